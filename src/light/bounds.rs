//! What is known of some lights together, and where to part them.
//!
//! In: bounds of single lights. Out: those of several, and the order that puts the two halves of a node apart.
//!
//! Source: A. Conty Estevez, C. Kulla, "Importance Sampling of Many Lights with Adaptive Tree Splitting", 2018; the cost of
//! a split as in Pharr, Jakob, Humphreys, *Physically Based Rendering*, 4th edition, §12.6.3.
//!
//! Symbols: o opening of the cone of axes, e angle around each within which it shines, w their sum, d size of the box.

use super::cone;
use core::f32::consts::{FRAC_PI_2, PI};
use glam::Vec3;

/// Candidate splits per axis, as in pbrt.
const BUCKETS: usize = 12;

/// What is known of some leaves together.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bounds {
    pub(super) low: Vec3,
    pub(super) high: Vec3,
    /// Axis of the cone of directions into which they shine.
    pub(super) axis: Vec3,
    pub(super) cos_o: f32,
    pub(super) cos_e: f32,
    /// Both sides shine.
    pub(super) two_sided: bool,
    /// Radiance × area, or intensity [cd].
    pub(super) power: f32,
    /// Nothing arrives beyond this distance [m].
    pub(super) range: f32,
}

impl Bounds {
    /// Of nothing.
    pub(super) const NONE: Self = Self {
        low: Vec3::ZERO,
        high: Vec3::ZERO,
        axis: Vec3::ZERO,
        cos_o: 1.0,
        cos_e: 1.0,
        two_sided: false,
        power: 0.0,
        range: 0.0,
    };

    /// Of both.
    pub(super) fn union(&self, other: &Self) -> Self {
        let (axis, cos_o) = cone::union((self.axis, self.cos_o), (other.axis, other.cos_o));
        Self {
            low: self.low.min(other.low),
            high: self.high.max(other.high),
            axis,
            cos_o,
            cos_e: self.cos_e.min(other.cos_e),
            two_sided: self.two_sided || other.two_sided,
            power: self.power + other.power,
            range: self.range.max(other.range),
        }
    }

    /// Distance of a point from the box [m].
    pub(super) fn distance(&self, point: Vec3) -> f32 {
        point.clamp(self.low, self.high).distance(point)
    }

    /// Middle of the box [m].
    pub(super) fn center(&self) -> Vec3 {
        (self.low + self.high) * 0.5
    }

    /// Cost of shooting at these leaves as one: power × solid angle of emission × surface (Conty and Kulla, eq. 1).
    fn cost(&self) -> f32 {
        let (o, e) = (libm::acosf(self.cos_o.clamp(-1.0, 1.0)), libm::acosf(self.cos_e.clamp(-1.0, 1.0)));
        let w = (o + e).min(PI);
        let (sin_o, cos_o) = libm::sincosf(o);
        let omega = 2.0 * PI * (1.0 - cos_o)
            + FRAC_PI_2 * (2.0 * w * sin_o - libm::cosf(o - 2.0 * w) - 2.0 * o * sin_o + cos_o);
        let d = self.high - self.low;
        // The diagonal keeps rows of lights, which have no surface, apart.
        self.power * omega * (2.0 * (d.x * d.y + d.y * d.z + d.z * d.x) + 0.01 * d.length_squared())
    }
}

/// Orders the leaves for the cheapest of the candidate splits; how many go first. Half of them if none separates.
pub(super) fn split(leaves: &[Bounds], order: &mut [u32], bounds: &Bounds) -> usize {
    let center = |k: u32| leaves[k as usize].center();
    let (mut low, mut high) = (Vec3::splat(f32::MAX), Vec3::splat(f32::MIN));
    for &k in order.iter() {
        low = low.min(center(k));
        high = high.max(center(k));
    }
    let extent = high - low;
    let bucket = |k: u32, axis: usize| {
        (((center(k)[axis] - low[axis]) / extent[axis] * BUCKETS as f32) as usize).min(BUCKETS - 1)
    };
    let size = bounds.high - bounds.low;
    let mut best: Option<(f32, usize, usize)> = None;
    for axis in (0..3).filter(|&a| extent[a] > 0.0) {
        let mut all: [Option<Bounds>; BUCKETS] = [None; BUCKETS];
        for &k in order.iter() {
            let slot = &mut all[bucket(k, axis)];
            *slot = Some(slot.map_or(leaves[k as usize], |b| b.union(&leaves[k as usize])));
        }
        // Long boxes are cut across, not along.
        let shape = size.max_element() / size[axis].max(f32::MIN_POSITIVE);
        for at in 1..BUCKETS {
            let side = |part: &[Option<Bounds>]| part.iter().flatten().copied().reduce(|a, b| a.union(&b));
            let (Some(a), Some(b)) = (side(&all[..at]), side(&all[at..])) else { continue };
            let cost = shape * (a.cost() + b.cost());
            if best.is_none_or(|(least, ..)| cost < least) {
                best = Some((cost, axis, at));
            }
        }
    }
    let Some((_, axis, at)) = best else { return order.len() / 2 };
    let mut first: Vec<u32> = order.iter().copied().filter(|&k| bucket(k, axis) < at).collect();
    let split = first.len();
    first.extend(order.iter().copied().filter(|&k| bucket(k, axis) >= at));
    order.copy_from_slice(&first);
    split
}
