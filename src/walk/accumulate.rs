//! Sums over many threads that do not depend on their order: fixed point in integers.
//!
//! In: flux at patches, from any thread. Out: their sums per patch.
//!
//! Every thread adds to a copy of its own as long as the copies fit [`MOST_BYTES`]: two cores that add to one cache
//! line take turns at it, and the paper's splat adds to nine patches per line. Above that, where two threads rarely
//! meet, copies are shared and additions are atomic. Integer sums are the same either way.
//!
//! Limits: 24 bytes per patch and copy.

use crate::base::{Rgb, parallel};
use glam::DVec3;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// Bits of the largest sum that can occur; two are kept free for rounding up.
const SUM_BITS: i32 = 61;
/// All copies together.
const MOST_BYTES: usize = 256 << 20;

/// Red, green and blue flux.
type Sums = [AtomicU64; 3];

/// Received flux.
pub(super) struct Arrivals {
    copies: Vec<Vec<Sums>>,
    patches: usize,
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
        let copy = |_| (0..n).map(|_| [const { AtomicU64::new(0) }; 3]).collect();
        let (_, exponent) = libm::frexp(most.max(f64::MIN_POSITIVE));
        Self {
            copies: parallel::map(copies, copy),
            patches: n,
            owned,
            units_per_lumen: libm::ldexp(1.0, SUM_BITS - exponent),
        }
    }

    /// For the calling thread, as long as it is in this call of the pool.
    pub(super) fn adder(&self) -> Adder<'_> {
        let thread = rayon::current_thread_index();
        let alone = self.owned && thread.is_some();
        let copy = if self.owned { thread.unwrap_or(self.copies.len() - 1) } else { thread.unwrap_or(0) };
        Adder { sums: &self.copies[copy % self.copies.len()], alone, units_per_lumen: self.units_per_lumen }
    }

    /// The sums [lm].
    pub(super) fn take(self) -> Vec<Rgb> {
        let scale = 1.0 / self.units_per_lumen;
        let total = |i: usize, c: usize| self.copies.iter().map(|sums| sums[i][c].load(Relaxed)).sum::<u64>();
        parallel::map(self.patches, |i| (DVec3::from_array([0, 1, 2].map(|c| total(i, c) as f64)) * scale).as_vec3())
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

    fn add(&self, sum: &AtomicU64, value: u64) {
        if self.alone {
            sum.store(sum.load(Relaxed) + value, Relaxed);
        } else {
            sum.fetch_add(value, Relaxed);
        }
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
            (flux.take()[0], owned)
        };
        let (one, owned) = run(1, 1);
        assert!(owned);
        assert_eq!(one, run(8, 1).0);
        let (shared, owned) = run(8, 1 << 21);
        assert!(!owned, "copies for all threads would not fit");
        assert_eq!(one, shared);
        assert!((one.z - 25_002.5).abs() < 1e-2);
        assert!((one.x - 12.090_246).abs() < 1e-4);
    }
}
