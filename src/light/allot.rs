//! Who gets more shadow rays: texels whose halves disagree, judged with their neighbours.
//!
//! In: estimates of every kind after a round. Out: for each kind, the patches that need more samples, and how many.
//!
//! The difference of two halves is one draw of an error, too little to judge by: half of the noisy texels would look
//! clean. So variances per sample are averaged over the 3 × 3 texels that have samples of the kind. A texel has enough when
//! its squared error is below ENOUGH² · visible · mean, where `visible` is the light there, all kinds together, plus
//! [`DARK`] of the scene's mean: half-way between an absolute error, which spends the rays on the brightest texels, and a
//! relative one, which spends them in the dark.
//!
//! What lost, as rays a texel: NRMSE / root mean square relative error, office at 32 samples (`tests/bench/direct.rs`):
//! * as kept: 118: 2.7 % / 2.9 % (by ENOUGH = 0.03); cornell 66: 1.4 % / 1.9 %;
//! * no rounds, the same for everybody: 80: 3.4 % / 4.2 %; cornell 88: 1.6 % / 2.6 %;
//! * relative error alone: 121: 3.0 % / 2.7 %; cornell 77: 1.3 % / 1.6 %;
//! * a first round of half the samples: 83: 4.3 % / 4.2 %: edges of shadows go unnoticed;
//! * neighbours without samples counted as clean, edges of hard shadows with the first round of everybody: courtyard
//!   95: 2.2 % / 2.8 %, against 50: 1.6 % / 3.2 %.
//!
//! Limits: an edge that no texel of a neighbourhood has noticed gets nothing.

use super::direct::Estimate;
use super::neighbors::Neighbors;
use crate::base::{Rgb, parallel};

/// A patch, and the samples of each half that it shall have.
pub(super) type Allotment = (u32, u32);

/// Rounds after the first.
pub(super) const ROUNDS: u32 = 3;
/// Most samples, as a multiple of those asked for.
const MOST: u32 = 16;
/// Standard error over visible light at which a texel of mean brightness has enough, at [`TYPICAL`] samples. Less costs rays
/// by its square where there are penumbrae; more leaves noise that a picture shows.
const ENOUGH: f32 = 0.04;
/// Samples for which [`ENOUGH`] holds; it falls with their square root.
const TYPICAL: f32 = 32.0;
/// Share of the scene's mean that counts as visible everywhere.
const DARK: f32 = 0.05;

/// Samples per half of the first round. Twice as many where an edge of a shadow is known to be: it may cut off so little that
/// few samples do not notice.
pub(super) fn first_samples(samples: u32, at_edges: bool) -> u32 {
    if at_edges { samples } else { samples.div_ceil(2) }.max(1)
}

/// What each kind wants, patches ascending.
pub(super) fn wanted(
    hard: &[Rgb],
    kinds: &[&[Estimate]],
    neighbors: &Neighbors<'_>,
    samples: u32,
) -> Vec<Vec<Allotment>> {
    let n = hard.len();
    let visible = parallel::map(n, |i| {
        let sum = |h: usize| kinds.iter().map(|k| k[i].halves[h]).fold(Rgb::ZERO, |a, b| a + b);
        (hard[i] + (sum(0) + sum(1)) * 0.5).element_sum() / 3.0
    });
    let mean = (parallel::sum(n, |i| f64::from(visible[i])) / n.max(1) as f64) as f32;
    let enough = ENOUGH * ENOUGH * TYPICAL / samples as f32 * mean;
    let most = (samples * MOST / 2).max(1);
    let one = |estimates: &[Estimate], i: usize| {
        let own = estimates[i];
        if own.samples == 0 || own.samples >= most {
            return None;
        }
        let (mut spread, mut judges) = (variance(&own), 1.0);
        let (mut light, mut count) = (visible[i], 1.0);
        neighbors.of(i, |j| {
            light += visible[j];
            count += 1.0;
            if estimates[j].samples > 0 {
                spread += variance(&estimates[j]);
                judges += 1.0;
            }
        });
        let level = (light / count).max(visible[i]) + DARK * mean;
        let factor = spread / judges / own.samples as f32 / (enough * level).max(f32::MIN_POSITIVE);
        let times = if factor > 4.0 { 8 } else { 4u32.min((factor.ceil() as u32).next_power_of_two()) };
        (factor > 1.0).then(|| (i as u32, (own.samples * times).min(most)))
    };
    kinds.iter().map(|k| parallel::map(n, |i| one(k, i)).into_iter().flatten().collect()).collect()
}

/// Variance of one sample, from the two means: mean of the channels.
fn variance(estimate: &Estimate) -> f32 {
    let difference = estimate.halves[0] - estimate.halves[1];
    difference.length_squared() / 12.0 * estimate.samples as f32
}
