//! Sharing: noisy light flows between linked texels, as far as two half-budgets show that it helps.
//!
//! In: irradiance as two halves that share no random number, and links. Out: both halves, smoother by the same linear
//! map, and the squared error that is left in their mean; constant irradiance stays constant, and flux is conserved, but
//! for what would be too dark or too bright beside jumps (`straightened`, `bounded`): of cornell, courtyard, office and
//! room up to 5·10⁻⁴ of it with the rays of `production`, 1.2·10⁻³ with a sixteenth of them.
//!
//! The fuzzy random walk's splat, made to converge: a bandwidth per texel that vanishes with the noise, and flow
//! through reversible conductances (`network`). Design: Castro, Feixas, Sbert, "Fuzzy Random Walk", §5, leave both
//! open.
//!
//! What flows is what differs from the trend of the light ([`trend`](super::trend)), not over links where it jumps
//! (`Network::stopped`). How far it flows over the others is chosen per texel among [`LEVELS`]. With A and B the halves
//! (one truth, independent noise) and G what a level does to them,
//!
//! `bias² = (G A − A)·(G B − B)` and `noise = ¼(G A − G B)²`
//!
//! are on average the squared bias and the variance of the mean of the halves, without a model of the light. Where light
//! bends, the bias shows and light flows less far; as the noise falls, every bias shows, so the result converges to the
//! truth. Both are noise themselves, of one texel; `judge` says what is to be believed of them. The same two are what is
//! stated.
//!
//! G does 2F − F² to what flows, with F the flow of a level: it leaves what bends smoothly as it is, to the second order,
//! and F² is the next level's F.
//!
//! Cross-validation of two buffers: Rousselle, Manzi, Zwicker, "Robust Denoising using Feature and Color Information",
//! Computer Graphics Forum 32(7), 2013, §4 (there for a pixel filter that conserves nothing).
//!
//! The choice looks at the noise that it judges, which makes what it sees of both low, the more the more of it is removed;
//! [`left`] makes up for it.
//!
//! Tried, each by the error against long bakes of the indirect light of cornell (117,000 texels), office (50,000),
//! courtyard (73,000) with the rays of `production`; it is 0.39, 0.79 and 0.42 %: F in place of G, 0.42, 0.82 and 0.44 %;
//! no stops, and levels judged in windows of 64 texels alone, 0.62, 1.04 and 0.56 %. Jumps of the raw light as stops,
//! too: 0.66, 0.83 and 0.45 % and more, as noise then keeps itself apart. Stops found again in the shared light: 0.48, 0.82
//! and 0.45 %, with F, against 0.48, 0.83 and 0.45 % without. All of that without trends. With them, the error of all light
//! of cornell (109,000 texels), office (44,000), courtyard (61,000), two rooms (35,000) and chairs (70,000) is 0.43, 1.36,
//! 0.48, 0.77 and 0.67 % instead of 0.50, 1.36, 0.50, 0.93 and 0.71 %. Jumps of the light itself rather than of the rest, with
//! trends that stop there: 1.35 in office, 0.82 in two rooms, 0.69 in chairs.

use super::cells::{self, Cells};
use super::judge::Judge;
use super::network::{Field, Network};
use super::trend::Trend;
use super::ways::Ways;
use super::windows::Windows;
use crate::base::{LightVector, Rgb, parallel};
use crate::patches::Patches;
use core::ops::{Add, Mul, Sub};
use std::sync::Arc;

/// Steps of flow that are compared; n steps spread light by √(0.4 n) texels: 0.6, 0.9, 1.3, 1.8, 2.5, 3.6, 5.1.
const LEVELS: [usize; 8] = [0, 1, 2, 4, 8, 16, 32, 64];
/// Power of the part by which noise fell, by which more of it is left than is seen, and the part from which on no more is
/// hidden. So chosen that of cornell, courtyard, office, room, two rooms and chairs (22,000 to 109,000 texels), with a quarter
/// of the rays of `production` and all of them, 0.8 to 1.1 of the error is stated, and 0.8 to 1.15 deviations are one.
const HIDDEN: f32 = 0.55;
const MOST_REMOVED: f32 = 2.5;
/// Error that no page shows, relative: half of what half floats round by.
const UNSEEN: f32 = 1.0 / 4096.0;
/// Steps of flow after which jumps over links are looked for, and jumps that halve what flows, squared, in variances of
/// the raw mean.
const PILOTS: [(usize, f32); 2] = [(1, 4.0), (3, 1.0)];
/// Steps that errors flow, to be known around each patch: a window of 3.5 texels.
const AROUND: usize = 30;
/// Steps that the chosen bandwidth flows, so that it does not jump.
const SETTLE_STEPS: usize = 2;
/// A wider level is tried while the last one was the best for this share of the texels.
const WORTHWHILE: f64 = 0.02;

/// Two halves of a solution.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Pair(Rgb, Rgb);

/// Squared error of the mean of two shared halves [lx², sum of the channels], by patch.
#[derive(Debug, Default)]
pub struct Errors {
    /// Noise that is left.
    pub noise: Vec<f32>,
    /// Squared bias of the flow. Means something only averaged over many patches; single ones can be negative.
    pub bias: Vec<f32>,
}

impl Errors {
    /// Two halves that did not flow.
    #[must_use]
    pub fn of_noise(halves: &[Vec<Rgb>; 2]) -> Self {
        let [a, b] = halves;
        let noise = parallel::map_light(a.len(), |i| 0.25 * (a[i] - b[i]).length_squared());
        Self { bias: vec![0.0; a.len()], noise }
    }

    /// The errors of light that does not depend on this one come on top.
    pub fn add(&mut self, other: &Self) {
        let add = |a: &mut [f32], b: &[f32]| a.iter_mut().zip(b).for_each(|(a, b)| *a += *b);
        add(&mut self.noise, &other.noise);
        add(&mut self.bias, &other.bias);
    }

    /// Over the patches that count together; there the bias is known well enough to be added where it is not negative.
    #[must_use]
    pub fn sum_of(&self, counts: impl Fn(usize) -> bool + Sync) -> f64 {
        let sum = |values: &[f32]| parallel::sum(values.len(), |i| if counts(i) { f64::from(values[i]) } else { 0.0 });
        sum(&self.noise) + sum(&self.bias).max(0.0)
    }

    /// Squared error to be expected of each patch: half of it from around the patch, half from its cell of space.
    ///
    /// Either alone knows too little. From around it alone, charts of few texels seemed to have 0.35 of the error that
    /// they had (office, 128 rays per texel, the quarter of the texels with the lowest); from the cell alone, edges of
    /// shadows get lost.
    #[must_use]
    pub fn expected(&self, patches: &Patches, network: &Network) -> Vec<f32> {
        let cells = Cells::new(patches, self.noise.len(), cells::NARROW);
        let in_cell = self.averaged(|values| cells.mean(&values));
        self.around(network).into_iter().zip(in_cell).map(|(around, cell)| 0.5 * (around + cell)).collect()
    }

    /// Noise and bias around each patch: smoother, and never below the noise there.
    #[must_use]
    pub fn around(&self, network: &Network) -> Vec<f32> {
        self.averaged(|values| network.flow(values, AROUND))
    }

    /// Noise and bias after averaging, never below the noise.
    fn averaged(&self, average: impl Fn(Vec<f32>) -> Vec<f32>) -> Vec<f32> {
        let both = parallel::map_light(self.noise.len(), |i| self.noise[i] + self.bias[i]);
        let (both, noise) = (average(both), average(self.noise.clone()));
        parallel::map_light(both.len(), |i| both[i].max(noise[i]))
    }
}

/// What flows as the light that it belongs to does. Empty fields are left alone.
#[derive(Debug, Default)]
pub struct Along<'a> {
    /// A part of the light [lx].
    pub part: Option<&'a mut Vec<Rgb>>,
    /// Light vectors [lx].
    pub vectors: Option<&'a mut Vec<LightVector>>,
}

/// Shares two halves of irradiance [lx] of the patches that `ways` are made for, in place; what is in `along` flows the
/// same way.
pub fn share(patches: &Patches, ways: Ways, halves: [&mut Vec<Rgb>; 2], along: Along<'_>) -> Errors {
    let [a, b] = halves;
    let raw = parallel::map_light(a.len(), |i| Pair(a[i], b[i]));
    let Ways { network, windows, cells } = ways;
    let before = windows.means(|i| noise(raw[i]).max(unseen(raw[i])));
    let seen = |slope: Pair| [slope.0.dot(slope.1), noise(slope)];
    let larger = |a: Pair, b: Pair| Pair(a.0.max(b.0), a.1.max(b.1));
    let (trend, trends) = Trend::new(&patches.position[..raw.len()], (&network, &windows), &raw, seen, larger);
    let part = along.part.map(|part| (trend.of(part, Rgb::max), part));
    let vectors = along.vectors.filter(|v| !v.is_empty()).map(|vectors| (trend.of(vectors, |a, _| a), vectors));
    drop(trend);
    let flow = chosen(network, (&windows, cells), (&raw, &trends), &before);
    let capped = |light: Rgb, most: Rgb| light.min(most).max(Rgb::ZERO);
    let both = |light: Pair, most: Pair| Pair(capped(light.0, most.0), capped(light.1, most.1));
    let shared = bounded(&flow, &raw, straightened(&flow, &raw, trends, larger), both);
    if let Some((trends, part)) = part {
        *part = bounded(&flow, part, straightened(&flow, part, trends, Rgb::max), capped);
    }
    if let Some((trends, vectors)) = vectors {
        *vectors = straightened(&flow, vectors, trends, |a, _| a);
    }
    drop(flow);
    let bias = parallel::map_light(raw.len(), |i| bias(shared[i], raw[i]));
    let noise = left(&windows, &before, &shared);
    parallel::update_light(a, |i, a| *a = shared[i].0);
    parallel::update_light(b, |i, b| *b = shared[i].1);
    Errors { noise, bias }
}

/// How light flows.
struct Flow {
    /// Links that let it flow as far as suits each patch in so many steps.
    network: Network,
    steps: usize,
}

/// Variance of the mean of two halves that is left after they flowed [lx²]: what is seen of it, times a power of what was
/// removed of the noise that was around there before.
fn left(windows: &Windows, before: &[f32], shared: &[Pair]) -> Vec<f32> {
    let after = windows.means(|i| noise(shared[i]));
    parallel::map_light(shared.len(), |i| {
        let (before, after) = (before[windows.block(i)], after[windows.block(i)]);
        // Leaps leave some of it below zero, where there is next to none.
        let removed = if after > 0.0 { (before / after).clamp(1.0, MOST_REMOVED) } else { 1.0 };
        noise(shared[i]) * libm::powf(removed, HIDDEN)
    })
}

/// How light flows that has these trends, with this noise around each block of patches.
fn chosen(
    network: Arc<Network>,
    (windows, cells): (&Windows, Arc<Cells>),
    (raw, trends): (&[Pair], &[Pair]),
    noise: &[f32],
) -> Flow {
    let rest = parallel::map_light(raw.len(), |i| raw[i] - trends[i]);
    let noise = parallel::map_light(raw.len(), |i| noise[windows.block(i)]);
    let stopped = stopped(&network, &rest, &noise);
    drop(network);
    let wanted = bandwidth(&stopped, &Judge { windows, cells: &cells }, (raw, trends), rest);
    let steps = widest(&wanted);
    Flow { network: stopped.narrowed(&wanted, steps), steps }
}

/// The links that light can flow over without crossing an edge of its own.
fn stopped(network: &Network, light: &[Pair], noise: &[f32]) -> Network {
    let (mut rough, mut before, mut jumps) = (light.to_vec(), 0, vec![]);
    for (steps, noises) in PILOTS {
        rough = network.flow(rough, steps - before);
        before = steps;
        network.add_over_links(&mut jumps, |i, j| {
            let Pair(a, b) = rough[i] - rough[j];
            a.dot(b).max(0.0) / noises
        });
    }
    drop(rough);
    network.stopped(&jumps, noise)
}

/// Steps of flow that suit each patch best.
fn bandwidth(network: &Network, judge: &Judge<'_>, (raw, trends): (&[Pair], &[Pair]), rest: Vec<Pair>) -> Vec<f32> {
    let mut best: Vec<(f32, f32)> = vec![(f32::INFINITY, 0.0); raw.len()];
    let mut flowed = rest;
    for steps in LEVELS {
        // Of level 0 all is raw, and the first step leads to level 1.
        let twice = network.flow(flowed.clone(), steps.max(1));
        let found = parallel::map_light(raw.len(), |i| {
            let level = if steps == 0 { raw[i] } else { trends[i] + flowed[i] * 2.0 - twice[i] };
            (bias(level, raw[i]), noise(level))
        });
        let errors = judge.errors(&found);
        parallel::update_light(&mut best, |i, best| {
            if errors[i] < best.0 + unseen(raw[i]) {
                *best = (errors[i].min(best.0), steps as f32);
            }
        });
        let chosen = parallel::sum(best.len(), |i| f64::from(best[i].1 == steps as f32));
        if chosen < WORTHWHILE * raw.len() as f64 {
            break;
        }
        flowed = twice;
    }
    network.flow(best.into_iter().map(|(_, steps)| steps).collect(), SETTLE_STEPS)
}

/// Trends of a field, and 2F − F² of the rest, with F the flow; the larger of that and half of what F makes of it, as
/// `larger` says. Beside jumps there would be rims of black otherwise. Where nothing flows, light stays to the last bit.
fn straightened<T: Field>(flow: &Flow, field: &[T], trends: Vec<T>, larger: impl Fn(T, T) -> T + Sync) -> Vec<T> {
    let rest = |i: usize| field[i] - trends[i];
    let once = flow.network.flow(parallel::map_light(field.len(), rest), flow.steps);
    let twice = flow.network.flow(once.clone(), flow.steps);
    parallel::map_light(once.len(), |i| {
        let straight = field[i] + ((once[i] - rest(i)) + (once[i] - twice[i]));
        larger(straight, (trends[i] + once[i]) * 0.5)
    })
}

/// Light that is `capped` by twice what flows of the field that it was made of: without trends, it could not be more. With
/// them, 3·10⁻⁵ of the sun glimmered in black shadows.
fn bounded<T: Field>(flow: &Flow, field: &[T], light: Vec<T>, capped: impl Fn(T, T) -> T + Sync) -> Vec<T> {
    let flowed = flow.network.flow(field.to_vec(), flow.steps);
    parallel::map_light(light.len(), |i| capped(light[i], flowed[i] * 2.0))
}

/// Squared bias of the mean of two halves, on average [lx²].
fn bias(shared: Pair, raw: Pair) -> f32 {
    (shared.0 - raw.0).dot(shared.1 - raw.1)
}

/// Squared error of two halves' mean that no page shows [lx²]. Light without noise has no more than that to choose by; what
/// flows along with it may have noise.
fn unseen(halves: Pair) -> f32 {
    (halves.0 + halves.1).length_squared() * (0.25 * UNSEEN * UNSEEN)
}

/// Variance of the mean of two halves, on average [lx²].
fn noise(halves: Pair) -> f32 {
    0.25 * (halves.0 - halves.1).length_squared()
}

/// Steps that all but the widest hundredth of the texels are content with.
fn widest(wanted: &[f32]) -> usize {
    let mut wanted = wanted.to_vec();
    if wanted.is_empty() {
        return 0;
    }
    let k = wanted.len() * 99 / 100;
    let (_, value, _) = wanted.select_nth_unstable_by(k, f32::total_cmp);
    value.ceil() as usize
}

impl Add for Pair {
    type Output = Self;
    fn add(self, o: Self) -> Self {
        Self(self.0 + o.0, self.1 + o.1)
    }
}

impl Sub for Pair {
    type Output = Self;
    fn sub(self, o: Self) -> Self {
        Self(self.0 - o.0, self.1 - o.1)
    }
}

impl Mul<f32> for Pair {
    type Output = Self;
    fn mul(self, k: f32) -> Self {
        Self(self.0 * k, self.1 * k)
    }
}
