//! Direct light: samplers against their densities, lights against closed forms, many lights against few.
//!
//! χ² by Wilson and Hilferty's cube root; seeds are fixed, so a failure is a fault and not bad luck.

#![allow(clippy::print_stderr, reason = "figures of the slow tests")]

use crate::solve;
use crate::solve::{Stage, square};
use crate::support;
use glam::{Mat3, Vec2, Vec3};
use std::f32::consts::PI;
use std::path::Path;
use texelwalk::base::distribution::Grid;
use texelwalk::base::{Progress, Rgb, Stream, warp};
use texelwalk::light::{self, Openings};
use texelwalk::patches::Tilts;
use texelwalk::scene::{Class, Environment, Light, Scene};
use texelwalk::walk::{self, Splat};

/// How many standard deviations the χ² of `counts` against `expected` (both sum to the same) lies off its mean.
fn surprise(counts: &[u64], expected: &[f64]) -> f64 {
    let terms = counts.iter().zip(expected).map(|(&c, e)| (c as f64 - e).powi(2) / e);
    let k = counts.len() as f64 - 1.0;
    let spread = 2.0 / (9.0 * k);
    ((terms.fold(0.0, |a, b| a + b) / k).cbrt() - (1.0 - spread)) / spread.sqrt()
}

/// Counts of `bin` over `n` draws of two uniform numbers, against `share` of each bin.
fn chi_square(n: u64, shares: &[f64], seed: u64, bin: impl Fn(Vec2) -> Option<usize>) -> f64 {
    let mut s: Stream = support::stream(seed);
    let mut counts = vec![0u64; shares.len()];
    let mut outside = 0u64;
    for _ in 0..n {
        match bin(Vec2::new(s.next_f32(), s.next_f32())) {
            Some(k) => counts[k] += 1,
            None => outside += 1,
        }
    }
    assert!(outside * 10_000 < n, "{outside} of {n} samples outside all bins");
    let inside = (n - outside) as f64;
    surprise(&counts, &shares.iter().map(|s| s * inside).collect::<Vec<_>>())
}

const FITS: f64 = 3.3;

/// Bins of equal solid angle times `density` integral: rings in z by sectors.
fn ring(v: Vec3, z_of: impl Fn(f32) -> f32, rings: usize, sectors: usize) -> Option<usize> {
    let t = z_of(v.z);
    let angle = v.y.atan2(v.x) / (2.0 * PI);
    let sector = ((angle - angle.floor()) * sectors as f32) as usize;
    (0.0..=1.0001)
        .contains(&t)
        .then(|| ((t * rings as f32) as usize).min(rings - 1) * sectors + sector.min(sectors - 1))
}

#[test]
fn cosine_and_cones_follow_their_densities() {
    let even = vec![1.0 / 63.0; 63];
    // ∫ cos θ/π over a ring is the difference of sin², so 1 − z² is uniform.
    let cosine = |u| ring(warp::square_to_cosine_hemisphere(u), |z| 1.0 - z * z, 9, 7);
    assert!(chi_square(200_000, &even, 1, cosine).abs() < FITS);
    let cone = |u| ring(warp::square_to_cone(u, 0.3), |z| (1.0 - z) / 0.7, 9, 7);
    assert!(chi_square(200_000, &even, 2, cone).abs() < FITS);
    let narrow = |u| ring(warp::square_to_narrow_cone(u, 0.7), |z| (1.0 - z) / 0.7, 9, 7);
    assert!(chi_square(200_000, &even, 3, narrow).abs() < FITS);
    assert!((warp::square_to_cone_pdf(0.3) * 2.0 * PI * 0.7 - 1.0).abs() < 1e-6);
    let wrong = |u| ring(warp::square_to_cone(u, 0.0), |z| 1.0 - z * z, 9, 7);
    assert!(chi_square(200_000, &even, 4, wrong) > 20.0, "a uniform hemisphere is no cosine");
}

#[test]
fn narrow_cones_keep_their_width() {
    // The sun from Neptune: 0.3 arc minutes; 1 − cos would have no digits left in single precision.
    let versine = 2.0 * (4.3e-5f32 / 2.0).powi(2);
    let mut s = support::stream(5);
    let n = 20_000;
    let mean = (0..n)
        .map(|_| {
            let v = warp::square_to_narrow_cone(Vec2::new(s.next_f32(), s.next_f32()), versine);
            f64::from(v.x * v.x + v.y * v.y)
        })
        .fold(0.0, |a, b| a + b)
        / f64::from(n);
    let expected = 0.5 * f64::from(4.3e-5f32).powi(2);
    assert!((mean / expected - 1.0).abs() < 0.02, "{mean} against {expected}");
}

/// 16 similar triangles that make up one.
fn sixteenths(t: [Vec3; 3]) -> Vec<[Vec3; 3]> {
    let quarter = |t: &[Vec3; 3]| {
        let [a, b, c] = *t;
        let (ab, bc, ca) = ((a + b) / 2.0, (b + c) / 2.0, (c + a) / 2.0);
        [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
    };
    quarter(&t).iter().flat_map(quarter).collect()
}

#[test]
fn spherical_triangles_are_covered_evenly() {
    for (seed, corners) in [
        [Vec3::new(-0.3, -0.2, 1.0), Vec3::new(0.9, -0.2, 0.8), Vec3::new(0.1, 1.4, 1.3)],
        [Vec3::new(-5.0, -3.0, 0.4), Vec3::new(6.0, -3.0, 0.4), Vec3::new(0.0, 7.0, 0.4)],
        [Vec3::new(1.0, 0.0, 0.1), Vec3::new(1.0, 0.3, 0.1), Vec3::new(2.0, 0.1, 0.9)],
    ]
    .into_iter()
    .enumerate()
    {
        let whole = warp::SphericalTriangle::new(corners).unwrap();
        let parts = sixteenths(corners);
        let solid = |t: &[Vec3; 3]| f64::from(warp::SphericalTriangle::new(*t).unwrap().solid_angle);
        let sum: f64 = parts.iter().map(solid).fold(0.0, |a, b| a + b);
        assert!((sum / f64::from(whole.solid_angle) - 1.0).abs() < 1e-4);
        let shares: Vec<f64> = parts.iter().map(|t| solid(t) / sum).collect();
        let inside = |t: &[Vec3; 3], d: Vec3| {
            let w = Mat3::from_cols(t[0], t[1], t[2]).inverse() * d;
            w.min_element()
        };
        let bin = |u| {
            let d = whole.sample(u);
            let best = (0..16).max_by(|&a, &b| inside(&parts[a], d).total_cmp(&inside(&parts[b], d)))?;
            (inside(&parts[best], d) > -1e-4).then_some(best)
        };
        let z = chi_square(100_000, &shares, 10 + seed as u64, bin);
        assert!(z.abs() < FITS, "triangle {seed}: {z}");
        // The same samples against areas instead of solid angles.
        let z = chi_square(100_000, &[1.0 / 16.0; 16], 10 + seed as u64, bin);
        assert!(z > 20.0, "triangle {seed}: the test does not see a wrong density ({z})");
    }
}

fn environment(rotation: f32) -> Environment {
    // Even, with a bright and a very bright spot.
    let value = |i: usize| match i {
        200 => 900.0,
        77 => 40.0,
        _ => 0.5 + (i % 7) as f32 * 0.1,
    };
    Environment::new(32, 16, (0..512).map(|i| Rgb::new(value(i), 1.0, 0.7 * value(i))).collect(), rotation).unwrap()
}

#[test]
fn grids_choose_by_weight() {
    let map = environment(0.0);
    let weight = |x: usize, y: usize| map.pixel(x, y).x * map.solid_angle(y);
    let grid = Grid::new(32, 16, weight);
    let shares: Vec<f64> = (0..512).map(|i| f64::from(grid.probability(i % 32, i / 32))).collect();
    let bin = |u| grid.sample(u).map(|([x, y], _)| y * 32 + x);
    let exact: Vec<f64> = (0..512).map(|i| f64::from(weight(i % 32, i / 32) / grid.total())).collect();
    assert!(shares.iter().zip(&exact).all(|(a, b)| (a - b).abs() < 1e-6));
    assert!(chi_square(2_000_000, &shares, 20, bin).abs() < FITS);
    // Directions drawn within the chosen pixels stay in them, uniform in the sine of elevation.
    let mut s = support::stream(21);
    let (mut sum, n) = (0.0f64, 100_000);
    for _ in 0..n {
        let place = Vec2::new(s.next_f32(), s.next_f32());
        sum += f64::from(map.toward([3, 0], place).y);
    }
    let exact = 0.5 * (1.0 + f64::from(libm::cosf(PI / 16.0)));
    assert!((sum / f64::from(n) - exact).abs() < 1e-4);
}

fn plane() -> Scene {
    support::scene_from_triangles(&square(Vec3::ZERO, Vec3::Z * 3.0, Vec3::X * 3.0))
}

/// A floor with a wall that shades a part of it.
fn floor_and_wall() -> Scene {
    let mut all = square(Vec3::ZERO, Vec3::Z * 3.0, Vec3::X * 3.0).to_vec();
    all.extend(square(Vec3::new(1.5, 0.0, 0.5), Vec3::Y, Vec3::Z * 2.0));
    support::scene_from_triangles(&all)
}

#[test]
fn a_sphere_above_the_horizon_gives_what_its_centre_gives() {
    for radius in [1e-3, 0.1, 0.9] {
        let mut scene = plane();
        let position = Vec3::new(1.3, 1.0, 1.7);
        scene.lights.push(Light::Point { position, intensity: Rgb::splat(5.0), range: f32::INFINITY, radius });
        let stage = Stage::new(&scene, 8.0);
        let light = stage.direct_halves(256, 1);
        let (mut got, mut exact) = (0.0, 0.0);
        for i in 0..stage.patches.front {
            let to = position - stage.patches.position[i];
            let expected = 5.0 * to.y / to.length().powi(3);
            let e = (light.halves[0][i].x + light.halves[1][i].x) * 0.5;
            // The centre of a texel of 1/8 m stands for its mean, within its curvature.
            assert!((e - expected).abs() < 0.03 * expected, "radius {radius}, texel {i}: {e} against {expected}");
            got += f64::from(e);
            exact += f64::from(expected);
        }
        assert!((got / exact - 1.0).abs() < 2e-3, "radius {radius}: {got} against {exact}");
    }
}

#[test]
fn shot_lines_of_a_sphere_agree_with_shadow_rays() {
    let mut scene = floor_and_wall();
    let position = Vec3::new(1.0, 0.8, 1.2);
    scene.lights.push(Light::Point { position, intensity: Rgb::ONE, range: 3.0, radius: 0.3 });
    compare_shot_and_gathered(&scene, 2e-2);
}

fn compare_shot_and_gathered(scene: &Scene, tolerance: f64) {
    let stage = Stage::new(scene, 6.0);
    let settings =
        walk::Settings { splat: Splat::None, lines: 1_000_000, bounces: Some(0), low_discrepancy: false, seed: 3 };
    let shot = stage.walk_with(None, &settings).direct;
    let gathered = stage.direct(128);
    for side in [0.0f32, 1.5] {
        let part = |i: usize| {
            let p = stage.patches.position[i];
            stage.patches.normal[i].y > 0.9 && (side..side + 1.5).contains(&p.x)
        };
        let (a, b) = (stage.mean(&shot, part), stage.mean(&gathered, part));
        assert!((a / b - 1.0).abs() < tolerance, "from {side}: shot {a}, gathered {b}");
    }
}

#[test]
fn a_constant_environment_gives_pi_times_its_radiance() {
    let mut scene = plane();
    scene.environment = Environment::new(16, 8, vec![Rgb::new(1.0, 2.0, 3.0); 128], 0.4);
    let stage = Stage::new(&scene, 4.0);
    for e in stage.direct(8) {
        assert!((e / PI - Vec3::new(1.0, 2.0, 3.0)).abs().max_element() < 1e-4, "{e}");
    }
}

#[test]
fn an_environment_adds_up_to_the_sum_over_its_pixels() {
    for rotation in [0.0, 2.0] {
        let mut scene = plane();
        let map = environment(rotation);
        let mut expected = Rgb::ZERO;
        let n = 16;
        for y in 0..16 {
            for x in 0..32 {
                for k in 0..n * n {
                    let place = Vec2::new((k % n) as f32 + 0.5, (k / n) as f32 + 0.5) / n as f32;
                    let cosine = map.toward([x, y], place).y.max(0.0);
                    expected += map.pixel(x, y) * (map.solid_angle(y) * cosine / (n * n) as f32);
                }
            }
        }
        scene.environment = Some(map);
        let stage = Stage::new(&scene, 6.0);
        for c in 0..3 {
            let channel: Vec<Rgb> = stage.direct(64).iter().map(|e| Rgb::splat(e[c])).collect();
            let mean = stage.mean(&channel, |_| true);
            assert!((mean / f64::from(expected[c]) - 1.0).abs() < 3e-3, "channel {c}: {mean}, {expected}");
        }
    }
}

/// Mean irradiance by shadow rays and gather together, by shadow rays alone, and what both find, if `rays` are declared
/// for each sample and `told` are what the gather goes by.
fn divided(scene: &Scene, rays: f32, told: f32) -> [f64; 3] {
    let stage = Stage::new(scene, 6.0);
    let p = &stage.patches;
    let settings = light::Settings { samples: 64, gather_rays: rays, seed: 3, directional: false };
    let direct =
        light::direct(&stage.tracer, p, &stage.emitters, (&Openings::default(), None), &settings, &Progress::default());
    let black = vec![Rgb::ZERO; p.len()];
    let none = Openings::default();
    let sky = |patch, normal, toward| stage.emitters.gathered_sky(scene, (&none, patch), normal, toward, told);
    let found = stage.gather(&black, &Tilts::default(), Some(&sky), 256, 7);
    let mean = |[a, b]: &[Vec<Rgb>; 2]| {
        let values: Vec<Rgb> = a.iter().zip(b).map(|(a, b)| (*a + *b) * 0.5).collect();
        stage.mean(&values, |_| true)
    };
    let (all, common) = (mean(&direct.halves), mean(&direct.gathered));
    [all - common + mean(&found), all, common]
}

#[test]
fn the_gather_finds_of_the_sky_what_shadow_rays_leave_to_it() {
    let mut even = plane();
    even.environment = Environment::new(16, 8, vec![Rgb::ONE; 128], 0.4);
    let [together, _, common] = divided(&even, 8.0, 8.0);
    assert!((together / f64::from(PI) - 1.0).abs() < 1e-4, "{together}");
    assert!((common / f64::from(PI) - 8.0 / 9.0).abs() < 1e-4, "an even sky is the gather's: {common}");

    let mut odd = floor_and_wall();
    odd.environment = Some(environment(1.0));
    let [together, alone, common] = divided(&odd, 2.0, 2.0);
    assert!((together / alone - 1.0).abs() < 4e-3, "{together}, {alone}");
    assert!(common < 0.6 * alone, "what is bright and small is not the gather's: {common} of {alone}");
    let [wrong, alone, _] = divided(&odd, 2.0, 3.0);
    assert!((wrong / alone - 1.0).abs() > 1.2e-2, "another division goes unnoticed");
}

#[test]
fn shot_environments_agree_with_gathered_ones() {
    let mut scene = floor_and_wall();
    scene.environment = Some(environment(1.0));
    compare_shot_and_gathered(&scene, 2e-2);
}

#[test]
fn a_disc_in_an_environment_is_a_sun() {
    let toward = Vec3::new(0.5, 0.7, 0.2).normalize();
    let angle = 0.2f32;
    let black = Environment::new(1024, 512, vec![Rgb::ZERO; 1024 * 512], 0.0).unwrap();
    let mut illuminance = 0.0;
    let pixels = (0..1024 * 512)
        .map(|i| {
            let pixel = [i % 1024, i / 1024];
            let bright = black.toward(pixel, Vec2::splat(0.5)).dot(toward) > libm::cosf(angle / 2.0);
            if bright {
                illuminance += 100.0 * black.solid_angle(pixel[1]);
            }
            if bright { Rgb::splat(100.0) } else { Rgb::ZERO }
        })
        .collect();
    let mut by_map = floor_and_wall();
    by_map.environment = Environment::new(1024, 512, pixels, 0.0);
    let mut by_sun = floor_and_wall();
    by_sun.lights.push(Light::Sun { direction: -toward, illuminance: Rgb::splat(illuminance), angle });
    let (map, sun) = (Stage::new(&by_map, 6.0), Stage::new(&by_sun, 6.0));
    let (a, b) = (map.direct(256), sun.direct(256));
    let up = |i: usize| map.patches.normal[i].y > 0.9;
    let (mean_a, mean_b) = (map.mean(&a, up), sun.mean(&b, up));
    assert!((mean_a / mean_b - 1.0).abs() < 1e-2, "{mean_a} against {mean_b}");
    let peak = illuminance * toward.y;
    for i in (0..a.len()).filter(|&i| up(i)) {
        assert!((a[i].x - b[i].x).abs() < 0.06 * peak, "texel {i}: {} against {}", a[i].x, b[i].x);
    }
}

/// A hall with pillars and n point lights below its ceiling, the same power in all.
fn hall(n: usize) -> Scene {
    let mut shape = vec![];
    support::cuboid(glam::DVec3::ZERO, glam::DVec3::new(40.0, 5.0, 40.0), 4, true, &mut shape);
    for k in 0..16 {
        let low = glam::DVec3::new(4.0 + 9.0 * f64::from(k % 4), 0.0, 4.0 + 9.0 * f64::from(k / 4));
        support::cuboid(low, low + glam::DVec3::new(1.0, 4.0, 1.0), 1, false, &mut shape);
    }
    let triangles: Vec<[Vec3; 3]> = shape.iter().map(|t| t.map(|p| p.as_vec3())).collect();
    let mut scene = support::scene_from_triangles(&triangles);
    let mut s = support::stream(40);
    for _ in 0..n {
        let position = Vec3::new(1.0 + 38.0 * s.next_f32(), 3.0 + 1.7 * s.next_f32(), 1.0 + 38.0 * s.next_f32());
        let intensity = Rgb::splat(2000.0 / n as f32);
        scene.lights.push(Light::Point { position, intensity, range: f32::INFINITY, radius: 0.0 });
    }
    scene
}

/// Shadow rays per texel, and the error that the halves show over the mean.
fn cost_and_error(scene: &Scene, samples: u32) -> (f64, f64) {
    let stage = Stage::new(scene, 1.0);
    let light = stage.direct_halves(samples, 1);
    let n = stage.patches.front as f64;
    let sum = |f: &dyn Fn(usize) -> f64| (0..stage.patches.front).map(f).fold(0.0, |a, b| a + b);
    let square = sum(&|i| f64::from((light.halves[0][i].x - light.halves[1][i].x).powi(2)) / 4.0);
    let mean = sum(&|i| f64::from(light.halves[0][i].x)) / n;
    (light.rays as f64 / n, (square / n).sqrt() / mean)
}

#[test]
fn a_thousand_lights_cost_little_more_than_ten() {
    // Ten are exact but for edges of shadows, so there is no cheaper way to look at them than this, and no larger error.
    let most = 0.036;
    let least_rays = |n: usize| {
        let runs = [1, 4, 16, 32, 64].into_iter().map(|samples| cost_and_error(&hall(n), samples));
        runs.filter(|r| r.1 <= most).map(|r| r.0).fold(f64::INFINITY, f64::min)
    };
    let (few, many) = (least_rays(10), least_rays(1000));
    assert!(many <= 3.0 * few, "{many} rays a texel against {few}");
}

#[test]
fn many_lights_add_up_to_the_same_as_each_alone() {
    // So many that the texels of a block look for them together.
    let scene = hall(40);
    let stage = Stage::new(&scene, 1.0);
    let together = stage.direct(64);
    let mut alone = vec![Rgb::ZERO; together.len()];
    for part in scene.lights.chunks(8) {
        let mut one = hall(0);
        one.lights = part.to_vec();
        let stage = Stage::new(&one, 1.0);
        alone.iter_mut().zip(stage.direct(64)).for_each(|(sum, e)| *sum += e);
    }
    let (a, b) = (stage.mean(&together, |_| true), stage.mean(&alone, |_| true));
    assert!((a / b - 1.0).abs() < 2e-3, "{a} against {b}");
}

#[test]
fn halves_are_independent_and_tell_the_error() {
    let scene = solve::load("cornell/cornell.gltf");
    let stage = Stage::new(&scene, 6.0);
    let reference = stage.direct_halves(256, 77);
    let test = stage.direct_halves(16, 5);
    let mean = |l: &light::Direct, i: usize| (l.halves[0][i] + l.halves[1][i]) * 0.5;
    let (mut real, mut told) = (0.0, 0.0);
    for i in 0..stage.patches.front {
        real += f64::from((mean(&test, i) - mean(&reference, i)).length_squared());
        told += f64::from((test.halves[0][i] - test.halves[1][i]).length_squared()) / 4.0;
    }
    // A little less than all of it: texels stop when they look good.
    let ratio = (told / real).sqrt();
    assert!((0.75..1.1).contains(&ratio), "the halves tell {ratio} of the error");
}

#[test]
fn the_same_bits_at_every_thread_count() {
    let mut scene = hall(30);
    scene.environment = Some(environment(0.3));
    scene.lights.push(Light::Sun { direction: -Vec3::Y, illuminance: Rgb::ONE, angle: 0.1 });
    let bits = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let halves = pool.install(|| Stage::new(&scene, 0.5).direct_halves(8, 1)).halves;
        halves.map(|h| h.iter().map(|v| v.to_array().map(f32::to_bits)).collect::<Vec<_>>())
    };
    let one = bits(1);
    assert_ne!(one[0], one[1]);
    assert!([2, 3].into_iter().all(|threads| bits(threads) == one));
}

/// A Radiance HDR file of 8 × 4 pixels without compression, and its first value.
fn hdr() -> Vec<u8> {
    let mut bytes = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 8\n".to_vec();
    for i in 0..32u8 {
        bytes.extend([128, 64 + i, 3, 129]);
    }
    bytes
}

#[test]
fn both_formats_give_the_same_light() {
    let folder = tempfile::tempdir().unwrap();
    let (a, b) = (folder.path().join("a.hdr"), folder.path().join("b.exr"));
    std::fs::write(&a, hdr()).unwrap();
    let first = Environment::load(&a, 1.0, 0.0).unwrap().output;
    assert!((first.pixel(0, 0).x - 1.0).abs() < 0.01, "{}", first.pixel(0, 0));
    let pixel = |x: usize, y: usize| (first.pixel(x, y).x, first.pixel(x, y).y, first.pixel(x, y).z);
    exr::prelude::write_rgb_file(&b, 8, 4, pixel).unwrap();
    assert_eq!(Environment::load(&b, 1.0, 0.0).unwrap().output, first);
    let half = Environment::load(&b, 0.5, 0.0).unwrap().output;
    assert_eq!(half.pixel(5, 3) * 2.0, first.pixel(5, 3));
}

#[test]
fn a_map_of_luminance_is_grey_and_negative_values_are_told_once() {
    use exr::prelude::{SpecificChannels, Vec2 as Place, WritableImage};
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("grey.exr");
    let write = |name: &str, value: &(dyn Fn(usize, usize) -> f32 + Sync)| {
        let channels = SpecificChannels::build().with_channel(name);
        let channels = channels.with_pixel_fn(|at: Place<usize>| (value(at.x(), at.y()),));
        exr::prelude::Image::from_channels((8, 4), channels).write().to_file(&path).unwrap();
        Environment::load(&path, 2.0, 0.0)
    };
    let grey = write("Y", &|x, y| (x + 8 * y) as f32).unwrap();
    assert!(grey.warnings.is_empty());
    assert_eq!(grey.output.pixel(5, 3), Rgb::splat(58.0));
    let odd = write("Y", &|x, _| if x < 2 { -0.5 } else { 1.0 }).unwrap();
    assert_eq!([odd.output.pixel(0, 0), odd.output.pixel(2, 0)], [Rgb::ZERO, Rgb::splat(2.0)]);
    let told: Vec<(&str, &str)> = odd.warnings.iter().map(|w| (w.code, w.message.as_str())).collect();
    assert!(matches!(told[..], [("negative-environment", text)] if text.contains("8 of 32")), "{told:?}");
    assert!(write("Z", &|_, _| 1.0).is_err());
}

#[test]
fn broken_environments_are_one_clear_error() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("map.hdr");
    let refused = |bytes: &[u8]| {
        std::fs::write(&path, bytes).unwrap();
        let error = Environment::load(&path, 1.0, 0.0).unwrap_err();
        assert!(matches!(error.class(), Class::Invalid | Class::Unsupported), "{error}");
        let text = error.to_string();
        assert!(text.contains("map.hdr") && text.contains("environment map") && !text.contains('\n'), "{text}");
    };
    let good = hdr();
    for length in [0, 1, 11, 30, good.len() - 1] {
        refused(&good[..length]);
    }
    refused(b"\x89PNG\r\n\x1a\n");
    refused(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 30000 +X 30000\n");
    refused(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4000 +X 8000\n");
    refused(b"\x76\x2f\x31\x01 and then nothing");
    exr::prelude::write_rgb_file(&path, 8, 4, |x, _| (if x == 3 { f32::INFINITY } else { 1.0 }, 1.0, 1.0)).unwrap();
    refused(&std::fs::read(&path).unwrap());
    assert!(matches!(Environment::load(Path::new("/no/such.hdr"), 1.0, 0.0).unwrap_err().class(), Class::Io));
}

#[test]
fn the_command_takes_an_environment_and_names_it() {
    let folder = tempfile::tempdir().unwrap();
    let (good, bad) = (folder.path().join("good.hdr"), folder.path().join("bad.hdr"));
    std::fs::write(&good, hdr()).unwrap();
    std::fs::write(&bad, &hdr()[..60]).unwrap();
    let bake = |environment: &Path| {
        std::process::Command::new(env!("CARGO_BIN_EXE_texelwalk"))
            .args([
                "bake",
                "--quiet",
                "--preset",
                "preview",
                "--texels-per-meter",
                "2",
                "--environment-rotation",
                "-90",
            ])
            .args(["--sky-horizon", "0.1", "--environment-intensity", "2", "--light-radius", "0.1", "--environment"])
            .arg(environment)
            .arg(solve::fixture("cornell/cornell.gltf"))
            .arg("-o")
            .arg(folder.path().join("out/"))
            .arg("--depfile")
            .arg(folder.path().join("out.d"))
            .arg("--report")
            .arg(folder.path().join("out.json"))
            .output()
            .unwrap()
    };
    let text = |o: &std::process::Output| String::from_utf8_lossy(&o.stderr).into_owned();
    let out = bake(&folder.path().join("none.hdr"));
    assert_eq!(out.status.code(), Some(4), "{}", text(&out));
    let out = bake(&bad);
    assert_eq!((out.status.code(), text(&out).trim().lines().count()), (Some(3), 1), "{}", text(&out));
    let out = bake(&good);
    assert_eq!(out.status.code(), Some(0), "{}", text(&out));
    for file in ["out.d", "out.json"] {
        assert!(std::fs::read_to_string(folder.path().join(file)).unwrap().contains("good.hdr"), "{file}");
    }
}

#[test]
fn one_sample_is_enough_to_find_edges_of_shadows() {
    // A square in the light of a sun, and of a lamp as small as a marble, hides a part of a floor of 24 × 24 texels.
    let mut all = square(Vec3::ZERO, Vec3::Z * 3.0, Vec3::X * 3.0).to_vec();
    all.extend(square(Vec3::new(0.4, 0.5, 1.3), Vec3::new(1.1, 0.0, 1.0), Vec3::new(1.0, 0.0, -1.1)));
    let sun = Light::Sun { direction: -Vec3::Y, illuminance: Rgb::ONE, angle: 0.0 };
    let position = Vec3::new(1.5, 4.0, 1.5);
    let lamp = Light::Point { position, intensity: Rgb::splat(16.0), range: f32::INFINITY, radius: 0.01 };
    for (name, light, most) in [("sun", sun, 0.06), ("lamp", lamp, 0.11)] {
        let mut scene = support::scene_from_triangles(&all);
        scene.lights.push(light);
        let stage = Stage::new(&scene, 8.0);
        let p = &stage.patches;
        let truth = stage.direct(2048);
        let is_cut = |i: &usize| p.position[*i].y < 0.1 && (0.05..0.6).contains(&truth[*i].x);
        let cut: Vec<usize> = (0..p.front).filter(is_cut).collect();
        let mut sum = 0.0;
        for seed in 1..=8 {
            let [a, b] = stage.direct_halves(1, seed).halves;
            sum += cut.iter().map(|&i| f64::from((a[i].x + b[i].x) * 0.5 - truth[i].x).powi(2)).sum::<f64>();
        }
        let off = (sum / (8 * cut.len()) as f64).sqrt();
        eprintln!("{name}: {} texels cut, off by {off:.3}", cut.len());
        assert!(cut.len() > 20 && off < most, "{name}: {off} of {} texels", cut.len());
    }
}
