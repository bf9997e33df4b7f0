//! What is to be believed of bias and noise that single texels show.
//!
//! In: squared bias and noise of each patch, on average right, each by itself mostly chance. Out: the squared error that is
//! to be expected of each patch.
//!
//! The mean of a wide cell of space is known well, but is no place's own; the mean around a patch is its own, but known
//! badly: of seven levels that are compared by it alone one would win by chance in every tenth window, and leave blotches
//! of noise there. So the mean around a patch counts as far as it differs from the cell's by more than chance would make
//! it. Source: James and Stein, "Estimation with quadratic loss", Proc. 4th Berkeley Symposium, 1961; with the positive
//! part, and the variance as the window shows it.
//!
//! Symbols: m mean   v variance of a mean   n texels of a window
//!
//! Limits: neighbours' noise counts as independent.

use super::cells::Cells;
use super::windows::Windows;
use crate::base::parallel;
use glam::Vec3;

/// Squared difference that is chance, in variances.
const CHANCE: f32 = 4.0;
/// Texels of a chart from which on its own noise counts for more than the cell's.
const FEW: f32 = 16.0;

/// Judges levels of flow.
pub(super) struct Judge<'a> {
    pub(super) windows: &'a Windows,
    pub(super) cells: &'a Cells,
}

impl Judge<'_> {
    /// Squared error to be expected of each patch, by the squared bias and the noise that each shows.
    pub(super) fn errors(&self, found: &[(f32, f32)]) -> Vec<f32> {
        let moments = |i: usize| {
            let (bias, noise) = found[i];
            Vec3::new(bias, bias * bias, noise)
        };
        let (cells, windows) = (self.cells.means(moments), self.windows.means(moments));
        parallel::map_light(found.len(), |i| {
            let (cell, around, n) = (cells[self.cells.of(i)], windows[self.windows.block(i)], self.windows.size(i));
            shrunk(cell.x, around, n) + cell.z + (around.z - cell.z) * (n / (n + FEW))
        })
    }
}

/// A window's mean of n values, as far as it differs from `usual` by more than chance; `window` holds their first and
/// second moments.
fn shrunk(usual: f32, window: Vec3, n: f32) -> f32 {
    let v = (window.y - window.x * window.x).max(0.0) / n;
    let difference = window.x - usual;
    let own = 1.0 - CHANCE * v / (difference * difference).max(f32::MIN_POSITIVE);
    usual + difference * own.max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Worth of the mean of `n` draws of deviation 1 around `truth`, beside a cell's of zero: mean of the squared error.
    fn risk(truth: f64, n: u32) -> f64 {
        let mut stream = crate::base::random::Stream::new(7, crate::base::random::Stage::Light, 0, 0);
        let rounds = 4000;
        let one = || {
            // Sums of twelve uniform numbers are near enough to normal ones.
            let mut normal = || (0..12).map(|_| stream.next_f64()).fold(-6.0, |a, b| a + b);
            let draws: Vec<f64> = (0..n).map(|_| truth + normal()).collect();
            let mean = |power: i32| draws.iter().map(|x| x.powi(power)).fold(0.0, |a, b| a + b) / f64::from(n);
            (shrunk(0.0, Vec3::new(mean(1) as f32, mean(2) as f32, 0.0), n as f32) as f64 - truth).powi(2)
        };
        core::iter::repeat_with(one).take(rounds).fold(0.0, |a, b| a + b) / f64::from(rounds as u32)
    }

    #[test]
    fn chance_does_not_count_and_what_is_beyond_it_does() {
        let variance = 1.0 / 50.0;
        assert!(risk(0.0, 50) < 0.35 * variance, "{}", risk(0.0, 50) / variance);
        assert!(risk(1.0, 50) < 1.6 * variance, "{}", risk(1.0, 50) / variance);
    }
}
