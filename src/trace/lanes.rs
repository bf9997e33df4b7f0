//! Eight numbers at a time.
//!
//! [`Lanes`] is what the box test and the filter of the triangle test are written with. [`Portable`] is two 128-bit
//! vectors, which every x86-64 and arm64 machine has; `avx2` has the other implementation.
//!
//! Invariants: every operation is one correctly rounded IEEE operation in each lane, so all implementations agree; they
//! may differ for NaN and for the sign of zero, which decide nothing (see `triangle`, `traverse`). Every method is inlined
//! by force: an implementation may use instructions that only the outermost function is compiled for.

use glam::Vec4;

/// Eight numbers in memory.
#[derive(Clone, Copy, Default)]
#[repr(align(32))]
pub(super) struct Eight(pub(super) [f32; 8]);

/// Eight numbers in registers.
pub(super) trait Lanes: Copy {
    fn load(from: &Eight) -> Self;
    fn store(self) -> Eight;
    fn splat(value: f32) -> Self;
    fn plus(self, other: Self) -> Self;
    fn minus(self, other: Self) -> Self;
    fn times(self, other: Self) -> Self;
    fn least(self, other: Self) -> Self;
    fn most(self, other: Self) -> Self;
    fn size(self) -> Self;
    /// A bit for each lane that is at most the other one; not for NaN.
    fn at_most(self, other: Self) -> u32;
    /// A bit for each lane that is below the other one; not for NaN.
    fn below(self, other: Self) -> u32;
    /// Asks for a cache line that will be read soon. Any address will do.
    #[inline(always)]
    fn prefetch(_address: usize) {}
}

/// See the head of this file.
#[derive(Clone, Copy)]
pub(super) struct Portable([Vec4; 2]);

impl Lanes for Portable {
    #[inline(always)]
    fn load(from: &Eight) -> Self {
        let [a, b, c, d, e, f, g, h] = from.0;
        Self([Vec4::new(a, b, c, d), Vec4::new(e, f, g, h)])
    }

    #[inline(always)]
    fn store(self) -> Eight {
        let ([a, b, c, d], [e, f, g, h]) = (self.0[0].to_array(), self.0[1].to_array());
        Eight([a, b, c, d, e, f, g, h])
    }

    #[inline(always)]
    fn splat(value: f32) -> Self {
        Self([Vec4::splat(value); 2])
    }

    #[inline(always)]
    fn plus(self, other: Self) -> Self {
        Self([self.0[0] + other.0[0], self.0[1] + other.0[1]])
    }

    #[inline(always)]
    fn minus(self, other: Self) -> Self {
        Self([self.0[0] - other.0[0], self.0[1] - other.0[1]])
    }

    #[inline(always)]
    fn times(self, other: Self) -> Self {
        Self([self.0[0] * other.0[0], self.0[1] * other.0[1]])
    }

    #[inline(always)]
    fn least(self, other: Self) -> Self {
        Self([self.0[0].min(other.0[0]), self.0[1].min(other.0[1])])
    }

    #[inline(always)]
    fn most(self, other: Self) -> Self {
        Self([self.0[0].max(other.0[0]), self.0[1].max(other.0[1])])
    }

    #[inline(always)]
    fn size(self) -> Self {
        Self([self.0[0].abs(), self.0[1].abs()])
    }

    #[inline(always)]
    fn at_most(self, other: Self) -> u32 {
        self.0[0].cmple(other.0[0]).bitmask() | self.0[1].cmple(other.0[1]).bitmask() << 4
    }

    #[inline(always)]
    fn below(self, other: Self) -> u32 {
        self.0[0].cmplt(other.0[0]).bitmask() | self.0[1].cmplt(other.0[1]).bitmask() << 4
    }
}
