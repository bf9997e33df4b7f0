//! Parts that share their geometry: one hierarchy in the space of each mesh, and a tree of the boxes of all copies.
//!
//! In: [`Scene`]. Out: [`Shared`], and all that a ray crosses in it.
//!
//! The answers are those, bit by bit, of a hierarchy of all triangles where they stand: boxes and the filter of the
//! triangle test are asked in the space of the mesh, where they only refuse, with room for what the world's coordinates
//! lose in rounding; then the triangle's corners are placed as [`Scene::corners`] does it, and the exact test decides in
//! the world. A ray starts anew, in the space of the mesh, where it enters the box of the copy: so f32 is enough there
//! however far it came.
//!
//! Memory: that of one hierarchy per mesh, and 400 bytes per copy.
//!
//! Symbols: δ (`slack`) bounds how far in the space of the mesh [its units] a corner or the ray is from where they are
//! in exact arithmetic.

use super::Hit;
use super::Ray3;
use super::Tracer;
use super::build::Child;
use super::build::Hierarchy;
use super::build::Packet;
use super::build::WIDTH;
use super::build::item;
use super::build::padded;
use super::lanes::Eight;
use super::lanes::Lanes;
use super::lanes::SLACK;
use super::split::Item;
use super::stack::Stack;
use super::traverse::Best;
use super::traverse::Slab;
use super::traverse::rank;
use super::traverse::take;
use super::triangle::Crossing;
use super::triangle::Shear;
use super::triangle::ShearLanes;
use crate::base::parallel;
use crate::scene::{Copied, Part, Placement, Scene};
use core::ops::Range;
use glam::{DMat4, DVec3, Vec3};
use std::collections::BTreeMap;

/// 2⁻²³: twice the relative error of rounding to f32.
const ROUNDING: f64 = 1.0 / (1u32 << 23) as f64;
/// Far above the relative error of a few operations in f64.
const ROUNDING_64: f64 = 1.0 / (1u64 << 48) as f64;

/// Branches that may be open at once: one per level of a tree that halves, and there are no more than 2³² copies.
const MOST_OPEN: usize = 34;

/// All copies of a scene.
#[derive(Default)]
pub(super) struct Shared {
    meshes: Vec<Mesh>,
    copies: Vec<Copy>,
    /// Forks of a binary tree over the copies, the root first.
    tree: Vec<Fork>,
    /// Smallest and largest coordinates, unpadded [m].
    pub(super) bounds: (Vec3, Vec3),
    /// Triangles of all copies.
    pub(super) triangle_count: usize,
}

/// A primitive in its own space.
struct Mesh {
    hierarchy: Hierarchy,
    /// Corners of its triangles, each once; empty when all copies are made.
    points: Vec<Vec3>,
}

/// A part that has the triangles of a mesh.
struct Copy {
    mesh: u32,
    /// Id of its first triangle.
    first: u32,
    placement: Placement,
    local_from_world: DMat4,
    /// Padded [m].
    bounds: (Vec3, Vec3),
    /// Part of δ that comes from the rounding of corners in the world.
    slack: f64,
}

/// Two branches with their boxes.
struct Fork {
    bounds: [(Vec3, Vec3); 2],
    branches: [Branch; 2],
}

#[derive(Clone, Copy)]
enum Branch {
    Fork(u32),
    Copy(u32),
}

/// A ray within a copy.
struct Within<L> {
    copy: u32,
    /// Where it starts anew, in units of its direction.
    start: f64,
    shear: Shear,
    slab: Slab<L>,
    lanes: ShearLanes<L>,
    slack: f32,
}

impl Shared {
    /// Of parts that are kept.
    pub(super) fn new(scene: &Scene, keep: impl Fn(&Part) -> bool) -> Self {
        let kept: Vec<Copied<'_>> = scene.copied().filter(|c| keep(&scene.parts[c.part])).collect();
        let mut stored: BTreeMap<u32, u32> = BTreeMap::new();
        for copied in &kept {
            let next = stored.len() as u32;
            stored.entry(copied.stored).or_insert(next);
        }
        let mut sources: Vec<Option<Range<u32>>> = vec![None; stored.len()];
        for copied in &kept {
            let count = scene.parts[copied.part].triangles.len() as u32;
            sources[stored[&copied.stored] as usize] = Some(copied.stored..copied.stored + count);
        }
        let sources: Vec<Range<u32>> = sources.into_iter().flatten().collect();
        let opaque = |copied: &Copied<'_>| scene.materials[scene.parts[copied.part].material].is_opaque();
        let is_opaque: BTreeMap<u32, bool> = kept.iter().map(|c| (c.stored, opaque(c))).collect();
        let mut meshes: Vec<Mesh> =
            sources.iter().map(|range| Mesh::new(scene, range.clone(), is_opaque[&range.start])).collect();
        let copies = parallel::map(kept.len(), |k| {
            let mesh = stored[&kept[k].stored];
            Copy::new(scene, &kept[k], mesh, &meshes[mesh as usize].points)
        });
        let all = copies.iter().map(|(_, bounds)| *bounds).reduce(both);
        let triangle_count = copies.iter().map(|(copy, _)| meshes[copy.mesh as usize].hierarchy.triangle_count).sum();
        let copies: Vec<Copy> = copies.into_iter().map(|(copy, _)| copy).collect();
        meshes.iter_mut().for_each(|mesh| mesh.points = vec![]);
        let mut shared = Self { meshes, copies, tree: vec![], bounds: all.unwrap_or_default(), triangle_count };
        let mut order: Vec<u32> = (0..shared.copies.len() as u32).collect();
        if !order.is_empty() {
            shared.fork(&mut order);
        }
        shared
    }

    pub(super) fn is_empty(&self) -> bool {
        self.copies.is_empty()
    }

    pub(super) fn node_count(&self) -> usize {
        self.tree.len() + self.meshes.iter().map(|m| m.hierarchy.node_count).sum::<usize>()
    }

    pub(super) fn memory_bytes(&self) -> usize {
        let meshes: usize = self.meshes.iter().map(|m| m.hierarchy.memory_bytes()).sum();
        meshes + self.copies.capacity() * size_of::<Copy>() + self.tree.capacity() * size_of::<Fork>()
    }

    /// Makes the fork over some copies, which are one or more: its number. Halves by number of the longest axis of their
    /// middles, so that the tree is no deeper than the logarithm of their number.
    fn fork(&mut self, order: &mut [u32]) -> u32 {
        let middle = |c: u32| {
            let (low, high) = self.copies[c as usize].bounds;
            low + (high - low) * 0.5
        };
        let (low, high) = order
            .iter()
            .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), &c| (low.min(middle(c)), high.max(middle(c))));
        let axis = (high - low).max_position();
        let half = order.len().div_ceil(2).min(order.len() - usize::from(order.len() > 1));
        if order.len() > 1 {
            order.select_nth_unstable_by(half, |&a, &b| middle(a)[axis].total_cmp(&middle(b)[axis]).then(a.cmp(&b)));
        }
        let number = self.tree.len();
        let nothing = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        self.tree.push(Fork { bounds: [nothing; 2], branches: [Branch::Fork(0); 2] });
        let (near, far) = order.split_at_mut(half);
        for (k, part) in [near, far].into_iter().enumerate() {
            let Some(&first) = part.first() else { continue };
            let boxes = part.iter().map(|&c| self.copies[c as usize].bounds).reduce(both);
            let branch = if part.len() == 1 { Branch::Copy(first) } else { Branch::Fork(self.fork(part)) };
            self.tree[number].bounds[k] = boxes.unwrap_or(nothing);
            self.tree[number].branches[k] = branch;
        }
        number as u32
    }

    /// Calls `found` for every triangle that the ray may cross below a bound: with the crossing, and the triangle as
    /// packets have it. `found` gives the next bound of t; below zero it ends.
    #[inline(always)]
    fn cross<L: Lanes>(&self, ray: &Ray3, world: &Shear, bound: f32, mut found: impl FnMut(Crossing, u32) -> f32) {
        let origin = ray.origin.as_dvec3();
        let inverse = ray.direction.recip();
        let mut bound = bound;
        let mut open = [(0.0, Branch::Fork(0)); MOST_OPEN];
        let mut count = 1;
        while count > 0 {
            count -= 1;
            let (entry, branch) = open[count];
            if entry > upper(bound) {
                continue;
            }
            match branch {
                Branch::Copy(copy) => {
                    let within = Within::<L>::new(self, copy, ray, entry);
                    bound = self.cross_copy(&within, world, bound, &mut found);
                    if bound < 0.0 {
                        return;
                    }
                }
                Branch::Fork(fork) => {
                    let fork = &self.tree[fork as usize];
                    // No closures over arrays in here: they are calls in code for newer processors, a fifth of the time.
                    let a = (entry_of(fork.bounds[0], origin, inverse, bound), fork.branches[0]);
                    let b = (entry_of(fork.bounds[1], origin, inverse, bound), fork.branches[1]);
                    let (near, far) = if a.0 <= b.0 { (a, b) } else { (b, a) };
                    if far.0 < f64::INFINITY {
                        open[count] = far;
                        count += 1;
                    }
                    if near.0 < f64::INFINITY {
                        open[count] = near;
                        count += 1;
                    }
                }
            }
        }
    }

    #[inline(always)]
    fn cross_copy<L: Lanes>(
        &self,
        within: &Within<L>,
        world: &Shear,
        mut bound: f32,
        found: &mut impl FnMut(Crossing, u32) -> f32,
    ) -> f32 {
        let copy = &self.copies[within.copy as usize];
        let hierarchy = &self.meshes[copy.mesh as usize].hierarchy;
        if hierarchy.nodes.is_empty() {
            return bound;
        }
        let mut limit = within.limit(bound);
        let mut stack = Stack::new();
        let mut child = hierarchy.root;
        loop {
            if let Some((packet, count)) = child.as_packet() {
                let packet = &hierarchy.packets[packet];
                let mut mask =
                    within.lanes.filter_within::<true>(packet, &within.shear, within.slack) & ((1 << count) - 1);
                while mask != 0 {
                    let lane = mask.trailing_zeros() as usize % WIDTH;
                    mask &= mask - 1;
                    let Some(crossing) = copy.cross(packet, lane, world) else { continue };
                    bound = found(crossing, packet.triangles[lane] + copy.first);
                    if bound < 0.0 {
                        return bound;
                    }
                    limit = within.limit(bound);
                }
            } else {
                let node = &hierarchy.nodes[child.as_node()];
                let (near, mask) = within.slab.meet(node, L::splat(limit));
                if mask != 0 {
                    child = stack.push_all_but_nearest(node, &near.store().0, mask);
                    continue;
                }
            }
            let Some(next) = stack.pop(limit) else { break };
            child = next;
        }
        bound
    }

    /// The nearest hit, or `before`, which was found elsewhere.
    #[inline(always)]
    pub(super) fn closest<L: Lanes>(&self, tracer: &Tracer<'_>, ray: &Ray3, before: Option<Hit>) -> Option<Hit> {
        if !ray.is_valid() {
            return before;
        }
        let shear = Shear::new(ray.origin, ray.direction);
        let (t, rank) = before.map_or((ray.t_max, 0), |hit| (hit.t, rank(hit.triangle, hit.front)));
        let mut best = Best { t, rank, crossing: None };
        self.cross::<L>(ray, &shear, t, |crossing, tagged| {
            take(tracer, ray, crossing, tagged, &mut best);
            best.t
        });
        best.hit().or(before)
    }

    /// Whether there is any hit.
    #[inline(always)]
    pub(super) fn any<L: Lanes>(&self, tracer: &Tracer<'_>, ray: &Ray3) -> bool {
        if !ray.is_valid() {
            return false;
        }
        let shear = Shear::new(ray.origin, ray.direction);
        let mut is_met = false;
        self.cross::<L>(ray, &shear, ray.t_max, |crossing, tagged| {
            let mut best = Best::nothing_before(ray.t_max);
            is_met = take(tracer, ray, crossing, tagged, &mut best);
            if is_met { -1.0 } else { ray.t_max }
        });
        is_met
    }

    /// Calls `visit` for all that a valid ray may cross, in no certain order, as long as that returns true: whether it
    /// always did.
    pub(super) fn each<L: Lanes>(
        &self,
        ray: &Ray3,
        shear: &Shear,
        mut visit: impl FnMut(Crossing, u32) -> bool,
    ) -> bool {
        let mut go_on = true;
        self.cross::<L>(ray, shear, ray.t_max, |crossing, tagged| {
            go_on = visit(crossing, tagged);
            if go_on { ray.t_max } else { -1.0 }
        });
        go_on
    }

    /// Some triangle that `matters` may reach into the box from `low` to `high` [m].
    pub(super) fn any_within(&self, low: Vec3, high: Vec3, matters: &mut impl FnMut(u32) -> bool) -> bool {
        let mut open = vec![Branch::Fork(0)];
        while let Some(branch) = open.pop() {
            match branch {
                Branch::Copy(copy) => {
                    let copy = &self.copies[copy as usize];
                    if copy.any_within(&self.meshes[copy.mesh as usize].hierarchy, low, high, matters) {
                        return true;
                    }
                }
                Branch::Fork(fork) => {
                    let fork = &self.tree[fork as usize];
                    let meets = |k: &usize| {
                        let (from, to) = fork.bounds[*k];
                        from.cmple(high).all() && to.cmpge(low).all()
                    };
                    open.extend((0..2).filter(meets).map(|k| fork.branches[k]));
                }
            }
        }
        false
    }
}

fn both(a: (Vec3, Vec3), b: (Vec3, Vec3)) -> (Vec3, Vec3) {
    (a.0.min(b.0), a.1.max(b.1))
}

/// Largest distance that is rounded to this one, or more.
fn upper(t: f32) -> f64 {
    f64::from(t) * (1.0 + ROUNDING)
}

/// Where a ray enters a box, in units of its direction; infinite if it misses it or does so beyond the bound.
#[inline]
fn entry_of((low, high): (Vec3, Vec3), origin: DVec3, inverse: DVec3, bound: f32) -> f64 {
    // 0 · ∞ is no number, which min and max leave out: that plane then bounds nothing.
    let (a, b) = ((low.as_dvec3() - origin) * inverse, (high.as_dvec3() - origin) * inverse);
    let entry = a.min(b).max_element().max(0.0);
    let exit = a.max(b).min_element().min(upper(bound));
    if entry <= exit * (1.0 + ROUNDING_64) { entry } else { f64::INFINITY }
}

impl Mesh {
    fn new(scene: &Scene, stored: Range<u32>, opaque: bool) -> Self {
        let corners = |t: u32| scene.stored_positions(t + stored.start);
        let items: Vec<Item> = (0..stored.end - stored.start).filter_map(|t| item(t, corners(t), opaque)).collect();
        let key = |p: &Vec3| p.to_array().map(f32::to_bits);
        let mut points: Vec<Vec3> = items.iter().flat_map(|i| corners(i.triangle())).collect();
        points.sort_unstable_by_key(key);
        points.dedup_by_key(|p| key(p));
        Self { hierarchy: Hierarchy::of(items, corners, 0.0), points }
    }
}

impl Copy {
    /// And its box, unpadded [m].
    fn new(scene: &Scene, copied: &Copied<'_>, mesh: u32, points: &[Vec3]) -> (Self, (Vec3, Vec3)) {
        let placement = copied.placement.clone();
        let nothing = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        let (low, high) = points.iter().map(|p| placement.position(*p)).fold(nothing, |b, p| both(b, (p, p)));
        let reach = low.abs().max(high.abs()).max_element();
        let bounds = padded((low, high), reach);
        let local_from_world = placement.world.inverse();
        let slack = ROUNDING * f64::from(reach) * size(local_from_world);
        let first = scene.parts[copied.part].triangles.start;
        (Self { mesh, first, placement, local_from_world, bounds, slack }, (low, high))
    }

    /// A triangle of the mesh, where it stands in the world.
    #[inline(always)]
    fn corners(&self, packet: &Packet, lane: usize) -> [Vec3; 3] {
        let [a, b, c] = &packet.corners;
        let (b, c) = if self.placement.mirrored { (c, b) } else { (b, c) };
        [self.corner(a, lane), self.corner(b, lane), self.corner(c, lane)]
    }

    #[inline(always)]
    fn corner(&self, [x, y, z]: &[Eight; 3], lane: usize) -> Vec3 {
        self.placement.position(Vec3::new(x.0[lane], y.0[lane], z.0[lane]))
    }

    #[inline(always)]
    fn cross(&self, packet: &Packet, lane: usize, world: &Shear) -> Option<Crossing> {
        let corners = self.corners(packet, lane);
        // Rounding may have made it flat.
        world.cross_points(corners).filter(|_| item(0, corners, true).is_some())
    }

    fn any_within(&self, hierarchy: &Hierarchy, low: Vec3, high: Vec3, matters: &mut impl FnMut(u32) -> bool) -> bool {
        if hierarchy.nodes.is_empty() {
            return false;
        }
        let (middle, half) = ((low.as_dvec3() + high.as_dvec3()) * 0.5, (high.as_dvec3() - low.as_dvec3()) * 0.5);
        let m = self.local_from_world;
        let middle_here = m.transform_point3(middle);
        let [x, y, z] = [m.x_axis, m.y_axis, m.z_axis].map(|axis| axis.truncate().abs());
        let lost = self.slack + ROUNDING * middle_here.abs().max_element();
        let half_here = x * half.x + y * half.y + z * half.z + lost;
        let (from, to) = ((middle_here - half_here).as_vec3(), (middle_here + half_here).as_vec3());
        let mut open: Vec<Child> = vec![hierarchy.root];
        while let Some(child) = open.pop() {
            if let Some((packet, count)) = child.as_packet() {
                let packet = &hierarchy.packets[packet];
                let meets = |lane: usize| {
                    let [a, b, c] = self.corners(packet, lane);
                    a.min(b).min(c).cmple(high).all() && a.max(b).max(c).cmpge(low).all()
                };
                let id = |lane: usize| (packet.triangles[lane] & !Packet::TRANSPARENT) + self.first;
                if (0..count).any(|lane| meets(lane) && matters(id(lane))) {
                    return true;
                }
                continue;
            }
            let node = &hierarchy.nodes[child.as_node()];
            let meets = |k: &usize| {
                (0..3).all(|axis| {
                    let [lowest, highest]: &[Eight; 2] = &node.bounds[axis];
                    lowest.0[*k] <= to[axis] && highest.0[*k] >= from[axis]
                })
            };
            open.extend((0..WIDTH).filter(meets).map(|k| node.children[k]));
        }
        false
    }
}

/// Bounds by how much a transform makes vectors longer.
fn size(m: DMat4) -> f64 {
    [m.x_axis, m.y_axis, m.z_axis].iter().map(|c| c.truncate().length_squared()).sum::<f64>().sqrt()
}

impl<L: Lanes> Within<L> {
    #[inline(always)]
    fn new(shared: &Shared, copy: u32, ray: &Ray3, start: f64) -> Self {
        let own = &shared.copies[copy as usize];
        let direction = own.local_from_world.transform_vector3(ray.direction);
        let origin = own.local_from_world.transform_point3(ray.origin.as_dvec3());
        let moved = origin + direction * start;
        let way = ray.origin.as_dvec3().abs().max_element() * size(own.local_from_world)
            + own.local_from_world.w_axis.truncate().abs().max_element()
            + direction.abs().max_element() * start;
        let slack = own.slack + ROUNDING * moved.abs().max_element() + ROUNDING_64 * way;
        let (here, slack) = (moved.as_vec3(), (2.0 * slack) as f32);
        let shear = Shear::new(here, direction);
        let reach = here.abs().max_element().max(shared.meshes[own.mesh as usize].hierarchy.reach() as f32);
        let slab = Slab::within(here, &shear, reach, slack);
        let lanes = ShearLanes::new(&shear);
        Self { copy, start, shear, slab, lanes, slack }
    }

    /// Upper bound of the inner distance of hits up to `t`.
    #[inline(always)]
    fn limit(&self, t: f32) -> f32 {
        let way = (upper(t) - self.start).max(0.0) * self.shear.scale();
        ((way as f32 + 2.0 * self.slack) * SLACK).next_up()
    }
}
