//! [`Scene`] → [`Atlas`]: charts, pages, conservative texel coverage. xatlas lives only here.
//!
//! Lightmap coordinates are kept in texels: x right, y down, texel (0, 0) covers [0, 1)². UV = texels / page size.

pub mod raster;

use glam::Vec2;

/// No chart: the triangle has no area, or its part receives no light.
pub const NO_CHART: u32 = u32::MAX;

/// Where every triangle lies on the lightmap pages.
#[derive(Debug, Default)]
pub struct Atlas {
    /// Width and height of every page [texels].
    pub page_size: [u32; 2],
    /// Number of pages.
    pub pages: u32,
    /// Density that was reached, in world space [texels/m].
    pub texels_per_meter: f32,
    /// Charts; a chart lies on one page.
    pub charts: Vec<Chart>,
    /// One entry per `Scene::parts`, in the same order.
    pub parts: Vec<ChartedPart>,
}

/// A connected piece of surface that is flat on a page.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Chart {
    /// Index into `Scene::parts`.
    pub part: u32,
    /// Page it lies on.
    pub page: u32,
}

/// A part with its vertices split where charts need it.
#[derive(Debug, Default, Clone)]
pub struct ChartedPart {
    /// For each output vertex, the index of the source vertex within the part (= accessor element).
    pub source_vertex: Vec<u32>,
    /// Lightmap position of each output vertex [texels]; zero where it belongs to no chart.
    pub uv: Vec<Vec2>,
    /// Output vertices of each triangle, in the order and winding of the part's range of `Scene::triangles`.
    pub triangles: Vec<[u32; 3]>,
    /// Index into `Atlas::charts` for each triangle, or [`NO_CHART`].
    pub chart: Vec<u32>,
    /// The part's own TEXCOORD_1 was kept: output vertices equal source vertices.
    pub kept: bool,
}
