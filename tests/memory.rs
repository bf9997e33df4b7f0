//! Memory: what `inspect` estimates against what a bake takes, and what is refused, with `--memory-limit` and without.
#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "tests")]

#[path = "support/gltf_builder.rs"]
mod gltf_builder;

use gltf_builder::Builder;
use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn texelwalk(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_texelwalk")).args(args).output().unwrap()
}

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures").join(name)
}

/// Few rays, of which memory does not depend on.
const HASTE: &str = "direct-samples = 1\nlines-per-texel = 0.5\ngather = 2\n";

/// The estimate and the peak of a bake [bytes].
fn estimate_and_peak(input: &Path, config: &str) -> [f64; 2] {
    let home = tempfile::tempdir().unwrap();
    let path = |name: &str| home.path().join(name).to_str().unwrap().to_owned();
    fs::write(path("a.toml"), format!("{HASTE}{config}")).unwrap();
    let (input, config) = (input.to_str().unwrap(), path("a.toml"));
    let told = texelwalk(&["inspect", input, "--preset", "preview", "--config", &config, "--json"]);
    assert!(told.status.success(), "{}", String::from_utf8_lossy(&told.stderr));
    let facts: Value = serde_json::from_slice(&told.stdout).unwrap();
    let report = path("report.json");
    let args = ["bake", input, "-q", "-o", &path("out/"), "--preset", "preview", "--config", &config];
    let baked = texelwalk(&[&args[..], &["--report", &report]].concat());
    assert!(baked.status.success(), "{}", String::from_utf8_lossy(&baked.stderr));
    let report: Value = serde_json::from_slice(&fs::read(report).unwrap()).unwrap();
    [facts["memory"]["bytes"].as_f64().unwrap(), report["peak_memory_bytes"].as_f64().unwrap()]
}

/// A wavy sheet of 2·n² triangles, with or without a layout of its own, and `textures` of 512² texels.
fn sheet(n: u32, layout: bool, textures: u32) -> Vec<u8> {
    let mut b = Builder::new();
    let at = |i: u32| [i % (n + 1), i / (n + 1)].map(|k| k as f32 / n as f32);
    let all = 0..(n + 1) * (n + 1);
    let position: Vec<f32> = all
        .clone()
        .flat_map(|i| {
            let [x, z] = at(i);
            [8.0 * x, 0.2 * libm::sinf(20.0 * x) * libm::cosf(17.0 * z), 8.0 * z]
        })
        .collect();
    let uv: Vec<f32> = all.flat_map(at).collect();
    let quad = |i: u32| {
        let a = i / n * (n + 1) + i % n;
        [a, a + n + 1, a + 1, a + 1, a + n + 1, a + n + 2]
    };
    let corners: Vec<u8> = (0..n * n).flat_map(quad).flat_map(u32::to_le_bytes).collect();
    let (position, uv) = (b.floats("VEC3", &position), b.floats("VEC2", &uv));
    let indices = b.accessor(5125, "SCALAR", (6 * n * n) as usize, &corners, json!({}));
    let mut attributes = json!({"POSITION": position, "TEXCOORD_0": uv});
    if layout {
        attributes["TEXCOORD_1"] = json!(uv);
    }
    for k in 0..textures.max(1) {
        let mut material = json!({});
        if k < textures {
            let texture = b.texture(512, &vec![[k as u8, 90, 120, 255]; 512 * 512]);
            material = json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": texture}}});
        }
        let material = b.push("materials", material);
        let primitive = json!({"attributes": attributes, "indices": indices, "material": material});
        let mesh = b.push("meshes", json!({"primitives": [primitive]}));
        b.push("nodes", json!({"mesh": mesh, "translation": [0, k, 0]}));
    }
    b.glb(&[])
}

#[test]
fn estimates_are_above_what_bakes_take_and_not_far_above() {
    let home = tempfile::tempdir().unwrap();
    let write = |name: &str, bytes: Vec<u8>| {
        let path = home.path().join(name);
        fs::write(&path, bytes).unwrap();
        path
    };
    let cornell = fixture("cornell/cornell.gltf");
    let cases = [
        (cornell.clone(), "texels-per-meter = 40"),
        (cornell.clone(), "texels-per-meter = 30\naov = [\"direct\", \"normal\", \"chart\"]"),
        (cornell, "texels-per-meter = 30\ndirectional = \"sh\""),
        (fixture("office/office.glb"), "texels-per-meter = 12"),
        (write("sheet.glb", sheet(300, true, 0)), "texels-per-meter = 2"),
        (write("pictures.glb", sheet(4, true, 100)), "texels-per-meter = 2"),
    ];
    let mut ratios = vec![];
    for (input, config) in &cases {
        let [estimate, peak] = estimate_and_peak(input, config);
        let ratio = estimate / peak;
        eprintln!("{} {config:?}: {:.0} of {:.0} MB, {ratio:.2}", input.display(), estimate / 1e6, peak / 1e6);
        ratios.push(ratio);
    }
    assert!(ratios.iter().all(|ratio| (1.0..=1.6).contains(ratio)), "{ratios:.2?}");
}

#[test]
fn what_needs_more_than_the_limit_is_refused_before_it_takes_it() {
    let home = tempfile::tempdir().unwrap();
    let input = home.path().join("sheet.glb");
    fs::write(&input, sheet(100, true, 4)).unwrap();
    let output = home.path().join("out");
    let target = output.join("a.glb");
    let bake = |more: &[&str]| {
        let args = ["bake", input.to_str().unwrap(), "-q", "-o", target.to_str().unwrap(), "--preset", "preview"];
        let out = texelwalk(&[&args[..], more].concat());
        (out.status.code().unwrap(), String::from_utf8(out.stderr).unwrap())
    };
    let (code, message) = bake(&["--memory-limit", "1MB"]);
    assert_eq!(code, 1, "{message}");
    for part in ["sheet.glb: loading it needs about", "80000 triangles", "--memory-limit"] {
        assert!(message.contains(part), "{part} is missing in {message}");
    }
    assert!(!message.contains("the bake needs"), "{message}");
    let (code, message) = bake(&["--memory-limit", "200MB", "--texels-per-meter", "64", "--max-pages", "9"]);
    assert_eq!(code, 1, "{message}");
    assert!(message.contains("the bake needs about") && message.contains("--texels-per-meter"), "{message}");
    assert!(!output.exists(), "something was written");
    assert_eq!(bake(&["--memory-limit", "much"]).0, 2);
    let (code, message) =
        bake(&["--memory-limit", "2GiB", "--texels-per-meter", "4", "--gather", "2", "--direct-samples", "1"]);
    assert_eq!(code, 0, "{message}");
}

/// A room whose unit is the millimetre would take weeks and more memory than there is: refused, without being asked to.
#[test]
fn what_the_machine_cannot_hold_is_refused() {
    let home = tempfile::tempdir().unwrap();
    let mut b = Builder::new();
    let position = b.floats("VEC3", &[0.0, 0.0, 0.0, 0.0, 0.0, 9e6, 9e6, 0.0, 0.0]);
    let mesh = b.push("meshes", json!({"primitives": [{"attributes": {"POSITION": position}}]}));
    b.push("nodes", json!({"mesh": mesh}));
    let (input, output) = (home.path().join("mm.glb"), home.path().join("out/mm.glb"));
    fs::write(&input, b.glb(&[])).unwrap();
    let args = ["bake", input.to_str().unwrap(), "-o", output.to_str().unwrap(), "--page-size", "16384"];
    let out = texelwalk(&args);
    let message = String::from_utf8(out.stderr).unwrap();
    assert_eq!(out.status.code(), Some(1), "{message}");
    for part in ["the bake needs about", "of this machine", "--memory-limit", "9000000 x 0 x 9000000 m", "unit"] {
        assert!(message.contains(part), "{part} is missing in {message}");
    }
    assert!(!home.path().join("out").exists(), "something was written");
}

/// A document of a thousand pictures, each decoded once. The numbers are in the README.
#[test]
#[ignore = "20 s, a gigabyte"]
fn a_thousand_pictures_load() {
    let home = tempfile::tempdir().unwrap();
    let input = home.path().join("pictures.glb");
    fs::write(&input, sheet(2, true, 1000)).unwrap();
    let [estimate, peak] = estimate_and_peak(&input, "texels-per-meter = 1");
    eprintln!("{:.0} MB estimated, {:.0} MB taken", estimate / 1e6, peak / 1e6);
    assert!((1.0..=1.6).contains(&(estimate / peak)));
}
