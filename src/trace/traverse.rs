//! Walks the hierarchy along one ray.
//!
//! In: [`Tracer`] and [`Ray3`]. Out: the nearest hit, or any hit at all.
//!
//! Source of the box test: Ize, "Robust BVH Ray Traversal", JCGT 2(2), 2013. Distances to the planes of a box are
//! bounded on the safe side, see `Lanes::plane`. Where we differ: reciprocals are clamped to 2¹⁰⁰, so that a zero
//! component of the direction makes no NaN. That is safe because no triangle reaches the border of its box (see
//! `build`): for an origin on a triangle's own plane the far plane is at least 2⁻⁴⁰ of the scene away, and 2⁶⁰ scene
//! sizes off along the ray.
//!
//! Distances inside are measured along the largest axis of the direction (`t · scale`), so that directions of any
//! length work; what is compared and returned is the f32 t.
//!
//! Everything up to the entry points in `avx2` and [`super::Tracer`] is inlined by force, so that it is compiled once
//! for each kind of [`Lanes`].
//!
//! Tried, with 20 and 200 thousand triangles: reciprocals without the division in `Shear`, and the sign of t before
//! that division, 2 to 5 % slower; on top of them, one or two children pushed without a branch, 1 % slower still. No
//! prefetches: nearest hit 6 and 18 % slower. For any hit, to ask for the next child alone: a difference within the
//! noise. Any hit accepted in f32 where all margins are clear: no gain, a hit saves what the packets before it cost.
//!
//! Invariants: nothing is culled that could be nearer than the best hit or equally near, so ties go to the smallest
//! index whatever the order of visits. The stack grows: no depth is too large.

use super::Hit;
use super::Ray3;
use super::Tracer;
use super::build::Child;
use super::build::Node;
use super::build::Packet;
use super::build::WIDTH;
use super::lanes::Lanes;
use super::lanes::SLACK;
use super::stack::Stack;
use super::triangle::Crossing;
use super::triangle::Shear;
use super::triangle::ShearLanes;
use crate::base::random::Stage;
use crate::base::random::Stream;
use crate::base::random::mix;
use glam::{Vec2, Vec3};

/// Largest reciprocal of a direction component relative to the largest one.
const STEEPEST: f32 = (1u128 << 100) as f32;

/// The nearest hit, or with `ANY` the first one found. `None` also for rays that are not finite, have no direction or
/// no length.
#[inline(always)]
pub(super) fn traverse<L: Lanes, const ANY: bool>(tracer: &Tracer<'_>, ray: Ray3) -> Option<Hit> {
    if !ray.is_valid() || tracer.hierarchy.nodes.is_empty() {
        return None;
    }
    let shear = Shear::new(ray.origin, ray.direction);
    if ANY { any::<L>(tracer, &ray, &shear) } else { closest::<L>(tracer, &ray, &shear) }
}

/// What is known of the nearest hit so far.
pub(super) struct Best {
    /// Hits must be nearer, or equally near with a smaller rank.
    pub(super) t: f32,
    /// Of [`rank`]. 0 while there is none: no rank is smaller, so a hit at `t_max` is none.
    pub(super) rank: u32,
    pub(super) crossing: Option<Crossing>,
}

/// Order of hits at the same distance: fronts first, as of a face that is there once for each side the other one is what is
/// seen; then by triangle.
#[inline(always)]
pub(super) fn rank(triangle: u32, front: bool) -> u32 {
    triangle | u32::from(!front) << 31
}

impl Best {
    pub(super) fn nothing_before(t: f32) -> Self {
        Self { t, rank: 0, crossing: None }
    }

    /// Nothing if there is none.
    #[inline(always)]
    pub(super) fn hit(&self) -> Option<Hit> {
        let triangle = self.rank & !(1 << 31);
        self.crossing.as_ref().map(|c| Hit { triangle, b: c.weights(), t: self.t, front: c.front() })
    }
}

#[inline(always)]
fn closest<L: Lanes>(tracer: &Tracer<'_>, ray: &Ray3, shear: &Shear) -> Option<Hit> {
    let slab = Slab::<L>::new(tracer, ray.origin, shear);
    let lanes = ShearLanes::<L>::new(shear);
    let mut best = Best::nothing_before(ray.t_max);
    let mut limit = limit(ray.t_max, shear.scale());
    let mut stack = Stack::new();
    let mut child = tracer.hierarchy.root;
    loop {
        if let Some((packet, count)) = child.as_packet() {
            let packet = &tracer.hierarchy.packets[packet];
            L::prefetch(packet.triangles.as_ptr().addr());
            let own = L::equal(&packet.triangles, ray.passes);
            let mut mask = lanes.filter(packet, shear) & ((1 << count) - 1) & !own;
            let mut improved = false;
            while mask != 0 {
                let lane = mask.trailing_zeros() as usize % WIDTH;
                mask &= mask - 1;
                improved |= improve(tracer, ray, shear, packet, lane, &mut best);
            }
            if improved {
                limit = self::limit(best.t, shear.scale());
            }
        } else {
            let node = &tracer.hierarchy.nodes[child.as_node()];
            L::prefetch(node.children.as_ptr().addr());
            let (near, mask) = slab.meet(node, L::splat(limit));
            prefetch_later::<L>(tracer, node, mask);
            if mask != 0 {
                child = stack.push_all_but_nearest(node, &near.store().0, mask);
                continue;
            }
        }
        let Some(next) = stack.pop(limit) else { break };
        child = next;
    }
    best.hit()
}

#[inline(always)]
fn any<L: Lanes>(tracer: &Tracer<'_>, ray: &Ray3, shear: &Shear) -> Option<Hit> {
    let slab = Slab::<L>::new(tracer, ray.origin, shear);
    let lanes = ShearLanes::<L>::new(shear);
    let limit = L::splat(limit(ray.t_max, shear.scale()));
    let mut stack = Stack::new();
    let mut index = tracer.hierarchy.root.as_node();
    let mut node = &tracer.hierarchy.nodes[index];
    let mut mask = slab.meet(node, limit).1;
    loop {
        // Children are in a good order already (see `build`): the next one is the lowest bit.
        while mask == 0 {
            (index, mask) = stack.pop_rest()?;
            node = &tracer.hierarchy.nodes[index];
        }
        let child = node.children[mask.trailing_zeros() as usize % WIDTH];
        mask &= mask - 1;
        if let Some((packet, count)) = child.as_packet() {
            let packet = &tracer.hierarchy.packets[packet];
            let own = L::equal(&packet.triangles, ray.passes);
            let mut passed = lanes.filter(packet, shear) & ((1 << count) - 1) & !own;
            while passed != 0 {
                let lane = passed.trailing_zeros() as usize % WIDTH;
                passed &= passed - 1;
                let mut best = Best::nothing_before(ray.t_max);
                if improve(tracer, ray, shear, packet, lane, &mut best) {
                    return best.hit();
                }
            }
        } else {
            if mask != 0 {
                stack.push_rest(index, mask);
            }
            index = child.as_node();
            node = &tracer.hierarchy.nodes[index];
            L::prefetch(node.children.as_ptr().addr());
            mask = slab.meet(node, limit).1;
            prefetch_later::<L>(tracer, node, mask);
        }
    }
}

/// Asks for all children in `mask` but the lowest, which is needed at once.
#[inline(always)]
fn prefetch_later<L: Lanes>(tracer: &Tracer<'_>, node: &Node, mask: u32) {
    let mut later = mask & mask.wrapping_sub(1);
    while later != 0 {
        prefetch::<L>(tracer, node.children[later.trailing_zeros() as usize % WIDTH]);
        later &= later - 1;
    }
}

/// Asks for the first four cache lines of a child. No branch: whether it is a node or a packet cannot be predicted.
#[inline(always)]
pub(super) fn prefetch<L: Lanes>(tracer: &Tracer<'_>, child: Child) {
    let (nodes, packets) = (tracer.hierarchy.nodes.as_ptr().addr(), tracer.hierarchy.packets.as_ptr().addr());
    let node = nodes.wrapping_add(child.index() * size_of::<Node>());
    let packet = packets.wrapping_add(child.index() * size_of::<Packet>());
    let address = core::hint::select_unpredictable(child.as_packet().is_some(), packet, node);
    for line in 0..4 {
        L::prefetch(address.wrapping_add(64 * line));
    }
}

/// Upper bound of the inner distance of hits whose f32 t is `t` or less.
#[inline(always)]
pub(super) fn limit(t: f32, scale: f64) -> f32 {
    ((f64::from(t) * scale) as f32 * SLACK).next_up()
}

/// The exact test of one triangle; whether it is the best one now.
#[inline(always)]
pub(super) fn improve(
    tracer: &Tracer<'_>,
    ray: &Ray3,
    shear: &Shear,
    packet: &Packet,
    lane: usize,
    best: &mut Best,
) -> bool {
    let Some(crossing) = shear.cross(packet, lane) else { return false };
    take(tracer, ray, crossing, packet.triangles[lane], best)
}

/// Takes a crossing, of a triangle as packets have it, if it is the best one now.
#[inline(always)]
pub(super) fn take(tracer: &Tracer<'_>, ray: &Ray3, crossing: Crossing, tagged: u32, best: &mut Best) -> bool {
    let t = crossing.t() as f32;
    let triangle = tagged & !Packet::TRANSPARENT;
    // Bitwise, because neither side of a short cut would be predicted.
    let rank = rank(triangle, crossing.front());
    if !((t > 0.0) & ((t < best.t) | ((t == best.t) & (rank < best.rank)))) {
        return false;
    }
    // Others are left out by their lanes; those of copies and transparent ones have another number there.
    if triangle == ray.passes {
        return false;
    }
    if tagged & Packet::TRANSPARENT != 0 && (ray.clear || !stops(tracer, ray, triangle, crossing.weights())) {
        return false;
    }
    *best = Best { t, rank, crossing: Some(crossing) };
    true
}

/// Whether a transparent triangle stops this ray: the same answer in every query with this origin and direction.
#[cold]
#[inline(never)]
fn stops(tracer: &Tracer<'_>, query: &Ray3, triangle: u32, b: Vec2) -> bool {
    let opacity = tracer.scene.opacity(triangle, b);
    let [x, y, z] = query.origin.to_array().map(|v| u64::from(v.to_bits()));
    let mut ray = mix(x << 32 | y) ^ z;
    for d in query.direction.to_array() {
        ray = mix(ray).wrapping_add(d.to_bits());
    }
    Stream::new(0, Stage::Alpha, ray, u64::from(triangle)).next_f32() < opacity
}

/// A ray, prepared for boxes.
pub(super) struct Slab<L> {
    /// Of [`Lanes::plane`], by axis; near planes, then far ones.
    axes: [[[L; 2]; 2]; 3],
    /// Which side of a box the ray enters through, by axis: 0 = smallest coordinate.
    enter: [usize; 3],
}

impl<L: Lanes> Slab<L> {
    #[inline(always)]
    pub(super) fn new(tracer: &Tracer<'_>, origin: Vec3, shear: &Shear) -> Self {
        let reach = origin.abs().max_element().max(tracer.hierarchy.reach() as f32);
        let [x, y, z] = shear.unit.to_array();
        let [x, y, z] = [negative_inverse(x), negative_inverse(y), negative_inverse(z)];
        Self {
            axes: [L::axis(origin.x, x, reach), L::axis(origin.y, y, reach), L::axis(origin.z, z, reach)],
            enter: [usize::from(x > 0.0), usize::from(y > 0.0), usize::from(z > 0.0)],
        }
    }

    /// For boxes that are known to be within `slack` of where their nodes have them, or a ray as far off; `reach` bounds
    /// all coordinates.
    #[inline(always)]
    pub(super) fn within(origin: Vec3, shear: &Shear, reach: f32, slack: f32) -> Self {
        // Not by `map`: its closure is a call in code for newer processors, and lanes go to it through memory.
        let x = Self::axis_within(origin.x, shear.unit.x, reach, slack);
        let y = Self::axis_within(origin.y, shear.unit.y, reach, slack);
        let z = Self::axis_within(origin.z, shear.unit.z, reach, slack);
        Self { axes: [x.0, y.0, z.0], enter: [x.1, y.1, z.1] }
    }

    #[inline(always)]
    fn axis_within(origin: f32, direction: f32, reach: f32, slack: f32) -> ([[L; 2]; 2], usize) {
        let inverse = negative_inverse(direction);
        let ahead = slack.copysign(-inverse);
        let [near, _] = L::axis(origin + ahead, inverse, reach + slack);
        let [_, far] = L::axis(origin - ahead, inverse, reach + slack);
        ([near, far], usize::from(inverse > 0.0))
    }

    /// Inner distances to the eight boxes, and a bit for each that is met before `limit`.
    #[inline(always)]
    pub(super) fn meet(&self, node: &Node, limit: L) -> (L, u32) {
        // Taken from memory where they are used: there are more of them than registers.
        let [x, y, z] = &self.axes;
        let [sx, sy, sz] = &node.bounds;
        let [ex, ey, ez] = self.enter;
        let (nx, fx) = (L::plane(&sx[ex & 1], x[0]), L::plane(&sx[!ex & 1], x[1]));
        let (ny, fy) = (L::plane(&sy[ey & 1], y[0]), L::plane(&sy[!ey & 1], y[1]));
        let (nz, fz) = (L::plane(&sz[ez & 1], z[0]), L::plane(&sz[!ez & 1], z[1]));
        let near = nx.most(ny).most(nz.most(L::splat(0.0)));
        let far = fx.least(fy).least(fz.least(limit));
        (near, near.at_most(far))
    }
}

#[inline(always)]
fn negative_inverse(unit: f32) -> f32 {
    // Of the two zeros the sign decides which planes are the near ones; either is right.
    (-1.0 / unit).clamp(-STEEPEST, STEEPEST)
}
