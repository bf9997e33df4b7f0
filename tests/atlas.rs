//! The atlas stage on meshes with known charts, on bad meshes, and against its invariants.
//!
//! Footprints are checked with an independent clipper in double precision, not with the code under test.

#![allow(clippy::print_stdout, clippy::unwrap_used, reason = "figures are shown with --nocapture; a test may panic")]

mod atlas_meshes;

use atlas_meshes::{
    Mesh, bad_meshes, cylinder, interior, laid_out, laid_out_with_needles, noise, one_box, rough, scene, sphere,
    terrain, torus,
};
use glam::{DVec2, Vec2, Vec3};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};
use texelwalk::atlas::{self, Atlas, NO_CHART, Settings, Uv};
use texelwalk::base::Warned;
use texelwalk::scene::Scene;
use texelwalk::trace::Tracer;

fn settings(texels_per_meter: f32) -> Settings {
    Settings { texels_per_meter, ..Settings::default() }
}

fn build(scene: &Scene, settings: &Settings) -> Warned<Atlas> {
    let built = atlas::build(&Tracer::new(scene), settings).unwrap();
    check(scene, settings, &built.output);
    built
}

fn corners(atlas: &Atlas, part: usize, triangle: usize) -> [DVec2; 3] {
    atlas.parts[part].layout.triangles[triangle].map(|v| atlas.parts[part].uv(v).as_dvec2())
}

/// World area and flat area of each chart [m², texels²].
fn areas(scene: &Scene, atlas: &Atlas) -> Vec<(f64, f64)> {
    let mut areas = vec![(0.0, 0.0); atlas.charts.len()];
    for (p, part) in scene.parts.iter().enumerate() {
        for t in 0..part.triangles.len() {
            let chart = atlas.parts[p].chart(t);
            if chart != NO_CHART {
                let [a, b, c] = corners(atlas, p, t);
                areas[chart as usize].0 += scene.area(part.triangles.start + t as u32);
                areas[chart as usize].1 += 0.5 * (b - a).perp_dot(c - a).abs();
            }
        }
    }
    areas
}

/// The part of a convex polygon where `sign · (p[axis] − limit) ≥ 0`.
fn clip(polygon: &[DVec2], axis: usize, sign: f64, limit: f64) -> Vec<DVec2> {
    let inside = |p: DVec2| sign * (p[axis] - limit);
    let mut clipped = Vec::new();
    for i in 0..polygon.len() {
        let (a, b) = (polygon[i], polygon[(i + 1) % polygon.len()]);
        if inside(a) >= 0.0 {
            clipped.push(a);
        }
        if inside(a) * inside(b) < 0.0 {
            clipped.push(a + (b - a) * (inside(a) / (inside(a) - inside(b))));
        }
    }
    clipped
}

/// Texels that share an area with a triangle.
fn touched(uv: [DVec2; 3]) -> Vec<(i64, i64)> {
    let area = |p: &[DVec2]| {
        let sum: f64 = (0..p.len()).map(|i| (p[i] - p[0]).perp_dot(p[(i + 1) % p.len()] - p[0])).sum();
        sum.abs()
    };
    let range = |p: &[DVec2], axis: usize| {
        let low = p.iter().fold(f64::INFINITY, |a, p| a.min(p[axis]));
        let high = p.iter().fold(f64::NEG_INFINITY, |a, p| a.max(p[axis]));
        low.floor() as i64..=high.ceil() as i64
    };
    let mut texels = Vec::new();
    for y in range(&uv, 1) {
        let row = clip(&clip(&uv, 1, 1.0, y as f64), 1, -1.0, (y + 1) as f64);
        if row.len() < 3 {
            continue;
        }
        for x in range(&row, 0) {
            if area(&clip(&clip(&row, 0, 1.0, x as f64), 0, -1.0, (x + 1) as f64)) > 1e-9 {
                texels.push((x, y));
            }
        }
    }
    texels
}

/// Chart of each texel of the pages, row by row, page by page; `NO_CHART` where empty.
struct Owners {
    texels: Vec<u32>,
    size: [usize; 2],
}

impl Owners {
    fn new(atlas: &Atlas) -> Self {
        let size = atlas.page_size.map(|side| side as usize);
        Self { texels: vec![NO_CHART; size[0] * size[1] * atlas.pages as usize], size }
    }

    fn get(&self, page: usize, x: i64, y: i64) -> u32 {
        let [width, height] = self.size.map(|side| side as i64);
        let inside = (0..width).contains(&x) && (0..height).contains(&y);
        if inside { self.texels[(page * self.size[1] + y as usize) * self.size[0] + x as usize] } else { NO_CHART }
    }

    fn claim(&mut self, page: usize, x: i64, y: i64, chart: u32) {
        // Also the border of a page must stay empty.
        let [width, height] = self.size.map(|side| side as i64);
        assert!(x >= 1 && y >= 1 && x + 1 < width && y + 1 < height, "texel {x} {y} lies on the border");
        let texel = &mut self.texels[(page * self.size[1] + y as usize) * self.size[0] + x as usize];
        assert!(*texel == NO_CHART || *texel == chart, "texel {x} {y} is in two charts");
        *texel = chart;
    }
}

/// Every promise of the stage that can be checked from outside.
fn check(scene: &Scene, settings: &Settings, atlas: &Atlas) {
    assert_eq!(atlas.parts.len(), scene.parts.len());
    assert!(atlas.page_size.iter().all(|side| *side <= settings.page_size));
    let mut owners = Owners::new(atlas);
    let mut needles = 0;
    for (p, part) in scene.parts.iter().enumerate() {
        let charted = &atlas.parts[p];
        let layout = &charted.layout;
        assert_eq!(layout.triangles.len(), part.triangles.len());
        assert_eq!((layout.chart.len(), layout.uv.len()), (layout.triangles.len(), layout.source_vertex.len()));
        for (t, vertices) in layout.triangles.iter().enumerate() {
            let source = scene.triangles[part.triangles.start as usize + t].map(|v| v - part.vertices.start);
            assert_eq!(vertices.map(|v| layout.source_vertex[v as usize]), source, "corners keep their source vertex");
            let chart = charted.chart(t);
            let real = scene.area(part.triangles.start + t as u32) > 0.0 && part.receives;
            assert_eq!(chart != NO_CHART, real, "part {p} triangle {t}");
            if real {
                let page = atlas.charts[chart as usize].page;
                assert!(page < atlas.pages);
                let uv = corners(atlas, p, t);
                needles += usize::from((uv[1] - uv[0]).perp_dot(uv[2] - uv[0]).abs() < 1e-2);
                touched(uv).into_iter().for_each(|(x, y)| owners.claim(page as usize, x, y, chart));
            }
        }
    }
    check_spacing(settings, atlas, &owners);
    check_mips(settings, atlas, &owners);
    // Texels touched by less than a grid step, as by needles, count as covered, but not for the clipper.
    let (covered, found) = (atlas.covered_texels as usize, owners.texels.iter().filter(|c| **c != NO_CHART).count());
    assert!(covered >= found && covered <= found + found / 30 + 8 + 20 * needles, "{covered} {found}");
}

fn check_spacing(settings: &Settings, atlas: &Atlas, owners: &Owners) {
    let pad = i64::from(settings.padding);
    let kept = |chart: u32| atlas.parts[atlas.charts[chart as usize].part as usize].kept;
    for page in 0..atlas.pages as usize {
        for (y, x) in (0..owners.size[1] as i64).flat_map(|y| (0..owners.size[0] as i64).map(move |x| (y, x))) {
            let chart = owners.get(page, x, y);
            if chart == NO_CHART {
                continue;
            }
            for (dx, dy) in (-pad..=pad).flat_map(|dx| (0..=pad).map(move |dy| (dx, dy))) {
                let other = owners.get(page, x + dx, y + dy);
                let apart = other == NO_CHART || other == chart || (kept(other) && kept(chart));
                assert!(apart, "charts nearer than {pad} texels at {x} {y}");
            }
        }
    }
}

/// No two charts are read by look-ups in one texel of a mip level that was asked for.
fn check_mips(settings: &Settings, atlas: &Atlas, owners: &Owners) {
    let sides = atlas.page_size.iter().all(|side| side % (1 << settings.mips) == 0);
    assert!(sides && atlas.mips <= settings.mips, "{:?}", atlas.page_size);
    for (page, level) in (0..atlas.pages as usize).flat_map(|page| (1..=atlas.mips).map(move |level| (page, level))) {
        let size = [0, 1].map(|axis| owners.size[axis] >> level);
        let mut reader = vec![NO_CHART; size[0] * size[1]];
        for (y, x) in (0..owners.size[1] as i64).flat_map(|y| (0..owners.size[0] as i64).map(move |x| (y, x))) {
            let chart = owners.get(page, x, y);
            if chart == NO_CHART {
                continue;
            }
            // Places at the four corners of the texel, inside it.
            for (dx, dy) in [(0.01, 0.01), (0.99, 0.01), (0.01, 0.99), (0.99, 0.99)] {
                let at = (DVec2::new(x as f64 + dx, y as f64 + dy) / f64::from(1 << level) - 0.5).floor();
                for (cx, cy) in [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(i, j)| (at.x as usize + i, at.y as usize + j)) {
                    let cell = &mut reader[cy * size[0] + cx];
                    assert!(*cell == NO_CHART || *cell == chart, "level {level} mixes charts at {x} {y}");
                    *cell = chart;
                }
            }
        }
    }
}

/// Flat area over world area is the density squared.
fn check_areas(scene: &Scene, atlas: &Atlas, tolerance: f64) {
    let density = f64::from(atlas.texels_per_meter);
    for (world, flat) in areas(scene, atlas) {
        let wanted = world * density * density;
        // Corners lie on a grid of 1/4096 texel, which is all that a tiny chart can be off by.
        let grid = (wanted.sqrt() + 64.0 / density.max(1.0) + 1.0) * 2.0 / 4096.0;
        assert!((flat - wanted).abs() < tolerance * wanted + if wanted < 9.0 { grid } else { 0.0 }, "{flat} {wanted}");
    }
}

#[test]
fn a_box_has_six_rectangular_charts() {
    let scene = scene(&[one_box()]);
    let atlas = build(&scene, &settings(10.0)).output;
    assert_eq!((atlas.charts.len(), atlas.pages), (6, 1));
    // Sides are whole texels, so charts are full rectangles: 2 · (30·20 + 20·10 + 30·10).
    assert_eq!(atlas.covered_texels, 2200);
    check_areas(&scene, &atlas, 1e-3);
    println!("box: {:.3} used, {:?}", atlas.utilization(), atlas.page_size);
    assert!(atlas.utilization() > 0.6, "{} {:?}", atlas.utilization(), atlas.page_size);
}

#[test]
fn a_turned_wall_with_a_window_is_one_isometric_chart() {
    let mut mesh = Mesh::default();
    mesh.quad([Vec3::ZERO, Vec3::X * 8.0, Vec3::new(8.0, 4.0, 0.0), Vec3::Y * 4.0], 8);
    let positions = mesh.positions.clone();
    mesh.triangles.retain(|t| {
        let center = t.iter().map(|v| positions[*v as usize]).sum::<Vec3>() / 3.0;
        !(2.0..5.0).contains(&center.x) || !(1.0..3.0).contains(&center.y)
    });
    let turn = glam::Quat::from_euler(glam::EulerRot::XYZ, 0.3, 0.7, 1.1);
    let scene = scene(&[mesh.map(|p| turn * p + Vec3::new(5.0, -3.0, 9.0))]);
    let atlas = build(&scene, &settings(12.0)).output;
    assert_eq!(atlas.charts.len(), 1);
    // 96 × 48 texels less a window of 36 × 24; positions of about 10 m in single precision leave 1e-5 texels.
    assert!(atlas.covered_texels.abs_diff(96 * 48 - 36 * 24) <= 120, "{}", atlas.covered_texels);
    check_areas(&scene, &atlas, 1e-3);
    for t in 0..scene.triangles.len() {
        let world = scene.corners(t as u32).map(|p| p.as_dvec3());
        let flat = corners(&atlas, 0, t);
        for k in 0..3 {
            let (a, b) = (world[k].distance(world[(k + 1) % 3]) * 12.0, flat[k].distance(flat[(k + 1) % 3]));
            assert!((a - b).abs() < 5e-3, "{a} {b}");
        }
    }
}

#[test]
fn smooth_meshes_keep_the_invariants_and_have_few_charts() {
    for (name, mesh, most) in [
        ("terrain", terrain(40), 1),
        ("torus", torus(48, 24), 30),
        ("sphere", sphere(48, 24), 20),
        ("rough sphere", rough(sphere(40, 20), 0.15), 150),
        ("cylinder", cylinder(24), 4),
    ] {
        let scene = scene(&[mesh]);
        let atlas = build(&scene, &settings(24.0)).output;
        println!("{name}: {} charts, {:.3} used, {:?}", atlas.charts.len(), atlas.utilization(), atlas.page_size);
        check_areas(&scene, &atlas, 0.01);
        assert!(atlas.charts.len() <= most, "{name}: {} charts", atlas.charts.len());
    }
}

#[test]
fn bad_meshes_lose_no_triangle() {
    for (name, mesh) in bad_meshes() {
        let scene = scene(&[mesh]);
        let atlas = build(&scene, &settings(16.0)).output;
        println!("{name}: {} charts, {:.3} used, {:?}", atlas.charts.len(), atlas.utilization(), atlas.page_size);
        check_areas(&scene, &atlas, 0.1);
        if name == "four copies" {
            assert_eq!(atlas.charts.len(), 24);
        }
    }
}

#[test]
fn scale_does_not_change_the_charts() {
    let unit = build(&scene(&[torus(32, 16)]), &settings(20.0)).output;
    for scale in [1.0 / 1024.0, 4096.0, 1e-6f32, 1e9] {
        let atlas = build(&scene_of(torus(32, 16).map(|p| p * scale)), &settings(20.0 / scale)).output;
        let near = atlas.charts.len().abs_diff(unit.charts.len());
        // Powers of two change no rounding at all.
        assert!(near == 0 || (near <= 3 && libm::log2f(scale).fract() != 0.0), "{near} at scale {scale}");
    }
}

fn scene_of(mesh: Mesh) -> Scene {
    scene(&[mesh])
}

#[test]
fn parts_that_do_not_receive_light_get_no_charts() {
    let mut scene = scene(&[one_box(), one_box().map(|p| p + Vec3::X * 9.0), Mesh::default()]);
    scene.parts[1].receives = false;
    let atlas = build(&scene, &settings(8.0)).output;
    assert_eq!(atlas.charts.len(), 6);
    assert!(atlas.parts[1].charts().all(|chart| chart == NO_CHART));
    assert_eq!(atlas.parts[1].layout.source_vertex, (0..96).collect::<Vec<u32>>());
    let none = build(&Scene::default(), &settings(8.0)).output;
    assert_eq!((none.pages, none.charts.len(), none.utilization()), (0, 0, 0.0));
}

#[test]
fn an_interior_fills_its_pages() {
    let scene = scene(&interior());
    let atlas = build(&scene, &settings(40.0)).output;
    println!("{} charts, {:.3} used, {:?}", atlas.charts.len(), atlas.utilization(), atlas.page_size);
    assert!(atlas.utilization() >= 0.75, "{}", atlas.utilization());
    assert_eq!(atlas.pages, 1);
    assert!(atlas.page_size.iter().all(|side| side % 4 == 0));
    let several = build(&scene, &Settings { page_size: 256, ..settings(40.0) }).output;
    println!("{} pages of {:?}, {:.3} used", several.pages, several.page_size, several.utilization());
    assert!(several.pages > 5);
    assert_eq!(several.page_size[0], 256);
}

#[test]
fn mip_levels_read_one_chart_each() {
    for (mips, padding) in [(1, 2), (2, 0), (2, 9), (3, 2), (5, 4)] {
        let wanted = |texels_per_meter| Settings { mips, padding, ..settings(texels_per_meter) };
        for mesh in [one_box(), sphere(24, 12), rough(terrain(20), 0.05)] {
            assert_eq!(build(&scene(&[mesh]), &wanted(7.3)).output.mips, mips);
        }
        let several = build(&scene(&interior()), &Settings { page_size: 256, ..wanted(16.0) }).output;
        assert!(several.pages > 1 && several.mips == mips);
    }
}

#[test]
fn charts_stay_as_they_are_when_another_mesh_changes() {
    // Relative to the first corner of each chart, bit by bit.
    let shapes = |atlas: &Atlas, part: usize| -> Vec<Vec<Vec2>> {
        let charted = &atlas.parts[part];
        let mut charts: std::collections::BTreeMap<u32, Vec<Vec2>> = std::collections::BTreeMap::new();
        for (vertices, chart) in charted.layout.triangles.iter().zip(charted.charts()) {
            charts.entry(chart).or_default().extend(vertices.map(|v| charted.uv(v)));
        }
        charts.into_values().map(|uv| uv.iter().map(|p| *p - uv[0]).collect()).collect()
    };
    for mips in [0, 2] {
        let wanted = Settings { mips, ..settings(12.0) };
        let built = |meshes: &[Mesh]| build(&scene(meshes), &wanted).output;
        let before = built(&[torus(24, 12), one_box(), sphere(24, 12)]);
        let changed = built(&[torus(24, 12), rough(terrain(20), 0.05), sphere(24, 12)]);
        let added = built(&[torus(24, 12), one_box(), sphere(24, 12), cylinder(16)]);
        for other in [&changed, &added] {
            assert!([0, 2].iter().all(|part| shapes(&before, *part) == shapes(other, *part)), "mips {mips}");
        }
        let places = |atlas: &Atlas| atlas.parts[2].uvs().collect::<Vec<_>>();
        assert!(places(&before) != places(&changed), "charts moved, so there was something to see");
    }
}

#[test]
fn max_pages_lowers_the_density_and_says_so() {
    let scene = scene(&interior());
    let built = build(&scene, &Settings { page_size: 256, max_pages: Some(2), ..settings(40.0) });
    let warning = built.warnings.iter().find(|w| w.code == "density-lowered").unwrap();
    let factor = built.output.texels_per_meter / 40.0;
    println!("factor {factor}, {:.3} used", built.output.utilization());
    assert!(warning.message.contains(&format!("{factor:.4}")), "{}", warning.message);
    assert!(built.output.pages <= 2 && factor < 1.0);
    assert!(built.output.utilization() > 0.5, "{}", built.output.utilization());
    check_areas(&scene, &built.output, 0.01);
    let tight = atlas::build(&Tracer::new(&scene), &Settings { page_size: 16, max_pages: Some(1), ..settings(40.0) });
    assert!(matches!(tight, Err(atlas::Error::DoesNotFit { .. })));
}

#[test]
fn charts_larger_than_a_page_are_cut_or_lowered() {
    let wall = |steps| {
        let mut mesh = Mesh::default();
        mesh.quad([Vec3::ZERO, Vec3::X * 30.0, Vec3::new(30.0, 10.0, 0.0), Vec3::Y * 10.0], steps);
        scene(&[mesh])
    };
    let cut = build(&wall(12), &Settings { page_size: 128, ..settings(10.0) });
    assert!(cut.warnings.is_empty() && cut.output.charts.len() >= 3, "{:?}", cut.warnings);
    check_areas(&wall(12), &cut.output, 1e-3);
    let lowered = build(&wall(1), &Settings { page_size: 128, ..settings(10.0) });
    assert_eq!(lowered.warnings[0].code, "chart-density-lowered");
    assert_eq!(lowered.warnings[0].node.as_deref(), Some("node 0"));
}

#[test]
fn limits_and_bad_settings_are_errors() {
    let scene = scene(&[torus(64, 32)]);
    let cancelled = Settings { cancel: Some(Arc::new(AtomicBool::new(true))), ..settings(8.0) };
    assert!(matches!(atlas::build(&Tracer::new(&scene), &cancelled), Err(atlas::Error::Cancelled)));
    let late = Settings { time_limit: Some(Duration::ZERO), ..settings(8.0) };
    assert!(matches!(atlas::build(&Tracer::new(&scene), &late), Err(atlas::Error::TimeLimit(_))));
    for density in [0.0, -1.0, f32::NAN, f32::INFINITY] {
        assert!(matches!(atlas::build(&Tracer::new(&scene), &settings(density)), Err(atlas::Error::Setting(_))));
    }
    for page_size in [0, 8, 1 << 20] {
        let wrong = Settings { page_size, ..settings(8.0) };
        assert!(matches!(atlas::build(&Tracer::new(&scene), &wrong), Err(atlas::Error::Setting(_))));
    }
    let many = build(&scene, &Settings { max_pages: Some(1), page_size: 512, ..settings(1e20) });
    assert!(many.warnings.iter().any(|w| w.code == "density-lowered"));
}

#[test]
fn a_limit_that_passes_midway_stops_xatlas() {
    let scene = scene(&[rough(torus(160, 80), 0.05)]);
    let start = Instant::now();
    let late = Settings { time_limit: Some(Duration::from_millis(150)), ..settings(8.0) };
    assert!(matches!(atlas::build(&Tracer::new(&scene), &late), Err(atlas::Error::TimeLimit(_))));
    assert!(start.elapsed() < Duration::from_secs(2), "{:?}", start.elapsed());
}

#[test]
fn a_usable_layout_is_kept() {
    let scene = scene(&[laid_out(), one_box()]);
    let built = build(&scene, &settings(10.0));
    assert!(built.warnings.is_empty(), "{:?}", built.warnings);
    let kept = &built.output.parts[0];
    assert!(kept.kept && !built.output.parts[1].kept);
    assert_eq!(kept.layout.source_vertex, (0..25).collect::<Vec<u32>>());
    let offset = kept.uv(0) - laid_out().uv1[0] * 50.0;
    for (uv, source) in kept.uvs().zip(laid_out().uv1) {
        assert!((uv - source * 50.0 - offset).length() < 2e-3, "rigid and uniformly scaled");
    }
    let anew = build(&scene, &Settings { uv: Uv::Generate, ..settings(10.0) }).output;
    assert!(!anew.parts[0].kept && anew.charts.len() == 7);
}

#[test]
fn needles_on_the_last_borders_of_a_layout_do_no_harm() {
    // A hair less than whole texels: the borders are rounded to the ends of the last row and column.
    let settings = Settings { uv: Uv::Keep, ..settings(9.999_99) };
    let built = atlas::build(&Tracer::new(&scene(&[laid_out_with_needles()])), &settings).unwrap();
    assert!(built.warnings.is_empty() && built.output.parts[0].kept, "{:?}", built.warnings);
    assert_eq!((built.output.charts.len(), built.output.covered_texels), (3, 800));
}

#[test]
fn unusable_layouts_are_charted_anew_with_the_reason() {
    type Spoil = fn(Vec2) -> Vec2;
    let cases: [(&str, Spoil); 6] = [
        ("overlap", |p| Vec2::new((p.x - 0.5).abs(), p.y)),
        ("not finite", |p| Vec2::new(p.x, if p.y > 0.4 { f32::NAN } else { p.y })),
        ("leaves the range", |p| p * 2.0),
        ("no area", |p| Vec2::new(p.x, 0.5)),
        ("stretched", |p| Vec2::new(p.x * p.x * p.x * p.x, p.y)),
        ("stretched", |p| Vec2::new(p.x, p.y * 0.02)),
    ];
    for (reason, spoil) in cases {
        let mut mesh = laid_out();
        mesh.uv1.iter_mut().for_each(|p| *p = spoil(*p));
        let scene = scene(&[mesh]);
        let built = build(&scene, &settings(10.0));
        assert_eq!((built.warnings.len(), built.warnings[0].code), (1, "uv-regenerated"));
        assert!(built.warnings[0].message.contains(reason), "{reason}: {}", built.warnings[0].message);
        assert!(!built.output.parts[0].kept);
        match atlas::build(&Tracer::new(&scene), &Settings { uv: Uv::Keep, ..settings(10.0) }) {
            Err(atlas::Error::UnusableUv { node, .. }) => assert_eq!(node, "node 0"),
            other => panic!("{reason}: {other:?}"),
        }
    }
}

#[test]
fn second_sets_of_the_parsing_fixture() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/primitives/primitives.gltf");
    let scene = texelwalk::scene::load(std::path::Path::new(path), &Default::default()).unwrap().output;
    let built = build(&scene, &settings(32.0));
    let kept = |name: &str| {
        let k = scene.parts.iter().position(|p| p.name == name).unwrap();
        built.output.parts[k].kept
    };
    assert!(kept("GoodSecondSet"));
    for (name, reason) in [
        ("MirroredSecondSet", "mirrored"),
        ("OverlappingSecondSet", "overlap"),
        ("OutOfRangeSecondSet", "leaves the range"),
    ] {
        assert!(!kept(name), "{name}");
        assert!(built.warnings.iter().any(|w| w.message.contains(name) && w.message.contains(reason)), "{name}");
    }
}

#[test]
fn primitives_of_a_node_share_a_layout_or_are_kept_alone() {
    let mut right = laid_out().map(|p| p + Vec3::Z);
    right.uv1.iter_mut().for_each(|p| p.y += 0.45);
    let mut apart = scene(&[laid_out(), right]);
    (apart.parts[1].node, apart.parts[1].mesh) = (0, 0);
    let atlas = build(&apart, &settings(20.0)).output;
    assert!(atlas.parts.iter().all(|part| part.kept));
    let shift = atlas.parts[1].uv(0) - atlas.parts[0].uv(0);
    assert!((shift - Vec2::new(0.0, 0.45 * 100.0)).length() < 2e-3, "one rigid block: {shift}");
    let mut same = scene(&[laid_out(), laid_out().map(|p| p + Vec3::Z)]);
    (same.parts[1].node, same.parts[1].mesh) = (0, 0);
    let atlas = build(&same, &settings(20.0)).output;
    assert!(atlas.parts.iter().all(|part| part.kept) && atlas.charts.len() == 2);
}

#[test]
fn kept_charts_that_share_texels_are_charted_anew_or_united() {
    let mut mesh = laid_out();
    let first = mesh.positions.len() as u32;
    let other = laid_out();
    mesh.positions.extend(other.positions.iter().map(|p| *p + Vec3::Z));
    mesh.normals.extend(&other.normals);
    mesh.uv1.extend(other.uv1.iter().map(|p| *p + Vec2::new(0.0, 0.405)));
    mesh.triangles.extend(other.triangles.iter().map(|t| t.map(|v| v + first)));
    let scene = scene(&[mesh]);
    let anew = build(&scene, &settings(11.0));
    assert!(anew.warnings[0].message.contains("share texels"), "{:?}", anew.warnings);
    let united = build(&scene, &Settings { uv: Uv::Keep, ..settings(11.0) }).output;
    assert_eq!((united.charts.len(), united.parts[0].kept), (1, true));
}

#[test]
fn threads_do_not_change_the_atlas() {
    let mut meshes = interior();
    meshes.truncate(20);
    meshes.push(rough(sphere(80, 40), 0.3));
    meshes.push(laid_out());
    let scene = scene(&meshes);
    let results: Vec<String> = [1, 2, 8]
        .into_iter()
        .map(|threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            format!("{:?}", pool.install(|| atlas::build(&Tracer::new(&scene), &settings(16.0)).unwrap().output))
        })
        .collect();
    assert!(results.windows(2).all(|w| w[0] == w[1]));
}

/// The threaded build of xatlas dies where the machine reports one CPU.
#[test]
fn one_cpu_is_enough() {
    let test = "smooth_meshes_keep_the_invariants_and_have_few_charts";
    let run = std::process::Command::new("taskset")
        .args(["-c", "0"])
        .arg(std::env::current_exe().unwrap())
        .args(["--exact", test])
        .output()
        .expect("this test needs `taskset` (util-linux) to pretend that there is one CPU");
    let out = String::from_utf8_lossy(&run.stdout);
    assert!(run.status.success() && out.contains("1 passed"), "{out}");
}

fn timed(name: &str, mesh: Mesh, limit: Duration) {
    let scene = scene(&[mesh]);
    let triangles = scene.triangles.len();
    // About two texels per triangle.
    let area: f64 = (0..triangles as u32).map(|t| scene.area(t)).sum();
    let settings = settings((2.0 * triangles as f64 / area).sqrt() as f32);
    let start = Instant::now();
    let atlas = atlas::build(&Tracer::new(&scene), &settings).unwrap().output;
    let time = start.elapsed();
    let (charts, size) = (atlas.charts.len(), atlas.page_size);
    println!("{name}: {triangles} triangles, {charts} charts, {:.3} used, {size:?}, {time:.2?}", atlas.utilization());
    check(&scene, &settings, &atlas);
    assert!(time < limit, "{name} took {time:?}");
}

#[test]
#[ignore = "slow: 20 s"]
fn fifty_thousand_smooth_triangles_take_less_than_5_s() {
    let limit = Duration::from_secs(5);
    timed("terrain", terrain(158), limit);
    timed("torus", torus(224, 112), limit);
    timed("sphere", sphere(224, 112), limit);
    timed("rough sphere", rough(sphere(224, 112), 0.01), 6 * limit);
}

#[test]
#[ignore = "slow: 1 min"]
fn two_hundred_thousand_smooth_triangles_take_less_than_30_s() {
    let limit = Duration::from_secs(30);
    timed("terrain", terrain(316), limit);
    timed("torus", torus(448, 224), limit);
    timed("sphere", sphere(448, 224), limit);
    timed("rough sphere", rough(sphere(448, 224), 0.005), 6 * limit);
}

#[test]
#[ignore = "slow: 10 s"]
fn fifty_thousand_charts_are_packed_in_seconds() {
    let mut meshes = Vec::new();
    for i in 0..8400 {
        let mut mesh = Mesh::default();
        let size = Vec3::new(0.6 + noise(i), 0.6 + noise(i + 10_000), 0.6 + noise(i + 20_000));
        mesh.cuboid(Vec3::ZERO, size.max(Vec3::splat(0.1)), 2);
        meshes.push(mesh);
    }
    let scene = scene(&meshes);
    let settings = settings(20.0);
    let start = Instant::now();
    let atlas = atlas::build(&Tracer::new(&scene), &settings).unwrap().output;
    let time = start.elapsed();
    let (charts, pages, size) = (atlas.charts.len(), atlas.pages, atlas.page_size);
    println!("{charts} charts, {pages} pages of {size:?}, {:.3} used, {time:.2?}", atlas.utilization());
    check(&scene, &settings, &atlas);
    assert!(time < Duration::from_secs(10), "{time:?}");
}
