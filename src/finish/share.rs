//! Sharing: noisy light flows between linked texels, as far as two half-budgets show that it helps.
//!
//! In: irradiance as two halves that share no random number, and links. Out: both halves, smoother by the same linear
//! map, and the squared error that is left in their mean; flux is conserved and constant irradiance stays constant.
//!
//! The fuzzy random walk's splat, made to converge: a bandwidth per texel that vanishes with the noise, and flow
//! through reversible conductances (`network`). Design: Castro, Feixas, Sbert, "Fuzzy Random Walk", §5, leave both
//! open.
//!
//! How far light flows is chosen per texel among [`LEVELS`]. With A and B the halves (one truth, independent noise) and
//! F a level's flow, `(F A − B)²` is on average bias² + var(F A) + var(B), and `(F A − F B)²` is 2 var(F A). So
//!
//! `q = ½((F A − B)² + (F B − A)²) − ¼(F A − F B)² = bias² + ½ var(F A) + var(B)`
//!
//! is the squared error of the mean of the halves up to a constant that all levels have in common, without a model of
//! the light. Where light jumps (a contact shadow), the bias shows and light does not flow; as the noise falls, every
//! bias shows, so the result converges to the truth. q of one texel is noise itself: it flows [`JUDGE_STEPS`] steps
//! first, and is averaged over a cell of space (`cells`). What is stated is `¼(F A − F B)²`, the noise, and `q − ½(A −
//! B)²` less that noise, the squared bias.
//!
//! Cross-validation of two buffers: Rousselle, Manzi, Zwicker, "Robust Denoising using Feature and Color Information",
//! Computer Graphics Forum 32(7), 2013, §4 (there for a pixel filter that conserves nothing).
//!
//! The choice looks at the noise that it judges, which makes what it sees of both low; [`WIDER`] makes up for it.
//!
//! Tried: the flow corrected by what it does to itself, 2F − F², which bends less: squared errors 1 to 4 % lower, for
//! twice the time.

use super::cells::Cells;
use super::network::Network;
use crate::base::{LightVector, Rgb, parallel};
use crate::patches::{PatchGraph, Patches};
use core::ops::{Add, Mul, Sub};

/// Steps of flow that are compared; n steps spread light by √(0.4 n) texels: 0.6, 1.1, 1.8, 2.8, 4.5, 6.9.
const LEVELS: [usize; 7] = [0, 1, 3, 8, 20, 50, 120];
/// Steps that q flows before levels are compared: a window of 3.5 texels. On courtyard and office (10,000 texels), 4
/// steps had up to 4 % more error with 16 rays per texel; on courtyard 300 had 7 % more with 64.
const JUDGE_STEPS: usize = 30;
/// Weight of the cell's mean of q against the flow's. Without cells, charts of few texels choose by their noise: with
/// 16 rays per texel the error is within 4 % of what it is with them, but the stated one was 0.60 of it in courtyard
/// and 0.68 in office; at this weight 0.87 and 0.88.
const CELL_WEIGHT: f32 = 0.9;
/// Times the noise and the bias that are seen. On ten to forty thousand texels of office, courtyard, two rooms and
/// cornell, a quarter of the rays of `production` to twice of them, stated errors were 0.72 to 0.96 of the measured ones
/// without it.
const WIDER: f32 = 1.15 * 1.15;
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

    /// Over all patches together; there the bias is known well enough to be added where it is not negative.
    #[must_use]
    pub fn sum(&self) -> f64 {
        let sum = |values: &[f32]| parallel::sum(values.len(), |i| f64::from(values[i]));
        sum(&self.noise) + sum(&self.bias).max(0.0)
    }

    /// Squared error to be expected of each patch: half of it from around the patch, half from its cell of space.
    ///
    /// Either alone knows too little. From around it alone, charts of few texels seemed to have 0.35 of the error that
    /// they had (office, 128 rays per texel, the quarter of the texels with the lowest); from the cell alone, edges of
    /// shadows get lost.
    #[must_use]
    pub fn expected(&self, patches: &Patches, graph: &PatchGraph) -> Vec<f32> {
        let cells = Cells::new(patches, self.noise.len());
        let in_cell = self.averaged(|values| cells.mean(&values));
        self.around(patches, graph).into_iter().zip(in_cell).map(|(around, cell)| 0.5 * (around + cell)).collect()
    }

    /// Noise and bias around each patch: smoother, and never below the noise there.
    #[must_use]
    pub fn around(&self, patches: &Patches, graph: &PatchGraph) -> Vec<f32> {
        let network = Network::new(patches, graph, self.noise.len());
        self.averaged(|values| network.flow(values, JUDGE_STEPS))
    }

    /// Noise and bias after averaging, never below the noise.
    fn averaged(&self, average: impl Fn(Vec<f32>) -> Vec<f32>) -> Vec<f32> {
        let both = self.noise.iter().zip(&self.bias).map(|(n, b)| n + b).collect();
        let (both, noise) = (average(both), average(self.noise.clone()));
        both.into_iter().zip(noise).map(|(e, n)| e.max(n)).collect()
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

/// Shares two halves of irradiance [lx] of the first patches in place; what is in `along` flows the same way.
pub fn share(patches: &Patches, graph: &PatchGraph, halves: [&mut Vec<Rgb>; 2], along: Along<'_>) -> Errors {
    let [a, b] = halves;
    let raw = parallel::map_light(a.len(), |i| Pair(a[i], b[i]));
    let network = Network::new(patches, graph, raw.len());
    let wanted = bandwidth(&network, &Cells::new(patches, raw.len()), &raw);
    let steps = widest(&wanted);
    let network = network.narrowed(&wanted, steps);
    let shared = network.flow(raw.clone(), steps);
    if let Some(part) = along.part {
        *part = network.flow(core::mem::take(part), steps);
    }
    if let Some(vectors) = along.vectors.filter(|v| !v.is_empty()) {
        *vectors = network.flow(core::mem::take(vectors), steps);
    }
    let noise = |p: Pair| 0.25 * (p.0 - p.1).length_squared();
    let bias = |i: usize| judged(shared[i], raw[i]) - 2.0 * noise(raw[i]) - noise(shared[i]);
    let bias = parallel::map_light(raw.len(), |i| WIDER * bias(i));
    let noise = parallel::map_light(raw.len(), |i| WIDER * noise(shared[i]));
    for (i, pair) in shared.into_iter().enumerate() {
        (a[i], b[i]) = (pair.0, pair.1);
    }
    Errors { noise, bias }
}

/// Steps of flow that suit each patch best.
fn bandwidth(network: &Network, cells: &Cells, raw: &[Pair]) -> Vec<f32> {
    let mut best: Vec<(f32, f32)> = vec![(f32::INFINITY, 0.0); raw.len()];
    let (mut field, mut before) = (raw.to_vec(), 0);
    for steps in LEVELS {
        field = network.flow(field, steps - before);
        before = steps;
        let q = parallel::map_light(raw.len(), |i| judged(field[i], raw[i]));
        let (near, around) = (network.flow(q.clone(), JUDGE_STEPS), cells.mean(&q));
        let q = near.into_iter().zip(around).map(|(n, a)| n + (a - n) * CELL_WEIGHT);
        let mut chosen = 0;
        for (best, q) in best.iter_mut().zip(q) {
            if q < best.0 {
                *best = (q, steps as f32);
                chosen += 1;
            }
        }
        if (chosen as f64) < WORTHWHILE * raw.len() as f64 {
            break;
        }
    }
    network.flow(best.into_iter().map(|(_, steps)| steps).collect(), SETTLE_STEPS)
}

/// q of the header.
fn judged(shared: Pair, raw: Pair) -> f32 {
    let square = |v: Rgb| v.length_squared();
    0.5 * (square(shared.0 - raw.1) + square(shared.1 - raw.0)) - 0.25 * square(shared.0 - shared.1)
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
