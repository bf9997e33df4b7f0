//! Light at vertices: what least squares must reproduce, what it must never do, and how triangles are cut.
#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "tests")]

#[path = "support/solve.rs"]
mod solve;
#[path = "support/mod.rs"]
mod support;

use glam::{DVec3, Vec3};
use solve::{Stage, load};
use std::collections::BTreeMap;
use support::{blob, grid, place, room, scene_from_triangles, skew};
use texelwalk::base::{Progress, Rgb};
use texelwalk::finish::{self, Lightmap};
use texelwalk::scene::Scene;
use texelwalk::vertices::{Settings, VertexLight, fit};

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
    assert!(!light.fit.reached && light.fit.triangles > 2 && light.fit.triangles < 600, "{:?}", light.fit);
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
