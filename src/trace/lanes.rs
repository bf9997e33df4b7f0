//! Eight numbers at a time.
//!
//! [`Lanes`] is what the box test and the filter of the triangle test are written with. [`Portable`] is two 128-bit
//! vectors, which every x86-64 and arm64 machine has; `avx2` has the other implementation.
//!
//! Invariants: nothing that is computed here decides what is hit; it only refuses what `triangle` would refuse. So
//! implementations may differ within their error bounds: in [`Lanes::plane`], for NaN, and in the sign of zero. All
//! other operations are one correctly rounded IEEE operation in each lane. Every method is inlined by force: an
//! implementation may use instructions that only the outermost function is compiled for.

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
    /// A bit for each number that equals this one.
    #[inline(always)]
    fn equal(numbers: &[u32; 8], number: u32) -> u32 {
        let mut bits = 0;
        for (k, n) in numbers.iter().enumerate() {
            bits |= u32::from(*n == number) << k;
        }
        bits
    }
    /// What [`Lanes::plane`] needs for near and for far planes along one axis, of a ray's `origin` and the negative
    /// reciprocal of its direction; `reach` bounds all coordinates.
    fn axis(origin: f32, inverse: f32, reach: f32) -> [[Self; 2]; 2];
    /// Distances to planes: at most the true ones for near planes, at least the true ones for far planes.
    fn plane(at: &Eight, axis: [Self; 2]) -> Self;
    /// Asks for a cache line that will be read soon. Any address will do.
    #[inline(always)]
    fn prefetch(_address: usize) {}
}

/// (1 + ε)⁴/(1 − ε)⁴ with ε = 2⁻²⁴ is 1 + 8ε; this is 1 + 16ε.
pub(super) const SLACK: f32 = 1.0 + 1.0 / (1u32 << 20) as f32;

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

    /// Four roundings, all of them relative, so the far ones are enlarged by [`SLACK`].
    #[inline(always)]
    fn axis(origin: f32, inverse: f32, _reach: f32) -> [[Self; 2]; 2] {
        let origin = Self::splat(origin);
        [[origin, Self::splat(inverse)], [origin, Self::splat(inverse * SLACK)]]
    }

    #[inline(always)]
    fn plane(at: &Eight, [origin, inverse]: [Self; 2]) -> Self {
        origin.minus(Self::load(at)).times(inverse)
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

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::base::random::Stage;
    use crate::base::random::Stream;

    /// Distances to planes are bounded on the right side, for coordinates and directions of any size.
    pub(in super::super) fn planes_are_bounded<L: Lanes>() {
        let mut s = Stream::new(9, Stage::Render, 0, 0);
        for i in 0..300_000 {
            let mut number = |size: f32| (s.next_f32() - 0.5) * size;
            let size = [1e-3, 1.0, 1e3, 3e7][i % 4];
            let (origin, mut at) = (number(size), number([size, 1e-3 * size][i / 4 % 2]));
            let direction = number([2.0, 1e-6, 1e-28][i / 8 % 3]);
            let direction = direction.abs().max(1e-29).copysign(direction);
            if i % 5 == 0 {
                at = origin * (1.0 + number(1e-6));
            }
            let inverse = -1.0 / direction;
            let [near, far] = L::axis(origin, inverse, origin.abs().max(at.abs()));
            let at_lanes = Eight([at; 8]);
            let [near, far] = [near, far].map(|axis| f64::from(L::plane(&at_lanes, axis).store().0[i % 8]));
            // What lies behind the origin is refused anyway. Of relative bounds only the far ones are enlarged.
            let exact = ((f64::from(at) - f64::from(origin)) / f64::from(direction)).max(0.0);
            let bounded = near <= exact * f64::from(SLACK) && (far >= exact || exact == 0.0);
            assert!(bounded, "{near} {exact} {far}");
            // And not by much more than the rounding of the coordinates.
            let loose = 4e-6 * f64::from(origin.abs().max(at.abs()) / direction.abs());
            assert!(far - near <= loose + 1e-38, "{near} {exact} {far}");
        }
    }

    #[test]
    fn portable_planes_are_bounded() {
        planes_are_bounded::<Portable>();
    }
}
