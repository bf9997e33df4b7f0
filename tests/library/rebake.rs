//! What was baked is baked again: its layout is kept, on texels of the same shape, and pages of the same size.

use crate::quads::{Baked, Quad, Scene, bake_file, bake_fixture, grey};
use glam::Vec3;
use serde_json::Value;
use std::fs;
use std::path::Path;

const OPTIONS: [&str; 8] = ["--texels-per-meter", "10", "--gather", "2", "--lines", "1000", "--aov", "position"];

/// Mean distances from texels to the ones on their right and below [m].
fn steps(baked: &Baked) -> [f32; 2] {
    let page = baked.page("lightmap0.exr");
    let width = baked.width("lightmap0.exr");
    let [x, y, z] = ["position.X", "position.Y", "position.Z"].map(|name| baked.layer(name));
    let at = |i: usize| Vec3::new(x[i], y[i], z[i]);
    [1, width].map(|step| {
        let both = |i: &usize| page[*i][3] > 0.0 && page[i + step][3] > 0.0 && (i + step) % width >= i % width;
        let pairs = (0..page.len() - step).filter(both);
        let distances: Vec<f32> = pairs.map(|i| at(i).distance(at(i + step))).collect();
        assert!(distances.len() > 500);
        distances.iter().sum::<f32>() / distances.len() as f32
    })
}

#[test]
fn texels_of_a_page_that_is_not_square_stay_square() {
    let long = Quad::new([0.0; 3], [0.0, 0.0, 1.5], [12.0, 0.0, 0.0], grey(0.5));
    let first = Scene { quads: vec![long], lights: vec![] }.bake(&OPTIONS);
    let again = bake_file(&first.path("out.gltf"), &[&OPTIONS[..], &["--uv", "keep"]].concat());
    let pages = [&first, &again].map(|baked| baked.report["atlas"].clone());
    assert_eq!(pages[0]["texels"], pages[1]["texels"]);
    let [wide, high] = [0, 1].map(|k| pages[0]["page_size"][k].as_f64().unwrap());
    assert!((wide / high).ln().abs() > 1.0, "{wide} × {high}: the first page is long");
    for step in [steps(&first), steps(&again)].as_flattened() {
        assert!((step - 0.1).abs() < 1e-3, "{step} m from texel to texel");
    }
}

/// Bakes a fixture, and what came of it, with `options`; both have the same pages.
fn stays(name: &str, options: &[&str]) -> [Baked; 2] {
    let options = [&["--gather", "2", "--lines", "1000", "--aov", "position"], options].concat();
    let first = bake_fixture(name, &options);
    let again = bake_file(&first.path("out.gltf"), &options);
    assert_eq!(first.report["atlas"], again.report["atlas"], "{name} {options:?}");
    for page in 0..first.report["atlas"]["pages"].as_u64().unwrap() {
        let page = format!("lightmap{page}.exr");
        let [before, after] = [&first, &again].map(|baked| baked.page(&page));
        assert!(before.iter().zip(&after).all(|(a, b)| (a[3] > 0.0) == (b[3] > 0.0)), "{page} of {name}");
    }
    [first, again]
}

#[test]
fn a_scene_keeps_its_pages_and_their_mip_levels() {
    for options in [&["--texels-per-meter", "6"][..], &["--texels-per-meter", "6", "--mips", "3", "--padding", "6"]] {
        let [first, again] = stays("office/office.glb", options);
        let [before, after] =
            [&first, &again].map(|baked| ["X", "Y", "Z"].map(|c| baked.layer(&format!("position.{c}"))));
        let covered = first.page("lightmap0.exr");
        for (i, texel) in covered.iter().enumerate().filter(|(_, texel)| texel[3] > 0.0) {
            let moved = (0..3).map(|k| (before[k][i] - after[k][i]).abs()).fold(0.0, f32::max);
            assert!(moved < 1e-3, "{moved} m at texel {i}, {texel:?}");
        }
        assert!(
            first.names().contains(&"out.lightmap.bin".into()) && !again.names().contains(&"out.lightmap.bin".into())
        );
    }
}

#[test]
fn a_scene_of_several_pages_keeps_each_of_them() {
    let several = &["--texels-per-meter", "6", "--page-size", "96"];
    let [first, _] = stays("office/office.glb", several);
    assert!(first.report["atlas"]["pages"].as_u64() > Some(1));
    // On fewer pages than the density needs.
    stays("office/office.glb", &["--texels-per-meter", "16", "--page-size", "256", "--max-pages", "2", "--mips", "2"]);
}

/// How many samplers, images and textures a document has.
fn counts(document: &Value) -> [usize; 3] {
    ["samplers", "images", "textures"].map(|key| document[key].as_array().map_or(0, Vec::len))
}

/// The document of a GLB or glTF.
fn document(path: &Path) -> Value {
    let scene = texelwalk::scene::load(path, &texelwalk::scene::Settings::default()).unwrap().output;
    serde_json::from_str(&scene.document.json).unwrap()
}

#[test]
fn bakes_in_a_row_leave_one_lightmap_and_the_same_paths() {
    let mut bakes = vec![bake_fixture("cornell/cornell.gltf", &OPTIONS)];
    for _ in 0..3 {
        bakes.push(bake_file(&bakes[bakes.len() - 1].path("out.gltf"), &OPTIONS));
    }
    let documents: Vec<Value> = bakes.iter().map(Baked::document).collect();
    for document in &documents {
        assert_eq!(counts(document), [1, 1, 1]);
        assert_eq!(document["textures"][0]["extras"]["lightmap"]["uri"], "out.lightmap0.exr");
        assert_eq!(document["buffers"][0]["uri"], documents[0]["buffers"][0]["uri"]);
    }
    assert!(documents[0]["buffers"][0]["uri"].as_str().unwrap().starts_with("../"));

    // Fewer pages than before, beside pictures of the document's own.
    let source = counts(&document(&Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/office/office.glb")));
    let several = ["--gather", "1", "--lines", "1000", "--texels-per-meter", "6", "--page-size", "96"];
    let first = bake_fixture("office/office.glb", &several);
    let pages = first.report["atlas"]["pages"].as_u64().unwrap() as usize;
    assert!(pages > 1);
    assert_eq!(counts(&first.document()), [source[0] + 1, source[1] + pages, source[2] + pages]);
    let one = bake_file(&first.path("out.gltf"), &[&several[..6], &["--uv", "generate"]].concat());
    assert_eq!(counts(&one.document()), source.map(|n| n + 1));
}

#[test]
fn light_at_vertices_takes_the_lightmap_away() {
    let first = bake_fixture("cornell/cornell.gltf", &OPTIONS);
    let again = bake_file(&first.path("out.gltf"), &[&OPTIONS[..6], &["--target", "vertex"]].concat());
    assert!(first.document()["materials"].to_string().contains("MOZ_lightmap"));
    let document = again.document();
    assert!(!document["materials"].to_string().contains("MOZ_lightmap"), "{}", document["materials"]);
    assert!(document["meshes"].to_string().contains("_LIGHTMAP"));
    for key in ["samplers", "images", "textures"] {
        assert!(document[key].is_null(), "{key}");
    }
    let mut materials = first.document()["materials"].clone();
    for material in materials.as_array_mut().unwrap() {
        let material = material.as_object_mut().unwrap();
        let others = material.get_mut("extensions").and_then(Value::as_object_mut);
        if others.is_some_and(|e| e.remove("MOZ_lightmap").is_some() && e.is_empty()) {
            material.remove("extensions");
        }
    }
    assert_eq!(document["materials"], materials, "nothing else of them goes");
}

#[test]
fn bakes_in_a_row_leave_the_light_of_one_at_vertices() {
    let sizes = |document: &Value| {
        let length = |key: &str| document[key].as_array().map_or(0, Vec::len);
        let bytes = document["buffers"].as_array().unwrap().iter().map(|b| b["byteLength"].as_u64().unwrap()).sum();
        (["accessors", "bufferViews", "buffers", "meshes"].map(length), bytes)
    };
    let vertex =
        |more: &[&'static str]| [&OPTIONS[..6], &["--target", "vertex", "--vertex-attribute", "both"], more].concat();
    for options in [vertex(&[]), vertex(&["--subdivide", "0.05"])] {
        let first = bake_fixture("cornell/cornell.gltf", &options);
        let mut bakes = vec![first];
        for k in 0..3 {
            bakes.push(bake_file(&bakes[k].path("out.gltf"), &options));
        }
        let documents: Vec<Value> = bakes.iter().map(Baked::document).collect();
        // Vertices that cuts added stay in the file of the first bake, of which only the light is not needed any more.
        let [mut first, second] = [&documents[0], &documents[1]].map(|d| sizes(d).0);
        first[2] += usize::from(second[2] > first[2] && options.contains(&"--subdivide"));
        assert_eq!(second, first, "{options:?}");
        for pair in documents[1..].windows(2) {
            assert_eq!(sizes(&pair[1]), sizes(&pair[0]), "{options:?}");
            assert_eq!(pair[1]["meshes"], pair[0]["meshes"], "{options:?}");
        }
    }
    // In turns with lightmaps, whose coordinates stay.
    let mut of_turns: Vec<(_, u64)> = vec![];
    let mut bakes = vec![bake_fixture("cornell/cornell.gltf", &vertex(&[]))];
    for k in 0..6 {
        let options = if k % 2 == 0 { OPTIONS.to_vec() } else { vertex(&[]) };
        bakes.push(bake_file(&bakes[k].path("out.gltf"), &options));
        of_turns.push(sizes(&bakes[k + 1].document()));
    }
    assert_eq!(of_turns[2..4], of_turns[4..]);
    assert_eq!(of_turns[..2], of_turns[2..4]);
}

#[test]
fn other_scenes_find_their_pages_from_another_folder() {
    let floor = |y: f32| Quad::new([0.0, y, 0.0], [0.0, 0.0, 2.0], [2.0, 0.0, 0.0], grey(0.5));
    let bulb = |candela: f32| serde_json::json!({"type": "point", "intensity": candela});
    let two = Scene { quads: vec![floor(0.0), floor(1.0)], lights: vec![] };
    let two =
        two.with(bulb(30.0), Vec3::new(1.0, 2.5, 1.0), Vec3::Y).with(bulb(90.0), Vec3::new(1.0, 2.5, 1.0), Vec3::Y);
    let mut document = two.document();
    document["scenes"] = serde_json::json!([{"nodes": [0, 2]}, {"nodes": [1, 3]}]);
    let home = tempfile::tempdir().unwrap();
    let input = home.path().join("in.gltf");
    fs::write(&input, document.to_string()).unwrap();
    let more = ["--format", "exr,png", "--directional", "sh"];
    let of_scene = |scene: &'static str| [&OPTIONS[..6], &more, &["--scene", scene]].concat();
    let first = bake_file(&input, &of_scene("0"));
    let both = bake_file(&first.path("out.gltf"), &of_scene("1"));
    let pictures = [(&first, "0"), (&both, "0"), (&both, "1")].map(|(baked, scene)| {
        let (gltf, out) = (baked.path("out.gltf"), home.path().join("view.exr"));
        let words = ["--scene", scene, "--auto", "--width", "32", "--height", "32", "--samples", "1"];
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_texelwalk"));
        let done = command.arg("render").arg(gltf).arg("-o").arg(&out).args(words).output().unwrap();
        assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
        texelwalk::output::exr::read_rgba(&out).unwrap().pixels
    });
    assert!(pictures[0] == pictures[1] && pictures[0] != pictures[2]);
    let document = both.document();
    let folder = first.path("").parent().unwrap().file_name().unwrap().to_str().unwrap().to_owned();
    let own = document["scenes"][0]["extras"]["lightmap"]["pages"][0].clone();
    let texture = own["texture"].as_u64().unwrap() as usize;
    for place in [own, document["textures"][texture]["extras"]["lightmap"].clone()] {
        let uris = [&place["uri"], &place["files"][1]["uri"], &place["directional"]["l1z"]];
        for uri in uris.map(|uri| uri.as_str().unwrap().to_owned()) {
            assert!(uri.starts_with(&format!("../../{folder}/baked/out.lightmap0.")), "{uri}");
            assert!(both.path("").join(&uri).is_file(), "{uri}");
        }
        assert_eq!(place["directional"]["mode"], "sh");
    }
    assert_eq!(document["scenes"][1]["extras"]["lightmap"]["pages"][0]["uri"], "out.lightmap0.exr");
}

#[test]
fn objects_of_other_densities_stay_on_the_page() {
    let home = tempfile::tempdir().unwrap();
    let rules = home.path().join("rules.toml");
    let of = |node: &str, factor: f64| format!("[[rules]]\nnodes = [\"{node}\"]\ndensity = {factor:?}\n");
    fs::write(&rules, of("Floor", 2.0) + &of("Desk*", 0.5)).unwrap();
    stays("office/office.glb", &["--texels-per-meter", "6", "--config", rules.to_str().unwrap()]);
}
