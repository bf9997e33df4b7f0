//! Nodes that place a mesh in one size are charted once, and each has its own place on the pages.

use crate::gltf_builder;
use crate::gltf_builder::Builder;
use crate::solve::Stage;
use glam::{DMat4, DQuat, DVec3, Vec2, Vec3};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use texelwalk::atlas::{self, Atlas, Chart, NO_CHART, raster};
use texelwalk::base::Warned;
use texelwalk::scene::{Rule, Scene, Settings, load_bytes};
use texelwalk::trace::Tracer;

/// A box of 1 × 1.4 × 0.8 m in two primitives of three sides each; with a layout of its own if `uv`, one for both.
fn box_of_two(b: &mut Builder, uv: bool) {
    let half = Vec3::new(0.5, 0.7, 0.4);
    let sides = [Vec3::X, Vec3::Y, Vec3::Z, Vec3::NEG_X, Vec3::NEG_Y, Vec3::NEG_Z];
    let mut primitives = vec![];
    for (k, three) in sides.chunks(3).enumerate() {
        let (mut positions, mut uvs) = (vec![], vec![]);
        for (i, n) in three.iter().enumerate() {
            let (s, t) = n.any_orthonormal_pair();
            for (u, v) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
                positions.extend(((*n + s * u + t * v) * half).to_array());
                let side = Vec2::new((s * half).length(), (t * half).length());
                let cell = Vec2::new(i as f32 * 0.3 + 0.02, k as f32 * 0.5 + 0.02);
                uvs.extend((cell + side * Vec2::new(u + 1.0, v + 1.0) * 0.15).to_array());
            }
        }
        let fans: Vec<u16> = (0..3u16).flat_map(|i| [0, 1, 2, 0, 2, 3].map(|v| 4 * i + v)).collect();
        let indices = b.accessor(5123, "SCALAR", fans.len(), &gltf_builder::words(&fans), json!({}));
        let mut attributes = json!({"POSITION": b.floats("VEC3", &positions)});
        if uv {
            attributes["TEXCOORD_1"] = json!(b.floats("VEC2", &uvs));
        }
        primitives.push(json!({"attributes": attributes, "indices": indices}));
    }
    b.push("meshes", json!({ "primitives": primitives }));
}

/// Boxes at several places, each with a name.
fn scene(uv: bool, places: &[(&str, DMat4)], rules: &Value) -> Scene {
    let mut b = Builder::new();
    box_of_two(&mut b, uv);
    b.push("scenes", json!({"nodes": (0..places.len()).collect::<Vec<_>>()}));
    for (name, world) in places {
        b.push("nodes", json!({"mesh": 0, "name": name, "matrix": world.to_cols_array()}));
    }
    let rules: Vec<Rule> = serde_json::from_value(rules.clone()).unwrap();
    load_bytes(b.glb(&[]), Path::new("a.glb"), &Settings { rules, ..Settings::default() }).unwrap().output
}

fn at(scale: [f64; 3], angle: f64, x: f64) -> DMat4 {
    let turn = DQuat::from_axis_angle(DVec3::new(0.3, 1.0, -0.2).normalize(), angle);
    DMat4::from_scale_rotation_translation(DVec3::from(scale), turn, DVec3::new(x, 0.3 * x, 0.0))
}

fn charted(scene: &Scene, settings: &atlas::Settings) -> Atlas {
    let Warned { output, warnings } = atlas::build(&Tracer::new(scene), settings).unwrap();
    assert!(warnings.is_empty(), "{warnings:?}");
    output
}

fn places() -> [(&'static str, DMat4); 7] {
    [
        ("plain", at([1.0; 3], 0.0, 0.0)),
        ("turned", at([1.0; 3], 0.7, 4.0)),
        ("larger", at([1.7; 3], 0.7, 8.0)),
        ("mirrored", at([-1.0, 1.0, 1.0], 0.2, 12.0)),
        ("mirrored too", at([1.0, 1.0, -1.0], 1.2, 16.0)),
        ("denser", at([1.0; 3], 0.1, 20.0)),
        ("far", at([1.0; 3], 2.0, 700.0)),
    ]
}

/// Every triangle has its area at the density of its part, and no texel two charts.
fn check(scene: &Scene, atlas: &Atlas, texels_per_meter: f64) {
    let mut owner: BTreeMap<[i64; 3], u32> = BTreeMap::new();
    for (p, part) in scene.parts.iter().enumerate() {
        let charted = &atlas.parts[p];
        let density = texels_per_meter * f64::from(part.treatment.density);
        for (k, t) in part.triangles.clone().enumerate() {
            let chart = charted.chart(k);
            let Chart { part: of, page } = atlas.charts[chart as usize];
            let uv = charted.layout.triangles[k].map(|v| charted.uv(v));
            let flat = f64::from((uv[1] - uv[0]).perp_dot(uv[2] - uv[0])).abs() * 0.5;
            let wanted = scene.area(t) * density * density;
            assert!((flat - wanted).abs() < 0.03 * wanted, "{}: {flat} of {wanted} texels", part.name);
            assert_eq!(scene.parts[of as usize].node, part.node);
            raster::cover(uv, |x, y, _| {
                let one = *owner.entry([page.into(), x.into(), y.into()]).or_insert(chart);
                assert_eq!(one, chart, "{}: a texel has two charts", part.name);
            });
        }
    }
    assert_eq!(atlas.covered_texels, owner.len() as u64);
}

#[test]
fn placements_in_one_size_have_one_layout_each_in_its_own_place() {
    let rules = json!([{"nodes": ["denser"], "density": 2.0}]);
    let scene = scene(false, &places(), &rules);
    let settings = atlas::Settings { texels_per_meter: 9.0, ..atlas::Settings::default() };
    let atlas = charted(&scene, &settings);
    check(&scene, &atlas, 9.0);
    assert_eq!(atlas.charts.len(), 7 * 6);
    let same = |a: usize, b: usize| {
        (0..2).all(|k| Arc::ptr_eq(&atlas.parts[2 * a + k].layout, &atlas.parts[2 * b + k].layout))
    };
    assert!(same(0, 1) && same(0, 6) && same(3, 4));
    assert!([2, 3, 5].iter().all(|&other| !same(0, other)));
    // Corners of the turned box are as far apart as those of the plain one.
    let spread = |p: usize| atlas.parts[p].uv(0) - atlas.parts[p].uv(2);
    assert_eq!(spread(0), spread(2));
    // Pages, mip levels and a page limit hold with copies, too.
    let tight = atlas::Settings { texels_per_meter: 30.0, page_size: 128, mips: 2, ..settings };
    let paged = charted(&scene, &tight);
    check(&scene, &paged, 30.0);
    assert!(paged.pages > 2 && paged.mips == 2);
    let limited = atlas::build(&Tracer::new(&scene), &atlas::Settings { max_pages: Some(2), ..tight }).unwrap();
    assert_eq!(limited.warnings[0].code, "density-lowered");
    assert!(limited.output.pages <= 2 && limited.output.texels_per_meter < 30.0);
    check(&scene, &limited.output, limited.output.texels_per_meter.into());
}

#[test]
fn layouts_of_the_document_are_kept_for_every_placement() {
    let scene = scene(true, &places(), &json!([]));
    let atlas = charted(&scene, &atlas::Settings { texels_per_meter: 9.0, ..atlas::Settings::default() });
    assert!(atlas.parts.iter().all(|part| part.kept));
    assert!(Arc::ptr_eq(&atlas.parts[0].layout, &atlas.parts[2].layout));
    let shift = |k: usize| atlas.parts[2 + k].uvs().zip(atlas.parts[k].uvs()).map(|(b, a)| b - a);
    let first = shift(0).next().unwrap();
    assert!(first != Vec2::ZERO && shift(0).chain(shift(1)).all(|s| s == first), "both primitives move together");
    let of_copy = |node: usize| atlas.parts[2 * node].charts().chain(atlas.parts[2 * node + 1].charts());
    for (node, chart) in (0..7).flat_map(|n| of_copy(n).map(move |c| (n, c))) {
        assert!(chart != NO_CHART && scene.parts[atlas.charts[chart as usize].part as usize].node == node);
    }
}

#[test]
fn what_is_wrong_with_a_layout_is_said_of_every_placement() {
    let mut b = Builder::new();
    box_of_two(&mut b, false);
    let all = [Vec2::ZERO; 12].iter().flat_map(|p| p.to_array()).collect::<Vec<f32>>();
    let uv = b.floats("VEC2", &all);
    b.set("/meshes/0/primitives/1/attributes/TEXCOORD_1", json!(uv));
    b.push("scenes", json!({"nodes": [0, 1, 2]}));
    for (i, name) in ["a", "b", "c"].iter().enumerate() {
        b.push("nodes", json!({"mesh": 0, "name": name, "translation": [2.0 * i as f64, 0, 0]}));
    }
    let scene = load_bytes(b.glb(&[]), Path::new("a.glb"), &Settings::default()).unwrap().output;
    let built = atlas::build(&Tracer::new(&scene), &atlas::Settings::default()).unwrap();
    let told: Vec<_> = built.warnings.iter().map(|w| (w.code, w.node.as_deref().unwrap())).collect();
    assert_eq!(told, ["a", "b", "c"].map(|name| ("uv-regenerated", name)));
}

#[test]
fn patches_lie_on_the_part_that_their_texels_belong_to() {
    for uv in [false, true] {
        let scene = scene(uv, &places(), &json!([]));
        let stage = Stage::new(&scene, 7.0);
        let (patches, atlas) = (&stage.patches, &stage.atlas);
        for (p, part) in scene.parts.iter().enumerate() {
            let wanted = part.triangles.clone().map(|t| scene.area(t)).sum::<f64>();
            let found = patches.area_of_part(&scene, p);
            assert!((found - wanted).abs() < 1e-3 * wanted, "{}: {found} of {wanted} m2", part.name);
        }
        let mut seen = 0;
        for i in 0..patches.front {
            let node = scene.parts[atlas.charts[patches.chart(i) as usize].part as usize].node;
            let (mut nearest, corner) = (f32::INFINITY, patches.position[i]);
            for t in patches.triangles(i) {
                assert_eq!(scene.part(t).node, node);
                let [a, b, c] = scene.corners(t);
                let n = (b - a).cross(c - a).normalize();
                assert!(n.dot(patches.normal[i]) > 0.999, "a normal points elsewhere");
                nearest = nearest.min((corner - a).dot(n).abs());
                seen += 1;
            }
            assert!(nearest < 1e-4, "{nearest} m off its triangles");
        }
        assert!(seen > 2_000);
    }
}
