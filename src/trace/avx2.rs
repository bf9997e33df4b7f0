//! The traversal, compiled for CPUs with AVX2, and the question whether this is one.
//!
//! [`Avx2`] is the proof that it is: [`Avx2::detect`] alone makes it. [`Wide`], eight lanes in one register, stays in this
//! file, and every use of it is compiled into the functions with `#[target_feature]` below, which need the proof.
//! Fused multiply-add is not among their features: it would round differently from the portable path.

#![allow(unsafe_code, reason = "instructions that not every machine has; the only such file of the folder")]

use super::Hit;
use super::Ray3;
use super::Tracer;
use super::lanes::Eight;
use super::lanes::Lanes;
use super::traverse::traverse;
use core::arch::x86_64::*;

/// This machine has the instructions.
#[derive(Clone, Copy, Debug)]
pub(super) struct Avx2(());

impl Avx2 {
    pub(super) fn detect() -> Option<Self> {
        let all = is_x86_feature_detected!("avx2")
            && is_x86_feature_detected!("bmi1")
            && is_x86_feature_detected!("bmi2")
            && is_x86_feature_detected!("lzcnt")
            && is_x86_feature_detected!("popcnt");
        all.then_some(Self(()))
    }

    #[inline]
    pub(super) fn closest(self, tracer: &Tracer<'_>, ray: Ray3) -> Option<Hit> {
        // SAFETY: `self` exists, so the features have been detected.
        unsafe { closest(tracer, ray) }
    }

    #[inline]
    pub(super) fn any(self, tracer: &Tracer<'_>, ray: Ray3) -> bool {
        // SAFETY: `self` exists, so the features have been detected.
        unsafe { any(tracer, ray) }
    }
}

#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
fn closest(tracer: &Tracer<'_>, ray: Ray3) -> Option<Hit> {
    traverse::<Wide, false>(tracer, ray)
}

#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
fn any(tracer: &Tracer<'_>, ray: Ray3) -> bool {
    traverse::<Wide, true>(tracer, ray).is_some()
}

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
    fn load(from: &Eight) -> Self {
        // SAFETY: features as above; `Eight` is 32 bytes, aligned to 32.
        Self(unsafe { _mm256_load_ps(from.0.as_ptr()) })
    }

    #[inline(always)]
    fn store(self) -> Eight {
        let mut to = Eight::default();
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
