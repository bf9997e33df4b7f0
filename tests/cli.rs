//! The program as build systems see it: exit codes, streams, files, and the same bytes every time.

#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "support/hostile.rs"]
mod hostile;

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};
use texelwalk::output::exr;

const PROGRAM: &str = env!("CARGO_BIN_EXE_texelwalk");

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures").join(name)
}

fn run(arguments: &[&str]) -> Output {
    Command::new(PROGRAM).args(arguments).stdin(Stdio::null()).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn path(p: &Path) -> &str {
    p.to_str().unwrap()
}

/// Exit code, and standard error for the message.
#[track_caller]
fn expect(arguments: &[&str], code: i32) -> Output {
    let out = run(arguments);
    assert_eq!(out.status.code(), Some(code), "{arguments:?}\n{}", text(&out.stderr));
    out
}

fn folder() -> tempfile::TempDir {
    tempfile::tempdir().unwrap()
}

/// Name and bytes of every file below a folder.
fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let entries = fs::read_dir(folder).map(|d| d.map(|e| e.unwrap().path()).collect::<Vec<_>>()).unwrap_or_default();
    entries.into_iter().map(|p| (p.file_name().unwrap().to_string_lossy().into_owned(), fs::read(p).unwrap())).collect()
}

/// A cheap bake of the office.
const QUICK: [&str; 8] = ["--preset", "preview", "--gather", "2", "--lines-per-texel", "4", "--direct-samples", "2"];

#[test]
fn hostile_files_get_one_message_and_nothing_is_written() {
    // Claimed sizes must not be allocated: the address space is capped.
    let limited = |command: &str, input: &Path, output: &Path| {
        let script = format!("ulimit -v 4000000; exec \"{PROGRAM}\" {command}");
        let mut c = Command::new("sh");
        c.arg("-c").arg(script).env("IN", input).env("OUT", output).env("RUST_BACKTRACE", "0");
        c.stdin(Stdio::null()).output().unwrap()
    };
    let cases = hostile::cases();
    assert!(cases.len() >= 30);
    for case in cases {
        let home = folder();
        for (name, bytes) in &case.files {
            fs::write(home.path().join(name), bytes).unwrap();
        }
        let code = if case.class == hostile::Class::Io { 4 } else { 3 };
        let (input, output) = (home.path().join(case.main), home.path().join("out"));
        let start = Instant::now();
        for command in ["bake \"$IN\" -o \"$OUT/\" --threads 2", "inspect \"$IN\""] {
            let out = limited(command, &input, &output);
            let said = text(&out.stderr);
            assert_eq!(out.status.code(), Some(code), "{}: {command}: {said}", case.name);
            let errors: Vec<&str> = said.lines().filter(|l| l.starts_with("error: ")).collect();
            assert_eq!(errors.len(), 1, "{}: {said}", case.name);
            assert!(!said.contains("panicked"), "{}: {said}", case.name);
            for word in &case.message_contains {
                assert!(errors[0].contains(word), "{}: no '{word}' in {}", case.name, errors[0]);
            }
        }
        assert!(!output.exists(), "{}: something was written", case.name);
        assert!(start.elapsed() < Duration::from_secs(10), "{}: {:?}", case.name, start.elapsed());
    }
}

#[test]
fn usage_errors_are_code_2() {
    let office = fixture("office/office.glb");
    let home = folder();
    let out = path(home.path());
    for more in [
        &["--no-such-option"][..],
        &["--alpha", "9", "--beta", "3"],
        &["--texels-per-meter", "-1"],
        &["--threads", "0"],
        &["--sky", "1,2"],
        &["--preset", "best"],
        &["--lines", "5", "--lines-per-texel", "5"],
        &["--texel-size", "5", "--texels-per-meter", "5"],
    ] {
        let mut all = vec!["bake", path(&office), "-o", out];
        all.extend(more);
        let said = text(&expect(&all, 2).stderr);
        assert!(said.contains("error"), "{more:?}: {said}");
    }
    // What is out of range is told its range, negative or not.
    for (option, value, told) in [
        ("--sun-angle", "-3", "--sun-angle -3"),
        ("--texels-per-meter", "-1", "--texels-per-meter -1"),
        ("--gather", "-1", "invalid value '-1' for '--gather"),
        ("--padding", "16", "padding of 16 texels"),
        ("--mips", "4", "4 clean mip levels"),
    ] {
        let said = text(&expect(&["bake", path(&office), "-o", out, "--page-size", "32", option, value], 2).stderr);
        assert!(said.contains(told), "{option}: {said}");
    }
    let config = home.path().join("c.toml");
    fs::write(&config, "gatherr = 3\n").unwrap();
    let said = text(&expect(&["bake", path(&office), "-o", out, "--config", path(&config)], 2).stderr);
    assert!(said.contains("gatherr") && said.contains("c.toml"), "{said}");
    // The file is named if the fault is its own.
    let faults = [
        ("threads = 0", "--threads 0"),
        ("texels-per-meter = -1.0", "--texels-per-meter -1"),
        ("texel-size = 0.1\ntexels-per-meter = 3.0", "texels-per-meter and texel-size"),
        ("[[rules]]\nnodes = [\"a\"]\ndensity = 100", "rule 1"),
        ("seed = 1", "--alpha 9"),
    ];
    for (text, message) in faults {
        fs::write(&config, text).unwrap();
        let own: &[&str] = if text == "seed = 1" { &["--alpha", "9", "--beta", "3"] } else { &[] };
        let words = [&["bake", path(&office), "-o", out, "--config", path(&config)], own].concat();
        let said = crate::text(&expect(&words, 2).stderr);
        assert!(said.contains(message) && said.contains("c.toml") == own.is_empty(), "{said}");
    }
    for words in [
        &["compare", "a.exr", "b.exr", "--fail", "nan"][..],
        &["compare", "a.exr", "b.exr", "--fail=-1"],
        &["render", "a.glb", "-o", "a.png", "--camera", "-1"],
        &["render", "a.glb", "-o", "a.png", "--exposure", "nan"],
        &["render", "a.glb", "-o", "a.png", "--exposure", "inf"],
        &["render", "a.glb", "-o", "a.jpg"],
        &["render", "a.glb", "-o", "a"],
    ] {
        expect(words, 2);
    }
    expect(&["bake", path(&office)], 2);
    expect(&[], 2);
}

#[test]
fn the_input_is_never_overwritten() {
    let home = folder();
    let input = home.path().join("office.glb");
    fs::copy(fixture("office/office.glb"), &input).unwrap();
    let before = fs::read(&input).unwrap();
    for output in [path(&input), path(home.path())] {
        let mut all = vec!["bake", path(&input), "-o", output];
        all.extend(QUICK);
        let said = text(&run(&all).stderr);
        assert!(said.contains("overwrite"), "{said}");
        assert_eq!(fs::read(&input).unwrap(), before);
        assert_eq!(files(home.path()).len(), 1, "only the input is there");
    }
}

#[test]
fn file_system_errors_are_code_4() {
    let home = folder();
    let file = home.path().join("file");
    fs::write(&file, "x").unwrap();
    let office = fixture("office/office.glb");
    let below = file.join("out/");
    let mut all = vec!["bake", path(&office), "-o", path(&below)];
    all.extend(QUICK);
    expect(&all, 4);
    expect(&["bake", "no-such-file.glb", "-o", path(home.path())], 4);
    expect(&["compare", "no-such.exr", "no-such.exr"], 4);
}

#[test]
fn report_depfile_streams_and_config() {
    let home = folder();
    let (report, dep, config) = (home.path().join("r.json"), home.path().join("a.d"), home.path().join("c.toml"));
    fs::write(&config, "seed = 7\ngather = 4\n").unwrap();
    let office = fixture("office/office.glb");
    let out = home.path().join("o");
    let mut all = vec!["bake", path(&office), "-o", path(&out), "--report", path(&report), "--depfile", path(&dep)];
    all.extend(["--config", path(&config), "--json", "-q"]);
    all.extend(QUICK);
    fs::create_dir(&out).unwrap();
    let done = expect(&all, 0);
    assert!(done.stderr.is_empty(), "quiet: {}", text(&done.stderr));
    assert_eq!(
        text(&done.stdout),
        fs::read_to_string(&report).unwrap().split("\"name\": \"write\"").next().unwrap().to_owned() + tail(&report)
    );
    let json: serde_json::Value = serde_json::from_slice(&done.stdout).unwrap();
    assert_eq!(json["settings"]["seed"], 7, "from the file");
    assert_eq!(json["settings"]["gather"], 2, "the command line wins");
    for key in [
        "version", "schema", "inputs", "outputs", "scene", "atlas", "walk", "gather", "error", "rays", "stages",
        "warnings",
    ] {
        assert!(!json[key].is_null(), "{key}");
    }
    let channel = |k: &str, c: usize| json["walk"][k][c].as_f64().unwrap();
    for c in 0..3 {
        let kept = channel("power_absorbed", c) + channel("power_escaped", c) + channel("power_residual", c);
        assert!((kept / channel("power_in", c) - 1.0).abs() < 0.03, "balance of channel {c}");
    }
    let rule = fs::read_to_string(&dep).unwrap();
    for part in ["office.glb", "office.lightmap0.exr", "c.toml"] {
        assert!(rule.contains(part), "{rule}");
    }
    assert_eq!(
        files(&out).keys().cloned().collect::<Vec<_>>(),
        ["office.glb", "office.lightmap0.exr", "office.lightmap0.png"]
    );
}

/// What follows the last stage in a report: nothing differs between the file and standard output.
fn tail(report: &Path) -> &'static str {
    assert!(
        !fs::read_to_string(report).unwrap().contains("\"name\": \"write\""),
        "the report is made before the write"
    );
    ""
}

#[test]
fn strict_turns_warnings_into_code_5_with_outputs() {
    let home = folder();
    let primitives = fixture("primitives/primitives.gltf");
    let mut all = vec!["bake", path(&primitives), "-o", path(home.path()), "--strict"];
    all.extend(QUICK);
    let done = expect(&all, 5);
    assert!(text(&done.stderr).contains("warning: unsupported-extension"));
    assert!(done.stdout.is_empty());
    assert!(home.path().join("primitives.lightmap0.exr").exists());
}

#[test]
fn layouts_that_are_to_be_kept_must_be_there() {
    let home = folder();
    let all =
        ["bake", path(&fixture("cornell/cornell.gltf")), "-o", path(home.path()), "--uv", "keep"].map(str::to_owned);
    let said = text(&expect(&all.each_ref().map(String::as_str), 1).stderr);
    let error = said.lines().find(|l| l.starts_with("error: ")).unwrap();
    assert!(error.contains("no TEXCOORD_1 to keep") && error.contains("more nodes") && error.contains(", "), "{error}");
    assert!(files(home.path()).is_empty());
}

#[test]
fn the_last_line_counts_all_bounces_and_the_report_the_document() {
    let home = folder();
    let (cornell, report) = (fixture("cornell/cornell.gltf"), home.path().join("r.json"));
    let bake = |more: &[&str]| {
        let all =
            [&["bake", path(&cornell), "-o", path(home.path()), "--report", path(&report)], more, &QUICK].concat();
        text(&expect(&all, 0).stderr)
    };
    for n in ["0", "1", "3"] {
        let said = bake(&["--bounces", n]);
        assert!(said.contains(&format!(", {n} bounces, ")), "{n}: {said}");
    }
    let count = |file: &Path| serde_json::from_slice::<serde_json::Value>(&fs::read(file).unwrap()).unwrap();
    let materials = count(&cornell)["materials"].as_array().unwrap().len();
    assert_eq!(count(&report)["scene"]["materials"], materials);
}

#[test]
fn a_black_bake_says_why() {
    let home = folder();
    let cornell = fixture("cornell/cornell.gltf");
    let config = home.path().join("dark.toml");
    fs::write(&config, "[[rules]]\nnodes = [\"*\"]\nemission = 0\n").unwrap();
    let bake = |more: &[&str]| {
        let all = [&["bake", path(&cornell), "-o", path(home.path())], more, &QUICK].concat();
        text(&expect(&all, 0).stderr).to_owned()
    };
    let dark = bake(&["--config", path(&config)]);
    assert!(dark.contains("warning: no-light: the scene has no light") && dark.contains("--sky"), "{dark}");
    assert!(!bake(&["--config", path(&config), "--sky", "1"]).contains("no-light"));
    assert!(!bake(&[]).contains("no-light"));
}

#[test]
fn of_many_warnings_alike_the_first_are_told() {
    let home = folder();
    let name = "cornell/cornell.gltf";
    let mut document: serde_json::Value = serde_json::from_slice(&fs::read(fixture(name)).unwrap()).unwrap();
    let parts = document["nodes"].as_array().unwrap().iter().filter(|n| n.get("mesh").is_some()).count();
    assert!(parts > 6);
    let channel = |node| serde_json::json!({"sampler": 0, "target": {"node": node, "path": "translation"}});
    let nodes = document["nodes"].as_array().unwrap().len();
    let channels: Vec<_> = (0..nodes).map(channel).collect();
    document["animations"] = serde_json::json!([{"samplers": [{"input": 0, "output": 0}], "channels": channels}]);
    let input = home.path().join("moving.gltf");
    fs::write(&input, document.to_string()).unwrap();
    for buffer in document["buffers"].as_array().unwrap() {
        let file = buffer["uri"].as_str().unwrap();
        fs::copy(fixture(name).with_file_name(file), home.path().join(file)).unwrap();
    }
    let out = home.path().join("out/moving.gltf");
    let bake = |more: &[&str]| {
        let all = [&["bake", path(&input), "-o", path(&out), "--texels-per-meter", "2"], more, &QUICK].concat();
        text(&expect(&all, 0).stderr).to_owned()
    };
    let (few, all) = (bake(&[]), bake(&["-v"]));
    let count = |said: &str| said.matches("warning: animated-node [").count();
    assert_eq!((count(&few), count(&all)), (5, parts), "{few}");
    assert!(few.contains(&format!("animated-node: {} more of these", parts - 5)), "{few}");
    assert!(!all.contains("more of these"), "{all}");
}

#[test]
fn compare_tells_equal_from_different() {
    let home = folder();
    let cornell = fixture("cornell/cornell.gltf");
    let bake = |name: &str, seed: &str, density: &str| {
        let out = home.path().join(name);
        fs::create_dir(&out).unwrap();
        let mut all = vec!["bake", path(&cornell), "-o", path(&out), "--seed", seed, "--texels-per-meter", density];
        all.extend(QUICK);
        expect(&all, 0);
        out.join("cornell.lightmap0.exr")
    };
    let (a, b, small) = (bake("a", "1", "6"), bake("b", "2", "6"), bake("c", "1", "3"));
    expect(&["compare", path(&a), path(&a), "--fail", "0"], 0);
    expect(&["compare", path(&a), path(&b), "--fail", "1e-6"], 7);
    expect(&["compare", path(&a), path(&b), "--fail", "0.9"], 0);
    expect(&["compare", path(&a), path(&small)], 3);
    let json: serde_json::Value =
        serde_json::from_slice(&expect(&["compare", path(&a), path(&b), "--json"], 0).stdout).unwrap();
    assert!(json["nrmse"].as_f64().unwrap() > 0.0);
}

#[test]
fn help_is_enough_to_start() {
    let help = text(&expect(&["--help"], 0).stdout);
    for word in ["bake", "inspect", "compare", "render", "Exit codes", "texelwalk bake room.glb -o out/"] {
        assert!(help.contains(word), "{word}");
    }
    let bake = text(&expect(&["bake", "--help"], 0).stdout);
    for word in ["--preset", "--texels-per-meter", "--splat", "--gather", "--sky", "--report", "--depfile", "--threads"]
    {
        assert!(bake.contains(word), "{word}");
    }
}

#[cfg(unix)]
#[test]
fn an_interrupt_leaves_nothing() {
    let home = folder();
    let out = home.path().join("out");
    let office = fixture("office/office.glb");
    let mut child = Command::new(PROGRAM)
        .args(["bake", path(&office), "-o", path(&out), "--preset", "final", "-q"])
        .stdin(Stdio::null())
        .spawn()
        .unwrap();
    std::thread::sleep(Duration::from_secs(2));
    let kill = Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(kill.success());
    let start = Instant::now();
    let status = child.wait().unwrap();
    assert_eq!(status.code(), Some(130));
    assert!(start.elapsed() < Duration::from_secs(10), "{:?}", start.elapsed());
    assert!(files(home.path()).is_empty() && !out.exists());
}

/// Every output of a bake at a number of threads.
fn baked(name: &str, options: &[&str], prefix: &[&str]) -> BTreeMap<String, Vec<u8>> {
    let home = folder();
    let input = fixture(name);
    let mut all: Vec<&str> = prefix.to_vec();
    all.extend([PROGRAM, "bake", path(&input), "-o", path(home.path()), "-q"]);
    all.extend(options);
    let out = Command::new(all[0]).args(&all[1..]).stdin(Stdio::null()).output();
    let out = out.unwrap_or_else(|e| panic!("{} is needed: {e}", all[0]));
    assert!(out.status.success(), "{all:?}: {}", text(&out.stderr));
    files(home.path())
}

#[test]
fn the_same_bytes_at_any_thread_count_and_on_one_cpu() {
    let cases: [(&str, &[&str]); 3] = [
        ("office/office.glb", &["--preset", "preview"]),
        ("cornell/cornell.gltf", &["--preset", "paper", "--lines-per-texel", "20"]),
        ("courtyard/courtyard.gltf", &["--preset", "preview", "--texels-per-meter", "2", "--sky", "0.3,0.4,0.6"]),
    ];
    for (name, options) in cases {
        let with = |threads: &'static str| [options, &["--threads", threads]].concat();
        let one = baked(name, &with("1"), &[]);
        assert!(one.len() >= 3);
        for threads in ["1", "2", "3", "8"] {
            assert!(baked(name, &with(threads), &[]) == one, "{name} at {threads} threads");
        }
        assert!(baked(name, options, &["taskset", "-c", "0"]) == one, "{name} on one CPU");
        let other = baked(name, &[options, &["--seed", "5"]].concat(), &[]);
        let lightmap = other.keys().find(|k| k.ends_with("0.exr")).unwrap();
        assert!(other[lightmap] != one[lightmap], "{name}: the seed does nothing");
    }
}

/// The glTF files of all fixtures.
fn all_fixtures() -> Vec<PathBuf> {
    let mut found = vec![];
    for folder in fs::read_dir(fixture("")).unwrap().map(|e| e.unwrap().path()).filter(|p| p.is_dir()) {
        let files = fs::read_dir(folder).unwrap().map(|e| e.unwrap().path());
        found.extend(files.filter(|p| p.extension().is_some_and(|e| e == "gltf" || e == "glb")));
    }
    found.sort();
    assert!(found.len() >= 12);
    found
}

#[test]
fn every_fixture_bakes_and_renders() {
    for input in all_fixtures() {
        let home = folder();
        let density = if input.to_string_lossy().contains("freedoom") { "0.5" } else { "4" };
        let mut all =
            vec!["bake", path(&input), "-o", path(home.path()), "--texels-per-meter", density, "--sky", "0.2"];
        all.extend(QUICK);
        expect(&all, 0);
        let document = home.path().join(input.file_name().unwrap());
        let [picture, radiance] = ["view.png", "view.exr"].map(|name| home.path().join(name));
        for out in [&picture, &radiance] {
            let size = ["--width", "64", "--height", "48", "--samples", "1"];
            expect(&[&["render", path(&document), "-o", path(out)], size.as_slice()].concat(), 0);
        }
        assert!(fs::metadata(&picture).unwrap().len() > 100);
        assert_eq!(exr::read_rgba(&radiance).unwrap().width, 64);
        let stem = input.file_stem().unwrap().to_string_lossy().into_owned();
        let image = exr::read_rgba(&home.path().join(format!("{stem}.lightmap0.exr"))).unwrap();
        assert!(image.pixels.iter().flatten().all(|v| v.is_finite() && *v >= 0.0), "{stem}");
        let covered = image.pixels.iter().filter(|p| p[3] == 1.0);
        let lit = covered.clone().filter(|p| p[0] > 0.0).count();
        assert!(lit * 3 > covered.count(), "{stem}: mostly dark");
    }
}
