//! Files of a bake to vertices: what is added, what stays, and what cut triangles take with them.

#![allow(clippy::expect_used, reason = "tests")]

use glam::{Vec3, Vec4};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::Command;
use texelwalk::scene::{self, Part, Scene};

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures").join(name)
}

/// A cheap bake to vertices; the written document, and standard error.
fn bake(input: &Path, folder: &Path, options: &[&str]) -> (PathBuf, String) {
    let quick =
        ["--preset", "preview", "--gather", "4", "--lines-per-texel", "8", "--sky", "0.3", "--target", "vertex"];
    let out = Command::new(env!("CARGO_BIN_EXE_texelwalk"))
        .arg("bake")
        .arg(input)
        .arg("-o")
        .arg(folder.join(input.file_name().unwrap()))
        .args(quick)
        .args(options)
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&out.stderr).into_owned();
    assert!(out.status.success(), "{said}");
    (folder.join(input.file_name().unwrap()), said)
}

fn load(path: &Path) -> Scene {
    scene::load(path, &scene::Settings::default()).unwrap().output
}

/// Parts of two scenes that come from the same node and primitive.
fn pairs<'a>(a: &'a Scene, b: &'a Scene) -> Vec<(&'a Part, &'a Part)> {
    assert_eq!(a.parts.len(), b.parts.len());
    let same = |p: &&Part, q: &&Part| (p.node, p.primitive) == (q.node, q.primitive);
    a.parts.iter().map(|p| (p, b.parts.iter().find(|q| same(&p, q)).unwrap())).collect()
}

fn json(scene: &Scene) -> Value {
    serde_json::from_str(&scene.document.json).unwrap()
}

fn primitive<'a>(json: &'a Value, part: &Part) -> &'a Value {
    &json["meshes"][part.mesh]["primitives"][part.primitive]
}

/// `_LIGHTMAP` of a part.
fn light(scene: &Scene, json: &Value, part: &Part) -> Vec<Vec3> {
    let accessor = primitive(json, part)["attributes"]["_LIGHTMAP"].as_u64().unwrap();
    let data = scene.document.accessor(accessor as usize).unwrap();
    assert_eq!((data.component_type, data.components), (5126, 3));
    let floats: Vec<f32> = data.bytes.chunks(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect();
    floats.chunks(3).map(Vec3::from_slice).collect()
}

/// `COLOR_0` of a part as it is stored.
fn colors(scene: &Scene, json: &Value, part: &Part) -> Vec<Vec4> {
    let accessor = primitive(json, part)["attributes"]["COLOR_0"].as_u64().unwrap();
    let data = scene.document.accessor(accessor as usize).unwrap();
    assert_eq!((data.component_type, data.components, data.normalized), (5123, 4, true));
    data.to_f32().chunks(4).map(Vec4::from_slice).collect()
}

/// Exit code and standard error.
fn run(words: &[&str]) -> (Option<i32>, String) {
    let out = Command::new(env!("CARGO_BIN_EXE_texelwalk")).args(words).output().unwrap();
    (out.status.code(), String::from_utf8_lossy(&out.stderr).into_owned())
}

#[test]
fn light_in_vertex_colors_is_no_albedo_of_the_next_bake() {
    let input = fixture("cornell/cornell.gltf");
    let home = tempfile::tempdir().unwrap();
    let folder = |name: &str| home.path().join(name);
    for attribute in ["color0", "both"] {
        let options = ["--vertex-attribute", attribute, "--texels-per-meter", "8"];
        let (first, _) = bake(&input, &folder(attribute), &options);
        let (again, _) = bake(&first, &folder(&format!("{attribute}-again")), &options);
        let [a, b] = [&first, &again].map(|path| load(path));
        let [old, new] = [&a, &b].map(json);
        let color = |document: &Value| document["scenes"][0]["extras"]["lightmap"]["color"].clone();
        assert_eq!(color(&old)["white"], true);
        assert_eq!(color(&old), color(&new));
        for (p, q) in pairs(&a, &b).into_iter().filter(|(p, _)| p.receives) {
            assert!(colors(&a, &old, p) == colors(&b, &new, q), "{attribute}: {}", p.name);
        }
        // Nothing of it stays beside pages.
        let pages = folder(&format!("{attribute}-pages.gltf"));
        let words = ["--preset", "preview", "--texels-per-meter", "8", "--gather", "1"];
        let words = [&["bake", first.to_str().unwrap(), "-o", pages.to_str().unwrap()], words.as_slice()].concat();
        let (code, said) = run(&words);
        assert_eq!(code, Some(0), "{said}");
        let meshes = json(&load(&pages))["meshes"].to_string();
        assert!(!meshes.contains("COLOR_0") && !meshes.contains("_LIGHTMAP") && meshes.contains("TEXCOORD_1"));
        // Without the word of the manifest nobody knows.
        let text = std::fs::read_to_string(&first).unwrap();
        std::fs::write(&first, text.replace(", \"white\": true", "")).unwrap();
        let (code, said) = run(&["bake", first.to_str().unwrap(), "-o", folder("never").to_str().unwrap()]);
        assert!(code == Some(3) && said.contains("bake from the source"), "{code:?} {said}");
    }
    // Colours that there were are not known any more.
    let (colored, _) = bake(&fixture("primitives/primitives.gltf"), &folder("c"), &["--vertex-attribute", "color0"]);
    assert_eq!(json(&load(&colored))["scenes"][0]["extras"]["lightmap"]["color"]["white"], false);
    for words in [
        ["bake", colored.to_str().unwrap(), "-o", home.path().to_str().unwrap()].as_slice(),
        &["inspect", colored.to_str().unwrap()],
    ] {
        let (code, said) = run(words);
        assert!(
            code == Some(3) && said.contains("COLOR_0") && said.contains("bake from the source"),
            "{code:?} {said}"
        );
    }
}

#[test]
fn light_in_vertex_colors_is_drawn_once() {
    let home = tempfile::tempdir().unwrap();
    let picture = |name: &str, input: &Path, options: &[&str]| {
        let options = [&["--texels-per-meter", "8"], options].concat();
        let (path, _) = bake(input, &home.path().join(name), &options);
        let out = home.path().join(format!("{name}.exr"));
        let size = ["--width", "64", "--height", "48", "--samples", "4"];
        let words = [&["render", path.to_str().unwrap(), "-o", out.to_str().unwrap()], size.as_slice()].concat();
        let (code, said) = run(&words);
        assert_eq!(code, Some(0), "{name}: {said}");
        texelwalk::output::exr::read_rgba(&out).unwrap().pixels
    };
    let mean = |pixels: &[[f32; 4]]| pixels.iter().map(|p| p[0] + p[1] + p[2]).sum::<f32>() / pixels.len() as f32;
    let white = fixture("cornell/cornell.gltf");
    let exact = picture("exact", &white, &[]);
    for (name, options) in [("color0", &[][..]), ("both", &[]), ("color0", &["--unlit"])] {
        let found = picture(name, &white, &[&["--vertex-attribute", name], options].concat());
        let worst = exact.iter().zip(&found).flat_map(|(a, b)| (0..3).map(move |c| (a[c] - b[c]).abs()));
        let worst = worst.fold(0.0, f32::max);
        assert!(worst < 1e-3 * mean(&exact), "{name} {options:?}: {worst} of {}", mean(&exact));
    }
    // With colours, their products with light are interpolated instead of each by itself.
    let colored = fixture("primitives/primitives.gltf");
    let exact = mean(&picture("exact", &colored, &[]));
    for name in ["color0", "both"] {
        let found = mean(&picture(name, &colored, &["--vertex-attribute", name]));
        assert!((found / exact - 1.0).abs() < 0.01, "{name}: {found} of {exact}");
    }
}

#[test]
fn attributes_are_added_and_nothing_else_changes() {
    let (home, input) = (tempfile::tempdir().unwrap(), fixture("primitives/primitives.gltf"));
    let (path, _) = bake(&input, home.path(), &["--vertex-attribute", "both", "--unlit"]);
    let (before, after) = (load(&input), load(&path));
    let (old, new) = (json(&before), json(&after));
    let manifest = &new["scenes"][0]["extras"]["lightmap"];
    assert_eq!((&manifest["quantity"], &manifest["attribute"]), (&"radiosity".into(), &"_LIGHTMAP".into()));
    let scale = manifest["color"]["scale"].as_f64().unwrap() as f32;
    let (mut lit, mut brightest, mut colored) = (0, 0.0f32, 0);
    for (a, b) in pairs(&before, &after) {
        let (p, q) = (primitive(&old, a), primitive(&new, b));
        for key in ["indices", "mode", "targets"] {
            assert_eq!(p[key], q[key], "{key} of {}", a.name);
        }
        for (name, accessor) in p["attributes"].as_object().unwrap() {
            assert!(name == "COLOR_0" || q["attributes"][name] == *accessor, "{name} of {}", a.name);
        }
        if !a.receives {
            assert!(q["attributes"]["_LIGHTMAP"].is_null(), "{}", a.name);
            continue;
        }
        lit += 1;
        let (light, colors) = (light(&after, &new, b), colors(&after, &new, b));
        assert_eq!((light.len(), colors.len()), (a.vertices.len(), a.vertices.len()));
        for (k, light) in light.iter().enumerate() {
            let own = before.vertices.color[a.vertices.start as usize + k];
            let shown = colors[k];
            let expected = (own.truncate() * *light / scale).extend(own.w).min(Vec4::ONE);
            assert!((shown - expected).abs().max_element() < 1e-5, "{} {shown} {expected}", a.name);
            brightest = brightest.max((own.truncate() * *light).max_element());
            colored += usize::from(own.truncate() != Vec3::ONE);
        }
        let material = q["material"].as_u64().map(|m| &new["materials"][m as usize]);
        let unlit = material.is_some_and(|m| !m["extensions"]["KHR_materials_unlit"].is_null());
        assert_eq!(unlit, !before.materials[a.material].glows(), "{}", a.name);
    }
    assert!(lit > 8 && colored > 10, "{lit} {colored}");
    assert!((brightest / scale - 1.0).abs() < 1e-6, "{brightest} {scale}");
}

#[test]
fn a_glb_that_is_baked_again_stays_as_large() {
    for options in [&["--vertex-attribute", "both"][..], &["--subdivide", "0.5"]] {
        let home = tempfile::tempdir().unwrap();
        let (mut path, _) = bake(&fixture("office/office.glb"), &home.path().join("0"), options);
        let mut lengths = vec![];
        for i in 1..4 {
            lengths.push(std::fs::metadata(&path).unwrap().len());
            path = bake(&path, &home.path().join(i.to_string()), options).0;
            // Still whole.
            load(&path);
        }
        // But for blanks.
        assert!(lengths.iter().all(|length| length.abs_diff(lengths[0]) < 16), "{options:?}: {lengths:?}");
        assert_eq!(lengths[1], lengths[2], "{options:?}");
    }
}

#[test]
fn a_scale_of_ones_own_clamps_and_says_so() {
    let (home, input) = (tempfile::tempdir().unwrap(), fixture("two-rooms/two-rooms.glb"));
    let options = ["--vertex-attribute", "color0", "--vertex-scale", "0.01"];
    let (path, said) = bake(&input, home.path(), &options);
    assert!(said.contains("vertex-color-clamped") || said.contains("were clamped"), "{said}");
    let document = load(&path).document.json;
    let new: Value = serde_json::from_str(&document).unwrap();
    assert_eq!(new["scenes"][0]["extras"]["lightmap"]["color"]["scale"].as_f64().map(|s| s as f32), Some(0.01));
    assert!(!document.contains("_LIGHTMAP") && !document.contains("KHR_materials_unlit"));
}

#[test]
fn irradiance_is_pi_times_radiosity() {
    let input = fixture("cornell/cornell.gltf");
    let [a, b] = ["radiosity", "irradiance"].map(|quantity| {
        let home = tempfile::tempdir().unwrap();
        let (path, _) = bake(&input, home.path(), &["--quantity", quantity]);
        let scene = load(&path);
        let document = json(&scene);
        scene.parts.iter().filter(|p| p.receives).flat_map(|p| light(&scene, &document, p)).collect::<Vec<_>>()
    });
    assert!(a.len() > 50 && a.iter().any(|v| v.x > 0.1));
    let pi = core::f32::consts::PI;
    assert!(a.iter().zip(&b).all(|(a, b)| (*a * pi - *b).abs().max_element() <= 1e-5 * (1.0 + b.max_element())));
}

/// Area of a part, and part of it whose vertex normals look to the side that its winding says is the front.
fn surface(scene: &Scene, part: &Part) -> (f64, f64) {
    let (mut area, mut agrees) = (0.0, 0.0);
    for t in part.triangles.clone() {
        let [a, b, c] = scene.triangles[t as usize].map(|v| scene.vertices.position[v as usize]);
        let normal: Vec3 = scene.triangles[t as usize].map(|v| scene.vertices.normal[v as usize]).into_iter().sum();
        area += scene.area(t);
        agrees += if (b - a).cross(c - a).dot(normal) > 0.0 { scene.area(t) } else { 0.0 };
    }
    (area, agrees)
}

#[test]
fn cut_triangles_cover_the_same_surface_with_the_same_side_out() {
    for (name, error) in [("primitives/primitives.gltf", "0.03"), ("chairs/chairs.glb", "0.15")] {
        let (home, input) = (tempfile::tempdir().unwrap(), fixture(name));
        let (path, _) = bake(&input, home.path(), &["--subdivide", error]);
        let (before, after) = (load(&input), load(&path));
        let (old, new) = (json(&before), json(&after));
        let mut cut = 0;
        for (a, b) in pairs(&before, &after) {
            let ((area, out), (new_area, new_out)) = (surface(&before, a), surface(&after, b));
            assert!((area - new_area).abs() < 1e-5 * area && (out - new_out).abs() < 1e-5 * area, "{}", a.name);
            let normals = &after.vertices.normal[b.vertices.start as usize..b.vertices.end as usize];
            assert!(normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-3));
            if b.vertices.len() > a.vertices.len() {
                cut += 1;
                let (p, q) = (primitive(&old, a), primitive(&new, b));
                let keys = |v: &Value| v["attributes"].as_object().unwrap().keys().cloned().collect::<Vec<_>>();
                let own: Vec<String> = keys(q).into_iter().filter(|k| k != "_LIGHTMAP").collect();
                assert_eq!(keys(p), own);
                assert_eq!(light(&after, &new, b).len(), b.vertices.len());
            }
        }
        assert!(cut > 2, "{name}: {cut} primitives were cut");
    }
}

#[test]
fn instances_have_light_of_their_own_and_share_the_rest() {
    let (home, input) = (tempfile::tempdir().unwrap(), fixture("chairs/chairs.glb"));
    let (path, _) = bake(&input, home.path(), &[]);
    let scene = load(&path);
    let document = json(&scene);
    let source = load(&input);
    let mut shared = 0;
    for (a, b) in pairs(&source, &scene).into_iter().filter(|(a, _)| a.receives) {
        let twin = pairs(&source, &scene)
            .into_iter()
            .find(|(c, _)| (c.mesh, c.primitive) == (a.mesh, a.primitive) && c.node != a.node);
        let Some((_, other)) = twin else { continue };
        let [p, q] = [b, other].map(|part| &primitive(&document, part)["attributes"]);
        assert_eq!(p["POSITION"], q["POSITION"]);
        assert_ne!(p["_LIGHTMAP"], q["_LIGHTMAP"]);
        shared += 1;
    }
    assert!(shared > 4, "{shared}");
}

#[test]
fn the_same_bytes_at_any_number_of_threads_and_a_picture_of_them() {
    let input = fixture("two-rooms/two-rooms.glb");
    let home = tempfile::tempdir().unwrap();
    let written = ["1", "3"].map(|threads| {
        let folder = home.path().join(threads);
        let (path, _) = bake(&input, &folder, &["--threads", threads, "--subdivide", "0.2"]);
        std::fs::read(path).unwrap()
    });
    assert!(written[0] == written[1]);
    let picture = home.path().join("view.exr");
    let baked = home.path().join("1/two-rooms.glb");
    let size = ["--width", "48", "--height", "32", "--samples", "4"];
    let done = Command::new(env!("CARGO_BIN_EXE_texelwalk"))
        .args([&["render", baked.to_str().unwrap(), "-o", picture.to_str().unwrap()], size.as_slice()].concat())
        .output()
        .unwrap();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let image = texelwalk::output::exr::read_rgba(&picture).unwrap();
    assert!(image.pixels.iter().any(|p| p[0] > 0.05));
}
