//! `--quantize-uv`: 16-bit lightmap coordinates against the floats of the same bake.

use crate::gltf::Output;
use serde_json::Value;
use std::path::Path;
use std::process::Command;

fn texelwalk(args: &[&str]) -> (i32, String) {
    let out = Command::new(env!("CARGO_BIN_EXE_texelwalk")).args(args).output().unwrap();
    let text = String::from_utf8_lossy(&out.stdout).into_owned() + &String::from_utf8_lossy(&out.stderr);
    (out.status.code().unwrap(), text)
}

/// Accessors of the lightmap coordinates, in document order.
fn accessors(document: &Output) -> Vec<Value> {
    let list = |v: &Value| v.as_array().cloned().unwrap_or_default();
    let primitives = list(&document.json["meshes"]).into_iter().flat_map(|mesh| list(&mesh["primitives"]));
    primitives.map(|p| p["attributes"]["TEXCOORD_1"].clone()).filter(|a| !a.is_null()).collect()
}

#[test]
fn sixteen_bits_are_within_half_a_step_and_read_back() {
    let home = tempfile::tempdir().unwrap();
    let fixture = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/cornell/cornell.gltf");
    let bake = |name: &str, more: &[&str]| {
        let output = home.path().join(name).join("room.glb");
        let haste = ["--preset", "preview", "--texels-per-meter", "8", "--gather", "4", "--direct-samples", "1", "-q"];
        let args = ["bake", fixture.to_str().unwrap(), "-o", output.to_str().unwrap()];
        let (code, text) = texelwalk(&[&args[..], &haste, more].concat());
        assert_eq!(code, 0, "{text}");
        output
    };
    let (plain, short) = (bake("plain", &[]), bake("short", &["--quantize-uv"]));
    let [exact, rounded] = [&plain, &short].map(|path| Output::read(path));
    let (floats, shorts) = (accessors(&exact), accessors(&rounded));
    assert!(!floats.is_empty() && floats.len() == shorts.len());
    for (a, b) in floats.iter().zip(&shorts) {
        let accessor = &rounded.json["accessors"][b.as_u64().unwrap() as usize];
        assert_eq!((accessor["componentType"].as_u64(), accessor["normalized"].as_bool()), (Some(5123), Some(true)));
        let view = &rounded.json["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize];
        assert_eq!(view["byteStride"], 4);
        assert_eq!(accessor["byteOffset"].as_u64().unwrap_or(0) % 4, 0);
        let (exact, rounded) = (exact.floats(a), rounded.elements(b));
        assert_eq!(exact.len(), rounded.len());
        for (exact, rounded) in exact.iter().zip(&rounded) {
            for (value, bytes) in exact.iter().zip(rounded.chunks(2)) {
                let read = f64::from(u16::from_le_bytes([bytes[0], bytes[1]])) / 65535.0;
                assert!((f64::from(*value) - read).abs() <= 0.5 / 65535.0 + 1e-7, "{value} {read}");
            }
        }
    }
    // No texel is another one for it, and what reads bakes back reads this one.
    let exr = |n: &str| home.path().join(n).join("room.lightmap0.exr").to_str().unwrap().to_owned();
    let (code, text) = texelwalk(&["compare", &exr("plain"), &exr("short"), "--fail", "0"]);
    assert_eq!(code, 0, "{text}");
    let faults = |path: &Path| {
        let (code, text) = texelwalk(&["check", path.to_str().unwrap(), "--json", "-"]);
        assert_eq!(code, 0, "{text}");
        let report: Value = serde_json::from_str(&text).unwrap();
        report["faults"].as_array().unwrap().iter().map(|f| f.to_string()).collect::<Vec<_>>()
    };
    assert_eq!(faults(&plain), faults(&short));
    let picture = home.path().join("view.png");
    let args = ["render", short.to_str().unwrap(), "-o", picture.to_str().unwrap(), "--width", "32", "--height", "32"];
    assert_eq!(texelwalk(&args).0, 0);
}

#[test]
fn vertices_have_no_lightmap_coordinates() {
    let (code, text) = texelwalk(&["bake", "a.glb", "-o", "b.glb", "--target", "vertex", "--quantize-uv"]);
    assert!(code == 2 && text.contains("--quantize-uv needs --target lightmap"), "{text}");
}
