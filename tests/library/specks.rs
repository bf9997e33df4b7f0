//! Charts smaller than a texel share texels: what may, that nothing is lost by it, and that files keep it.

use crate::gltf_builder;
use crate::gltf_builder::Builder;
use crate::support;
use glam::{DVec2, DVec3, Vec3};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;
use texelwalk::atlas::{self, Atlas, NO_CHART, Settings};
use texelwalk::scene::Scene;
use texelwalk::trace::Tracer;

/// Texels per metre.
const DENSITY: f64 = 16.0;

fn build(scene: &Scene) -> Atlas {
    atlas::build(&Tracer::new(scene), &Settings { texels_per_meter: DENSITY as f32, ..Settings::default() })
        .unwrap()
        .output
}

/// Triangles of each chart of the only part.
fn by_chart(atlas: &Atlas) -> BTreeMap<u32, Vec<usize>> {
    let mut charts: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
    let part = &atlas.parts[0];
    for t in 0..part.layout.triangles.len() {
        assert_ne!(part.chart(t), NO_CHART, "triangle {t} has no chart");
        charts.entry(part.chart(t)).or_default().push(t);
    }
    charts
}

fn uv(atlas: &Atlas, triangle: usize) -> [DVec2; 3] {
    atlas.parts[0].layout.triangles[triangle].map(|v| atlas.parts[0].uv(v).as_dvec2())
}

fn normal(scene: &Scene, triangle: usize) -> DVec3 {
    let [a, b, c] = scene.corners(triangle as u32).map(|p| p.as_dvec3());
    (b - a).cross(c - a)
}

/// Every triangle has the size on its page that it has in the world, and samples of a texel lie in one triangle at most.
fn nothing_is_lost(scene: &Scene, atlas: &Atlas) {
    let mut owner: BTreeMap<(u32, i64, i64), usize> = BTreeMap::new();
    let (mut sampled, mut area) = (0usize, 0.0);
    for t in 0..scene.triangle_count() {
        let [a, b, c] = uv(atlas, t);
        let (flat, world) = (0.5 * (b - a).perp_dot(c - a), 0.5 * normal(scene, t).length() * DENSITY * DENSITY);
        assert!((flat - world).abs() <= 0.02 * world + 1e-4, "triangle {t}: {flat} of {world} texels");
        area += flat;
        let page = atlas.charts[atlas.parts[0].chart(t) as usize].page;
        let (low, high) = (a.min(b).min(c) * 64.0, a.max(b).max(c) * 64.0);
        for y in low.y.floor() as i64..=high.y.ceil() as i64 {
            for x in low.x.floor() as i64..=high.x.ceil() as i64 {
                let p = (DVec2::new(x as f64, y as f64) + 0.5) / 64.0;
                let side = |from: DVec2, to: DVec2| (to - from).perp_dot(p - from);
                if side(a, b).min(side(b, c)).min(side(c, a)) > 1e-6 {
                    assert_eq!(owner.insert((page, x, y), t), None, "triangle {t} lies on another");
                    sampled += 1;
                }
            }
        }
    }
    assert!((sampled as f64 / 4096.0 / area - 1.0).abs() < 0.15, "{sampled} samples for {area} texels");
}

/// What shares a texel is near and does not face away.
fn sharing_is_local(scene: &Scene, atlas: &Atlas) {
    for triangles in by_chart(atlas).values() {
        let corners = || triangles.iter().flat_map(|t| scene.corners(*t as u32));
        let (low, high) = corners().fold((Vec3::MAX, Vec3::MIN), |(l, h), p| (l.min(p), h.max(p)));
        let texels = f64::from((high - low).max_element()) * DENSITY;
        assert!(texels <= 2.0 + 1e-3, "a texel is {texels} texels wide");
        let mean = triangles.iter().fold(DVec3::ZERO, |a, t| a + normal(scene, *t)).normalize();
        let least = triangles.iter().map(|t| normal(scene, *t).normalize().dot(mean)).fold(1.0, f64::min);
        assert!(least > 0.5, "{least}: triangles of one texel face away from each other");
    }
}

/// Loose triangles of a centimetre in a cube of 0.12 m.
fn leaves(count: usize) -> Scene {
    let mut s = support::stream(11);
    let mut point = |size: f64| (support::point(&mut s) * size).as_vec3();
    let leaf = |_| {
        let at = point(0.12);
        [0; 3].map(|_| at + point(0.012))
    };
    support::scene_from_triangles(&(0..count).map(leaf).collect::<Vec<_>>())
}

/// A ball of 3 cm whose triangles share their corners.
fn ball() -> Scene {
    let shape: Vec<[Vec3; 3]> = support::blob(24, 0.0).iter().map(|t| t.map(|p| (p * 0.015).as_vec3())).collect();
    let mut scene = support::scene_from_triangles(&shape);
    let mut first: BTreeMap<[u32; 3], u32> = BTreeMap::new();
    let positions = scene.vertices.position.clone();
    let mut weld = |v: u32| *first.entry(positions[v as usize].to_array().map(f32::to_bits)).or_insert(v);
    scene.triangles.iter_mut().for_each(|t| *t = t.map(&mut weld));
    scene
}

/// 64 squares of 0.4 texels that face up, each with another one a millimetre below it, which faces up or down.
fn squares(lower_face_up: bool) -> Scene {
    let (mut shape, side) = (vec![], 0.4 / DENSITY);
    let (u, v) = (DVec3::X * side, DVec3::Z * side);
    let lower = if lower_face_up { [v, u] } else { [u, v] };
    for k in 0..64 {
        let at = DVec3::new(f64::from(k % 8), 0.0, f64::from(k / 8)) * (1.5 * side);
        support::grid(at, v, u, 1, 1, &mut shape);
        support::grid(at - DVec3::Y * 1e-3, lower[0], lower[1], 1, 1, &mut shape);
    }
    support::scene_from_triangles(&shape.iter().map(|t| t.map(|p| p.as_vec3())).collect::<Vec<_>>())
}

#[test]
fn loose_leaves_share_the_texels_that_their_surface_fills() {
    let scene = leaves(20_000);
    let atlas = build(&scene);
    let area: f64 = (0..20_000).map(|t| 0.5 * normal(&scene, t).length() * DENSITY * DENSITY).sum();
    let texels = atlas.covered_texels as f64;
    // 0.13 m are 3 cells, there are 54 directions, and openness differs by a few steps.
    assert!(texels <= 27.0 * 54.0 * 4.0 && texels >= area, "{texels} texels for a surface of {area}");
    nothing_is_lost(&scene, &atlas);
    sharing_is_local(&scene, &atlas);
}

#[test]
fn corners_that_charts_of_one_texel_share_stay_apart() {
    let scene = ball();
    let atlas = build(&scene);
    assert!(atlas.covered_texels <= 24, "{} texels", atlas.covered_texels);
    nothing_is_lost(&scene, &atlas);
    sharing_is_local(&scene, &atlas);
}

#[test]
fn the_two_sides_of_a_plate_share_nothing() {
    let scene = squares(false);
    let atlas = build(&scene);
    assert!(atlas.charts.len() < 128, "{} charts of 128 plates", atlas.charts.len());
    for triangles in by_chart(&atlas).values() {
        let up = triangles.iter().filter(|t| normal(&scene, **t).y > 0.0).count();
        assert!(up == 0 || up == triangles.len(), "{up} of {} face up", triangles.len());
    }
}

#[test]
fn what_is_open_shares_nothing_with_what_is_covered() {
    let scene = squares(true);
    let atlas = build(&scene);
    assert!(atlas.charts.len() < 64, "{} charts of 128 squares", atlas.charts.len());
    for triangles in by_chart(&atlas).values() {
        let above = triangles.iter().filter(|t| scene.corners(**t as u32)[0].y == 0.0).count();
        assert!(above == 0 || above == triangles.len(), "{above} of {} lie above", triangles.len());
    }
    let lone = Settings { texels_per_meter: DENSITY as f32, share_texels: false, ..Settings::default() };
    let lone = atlas::build(&Tracer::new(&scene), &lone).unwrap().output;
    assert_eq!(lone.charts.len(), 128);
}

/// A floor that goes on in a wall over a bevel of a hundredth of a millimetre, laid out side by side.
fn beveled() -> Vec<u8> {
    let profile = [[0.0, 0.0, 0.1], [1.0, 0.0, 0.5], [1.0 + 1e-5, 1e-5, 0.500_005], [1.0 + 1e-5, 1.0, 0.9]];
    let corners = profile.iter().flat_map(|&[x, y, u]| [[x, y, 0.0, u, 0.9], [x, y, 1.0, u, 0.5]]);
    let (mut positions, mut coordinates): (Vec<f32>, Vec<f32>) = (vec![], vec![]);
    for [x, y, z, u, v] in corners {
        positions.extend([x, y, z]);
        coordinates.extend([u, v]);
    }
    let indices: Vec<u16> = [0u16, 2, 4].iter().flat_map(|k| [0, 1, 2, 2, 1, 3].map(|c| c + k)).collect();
    let mut b = Builder::new();
    let (position, uv) = (b.floats("VEC3", &positions), b.floats("VEC2", &coordinates));
    let indices = b.accessor(5123, "SCALAR", indices.len(), &gltf_builder::words(&indices), json!({}));
    b.push("materials", json!({"pbrMetallicRoughness": {"metallicFactor": 0}}));
    let attributes = json!({"POSITION": position, "TEXCOORD_1": uv});
    b.push("meshes", json!({"primitives": [{"attributes": attributes, "indices": indices, "material": 0}]}));
    b.push("nodes", json!({"mesh": 0, "name": "bevel"}));
    b.glb(&[])
}

#[test]
fn what_hangs_together_over_a_bevel_of_no_width_is_one_chart() {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("bevel");
    std::fs::create_dir_all(&folder).unwrap();
    std::fs::write(folder.join("bevel.glb"), beveled()).unwrap();
    let said = run(&folder, &["bake", "bevel.glb", "-o", "out/", "--preset", "preview", "--sky", "1,1,1"]);
    assert!(!said.contains("uv-regenerated"), "{said}");
    run(&folder, &["check", "out/bevel.glb", "--json", "check.json"]);
    let checked: Value = serde_json::from_slice(&std::fs::read(folder.join("check.json")).unwrap()).unwrap();
    let padding = checked["measures"].as_array().unwrap().iter().find(|m| m["name"] == "padding").unwrap();
    assert_eq!(padding["value"], 0.0, "{padding}");
}

/// Runs the program in a folder, and takes what it says.
fn run(folder: &Path, arguments: &[&str]) -> String {
    let out = Command::new(env!("CARGO_BIN_EXE_texelwalk")).current_dir(folder).args(arguments).output().unwrap();
    let said = String::from_utf8_lossy(&out.stderr).into_owned();
    assert!(out.status.success(), "{arguments:?}: {said}");
    said
}

#[test]
fn files_with_shared_texels_are_clean_and_are_kept() {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("specks");
    std::fs::create_dir_all(&folder).unwrap();
    let scene = leaves(2_000);
    let mut b = Builder::new();
    let corners: Vec<f32> = scene.vertices.position.iter().flat_map(|p| p.to_array()).collect();
    let position = b.floats("VEC3", &corners);
    b.push("materials", json!({"pbrMetallicRoughness": {"metallicFactor": 0}, "doubleSided": true}));
    b.push("meshes", json!({"primitives": [{"attributes": {"POSITION": position}, "material": 0}]}));
    b.push("nodes", json!({"mesh": 0, "name": "leaves"}));
    std::fs::write(folder.join("leaves.glb"), b.glb(&[])).unwrap();
    let bake = ["--preset", "preview", "--texels-per-meter", "16", "--sky", "1,1,1"];
    run(&folder, &[&["bake", "leaves.glb", "-o", "once/"], &bake[..]].concat());
    run(&folder, &["check", "once/leaves.glb", "--json", "check.json"]);
    let checked: Value = serde_json::from_slice(&std::fs::read(folder.join("check.json")).unwrap()).unwrap();
    for measure in checked["measures"].as_array().unwrap() {
        // Leaves that touch by chance have nothing to do with each other; steps of light between them are no seams' fault.
        let name = measure["name"].as_str().unwrap();
        if ["uv-overlap", "uv-degenerate", "padding", "uncovered", "density", "stretch"].contains(&name) {
            assert_eq!(measure["fault"], false, "{measure}");
        }
    }
    let again = run(&folder, &[&["bake", "once/leaves.glb", "-o", "twice/"], &bake[..]].concat());
    assert!(!again.contains("uv-regenerated"), "{again}");
}
