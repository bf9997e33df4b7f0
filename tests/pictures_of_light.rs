//! Surfaces that glow by a picture: what of it is black, what is noise, and how much work it is.

#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "support/solve.rs"]
mod solve;
#[path = "support/mod.rs"]
mod support;

use glam::{Affine2, Vec2, Vec3};
use solve::{Stage, square};
use std::time::Instant;
use texelwalk::base::Rgb;
use texelwalk::light::Emitters;
use texelwalk::scene::{Material, Scene, Texture, TextureRef, Wrap};

/// Pixels per side of the pictures.
const SIDE: u32 = 512;
/// Lamps of a picture, squares of this many pixels, by their corners.
const LAMP: u32 = 8;
const LAMPS: [[u32; 2]; 5] = [[40, 60], [200, 310], [333, 120], [420, 444], [97, 401]];

fn picture(pixel: impl Fn(u32, u32) -> u8) -> Texture {
    let value = |k: u32| pixel(k % SIDE, k / SIDE);
    let pixels = (0..SIDE * SIDE).map(|k| [value(k), value(k), value(k), 255]).collect();
    Texture { width: SIDE, height: SIDE, pixels, wrap: [Wrap::Repeat; 2], nearest: false }
}

fn is_lamp(x: u32, y: u32) -> bool {
    LAMPS.iter().any(|&[a, b]| (a..a + LAMP).contains(&x) && (b..b + LAMP).contains(&y))
}

/// Numbers that look random.
fn noise(x: u32, y: u32) -> u32 {
    (texelwalk::base::random::mix(u64::from(y) << 32 | u64::from(x)) >> 40) as u32
}

/// A floor of 6 × 6 m, 1 m below something that glows, and is white but gets no light.
fn over_floor(shape: &[[Vec3; 3]], material: Material) -> Scene {
    let floor = square(Vec3::new(-3.0, 0.0, -3.0), Vec3::Z * 6.0, Vec3::X * 6.0);
    let mut scene = support::scene_of_two(&floor, shape, Material { emission: Rgb::ONE, ..material });
    scene.parts[1].receives = false;
    scene
}

/// A square of 2 × 2 m over the floor, of 2·n² triangles, that glows by a picture.
fn screen_over_floor(n: usize, texture: Texture) -> Scene {
    let step = 2.0 / n as f32;
    let cell = |k: usize| {
        let corner = Vec3::new((k % n) as f32 * step - 1.0, 1.0, (k / n) as f32 * step - 1.0);
        square(corner, Vec3::X * step, Vec3::Z * step)
    };
    let screen: Vec<[Vec3; 3]> = (0..n * n).flat_map(cell).collect();
    let emission_texture = Some(TextureRef { texture: 0, uv_set: 0, transform: Affine2::IDENTITY });
    let mut scene = over_floor(&screen, Material { emission_texture, ..support::white() });
    scene.vertices.uv[0] = scene.vertices.position.iter().map(|p| (Vec2::new(p.x, p.z) + 1.0) * 0.5).collect();
    scene.textures.push(texture);
    scene
}

/// Mean direct light, and the error that the halves show over it.
fn light_and_error(scene: &Scene, samples: u32) -> (f64, f64) {
    let stage = Stage::new(scene, 4.0);
    let [a, b] = stage.direct_halves(samples, 3).halves;
    let n = a.len() as f64;
    let square = a.iter().zip(&b).map(|(a, b)| f64::from((a.x - b.x).powi(2)) / 4.0).fold(0.0, |a, b| a + b);
    let mean = a.iter().zip(&b).map(|(a, b)| f64::from(a.x + b.x) / 2.0).fold(0.0, |a, b| a + b) / n;
    (mean, (square / n).sqrt() / mean)
}

#[test]
fn what_is_black_is_no_emitter_and_what_is_not_has_its_flux() {
    let scene = screen_over_floor(64, picture(|x, y| if is_lamp(x, y) { 255 } else { 0 }));
    let emitters = Emitters::new(&scene);
    // A lamp is as large as a cell of two triangles; cells beside it are in doubt.
    let most = LAMPS.len() * 4 * 4 * 2;
    assert!((LAMPS.len() * 2..=most).contains(&emitters.len()), "{} triangles of 8192 glow", emitters.len());
    let area = LAMPS.len() as f64 * f64::from(LAMP * LAMP) / f64::from(SIDE * SIDE) * 4.0;
    let flux = f64::from(emitters.flux().x) / core::f64::consts::PI / area;
    assert!((flux - 1.0).abs() < 0.01, "{flux} of the flux");
    assert_eq!(Emitters::new(&screen_over_floor(8, picture(|_, _| 0))).len(), 0);
}

#[test]
fn a_picture_lights_as_the_lamps_on_it_do() {
    let scene = screen_over_floor(64, picture(|x, y| if is_lamp(x, y) { 255 } else { 0 }));
    // The same lamps as pieces of geometry.
    let at = |p: u32| p as f32 / SIDE as f32 * 2.0 - 1.0;
    let side = LAMP as f32 / SIDE as f32 * 2.0;
    let lamp = |&[x, y]: &[u32; 2]| square(Vec3::new(at(x), 1.0, at(y)), Vec3::X * side, Vec3::Z * side);
    let plain = over_floor(&LAMPS.iter().flat_map(lamp).collect::<Vec<_>>(), support::white());
    let (by_picture, _) = light_and_error(&scene, 64);
    let (by_shape, _) = light_and_error(&plain, 64);
    assert!((by_picture / by_shape - 1.0).abs() < 0.01, "{by_picture} against {by_shape}");
}

#[test]
fn what_compression_leaves_in_the_dark_costs_no_samples() {
    let lamps = |dark: u32| picture(move |x, y| if is_lamp(x, y) { 255 } else { (noise(x, y) % (dark + 1)) as u8 });
    let (_, clean) = light_and_error(&screen_over_floor(100, lamps(0)), 4);
    let (_, noisy) = light_and_error(&screen_over_floor(100, lamps(2)), 4);
    assert!(noisy < 1.3 * clean, "{noisy} against {clean}");
}

#[test]
fn more_triangles_with_a_picture_take_little_more_time() {
    let seconds = |n: usize| {
        let scene = screen_over_floor(n, picture(|x, y| noise(x, y) as u8));
        let start = Instant::now();
        assert_eq!(Emitters::new(&scene).len(), 2 * n * n);
        start.elapsed().as_secs_f64()
    };
    let (few, many) = (seconds(40), seconds(200));
    assert!(many < 6.0 * few, "{many} s for 80,000 triangles, {few} s for 3,200");
}
