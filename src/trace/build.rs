//! Builds the hierarchy: nodes of eight boxes and packets of eight triangles.
//!
//! In: [`Scene`], or triangles. Out: [`Hierarchy`], and its root node. Two steps: `collapse` plans what is below
//! what; `write` copies that into nodes and packets, depth first, so that what is near in space is near in memory.
//!
//! Children with triangles come first, then by falling area: the order in which a ray that asks for any hit should
//! look.
//!
//! Boxes are one f32 step larger than their triangles on each side, and at least 2⁻⁴⁰ of the largest coordinate: so no
//! box is flat, no point of a triangle lies on the border of its box, and the rounding of the double-precision triangle
//! test (2⁻⁵³ of the distance) cannot put a hit outside of the box. See `traverse`.
//!
//! Invariants: every triangle of a kept part that is no copy (see `copies`) with area and finite corners is in exactly
//! one packet; the same bytes at every thread count; recursion is no deeper than that of `collapse`. Limit: 2²⁸
//! triangles.

use super::collapse::Branch;
use super::collapse::Plan;
use super::collapse::plan;
use super::lanes::Eight;
use super::machine;
use super::split::Bounds;
use super::split::Item;
use crate::base::parallel;
use crate::scene::Part;
use crate::scene::Scene;
use core::mem::take;
use core::sync::atomic::{AtomicBool, Ordering};
use glam::{DVec3, Vec3};
use rayon::prelude::*;

/// Children of a node.
pub(super) const WIDTH: usize = 8;
/// Triangles of a packet.
pub(super) const LANES: usize = 8;
/// More would not fit into [`Child`].
const MAX_TRIANGLES: u32 = 1 << 28;
/// Boxes grow by this part of the largest coordinate. Larger: thin boxes overlap; smaller: below the error of the
/// triangle test once an origin is far outside of the scene.
const PAD: f32 = 1.0 / (1u64 << 40) as f32;

/// A box that has grown by what rounding needs in a scene whose largest coordinate is `reach`.
pub(super) fn padded((low, high): (Vec3, Vec3), reach: f32) -> (Vec3, Vec3) {
    let pad = PAD * reach;
    let (low, high) = (low - pad, high + pad);
    let low = Vec3::new(low.x.next_down(), low.y.next_down(), low.z.next_down());
    let high = Vec3::new(high.x.next_up(), high.y.next_up(), high.z.next_up());
    (low.max(Vec3::MIN), high.min(Vec3::MAX))
}

/// Triangles below which a subtree is not worth a task.
const TASK: usize = 1 << 12;

/// Triangles that are looked at in one go.
const CHUNK: usize = 1 << 14;

/// Smallest `Packet::margin` [m]: see `ShearLanes::filter`.
const LEAST_MARGIN: f64 = 1.0 / (1u64 << 50) as f64;

/// Eight boxes and what is in them. Four whole cache lines.
#[derive(Clone)]
#[repr(align(64))]
pub(super) struct Node {
    /// By axis, then smallest and largest coordinate, then four children each. Empty: +∞ and −∞, which no ray meets.
    pub(super) bounds: [[Eight; 2]; 3],
    /// What is in each box.
    pub(super) children: [Child; WIDTH],
}

/// Index of a node, or index of a packet with the number of its triangles.
///
/// Bit 31: packet; then bits 28 to 30 hold the number of triangles, bits 0 to 27 the index.
#[derive(Clone, Copy, Default)]
pub(super) struct Child(u32);

impl Child {
    pub(super) const fn node(index: usize) -> Self {
        Self(index as u32)
    }

    const fn packet(index: usize, count: usize) -> Self {
        Self(1 << 31 | (count as u32 - 1) << 28 | index as u32)
    }

    /// What is nowhere.
    const NONE: Self = Self::node(0);

    /// `(packet, number of triangles in it)`, or `None` for a node.
    pub(super) const fn as_packet(self) -> Option<(usize, usize)> {
        if self.0 >> 31 == 1 { Some(((self.0 & 0xfff_ffff) as usize, (self.0 >> 28 & 7) as usize + 1)) } else { None }
    }

    /// Index of the node or packet that this is.
    pub(super) const fn index(self) -> usize {
        (self.0 & 0xfff_ffff) as usize
    }

    pub(super) const fn to_bits(self) -> u32 {
        self.0
    }

    pub(super) const fn from_bits(bits: u32) -> Self {
        Self(bits)
    }

    /// Index of the node that this is.
    pub(super) const fn as_node(self) -> usize {
        self.0 as usize
    }
}

/// Up to four triangles.
#[derive(Clone)]
#[repr(align(64))]
pub(super) struct Packet {
    /// By corner, then axis, then triangle; in metres.
    pub(super) corners: [[Eight; 3]; 3],
    /// Twice the larger 1-norm of the edges at corner 0 [m].
    pub(super) margin: Eight,
    /// Triangle indices; [`Packet::TRANSPARENT`] is set where the material is not opaque.
    pub(super) triangles: [u32; LANES],
}

impl Packet {
    /// Flag in `triangles`: ask the scene for the opacity.
    pub(super) const TRANSPARENT: u32 = 1 << 31;

    pub(super) fn empty() -> Self {
        Self { corners: [[Eight::default(); 3]; 3], margin: Eight::default(), triangles: [0; LANES] }
    }

    pub(super) fn set(&mut self, lane: usize, corners: [Vec3; 3], triangle: u32) {
        let edge = |k: usize| (corners[k].as_dvec3() - corners[0].as_dvec3()).abs().element_sum();
        self.margin.0[lane] =
            (2.0 * edge(1).max(edge(2))).max(LEAST_MARGIN).next_up() as f32 * (1.0 + 4.0 * f32::EPSILON);
        self.triangles[lane] = triangle;
        for (lanes, p) in self.corners.iter_mut().zip(corners) {
            for (axis, v) in p.to_array().into_iter().enumerate() {
                lanes[axis].0[lane] = v;
            }
        }
    }
}

/// The finished hierarchy.
#[derive(Default)]
pub(super) struct Hierarchy {
    /// Empty if there is no triangle.
    pub(super) nodes: Vec<Node>,
    /// Where the nodes begin.
    pub(super) root: Child,
    pub(super) node_count: usize,
    /// What `Child::packet` points to.
    pub(super) packets: Vec<Packet>,
    /// Smallest and largest coordinates, unpadded [m].
    pub(super) bounds: (Vec3, Vec3),
    /// Triangles in all packets.
    pub(super) triangle_count: usize,
}

impl Hierarchy {
    /// Of the triangles of parts that are kept and stored where they stand.
    pub(super) fn new(scene: &Scene, keep: impl Fn(&Part) -> bool) -> Self {
        Self::of(usable(scene, keep), |triangle| scene.corners(triangle), 0.0)
    }

    /// Some of what is in this one, by part, with boxes as safe.
    pub(super) fn part_of(&self, scene: &Scene, keep: impl Fn(&Part) -> bool) -> Self {
        Self::of(usable(scene, keep), |triangle| scene.corners(triangle), self.reach() as f32)
    }

    /// Of such triangles, by their corners [m]; boxes grow as in a scene whose largest coordinate is `reach` or more [m].
    pub(super) fn of(mut items: Vec<Item>, corners: impl Fn(u32) -> [Vec3; 3] + Sync, reach: f32) -> Self {
        if items.is_empty() {
            return Self::default();
        }
        let bounds = Bounds::of(&items);
        let bounds = (Vec3::from(bounds.min), Vec3::from(bounds.max));
        let reach = bounds.0.abs().max(bounds.1.abs()).max_element().max(reach);
        let centres = pad(&mut items, reach);
        let extent = (bounds.1 - bounds.0).max_element();
        // Boxes grow alike, so the one around all of them is that around all triangles, grown.
        let (min, max) = padded(bounds, reach);
        let branch = Branch { first: 0, count: items.len(), bounds: Bounds { min: min.into(), max: max.into() } };
        let plan = plan(&mut items, branch, &centres, 1.0 / extent);
        let (mut nodes, first_node) = machine::fill(plan.nodes, &Node::empty());
        let (mut packets, first_packet) = machine::fill(plan.packets, &Packet::empty());
        let (n, p) = (&mut nodes[first_node..], &mut packets[first_packet..]);
        write(&corners, &items, &plan, (n, first_node), (p, first_packet));
        Self {
            nodes,
            packets,
            root: Child::node(first_node),
            node_count: plan.nodes,
            bounds,
            triangle_count: items.len(),
        }
    }

    /// Largest absolute coordinate [m].
    pub(super) fn reach(&self) -> f64 {
        f64::from(self.bounds.0.abs().max(self.bounds.1.abs()).max_element())
    }

    pub(super) fn memory_bytes(&self) -> usize {
        self.nodes.capacity() * size_of::<Node>() + self.packets.capacity() * size_of::<Packet>()
    }
}

/// Lets boxes grow by what rounding needs in a scene whose largest coordinate is `reach`; the box around their centres.
fn pad(items: &mut [Item], reach: f32) -> Bounds {
    let some = |items: &mut [Item]| {
        items.iter_mut().for_each(|item| item.set_bounds(padded(item.bounds(), reach)));
        Bounds::of_centres(items)
    };
    let chunks: Vec<_> = items.par_chunks_mut(CHUNK).map(some).collect();
    chunks.into_iter().fold(Bounds::EMPTY, Bounds::and)
}

/// Triangles of kept parts that have area and finite corners, with unpadded boxes.
fn usable(scene: &Scene, keep: impl Fn(&Part) -> bool) -> Vec<Item> {
    let stored = (0..scene.parts.len()).filter(|&p| !scene.is_copied(p)).map(|p| &scene.parts[p]);
    let mut count = 0;
    // Of each part the number of triangles before it, its first triangle, and whether it is opaque.
    let mut parts = vec![];
    for part in stored.filter(|part| keep(part)) {
        let triangles = part.triangles.start..part.triangles.end.min(MAX_TRIANGLES);
        parts.push((count, triangles.start, scene.materials[part.material].is_opaque()));
        count += triangles.len();
    }
    let all_usable = AtomicBool::new(true);
    let mut items = parallel::map_light(count, |k| {
        let (before, first, opaque) = parts[parts.partition_point(|part| part.0 <= k) - 1];
        let triangle = first + (k - before) as u32;
        item(triangle, scene.corners(triangle), opaque).unwrap_or_else(|| {
            all_usable.store(false, Ordering::Relaxed);
            Item::NOTHING
        })
    });
    if !all_usable.into_inner() {
        items.retain(|item| !item.is_nothing());
    }
    items
}

/// A triangle with area and finite corners.
pub(super) fn item(triangle: u32, corners: [Vec3; 3], opaque: bool) -> Option<Item> {
    if !corners.iter().all(|p| p.is_finite()) {
        return None;
    }
    let [a, b, c] = corners.map(|p| p.as_dvec3());
    if (b - a).cross(c - a) == DVec3::ZERO {
        return None;
    }
    let flag = if opaque { 0 } else { Packet::TRANSPARENT };
    let (min, max) = (corners[0].min(corners[1]).min(corners[2]), corners[0].max(corners[1]).max(corners[2]));
    Some(Item::new(min, max, triangle | flag))
}

/// Fills exactly the nodes and packets of a plan; with each slice comes the index of its first element in the whole.
fn write(
    corners: &(impl Fn(u32) -> [Vec3; 3] + Sync),
    items: &[Item],
    plan: &Plan,
    nodes: (&mut [Node], usize),
    packets: (&mut [Packet], usize),
) {
    let (Some((node, mut node_rest)), mut node_index) = (nodes.0.split_first_mut(), nodes.1 + 1) else { return };
    let (mut packet_rest, mut packet_index) = packets;
    let mut jobs = Vec::with_capacity(WIDTH);
    for (slot, (branch, below)) in plan.children.iter().enumerate() {
        if let Some(below) = below {
            node.set(slot, &branch.bounds, Child::node(node_index));
            let (n, n_rest) = take(&mut node_rest).split_at_mut(below.nodes);
            let (p, p_rest) = take(&mut packet_rest).split_at_mut(below.packets);
            (node_rest, packet_rest) = (n_rest, p_rest);
            jobs.push((below, (n, node_index), (p, packet_index)));
            node_index += below.nodes;
            packet_index += below.packets;
        } else if let Some((packet, p_rest)) = take(&mut packet_rest).split_first_mut() {
            node.set(slot, &branch.bounds, Child::packet(packet_index, branch.count));
            for (lane, item) in items[branch.first..branch.first + branch.count].iter().enumerate() {
                packet.set(lane, corners(item.triangle()), item.tagged());
            }
            packet_rest = p_rest;
            packet_index += 1;
        }
    }
    if plan.packets > TASK / LANES {
        jobs.into_par_iter().for_each(|(below, n, p)| write(corners, items, below, n, p));
    } else {
        jobs.into_iter().for_each(|(below, n, p)| write(corners, items, below, n, p));
    }
}

impl Node {
    pub(super) fn empty() -> Self {
        let side = [Eight([f32::INFINITY; WIDTH]), Eight([f32::NEG_INFINITY; WIDTH])];
        Self { bounds: [side; 3], children: [Child::NONE; WIDTH] }
    }

    fn set(&mut self, slot: usize, bounds: &Bounds, child: Child) {
        for axis in 0..3 {
            self.bounds[axis][0].0[slot] = bounds.min[axis];
            self.bounds[axis][1].0[slot] = bounds.max[axis];
        }
        self.children[slot] = child;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn children_round_trip() {
        assert_eq!(Child::packet(0xfff_fffe, 8).as_packet(), Some((0xfff_fffe, 8)));
        assert_eq!(Child::packet(0, 1).as_packet(), Some((0, 1)));
        assert!(Child::node(0xfff_ffff).as_packet().is_none());
        assert_eq!(Child::node(77).as_node(), 77);
    }

    #[test]
    fn nodes_and_packets_are_whole_cache_lines() {
        assert_eq!((size_of::<Node>(), align_of::<Node>()), (256, 64));
        assert_eq!((size_of::<Packet>(), align_of::<Packet>()), (384, 64));
    }
}
