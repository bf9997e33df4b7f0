//! Choice in proportion to tabulated weights: of an index, and of a cell of a grid.
//!
//! In: weights ≥ 0. Out: an index (or a cell and a place in it) and its probability. The probability that is returned
//! is that of the table as it was rounded, so an estimate that divides by it has no bias.
//!
//! Source: Pharr, Jakob, Humphreys, *Physically Based Rendering*, 4th edition, appendix A.5.6 (piecewise-constant 2D).
//!
//! Limits: a weight below 2⁻²⁴ of its row's sum may round to probability 0; a caller needs a second way to reach it.

use glam::Vec2;

/// Weights as running sums.
#[derive(Debug, Clone, Default)]
pub struct Running {
    sums: Vec<f32>,
}

impl Running {
    /// The table of some weights; negative ones count as 0.
    #[must_use]
    pub fn new(weights: impl Iterator<Item = f32>) -> Self {
        let mut sum = 0.0f64;
        let add = |w: f32| {
            sum += f64::from(w.max(0.0));
            sum as f32
        };
        Self { sums: weights.map(add).collect() }
    }

    /// Sum of all weights; 0 for an empty table.
    #[must_use]
    pub fn total(&self) -> f32 {
        self.sums.last().copied().unwrap_or(0.0)
    }

    /// Probability of index `k`.
    #[must_use]
    pub fn probability(&self, k: usize) -> f32 {
        let low = if k == 0 { 0.0 } else { self.sums[k - 1] };
        (self.sums[k] - low) / self.total().max(f32::MIN_POSITIVE)
    }

    /// An index for `u` in [0, 1), and where in [0, 1) of its share `u` lies. `None` if all weights are 0.
    #[must_use]
    pub fn sample(&self, u: f32) -> Option<(usize, f32)> {
        let target = u * self.total();
        if self.total() <= 0.0 {
            return None;
        }
        // The product may round up to the total: then the last index that has a weight is meant.
        let last = self.sums.partition_point(|&s| s < self.total());
        let k = self.sums.partition_point(|&s| s <= target).min(last);
        let low = if k == 0 { 0.0 } else { self.sums[k - 1] };
        Some((k, ((target - low) / (self.sums[k] - low)).clamp(0.0, 0.999_999_9)))
    }
}

/// Weights of the cells of a grid.
#[derive(Debug, Clone, Default)]
pub struct Grid {
    rows: Vec<Running>,
    row: Running,
}

impl Grid {
    /// The table of a grid; `weight(x, y)` is the weight of a whole cell.
    #[must_use]
    pub fn new(width: usize, height: usize, weight: impl Fn(usize, usize) -> f32) -> Self {
        let rows: Vec<Running> = (0..height).map(|y| Running::new((0..width).map(|x| weight(x, y)))).collect();
        let row = Running::new(rows.iter().map(Running::total));
        Self { rows, row }
    }

    /// Sum of all weights.
    #[must_use]
    pub fn total(&self) -> f32 {
        self.row.total()
    }

    /// Probability of cell (x, y).
    #[must_use]
    pub fn probability(&self, x: usize, y: usize) -> f32 {
        self.row.probability(y) * self.rows[y].probability(x)
    }

    /// A cell, and a uniform place in it; `u.y` chooses the row. `None` if all weights are 0.
    #[must_use]
    pub fn sample(&self, u: Vec2) -> Option<([usize; 2], Vec2)> {
        let (y, v) = self.row.sample(u.y)?;
        let (x, u) = self.rows[y].sample(u.x)?;
        Some(([x, y], Vec2::new(u, v)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn probabilities_add_up_and_choices_follow_them() {
        let weight = |x: usize, y: usize| ((x * 7 + y * 3) % 5) as f32;
        let grid = Grid::new(6, 4, weight);
        let total: f32 = (0..4)
            .flat_map(|y| (0..6).map(move |x| (x, y)))
            .map(|(x, y)| grid.probability(x, y))
            .fold(0.0, |a, b| a + b);
        assert!((total - 1.0).abs() < 1e-5);
        let n = 512;
        let mut seen = [[0u32; 6]; 4];
        for i in 0..n * n {
            let u = Vec2::new((i % n) as f32 + 0.5, (i / n) as f32 + 0.5) / n as f32;
            let ([x, y], place) = grid.sample(u).unwrap();
            seen[y][x] += 1;
            assert!(place.min_element() >= 0.0 && place.max_element() < 1.0);
        }
        for (y, row) in seen.iter().enumerate() {
            for (x, &count) in row.iter().enumerate() {
                let share = count as f32 / (n * n) as f32;
                assert!((share - grid.probability(x, y)).abs() < 5e-3, "{x} {y}");
            }
        }
    }

    #[test]
    fn nothing_can_be_chosen_from_zeros() {
        assert!(Grid::new(3, 2, |_, _| 0.0).sample(Vec2::splat(0.3)).is_none());
        assert!(Running::default().sample(0.5).is_none());
        let (k, _) = Running::new([0.0, 1.0, 0.0].into_iter()).sample(0.999_999_9).unwrap();
        assert_eq!(k, 1);
    }
}
