//! Broken and hostile documents: the right class of error, one clear message, no panic, at once.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on should panic")]

#[path = "support/hostile.rs"]
mod hostile;

use std::time::Duration;
use std::time::Instant;
use texelwalk::scene;

/// Longest that a refusal may take. The slowest cases parse a few megabytes; a hundred times less is usual.
const PATIENCE: Duration = Duration::from_secs(2);

#[test]
fn every_case_is_refused_with_its_class_and_a_clear_message() {
    let cases = hostile::cases();
    assert!(cases.len() >= 35);
    let mut faults = Vec::new();
    for case in &cases {
        let folder = tempfile::tempdir().unwrap();
        for (name, bytes) in &case.files {
            std::fs::write(folder.path().join(name), bytes).unwrap();
        }
        let start = Instant::now();
        let result =
            std::panic::catch_unwind(|| scene::load(&folder.path().join(case.main), &scene::Settings::default()));
        let took = start.elapsed();
        let error = match result {
            Err(_) => {
                faults.push(format!("{}: panicked", case.name));
                continue;
            }
            Ok(Ok(_)) => {
                faults.push(format!("{}: was loaded", case.name));
                continue;
            }
            Ok(Err(error)) => error,
        };
        let expected = match case.class {
            hostile::Class::Unsupported => scene::Class::Unsupported,
            hostile::Class::Invalid => scene::Class::Invalid,
            hostile::Class::Io => scene::Class::Io,
        };
        let message = error.to_string();
        if error.class() != expected {
            faults.push(format!("{}: {:?} instead of {expected:?}: {message}", case.name, error.class()));
        }
        for word in &case.message_contains {
            if !message.contains(word) {
                faults.push(format!("{}: `{word}` is missing in: {message}", case.name));
            }
        }
        if message.contains('\n') || message.len() > 500 {
            faults.push(format!("{}: not one short line: {message}", case.name));
        }
        if took > PATIENCE {
            faults.push(format!("{}: took {took:?}", case.name));
        }
    }
    assert!(faults.is_empty(), "{} of {} cases:\n{}", faults.len(), cases.len(), faults.join("\n"));
}

#[test]
fn case_names_are_distinct() {
    let mut names: Vec<_> = hostile::cases().iter().map(|c| c.name).collect();
    names.sort_unstable();
    assert!(names.windows(2).all(|w| w[0] != w[1]));
}

/// The document that most cases change is fine by itself, so each refusal is due to the change.
#[test]
fn the_unchanged_document_loads() {
    let path = std::path::Path::new("a.gltf");
    for bytes in [hostile::builder::Builder::triangle().gltf(), hostile::builder::Builder::triangle().glb(&[])] {
        let loaded = scene::load_bytes(bytes, path, &scene::Settings::default()).unwrap();
        assert_eq!(loaded.output.triangles, [[0, 1, 2]]);
        assert_eq!(loaded.warnings, []);
    }
}

/// Every prefix and every single changed byte of a small file: whatever comes out, it is no panic.
#[test]
fn prefixes_and_flipped_bytes_never_panic() {
    let path = std::path::Path::new("a.glb");
    let mut b = hostile::builder::Builder::square(serde_json::json!({
        "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}, "alphaMode": "BLEND"
    }));
    b.texture(2, &[[9, 8, 7, 6]; 4]);
    let good = b.glb(&[]);
    let mut loaded = 0;
    for end in 0..good.len() {
        assert!(scene::load_bytes(good[..end].to_vec(), path, &scene::Settings::default()).is_err());
    }
    for at in 0..good.len() {
        for flip in [0x01, 0x10, 0xff] {
            let mut bad = good.clone();
            bad[at] ^= flip;
            loaded += usize::from(scene::load_bytes(bad, path, &scene::Settings::default()).is_ok());
        }
    }
    assert!(loaded > 100, "only {loaded} changed files still load: the test no longer reaches the decoder");
}

/// A document that uses everything the reader knows.
fn rich() -> serde_json::Value {
    use serde_json::json;
    let info = |set: u32| {
        json!({"index": 0, "texCoord": set,
               "extensions": {"KHR_texture_transform": {"offset": [0, 1], "rotation": 1, "scale": [2, 2], "texCoord": 0}}})
    };
    let mut b = hostile::builder::Builder::square(json!({
        "pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 1], "baseColorTexture": info(0),
                                 "metallicFactor": 1, "metallicRoughnessTexture": info(1)},
        "emissiveFactor": [1, 1, 1], "emissiveTexture": info(0), "alphaMode": "MASK", "alphaCutoff": 0.5,
        "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 2}}
    }));
    b.texture(2, &[[9, 8, 7, 6]; 4]);
    b.push("samplers", json!({"magFilter": 9728, "wrapS": 33648, "wrapT": 33071}));
    b.set("/textures/0/sampler", json!(0));
    let indices = b.view(&[0, 2], json!({}));
    let values = b.view(&[0; 24], json!({}));
    let sparse = json!({"count": 2, "indices": {"bufferView": indices, "byteOffset": 0, "componentType": 5121},
                        "values": {"bufferView": values, "byteOffset": 0}});
    b.set("/accessors/0/sparse", sparse);
    b.set("/accessors/0/byteOffset", json!(0));
    b.set("/bufferViews/0/byteStride", json!(12));
    let joints = b.accessor(5121, "VEC4", 4, &[0; 16], json!({}));
    let weights = b.floats("VEC4", &[1., 0., 0., 0.].repeat(4));
    let binds = b.floats("MAT4", &glam::Mat4::IDENTITY.to_cols_array());
    b.set("/meshes/0/primitives/0/attributes/JOINTS_0", json!(joints));
    b.set("/meshes/0/primitives/0/attributes/WEIGHTS_0", json!(weights));
    b.set("/meshes/0/primitives/0/attributes/COLOR_0", json!(weights));
    b.set("/meshes/0/primitives/0/targets", json!([{"POSITION": 0}]));
    b.set("/meshes/0/primitives/0/mode", json!(4));
    b.set("/meshes/0/weights", json!([0.5]));
    b.push("skins", json!({"joints": [1], "inverseBindMatrices": binds}));
    b.set("/nodes/0/skin", json!(0));
    b.push(
        "nodes",
        json!({"translation": [1, 2, 3], "rotation": [0, 0, 0, 1], "scale": [1, 2, 3], "children": [2, 3]}),
    );
    b.push("nodes", json!({"matrix": glam::Mat4::IDENTITY.to_cols_array(), "camera": 0, "mesh": 0, "weights": [1]}));
    b.push(
        "nodes",
        json!({"extensions": {"KHR_lights_punctual": {"light": 0}, "KHR_node_visibility": {"visible": true}}}),
    );
    b.push("cameras", json!({"perspective": {"yfov": 1, "aspectRatio": 1}}));
    b.push("scenes", json!({"nodes": [0, 1]}));
    b.push("animations", json!({"channels": [{"target": {"node": 1, "path": "scale"}}]}));
    let wishes = json!({"texelwalk": {"density": 2, "receives": true, "casts": 1, "emission": 2, "light_group": "a"}});
    for at in ["/nodes/0", "/meshes/0", "/materials/0"] {
        b.set(&format!("{at}/extras"), wishes.clone());
    }
    b.json["scene"] = json!(0);
    b.json["extensions"] = json!({"KHR_lights_punctual": {"lights": [
        {"type": "spot", "color": [1, 1, 1], "intensity": 5, "range": 9, "extras": {"radius": 0.1, "angle": 0.1, "texelwalk": {"intensity": 2}},
         "spot": {"innerConeAngle": 0.1, "outerConeAngle": 0.2}}]}});
    serde_json::from_slice(&b.gltf()).unwrap()
}

/// Paths to everything in a document.
fn pointers(value: &serde_json::Value, here: &str, out: &mut Vec<String>) {
    out.push(here.to_owned());
    if let Some(object) = value.as_object() {
        object.iter().for_each(|(key, value)| pointers(value, &format!("{here}/{key}"), out));
    }
    if let Some(array) = value.as_array() {
        array.iter().enumerate().for_each(|(i, value)| pointers(value, &format!("{here}/{i}"), out));
    }
}

/// Each value of a document in turn becomes something else: the reader returns, and what it accepts is finite.
#[test]
fn any_value_may_be_anything() {
    use serde_json::json;
    let good = rich();
    let load = |json: &serde_json::Value| {
        scene::load_bytes(json.to_string().into_bytes(), std::path::Path::new("a.gltf"), &scene::Settings::default())
    };
    let first = load(&good).unwrap();
    assert!(first.output.parts.len() == 2 && first.output.lights.len() == 1 && first.output.cameras.len() == 1);
    let mut places = Vec::new();
    pointers(&good, "", &mut places);
    assert!(places.len() > 200, "{}", places.len());
    let odd = [
        json!(-1),
        json!(0),
        json!(0.5),
        json!(1),
        json!(7),
        json!(1_000_000_000),
        json!(u64::MAX),
        json!(1e308),
        json!(-1e39),
        json!(1e-320),
        json!("x"),
        json!(""),
        json!(null),
        json!(true),
        json!([]),
        json!([0]),
        json!({}),
    ];
    let (mut accepted, mut refused) = (0, 0);
    for place in &places {
        for value in &odd {
            let mut json = good.clone();
            *json.pointer_mut(place).unwrap() = value.clone();
            match load(&json) {
                Err(_) => refused += 1,
                Ok(loaded) => {
                    accepted += 1;
                    let v = &loaded.output.vertices;
                    assert!(v.position.iter().chain(&v.normal).all(|p| p.is_finite()), "{place} = {value}");
                    assert!(v.uv.iter().flatten().all(|t| t.is_finite()), "{place} = {value}");
                    let b = glam::Vec2::splat(0.3);
                    for t in 0..loaded.output.triangles.len() as u32 {
                        let scene = &loaded.output;
                        let light = scene.reflectance(t, b) + scene.emission(t, b);
                        assert!(light.is_finite() && light.min_element() >= 0.0, "{place} = {value}: {light}");
                        assert!((0.0..=1.0).contains(&scene.opacity(t, b)), "{place} = {value}");
                    }
                }
            }
        }
    }
    assert!(accepted > 500 && refused > 500, "{accepted} accepted, {refused} refused");
}
