//! Surfaces that send out light: by texture, by alpha, and where their samples go.

use crate::solve::{Stage, square};
use crate::support;
use glam::{Vec2, Vec3};
use texelwalk::base::Rgb;
use texelwalk::scene::{Alpha, Material, Scene, Texture, TextureRef, Wrap};

/// A floor under a square emitter whose texture glows in `lit` of 16 × 16 texels (row-major).
fn textured(lit: impl Fn(usize) -> bool) -> Scene {
    let emitter = square(Vec3::new(0.0, 1.0, 0.0), Vec3::X * 2.0, Vec3::Z * 2.0);
    let mut all = square(Vec3::ZERO, Vec3::Z * 2.0, Vec3::X * 2.0).to_vec();
    all.extend(emitter);
    let mut scene = support::scene_from_triangles(&all);
    split(&mut scene, 2);
    for v in 0..scene.vertices.position.len() {
        let p = scene.vertices.position[v];
        scene.vertices.uv[0][v] = Vec2::new(p.x, p.z) / 2.0;
    }
    let pixels = (0..256).map(|i| if lit(i) { [255; 4] } else { [0, 0, 0, 255] }).collect();
    scene.textures.push(Texture { width: 16, height: 16, pixels, wrap: [Wrap::Clamp; 2], nearest: true });
    scene.materials[1].emission_texture =
        Some(TextureRef { texture: 0, uv_set: 0, transform: glam::Affine2::IDENTITY });
    scene
}

/// Makes the triangles from `first` on a second, glowing part.
fn split(scene: &mut Scene, first: u32) {
    let all = scene.triangles.len() as u32;
    scene.materials.push(Material { emission: Rgb::ONE, ..support::white() });
    let mut second = scene.parts[0].clone();
    scene.parts[0].triangles = 0..first;
    scene.parts[0].vertices = 0..3 * first;
    second.triangles = first..all;
    second.vertices = 3 * first..3 * all;
    second.material = scene.materials.len() - 1;
    scene.parts.push(second);
    scene.triangle_part[first as usize..].fill(1);
}

#[test]
fn a_texture_that_glows_in_a_corner_is_a_lamp_in_that_corner() {
    let by_texture = textured(|i| i % 16 < 2 && i / 16 < 2);
    let mut all = square(Vec3::ZERO, Vec3::Z * 2.0, Vec3::X * 2.0).to_vec();
    all.extend(square(Vec3::new(0.0, 1.0, 0.0), Vec3::X * 0.25, Vec3::Z * 0.25));
    let mut by_shape = support::scene_from_triangles(&all);
    split(&mut by_shape, 2);
    let (texture, shape) = (Stage::new(&by_texture, 8.0), Stage::new(&by_shape, 8.0));
    let up = |s: &Stage<'_>, i: usize| s.patches.normal[i].y > 0.9;
    let a = texture.mean(&texture.direct(64), |i| up(&texture, i));
    let b = shape.mean(&shape.direct(64), |i| up(&shape, i));
    assert!((a / b - 1.0).abs() < 5e-3, "{a} against {b}");
    let error = |s: &Stage<'_>| {
        let light = s.direct_halves(32, 1);
        let square = |i: usize| f64::from((light.halves[0][i] - light.halves[1][i]).length_squared()) / 12.0;
        let floor: Vec<usize> = (0..s.patches.front).filter(|&i| up(s, i)).collect();
        (floor.iter().map(|&i| square(i)).fold(0.0, |a, b| a + b) / floor.len() as f64).sqrt() / b
    };
    // Uniform sampling of the square would hit the corner once in 64 times, and be off by 1.4.
    assert!(error(&texture) < 0.05, "{}", error(&texture));
}

#[test]
fn a_texture_of_one_texel_is_found() {
    let lone = textured(|i| i == 8 * 16 + 9);
    let stage = Stage::new(&lone, 4.0);
    let up = |i: usize| stage.patches.normal[i].y > 0.9;
    let mean = stage.mean(&stage.direct(256), up);
    let mut expected = 0.0;
    let floor: Vec<usize> = (0..stage.patches.front).filter(|&i| up(i)).collect();
    for &i in &floor {
        let to = Vec3::new((9.5) / 8.0, 1.0, 8.5 / 8.0) - stage.patches.position[i];
        expected += f64::from(to.y * to.y / to.length_squared().powi(2)) / 64.0 / floor.len() as f64;
    }
    assert!((mean / expected - 1.0).abs() < 0.01, "{mean} against {expected}");
}

/// glTF paints what a material sends out over what is behind it, by alpha: so much of the surface is there to glow.
#[test]
fn what_alpha_leaves_of_a_surface_glows() {
    let all = textured(|_| true);
    let opaque = Stage::new(&all, 4.0);
    let up = |s: &Stage<'_>, i: usize| s.patches.normal[i].y > 0.9;
    let mean = |s: &Stage<'_>| s.mean(&s.direct(64), |i| up(s, i));
    let whole = mean(&opaque);
    let with = |alpha: Alpha, factor: f32, pixel: &dyn Fn(usize) -> [u8; 4]| {
        let mut scene = textured(|_| true);
        let glow = scene.materials[1].emission_texture.take();
        scene.textures[0].pixels = (0..256).map(pixel).collect();
        let material = &mut scene.materials[1];
        (material.alpha, material.base_color_texture) = (alpha, glow);
        material.base_color.w = factor;
        mean(&Stage::new(&scene, 4.0)) / whole
    };
    let faint = with(Alpha::Blend, 0.25, &|_| [255; 4]);
    assert!((faint - 0.25).abs() < 1e-3, "{faint}");
    let faint = with(Alpha::Blend, 1.0, &|_| [255, 255, 255, 51]);
    assert!((faint - 0.2).abs() < 1e-3, "{faint}");
    let checkered = |i: usize| [255, 255, 255, if (i / 16 + i).is_multiple_of(2) { 255 } else { 0 }];
    let holes = with(Alpha::Mask(0.5), 1.0, &checkered);
    assert!((holes - 0.5).abs() < 5e-3, "{holes}");
    assert_eq!(with(Alpha::Mask(0.5), 0.4, &|_| [255; 4]), 0.0);
    assert!((with(Alpha::Opaque, 0.25, &|_| [255; 4]) - 1.0).abs() < 1e-3);
}

/// A square that looks up, under what glows down.
fn below(side: f32, lamp: &[[Vec3; 3]]) -> Scene {
    let mut all = square(Vec3::new(-0.5, 0.0, -0.5) * side, Vec3::Z * side, Vec3::X * side).to_vec();
    all.extend(lamp);
    let mut scene = support::scene_from_triangles(&all);
    split(&mut scene, 2);
    scene
}

/// Mean irradiance over π of what looks up, and the root mean square of the difference of its halves over it.
fn seen_from_below(scene: &Scene, samples: u32) -> (f64, f64) {
    let stage = Stage::new(scene, 20.0);
    let up: Vec<usize> = (0..stage.patches.front).filter(|&i| stage.patches.normal[i].y > 0.9).collect();
    let light = stage.direct_halves(samples, 1);
    let mean = |f: &dyn Fn(usize) -> f64| up.iter().map(|&i| f(i)).fold(0.0, |a, b| a + b) / up.len() as f64;
    let value = mean(&|i| f64::from((light.halves[0][i] + light.halves[1][i]).x * 0.5)) / core::f64::consts::PI;
    let apart = mean(&|i| f64::from(light.halves[0][i].x - light.halves[1][i].x).powi(2)).sqrt();
    (value, apart / core::f64::consts::PI / value)
}

/// A lamp of hundreds of faces that fills the view of a texel larger than them: choosing among the faces says little.
#[test]
fn lamps_that_fill_the_view_leave_little_noise() {
    let at = |ring: u32, k: u32| {
        let (sin, cos) = libm::sincosf((k % 24) as f32 * core::f32::consts::TAU / 24.0);
        Vec3::new(cos, 0.0, sin) * (0.02 * ring as f32) + Vec3::Y * 0.001
    };
    let quad = |(r, k): (u32, u32)| {
        let [a, b, c, d] = [at(r, k), at(r, k + 1), at(r + 1, k + 1), at(r + 1, k)];
        [[a, c, b], [a, d, c]]
    };
    let lamp: Vec<[Vec3; 3]> = (0..10).flat_map(|r| (0..24).map(move |k| (r, k))).flat_map(quad).collect();
    let (value, apart) = seen_from_below(&below(0.04, &lamp), 16);
    assert!((value - 1.0).abs() < 5e-3 && apart < 0.02, "{value}, halves apart by {apart}");
}

/// A lamp over one half of the square gives half of what one over all of it gives: by symmetry, at any height.
#[test]
fn what_both_ways_find_adds_up() {
    for height in [0.01, 0.04, 0.15] {
        let lamp = square(Vec3::new(0.0, height, -4.0), Vec3::X * 4.0, Vec3::Z * 8.0);
        let (value, _) = seen_from_below(&below(0.4, &lamp), 64);
        assert!((value - 0.5).abs() < 2.5e-3, "{height}: {value}");
    }
}

/// Squares of one metre that face each other, so far apart [m]: how much of what one sends out the other gets.
fn facing(distance: f64) -> f64 {
    let x = 1.0 / distance;
    let root = (1.0 + x * x).sqrt();
    let log = ((1.0 + x * x) / (1.0 + 2.0 * x * x).sqrt()).ln();
    2.0 / (core::f64::consts::PI * x * x) * (log + 2.0 * x * root * (x / root).atan() - 2.0 * x * x.atan())
}

#[test]
fn lamps_that_nothing_hides_leave_no_noise() {
    let lamp = square(Vec3::new(-0.5, 3.0, -0.5), Vec3::X, Vec3::Z);
    let (value, apart) = seen_from_below(&below(1.0, &lamp), 8);
    assert!((value / facing(3.0) - 1.0).abs() < 1e-4, "{value}, should be {}", facing(3.0));
    assert!(apart < 1e-6, "halves apart by {apart}");
}

/// Few samples of the border of a shadow are as bright as many, in the mean over texels and seeds.
#[test]
fn what_hides_a_part_of_a_lamp_makes_few_samples_no_darker() {
    let mut all = square(Vec3::new(-0.5, 0.0, -0.5), Vec3::Z, Vec3::X).to_vec();
    all.extend(square(Vec3::new(0.0, 1.0, -1.0), Vec3::X * 2.0, Vec3::Z * 2.0));
    all.extend(square(Vec3::new(-0.5, 3.0, -0.5), Vec3::X, Vec3::Z));
    let mut scene = support::scene_from_triangles(&all);
    split(&mut scene, 4);
    let stage = Stage::new(&scene, 10.0);
    let floor: Vec<usize> = (0..stage.patches.front).filter(|&i| stage.patches.position[i].y < 0.01).collect();
    let mean = |samples: u32, seed: u64| {
        let halves = stage.direct_halves(samples, seed).halves;
        let sum = |half: &[Rgb]| floor.iter().map(|&i| f64::from(half[i].x)).fold(0.0, |a, b| a + b);
        sum(&halves[0]) + sum(&halves[1])
    };
    let many = mean(4096, 1);
    let few: Vec<f64> = (0..40).map(|seed| mean(8, seed) / many - 1.0).collect();
    let off = few.iter().fold(0.0, |a, b| a + b) / 40.0;
    let spread = (few.iter().map(|v| (v - off).powi(2)).fold(0.0, |a, b| a + b) / 39.0 / 40.0).sqrt();
    assert!(off.abs() < 3.0 * spread + 1e-3, "{off} ± {spread}");
}

#[test]
fn a_screen_near_a_plane_through_zero_lights_as_it_does_elsewhere() {
    // The ends of ways to it are rounded by more than they are off it.
    let floor_under = |z: f32| {
        let mut all = square(Vec3::new(-2.0, -1.0, 4.0 + z), Vec3::X * 4.0, Vec3::Z * -4.0).to_vec();
        all.extend(square(Vec3::new(-0.6, 0.1, z), Vec3::X * 1.2, Vec3::Y * 0.7));
        let mut scene = support::scene_from_triangles(&all);
        split(&mut scene, 2);
        let stage = Stage::new(&scene, 8.0);
        let light = stage.direct(16);
        stage.mean(&light, |i| stage.patches.normal[i].y > 0.9)
    };
    let expected = floor_under(5.0);
    for z in [0.001, 0.004, 0.02, 0.0254, 0.05, 0.1] {
        let found = floor_under(z) / expected;
        assert!((found - 1.0).abs() < 2e-3, "at {z} m: {found} of the light");
    }
}

/// Of 512 × 512 texels 6 × 6 glow: points of a coarse grid miss them.
#[test]
fn a_small_lamp_in_a_large_black_picture_has_all_of_its_light() {
    let mut scene = textured(|_| false);
    let lit = |i: usize| (210..216).contains(&(i % 512)) && (333..339).contains(&(i / 512));
    let pixels = (0..512 * 512).map(|i| if lit(i) { [255; 4] } else { [0, 0, 0, 255] }).collect();
    scene.textures[0] = Texture { width: 512, height: 512, pixels, wrap: [Wrap::Clamp; 2], nearest: true };
    let stage = Stage::new(&scene, 4.0);
    let area = (2.0 * 6.0f64 / 512.0).powi(2);
    let flux = f64::from(stage.emitters.flux().x) / (area * core::f64::consts::PI);
    assert!((flux - 1.0).abs() < 0.01, "{flux} of the flux");
    let light = stage.direct(32);
    let floor: Vec<usize> = (0..stage.patches.front).filter(|&i| stage.patches.normal[i].y > 0.9).collect();
    let (mut sum, mut expected) = (0.0, 0.0);
    for i in floor {
        let to = Vec3::new(213.0 / 256.0, 1.0, 336.0 / 256.0) - stage.patches.position[i];
        sum += f64::from(light[i].x);
        expected += area * f64::from(to.y * to.y / to.length_squared().powi(2));
    }
    assert!((sum / expected - 1.0).abs() < 0.03, "{} of the light", sum / expected);
}

/// The light of a lamp of one texel, by either filter, in pictures of any size; and no more noise than that of a lamp of
/// geometry has with a choice or two more.
#[test]
fn a_lamp_of_one_texel_in_a_large_black_picture_has_all_of_its_light() {
    for (side, nearest) in [(256usize, true), (256, false), (2048, true), (2048, false)] {
        let mut scene = textured(|_| false);
        let (column, row) = (side * 2 / 5 + 1, side * 13 / 20 + 1);
        let pixel = |i: usize| if i == row * side + column { [255; 4] } else { [0, 0, 0, 255] };
        let pixels = (0..side * side).map(pixel).collect();
        let size = side as u32;
        scene.textures[0] = Texture { width: size, height: size, pixels, wrap: [Wrap::Repeat; 2], nearest };
        let area = (2.0 / side as f64).powi(2);
        scene.materials[1].emission = Rgb::splat(1.0 / area as f32);
        let stage = Stage::new(&scene, 4.0);
        let by_pieces = f64::from(stage.emitters.flux().x) / core::f64::consts::PI;
        assert!((by_pieces - 1.0).abs() < 0.02, "{side}: {by_pieces} of the flux");
        let by_part = texelwalk::light::flux_of_parts(&scene)[1].x / core::f64::consts::PI;
        assert!((by_part - 1.0).abs() < 1e-4, "{side}: {by_part} of the flux of the part");
        let halves = stage.direct_halves(32, 1).halves;
        let lamp = Vec2::new(column as f32 + 0.5, row as f32 + 0.5) * (2.0 / side as f32);
        let (mut sum, mut expected, mut apart, mut count) = (0.0, 0.0, 0.0, 0.0);
        for i in (0..stage.patches.front).filter(|&i| stage.patches.normal[i].y > 0.9) {
            let to = Vec3::new(lamp.x, 1.0, lamp.y) - stage.patches.position[i];
            let [a, b] = [0, 1].map(|half| f64::from(halves[half][i].x));
            sum += 0.5 * (a + b);
            apart += (a - b).powi(2);
            count += 1.0;
            expected += f64::from(to.y * to.y / to.length_squared().powi(2));
        }
        assert!((sum / expected - 1.0).abs() < 0.02, "{side}, {nearest}: {} of the light", sum / expected);
        let apart = (apart / count).sqrt() / (expected / count);
        assert!(apart < 0.25, "{side}, {nearest}: halves apart by {apart}");
    }
}
