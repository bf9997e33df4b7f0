//! A piece at its density: corners on a fixed-point texel grid, and the texels that it touches.
//!
//! A texel is touched if it shares more than a border with a triangle (the triangle's inside, or the segment it
//! collapses to). The spans are exact: integer coordinates, crossings of texel rows rounded outwards by less than one
//! grid step.
//!
//! Sides within [`SNAP`] of a whole number of texels are stretched to it, so that a wall of 3 m at 10 texels/m covers
//! 30 texels and not 31; other pieces are centred on the texels they need. Of kept layouts the page is stretched instead,
//! to whole blocks of texels, and what lies on it keeps its place on the grid: what was made for it stays on whole texels,
//! and as far apart. At other densities small ones are better off centred: objects of a room at half the density of their
//! layouts touch 48,926 texels instead of 53,024.

use super::align::Piece;
use glam::DVec2;

/// Largest change of a side for the sake of whole texels, as a fraction. Twice this stays below 0.1 % of area.
const SNAP: f64 = 3e-4;

/// Texels along a side of a block of compressed textures.
pub(super) const BLOCK: u32 = 4;

/// Share of the texels that a layout touches on its page, below which it is better off it.
const FEWER: f64 = 0.98;

/// Largest change of a side of a page for the sake of whole blocks, or whole texels, as a fraction.
const PAGE_SNAP: f64 = 0.01;

/// A piece at its density.
#[derive(Debug, Clone)]
pub(super) struct Shape {
    /// Corner positions relative to the shape [2^−bits texels].
    pub(super) grid: Vec<[[i32; 2]; 3]>,
    /// Texels touched.
    pub(super) footprint: Footprint,
    /// Of kept layouts that lie on their own page, the place of the first texel there.
    pub(super) first: Option<[i32; 2]>,
}

/// Touched texels of a shape as runs per row.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(super) struct Footprint {
    /// Width [texels].
    pub(super) width: u32,
    /// Height [texels].
    pub(super) height: u32,
    /// Index of the first run of each row, and the number of runs at the end.
    starts: Vec<u32>,
    /// Runs [from, to) of touched texels.
    runs: Vec<(u32, u32)>,
    /// Number of touched texels.
    pub(super) texels: u64,
}

impl Footprint {
    /// Runs [from, to) of a row.
    pub(super) fn row(&self, y: u32) -> &[(u32, u32)] {
        let range = self.starts[y as usize] as usize..self.starts[y as usize + 1] as usize;
        &self.runs[range]
    }

    fn new(width: u32, height: u32, grid: &[[[i32; 2]; 3]], bits: u32) -> Self {
        let mut map = BitMap::new(width, height);
        for triangle in grid {
            touched(*triangle, bits, |y, from, to| map.set(y, from, to));
        }
        Self::of(&map, width, height)
    }

    /// The bits of a map of this size.
    pub(super) fn of(map: &BitMap, width: u32, height: u32) -> Self {
        let mut footprint = Self { width, height, starts: vec![0], runs: Vec::new(), texels: 0 };
        for y in 0..height {
            footprint.runs.extend(map.runs(y));
            footprint.starts.push(footprint.runs.len() as u32);
        }
        footprint.texels = footprint.runs.iter().map(|(from, to)| u64::from(to - from)).sum();
        footprint
    }
}

/// Bits of the fraction of a texel that leave every coordinate on a page exact in `f32`.
pub(super) fn fraction_bits(page_size: u32) -> u32 {
    24 - page_size.next_power_of_two().trailing_zeros().min(20)
}

/// Width and height of a piece [m].
pub(super) fn extent(piece: &Piece) -> (DVec2, DVec2) {
    let low = piece.corners.iter().flatten().fold(DVec2::INFINITY, |a, p| a.min(*p));
    let high = piece.corners.iter().flatten().fold(DVec2::NEG_INFINITY, |a, p| a.max(*p));
    (low, high)
}

/// Scales a piece to `density` [texels/m] and rasterises it. A kept layout is laid on its page, unless it is made for another
/// density and touches fewer texels if it is centred on those that it needs.
pub(super) fn shape(piece: &Piece, density: f64, bits: u32) -> Shape {
    let (low, high) = extent(piece);
    let snap = if piece.page.is_none() { SNAP } else { 0.0 };
    let centred = || rasterised(piece, [0, 1].map(|k| Axis::of_chart([low[k], high[k]], density, snap)), bits);
    let Some(page) = piece.page else { return centred() };
    let (kept, centred) = (shape_on_page(piece, page, density, bits), centred());
    let [before, after] = [&kept, &centred].map(|shape| shape.footprint.texels as f64);
    if after < FEWER * before { centred } else { kept }
}

/// The same where a layout lies on its page.
pub(super) fn shape_on_page(piece: &Piece, page: DVec2, density: f64, bits: u32) -> Shape {
    let (low, high) = extent(piece);
    let steps = f64::from(1u32 << bits);
    let axes = [0, 1].map(|k| Axis::of_page(page[k], [low[k], high[k]], density, steps));
    let first = Some([0, 1].map(|k: usize| -axes[k].margin as i32));
    Shape { first, ..rasterised(piece, axes, bits) }
}

fn rasterised(piece: &Piece, axes: [Axis; 2], bits: u32) -> Shape {
    let steps = f64::from(1u32 << bits);
    let round = |p: f64, axis: &Axis| {
        let step = (((p - axis.low) * axis.factor + axis.margin) * steps).round();
        step.clamp(0.0, f64::from(axis.texels) * steps) as i32
    };
    let [x, y] = &axes;
    let grid: Vec<[[i32; 2]; 3]> = piece.corners.iter().map(|c| c.map(|p| [round(p.x, x), round(p.y, y)])).collect();
    let footprint = Footprint::new(x.texels, y.texels, &grid, bits);
    Shape { grid, footprint, first: None }
}

/// How positions along an axis become texels.
struct Axis {
    /// Position [m] that lies at `margin`.
    low: f64,
    /// Texels per metre.
    factor: f64,
    /// Place of `low` [texels].
    margin: f64,
    /// Length [texels].
    texels: u32,
}

impl Axis {
    /// Of what lies between `low` and `high`; stretched by up to `snap` to whole texels.
    fn of_chart([low, high]: [f64; 2], density: f64, snap: f64) -> Self {
        let size = (high - low) * density;
        let whole = size.round();
        let snaps = whole >= 1.0 && (size - whole).abs() <= snap * whole;
        let (factor, size) = if snaps { (whole / size, whole) } else { (1.0, size) };
        let texels = size.ceil().max(1.0);
        Self { low, factor: factor * density, margin: 0.5 * (texels - size), texels: texels as u32 }
    }

    /// Of what lies between `low` and `high` on a page with a side of this length. Places are rounded to the grid before
    /// they are to whole texels: 2 texels of 276 become 2.00002 by way of a coordinate in `f32`.
    fn of_page(side: f64, [low, high]: [f64; 2], density: f64, steps: f64) -> Self {
        let factor = whole_side(side * density) / side;
        let on_grid = |p: f64| (p * factor * steps).round() / steps;
        let (first, end) = (on_grid(low).floor(), on_grid(high).ceil());
        Self { low: 0.0, factor, margin: -first, texels: (end - first).max(1.0) as u32 }
    }
}

/// The side of a page [texels] in whole blocks of [`BLOCK`] texels if that changes it little, else in whole texels, else as
/// it is.
pub(super) fn whole_side(side: f64) -> f64 {
    let near = |step: f64| Some((side / step).round() * step).filter(|w| (w - side).abs() <= PAGE_SNAP * side);
    near(f64::from(BLOCK)).or_else(|| near(1.0)).unwrap_or(side)
}

/// Calls `visit(row, from, to)` for the touched texels of each row of a triangle.
pub(super) fn touched(triangle: [[i32; 2]; 3], bits: u32, mut visit: impl FnMut(u32, u32, u32)) {
    let p = triangle.map(|p| p.map(i64::from));
    let one = 1i64 << bits;
    let last_texel = |low: i64, high: i64| (low >> bits).max(((high + one - 1) >> bits) - 1);
    let low = p[0][1].min(p[1][1]).min(p[2][1]);
    let high = p[0][1].max(p[1][1]).max(p[2][1]);
    for row in (low >> bits)..=last_texel(low, high) {
        let (y0, y1) = (row * one, (row + 1) * one);
        let (mut from, mut to) = (i64::MAX, i64::MIN);
        for k in 0..3 {
            let (a, b) = (p[k], p[(k + 1) % 3]);
            if (y0..=y1).contains(&a[1]) {
                from = from.min(a[0]);
                to = to.max(a[0]);
            }
            for y in [y0, y1] {
                if (a[1] < y && b[1] > y) || (b[1] < y && a[1] > y) {
                    let dy = (b[1] - a[1]).abs();
                    let numerator = (b[0] - a[0]) * (y - a[1]) * (b[1] - a[1]).signum();
                    from = from.min(a[0] + numerator.div_euclid(dy));
                    to = to.max(a[0] - (-numerator).div_euclid(dy));
                }
            }
        }
        if from <= to {
            visit(row as u32, (from >> bits) as u32, last_texel(from, to) as u32 + 1);
        }
    }
}

/// Rows of bits.
#[derive(Debug, Clone)]
pub(super) struct BitMap {
    /// Words per row.
    pub(super) stride: usize,
    /// All rows; bit x of a row is bit x % 64 of word x / 64.
    pub(super) words: Vec<u64>,
    width: u32,
}

impl BitMap {
    /// An empty map.
    pub(super) fn new(width: u32, height: u32) -> Self {
        let stride = (width as usize).div_ceil(64);
        Self { stride, words: vec![0; stride * height as usize], width }
    }

    /// Words of a row.
    pub(super) fn row(&self, y: u32) -> &[u64] {
        &self.words[y as usize * self.stride..(y as usize + 1) * self.stride]
    }

    /// Sets the bits [from, to) of a row, as far as they lie on the map.
    pub(super) fn set(&mut self, y: u32, from: u32, to: u32) {
        let to = to.min(self.width);
        // A needle without height on the grid may lie on the last border.
        if from >= to || (y as usize + 1) * self.stride > self.words.len() {
            return;
        }
        let row = &mut self.words[y as usize * self.stride..(y as usize + 1) * self.stride];
        let (first, last) = (from as usize / 64, (to as usize - 1) / 64);
        let head = !0u64 << (from % 64);
        let tail = !0u64 >> (63 - (to - 1) % 64);
        if first == last {
            row[first] |= head & tail;
        } else {
            row[first] |= head;
            row[first + 1..last].fill(!0);
            row[last] |= tail;
        }
    }

    /// Whether any of the bits [from, to) of a row is set, as far as it lies on the map.
    pub(super) fn any(&self, y: u32, from: u32, to: u32) -> bool {
        y as usize * self.stride < self.words.len() && next(self.row(y), from, to, 0).is_some()
    }

    /// Runs [from, to) of set bits of a row.
    pub(super) fn runs(&self, y: u32) -> Vec<(u32, u32)> {
        let row = self.row(y);
        let mut runs = Vec::new();
        let mut x = 0;
        while let Some(from) = next(row, x, self.width, 0) {
            let to = next(row, from, self.width, !0).unwrap_or(self.width);
            runs.push((from, to));
            x = to;
        }
        runs
    }

    /// Length of the longest run of clear bits of a row.
    pub(super) fn longest_gap(&self, y: u32) -> u32 {
        let row = self.row(y);
        let (mut longest, mut x) = (0, 0);
        while let Some(from) = next(row, x, self.width, !0) {
            let to = next(row, from, self.width, 0).unwrap_or(self.width);
            longest = longest.max(to - from);
            x = to;
        }
        longest
    }
}

/// First set bit at or after x of the row XOR `invert`, below the width.
fn next(row: &[u64], x: u32, width: u32, invert: u64) -> Option<u32> {
    let mut word = x as usize / 64;
    let mut bits = (*row.get(word)? ^ invert) & (!0u64 << (x % 64));
    while bits == 0 {
        word += 1;
        bits = *row.get(word)? ^ invert;
    }
    let found = word as u32 * 64 + bits.trailing_zeros();
    (found < width).then_some(found)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::Stream;
    use crate::base::random::Stage;

    /// Does the inside of a triangle meet a texel? By clipping in doubles.
    fn meets(triangle: [DVec2; 3], x: u32, y: u32) -> bool {
        let mut polygon = triangle.to_vec();
        let (low, high) = (DVec2::new(f64::from(x), f64::from(y)), DVec2::new(f64::from(x + 1), f64::from(y + 1)));
        for (axis, sign, limit) in [(0, 1.0, low.x), (0, -1.0, -high.x), (1, 1.0, low.y), (1, -1.0, -high.y)] {
            let inside = |p: DVec2| sign * p[axis] - limit;
            let mut clipped = Vec::new();
            for i in 0..polygon.len() {
                let (a, b) = (polygon[i], polygon[(i + 1) % polygon.len()]);
                if inside(a) >= 0.0 {
                    clipped.push(a);
                }
                if inside(a) * inside(b) < 0.0 {
                    clipped.push(a + (b - a) * (inside(a) / (inside(a) - inside(b))));
                }
            }
            polygon = clipped;
        }
        let area: f64 = (0..polygon.len()).map(|i| polygon[i].perp_dot(polygon[(i + 1) % polygon.len()])).sum();
        area.abs() > 1e-9
    }

    #[test]
    fn touched_texels_are_those_that_clipping_finds() {
        let mut random = Stream::new(1, Stage::Render, 0, 0);
        for _ in 0..500 {
            let mut point = || [0, 0].map(|_: i32| (random.next_u32() % (12 * 256)) as i32);
            let triangle = [point(), point(), point()];
            let mut found = std::collections::BTreeSet::new();
            touched(triangle, 8, |y, from, to| found.extend((from..to).map(|x| (x, y))));
            let exact = triangle.map(|p| DVec2::new(f64::from(p[0]), f64::from(p[1])) / 256.0);
            for y in 0..13 {
                for x in 0..13 {
                    let (is, should) = (found.contains(&(x, y)), meets(exact, x, y));
                    // Crossings are rounded outwards by one step, so a texel may be touched by less than 1/256.
                    assert!(is || !should, "{triangle:?} misses {x} {y}");
                    if is && !should {
                        let wider = exact.map(|p| p + (p - (exact[0] + exact[1] + exact[2]) / 3.0) * 0.1);
                        assert!(meets(wider, x, y), "{triangle:?} has {x} {y}");
                    }
                }
            }
        }
    }

    #[test]
    fn a_rectangle_on_the_grid_touches_no_more_than_itself() {
        let mut count = 0;
        touched([[0, 0], [1024, 0], [0, 512]], 8, |_, from, to| count += to - from);
        touched([[1024, 0], [1024, 512], [0, 512]], 8, |_, from, to| count += to - from);
        assert!((8..=12).contains(&count));
        touched([[256, 256], [256, 256], [256, 256]], 8, |y, from, to| assert_eq!((y, from, to), (1, 1, 2)));
    }

    #[test]
    fn bit_maps_find_runs_and_gaps() {
        let mut map = BitMap::new(200, 2);
        map.set(1, 10, 70);
        map.set(1, 128, 300);
        assert_eq!(map.runs(1), [(10, 70), (128, 200)]);
        assert_eq!(map.longest_gap(1), 58);
        assert_eq!((map.longest_gap(0), map.runs(0).len()), (200, 0));
        assert_eq!(
            [(0, 10), (0, 11), (69, 90), (70, 128), (199, 200)].map(|(a, b)| map.any(1, a, b)),
            [false, true, true, false, true]
        );
    }
}
