//! Lights without size that are looked at one by one: exact, but for texels that an edge of their shadow cuts.
//!
//! Each light is evaluated at the centroids of 2 × 2 cells of the texel, which is exact for linear functions. A light
//! is cut by an edge where the cells do not agree on it, and where a neighbouring texel's cells all say the opposite:
//! then the edge runs between the centroids of the two, and takes up to a quarter of either. Edges are left to the
//! samples, and so is all light on normal maps, which change faster than cells.

use super::lit::Lit;
use super::look::Look;
use super::neighbors::Neighbors;
use super::slope::Moments;
use crate::base::{LightVector, Progress, Rgb, parallel};
use glam::Vec2;

/// Cells per side.
const CELLS: u32 = 2;
/// Least share of a texel that is cut into cells [texel²].
const LEAST_CELLS: f32 = 1e-9;

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
    rays: u64,
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
    let edges = parallel::map(n, |i| {
        let own = &first[i];
        let mut edges = own.any ^ own.all;
        neighbors.of(i, |j| edges |= (own.all & !first[j].any) | (first[j].all & !own.any));
        if look().has_relief(i) { all } else { edges }
    });
    let again = parallel::map(n, |i| if edges[i] == 0 { first[i] } else { cells(&mut look(), i, !edges[i]) });
    let rays: u64 = (0..n).map(|i| first[i].rays + if edges[i] == 0 { 0 } else { again[i].rays }).sum();
    let (irradiance, slope) = again.iter().map(|c| (c.mean, c.slope)).unzip();
    Hard { irradiance, vectors: vectors(&|i| again[i].vector), slope, edges, rays }
}

/// Mean over the cells, of the lights in `mask`.
fn cells(look: &mut Look<'_>, patch: usize, mask: u64) -> Cells {
    if look.patches.exposed[patch] <= 0.0 {
        return Cells::default();
    }
    let (mut sum, mut vector, mut weight) = (Rgb::ZERO, LightVector::default(), 0.0f32);
    let (mut any, mut all) = (0, u64::MAX);
    let (patches, emitters) = (look.patches, look.emitters);
    let mut moments = Moments::default();
    patches.cells(patch, CELLS, |point, within, area| {
        let place = look.place(patch, point);
        let (mut seen, mut here) = (0u64, Lit::default());
        for (k, light) in emitters.hard.iter().enumerate().filter(|(k, _)| mask >> k & 1 == 1) {
            let light = look.light(&place, light, Vec2::ZERO);
            if light.all.max_element() > 0.0 {
                here = here + light;
                seen |= 1 << k;
            }
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
    Cells { mean: sum / weight, vector: vector * weight.recip(), slope: moments.slope(), any, all, rays: look.rays }
}
