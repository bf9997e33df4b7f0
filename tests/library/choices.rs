//! What of a document is baked where it holds more than one answer: variants of materials, levels of detail.

use crate::gltf_builder::Builder;
use serde_json::{Value, json};
use std::fs;
use std::path::Path;
use std::process::{Command, Output};
use texelwalk::base::Warned;
use texelwalk::scene::{Error, Scene, Settings, load_bytes};

/// A square that is red, or blue in the variants `night` and `dusk`, and one without a choice.
fn with_variants() -> Builder {
    let color = |name: &str, c: [f32; 4]| json!({"name": name, "pbrMetallicRoughness": {"baseColorFactor": c, "metallicFactor": 0}});
    let mut b = Builder::square(color("red", [0.8, 0.1, 0.1, 1.0]));
    b.push("materials", color("blue", [0.1, 0.1, 0.8, 1.0]));
    let plain = b.json["meshes"][0].clone();
    b.push("meshes", plain);
    b.push("nodes", json!({"mesh": 1, "translation": [0, 0, 1]}));
    let mappings = json!([{"material": 0, "variants": [0]}, {"material": 1, "variants": [1, 2]}]);
    b.set("/meshes/0/primitives/0/extensions", json!({"KHR_materials_variants": {"mappings": mappings}}));
    b.json["extensionsUsed"] = json!(["KHR_materials_variants"]);
    let names = json!([{"name": "day"}, {"name": "night"}, {"name": "dusk"}]);
    b.json["extensions"] = json!({"KHR_materials_variants": {"variants": names}});
    b
}

fn load(b: &Builder, variant: Option<&str>) -> Result<Warned<Scene>, Error> {
    let settings = Settings { variant: variant.map(str::to_owned), ..Settings::default() };
    load_bytes(b.gltf(), Path::new("a.gltf"), &settings)
}

fn materials(b: &Builder, variant: Option<&str>) -> Vec<String> {
    let scene = load(b, variant).unwrap().output;
    scene.parts.iter().map(|p| scene.materials[p.material].name.clone()).collect()
}

#[test]
fn a_variant_chooses_materials() {
    let b = with_variants();
    assert_eq!(materials(&b, None), ["red", "red"]);
    assert_eq!(materials(&b, Some("day")), ["red", "red"]);
    assert_eq!(materials(&b, Some("dusk")), ["blue", "red"]);
    let error = load(&b, Some("noon")).unwrap_err().to_string();
    assert!(error.contains("\"noon\"") && error.contains("day, night, dusk"), "{error}");
    let error = load(&Builder::triangle(), Some("noon")).unwrap_err().to_string();
    assert!(error.contains("no variants"), "{error}");
    // A mapping to a material that does not exist is refused like any such reference.
    let mut bad = with_variants();
    bad.set("/meshes/0/primitives/0/extensions/KHR_materials_variants/mappings/1/material", json!(9));
    assert!(load(&bad, Some("night")).is_err());
}

fn texelwalk(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_texelwalk")).args(arguments).output().unwrap()
}

#[test]
fn a_baked_variant_keeps_the_choice() {
    let folder = tempfile::tempdir().unwrap();
    let [input, config] = ["in.gltf", "night.toml"].map(|name| folder.path().join(name));
    fs::write(&input, with_variants().gltf()).unwrap();
    fs::write(&config, "variant = \"night\"\n").unwrap();
    let path = |p: &Path| p.to_str().unwrap().to_owned();
    let bake = |name: &str, more: &[&str]| -> Value {
        let out = folder.path().join(name).join("out.gltf");
        fs::create_dir(out.parent().unwrap()).unwrap();
        let (input, out) = (path(&input), path(&out));
        let usual = ["bake", &input, "-o", &out, "-q", "--preset", "preview", "--sky", "1,1,1"];
        let done = texelwalk(&[&usual[..], more].concat());
        assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
        serde_json::from_slice(&fs::read(&out).unwrap()).unwrap()
    };
    let plain = bake("plain", &[]);
    let night = bake("night", &["--variant", "night"]);
    let pages = |name: &str| fs::read(folder.path().join(name).join("out.lightmap0.exr")).unwrap();
    assert_ne!(pages("plain"), pages("night"), "another reflectance gives other light");
    assert_eq!(plain["meshes"], night["meshes"]);
    assert_eq!(plain["materials"], night["materials"]);
    let mappings = &night["meshes"][0]["primitives"][0]["extensions"]["KHR_materials_variants"]["mappings"];
    for mapping in mappings.as_array().unwrap() {
        let material = &night["materials"][mapping["material"].as_u64().unwrap() as usize];
        assert!(material["extensions"]["MOZ_lightmap"].is_object(), "{mapping} has no lightmap");
    }
    let config = path(&config);
    bake("config", &["--config", &config]);
    assert_eq!(pages("config"), pages("night"));
    let shown = texelwalk(&["inspect", &path(&input)]);
    assert!(String::from_utf8_lossy(&shown.stdout).contains("variant: night"));
    let out = path(&folder.path().join("out.gltf"));
    let unknown = texelwalk(&["bake", &path(&input), "-o", &out, "--variant", "noon"]);
    assert_eq!(unknown.status.code(), Some(3));
    assert!(String::from_utf8_lossy(&unknown.stderr).contains("day, night, dusk"));
}

#[test]
fn only_the_finest_level_takes_part() {
    let mut b = Builder::triangle();
    b.set("/nodes/0/name", json!("fine"));
    b.set("/nodes/0/extensions", json!({"MSFT_lod": {"ids": [1, 2]}}));
    b.push("nodes", json!({"name": "coarse", "mesh": 0, "children": [3]}));
    b.push("nodes", json!({"name": "coarser", "mesh": 0}));
    b.push("nodes", json!({"name": "below", "mesh": 0}));
    b.push("nodes", json!({"name": "other", "mesh": 0}));
    b.json["extensionsUsed"] = json!(["MSFT_lod"]);
    b.json["scenes"] = json!([{"nodes": [0, 1, 4]}]);
    let loaded = load(&b, None).unwrap();
    let names: Vec<&str> = loaded.output.parts.iter().map(|p| p.name.as_str()).collect();
    assert_eq!(names, ["fine", "other"]);
    let told: Vec<_> = loaded.warnings.iter().map(|w| (w.code, w.node.as_deref())).collect();
    assert_eq!(told, [("lod-levels", Some("coarse"))], "the one that is not in the scene needs no warning");
    // Levels of materials: what primitives refer to is the finest.
    let mut b = with_variants();
    b.set("/materials/0/extensions", json!({"MSFT_lod": {"ids": [1]}}));
    assert_eq!(materials(&b, None), ["red", "red"]);
    // Names of what does not exist, and of itself, hide nothing.
    let mut b = Builder::triangle();
    b.set("/nodes/0/extensions", json!({"MSFT_lod": {"ids": [0, 77]}}));
    assert_eq!(load(&b, None).unwrap().output.parts.len(), 1);
}
