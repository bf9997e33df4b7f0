//! Everything that a ray crosses, not only what it meets first.
//!
//! In: [`Tracer`] and [`Ray3`]. Out: a call for each triangle with 0 < t < `t_max`, until one says that it is enough, in
//! an order that depends on the hierarchy alone. The same box and triangle tests as in `traverse`, so nothing is
//! crossed here that stops no ray there.

use super::Ray3;
use super::Tracer;
use super::build::Child;
use super::build::Hierarchy;
use super::build::Node;
use super::build::Packet;
use super::build::WIDTH;
use super::lanes::Lanes;
use super::lanes::Portable;
use super::traverse::Slab;
use super::traverse::limit;
use super::triangle::Crossing;
use super::triangle::Shear;
use super::triangle::ShearLanes;
use glam::Vec2;

/// A triangle that a ray crosses.
pub(super) struct Crossed {
    pub(super) triangle: u32,
    /// Its material is not opaque.
    pub(super) transparent: bool,
    /// Distance in units of the ray's direction.
    pub(super) t: f32,
    /// The ray comes from the front side.
    pub(super) front: bool,
    crossing: Crossing,
}

impl Crossed {
    /// Weights of the triangle's vertices 1 and 2.
    pub(super) fn weights(&self) -> Vec2 {
        self.crossing.weights()
    }
}

impl Tracer<'_> {
    /// Calls `visit` for all of it, as long as that returns true. Rays that are not finite, or have no direction or length,
    /// cross nothing.
    pub(super) fn each_crossed(&self, ray: &Ray3, visit: impl FnMut(Crossed) -> bool) {
        self.crossed_in(&self.hierarchy, ray, visit);
    }

    /// Calls `visit` for all of it that lets light pass.
    pub(super) fn each_veil(&self, ray: &Ray3, mut visit: impl FnMut(Crossed)) {
        self.crossed_in(self.veils.as_ref().unwrap_or(&self.hierarchy), ray, |crossed| {
            if crossed.transparent {
                visit(crossed);
            }
            true
        });
    }

    /// The same for a part of what is not shared, and all that is.
    fn crossed_in(&self, hierarchy: &Hierarchy, ray: &Ray3, mut visit: impl FnMut(Crossed) -> bool) {
        if !ray.is_valid() {
            return;
        }
        let shear = Shear::new(ray.origin, ray.direction);
        let mut one = |crossing: Crossing, tagged: u32| {
            let t = crossing.t() as f32;
            if t <= 0.0 || t >= ray.t_max {
                return true;
            }
            let triangle = tagged & !Packet::TRANSPARENT;
            visit(Crossed { triangle, transparent: tagged != triangle, t, front: crossing.front(), crossing })
        };
        let go_on = self.shared.is_empty() || self.shared.each::<Portable>(ray, &shear, &mut one);
        if !go_on || hierarchy.nodes.is_empty() {
            return;
        }
        let (slab, lanes) = (Slab::<Portable>::new(self, ray.origin, &shear), ShearLanes::<Portable>::new(&shear));
        let most = Portable::splat(limit(ray.t_max, shear.scale()));
        let below = |node: &Node, open: &mut Vec<Child>| {
            let mask = slab.meet(node, most).1;
            open.extend((0..WIDTH).filter(|slot| mask >> slot & 1 == 1).map(|slot| node.children[slot]));
        };
        let mut open = vec![];
        below(&hierarchy.nodes[hierarchy.root.as_node()], &mut open);
        while let Some(child) = open.pop() {
            let Some((packet, count)) = child.as_packet() else {
                below(&hierarchy.nodes[child.as_node()], &mut open);
                continue;
            };
            let packet = &hierarchy.packets[packet];
            let mask = lanes.filter(packet, &shear);
            for lane in (0..count).filter(|lane| mask >> lane & 1 == 1) {
                if let Some(crossing) = shear.cross(packet, lane)
                    && !one(crossing, packet.triangles[lane])
                {
                    return;
                }
            }
        }
    }
}
