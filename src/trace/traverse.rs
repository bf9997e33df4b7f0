//! Walks the hierarchy along one ray.
//!
//! In: [`Query`]. Out: the nearest hit, or any hit at all.
//!
//! Source of the box test: Ize, "Robust BVH Ray Traversal", JCGT 2(2), 2013. Distances to the planes of a box have three
//! roundings each, so the far one is enlarged by [`SLACK`]. Where we differ: reciprocals are clamped to 2¹⁰⁰, so that a
//! zero component of the direction makes no NaN. That is safe because no triangle reaches the border of its box (see
//! `build`): for an origin on a triangle's own plane the far plane is at least 2⁻⁴⁰ of the scene away, and 2⁶⁰ scene
//! sizes off along the ray.
//!
//! Distances inside are measured along the largest axis of the direction (`t · scale`), so that directions of any length
//! work; what is compared and returned is the f32 t.
//!
//! Invariants: nothing is culled that could be nearer than the best hit or equally near, so ties go to the smallest
//! index whatever the order of visits. The stack grows: no depth is too large.

use super::Hit;
use super::Tracer;
use super::build::Child;
use super::build::LANES;
use super::build::Node;
use super::build::Packet;
use super::build::WIDTH;
use super::triangle::Shear;
use crate::base::random::Stage;
use crate::base::random::Stream;
use crate::base::random::mix;
use glam::{DVec3, Vec2, Vec3, Vec4};

/// (1 + ε)³/(1 − ε)³ with ε = 2⁻²⁴ is 1 + 6ε; this is 1 + 16ε.
const SLACK: f32 = 1.0 + 1.0 / (1u32 << 20) as f32;
/// Largest reciprocal of a direction component relative to the largest one.
const STEEPEST: f64 = (1u128 << 100) as f64;
/// Entries before the stack moves to the heap. A node leaves at most seven there, mostly one.
const STACK: usize = 64;

/// A ray, prepared.
pub(super) struct Query {
    origin: Vec3,
    direction: DVec3,
    t_max: f32,
    /// Length of the direction along its largest axis.
    scale: f64,
    origin_lanes: [Vec4; 3],
    /// Reciprocal of direction/scale.
    inverse_lanes: [Vec4; 3],
    /// Which side of a box the ray enters through, by axis: 0 = smallest coordinate.
    enter: [usize; 3],
    shear: Shear,
}

impl Query {
    /// `None` for rays that meet nothing: not finite, no direction, no length.
    pub(super) fn new(origin: Vec3, direction: DVec3, t_max: f32) -> Option<Self> {
        let scale = direction.abs().max_element();
        // Written so that NaN fails.
        if !(origin.is_finite() && direction.is_finite() && scale > 0.0 && t_max > 0.0) {
            return None;
        }
        let inverse = direction.to_array().map(|d| (scale / d).clamp(-STEEPEST, STEEPEST) as f32);
        Some(Self {
            origin,
            direction,
            t_max,
            scale,
            origin_lanes: origin.to_array().map(Vec4::splat),
            inverse_lanes: inverse.map(Vec4::splat),
            enter: inverse.map(|i| usize::from(i < 0.0)),
            shear: Shear::new(origin, direction),
        })
    }

    /// Upper bound of the inner distance of hits whose f32 t is `t` or less.
    fn limit(&self, t: f32) -> f32 {
        ((f64::from(t) * self.scale) as f32 * SLACK).next_up()
    }

    /// Inner distances to the eight boxes, and a bit for each that is met before `limit`.
    #[inline]
    fn boxes(&self, node: &Node, limit: f32) -> ([Vec4; 2], u32) {
        let mut distances = [Vec4::ZERO; 2];
        let mut mask = 0;
        for (half, distance) in distances.iter_mut().enumerate() {
            let mut near = Vec4::ZERO;
            let mut far = Vec4::splat(limit);
            for axis in 0..3 {
                let sides = &node.bounds[axis];
                let (o, i) = (self.origin_lanes[axis], self.inverse_lanes[axis]);
                near = ((sides[self.enter[axis] & 1][half] - o) * i).max(near);
                far = ((sides[!self.enter[axis] & 1][half] - o) * i).min(far);
            }
            mask |= near.cmple(far * SLACK).bitmask() << (4 * half);
            *distance = near;
        }
        (distances, mask)
    }
}

/// A box to visit, and the inner distance to it.
type Visit = (f32, Child);

/// A stack whose first entries need no heap.
struct Stack {
    local: [Visit; STACK],
    spill: Vec<Visit>,
    len: usize,
}

impl Stack {
    fn new() -> Self {
        Self { local: [(0.0, Child::ROOT); STACK], spill: Vec::new(), len: 0 }
    }

    #[inline]
    fn push(&mut self, visit: Visit) {
        if self.len < STACK {
            self.local[self.len] = visit;
        } else {
            self.spill.push(visit);
        }
        self.len += 1;
    }

    #[inline]
    fn pop(&mut self) -> Option<Visit> {
        self.len = self.len.checked_sub(1)?;
        if self.len < STACK { Some(self.local[self.len]) } else { self.spill.pop() }
    }
}

impl Tracer<'_> {
    /// The nearest hit, or with `ANY` the first one found.
    pub(super) fn traverse<const ANY: bool>(&self, query: &Query) -> Option<Hit> {
        if self.hierarchy.nodes.is_empty() {
            return None;
        }
        let mut best: Option<Hit> = None;
        let mut limit = query.limit(query.t_max);
        let mut stack = Stack::new();
        stack.push((0.0, Child::ROOT));
        while let Some((distance, child)) = stack.pop() {
            if distance > limit {
                continue;
            }
            if let Some((packet, count)) = child.as_packet() {
                if self.meet(query, &self.hierarchy.packets[packet], count, &mut best) {
                    if ANY {
                        return best;
                    }
                    limit = best.map_or(limit, |hit| query.limit(hit.t));
                }
            } else {
                let node = &self.hierarchy.nodes[child.as_node()];
                let (distances, mask) = query.boxes(node, limit);
                push_children::<ANY>(&mut stack, node, distances, mask);
            }
        }
        best
    }

    /// Tests the triangles of a packet; whether `best` was improved.
    #[inline]
    fn meet(&self, query: &Query, packet: &Packet, count: usize, best: &mut Option<Hit>) -> bool {
        let mut improved = false;
        let mut mask = query.shear.filter(packet, count);
        while mask != 0 {
            let lane = mask.trailing_zeros() as usize % LANES;
            mask &= mask - 1;
            let Some(crossing) = query.shear.cross(packet, lane) else { continue };
            let t = crossing.t as f32;
            let triangle = packet.triangles[lane] & !Packet::TRANSPARENT;
            let nearer = match best {
                Some(hit) => t < hit.t || (t == hit.t && triangle < hit.triangle),
                None => t < query.t_max,
            };
            if t > 0.0 && nearer {
                let b = Vec2::new(crossing.b[0] as f32, crossing.b[1] as f32);
                if packet.triangles[lane] & Packet::TRANSPARENT == 0 || self.stops(query, triangle, b) {
                    *best = Some(Hit { triangle, b, t, front: crossing.front });
                    improved = true;
                }
            }
        }
        improved
    }

    /// Whether a transparent triangle stops this ray: the same answer in every query with this origin and direction.
    #[cold]
    fn stops(&self, query: &Query, triangle: u32, b: Vec2) -> bool {
        let opacity = self.scene.opacity(triangle, b);
        let [x, y, z] = query.origin.to_array().map(|v| u64::from(v.to_bits()));
        let mut ray = mix(x << 32 | y) ^ z;
        for d in query.direction.to_array() {
            ray = mix(ray).wrapping_add(d.to_bits());
        }
        Stream::new(0, Stage::Alpha, ray, u64::from(triangle)).next_f32() < opacity
    }
}

/// Pushes the boxes that were met, the nearest last (in any order with `ANY`).
#[inline]
fn push_children<const ANY: bool>(stack: &mut Stack, node: &Node, distances: [Vec4; 2], mut mask: u32) {
    let [low, high] = distances.map(|d| d.to_array());
    let mut met = [(0.0, Child::ROOT); WIDTH];
    let mut n = 0;
    while mask != 0 {
        let i = mask.trailing_zeros() as usize % WIDTH;
        mask &= mask - 1;
        let visit = (if i < 4 { low[i] } else { high[i - 4] }, node.children[i]);
        if ANY {
            stack.push(visit);
            continue;
        }
        let mut at = n;
        while at > 0 && met[at - 1].0 < visit.0 {
            met[at] = met[at - 1];
            at -= 1;
        }
        met[at] = visit;
        n += 1;
    }
    for &visit in &met[..n] {
        stack.push(visit);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_stack_spills_and_comes_back_in_order() {
        let mut stack = Stack::new();
        for i in 0..3 * STACK {
            stack.push((i as f32, Child::ROOT));
        }
        for i in (0..3 * STACK).rev() {
            assert_eq!(stack.pop().unwrap().0, i as f32);
        }
        assert!(stack.pop().is_none());
    }

    #[test]
    fn broken_rays_are_refused() {
        let bad = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY];
        for v in bad {
            assert!(Query::new(Vec3::new(0.0, v, 0.0), DVec3::X, 1.0).is_none());
            assert!(Query::new(Vec3::ZERO, Vec3::new(1.0, v, 0.0).as_dvec3(), 1.0).is_none());
        }
        for t_max in [f32::NAN, 0.0, -1.0, f32::NEG_INFINITY] {
            assert!(Query::new(Vec3::ZERO, DVec3::X, t_max).is_none());
        }
        assert!(Query::new(Vec3::ZERO, DVec3::ZERO, 1.0).is_none());
        assert!(Query::new(Vec3::ZERO, DVec3::X, f32::INFINITY).is_some());
    }
}
