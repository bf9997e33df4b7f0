//! Surfaces that close around a space: what lies in one of them does not depend on what else goes through it.
//!
//! In: [`Scene`]. Out: [`Closed`], the triangles of such surfaces. Over all of them, a ray to infinity crosses as many more
//! backs than fronts as there are bodies around its start (winding number): a floor that is a sheet and goes through a wall
//! changes nothing about that, as it does where fronts and backs of everything are counted.
//!
//! Triangles of a node hang together over common edges, told by the bits of positions; they close if every edge of
//! theirs is passed as often in one direction as in the other. Primitives of a node count together, so that a wall may have
//! another material on each side. A surface that faces inward, by its signed volume, as a room may, takes one from the count
//! of all within it: of what lies there this does not say more than before, and what is behind it may be the void.
//!
//! Limits: surfaces that close but for T-junctions, or over several nodes, are not known.

use crate::base::{Sets, parallel};
use crate::scene::{Part, Scene};
use std::collections::HashMap;

/// Position, told by its bits.
type Key = [u32; 3];

/// One direction of an edge: its ends in order, +1 or −1 for the direction, index of the triangle.
type Edge = (Key, Key, i32, u32);

/// Triangles of closed surfaces that let no light through and have one side.
#[derive(Debug, Default)]
pub struct Closed {
    /// A bit per triangle id.
    bits: Vec<u64>,
    /// The same for those of surfaces that face inward.
    inward: Vec<u64>,
}

/// What a triangle belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Surface {
    Open,
    /// Closed, its fronts outside.
    Body,
    /// Closed, its fronts inside.
    Room,
}

impl Closed {
    /// Finds them.
    #[must_use]
    pub fn new(scene: &Scene) -> Self {
        let nodes: Vec<&[Part]> = scene.parts.chunk_by(|a, b| a.node == b.node).collect();
        let stored: HashMap<usize, u32> = scene.copied().map(|copy| (copy.part, copy.stored)).collect();
        let mut first_of = HashMap::new();
        let mut part = 0;
        let same_as: Vec<usize> = nodes
            .iter()
            .enumerate()
            .map(|(k, node)| {
                let shared: Option<Vec<_>> =
                    (part..part + node.len()).map(|p| Some((*stored.get(&p)?, scene.parts[p].material))).collect();
                part += node.len();
                shared.map_or(k, |key| *first_of.entry(key).or_insert(k))
            })
            .collect();
        let own = parallel::map(nodes.len(), |k| if same_as[k] == k { of_node(scene, nodes[k]) } else { vec![] });
        let none = || vec![0u64; scene.triangle_count().div_ceil(64)];
        let (mut bits, mut inward) = (none(), none());
        for (node, same) in nodes.iter().zip(same_as) {
            let ids = node.iter().flat_map(|part| part.triangles.clone());
            for (id, surface) in ids.zip(&own[same]).filter(|(_, surface)| **surface != Surface::Open) {
                bits[id as usize / 64] |= 1 << (id % 64);
                inward[id as usize / 64] |= u64::from(*surface == Surface::Room) << (id % 64);
            }
        }
        Self { bits, inward }
    }

    /// The triangle belongs to one.
    #[must_use]
    pub fn holds(&self, triangle: u32) -> bool {
        bit(&self.bits, triangle)
    }

    /// The triangle belongs to one whose fronts are inside, as the walls of a room are that has no outside.
    #[must_use]
    pub fn faces_inward(&self, triangle: u32) -> bool {
        bit(&self.inward, triangle)
    }
}

fn bit(bits: &[u64], triangle: u32) -> bool {
    bits.get(triangle as usize / 64).is_some_and(|bits| bits >> (triangle % 64) & 1 == 1)
}

/// For each triangle of the parts of a node, in order.
fn of_node(scene: &Scene, parts: &[Part]) -> Vec<Surface> {
    let ids: Vec<u32> = parts.iter().flat_map(|part| part.triangles.clone()).collect();
    let edges = sorted_edges(scene, &ids);
    let mut sets = Sets::new(ids.len());
    for edge in edges.chunk_by(same) {
        edge.iter().for_each(|e| sets.join(edge[0].3 as usize, e.3 as usize));
    }
    let mut closed = vec![true; ids.len()];
    for edge in edges.chunk_by(same).filter(|edge| !is_balanced(edge)) {
        closed[sets.find(edge[0].3 as usize)] = false;
    }
    for (k, &id) in ids.iter().enumerate() {
        let material = scene.material(id);
        if material.is_two_sided() || !material.is_opaque() {
            closed[sets.find(k)] = false;
        }
    }
    let mut volumes = vec![0.0; ids.len()];
    for (k, &id) in ids.iter().enumerate() {
        volumes[sets.find(k)] += volume(scene, id, ids[0]);
    }
    let surface = |k: usize| match closed[sets.find(k)] {
        true if volumes[sets.find(k)] < 0.0 => Surface::Room,
        true => Surface::Body,
        false => Surface::Open,
    };
    (0..ids.len()).map(surface).collect()
}

/// Three times the volume between a triangle and a corner of another one, negative where that is before its front [m³].
fn volume(scene: &Scene, triangle: u32, from: u32) -> f64 {
    let [origin, corner] = [from, triangle].map(|t| scene.corners(t)[0].as_dvec3());
    scene.area(triangle) * (corner - origin).dot(scene.geometric_normal(triangle).as_dvec3())
}

/// Every edge of some triangles is passed as often in one direction as in the other.
pub(super) fn closes(scene: &Scene, triangles: &[u32]) -> bool {
    sorted_edges(scene, triangles).chunk_by(same).all(is_balanced)
}

fn same(a: &Edge, b: &Edge) -> bool {
    (a.0, a.1) == (b.0, b.1)
}

fn is_balanced(edge: &[Edge]) -> bool {
    edge.iter().map(|e| e.2).sum::<i32>() == 0
}

fn sorted_edges(scene: &Scene, triangles: &[u32]) -> Vec<Edge> {
    let mut edges = Vec::with_capacity(3 * triangles.len());
    for (t, &id) in (0u32..).zip(triangles) {
        // Adding 0 makes one zero of both.
        let corners = scene.corners(id).map(|p| (p + glam::Vec3::ZERO).to_array().map(f32::to_bits));
        for k in 0..3 {
            let (a, b) = (corners[k], corners[(k + 1) % 3]);
            if a != b {
                edges.push(if a < b { (a, b, 1, t) } else { (b, a, -1, t) });
            }
        }
    }
    edges.sort_unstable();
    edges
}
