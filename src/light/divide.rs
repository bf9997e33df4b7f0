//! Emissive triangles → [`Piece`]s.
//!
//! An emitter of one colour is one piece. One with a texture, or with alpha, is cut into up to 4³ similar pieces, as far
//! as its emission varies, so that bright parts of it get the samples: its distribution is piecewise constant over a
//! barycentric grid. What cannot glow, by the bounds of its texture ([`Picture::most`]), is left out: assets have pictures
//! of emission that are black but for a lamp or two.
//!
//! Pieces that are dark but for small lamps are cut on, those first that cost most: with a piece chosen by its mean and a
//! point of it by area, the variance grows with Σ A·(E[L²]/m − m) over the pieces, and E[L²] is at most the peak times m.
//! So a lamp of one texel in 2048² becomes pieces of a texel or two, and has its light: uniform points of the 4³ pieces
//! found it once in 32,768 times.
//!
//! Means are those of all texels in a piece ([`Picture::mean_over`]). Pieces and squares of texels are dealt by what a
//! triangle could emit at most, so a screen of two triangles is cut finely beside a body of 100,000, and all of them
//! together take bounded time and memory: a loudspeaker of 56,000 triangles with such a picture took 14 s, 1,024 readings
//! for each.
//!
//! Invariant: what is left out is black.
//!
//! Limit: of a body of very many triangles, each of which shows a whole picture with a small lamp, pieces are whole
//! triangles; their samples are noisy.

use super::piece::{LEAST, Piece, inside};
use crate::base::color::luminance;
use crate::base::{Rgb, parallel, warp};
use crate::scene::{Alpha, Picture, Scene};
use core::f64::consts::PI;
use glam::{DVec3, Vec2};

/// Cuts of a textured triangle: 4³ pieces at most. A level more costs memory and finds nothing on usual lamps.
const LEVELS: u32 = 3;
/// Pieces are cut on whose brightest point may be more times as bright as their mean.
const PEAKED: f32 = 4.0;
/// Least of such a piece's cost, as a share of all that the triangle emits, and least area [texels²]: below, there is
/// nothing to gain.
const LEAST_COST: f32 = 1.0 / 1024.0;
const LEAST_TEXELS: f32 = 0.5;
/// Most pieces that such cuts give a triangle. Rays that meet it look through its pieces.
const MOST_DEEPER: f64 = 1024.0;
/// Pieces of all textured triangles together, but for the first of each: 2,048 triangles that are alike have all levels.
const MOST: f64 = (1u32 << 17) as f64;
/// Squares of texels across the edges of a piece, at least and at most, and of all of them together, but for the least.
const CELLS: [usize; 2] = [16, 4096];
const MOST_CELLS: f64 = (1u32 << 20) as f64;
/// The same for a piece that was cut on, and for a triangle of which only the mean is asked.
const DEEPER_CELLS: usize = 256;
/// Area up to which a piece with fewer squares than that has its mean from the grid of points [texels²].
const SMALL: f32 = 24.0;
/// Points per side of the grid at which alpha is read, and what is small on its texture.
const GRID: u32 = 4;
/// Brightest over darkest of four pieces up to which they stay one.
const EVEN: f32 = 1.25;

const WHOLE: [Vec2; 3] = [Vec2::ZERO, Vec2::X, Vec2::Y];

/// The pieces of triangles that may glow, in their order.
pub(super) fn pieces(scene: &Scene, triangles: &[u32]) -> Vec<Piece> {
    let emitting = Emitting::new(scene, triangles);
    let most = parallel::map(triangles.len(), |k| emitting.most(triangles[k], WHOLE));
    let power = |k: usize| emitting.power(triangles[k], most[k]);
    let total = (0..triangles.len()).fold(0.0, |sum, k| sum + power(k));
    let cut = |range: core::ops::Range<usize>| {
        let mut pieces = vec![];
        range.for_each(|k| emitting.cut(triangles[k], most[k], Deal::new(power(k) / total), &mut pieces));
        pieces
    };
    parallel::map_chunks(triangles.len(), 64, cut).into_iter().flatten().collect()
}

/// Flux of what each part sends out [lm], by the means of its textures where it shows them; both sides of a double-sided
/// part.
#[must_use]
pub fn flux_of_parts(scene: &Scene) -> Vec<DVec3> {
    let glowing = |p: &usize| scene.glows(&scene.parts[*p]);
    let triangles: Vec<u32> =
        (0..scene.parts.len()).filter(glowing).flat_map(|p| scene.parts[p].triangles.clone()).collect();
    let emitting = Emitting::new(scene, &triangles);
    let share = 1.0 / triangles.len().max(1) as f64;
    let cells = Deal::new(share).cells.max(DEEPER_CELLS);
    let of_part = |p: usize| {
        let part = &scene.parts[p];
        if !glowing(&p) {
            return DVec3::ZERO;
        }
        let sides = if scene.materials[part.material].double_sided { 2.0 } else { 1.0 };
        let of_triangle = |k: usize| {
            let triangle = part.triangles.start + k as u32;
            emitting.mean(triangle, WHOLE, cells).as_dvec3() * scene.area(triangle)
        };
        parallel::sum_channels(part.triangles.len(), of_triangle) * (PI * sides)
    };
    (0..scene.parts.len()).map(of_part).collect()
}

/// What a triangle may spend.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Deal {
    /// Cuts.
    levels: u32,
    /// Pieces beyond those that they make.
    deeper: usize,
    /// Squares of texels across the edges of a piece.
    cells: usize,
}

impl Deal {
    /// Of a triangle that could emit this share of all that is emitted.
    fn new(share: f64) -> Self {
        let pieces = (MOST * share).max(1.0);
        let levels = ((0.5 * pieces.log2()) as u32).min(LEVELS);
        let made = f64::from(1u32 << (2 * levels));
        let cells = (MOST_CELLS * share / made).max(0.0) as usize;
        let [least, most] = CELLS;
        Self { levels, deeper: (pieces - made).clamp(0.0, MOST_DEEPER) as usize, cells: cells.clamp(least, most) }
    }
}

/// What becomes a piece.
#[derive(Debug, Clone, Copy)]
struct Part {
    /// Its corners in barycentric weights of the triangle's vertices 1 and 2.
    b: [Vec2; 3],
    mean: Rgb,
    most: Rgb,
}

impl Part {
    fn quarters(&self) -> [[Vec2; 3]; 4] {
        let b = self.b;
        let middle = [(b[0] + b[1]) * 0.5, (b[1] + b[2]) * 0.5, (b[2] + b[0]) * 0.5];
        [
            [b[0], middle[0], middle[2]],
            [middle[0], b[1], middle[1]],
            [middle[2], middle[1], b[2]],
            [middle[1], middle[2], middle[0]],
        ]
    }

    /// Of the triangle.
    fn share(&self) -> f32 {
        (self.b[1] - self.b[0]).perp_dot(self.b[2] - self.b[0]).abs()
    }

    fn cost(&self) -> f32 {
        (luminance(self.most) - luminance(self.mean)) * self.share()
    }
}

/// A scene with its pictures of emission.
struct Emitting<'a> {
    scene: &'a Scene,
    /// By texture.
    pictures: Vec<Option<Picture<'a>>>,
}

impl<'a> Emitting<'a> {
    fn new(scene: &'a Scene, triangles: &[u32]) -> Self {
        let mut pictures: Vec<Option<Picture<'a>>> = scene.textures.iter().map(|_| None).collect();
        for part in triangles.chunk_by(|a, b| scene.part_index(*a) == scene.part_index(*b)) {
            if let Some(r) = &scene.material(part[0]).emission_texture {
                pictures[r.texture].get_or_insert_with(|| Picture::new(&scene.textures[r.texture]));
            }
        }
        Self { scene, pictures }
    }

    /// The picture on a triangle, with the coordinates of three of its points.
    fn picture(&self, triangle: u32, b: [Vec2; 3]) -> Option<(&Picture<'a>, [Vec2; 3])> {
        let (texture, uvs) = self.scene.emission_uvs(triangle, b)?;
        Some((self.pictures[texture].as_ref()?, uvs))
    }

    /// No point of the part of a triangle between three points emits more [cd/m²].
    fn most(&self, triangle: u32, b: [Vec2; 3]) -> Rgb {
        self.scene.most_emission(triangle) * self.picture(triangle, b).map_or(1.0, |(picture, uvs)| picture.most(uvs))
    }

    /// Radiance × area that a triangle could have if it is to be cut, else 0.
    fn power(&self, triangle: u32, most: Rgb) -> f64 {
        if self.is_even(triangle) {
            return 0.0;
        }
        f64::from(luminance(most)) * self.scene.area(triangle)
    }

    /// All of the triangle emits the same.
    fn is_even(&self, triangle: u32) -> bool {
        let material = self.scene.material(triangle);
        material.emission_texture.is_none() && material.alpha == Alpha::Opaque
    }

    /// The pieces of one triangle, appended to `out`.
    fn cut(&self, triangle: u32, most: Rgb, deal: Deal, out: &mut Vec<Piece>) {
        if self.is_even(triangle) {
            let emission = self.scene.most_emission(triangle);
            out.extend(Piece::new(self.scene, triangle, WHOLE, emission, emission));
            return;
        }
        let mut parts = vec![];
        self.divide(triangle, (WHOLE, most), deal, &mut parts);
        self.cut_on(triangle, deal, &mut parts);
        out.extend(parts.iter().filter_map(|p| Piece::new(self.scene, triangle, p.b, p.mean, p.most)));
    }

    /// Cuts a part in four where that tells bright from dark; the mean emission of what became of it.
    fn divide(&self, triangle: u32, (b, most): ([Vec2; 3], Rgb), deal: Deal, out: &mut Vec<Part>) -> Rgb {
        if most.max_element() <= 0.0 {
            return Rgb::ZERO;
        }
        if deal.levels == 0 {
            let mean = self.mean(triangle, b, deal.cells);
            out.push(Part { b, mean, most });
            return mean;
        }
        let first = out.len();
        let next = Deal { levels: deal.levels - 1, ..deal };
        let quarters = Part { b, mean: Rgb::ZERO, most }.quarters();
        let means = quarters.map(|q| self.divide(triangle, (q, self.most(triangle, q)), next, out));
        let mean = (means[0] + means[1] + means[2] + means[3]) * 0.25;
        let values = means.map(luminance);
        let (low, high) = values.iter().fold((f32::MAX, 0.0f32), |(l, h), &v| (l.min(v), h.max(v)));
        // Fewer than four parts: some were black.
        if out.len() <= first + 4 && high <= EVEN * low.max(LEAST * luminance(most)) {
            out.truncate(first);
            out.push(Part { b, mean, most });
        }
        mean
    }

    /// Cuts what is dark but for small lamps, all that is worth it once a round, as far as the deal goes.
    fn cut_on(&self, triangle: u32, deal: Deal, parts: &mut Vec<Part>) {
        let emitted = parts.iter().fold(0.0, |sum, p| sum + luminance(p.mean) * p.share());
        let most = parts.len() + deal.deeper;
        let is_worth = |p: &Part| {
            luminance(p.most) > PEAKED * luminance(p.mean)
                && p.cost() > LEAST_COST * emitted
                && self.texels(triangle, p.b) > LEAST_TEXELS
        };
        loop {
            let mut chosen: Vec<usize> = (0..parts.len()).filter(|&k| is_worth(&parts[k])).collect();
            chosen.sort_by(|&i, &j| parts[j].cost().total_cmp(&parts[i].cost()));
            chosen.truncate(most.saturating_sub(parts.len()) / 3);
            if chosen.is_empty() {
                return;
            }
            chosen.sort_unstable();
            let mut next = Vec::with_capacity(parts.len() + 3 * chosen.len());
            for (k, part) in parts.iter().enumerate() {
                if chosen.binary_search(&k).is_err() {
                    next.push(*part);
                    continue;
                }
                for b in part.quarters() {
                    let most = self.most(triangle, b);
                    if most.max_element() > 0.0 {
                        next.push(Part { b, mean: self.mean(triangle, b, DEEPER_CELLS), most });
                    }
                }
            }
            *parts = next;
        }
    }

    /// Area on its texture [texels²].
    fn texels(&self, triangle: u32, b: [Vec2; 3]) -> f32 {
        self.scene.emission_uvs(triangle, b).map_or(0.0, |(texture, uv)| {
            let (width, height) = (self.scene.textures[texture].width, self.scene.textures[texture].height);
            0.5 * (uv[1] - uv[0]).perp_dot(uv[2] - uv[0]).abs() * width as f32 * height as f32
        })
    }

    /// Mean emission of a part of a triangle, of what alpha leaves of it.
    fn mean(&self, triangle: u32, b: [Vec2; 3], cells: usize) -> Rgb {
        if self.is_even(triangle) {
            return self.scene.most_emission(triangle);
        }
        let is_small = cells < DEEPER_CELLS && self.texels(triangle, b) < SMALL;
        let picture = self.picture(triangle, b).filter(|_| !is_small);
        let mean = picture.and_then(|(picture, uvs)| picture.mean_over(uvs, cells));
        let Some(mean) = mean.map(|mean| self.scene.most_emission(triangle) * mean) else {
            return over_grid(b, |b| self.scene.emission(triangle, b));
        };
        if self.scene.material(triangle).alpha == Alpha::Opaque {
            return mean;
        }
        let factor = self.scene.part(triangle).treatment.emission;
        let glow = luminance(over_grid(b, |b| self.scene.shown_emission(triangle, b) * factor));
        let left = luminance(over_grid(b, |b| self.scene.emission(triangle, b)));
        if glow > 0.0 {
            mean * (left / glow)
        } else {
            mean * over_grid(b, |b| Rgb::splat(self.scene.opacity(triangle, b)))
        }
    }
}

/// Mean over points of a grid in a part of a triangle.
fn over_grid(b: [Vec2; 3], value: impl Fn(Vec2) -> Rgb) -> Rgb {
    let point = |k: u32| {
        let u = Vec2::new((k % GRID) as f32 + 0.5, (k / GRID) as f32 + 0.5) / GRID as f32;
        value(inside(b, warp::square_to_triangle(u)))
    };
    (0..GRID * GRID).map(point).fold(Rgb::ZERO, |a, b| a + b) / (GRID * GRID) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_are_dealt_by_power_and_bounded() {
        let levels = |share: f64| Deal::new(share).levels;
        assert_eq!([1.0, 1.0 / 2048.0, 1.0 / 2100.0, 1.0 / 100_000.0, 0.0].map(levels), [3, 3, 2, 0, 0]);
        assert_eq!(Deal::new(f64::NAN), Deal { levels: 0, deeper: 0, cells: CELLS[0] }, "nothing can glow");
        // A screen of two triangles beside a body of many, and shares that fall off.
        for n in [1u32, 10, 1_000, 100_000] {
            let share = |k: u32| f64::from(2 * (n - k)) / (f64::from(n) * f64::from(n + 1));
            let deals = || (0..n).map(|k| Deal::new(share(k)));
            let all: u64 = deals().map(|deal| 4u64.pow(deal.levels) + deal.deeper as u64).sum();
            let cells: u64 = deals().map(|deal| (deal.cells as u64) << (2 * deal.levels)).sum();
            assert!(cells as f64 <= MOST_CELLS + (64 * CELLS[0]) as f64 * f64::from(n), "{n}: {cells}");
            assert!(all as f64 <= MOST + f64::from(n), "{n}: {all}");
        }
    }
}
