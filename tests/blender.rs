//! The Blender scripts: `verify.py` judges every fixture, `view.py` shows what `render` shows, the add-on comes and goes.
//!
//! They need the environment of the cross-checks (see `tests/crosscheck.rs`). Sizes are small: exactness at large sizes is
//! the business of `tests/crosscheck.rs`; here the scripts have to be right about any scene, and to notice what is wrong.
#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "tests")]

#[path = "support/crosscheck_env.rs"]
mod crosscheck_env;
#[path = "support/gltf_builder.rs"]
mod gltf_builder;

use crosscheck_env::{
    Bake, Fixture, bake, brighten_where, environment_python, fixture, fixtures, folder, root, texelwalk, text,
};
use glam::Vec2;
use gltf_builder::{Builder, words};
use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use texelwalk::render::Lightmaps;
use texelwalk::scene;

/// About how many texels a fixture gets.
const TEXELS: f64 = 3000.0;
/// Where another density is needed [texels per metre]: walls must be two texels thick; a level of 78 × 108 m has narrow
/// doors.
const DENSITIES: &[(&str, f64)] = &[("two-rooms", 8.0), ("freedoom", 0.7)];
/// Texels of decimetres hide edges of shadows, and what touches is half in the dark: more is allowed than the script would
/// by itself, and still much less than a twentieth of the mean.
const COARSE: [&str; 4] = ["--fail", "0.12", "--mean", "0.02"];
/// More of it. Two rooms: five times the texels, a quarter of the points each. Freedoom: texels of 1.4 m reach around the
/// corners of rooms, and 77 lights make Cycles noisy, so its objects say less one by one.
const OPTIONS: &[(&str, &[&str])] =
    &[("two-rooms", &["--grid", "2", "--samples", "2"]), ("freedoom", &["--object", "0.3"])];

type Page = Vec<Vec<(f32, f32, f32, f32)>>;

/// Exit code and output of a script of `pipelines/blender`.
fn blender(script: &str, arguments: &[&str]) -> (i32, String) {
    let path = root().join("pipelines/blender").join(script);
    let output = Command::new(environment_python()).arg(path).args(arguments).output().unwrap();
    let said = String::from_utf8_lossy(&[output.stdout, output.stderr].concat()).into_owned();
    (output.status.code().unwrap_or(-1), said)
}

/// Runs `verify.py`, which must end with `code` and say all of `words`.
fn verify(arguments: &[&str], code: i32, words: &[&str]) {
    let (found, said) = blender("verify.py", arguments);
    assert_eq!(found, code, "verify.py {}\n{said}", arguments.join(" "));
    assert!(!said.contains("Traceback"), "{said}");
    for word in words {
        assert!(said.contains(word), "verify.py {} does not say {word:?}:\n{said}", arguments.join(" "));
    }
}

/// Texels per metre at which a fixture has about [`TEXELS`] texels: `inspect` knows its area.
fn small(fixture: &Fixture) -> String {
    if let Some((_, density)) = DENSITIES.iter().find(|(name, _)| *name == fixture.name) {
        return density.to_string();
    }
    let output = texelwalk(&["inspect", text(&fixture.file), "--json"]);
    let found: Value = serde_json::from_slice(&output.stdout).unwrap();
    let area: f64 = found["parts"].as_array().unwrap().iter().map(|p| p["area"].as_f64().unwrap()).sum();
    format!("{:.3}", (TEXELS / area).sqrt())
}

fn small_bake(fixture: &Fixture, folder: &Path, options: &[&str]) -> Bake {
    let density = small(fixture);
    bake(fixture, folder, &[&["--texels-per-meter", &density], options].concat())
}

fn read(path: &Path) -> Page {
    let size =
        |s: exr::prelude::Vec2<usize>, _: &_| vec![vec![(0.0f32, 0.0f32, 0.0f32, 0.0f32); s.width()]; s.height()];
    let set =
        |rows: &mut Page, at: exr::prelude::Vec2<usize>, pixel: (f32, f32, f32, f32)| rows[at.y()][at.x()] = pixel;
    exr::prelude::read_first_rgba_layer_from_file(path, size, set).unwrap().layer_data.channel_data.pixels
}

#[test]
#[ignore = "slow: Cycles on the CPU, a minute and a half"]
fn verify_finds_every_fixture_right() {
    let out = folder("verify_fixtures");
    let mut faults = vec![];
    for fixture in fixtures() {
        let stem = fixture.file.file_stem().unwrap().to_string_lossy().into_owned();
        let inside = out.join(&stem);
        fs::create_dir_all(&inside).unwrap();
        let baked = small_bake(&fixture, &inside, &["--gather", "64", "--lines-per-texel", "16"]);
        let picture = inside.join("difference.png");
        let own = OPTIONS.iter().find(|(name, _)| *name == fixture.name).map_or(&[][..], |(_, o)| o);
        let arguments =
            [&[text(&baked.gltf), "--samples", "1", "--difference", text(&picture)][..], &COARSE, own].concat();
        let (code, said) = blender("verify.py", &arguments);
        eprintln!("{stem}: {}", said.lines().find(|l| l.trim_start().starts_with("all ")).unwrap_or("no figures"));
        if code != 0 {
            faults.push(format!("{stem}: exit code {code}\n{said}"));
        }
        assert!(picture.is_file(), "{stem}: no picture\n{said}");
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

/// Whether the centre of each texel of page 0 lies in a triangle of the node.
fn texels_of(gltf: &Path, node: &str, width: usize, height: usize) -> Vec<bool> {
    let scene = scene::load(gltf, &scene::Settings::default()).unwrap().output;
    let lightmaps = Lightmaps::load(&scene).unwrap();
    let part = scene.parts.iter().find(|p| p.name == node).unwrap_or_else(|| panic!("no node {node}"));
    let corners: Vec<[Vec2; 3]> = part.triangles.clone().filter_map(|t| lightmaps.texels(&scene, t)).collect();
    let inside = |p: Vec2, [a, b, c]: &[Vec2; 3]| {
        let side = |from: Vec2, to: Vec2| (to - from).perp_dot(p - from);
        let sides = [side(*a, *b), side(*b, *c), side(*c, *a)];
        sides.iter().all(|s| *s >= 0.0) || sides.iter().all(|s| *s <= 0.0)
    };
    let center = |i: usize| Vec2::new((i % width) as f32 + 0.5, (i / width) as f32 + 0.5);
    (0..width * height).map(|i| corners.iter().any(|t| inside(center(i), t))).collect()
}

#[test]
#[ignore = "slow: Cycles on the CPU, half a minute"]
fn verify_names_what_is_wrong() {
    let out = folder("verify_rejects");
    let cornell = fixture("cornell");
    let fresh = |name: &str, fixture: &Fixture, options: &[&str]| {
        let inside = out.join(name);
        fs::create_dir_all(&inside).unwrap();
        small_bake(fixture, &inside, options)
    };
    let all = fresh("all", &cornell, &[]);
    brighten_where(&all.pages[0], 1.05, |_, _| true);
    verify(&[text(&all.gltf), "--samples", "1"], 7, &["the lightmap as a whole is", "brighter than Cycles"]);

    let packed = all.gltf.with_file_name("packed.gltf");
    let mut document: Value = serde_json::from_slice(&fs::read(&all.gltf).unwrap()).unwrap();
    let fallback = document["buffers"].as_array().unwrap().len();
    let mut push = |list: &str, entry: Value| document[list].as_array_mut().unwrap().push(entry);
    push("buffers", json!({"byteLength": 4, "extensions": {"EXT_meshopt_compression": {"fallback": true}}}));
    let how = json!({"buffer": 0, "byteLength": 4, "byteStride": 4, "count": 1, "mode": "ATTRIBUTES"});
    let compressed = json!({"EXT_meshopt_compression": how});
    push("bufferViews", json!({"buffer": fallback, "byteLength": 4, "extensions": compressed}));
    fs::write(&packed, document.to_string()).unwrap();
    verify(&[text(&packed)], 3, &["EXT_meshopt_compression is more than Blender can read"]);

    let one = fresh("one", &cornell, &[]);
    let (width, height) = (read(&one.pages[0])[0].len(), read(&one.pages[0]).len());
    let block = texels_of(&one.gltf, "ShortBlock", width, height);
    assert!(block.iter().filter(|b| **b).count() > 50);
    brighten_where(&one.pages[0], 1.2, |x, y| block[y * width + x]);
    verify(&[text(&one.gltf), "--samples", "1"], 7, &["object \"ShortBlock\" is", "brighter than Cycles"]);

    // The settings are gone with the header: without the sky on the command line, all is too bright.
    let sky = fresh("sky", &fixture("fence"), &[]);
    brighten_where(&sky.pages[0], 1.0, |_, _| false);
    let dark = [&[text(&sky.gltf), "--samples", "1"][..], &COARSE].concat();
    verify(&dark, 7, &["as a whole", "brighter than Cycles"]);
    let options: Vec<&str> = sky.fixture.options.iter().map(String::as_str).collect();
    verify(&[&dark[..], &options].concat(), 0, &["they agree"]);
    brighten_where(&sky.pages[0], f32::NAN, |x, y| x == 3 && y == 3);
    verify(&[text(&sky.gltf)], 3, &["NaN"]);
    fs::remove_file(&sky.pages[0]).unwrap();
    verify(&[text(&sky.gltf)], 4, &["does not exist"]);
    verify(&[text(&cornell.file)], 3, &["was it baked"]);
    verify(&["--samples", "0", "x"], 2, &["1 or more"]);
}

/// Lights with a size, a turned environment map, irradiance instead of radiosity: all in one bake, read from its page.
#[test]
#[ignore = "slow: Cycles on the CPU, half a minute"]
fn verify_knows_lights_and_quantity_of_the_bake() {
    let out = folder("verify_lights");
    let map = out.join("map.exr");
    let bright = |x: usize, y: usize| if (x, y) == (4, 2) { (20.0f32, 10.0, 5.0) } else { (0.1, 0.1, 0.1) };
    exr::prelude::write_rgb_file(&map, 16, 8, bright).unwrap();
    let lights = ["--environment", text(&map), "--environment-rotation", "40", "--environment-intensity", "0.5"];
    let sizes = ["--sun-angle", "5", "--light-radius", "0.3", "--quantity", "irradiance"];
    let baked = small_bake(&fixture("primitives"), &out, &[&lights[..], &sizes].concat());
    let arguments = [&[text(&baked.gltf), "--samples", "2"][..], &COARSE].concat();
    verify(&arguments, 0, &["environment", "they agree"]);
    verify(&[&arguments[..], &["--environment-rotation", "130"]].concat(), 7, &["they differ"]);
}

/// A floor and a wall of specular-glossiness, below and before sheets of tinted and of frosted glass, under a sun and a sky,
/// and a camera.
fn glasshouse() -> Builder {
    let mut b = Builder::new();
    let pbr = |color: [f32; 4]| json!({"metallicFactor": 0.2, "baseColorFactor": color});
    let gloss = |e: Value| json!({"extensions": {"KHR_materials_pbrSpecularGlossiness": e}});
    b.push(
        "materials",
        gloss(json!({"diffuseFactor": [0.8, 0.7, 0.6, 1.0], "diffuseTexture": {"index": 0},
        "specularFactor": [0.9, 0.4, 0.2], "specularGlossinessTexture": {"index": 1}})),
    );
    b.push("materials", gloss(json!({"diffuseFactor": [0.6, 0.9, 0.6, 1.0], "specularFactor": [0.1, 0.4, 0.1]})));
    b.push("materials", json!({"pbrMetallicRoughness": pbr([0.3, 0.6, 0.9, 1.0]), "doubleSided": true, "name": "pane",
        "extensions": {"KHR_materials_transmission": {"transmissionFactor": 0.75, "transmissionTexture": {"index": 1}}}}));
    b.push("materials", json!({"pbrMetallicRoughness": pbr([0.5, 0.8, 0.5, 1.0]), "extensions": {
        "KHR_materials_transmission": {"transmissionFactor": 0.2},
        "KHR_materials_diffuse_transmission": {"diffuseTransmissionFactor": 0.6, "diffuseTransmissionColorFactor": [0.9, 0.5, 0.2]}}}));
    b.texture(2, &[[255, 255, 255, 255], [200, 255, 255, 255], [255, 200, 255, 255], [255, 255, 200, 255]]);
    b.texture(2, &[[255, 0, 0, 255], [128, 255, 0, 255], [255, 0, 128, 255], [255, 255, 255, 255]]);
    let rectangles: [[[f32; 3]; 4]; 4] = [
        [[-1.5, 0.0, 1.5], [1.5, 0.0, 1.5], [1.5, 0.0, -1.5], [-1.5, 0.0, -1.5]],
        [[-1.5, 0.0, -1.5], [1.5, 0.0, -1.5], [1.5, 1.5, -1.5], [-1.5, 1.5, -1.5]],
        [[-1.4, 0.6, 1.0], [0.2, 0.6, 1.0], [0.2, 0.6, -1.0], [-1.4, 0.6, -1.0]],
        [[0.6, 0.05, 1.0], [0.6, 0.05, -1.0], [0.6, 1.0, -1.0], [0.6, 1.0, 1.0]],
    ];
    for (material, corners) in rectangles.iter().enumerate() {
        let position = b.floats("VEC3", corners.as_flattened());
        let uv = b.floats("VEC2", &[0., 0., 1., 0., 1., 1., 0., 1.]);
        let indices = b.accessor(5123, "SCALAR", 6, &words(&[0, 1, 2, 0, 2, 3]), json!({}));
        let attributes = json!({"POSITION": position, "TEXCOORD_0": uv});
        let mesh = b.push(
            "meshes",
            json!({"primitives": [{"attributes": attributes, "indices": indices, "material": material}]}),
        );
        b.push("nodes", json!({"mesh": mesh}));
    }
    b.json["extensionsUsed"] = json!(["KHR_lights_punctual"]);
    let sun = json!({"type": "directional", "intensity": 2.0, "color": [1.0, 0.9, 0.8]});
    b.json["extensions"] = json!({"KHR_lights_punctual": {"lights": [sun]}});
    let turned = [-0.560, -0.292, -0.217, 0.744];
    b.push("nodes", json!({"rotation": turned, "extensions": {"KHR_lights_punctual": {"light": 0}}}));
    b.push("cameras", json!({"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.1}}));
    b.push("nodes", json!({"camera": 0, "translation": [0.0, 1.9, 3.4], "rotation": [-0.2164, 0, 0, 0.9763]}));
    b
}

/// What is reflected, tinted, and scattered on: `verify.py` and `view.py` mean the same by it as `bake` and `render`.
#[test]
#[ignore = "slow: Cycles on the CPU, half a minute"]
fn glass_and_specular_glossiness_are_known() {
    let out = folder("blender_glass");
    let (input, gltf) = (out.join("in.gltf"), out.join("glass.gltf"));
    fs::write(&input, glasshouse().gltf()).unwrap();
    let options = ["--texels-per-meter", "16", "--sky", "0.3,0.4,0.5", "--preset", "production", "-q"];
    let output = texelwalk(&[&["bake", text(&input), "-o", text(&gltf)][..], &options].concat());
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let strict = ["--mean", "0.004", "--fail", "0.015", "--object", "0.01"];
    verify(&[&[text(&gltf)][..], &strict].concat(), 0, &["they agree"]);
    // Both throw dice at glass: with 144 rays a pixel an eighth of the pixels are 3 % apart.
    let (ours, theirs) = views(&gltf, "1024");
    assert_eq!(unlike(&ours, &theirs), [""; 0]);

    let good = fs::read_to_string(&gltf).unwrap();
    for (from, to) in [
        (r#""transmissionFactor":0.75"#, r#""transmissionFactor":0.6"#),
        (r#""diffuseTransmissionColorFactor":[0.9,0.5,0.2]"#, r#""diffuseTransmissionColorFactor":[0.1,0.1,0.1]"#),
        (r#""specularFactor":[0.1,0.4,0.1]"#, r#""specularFactor":[0.1,0.1,0.1]"#),
        (r#""specularFactor":[0.9,0.4,0.2]"#, r#""specularFactor":[0.5,0.4,0.2]"#),
    ] {
        let wrong = out.join("wrong.gltf");
        assert!(good.contains(from), "{from} in {good}");
        fs::write(&wrong, good.replace(from, to)).unwrap();
        verify(&[&[text(&wrong)][..], &strict].concat(), 7, &["they differ"]);
    }
}

/// Meshes may have all the UV maps that Blender knows, the lightmap's among them.
#[test]
#[ignore = "slow: Cycles on the CPU, seconds"]
fn verify_needs_the_texture_coordinates_that_are_read_alone() {
    let out = folder("verify_uv_sets");
    let (input, gltf) = (out.join("in.gltf"), out.join("sets.gltf"));
    let mut b = glasshouse();
    for mesh in b.json["meshes"].as_array_mut().unwrap() {
        let attributes = mesh["primitives"][0]["attributes"].as_object_mut().unwrap();
        let uv = attributes["TEXCOORD_0"].clone();
        attributes.extend((1..8).map(|set| (format!("TEXCOORD_{set}"), uv.clone())));
    }
    b.set("/materials/0/extensions/KHR_materials_pbrSpecularGlossiness/diffuseTexture/texCoord", json!(7));
    fs::write(&input, b.gltf()).unwrap();
    let options = ["--texels-per-meter", "16", "--sky", "0.3,0.4,0.5", "--preset", "production", "-q"];
    let output = texelwalk(&[&["bake", text(&input), "-o", text(&gltf)][..], &options].concat());
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    verify(&[text(&gltf), "--mean", "0.004", "--fail", "0.015", "--object", "0.01"], 0, &["they agree"]);

    let mut document: Value = serde_json::from_slice(&fs::read(&gltf).unwrap()).unwrap();
    let reading = |set: usize| json!({"emissiveTexture": {"index": 0, "texCoord": set}});
    document["materials"].as_array_mut().unwrap().extend((0..8).map(reading));
    fs::write(&gltf, document.to_string()).unwrap();
    verify(&[text(&gltf)], 3, &["textures read 8 sets of texture coordinates", "8 UV maps"]);
}

/// What differs between two pictures of one camera: means by more than 2 %, or a pixel in 20 by more than 3 %.
fn unlike(ours: &Page, theirs: &Page) -> Vec<String> {
    let rgb = |page: &Page| -> Vec<[f32; 3]> { page.iter().flatten().map(|p| [p.0, p.1, p.2]).collect() };
    let (a, b) = (rgb(ours), rgb(theirs));
    assert_eq!(a.len(), b.len());
    let mean = |v: &[[f32; 3]]| v.iter().flatten().map(|x| f64::from(*x)).sum::<f64>();
    let ratio = mean(&b) / mean(&a);
    let most = |p: &[f32; 3]| p[0].max(p[1]).max(p[2]);
    let lit: Vec<f32> = a
        .iter()
        .zip(&b)
        .filter(|(p, q)| most(p).max(most(q)) > 1e-6)
        .map(|(p, q)| (0..3).map(|c| (p[c] - q[c]).abs()).fold(0.0, f32::max) / most(p).max(most(q)))
        .collect();
    let close = lit.iter().filter(|d| **d < 0.03).count() as f64 / lit.len() as f64;
    let mut found = vec![];
    if (ratio - 1.0).abs() > 0.02 {
        found.push(format!("the ratio of means is {ratio:.4}"));
    }
    if close < 0.95 {
        found.push(format!("{:.1} % of the pixels are within 3 %", 100.0 * close));
    }
    eprintln!("ratio of means {ratio:.4}, {:.1} % of pixels within 3 %", 100.0 * close);
    found
}

/// Pictures of the first camera by `view.py` and by `render`, linear. Many rays per pixel: both filter with a box of one
/// pixel, and with few rays edges and far textures are noise in both.
fn views(gltf: &Path, samples: &str) -> (Page, Page) {
    let [ours, theirs] = ["ours.exr", "blender.exr"].map(|name| gltf.with_file_name(name));
    let options = ["--width", "160", "--height", "120", "--samples", samples];
    let output = texelwalk(&[&["render", text(gltf), "-o", text(&ours)][..], &options].concat());
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let size = ["--size", "160", "120", "--samples", samples];
    let (code, said) = blender("view.py", &[&[text(gltf), "--render", text(&theirs)][..], &size].concat());
    assert_eq!(code, 0, "{said}");
    (read(&ours), read(&theirs))
}

#[test]
#[ignore = "slow: Cycles on the CPU, a quarter of a minute"]
fn view_shows_what_render_shows() {
    let mut faults = vec![];
    for (name, quantity) in
        [("cornell", "irradiance"), ("office", "radiosity"), ("primitives", "radiosity"), ("freedoom", "radiosity")]
    {
        let out = folder(&format!("view_{name}"));
        let options = ["--gather", "0", "--lines-per-texel", "4", "--quantity", quantity, "--page-size", "64"];
        let baked = small_bake(&fixture(name), &out, &options);
        let (ours, theirs) = views(&baked.gltf, "144");
        faults.extend(unlike(&ours, &theirs).into_iter().map(|f| format!("{name}: {f}")));
        // The comparison sees 4 % of brightness, and one wrong page.
        let dimmer: Page =
            ours.iter().map(|row| row.iter().map(|p| (0.96 * p.0, 0.96 * p.1, 0.96 * p.2, p.3)).collect()).collect();
        assert_eq!(unlike(&dimmer, &theirs).len(), 2);
        if name == "office" {
            assert!(baked.pages.len() > 1, "64 texels a side should not be enough");
            brighten_where(baked.pages.last().unwrap(), 0.0, |_, _| true);
            assert!(!unlike(&ours, &views(&baked.gltf, "16").1).is_empty(), "a black page must show");
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

/// A square of 1 m seen from above, with light at its corners instead of a lightmap, and colours at its corners.
fn vertex_baked(folder: &Path, light: [[f32; 3]; 4], colors: [[f32; 4]; 4]) -> PathBuf {
    let positions: [[f32; 3]; 4] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 1.0], [0.0, 0.0, 1.0]];
    let values = positions.iter().flatten().chain(light.iter().flatten()).chain(colors.iter().flatten());
    let mut bytes: Vec<u8> = values.flat_map(|x| x.to_le_bytes()).collect();
    bytes.extend([0u16, 2, 1, 0, 3, 2].iter().flat_map(|i| i.to_le_bytes()));
    fs::write(folder.join("square.bin"), bytes).unwrap();
    let gltf = r#"{"asset": {"version": "2.0"}, "scene": 0,
        "scenes": [{"nodes": [0, 1], "extras": {"lightmap": {"version": 1, "quantity": "radiosity", "attribute": "_LIGHTMAP"}}}],
        "nodes": [{"mesh": 0}, {"camera": 0, "translation": [0.5, 2, 0.5], "rotation": [-0.70710678, 0, 0, 0.70710678]}],
        "cameras": [{"type": "orthographic", "orthographic": {"xmag": 0.5, "ymag": 0.5, "znear": 0.1, "zfar": 10}}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "_LIGHTMAP": 1, "COLOR_0": 2}, "indices": 3, "material": 0}]}],
        "materials": [{"pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.25, 0.8, 1], "metallicFactor": 0}, "emissiveFactor": [0, 0.1, 0]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [0, 0, 0], "max": [1, 0, 1]},
                      {"bufferView": 1, "componentType": 5126, "count": 4, "type": "VEC3"},
                      {"bufferView": 2, "componentType": 5126, "count": 4, "type": "VEC4"},
                      {"bufferView": 3, "componentType": 5123, "count": 6, "type": "SCALAR"}],
        "bufferViews": [{"buffer": 0, "byteLength": 48}, {"buffer": 0, "byteOffset": 48, "byteLength": 48},
                        {"buffer": 0, "byteOffset": 96, "byteLength": 64}, {"buffer": 0, "byteOffset": 160, "byteLength": 12}],
        "buffers": [{"byteLength": 172, "uri": "square.bin"}]}"#;
    let path = folder.join("square.gltf");
    fs::write(&path, gltf).unwrap();
    path
}

#[test]
#[ignore = "slow: makes a Python environment (for Blender), minutes"]
fn view_shows_light_at_vertices() {
    let out = folder("view_vertices");
    let light = [[4.0, 0.5, 1.0], [0.0, 2.0, 1.0], [1.0, 1.0, 3.0], [2.0, 0.0, 0.0]];
    let colors = [[1.0, 1.0, 1.0, 1.0], [0.0, 0.5, 1.0, 1.0], [0.5, 0.5, 0.5, 1.0], [1.0, 0.2, 0.0, 1.0]];
    let gltf = vertex_baked(&out, light, colors);
    let view = out.join("view.exr");
    let (code, said) =
        blender("view.py", &[text(&gltf), "--render", text(&view), "--size", "64", "64", "--samples", "16"]);
    assert_eq!(code, 0, "{said}");
    let pixels = read(&view);
    let base = [0.5, 0.25, 0.8];
    let own = [0.0, 0.1, 0.0];
    // Pixels in both triangles; x to the right, z down.
    for (x, y) in [(40, 10), (60, 50), (50, 30), (10, 40), (30, 60), (5, 20)] {
        let (u, v) = ((x as f32 + 0.5) / 64.0, (y as f32 + 0.5) / 64.0);
        // Triangles 0 2 1 and 0 3 2.
        let weights = if u > v { [1.0 - u, u - v, v, 0.0] } else { [1.0 - v, 0.0, u, v - u] };
        let at = |values: &dyn Fn(usize) -> f32| (0..4).map(|i| weights[i] * values(i)).sum::<f32>();
        let found = [pixels[y][x].0, pixels[y][x].1, pixels[y][x].2];
        for c in 0..3 {
            let expected = base[c] * at(&|i| colors[i][c]) * at(&|i| light[i][c]) + own[c];
            assert!(
                (found[c] - expected).abs() < 0.01 * expected + 0.002,
                "{x},{y}: {found:?}, channel {c} should be {expected}"
            );
        }
    }
    verify(&[text(&gltf)], 3, &["only lightmaps can be compared", "_LIGHTMAP"]);
}

#[test]
#[ignore = "slow: makes a Python environment (for Blender), minutes"]
fn the_add_on_comes_works_and_goes() {
    let out = folder("add_on");
    let archive = out.join("texelwalk-blender.zip");
    let (code, said) = blender("package.py", &[text(&archive)]);
    assert_eq!(code, 0, "{said}");
    let baked = small_bake(&fixture("cornell"), &out, &[]);
    let script = root().join("tests/support/blender_addon.py");
    let run = |agreeing: &Path| {
        let mut command = Command::new(environment_python());
        command.env("BLENDER_USER_RESOURCES", out.join("resources"));
        let output = command.args([&script, &archive, agreeing, &fixture("cornell").file]).output().unwrap();
        (output.status.success(), String::from_utf8_lossy(&[output.stdout, output.stderr].concat()).into_owned())
    };
    let (good, said) = run(&baked.gltf);
    assert!(good, "{said}");
    brighten_where(&baked.pages[0], 1.1, |_, _| true);
    let (good, said) = run(&baked.gltf);
    assert!(!good && said.contains("they differ"), "{said}");
}
