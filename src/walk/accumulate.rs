//! Sums over many threads that do not depend on their order: fixed point in atomic integers.

use crate::base::{Rgb, parallel};
use glam::DVec3;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// Bits of the largest sum that can occur; two are kept free for rounding up.
const SUM_BITS: i32 = 61;

/// Received flux per patch.
pub(super) struct Flux {
    sums: Vec<[AtomicU64; 3]>,
    units_per_lumen: f64,
}

impl Flux {
    /// Room for `n` patches that receive at most `most` lumens together in any channel.
    pub(super) fn new(n: usize, most: f64) -> Self {
        let sums = (0..n).map(|_| [const { AtomicU64::new(0) }; 3]).collect();
        let (_, exponent) = libm::frexp(most.max(f64::MIN_POSITIVE));
        Self { sums, units_per_lumen: libm::ldexp(1.0, SUM_BITS - exponent) }
    }

    pub(super) fn add(&self, patch: usize, flux: Rgb) {
        let units = flux.as_dvec3() * self.units_per_lumen;
        for (sum, v) in self.sums[patch].iter().zip(units.to_array()) {
            sum.fetch_add((v + 0.5) as u64, Relaxed);
        }
    }

    /// The sums in lumens.
    pub(super) fn take(self) -> Vec<Rgb> {
        let scale = 1.0 / self.units_per_lumen;
        parallel::map(self.sums.len(), |i| {
            (DVec3::from_array([0, 1, 2].map(|c| self.sums[i][c].load(Relaxed) as f64)) * scale).as_vec3()
        })
    }
}

/// Harmonic means of line lengths per patch.
pub(super) struct Distances {
    /// Sum of 1/length in units of 2⁻²⁴ per metre, and number of lines.
    sums: Vec<[AtomicU64; 2]>,
}

/// Units per (1/m). Lengths below 2⁻²⁰ m count as that.
const INVERSE_UNITS: f64 = 16_777_216.0;
const SHORTEST: f64 = 1.0 / 1_048_576.0;

impl Distances {
    pub(super) fn new(n: usize) -> Self {
        Self { sums: (0..n).map(|_| [const { AtomicU64::new(0) }; 2]).collect() }
    }

    pub(super) fn add(&self, patch: usize, length: f32) {
        let inverse = INVERSE_UNITS / f64::from(length).max(SHORTEST);
        self.sums[patch][0].fetch_add((inverse + 0.5) as u64, Relaxed);
        self.sums[patch][1].fetch_add(1, Relaxed);
    }

    /// Metres; 0 where no line came.
    pub(super) fn harmonic_means(self) -> Vec<f32> {
        let mean = |s: [AtomicU64; 2]| {
            let [inverse, count] = s.map(AtomicU64::into_inner);
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
        let run = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let flux = Flux::new(1, 30_000.0);
            pool.install(|| (0..100_000u64).into_par_iter().for_each(|i| flux.add(0, term(i))));
            flux.take()[0]
        };
        let one = run(1);
        assert_eq!(one, run(8));
        assert!((one.z - 25_000.0).abs() < 1e-2);
        assert!((one.x - 12.090_146).abs() < 1e-4);
    }

    #[test]
    fn harmonic_mean_of_lengths() {
        let d = Distances::new(2);
        d.add(0, 1.0);
        d.add(0, 3.0);
        let means = d.harmonic_means();
        assert!((means[0] - 1.5).abs() < 1e-5);
        assert_eq!(means[1], 0.0);
    }
}
