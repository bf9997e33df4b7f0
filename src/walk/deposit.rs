//! Shares the flux of one line hit between the patch that was hit and its neighbours.
//!
//! In: the hit patch, where it was hit, how far the line came and at what angle. Out: deposits that add up to the flux.
//!
//! Source: Castro, Feixas, Sbert, "Fuzzy Random Walk", §3, eqs. (2) to (4). Where we differ, and why:
//! * eq. (4) prints `d_i²/i`; the weights then do not add up to one. Read as `d_i²` they do, with the paper's 1/7;
//! * the paper has eight coplanar neighbours; at borders there are m < 8, and 1/7 becomes 1/(m − 1). A single neighbour
//!   takes all that is shared.
//!
//! Symbols, in this file only:
//!   A  area of the hit patch [m²]     c  cosine at the hit, ≥ 0     R  distance that the line came [m]
//!   p  chance of this hit, A c/(2π R²)     u  uncertainty, −log2 p [bit], 0 if p ≥ 1     f  fraction that is shared
//!
//! Invariants: deposits are whole numbers of units, and their sum is exactly the flux. No allocation.

use crate::base::Rgb;
use crate::patches::{PatchGraph, Patches};
use core::f32::consts::TAU;
use glam::{Vec2, Vec3};

/// What a line does where it hits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Splat {
    /// All flux goes to the hit patch: the classic random walk.
    None,
    /// The paper's splat: nothing is shared below `alpha` bits of uncertainty, everything above `beta`.
    Paper {
        /// Uncertainty where sharing starts [bit].
        alpha: f32,
        /// Uncertainty from which everything is shared [bit].
        beta: f32,
    },
}

/// A line's end.
#[derive(Debug, Clone, Copy)]
pub(super) struct Arrival {
    pub(super) patch: usize,
    pub(super) position: Vec3,
    /// From the corner of the texel [texels].
    pub(super) within: Vec2,
    pub(super) distance: f32,
    /// Of the line.
    pub(super) direction: Vec3,
    pub(super) flux: Rgb,
}

/// Calls `deposit(patch, units)` for each share of the line's flux, which is `units` in the unit of the sums.
pub(super) fn deposit(
    splat: Splat,
    patches: &Patches,
    graph: &PatchGraph,
    arrival: &Arrival,
    units: [u64; 3],
    mut deposit: impl FnMut(usize, [u64; 3]),
) {
    let f = match splat {
        Splat::None => 0.0,
        Splat::Paper { alpha, beta } => {
            let d = arrival.direction;
            let cosine = (d.dot(patches.normal[arrival.patch]) / d.length()).abs();
            fraction(patches.area[arrival.patch], cosine, arrival.distance, alpha, beta)
        }
    };
    if f <= 0.0 {
        return deposit(arrival.patch, units);
    }
    let neighbors = graph.neighbors(arrival.patch);
    if neighbors.is_empty() {
        return deposit(arrival.patch, units);
    }
    let mut left = units;
    if f < 1.0 {
        left = part(left, f);
        deposit(arrival.patch, core::array::from_fn(|c| units[c] - left[c]));
    }
    let shared = left;
    let mut squares = [0.0f32; 8];
    for (d, &k) in squares.iter_mut().zip(neighbors) {
        *d = patches.position[k as usize].distance_squared(arrival.position);
    }
    let m = neighbors.len().min(8);
    let total: f32 = squares[..m].iter().fold(0.0, |a, b| a + b);
    let scale = 1.0 / ((m - 1) as f32 * total).max(f32::MIN_POSITIVE);
    for (&d, &k) in squares[..m - 1].iter().zip(neighbors) {
        let units = part(shared, (total - d) * scale);
        left = core::array::from_fn(|c| left[c].saturating_sub(units[c]));
        deposit(k as usize, units);
    }
    // Rounding of the other weights ends here: the deposits add up.
    deposit(neighbors[m - 1] as usize, left);
}

/// A fraction of flux, to 30 bits.
fn part(units: [u64; 3], fraction: f32) -> [u64; 3] {
    const BITS: u32 = 30;
    let fraction = u128::from((fraction * (1u32 << BITS) as f32) as u32);
    units.map(|u| ((u128::from(u) * fraction) >> BITS) as u64)
}

/// Fraction of the flux that is shared: eqs. (2) and (3), then linear from `alpha` to `beta`.
fn fraction(area: f32, c: f32, distance: f32, alpha: f32, beta: f32) -> f32 {
    let p = area * c / (TAU * distance * distance);
    let u = if p >= 1.0 { 0.0 } else { -libm::log2f(p.max(f32::MIN_POSITIVE)) };
    ((u - alpha) / (beta - alpha)).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_exact_to_thirty_bits() {
        assert_eq!(part([1 << 60, 3, 0], 1.0), [1 << 60, 3, 0]);
        assert_eq!(part([1 << 60, 8, 0], 0.25), [1 << 58, 2, 0]);
        assert_eq!(part([u64::MAX, 0, 0], 0.0), [0; 3]);
    }

    #[test]
    fn fraction_follows_the_uncertainty() {
        // A patch of 2π/1024 m² at 1 m, hit head on, has p = 2⁻¹⁰, so u = 10 bits: half way from 5 to 15.
        assert!((fraction(TAU / 1024.0, 1.0, 1.0, 5.0, 15.0) - 0.5).abs() < 1e-5);
        // Twice as far: two bits more.
        assert!((fraction(TAU / 1024.0, 1.0, 2.0, 5.0, 15.0) - 0.7).abs() < 1e-5);
        assert_eq!(fraction(TAU, 1.0, 0.5, 5.0, 15.0), 0.0);
        assert_eq!(fraction(1e-9, 0.5, 10.0, 5.0, 15.0), 1.0);
    }
}
