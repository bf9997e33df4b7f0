//! Light that comes in through a window, from the sky and from a glowing surface behind it, against closed forms; and the walk in
//! a room with a window below bright ground.

use crate::solve::{Stage, square};
use crate::support;
use glam::{Vec3, Vec4};
use texelwalk::base::{Progress, Rgb};
use texelwalk::gather::Sky as GatheredSky;
use texelwalk::light::{self, Openings};
use texelwalk::patches::Tilts;
use texelwalk::scene::{Material, Scene, Sky};
use texelwalk::walk::{self, Splat};

/// Half the edge of the window [m].
const HALF: f32 = 0.4;

/// A room of 4 × 3 × 4 m, seen from inside, with a window in the middle of the wall at z = −2.
fn room() -> Vec<[Vec3; 3]> {
    let (x, y, z) = (Vec3::X, Vec3::Y, Vec3::Z);
    let corner = Vec3::new(-2.0, -1.5, -2.0);
    let mut all = vec![];
    let mut wall = |o: Vec3, u: Vec3, v: Vec3| all.extend(square(o, u, v));
    wall(corner, z * 4.0, x * 4.0);
    wall(corner + y * 3.0, x * 4.0, z * 4.0);
    wall(corner, y * 3.0, z * 4.0);
    wall(corner + x * 4.0, z * 4.0, y * 3.0);
    wall(corner + z * 4.0, y * 3.0, x * 4.0);
    let (below, beside) = (1.5 - HALF, 2.0 - HALF);
    wall(corner, x * 4.0, y * below);
    wall(corner + y * (3.0 - below), x * 4.0, y * below);
    wall(corner + y * below, x * beside, y * (2.0 * HALF));
    wall(corner + y * below + x * (4.0 - beside), x * beside, y * (2.0 * HALF));
    all
}

/// Irradiance at a point of the wall that faces the window, by radiance 1 behind it (Lambert's formula).
fn expected(position: Vec3) -> f64 {
    let corner = |x: f32, y: f32| (Vec3::new(x * HALF, y * HALF, -2.0) - position).as_dvec3().normalize();
    let corners = [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)];
    let edge = |k: usize| {
        let (a, b) = (corners[k], corners[(k + 1) % 4]);
        a.cross(b).normalize() * a.dot(b).acos()
    };
    (0..4).map(|k| edge(k).z).fold(0.0, |a, b| a + b).abs() * 0.5
}

/// The wall that faces the window.
fn faces(stage: &Stage<'_>) -> Vec<usize> {
    let facing = |i: &usize| stage.patches.position[*i].z > 1.99 && stage.patches.exposed[*i] >= 1.0;
    (0..stage.patches.front).filter(facing).collect()
}

/// How direct light was found.
struct Found {
    /// Mean over closed form.
    mean: f64,
    /// Root mean square of the texels' errors, over the mean.
    error: f64,
    rays: u64,
}

fn found(stage: &Stage<'_>, openings: &Openings, samples: u32) -> Found {
    let wall = faces(stage);
    let exact: Vec<f64> = wall.iter().map(|&i| expected(stage.patches.position[i])).collect();
    let mean = exact.iter().fold(0.0, |a, b| a + b) / wall.len() as f64;
    let (mut sum, mut square, mut rays, seeds) = (0.0, 0.0, 0, 16u32);
    for seed in 0..seeds {
        let how = light::Settings { samples, gather_rays: 0.0, seed: seed.into(), directional: false };
        let progress = Progress::default();
        let direct = light::direct(&stage.tracer, &stage.patches, &stage.emitters, openings, &how, &progress);
        for (&i, exact) in wall.iter().zip(&exact) {
            let light = f64::from((direct.halves[0][i] + direct.halves[1][i]).x) * 0.5;
            sum += light;
            square += (light - exact).powi(2);
        }
        rays += direct.rays;
    }
    let n = wall.len() as f64 * f64::from(seeds);
    Found { mean: sum / n / mean, error: (square / n).sqrt() / mean, rays }
}

fn openings(stage: &Stage<'_>) -> Openings {
    Openings::find(&stage.tracer, &stage.patches, &stage.emitters, 5, &Progress::default())
}

/// With maps of where light comes in and without.
fn compared(scene: &Scene, samples: u32) -> [Found; 2] {
    let stage = Stage::new(scene, 8.0);
    [openings(&stage), Openings::default()].map(|openings| found(&stage, &openings, samples))
}

fn under_sky() -> Scene {
    let grey = Material { base_color: Vec4::new(0.5, 0.5, 0.5, 1.0), ..support::white() };
    Scene { sky: Sky::constant(Rgb::ONE), ..support::scene_with_material(&room(), grey) }
}

#[test]
fn the_sky_in_a_window_is_found_by_few_samples() {
    let [guided, blind] = compared(&under_sky(), 4);
    assert!((guided.mean - 1.0).abs() < 0.01, "{} {} {} {}", guided.mean, guided.error, blind.mean, blind.error);
    let merit = |found: &Found| 1.0 / (found.error.powi(2) * found.rays as f64);
    assert!(
        merit(&guided) > 4.0 * merit(&blind),
        "{} by {}, {} by {}",
        guided.error,
        guided.rays,
        blind.error,
        blind.rays
    );
}

#[test]
fn what_glows_behind_a_window_is_found_by_few_samples() {
    let backdrop = square(Vec3::new(-15.0, -7.5, -3.0), Vec3::X * 30.0, Vec3::Y * 15.0);
    let glowing = Material { emission: Rgb::ONE, ..support::white() };
    let [guided, blind] = compared(&support::scene_of_two(&room(), &backdrop, glowing), 4);
    // Where no ray of a block passes the window, samples alone look for it, and bring too little in the mean.
    assert!((guided.mean - 1.0).abs() < 0.04 && blind.mean < 0.8, "{}, without maps {}", guided.mean, blind.mean);
    assert!(guided.error < 0.4 * blind.error, "{}, without maps {}", guided.error, blind.error);
}

#[test]
fn the_gather_finds_what_samples_through_a_window_leave_to_it() {
    let scene = under_sky();
    let stage = Stage::new(&scene, 8.0);
    let openings = openings(&stage);
    let how = light::Settings { samples: 16, gather_rays: 8.0, seed: 3, directional: false };
    let progress = Progress::default();
    let direct = light::direct(&stage.tracer, &stage.patches, &stage.emitters, &openings, &how, &progress);
    let together = |told: f32| {
        let sky = |patch: usize, normal: Vec3, toward: Vec3| {
            stage.emitters.gathered_sky(&scene, (&openings, patch), normal, toward, told)
        };
        let black = vec![Rgb::ZERO; stage.patches.len()];
        let sky: GatheredSky<'_> = &sky;
        let gathered = stage.gather(&black, &Tilts::default(), Some(sky), 1024, 7);
        let all = |i: usize| {
            let half = |h: usize| direct.halves[h][i] - direct.gathered[h][i] + gathered[h][i];
            f64::from((half(0) + half(1)).x) * 0.5
        };
        let wall = faces(&stage);
        let exact = wall.iter().map(|&i| expected(stage.patches.position[i])).fold(0.0, |a, b| a + b);
        wall.into_iter().map(all).fold(0.0, |a, b| a + b) / exact
    };
    assert!((together(8.0) - 1.0).abs() < 0.01, "{}", together(8.0));
    assert!((together(64.0) - 1.0).abs() > 0.02, "another division goes unnoticed: {}", together(64.0));
}

#[test]
fn lines_go_where_they_count_not_into_the_sky() {
    let mut triangles = room();
    triangles.extend(square(Vec3::new(-8.0, 2.5, -8.0), Vec3::Z * 16.0, Vec3::X * 16.0));
    let grey = Material { base_color: Vec4::new(0.6, 0.6, 0.6, 1.0), ..support::white() };
    let scene = support::scene_with_material(&triangles, grey);
    let stage = Stage::new(&scene, 4.0);
    let patches = &stage.patches;
    let light = |i: usize, outside: f32| match patches.position[i].y {
        y if y > 2.0 => outside,
        y if y < -1.499 && patches.normal[i].y > 0.9 => 1.0,
        _ => 0.0,
    };
    let direct = |outside: f32| (0..patches.len()).map(|i| Rgb::splat(light(i, outside))).collect::<Vec<Rgb>>();
    let wall = faces(&stage);
    let walked = |outside: f32, lines: u64, low_discrepancy: bool, seed: u64| {
        let how = walk::Settings { splat: Splat::None, lines, bounces: None, low_discrepancy, seed };
        let walk = stage.walk_with(Some(&direct(outside)), &how);
        for bounce in walk.ledger.iter().filter(|bounce| bounce.lines > 1000) {
            let spent = (bounce.received[0] + bounce.escaped[0] + bounce.culled[0]) / bounce.shot[0];
            assert!((spent - 1.0).abs() < 1e-5, "{bounce:?}");
            assert!((bounce.shot[0] / bounce.unshot[0] - 1.0).abs() < 0.01, "{bounce:?}");
        }
        wall.iter().map(|&i| f64::from(walk.indirect[i].x)).collect::<Vec<f64>>()
    };
    // Nothing of what is above the roof comes in.
    let truth = walked(0.0, 4_000_000, false, 99);
    let mean = truth.iter().fold(0.0, |a, b| a + b) / truth.len() as f64;
    let seeds = 8;
    let compared = |low_discrepancy: bool| {
        let (mut bias, mut square) = (0.0, 0.0);
        for seed in 0..seeds {
            for (light, truth) in walked(50.0, 50_000, low_discrepancy, seed).into_iter().zip(&truth) {
                bias += light - truth;
                square += (light - truth).powi(2);
            }
        }
        let n = truth.len() as f64 * seeds as f64;
        [bias / n / mean, (square / n).sqrt() / mean]
    };
    let [[bias, error], [_, by_power]] = [compared(true), compared(false)];
    assert!(bias.abs() < 0.03, "{bias}");
    assert!(error < 0.4 * by_power, "{error}, by power {by_power}");
}
