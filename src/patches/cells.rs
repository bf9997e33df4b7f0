//! A texel cut into a grid of cells: quadrature points for smooth functions, and the cells of the exposure mask.
//!
//! The point of a cell is the centroid of the surface in it and its weight is the surface's area there, so the sum is
//! exact for functions that are linear over each cell, also on clipped texels.

use super::{Patches, SurfacePoint};
use glam::DVec2;

/// Cells per side of the exposure mask.
pub(super) const MASK_GRID: u32 = 8;

/// The cell of an n × n grid that a point in texel coordinates lies in, row by row.
pub(super) fn cell_index(point: DVec2, n: u32) -> usize {
    let cell = |v: f64| ((v * f64::from(n)) as u32).min(n - 1);
    (cell(point.y) * n + cell(point.x)) as usize
}

impl Patches {
    /// Calls `visit(point, area)` for each cell of an n × n grid over the texel that the exposed part of the patch
    /// touches; areas in texel². A partly hidden texel is cut at least as finely as its mask, so that the centroid of a
    /// cell speaks for all of it.
    pub fn cells(&self, patch: usize, n: u32, mut visit: impl FnMut(SurfacePoint, f32)) {
        let front = self.front_patch(patch);
        let n = if self.mask[front] == u64::MAX { n } else { n.max(MASK_GRID) };
        for f in self.fragments.range(front) {
            self.cell_centroids(front, f, n, |point, centroid, area| {
                if self.cell_is_exposed(front, centroid) {
                    visit(point, area);
                }
            });
        }
    }

    /// The same for one fragment, hidden cells included.
    pub(super) fn fragment_cells(&self, front: usize, f: usize, n: u32, mut visit: impl FnMut(SurfacePoint, f32)) {
        self.cell_centroids(front, f, n, |point, _, area| visit(point, area));
    }

    /// Calls `visit(point, centroid in texel coordinates, area [texel²])`.
    pub(super) fn cell_centroids(
        &self,
        front: usize,
        f: usize,
        n: u32,
        mut visit: impl FnMut(SurfacePoint, DVec2, f32),
    ) {
        let triangle = self.fragments.triangle[f];
        let map = self.map(triangle, front);
        let at = |c: DVec2| SurfacePoint { triangle, b: map.weights(c) };
        let side = 1.0 / f64::from(n);
        if self.fragments.covered[f] > 0.999_999 {
            for k in 0..n * n {
                let centroid = DVec2::new(f64::from(k % n) + 0.5, f64::from(k / n) + 0.5) * side;
                visit(at(centroid), centroid, (side * side) as f32);
            }
            return;
        }
        let polygon = self.polygon(front, f).map(|c| c * f64::from(n));
        for y in 0..n {
            let row = polygon.slab(1, f64::from(y));
            if row.corners().len() < 3 {
                continue;
            }
            for x in 0..n {
                let cell = row.slab(0, f64::from(x));
                let area = cell.area();
                if area > 1e-9 {
                    let centroid = cell.centroid() * side;
                    visit(at(centroid), centroid, (area * side * side) as f32);
                }
            }
        }
    }
}
