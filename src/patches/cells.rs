//! A texel cut into a grid of cells: quadrature points for smooth functions, and the cells of the exposure mask.
//!
//! The point of a cell is the centroid of the surface in it and its weight is the surface's area there, so the sum is
//! exact for functions that are linear over each cell, also on clipped texels.

use super::{Patches, SurfacePoint};
use glam::{DVec2, Vec2};

/// Cells per side of the exposure mask.
pub(super) const MASK_GRID: u32 = 8;

/// Part of a texel from which on a fragment fills it, but for rounding.
const WHOLE: f32 = 0.999_999;

/// Distance of four points, a quarter turn apart, from the middle of a square of side 1, by which their mean is exact for cubic
/// functions, whichever way they are turned: 1/√6. Turned by 45° they are Gauss's.
const RADIUS: f64 = 0.408_248_290_463_863;

/// The cell of an n × n grid that a point in texel coordinates lies in, row by row.
pub(super) fn cell_index(point: DVec2, n: u32) -> usize {
    let cell = |v: f64| ((v * f64::from(n)) as u32).min(n - 1);
    (cell(point.y) * n + cell(point.x)) as usize
}

/// A unit vector in the first quadrant for a texel, far from those of the texels around it.
fn turned(x: u32, y: u32) -> DVec2 {
    // Multiples of the inverse plastic number and its square, 0.7549 and 0.5698, are even over the plane (Roberts, 2018).
    let step = x.wrapping_mul(3_242_174_889).wrapping_add(y.wrapping_mul(2_447_445_413));
    let half = f64::from(step) / 4_294_967_296.0;
    DVec2::new(1.0 - half * half, 2.0 * half) / (1.0 + half * half)
}

/// A cell of the exposure mask and the eight around it, as bits.
fn around(cell: usize) -> u64 {
    let (x, y) = (cell as u32 % MASK_GRID, cell as u32 / MASK_GRID);
    let rows = (y.saturating_sub(1)..=(y + 1).min(MASK_GRID - 1)).map(|y| y * MASK_GRID);
    let columns = (0b111 << x >> 1) & 0xff;
    rows.fold(0, |bits, row| bits | columns << row)
}

/// Cells of a mask beside those of another, of which they share a side.
fn beside(cells: u64) -> u64 {
    const FIRST_COLUMN: u64 = 0x0101_0101_0101_0101;
    (cells & !(FIRST_COLUMN << 7)) << 1 | (cells & !FIRST_COLUMN) >> 1 | cells << 8 | cells >> 8
}

/// The cells hang together.
fn is_whole(cells: u64) -> bool {
    let mut reached = cells & cells.wrapping_neg();
    loop {
        let more = (reached | beside(reached)) & cells;
        if more == reached {
            return reached == cells;
        }
        reached = more;
    }
}

impl Patches {
    /// What is exposed of a patch lies in pieces: something runs through it from side to side.
    #[must_use]
    pub fn is_split(&self, patch: usize) -> bool {
        !is_whole(self.mask[patch])
    }

    /// The cell of the exposure mask that a point lies in, or one of the eight around it, is exposed.
    pub(super) fn is_near_exposed(&self, patch: usize, point: DVec2) -> bool {
        around(cell_index(point, MASK_GRID)) & self.mask[patch] != 0
    }

    /// The cell of the exposure mask that a point lies in and the eight around it are exposed. Of a cell at the texel's
    /// border it is not known.
    pub(super) fn is_inside_exposed(&self, patch: usize, point: DVec2) -> bool {
        let around = around(cell_index(point, MASK_GRID));
        around.count_ones() == 9 && around & !self.mask[patch] == 0
    }

    /// A position on a page [texels] lies on surface that is in the open: in an exposed cell of a patch's mask.
    #[must_use]
    pub fn is_open(&self, page: u32, uv: Vec2) -> bool {
        let corner = uv.floor();
        let Some(front) = self.front_at(page, corner.x as i32, corner.y as i32) else { return false };
        self.exposed[front] > 0.0 && self.is_exposed_at(front, (uv - corner).as_dvec2())
    }

    /// Calls `visit(point, within, area)` for each cell of an n × n grid over the texel that the exposed part of the
    /// patch touches; the point also from the texel's corner [texels], areas in texel². A partly hidden texel is cut at
    /// least as finely as its mask, so that the centroid of a cell speaks for all of it.
    pub fn cells(&self, patch: usize, n: u32, mut visit: impl FnMut(SurfacePoint, Vec2, f32)) {
        let front = self.front_patch(patch);
        let n = if self.mask[patch] == u64::MAX { n } else { n.max(MASK_GRID) };
        for f in self.fragments.range(front) {
            self.cell_centroids(front, f, n, |point, centroid, area| {
                if self.is_exposed_at(patch, centroid) {
                    visit(point, centroid.as_vec2(), area);
                }
            });
        }
    }

    /// Calls `visit(point, within, area)` at four points of a texel that one triangle fills and nothing hides: exact for cubic
    /// functions, where centroids of as many cells leave out a quarter of what curvature does (below a point light two
    /// texels off the plane 1.4 %; these 0.12 %). They are turned from texel to texel, so that between those of a few
    /// texels nothing thin is missed for long. Other texels: as [`Self::cells`], 2 × 2.
    pub fn quarters(&self, patch: usize, mut visit: impl FnMut(SurfacePoint, Vec2, f32)) {
        let front = self.front_patch(patch);
        let Some(f) = self.sole_fragment(front).filter(|_| self.mask[patch] == u64::MAX) else {
            return self.cells(patch, 2, visit);
        };
        let triangle = self.fragments.triangle(front, f);
        let map = self.map(triangle, front);
        let mut arm = turned(self.texel[front] % self.page_size[0], self.texel[front] / self.page_size[0]) * RADIUS;
        for _ in 0..4 {
            let within = DVec2::splat(0.5) + arm;
            visit(SurfacePoint { triangle, b: map.weights(within) }, within.as_vec2(), 0.25);
            arm = arm.perp();
        }
    }

    /// The fragment that fills all of a front patch's texel.
    fn sole_fragment(&self, front: usize) -> Option<usize> {
        let range = self.fragments.range(front);
        (range.len() == 1 && self.fragments.covered[range.start] > WHOLE).then_some(range.start)
    }

    /// Centroid of the exposed part of a front patch [texels from the texel's corner].
    pub(super) fn centroid_of(&self, front: usize) -> Vec2 {
        let (range, is_open) = (self.fragments.range(front), self.mask[front] == u64::MAX);
        if is_open && self.sole_fragment(front).is_some() {
            return Vec2::splat(0.5);
        }
        let (mut sum, mut total) = (DVec2::ZERO, 0.0);
        let mut add = |centroid: DVec2, area: f64| {
            sum += centroid * area;
            total += area;
        };
        for f in range {
            if is_open {
                let polygon = self.polygon(front, f);
                add(polygon.centroid(), polygon.area());
            } else {
                self.cell_centroids(front, f, MASK_GRID, |_, centroid, area| {
                    if self.is_exposed_at(front, centroid) {
                        add(centroid, f64::from(area));
                    }
                });
            }
        }
        if total > 0.0 { (sum / total).as_vec2() } else { Vec2::splat(0.5) }
    }

    /// [`Patches::cells`] for one fragment, hidden cells included: calls `visit(point, centroid in texel coordinates, area
    /// [texel²])`.
    pub(super) fn cell_centroids(
        &self,
        front: usize,
        f: usize,
        n: u32,
        mut visit: impl FnMut(SurfacePoint, DVec2, f32),
    ) {
        let triangle = self.fragments.triangle(front, f);
        let map = self.map(triangle, front);
        let at = |c: DVec2| SurfacePoint { triangle, b: map.weights(c) };
        let side = 1.0 / f64::from(n);
        if self.fragments.covered[f] > WHOLE {
            for k in 0..n * n {
                let centroid = DVec2::new(f64::from(k % n) + 0.5, f64::from(k / n) + 0.5) * side;
                visit(at(centroid), centroid, (side * side) as f32);
            }
            return;
        }
        self.polygon(front, f).each_cell(n, |area, centroid| visit(at(centroid), centroid, area as f32));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_hang_together_over_their_sides() {
        let cells = |rows: [u64; 8]| rows.iter().rev().fold(0, |bits, row| bits << 8 | row);
        let (wall, post) = (0b1110_0111, [0xff, 0xff, 0xff, 0b1110_0111, 0b1110_0111, 0xff, 0xff, 0xff]);
        let diagonal = [0, 1, 2, 3, 4, 5, 6, 7].map(|k| 0xff ^ 1 << k);
        assert!(is_whole(u64::MAX) && is_whole(0) && is_whole(cells(post)) && is_whole(1 << 63));
        // Bits of one row's end and the next row's start are no neighbours.
        assert!(!is_whole(cells([wall; 8])) && !is_whole(cells(diagonal)) && !is_whole(0b1_1000_0000));
    }
}
