//! Whether anything lies in a box.
//!
//! In: a box along the axes. Out: whether the box of some triangle meets it. One such question answers for the many
//! short rays that stay inside: where nothing is near, they need not be traced.
//!
//! Invariant: never overlooks a triangle; may take one into account that passes by.

use super::Tracer;
use super::build::Child;
use super::build::Packet;
use super::build::WIDTH;
use super::lanes::Eight;
use glam::Vec3;

impl Tracer<'_> {
    /// Some triangle that `matters` may reach into the box from `low` to `high` [m].
    pub fn any_within(&self, low: Vec3, high: Vec3, mut matters: impl FnMut(u32) -> bool) -> bool {
        let stored = !self.hierarchy.nodes.is_empty() && self.any_below(self.hierarchy.root, low, high, &mut matters);
        stored || !self.shared.is_empty() && self.shared.any_within(low, high, &mut matters)
    }

    fn any_below(&self, child: Child, low: Vec3, high: Vec3, matters: &mut impl FnMut(u32) -> bool) -> bool {
        if let Some((packet, count)) = child.as_packet() {
            let packet = &self.hierarchy.packets[packet];
            let met = meeting(packet, low, high);
            return (0..count).any(|lane| met[lane] && matters(packet.triangles[lane] & !Packet::TRANSPARENT));
        }
        let node = &self.hierarchy.nodes[child.as_node()];
        let mut met = [true; WIDTH];
        for axis in 0..3 {
            let [from, to]: &[Eight; 2] = &node.bounds[axis];
            for (i, met) in met.iter_mut().enumerate() {
                *met &= (from.0[i] <= high[axis]) & (to.0[i] >= low[axis]);
            }
        }
        (0..WIDTH).any(|i| met[i] && self.any_below(node.children[i], low, high, matters))
    }
}

/// Which boxes of a packet's triangles meet one. Lane by lane, in the order that compilers make vectors of.
fn meeting(packet: &Packet, low: Vec3, high: Vec3) -> [bool; WIDTH] {
    let mut met = [true; WIDTH];
    for axis in 0..3 {
        let [a, b, c] = [0, 1, 2].map(|corner: usize| &packet.corners[corner][axis].0);
        for (lane, met) in met.iter_mut().enumerate() {
            let (least, most) =
                (lesser(lesser(a[lane], b[lane]), c[lane]), greater(greater(a[lane], b[lane]), c[lane]));
            *met &= (least <= high[axis]) & (most >= low[axis]);
        }
    }
    met
}

/// Of two numbers, neither of them NaN, which [`f32::min`] would have to look for.
fn lesser(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

fn greater(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}
