//! The triangles of a scene by the places of their corners, whatever mesh they belong to, and the points on their edges.
//!
//! A point on an edge is a number of steps of 1/[`GRID`] of its length from the end whose place has the lower number. So
//! all triangles at the edge get the same point, and its weights are exact in `f32`.

use super::plane::Plane;
use crate::base::parallel;
use crate::scene::{Alpha, Scene};
use glam::{DVec2, DVec3};
use rayon::slice::ParallelSliceMut;

/// Steps of a triangle's weights: as fine as an `f32` in [0.5, 1).
pub(super) const GRID: u32 = 1 << 24;

/// Cosine from which on two faces are one surface for charts.
const SMOOTH: f64 = 0.9;

/// A scene by places.
pub(super) struct Mesh<'a> {
    pub(super) scene: &'a Scene,
    /// By vertex; places are numbered in the order of their coordinates.
    place: Vec<u32>,
    /// Lower place, higher place, triangle · 3 + side; ascending.
    edges: Vec<(u32, u32, u32)>,
    /// By part: its triangles are cut.
    is_cut: Vec<bool>,
}

/// A point on an edge: lower place, higher place, steps from the lower one.
pub(super) type EdgePoint = (u32, u32, u32);

/// Points on all edges, ascending.
pub(super) struct EdgePoints(Vec<EdgePoint>);

impl<'a> Mesh<'a> {
    pub(super) fn new(scene: &'a Scene, keep_uv: bool) -> Self {
        let key = |v: u32| scene.vertex_position(v).to_array().map(ordered);
        let mut order: Vec<u32> = (0..scene.vertex_count() as u32).collect();
        order.par_sort_unstable_by_key(|&v| (key(v), v));
        let mut place = vec![0; order.len()];
        let mut count = 0;
        for (k, &v) in order.iter().enumerate() {
            count += u32::from(k > 0 && key(order[k - 1]) != key(v));
            place[v as usize] = count;
        }
        let is_cut = scene.parts.iter().map(|part| part.receives && !(keep_uv && part.has_uv1)).collect();
        let mut mesh = Self { scene, place, edges: vec![], is_cut };
        mesh.edges = (0..scene.triangle_count() as u32 * 3)
            .map(|half| {
                let [a, b] = mesh.ends(half / 3, (half % 3) as usize);
                (a.min(b), a.max(b), half)
            })
            .collect();
        mesh.edges.par_sort_unstable();
        mesh
    }

    /// Places of the ends of a side, in the winding of the triangle.
    pub(super) fn ends(&self, triangle: u32, side: usize) -> [u32; 2] {
        let corners = self.scene.triangle(triangle);
        [side, (side + 1) % 3].map(|k| self.place[corners[k] as usize])
    }

    /// Triangles with a side between two places.
    pub(super) fn around(&self, [a, b]: [u32; 2]) -> impl Iterator<Item = u32> + '_ {
        let edge = (a.min(b), a.max(b));
        let start = self.edges.partition_point(|e| (e.0, e.1) < edge);
        self.edges[start..].iter().take_while(move |e| (e.0, e.1) == edge).map(|e| e.2 / 3)
    }

    /// Corners [m].
    pub(super) fn corners(&self, triangle: u32) -> [DVec3; 3] {
        self.scene.corners(triangle).map(|p| p.as_dvec3())
    }

    /// The plane of a triangle and its corners there.
    pub(super) fn flat(&self, triangle: u32) -> Option<(Plane, [DVec2; 3])> {
        let corners = self.corners(triangle);
        let plane = Plane::new(corners)?;
        Some((plane, corners.map(|p| plane.at(p))))
    }

    /// The triangle may be cut.
    pub(super) fn is_cut(&self, triangle: u32) -> bool {
        self.is_cut[self.scene.part_index(triangle)]
    }

    /// The triangle stops all light.
    pub(super) fn is_opaque(&self, triangle: u32) -> bool {
        matches!(self.scene.material(triangle).alpha, Alpha::Opaque)
    }

    /// Other triangles across a side with which a chart may go on.
    pub(super) fn goes_on(&self, triangle: u32, side: usize, normal: DVec3) -> impl Iterator<Item = u32> + '_ {
        let part = self.scene.part_index(triangle);
        self.around(self.ends(triangle, side)).filter(move |&other| {
            let alike = || Plane::new(self.corners(other)).is_some_and(|p| p.normal.dot(normal) > SMOOTH);
            other != triangle && self.scene.part_index(other) == part && alike()
        })
    }
}

impl EdgePoints {
    /// Points nearer than `tolerance` [m] to the one before them become that one.
    pub(super) fn new(mesh: &Mesh<'_>, mut proposed: Vec<EdgePoint>, tolerance: f64) -> Self {
        proposed.par_sort_unstable();
        proposed.dedup();
        let edges: Vec<&[EdgePoint]> = proposed.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)).collect();
        let kept = parallel::map(edges.len(), |e| {
            let length = mesh.length([edges[e][0].0, edges[e][0].1]);
            let least = tolerance / length.max(f64::MIN_POSITIVE) * f64::from(GRID);
            let mut kept: Vec<EdgePoint> = vec![];
            for &point in edges[e] {
                if kept.last().is_none_or(|last| f64::from(point.2 - last.2) > least) {
                    kept.push(point);
                }
            }
            kept
        });
        Self(kept.into_iter().flatten().collect())
    }

    /// Points on a side of a triangle, in steps from its first corner, in that order.
    pub(super) fn on(&self, mesh: &Mesh<'_>, triangle: u32, side: usize) -> Vec<u32> {
        let [a, b] = mesh.ends(triangle, side);
        let edge = (a.min(b), a.max(b));
        let start = self.0.partition_point(|p| (p.0, p.1) < edge);
        let own = self.0[start..].iter().take_while(|p| (p.0, p.1) == edge).map(|p| p.2);
        if a < b { own.collect() } else { own.map(|x| GRID - x).collect::<Vec<_>>().into_iter().rev().collect() }
    }
}

impl Mesh<'_> {
    /// Distance of two places that a triangle joins [m].
    fn length(&self, edge: [u32; 2]) -> f64 {
        let Some(t) = self.around(edge).next() else { return 0.0 };
        let side = (0..3).find(|&k| {
            let [a, b] = self.ends(t, k);
            [a.min(b), a.max(b)] == edge
        });
        let corners = self.corners(t);
        side.map_or(0.0, |k| corners[k].distance(corners[(k + 1) % 3]))
    }
}

/// Bits that are ordered as the number is; −0 counts as 0.
fn ordered(x: f32) -> u32 {
    let bits = (x + 0.0).to_bits();
    if bits >> 31 == 1 { !bits } else { bits | 1 << 31 }
}
