//! `--usd`: layers that OpenUSD opens, and that hold what the baked glTF holds.
//!
//! The slow tests run `pipelines/checks/usd.py` on bakes to pages and to vertices, and on altered copies of them, which it
//! has to reject. They need the Python environment of the cross-checks.
#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "tests")]

#[path = "support/crosscheck_env.rs"]
mod crosscheck_env;

use crosscheck_env::{accepts, fixture, folder, rejects, texelwalk, text};
use std::fs;
use std::path::{Path, PathBuf};

/// Light that is quick to find; it need not be right here.
const QUICK: [&str; 8] = ["--preset", "preview", "--gather", "0", "--lines", "20000", "--sky", "0.4"];

/// Bakes a fixture with layers in a folder below that of the glTF, so that paths have to go up; both documents.
fn bake(name: &str, out: &Path, options: &[&str]) -> (PathBuf, PathBuf) {
    let input = fixture(name).file;
    let (gltf, stage) = (out.join(input.file_name().unwrap()), out.join("usd/stage.usda"));
    let mut arguments = vec!["bake", text(&input), "-o", text(&gltf), "--usd", text(&stage), "-q"];
    arguments.extend(QUICK);
    arguments.extend(options);
    let done = texelwalk(&arguments);
    assert!(done.status.success(), "{name}: {}", String::from_utf8_lossy(&done.stderr));
    (gltf, stage)
}

/// The check accepts a bake of each fixture.
fn composes(test: &str, fixtures: &[&str], options: &[&str]) {
    let out = folder(test);
    for name in fixtures {
        let (gltf, stage) = bake(name, &out.join(name), options);
        accepts("checks/usd.py", &[text(&gltf), text(&stage)]);
    }
}

#[test]
#[ignore = "slow: makes a Python environment, minutes"]
fn lightmaps_compose_over_the_geometry() {
    composes("usd_pages", &["cornell", "office", "chairs", "primitives", "courtyard"], &[]);
}

#[test]
#[ignore = "slow: makes a Python environment, minutes"]
fn faces_on_several_pages_are_subsets() {
    let out = folder("usd_subsets");
    let (gltf, stage) = bake("office", &out, &["--page-size", "64", "--quantity", "irradiance"]);
    assert!(fs::read_to_string(stage.with_file_name("stage.lightmap.usda")).unwrap().contains("def GeomSubset"));
    accepts("checks/usd.py", &[text(&gltf), text(&stage)]);
}

#[test]
#[ignore = "slow: makes a Python environment, minutes"]
fn light_at_vertices_composes_over_the_geometry() {
    composes("usd_vertices", &["office", "primitives"], &["--target", "vertex"]);
    composes("usd_refined", &["office", "primitives"], &["--target", "vertex", "--subdivide", "0.05"]);
    let bytes = |test: &str| {
        let layer = crosscheck_env::root().join("target/crosscheck").join(test).join("office/usd/stage.geometry.usda");
        fs::metadata(layer).unwrap().len()
    };
    assert!(bytes("usd_refined") > bytes("usd_vertices"), "nothing was cut");
}

/// Copies a bake, changes one layer of it, and expects a complaint.
fn complains(out: &Path, bake: &(PathBuf, PathBuf), layer: &str, change: &dyn Fn(&str) -> String, why: &str) {
    let path = bake.1.with_file_name(layer);
    let text_before = fs::read_to_string(&path).unwrap();
    let text_after = change(&text_before);
    assert_ne!(text_before, text_after, "nothing was changed in {}", path.display());
    fs::write(&path, text_after).unwrap();
    rejects("checks/usd.py", &[text(&bake.0), text(&bake.1)], why);
    fs::write(&path, text_before).unwrap();
    eprintln!("{}: rejected ({why})", out.display());
}

/// Puts `value` in place of the first number after `marker`.
fn with_number(layer: &str, marker: &str, value: &str) -> String {
    let start = layer.find(marker).unwrap() + marker.len();
    let start = start + layer[start..].find('(').unwrap() + 1;
    let end = start + layer[start..].find(',').unwrap();
    format!("{}{value}{}", &layer[..start], &layer[end..])
}

#[test]
#[ignore = "slow: makes a Python environment, minutes"]
fn altered_layers_are_rejected() {
    let out = folder("usd_rejects");
    let bake = bake("cornell", &out, &[]);
    let (lightmap, geometry) = ("stage.lightmap.usda", "stage.geometry.usda");
    let swap = |from: &'static str, to: &'static str| move |layer: &str| layer.replacen(from, to, 1);
    complains(&out, &bake, lightmap, &swap("varname = \"st1\"", "varname = \"st7\""), "no primvar st7");
    complains(&out, &bake, lightmap, &swap("lightmap0.exr", "lightmap7.exr"), "which does not exist");
    complains(&out, &bake, lightmap, &swap("over \"Floor_0\"", "over \"Floor_7\""), "which the geometry lacks");
    complains(
        &out,
        &bake,
        lightmap,
        &swap("interpolation = \"faceVarying\"", "interpolation = \"vertex\""),
        "values, not",
    );
    complains(&out, &bake, lightmap, &swap("</World/Materials/", "</World/Other/"), "inherits no material");
    complains(&out, &bake, lightmap, &swap("UsdUVTexture", "NoSuchTexture"), "MissingShaderIdInRegistry");
    complains(&out, &bake, lightmap, &|l| with_number(l, "primvars:st1 = [", "0.5"), "differ in lightmap");
    complains(&out, &bake, lightmap, &swap("prepend apiSchemas", "delete apiSchemas"), "MissingMaterialBindingAPI");
    complains(&out, &bake, geometry, &|l| with_number(l, "points = [", "9"), "differ in position");
    complains(&out, &bake, "stage.usda", &swap("@./stage.geometry.usda@", "@./gone.usda@"), "gone.usda");
    complains(&out, &bake, "stage.usda", &|l| l.replace("Lightmap.outputs:rgb", "None"), "shows no light");
}

#[test]
#[ignore = "slow: makes a Python environment, minutes"]
fn altered_light_at_vertices_is_rejected() {
    let out = folder("usd_vertex_rejects");
    let bake = bake("cornell", &out, &["--target", "vertex"]);
    let layer = "stage.lightmap.usda";
    complains(&out, &bake, layer, &|l| with_number(l, "primvars:texelwalk:light = [", "0.125"), "differ in light");
    complains(&out, &bake, layer, &|l| with_number(l, "primvars:displayColor = [", "0.125"), "differ in color");
}

#[test]
fn layers_have_the_same_bytes_at_any_thread_count() {
    let home = tempfile::tempdir().unwrap();
    let files = |threads: &str| {
        let (_, stage) = bake("cornell", &home.path().join(threads), &["--threads", threads]);
        ["stage.usda", "stage.lightmap.usda", "stage.geometry.usda"].map(|n| fs::read(stage.with_file_name(n)).unwrap())
    };
    assert_eq!(files("1"), files("3"));
}

#[test]
fn names_that_cannot_be_are_refused() {
    let home = tempfile::tempdir().unwrap();
    let input = fixture("cornell").file;
    let refused = |usd: &str, more: &[&str]| {
        let (gltf, usd) = (home.path().join("a.gltf"), home.path().join(usd));
        let mut arguments = vec!["bake", text(&input), "-o", text(&gltf), "--usd", text(&usd), "-q"];
        arguments.extend(QUICK);
        arguments.extend(more);
        let done = texelwalk(&arguments);
        assert_eq!(fs::read_dir(home.path()).unwrap().count(), 0, "something was written");
        (done.status.code().unwrap(), String::from_utf8_lossy(&done.stderr).into_owned())
    };
    for name in ["a.usd", "a.usdc", "a", ".usda"] {
        let (code, said) = refused(name, &[]);
        assert!(code == 2 && said.contains(".usda"), "{name}: {code} {said}");
    }
    let (code, said) = refused("a.usda", &["--format", "png"]);
    assert!(code == 2 && said.contains("exr"), "{code} {said}");
    let clash = home.path().join("a.geometry.usda");
    let (code, said) = refused("a.usda", &["--report", text(&clash)]);
    assert!(code == 3 && said.contains("two outputs"), "{code} {said}");
}
