//! Means of a texture over triangles of its coordinates.
//!
//! In: a [`Picture`]. Out: for three coordinates, the mean of all look-ups in their triangle.
//!
//! Of all texels in it, not of points: a lamp of one texel in a black picture of 2048² has its light. Squares that lie in
//! the triangle are taken whole, those across its edges go on to their quarters, down to texels, which count by the area
//! that they have in it; black ones end at once. Bounded work: where more than `most` squares lie across the edges, each
//! counts as if it were even.
//!
//! A bilinear look-up is the mean of plain ones over a square of one texel around its point. So narrow triangles are
//! moved to points of that square, unless there is work for few squares only; of wide ones little goes over the edges, and
//! what one of them loses its neighbour has. Within a texel or two a few look-ups say more than moved triangles, and are
//! left to whoever asks.
//!
//! Source of the cut of a triangle: I. Sutherland, G. Hodgman, "Reentrant Polygon Clipping", 1974.

use super::picture::{Outline, Overlap, Picture};
use super::texture::Wrap;
use glam::{DVec2, DVec3, Vec2, Vec3};

/// Area of a triangle below which it has no inside that is worth a mean [texels²].
const LEAST_AREA: f64 = 1e-4;
/// Longest edge of a triangle up to which bilinear look-ups are left to others [texels].
const SHORT: f64 = 2.0;
/// Heights of a triangle up to which it is moved for bilinear look-ups, to points on each axis [texels]: those of Gauss'
/// rule of third degree, or the middles of quarters.
const NARROW: f64 = 16.0;
const VERY_NARROW: f64 = 4.0;
const GAUSS: [f64; 2] = [-0.288_675_134_594_812_9, 0.288_675_134_594_812_9];
const QUARTERS: [f64; 4] = [-0.375, -0.125, 0.125, 0.375];
/// Squares for which there must be work if triangles are to be moved.
const LEAST_MOVED: usize = 256;
/// Repetitions of the picture in a triangle up to which they are looked at.
const MOST_TILES: usize = 64;
/// Squares across the edges of a part that are always looked at: those that it begins with, and more.
const LEAST_CELLS: usize = 16;
/// Corners of a triangle that a rectangle cut, at most, and one more.
const MOST_CORNERS: usize = 8;

/// A convex polygon.
#[derive(Debug, Clone, Copy, Default)]
struct Polygon {
    corners: [DVec2; MOST_CORNERS],
    count: usize,
}

/// A stretch of an axis on which the picture is laid out in one way [texels].
#[derive(Debug, Clone, Copy)]
struct Stretch {
    low: f64,
    high: f64,
    /// The picture has v as `to` + (v − `from`) · `factor`.
    from: f64,
    factor: f64,
    to: f64,
}

impl Picture<'_> {
    /// Mean of all of it, linear.
    #[must_use]
    pub fn mean(&self) -> Vec3 {
        let [width, height] = self.size();
        (self.whole().sum.as_dvec3() / (width * height) as f64).as_vec3()
    }

    /// Mean of [`Texture::sample_srgb`](super::Texture::sample_srgb) over a triangle of coordinates, alpha left out; `None`
    /// where a few points say it as well.
    #[must_use]
    pub fn mean_over(&self, uvs: [Vec2; 3], most: usize) -> Option<Vec3> {
        let corners = self.in_texels(uvs);
        let area = 0.5 * (corners[1] - corners[0]).perp_dot(corners[2] - corners[0]).abs();
        if !(area > LEAST_AREA && area.is_finite()) {
            return None;
        }
        let longest = [0, 1, 2].map(|k| corners[k].distance(corners[(k + 1) % 3])).into_iter().fold(0.0, f64::max);
        let height = 2.0 * area / longest;
        let shifts: &[f64] = match () {
            () if self.texture.nearest => &[0.0],
            () if longest < SHORT => return None,
            () if height > NARROW || most < LEAST_MOVED => &[0.0],
            () if height > VERY_NARROW => &GAUSS,
            () => &QUARTERS,
        };
        let mut sum = DVec3::ZERO;
        for shift in shifts.iter().flat_map(|&x| shifts.iter().map(move |&y| DVec2::new(x, y))) {
            match self.laid_out(corners.map(|c| c + shift)) {
                Some(parts) => {
                    let most = (most / parts.len().max(1) / shifts.len().pow(2)).max(LEAST_CELLS);
                    let sum_of =
                        |(part, weight): &([DVec2; 3], f64)| self.integral(&Outline::new(*part), most) * *weight;
                    sum += parts.iter().map(sum_of).fold(DVec3::ZERO, |a, b| a + b);
                }
                None => sum += self.mean().as_dvec3() * area,
            }
        }
        Some((sum / (area * shifts.len().pow(2) as f64)).as_vec3())
    }

    /// The parts of a triangle on copies of the picture, as triangles on the picture, with factors of their areas; `None`
    /// where there are too many.
    fn laid_out(&self, corners: [DVec2; 3]) -> Option<Vec<([DVec2; 3], f64)>> {
        let Outline { low, high, .. } = Outline::new(corners);
        let columns = self.stretches(0, low.x, high.x)?;
        let rows = self.stretches(1, low.y, high.y)?;
        if columns.len() * rows.len() > MOST_TILES {
            return None;
        }
        let whole = Polygon::from(corners);
        let mut parts = vec![];
        for row in &rows {
            let across = whole.cut(1, row.low, 1.0).cut(1, row.high, -1.0);
            for column in &columns {
                let part = across.cut(0, column.low, 1.0).cut(0, column.high, -1.0);
                let weight = 1.0 / (column.factor * row.factor).abs();
                let fan = (2..part.count).map(|k| [part.corners[0], part.corners[k - 1], part.corners[k]]);
                parts.extend(fan.map(|t| (t.map(|c| DVec2::new(column.place(c.x), row.place(c.y))), weight)));
            }
        }
        Some(parts)
    }

    /// How the picture is laid out between two coordinates on an axis.
    fn stretches(&self, axis: usize, low: f64, high: f64) -> Option<Vec<Stretch>> {
        let size = self.size()[axis] as f64;
        let tiles = ((low / size).floor(), (high / size).ceil());
        let wrap = self.texture.wrap[axis];
        if wrap == Wrap::Clamp {
            let inside = Stretch { low: 0.0, high: size, from: 0.0, factor: 1.0, to: 0.0 };
            // The border's texel, as wide as all that it stands for.
            let before = Stretch { low, high: 0.0, from: low, factor: -1.0 / low, to: 0.0 };
            let beyond = Stretch { low: size, high, from: size, factor: 1.0 / (high - size), to: size - 1.0 };
            return Some([before, inside, beyond].into_iter().filter(|s| s.low.max(low) < s.high.min(high)).collect());
        }
        if tiles.1 - tiles.0 > MOST_TILES as f64 {
            return None;
        }
        let tile = |k: u32| {
            let first = tiles.0 + f64::from(k);
            let (low, high) = (first * size, (first + 1.0) * size);
            let mirrored = wrap == Wrap::Mirror && first.rem_euclid(2.0) == 1.0;
            let (from, factor) = if mirrored { (high, -1.0) } else { (low, 1.0) };
            Stretch { low, high, from, factor, to: 0.0 }
        };
        Some((0..(tiles.1 - tiles.0) as u32).map(tile).collect())
    }

    /// Sum of texels by their areas in a triangle on the picture.
    fn integral(&self, outline: &Outline, most: usize) -> DVec3 {
        let (mut level, mut cells) = self.cover(outline.low, outline.high);
        let mut sum = DVec3::ZERO;
        loop {
            let is_last = level == 0 || cells.len() > most;
            let mut next = vec![];
            for &place in &cells {
                let own = self.cell(level, place).sum.as_dvec3();
                if own == DVec3::ZERO {
                    continue;
                }
                let [low, high] = self.bounds(level, place);
                match outline.overlap(low, high) {
                    Overlap::Outside => (),
                    Overlap::Inside => sum += own,
                    Overlap::Across if is_last => {
                        let part = Polygon::from(outline.corners).cut(0, low.x, 1.0).cut(0, high.x, -1.0);
                        let area = part.cut(1, low.y, 1.0).cut(1, high.y, -1.0).area();
                        sum += own * (area / (high - low).element_product());
                    }
                    Overlap::Across => next.extend(self.quarters(level, place)),
                }
            }
            if next.is_empty() {
                return sum;
            }
            (level, cells) = (level - 1, next);
        }
    }
}

impl Stretch {
    fn place(&self, v: f64) -> f64 {
        self.to + (v - self.from) * self.factor
    }
}

impl Polygon {
    fn from(triangle: [DVec2; 3]) -> Self {
        let mut all = Self::default();
        triangle.into_iter().for_each(|corner| all.push(corner));
        all
    }

    fn push(&mut self, corner: DVec2) {
        if let Some(free) = self.corners.get_mut(self.count) {
            *free = corner;
            self.count += 1;
        }
    }

    /// What of it lies on one side of a line across an axis: beyond `at` for side 1, before it for −1.
    fn cut(&self, axis: usize, at: f64, side: f64) -> Self {
        let corners = &self.corners[..self.count];
        let depth = |corner: DVec2| (corner[axis] - at) * side;
        if corners.iter().all(|&c| depth(c) >= 0.0) {
            return *self;
        }
        let mut left = Self::default();
        for (k, &end) in corners.iter().enumerate() {
            let start = corners[(k + corners.len() - 1) % corners.len()];
            let (a, b) = (depth(start), depth(end));
            if (a < 0.0) != (b < 0.0) {
                left.push(start + (end - start) * (a / (a - b)));
            }
            if b >= 0.0 {
                left.push(end);
            }
        }
        left
    }

    fn area(&self) -> f64 {
        let spoke = |k: usize| self.corners[k] - self.corners[0];
        0.5 * (2..self.count).map(|k| spoke(k - 1).perp_dot(spoke(k))).fold(0.0, |a, b| a + b).abs()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::{Stage, Stream};
    use crate::base::warp;
    use crate::scene::Texture;

    const WRAPS: [Wrap; 3] = [Wrap::Repeat, Wrap::Mirror, Wrap::Clamp];
    /// Points per side of a grid that stands for the truth.
    const GRID: u32 = 200;

    fn texture(stream: &mut Stream, nearest: bool) -> Texture {
        let mut below = |n: u32| stream.next_u32() % n;
        let (width, height) = (1 + below(40), 1 + below(30));
        let pixel = |_| [(); 4].map(|()| if below(3) == 0 { below(256) as u8 } else { 0 });
        let pixels = (0..width * height).map(pixel).collect();
        let wrap = [0, 1].map(|_| WRAPS[stream.next_u32() as usize % 3]);
        Texture { width, height, pixels, wrap, nearest }
    }

    fn by_points(texture: &Texture, [p, q, r]: [Vec2; 3]) -> Vec3 {
        let at = |k: u32| {
            let u = Vec2::new((k % GRID) as f32 + 0.5, (k / GRID) as f32 + 0.5) / GRID as f32;
            let b = warp::square_to_triangle(u);
            texture.sample_srgb(p + (q - p) * b.x + (r - p) * b.y).truncate()
        };
        (0..GRID * GRID).map(at).fold(Vec3::ZERO, |a, b| a + b) / (GRID * GRID) as f32
    }

    #[test]
    fn means_are_those_of_many_points() {
        let mut stream = Stream::new(3, Stage::Walk, 0, 0);
        for k in 0..300 {
            let texture = texture(&mut stream, k % 2 == 0);
            let picture = Picture::new(&texture);
            let reach = [0.06, 0.3, 1.0, 3.0][k % 4];
            let mut point = |size: f32| (Vec2::new(stream.next_f32(), stream.next_f32()) - 0.5) * size;
            let at = point(5.0);
            let triangle = [at + point(reach), at + point(reach), at + point(reach)];
            let Some(mean) = picture.mean_over(triangle, usize::MAX) else { continue };
            let off = (mean - by_points(&texture, triangle)).abs().max_element();
            // What a bilinear look-up carries over the edges of a large triangle.
            let most = if texture.nearest { 0.006 } else { 0.03 };
            assert!(off < most, "{k}: off by {off}, {} × {}, {:?}", texture.width, texture.height, texture.wrap);
        }
    }

    #[test]
    fn a_single_texel_is_found_wherever_it_is() {
        for nearest in [false, true] {
            for k in [0usize, 517 * 2048 + 1033, 2048 * 2048 - 1] {
                let mut pixels = vec![[0, 0, 0, 255]; 2048 * 2048];
                pixels[k] = [255; 4];
                let texture = Texture { width: 2048, height: 2048, pixels, wrap: [Wrap::Repeat; 2], nearest };
                let picture = Picture::new(&texture);
                let halves = [[Vec2::ZERO, Vec2::X, Vec2::ONE], [Vec2::ONE, Vec2::Y, Vec2::ZERO]];
                let sum: f32 = halves.iter().map(|t| picture.mean_over(*t, 64).unwrap().x).sum();
                assert!((sum * 0.5 * 2048.0 * 2048.0 - 1.0).abs() < 1e-5, "{nearest} {k}: {sum}");
                assert!((picture.mean().y * 2048.0 * 2048.0 - 1.0).abs() < 1e-5);
            }
        }
    }

    #[test]
    fn triangles_without_area_have_no_mean_and_large_ones_that_of_the_whole() {
        let mut stream = Stream::new(5, Stage::Walk, 0, 0);
        let texture = Texture { wrap: [Wrap::Mirror; 2], ..texture(&mut stream, false) };
        let picture = Picture::new(&texture);
        for flat in [Vec2::ZERO, Vec2::splat(f32::NAN), Vec2::splat(0.5)] {
            assert!(picture.mean_over([Vec2::ZERO, Vec2::ONE, flat], 64).is_none());
        }
        let large = picture.mean_over([Vec2::ZERO, Vec2::X * 100.0, Vec2::Y * 300.0], 64).unwrap();
        assert!((large - picture.mean()).abs().max_element() < 1e-6);
    }
}
