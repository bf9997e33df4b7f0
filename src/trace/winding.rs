//! Whether a ray leaves a solid that it began in: somewhere on its way it has met more backs than fronts.
//!
//! In: [`Tracer`] and a ray. Out: yes or no. Where solids go through each other, as walls do at the corners of a room, the
//! nearest hit alone does not say that a point lies in one of them.
//!
//! What lies behind does not matter: the walls of a room around a solid show their fronts to a ray that has left the solid.
//! Double-sided and transparent surfaces do not count: they bound no solid. Of faces that lie on each other fronts come
//! first, so that a crate in the open that stands on a floor is left by no ray that comes from above.

use super::build::{Packet, WIDTH};
use super::lanes::{Lanes, Portable};
use super::stack::Stack;
use super::traverse::{Slab, limit};
use super::triangle::{Shear, ShearLanes};
use super::{Ray, Ray3, Tracer};
use glam::DVec3;

impl Tracer<'_> {
    /// Of single-sided opaque surfaces with 0 < t < `t_max`, the nearest so many hold more backs than fronts, for some
    /// number of them. False for rays without direction.
    #[must_use]
    pub fn leaves_solid(&self, ray: &Ray) -> bool {
        let ray = Ray3::from(ray);
        let valid = ray.origin.is_finite() && ray.direction.is_finite() && ray.t_max > 0.0;
        if !valid || ray.direction == DVec3::ZERO || self.hierarchy.nodes.is_empty() {
            return false;
        }
        let shear = Shear::new(ray.origin, ray.direction);
        let (slab, lanes) = (Slab::<Portable>::new(self, ray.origin, &shear), ShearLanes::<Portable>::new(&shear));
        let limit = limit(ray.t_max, shear.scale());
        let (mut met, mut stack, mut child) = (vec![], Stack::new(), self.hierarchy.root);
        loop {
            if let Some((packet, count)) = child.as_packet() {
                let packet = &self.hierarchy.packets[packet];
                let mut mask = lanes.filter(packet, &shear) & ((1 << count) - 1);
                while mask != 0 {
                    let lane = mask.trailing_zeros() as usize % WIDTH;
                    mask &= mask - 1;
                    let crossing = shear.cross(packet, lane).filter(|c| (0.0..ray.t_max).contains(&(c.t() as f32)));
                    if let Some(crossing) = crossing.filter(|_| self.bounds_solid(packet.triangles[lane])) {
                        met.push((crossing.t() as f32, if crossing.front() { -1 } else { 1 }));
                    }
                }
            } else {
                let node = &self.hierarchy.nodes[child.as_node()];
                let (near, mask) = slab.meet(node, Portable::splat(limit));
                if mask != 0 {
                    child = stack.push_all_but_nearest(node, &near.store().0, mask);
                    continue;
                }
            }
            let Some(next) = stack.pop(limit) else { break };
            child = next;
        }
        met.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        met.iter()
            .scan(0, |sum, (_, side)| {
                *sum += side;
                Some(*sum)
            })
            .any(|sum| sum > 0)
    }

    fn bounds_solid(&self, tagged: u32) -> bool {
        tagged & Packet::TRANSPARENT == 0 && !self.scene.material(tagged).is_two_sided()
    }
}
