//! Sums over many threads that do not depend on their order: fixed point in integers.
//!
//! In: flux and line lengths at patches, from any thread. Out: their sums per patch.
//!
//! Every thread adds to a copy of its own as long as the copies fit [`MOST_BYTES`]: two cores that add to one cache line
//! take turns at it, which made the paper's splat (nine patches per line) cost a third of the walk. Above that, where two
//! threads rarely meet, copies are shared and additions are atomic. Integer sums are the same either way.
//!
//! Limits: 40 bytes per patch and copy.

use crate::base::{Rgb, parallel};
use glam::DVec3;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// Bits of the largest sum that can occur; two are kept free for rounding up.
const SUM_BITS: i32 = 61;
/// All copies together.
const MOST_BYTES: usize = 256 << 20;
/// Units per (1/m). Lengths below 2⁻²⁰ m count as that.
const INVERSE_UNITS: f64 = 16_777_216.0;
const SHORTEST: f64 = 1.0 / 1_048_576.0;

/// Red, green and blue flux; 1/length of the lines; number of lines.
type Sums = [AtomicU64; 5];

/// Received flux, and lengths of the lines that brought it.
pub(super) struct Arrivals {
    copies: Vec<Vec<Sums>>,
    /// Every thread of the pool has a copy, and the last one is for threads outside it.
    owned: bool,
    units_per_lumen: f64,
}

/// One thread's way in.
pub(super) struct Adder<'a> {
    sums: &'a [Sums],
    alone: bool,
    units_per_lumen: f64,
}

impl Arrivals {
    /// Room for `n` patches that receive at most `most` lumens together in any channel.
    pub(super) fn new(n: usize, most: f64) -> Self {
        let threads = rayon::current_num_threads();
        let affordable = (MOST_BYTES / (n.max(1) * size_of::<Sums>())).max(1);
        let owned = affordable > threads;
        let copies = if owned { threads + 1 } else { affordable };
        let copy = |_| (0..n).map(|_| [const { AtomicU64::new(0) }; 5]).collect();
        let (_, exponent) = libm::frexp(most.max(f64::MIN_POSITIVE));
        Self { copies: parallel::map(copies, copy), owned, units_per_lumen: libm::ldexp(1.0, SUM_BITS - exponent) }
    }

    /// For the calling thread, as long as it is in this call of the pool.
    pub(super) fn adder(&self) -> Adder<'_> {
        let thread = rayon::current_thread_index();
        let alone = self.owned && thread.is_some();
        let copy = if self.owned { thread.unwrap_or(self.copies.len() - 1) } else { thread.unwrap_or(0) };
        Adder { sums: &self.copies[copy % self.copies.len()], alone, units_per_lumen: self.units_per_lumen }
    }

    /// The sums: flux in lumens, and lengths, which are added to `distances`.
    pub(super) fn take(self, distances: &mut Distances) -> Vec<Rgb> {
        let scale = 1.0 / self.units_per_lumen;
        let total = |i: usize, c: usize| self.copies.iter().map(|sums| sums[i][c].load(Relaxed)).sum::<u64>();
        let all = parallel::map(distances.sums.len(), |i| {
            let flux = DVec3::from_array([0, 1, 2].map(|c| total(i, c) as f64)) * scale;
            (flux.as_vec3(), [total(i, 3), total(i, 4)])
        });
        for (sum, (_, [inverse, count])) in distances.sums.iter_mut().zip(&all) {
            *sum = [sum[0] + inverse, sum[1] + count];
        }
        all.into_iter().map(|(flux, _)| flux).collect()
    }
}

impl Adder<'_> {
    /// Flux in the unit that the sums have.
    pub(super) fn units(&self, flux: Rgb) -> [u64; 3] {
        (flux.as_dvec3() * self.units_per_lumen).to_array().map(|v| (v + 0.5) as u64)
    }

    pub(super) fn flux(&self, patch: usize, units: [u64; 3]) {
        for (sum, v) in self.sums[patch].iter().zip(units) {
            self.add(sum, v);
        }
    }

    pub(super) fn length(&self, patch: usize, length: f32) {
        let inverse = INVERSE_UNITS / f64::from(length).max(SHORTEST);
        self.add(&self.sums[patch][3], (inverse + 0.5) as u64);
        self.add(&self.sums[patch][4], 1);
    }

    fn add(&self, sum: &AtomicU64, value: u64) {
        if self.alone {
            sum.store(sum.load(Relaxed) + value, Relaxed);
        } else {
            sum.fetch_add(value, Relaxed);
        }
    }
}

/// Harmonic means of line lengths per patch.
pub(super) struct Distances {
    /// Sum of 1/length in units of 2⁻²⁴ per metre, and number of lines.
    sums: Vec<[u64; 2]>,
}

impl Distances {
    pub(super) fn new(n: usize) -> Self {
        Self { sums: vec![[0; 2]; n] }
    }

    /// Metres; 0 where no line came.
    pub(super) fn harmonic_means(self) -> Vec<f32> {
        let mean = |[inverse, count]: [u64; 2]| {
            if inverse == 0 { 0.0 } else { (count as f64 * INVERSE_UNITS / inverse as f64) as f32 }
        };
        self.sums.into_iter().map(mean).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rayon::prelude::*;

    #[test]
    fn sums_are_equal_in_any_order_and_close_to_exact() {
        let term = |i: u64| Rgb::new(1.0 / (i + 1) as f32, i as f32 * 1e-6, 0.25);
        let add = |adder: &Adder<'_>, i| adder.flux(0, adder.units(term(i)));
        let run = |threads, patches| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let flux = pool.install(|| Arrivals::new(patches, 30_000.0));
            pool.install(|| (0..100_000u64).into_par_iter().for_each(|i| add(&flux.adder(), i)));
            // From outside the pool as well.
            (100_000..100_010u64).for_each(|i| add(&flux.adder(), i));
            let owned = flux.owned;
            (flux.take(&mut Distances::new(patches))[0], owned)
        };
        let (one, owned) = run(1, 1);
        assert!(owned);
        assert_eq!(one, run(8, 1).0);
        let (shared, owned) = run(8, 1 << 20);
        assert!(!owned, "copies for all threads would not fit");
        assert_eq!(one, shared);
        assert!((one.z - 25_002.5).abs() < 1e-2);
        assert!((one.x - 12.090_246).abs() < 1e-4);
    }

    #[test]
    fn harmonic_mean_of_lengths() {
        let (arrivals, mut d) = (Arrivals::new(2, 1.0), Distances::new(2));
        arrivals.adder().length(0, 1.0);
        arrivals.adder().length(0, 3.0);
        arrivals.take(&mut d);
        let means = d.harmonic_means();
        assert!((means[0] - 1.5).abs() < 1e-5);
        assert_eq!(means[1], 0.0);
    }
}
