//! Edges of charts: where a triangle ends on its page.
//!
//! In: scene and atlas. Out: [`Edge`]s, with points on them and just inside them. An edge that two triangles of a chart
//! share has the same two corners on the page for both; every other one is a border, also one where a chart was slit.
//!
//! Invariant: in the order of parts and triangles, whatever the number of threads.

use crate::atlas::Atlas;
use crate::atlas::NO_CHART;
use crate::base::parallel;
use crate::patches::Patches;
use crate::scene::Scene;
use glam::DVec3;
use glam::Vec2;
use glam::Vec3;
use rayon::slice::ParallelSliceMut;

/// How far inside its edge a point lies that speaks for the surface there [texels].
const INSET: f32 = 0.1;
/// The same, as the most of the triangle's height.
const MOST_INSET: f32 = 1.0 / 3.0;

/// A side of a triangle beyond which its chart does not go on.
#[derive(Debug, Clone, Copy)]
pub(super) struct Edge {
    /// Triangle of the scene, by its id.
    pub(super) triangle: u32,
    /// Corners of the triangle: from, to, and the one opposite.
    corner: [u8; 3],
    /// Page that it lies on.
    pub(super) page: u32,
    /// Its lightmap stores the back.
    turned: bool,
    /// These corners [texels].
    uv: [Vec2; 3],
    /// Ends of the edge [m].
    pub(super) ends: [DVec3; 2],
}

/// A point of a chart's surface.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place {
    /// Page.
    pub(super) page: u32,
    /// On the page [texels].
    pub(super) uv: Vec2,
    /// In the world [m].
    pub(super) position: Vec3,
    /// Interpolated unit normal, on the side that the lightmap stores.
    pub(super) normal: Vec3,
}

/// Borders of all charts.
pub(super) fn edges(scene: &Scene, atlas: &Atlas, patches: &Patches) -> Vec<Edge> {
    let of_parts = parallel::map(scene.parts.len(), |p| edges_of_part(scene, atlas, patches, p));
    of_parts.into_iter().flatten().collect()
}

fn edges_of_part(scene: &Scene, atlas: &Atlas, patches: &Patches, p: usize) -> Vec<Edge> {
    let charted = &atlas.parts[p];
    let first = scene.parts[p].triangles.start;
    let mut all: Vec<([[u32; 2]; 2], u32, Edge)> = vec![];
    for ((k, vertices), &chart) in (0u32..).zip(&charted.triangles).zip(&charted.chart) {
        if chart == NO_CHART {
            continue;
        }
        let page = atlas.charts[chart as usize].page;
        let uv = vertices.map(|v| charted.uv[v as usize]);
        let corners = scene.corners(first + k).map(|c| c.as_dvec3());
        for side in 0..3usize {
            let corner = [side, (side + 1) % 3, (side + 2) % 3];
            let key = |c: usize| uv[c].to_array().map(f32::to_bits);
            let (a, b) = (key(corner[0]), key(corner[1]));
            let edge = Edge {
                triangle: first + k,
                corner: corner.map(|c| c as u8),
                page,
                turned: patches.is_turned_chart(chart),
                uv: corner.map(|c| uv[c]),
                ends: [corners[corner[0]], corners[corner[1]]],
            };
            all.push(([a.min(b), a.max(b)], page, edge));
        }
    }
    let key = |e: &([[u32; 2]; 2], u32, Edge)| (e.1, e.0, e.2.triangle, e.2.corner[0]);
    all.par_sort_unstable_by_key(key);
    let alone = all.chunk_by(|a, b| (a.1, a.0) == (b.1, b.0)).filter(|same| same.len() == 1);
    let mut edges: Vec<Edge> = alone.map(|same| same[0].2).collect();
    edges.sort_unstable_by_key(|e| (e.triangle, e.corner[0]));
    edges.retain(|e| e.length() > 0.0);
    edges
}

impl Edge {
    /// Length on the page [texels].
    pub(super) fn length(&self) -> f32 {
        self.uv[0].distance(self.uv[1])
    }

    /// Length in the world [m].
    pub(super) fn world_length(&self) -> f64 {
        self.ends[0].distance(self.ends[1])
    }

    /// Edge length of the texels along it [m].
    pub(super) fn texel(&self) -> f64 {
        self.world_length() / f64::from(self.length())
    }

    /// The point at part `t` in [0, 1] of the way.
    pub(super) fn at(&self, scene: &Scene, t: f32) -> Place {
        self.place(scene, t, 0.0)
    }

    /// A point next to that one, inside the triangle.
    pub(super) fn inside(&self, scene: &Scene, t: f32) -> Place {
        let [a, b, apex] = self.uv;
        let height = (b - a).perp_dot(apex - a).abs() / self.length();
        self.place(scene, t, (INSET / height.max(f32::MIN_POSITIVE)).min(MOST_INSET))
    }

    /// At part `t` of the way, then part `up` of the way to the opposite corner.
    fn place(&self, scene: &Scene, t: f32, up: f32) -> Place {
        let along = [(1.0 - t) * (1.0 - up), t * (1.0 - up), up];
        let mut weights = [0.0; 3];
        let mut uv = Vec2::ZERO;
        for ((weight, &corner), corner_uv) in along.iter().zip(&self.corner).zip(self.uv) {
            weights[corner as usize] = *weight;
            uv += corner_uv * *weight;
        }
        let b = Vec2::new(weights[1], weights[2]);
        let normal = scene.shading_normal(self.triangle, b);
        Place {
            page: self.page,
            uv,
            position: scene.position(self.triangle, b),
            normal: if self.turned { -normal } else { normal },
        }
    }
}
