//! Light at vertices: what least squares must reproduce, what it must never do, and how triangles are cut.
#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "tests")]

#[path = "support/solve.rs"]
mod solve;
#[path = "support/mod.rs"]
mod support;

use glam::{DVec3, Vec2, Vec3, Vec4};
use solve::{Stage, load};
use std::collections::BTreeMap;
use support::{blob, grid, place, room, scene_from_triangles, skew};
use texelwalk::base::{Progress, Rgb};
use texelwalk::finish::{self, Lightmap};
use texelwalk::scene::{Scene, Sky};
use texelwalk::vertices::{Fit, Settings, VertexLight, fit};
use texelwalk::walk::Splat;

/// A lightmap with `light` at the middle of each texel's surface, dilated as a bake does.
fn painted(stage: &Stage<'_>, light: impl Fn(Vec3) -> Rgb) -> Lightmap {
    let values: Vec<Rgb> = stage.patches.position[..stage.patches.front].iter().map(|p| light(*p)).collect();
    let mut lightmap = finish::assemble(&stage.patches, stage.atlas.pages, &values, 1.0);
    lightmap.pages.iter_mut().for_each(|page| finish::dilate(page, 2));
    lightmap
}

fn fitted(scene: &Scene, texels_per_meter: f32, subdivide: Option<f64>, light: impl Fn(Vec3) -> Rgb) -> VertexLight {
    let stage = Stage::new(scene, texels_per_meter);
    let lightmap = painted(&stage, light);
    fit(scene, &stage.atlas, &stage.patches, &lightmap, &Settings { subdivide }, &Progress::default())
}

/// Position and value of every vertex of a part.
fn vertices(scene: &Scene, light: &VertexLight, part: usize) -> Vec<(Vec3, Rgb)> {
    let first = scene.parts[part].vertices.start;
    let own = &light.parts[part];
    let at = |o: &texelwalk::vertices::Origin| {
        (0..3).map(|k| scene.vertices.position[(first + o.source[k]) as usize] * o.weight[k]).sum()
    };
    own.origins.iter().zip(&own.values).map(|(o, v)| (at(o), *v)).collect()
}

fn floor(n: usize) -> Vec<[DVec3; 3]> {
    let mut out = vec![];
    grid(DVec3::ZERO, DVec3::Z * 4.0, DVec3::X * 4.0, n, n, &mut out);
    out
}

#[test]
fn a_constant_is_reproduced_also_where_furniture_hides_the_floor() {
    let scene = scene_from_triangles(&place(&room(3), skew(), 2.0, DVec3::ZERO));
    let constant = Rgb::new(0.25, 3.0, 0.0);
    for subdivide in [None, Some(1e-9)] {
        let light = fitted(&scene, 12.0, subdivide, |_| constant);
        assert!(light.fit.error < 1e-5, "{}", light.fit.error);
        // The undersides of the four pieces of furniture lie on the floor: nothing of them is seen.
        let (hidden, seen): (Vec<Rgb>, Vec<Rgb>) = light.parts[0].values.iter().partition(|v| **v == Rgb::ZERO);
        assert!((96..200).contains(&hidden.len()), "{}", hidden.len());
        assert!(seen.iter().all(|v| (*v - constant).abs().max_element() < 1e-4));
    }
}

#[test]
fn light_that_is_linear_is_reproduced() {
    let scene = scene_from_triangles(&place(&floor(5), skew(), 1.0, DVec3::new(3.0, 1.0, -2.0)));
    let linear = |p: Vec3| Rgb::new(5.0 + 0.5 * p.x, 3.0 - 0.1 * p.y + 0.2 * p.z, 1.0);
    let light = fitted(&scene, 25.0, None, linear);
    for (p, value) in vertices(&scene, &light, 0) {
        // Half a texel at the border is flat, because nothing is known beyond it.
        assert!((value - linear(p)).abs().max_element() < 0.02, "{value} at {p}, not {}", linear(p));
    }
}

#[test]
fn shadows_do_not_ring_below_zero() {
    let triangles: Vec<[Vec3; 3]> = floor(8).iter().map(|t| t.map(|p| p.as_vec3())).collect();
    let scene = scene_from_triangles(&triangles);
    let light = fitted(&scene, 32.0, None, |p| Rgb::splat(if p.x < 1.8 { 0.02 } else { 1.0 }));
    let values = vertices(&scene, &light, 0);
    assert!(values.iter().all(|(_, v)| v.min_element() >= 0.0));
    // Without the constraint the row of vertices before the edge of the shadow would swing below zero.
    let zeros = values.iter().filter(|(p, v)| p.x == 1.5 && *v == Rgb::ZERO).count();
    assert!(zeros > 0);
}

#[test]
fn parts_that_abut_have_one_value_where_they_meet() {
    let mut scene = scene_from_triangles(&place(&floor(6), skew(), 1.0, DVec3::new(50.0, 0.0, 9.0)));
    let half = scene.triangles.len() as u32 / 2;
    let mut second = scene.parts[0].clone();
    (second.vertices, second.triangles) = (3 * half..6 * half, half..2 * half);
    (scene.parts[0].vertices, scene.parts[0].triangles) = (0..3 * half, 0..half);
    scene.parts.push(second);
    scene.triangle_part[half as usize..].fill(1);
    // The border of the second part is off by what transforms round.
    scene.vertices.position[3 * half as usize..].iter_mut().for_each(|p| *p += Vec3::splat(4e-6));
    for subdivide in [None, Some(0.02)] {
        let light = fitted(&scene, 16.0, subdivide, |p| Rgb::splat(1.0 + libm::sinf(3.0 * (p.x + p.y + p.z))));
        let [a, b] = [0, 1].map(|part| vertices(&scene, &light, part));
        let mut met = 0;
        for (p, value) in &a {
            for (_, other) in b.iter().filter(|(q, _)| q.distance(*p) < 1e-4) {
                assert_eq!(value, other, "at {p}");
                met += 1;
            }
        }
        assert!(met >= 7, "{met}");
        assert_eq!(light.parts[1].refined, subdivide.is_some());
    }
}

#[test]
fn cut_triangles_fit_better_and_leave_no_vertex_on_an_edge() {
    let scene = scene_from_triangles(&place(&blob(4, 0.1), skew(), 2.0, DVec3::ZERO));
    let step = |p: Vec3| Rgb::splat(if p.x + 0.3 * p.y > 0.1 { 1.0 } else { 0.1 });
    let [coarse, fine] = [None, Some(0.1)].map(|subdivide| fitted(&scene, 24.0, subdivide, step));
    assert!(coarse.fit.error > 0.15 && fine.fit.error <= 0.1 && fine.fit.reached, "{:?} {:?}", coarse.fit, fine.fit);
    assert_eq!(coarse.parts[0].triangles.len(), scene.triangles.len());
    let places: Vec<Vec3> = vertices(&scene, &fine, 0).into_iter().map(|(p, _)| p).collect();
    let key = |v: u32| (places[v as usize] * 4096.0).round().to_array().map(|x| x as i32);
    let mut edges: BTreeMap<_, i32> = BTreeMap::new();
    let mut area = 0.0;
    for t in &fine.parts[0].triangles {
        for k in 0..3 {
            let (a, b) = (key(t[k]), key(t[(k + 1) % 3]));
            // A closed surface: the neighbour goes the other way.
            *edges.entry((a.min(b), a.max(b))).or_default() += if a < b { 1 } else { -1 };
        }
        let [a, b, c] = t.map(|v| places[v as usize].as_dvec3());
        area += 0.5 * (b - a).cross(c - a).length();
    }
    assert!(edges.values().all(|n| *n == 0), "{} open edges", edges.values().filter(|n| **n != 0).count());
    let before: f64 = (0..scene.triangles.len() as u32).map(|t| scene.area(t)).sum();
    assert!((area / before - 1.0).abs() < 1e-5, "{area} {before}");
}

#[test]
fn what_cannot_be_reached_is_said() {
    let scene = scene_from_triangles(&place(&floor(1), skew(), 1.0, DVec3::ZERO));
    let light = fitted(&scene, 4.0, Some(1e-6), |p| Rgb::splat(if libm::sinf(p.x * 3.0) > 0.2 { 1.0 } else { 0.0 }));
    assert!(!light.fit.reached && light.fit.triangles > 2 && light.fit.triangles < 256 * 8, "{:?}", light.fit);
    let dark = fitted(&scene, 4.0, Some(0.1), |_| Rgb::ZERO);
    assert!(dark.fit.reached && dark.fit.error == 0.0 && dark.parts[0].values.iter().all(|v| *v == Rgb::ZERO));
}

#[test]
fn the_same_bits_at_any_number_of_threads() {
    let scene = load("cornell/cornell.gltf");
    let wave = |p: Vec3| Rgb::new(1.0 + libm::sinf(5.0 * p.x), (p.y * p.z).abs(), if p.z > 0.1 { 1.0 } else { 0.0 });
    let fit_with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| fitted(&scene, 20.0, Some(0.1), wave))
    };
    let one = fit_with(1);
    assert!(one.fit.triangles > scene.triangles.len() as u64);
    assert!([2, 3].into_iter().all(|threads| fit_with(threads) == one));
}

#[test]
#[ignore = "slow: a million texels"]
fn two_hundred_thousand_vertices_take_seconds() {
    let scene = scene_from_triangles(&place(&floor(448), skew(), 1.0, DVec3::ZERO));
    let stage = Stage::new(&scene, 256.0);
    let lightmap =
        painted(&stage, |p| Rgb::new(1.0 + libm::sinf(9.0 * p.x), if p.z > 0.1 { 1.0 } else { 0.0 }, p.y.abs()));
    let start = std::time::Instant::now();
    let how = Settings::default();
    let light = fit(&scene, &stage.atlas, &stage.patches, &lightmap, &how, &Progress::default());
    let seconds = start.elapsed().as_secs_f64();
    eprintln!("{} texels, {} unknowns: {seconds:.2} s, {:?}", stage.patches.front, light.fit.unknowns, light.fit);
    assert!(
        light.fit.unknowns > 200_000 && stage.patches.front > 1_000_000 && light.fit.error < light.fit.error_averaged
    );
    // Two cores do it in under five when nothing else runs.
    assert!(seconds < 10.0, "{seconds} s");
}

#[test]
fn better_than_looking_at_the_vertices_or_averaging() {
    let scene = scene_from_triangles(&place(&floor(12), skew(), 1.0, DVec3::ZERO));
    let bump = |p: Vec3| Rgb::splat(1.0 + libm::sinf(2.0 * p.x) * libm::cosf(1.7 * p.z + 0.3));
    let fit = fitted(&scene, 32.0, None, bump).fit;
    assert!(fit.error < 0.6 * fit.error_sampled && fit.error < 0.6 * fit.error_averaged, "{fit:?}");
}

/// A square of 4 m, `cells`² quads with smooth normals, `height` [m] over it, under an even sky.
fn relief(cells: u32, height: impl Fn(f32, f32) -> f32) -> Scene {
    let mut scene = scene_from_triangles(&place(&floor(1), skew(), 1.0, DVec3::ZERO));
    let at = |i: u32, k: u32| {
        let [x, z] = [i, k].map(|n| n as f32 * 4.0 / cells as f32);
        Vec3::new(x, height(x, z), z)
    };
    let (mut position, mut normal) = (vec![], vec![]);
    for (i, k) in (0..=cells).flat_map(|i| (0..=cells).map(move |k| (i, k))) {
        let p = at(i, k);
        let slope = |dx: f32, dz: f32| (height(p.x + dx, p.z + dz) - height(p.x - dx, p.z - dz)) / 0.002;
        position.push(p);
        normal.push(Vec3::new(-slope(0.001, 0.0), 1.0, -slope(0.0, 0.001)).normalize());
    }
    let corner = |i: u32, k: u32| i * (cells + 1) + k;
    let quad = |(i, k): (u32, u32)| {
        let [a, b, c, d] = [corner(i, k), corner(i, k + 1), corner(i + 1, k + 1), corner(i + 1, k)];
        [[a, b, c], [a, c, d]]
    };
    scene.triangles = (0..cells).flat_map(|i| (0..cells).map(move |k| (i, k))).flat_map(quad).collect();
    let (vertices, triangles) = (position.len(), scene.triangles.len());
    scene.triangle_part = vec![0; triangles];
    scene.vertices.color = vec![Vec4::ONE; vertices];
    scene.vertices.uv = vec![vec![Vec2::ZERO; vertices]];
    (scene.vertices.position, scene.vertices.normal) = (position, normal);
    let part = &mut scene.parts[0];
    (part.vertices, part.triangles, part.flat) = (0..vertices as u32, 0..triangles as u32, false);
    scene.sky = Sky::constant(Rgb::ONE);
    scene
}

/// The fit of light that was solved: shadow rays, and `lines` for what is reflected.
fn solved(scene: &Scene, texels_per_meter: f32, lines: u64, subdivide: Option<f64>) -> Fit {
    let stage = Stage::new(scene, texels_per_meter);
    let direct = stage.direct(64);
    let indirect = stage.walk(Some(&direct), Splat::None, lines, 1).indirect;
    let light: Vec<Rgb> = direct.iter().zip(indirect).map(|(d, i)| *d + i).collect();
    let mut lightmap = finish::assemble(&stage.patches, stage.atlas.pages, &light, 1.0);
    lightmap.pages.iter_mut().for_each(|page| finish::dilate(page, 2));
    fit(scene, &stage.atlas, &stage.patches, &lightmap, &Settings { subdivide }, &Progress::default()).fit
}

/// Both plain methods at the same vertices.
#[test]
fn three_fifths_of_the_error_of_sampling_and_averaging_in_four_scenes() {
    let [waves, hills, pits] = [
        relief(18, |x, z| 0.25 * libm::sinf(5.0 * x) * libm::cosf(5.0 * z)),
        relief(16, |x, z| 0.15 * (libm::sinf(4.0 * x + z) + libm::cosf(5.0 * z - x))),
        relief(14, |x, z| -0.4 * (libm::sinf(3.0 * x) * libm::sinf(3.0 * z)).powi(2)),
    ];
    let chairs = load("chairs/chairs.glb");
    let scenes = [
        ("waves", &waves, 0, None),
        ("hills", &hills, 0, None),
        ("pits", &pits, 0, None),
        ("chairs", &chairs, 4_000_000, Some(0.1)),
    ];
    for (name, scene, lines, subdivide) in scenes {
        let fit = solved(scene, 24.0, lines, subdivide);
        eprintln!("{name}: {:.3} {:.3} {fit:?}", fit.error / fit.error_sampled, fit.error / fit.error_averaged);
        assert!(fit.error <= 0.6 * fit.error_sampled && fit.error <= 0.6 * fit.error_averaged, "{name}: {fit:?}");
    }
}

/// A cord: a triangular prism 4 mm wide and 2 m long, less than a texel wide at 32 texels per metre.
#[test]
fn needles_are_cut_along_their_length() {
    let ring = [0.0, 1.0, 2.0].map(|k| DVec3::new(0.002 * libm::cos(k * 2.1), 0.0, 0.002 * libm::sin(k * 2.1)));
    let sides = (0..3).flat_map(|k| {
        let (a, b) = (ring[k], ring[(k + 1) % 3]);
        let up = DVec3::Y * 2.0;
        [[a, a + up, b + up], [a, b + up, b]]
    });
    let cord = scene_from_triangles(&place(&sides.collect::<Vec<_>>(), skew(), 1.0, DVec3::ZERO));
    let end = skew().as_mat3() * Vec3::Y;
    let light = fitted(&cord, 32.0, Some(0.05), |p| Rgb::splat(1.0 / (0.1 + (2.0 - p.dot(end)).powi(2))));
    assert!(light.fit.reached && light.fit.error <= 0.05 && light.fit.triangles < 400, "{:?}", light.fit);
}
