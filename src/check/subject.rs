//! What is checked, prepared: charts and texel patches of a baked document, as they are on its pages.
//!
//! In: scene, lightmaps, settings. Out: [`Subject`].
//!
//! Pages may differ in size; patches number texels on pages as large as the largest.
//!
//! Limits: triangles that leave their page have no texels here; they are faults already.

use super::Settings;
use super::charts::{charts, corners};
use super::measure::{Place, Spot};
use crate::atlas::{Atlas, Chart, ChartedPart, Layout, NO_CHART, raster};
use crate::base::{Progress, Rgb, parallel};
use crate::output::Error;
use crate::output::exr::ImageF32;
use crate::patches::{PatchGraph, Patches, SurfacePoint};
use crate::render::Lightmaps;
use crate::scene::Scene;
use crate::trace::Tracer;
use glam::{DVec2, DVec3, Vec2, Vec3};

/// Coordinates may leave [0, 1] by this much (exporters write 1.0000001).
pub(super) const BORDER: f32 = 1e-4;

/// Share of the mean light below which differences are not relative any more: nobody sees that something dark is a
/// little darker.
pub(super) const FLOOR: f32 = 0.02;

/// Steps per texel of the grid that coordinates are rounded to: coarser than the rounding of `f32` on large pages.
const GRID: f32 = 1024.0;

/// Texels of all pages together that can be numbered.
const MOST_TEXELS: u64 = 1 << 31;

/// How often triangles may cover the pages before nothing can be said about single texels.
const MOST_LAYERS: f64 = 16.0;

/// A triangle on its page.
#[derive(Debug, Clone, Copy)]
pub(super) struct Flat {
    /// Corners [texels].
    pub(super) uv: [Vec2; 3],
    pub(super) page: u32,
    /// Irradiance of a texel of 1 [lx].
    pub(super) intensity: f32,
    /// It is within the page.
    pub(super) inside: bool,
}

impl Flat {
    /// Where a point of the triangle lies on the page [texels]; barycentric weights of the vertices 1 and 2.
    pub(super) fn at(&self, b: Vec2) -> Vec2 {
        self.uv[0] + (self.uv[1] - self.uv[0]) * b.x + (self.uv[2] - self.uv[0]) * b.y
    }
}

/// A baked document, ready to be measured.
pub(super) struct Subject<'a> {
    pub(super) settings: &'a Settings,
    pub(super) scene: &'a Scene,
    pub(super) lightmaps: &'a Lightmaps,
    pub(super) tracer: &'a Tracer<'a>,
    /// By triangle; `None` where it has no lightmap.
    pub(super) flat: Vec<Option<Flat>>,
    /// Area by triangle [m²].
    pub(super) area: Vec<f64>,
    /// Class of every vertex by place in the world and on its page.
    pub(super) corner: Vec<u32>,
    /// Chart by triangle, or [`NO_CHART`].
    pub(super) chart: Vec<u32>,
    pub(super) atlas: Atlas,
    pub(super) patches: Patches,
    pub(super) graph: PatchGraph,
    /// Mean light over the surface, largest channel, in the unit of the pages.
    pub(super) mean: f32,
}

impl<'a> Subject<'a> {
    /// Prepares a document.
    ///
    /// # Errors
    /// If its pages are too large, or its triangles cover them so often that it cannot be a lightmap layout.
    pub(super) fn new(
        settings: &'a Settings,
        tracer: &'a Tracer<'a>,
        lightmaps: &'a Lightmaps,
        progress: &Progress,
    ) -> Result<Self, Error> {
        let scene = tracer.scene();
        let flat = parallel::map_light(scene.triangle_count(), |t| flatten(scene, lightmaps, t as u32));
        let area = parallel::map_light(scene.triangle_count(), |t| scene.area(t as u32));
        let size = page_size(scene, lightmaps, &flat)?;
        let corner = corners(scene, &flat);
        let chart = charts(scene, &flat, &corner);
        let atlas = atlas(scene, &flat, &chart, size, lightmaps.pages().len() as u32);
        let patches = Patches::new(tracer, &atlas, progress);
        let graph = PatchGraph::new(&patches, tracer, progress);
        let mut subject =
            Self { settings, scene, lightmaps, tracer, flat, area, corner, chart, atlas, patches, graph, mean: 0.0 };
        subject.mean = subject.mean_light();
        Ok(subject)
    }

    fn mean_light(&self) -> f32 {
        let n = self.patches.front;
        let weight = |i: usize| f64::from(self.patches.exposed_area(i));
        let light = parallel::sum(n, |i| weight(i) * f64::from(self.light(i).max_element().clamp(0.0, 65504.0)));
        let area = parallel::sum(n, weight);
        if area > 0.0 { (light / area) as f32 } else { 0.0 }
    }

    /// A page.
    pub(super) fn page(&self, page: u32) -> &ImageF32 {
        &self.lightmaps.pages()[page as usize]
    }

    /// Value of a texel; beyond the page that of its border, as samplers read it.
    pub(super) fn texel(&self, page: u32, x: i32, y: i32) -> [f32; 4] {
        let image = self.page(page);
        let x = x.clamp(0, image.width as i32 - 1) as usize;
        let y = y.clamp(0, image.height as i32 - 1) as usize;
        image.pixels[y * image.width as usize + x]
    }

    /// Light in the texel of a front patch.
    pub(super) fn light(&self, front: usize) -> Rgb {
        let (x, y) = self.patches.texel_xy(front);
        rgb(self.texel(self.patches.page(front), x as i32, y as i32))
    }

    /// Difference of two lights over their mean, in the channel where it is largest. Dark ones are compared with a part
    /// of the mean of the scene.
    pub(super) fn relative(&self, a: Rgb, b: Rgb) -> f64 {
        let mean = 0.5 * (a + b).max_element();
        let scale = mean.max(FLOOR * self.mean);
        if scale > 0.0 { f64::from((a - b).abs().max_element() / scale) } else { 0.0 }
    }

    /// Edge of a triangle's texels [m].
    pub(super) fn texel_edge(&self, triangle: u32) -> f32 {
        let texels = self.flat[triangle as usize].map_or(1.0, |f| texel_area(&f.uv));
        (self.area[triangle as usize] / texels.max(1e-12)).sqrt() as f32
    }

    /// A texel of a patch lies in one chart alone.
    pub(super) fn is_pure(&self, front: usize) -> bool {
        let chart = self.patches.chart(front);
        self.patches.triangles(front).all(|t| self.chart[t as usize] == chart)
    }

    /// The surface of a patch at its centroid.
    pub(super) fn middle(&self, front: usize) -> SurfacePoint {
        let within = self.patches.centroid[front].as_dvec2();
        let distance = |p: &raster::Polygon| p.centroid().distance_squared(within);
        let nearest = self.patches.pieces(front).min_by(|a, b| distance(&a.1).total_cmp(&distance(&b.1)));
        let triangle = nearest.map_or(0, |(t, _)| t);
        self.patches.point_on(front, triangle, within)
    }

    /// A spot in words and numbers.
    pub(super) fn place(&self, spot: &Spot) -> Place {
        let SurfacePoint { triangle, b } = spot.point;
        let (scene, part) = (self.scene, self.scene.part(triangle));
        let flat = self.flat[triangle as usize];
        let at = flat.map(|f| f.at(b));
        let size = self.area[triangle as usize].sqrt() as f32;
        let texels = flat.map_or(0.0, |f| texel_area(&f.uv).sqrt());
        let edge = if texels > 1e-3 { size / texels as f32 } else { size };
        Place {
            value: spot.value,
            node: part.name.clone(),
            mesh: [part.mesh, part.primitive],
            position: scene.position(triangle, b).to_array(),
            normal: scene.geometric_normal(triangle).to_array(),
            page: flat.map(|f| f.page as usize),
            texel: at.map(|p| [p.x.floor() as i32, p.y.floor() as i32]),
            scale: (6.0 * edge).max(1e-4),
        }
    }
}

/// The colour of a texel.
pub(super) fn rgb(texel: [f32; 4]) -> Rgb {
    Rgb::new(texel[0], texel[1], texel[2])
}

/// Area of a triangle on its page [texel²].
pub(super) fn texel_area(uv: &[Vec2; 3]) -> f64 {
    let [a, b, c] = uv.map(|p| p.as_dvec2());
    0.5 * (b - a).perp_dot(c - a).abs()
}

fn flatten(scene: &Scene, lightmaps: &Lightmaps, triangle: u32) -> Option<Flat> {
    if !scene.part(triangle).receives {
        return None;
    }
    let (page, intensity) = lightmaps.page(scene, triangle)?;
    let uv = lightmaps.texels(scene, triangle)?.map(snap);
    let image = &lightmaps.pages()[page];
    let size = Vec2::new(image.width as f32, image.height as f32);
    let within = |p: &Vec2| {
        let p = *p / size;
        p.is_finite() && p.min_element() >= -BORDER && p.max_element() <= 1.0 + BORDER
    };
    Some(Flat { uv, page: page as u32, intensity, inside: uv.iter().all(within) })
}

/// A position on the grid of [`GRID`]. Coordinates are written as parts of the page, so texel borders come back a little
/// off, and a chart would seem to reach into the next texel.
fn snap(texels: Vec2) -> Vec2 {
    let snapped = (texels * GRID + 0.5).floor() / GRID;
    if snapped.is_finite() { snapped } else { texels }
}

/// Size of the largest page, if triangles lie on the pages in a way that can be worked with.
fn page_size(scene: &Scene, lightmaps: &Lightmaps, flat: &[Option<Flat>]) -> Result<[u32; 2], Error> {
    let fail = |message: String| Err(Error::invalid(&scene.document.path, message));
    let pages = lightmaps.pages();
    let size = |f: fn(&ImageF32) -> u32| pages.iter().map(f).max().unwrap_or(1).max(1);
    let (width, height) = (size(|p| p.width), size(|p| p.height));
    let texels = u64::from(width).saturating_mul(u64::from(height)).saturating_mul(pages.len() as u64);
    if texels > MOST_TEXELS {
        return fail(format!("{} pages of up to {width} × {height} texels are more than can be checked", pages.len()));
    }
    let cells = |f: &Flat| {
        let [a, b, c] = f.uv;
        let extent = a.max(b).max(c) - a.min(b).min(c);
        texel_area(&f.uv) + f64::from(extent.element_sum()) + 1.0
    };
    let claimed = flat.iter().flatten().filter(|f| f.inside).map(cells).fold(0.0, |a, b| a + b);
    let room = MOST_LAYERS * texels as f64 + 64.0 * flat.len() as f64;
    if claimed > room.min(f64::from(u32::MAX) * 0.5) {
        let times = claimed / texels.max(1) as f64;
        return fail(format!(
            "its triangles cover the lightmap pages about {times:.0} times; this is no lightmap layout"
        ));
    }
    Ok([width, height])
}

fn atlas(scene: &Scene, flat: &[Option<Flat>], chart: &[u32], page_size: [u32; 2], pages: u32) -> Atlas {
    let mut atlas = Atlas { page_size, pages, ..Atlas::default() };
    for (index, part) in scene.parts.iter().enumerate() {
        let range = part.triangles.start as usize..part.triangles.end as usize;
        let mut layout = Layout {
            source_vertex: (0..part.vertices.len() as u32).collect(),
            uv: vec![Vec2::ZERO; part.vertices.len()],
            chart: chart[range.clone()].to_vec(),
            ..Layout::default()
        };
        for t in range {
            let local = scene.triangle(t as u32).map(|v| v - part.vertices.start);
            layout.triangles.push(local);
            let Some(f) = flat[t] else { continue };
            local.iter().zip(f.uv).for_each(|(v, uv)| layout.uv[*v as usize] = uv);
            if chart[t] != NO_CHART && chart[t] as usize == atlas.charts.len() {
                atlas.charts.push(Chart { part: index as u32, page: f.page });
            }
        }
        atlas.parts.push(ChartedPart::on_page(layout));
    }
    atlas
}

/// A triangle as an affine map from its page to the world, also beyond its edges; `None` without area on the page.
pub(super) fn world_of(scene: &Scene, flat: &Flat, triangle: u32, at: DVec2) -> Option<Vec3> {
    let [a, b, c] = flat.uv.map(|p| p.as_dvec2());
    let (e1, e2, p) = (b - a, c - a, at - a);
    let area = e1.perp_dot(e2);
    let (b1, b2) = (p.perp_dot(e2) / area, e1.perp_dot(p) / area);
    let [p0, p1, p2]: [DVec3; 3] = scene.corners(triangle).map(|p| p.as_dvec3());
    let world = p0 + (p1 - p0) * b1 + (p2 - p0) * b2;
    world.is_finite().then(|| world.as_vec3())
}
