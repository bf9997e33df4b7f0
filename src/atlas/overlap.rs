//! Does a flat layout cover some place twice? Decided by samples, without rounding errors.
//!
//! Corners are rounded to a grid of 1/256 of the sample distance; a triangle covers the samples of row y between its
//! two edges that cross y, with half-open rules, so triangles that share an edge never share a sample. Limit: overlaps
//! thinner than the sample distance can be missed.

use glam::DVec2;

/// Grid steps per sample distance.
pub(crate) const STEPS: i64 = 256;

/// Samples of a layout that triangles cover.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Coverage {
    /// Covered at least once.
    pub(super) covered: u64,
    /// Covered more than once, counted per extra triangle.
    pub(super) double: u64,
}

impl Coverage {
    /// More overlap than rounding of sliver triangles can cause.
    pub(super) fn overlaps(self) -> bool {
        self.double * 2000 > self.covered
    }
}

/// Samples a layout with at least `4096` and about `per_triangle` samples per triangle, at most 2²².
pub(super) fn coverage(triangles: &[[DVec2; 3]], per_triangle: usize) -> Coverage {
    let corners = triangles.iter().flatten();
    let low = corners.clone().fold(DVec2::INFINITY, |a, p| a.min(*p));
    let high = corners.fold(DVec2::NEG_INFINITY, |a, p| a.max(*p));
    let extent = high - low;
    if !extent.is_finite() || extent.min_element() <= 0.0 {
        return Coverage { covered: 0, double: 0 };
    }
    let samples = (triangles.len() * per_triangle).clamp(4096, 1 << 22) as f64;
    let distance = (extent.x * extent.y / samples).sqrt().max(extent.max_element() / 16384.0);
    let width = (extent.x / distance).ceil() as usize + 1;
    let height = (extent.y / distance).ceil() as usize + 1;
    let mut bits = vec![0u64; (width * height).div_ceil(64)];
    let mut coverage = Coverage { covered: 0, double: 0 };
    let scale = STEPS as f64 / distance;
    for triangle in triangles {
        let grid = triangle.map(|p| {
            let q = ((p - low) * scale).round();
            [q.x as i64, q.y as i64]
        });
        visit_samples(grid, |x, y| {
            let bit = y as usize * width + x as usize;
            let mask = 1u64 << (bit % 64);
            if bits[bit / 64] & mask == 0 {
                coverage.covered += 1;
            } else {
                coverage.double += 1;
            }
            bits[bit / 64] |= mask;
        });
    }
    coverage
}

/// Calls `visit(column, row)` for every sample (at the middle of a cell of [`STEPS`]²) inside a triangle.
pub(crate) fn visit_samples(p: [[i64; 2]; 3], mut visit: impl FnMut(i64, i64)) {
    let low = p[0][1].min(p[1][1]).min(p[2][1]);
    let high = p[0][1].max(p[1][1]).max(p[2][1]);
    for row in (low - STEPS / 2).div_euclid(STEPS)..=high.div_euclid(STEPS) {
        let y = row * STEPS + STEPS / 2;
        let (mut first, mut last) = (i64::MAX, i64::MIN);
        for k in 0..3 {
            let (a, b) = if p[k][1] < p[(k + 1) % 3][1] { (p[k], p[(k + 1) % 3]) } else { (p[(k + 1) % 3], p[k]) };
            if a[1] <= y && y < b[1] {
                // First column whose sample lies at or right of the edge: ceil((x − ½ cell) / cell), x rational.
                let dy = b[1] - a[1];
                let x = (a[0] - STEPS / 2) * dy + (y - a[1]) * (b[0] - a[0]);
                let column = -((-x).div_euclid(dy * STEPS));
                first = first.min(column);
                last = last.max(column);
            }
        }
        for column in first..last.max(first) {
            visit(column, row);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fan(turn: f64) -> Vec<[DVec2; 3]> {
        let n = 24;
        let at = |i: usize| DVec2::from_angle(turn * i as f64 / n as f64) * 3.0;
        (0..n).map(|i| [DVec2::ZERO, at(i), at(i + 1)]).collect()
    }

    #[test]
    fn a_full_fan_covers_every_sample_once() {
        let coverage = coverage(&fan(core::f64::consts::TAU), 64);
        assert_eq!(coverage.double, 0);
        let share = coverage.covered as f64 / 4096.0;
        let polygon = 0.5 * 24.0 * (core::f64::consts::TAU / 24.0).sin() / 4.0;
        assert!((share - polygon).abs() < 0.02, "{share} {polygon}");
    }

    #[test]
    fn a_fan_that_turns_too_far_overlaps() {
        assert!(coverage(&fan(core::f64::consts::TAU * 1.1), 64).overlaps());
    }
}
