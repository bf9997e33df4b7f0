//! Sums over many threads that do not depend on their order: fixed point in integers.
//!
//! In: flux at patches, from any thread. Out: their sums per patch, and one point of each patch where flux arrived.
//!
//! The point is that of one of the patch's arrivals, each with a chance in proportion to its flux: the one whose
//! exponential random number, over its flux, is the least, in whatever order they come. Source: Efraimidis and Spirakis,
//! "Weighted random sampling with a reservoir", Information Processing Letters 97(5), 2006.
//!
//! Every thread adds to a copy of its own as long as the copies fit [`MOST_BYTES`]: two cores that add to one cache
//! line take turns at it, and the paper's splat adds to nine patches per line. Above that, where two threads rarely
//! meet, copies are shared and additions are atomic. Integer sums are the same either way.
//!
//! Limits: 32 bytes per patch and copy; points have 16 bits per axis.

use crate::base::random::{mix, unit_f32};
use crate::base::{Rgb, parallel};
use glam::{DVec3, Vec2};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// Bits of the largest sum that can occur; two are kept free for rounding up.
const SUM_BITS: i32 = 61;
/// Of a patch where nothing has arrived.
const NO_MARK: u64 = u64::MAX;
/// All copies together.
const MOST_BYTES: usize = 256 << 20;

/// What has arrived on one patch.
struct Sums {
    /// Red, green and blue.
    flux: [AtomicU64; 3],
    /// The arrival that is kept: its number to be the least by, and below it the point.
    mark: AtomicU64,
}

/// Where on its texel some of a patch's flux arrived.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Mark(u32);

impl Mark {
    /// The point [texels from the texel's corner].
    pub(super) fn within(self) -> Vec2 {
        let part = |bits: u32| (bits as f32 + 0.5) / 65_536.0;
        Vec2::new(part(self.0 >> 16), part(self.0 & 0xffff))
    }

    fn new(within: Vec2) -> Self {
        let bits = |v: f32| ((v * 65_536.0) as u32).min(0xffff);
        Self(bits(within.x) << 16 | bits(within.y))
    }
}

/// Received flux; made once for all bounces: fresh memory for each took 0.36 of the 4.2 s of a walk (1.1 million patches).
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
    /// Room for `n` patches.
    pub(super) fn new(n: usize) -> Self {
        let threads = rayon::current_num_threads();
        let affordable = (MOST_BYTES / (n.max(1) * size_of::<Sums>())).max(1);
        let owned = affordable > threads;
        let copies = if owned { threads + 1 } else { affordable };
        let none = |_| Sums { flux: [const { AtomicU64::new(0) }; 3], mark: AtomicU64::new(NO_MARK) };
        let copies = (0..copies).map(|_| parallel::map_light(n, none)).collect();
        Self { copies, patches: n, owned, units_per_lumen: 0.0 }
    }

    /// From now on the patches receive at most `most` lumens together in any channel.
    pub(super) fn expect(&mut self, most: f64) {
        let (_, exponent) = libm::frexp(most.max(f64::MIN_POSITIVE));
        self.units_per_lumen = libm::ldexp(1.0, SUM_BITS - exponent);
    }

    /// For the calling thread, as long as it is in this call of the pool.
    pub(super) fn adder(&self) -> Adder<'_> {
        let thread = rayon::current_thread_index();
        let alone = self.owned && thread.is_some();
        let copy = if self.owned { thread.unwrap_or(self.copies.len() - 1) } else { thread.unwrap_or(0) };
        Adder { sums: &self.copies[copy % self.copies.len()], alone, units_per_lumen: self.units_per_lumen }
    }

    /// The sums [lm], and a point of each patch where flux arrived (some point where none did); none is left here.
    pub(super) fn take(&mut self) -> (Vec<Rgb>, Vec<Mark>) {
        let scale = 1.0 / self.units_per_lumen;
        let take = |sum: &AtomicU64, none: u64| {
            let value = sum.load(Relaxed);
            sum.store(none, Relaxed);
            value
        };
        let total = |i: usize, c: usize| self.copies.iter().map(|sums| take(&sums[i].flux[c], 0)).sum::<u64>();
        let flux = parallel::map_light(self.patches, |i| {
            (DVec3::from_array([0, 1, 2].map(|c| total(i, c) as f64)) * scale).as_vec3()
        });
        let least = |i: usize| self.copies.iter().map(|sums| take(&sums[i].mark, NO_MARK)).min().unwrap_or(0);
        (flux, parallel::map_light(self.patches, |i| Mark(least(i) as u32)))
    }
}

impl Adder<'_> {
    /// Flux in the unit that the sums have.
    pub(super) fn units(&self, flux: Rgb) -> [u64; 3] {
        (flux.as_dvec3() * self.units_per_lumen).to_array().map(|v| (v + 0.5) as u64)
    }

    pub(super) fn flux(&self, patch: usize, units: [u64; 3]) {
        for (sum, v) in self.sums[patch].flux.iter().zip(units) {
            if self.alone {
                sum.store(sum.load(Relaxed) + v, Relaxed);
            } else {
                sum.fetch_add(v, Relaxed);
            }
        }
    }

    /// Flux arrived at a point of the patch [texels from the texel's corner]; `key` is a hash of the arrival.
    pub(super) fn mark(&self, patch: usize, within: Vec2, flux: Rgb, key: u64) {
        let random = 1.0 - unit_f32(mix(key) as u32);
        let order = libm::logf(random).abs() / flux.element_sum().max(f32::MIN_POSITIVE);
        // Floats that are not negative are ordered as their bits are.
        let entry = u64::from(order.to_bits()) << 32 | u64::from(Mark::new(within).0);
        let mark = &self.sums[patch].mark;
        if self.alone {
            mark.store(mark.load(Relaxed).min(entry), Relaxed);
        } else {
            mark.fetch_min(entry, Relaxed);
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
            let mut flux = pool.install(|| Arrivals::new(patches));
            flux.expect(30_000.0);
            pool.install(|| (0..100_000u64).into_par_iter().for_each(|i| add(&flux.adder(), i)));
            // From outside the pool as well.
            (100_000..100_010u64).for_each(|i| add(&flux.adder(), i));
            let owned = flux.owned;
            (flux.take().0[0], owned)
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

    #[test]
    fn the_point_that_is_kept_is_one_of_the_arrivals_by_flux_and_in_any_order() {
        // Patch p gets two arrivals, one with three times the flux of the other.
        let patches = 20_000;
        let arrival = |i: u64| (i / 2, Vec2::new(if i.is_multiple_of(2) { 0.25 } else { 0.75 }, 0.5));
        let flux = |i: u64| Rgb::splat(if i.is_multiple_of(2) { 3.0 } else { 1.0 });
        let run = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let mut arrivals = pool.install(|| Arrivals::new(patches));
            arrivals.expect(1e5);
            pool.install(|| {
                (0..2 * patches as u64).into_par_iter().for_each(|i| {
                    let (patch, within) = arrival(i);
                    arrivals.adder().mark(patch as usize, within, flux(i), i);
                });
            });
            arrivals.take().1
        };
        let marks = run(1);
        assert!(marks == run(3), "depends on the order");
        let strong = marks.iter().filter(|m| (m.within() - Vec2::new(0.25, 0.5)).length() < 1e-4).count();
        let weak = marks.iter().filter(|m| (m.within() - Vec2::new(0.75, 0.5)).length() < 1e-4).count();
        assert_eq!(strong + weak, patches);
        let z = (strong as f64 - 0.75 * patches as f64) / (0.75 * 0.25 * patches as f64).sqrt();
        assert!(z.abs() < 4.0, "{strong} of {patches}: {z}");
    }
}
