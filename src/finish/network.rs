//! The texel graph as a network of conductances, through which received light flows.
//!
//! One step is `Φ_i += Σ_j g_ij (E_j − E_i)` with `g_ij = g_ji ≥ 0`: a reversible random walk on the texels. Flux is
//! conserved and constant irradiance stays constant, whatever the areas. A splat that gives shares to neighbours by
//! distance alone (the paper's eq. (4)) is not reversible: on a chain of five patches with areas 1 1 1 1 0.1 it turns
//! constant 1 into up to 3.
//!
//! Light flows between the four neighbours of the texel grid, and across borders of charts where the surface goes on. A
//! step moves it by one texel with probability [`STEP`] per link, a variance of 2·STEP texels² per axis.
//!
//! Many steps are taken together: s rounds go as far as about s²/4 steps. Source: van der Houwen, Sommeijer, "On the
//! internal stability of explicit, m-stage Runge-Kutta methods for large m-values", ZAMM 60, 1980 (first order), with
//! damping so strong that of the noise that single steps would remove [`RIPPLE`] is left. Without damping
//! (Runge-Kutta-Legendre), a quarter was: 1.2 % NRMSE instead of 1.0 % in cornell, 40,000 texels, `production`. Step by
//! step, sharing took 2.4 times as long (cornell, 94,000 texels, a sixteenth of the rays of `production`).
//!
//! Tried: both halves as vectors of four lanes: 3 % off sharing (99,000 to 434,000 texels), within the noise, for a third more
//! memory.
//!
//! Symbols: A exposed area [m²]   E irradiance [lx]   Φ = A E   c factor of a link in [0, 1]
//!
//! Light flows less over links where it jumps itself ([`Network::stopped`]): Perona, Malik, "Scale-space and edge
//! detection using anisotropic diffusion", IEEE PAMI 12(7), 1990, with the noise as the scale of what is a jump.
//!
//! Invariant: the sum of `g_ij` over j is at most 0.8 A, so a step never overshoots; polynomials of steps whose
//! coefficients add up to one conserve flux and keep constants as single ones do.

use crate::base::{Groups, Sets, parallel};
use crate::patches::{PatchGraph, Patches};
use core::ops::{Add, Mul, Sub};

/// Share of a patch that flows over one link per step. Four links take 0.8; above 0.25 the explicit step would ring.
pub(super) const STEP: f32 = 0.2;

/// Patches per chunk of work on links.
pub(super) const CHUNK: usize = 1 << 12;
/// Steps up to which there is nothing to gain by taking them together.
const FEW: usize = 3;
/// Eigenvalues of a step's change reach twice its largest row sum.
const STIFF: f64 = 8.0 * STEP as f64;
/// Bound of a leap on what it removes, relative.
const RIPPLE: f64 = 0.02;

/// The angle whose multiple by the number of stages has the hyperbolic cosine 1/[`RIPPLE`].
fn angle(stages: u32) -> f64 {
    libm::acosh(1.0 / RIPPLE) / f64::from(stages)
}

/// Largest eigenvalue times steps for which that many stages are stable.
fn reach(stages: u32) -> f64 {
    let (n, theta) = (f64::from(stages), angle(stages));
    (libm::cosh(theta) + 1.0) * n * libm::tanh(n * theta) / libm::sinh(theta)
}

/// Links of some rows, and how many there are up to the end of each.
type Rows = (Vec<(u32, f32)>, Vec<u32>);

/// Links with their rates g/A, compressed rows.
pub struct Network {
    first: Vec<u32>,
    links: Vec<(u32, f32)>,
}

/// What can flow: one or several irradiances at once.
pub(super) trait Field:
    Copy + Send + Sync + Add<Output = Self> + Sub<Output = Self> + Mul<f32, Output = Self>
{
}
impl<T: Copy + Send + Sync + Add<Output = T> + Sub<Output = T> + Mul<f32, Output = T>> Field for T {}

impl Network {
    /// Full conductances between the first `n` patches.
    #[must_use]
    pub fn new(patches: &Patches, graph: &PatchGraph, n: usize) -> Self {
        // What is left of four links goes to those across the border of the chart.
        let spare = parallel::map(n, |i| {
            let across = graph.across(i).filter(|&j| (j as usize) < n).count();
            (4.0 - graph.sides(patches, i).count() as f32).min(across as f32) / across.max(1) as f32
        });
        let add_row = |i: usize, links: &mut Vec<(u32, f32)>| {
            let area = patches.exposed_area(i);
            let rate = |j: u32, share: f32| {
                let least = area.min(patches.exposed_area(j as usize));
                (j, share * STEP * least / area.max(f32::MIN_POSITIVE))
            };
            let is_within = |j: &u32| (*j as usize) < n;
            links.extend(graph.sides(patches, i).filter(is_within).map(|j| rate(j, 1.0)));
            let across = graph.across(i).filter(is_within);
            links.extend(across.map(|j| rate(j, spare[i].min(spare[j as usize]))));
        };
        Self::from_chunks(parallel::map_chunks(n, CHUNK, |range| {
            let (mut links, mut ends) = (vec![], Vec::with_capacity(range.len()));
            for i in range {
                add_row(i, &mut links);
                ends.push(links.len() as u32);
            }
            (links, ends)
        }))
    }

    /// From rows, chunk by chunk.
    pub(super) fn from_chunks(chunks: Vec<Rows>) -> Self {
        let (mut first, mut starts) = (vec![0u32], vec![0u32]);
        for (own, ends) in &chunks {
            let before = starts[starts.len() - 1];
            first.extend(ends.iter().map(|end| before + end));
            starts.push(before + own.len() as u32);
        }
        let mut links = vec![(0, 0.0); starts[chunks.len()] as usize];
        parallel::update_rows(&mut links, &starts, |chunk, links| links.copy_from_slice(&chunks[chunk].0));
        Self { first, links }
    }

    /// Adds what `f` says of the two ends of a link, for every entry of every row; an empty sum starts at zero.
    pub(super) fn add_over_links(&self, sums: &mut Vec<f32>, f: impl Fn(usize, usize) -> f32 + Sync) {
        sums.resize(self.links.len(), 0.0);
        parallel::update_rows(sums, &self.first, |i, sums| {
            sums.iter_mut().zip(self.row(i)).for_each(|(sum, &(j, _))| *sum += f(i, j as usize));
        });
    }

    /// The same links, but that a jump (squared) as large as the noise on its calmer side halves what flows. Noise below zero,
    /// as leaps leave it, is none.
    pub(super) fn stopped(&self, jumps: &[f32], noise: &[f32]) -> Self {
        self.scaled(|i, j, link| {
            let (calm, jump) = (noise[i].min(noise[j]).max(0.0), jumps[link]);
            if jump > 0.0 { calm / (calm + jump) } else { 1.0 }
        })
    }

    /// Number of patches.
    pub(super) fn len(&self) -> usize {
        self.first.len() - 1
    }

    /// The network of blocks of patches that have these areas: what flows between blocks goes as far as it does here, in
    /// a quarter of the steps.
    pub(super) fn merged(&self, blocks: &Groups, areas: &[f32]) -> Self {
        let n = blocks.count();
        let area = |b: usize| blocks.members(b).iter().map(|&i| areas[i as usize]).fold(0.0, |a, b| a + b);
        let conductances = |b: usize, row: &mut Vec<(u32, f32)>| {
            for &i in blocks.members(b) {
                for &(j, rate) in self.row(i as usize) {
                    let (other, g) = (blocks.of(j as usize) as u32, rate * areas[i as usize]);
                    match row.iter_mut().find(|link| link.0 == other) {
                        Some(link) => link.1 += g,
                        None if other as usize != b => row.push((other, g)),
                        None => {}
                    }
                }
            }
        };
        let all = Self::from_chunks(parallel::map_chunks(n, CHUNK, |range| {
            let (mut links, mut row, mut ends) = (vec![], vec![], Vec::with_capacity(range.len()));
            for b in range {
                conductances(b, &mut row);
                links.append(&mut row);
                ends.push(links.len() as u32);
            }
            (links, ends)
        }));
        let wider = parallel::map(n, |b| {
            let sum = all.row(b).iter().map(|link| link.1).fold(0.0, |a, b| a + b);
            (4.0 * STEP * area(b) / sum.max(f32::MIN_POSITIVE)).min(2.0)
        });
        all.scaled(|b, other, _| wider[b].min(wider[other]) / area(b).max(f32::MIN_POSITIVE))
    }

    /// How many hang together with each, itself among them, each counted as often as `count` says.
    pub(super) fn sizes(&self, count: impl Fn(usize) -> u32) -> Vec<u32> {
        let mut sets = Sets::new(self.len());
        for i in 0..self.len() {
            let linked = self.row(i).iter().filter(|(_, rate)| *rate > 0.0);
            linked.for_each(|&(j, _)| sets.join(i, j as usize));
        }
        let set = sets.numbers();
        let mut sizes = vec![0u32; self.len()];
        (0..self.len()).for_each(|i| sizes[set[i] as usize] = sizes[set[i] as usize].saturating_add(count(i)));
        set.into_iter().map(|set| sizes[set as usize]).collect()
    }

    /// The same links, each narrowed so that light flows about as far in `steps` steps as it did in `wanted` of them at
    /// full width; of two ends the smaller wish counts, so g stays symmetric.
    pub(super) fn narrowed(&self, wanted: &[f32], steps: usize) -> Self {
        self.scaled(|i, j, _| (wanted[i].min(wanted[j]) / steps.max(1) as f32).min(1.0))
    }

    /// The same links, their rates times what `f` makes of the two ends and the number of the entry.
    fn scaled(&self, f: impl Fn(usize, usize, usize) -> f32 + Sync) -> Self {
        let mut links = vec![(0, 0.0); self.links.len()];
        parallel::update_rows(&mut links, &self.first, |i, links| {
            for (k, (link, &(j, rate))) in (self.first[i] as usize..).zip(links.iter_mut().zip(self.row(i))) {
                *link = (j, rate * f(i, j as usize, k));
            }
        });
        Self { first: self.first.clone(), links }
    }

    /// `field` after so many steps.
    pub(super) fn flow<T: Field>(&self, field: Vec<T>, steps: usize) -> Vec<T> {
        if steps > FEW {
            return self.leap(field, steps as f64);
        }
        (0..steps).fold(field, |field, _| parallel::map_light(field.len(), |i| field[i] + self.change(&field, i, 1.0)))
    }

    /// Many steps at once, by a Chebyshev polynomial of a step.
    fn leap<T: Field>(&self, field: Vec<T>, steps: f64) -> Vec<T> {
        let mut stages = 2u32;
        while reach(stages) < STIFF * steps {
            stages += 1;
        }
        let theta = angle(stages);
        let (n, w0) = (f64::from(stages), libm::cosh(theta));
        let w1 = libm::sinh(theta) / (n * libm::tanh(n * theta));
        let chebyshev = |j: u32| libm::cosh(f64::from(j) * theta);
        let mut last =
            parallel::map_light(field.len(), |i| field[i] + self.change(&field, i, (steps * w1 / w0) as f32));
        let mut before = field;
        for j in 2..=stages {
            let weight = 2.0 * chebyshev(j - 1) / chebyshev(j);
            let (gain, scale) = ((weight * w0) as f32, (weight * w1 * steps) as f32);
            parallel::update_light(&mut before, |i, value| {
                *value = *value + (last[i] - *value) * gain + self.change(&last, i, scale);
            });
            core::mem::swap(&mut before, &mut last);
        }
        last
    }

    /// What `times` steps at the present rates would add to a patch.
    fn change<T: Field>(&self, field: &[T], i: usize, times: f32) -> T {
        let own = field[i];
        self.row(i).iter().fold(own * 0.0, |sum, &(j, rate)| sum + (field[j as usize] - own) * (rate * times))
    }

    /// Where what flows from a patch goes, with the rates.
    pub(super) fn row(&self, i: usize) -> &[(u32, f32)] {
        &self.links[self.first[i] as usize..self.first[i + 1] as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A chain of equal texels.
    fn chain(n: u32) -> Network {
        let row = |i: u32| [i.wrapping_sub(1), i + 1].into_iter().filter(|&j| j < n).map(|j| (j, STEP));
        let one = |i: u32| (row(i).collect::<Vec<_>>(), vec![row(i).count() as u32]);
        Network::from_chunks((0..n).map(one).collect())
    }

    #[test]
    fn leaps_go_as_far_as_steps_and_conserve_what_steps_do() {
        let (n, steps) = (201, 50);
        let network = chain(n);
        assert!(network.flow(vec![0.7f32; n as usize], steps).iter().all(|v| (v - 0.7).abs() < 1e-6));
        let mut peak = vec![0.0f32; n as usize];
        peak[100] = 1.0;
        let leapt = network.flow(peak.clone(), steps);
        let stepped = (0..steps).fold(peak, |field, _| network.flow(field, 1));
        let moment = |field: &[f32], power: i32| {
            (0..n as i32).map(|i| f64::from(field[i as usize]) * f64::from(i - 100).powi(power)).fold(0.0, |a, b| a + b)
        };
        assert!((moment(&leapt, 0) - 1.0).abs() < 1e-5);
        let spread = 2.0 * f64::from(STEP) * steps as f64;
        assert!((moment(&stepped, 2) / spread - 1.0).abs() < 1e-3);
        assert!((moment(&leapt, 2) / spread - 1.0).abs() < 1e-3, "{} of {spread}", moment(&leapt, 2));
        assert!(leapt.iter().zip(&stepped).all(|(a, b)| (a - b).abs() < 0.2 * stepped[100]));
    }

    #[test]
    fn light_does_not_flow_over_a_jump_and_is_conserved_beside_it() {
        let network = chain(40);
        let light: Vec<f32> = (0..40).map(|i| if i < 20 { 1.0 } else { 3.0 } + 0.1 * (i % 3) as f32).collect();
        let noise = vec![0.01; 40];
        let mut jumps = vec![];
        network.add_over_links(&mut jumps, |i, j| (light[i] - light[j]).powi(2));
        let stopped = network.stopped(&jumps, &noise).flow(light.clone(), 20);
        let sum = |field: &[f32], range: core::ops::Range<usize>| field[range].iter().fold(0.0, |a, b| a + b);
        assert!((sum(&stopped, 0..40) - sum(&light, 0..40)).abs() < 1e-4);
        assert!((sum(&stopped, 0..20) - sum(&light, 0..20)).abs() < 0.2);
        assert!((sum(&network.flow(light.clone(), 20), 0..20) - sum(&light, 0..20)).abs() > 2.0);
        // Noise that leaps have left below zero stops what jumps, and makes nothing grow.
        let stopped = network.stopped(&jumps, &[-1e-3; 40]).flow(light.clone(), 20);
        assert!((sum(&stopped, 0..20) - sum(&light, 0..20)).abs() < 1e-4);
        assert_eq!(network.stopped(&jumps, &noise).sizes(|_| 1), vec![40; 40]);
    }

    #[test]
    fn leaps_leave_little_of_noise() {
        let network = chain(200);
        let noise: Vec<f32> = (0..200).map(|i| if i % 2 == 0 { 1.0 } else { -1.0 }).collect();
        for steps in [12, 30, 70, 120] {
            let left = network.flow(noise.clone(), steps);
            let inner = &left[60..140];
            assert!(inner.iter().all(|v| v.abs() < 1.5 * RIPPLE as f32), "{steps} steps: {:?}", &inner[..4]);
        }
    }
}
