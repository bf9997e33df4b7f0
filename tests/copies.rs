//! Geometry that many nodes place is stored once; whoever asks gets the same bits as if every copy were stored.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "tests")]

#[path = "support/gltf_builder.rs"]
mod gltf_builder;
#[path = "support/solve.rs"]
mod solve;
mod support;

use glam::{DMat4, DQuat, DVec3, Quat, Vec2, Vec3};
use gltf_builder::Builder;
use serde_json::{Value, json};
use solve::Stage;
use std::path::Path;
use support::{blob, direction, point, stream};
use texelwalk::base::Rgb;
use texelwalk::scene::{Instances, Rule, Scene, Settings, Sky, load_bytes};
use texelwalk::trace::{Closed, Hit, Ray, Rays, Tracer};
use texelwalk::walk::Splat;

/// A floor, a bumpy ball, and a leaf whose texture is half holes; the ball and the leaf are placed by `nodes`.
fn forest(nodes: &[DMat4], normals: bool, cells: usize) -> Builder {
    let mut b = Builder::new();
    let side = if nodes.len() > 1_000 { 40.0 } else { 10.0 };
    let floor = b.floats("VEC3", &[-side, -0.6, side, side, -0.6, side, side, -0.6, -side, -side, -0.6, -side]);
    let fan = b.accessor(5123, "SCALAR", 6, &gltf_builder::words(&[0, 1, 2, 0, 2, 3]), json!({}));
    let ball = mesh(&mut b, &blob(cells, 0.1), normals, 0);
    let holes: Vec<[u8; 4]> = (0..16).map(|i| [200, 220, 180, if (i / 4 + i) % 2 == 0 { 255 } else { 0 }]).collect();
    let texture = b.texture(4, &holes);
    b.push("materials", json!({"pbrMetallicRoughness": {"baseColorFactor": [0.7, 0.5, 0.4, 1], "metallicFactor": 0}}));
    b.push(
        "materials",
        json!({"alphaMode": "MASK", "doubleSided": true,
        "pbrMetallicRoughness": {"baseColorTexture": {"index": texture}, "metallicFactor": 0}}),
    );
    let leaf = mesh(&mut b, &blob(cells, 0.3), normals, 1);
    b.push("meshes", json!({"primitives": [{"attributes": {"POSITION": floor}, "indices": fan}]}));
    b.push("meshes", json!({"primitives": [ball]}));
    b.push("meshes", json!({"primitives": [leaf]}));
    b.push("nodes", json!({"mesh": 0, "name": "Floor"}));
    b.push("scenes", json!({"nodes": (0..=nodes.len()).collect::<Vec<_>>()}));
    for (i, world) in nodes.iter().enumerate() {
        let matrix = world.to_cols_array();
        b.push("nodes", json!({"mesh": 1 + i % 2, "name": format!("Tree {i}"), "matrix": matrix}));
    }
    b
}

fn mesh(b: &mut Builder, triangles: &[[DVec3; 3]], normals: bool, material: usize) -> Value {
    let corners: Vec<Vec3> = triangles.iter().flatten().map(|p| p.as_vec3()).collect();
    let flat: Vec<f32> = corners.iter().flat_map(|p| p.to_array()).collect();
    let turned: Vec<f32> = corners.iter().flat_map(|p| p.normalize().to_array()).collect();
    let uv: Vec<f32> = corners.iter().flat_map(|p| [p.x + 0.5, p.y + 0.5]).collect();
    let mut attributes = json!({"POSITION": b.floats("VEC3", &flat), "TEXCOORD_0": b.floats("VEC2", &uv)});
    if normals {
        attributes["NORMAL"] = json!(b.floats("VEC3", &turned));
    }
    json!({"attributes": attributes, "material": material})
}

/// Turned, mirrored, squeezed, tiny, huge, far away, one inside another.
fn odd_places() -> Vec<DMat4> {
    let place = |scale: [f64; 3], angle: f64, at: [f64; 3]| {
        let axis = DVec3::new(0.3, 1.0, -0.2).normalize();
        let turn = Quat::from_axis_angle(axis.as_vec3(), angle as f32).as_dquat();
        DMat4::from_scale_rotation_translation(DVec3::from(scale), DQuat::normalize(turn), DVec3::from(at))
    };
    vec![
        place([1.0; 3], 0.0, [0.0, 0.0, 0.0]),
        place([1.0; 3], 0.0, [1.5, 0.0, 0.0]),
        place([1.0; 3], 1.0, [-1.5, 0.1, 0.3]),
        place([0.5, 2.0, 0.7], 2.0, [0.3, 0.2, 1.7]),
        place([-1.0, 1.0, 1.0], 0.7, [0.2, 0.1, -1.6]),
        place([1.0, -0.8, 1.0], -0.7, [1.7, 0.1, -1.6]),
        place([0.01; 3], 0.5, [0.7, -0.2, 0.7]),
        place([30.0; 3], 0.1, [0.0, 10.0, 0.0]),
        place([0.9; 3], 0.2, [0.0, 0.0, 0.0]),
        place([1.1, 1.0, 0.02], 0.9, [-1.0, 0.0, 1.8]),
        place([2.0; 3], 0.4, [2500.0, 3.0, -1700.0]),
        place([2.0; 3], 0.4, [2501.0, 3.0, -1700.0]),
    ]
}

fn scene(b: &Builder, share_from: usize, rules: &[Rule]) -> Scene {
    let sky = Sky::constant(Rgb::splat(1.0));
    let settings = Settings { share_from: Some(share_from), sky, rules: rules.to_vec(), ..Settings::default() };
    load_bytes(b.glb(&[]), Path::new("a.glb"), &settings).unwrap().output
}

/// Shared, and as if it were not.
fn both(b: &Builder, rules: &[Rule]) -> [Scene; 2] {
    let both = [0, usize::MAX].map(|share_from| scene(b, share_from, rules));
    assert!(both[0].copied().count() > 1 && both[1].copied().next().is_none());
    assert!(both[0].triangles.len() < both[1].triangles.len());
    both
}

fn bits(v: Vec3) -> [u32; 3] {
    v.to_array().map(f32::to_bits)
}

#[test]
fn copies_stand_where_stored_parts_would() {
    for normals in [true, false] {
        let [shared, stored] = both(&forest(&odd_places(), normals, 4), &[]);
        assert_eq!((shared.triangle_count(), shared.vertex_count()), (stored.triangle_count(), stored.vertex_count()));
        assert_eq!(shared.parts.len(), stored.parts.len());
        for t in 0..stored.triangles.len() as u32 {
            assert_eq!(shared.triangle(t), stored.triangles[t as usize]);
            assert_eq!(shared.part_index(t), stored.triangle_part[t as usize] as usize);
            assert_eq!(shared.corners(t).map(bits), stored.corners(t).map(bits));
            let b = Vec2::new(0.2, 0.3);
            assert_eq!(bits(shared.shading_normal(t, b)), bits(stored.shading_normal(t, b)));
            assert_eq!(shared.base_color(t, b), stored.base_color(t, b));
        }
        for v in 0..stored.vertices.position.len() as u32 {
            assert_eq!(bits(shared.vertex_position(v)), bits(stored.vertices.position[v as usize]));
            assert_eq!(shared.vertex_uv(0, v), stored.vertex_uv(0, v));
            let apart = shared.vertex_normal(v).distance(stored.vertices.normal[v as usize]);
            assert!(if normals { apart == 0.0 } else { apart < 0.02 }, "{apart}");
        }
        for part in &stored.parts {
            assert_eq!(shared.vertices_of(part).position, stored.vertices_of(part).position);
        }
    }
}

/// Rays through everything, from everywhere: between points of the surface, into corners and along edges, far and near.
fn rays(scene: &Scene, tracer: &Tracer<'_>, n: usize) -> Vec<Ray> {
    let mut s = stream(7);
    let mut on = |corner: bool| {
        let t = s.next_u32() % scene.triangle_count() as u32;
        let [mut x, mut y] = [s.next_f32(), s.next_f32()];
        if x + y > 1.0 {
            (x, y) = (1.0 - x, 1.0 - y);
        }
        let b = if corner { Vec2::new((x * 2.0).floor(), 0.0) } else { Vec2::new(x, y) };
        (t, b, scene.position(t, b))
    };
    let mut random = stream(8);
    let mut all = vec![];
    for i in 0..n {
        let (t, b, from) = on(false);
        let (_, _, to) = on(i % 3 == 0);
        let origin = match i % 5 {
            0 => tracer.origin_on(t, b, to - from),
            1 => from + (direction(&mut random) * 1e-3).as_vec3(),
            2 => (point(&mut random) * 8.0).as_vec3(),
            3 => (point(&mut random) * 1e4).as_vec3(),
            _ => from,
        };
        let mut direction = match i % 7 {
            0 => direction(&mut random).as_vec3(),
            1 => Vec3::AXES[i / 7 % 3] * if i % 2 == 0 { 1.0 } else { -1.0 },
            _ => to - origin,
        };
        direction *= [1.0, 1e-6, 1e6][i / 11 % 3];
        let t_max = [f32::INFINITY, 1.0, 0.5][i % 13 % 3];
        all.push(Ray { origin, direction, t_max });
    }
    all
}

#[test]
fn rays_meet_what_they_would_meet_if_every_copy_were_stored() {
    let b = forest(&odd_places(), true, 6);
    let [shared, stored] = both(&b, &[]);
    let plain = Tracer::new(&stored);
    let closed = [Closed::new(&shared), Closed::new(&stored)];
    for tracer in [Tracer::new(&shared), Tracer::new(&shared).portable()] {
        assert_eq!(tracer.bounds(), plain.bounds());
        assert_eq!(tracer.triangle_count(), plain.triangle_count());
        let [mut hits, mut blocked, mut inside] = [0; 3];
        let (all, mut together) = (rays(&stored, &plain, 150_000), Rays::default());
        all.iter().for_each(|ray| together.add(ray, None));
        let (each, occluded) = (tracer.closest_hits(&mut together).to_vec(), tracer.occluded_each(&mut together));
        for ((ray, hit), occluded) in all.into_iter().zip(each).zip(occluded) {
            let [a, b] = [tracer.closest_hit(&ray), plain.closest_hit(&ray)];
            let whole =
                |h: Option<Hit>| h.map(|h| (h.triangle, h.t.to_bits(), h.b.to_array().map(f32::to_bits), h.front));
            assert_eq!(whole(a), whole(b), "{ray:?}");
            assert_eq!(whole(hit), whole(b), "{ray:?}");
            assert_eq!([tracer.occluded(&ray), occluded], [plain.occluded(&ray); 2], "{ray:?}");
            assert_eq!(tracer.leaves_solid(&ray, &closed[0]), plain.leaves_solid(&ray, &closed[1]), "{ray:?}");
            let (low, high) = (ray.origin - 0.05, ray.origin + 0.02);
            let odd = |t: u32| t.is_multiple_of(3);
            let near = plain.any_within(low, high, odd);
            // In the space of the mesh fewer triangles pass by; those with a corner in the box are never overlooked.
            let close = tracer.any_within(low, high, odd);
            let is_in = |p: Vec3| p.cmpge(low).all() && p.cmple(high).all();
            let mut reaches = |t: u32| odd(t) && stored.corners(t).into_iter().any(is_in);
            assert!(if close { near } else { !plain.any_within(low, high, &mut reaches) }, "{ray:?}");
            hits += usize::from(a.is_some());
            blocked += usize::from(plain.occluded(&ray));
            inside += usize::from(close);
        }
        println!("{hits} hits, {blocked} blocked, {inside} near");
        assert!(hits > 60_000 && blocked > 40_000 && inside > 5_000);
    }
}

#[test]
fn light_is_the_same_bits() {
    let grid = (0..9).map(|i| DMat4::from_translation(DVec3::new(f64::from(i % 3) * 1.3, 0.0, f64::from(i / 3) * 1.2)));
    let b = forest(&grid.collect::<Vec<_>>(), true, 6);
    let unlit: Rule = serde_json::from_value(json!({"nodes": ["Tree [35]"], "receives": false})).unwrap();
    let dark: Rule = serde_json::from_value(json!({"nodes": ["Tree 4"], "casts": false})).unwrap();
    let [shared, stored] = both(&b, &[unlit, dark]);
    let [a, b] = [&shared, &stored].map(|scene| {
        let stage = Stage::new(scene, 3.0);
        let direct = stage.direct(16);
        let walk = stage.walk(Some(&direct), Splat::None, 20_000, 3);
        (stage.patches.texel.clone(), direct, walk.indirect)
    });
    assert!(a.0.len() > 2_000 && a.1.iter().any(|e| e.x > 1.0));
    assert!(a == b, "not the same bits");
}

#[test]
fn instances_can_be_left_without_light() {
    let b = forest(&odd_places()[..3], true, 4);
    let settings = Settings { instances: Instances::Skip, ..Settings::default() };
    let scene = load_bytes(b.glb(&[]), Path::new("a.glb"), &settings).unwrap().output;
    let receives: Vec<bool> = scene.parts.iter().map(|p| p.receives).collect();
    // The leaf stands there only once.
    assert_eq!(receives, [true, false, true, false]);
}

fn bake(folder: &Path, options: &[&str]) -> Value {
    let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_texelwalk"));
    let input = folder.join("in.glb");
    command.arg("bake").arg(&input).arg("-o").arg(folder.join("out.gltf")).args(options);
    let out = command.args(["-q", "--preset", "preview", "--texels-per-meter", "4", "--sky", "1"]).output().unwrap();
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    serde_json::from_slice(&std::fs::read(folder.join("out.gltf")).unwrap()).unwrap()
}

/// Set of the lightmap coordinates of a node's mesh.
fn layout(document: &Value, node: usize) -> Option<u64> {
    let mesh = document["nodes"][node]["mesh"].as_u64()? as usize;
    document["meshes"][mesh]["primitives"][0]["attributes"]["TEXCOORD_1"].as_u64()
}

#[test]
fn instances_show_one_lightmap_where_they_share_it() {
    let places = [[0.0, 0.0, 0.0], [9.0, 0.0, 9.0], [3.0, 0.0, 0.0], [6.0, 0.0, 9.0], [0.0, 0.0, 5.0]];
    let b = forest(&places.map(|p| DMat4::from_translation(DVec3::from(p))), true, 4);
    let home = tempfile::tempdir().unwrap();
    std::fs::write(home.path().join("in.glb"), b.glb(&[])).unwrap();
    let unique = bake(home.path(), &[]);
    let own: Vec<_> = [1, 3, 5].map(|n| layout(&unique, n)).to_vec();
    assert!(own.iter().all(Option::is_some) && own[0] != own[1] && own[1] != own[2]);
    let shared = bake(home.path(), &["--instances", "shared"]);
    let layouts: Vec<_> = (0..6).map(|n| layout(&shared, n)).collect();
    assert!(layouts.iter().all(Option::is_some));
    assert!(layouts[1] == layouts[3] && layouts[3] == layouts[5] && layouts[2] == layouts[4], "{layouts:?}");
    assert_ne!(layouts[1], layouts[2]);
    let skip = bake(home.path(), &["--instances", "skip"]);
    assert!(layout(&skip, 0).is_some() && (1..6).all(|n| layout(&skip, n).is_none()));
    // One of the balls keeps its own.
    let rules = "[[rules]]\nnodes = [\"Tree 2\"]\ninstances = \"unique\"\n";
    std::fs::write(home.path().join("rules.toml"), rules).unwrap();
    let config = home.path().join("rules.toml");
    let mixed = bake(home.path(), &["--instances", "shared", "--config", config.to_str().unwrap()]);
    let layouts: Vec<_> = (0..6).map(|n| layout(&mixed, n)).collect();
    assert!(layouts[1] == layouts[5] && layouts[1] != layouts[3] && layouts[3].is_some(), "{layouts:?}");
    let program = env!("CARGO_BIN_EXE_texelwalk");
    let check = std::process::Command::new(program).arg("check").arg(home.path().join("out.gltf")).output().unwrap();
    let told = String::from_utf8_lossy(&check.stdout).into_owned();
    assert!(check.status.success(), "{told}");
    let line = |name: &str| told.lines().find(|l| l.contains(name)).unwrap_or_default().to_owned();
    assert!(line("uv-overlap").contains("ok") && line("uv-missing").contains("ok"), "{told}");
}

/// Memory is asked for by address space: with all copies stored, the triangles alone would take 10 GB.
#[test]
#[ignore = "50 million triangles: 15 s"]
#[cfg(target_os = "linux")]
fn thousands_of_copies_fit_into_little_memory() {
    let home = tempfile::tempdir().unwrap();
    let places = (0..5_000).map(|i| {
        let at = DVec3::new(f64::from(i % 71) * 1.1 - 39.0, 0.0, f64::from(i / 71) * 1.1 - 39.0);
        DMat4::from_rotation_translation(DQuat::from_rotation_y(f64::from(i)), at)
    });
    let b = forest(&places.collect::<Vec<_>>(), true, 36);
    let scene = home.path().join("forest.glb");
    std::fs::write(&scene, b.glb(&[])).unwrap();
    let config = home.path().join("rules.toml");
    std::fs::write(&config, "[[rules]]\nnodes = [\"Tree *\"]\nreceives = false\n").unwrap();
    let bake = |kib: usize, name: &str| {
        let program = env!("CARGO_BIN_EXE_texelwalk");
        let options = "--preset preview --texels-per-meter 1 --sky 1 --threads 2 -q";
        let script = format!(
            "ulimit -v {kib}; exec {program} bake {} -o {}/ --config {} {options}",
            scene.display(),
            home.path().join(name).display(),
            config.display()
        );
        std::process::Command::new("sh").args(["-c", &script]).output().unwrap()
    };
    let out = bake(1_500_000, "out");
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
}
