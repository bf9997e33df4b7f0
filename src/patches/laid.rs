//! Where the triangles of a scene lie on the lightmap pages.
//!
//! In: scene and atlas. Out: [`Laid`], asked by triangle. Equal parts share what they have, and differ in the
//! places of their charts. Parts that share their geometry and receive no light are left out: there may be a thousand
//! times as many of their triangles as of all others.

use super::NO_PATCH;
use crate::atlas::{Atlas, ChartedPart, NO_CHART};
use crate::base::parallel;
use crate::scene::{Part, Scene};
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
    /// Triangles as stored.
    all: Vec<SurfaceTriangle>,
    /// The chart of each, or [`NO_CHART`].
    chart: Vec<u32>,
    /// In the order of the scene's triangles.
    runs: Vec<Run>,
    /// Runs that share no triangles, and how many triangles those before them have.
    own: Vec<[u32; 2]>,
    /// Runs that do, one list for each set of triangles.
    shared: Vec<Vec<u32>>,
    /// Charts of runs that share their triangles: place and page.
    places: Vec<(Vec2, u32)>,
}

/// Triangles that follow each other in the scene and as stored.
#[derive(Debug, Clone, Copy)]
struct Run {
    /// First triangle of the scene.
    first: u32,
    len: u32,
    /// First triangle as stored.
    stored: u32,
    /// Where the triangles, stored without it, are placed.
    placed: Option<Placed>,
}

#[derive(Debug, Clone, Copy)]
struct Placed {
    /// First of its charts in [`Laid::places`].
    places: u32,
    /// Index of that chart in the atlas.
    first_chart: u32,
}

impl Laid {
    pub(super) fn new(scene: &Scene, atlas: &Atlas) -> Self {
        let mut laid = Self::default();
        let (layout_of, is_shared) = shared_layouts(atlas);
        let mut known: Vec<Option<(u32, usize)>> = vec![None; is_shared.len()];
        let mut next = None;
        for (p, (part, charted)) in scene.parts.iter().zip(&atlas.parts).enumerate() {
            if scene.is_copied(p) && !part.receives {
                continue;
            }
            let layout = layout_of[p] as usize;
            let (first, len, run) = (part.triangles.start, part.triangles.len() as u32, laid.runs.len() as u32);
            if is_shared[layout] {
                let (stored, set) = *known[layout].get_or_insert_with(|| {
                    laid.shared.push(vec![]);
                    (laid.store(scene, part, charted, None), laid.shared.len() - 1)
                });
                laid.shared[set].push(run);
                let placed = Placed { places: laid.places.len() as u32, first_chart: charted.first_chart };
                let page = |chart: usize| atlas.charts[placed.first_chart as usize + chart].page;
                laid.places.extend(charted.places.iter().enumerate().map(|(chart, place)| (*place, page(chart))));
                laid.runs.push(Run { first, len, stored, placed: Some(placed) });
                next = None;
            } else {
                let stored = laid.store(scene, part, charted, Some(atlas));
                match laid.runs.last_mut().filter(|_| next == Some(first)) {
                    Some(run) => run.len += len,
                    None => {
                        laid.own.push([laid.unshared() as u32, run]);
                        laid.runs.push(Run { first, len, stored, placed: None });
                    }
                }
                next = Some(part.triangles.end);
            }
        }
        laid
    }

    /// Appends the triangles of a part: on their pages, or from the places of its charts; where they begin.
    fn store(&mut self, scene: &Scene, part: &Part, charted: &ChartedPart, pages: Option<&Atlas>) -> u32 {
        let first = self.all.len() as u32;
        let layout = &charted.layout;
        let two_sided = scene.materials[part.material].is_two_sided();
        for (k, corners) in layout.triangles.iter().enumerate() {
            let uv = corners.map(|v| if pages.is_some() { charted.uv(v) } else { layout.uv[v as usize] });
            let [a, b, c] = uv.map(|p| p.as_dvec2());
            let texels = 0.5 * (b - a).perp_dot(c - a).abs();
            let chart = if pages.is_some() { charted.chart(k) } else { layout.chart[k] };
            let usable = chart != NO_CHART && texels > 0.0;
            let page = if usable { pages.map_or(0, |atlas| atlas.charts[chart as usize].page) } else { NO_PATCH };
            let scale = if usable { scene.area(part.triangles.start + k as u32) / texels } else { 0.0 };
            self.all.push(SurfaceTriangle { uv, page, scale: scale as f32, two_sided });
            self.chart.push(chart);
        }
        first
    }

    /// Of a triangle of the scene.
    #[inline]
    pub(super) fn of(&self, triangle: u32) -> SurfaceTriangle {
        self.find(triangle).map_or(NOWHERE, |(run, at)| self.placed(run, at))
    }

    /// The chart that a triangle belongs to, or [`NO_CHART`].
    pub(super) fn chart(&self, triangle: u32) -> u32 {
        let Some((run, at)) = self.find(triangle) else { return NO_CHART };
        let chart = self.chart[at];
        if chart == NO_CHART { NO_CHART } else { run.placed.map_or(0, |placed| placed.first_chart) + chart }
    }

    /// A stored triangle as a run has it.
    #[inline]
    fn placed(&self, run: &Run, at: usize) -> SurfaceTriangle {
        let stored = self.all[at];
        match run.placed {
            Some(placed) if stored.page != NO_PATCH => {
                let (place, page) = self.places[(placed.places + self.chart[at]) as usize];
                SurfaceTriangle { uv: stored.uv.map(|p| p + place), page, ..stored }
            }
            _ => stored,
        }
    }

    /// The run that a triangle is in, and its place as stored.
    #[inline]
    fn find(&self, triangle: u32) -> Option<(&Run, usize)> {
        let i = match self.runs.len() {
            1 => 0,
            _ => self.runs.partition_point(|run| run.first <= triangle).checked_sub(1)?,
        };
        let run = self.runs.get(i)?;
        let at = triangle.checked_sub(run.first)?;
        (at < run.len).then_some((run, (run.stored + at) as usize))
    }

    /// Number of triangles that no two parts share.
    pub(super) fn unshared(&self) -> usize {
        self.own.last().map_or(0, |[before, run]| (before + self.runs[*run as usize].len) as usize)
    }

    /// Of those the one with a number: its triangle of the scene, where it lies, and its chart.
    pub(super) fn nth_unshared(&self, number: usize) -> (u32, SurfaceTriangle, u32) {
        let number = number as u32;
        let [before, run] = self.own[self.own.partition_point(|[before, _]| *before <= number) - 1];
        let (run, at) = (self.runs[run as usize], number - before);
        let stored = (run.stored + at) as usize;
        (run.first + at, self.all[stored], self.chart[stored])
    }

    /// Sets of triangles that parts share.
    pub(super) fn shared(&self) -> impl Iterator<Item = Shared<'_>> {
        self.shared.iter().map(|runs| Shared { laid: self, runs })
    }

    /// Memory that this holds [bytes].
    pub(super) fn bytes(&self) -> usize {
        self.all.len() * (size_of::<SurfaceTriangle>() + size_of::<u32>())
            + self.runs.len() * size_of::<Run>()
            + self.places.len() * size_of::<(Vec2, u32)>()
    }
}

/// Triangles that parts share.
pub(super) struct Shared<'a> {
    laid: &'a Laid,
    runs: &'a [u32],
}

impl Shared<'_> {
    fn run(&self, user: usize) -> &Run {
        &self.laid.runs[self.runs[user] as usize]
    }

    /// Number of triangles.
    pub(super) fn len(&self) -> usize {
        self.run(0).len as usize
    }

    /// The triangle with a number, where it lies from the place of its chart, and the chart among those of a part.
    pub(super) fn nth(&self, number: usize) -> (u32, SurfaceTriangle, u32) {
        let stored = self.run(0).stored as usize + number;
        (number as u32, self.laid.all[stored], self.laid.chart[stored])
    }

    /// For each part its first triangle, and the place and page of its chart.
    pub(super) fn places(&self, chart: u32) -> impl Iterator<Item = (u32, Vec2, u32)> {
        (0..self.runs.len()).filter_map(move |user| {
            let run = self.run(user);
            let (place, page) = self.laid.places[(run.placed?.places + chart) as usize];
            Some((run.first, place, page))
        })
    }
}

/// For each part its layout, and for each layout whether several parts have it, all of them without another part's
/// triangles in their charts.
fn shared_layouts(atlas: &Atlas) -> (Vec<u32>, Vec<bool>) {
    let (layouts, layout_of) = atlas.layouts();
    let mut users = vec![0; layouts.len()];
    layout_of.iter().for_each(|layout| users[*layout as usize] += 1);
    let mut is_shared: Vec<bool> = users.iter().map(|users| *users > 1).collect();
    if !is_shared.contains(&true) {
        return (layout_of, is_shared);
    }
    let charts = parallel::map(layouts.len(), |i| {
        let mut charts: Vec<u32> = layouts[i].chart.iter().copied().filter(|c| *c != NO_CHART).collect();
        charts.sort_unstable();
        charts.dedup();
        charts
    });
    let mut parts_in = vec![0u8; atlas.charts.len()];
    let in_charts = |p: usize| {
        let first = atlas.parts[p].first_chart;
        charts[layout_of[p] as usize].iter().map(move |chart| (first + chart) as usize)
    };
    for p in 0..atlas.parts.len() {
        in_charts(p).for_each(|chart| parts_in[chart] = (parts_in[chart] + 1).min(2));
    }
    for p in 0..atlas.parts.len() {
        is_shared[layout_of[p] as usize] &= in_charts(p).all(|chart| parts_in[chart] == 1);
    }
    (layout_of, is_shared)
}

impl SurfaceTriangle {
    /// Where a hit on the triangle lies on its page [texels].
    #[inline]
    pub(super) fn at(&self, hit: &Hit) -> Vec2 {
        self.uv[0] + (self.uv[1] - self.uv[0]) * hit.b.x + (self.uv[2] - self.uv[0]) * hit.b.y
    }
}
