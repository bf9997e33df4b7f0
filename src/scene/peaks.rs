//! Upper bounds of a texture over triangles of its coordinates.
//!
//! In: a [`Picture`]. Out: for three coordinates, a value that no channel of a look-up in their triangle exceeds; 0 only
//! where all of them are black.
//!
//! From a few squares around the triangle down to texels, those that no look-up can read are left out, as are those that
//! are no brighter than one that lies in it; so what is black up to a texel from the triangle's edges is told from what is
//! bright beside it. Bounded work: where more than [`MOST_CELLS`] squares are left, their bounds count.

use super::picture::{Outline, Overlap, Picture};
use super::texture::{SRGB_TO_LINEAR, Wrap};
use glam::{DVec2, Vec2};

/// Squares of a level up to which they are looked at.
const MOST_CELLS: usize = 24;
/// Repetitions of the picture in a triangle up to which they are looked at.
const MOST_TILES: i64 = 16;
/// Rounding of coordinates, as a share of the largest: triangles interpolate theirs in single precision.
const ROUNDING: f64 = 1e-6;
/// The same where they are small [texels].
const LEAST_ROUNDING: f64 = 0.01;
/// Farther than any coordinate [texels].
const BEYOND: f64 = 1e18;

impl Picture<'_> {
    /// No channel of [`Texture::sample_srgb`](super::Texture::sample_srgb) in a triangle of coordinates is larger, whatever
    /// its filter.
    #[must_use]
    pub fn most(&self, uvs: [Vec2; 3]) -> f32 {
        let most = self.most_of(uvs).unwrap_or(self.whole().most);
        SRGB_TO_LINEAR[usize::from(most)]
    }

    /// `None` where the triangle has too much of it.
    fn most_of(&self, uvs: [Vec2; 3]) -> Option<u8> {
        let corners = self.in_texels(uvs);
        let far = uvs.iter().fold(Vec2::ZERO, |far, uv| far.max(uv.abs()));
        if !uvs.iter().all(|uv| uv.is_finite()) || far.max_element() > 1e9 {
            return None;
        }
        let reach = if self.texture.nearest { 0.0 } else { 0.5 };
        let size = DVec2::from_array(self.size().map(|n| n as f64));
        let margin = reach + LEAST_ROUNDING + ROUNDING * far.as_dvec2() * size;
        let Outline { low, high, .. } = Outline::new(corners);
        let tiles = [0, 1].map(|axis| match self.texture.wrap[axis] {
            Wrap::Clamp => (0, 0),
            _ => {
                let tile = |v: f64| (v / size[axis]).floor() as i64;
                (tile(low[axis] - margin[axis]), tile(high[axis] + margin[axis]))
            }
        });
        if tiles.iter().map(|(a, b)| b - a + 1).fold(1i64, i64::saturating_mul) > MOST_TILES {
            return None;
        }
        let mut most = 0;
        for y in tiles[1].0..=tiles[1].1 {
            for x in tiles[0].0..=tiles[0].1 {
                let own = corners.map(|c| DVec2::new(self.fold(0, x, c.x), self.fold(1, y, c.y)));
                most = self.most_in_tile(&Outline::new(own), margin, most);
            }
        }
        Some(most)
    }

    /// A coordinate in texels on an axis, as one of the picture that stands for a tile.
    fn fold(&self, axis: usize, tile: i64, v: f64) -> f64 {
        let size = self.size()[axis] as f64;
        match self.texture.wrap[axis] {
            Wrap::Clamp => v,
            Wrap::Mirror if tile.rem_euclid(2) == 1 => (tile + 1) as f64 * size - v,
            Wrap::Mirror | Wrap::Repeat => v - tile as f64 * size,
        }
    }

    /// The brightest of what look-ups so far from a triangle may read of one tile, or what is known to be.
    fn most_in_tile(&self, outline: &Outline, margin: DVec2, mut known: u8) -> u8 {
        let size = DVec2::from_array(self.size().map(|n| n as f64));
        // The border of what is not repeated stands for all beyond it.
        let held = DVec2::from_array(self.texture.wrap.map(|w| if w == Wrap::Clamp { BEYOND } else { 0.0 }));
        let hold = |v: DVec2| DVec2::select(held.cmpgt(DVec2::ZERO), v.clamp(DVec2::ZERO, size - 0.5), v);
        let (mut level, mut cells) = self.cover(hold(outline.low - margin), hold(outline.high + margin));
        loop {
            let mut next = vec![];
            let mut unsure = 0;
            for &place in &cells {
                let most = self.brightest(level, place);
                if most <= known {
                    continue;
                }
                let [low, high] = self.bounds(level, place);
                let first = low - DVec2::select(low.cmple(DVec2::ZERO), held, DVec2::ZERO);
                let last = high + DVec2::select(high.cmpge(size), held, DVec2::ZERO);
                if outline.overlap(first - margin, last + margin) == Overlap::Outside {
                    continue;
                }
                if level == 0 || outline.overlap(low, high) == Overlap::Inside {
                    known = known.max(most);
                } else {
                    unsure = unsure.max(most);
                    next.extend(self.quarters(level, place));
                }
            }
            if next.is_empty() || next.len() > MOST_CELLS {
                return known.max(unsure);
            }
            (level, cells) = (level - 1, next);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::{Stage, Stream};
    use crate::base::warp;
    use crate::scene::Texture;

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
            let picture = Picture::new(&texture);
            let at = Vec2::new(stream.next_f32(), stream.next_f32()) * 8.0 - 4.0;
            let reach = [0.02, 0.3, 3.0][k % 3];
            let corner = |s: &mut Stream| at + (Vec2::new(s.next_f32(), s.next_f32()) - 0.5) * reach;
            let triangle = [corner(&mut stream), corner(&mut stream), corner(&mut stream)];
            let most = picture.most(triangle);
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
        let picture = Picture::new(&texture);
        let whole = SRGB_TO_LINEAR[31 * 8];
        for far in [f32::NAN, f32::INFINITY, f32::MAX, 1e12, 5.0] {
            assert_eq!(picture.most([Vec2::ZERO, Vec2::splat(far), Vec2::ZERO]), whole, "{far}");
        }
        assert!(picture.most([Vec2::splat(0.3); 3]) <= SRGB_TO_LINEAR[15 * 8]);
    }
}
