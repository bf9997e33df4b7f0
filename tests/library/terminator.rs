//! Light on smooth-shaded bodies made of few facets: as on their finely cut twins, without leaks through what is near.

#![allow(clippy::print_stderr, reason = "figures of the slow tests")]

use crate::gltf_builder::{Builder, words};
use crate::solve::{Stage, square};
use crate::support::{cuboid, place, scene_from_triangles, skew};
use core::f32::consts::PI;
use glam::{DMat3, DVec3, Vec2, Vec3};
use serde_json::json;
use std::path::Path;
use texelwalk::base::{Progress, Rgb};
use texelwalk::gather::{Field, Gathered};
use texelwalk::patches::{PatchSurface, Tilts};
use texelwalk::scene::{self, Light, Scene, Sky};
use texelwalk::trace::{Ground, Lift, Ray, Tracer};

type Triangles = Vec<[Vec3; 3]>;

/// A sphere of radius 1 around 0, front outward.
fn sphere(segments: usize, rings: usize) -> Triangles {
    let at = |i: usize, j: usize| {
        let (turn, tilt) = (i % segments, core::f64::consts::PI * j as f64 / rings as f64);
        let turn = core::f64::consts::TAU * turn as f64 / segments as f64;
        let r = if j == rings { 0.0 } else { libm::sin(tilt) };
        DVec3::new(r * libm::cos(turn), libm::cos(tilt), -r * libm::sin(turn)).as_vec3()
    };
    let mut out = vec![];
    for (i, j) in (0..segments).flat_map(|i| (0..rings).map(move |j| (i, j))) {
        let [a, b, c, d] = [at(i, j), at(i, j + 1), at(i + 1, j + 1), at(i + 1, j)];
        if j + 1 < rings {
            out.push([a, b, c]);
        }
        if j > 0 {
            out.push([a, c, d]);
        }
    }
    out
}

/// Bodies of one material; those with a centre are spheres around it, shaded smoothly.
fn bodies(bodies: &[(Triangles, Option<Vec3>)]) -> Scene {
    let all: Triangles = bodies.iter().flat_map(|(t, _)| t.iter().copied()).collect();
    let mut scene = scene_from_triangles(&all);
    let centers = bodies.iter().flat_map(|(t, center)| core::iter::repeat_n(*center, 3 * t.len()));
    for (k, center) in centers.enumerate().filter_map(|(k, c)| Some((k, c?))) {
        let out = (scene.vertices.position[k] - center).normalize();
        let normal = &mut scene.vertices.normal[k];
        *normal = if normal.dot(out) < 0.0 { -out } else { out };
    }
    scene.parts[0].flat = false;
    scene
}

fn ball(segments: usize, rings: usize) -> Scene {
    bodies(&[(sphere(segments, rings), Some(Vec3::ZERO))])
}

fn moved(triangles: Triangles, scale: f32, shift: Vec3) -> Triangles {
    triangles.into_iter().map(|t| t.map(|p| p * scale + shift)).collect()
}

fn inside_out(triangles: Triangles) -> Triangles {
    triangles.into_iter().map(|[a, b, c]| [a, c, b]).collect()
}

fn sun(toward: Vec3, angle: f32) -> Light {
    Light::Sun { direction: -toward.normalize(), illuminance: Rgb::ONE, angle }
}

fn point(position: Vec3, radius: f32) -> Light {
    Light::Point { position, intensity: Rgb::ONE, range: f32::INFINITY, radius }
}

/// Directions spread over the sphere.
fn directions(n: usize) -> impl Iterator<Item = Vec3> {
    (0..n).map(move |k| {
        let y = 1.0 - (2.0 * k as f32 + 1.0) / n as f32;
        let (sin, cos) = libm::sincosf(k as f32 * 2.399_963_2);
        Vec3::new((1.0 - y * y).sqrt() * cos, y, (1.0 - y * y).sqrt() * sin)
    })
}

/// Direct light of the texels of a body around 0 [lx], and their directions.
fn texels(scene: &Scene) -> Vec<(Vec3, f32)> {
    let stage = Stage::new(scene, 12.0);
    let light = stage.direct(64);
    stage.patches.position.iter().zip(light).map(|(p, e)| (p.normalize(), e.x)).collect()
}

/// Direct light of a body around 0 in some directions [lx], with its slopes over the texels.
fn seen_from_outside(scene: &Scene, directions: &[Vec3]) -> Vec<f32> {
    let stage = Stage::new(scene, 20.0);
    let direct = stage.direct_halves(64, 1);
    let read = |toward: &Vec3| {
        let ray = Ray { origin: *toward * 4.0, direction: -*toward, t_max: f32::INFINITY };
        let hit = stage.tracer.closest_hit(&ray).unwrap();
        let seen = stage.patches.seen(&hit).unwrap();
        let offset = seen.within - stage.patches.centroid[seen.patch];
        let half = |h: usize| direct.halves[h][seen.patch].x + direct.slopes[h][seen.patch].dot(offset);
        0.5 * (half(0) + half(1)).max(0.0)
    };
    directions.iter().map(read).collect()
}

/// Largest and root mean square difference to the second, relative to its brightest, and the largest relative one where
/// it has a fifth of that.
fn differences(coarse: &[(Vec3, f32)], fine: &[f32]) -> [f32; 3] {
    let peak = fine.iter().copied().fold(0.0, f32::max);
    let (mut most, mut square, mut relative) = (0.0f32, 0.0, 0.0f32);
    for ((_, a), b) in coarse.iter().zip(fine) {
        let off = (a - b).abs();
        most = most.max(off / peak);
        square += (off / peak).powi(2);
        if *b > 0.2 * peak {
            relative = relative.max(off / b);
        }
    }
    [most, (square / fine.len() as f32).sqrt(), relative]
}

#[test]
fn a_coarse_sphere_is_lit_as_its_twin() {
    // Lights with a size are sampled: the last number allows for that noise, in the twin as well.
    let lights = [
        ("sun", sun(Vec3::new(0.5, 0.7, 0.3), 0.0), 0.02),
        ("soft sun", sun(Vec3::new(0.5, 0.7, 0.3), 0.1), 0.04),
        ("point", point(Vec3::new(1.5, 2.0, 1.0), 0.0), 0.02),
        ("bulb", point(Vec3::new(1.5, 2.0, 1.0), 0.1), 0.04),
    ];
    for (name, light, noise) in lights {
        let [mut coarse, mut faceted, mut fine] = [(12, 8), (12, 8), (200, 100)].map(|(s, r)| ball(s, r));
        faceted.parts[0].flat = true;
        for scene in [&mut coarse, &mut faceted, &mut fine] {
            scene.lights.push(light.clone());
        }
        let [coarse, faceted] = [coarse, faceted].map(|scene| texels(&scene));
        let directions: Vec<Vec3> = coarse.iter().chain(&faceted).map(|t| t.0).collect();
        let fine = seen_from_outside(&fine, &directions);
        let (of_coarse, of_faceted) = fine.split_at(coarse.len());
        let [most, rms, relative] = differences(&coarse, of_coarse);
        let [flat, flat_rms, _] = differences(&faceted, of_faceted);
        eprintln!(
            "{name}: {most:.4} of the peak, rms {rms:.5}, relative {relative:.4}; facets {flat:.3}, {flat_rms:.4}"
        );
        assert!(most < 0.02 && rms < 0.005 && relative < noise, "{name}");
        assert!(flat > 0.1, "{name}: facets do not show");
    }
}

#[test]
fn a_coarse_sphere_sees_the_whole_sky_above_it() {
    // All around: no ray is lost. From above alone: π(1 + cos)/2, with the noise of single texels.
    let above = Sky { ground: Rgb::ZERO, ..Sky::constant(Rgb::ONE) };
    for (sky, below, most, mean) in [(Sky::constant(Rgb::ONE), 1.0, 1e-4, 1e-4), (above, 0.0, 0.06, 0.005)] {
        let mut scene = ball(12, 8);
        scene.sky = sky;
        let mut bands = [(0.0f32, 0.0f32); 8];
        for (toward, found) in texels(&scene) {
            let off = found / PI - 0.5 * (1.0 + toward.y) - 0.5 * (1.0 - toward.y) * below;
            assert!(off.abs() < most, "{off} at {toward}");
            let band = &mut bands[((toward.y * 4.0 + 4.0) as usize).min(7)];
            *band = (band.0 + off, band.1 + 1.0);
        }
        assert!(bands.iter().all(|(sum, n)| *n > 50.0 && (sum / n).abs() < mean), "{bands:?}");
    }
}

/// Irradiance by a gather in which all surfaces and the sky have radiance 1, over π.
fn gathered(scene: &Scene, texels_per_meter: f32, sky: bool) -> (Vec<f32>, Vec<Vec3>) {
    let stage = Stage::new(scene, texels_per_meter);
    let radiance = vec![Rgb::ONE; stage.patches.len()];
    let white = |_: usize, _: Vec3, _: Vec3| Rgb::ONE;
    let field = Field {
        tracer: &stage.tracer,
        patches: &stage.patches,
        radiance: [&radiance, &radiance],
        left_out: None,
        tilts: &Tilts::default(),
        sky: if sky { Some(&white) } else { None },
        anew: None,
        seed: 3,
    };
    let mut gathered = Gathered::new(&stage.patches);
    gathered.add(&field, |_| 128, &Progress::default());
    let [a, b] = gathered.halves();
    (a.iter().zip(b).map(|(a, b)| 0.5 * (a.x + b.x) / PI).collect(), stage.patches.position)
}

#[test]
fn what_is_round_is_a_furnace_from_inside_and_outside() {
    let mut walls = vec![];
    cuboid(DVec3::splat(-2.0), DVec3::splat(2.0), 1, true, &mut walls);
    let walls = place(&walls, DMat3::IDENTITY, 1.0, DVec3::ZERO);
    let outside = bodies(&[(walls, None), (sphere(12, 8), Some(Vec3::ZERO))]);
    let inside = bodies(&[(inside_out(sphere(12, 8)), Some(Vec3::ZERO))]);
    for (name, scene, sky) in [("outside", outside, false), ("inside", inside, false), ("sky", ball(12, 8), true)] {
        let (light, positions) = gathered(&scene, 6.0, sky);
        for (light, position) in light.iter().zip(positions) {
            assert!((light - 1.0).abs() < 1e-4, "{name}: {light} at {position}");
        }
    }
}

#[test]
fn a_sphere_that_is_half_sunk_is_dark_below_and_round_above() {
    let floor = square(Vec3::new(-6.0, 0.0, -6.0), Vec3::Z * 12.0, Vec3::X * 12.0).to_vec();
    for height in [0.0, 0.3, -0.2] {
        let center = Vec3::Y * height;
        let mut scene = bodies(&[(floor.clone(), None), (moved(sphere(12, 8), 1.0, center), Some(center))]);
        let toward = Vec3::new(0.9, 0.2, 0.3).normalize();
        scene.lights.push(sun(toward, 0.0));
        let stage = Stage::new(&scene, 12.0);
        let light = stage.direct(16);
        let (mut round, mut below) = (0, 0);
        for (i, light) in light.iter().enumerate().take(stage.patches.front) {
            let (p, n) = (stage.patches.position[i], stage.patches.normal[i]);
            if p.y < -0.1 {
                assert_eq!(*light, Rgb::ZERO, "below the floor at {p}");
                below += 1;
            } else if p.y > 0.1 && (p - center).length() < 1.01 && n.dot(p - center) > 0.8 {
                let expected = (p - center).normalize().dot(toward).max(0.0);
                assert!((light.x - expected).abs() < 0.02, "{} against {expected} at {p}", light.x);
                round += 1;
            }
        }
        assert!(round > 300 && below > 50, "{round} above, {below} below");
    }
}

#[test]
fn a_sheet_on_a_coarse_sphere_keeps_it_dark() {
    // The outer sphere is a millimetre and a half over the facets of the inner one, far below its lift of five centimetres.
    let (inner, outer) = (sphere(12, 8), moved(sphere(12, 8), 1.0016, Vec3::ZERO));
    let count = inner.len();
    let mut scene = bodies(&[(inner, Some(Vec3::ZERO)), (outer, Some(Vec3::ZERO))]);
    // Else the inner sphere would lie in a solid, and take no part in light at all.
    scene.materials[0].double_sided = true;
    scene.lights = vec![sun(Vec3::new(0.5, 0.7, 0.3), 0.1), point(Vec3::new(1.5, 2.0, 1.0), 0.0), sun(Vec3::X, 0.0)];
    scene.sky = Sky::constant(Rgb::ONE);
    let stage = Stage::new(&scene, 8.0);
    let (mut dark, mut lit) = (0, 0);
    for (i, light) in stage.direct(64).iter().enumerate().take(stage.patches.front) {
        let triangle = PatchSurface::new(&stage.tracer, &stage.patches, i).sample(Vec2::splat(0.5)).point.triangle;
        if (triangle as usize) < count {
            assert_eq!(*light, Rgb::ZERO, "at {}", stage.patches.position[i]);
            dark += 1;
        } else {
            assert!(light.x > 3.0, "{} at {}", light.x, stage.patches.position[i]);
            lit += 1;
        }
    }
    assert!(dark > 400 && lit > 400, "{dark} dark, {lit} lit");
}

#[test]
fn a_wall_that_cuts_a_coarse_sphere_lets_no_light_around_its_facets() {
    // A closed room of walls without thickness; half of the sphere is outside, in the sun.
    let mut walls = vec![];
    cuboid(DVec3::new(0.0, -2.0, -2.0), DVec3::new(4.0, 2.0, 2.0), 1, true, &mut walls);
    let walls = place(&walls, DMat3::IDENTITY, 1.0, DVec3::ZERO);
    for shift in [0.0, 0.11, -0.37] {
        let center = Vec3::X * shift;
        let ball = (moved(sphere(12, 8), 1.0, center), Some(center));
        let mut scene = bodies(&[(walls.clone(), None), ball]);
        scene.lights = vec![sun(Vec3::new(-0.3, 1.0, 0.2), 0.0), point(Vec3::new(-0.5, 1.6, 0.0), 0.05)];
        scene.sky = Sky::constant(Rgb::ONE);
        let stage = Stage::new(&scene, 8.0);
        let (mut dark, mut lit) = (0, 0);
        for (i, light) in stage.direct(32).iter().enumerate().take(stage.patches.front) {
            let p = stage.patches.position[i];
            let texel = 1.5 * stage.patches.texel_edge(i);
            if p.x > texel {
                assert_eq!(*light, Rgb::ZERO, "inside at {p}");
                dark += 1;
            } else if p.x < -texel {
                lit += usize::from(light.x > 0.1);
            }
        }
        assert!(dark > 1000 && lit > 100, "{dark} dark, {lit} lit");
    }
}

#[test]
fn the_inside_of_a_two_sided_sphere_has_light_of_its_own() {
    let mut scene = ball(12, 8);
    scene.materials[0].double_sided = true;
    scene.lights.push(sun(Vec3::new(0.5, 0.7, 0.3), 0.0));
    let light = |scene: &Scene| {
        let stage = Stage::new(scene, 8.0);
        let (light, front) = (stage.direct(16), stage.patches.front);
        (light[..front].to_vec(), light[front..].to_vec())
    };
    let (fronts, backs) = light(&scene);
    assert_eq!(fronts.len(), backs.len());
    assert!(fronts.iter().any(|e| e.x > 0.9) && backs.iter().all(|e| *e == Rgb::ZERO), "the sun stays outside");
    // A lamp in the middle: facets are up to 6 % nearer than the sphere that they stand for.
    scene.lights = vec![point(Vec3::ZERO, 0.0)];
    let (fronts, backs) = light(&scene);
    assert!(fronts.iter().all(|e| *e == Rgb::ZERO), "the lamp stays inside");
    assert!(backs.iter().all(|e| (0.98..1.13).contains(&e.x)), "{:?}", backs.iter().find(|e| e.x < 0.98));
    // The same sphere turned inside out, seen from outside: what is round is on the back.
    let mut turned = bodies(&[(inside_out(sphere(12, 8)), Some(Vec3::ZERO))]);
    turned.materials[0].double_sided = true;
    let toward = Vec3::new(0.5, 0.7, 0.3).normalize();
    turned.lights.push(sun(toward, 0.0));
    let stage = Stage::new(&turned, 8.0);
    let light = stage.direct(16);
    for (p, light) in stage.patches.position.iter().zip(light).skip(stage.patches.front) {
        assert!((light.x - p.normalize().dot(toward).max(0.0)).abs() < 0.02, "{} at {p}", light.x);
    }
}

#[test]
fn mirrored_instances_are_as_round() {
    let triangles = sphere(12, 8);
    let corners: Vec<f32> = triangles.iter().flatten().flat_map(|p| p.to_array()).collect();
    let mut builder = Builder::new();
    let position = builder.floats("VEC3", &corners);
    let count = 3 * triangles.len() as u16;
    let indices = builder.accessor(5123, "SCALAR", count.into(), &words(&(0..count).collect::<Vec<_>>()), json!({}));
    builder.push(
        "meshes",
        json!({"primitives": [{"attributes": {"POSITION": position, "NORMAL": position}, "indices": indices}]}),
    );
    builder.push("nodes", json!({"mesh": 0, "scale": [-1.0, 1.0, 1.0]}));
    let mut scene = scene::load_bytes(builder.gltf(), Path::new("."), &scene::Settings::default()).unwrap().output;
    let toward = Vec3::new(0.5, 0.7, 0.3).normalize();
    scene.lights.push(sun(toward, 0.0));
    let stage = Stage::new(&scene, 8.0);
    for (i, light) in stage.direct(16).iter().enumerate().take(stage.patches.front) {
        let p = stage.patches.position[i];
        let expected = p.normalize().dot(toward).max(0.0);
        assert!((light.x - expected).abs() < 0.02, "{} against {expected} at {p}", light.x);
    }
}

#[test]
fn flat_triangles_are_left_as_if_nothing_were_smooth() {
    let mut shape = vec![];
    cuboid(DVec3::splat(-0.5), DVec3::splat(0.5), 2, false, &mut shape);
    let offset = DVec3::new(30.0, -7.0, 100.0);
    let mut scene = scene_from_triangles(&place(&shape, skew(), 3.0, offset));
    scene.parts[0].flat = false;
    let exact = scene.vertices.normal.clone();
    let eight_bits: Vec<Vec3> = exact.iter().map(|n| (*n * 127.0).round().normalize()).collect();
    for normals in [exact, eight_bits] {
        scene.vertices.normal = normals;
        for triangle in 0..scene.triangles.len() as u32 {
            let facing = scene.geometric_normal(triangle);
            assert!(Lift::new(&scene, triangle, facing).is_none() && Lift::new(&scene, triangle, -facing).is_none());
        }
    }
    let tracer = Tracer::new(&scene);
    for triangle in 0..scene.triangles.len() as u32 {
        let (ground, facing) = (Ground::new(scene.corners(triangle)), scene.geometric_normal(triangle));
        for (k, direction) in directions(200).enumerate() {
            let b = Vec2::new(0.9 * (k as f32 * 0.618).fract(), 0.05);
            let start = tracer.leave_smooth(&ground, None, b, direction, facing);
            let above = direction.dot(facing) > 0.0;
            assert_eq!(start, above.then(|| tracer.leave(&ground, b, direction)), "{triangle}, {direction}");
        }
    }
}

#[test]
fn only_rays_that_graze_a_facet_are_lifted() {
    let scene = ball(12, 8);
    let tracer = Tracer::new(&scene);
    let mut lifted = 0;
    for triangle in 0..scene.triangles.len() as u32 {
        let (ground, facing) = (Ground::new(scene.corners(triangle)), scene.geometric_normal(triangle));
        let lift = Lift::new(&scene, triangle, facing).unwrap();
        assert!(Lift::new(&scene, triangle, -facing).is_none(), "a sphere is concave from inside");
        let b = Vec2::splat(1.0 / 3.0);
        for direction in directions(500) {
            let plain = tracer.leave(&ground, b, if direction.dot(facing) > 0.0 { direction } else { facing });
            let start = tracer.leave_smooth(&ground, Some(&lift), b, direction, facing).unwrap();
            if direction.dot(facing) >= 0.1 {
                assert_eq!(start, plain);
                continue;
            }
            lifted += 1;
            assert!((start - plain).dot(facing) > 0.0 && start.length() < 1.12, "{start} over {plain}");
            let ray = Ray { origin: start, direction, t_max: f32::INFINITY };
            if direction.dot(scene.shading_normal(triangle, b)) > 0.0 {
                assert!(!tracer.occluded(&ray), "{triangle}, {direction}");
            }
        }
    }
    assert!(lifted > 10_000, "{lifted}");
}
