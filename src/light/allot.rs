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
//! In a room behind a window the eye gets used to its light, not to that of the street outside, which makes the scene's mean. So
//! that mean counts less where it is far dimmer around (`patches::Outlook`). A room with a window of 1.2 m in a house that has its
//! outside, too (`preview`): direct light from 5.2 to 4.3 % NRMSE of the light in the room.
//!
//! Of few samples none may lie beyond an edge that cuts a texel: both halves agree, and are wrong. So after the first
//! round v is at least what it would be if the edge of what the neighbours show ran through the middle. With a sixteenth
//! of the rays of `production` errors fell from 2.72 to 2.43 % (chairs), 5.56 to 5.18 % (office), 3.63 to 3.53 % (two
//! rooms), with all of them by a hundredth, for 3 and 1 % of the time. Four times as much v: no less error.
//!
//! Where a texel's own samples help to decide that it gets more, what they find too often is corrected, and what they do
//! not find stays missing: the mean is too low wherever little of the sky is seen. A grey room with a hole of 0.2 m (one ray
//! in 600 finds out) got 0.17 of its light by `preview`, 0.60 by `production`; stated errors knew nothing of it. So for sky,
//! suns and edges the neighbours' first samples decide alone, once: what is found is right in the mean (0.96 ± 0.03,
//! 1.03 ± 0.02). NRMSE of the room by `production` fell from 0.24 to 0.14, with a hole of 0.4 m by a sixteenth of that
//! from 0.23 to 0.19; courtyard, two rooms: 0.98 of what it was. Lamps and glowing surfaces keep three rounds in which a
//! texel's own samples count: without these, single bright samples stay (office 0.0588 to 0.0651 by a sixteenth of
//! `production`, 0.0150 to 0.0158 by all of it).
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
//! Where glowing surfaces are seen through openings ([`openings`](super::openings)), they are judged as the sky is.
//!
//! Limits: an edge that no sample of a neighbourhood has noticed gets nothing. Of glowing surfaces behind holes so small that
//! these are not found, too little light is found, as above.

use super::direct::{Estimate, Kind};
use super::neighbors::Neighbors;
use super::openings::Openings;
use crate::base::{Rgb, color, parallel};
use crate::patches::Dimness;

/// A patch, and the samples of each half that it shall have.
pub(super) type Allotment = (u32, u32);

/// Rounds after the first.
pub(super) const ROUNDS: u32 = 3;
/// Most samples, as a multiple of those asked for.
const MOST: u32 = 64;
/// Most by which a round that others follow multiplies the samples.
const MOST_AT_ONCE: f32 = 8.0;
/// Standard error over visible light below which a texel of mean brightness gets no second round, at [`TYPICAL`]
/// samples.
const ENOUGH: f32 = 0.007;
/// Samples for which [`ENOUGH`] holds; it falls with their square root.
const TYPICAL: f32 = 32.0;
/// The same for lights without size and suns, as a multiple: they are sampled at edges of shadows alone, which are few.
/// Courtyard (73,000 texels, `production`) has 0.29 % error of direct light in 0.22 s with 1, 0.23 % in 0.25 s with 0.3.
const ENOUGH_AT_EDGES: f32 = 0.3;
/// The same, squared, for the sky where samples go by a map: there they are nearly all of its light, not the little that the
/// gather leaves, and sharing smooths them. Direct light of a room with a window (7,856 texels, `production`, maps where up to
/// 0.15 of the sky is seen): 1.85 % error with 1, 1.86 with 4, 1.94 with this, and far fewer rays.
const ENOUGH_IN_OPENINGS: f32 = 16.0;
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

/// Light of each patch, all kinds together, mean of the channels [lx].
pub(super) fn visible(hard: &[Rgb], kinds: &[(&[Estimate], Kind)]) -> Vec<f32> {
    parallel::map(hard.len(), |i| {
        let sum = |h: usize| kinds.iter().map(|(k, _)| k[i].halves[h]).fold(Rgb::ZERO, |a, b| a + b);
        color::mean(hard[i] + (sum(0) + sum(1)) * 0.5)
    })
}

/// What each kind wants, patches ascending, after so many rounds.
pub(super) fn wanted(
    kinds: &[(&[Estimate], Kind)],
    judges: &Judges<'_>,
    samples: u32,
    rounds: u32,
) -> Vec<Vec<Allotment>> {
    let visible = judges.visible;
    let n = visible.len();
    let mean = (parallel::sum(n, |i| f64::from(visible[i])) / n.max(1) as f64) as f32;
    let all = |&(estimates, kind): &(&[Estimate], Kind)| {
        let least = if kind == Kind::Each { ENOUGH * ENOUGH_AT_EDGES } else { ENOUGH };
        let judge = Judge {
            estimates,
            judges,
            kind,
            first: first_samples(samples, kind == Kind::Each),
            typical: samples as f32 / 2.0,
            most: (samples * MOST / 2).max(1),
            enough: least * least * TYPICAL / samples as f32 * mean,
            dark: DARK * mean,
        };
        let wants = |i: usize| if rounds > 0 && judge.is_by_neighbors(i) { None } else { judge.wants(i) };
        parallel::map(n, wants).into_iter().flatten().collect()
    };
    kinds.iter().map(all).collect()
}

/// By whom texels are judged.
pub(super) struct Judges<'a> {
    pub(super) neighbors: &'a Neighbors<'a>,
    /// What glows is judged by neighbours alone where it has an opening.
    pub(super) openings: &'a Openings,
    /// Light of all kinds together, mean of the channels [lx].
    pub(super) visible: &'a [f32],
    /// How bright it is around each patch, over the scene's mean.
    pub(super) dimness: &'a Dimness<'a>,
}

/// Judges the estimates of one kind.
struct Judge<'a> {
    estimates: &'a [Estimate],
    judges: &'a Judges<'a>,
    kind: Kind,
    /// Samples of a half in the first round, those asked for, and most.
    first: u32,
    typical: f32,
    most: u32,
    enough: f32,
    /// Light that counts as visible everywhere [lx].
    dark: f32,
}

impl Judge<'_> {
    /// The texel is judged by its neighbours alone, once.
    fn is_by_neighbors(&self, i: usize) -> bool {
        self.kind != Kind::Finite || self.judges.openings.glow(i).is_some()
    }

    /// Samples of the sky go by a map of where it is seen.
    fn is_guided(&self, i: usize) -> bool {
        self.kind == Kind::Infinity && self.judges.openings.sky(i).is_some()
    }

    /// What a patch shall have, if that is more than it has.
    fn wants(&self, i: usize) -> Option<Allotment> {
        let own = self.estimates[i];
        if own.samples == 0 || own.samples >= self.most {
            return None;
        }
        let (spread, light) = self.around(i);
        let n = own.samples as f32;
        let gain = spread / (n * n) * self.typical;
        let dim = self.judges.dimness.at(i);
        let enough = dim * if self.is_guided(i) { self.enough * ENOUGH_IN_OPENINGS } else { self.enough };
        let factor = (gain / (enough * (light + dim * self.dark)).max(f32::MIN_POSITIVE)).sqrt();
        let most = if self.is_by_neighbors(i) { MOST as f32 } else { MOST_AT_ONCE };
        let times = (factor.min(most).ceil() as u32).next_power_of_two();
        (factor > 1.0).then(|| (i as u32, (own.samples * times).min(self.most)))
    }

    /// Variance of a sample at a patch, and visible light [lx].
    fn around(&self, i: usize) -> (f32, f32) {
        let own = &self.estimates[i];
        let here = middle(own);
        let by_neighbors = self.is_by_neighbors(i);
        let (mut spread, mut judges) = if by_neighbors { (0.0, 0.0f32) } else { (variance(own), 1.0) };
        let (mut light, mut count) = if by_neighbors { (0.0, 0.0f32) } else { (self.judges.visible[i], 1.0) };
        let (mut low, mut high) = (Rgb::INFINITY, Rgb::NEG_INFINITY);
        let mut step = 0.0f32;
        self.judges.neighbors.of(i, |j| {
            light += self.judges.visible[j];
            count += 1.0;
            let other = &self.estimates[j];
            if other.samples > 0 {
                spread += variance(other);
                judges += 1.0;
                let middle = middle(other);
                (low, high) = (low.min(middle), high.max(middle));
                step = step.max((middle - here).length_squared());
            }
        });
        if judges == 0.0 {
            // Nobody is near to judge by.
            return (variance(own), self.judges.visible[i]);
        }
        let light = light / count;
        // A quarter of the squared step is the variance of a sample that falls on either side; see `variance` for the rest.
        if by_neighbors {
            ((spread / judges).max((high - low).length_squared() / 24.0), light)
        } else {
            let between = if own.samples <= self.first { step / 24.0 } else { 0.0 };
            ((spread / judges).max(between), light.max(self.judges.visible[i]))
        }
    }
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
