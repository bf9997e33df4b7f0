//! Emissive triangles → [`Piece`]s.
//!
//! An emitter of one colour is one piece. One with a texture, or with alpha, is cut into up to 4³ similar pieces, as far
//! as its emission varies, so that bright parts of it get the samples: its distribution is piecewise constant over a
//! barycentric grid. What cannot glow, by the bounds of its texture ([`Peaks`]), is left out: assets have pictures of
//! emission that are black but for a lamp or two.
//!
//! A picture that is black but for small lamps is cut finer around these, up to 4⁶, and its mean is read at about each of its
//! texels: of six lamps of 24 texels in 2048 × 2048, points of a grid of 4 × 4 found a quarter of the light.
//!
//! Pieces are dealt by what a triangle could emit at most, so a screen of two triangles is cut finely beside a body of
//! 100,000, and all of them together take bounded time and memory: a loudspeaker of 56,000 triangles with such a picture
//! took 14 s, 1,024 readings for each.
//!
//! Invariant: what is left out is black.

use super::piece::{LEAST, Piece, inside};
use crate::base::color::luminance;
use crate::base::{Rgb, parallel, warp};
use crate::scene::{Alpha, Peaks, Scene, Texture};
use glam::Vec2;

/// Cuts of a textured triangle: 4³ pieces at most. A level more costs memory and finds nothing on usual lamps.
const LEVELS: u32 = 3;
/// Cuts beyond these, of pieces whose brightest point may be so many times as bright as their mean.
const DEEPER: u32 = 3;
const PEAKED: f32 = 4.0;
/// Pieces of all textured triangles together, but for the first of each: 2,048 triangles that are alike have all levels.
const MOST: f64 = (1u32 << 17) as f64;
/// Least and most points per side of the grid at which a piece's texture is read: one for each of its texels between these.
const TEXTURE_GRID: [u32; 2] = [4, 64];
/// Readings of all textured triangles together, but for the least of each.
const MOST_READINGS: f64 = (1u32 << 24) as f64;
/// Brightest over darkest of four pieces up to which they stay one.
const EVEN: f32 = 1.25;

const WHOLE: [Vec2; 3] = [Vec2::ZERO, Vec2::X, Vec2::Y];

/// The pieces of triangles that may glow, in their order.
pub(super) fn pieces(scene: &Scene, triangles: &[u32]) -> Vec<Piece> {
    let emitting = Emitting::new(scene, triangles);
    let powers = parallel::map(triangles.len(), |k| emitting.power(triangles[k]));
    let total = powers.iter().fold(0.0, |sum, p| sum + p);
    let cut = |range: core::ops::Range<usize>| {
        let mut pieces = vec![];
        range.for_each(|k| emitting.cut(triangles[k], Deal::new(powers[k] / total), &mut pieces));
        pieces
    };
    parallel::map_chunks(triangles.len(), 64, cut).into_iter().flatten().collect()
}

/// What a triangle may spend.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Deal {
    /// Cuts, and cuts beyond them of what is mostly dark.
    levels: u32,
    deeper: u32,
    /// Points per side of a piece's grid.
    grid: u32,
}

impl Deal {
    /// Of a triangle that could emit this share of all that is emitted.
    fn new(share: f64) -> Self {
        let all = (0.5 * (MOST * share).max(1.0).log2()) as u32;
        let levels = all.min(LEVELS);
        let grid = (MOST_READINGS * share / f64::from(1u32 << (2 * levels))).max(0.0).sqrt() as u32;
        let [least, most] = TEXTURE_GRID;
        Self { levels, deeper: (all - levels).min(DEEPER), grid: grid.clamp(least, most) }
    }
}

/// A scene with the bounds of its pictures of emission.
struct Emitting<'a> {
    scene: &'a Scene,
    /// By texture.
    peaks: Vec<Option<Peaks>>,
}

impl<'a> Emitting<'a> {
    fn new(scene: &'a Scene, triangles: &[u32]) -> Self {
        let mut peaks: Vec<Option<Peaks>> = scene.textures.iter().map(|_| None).collect();
        for part in triangles.chunk_by(|a, b| scene.part_index(*a) == scene.part_index(*b)) {
            if let Some(r) = &scene.material(part[0]).emission_texture {
                peaks[r.texture].get_or_insert_with(|| Peaks::new(&scene.textures[r.texture]));
            }
        }
        Self { scene, peaks }
    }

    /// No point of the part of a triangle between three points emits more [cd/m²].
    fn most(&self, triangle: u32, b: [Vec2; 3]) -> Rgb {
        let most = self.scene.most_emission(triangle);
        let peak = |(texture, uvs): (usize, [Vec2; 3])| self.peaks[texture].as_ref().map_or(1.0, |p| p.most(uvs));
        most * self.scene.emission_uvs(triangle, b).map_or(1.0, peak)
    }

    /// Radiance × area that a triangle could have if it is to be cut, else 0.
    fn power(&self, triangle: u32) -> f64 {
        if self.is_even(triangle) {
            return 0.0;
        }
        f64::from(luminance(self.most(triangle, WHOLE))) * self.scene.area(triangle)
    }

    /// All of the triangle emits the same.
    fn is_even(&self, triangle: u32) -> bool {
        let material = self.scene.material(triangle);
        material.emission_texture.is_none() && material.alpha == Alpha::Opaque
    }

    /// The pieces of one triangle, appended to `out`.
    fn cut(&self, triangle: u32, deal: Deal, out: &mut Vec<Piece>) {
        if self.is_even(triangle) {
            let emission = self.scene.most_emission(triangle);
            out.extend(Piece::new(self.scene, triangle, WHOLE, emission, emission));
        } else {
            self.divide(triangle, WHOLE, deal, out);
        }
    }

    /// Cuts a piece in four where that tells bright from dark; the mean emission of what became of it.
    fn divide(&self, triangle: u32, b: [Vec2; 3], deal: Deal, out: &mut Vec<Piece>) -> Rgb {
        let most = self.most(triangle, b);
        if most.max_element() <= 0.0 {
            return Rgb::ZERO;
        }
        let mut next = Deal { levels: deal.levels.saturating_sub(1), ..deal };
        if deal.levels == 0 {
            let mean = self.mean(triangle, b, deal.grid);
            if deal.deeper == 0 || luminance(most) <= PEAKED * luminance(mean) {
                out.extend(Piece::new(self.scene, triangle, b, mean, most));
                return mean;
            }
            next.deeper -= 1;
        }
        let first = out.len();
        let middle = [(b[0] + b[1]) * 0.5, (b[1] + b[2]) * 0.5, (b[2] + b[0]) * 0.5];
        let quarters = [
            [b[0], middle[0], middle[2]],
            [middle[0], b[1], middle[1]],
            [middle[2], middle[1], b[2]],
            [middle[1], middle[2], middle[0]],
        ];
        let means = quarters.map(|q| self.divide(triangle, q, next, out));
        let mean = (means[0] + means[1] + means[2] + means[3]) * 0.25;
        let values = means.map(luminance);
        let (low, high) = values.iter().fold((f32::MAX, 0.0f32), |(l, h), &v| (l.min(v), h.max(v)));
        // Fewer than four pieces: some had no area, or were black.
        if out.len() <= first + 4 && high <= EVEN * low.max(LEAST * luminance(most)) {
            out.truncate(first);
            out.extend(Piece::new(self.scene, triangle, b, mean, most));
        }
        mean
    }

    /// Mean emission of a piece, by up to so many points per side of a grid.
    fn mean(&self, triangle: u32, b: [Vec2; 3], most: u32) -> Rgb {
        let edge = self.scene.emission_uvs(triangle, b).map_or(0.0, |(texture, uv)| {
            let Texture { width, height, .. } = self.scene.textures[texture];
            let area = 0.5 * (uv[1] - uv[0]).perp_dot(uv[2] - uv[0]).abs();
            (2.0 * area * width as f32 * height as f32).sqrt()
        });
        let n = (edge as u32).clamp(TEXTURE_GRID[0], most);
        let point = |k: u32| {
            let u = Vec2::new((k % n) as f32 + 0.5, (k / n) as f32 + 0.5) / n as f32;
            self.scene.emission(triangle, inside(b, warp::square_to_triangle(u)))
        };
        (0..n * n).map(point).fold(Rgb::ZERO, |a, b| a + b) / (n * n) as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_are_dealt_by_power_and_bounded() {
        let levels = |share: f64| Deal::new(share).levels;
        assert_eq!([1.0, 1.0 / 2048.0, 1.0 / 2100.0, 1.0 / 100_000.0, 0.0].map(levels), [3, 3, 2, 0, 0]);
        assert_eq!(Deal::new(f64::NAN), Deal { levels: 0, deeper: 0, grid: 4 }, "nothing can glow");
        // A screen of two triangles beside a body of many, and shares that fall off.
        for n in [1u32, 10, 1_000, 100_000] {
            let share = |k: u32| f64::from(2 * (n - k)) / (f64::from(n) * f64::from(n + 1));
            let deals = || (0..n).map(|k| Deal::new(share(k)));
            let all: u64 = deals().map(|deal| 4u64.pow(deal.levels + deal.deeper)).sum();
            let readings: u64 = deals().map(|deal| u64::from(deal.grid).pow(2) << (2 * deal.levels)).sum();
            assert!(readings as f64 <= MOST_READINGS + 1024.0 * f64::from(n), "{n}: {readings}");
            assert!(all as f64 <= MOST + f64::from(n), "{n}: {all}");
        }
    }
}
