//! Where borders of charts meet in space: of one mesh, or of two that abut, also where their vertices do not.
//!
//! In: edges. Out: for a point of the world, the edges that pass through it. Edges are cut into segments no longer than
//! a cell of a lattice and put into every cell that they touch, so one cell has all that is near a point.
//!
//! Invariant: edges come in their order.

use super::border::Edge;
use crate::base::parallel;
use glam::DVec3;
use rayon::slice::ParallelSliceMut;

/// Distance of places that are one, in texel edges: modular pieces are placed by hand.
const NEAR: f64 = 0.01;
/// The same in parts of the largest coordinate: a few rounding steps of an `f32`.
const ROUNDING: f64 = 3e-7;
/// Cell of the lattice in median texel edges.
const CELL: f64 = 4.0;
/// Most cells that all edges together go through: with edges of very different density, cells are larger.
const MOST_CELLS: f64 = 4e6;
/// Edges in one cell that are looked at: more of them are no seam but a knot.
const CROWD: usize = 256;

/// Edges by the cells that they go through.
pub(super) struct Lattice<'a> {
    edges: &'a [Edge],
    cell: f64,
    rounding: f64,
    /// Cell and edge, ascending, without duplicates.
    members: Vec<([i32; 3], u32)>,
}

impl<'a> Lattice<'a> {
    pub(super) fn new(edges: &'a [Edge]) -> Self {
        let mut texels: Vec<f64> = edges.iter().map(Edge::texel).collect();
        let total = edges.iter().fold(0.0, |sum, e| sum + e.world_length());
        let most = edges.iter().flat_map(|e| e.ends).fold(0.0f64, |m, p| m.max(p.abs().max_element()));
        let median = match texels.len() {
            0 => 1.0,
            n => *texels.select_nth_unstable_by(n / 2, f64::total_cmp).1,
        };
        // A cell's number fits into 32 bits.
        let cell = (CELL * median).max(total / MOST_CELLS).max(most * 1e-8).max(f64::MIN_POSITIVE);
        let mut lattice = Self { edges, cell, rounding: ROUNDING * most, members: vec![] };
        let of_edges = parallel::map(edges.len(), |e| lattice.cells(e));
        lattice.members = of_edges.into_iter().flatten().collect();
        lattice.members.par_sort_unstable();
        lattice.members.dedup();
        lattice
    }

    /// How far apart two places may be that are one, beside an edge [m].
    fn near(&self, edge: &Edge) -> f64 {
        (NEAR * edge.texel()).max(self.rounding).min(self.cell)
    }

    fn cell_of(&self, p: DVec3) -> [i32; 3] {
        (p / self.cell).floor().to_array().map(|x| x as i32)
    }

    fn cells(&self, e: usize) -> Vec<([i32; 3], u32)> {
        let edge = &self.edges[e];
        let near = self.near(edge);
        let count = (edge.world_length() / self.cell).ceil().clamp(1.0, MOST_CELLS) as usize;
        let at = |k: usize| edge.ends[0].lerp(edge.ends[1], k as f64 / count as f64);
        let mut out = vec![];
        for k in 0..count {
            let (a, b) = (at(k), at(k + 1));
            let (low, high) = (self.cell_of(a.min(b) - near), self.cell_of(a.max(b) + near));
            for x in low[0]..=high[0] {
                for y in low[1]..=high[1] {
                    out.extend((low[2]..=high[2]).map(|z| ([x, y, z], e as u32)));
                }
            }
        }
        out.dedup();
        out
    }

    /// Edges through a point of edge `own`, but for that one, with the part of their way at which it lies.
    pub(super) fn through(&self, own: usize, p: DVec3) -> impl Iterator<Item = (usize, f32)> + '_ {
        let cell = self.cell_of(p);
        let start = self.members.partition_point(|m| m.0 < cell);
        let here = self.members[start..].iter().take(CROWD).take_while(move |m| m.0 == cell).map(|m| m.1 as usize);
        here.filter(move |&e| e != own).filter_map(move |e| Some((e, self.on(e, own, p)?)))
    }

    /// Part of the way along an edge at which it passes a point of another one.
    fn on(&self, e: usize, own: usize, p: DVec3) -> Option<f32> {
        let edge = &self.edges[e];
        let [a, b] = edge.ends;
        let along = b - a;
        let t = (p - a).dot(along) / along.length_squared();
        let near = self.near(edge).min(self.near(&self.edges[own]));
        ((0.0..=1.0).contains(&t) && (a + along * t).distance(p) <= near).then_some(t as f32)
    }
}
