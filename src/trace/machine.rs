//! What depends on the machine: a traversal for CPUs with AVX2, and large pages. None of it changes a result.
//!
//! [`Avx2`] is the proof that the CPU has it: [`Avx2::detect`] alone makes it. `Wide`, eight lanes in one register,
//! stays in this file, and every use of it is compiled into the functions with `#[target_feature]` below, which need
//! the proof. Fused multiply-add is among their features, but the compiler never fuses by itself, so `Wide` alone has
//! it: to refuse boxes and triangles sooner, never to decide. With 20 thousand triangles it takes 6 % off the time of
//! an occlusion, all of it from the boxes, and nothing off that of the nearest hit.
//!
//! Tried: the same compiled with AVX-512VL (twice the registers, no spills) is 6 to 16 % slower on Skylake, as fast on Zen 4.
//!
//! A ray visits memory at random. With pages of 4 KiB, most of its time would go into finding their addresses; Linux
//! gives pages of 2 MiB to those who ask.

#![allow(unsafe_code, reason = "instructions and advice that no safe wrapper offers; the only such file of the folder")]

#[cfg(target_arch = "x86_64")]
pub(super) use avx2::Avx2;

use crate::base::parallel;
use rayon::prelude::*;

/// Bytes of a large page.
const LARGE: usize = 2 << 20;
/// Memory below this is not worth the bytes that alignment wastes.
const WORTH_IT: usize = LARGE / 8;

/// `n` copies of `value` in memory with large pages where there are any, and the index of the first one; what comes
/// before that is padding, because a large page begins at a multiple of its size.
pub(super) fn fill<T: Clone + Send + Sync>(n: usize, value: &T) -> (Vec<T>, usize) {
    if n * size_of::<T>() < WORTH_IT {
        return (parallel::map(n, |_| value.clone()), 0);
    }
    let mut out: Vec<T> = Vec::with_capacity(n + LARGE / size_of::<T>() + LARGE / size_of::<T>());
    let start = out.as_ptr().addr();
    let first = (start.next_multiple_of(LARGE) - start).div_ceil(size_of::<T>());
    ask_for_large_pages(&out);
    out.par_extend((0..first + n).into_par_iter().map(|_| value.clone()));
    (out, first)
}

/// Asks for large pages under the capacity of an empty list.
#[cfg(target_os = "linux")]
fn ask_for_large_pages<T>(list: &Vec<T>) {
    let start = list.as_ptr().addr().next_multiple_of(LARGE);
    let end = list.as_ptr().addr() + list.capacity() * size_of::<T>();
    if end > start {
        // SAFETY: the range lies in the allocation of `list`, the advice keeps its contents, and failure changes
        // nothing.
        unsafe { libc::madvise(core::ptr::with_exposed_provenance_mut(start), end - start, libc::MADV_HUGEPAGE) };
    }
}

#[cfg(not(target_os = "linux"))]
fn ask_for_large_pages<T>(_list: &Vec<T>) {}

#[cfg(target_arch = "x86_64")]
mod avx2 {
    use super::super::Hit;
    use super::super::Ray3;
    use super::super::Tracer;
    use super::super::lanes::Eight;
    use super::super::lanes::Lanes;
    #[cfg(test)]
    use super::super::lanes::tests::planes_are_bounded;
    use super::super::many;
    use super::super::traverse::traverse;
    use core::arch::x86_64::*;

    /// This machine has the instructions.
    #[derive(Clone, Copy, Debug)]
    pub(in super::super) struct Avx2(());

    impl Avx2 {
        pub(in super::super) fn detect() -> Option<Self> {
            let all = is_x86_feature_detected!("avx2")
                && is_x86_feature_detected!("fma")
                && is_x86_feature_detected!("bmi1")
                && is_x86_feature_detected!("bmi2")
                && is_x86_feature_detected!("lzcnt")
                && is_x86_feature_detected!("popcnt");
            all.then_some(Self(()))
        }

        /// Coordinates for which [`Wide`] never overflows: 2²⁴ times the largest reciprocal is 2¹²⁴. NaN is not within.
        #[inline]
        pub(in super::super) fn within(reach: f32) -> bool {
            reach <= (1u32 << 24) as f32
        }

        #[inline]
        pub(in super::super) fn closest(self, tracer: &Tracer<'_>, ray: Ray3) -> Option<Hit> {
            // SAFETY: `self` exists, so the features have been detected.
            unsafe { closest(tracer, ray) }
        }

        #[inline]
        pub(in super::super) fn closest_many(self, tracer: &Tracer<'_>, rays: &[Ray3], hits: &mut [Option<Hit>]) {
            // SAFETY: `self` exists, so the features have been detected.
            unsafe { closest_many(tracer, rays, hits) }
        }

        #[inline]
        pub(in super::super) fn any_many(self, tracer: &Tracer<'_>, rays: &[Ray3], hits: &mut [Option<Hit>]) {
            // SAFETY: `self` exists, so the features have been detected.
            unsafe { any_many(tracer, rays, hits) }
        }

        #[cold]
        pub(in super::super) fn closest_shared(
            self,
            tracer: &Tracer<'_>,
            ray: &Ray3,
            before: Option<Hit>,
        ) -> Option<Hit> {
            // SAFETY: `self` exists, so the features have been detected.
            unsafe { closest_shared(tracer, ray, before) }
        }

        #[cold]
        pub(in super::super) fn any_shared(self, tracer: &Tracer<'_>, ray: &Ray3) -> bool {
            // SAFETY: `self` exists, so the features have been detected.
            unsafe { any_shared(tracer, ray) }
        }

        #[inline]
        pub(in super::super) fn any(self, tracer: &Tracer<'_>, ray: Ray3) -> bool {
            // SAFETY: `self` exists, so the features have been detected.
            unsafe { any(tracer, ray) }
        }
    }

    #[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
    fn closest_shared(tracer: &Tracer<'_>, ray: &Ray3, before: Option<Hit>) -> Option<Hit> {
        tracer.shared.closest::<Wide>(tracer, ray, before)
    }

    #[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
    fn any_shared(tracer: &Tracer<'_>, ray: &Ray3) -> bool {
        tracer.shared.any::<Wide>(tracer, ray)
    }

    #[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
    fn closest(tracer: &Tracer<'_>, ray: Ray3) -> Option<Hit> {
        traverse::<Wide, false>(tracer, ray)
    }

    #[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
    fn any(tracer: &Tracer<'_>, ray: Ray3) -> bool {
        traverse::<Wide, true>(tracer, ray).is_some()
    }

    #[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
    fn closest_many(tracer: &Tracer<'_>, rays: &[Ray3], hits: &mut [Option<Hit>]) {
        many::trace::<Wide, false>(tracer, rays, hits);
    }

    #[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
    fn any_many(tracer: &Tracer<'_>, rays: &[Ray3], hits: &mut [Option<Hit>]) {
        many::trace::<Wide, true>(tracer, rays, hits);
    }

    /// 16ε; see [`Wide::axis`].
    const SHIFT: f32 = 1.0 / (1u32 << 20) as f32;

    #[derive(Clone, Copy)]
    struct Wide(__m256);

    /// Defines methods of [`Lanes`] that are one instruction.
    macro_rules! instructions {
        ($($name:ident: $instruction:ident),*) => {$(
            #[inline(always)]
            fn $name(self, other: Self) -> Self {
                // SAFETY: only reached from the functions with these features (see the head of this file).
                Self(unsafe { $instruction(self.0, other.0) })
            }
        )*};
    }

    impl Lanes for Wide {
        instructions!(plus: _mm256_add_ps, minus: _mm256_sub_ps, times: _mm256_mul_ps, least: _mm256_min_ps, most: _mm256_max_ps);

        #[inline(always)]
        fn prefetch(address: usize) {
            // SAFETY: a prefetch reads nothing and faults nowhere.
            unsafe { _mm_prefetch::<_MM_HINT_T0>(core::ptr::without_provenance(address)) };
        }

        #[inline(always)]
        fn load(from: &Eight) -> Self {
            // SAFETY: features as above; `Eight` is 32 bytes, aligned to 32.
            Self(unsafe { _mm256_load_ps(from.0.as_ptr()) })
        }

        #[inline(always)]
        fn store(self) -> Eight {
            let mut to = Eight([0.0; 8]);
            // SAFETY: features as above; `Eight` is 32 bytes, aligned to 32.
            unsafe { _mm256_store_ps(to.0.as_mut_ptr(), self.0) };
            to
        }

        #[inline(always)]
        fn splat(value: f32) -> Self {
            // SAFETY: features as above.
            Self(unsafe { _mm256_set1_ps(value) })
        }

        #[inline(always)]
        fn size(self) -> Self {
            // SAFETY: features as above.
            Self(unsafe { _mm256_andnot_ps(_mm256_set1_ps(-0.0), self.0) })
        }

        #[inline(always)]
        fn equal(numbers: &[u32; 8], number: u32) -> u32 {
            // SAFETY: features as above; eight numbers are 32 bytes, and the load needs no alignment.
            unsafe {
                let numbers = _mm256_loadu_si256(numbers.as_ptr().cast());
                let equal = _mm256_cmpeq_epi32(numbers, _mm256_set1_epi32(number.cast_signed()));
                _mm256_movemask_ps(_mm256_castsi256_ps(equal)) as u32
            }
        }

        /// With r the reach: the reciprocal is off by 2ε, its product with the origin by 3ε, and two sums add ε each,
        /// so the distance is off by less than 8ε·r times the reciprocal; `SHIFT` is twice that.
        #[inline(always)]
        fn axis(origin: f32, inverse: f32, reach: f32) -> [[Self; 2]; 2] {
            let (at_zero, error) = (origin * inverse, SHIFT * reach * inverse.abs());
            let inverse = Self::splat(inverse);
            [[Self::splat(at_zero - error), inverse], [Self::splat(at_zero + error), inverse]]
        }

        #[inline(always)]
        fn plane(at: &Eight, [at_zero, inverse]: [Self; 2]) -> Self {
            // SAFETY: features as above.
            Self(unsafe { _mm256_fnmadd_ps(Self::load(at).0, inverse.0, at_zero.0) })
        }

        #[inline(always)]
        fn at_most(self, other: Self) -> u32 {
            // SAFETY: features as above.
            unsafe { _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(self.0, other.0)) as u32 }
        }

        #[inline(always)]
        fn below(self, other: Self) -> u32 {
            // SAFETY: features as above.
            unsafe { _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LT_OQ>(self.0, other.0)) as u32 }
        }
    }

    #[cfg(test)]
    mod tests {
        use super::*;

        #[test]
        fn wide_planes_are_bounded() {
            if Avx2::detect().is_some() {
                planes_are_bounded::<Wide>();
            }
        }
    }
}
