//! Upper bounds of a texture over triangles of its coordinates.
//!
//! In: a [`Texture`]. Out: for three coordinates, a value that no channel of a look-up in their triangle exceeds; 0 only
//! where all of them are black.
//!
//! The brightest channel of 4 × 4 texels, then of 2 × 2 of these, and so on; a look-up reads at most 4 × 4 cells for
//! each of up to four rectangles that the bounds of the triangle become where the texture repeats.
//!
//! Limit: bounds of the triangle count, not the triangle, and cells that reach over them: what is black a few texels away
//! from something bright may be taken for bright.

use super::texture::{SRGB_TO_LINEAR, Texture, Wrap};
use glam::Vec2;

/// Texels per side of the finest cells.
const CELL: usize = 4;
/// Cells per side and rectangle up to which a level is read.
const MOST_CELLS: usize = 4;
/// Rounding of coordinates, as a share of the largest: triangles interpolate theirs in single precision.
const ROUNDING: f64 = 1e-6;

/// The brightest channels of a texture's parts.
#[derive(Debug)]
pub struct Peaks {
    size: [usize; 2],
    wrap: [Wrap; 2],
    /// From the finest to a single cell.
    levels: Vec<Level>,
}

#[derive(Debug)]
struct Level {
    width: usize,
    height: usize,
    /// Encoded as in the texture, row by row.
    cells: Vec<u8>,
}

/// First and last texel of a range.
type Range = (usize, usize);

impl Level {
    /// The brightest of `n` × `n` values of a picture, for each of its squares of that size.
    fn new([width, height]: [usize; 2], n: usize, value: impl Fn(usize, usize) -> u8) -> Self {
        let mut level = Self { width: width.div_ceil(n), height: height.div_ceil(n), cells: vec![] };
        level.cells.resize(level.width * level.height, 0);
        for y in 0..height {
            let row = &mut level.cells[y / n * level.width..][..level.width];
            for x in 0..width {
                row[x / n] = row[x / n].max(value(x, y));
            }
        }
        level
    }

    fn coarser(&self) -> Self {
        Self::new([self.width, self.height], 2, |x, y| self.cells[y * self.width + x])
    }
}

impl Peaks {
    /// Bounds of a texture, a fifteenth of its memory.
    #[must_use]
    pub fn new(texture: &Texture) -> Self {
        let size = [texture.width as usize, texture.height as usize];
        let brightest = |p: [u8; 4]| p[0].max(p[1]).max(p[2]);
        let mut levels = vec![Level::new(size, CELL, |x, y| brightest(texture.pixels[y * size[0] + x]))];
        while let Some(last) = levels.last().filter(|l| l.cells.len() > 1) {
            levels.push(last.coarser());
        }
        Self { size, wrap: texture.wrap, levels }
    }

    /// No channel of [`Texture::sample_srgb`] in a triangle of coordinates is larger, whatever its filter.
    #[must_use]
    pub fn most(&self, triangle: [Vec2; 3]) -> f32 {
        let [columns, rows] = [0, 1].map(|axis| self.read(axis, triangle.map(|t| f64::from(t[axis]))));
        let all = columns.iter().flatten().flat_map(|&c| rows.iter().flatten().map(move |&r| self.brightest(c, r)));
        SRGB_TO_LINEAR[usize::from(all.fold(0, u8::max))]
    }

    /// Texels that look-ups between coordinates on an axis may read.
    fn read(&self, axis: usize, t: [f64; 3]) -> [Option<Range>; 2] {
        let size = self.size[axis] as i64;
        let (low, high) = t.iter().fold((f64::MAX, f64::MIN), |(l, h), &v| (l.min(v), h.max(v)));
        let margin = 1.0 + ROUNDING * low.abs().max(high.abs()) * size as f64;
        let first = (low * size as f64 - 0.5 - margin).floor();
        let last = (high * size as f64 - 0.5 + margin).floor() + 1.0;
        let all = [Some((0, size as usize - 1)), None];
        if !t.iter().all(|t| t.is_finite()) || last - first >= size as f64 || first.abs() > 1e15 {
            return all;
        }
        let (first, last) = (first as i64, last as i64);
        let [a, b] = [first, last].map(|i| self.fold(axis, i));
        let is_split = first.div_euclid(size) != last.div_euclid(size);
        match self.wrap[axis] {
            Wrap::Repeat if is_split => [Some((0, b)), Some((a, size as usize - 1))],
            // Turning back at one end, both sides of it show the same texels.
            Wrap::Mirror if is_split && last.div_euclid(size) % 2 == 0 => [Some((0, a.max(b))), None],
            Wrap::Mirror if is_split => [Some((a.min(b), size as usize - 1)), None],
            _ => [Some((a.min(b), a.max(b))), None],
        }
    }

    /// The texel that stands for one on an endless axis.
    fn fold(&self, axis: usize, i: i64) -> usize {
        let size = self.size[axis] as i64;
        let (tile, inside) = (i.div_euclid(size), i.rem_euclid(size));
        let folded = match self.wrap[axis] {
            Wrap::Clamp => i.clamp(0, size - 1),
            Wrap::Mirror if tile.rem_euclid(2) == 1 => size - 1 - inside,
            Wrap::Mirror | Wrap::Repeat => inside,
        };
        folded as usize
    }

    /// The brightest channel of a rectangle of texels, or of a little more.
    fn brightest(&self, columns: Range, rows: Range) -> u8 {
        let cells = |(first, last): Range, level: usize| ((first / CELL) >> level, (last / CELL) >> level);
        let few = |range: Range, level: usize| cells(range, level).1 - cells(range, level).0 < MOST_CELLS;
        let fits = |&l: &usize| few(columns, l) && few(rows, l);
        let level = (0..self.levels.len()).find(fits).unwrap_or(self.levels.len() - 1);
        let (c, r) = (cells(columns, level), cells(rows, level));
        let Level { width, cells, .. } = &self.levels[level];
        let rows = (r.0..=r.1).map(|y| &cells[y * width..][c.0..=c.1]);
        rows.flatten().copied().fold(0, u8::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::{Stage, Stream};
    use crate::base::warp;

    const WRAPS: [Wrap; 3] = [Wrap::Repeat, Wrap::Mirror, Wrap::Clamp];

    fn below(stream: &mut Stream, n: u32) -> u32 {
        stream.next_u32() % n
    }

    /// Black but for a few texels.
    fn lamps(stream: &mut Stream, nearest: bool) -> Texture {
        let (width, height) = (1 + below(stream, 70), 1 + below(stream, 50));
        let mut pixels = vec![[0, 0, 0, 255]; (width * height) as usize];
        for _ in 0..1 + below(stream, 3) {
            let k = below(stream, width * height) as usize;
            pixels[k] = [0, below(stream, 256) as u8, 40, 255];
        }
        let wrap = [WRAPS[below(stream, 3) as usize], WRAPS[below(stream, 3) as usize]];
        Texture { width, height, pixels, wrap, nearest }
    }

    #[test]
    fn no_look_up_in_a_triangle_is_brighter() {
        let mut stream = Stream::new(7, Stage::Walk, 0, 0);
        let (mut black, mut tight) = (0, 0);
        for k in 0..4_000 {
            let texture = lamps(&mut stream, k % 2 == 0);
            let peaks = Peaks::new(&texture);
            let at = Vec2::new(stream.next_f32(), stream.next_f32()) * 8.0 - 4.0;
            let reach = [0.02, 0.3, 3.0][k % 3];
            let corner = |s: &mut Stream| at + (Vec2::new(s.next_f32(), s.next_f32()) - 0.5) * reach;
            let triangle = [corner(&mut stream), corner(&mut stream), corner(&mut stream)];
            let most = peaks.most(triangle);
            let mut found = 0.0f32;
            for _ in 0..200 {
                let b = warp::square_to_triangle(Vec2::new(stream.next_f32(), stream.next_f32()));
                let [p, q, r] = triangle;
                found = found.max(texture.sample_srgb(p + (q - p) * b.x + (r - p) * b.y).truncate().max_element());
            }
            assert!(found <= most * 1.000_001, "{found} above {most}");
            black += usize::from(most == 0.0);
            tight += usize::from(found > 0.0);
        }
        // A bound that says nothing would pass the above.
        assert!(black > 1_000 && tight > 400, "{black} black, {tight} not");
    }

    #[test]
    fn what_is_not_finite_or_spans_all_has_the_bound_of_the_whole() {
        let pixels = (0..1024u32).map(|k| [(k / 32) as u8 * 8, 0, 0, 255]).collect();
        let texture = Texture { width: 32, height: 32, pixels, wrap: [Wrap::Repeat; 2], nearest: true };
        let peaks = Peaks::new(&texture);
        let whole = SRGB_TO_LINEAR[31 * 8];
        for far in [f32::NAN, f32::INFINITY, f32::MAX, 1e12, 5.0] {
            assert_eq!(peaks.most([Vec2::ZERO, Vec2::splat(far), Vec2::ZERO]), whole, "{far}");
        }
        assert!(peaks.most([Vec2::splat(0.3); 3]) <= SRGB_TO_LINEAR[15 * 8]);
    }
}
