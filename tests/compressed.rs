//! Meshopt and Draco: what they hold is what is baked, damage is refused, and what is written needs no decoder.
//!
//! The streams are written here by hand, in the simplest form that the formats allow. `pipelines/checks/compressed.py` has
//! those of real encoders, and compares with the reference decoders.

#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "tests")]

#[path = "support/compressed.rs"]
mod compressed;
#[path = "support/crosscheck_env.rs"]
mod crosscheck_env;
#[path = "support/gltf_builder.rs"]
mod gltf_builder;

use compressed::{draco_mesh, draco_square, draco_squares, index_sequence, meshopt_square, vertex_stream};
use glam::{Vec2, Vec3};
use gltf_builder::Builder;
use serde_json::{Value, json};
use std::path::Path;
use std::process::Command;
use texelwalk::scene::{Part, Scene, Settings, load, load_bytes};

fn scene(builder: &Builder) -> Scene {
    load_bytes(builder.gltf(), Path::new("a.gltf"), &Settings::default()).unwrap().output
}

fn refusal(builder: &Builder) -> String {
    load_bytes(builder.gltf(), Path::new("a.gltf"), &Settings::default()).unwrap_err().to_string()
}

fn assert_same_square(scene: &Scene) {
    let plain = scene_of_plain_square();
    assert_eq!(scene.vertices.position, plain.vertices.position);
    assert_eq!(scene.vertices.uv, plain.vertices.uv);
    assert_eq!(scene.triangles, plain.triangles);
}

fn scene_of_plain_square() -> Scene {
    let mut plain = Builder::square(json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}));
    plain.texture(1, &[[255; 4]]);
    scene(&plain)
}

#[test]
fn meshopt_views_and_draco_primitives_are_read() {
    for name in ["EXT_meshopt_compression", "KHR_meshopt_compression"] {
        assert_same_square(&scene(&meshopt_square(name)));
    }
    let draco = scene(&draco_square());
    assert_same_square(&draco);
    assert_eq!(draco.vertices.normal[0], Vec3::Z);
}

/// A flat grid of 15 × 15 vertices with `TEXCOORD_0` = position, as the reference encoder writes it (edgebreaker, speed
/// 3, 6 bits).
const GRID: &str = "\
    RFJBQ08CAgEBAAAA4QGIAwGIAw4AaV/7VKtPVav6VFWrqk9VVauq+lRVVauqqk9VVVWrqqr6VFVVVauqqqpPVVVVVauqqqr6VFVV\
    VVWrqqqqqk9VVVVVVauqqqqq+lRVVVVV1VNVVVVVVX2qqqqqqqpaVVVVVVXVp6qqqqqqCv8BEf8DLIOAAv8AAAAAAAEACQMAAAIB\
    AwkCAAECAQEBAQRAdTJBBtUGExgYGKsYHxhYeIixJz8+bDovZIpAdDrRoeyNILbIKdlEI+a4LnTIy4MG705LFDXRizasXXq7ldmO\
    HnttkhalOfiHZgfgD6IIF+KIcKJV/ljyUw91owEfzM964u9r/Pm/gQAAAAA/AAAAAAAAAAAAAAAAAAAAAABgQQYFAQEBA0BRPAMh\
    AxMkAySrJB8kF9QfALy2NHkVJeqQmjwRHOIJ3ub78Y+l3wAAAAEDeP9VAAAAAD8AAAAAAAAAAAAAAAAAgD8G";

/// Texture coordinates that are laid out alike everywhere take less than a bit each.
#[test]
fn draco_meshes_with_very_regular_texture_coordinates_are_read() {
    use base64::Engine;
    let bytes = base64::engine::general_purpose::STANDARD.decode(GRID).unwrap();
    let (vertices, corners) = (15 * 15, 6 * 14 * 14);
    let mut b = Builder::square(json!({}));
    let view = b.view(&bytes, json!({}));
    for (accessor, count) in [(0, vertices), (1, vertices), (2, corners)] {
        b.json["accessors"][accessor].as_object_mut().unwrap().remove("bufferView");
        b.json["accessors"][accessor]["count"] = json!(count);
    }
    b.json["extensionsUsed"] = json!(["KHR_draco_mesh_compression"]);
    b.json["extensionsRequired"] = json!(["KHR_draco_mesh_compression"]);
    let draco = json!({"bufferView": view, "attributes": {"POSITION": 0, "TEXCOORD_0": 1}});
    b.set("/meshes/0/primitives/0/extensions", json!({"KHR_draco_mesh_compression": draco}));
    b.set("/materials/0/pbrMetallicRoughness", json!({"baseColorTexture": {"index": 0}}));
    b.texture(1, &[[255; 4]]);
    let scene = scene(&b);
    assert_eq!((scene.vertices.position.len(), scene.triangles.len()), (vertices, corners / 3));
    let area: f64 = (0..scene.triangles.len() as u32).map(|t| scene.area(t)).sum();
    assert!((area - 196.0).abs() < 0.1, "{area}");
    for (position, uv) in scene.vertices.position.iter().zip(&scene.vertices.uv[0]) {
        assert!((position.truncate() / 14.0 - *uv).abs().max_element() < 0.02, "{position} {uv}");
    }
}

#[test]
fn long_streams_cross_blocks() {
    let values: Vec<[u8; 12]> =
        (0..1000u32).map(|i| bytemuck::cast([i.wrapping_mul(0x9e37_79b9), i, !i.wrapping_mul(77)])).collect();
    let mut b = Builder::triangle();
    let bytes = vertex_stream(values.as_flattened(), 12);
    let view = compressed::view(&mut b, "EXT_meshopt_compression", &bytes, 1000, 12, "ATTRIBUTES");
    let accessor =
        b.push("accessors", json!({"bufferView": view, "componentType": 5125, "count": 1000, "type": "VEC3"}));
    let read = scene(&b).document.accessor(accessor).unwrap();
    assert_eq!(read.bytes, values.as_flattened());
}

#[test]
fn damage_is_refused_with_its_place() {
    let case = |change: &dyn Fn(&mut Value)| {
        let mut b = meshopt_square("EXT_meshopt_compression");
        change(&mut b.json["bufferViews"][0]["extensions"]["EXT_meshopt_compression"]);
        let message = refusal(&b);
        assert!(message.contains("buffer view 0"), "{message}");
        message
    };
    assert!(case(&|e| e["count"] = json!(5)).contains("do not make its 48 bytes"));
    assert!(case(&|e| e["byteLength"] = json!(7)).contains("truncated"));
    assert!(case(&|e| e["byteLength"] = json!(1_000_000)).contains("beyond"));
    assert!(case(&|e| e["buffer"] = json!(9)).contains("does not exist"));
    assert!(case(&|e| e["mode"] = json!("ZIP")).contains("ZIP"));
    assert!(case(&|e| e["filter"] = json!("BLUR")).contains("BLUR"));
    assert!(case(&|e| e["byteOffset"] = json!(1)).contains("header"));
    let mut huge = meshopt_square("EXT_meshopt_compression");
    huge.json["bufferViews"][0]["byteLength"] = json!(48_000_000_000u64);
    huge.json["bufferViews"][0]["extensions"]["EXT_meshopt_compression"]["count"] = json!(4_000_000_000u64);
    assert!(refusal(&huge).contains("cannot hold 48000000000 bytes"), "{}", refusal(&huge));
}

/// As glTF-Transform leaves a mesh with sparse positions.
#[test]
fn draco_meshes_may_have_indices_alone() {
    let mut b = Builder::square(json!({}));
    let stream = [b"DRACO\x02\x02\x01\x00\x00\x00\x02\x00\x01".as_slice(), &[0, 1, 2, 0, 2, 3], &[0]].concat();
    let (offset, length) = (b.bin.len(), stream.len());
    b.bin.extend(stream);
    let view = b.push("bufferViews", json!({"buffer": 0, "byteOffset": offset, "byteLength": length}));
    let indices = b.json["meshes"][0]["primitives"][0]["indices"].as_u64().unwrap() as usize;
    b.json["accessors"][indices] = json!({"componentType": 5125, "count": 6, "type": "SCALAR"});
    let extension = json!({"KHR_draco_mesh_compression": {"bufferView": view, "attributes": {}}});
    b.json["meshes"][0]["primitives"][0]["extensions"] = extension;
    let (packed, plain) = (scene(&b), scene(&Builder::square(json!({}))));
    assert_eq!(packed.vertices.position, plain.vertices.position);
    assert_eq!(packed.triangles, plain.triangles);
}

#[test]
fn damaged_draco_is_refused_with_its_place() {
    let case = |change: &dyn Fn(&mut Builder)| {
        let mut b = draco_square();
        change(&mut b);
        let message = refusal(&b);
        assert!(message.contains("mesh 0, primitive 0"), "{message}");
        message
    };
    assert!(case(&|b| b.json["accessors"][0]["count"] = json!(5)).contains("5 vertices are claimed"));
    assert!(case(&|b| b.json["accessors"][2]["count"] = json!(9)).contains("2 triangles were decoded"));
    let extension = "/meshes/0/primitives/0/extensions/KHR_draco_mesh_compression";
    let attribute = format!("{extension}/attributes/POSITION");
    let with = |pointer: &str, value: Value| {
        case(&|b| {
            b.set(pointer, value.clone());
        })
    };
    assert!(with(&attribute, json!(9)).contains("no attribute 9"));
    assert!(with(&format!("{extension}/bufferView"), json!(9)).contains("buffer view 9"));
    assert!(with("/meshes/0/primitives/0/mode", json!(5)).contains("triangle lists"));
    assert!(case(&|b| b.bin[0] = b'X').contains("Invalid magic"));
}

/// Every byte changed in turn, and every length: refused or read, never a panic or a hang.
#[test]
fn no_damaged_stream_is_trusted() {
    let streams = [meshopt_square("EXT_meshopt_compression"), draco_square(), draco_squares(&ALL_SHARED)];
    for builder in streams {
        for at in 0..builder.bin.len() {
            for flip in [0xff, 0x01, 0x80, 0x10] {
                let mut changed = Builder { json: builder.json.clone(), bin: builder.bin.clone() };
                changed.bin[at] ^= flip;
                let _ = load_bytes(changed.gltf(), Path::new("a.gltf"), &Settings::default());
            }
        }
    }
    let whole = draco_mesh();
    for length in 0..whole.len() {
        let mut b = draco_square();
        b.json["bufferViews"][0]["byteLength"] = json!(length);
        assert!(refusal(&b).contains("mesh 0, primitive 0"), "{length} of {}", whole.len());
    }
}

#[test]
fn what_is_baked_is_written_uncompressed_and_the_rest_stays() {
    let home = tempfile::tempdir().unwrap();
    for (name, builder) in [("meshopt", meshopt_square("EXT_meshopt_compression")), ("draco", draco_square())] {
        for target in ["lightmap", "vertex"] {
            let input = home.path().join(format!("{name}.glb"));
            std::fs::write(&input, builder.glb(&[])).unwrap();
            let output = home.path().join(format!("{target}/{name}.glb"));
            std::fs::create_dir_all(output.parent().unwrap()).unwrap();
            let mut bake = Command::new(env!("CARGO_BIN_EXE_texelwalk"));
            bake.arg("bake").arg(&input).arg("-o").arg(&output).args(["--preset", "preview", "--sky", "1,1,1", "-q"]);
            let done = bake.args(["--target", target]).output().unwrap();
            assert!(done.status.success(), "{name}: {}", String::from_utf8_lossy(&done.stderr));
            let baked = load(&output, &Settings::default()).unwrap().output;
            let corner = |s: &Scene, k: usize| s.corners(k as u32 / 3)[k % 3];
            let plain = scene_of_plain_square();
            assert_eq!(baked.triangles.len(), 2);
            assert!((0..6).all(|k| corner(&baked, k) == corner(&plain, k)), "{name} {target}");
            let json: Value = serde_json::from_str(&baked.document.json).unwrap();
            let primitive = &json["meshes"][0]["primitives"][0];
            assert!(primitive["extensions"].get("KHR_draco_mesh_compression").is_none(), "{name} {target}");
            let light = if target == "vertex" { "_LIGHTMAP" } else { "TEXCOORD_1" };
            let accessor = primitive["attributes"][light].as_u64().unwrap() as usize;
            assert_eq!(baked.document.accessor(accessor).unwrap().count as u64, {
                let position = primitive["attributes"]["POSITION"].as_u64().unwrap() as usize;
                json["accessors"][position]["count"].as_u64().unwrap()
            });
        }
    }
}

/// Position and texture coordinates of every corner, by part.
fn corners(scene: &Scene) -> Vec<Vec<(Vec3, Vec2)>> {
    let corner = |v: u32| (scene.vertex_position(v), scene.vertex_uv(0, v).unwrap());
    let part = |p: &Part| scene.part_triangles(p).flatten().map(|v| corner(p.vertices.start + v)).collect();
    scene.parts.iter().map(part).collect()
}

const ALL_SHARED: [&str; 3] = ["indices", "POSITION", "TEXCOORD_0"];

/// As Blender's exporter leaves them: one accessor of indices for all meshes of so many triangles.
#[test]
fn draco_primitives_that_share_an_accessor_have_their_own_values() {
    let apart = corners(&scene(&draco_squares(&[])));
    assert_eq!(apart[0], corners(&scene(&draco_square()))[0]);
    assert_eq!(apart[0], apart[2]);
    assert_eq!(apart[1][0].0, Vec3::new(4.0, 0.0, 0.0));
    assert_eq!(corners(&scene(&draco_squares(&["indices"]))), apart);
    assert_eq!(corners(&scene(&draco_squares(&ALL_SHARED))), apart);
}

#[test]
fn draco_primitives_that_share_an_accessor_must_fit_it() {
    let mut b = draco_squares(&ALL_SHARED);
    let one_triangle = [b"DRACO\x02\x02\x01\x00\x00\x00\x01\x00\x01".as_slice(), &[0, 1, 2], &[0]].concat();
    let view = b.view(&one_triangle, json!({}));
    let second = "/meshes/0/primitives/1/extensions/KHR_draco_mesh_compression";
    b.set(second, json!({"bufferView": view, "attributes": {}}));
    let message = refusal(&b);
    assert!(message.contains("mesh 0, primitive 1: indices: 6 are claimed, but 1 triangles"), "{message}");
    b.set(second, json!({"bufferView": 99, "attributes": {}}));
    assert!(refusal(&b).contains("buffer view 99"), "{}", refusal(&b));
}

#[test]
fn draco_primitives_that_share_an_accessor_are_written_apart() {
    let home = tempfile::tempdir().unwrap();
    let apart = corners(&scene(&draco_squares(&[])));
    for (target, receives) in [("lightmap", true), ("vertex", true), ("lightmap", false)] {
        let mut builder = draco_squares(&ALL_SHARED);
        let second = json!({"mesh": 0, "translation": [0, 9, 0], "extras": {"texelwalk": {"receives": receives}}});
        let second = builder.push("nodes", second);
        builder.json["scenes"][0]["nodes"].as_array_mut().unwrap().push(json!(second));
        let source = builder.json.clone();
        let input = home.path().join("squares.glb");
        std::fs::write(&input, builder.glb(&[])).unwrap();
        let output = home.path().join(format!("{target}-{receives}/squares.glb"));
        std::fs::create_dir_all(output.parent().unwrap()).unwrap();
        let mut bake = Command::new(env!("CARGO_BIN_EXE_texelwalk"));
        bake.arg("bake").arg(&input).arg("-o").arg(&output).args(["--preset", "preview", "--sky", "1,1,1", "-q"]);
        let done = bake.args(["--target", target]).output().unwrap();
        assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
        let baked = load(&output, &Settings::default()).unwrap().output;
        assert_eq!(baked.parts.len(), 6);
        assert_eq!(corners(&baked)[..3], apart, "{target} {receives}");
        let json: Value = serde_json::from_str(&baked.document.json).unwrap();
        let kept = source["accessors"].as_array().unwrap();
        assert_eq!(&json["accessors"].as_array().unwrap()[..kept.len()], kept);
        assert!(receives || json["meshes"][0] == source["meshes"][0], "what the dark node shows stays");
    }
}

#[test]
fn an_index_sequence_may_go_up_and_down() {
    let indices = [0, 3, 1, 1, 2, 0, 3, 3, 2, 65535, 0, 7];
    let mut b = Builder::triangle();
    let bytes = index_sequence(&indices);
    let view = compressed::view(&mut b, "EXT_meshopt_compression", &bytes, indices.len(), 4, "INDICES");
    let accessor = json!({"bufferView": view, "componentType": 5125, "count": indices.len(), "type": "SCALAR"});
    let accessor = b.push("accessors", accessor);
    assert_eq!(scene(&b).document.accessor(accessor).unwrap().to_u32().unwrap(), indices);
}

/// `how` empty: every way that the check knows.
fn optimised(fixture: &crosscheck_env::Fixture, how: &[&str]) {
    let out = crosscheck_env::folder(&format!("compressed-{}-{}", fixture.name, how.len()));
    let options = format!("--options={}", fixture.options.join(" "));
    let program = env!("CARGO_BIN_EXE_texelwalk");
    let text = crosscheck_env::text;
    let mut arguments = vec![program, text(&out), text(&fixture.file), &options];
    if !how.is_empty() {
        arguments.push("--how");
        arguments.extend(how);
    }
    crosscheck_env::accepts("checks/compressed.py", &arguments);
}

#[test]
#[ignore = "slow: makes a Python environment, minutes"]
fn what_optimisers_leave_is_read_as_reference_decoders_read_it() {
    optimised(&crosscheck_env::fixture("office"), &[]);
    for name in ["cornell", "courtyard", "room"] {
        optimised(&crosscheck_env::fixture(name), &["gltfpack -cc", "draco"]);
    }
}
