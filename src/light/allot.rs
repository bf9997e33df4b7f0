//! Who gets more shadow rays: texels whose halves disagree, judged with their neighbours.
//!
//! In: estimates of every kind after a round. Out: for each kind, the patches that need more samples, and how many.
//!
//! The difference of two halves is one draw of an error, too little to judge by: half of the noisy texels would look
//! clean. So variances per sample are averaged over 3 × 3 texels. The error that remains is compared with the light that is
//! visible there, all kinds together, averaged alike, plus a little of the scene's mean, so that no rays go to the dark.
//!
//! Limits: an edge that no texel of a neighbourhood has noticed gets nothing.

use super::direct::Estimate;
use super::neighbors::Neighbors;
use crate::base::{Rgb, parallel};

/// A patch, and the samples of each half that it shall have.
pub(super) type Allotment = (u32, u32);

/// Rounds after the first.
pub(super) const ROUNDS: u32 = 3;
/// Share of the samples that everybody gets.
const FIRST: f32 = 0.5;
/// Most samples, as a multiple of those asked for.
const MOST: u32 = 16;
/// Standard error over visible light at which a texel has enough, at [`TYPICAL`] samples.
const ENOUGH: f32 = 0.02;
/// Samples for which [`ENOUGH`] holds; it falls with their square root.
const TYPICAL: f32 = 32.0;
/// Share of the scene's mean that counts as visible everywhere.
const DARK: f64 = 0.05;

/// Samples per half of the first round.
pub(super) fn first_samples(samples: u32) -> u32 {
    ((samples as f32 * 0.5 * FIRST).ceil() as u32).max(1)
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
    let dark = (DARK * parallel::sum(n, |i| f64::from(visible[i])) / n.max(1) as f64) as f32;
    let enough = ENOUGH * ENOUGH * TYPICAL / samples as f32;
    let most = (samples * MOST / 2).max(1);
    let one = |estimates: &[Estimate], i: usize| {
        let own = estimates[i];
        if own.samples == 0 || own.samples >= most {
            return None;
        }
        let (mut variance, mut light, mut count) = (variance(&own), visible[i], 1.0);
        neighbors.of(i, |j| {
            variance += self::variance(&estimates[j]);
            light += visible[j];
            count += 1.0;
        });
        let level = light.max(visible[i] * count) / count + dark;
        let allowed = enough * level * level;
        let factor = variance / count / own.samples as f32 / allowed.max(f32::MIN_POSITIVE);
        (factor > 1.0).then(|| {
            let factor = if factor > 4.0 {
                8
            } else if factor > 2.0 {
                4
            } else {
                2
            };
            (i as u32, (own.samples * factor).min(most))
        })
    };
    kinds.iter().map(|k| parallel::map(n, |i| one(k, i)).into_iter().flatten().collect()).collect()
}

/// Variance of one sample, from the two means: mean of the channels.
fn variance(estimate: &Estimate) -> f32 {
    let difference = estimate.halves[0] - estimate.halves[1];
    difference.length_squared() / 12.0 * estimate.samples as f32
}
