//! Seams: steps at borders of charts before and after they are stitched, what may not change, and what is no seam.

#![allow(clippy::print_stderr, reason = "figures of the slow tests")]

use crate::solve::Stage;
use crate::support::{blob, cuboid, grid, place, scene_from_triangles, skew};
use glam::{DMat3, DVec3, Vec3};
use texelwalk::base::{Progress, Rgb};
use texelwalk::finish::{self, Lightmap};
use texelwalk::scene::Scene;
use texelwalk::seams::{Seams, Steps};

/// A smooth-shaded closed surface: vertices at one place get the mean normal of their triangles.
fn smooth(triangles: &[[Vec3; 3]]) -> Scene {
    let mut scene = scene_from_triangles(triangles);
    let mut sums = std::collections::BTreeMap::<[u32; 3], Vec3>::new();
    for t in triangles {
        let normal = (t[1] - t[0]).cross(t[2] - t[0]);
        for p in t {
            *sums.entry(p.to_array().map(f32::to_bits)).or_default() += normal;
        }
    }
    let normal = |p: &Vec3| sums[&p.to_array().map(f32::to_bits)].normalize();
    scene.vertices.normal = scene.vertices.position.iter().map(normal).collect();
    scene.parts[0].flat = false;
    scene
}

/// Every list of triangles as a part of its own: modular pieces.
fn pieces(pieces: &[Vec<[DVec3; 3]>]) -> Scene {
    let all: Vec<[DVec3; 3]> = pieces.concat();
    let mut scene = scene_from_triangles(&place(&all, DMat3::IDENTITY, 1.0, DVec3::ZERO));
    let whole = scene.parts.remove(0);
    let mut first = 0u32;
    for (k, piece) in pieces.iter().enumerate() {
        let end = first + piece.len() as u32;
        let mut part = whole.clone();
        part.node = k;
        part.name = format!("piece {k}");
        (part.triangles, part.vertices) = (first..end, 3 * first..3 * end);
        scene.parts.push(part);
        scene.triangle_part[first as usize..end as usize].fill(k as u32);
        first = end;
    }
    scene
}

/// 24 pieces: floors of 2 m, walls of 2 × 3 m, and a stretch of wall from four small ones, which meets others in T's.
fn corridor() -> Scene {
    let mut all = vec![];
    let mut quad = |corner: DVec3, u: DVec3, v: DVec3| {
        let mut piece = vec![];
        grid(corner, u, v, 1, 1, &mut piece);
        all.push(piece);
    };
    for k in 0..7 {
        let x = DVec3::X * (2.0 * f64::from(k));
        quad(x, DVec3::Z * 2.0, DVec3::X * 2.0);
        quad(x + DVec3::Z * 2.0, DVec3::Y * 3.0, DVec3::X * 2.0);
        if k != 3 {
            quad(x, DVec3::X * 2.0, DVec3::Y * 3.0);
            continue;
        }
        for (i, j) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.5), (1.0, 1.5)] {
            quad(x + DVec3::new(i, j, 0.0), DVec3::X, DVec3::Y * 1.5);
        }
    }
    pieces(&all)
}

fn torus() -> Vec<[DVec3; 3]> {
    let at = |i: usize, j: usize| {
        let turn = core::f64::consts::TAU;
        let (u, v) = ((i % 64) as f64 / 64.0 * turn, (j % 32) as f64 / 32.0 * turn);
        let r = 1.0 + 0.45 * libm::cos(v);
        DVec3::new(r * libm::cos(u), 0.45 * libm::sin(v), -r * libm::sin(u))
    };
    let cell =
        |k: usize| (at(k / 32, k % 32), at(k / 32 + 1, k % 32), at(k / 32 + 1, k % 32 + 1), at(k / 32, k % 32 + 1));
    (0..64 * 32).map(cell).flat_map(|(a, b, c, d)| [[a, b, c], [a, c, d]]).collect()
}

/// A sun with soft shadows every few metres, a sky, and a little light from below.
fn sunny(p: Vec3, n: Vec3) -> Rgb {
    let sun =
        n.dot(Vec3::new(0.48, 0.8, 0.36)).max(0.0) * (0.55 + 0.45 * libm::tanhf(3.0 * libm::sinf(p.x + 0.3 * p.z)));
    Rgb::new(1.0, 0.9, 0.75) * sun + Rgb::new(0.2, 0.3, 0.5) * (1.0 + n.y) + 0.05
}

fn painted(stage: &Stage<'_>, light: impl Fn(Vec3, Vec3) -> Rgb) -> Lightmap {
    let patches = &stage.patches;
    let values: Vec<Rgb> = (0..patches.front).map(|i| light(patches.position[i], patches.normal[i])).collect();
    let mut lightmap = finish::assemble(patches, stage.atlas.pages, &values, 1.0);
    lightmap.pages.iter_mut().for_each(|page| finish::dilate(page, 2));
    lightmap
}

struct Stitched {
    before: Lightmap,
    after: Lightmap,
    /// At points other than those that are made to agree.
    steps: [Steps; 2],
}

/// Points per texel at which steps are measured.
const MEASURED: f32 = 13.0;

fn stitched(scene: &Scene, texels_per_meter: f32, light: impl Fn(Vec3, Vec3) -> Rgb) -> Stitched {
    let stage = Stage::new(scene, texels_per_meter);
    let seams = Seams::new(&stage.tracer, &stage.atlas, &stage.patches, &Progress::default());
    let before = painted(&stage, light);
    let mut after = before.clone();
    if let Some(stitcher) = seams.stitcher(&stage.patches, &before, &Progress::default()) {
        stitcher.stitch(&mut after, &Progress::default());
    }
    let other = Seams::asked_at(&stage.tracer, &stage.atlas, &stage.patches, MEASURED, &Progress::default());
    let steps = [&before, &after].map(|l| other.steps(&stage.patches, l));
    Stitched { before, after, steps }
}

#[test]
fn steps_vanish_on_smooth_bodies_and_between_modular_pieces() {
    let whole = |t: &[[DVec3; 3]], scale: f64| smooth(&place(t, skew(), scale, DVec3::new(0.1, 0.2, 0.3)));
    let scenes = [
        ("sphere", whole(&blob(12, 0.0), 2.0)),
        ("torus", whole(&torus(), 1.0)),
        ("body", whole(&blob(16, 0.1), 2.5)),
        ("corridor", corridor()),
    ];
    for (name, scene) in &scenes {
        for density in [8.0, 32.0] {
            let [before, after] = stitched(scene, density, sunny).steps;
            eprintln!("{name} {density}: {} points, {:.4} → {:.5}", after.points, before.p999, after.p999);
            assert!(after.points > 100 && before.p999 > 0.01, "{name} {density}: {before:?}");
            // Where texels are coarse for a shape, more weight on seams would take light farther from the truth.
            let most = match (*name, density) {
                ("body", 8.0) => 0.025,
                ("body", _) => 0.02,
                ("torus", 8.0) => 0.0125,
                _ => 0.005,
            };
            assert!(after.p999 < most, "{name} {density}: {after:?}");
        }
    }
}

#[test]
fn texels_hardly_change_and_only_along_seams() {
    let s = stitched(&corridor(), 16.0, sunny);
    let (mut changed, mut covered, mut most) = (0, 0, 0.0f32);
    for (a, b) in s.before.pixels().zip(s.after.pixels()) {
        assert_eq!(a[3], b[3]);
        if a[3] > 0.0 {
            covered += 1;
            changed += i32::from(a != b);
            most = (0..3).map(|c| (a[c] - b[c]).abs() / a[c]).fold(most, f32::max);
        }
    }
    assert!(changed > 0 && changed * 10 < covered, "{changed} of {covered}");
    assert!(most < 0.02, "{most}");
}

#[test]
fn light_does_not_run_along_seams_into_the_dark() {
    for (name, triangles) in [("sphere", blob(12, 0.0)), ("body", blob(16, 0.1)), ("torus", torus())] {
        let scene = smooth(&place(&triangles, skew(), 2.0, DVec3::ZERO));
        let stage = Stage::new(&scene, 16.0);
        let seams = Seams::new(&stage.tracer, &stage.atlas, &stage.patches, &Progress::default());
        // Stripes of light, without any between them.
        let stripe = |p: Vec3| if libm::sinf(4.0 * p.x) > 0.0 { 1.0 } else { 0.0 };
        let mut lightmap = painted(&stage, |p, _| Rgb::splat(stripe(p)));
        let mean = lightmap.pixels().map(|p| p[0] * p[3]).sum::<f32>() / stage.patches.front as f32;
        seams
            .stitcher(&stage.patches, &lightmap, &Progress::default())
            .unwrap()
            .stitch(&mut lightmap, &Progress::default());
        let patches = &stage.patches;
        let pixels: Vec<&[f32; 4]> = lightmap.pixels().collect();
        let dark = |i: &usize| {
            let place = patches.position[*i];
            let around = [-3.0, 0.0, 3.0].map(|texels| stripe(place + Vec3::X * (texels / 16.0)));
            patches.exposed[*i] > 0.0 && around == [0.0; 3]
        };
        let lit = (0..patches.front).filter(dark).map(|i| pixels[patches.texel[i] as usize][0]);
        let most = lit.fold(0.0, f32::max) / mean;
        eprintln!("{name}: {most:.4} of the mean");
        assert!(most < 0.02, "{name}: {most}");
    }
}

#[test]
fn even_shade_beside_bright_light_gets_no_dark_dashes() {
    const SHADE: f32 = 0.05;
    for (name, triangles) in [("sphere", blob(12, 0.0)), ("body", blob(16, 0.1)), ("torus", torus())] {
        let scene = smooth(&place(&triangles, skew(), 2.0, DVec3::ZERO));
        let stage = Stage::new(&scene, 16.0);
        let patches = &stage.patches;
        let seams = Seams::new(&stage.tracer, &stage.atlas, patches, &Progress::default());
        let stripes = |p: Vec3| if libm::sinf(4.0 * p.x) > 0.0 { 1.0 } else { SHADE };
        let before = painted(&stage, |p, _| Rgb::splat(stripes(p)));
        let mut after = before.clone();
        let stitcher = seams.stitcher(patches, &before, &Progress::default()).unwrap();
        stitcher.stitch(&mut after, &Progress::default());
        let texels = |chart: u32| (0..patches.front).filter(|&i| patches.chart(i) == chart).count();
        let charts = 1 + (0..patches.front).map(|i| patches.chart(i)).max().unwrap();
        let wide: Vec<bool> = (0..charts).map(|chart| texels(chart) >= 100).collect();
        let [held, holds] = [&before, &after].map(|l| l.pixels().map(|p| p[0]).collect::<Vec<f32>>());
        let of = |values: &[f32], i: usize| values[patches.texel[i] as usize];
        let even: Vec<usize> = (0..patches.front)
            .filter(|&i| wide[patches.chart(i) as usize] && patches.exposed[i] > 0.0 && of(&held, i) == SHADE)
            .collect();
        let least = even.iter().map(|&i| of(&holds, i)).fold(f32::INFINITY, f32::min) / SHADE;
        let changed = even.iter().filter(|&&i| of(&holds, i) != SHADE).count();
        eprintln!("{name}: {changed} of {} texels in the shade change, none to less than {least:.3}", even.len());
        assert!(changed > 20 && least > 0.799, "{name}: {changed}, {least}");
    }
}

trait Pixels {
    fn pixels(&self) -> impl Iterator<Item = &[f32; 4]>;
}

impl Pixels for Lightmap {
    fn pixels(&self) -> impl Iterator<Item = &[f32; 4]> {
        self.pages.iter().flat_map(|page| &page.pixels)
    }
}

#[test]
fn specks_in_the_dark_do_not_darken_what_they_lie_in() {
    // A plate of 4 × 4 texels with holes of a ninth of it, a quarter of a texel wide, filled by pieces in the dark.
    let (cells, cell) = (16, 0.25 / 16.0);
    let is_hole = |i: i32, j: i32| i % 3 == 1 && j % 3 == 1;
    let mut all = vec![vec![]];
    for (i, j) in (0..cells * cells).map(|k| (k % cells, k / cells)) {
        let mut square = vec![];
        let at = DVec3::new(f64::from(i), 0.0, f64::from(j)) * cell;
        grid(at, DVec3::Z * cell, DVec3::X * cell, 1, 1, &mut square);
        if is_hole(i, j) { all.push(square) } else { all[0].extend(square) }
    }
    let mut scene = pieces(&all);
    (0..).zip(&mut scene.parts).for_each(|(k, part)| part.mesh = k);
    let stage = Stage::new(&scene, 16.0);
    assert_eq!(stage.atlas.charts.len(), 26);
    let patches = &stage.patches;
    let plate: Vec<usize> = (0..patches.front).filter(|i| patches.chart(*i) == 0).collect();
    let light: Vec<Rgb> = (0..patches.front).map(|i| Rgb::splat(f32::from(plate.contains(&i)))).collect();
    let mut map = finish::assemble(patches, stage.atlas.pages, &light, 1.0);
    finish::fill(patches, &mut map, 0, 2);
    let progress = Progress::default();
    let seams = Seams::new(&stage.tracer, &stage.atlas, patches, &progress);
    assert!(seams.steps(patches, &map).points > 100);
    seams.stitcher(patches, &map, &progress).unwrap().stitch(&mut map, &progress);
    let pixel = |i: &usize| {
        let (x, y) = patches.texel_xy(*i);
        map.pages[0].pixels[(y * map.pages[0].width + x) as usize][0]
    };
    let least = plate.iter().map(pixel).fold(1.0, f32::min);
    assert!(least > 0.7, "the plate holds {least} of its light");
}

#[test]
fn constants_and_zero_stay_and_nothing_goes_below_zero() {
    let scene = smooth(&place(&blob(10, 0.2), skew(), 2.0, DVec3::ZERO));
    for light in [Rgb::new(0.3, 2.0, 0.0), Rgb::ZERO] {
        let s = stitched(&scene, 12.0, |_, _| light);
        for (a, b) in s.before.pixels().zip(s.after.pixels()) {
            assert!((0..3).all(|c| (a[c] - b[c]).abs() <= 1e-4 * a[c]), "{a:?} {b:?}");
        }
    }
    let s = stitched(&scene, 12.0, |p, _| Rgb::splat(if p.x + 0.3 * p.y > 0.0 { 1.0 } else { 0.0 }));
    assert!(s.after.pixels().all(|p| p.iter().all(|v| *v >= 0.0)));
}

#[test]
fn parts_of_the_light_are_stitched_as_their_sum_is() {
    let scene = corridor();
    let stage = Stage::new(&scene, 16.0);
    let seams = Seams::new(&stage.tracer, &stage.atlas, &stage.patches, &Progress::default());
    let (warm, cold) = (|p: Vec3, n: Vec3| sunny(p, n) * 0.7, |p: Vec3, _: Vec3| Rgb::splat(0.2 + 0.05 * p.x));
    let whole = painted(&stage, |p, n| warm(p, n) + cold(p, n));
    let stitcher = seams.stitcher(&stage.patches, &whole, &Progress::default()).unwrap();
    let [a, b, sum] = [painted(&stage, warm), painted(&stage, cold), whole].map(|mut lightmap| {
        stitcher.stitch(&mut lightmap, &Progress::default());
        lightmap
    });
    for ((a, b), sum) in a.pixels().zip(b.pixels()).zip(sum.pixels()) {
        // What was filled beyond a corner is hardly asked for anything, and solved less exactly.
        let most = if sum[3] > 0.0 { 2e-3 } else { 1e-2 };
        assert!((0..3).all(|c| (a[c] + b[c] - sum[c]).abs() <= most * sum[c].max(0.1)), "{a:?} {b:?} {sum:?}");
    }
}

#[test]
fn hard_edges_and_walls_on_a_border_are_no_seams() {
    let mut cube = vec![];
    cuboid(DVec3::ZERO, DVec3::splat(2.0), 1, false, &mut cube);
    let scene = scene_from_triangles(&place(&cube, DMat3::IDENTITY, 1.0, DVec3::ZERO));
    assert_eq!(stitched(&scene, 8.0, sunny).steps[1].points, 0);
    // Two floors side by side; then the same with a wall on the border, as a solid and as a sheet.
    let floor = |x: f64| {
        let mut piece = vec![];
        grid(DVec3::X * x, DVec3::Z * 2.0, DVec3::X * 2.0, 1, 1, &mut piece);
        piece
    };
    let split = |p: Vec3, _: Vec3| Rgb::splat(if p.x < 2.0 { 1.0 } else { 0.01 });
    let open = stitched(&pieces(&[floor(0.0), floor(2.0)]), 8.0, split).steps;
    assert!(open[0].points > 30 && open[0].worst > 1.0 && open[1].worst < 0.01, "{open:?}");
    for half in [0.2, 0.0] {
        let mut wall = vec![];
        cuboid(DVec3::new(2.0 - half, -0.5, -0.5), DVec3::new(2.0 + half, 2.0, 2.5), 1, false, &mut wall);
        let steps = stitched(&pieces(&[floor(0.0), floor(2.0), wall]), 8.0, split).steps;
        assert_eq!(steps[1].points, 0, "wall of {} m", 2.0 * half);
    }
}

#[test]
fn the_same_bits_at_any_thread_count() {
    let scene = smooth(&place(&blob(10, 0.2), skew(), 2.0, DVec3::ZERO));
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| stitched(&scene, 16.0, sunny).after)
    };
    assert!(run(1) == run(3));
}
