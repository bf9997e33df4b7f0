//! Runs what `pipelines/` offers to build systems and artists: presets, Make, Ninja, Blender; and the study of error
//! against time.
#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "tests")]

#[path = "support/crosscheck_env.rs"]
mod crosscheck_env;

use crosscheck_env::{environment_python, fixture, folder, root, text};
use std::f32::consts::PI;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

const FLAGS: &str = "--preset preview --gather 0 --lines-per-texel 4 --max-pages 1";

/// A command that finds the binary under test as `texelwalk`.
fn command(program: &str, folder: &Path) -> Command {
    let binary = Path::new(env!("CARGO_BIN_EXE_texelwalk")).parent().unwrap();
    let mut paths = vec![binary.to_path_buf()];
    paths.extend(std::env::split_paths(&std::env::var_os("PATH").unwrap_or_default()));
    let mut command = Command::new(program);
    command.current_dir(folder).env("PATH", std::env::join_paths(paths).unwrap());
    command
}

fn said(output: Output) -> String {
    let text = String::from_utf8_lossy(&[output.stdout, output.stderr].concat()).into_owned();
    assert!(output.status.success(), "{}\n{text}", output.status);
    text
}

/// A folder with a copy of the fixture `cornell` and of what it refers to; returns the copy's path.
fn workplace(test: &str) -> (PathBuf, PathBuf) {
    let out = folder(test);
    let source = fixture("cornell").file;
    for file in fs::read_dir(source.parent().unwrap()).unwrap() {
        let file = file.unwrap().path();
        if file.is_file() {
            fs::copy(&file, out.join(file.file_name().unwrap())).unwrap();
        }
    }
    let copy = out.join(source.file_name().unwrap());
    (out, copy)
}

/// Makes a file newer than everything a build has written.
fn touch(path: &Path) {
    let later = std::time::SystemTime::now() + std::time::Duration::from_secs(2);
    fs::File::options().append(true).open(path).unwrap().set_modified(later).unwrap();
}

#[test]
fn every_preset_is_a_table_of_options_that_bake_knows() {
    let help = Command::new(env!("CARGO_BIN_EXE_texelwalk")).args(["bake", "--help"]).output().unwrap();
    let help = said(help);
    for name in ["preview", "production", "final", "paper"] {
        let path = root().join(format!("pipelines/presets/{name}.toml"));
        let table: toml::Table = fs::read_to_string(&path).unwrap().parse().unwrap();
        assert!(!table.is_empty());
        for key in table.keys() {
            assert!(help.contains(&format!("--{key} ")), "{name}.toml: `bake` has no option --{key}");
        }
    }
}

#[test]
fn make_bakes_what_changed_and_nothing_else() {
    let (out, scene) = workplace("make");
    let makefile = root().join("pipelines/make/Makefile");
    let flags = format!("FLAGS={FLAGS}");
    let make = || {
        let arguments = ["-f", text(&makefile), "SOURCE=.", "OUT=baked", &flags];
        let output = command("make", &out).args(arguments).output();
        said(output.unwrap_or_else(|e| panic!("make is needed: {e}")))
    };
    assert!(make().contains("texelwalk bake"));
    assert!(out.join("baked").join(scene.file_name().unwrap()).is_file());
    assert!(make().contains("Nothing to be done"));
    touch(&scene);
    assert!(make().contains("texelwalk bake"), "a changed scene must be baked again");
    // A buffer is known from the depfile alone.
    let buffer =
        fs::read_dir(&out).unwrap().map(|e| e.unwrap().path()).find(|p| p.extension().is_some_and(|e| e == "bin"));
    if let Some(buffer) = buffer {
        std::thread::sleep(std::time::Duration::from_secs(3));
        make();
        assert!(make().contains("Nothing to be done"));
        touch(&buffer);
        assert!(make().contains("texelwalk bake"), "a changed buffer must be baked again");
    }
}

#[test]
#[ignore = "slow: makes a Python environment (for ninja), minutes"]
fn ninja_bakes_what_changed_and_nothing_else() {
    let (out, scene) = workplace("ninja");
    let python = environment_python();
    let ninja = Path::new(&python).parent().unwrap().join("ninja");
    let ending = scene.extension().unwrap().to_string_lossy().into_owned();
    fs::rename(&scene, out.join(format!("scene.{ending}"))).unwrap();
    let recipe = fs::read_to_string(root().join("pipelines/ninja/build.ninja")).unwrap();
    let recipe =
        recipe.replace("scene.glb", &format!("scene.{ending}")).replace("--preset production --max-pages 1", FLAGS);
    assert!(recipe.contains(FLAGS));
    // A .gltf brings a buffer file of its own for the coordinates that were added.
    let extra = if ending == "gltf" { " baked/scene.lightmap.bin:" } else { ":" };
    fs::write(out.join("build.ninja"), recipe.replace("lightmap0.png:", &format!("lightmap0.png{extra}"))).unwrap();
    let run = || said(command(text(&ninja), &out).output().unwrap());
    assert!(run().contains("bake scene"));
    assert!(run().contains("no work to do"));
    std::thread::sleep(std::time::Duration::from_secs(1));
    touch(&out.join(format!("scene.{ending}")));
    assert!(run().contains("bake scene"));
}

/// A one-metre floor under a point light, with a camera that looks straight down on it.
fn floor(folder: &Path) -> PathBuf {
    let positions: [[f32; 3]; 4] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 1.0], [0.0, 0.0, 1.0]];
    let mut bytes: Vec<u8> = positions.iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
    bytes.extend([0u16, 2, 1, 0, 3, 2].iter().flat_map(|i| i.to_le_bytes()));
    fs::write(folder.join("floor.bin"), bytes).unwrap();
    let gltf = r#"{"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0, 1, 2]}],
        "extensionsUsed": ["KHR_lights_punctual"],
        "extensions": {"KHR_lights_punctual": {"lights": [{"type": "point", "intensity": 8, "color": [1, 0.5, 0.25]}]}},
        "nodes": [{"mesh": 0}, {"translation": [0.3, 0.8, 0.2], "extensions": {"KHR_lights_punctual": {"light": 0}}},
                  {"camera": 0, "translation": [0.5, 2, 0.5], "rotation": [-0.70710678, 0, 0, 0.70710678]}],
        "cameras": [{"type": "orthographic", "orthographic": {"xmag": 0.5, "ymag": 0.5, "znear": 0.1, "zfar": 10}}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "material": 0}]}],
        "materials": [{"pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.25, 0.8, 1], "metallicFactor": 0}}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [0, 0, 0], "max": [1, 0, 1]},
                      {"bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR"}],
        "bufferViews": [{"buffer": 0, "byteLength": 48}, {"buffer": 0, "byteOffset": 48, "byteLength": 12}],
        "buffers": [{"byteLength": 60, "uri": "floor.bin"}]}"#;
    let path = folder.join("floor.gltf");
    fs::write(&path, gltf).unwrap();
    path
}

#[test]
#[ignore = "slow: makes a Python environment (for Blender), minutes"]
fn blender_shows_base_color_times_lightmap() {
    let out = folder("blender_view");
    let input = floor(&out);
    let (baked, view) = (out.join("baked.gltf"), out.join("view.exr"));
    let options = ["--texels-per-meter", "64", "--gather", "0"];
    let mut bake = Command::new(env!("CARGO_BIN_EXE_texelwalk"));
    said(bake.args(["bake", text(&input), "-o", text(&baked), "-q"]).args(options).output().unwrap());
    let script = root().join("pipelines/blender/view.py");
    let mut blender = Command::new(environment_python());
    blender.args([text(&script), text(&baked), "--render", text(&view), "--size", "64", "64"]);
    said(blender.output().unwrap());
    let size = |s: exr::prelude::Vec2<usize>, _: &_| vec![[0.0f32; 3]; s.width() * s.height()];
    let set = |p: &mut Vec<[f32; 3]>, at: exr::prelude::Vec2<usize>, (r, g, b, _): (f32, f32, f32, f32)| {
        p[at.y() * 64 + at.x()] = [r, g, b];
    };
    let pixels =
        exr::prelude::read_first_rgba_layer_from_file(&view, size, set).unwrap().layer_data.channel_data.pixels;
    let albedo = [0.5, 0.25, 0.8];
    let candela = [8.0, 4.0, 2.0];
    // Pixels that are not at the rim, where Blender mixes the floor with what is beside it.
    for (x, y) in [(16, 16), (48, 16), (16, 48), (48, 48), (20, 12), (5, 58)] {
        let d = [0.3 - (x as f32 + 0.5) / 64.0, 0.8, 0.2 - (y as f32 + 0.5) / 64.0];
        let squared = d.iter().map(|v| v * v).sum::<f32>();
        for c in 0..3 {
            let expected = albedo[c] * candela[c] * d[1] / (squared * squared.sqrt()) / PI;
            let found = pixels[y * 64 + x][c];
            assert!((found / expected - 1.0).abs() < 0.01, "pixel {x},{y} channel {c}: {found}, expected {expected}");
        }
    }
}

#[test]
#[ignore = "slow: Cycles, its denoiser and Mitsuba on the CPU, minutes"]
fn the_study_of_error_against_time_runs_and_its_judges_find_us_right() {
    let out = folder("study");
    let script = root().join("pipelines/study/curves.py");
    let mut study = Command::new(environment_python());
    study.args([text(&script), text(&out), "--quick", "--scene", "cornell"]);
    study.args(["--binary", env!("CARGO_BIN_EXE_texelwalk")]);
    said(study.output().unwrap());
    let table = fs::read_to_string(out.join("curves.csv")).unwrap();
    let rows: Vec<Vec<&str>> = table.lines().skip(1).map(|line| line.split(',').collect()).collect();
    let error = |method: &str, budget: f32| -> f32 {
        let row = rows.iter().find(|r| r[1] == method && r[2].parse() == Ok(budget));
        row.unwrap_or_else(|| panic!("no {method} at {budget} in\n{table}"))[5].parse().unwrap()
    };
    // Cycles' own noise, and what its denoiser makes of it, show that errors are not of our own making.
    assert!(error("Cycles", 8.0) < 0.4 && error("Cycles", 8.0) < 0.5 * error("Cycles", 1.0), "{table}");
    assert!(error("Cycles + OIDN RT", 8.0) < 0.5 * error("Cycles", 8.0), "{table}");
    assert!(error("texelwalk share", 1.0) < 0.03, "{table}");
    assert!(out.join("curves.png").is_file());
}

#[test]
#[ignore = "slow: Cycles on the CPU"]
fn pictures_beside_cycles_show_the_same_scene_through_the_same_camera() {
    let out = folder("study_beside");
    let options = ["--preset", "preview", "--texels-per-meter", "12", "-o"];
    let mut bake = Command::new(env!("CARGO_BIN_EXE_texelwalk"));
    said(bake.arg("bake").arg(fixture("office").file).args(options).arg(&out).output().unwrap());
    let script = root().join("pipelines/study/beside.py");
    let mut study = Command::new(environment_python());
    study.args([text(&script), text(&out.join("office.glb")), text(&out)]);
    study.args(["--size", "180", "120", "--samples", "32", "--binary", env!("CARGO_BIN_EXE_texelwalk")]);
    let said = said(study.output().unwrap());
    let rows: Vec<&str> = said.lines().filter(|line| line.starts_with("office camera ")).collect();
    assert_eq!(rows.len(), 2, "{said}");
    for (number, row) in rows.iter().enumerate() {
        let after =
            |word: &str| row.split(word).nth(1).unwrap().split([',', '%']).next().unwrap().parse::<f32>().unwrap();
        assert!((after("ratio of means ") - 1.0).abs() < 0.03 && after("30 %: ") < 6.0, "{row}");
        assert!(out.join(format!("office.{number}.png")).is_file());
    }
}

#[test]
#[ignore = "slow: makes Python environments, minutes"]
fn the_study_of_charts_lays_out_a_scene_by_all_programs() {
    let out = folder("study_charts");
    let script = root().join("pipelines/study/charts.py");
    let mut study = Command::new(environment_python());
    study.args([text(&script), text(&out), "--scene", "cornell", "--triangles", "5000"]);
    study.args(["--binary", env!("CARGO_BIN_EXE_texelwalk")]);
    let said = said(study.output().unwrap());
    let rows: Vec<Vec<&str>> =
        said.lines().filter(|l| l.starts_with("| cornell |")).map(|l| l.split('|').map(str::trim).collect()).collect();
    assert_eq!(rows.len(), 4, "{said}");
    let number = |row: usize, column: usize| rows[row][column].trim_end_matches('%').parse::<f64>().unwrap();
    // Ours is even, and without padding fills the page better than with it.
    assert!(number(0, 5) < 1.01 && number(1, 4) > number(0, 4) && number(0, 4) > 75.0, "{said}");
    assert!((0..4).all(|row| (40.0..=100.0).contains(&number(row, 4))), "{said}");
    assert!(said.contains("triangles: "), "{said}");
}

#[test]
#[ignore = "slow: makes the environment of the cross-checks"]
fn the_corpus_runner_tells_bakes_refusals_and_faults_apart() {
    use std::os::unix::fs::PermissionsExt;
    let folder = folder("corpus");
    let files = folder.join("files/ours");
    fs::create_dir_all(&files).unwrap();
    let fixtures = root().join("fixtures");
    for name in ["cornell/cornell.gltf", "cornell/cornell.bin", "chairs/chairs.glb"] {
        fs::copy(fixtures.join(name), files.join(name.split_once('/').unwrap().1)).unwrap();
    }
    fs::write(files.join("empty.gltf"), r#"{"asset": {"version": "2.0"}}"#).unwrap();
    let list = folder.join("list.tsv");
    fs::write(
        &list,
        "cornell.gltf\nchairs.glb\nempty.gltf\n".lines().map(|n| format!("ours/{n}\tours\t1\n")).collect::<String>(),
    )
    .unwrap();
    let run = |program: &str, out: &str| {
        let mut command = Command::new(environment_python());
        let table = folder.join(format!("{out}.md"));
        command.args([text(&root().join("pipelines/corpus/run.py")), text(files.parent().unwrap()), text(&list)]);
        command.args([text(&folder.join(out)), "--program", program, "--table", text(&table)]);
        let done = command.output().unwrap();
        (done.status.code(), fs::read_to_string(&table).unwrap_or_default())
    };
    let (code, table) = run(env!("CARGO_BIN_EXE_texelwalk"), "good");
    assert!(code == Some(0) && table.contains("2 baked, 1 refused, 0 with a fault"), "{table}");
    assert!(
        table.contains("nothing to bake: the scene has no visible triangles (no fault)")
            && table.contains("ours @ 1: 3"),
        "{table}"
    );
    // A program that bakes nothing and panics.
    let bad = folder.join("bad.sh");
    fs::write(&bad, "#!/bin/sh\necho \"thread 'main' panicked at here\" >&2\nexit 101\n").unwrap();
    fs::set_permissions(&bad, fs::Permissions::from_mode(0o755)).unwrap();
    let (code, table) = run(text(&bad), "bad");
    assert!(code == Some(1) && table.contains("0 baked, 0 refused, 3 with a fault"), "{table}");
    assert!(table.contains("panicked at here"), "{table}");
}
