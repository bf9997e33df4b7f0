//! Sharing: noisy light flows between linked texels, as far as its uncertainty allows.
//!
//! In: irradiance fields of the front patches, links, and how far light may flow at each patch. Out: the same fields,
//! smoother; flux is conserved and constant irradiance stays constant, whatever the areas.
//!
//! The texel graph is a network of conductances: one step is
//! `Φ_i += Σ_j g_ij (E_j − E_i)` with `g_ij = g_ji ≥ 0`. That is a reversible random walk on the texels, the fuzzy walk's splat made free of bias on constant light. A splat that
//! gives shares to neighbours by distance alone (the paper's eq. (4)) is not reversible: on a chain of five patches
//! with areas 1 1 1 1 0.1 it turns constant 1 into up to 3.
//!
//! How far light flows, `σ_i`, is the smaller of two bounds:
//! * the paper's uncertainty: a footprint of α bits has a radius in proportion to the distance R of the source, so
//!   σ ≤ a H with H the harmonic mean distance of what the patch sees;
//! * the noise: of n lines per area a kernel of width σ collects 4πσ²n, so its variance is 1/(4πσ²n); its bias on light
//!   that curves at the scale of H is κσ²/H². The sum of squares is least at σ⁶ = H⁴/(8πκ²n). It vanishes as n grows, so
//!   the result converges to the truth.
//!
//! Symbols: s texel edge [m]   c conductance factor of a link in [0, 1]   A exposed area [m²]   n lines per area [1/m²]
//!
//! Each explicit step moves light by one texel with probability [`STEP`] per link, a variance of 2·STEP·s² per axis.
//!
//! Limits: sharing stops at chart borders; at most [`MOST_STEPS`] steps, which is σ = 10 texels.

use crate::base::{Rgb, parallel};
use crate::patches::{PatchGraph, Patches};

/// Share of a patch that flows over one link per step. Four links take 0.8; above 0.25 the explicit step would ring.
const STEP: f32 = 0.2;
/// Ends the loop for very fine texels.
const MOST_STEPS: usize = 256;
/// κ: relative curvature of indirect light at the scale of H; a guess. Smaller shares more.
const CURVATURE: f32 = 0.5;

/// How much to share.
#[derive(Debug, Clone, Copy)]
pub struct Settings {
    /// a: most that light flows, as a share of the harmonic mean distance H.
    pub reach: f32,
    /// n: independent lines per area [1/m²].
    pub lines_per_area: f64,
}

/// Links of the four-neighbour scheme with their conductances, compressed rows over front patches.
struct Network {
    first: Vec<u32>,
    links: Vec<(u32, f32)>,
}

/// Shares the front patches' part of each of `fields` (irradiance [lx]) in place. `distance` is H [m].
pub fn share(
    patches: &Patches,
    graph: &PatchGraph,
    distance: &[f32],
    fields: &mut [&mut Vec<Rgb>],
    settings: &Settings,
) {
    let sigma = parallel::map(patches.front, |i| width(distance[i], settings));
    let edges = parallel::map(patches.front, |i| patches.texel_edge(i));
    let steps = steps(&sigma, &edges);
    if steps == 0 {
        return;
    }
    let network = Network::new(patches, graph, &sigma, &edges, steps);
    for field in fields {
        let mut now = field[..patches.front].to_vec();
        for _ in 0..steps {
            now = parallel::map(patches.front, |i| network.step(&now, i));
        }
        field[..patches.front].copy_from_slice(&now);
    }
}

/// σ [m].
fn width(distance: f32, settings: &Settings) -> f32 {
    let h = f64::from(distance);
    let kappa = f64::from(CURVATURE);
    let variance = h.powi(4) / (8.0 * core::f64::consts::PI * kappa * kappa * settings.lines_per_area.max(1e-9));
    (libm::pow(variance, 1.0 / 6.0) as f32).min(settings.reach * distance)
}

/// Steps that the widest twentieth of the texels needs at full conductance.
fn steps(sigma: &[f32], edges: &[f32]) -> usize {
    let mut needed: Vec<f32> = sigma.iter().zip(edges).map(|(w, s)| (w / s) * (w / s) / (2.0 * STEP)).collect();
    if needed.is_empty() {
        return 0;
    }
    let k = needed.len() * 19 / 20;
    let (_, value, _) = needed.select_nth_unstable_by(k, f32::total_cmp);
    (value.ceil() as usize).min(MOST_STEPS)
}

impl Network {
    fn new(patches: &Patches, graph: &PatchGraph, sigma: &[f32], edges: &[f32], steps: usize) -> Self {
        let rows = parallel::map(patches.front, |i| {
            let (x, y) = patches.texel_xy(i);
            let beside = |j: usize| {
                let (u, v) = patches.texel_xy(j);
                u.abs_diff(x) + v.abs_diff(y) == 1
            };
            let link = |&j: &u32| {
                let k = j as usize;
                let (width, s) = (sigma[i].min(sigma[k]), edges[i].max(edges[k]));
                let c = (width * width / (2.0 * STEP * steps as f32 * s * s)).min(1.0);
                let conductance = STEP * c * patches.exposed_area(i).min(patches.exposed_area(k));
                (j, conductance / patches.exposed_area(i).max(f32::MIN_POSITIVE))
            };
            graph.neighbors(i).iter().filter(|&&j| beside(j as usize)).map(link).collect::<Vec<_>>()
        });
        let mut first = vec![0u32];
        let mut links = vec![];
        for row in rows {
            links.extend(row);
            first.push(links.len() as u32);
        }
        Self { first, links }
    }

    fn step(&self, field: &[Rgb], i: usize) -> Rgb {
        let row = &self.links[self.first[i] as usize..self.first[i + 1] as usize];
        row.iter().fold(field[i], |e, &(j, rate)| e + (field[j as usize] - field[i]) * rate)
    }
}
