//! What a bake writes besides the lightmap: further layers, and a lightmap per group of lights.

use exr::prelude::{ReadChannels, ReadLayers};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use texelwalk::output::exr::{ImageF32, read_rgba};

struct Baked {
    home: tempfile::TempDir,
    report: Value,
    rule: String,
}

/// Bakes cornell after `edit`, at a low density.
fn bake(edit: impl Fn(&mut Value), options: &[&str]) -> Baked {
    let home = tempfile::tempdir().unwrap();
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/cornell");
    for file in fs::read_dir(&source).unwrap().map(|f| f.unwrap().path()).filter(|f| f.is_file()) {
        fs::copy(&file, home.path().join(file.file_name().unwrap())).unwrap();
    }
    let input = home.path().join("cornell.gltf");
    let mut document: Value = serde_json::from_slice(&fs::read(&input).unwrap()).unwrap();
    edit(&mut document);
    fs::write(&input, document.to_string()).unwrap();
    let (report, rule) = (home.path().join("r.json"), home.path().join("r.d"));
    let mut command = Command::new(env!("CARGO_BIN_EXE_texelwalk"));
    command.arg("bake").arg(&input).arg("-o").arg(home.path().join("out.gltf")).arg("--report").arg(&report);
    command.arg("--depfile").arg(&rule).args(["-q", "--texels-per-meter", "4"]).args(options).stdin(Stdio::null());
    let out = command.output().unwrap();
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    let report = serde_json::from_slice(&fs::read(&report).unwrap()).unwrap();
    Baked { report, rule: fs::read_to_string(rule).unwrap(), home }
}

impl Baked {
    fn file(&self, name: &str) -> PathBuf {
        self.home.path().join(name)
    }

    fn page(&self, name: &str) -> ImageF32 {
        read_rgba(&self.file(name)).unwrap()
    }

    /// The report and the depfile name this output.
    fn names(&self, name: &str) -> bool {
        let listed = self.report["outputs"].as_array().unwrap().iter().any(|o| o.as_str().unwrap().ends_with(name));
        assert_eq!(listed, self.rule.contains(name), "{name}");
        listed
    }
}

/// Channels of an EXR file by name.
fn channels(path: &Path) -> BTreeMap<String, Vec<f32>> {
    let read = exr::prelude::read().no_deep_data().largest_resolution_level().all_channels().first_valid_layer();
    let image = read.all_attributes().from_file(path).unwrap();
    let list = image.layer_data.channel_data.list;
    list.iter().map(|c| (c.name.to_string(), c.sample_data.values_as_f32().collect())).collect()
}

/// Mean of the covered texels' channels.
fn mean(page: &ImageF32) -> f64 {
    let covered = page.pixels.iter().filter(|p| p[3] > 0.0);
    let (sum, n) = covered.fold((0.0, 0.0), |(s, n), p| (s + f64::from(p[0] + p[1] + p[2]), n + 3.0));
    sum / n
}

#[test]
fn direct_and_indirect_add_up_to_the_lightmap() {
    let baked = bake(|_| {}, &["--aov", "indirect,direct,indirect"]);
    let layers = channels(&baked.file("out.aov0.exr"));
    let names: Vec<&str> = layers.keys().map(String::as_str).collect();
    assert_eq!(names, ["direct.B", "direct.G", "direct.R", "indirect.B", "indirect.G", "indirect.R"]);
    let page = baked.page("out.lightmap0.exr");
    for (i, pixel) in page.pixels.iter().enumerate() {
        for (c, name) in ["R", "G", "B"].into_iter().enumerate() {
            let sum = layers[&format!("direct.{name}")][i] + layers[&format!("indirect.{name}")][i];
            assert!((sum - pixel[c]).abs() <= 6e-4 * sum.abs() + 1e-6, "texel {i}: {sum} {}", pixel[c]);
        }
    }
    assert!(baked.names("out.aov0.exr"));
    assert!(!bake(|_| {}, &["--preset", "preview"]).file("out.aov0.exr").exists());
}

#[test]
fn surface_layers_describe_the_room() {
    let wanted = ["albedo", "normal", "position", "chart", "density", "coverage"];
    let baked = bake(|_| {}, &["--aov", &wanted.join(","), "--gather", "4"]);
    let layers = channels(&baked.file("out.aov0.exr"));
    let names: std::collections::BTreeSet<&str> = layers.keys().map(|k| k.split('.').next().unwrap()).collect();
    assert_eq!(names, wanted.into_iter().collect());
    let page = baked.page("out.lightmap0.exr");
    let charts = baked.report["atlas"]["charts"].as_f64().unwrap() as f32;
    let (mut floor, mut area) = (0, 0.0);
    for (i, pixel) in page.pixels.iter().enumerate() {
        let all = |name: &str, channels: [&str; 3]| channels.map(|c| layers[&format!("{name}.{c}")][i]);
        let number = |name: &str| layers[&format!("{name}.Y")][i];
        let (albedo, normal, position) =
            (all("albedo", ["R", "G", "B"]), all("normal", ["X", "Y", "Z"]), all("position", ["X", "Y", "Z"]));
        if pixel[3] == 0.0 {
            assert!([albedo, normal, position].as_flattened().iter().all(|v| *v == 0.0) && number("chart") == 0.0);
            continue;
        }
        assert!((normal.iter().map(|v| v * v).sum::<f32>() - 1.0).abs() < 1e-4);
        assert!((1.0..=charts).contains(&number("chart")) && number("chart").fract() == 0.0);
        assert!((0.0..=1.0001).contains(&number("coverage")) && albedo.iter().all(|a| (0.0..1.0).contains(a)));
        area += number("coverage") / number("density").powi(2);
        if normal[1] > 0.999 && position[1].abs() < 1e-4 {
            floor += 1;
        }
    }
    // Five sides of 5.5 m squared and two solids; of the floor, at 4 texels per metre, the solids hide a sixth.
    assert!((350..=540).contains(&floor), "{floor}");
    assert!((160.0..200.0).contains(&area), "{area}");
}

#[test]
fn the_standard_error_is_that_of_another_seed() {
    let one = |seed| bake(|_| {}, &["--aov", "stderr", "--quantity", "irradiance", "--seed", seed]);
    let bakes = ["1", "2"].map(one);
    let pages = [0, 1].map(|k: usize| bakes[k].page("out.lightmap0.exr"));
    let errors = [0, 1].map(|k: usize| channels(&bakes[k].file("out.aov0.exr"))["stderr.Y"].clone());
    let bright = mean(&pages[0]) as f32;
    let (mut sum, mut n) = (0.0f64, 0.0f64);
    for (i, (a, b)) in pages[0].pixels.iter().zip(&pages[1].pixels).enumerate() {
        assert!(errors[0][i].is_finite() && errors[0][i] >= 0.0);
        let variance = f64::from(errors[0][i].powi(2) + errors[1][i].powi(2));
        if a[3] > 0.0 && a[1] > 0.05 * bright && variance > 0.0 {
            sum += (0..3).map(|c| f64::from(a[c] - b[c]).powi(2)).fold(0.0, |a, b| a + b) / 3.0 / variance;
            n += 1.0;
        }
    }
    // The error of sharing is the same for both seeds, so this is a little low.
    let deviation = (sum / n).sqrt();
    assert!(n > 500.0 && (0.6..1.2).contains(&deviation), "{deviation} over {n} texels");
}

/// A named lamp, the panel in a group of its own, and one lamp without a name.
fn grouped(document: &mut Value) {
    let lamp = json!({"type": "point", "intensity": 4.0, "color": [1.0, 0.6, 0.3]});
    let cold = json!({"type": "point", "intensity": 3.0, "extras": {"texelwalk": {"light_group": "Key Light"}}});
    document["extensions"] = json!({"KHR_lights_punctual": {"lights": [lamp, cold]}});
    document["extensionsUsed"] = json!(["KHR_lights_punctual"]);
    let place =
        |light: u32, at: [f32; 3]| json!({"translation": at, "extensions": {"KHR_lights_punctual": {"light": light}}});
    let nodes = document["nodes"].as_array_mut().unwrap();
    nodes.extend([place(0, [2.0, 4.0, 1.0]), place(1, [4.0, 3.0, 2.0]), place(1, [1.0, 1.0, 1.0])]);
    let first = nodes.len() - 3;
    nodes[first + 2]["extras"] = json!({"texelwalk": {"light_group": "default"}});
    document["scenes"][0]["nodes"].as_array_mut().unwrap().extend((first..first + 3).map(|n| json!(n)));
    for material in document["materials"].as_array_mut().unwrap() {
        if material.get("emissiveFactor").is_some() {
            material["extras"] = json!({"texelwalk": {"light_group": "panel"}});
        }
    }
}

#[test]
fn groups_add_up_to_the_whole() {
    let options = ["--light-groups", "--sky", "0.5", "--gather", "32"];
    let baked = bake(grouped, &options);
    let files = [
        "out.lightmap-Key_Light0.exr",
        "out.lightmap-default0.exr",
        "out.lightmap-panel0.exr",
        "out.lightmap-sky0.exr",
    ];
    let listed = baked.report["light_groups"].as_array().unwrap();
    let names: Vec<&str> = listed.iter().map(|g| g["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["Key Light", "default", "panel", "sky"]);
    assert!(files.iter().all(|f| baked.names(f)));

    let whole = baked.page("out.lightmap0.exr");
    let parts = files.map(|f| baked.page(f));
    assert!(parts.iter().all(|p| mean(p) > 0.01 * mean(&whole)));
    for (i, pixel) in whole.pixels.iter().enumerate() {
        for (c, whole) in pixel.iter().enumerate().take(3) {
            let sum: f32 = parts.iter().map(|p| p.pixels[i][c]).fold(0.0, |a, b| a + b);
            assert!((sum - whole).abs() <= 1e-3 * whole + 1e-6, "texel {i}: {sum} {whole}");
        }
    }
    let powers = |b: &Baked| b.report["walk"]["power_in"][1].as_f64().unwrap();
    let plain = bake(grouped, &options[1..]);
    assert!(!plain.file(files[0]).exists());
    assert!((mean(&whole) / mean(&plain.page("out.lightmap0.exr")) - 1.0).abs() < 0.01);
    assert!((powers(&baked) / powers(&plain) - 1.0).abs() < 0.01);
}

#[test]
fn a_group_is_a_bake_of_its_lights_alone() {
    let alone = |document: &mut Value| {
        grouped(document);
        document["scenes"][0]["nodes"].as_array_mut().unwrap().retain(|n| n != 9 && n != 11);
        for material in document["materials"].as_array_mut().unwrap() {
            material.as_object_mut().unwrap().remove("emissiveFactor");
        }
    };
    for more in [&["--direct", "gather"][..], &["--direct", "shoot", "--lines-per-texel", "200"]] {
        let groups = bake(grouped, &[&["--light-groups", "--sky", "0.5"], more].concat());
        let own = bake(alone, more);
        let ratio = mean(&groups.page("out.lightmap-Key_Light0.exr")) / mean(&own.page("out.lightmap0.exr"));
        assert!((ratio - 1.0).abs() < 0.02, "{more:?}: {ratio}");
    }
}

#[test]
fn a_group_that_is_no_name_is_a_warning() {
    let odd = |document: &mut Value| document["materials"][0]["extras"] = json!({"texelwalk": {"light_group": 3}});
    let baked = bake(odd, &["--preset", "preview", "--light-groups"]);
    assert_eq!(baked.report["warnings"][0]["code"], "bad-light-group");
    assert!(baked.file("out.lightmap-default0.exr").exists(), "the panel has no name");
    // Extras may be anything.
    bake(|document| document["nodes"][0]["extras"] = json!([[1], "x"]), &["--preset", "preview"]);
}
