//! Edges of charts: where a triangle ends on its page.
//!
//! In: scene and atlas. Out: [`Borders`], asked for [`Edge`]s, with points on them and just inside them. An edge that two
//! triangles of a chart share has the same two corners on the page for both; every other one is a border, also one where a
//! chart was slit.
//!
//! Invariant: in the order of parts and triangles, whatever the number of threads.
//!
//! Memory: grows with the layouts that parts share, not with the parts. Edges are made when they are asked for.

use super::asked;
use super::asked::Asked;
use crate::atlas::Atlas;
use crate::atlas::Layout;
use crate::atlas::NO_CHART;
use crate::base::parallel;
use crate::patches::Patches;
use crate::patches::SurfacePoint;
use crate::scene::Scene;
use glam::DVec3;
use glam::Vec2;
use glam::Vec3;
use rayon::slice::ParallelSliceMut;

/// How far inside its edge a point lies that speaks for the surface there [texels].
const INSET: f32 = 0.1;
/// The same, as the most of the triangle's height.
const MOST_INSET: f32 = 1.0 / 3.0;
/// The same at least [texels], if the chart goes on behind the triangle. With a tenth, a ninth more places along seams of a
/// living room had steps: what is finely curved lay between the points.
const LEAST_INSET: f32 = 0.03;

/// A side of a triangle beyond which its chart does not go on.
#[derive(Debug, Clone, Copy)]
pub(super) struct Edge {
    /// Triangle of the scene, by its id.
    triangle: u32,
    /// Corners of the triangle: from, to, and the one opposite.
    corner: [u8; 3],
    /// Chart and page that it lies on.
    chart: u32,
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

/// Borders of all charts, by what parts share.
pub(super) struct Borders<'a> {
    scene: &'a Scene,
    atlas: &'a Atlas,
    patches: &'a Patches,
    /// The layout of each part.
    layout_of: Vec<u32>,
    /// Of each layout: a bit for each side of each triangle beyond which its chart does not go on.
    sides: Vec<Vec<u8>>,
    /// Of each layout: where its borders are asked.
    asked: Vec<Vec<Asked>>,
    /// Number of places that are asked in the parts before each, and in all.
    before: Vec<usize>,
    /// See [`surfaces`].
    surface: Vec<f32>,
    /// Median edge length of the texels along borders, parts with one layout counted once [m].
    pub(super) texel: f64,
}

impl<'a> Borders<'a> {
    pub(super) fn new(scene: &'a Scene, atlas: &'a Atlas, patches: &'a Patches, points: f32) -> Self {
        let (layouts, layout_of) = atlas.layouts();
        let sides: Vec<Vec<u8>> = parallel::map(layouts.len(), |i| border_sides(layouts[i]));
        let asked: Vec<Vec<Asked>> = parallel::map(layouts.len(), |i| asked::along(layouts[i], &sides[i], points));
        let mut before = vec![0];
        before.extend(layout_of.iter().scan(0, |sum, layout| {
            *sum += asked[*layout as usize].len();
            Some(*sum)
        }));
        let surface = surfaces(patches);
        let mut borders = Self { scene, atlas, patches, layout_of, sides, asked, before, surface, texel: 1.0 };
        borders.texel = borders.median_texel();
        borders
    }

    /// Exposed surface of an edge's chart, up to a texel.
    pub(super) fn surface(&self, edge: &Edge) -> f32 {
        self.surface.get(edge.chart as usize).copied().unwrap_or(0.0)
    }

    /// Number of places that are asked.
    pub(super) fn len(&self) -> usize {
        self.before.last().copied().unwrap_or(0)
    }

    /// One of them, with its edge.
    pub(super) fn asked(&self, number: usize) -> (Edge, Asked) {
        let part = self.before.partition_point(|before| *before <= number) - 1;
        let asked = self.asked[self.layout_of[part] as usize][number - self.before[part]];
        (self.edge(part, asked.triangle, asked.side), asked)
    }

    /// The sides of a triangle of the scene that lie on borders.
    pub(super) fn edges_of(&self, triangle: u32) -> impl Iterator<Item = Edge> + '_ {
        let part = self.scene.part_index(triangle);
        let k = triangle - self.scene.parts[part].triangles.start;
        let sides = self.sides[self.layout_of[part] as usize].get(k as usize).copied().unwrap_or(0);
        self.edges(part, k, sides)
    }

    /// Sides of a part's triangle, those whose bits are set.
    fn edges(&self, part: usize, k: u32, sides: u8) -> impl Iterator<Item = Edge> + '_ {
        (0..3).filter(move |side| sides >> side & 1 == 1).map(move |side| self.edge(part, k, side))
    }

    /// A point of the chart next to that at part `t` in [0, 1] of the way. Beyond the edge's own triangle if that is
    /// flatter: along cuts lie some of a micrometre, which do not say on which side of the cut their chart is.
    pub(super) fn inside(&self, edge: &Edge, t: f32) -> Place {
        let [a, b, apex] = edge.uv;
        let inward = (b - a).perp() * (b - a).perp_dot(apex - a).signum() / edge.length();
        let uv = a.lerp(b, t) + inward * (MOST_INSET * edge.height()).clamp(LEAST_INSET, INSET);
        let found =
            self.patches.surface_at(edge.page, uv).filter(|(front, _)| self.patches.chart(*front) == edge.chart);
        match found {
            Some((_, SurfacePoint { triangle, b })) => edge.on(self.scene, triangle, b, uv),
            None => edge.place(self.scene, t, (INSET / edge.height()).min(MOST_INSET)),
        }
    }

    /// A side of a part's triangle.
    fn edge(&self, part: usize, k: u32, side: u8) -> Edge {
        let charted = &self.atlas.parts[part];
        let chart = charted.chart(k as usize);
        let corner = [side, (side + 1) % 3, (side + 2) % 3];
        let triangle = self.scene.parts[part].triangles.start + k;
        let corners = self.scene.corners(triangle).map(|c| c.as_dvec3());
        let vertices = charted.layout.triangles[k as usize];
        Edge {
            triangle,
            corner,
            chart,
            page: self.atlas.charts[chart as usize].page,
            turned: self.patches.is_turned_chart(chart),
            uv: corner.map(|c| charted.uv(vertices[c as usize])),
            ends: [corners[corner[0] as usize], corners[corner[1] as usize]],
        }
    }

    fn median_texel(&self) -> f64 {
        let mut part_of = vec![None; self.sides.len()];
        for (part, layout) in self.layout_of.iter().enumerate() {
            part_of[*layout as usize].get_or_insert(part);
        }
        let texels = |layout: usize| -> Vec<f64> {
            let Some(part) = part_of[layout] else { return vec![] };
            let edges = (0..).zip(&self.sides[layout]).flat_map(|(k, sides)| self.edges(part, k, *sides));
            edges.map(|e| e.texel()).collect()
        };
        let mut all: Vec<f64> = parallel::map(self.sides.len(), texels).into_iter().flatten().collect();
        let middle = all.len() / 2;
        if all.is_empty() { 1.0 } else { *all.select_nth_unstable_by(middle, f64::total_cmp).1 }
    }
}

/// Exposed surface of each chart, up to a texel; charts without texels may be missing at the end.
pub(super) fn surfaces(patches: &Patches) -> Vec<f32> {
    let mut surface: Vec<f32> = vec![];
    for i in 0..patches.front {
        let chart = patches.chart(i) as usize;
        surface.resize(surface.len().max(chart + 1), 0.0);
        surface[chart] = (surface[chart] + patches.covered(i) * patches.exposed[i]).min(1.0);
    }
    surface
}

/// Chart, ends on the page by their bits, triangle, and which of its sides.
type Side = (u32, [[u32; 2]; 2], u32, u8);

/// For each triangle a bit for each of its sides that has a length and that no other triangle of its chart has.
fn border_sides(layout: &Layout) -> Vec<u8> {
    let mut all: Vec<Side> = vec![];
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
    let has_length = |(_, [a, b], ..): &&Side| {
        let [a, b] = [a, b].map(|p| Vec2::from_array(p.map(f32::from_bits)));
        a.distance(b) > 0.0
    };
    let mut sides = vec![0; layout.triangles.len()];
    alone.map(|same| &same[0]).filter(has_length).for_each(|e| sides[e.2 as usize] |= 1 << e.3);
    sides
}

impl Edge {
    /// Its place among all sides of all triangles.
    pub(super) fn id(&self) -> (u32, u8) {
        (self.triangle, self.corner[0])
    }

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

    /// At part `t` of the way, then part `up` of the way to the opposite corner.
    fn place(&self, scene: &Scene, t: f32, up: f32) -> Place {
        let along = [(1.0 - t) * (1.0 - up), t * (1.0 - up), up];
        let mut weights = [0.0; 3];
        let mut uv = Vec2::ZERO;
        for ((weight, &corner), corner_uv) in along.iter().zip(&self.corner).zip(self.uv) {
            weights[corner as usize] = *weight;
            uv += corner_uv * *weight;
        }
        self.on(scene, self.triangle, Vec2::new(weights[1], weights[2]), uv)
    }

    /// A point of a triangle of its chart.
    fn on(&self, scene: &Scene, triangle: u32, b: Vec2, uv: Vec2) -> Place {
        let normal = scene.shading_normal(triangle, b);
        Place {
            page: self.page,
            uv,
            position: scene.position(triangle, b),
            normal: if self.turned { -normal } else { normal },
        }
    }

    /// Of its triangle over it [texels].
    fn height(&self) -> f32 {
        let [a, b, apex] = self.uv;
        ((b - a).perp_dot(apex - a).abs() / self.length()).max(f32::MIN_POSITIVE)
    }
}
