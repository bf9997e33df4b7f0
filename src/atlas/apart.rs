//! Whether charts of a layout that somebody else made are apart: whether they share texels, or look-ups in one read another.
//!
//! In: a piece and its shape. Out: sets of charts that share texels; the charts in which look-ups read others.
//!
//! A bilinear look-up at p reads the texels ⌊p − ½⌋ and the next, along each axis: those that the triangle touches if it is
//! moved by half a texel back, and half a texel on.

use super::align::Piece;
use super::shape::Footprint;
use super::shape::Shape;
use super::shape::touched;
use crate::base::Sets;

/// No chart.
const NONE: u32 = u32::MAX;

/// What lies on the texels of a shape.
pub(super) struct Touched {
    width: u32,
    height: u32,
    /// The last chart that touches each texel.
    chart: Vec<u32>,
    /// Charts that share texels.
    pub(super) sets: Sets,
}

impl Touched {
    pub(super) fn new(piece: &Piece, shape: &Shape, bits: u32) -> Self {
        let Footprint { width, height, .. } = shape.footprint;
        let (chart, sets) = (vec![NONE; width as usize * height as usize], Sets::new(piece.parts.len()));
        let mut all = Self { width, height, chart, sets };
        for (face, grid) in piece.faces.iter().zip(&shape.grid) {
            touched(*grid, bits, |y, from, to| {
                for i in all.texels(y, from, to) {
                    let before = core::mem::replace(&mut all.chart[i], face.chart);
                    if before != NONE && before != face.chart {
                        all.sets.join(before as usize, face.chart as usize);
                    }
                }
            });
        }
        all
    }

    /// The places in `chart` of a row's range, as far as it lies on the shape; a needle may lie on the last border.
    fn texels(&self, y: u32, from: u32, to: u32) -> core::ops::Range<usize> {
        if y >= self.height {
            return 0..0;
        }
        let row = y as usize * self.width as usize;
        row + from as usize..row + to.min(self.width).max(from) as usize
    }

    /// Whether look-ups in a chart read texels of others, those of the same set left out, by chart, as `set` is.
    pub(super) fn mixed(&self, piece: &Piece, shape: &Shape, bits: u32, set: &[u32]) -> Vec<bool> {
        let half = 1 << (bits - 1);
        let mut mixed = vec![false; set.len()];
        for (face, grid) in piece.faces.iter().zip(&shape.grid) {
            let foreign = |i: usize| {
                let owner = self.chart[i];
                owner != NONE && set[owner as usize] != set[face.chart as usize]
            };
            // Moved on by half a texel, so that nothing is negative: cell i reads the texels i − 1 and i.
            touched(grid.map(|p| p.map(|x| x + half)), bits, |y, from, to| {
                let mut rows = y.saturating_sub(1)..=y;
                mixed[face.chart as usize] |= rows.any(|y| self.texels(y, from.saturating_sub(1), to).any(foreign));
            });
        }
        mixed
    }
}

#[cfg(test)]
mod tests {
    use super::super::align::Face;
    use super::super::shape::shape;
    use super::*;
    use glam::DVec2;

    const BITS: u32 = 12;

    /// Charts of a square each, by their lower corners and edges [texels], and how many of them are mixed.
    fn mixed_squares(squares: &[([f64; 2], f64)]) -> usize {
        let (mut faces, mut corners) = (vec![], vec![]);
        for (chart, ([x, y], edge)) in (0..).zip(squares) {
            let at = |dx: f64, dy: f64| DVec2::new(x + dx * edge, y + dy * edge);
            for (triangle, c) in
                [[(0.0, 0.0), (1.0, 0.0), (1.0, 1.0)], [(0.0, 0.0), (1.0, 1.0), (0.0, 1.0)]].iter().enumerate()
            {
                faces.push(Face { part: 0, triangle: triangle as u32, chart });
                corners.push(c.map(|(dx, dy)| at(dx, dy)));
            }
        }
        let parts = vec![0; squares.len()];
        let piece = Piece { owners: [vec![0]].into(), parts, faces, corners, page: Some(DVec2::splat(32.0)) };
        let shape = shape(&piece, 1.0, BITS);
        let mut touched = Touched::new(&piece, &shape, BITS);
        let set = touched.sets.numbers();
        touched.mixed(&piece, &shape, BITS, &set).into_iter().filter(|mixed| *mixed).count()
    }

    /// Two squares in a frame of 32 texels, so that nothing moves, `gap` texels apart from column 10.25 on.
    fn mixed_at(gap: f64) -> usize {
        let corner = |at: f64| ([at, at], 1.0);
        mixed_squares(&[corner(0.0), corner(31.0), ([4.25, 8.0], 6.0), ([10.25 + gap, 8.0], 6.0)])
    }

    #[test]
    fn look_ups_read_half_a_texel_beyond_their_chart() {
        // At 10.25 they read the texels 9 and 10; at 10.25 + 0.8 = 11.05, 10 and 11, and at 11.55, 11 and 12.
        assert_eq!(mixed_at(0.8), 1);
        assert_eq!(mixed_at(1.3), 0);
        assert_eq!(mixed_at(4.0), 0);
        // Side by side in one row of texels.
        assert_eq!(mixed_squares(&[([0.0, 0.0], 2.0), ([2.0, 0.0], 2.0)]), 2);
        assert_eq!(mixed_squares(&[([0.0, 0.0], 2.0), ([3.0, 3.0], 2.0)]), 0);
    }

    #[test]
    fn charts_that_share_texels_are_one() {
        assert_eq!(mixed_at(0.5), 0);
    }
}
