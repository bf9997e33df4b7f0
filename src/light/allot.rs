//! Who gets more shadow rays: texels whose halves disagree, judged with their neighbours.
//!
//! In: estimates of every kind after a round. Out: for each kind, the patches that need more samples, and how many.
//!
//! The difference of two halves is one draw of an error, too little to judge by: half of the noisy texels would look
//! clean. So variances per sample are averaged over the 3 × 3 texels that have samples of the kind. With v that
//! variance and n its samples, one more sample takes v/n² off a texel's squared error. It gets more as long as v/n² ·
//! n₀ is above ENOUGH² · visible · mean, n₀ the samples asked for and `visible` the light there, all kinds together,
//! plus [`DARK`] of the scene's mean: half-way between an absolute error, which spends the rays on the brightest
//! texels, and a relative one, which spends them in the dark.
//!
//! Of few samples none may lie beyond an edge that cuts a texel: both halves agree, and are wrong. So after the first
//! round v is at least what it would be if the edge of what the neighbours show ran through the middle. With a sixteenth
//! of the rays of `production` errors fell from 2.72 to 2.43 % (chairs), 5.56 to 5.18 % (office), 3.63 to 3.53 % (two
//! rooms), with all of them by a hundredth, for 3 and 1 % of the time. Four times as much v: no less error.
//!
//! What lost, as NRMSE in a bake with the default preset, 10,000 texels, seconds of direct light on 2 cores:
//! * as kept, ENOUGH from 0.01 to 0.005: office 2.4 to 2.3 %, 0.8 to 1.4 s; courtyard 1.5 to 1.2 %, 0.2 to 0.3 s; room
//!   13 %, 3.7 to 6 s (nearly all of it in four texels inside a lampshade, 200 times as bright as the mean);
//! * samples until v/n itself is small, at most 16 times those asked for: office 2.4 %, 1.0 s; courtyard 1.2 %, 0.3 s;
//!   room 35 %, 4.7 s; with up to 64 times room 13 % too, but 8.5 s;
//! * four times the ENOUGH: courtyard 2.2 %, office 2.8 %, in 0.1 and 0.3 s less.
//!
//! And earlier, as rays a texel: NRMSE / root mean square relative error, office at 32 samples
//! (`tests/bench/direct.rs`):
//! * a threshold as above: 118: 2.7 % / 2.9 %; cornell 66: 1.4 % / 1.9 %;
//! * no rounds, the same for everybody: 80: 3.4 % / 4.2 %; cornell 88: 1.6 % / 2.6 %;
//! * relative error alone: 121: 3.0 % / 2.7 %; cornell 77: 1.3 % / 1.6 %;
//! * a first round of half the samples: 83: 4.3 % / 4.2 %: edges of shadows go unnoticed;
//! * neighbours without samples counted as clean, edges of hard shadows with the first round of everybody: courtyard
//!   95: 2.2 % / 2.8 %, against 50: 1.6 % / 3.2 %.
//!
//! Limits: an edge that no sample of a neighbourhood has noticed gets nothing.

use super::direct::Estimate;
use super::neighbors::Neighbors;
use crate::base::{Rgb, color, parallel};

/// A patch, and the samples of each half that it shall have.
pub(super) type Allotment = (u32, u32);

/// Rounds after the first.
pub(super) const ROUNDS: u32 = 3;
/// Most samples, as a multiple of those asked for.
const MOST: u32 = 64;
/// Standard error over visible light below which a texel of mean brightness gets no second round, at [`TYPICAL`]
/// samples.
const ENOUGH: f32 = 0.007;
/// Samples for which [`ENOUGH`] holds; it falls with their square root.
const TYPICAL: f32 = 32.0;
/// The same for lights without size and suns, as a multiple: they are sampled at edges of shadows alone, which are few.
/// Courtyard (73,000 texels, `production`) has 0.29 % error of direct light in 0.22 s with 1, 0.23 % in 0.25 s with 0.3.
const ENOUGH_AT_EDGES: f32 = 0.3;
/// Share of the scene's mean that counts as visible everywhere.
const DARK: f32 = 0.05;
/// Least samples per half where an edge is known to be. With one sample, a hundredth of the texels had 0.69 of the squared
/// error of courtyard (61,000 texels, a sixteenth of the rays of `production`), 3.2 % NRMSE; with these it is 2.0 %, in the
/// same time (with 4 or 8 2.1 %, with 32 1.95 %).
const LEAST_AT_EDGES: u32 = 16;

/// Samples per half of the first round, `each` for suns that have a size.
pub(super) fn first_samples(samples: u32, each: bool) -> u32 {
    if each { samples } else { samples.div_ceil(2) }.max(1)
}

/// The same where the edge of a shadow is known to be: it may cut off so little that few samples do not notice.
pub(super) fn first_at_edge(samples: u32) -> u32 {
    (2 * samples).max(LEAST_AT_EDGES)
}

/// What each kind wants, patches ascending. Kinds come with whether they are sampled at edges alone.
pub(super) fn wanted(
    hard: &[Rgb],
    kinds: &[(&[Estimate], bool)],
    neighbors: &Neighbors<'_>,
    samples: u32,
) -> Vec<Vec<Allotment>> {
    let n = hard.len();
    let visible = parallel::map(n, |i| {
        let sum = |h: usize| kinds.iter().map(|(k, _)| k[i].halves[h]).fold(Rgb::ZERO, |a, b| a + b);
        color::mean(hard[i] + (sum(0) + sum(1)) * 0.5)
    });
    let mean = (parallel::sum(n, |i| f64::from(visible[i])) / n.max(1) as f64) as f32;
    let enough = |at_edges: bool| {
        let least = if at_edges { ENOUGH * ENOUGH_AT_EDGES } else { ENOUGH };
        least * least * TYPICAL / samples as f32 * mean
    };
    let most = (samples * MOST / 2).max(1);
    let typical = samples as f32 / 2.0;
    let one = |estimates: &[Estimate], first: u32, enough: f32, i: usize| {
        let own = estimates[i];
        if own.samples == 0 || own.samples >= most {
            return None;
        }
        let (mut spread, mut judges) = (variance(&own), 1.0);
        let (mut light, mut count) = (visible[i], 1.0);
        let (is_first, here, mut between) = (own.samples <= first, middle(&own), 0.0f32);
        neighbors.of(i, |j| {
            light += visible[j];
            count += 1.0;
            if estimates[j].samples > 0 {
                spread += variance(&estimates[j]);
                judges += 1.0;
                if is_first {
                    between = between.max((middle(&estimates[j]) - here).length_squared());
                }
            }
        });
        let level = (light / count).max(visible[i]) + DARK * mean;
        let n = own.samples as f32;
        // A quarter of the squared step is the variance of a sample that falls on either side; see `variance` for the rest.
        let gain = (spread / judges).max(between / 24.0) / (n * n) * typical;
        let factor = (gain / (enough * level).max(f32::MIN_POSITIVE)).sqrt();
        let times = (factor.min(8.0).ceil() as u32).next_power_of_two();
        (factor > 1.0).then(|| (i as u32, (own.samples * times).min(most)))
    };
    let all = |&(estimates, at_edges): &(&[Estimate], bool)| {
        let (first, enough) = (first_samples(samples, at_edges), enough(at_edges));
        parallel::map(n, |i| one(estimates, first, enough, i)).into_iter().flatten().collect()
    };
    kinds.iter().map(all).collect()
}

/// The halves without what the gather finds, too: that is not at stake.
fn halves(estimate: &Estimate) -> [Rgb; 2] {
    [0, 1].map(|h| estimate.halves[h] - estimate.gathered[h])
}

/// Variance of one sample, from the two means: mean of the channels.
fn variance(estimate: &Estimate) -> f32 {
    let [a, b] = halves(estimate);
    (a - b).length_squared() / 12.0 * estimate.samples as f32
}

/// Mean of the halves.
fn middle(estimate: &Estimate) -> Rgb {
    let [a, b] = halves(estimate);
    (a + b) * 0.5
}
