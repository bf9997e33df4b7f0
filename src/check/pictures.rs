//! Pictures of the worst places, in the scene: on the left where it is, on the right what it is.
//!
//! In: a baked document and its report. Out: a PNG for each place of each fault, named after the measure.
//!
//! The camera looks at the place, from where it is seen best: from many directions over the surface, the one that goes
//! farthest and is neither grazing nor straight down wins. A ring, the same in both halves, marks the place; it stays the
//! same size on the screen. In a gap that is too narrow for a camera, the close look is a cutaway. Faults of coordinates
//! show the texels as a checkerboard on the right, faults of light the light alone without colours of materials, because
//! a leak on a dark carpet is a leak as well. A faint blue tells what has no light from what is not there.

use super::Baked;
use super::Report;
use super::measure::{Kind, Place};
use crate::output::{Error, Files, png};
use crate::render::{self, Overlay, Toward, View};
use crate::trace::{Ray, Tracer};
use core::f32::consts::TAU;
use glam::{Vec2, Vec3};
use std::path::Path;

/// Width and height of one half [px].
const SIZE: [u32; 2] = [560, 480];

/// Between the halves [px].
const GAP: u32 = 8;

/// Radius of the ring [px], and its width.
const RING: f32 = 30.0;
const LINE: f32 = 3.0;

/// Rays per pixel.
const SAMPLES: u32 = 4;

/// Directions that are tried for the camera.
const DIRECTIONS: usize = 128;

/// Distance of the close look in units of the place's scale: about twelve texels fill the height.
const CLOSE: f32 = 2.2;

/// Vertical field of view [rad].
const FIELD: f32 = 0.8;

/// What is added to surfaces that face the camera, so that the shape of rooms without any light can be seen.
const DIM: [f32; 3] = [0.012, 0.02, 0.05];

/// Magenta: no lamp and no wall has it.
const MARK: [f32; 3] = [1.0, 0.0, 0.55];

/// The pictures of a report's faults.
///
/// # Errors
/// If a picture cannot be encoded.
pub fn take(baked: &Baked, report: &Report, folder: &Path) -> Result<Files, Error> {
    let mut files = vec![];
    let tracer = Tracer::of_all(&baked.scene);
    for measure in report.measures.iter().filter(|m| m.fault) {
        for (k, place) in measure.places.iter().enumerate() {
            let path = folder.join(format!("{}-{}.png", measure.name, k + 1));
            let pixels = picture(baked, &tracer, measure.kind, place);
            let bytes = png::picture(&path, [2 * SIZE[0] + GAP, SIZE[1]], &pixels)?;
            files.push((path, bytes.into()));
        }
    }
    Ok(files)
}

/// Both halves of a picture.
fn picture(baked: &Baked, tracer: &Tracer<'_>, kind: Kind, place: &Place) -> Vec<[f32; 3]> {
    let (target, normal) = (Vec3::from(place.position), Vec3::from(place.normal).try_normalize().unwrap_or(Vec3::Y));
    let (direction, free) = viewpoint(tracer, target, normal, place.scale);
    let reach = (tracer.bounds().1 - tracer.bounds().0).length();
    // In a gap that no camera fits into, the left half shows what is in front of the place.
    let far = free.min(0.5 * reach).max((8.0 * place.scale).min(0.3 * reach));
    let near = (CLOSE * place.scale).min(far);
    let overlay = match kind {
        Kind::UvMissing | Kind::UvRange | Kind::UvOverlap | Kind::UvDegenerate => Overlay::Density,
        Kind::Padding | Kind::Density | Kind::Stretch => Overlay::Density,
        _ => Overlay::Light,
    };
    // Where something stands before the place, the close look cuts it away.
    let cut = (near > free).then(|| (normal, 0.9 * clearance(tracer, target, normal, near)));
    let looks = [(far, Overlay::None, None), (near, overlay, cut)].into_iter();
    let halves = looks.map(|(distance, overlay, cut)| {
        let toward = Toward { position: target + direction * distance, target, yfov: FIELD, cut };
        half(baked, View::Toward(toward), overlay)
    });
    let halves: Vec<Vec<[f32; 3]>> = halves.collect();
    let [width, height] = SIZE.map(|s| s as usize);
    let mut pixels = Vec::with_capacity((2 * width + GAP as usize) * height);
    for row in 0..height {
        pixels.extend_from_slice(&halves[0][row * width..(row + 1) * width]);
        pixels.resize(pixels.len() + GAP as usize, [1.0; 3]);
        pixels.extend_from_slice(&halves[1][row * width..(row + 1) * width]);
    }
    pixels
}

fn half(baked: &Baked, view: View, overlay: Overlay) -> Vec<[f32; 3]> {
    let [width, height] = SIZE;
    let pixels = |overlay: Overlay| {
        let settings =
            render::Settings { width, height, samples: SAMPLES, exposure: None, view, overlay, linear: false };
        let picture = render::render(&baked.scene, &baked.lightmaps, &settings);
        picture.map_or_else(|_| vec![[0.0; 3]; (width * height) as usize], |p| p.pixels)
    };
    let mut seen = pixels(overlay);
    for (pixel, shape) in seen.iter_mut().zip(pixels(Overlay::Shape)) {
        for c in 0..3 {
            pixel[c] += DIM[c] * shape[c] * shape[c] * (1.0 - pixel[c]);
        }
    }
    mark(&mut seen);
    seen
}

/// Draws the ring around the middle, with a dark rim so that it shows on anything.
fn mark(pixels: &mut [[f32; 3]]) {
    let middle = Vec2::new(SIZE[0] as f32, SIZE[1] as f32) * 0.5;
    for (i, pixel) in pixels.iter_mut().enumerate() {
        let at = Vec2::new((i as u32 % SIZE[0]) as f32 + 0.5, (i as u32 / SIZE[0]) as f32 + 0.5) - middle;
        let tick = at.abs().min_element() < LINE * 0.5 && (RING..RING * 1.5).contains(&at.abs().max_element());
        let off = if tick { 0.0 } else { (at.length() - RING).abs() };
        let cover = (LINE * 0.5 + 0.5 - off).clamp(0.0, 1.0);
        let rim = (LINE * 0.5 + 2.0 - off).clamp(0.0, 1.0);
        for c in 0..3 {
            pixel[c] = pixel[c] * (1.0 - rim) + MARK[c] * cover;
        }
    }
}

/// Free height over a place, at most `most` [m].
fn clearance(tracer: &Tracer<'_>, target: Vec3, normal: Vec3, most: f32) -> f32 {
    let start = 1e-3 * most;
    let ray = Ray { origin: target + normal * start, direction: normal, t_max: most };
    tracer.closest_hit(&ray).map_or(most, |hit| hit.t + start)
}

/// Direction from a place to a camera that sees it, and how far it can go back [m].
fn viewpoint(tracer: &Tracer<'_>, target: Vec3, normal: Vec3, scale: f32) -> (Vec3, f32) {
    let reach = (tracer.bounds().1 - tracer.bounds().0).length().max(1e-3);
    let origin = target + normal * (0.02 * scale).max(1e-5 * reach);
    let mut best = (f32::NEG_INFINITY, normal, scale);
    for k in 0..DIRECTIONS {
        // Evenly over the hemisphere; the golden angle keeps neighbours in height apart in azimuth.
        let up = (k as f32 + 0.5) / DIRECTIONS as f32;
        let (azimuth, r) = (TAU * (k as f32 * 0.618_034).fract(), (1.0 - up * up).sqrt());
        let side = normal.any_orthonormal_vector();
        let direction = normal * up + (side * libm::cosf(azimuth) + normal.cross(side) * libm::sinf(azimuth)) * r;
        let hit = tracer.closest_hit(&Ray { origin, direction, t_max: reach });
        let free = hit.map_or(reach, |h| h.t) * 0.92;
        // People look from above, and slantwise; far enough to see what is around.
        let slant = 1.0 - 2.0 * (up - 0.6).abs();
        let score =
            (free / (8.0 * scale)).min(1.0) + (free / reach).min(0.5) + 0.5 * slant + 0.3 * direction.y.max(-0.2);
        if score > best.0 {
            best = (score, direction, free);
        }
    }
    (best.1, best.2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ring_lies_around_the_middle_and_leaves_it_free() {
        let (width, height) = (SIZE[0] as usize, SIZE[1] as usize);
        let mut pixels = vec![[0.5; 3]; width * height];
        mark(&mut pixels);
        let at = |x: usize, y: usize| pixels[y * width + x];
        assert_eq!(at(width / 2, height / 2), [0.5; 3]);
        assert_eq!(at(width / 2 + RING as usize, height / 2), MARK);
        assert_eq!(at(width / 2, height / 2 - RING as usize), MARK);
        assert_eq!(at(4, 4), [0.5; 3]);
    }
}
