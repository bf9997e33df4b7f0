//! Light that comes in through a window, from the sky and from a glowing surface behind it, against closed forms; and the walk in
//! a room with a window below bright ground.

use crate::solve::{Stage, square};
use crate::support;
use glam::{Vec3, Vec4};
use texelwalk::base::{Progress, Rgb};
use texelwalk::gather::Sky as GatheredSky;
use texelwalk::light::{self, Openings};
use texelwalk::patches::{Outlook, Tilts};
use texelwalk::scene::{Material, Scene, Sky};
use texelwalk::walk::{self, Splat};

/// Half the edge of a window, and of a hole [m].
const HALF: f32 = 0.4;
const HOLE: f32 = 0.12;

/// A room of 4 × 3 × 4 m, seen from inside, with a window of twice `half` the edge in the middle of the wall at z = −2.
fn room(half: f32) -> Vec<[Vec3; 3]> {
    let (x, y, z) = (Vec3::X, Vec3::Y, Vec3::Z);
    let corner = Vec3::new(-2.0, -1.5, -2.0);
    let mut all = vec![];
    let mut wall = |o: Vec3, u: Vec3, v: Vec3| all.extend(square(o, u, v));
    wall(corner, z * 4.0, x * 4.0);
    wall(corner + y * 3.0, x * 4.0, z * 4.0);
    wall(corner, y * 3.0, z * 4.0);
    wall(corner + x * 4.0, z * 4.0, y * 3.0);
    wall(corner + z * 4.0, y * 3.0, x * 4.0);
    let (below, beside) = (1.5 - half, 2.0 - half);
    wall(corner, x * 4.0, y * below);
    wall(corner + y * (3.0 - below), x * 4.0, y * below);
    wall(corner + y * below, x * beside, y * (2.0 * half));
    wall(corner + y * below + x * (4.0 - beside), x * beside, y * (2.0 * half));
    all
}

/// Irradiance at a point of the wall that faces the window, by radiance 1 behind it (Lambert's formula).
fn expected(position: Vec3, half: f32) -> f64 {
    let corner = |x: f32, y: f32| (Vec3::new(x * half, y * half, -2.0) - position).as_dvec3().normalize();
    let corners = [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)];
    let edge = |k: usize| {
        let (a, b) = (corners[k], corners[(k + 1) % 4]);
        a.cross(b).normalize() * a.dot(b).acos()
    };
    (0..4).map(|k| edge(k).z).fold(0.0, |a, b| a + b).abs() * 0.5
}

/// The wall that faces the window.
fn faces(stage: &Stage<'_>) -> Vec<usize> {
    let position = |i: usize| stage.patches.position[i];
    let facing = |i: &usize| position(*i).z > 1.99 && position(*i).y < 1.5 && stage.patches.exposed[*i] >= 1.0;
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

/// Samples of a texel, and seeds.
#[derive(Clone, Copy)]
struct Effort {
    samples: u32,
    seeds: u32,
}

fn found(stage: &Stage<'_>, half: f32, openings: &Openings, effort: Effort) -> Found {
    found_by(stage, half, (openings, None), effort)
}

fn found_by(stage: &Stage<'_>, half: f32, by: (&Openings, Option<&Outlook>), effort: Effort) -> Found {
    let wall = faces(stage);
    let exact: Vec<f64> = wall.iter().map(|&i| expected(stage.patches.position[i], half)).collect();
    let mean = exact.iter().fold(0.0, |a, b| a + b) / wall.len() as f64;
    let Effort { samples, seeds } = effort;
    let (mut sum, mut square, mut rays) = (0.0, 0.0, 0);
    for seed in 0..seeds {
        let how = light::Settings { samples, gather_rays: 0.0, seed: seed.into(), directional: false };
        let progress = Progress::default();
        let direct = light::direct(&stage.tracer, &stage.patches, &stage.emitters, by, &how, &progress);
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
    looked(stage, 5)
}

fn looked(stage: &Stage<'_>, seed: u64) -> Openings {
    Openings::find(&stage.tracer, &stage.patches, &stage.emitters, seed, &Progress::default())
}

/// With maps of where light comes in and without.
fn compared(scene: &Scene) -> [Found; 2] {
    let stage = Stage::new(scene, 8.0);
    [openings(&stage), Openings::default()]
        .map(|openings| found(&stage, HALF, &openings, Effort { samples: 4, seeds: 8 }))
}

fn under_sky(half: f32) -> Scene {
    let grey = Material { base_color: Vec4::new(0.5, 0.5, 0.5, 1.0), ..support::white() };
    Scene { sky: Sky::constant(Rgb::ONE), ..support::scene_with_material(&room(half), grey) }
}

#[test]
fn the_sky_in_a_window_is_found_by_few_samples() {
    let [guided, blind] = compared(&under_sky(HALF));
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
fn a_hole_that_one_block_has_found_is_found_by_all() {
    // Of the wall that faces it, one ray in 500 finds out.
    let scene = under_sky(HOLE);
    let effort = Effort { samples: 4, seeds: 16 };
    let stage = Stage::new(&scene, 8.0);
    let all: Vec<Found> = (0..2).map(|seed| found(&stage, HOLE, &looked(&stage, seed), effort)).collect();
    let mean = all.iter().map(|found| found.mean).fold(0.0, |a, b| a + b) / all.len() as f64;
    let error = all.iter().map(|found| found.error).fold(0.0, f64::max);
    let blind = found(&stage, HOLE, &Openings::default(), effort);
    assert!((mean - 1.0).abs() < 0.02, "{mean}");
    assert!(error < 0.2 * blind.error, "{error}, without maps {}", blind.error);
}

#[test]
fn what_glows_behind_a_window_is_found_by_few_samples() {
    let backdrop = square(Vec3::new(-15.0, -7.5, -3.0), Vec3::X * 30.0, Vec3::Y * 15.0);
    let glowing = Material { emission: Rgb::ONE, ..support::white() };
    let [guided, blind] = compared(&support::scene_of_two(&room(HALF), &backdrop, glowing));
    // Where no ray of a block passes the window, samples alone look for it, and bring too little in the mean.
    assert!((guided.mean - 1.0).abs() < 0.04 && blind.mean < 0.8, "{}, without maps {}", guided.mean, blind.mean);
    assert!(guided.error < 0.4 * blind.error, "{}, without maps {}", guided.error, blind.error);
}

#[test]
fn the_gather_finds_what_samples_through_a_window_leave_to_it() {
    let scene = under_sky(HALF);
    let stage = Stage::new(&scene, 8.0);
    let openings = openings(&stage);
    let how = light::Settings { samples: 16, gather_rays: 8.0, seed: 3, directional: false };
    let progress = Progress::default();
    let direct = light::direct(&stage.tracer, &stage.patches, &stage.emitters, (&openings, None), &how, &progress);
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
        let exact = wall.iter().map(|&i| expected(stage.patches.position[i], HALF)).fold(0.0, |a, b| a + b);
        wall.into_iter().map(all).fold(0.0, |a, b| a + b) / exact
    };
    assert!((together(8.0) - 1.0).abs() < 0.01, "{}", together(8.0));
    assert!((together(64.0) - 1.0).abs() > 0.02, "another division goes unnoticed: {}", together(64.0));
}

#[test]
fn what_is_dim_beside_the_street_gets_shadow_rays_by_what_is_bright_in_it() {
    let mut triangles = room(HALF);
    triangles.extend(square(Vec3::new(-8.0, 2.5, -2.0), Vec3::Z * 16.0, Vec3::X * 16.0));
    let grey = Material { base_color: Vec4::new(0.5, 0.5, 0.5, 1.0), ..support::white() };
    let scene = Scene { sky: Sky::constant(Rgb::ONE), ..support::scene_with_material(&triangles, grey) };
    let stage = Stage::new(&scene, 4.0);
    let patches = &stage.patches;
    let outlook = Outlook::find(&stage.tracer, patches, &Progress::default());
    let is_outside = |i: usize| patches.position[i].y > 2.0;
    let dimness = |inside: f32| {
        let light = |i: usize| if is_outside(i) { 50.0 } else { inside };
        let dimness = outlook.dimness(patches, &(0..patches.len()).map(light).collect::<Vec<f32>>());
        (0..patches.len()).map(|i| dimness.at(i)).collect::<Vec<f32>>()
    };
    let (dim, even) = (dimness(0.2), dimness(20.0));
    for i in 0..patches.len() {
        // Four times 0.2, and half a bounce to a whole one of that, over 40.
        assert!(if is_outside(i) { dim[i] == 1.0 } else { (0.02..0.045).contains(&dim[i]) }, "{i}: {}", dim[i]);
        assert!(even[i] == 1.0);
    }
    assert!(dimness(0.0).iter().enumerate().all(|(i, dim)| is_outside(i) || *dim > 0.0));
    let openings = openings(&stage);
    let [by_mean, by_place] = [None, Some(&outlook)]
        .map(|outlook| found_by(&stage, HALF, (&openings, outlook), Effort { samples: 16, seeds: 16 }));
    assert!((by_place.mean - 1.0).abs() < 0.01, "{}", by_place.mean);
    assert!(by_place.error < 0.8 * by_mean.error, "{}, by the scene's mean {}", by_place.error, by_mean.error);
}

#[test]
fn lines_go_where_they_count_not_into_the_sky() {
    let mut triangles = room(HALF);
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
    let outlook = Outlook::find(&stage.tracer, patches, &Progress::default());
    let walked = |outside: f32, lines: u64, outlook: Option<&Outlook>, seed: u64| {
        let how = walk::Settings { splat: Splat::None, lines, bounces: None, low_discrepancy: true, seed };
        let walk = stage.walk_in((&[], outlook), Some(&direct(outside)), &how);
        for bounce in walk.ledger.iter().filter(|bounce| bounce.lines > 1000) {
            let spent = (bounce.received[0] + bounce.escaped[0] + bounce.culled[0]) / bounce.shot[0];
            assert!((spent - 1.0).abs() < 1e-5, "{bounce:?}");
            assert!((bounce.shot[0] / bounce.unshot[0] - 1.0).abs() < 0.01, "{bounce:?}");
        }
        wall.iter().map(|&i| f64::from(walk.indirect[i].x)).collect::<Vec<f64>>()
    };
    // Nothing of what is above the roof comes in.
    let truth = walked(0.0, 4_000_000, None, 99);
    let mean = truth.iter().fold(0.0, |a, b| a + b) / truth.len() as f64;
    let seeds = 8;
    let compared = |outlook: Option<&Outlook>| {
        let (mut bias, mut square) = (0.0, 0.0);
        for seed in 0..seeds {
            for (light, truth) in walked(50.0, 50_000, outlook, seed).into_iter().zip(&truth) {
                bias += light - truth;
                square += (light - truth).powi(2);
            }
        }
        let n = truth.len() as f64 * seeds as f64;
        [bias / n / mean, (square / n).sqrt() / mean]
    };
    let [[bias, error], [_, by_power]] = [compared(Some(&outlook)), compared(None)];
    assert!(bias.abs() < 0.03, "{bias}");
    assert!(error < 0.4 * by_power, "{error}, by power {by_power}");
}
