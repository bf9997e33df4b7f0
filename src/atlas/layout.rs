//! The charts of a part, and where they lie.
//!
//! A [`Layout`] has the vertices, split where charts need it, and their positions relative to their charts. Equal parts
//! share one; a [`ChartedPart`] adds the place of each chart, so its memory grows with the charts alone.

use super::Atlas;
use super::NO_CHART;
use super::connect;
use glam::DVec2;
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

impl Layout {
    /// For each chart of the part, whether it is several pieces of surface in one texel, which has one value for all.
    #[must_use]
    pub fn shared_texels(&self) -> Vec<bool> {
        let corners = |t: usize| self.triangles[t].map(|v| self.uv[v as usize].as_dvec2());
        let charted = || self.chart.iter().enumerate().filter(|(_, chart)| **chart != NO_CHART);
        let count = charted().map(|(_, chart)| *chart as usize + 1).max().unwrap_or(0);
        let mut bounds = vec![(DVec2::INFINITY, DVec2::NEG_INFINITY); count];
        for (t, &chart) in charted() {
            let (low, high) = &mut bounds[chart as usize];
            corners(t).iter().for_each(|p| (*low, *high) = (low.min(*p), high.max(*p)));
        }
        let mut small: Vec<(u32, usize)> = charted()
            .filter(|(_, chart)| {
                let (low, high) = bounds[**chart as usize];
                (high - low.floor()).max_element() <= 1.0
            })
            .map(|(t, chart)| (*chart, t))
            .collect();
        small.sort_unstable();
        let mut shared = vec![false; count];
        for members in small.chunk_by(|a, b| a.0 == b.0) {
            let flat: Vec<_> = members.iter().map(|(_, t)| corners(*t)).collect();
            shared[members[0].0 as usize] = connect::components(&flat).iter().any(|c| *c > 0);
        }
        shared
    }
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
