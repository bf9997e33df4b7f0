//! Lights without size that are looked at one by one: exact, but for texels that an edge of their shadow cuts.
//!
//! Each light is evaluated at four points of the texel, which is exact for cubic functions (linear ones where its surface is
//! cut, see `Patches::quarters`). A light is cut by an edge where these cells do not agree on it, and where a neighbouring
//! texel's cells all say the opposite: then the edge runs between the points of the two, and takes up to a quarter of either.
//! Where cells of a texel do not agree but those of two texels on opposite sides of it do, no one edge is there but something
//! thin, as a wire or a leaf, or the corner of something: it may pass between the points of the texels around, so these
//! count as cut, too.
//! Glass has edges, too: they are where the share of light that passes differs by more than `LEAST_EDGE` (without this, texels
//! cut by the shadow of a tinted pane were up to a quarter of the light off). Edges are left to the samples, and so are lights
//! nearer than [`NEAR`], and all light on normal maps, which change faster than cells.

use super::lit::Lit;
use super::look::Look;
use super::neighbors::Neighbors;
use super::punctual;
use super::slope::Moments;
use crate::base::{LightVector, Progress, Rgb, parallel};
use glam::Vec2;

/// Least share of a texel that is cut into cells [texel²].
const LEAST_CELLS: f32 = 1e-9;
/// Distance of a light up to which its light bends more over a texel than four points tell [texels]. From there on they are
/// 0.12 % off at most, at half the distance 1.5 %; centroids of 2 × 2 cells were 1.4 and 4 % off.
const NEAR: f32 = 2.0;
/// Share of a light that makes an edge.
const LEAST_EDGE: f32 = 0.02;

/// What the cells of one texel say.
#[derive(Debug, Clone, Copy, Default)]
struct Cells {
    mean: Rgb,
    vector: LightVector,
    slope: Vec2,
    /// Lights that some cell sees, a bit each.
    any: u64,
    /// Lights that all cells see.
    all: u64,
    /// Lights that something between clear and opaque dims in some cell.
    dimmed: u64,
    /// Lights of which more passes to one cell than to another.
    uneven: u64,
    /// Share of the lights that passes, summed over them.
    passing: f32,
    rays: u64,
}

impl Cells {
    /// Lights that an edge divides between two texels.
    fn edges_between(&self, other: &Self) -> u64 {
        let dark = (self.all & !other.any) | (other.all & !self.any);
        let dimmed = self.dimmed | other.dimmed;
        if (self.passing - other.passing).abs() > LEAST_EDGE { dark | dimmed } else { dark }
    }
}

/// Light without edges of shadows, per patch.
#[derive(Debug, Default)]
pub(super) struct Hard {
    /// Irradiance by the lights that have no edge here [lx].
    pub(super) irradiance: Vec<Rgb>,
    /// Their light vectors; empty if those are not wanted.
    pub(super) vectors: Vec<LightVector>,
    /// Its slope over the patch's texel [lx per texel].
    pub(super) slope: Vec<Vec2>,
    /// Lights whose shadow's edge cuts the patch, a bit each.
    pub(super) edges: Vec<u64>,
    pub(super) rays: u64,
}

pub(super) fn hard<'a>(look: &(impl Fn() -> Look<'a> + Sync), neighbors: &Neighbors<'_>, progress: &Progress) -> Hard {
    let n = look().patches.len();
    let vectors = |vector: &(dyn Fn(usize) -> LightVector + Sync)| {
        if look().directional { parallel::map(n, vector) } else { vec![] }
    };
    if look().emitters.hard.is_empty() {
        let (irradiance, slope, edges) = (vec![Rgb::ZERO; n], vec![Vec2::ZERO; n], vec![0; n]);
        return Hard { irradiance, vectors: vectors(&|_| LightVector::default()), slope, edges, rays: 0 };
    }
    let all = u64::MAX >> (64 - look().emitters.hard.len());
    let first = parallel::map_watched(n, progress, |i| cells(&mut look(), i, u64::MAX));
    let thin = parallel::map(n, |i| thin(&first, neighbors, i));
    let edges = parallel::map(n, |i| {
        let own = &first[i];
        let mut edges = (own.any ^ own.all) | own.uneven | thin[i];
        neighbors.of(i, |j| edges |= own.edges_between(&first[j]) | thin[j]);
        if look().has_relief(i) { all } else { edges }
    });
    let again = parallel::map(n, |i| if edges[i] == 0 { first[i] } else { cells(&mut look(), i, !edges[i]) });
    let rays: u64 = (0..n).map(|i| first[i].rays + if edges[i] == 0 { 0 } else { again[i].rays }).sum();
    let (irradiance, slope) = again.iter().map(|c| (c.mean, c.slope)).unzip();
    Hard { irradiance, vectors: vectors(&|i| again[i].vector), slope, edges, rays }
}

/// Lights of which something hides, or lets through, a part of a patch that no straight edge of a shadow would: what is lit
/// beside a straight edge is convex.
fn thin(cells: &[Cells], neighbors: &Neighbors<'_>, patch: usize) -> u64 {
    let own = cells[patch].any ^ cells[patch].all;
    if own == 0 {
        return 0;
    }
    let around = neighbors.around(patch);
    let both = |k: usize| match (around[k], around[8 - k]) {
        (Some(a), Some(b)) => cells[a].all & cells[b].all | !cells[a].any & !cells[b].any,
        _ => 0,
    };
    (0..4).fold(0, |found, k| found | own & both(k))
}

/// Mean over the cells, of the lights in `mask`.
fn cells(look: &mut Look<'_>, patch: usize, mask: u64) -> Cells {
    if look.patches.exposed[patch] <= 0.0 {
        return Cells::default();
    }
    let (mut sum, mut vector, mut weight, mut passing) = (Rgb::ZERO, LightVector::default(), 0.0f32, 0.0f32);
    let (mut any, mut all, mut dimmed, mut uneven) = (0, u64::MAX, 0, 0);
    let mut first = [f32::NAN; u64::BITS as usize];
    let (patches, emitters) = (look.patches, look.emitters);
    let near = NEAR * patches.texel_edge(patch);
    let (mut moments, mut last) = (Moments::default(), None);
    patches.quarters(patch, |point, within, area| {
        let place = look.place(patch, point, &mut last);
        let (mut seen, mut here) = (0u64, Lit::default());
        for (k, light) in emitters.hard.iter().enumerate().filter(|(k, _)| mask >> k & 1 == 1) {
            let (lit, share) = look.light_and_passing(&place, light, Vec2::ZERO);
            if lit.all.max_element() > 0.0 {
                here = here + lit;
                seen |= 1 << k;
                uneven |= u64::from(punctual::is_near(light, place.position, near)) << k;
                passing += share * area;
                dimmed |= u64::from(share < 1.0 - LEAST_EDGE) << k;
            }
            if first[k].is_nan() {
                first[k] = share;
            }
            uneven |= u64::from((share - first[k]).abs() > LEAST_EDGE) << k;
        }
        sum += here.all * area;
        vector += here.vector * area;
        moments.add(here.all, within, area);
        weight += area;
        any |= seen;
        all &= seen;
    });
    let all = if weight > 0.0 { all } else { 0 };
    let weight = weight.max(LEAST_CELLS);
    let (mean, vector, passing) = (sum / weight, vector * weight.recip(), passing / weight);
    Cells { mean, vector, slope: moments.slope(), any, all, dimmed, uneven, passing, rays: look.rays }
}
