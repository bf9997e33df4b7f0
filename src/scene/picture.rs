//! A texture of colours as a pyramid: what squares of its texels add up to, and the brightest of them.
//!
//! In: a [`Texture`]. Out: [`Picture`]; `peaks` asks it for bounds over triangles of coordinates, `means` for means.
//!
//! Squares of 4 × 4 texels and more are kept, a byte for each texel; smaller ones are read from the texture, which would
//! otherwise be there four times. A picture of 4096² takes 0.05 s on two threads.

use super::texture::{SRGB_TO_LINEAR, Texture};
use crate::base::parallel;
use glam::{DVec2, Vec2, Vec3};

/// Level of the smallest squares that are kept: they have 2² texels per side.
const KEPT: usize = 2;
/// Squares per side at which a look at a triangle begins.
const FIRST: usize = 3;

/// A texture with its pyramid.
#[derive(Debug)]
pub struct Picture<'a> {
    pub(super) texture: &'a Texture,
    /// From [`KEPT`] on to a single square.
    levels: Vec<Level>,
}

#[derive(Debug)]
struct Level {
    width: usize,
    cells: Vec<Cell>,
}

/// A square of texels.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Cell {
    /// Of its texels, linear.
    pub(super) sum: Vec3,
    /// The brightest channel, encoded.
    pub(super) most: u8,
}

/// Column and row of a square, in squares of its level.
pub(super) type Place = [usize; 2];

impl Cell {
    fn texel([r, g, b, _]: [u8; 4]) -> Self {
        let sum = Vec3::from_array([r, g, b].map(|c| SRGB_TO_LINEAR[usize::from(c)]));
        Self { sum, most: r.max(g).max(b) }
    }

    fn with(self, other: Self) -> Self {
        Self { sum: self.sum + other.sum, most: self.most.max(other.most) }
    }
}

impl<'a> Picture<'a> {
    /// Reads a texture.
    #[must_use]
    pub fn new(texture: &'a Texture) -> Self {
        let (width, height) = (texture.width as usize, texture.height as usize);
        let side = 1 << KEPT;
        let columns = width.div_ceil(side);
        let row = |j: usize| {
            let mut cells = vec![Cell::default(); columns];
            for y in j * side..height.min((j + 1) * side) {
                for (cell, texels) in cells.iter_mut().zip(texture.pixels[y * width..][..width].chunks(side)) {
                    *cell = texels.iter().fold(*cell, |cell, &texel| cell.with(Cell::texel(texel)));
                }
            }
            cells
        };
        let rows = parallel::map(height.div_ceil(side), row);
        let mut levels = vec![Level { width: columns, cells: rows.concat() }];
        while let Some(last) = levels.last().filter(|l| l.cells.len() > 1) {
            levels.push(last.coarser());
        }
        Self { texture, levels }
    }

    /// Width and height [texels].
    pub(super) fn size(&self) -> [usize; 2] {
        [self.texture.width as usize, self.texture.height as usize]
    }

    /// Coordinates in texels from the picture's corner.
    pub(super) fn in_texels(&self, uvs: [Vec2; 3]) -> [DVec2; 3] {
        uvs.map(|uv| uv.as_dvec2() * DVec2::from_array(self.size().map(|n| n as f64)))
    }

    /// All of it.
    pub(super) fn whole(&self) -> Cell {
        self.levels.last().map_or(Cell::default(), |l| l.cells[0])
    }

    /// A square of 2^`level` texels per side.
    pub(super) fn cell(&self, level: usize, [x, y]: Place) -> Cell {
        if level >= KEPT {
            let level = &self.levels[(level - KEPT).min(self.levels.len() - 1)];
            return level.cells[y * level.width + x];
        }
        let [[left, right], [top, bottom]] = self.span(level, [x, y]);
        let row = |y: usize| &self.texture.pixels[y * self.size()[0]..][left..right];
        let texels = (top..bottom).flat_map(row);
        texels.fold(Cell::default(), |cell, &texel| cell.with(Cell::texel(texel)))
    }

    /// The brightest channel of a square, encoded.
    pub(super) fn brightest(&self, level: usize, place: Place) -> u8 {
        if level >= KEPT {
            return self.cell(level, place).most;
        }
        let [[left, right], [top, bottom]] = self.span(level, place);
        let row = |y: usize| &self.texture.pixels[y * self.size()[0]..][left..right];
        (top..bottom).flat_map(row).fold(0, |most, &[r, g, b, _]| most.max(r).max(g).max(b))
    }

    /// First texel of a square, and the one after its last, by axis.
    pub(super) fn span(&self, level: usize, place: Place) -> [[usize; 2]; 2] {
        let size = self.size();
        [0, 1].map(|axis| [place[axis] << level, ((place[axis] + 1) << level).min(size[axis])])
    }

    /// The same as points.
    pub(super) fn bounds(&self, level: usize, place: Place) -> [DVec2; 2] {
        let [x, y] = self.span(level, place);
        [0, 1].map(|end| DVec2::new(x[end] as f64, y[end] as f64))
    }

    /// The squares of the next finer level in one.
    pub(super) fn quarters(&self, level: usize, place: Place) -> impl Iterator<Item = Place> {
        let size = self.size();
        let [x, y] = place.map(|p| 2 * p);
        let all = [[x, y], [x + 1, y], [x, y + 1], [x + 1, y + 1]];
        all.into_iter().filter(move |p| p[0] << (level - 1) < size[0] && p[1] << (level - 1) < size[1])
    }

    /// A few squares that cover all that the picture has between two points, and their level; none where it has nothing.
    pub(super) fn cover(&self, low: DVec2, high: DVec2) -> (usize, Vec<Place>) {
        let size = self.size();
        if low.x >= size[0] as f64 || low.y >= size[1] as f64 || high.min_element() < 0.0 {
            return (0, vec![]);
        }
        let texel = |v: f64, axis: usize| (v.max(0.0) as usize).min(size[axis] - 1);
        let ranges = [0, 1].map(|axis| (texel(low[axis], axis), texel(high[axis], axis)));
        let few = |&level: &usize| ranges.iter().all(|(a, b)| (b >> level) - (a >> level) < FIRST);
        let level = (0..self.levels.len() + KEPT).find(few).unwrap_or(self.levels.len() + KEPT - 1);
        let [columns, rows] = ranges.map(|(a, b)| a >> level..=b >> level);
        (level, rows.flat_map(|y| columns.clone().map(move |x| [x, y])).collect())
    }
}

impl Level {
    fn coarser(&self) -> Self {
        let height = self.cells.len() / self.width;
        let width = self.width.div_ceil(2);
        let mut cells = vec![Cell::default(); width * height.div_ceil(2)];
        for (k, &cell) in self.cells.iter().enumerate() {
            let to = &mut cells[k / self.width / 2 * width + k % self.width / 2];
            *to = to.with(cell);
        }
        Self { width, cells }
    }
}

/// How a rectangle lies to a triangle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Overlap {
    Outside,
    Across,
    Inside,
}

/// A triangle on a picture [texels], with its edges.
#[derive(Debug)]
pub(super) struct Outline {
    pub(super) corners: [DVec2; 3],
    pub(super) low: DVec2,
    pub(super) high: DVec2,
    /// Toward its inside, by edge; zero without area.
    inward: [DVec2; 3],
}

impl Outline {
    pub(super) fn new(corners: [DVec2; 3]) -> Self {
        let [a, b, c] = corners;
        let area = (b - a).perp_dot(c - a);
        let side = if area == 0.0 { 0.0 } else { area.signum() };
        let inward = [b - a, c - b, a - c].map(|edge| edge.perp() * side);
        Self { corners, low: a.min(b).min(c), high: a.max(b).max(c), inward }
    }

    /// Of the rectangle between two points.
    pub(super) fn overlap(&self, low: DVec2, high: DVec2) -> Overlap {
        if low.cmpgt(self.high).any() || high.cmplt(self.low).any() {
            return Overlap::Outside;
        }
        let mut inside = self.inward[0] != DVec2::ZERO;
        for (corner, n) in self.corners.iter().zip(self.inward) {
            let (a, b) = ((low - *corner) * n, (high - *corner) * n);
            if a.max(b).element_sum() < 0.0 {
                return Overlap::Outside;
            }
            inside &= a.min(b).element_sum() >= 0.0;
        }
        if inside { Overlap::Inside } else { Overlap::Across }
    }
}
