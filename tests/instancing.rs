//! `EXT_mesh_gpu_instancing`: instances are nodes, each with light of its own.

#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "tests")]

#[path = "support/crosscheck_env.rs"]
mod crosscheck_env;
#[path = "support/gltf_builder.rs"]
mod gltf_builder;

use gltf_builder::Builder;
use serde_json::Value;
use serde_json::json;
use std::path::Path;
use std::path::PathBuf;
use std::process::Command;
use texelwalk::scene::Scene;
use texelwalk::scene::Settings;
use texelwalk::scene::load;
use texelwalk::scene::load_bytes;

const NAME: &str = "EXT_mesh_gpu_instancing";

/// Half a turn about y and a sixth of a turn about z, as signed bytes: not of unit length when read.
const TURNS: [[i8; 4]; 3] = [[0, 127, 0, 0], [0, 0, 64, 110], [0, 0, 0, 127]];
const PLACES: [[f32; 3]; 3] = [[0.25, 0.0, 0.5], [2.0, 0.0, 1.0], [1.0, 0.5, -1.0]];
const SCALES: [[f32; 3]; 3] = [[1.0, 1.0, 1.0], [0.5, 1.5, 0.5], [-1.0, 1.0, 1.0]];

fn instanced(material: Value) -> Builder {
    let mut b = Builder::square(material);
    (b.json["accessors"][0]["min"], b.json["accessors"][0]["max"]) = (json!([0, 0, 0]), json!([1, 1, 0]));
    let places = b.floats("VEC3", PLACES.as_flattened());
    let scales = b.floats("VEC3", SCALES.as_flattened());
    let turns = bytemuck::cast_slice(TURNS.as_flattened());
    let turns = b.accessor(5120, "VEC4", 3, turns, json!({"normalized": true}));
    let ids = b.accessor(5123, "SCALAR", 3, &gltf_builder::words(&[7, 8, 500]), json!({}));
    let wind = b.floats("VEC2", &[0.5, 1.0, 1.5, 2.0, 2.5, 3.0]);
    let attributes = json!({"TRANSLATION": places, "SCALE": scales, "ROTATION": turns, "_ID": ids, "_WIND": wind});
    b.json["nodes"][0] = json!({"name": "Trees", "mesh": 0, "translation": [0, 1, 0],
        "extensions": {NAME: {"attributes": attributes}, "ACME_moss": {"x": 1.50}}, "extras": {"a": 1}});
    b.push("nodes", json!({"name": "Rock", "translation": [5, 0, 0]}));
    b.json["scenes"] = json!([{"nodes": [0, 1]}]);
    b.json["extensionsUsed"] = json!([NAME, "ACME_moss"]);
    b.json["extensionsRequired"] = json!([NAME]);
    b
}

/// The same with nodes.
fn written_out(b: &Builder) -> Builder {
    let mut plain = Builder { json: b.json.clone(), bin: b.bin.clone() };
    let mut children = vec![];
    for i in 0..3 {
        let turn = TURNS[i].map(|v| f64::from((f32::from(v) / 127.0).max(-1.0)));
        let length = turn.iter().map(|v| v * v).sum::<f64>().sqrt();
        let turn = turn.map(|v| (v / length) as f32);
        let node = json!({"mesh": 0, "translation": PLACES[i], "rotation": turn, "scale": SCALES[i]});
        children.push(plain.push("nodes", node));
    }
    plain.json["nodes"][0] = json!({"translation": [0, 1, 0], "children": children});
    plain.json["extensionsUsed"] = json!(["ACME_moss"]);
    plain.json.as_object_mut().unwrap().remove("extensionsRequired");
    plain
}

fn scene(b: &Builder) -> Scene {
    load_bytes(b.gltf(), Path::new("a.gltf"), &Settings::default()).unwrap().output
}

#[test]
fn instances_are_placed_as_nodes_would_be() {
    let b = instanced(json!({}));
    let (instances, nodes) = (scene(&b), scene(&written_out(&b)));
    assert_eq!(instances.vertices.normal, nodes.vertices.normal);
    assert_eq!(instances.triangles, nodes.triangles);
    let apart = instances.vertices.position.iter().zip(&nodes.vertices.position).map(|(a, b)| a.distance(*b));
    assert!(apart.fold(0.0, f32::max) < 1e-6, "numbers of 32 bits in the text");
    let names: Vec<&str> = instances.parts.iter().map(|p| p.name.as_str()).collect();
    assert_eq!(names, ["Trees.0", "Trees.1", "Trees.2"]);
    assert!(instances.parts[2].mirrored && instances.parts.iter().all(|p| p.receives));
}

#[test]
fn the_document_has_nodes_and_no_extension() {
    let scene = scene(&instanced(json!({})));
    let json: Value = serde_json::from_str(&scene.document.json).unwrap();
    assert_eq!(json["extensionsUsed"], json!(["ACME_moss"]));
    assert!(json.get("extensionsRequired").is_none(), "an empty list would be invalid");
    let node = &json["nodes"][0];
    assert_eq!(node["children"], json!([2, 3, 4]));
    assert!(node.get("mesh").is_none() && node["extensions"].get(NAME).is_none());
    assert!(scene.document.json.contains("\"ACME_moss\": {\"x\":1.5}") && node["extras"]["a"] == 1);
    let child = &json["nodes"][4];
    assert_eq!((&child["name"], &child["mesh"]), (&json!("Trees.2"), &json!(0)));
    assert_eq!(child["extras"], json!({"_ID": 500, "_WIND": [2.5, 3]}), "what viewers cannot know is kept");
    assert_eq!(child["scale"], json!([-1, 1, 1]));
}

#[test]
fn what_receives_nothing_keeps_the_extension() {
    let mut b = instanced(json!({"extensions": {"KHR_materials_unlit": {}}}));
    let text = String::from_utf8(b.gltf()).unwrap();
    let unlit = scene(&b);
    assert_eq!(unlit.document.json, text);
    assert_eq!(unlit.parts.len(), 3);
    assert_eq!(unlit.vertices.position, scene(&written_out(&b)).vertices.position);
    assert!(unlit.parts.iter().all(|p| !p.receives));
    // A second instanced node that does receive is written out; the first and the names of the extension stay.
    let mut lit = b.json["meshes"][0].clone();
    lit["primitives"][0].as_object_mut().unwrap().remove("material");
    b.push("meshes", lit);
    let mut node = b.json["nodes"][0].clone();
    node["mesh"] = json!(1);
    node["name"] = json!("Bushes");
    b.json["nodes"][1] = node;
    let both = scene(&b);
    let json: Value = serde_json::from_str(&both.document.json).unwrap();
    assert_eq!((json["nodes"].as_array().unwrap().len(), both.parts.len()), (5, 6));
    assert_eq!(json["nodes"][0], b.json["nodes"][0]);
    assert_eq!(json["extensionsRequired"], json!([NAME]));
    let receives: Vec<&str> = both.parts.iter().filter(|p| p.receives).map(|p| p.name.as_str()).collect();
    assert_eq!(receives, ["Bushes.0", "Bushes.1", "Bushes.2"]);
}

#[test]
fn a_fault_of_the_mesh_is_reported_once() {
    let mut b = instanced(json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "texCoord": 3}}}));
    b.texture(1, &[[255; 4]]);
    b.json["animations"] = json!([{"channels": [{"sampler": 0, "target": {"node": 0, "path": "rotation"}}]}]);
    let loaded = load_bytes(b.gltf(), Path::new("a.gltf"), &Settings::default()).unwrap();
    let codes: Vec<&str> = loaded.warnings.iter().map(|w| w.code).collect();
    assert_eq!(codes, ["unsupported-extension", "missing-texcoord", "animated-node"]);
}

fn bake(folder: &Path, name: &str, b: &Builder) -> PathBuf {
    let input = folder.join(format!("{name}.glb"));
    std::fs::write(&input, b.glb(&[])).unwrap();
    let output = folder.join(format!("{name}-out/scene.glb"));
    let mut command = Command::new(env!("CARGO_BIN_EXE_texelwalk"));
    command.arg("bake").arg(&input).arg("-o").arg(&output).args(["--preset", "preview", "--sky", "1,2,3", "-q"]);
    let done = command.args(["--texels-per-meter", "8"]).output().unwrap();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    output
}

#[test]
fn every_instance_gets_the_light_that_a_node_gets() {
    let home = tempfile::tempdir().unwrap();
    let b = instanced(json!({}));
    let [instances, nodes] =
        [("instances", b.clone_of()), ("nodes", written_out(&b))].map(|(name, b)| bake(home.path(), name, &b));
    let page = |glb: &Path| std::fs::read(glb.with_file_name("scene.lightmap0.exr")).unwrap();
    assert!(page(&instances) == page(&nodes), "the same page, byte for byte");
    let baked = load(&instances, &Settings::default()).unwrap().output;
    let json: Value = serde_json::from_str(&baked.document.json).unwrap();
    let sets: Vec<&Value> =
        (0..3).map(|i| &json["meshes"][baked.parts[i].mesh]["primitives"][0]["attributes"]["TEXCOORD_1"]).collect();
    assert!(sets[0] != sets[1] && sets[1] != sets[2] && sets.iter().all(|s| s.is_u64()), "{sets:?}");
    let positions = |i: usize| &json["meshes"][baked.parts[i].mesh]["primitives"][0]["attributes"]["POSITION"];
    assert_eq!(positions(0), positions(1), "what is equal is stored once");
}

#[test]
#[ignore = "slow: makes a Python environment, minutes"]
fn nothing_is_invalid_or_lost() {
    let folder = crosscheck_env::folder("instancing");
    let mut b = instanced(json!({}));
    // The validator knows neither this name nor what an accessor that only an unknown extension uses is for.
    b.json["extensionsUsed"] = json!([NAME]);
    b.json["nodes"][0]["extensions"].as_object_mut().unwrap().remove("ACME_moss");
    let baked = bake(&folder, "instances", &b);
    let input = folder.join("instances.glb");
    crosscheck_env::accepts(
        "checks/validate.py",
        &[crosscheck_env::text(&baked), "--input", crosscheck_env::text(&input)],
    );
    let [input, baked] = [&input, &baked].map(|file| crosscheck_env::text(file));
    crosscheck_env::accepts("checks/preserved.py", &[input, baked]);
}

impl Builder {
    fn clone_of(&self) -> Self {
        Self { json: self.json.clone(), bin: self.bin.clone() }
    }
}
