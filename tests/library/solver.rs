//! Light transport against closed forms, balances, and things that must stay dark.
//!
//! Form factors are those of Howell, "A Catalog of Radiation Heat Transfer Configuration Factors", C-11 and C-14.

use crate::solve::{Stage, load, load_under_sky, square};
use crate::support;
use glam::Vec3;
use texelwalk::base::random::Stage as Random;
use texelwalk::base::{Rgb, Stream};
use texelwalk::finish::{Along, Ways, share};
use texelwalk::patches::{Shine, Tilts};
use texelwalk::scene::{Light, Material, Scene, Sky};
use texelwalk::walk::{self, Splat, Walk};

const PAPER: Splat = Splat::Paper { alpha: 5.0, beta: 15.0 };
/// Two facing unit squares at distance 1, and two that share an edge at a right angle.
const FACING: f64 = 0.199_825;
const ADJACENT: f64 = 0.200_044;

/// A white receiver and an emitter of radiance 1, as two parts.
fn receiver_and_emitter(receiver: &[[Vec3; 3]], emitter: &[[Vec3; 3]]) -> Scene {
    support::scene_of_two(receiver, emitter, Material { emission: Rgb::ONE, ..support::white() })
}

fn facing_squares() -> Scene {
    receiver_and_emitter(&square(Vec3::ZERO, Vec3::Z, Vec3::X), &square(Vec3::Y, Vec3::X, Vec3::Z))
}

fn adjacent_squares() -> Scene {
    receiver_and_emitter(&square(Vec3::ZERO, Vec3::Z, Vec3::X), &square(Vec3::ZERO, Vec3::Y, Vec3::Z))
}

fn is_receiver(stage: &Stage<'_>) -> impl Fn(usize) -> bool {
    let part: Vec<bool> = (0..stage.patches.front)
        .map(|i| stage.patches.position[i].y.abs() < 1e-4 && stage.patches.normal[i].y > 0.9)
        .collect();
    move |i| part[i]
}

#[test]
fn sun_on_a_plane() {
    let mut scene = support::scene_from_triangles(&square(Vec3::ZERO, Vec3::Z * 3.0, Vec3::X * 3.0));
    let direction = Vec3::new(0.3, -0.8, 0.1).normalize();
    scene.lights.push(Light::Sun { direction, illuminance: Rgb::splat(7.0), angle: 0.0 });
    let stage = Stage::new(&scene, 8.0);
    let expected = 7.0 * -direction.y;
    for (i, e) in stage.direct(4).iter().enumerate() {
        assert!((e.x - expected).abs() < 1e-3 * expected, "patch {i}: {} against {expected}", e.x);
    }
}

#[test]
fn point_light_on_a_plane_at_texel_centres() {
    let mut scene = support::scene_from_triangles(&square(Vec3::ZERO, Vec3::Z * 2.0, Vec3::X * 2.0));
    let position = Vec3::new(0.7, 1.0, 1.1);
    scene.lights.push(Light::Point { position, intensity: Rgb::splat(5.0), range: f32::INFINITY, radius: 0.0 });
    let stage = Stage::new(&scene, 32.0);
    for (i, e) in stage.direct(4).iter().enumerate() {
        let to = position - stage.patches.position[i];
        let expected = 5.0 * to.y / to.length().powi(3);
        assert!((e.x - expected).abs() < 1e-3 * expected, "patch {i}: {} against {expected}", e.x);
    }
}

/// Mean over a texel of h/d³ by 64 × 64 points: a point light of 1 cd over a plane y = 0.
fn mean_over_texel(light: Vec3, middle: Vec3, edge: f64) -> f64 {
    const POINTS: u32 = 64;
    let at = |k: u32| (f64::from(k) + 0.5) / f64::from(POINTS) - 0.5;
    let to = (light - middle).as_dvec3();
    let each = (0..POINTS * POINTS).map(|k| {
        let [x, z] = [at(k % POINTS), at(k / POINTS)].map(|offset| edge * offset);
        to.y / (to - glam::DVec3::new(x, 0.0, z)).length().powi(3)
    });
    each.sum::<f64>() / f64::from(POINTS * POINTS)
}

#[test]
fn point_light_near_a_plane_is_the_mean_over_each_texel() {
    // Texels of an eighth of a metre; the light stands at 0.8, 2 and 4 of them.
    for (height, most) in [(0.1, 0.02), (0.25, 0.0015), (0.5, 0.0005)] {
        let mut scene = support::scene_from_triangles(&square(Vec3::ZERO, Vec3::Z * 2.0, Vec3::X * 2.0));
        let light = Vec3::new(0.7, height, 1.1);
        scene.lights.push(Light::Point { position: light, intensity: Rgb::ONE, range: f32::INFINITY, radius: 0.0 });
        let stage = Stage::new(&scene, 8.0);
        let direct = stage.direct(64);
        for (i, e) in direct.iter().enumerate().filter(|(i, _)| stage.patches.covered(*i) > 0.999) {
            let middle = stage.patches.position[i];
            let expected = mean_over_texel(light, middle, f64::from(stage.patches.texel_edge(i)));
            // Texels along the diagonal have two triangles, and cells.
            let cut = (middle.x - middle.z).abs() < 0.2;
            let most = if cut { 10.0 * most } else { most };
            let off = f64::from(e.x) / expected - 1.0;
            assert!(off.abs() < most, "light at {height} m, patch {i} at {middle}: {off}");
        }
    }
}

#[test]
fn sky_on_a_plane_and_on_a_box() {
    let plane = support::scene_from_triangles(&square(Vec3::ZERO, Vec3::Z * 3.0, Vec3::X * 3.0));
    let mut cube = vec![];
    support::cuboid(glam::DVec3::ZERO, glam::DVec3::new(1.0, 2.0, 0.5), 1, false, &mut cube);
    let cube: Vec<[Vec3; 3]> = cube.iter().map(|t| t.map(|p| p.as_vec3())).collect();
    for mut scene in [plane, support::scene_from_triangles(&cube)] {
        scene.sky = Sky::constant(Rgb::ONE);
        let stage = Stage::new(&scene, 6.0);
        let pi = std::f64::consts::PI;
        let gathered = stage.mean(&stage.direct(16), |_| true);
        assert!((gathered / pi - 1.0).abs() < 1e-4, "gathered {gathered}");
        let settings =
            walk::Settings { splat: Splat::None, lines: 1_000_000, bounces: Some(0), low_discrepancy: false, seed: 3 };
        let shot = stage.mean(&stage.walk_with(None, &settings).direct, |_| true);
        assert!((shot / pi - 1.0).abs() < 1e-2, "shot {shot}");
    }
}

#[test]
fn form_factors_by_shadow_rays() {
    for (scene, factor) in [(facing_squares(), FACING), (adjacent_squares(), ADJACENT)] {
        let stage = Stage::new(&scene, 24.0);
        let mean = stage.mean(&stage.direct(32), is_receiver(&stage)) / std::f64::consts::PI;
        assert!((mean - factor).abs() < 5e-3 * factor, "{mean} against {factor}");
    }
}

#[test]
fn form_factors_by_shot_lines_are_binomial() {
    let n = 1_000_000u64;
    for (scene, factor) in [(facing_squares(), FACING), (adjacent_squares(), ADJACENT)] {
        let stage = Stage::new(&scene, 16.0);
        let settings =
            walk::Settings { splat: Splat::None, lines: n, bounces: Some(0), low_discrepancy: false, seed: 3 };
        let walk = stage.walk_with(None, &settings);
        let first = &walk.ledger[0];
        let (share, n) = (first.received[0] / first.shot[0], first.lines as f64);
        let deviation = (factor * (1.0 - factor) / n).sqrt();
        assert!((share - factor).abs() < 4.9 * deviation, "{share} against {factor} ± {deviation}");
        // The same test must notice an error of 2 %.
        assert!((share - 1.02 * factor).abs() > 4.9 * deviation);
    }
}

/// Mean of E over the furnace and the largest deviation of a fully covered patch, by walk and gather.
fn furnace(name: &str, lines: u64, gather_rays: u32) -> (f64, f64) {
    let scene = load(name);
    let stage = Stage::new(&scene, 16.0);
    let direct = stage.direct(16);
    let walk = stage.walk_with(
        Some(&direct),
        &walk::Settings { splat: Splat::None, lines, bounces: None, low_discrepancy: true, seed: 5 },
    );
    let p = &stage.patches;
    let mut indirect = walk.indirect.clone();
    let mut other = indirect.clone();
    share(p, Ways::new(p, &stage.graph, p.len()), [&mut indirect, &mut other], Along::default());
    let radiance: Vec<Rgb> =
        (0..p.len()).map(|i| p.reflectance[i] * (direct[i] + indirect[i]) / std::f32::consts::PI).collect();
    let halves = stage.gather(&radiance, &Tilts::default(), None, gather_rays / 2, 9);
    let total: Vec<Rgb> = (0..p.front).map(|i| direct[i] + (halves[0][i] + halves[1][i]) * 0.5).collect();
    let mean = stage.mean(&total, |_| true);
    let worst = total.iter().map(|e| (f64::from(e.x) / mean - 1.0).abs()).fold(0.0, f64::max);
    (mean, worst)
}

#[test]
fn furnaces_have_the_radiosity_of_the_closed_form() {
    for (name, reflectance) in [
        ("furnace/furnace-0.5.gltf", 0.5),
        ("furnace/polyhedron-0.5.gltf", 0.5),
        ("furnace/furnace-0.9.gltf", 0.9),
        ("furnace/polyhedron-0.9.gltf", 0.9),
    ] {
        let (mean, worst) = furnace(name, 1_000_000, 32);
        let exact = 1.0 / (1.0 - reflectance);
        assert!((mean / exact - 1.0).abs() < 2e-3, "{name}: mean {mean} against {exact}");
        assert!(worst < 0.3, "{name}: a patch is off by {worst}");
        // A reflectance that is off by 2 % must not pass.
        let wrong = 1.0 / (1.0 - 0.98 * reflectance);
        assert!((mean / wrong - 1.0).abs() > 2e-3, "{name}: the test has no power");
    }
}

#[test]
fn light_bounces_as_often_as_it_may() {
    let scene = load("furnace/furnace-0.5.gltf");
    let stage = Stage::new(&scene, 8.0);
    let direct = stage.direct(16);
    for limit in 0..5u32 {
        let settings = walk::Settings {
            splat: Splat::None,
            lines: 1_000_000,
            bounces: Some(limit),
            low_discrepancy: true,
            seed: 3,
        };
        let exact: f64 = (0..=limit).map(|k| 0.5f64.powi(k as i32)).sum();
        for shot in [false, true] {
            let walk = stage.walk_with((!shot).then_some(&direct), &settings);
            let first = if shot { &walk.direct } else { &direct };
            let total: Vec<Rgb> = first.iter().zip(&walk.indirect).map(|(a, b)| *a + *b).collect();
            let mean = stage.mean(&total, |_| true);
            assert!((mean / exact - 1.0).abs() < 5e-3, "{limit} bounces, shot {shot}: {mean} against {exact}");
            assert_eq!(walk.ledger.len(), limit as usize + 1 + usize::from(shot));
        }
    }
}

fn ledger_closes(walk: &Walk) {
    for (k, b) in walk.ledger.iter().filter(|b| b.lines > 0).enumerate() {
        for c in 0..3 {
            let out = b.received[c] + b.escaped[c] + b.culled[c];
            assert!((out - b.shot[c]).abs() <= 1e-5 * b.shot[c], "bounce {k}, channel {c}: {out} of {}", b.shot[c]);
        }
        // Systematic picks make the lines carry what was to be shot, in the mean of the channels; emitters vary more.
        let (shot, unshot) = (walk::Bounce::mean(b.shot), walk::Bounce::mean(b.unshot));
        let most = if k == 0 { 0.03 } else { 1e-3 };
        assert!((shot - unshot).abs() <= most * unshot, "bounce {k}: {shot} of {unshot}");
    }
    assert!(walk.ledger.len() > 3);
}

#[test]
fn power_ledgers_close_at_every_bounce() {
    for name in ["office/office.glb", "cornell/cornell.gltf"] {
        let scene = load(name);
        let stage = Stage::new(&scene, 4.0);
        let direct = stage.direct(4);
        for splat in [Splat::None, PAPER] {
            ledger_closes(&stage.walk(Some(&direct), splat, 200_000, 1));
            ledger_closes(&stage.walk(None, splat, 200_000, 1));
        }
    }
    let scene = load_under_sky("courtyard/courtyard.gltf", Rgb::new(0.35, 0.45, 0.65));
    let stage = Stage::new(&scene, 2.0);
    ledger_closes(&stage.walk(Some(&stage.direct(4)), Splat::None, 200_000, 1));
}

#[test]
fn what_leaves_an_open_scene_takes_no_lines_from_the_first_bounce() {
    // White squares that face each other: a fifth of the light comes back from bounce to bounce.
    let scene = facing_squares();
    let stage = Stage::new(&scene, 8.0);
    let direct = stage.direct(4);
    for start in [Some(direct.as_slice()), None] {
        let walk = stage.walk(start, Splat::None, 20_000, 1);
        let share = walk.ledger[0].lines as f64 / 20_000.0;
        assert!((0.7..0.9).contains(&share), "{share} of the lines go into the first bounce");
        assert!(walk.ledger.iter().map(|b| b.lines).sum::<u64>() <= 20_000);
    }
}

#[test]
fn open_strips_of_texels_below_walls_swallow_no_light() {
    // At 6.5 texels per metre walls leave some of the floor's texels open by less than half a cell of their mask.
    let scene = load("two-rooms/two-rooms.glb");
    let stage = Stage::new(&scene, 6.5);
    let walk = stage.walk(Some(&stage.direct(4)), Splat::None, 500_000, 1);
    let sum = |of: fn(&walk::Bounce) -> [f64; 3]| walk.ledger.iter().map(|b| walk::Bounce::mean(of(b))).sum::<f64>();
    let lost = (sum(|b| b.escaped) + sum(|b| b.culled)) / sum(|b| b.shot);
    assert!(lost < 2e-4, "{lost} of the light is lost");
}

#[test]
fn shot_and_gathered_direct_light_agree() {
    for (scene, density) in [
        (load("cornell/cornell.gltf"), 4.0),
        (load("two-rooms/two-rooms.glb"), 2.0),
        (load_under_sky("courtyard/courtyard.gltf", Rgb::new(0.35, 0.45, 0.65)), 2.0),
    ] {
        let stage = Stage::new(&scene, density);
        let gathered = stage.mean(&stage.direct(64), |_| true);
        let settings =
            walk::Settings { splat: Splat::None, lines: 2_000_000, bounces: Some(0), low_discrepancy: false, seed: 3 };
        let shot = stage.mean(&stage.walk_with(None, &settings).direct, |_| true);
        assert!((shot / gathered - 1.0).abs() < 0.01, "{shot} shot, {gathered} gathered");
    }
}

/// The dark room, with its inner surfaces.
fn in_dark_room(p: Vec3) -> bool {
    (3.74..=7.26).contains(&p.x) && (-0.01..=3.51).contains(&p.z) && (-0.01..=2.51).contains(&p.y)
}

#[test]
fn a_sealed_room_stays_exactly_dark() {
    let scene = load("two-rooms/two-rooms.glb");
    let stage = Stage::new(&scene, 12.0);
    let p = &stage.patches;
    let direct = stage.direct(16);
    let dark: Vec<usize> = (0..p.front).filter(|&i| in_dark_room(p.position[i])).collect();
    assert!(dark.len() > 3000, "only {} patches in the dark room", dark.len());
    for splat in [Splat::None, PAPER] {
        let walk = stage.walk(Some(&direct), splat, 500_000, 2);
        let shot = stage.walk(None, splat, 500_000, 2);
        for &i in &dark {
            assert_eq!(
                direct[i] + walk.indirect[i] + shot.direct[i] + shot.indirect[i],
                Rgb::ZERO,
                "patch {i} at {}",
                p.position[i]
            );
        }
    }
    let lit = stage.mean(&direct, |i| !in_dark_room(p.position[i]));
    assert!(lit > 0.1, "the lit room is dark, too");
}

#[test]
fn links_do_not_cross_walls() {
    let scene = load("two-rooms/two-rooms.glb");
    let stage = Stage::new(&scene, 12.0);
    let p = &stage.patches;
    let (mut links, mut floor) = (0, 0);
    for i in 0..p.len() {
        for &j in stage.graph.neighbors(i) {
            let j = j as usize;
            assert!(stage.graph.neighbors(j).contains(&(i as u32)), "link {i} to {j} has no way back");
            assert!(p.normal[i].dot(p.normal[j]) > 0.98);
            assert_eq!(
                in_dark_room(p.position[i]),
                in_dark_room(p.position[j]),
                "{} to {}, normal {} exposed {} {}",
                p.position[i],
                p.position[j],
                p.normal[i],
                p.exposed[i],
                p.exposed[j]
            );
            links += 1;
            floor += usize::from(p.position[i].y.abs() < 1e-3);
        }
        assert!(stage.graph.neighbors(i).len() <= 8);
    }
    assert!(links > 5 * p.len(), "only {links} links");
    assert!(floor > 10_000, "only {floor} links on the floor");
}

#[test]
fn patches_have_the_area_of_the_meshes() {
    for (name, density) in [
        ("cornell/cornell.gltf", 3.3),
        ("office/office.glb", 4.75),
        ("room/room.glb", 11.8),
        ("furnace/polyhedron-0.5.gltf", 7.7),
        ("chairs/chairs.glb", 5.0),
        ("primitives/primitives.gltf", 9.0),
    ] {
        let scene = load(name);
        let stage = Stage::new(&scene, density);
        for (k, part) in scene.parts.iter().enumerate().filter(|(_, p)| p.receives) {
            let mesh: f64 = part.triangles.clone().map(|t| scene.area(t)).sum();
            let charted = stage.patches.area_of_part(&scene, k);
            assert!((charted - mesh).abs() <= 1e-4 * mesh, "{name}, {}: {charted} of {mesh} m2", part.name);
        }
    }
}

#[test]
fn sharing_conserves_flux_and_keeps_constants() {
    let scene = load("furnace/polyhedron-0.5.gltf");
    let stage = Stage::new(&scene, 24.0);
    let p = &stage.patches;
    let mut constant = [(); 2].map(|()| vec![Rgb::ONE; p.front]);
    let [a, b] = &mut constant;
    share(p, Ways::new(p, &stage.graph, p.front), [a, b], Along::default());
    assert!(constant.iter().flatten().all(|v| (v.x - 1.0).abs() < 1e-5));
    // Noise of two halves on equal light.
    let mut s = Stream::new(1, Random::Render, 0, 0);
    let mut noise = [(); 2].map(|()| -> Vec<Rgb> { (0..p.front).map(|_| Rgb::splat(s.next_f32() * 2.0)).collect() });
    let flux = |v: &[Rgb]| (0..p.front).map(|i| f64::from(v[i].x * p.exposed_area(i))).sum::<f64>();
    let variance =
        |v: &[Vec<Rgb>; 2]| (0..p.front).map(|i| f64::from((v[0][i].x + v[1][i].x) * 0.5 - 1.0).powi(2)).sum::<f64>();
    let (flux_before, variance_before) = (flux(&noise[0]), variance(&noise));
    let [a, b] = &mut noise;
    let error = share(p, Ways::new(p, &stage.graph, p.front), [a, b], Along::default());
    assert!((flux(&noise[0]) / flux_before - 1.0).abs() < 1e-5);
    let left = variance(&noise);
    assert!(left < 0.1 * variance_before, "{left} of {variance_before}");
    // What is stated is what is left, in three channels.
    let stated = error.sum_of(|_| true) / 3.0;
    assert!((0.5..1.5).contains(&(stated / left)), "{stated} for {left}");
}

#[test]
fn twice_the_light_is_twice_the_irradiance() {
    let mut scene = load("two-rooms/two-rooms.glb");
    let run = |scene: &Scene| {
        let stage = Stage::new(scene, 3.0);
        let direct = stage.direct(8);
        let walk = stage.walk(Some(&direct), Splat::None, 50_000, 4);
        direct.iter().zip(&walk.indirect).map(|(a, b)| *a + *b).collect::<Vec<Rgb>>()
    };
    let once = run(&scene);
    for light in &mut scene.lights {
        if let Light::Point { intensity, .. } = light {
            *intensity *= 2.0;
        }
    }
    for material in &mut scene.materials {
        material.emission *= 2.0;
    }
    for (a, b) in once.iter().zip(&run(&scene)) {
        assert!((*a * 2.0 - *b).abs().max_element() <= 1e-4 * b.max_element());
    }
}

#[test]
fn error_of_the_classic_walk_falls_with_the_square_root_of_the_lines() {
    let scene = load("cornell/cornell.gltf");
    let stage = Stage::new(&scene, 3.0);
    let direct = stage.direct(16);
    let reference = stage.walk(Some(&direct), Splat::None, 30_000_000, 99).indirect;
    let error = |lines: u64| {
        let mse = |seed| {
            let w = stage.walk(Some(&direct), Splat::None, lines, seed).indirect;
            let p = &stage.patches;
            (0..p.front).map(|i| f64::from(p.area[i]) * f64::from((w[i] - reference[i]).length_squared())).sum::<f64>()
        };
        (0..4).map(mse).sum::<f64>() * lines as f64
    };
    let (few, many) = (error(40_000), error(640_000));
    assert!((few / many - 1.0).abs() < 0.15, "MSE × lines: {few} with 40,000, {many} with 640,000");
}

/// Irradiance of a ceiling by what a floor reflects, which an awning above it covers and shades by half: too high to count as
/// what hides it.
fn ceiling_over_shade(texels_per_meter: f32, tilted: bool) -> f64 {
    let floor = square(Vec3::ZERO, Vec3::Z, Vec3::X);
    let awning = square(Vec3::new(0.5, 0.12, 0.0), Vec3::Z, Vec3::X * 0.5);
    let below = square(Vec3::new(0.5, 0.119, 0.0), Vec3::X * 0.5, Vec3::Z);
    let ceiling = square(Vec3::Y, Vec3::X, Vec3::Z);
    let mut scene = support::scene_from_triangles(&[floor, awning, below, ceiling].concat());
    scene.lights.push(Light::Point {
        position: Vec3::new(0.5, 0.95, 0.5),
        intensity: Rgb::ONE,
        range: f32::INFINITY,
        radius: 0.0,
    });
    let stage = Stage::new(&scene, texels_per_meter);
    let p = &stage.patches;
    let direct = stage.direct_halves(64, 1);
    let mean: Vec<Rgb> = direct.halves[0].iter().zip(&direct.halves[1]).map(|(a, b)| (*a + *b) * 0.5).collect();
    let grey: Vec<f32> = mean.iter().map(|e| e.x).collect();
    let [a, b] = &direct.slopes;
    let shine = Shine { all: &grey, direct: &grey, slopes: [a, b] };
    let tilts = if tilted { Tilts::new(p, &stage.graph, &shine) } else { Tilts::default() };
    // The awning is black, so that the floor alone is seen.
    let on_floor = |i: usize| if p.position[i].y < 0.005 { 1.0 / std::f32::consts::PI } else { 0.0 };
    let radiance: Vec<Rgb> = (0..p.len()).map(|i| mean[i] * on_floor(i)).collect();
    let [found, _] = stage.gather(&radiance, &tilts, None, 4096, 4);
    stage.mean(&found, |i| p.position[i].y > 0.5)
}

#[test]
fn a_texel_cut_by_a_shadow_is_seen_from_its_bright_side() {
    let truth = ceiling_over_shade(32.0, false);
    let (even, tilted) = (ceiling_over_shade(1.0, false) / truth, ceiling_over_shade(1.0, true) / truth);
    assert!(even < 0.75, "the texel is read as even: {even} of {truth}");
    assert!((tilted - 1.0).abs() < 0.3 * (1.0 - even), "{tilted}, and {even} without tilts");
}

/// Every square a part of its own, so that it has a chart of its own.
fn squares_apart(squares: &[[[Vec3; 3]; 2]]) -> Scene {
    let mut scene = support::scene_from_triangles(squares.as_flattened());
    let part = scene.parts.remove(0);
    for k in 0..squares.len() as u32 {
        let mut own = part.clone();
        (own.triangles, own.vertices) = (2 * k..2 * k + 2, 6 * k..6 * k + 6);
        own.mesh = k as usize;
        scene.parts.push(own);
    }
    scene.triangle_part = (0..scene.triangles.len() as u32).map(|t| t / 2).collect();
    scene
}

#[test]
fn light_is_shared_across_charts_where_the_surface_goes_on_and_nowhere_else() {
    let tile = |x: f32| square(Vec3::new(x, 0.0, 0.0), Vec3::Z, Vec3::X);
    let wall = square(Vec3::new(2.0, -0.1, 0.0), Vec3::Z, Vec3::Y * 0.4);
    // Two tiles side by side, a wall, a third tile, and a fourth behind a gap of half a texel.
    let scene = squares_apart(&[tile(0.0), tile(1.0), wall, tile(2.0), tile(3.0 + 0.5 / 8.0)]);
    let stage = Stage::new(&scene, 8.0);
    let p = &stage.patches;
    let mut linked = 0;
    for i in 0..p.front {
        for j in stage.graph.across(i).map(|j| j as usize) {
            assert!(stage.graph.across(j).any(|back| back as usize == i), "{i} to {j}, and not back");
            let [a, b] = [p.position[i], p.position[j]];
            assert!((a.x - 1.0) * (b.x - 1.0) < 0.0 && a.distance(b) < 0.16, "{a} and {b}");
            linked += 1;
        }
    }
    assert!(linked >= 16, "{linked} links across the seam");

    let mut stream = Stream::new(3, Random::Walk, 0, 0);
    let mut half = || -> Vec<Rgb> { (0..p.front).map(|_| Rgb::splat(0.5 + stream.next_f32())).collect() };
    let (mut a, mut b) = (half(), half());
    let flux = |e: &[Rgb], low: f32, high: f32| -> f64 {
        let own = |&i: &usize| p.position[i].y.abs() < 1e-3 && (low..high).contains(&p.position[i].x);
        (0..p.front).filter(own).map(|i| f64::from(e[i].x * p.exposed_area(i))).sum()
    };
    let before = [flux(&a, 0.0, 1.0), flux(&a, 1.0, 2.0), flux(&a, 2.0, 3.0)];
    share(p, Ways::new(p, &stage.graph, p.front), [&mut a, &mut b], Along::default());
    let after = [flux(&a, 0.0, 1.0), flux(&a, 1.0, 2.0), flux(&a, 2.0, 3.0)];
    assert!((after[0] + after[1] - before[0] - before[1]).abs() < 1e-5, "flux of the two tiles: {before:?}, {after:?}");
    assert!((after[0] - before[0]).abs() > 1e-4, "nothing crossed the seam: {before:?}, {after:?}");
    assert!((after[2] - before[2]).abs() < 1e-5, "light crossed the wall: {before:?}, {after:?}");
    let (mut a, mut b) = (vec![Rgb::ONE; p.front], vec![Rgb::ONE; p.front]);
    share(p, Ways::new(p, &stage.graph, p.front), [&mut a, &mut b], Along::default());
    assert!(a.iter().all(|e| (*e - Rgb::ONE).abs().max_element() < 1e-5));
}
