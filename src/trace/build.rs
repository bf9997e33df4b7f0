//! Builds the hierarchy: obvhs's binary tree, collapsed to nodes of eight boxes and packets of four triangles.
//!
//! In: [`Scene`]. Out: [`Hierarchy`], node 0 is the root.
//!
//! Source: obvhs 0.4.0, preset "medium" (parallel locally-ordered clustering, Meister and Bittner 2018, and parallel
//! reinsertion, Meister and Bittner 2017); greedy collapse after Wald, Benthin, Boulos, "Getting rid of packets", 2008,
//! §3: the child with the largest area is opened until eight are there.
//!
//! obvhs sees boxes scaled to the unit cube, so that neither a huge nor a tiny scene overflows its areas; only its
//! topology is used. Our boxes are computed from the triangles, one f32 step larger on each side, and at least 2⁻⁴⁰ of
//! the largest coordinate: so no box is flat, no point of a triangle lies on the border of its box, and the rounding of
//! the double-precision triangle test (2⁻⁵³ of the distance) cannot put a hit outside of the box. See `traverse`.
//!
//! Invariants: every triangle with area and finite corners is in exactly one packet; no recursion, so a degenerate tree
//! cannot overflow the stack. Limit: 2²⁸ triangles.

use crate::base::parallel;
use crate::scene::Alpha;
use crate::scene::Scene;
use super::lanes::Eight;
use core::time::Duration;
use glam::{DVec3, Vec3, Vec3A};
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::builder::build_bvh2;

/// Children of a node.
pub(super) const WIDTH: usize = 8;
/// Triangles of a packet: the lanes of a 128-bit register, which every x86-64 and arm64 machine has.
pub(super) const LANES: usize = 8;
/// More would not fit into [`Child`].
const MAX_TRIANGLES: usize = 1 << 28;
/// Boxes grow by this part of the largest coordinate. Larger: thin boxes overlap; smaller: below the error of the
/// triangle test once an origin is far outside of the scene.
const PAD: f32 = 1.0 / (1u64 << 40) as f32;

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
#[derive(Clone, Copy)]
pub(super) struct Child(u32);

impl Child {
    pub(super) const fn node(index: usize) -> Self {
        Self(index as u32)
    }

    const fn packet(index: usize, count: usize) -> Self {
        Self(1 << 31 | (count as u32 - 1) << 28 | index as u32)
    }

    /// The root node.
    pub(super) const ROOT: Self = Self::node(0);

    /// `(packet, number of triangles in it)`, or `None` for a node.
    pub(super) const fn as_packet(self) -> Option<(usize, usize)> {
        if self.0 >> 31 == 1 { Some(((self.0 & 0xfff_ffff) as usize, (self.0 >> 28 & 7) as usize + 1)) } else { None }
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
        self.margin.0[lane] = (2.0 * edge(1).max(edge(2))).max(LEAST_MARGIN).next_up() as f32 * (1.0 + 4.0 * f32::EPSILON);
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
    /// What `Child::packet` points to.
    pub(super) packets: Vec<Packet>,
    /// Smallest and largest coordinates, unpadded [m].
    pub(super) bounds: (Vec3, Vec3),
    /// Triangles in all packets.
    pub(super) triangle_count: usize,
}

/// A triangle on its way into the hierarchy.
struct Item {
    triangle: u32,
    min: Vec3,
    max: Vec3,
}

impl Hierarchy {
    pub(super) fn new(scene: &Scene) -> Self {
        let mut items = usable(scene);
        if items.is_empty() {
            return Self::default();
        }
        let bounds = items.iter().fold((items[0].min, items[0].max), |b, i| (b.0.min(i.min), b.1.max(i.max)));
        let pad = PAD * bounds.0.abs().max(bounds.1.abs()).max_element();
        for item in &mut items {
            item.min = Vec3::from_array((item.min - pad).to_array().map(f32::next_down)).max(Vec3::MIN);
            item.max = Vec3::from_array((item.max + pad).to_array().map(f32::next_up)).min(Vec3::MAX);
        }
        let tree = binary_tree(&items, bounds);
        let mut collapse = Collapse::new(scene, &items, &tree);
        collapse.run();
        Self { nodes: collapse.nodes, packets: collapse.packets, bounds, triangle_count: items.len() }
    }

    /// Largest absolute coordinate [m].
    pub(super) fn reach(&self) -> f64 {
        f64::from(self.bounds.0.abs().max(self.bounds.1.abs()).max_element())
    }

    pub(super) fn memory_bytes(&self) -> usize {
        self.nodes.capacity() * size_of::<Node>() + self.packets.capacity() * size_of::<Packet>()
    }
}

/// Triangles that have area and finite corners, with unpadded boxes.
fn usable(scene: &Scene) -> Vec<Item> {
    let chunks = parallel::map_chunks(scene.triangles.len().min(MAX_TRIANGLES), 1 << 14, |range| {
        range.filter_map(|i| item(scene, i as u32)).collect::<Vec<_>>()
    });
    chunks.into_iter().flatten().collect()
}

fn item(scene: &Scene, triangle: u32) -> Option<Item> {
    let corners = scene.corners(triangle);
    if !corners.iter().all(|p| p.is_finite()) {
        return None;
    }
    let [a, b, c] = corners.map(|p| p.as_dvec3());
    if (b - a).cross(c - a) == DVec3::ZERO {
        return None;
    }
    let min = corners[0].min(corners[1]).min(corners[2]);
    let max = corners[0].max(corners[1]).max(corners[2]);
    Some(Item { triangle, min, max })
}

fn binary_tree(items: &[Item], bounds: (Vec3, Vec3)) -> Bvh2 {
    let low = bounds.0.as_dvec3();
    let scale = 1.0 / (bounds.1.as_dvec3() - low).max_element();
    let unit = |p: Vec3| Vec3A::from(((p.as_dvec3() - low) * scale).as_vec3());
    let boxes: Vec<Aabb> = parallel::map(items.len(), |i| Aabb::new(unit(items[i].min), unit(items[i].max)));
    build_bvh2(&boxes, BvhBuildParams::medium_build(), &mut Duration::default())
}

/// The state of the collapse.
struct Collapse<'a> {
    scene: &'a Scene,
    items: &'a [Item],
    tree: &'a Bvh2,
    /// Number of triangles below each node of the tree.
    counts: Vec<u32>,
    /// Box of each node of the tree.
    boxes: Vec<(Vec3, Vec3)>,
    nodes: Vec<Node>,
    packets: Vec<Packet>,
}

impl<'a> Collapse<'a> {
    fn new(scene: &'a Scene, items: &'a [Item], tree: &'a Bvh2) -> Self {
        let n = tree.nodes.len();
        let mut this = Self {
            scene,
            items,
            tree,
            counts: vec![0; n],
            boxes: vec![(Vec3::INFINITY, Vec3::NEG_INFINITY); n],
            nodes: Vec::new(),
            packets: Vec::new(),
        };
        this.measure();
        this
    }

    /// Counts and boxes, children before parents.
    fn measure(&mut self) {
        let mut order = Vec::with_capacity(self.tree.nodes.len());
        let mut pending = vec![0];
        while let Some(n) = pending.pop() {
            order.push(n);
            if let Some(children) = self.children(n) {
                pending.extend(children);
            }
        }
        for &n in order.iter().rev() {
            let union = |a: (Vec3, Vec3), b: (Vec3, Vec3)| (a.0.min(b.0), a.1.max(b.1));
            if let Some([l, r]) = self.children(n) {
                self.counts[n] = self.counts[l] + self.counts[r];
                self.boxes[n] = union(self.boxes[l], self.boxes[r]);
            } else {
                let leaf = self.leaf(n);
                self.counts[n] = leaf.len() as u32;
                self.boxes[n] = leaf
                    .iter()
                    .map(|&i| (self.items[i as usize].min, self.items[i as usize].max))
                    .fold(self.boxes[n], union);
            }
        }
    }

    fn children(&self, node: usize) -> Option<[usize; 2]> {
        let n = &self.tree.nodes[node];
        let first = n.first_index as usize;
        (n.prim_count == 0).then_some([first, first + 1])
    }

    fn leaf(&self, node: usize) -> &'a [u32] {
        let n = &self.tree.nodes[node];
        let first = n.first_index as usize;
        &self.tree.primitive_indices[first..first + n.prim_count as usize]
    }

    fn run(&mut self) {
        self.nodes.push(Node::empty());
        let mut pending = vec![(Branch::Tree(0), 0)];
        while let Some((branch, at)) = pending.pop() {
            for (slot, child) in self.open(branch).into_iter().enumerate() {
                let (count, bounds) = self.extent(&child);
                let reference = if count <= LANES {
                    let items = self.gather(&child);
                    self.packets.push(self.packet(&items));
                    Child::packet(self.packets.len() - 1, items.len())
                } else {
                    self.nodes.push(Node::empty());
                    pending.push((child, self.nodes.len() - 1));
                    Child::node(self.nodes.len() - 1)
                };
                self.nodes[at].set(slot, bounds, reference);
            }
        }
        self.nodes.shrink_to_fit();
        self.packets.shrink_to_fit();
    }

    /// At most eight branches that together are the given one.
    fn open(&self, branch: Branch<'a>) -> Vec<Branch<'a>> {
        let mut out = vec![branch];
        while out.len() < WIDTH {
            let mut largest = None;
            for (i, b) in out.iter().enumerate() {
                let (count, (min, max)) = self.extent(b);
                let e = (max - min).as_dvec3();
                let area = e.x * e.y + e.y * e.z + e.z * e.x;
                if count > LANES && largest.is_none_or(|(a, _)| area > a) {
                    largest = Some((area, i));
                }
            }
            let Some((_, i)) = largest else { break };
            let [l, r] = match out.remove(i) {
                Branch::Tree(n) => match self.children(n) {
                    Some([l, r]) => [Branch::Tree(l), Branch::Tree(r)],
                    None => halves(self.leaf(n)),
                },
                Branch::Items(items) => halves(items),
            };
            out.extend([l, r]);
        }
        out
    }

    fn extent(&self, branch: &Branch<'_>) -> (usize, (Vec3, Vec3)) {
        match branch {
            Branch::Tree(n) => (self.counts[*n] as usize, self.boxes[*n]),
            Branch::Items(items) => {
                let corners = items.iter().map(|&i| &self.items[i as usize]);
                let empty = (Vec3::INFINITY, Vec3::NEG_INFINITY);
                (items.len(), corners.fold(empty, |b, i| (b.0.min(i.min), b.1.max(i.max))))
            }
        }
    }

    /// The items below a branch with few of them.
    fn gather(&self, branch: &Branch<'_>) -> Vec<u32> {
        let mut items = Vec::with_capacity(LANES);
        let mut pending = match branch {
            Branch::Tree(n) => vec![*n],
            Branch::Items(list) => {
                items.extend_from_slice(list);
                vec![]
            }
        };
        while let Some(n) = pending.pop() {
            match self.children(n) {
                Some([l, r]) => pending.extend([r, l]),
                None => items.extend_from_slice(self.leaf(n)),
            }
        }
        items
    }

    fn packet(&self, items: &[u32]) -> Packet {
        let mut packet = Packet::empty();
        for (lane, &i) in items.iter().enumerate() {
            let triangle = self.items[i as usize].triangle;
            let opaque = self.scene.material(triangle).alpha == Alpha::Opaque;
            packet.set(lane, self.scene.corners(triangle), if opaque { triangle } else { triangle | Packet::TRANSPARENT });
        }
        packet
    }
}

/// Part of the binary tree: a node, or a run of the triangles of a leaf that is too large for a packet.
enum Branch<'a> {
    Tree(usize),
    Items(&'a [u32]),
}

fn halves(items: &[u32]) -> [Branch<'_>; 2] {
    let (l, r) = items.split_at(items.len() / 2);
    [Branch::Items(l), Branch::Items(r)]
}

impl Node {
    pub(super) fn empty() -> Self {
        let side = [Eight([f32::INFINITY; WIDTH]), Eight([f32::NEG_INFINITY; WIDTH])];
        Self { bounds: [side; 3], children: [Child::ROOT; WIDTH] }
    }

    fn set(&mut self, slot: usize, bounds: (Vec3, Vec3), child: Child) {
        for axis in 0..3 {
            self.bounds[axis][0].0[slot] = bounds.0[axis];
            self.bounds[axis][1].0[slot] = bounds.1[axis];
        }
        self.children[slot] = child;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn children_round_trip() {
        assert_eq!(Child::packet(0xfff_fffe, 4).as_packet(), Some((0xfff_fffe, 4)));
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
