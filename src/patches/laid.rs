//! Where the triangles of a scene lie on the lightmap pages.
//!
//! In: scene and atlas. Out: [`Laid`], asked by triangle. Parts that share their geometry and receive no light are left
//! out: there may be a thousand times as many of their triangles as of all others.

use super::NO_PATCH;
use crate::atlas::{Atlas, NO_CHART};
use crate::scene::Scene;
use crate::trace::Hit;
use glam::Vec2;

/// Where a scene triangle lies on the pages.
#[derive(Debug, Clone, Copy)]
pub(super) struct SurfaceTriangle {
    /// Corners [texels].
    pub(super) uv: [Vec2; 3],
    /// Page, or [`NO_PATCH`] for a triangle without a chart.
    pub(super) page: u32,
    /// World area per texel area [m²].
    pub(super) scale: f32,
    /// Light takes part on both sides.
    pub(super) two_sided: bool,
}

/// What a triangle has that no chart lies on.
const NOWHERE: SurfaceTriangle = SurfaceTriangle { uv: [Vec2::ZERO; 3], page: NO_PATCH, scale: 0.0, two_sided: false };

/// All of them.
#[derive(Debug, Default)]
pub(super) struct Laid {
    /// Triangles of the runs, one run behind the other.
    all: Vec<SurfaceTriangle>,
    /// The chart of each, or [`NO_CHART`].
    chart: Vec<u32>,
    /// First triangle of each run, and its place in `all`.
    runs: Vec<[u32; 2]>,
}

impl Laid {
    pub(super) fn new(scene: &Scene, atlas: &Atlas) -> Self {
        let mut laid = Self::default();
        let mut next = u32::MAX;
        for (p, (part, charted)) in scene.parts.iter().zip(&atlas.parts).enumerate() {
            if scene.is_copied(p) && !part.receives {
                continue;
            }
            if part.triangles.start != next {
                laid.runs.push([part.triangles.start, laid.all.len() as u32]);
            }
            next = part.triangles.end;
            let two_sided = scene.materials[part.material].is_two_sided();
            for (k, corners) in charted.triangles.iter().enumerate() {
                let uv = corners.map(|v| charted.uv[v as usize]);
                let [a, b, c] = uv.map(|p| p.as_dvec2());
                let texels = 0.5 * (b - a).perp_dot(c - a).abs();
                let chart = charted.chart[k];
                let usable = chart != NO_CHART && texels > 0.0;
                let page = if usable { atlas.charts[chart as usize].page } else { NO_PATCH };
                let scale = if usable { scene.area(part.triangles.start + k as u32) / texels } else { 0.0 };
                laid.all.push(SurfaceTriangle { uv, page, scale: scale as f32, two_sided });
                laid.chart.push(chart);
            }
        }
        laid
    }

    /// Of a triangle of the scene.
    #[inline]
    pub(super) fn of(&self, triangle: u32) -> &SurfaceTriangle {
        self.place(triangle).and_then(|place| self.all.get(place)).unwrap_or(&NOWHERE)
    }

    /// The chart that a triangle belongs to, or [`NO_CHART`].
    pub(super) fn chart(&self, triangle: u32) -> u32 {
        self.place(triangle).and_then(|place| self.chart.get(place)).copied().unwrap_or(NO_CHART)
    }

    #[inline]
    fn place(&self, triangle: u32) -> Option<usize> {
        if let [[first, _]] = self.runs[..] {
            return triangle.checked_sub(first).map(|place| place as usize);
        }
        let run = self.runs.partition_point(|[first, _]| *first <= triangle).checked_sub(1)?;
        let end = self.runs.get(run + 1).map_or(self.all.len(), |[_, place]| *place as usize);
        let place = (triangle - self.runs[run][0] + self.runs[run][1]) as usize;
        (place < end).then_some(place)
    }

    /// Number of triangles that are not left out.
    pub(super) fn len(&self) -> usize {
        self.all.len()
    }

    /// The one with a number below [`Laid::len`], and its triangle of the scene.
    pub(super) fn nth(&self, place: usize) -> (u32, &SurfaceTriangle) {
        let run = self.runs.partition_point(|[_, first]| *first as usize <= place) - 1;
        (place as u32 - self.runs[run][1] + self.runs[run][0], &self.all[place])
    }

    /// Memory that this holds [bytes].
    pub(super) fn bytes(&self) -> usize {
        self.all.len() * (size_of::<SurfaceTriangle>() + size_of::<u32>())
    }
}

impl SurfaceTriangle {
    /// Where a hit on the triangle lies on its page [texels].
    #[inline]
    pub(super) fn at(&self, hit: &Hit) -> Vec2 {
        self.uv[0] + (self.uv[1] - self.uv[0]) * hit.b.x + (self.uv[2] - self.uv[0]) * hit.b.y
    }
}
