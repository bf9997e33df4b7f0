//! Edges of charts: where a triangle ends on its page.
//!
//! In: scene and atlas. Out: [`Edge`]s, with points on them and just inside them. An edge that two triangles of a chart
//! share has the same two corners on the page for both; every other one is a border, also one where a chart was slit.
//!
//! Invariant: in the order of parts and triangles, whatever the number of threads.

use crate::atlas::Atlas;
use crate::atlas::Layout;
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
    let (layouts, layout_of) = atlas.layouts();
    let sides = parallel::map(layouts.len(), |i| border_sides(layouts[i]));
    let of_part = |p: usize| -> Vec<Edge> {
        let (part, charted) = (&scene.parts[p], &atlas.parts[p]);
        let edge = |&(k, side): &(u32, u8)| {
            let chart = charted.chart(k as usize);
            let corner = [side, (side + 1) % 3, (side + 2) % 3];
            let triangle = part.triangles.start + k;
            let corners = scene.corners(triangle).map(|c| c.as_dvec3());
            let vertices = charted.layout.triangles[k as usize];
            Edge {
                triangle,
                corner,
                page: atlas.charts[chart as usize].page,
                turned: patches.is_turned_chart(chart),
                uv: corner.map(|c| charted.uv(vertices[c as usize])),
                ends: [corners[corner[0] as usize], corners[corner[1] as usize]],
            }
        };
        sides[layout_of[p] as usize].iter().map(edge).collect()
    };
    parallel::map(scene.parts.len(), of_part).into_iter().flatten().collect()
}

/// Sides of triangles (triangle, first corner) that have a length and that no other triangle of their chart has.
fn border_sides(layout: &Layout) -> Vec<(u32, u8)> {
    let mut all: Vec<(u32, [[u32; 2]; 2], u32, u8)> = vec![];
    for ((k, vertices), &chart) in (0u32..).zip(&layout.triangles).zip(&layout.chart) {
        if chart == NO_CHART {
            continue;
        }
        let key = vertices.map(|v| layout.uv[v as usize].to_array().map(f32::to_bits));
        for side in 0..3u8 {
            let (a, b) = (key[side as usize], key[(side as usize + 1) % 3]);
            all.push((chart, [a.min(b), a.max(b)], k, side));
        }
    }
    all.par_sort_unstable();
    let alone = all.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)).filter(|same| same.len() == 1);
    let has_length = |(_, [a, b], ..): &&(u32, [[u32; 2]; 2], u32, u8)| {
        let [a, b] = [a, b].map(|p| Vec2::from_array(p.map(f32::from_bits)));
        a.distance(b) > 0.0
    };
    let mut sides: Vec<(u32, u8)> = alone.map(|same| &same[0]).filter(has_length).map(|e| (e.2, e.3)).collect();
    sides.sort_unstable();
    sides
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
