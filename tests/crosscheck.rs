//! Cross-checks against programs by others: Khronos validator, OpenImageIO, Blender's importer and Cycles.
//!
//! They need Python 3.11 or 3.13 with venv, make an environment under `target/` on the first run (a minute, 1.5 GB), and run
//! the scripts of `pipelines/checks` on bakes of every fixture found on disk. Each check is also shown something wrong,
//! which it has to reject.
#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "tests")]

#[path = "support/crosscheck_env.rs"]
mod crosscheck_env;

use crosscheck_env::{Bake, accepts, bake, brighten, density, fixture, fixtures, folder, rejects, text};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// Texels per metre where nothing is said of light: a level of 78 × 108 m is among the fixtures.
const COARSE: &str = "3";

/// Every fixture, baked once for all tests of this file.
fn bakes() -> &'static [Bake] {
    static BAKES: OnceLock<Vec<Bake>> = OnceLock::new();
    BAKES.get_or_init(|| {
        let out = folder("bakes");
        let one = |f: &crosscheck_env::Fixture| {
            let inside = out.join(&f.name);
            fs::create_dir_all(&inside).unwrap();
            bake(f, &inside, &["--preset", "preview", "--texels-per-meter", COARSE])
        };
        fixtures().iter().map(one).collect()
    })
}

#[test]
#[ignore = "slow: makes a Python environment, minutes"]
fn khronos_validator_finds_nothing_in_any_baked_fixture() {
    for bake in bakes() {
        accepts("checks/validate.py", &["--input", text(&bake.fixture.file), text(&bake.gltf)]);
    }
}

#[test]
#[ignore = "slow: makes a Python environment, minutes"]
fn khronos_validator_check_rejects_an_error_and_a_warning() {
    let out = folder("validator_rejects");
    let error = out.join("error.gltf");
    fs::write(&error, r#"{"asset": {"version": "2.0"}, "scene": 3}"#).unwrap();
    rejects("checks/validate.py", &[text(&error)], "UNRESOLVED_REFERENCE");
    let warning = out.join("warning.gltf");
    let image = r#"{"asset": {"version": "2.0"}, "images": [{"uri": "a.exr"}]}"#;
    fs::write(&warning, image).unwrap();
    fs::write(out.join("a.exr"), [0x76, 0x2f, 0x31, 0x01, 2, 0, 0, 0]).unwrap();
    rejects("checks/validate.py", &[text(&warning)], "IMAGE_UNRECOGNIZED_FORMAT");
    accepts("checks/validate.py", &["--input", text(&warning), text(&warning)]);
}

#[test]
#[ignore = "slow: makes a Python environment, minutes"]
fn openimageio_reads_every_page() {
    let pages: Vec<&str> = bakes().iter().flat_map(|b| &b.pages).map(|p| text(p)).collect();
    accepts("checks/exr.py", &pages);
}

#[test]
#[ignore = "slow: makes a Python environment, minutes"]
fn exr_check_rejects_other_channels_types_and_values() {
    let path = folder("exr_rejects").join("wrong.exr");
    let pixel = |x: usize, _: usize| (if x == 0 { f32::NAN } else { -1.0 }, 0.0f32, 0.0f32, 0.5f32);
    exr::prelude::write_rgba_file(&path, 4, 4, pixel).unwrap();
    for why in ["not half", "NaN", "negative", "alpha", "texelwalk.version", "Rec.709"] {
        rejects("checks/exr.py", &[text(&path)], why);
    }
}

#[test]
#[ignore = "slow: makes a Python environment, minutes"]
fn everything_in_every_input_is_still_there() {
    for bake in bakes() {
        accepts("checks/preserved.py", &[text(&bake.fixture.file), text(&bake.gltf)]);
    }
}

#[test]
#[ignore = "slow: makes a Python environment, minutes"]
fn many_small_pages_pass_every_check() {
    let out = folder("small_pages");
    let baked = bake(&fixture("office"), &out, &["--preset", "preview", "--page-size", "64", "--gather", "0"]);
    assert!(baked.pages.len() > 1, "64² texels should not be enough for the office");
    accepts("checks/validate.py", &["--input", text(&baked.fixture.file), text(&baked.gltf)]);
    accepts("checks/exr.py", &baked.pages.iter().map(|p| text(p)).collect::<Vec<_>>());
    accepts("checks/preserved.py", &[text(&baked.fixture.file), text(&baked.gltf)]);
}

/// Every fixture, baked to its vertices with everything that can be asked for.
#[test]
#[ignore = "slow: makes a Python environment, minutes"]
fn vertex_bakes_are_valid_lose_nothing_and_arrive_in_blender() {
    let out = folder("vertices");
    let mut documents = vec![];
    for fixture in fixtures() {
        let plain = bake_to_vertices(&fixture, &out.join("plain"), &[]);
        accepts("checks/preserved.py", &[text(&fixture.file), text(&plain)]);
        let all = ["--vertex-attribute", "both", "--unlit", "--subdivide", "0.3"];
        let all = bake_to_vertices(&fixture, &out.join("all"), &all);
        accepts("checks/validate.py", &["--input", text(&fixture.file), text(&plain), text(&all)]);
        documents.extend([plain, all]);
    }
    // Blender 5.0's importer stumbles over the animation pointers of the primitives.
    let importable = documents.iter().filter(|d| !d.ends_with("primitives.gltf"));
    accepts("checks/vertex_light.py", &importable.map(|d| text(d)).collect::<Vec<_>>());
    let cornell = text(&fixture("cornell").file).to_owned();
    rejects("checks/vertex_light.py", &[&cornell], "do not arrive");
}

fn bake_to_vertices(fixture: &crosscheck_env::Fixture, folder: &Path, options: &[&str]) -> PathBuf {
    let document = folder.join(fixture.file.file_name().unwrap());
    let common = ["--target", "vertex", "--preset", "preview", "--texels-per-meter", COARSE, "--gather", "4", "-q"];
    let mut arguments = vec!["bake", text(&fixture.file), "-o", text(&document)];
    arguments.extend(common.iter().chain(options));
    arguments.extend(fixture.options.iter().map(String::as_str));
    let done = crosscheck_env::texelwalk(&arguments);
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    document
}

#[test]
#[ignore = "slow: makes a Python environment, minutes"]
fn preservation_check_rejects_every_kind_of_loss() {
    let out = folder("preserved_rejects");
    let original = r#"{"asset": {"version": "2.0", "generator": "hand"}, "scenes": [{"nodes": [0], "extras": {"a": 1.50}}],
        "nodes": [{"mesh": 0, "name": "n"}], "custom": {"x": [1e5, "ü"]},
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]},
                      {"bufferView": 1, "componentType": 5121, "count": 3, "type": "SCALAR"}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 3}],
        "buffers": [{"byteLength": 39, "uri": "b.bin"}]}"#;
    let mut bytes: Vec<u8> =
        [0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0].iter().flat_map(|x| x.to_le_bytes()).collect();
    bytes.extend([0, 1, 2]);
    fs::write(out.join("b.bin"), &bytes).unwrap();
    bytes[38] = 1;
    fs::write(out.join("c.bin"), &bytes).unwrap();
    let input = out.join("input.gltf");
    fs::write(&input, original).unwrap();
    accepts("checks/preserved.py", &[text(&input), text(&input)]);
    let losses = [
        ("1.50", "1.5", "/scenes/0/extras/a: number 1.50 became 1.5"),
        (r#", "name": "n""#, "", "/nodes/0/name: is gone"),
        ("1e5", "100000.0", "/custom/x/0"),
        (r#""generator": "hand""#, r#""generator": "other""#, "/asset/generator"),
        (r#"{"mesh": 0, "name": "n"}"#, r#"{"name": "n", "mesh": 0}"#, "order of the keys"),
        ("b.bin", "c.bin", "a corner of a triangle"),
        (r#""custom""#, r#""other""#, "/custom: is gone"),
        (r#""indices": 1"#, r#""indices": 1, "mode": 1"#, "/mode"),
    ];
    for (from, to, why) in losses {
        let output = out.join("output.gltf");
        assert!(original.contains(from));
        fs::write(&output, original.replacen(from, to, 1)).unwrap();
        rejects("checks/preserved.py", &[text(&input), text(&output)], why);
    }
}

/// Bakes a fixture at about `texels` texels, and lets Cycles bake it again on our texture coordinates.
///
/// Where solids touch and shadows end, texels must be small beside them for the two to agree; each costs Cycles 128 × samples
/// paths (about 50,000 a second on one core).
fn agrees_with_cycles(name: &str, preset: &str, texels: f64, options: &[&str]) {
    let out = folder(&format!("cycles_{name}"));
    let fixture = fixture(name);
    let density = density(&fixture, texels);
    let baked = bake(&fixture, &out, &["--preset", preset, "--texels-per-meter", &density]);
    let pictures = out.join("pictures");
    let mut arguments = vec![text(&baked.gltf), "--pictures", text(&pictures)];
    arguments.extend(options);
    arguments.extend(fixture.options.iter().map(String::as_str));
    accepts("checks/parity.py", &arguments);
}

#[test]
#[ignore = "slow: Cycles on the CPU, minutes"]
fn cornell_agrees_with_cycles() {
    agrees_with_cycles("cornell", "final", 20_000.0, &["--samples", "1"]);
}

#[test]
#[ignore = "slow: Cycles on the CPU, minutes"]
fn office_agrees_with_cycles() {
    agrees_with_cycles("office", "final", 15_000.0, &["--samples", "2"]);
}

#[test]
#[ignore = "slow: Cycles on the CPU, minutes"]
fn courtyard_agrees_with_cycles() {
    agrees_with_cycles("courtyard", "final", 30_000.0, &["--samples", "1"]);
}

/// 78 lights, of which Cycles picks one per path: the noise of a texel is half its value, so tiles are compared.
#[test]
#[ignore = "slow: Cycles on the CPU, minutes"]
fn a_level_made_by_others_agrees_with_cycles() {
    agrees_with_cycles("freedoom", "production", 40_000.0, &["--grid", "4", "--samples", "2", "--tile", "16"]);
}

#[test]
#[ignore = "slow: Cycles on the CPU, minutes"]
fn parity_check_rejects_a_lightmap_that_is_five_percent_too_bright() {
    let out = folder("cycles_rejects");
    let fixture = fixture("cornell");
    let density = density(&fixture, 2_000.0);
    let baked = bake(&fixture, &out, &["--preset", "production", "--texels-per-meter", &density]);
    for page in &baked.pages {
        brighten(page, 1.05);
    }
    rejects("checks/parity.py", &[text(&baked.gltf), "--samples", "1"], "mean ratio");
}
