//! The charts of a part, and where they lie.
//!
//! A [`Layout`] has the vertices, split where charts need it, and their positions relative to their charts. Equal parts
//! share one; a [`ChartedPart`] adds the place of each chart, so its memory grows with the charts alone.

use super::Atlas;
use super::NO_CHART;
use glam::Vec2;
use std::collections::HashMap;
use std::sync::Arc;

/// Vertices and triangles of a part, wherever its charts lie.
#[derive(Debug, Default, Clone)]
pub struct Layout {
    /// For each output vertex, the index of the source vertex within the part (= accessor element).
    pub source_vertex: Vec<u32>,
    /// Lightmap position of each output vertex, from the place of its chart [texels]; zero where it belongs to no chart.
    pub uv: Vec<Vec2>,
    /// For each output vertex, its chart among those of the part, or [`NO_CHART`]. May be empty where all places are zero.
    pub vertex_chart: Vec<u32>,
    /// Output vertices of each triangle, in the order and winding of the part's range of triangles.
    pub triangles: Vec<[u32; 3]>,
    /// The chart of each triangle among those of the part, or [`NO_CHART`].
    pub chart: Vec<u32>,
}

/// A part with its place on the pages. Empty for a part that receives no light and shares its geometry.
#[derive(Debug, Default, Clone)]
pub struct ChartedPart {
    /// Its charts, shared by all parts that are equal to it.
    pub layout: Arc<Layout>,
    /// Index into `Atlas::charts` of the first of its charts.
    pub first_chart: u32,
    /// Place of each of its charts on the page of the chart [texels]; zero for those that are not listed.
    pub places: Vec<Vec2>,
    /// The part's own `TEXCOORD_1` was kept: output vertices equal source vertices.
    pub kept: bool,
}

impl ChartedPart {
    /// A part with a layout of its own whose positions are on the page and whose charts are indices into `Atlas::charts`.
    #[must_use]
    pub fn on_page(layout: Layout) -> Self {
        Self { layout: Arc::new(layout), ..Self::default() }
    }

    /// Index into `Atlas::charts` for a triangle, or [`NO_CHART`].
    #[must_use]
    pub fn chart(&self, triangle: usize) -> u32 {
        self.chart_of(self.layout.chart[triangle])
    }

    /// The same for all triangles.
    pub fn charts(&self) -> impl ExactSizeIterator<Item = u32> + '_ {
        self.layout.chart.iter().map(|chart| self.chart_of(*chart))
    }

    fn chart_of(&self, local: u32) -> u32 {
        if local == NO_CHART { NO_CHART } else { self.first_chart + local }
    }

    /// Lightmap position of an output vertex [texels]; zero where it belongs to no chart.
    #[must_use]
    pub fn uv(&self, vertex: u32) -> Vec2 {
        let chart = self.layout.vertex_chart.get(vertex as usize);
        let place = chart.and_then(|chart| self.places.get(*chart as usize));
        self.layout.uv[vertex as usize] + place.copied().unwrap_or(Vec2::ZERO)
    }

    /// The same for all output vertices.
    pub fn uvs(&self) -> impl ExactSizeIterator<Item = Vec2> + '_ {
        (0..self.layout.uv.len() as u32).map(|vertex| self.uv(vertex))
    }
}

impl Atlas {
    /// The different layouts of the parts, and which of them each part has.
    #[must_use]
    pub fn layouts(&self) -> (Vec<&Layout>, Vec<u32>) {
        let mut known: HashMap<*const Layout, u32> = HashMap::new();
        let mut layouts = vec![];
        let mut of_part = Vec::with_capacity(self.parts.len());
        for part in &self.parts {
            let next = layouts.len() as u32;
            let n = *known.entry(Arc::as_ptr(&part.layout)).or_insert(next);
            if n == next {
                layouts.push(&*part.layout);
            }
            of_part.push(n);
        }
        (layouts, of_part)
    }
}
