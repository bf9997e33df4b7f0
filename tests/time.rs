//! Time: what `inspect` estimates against what a bake takes.
//!
//! Machines differ and are busy, so limits are wide: a tenth to ten times for a bake, a quarter to four times for how two
//! bakes compare.
#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "tests")]

use serde_json::Value;
use std::fs;
use std::path::Path;
use std::process::Command;

fn texelwalk(args: &[&str], threads: u64) -> Vec<u8> {
    let mut program = Command::new(env!("CARGO_BIN_EXE_texelwalk"));
    let done = program.args(args).env("RAYON_NUM_THREADS", threads.to_string()).output().unwrap();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    done.stdout
}

fn fixture(name: &str) -> String {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures").join(name).to_str().unwrap().to_owned()
}

/// The estimate [s] for so many threads.
fn estimate(input: &str, options: &[&str], threads: u64) -> f64 {
    let facts = texelwalk(&[&["inspect", input, "--json"], options].concat(), threads);
    let time = &serde_json::from_slice::<Value>(&facts).unwrap()["time"];
    assert_eq!(time["threads"], threads);
    time["seconds"].as_f64().unwrap()
}

/// What all stages of a bake took on two threads [s].
fn taken(input: &str, options: &[&str]) -> f64 {
    let home = tempfile::tempdir().unwrap();
    let path = |name: &str| home.path().join(name).to_str().unwrap().to_owned();
    let (out, report) = (path("out/"), path("report.json"));
    texelwalk(&[&["bake", input, "-q", "-o", &out, "--report", &report], options].concat(), 2);
    let report: Value = serde_json::from_slice(&fs::read(report).unwrap()).unwrap();
    report["stages"].as_array().unwrap().iter().map(|stage| stage["seconds"].as_f64().unwrap()).sum()
}

#[test]
fn estimates_are_near_and_compare_as_bakes_do() {
    let (office, cornell) = (fixture("office/office.glb"), fixture("cornell/cornell.gltf"));
    let few = ["--preset", "preview", "--texels-per-meter", "4"];
    let many = ["--preset", "production", "--texels-per-meter", "8"];
    let pair = |input: &str, options: &[&str]| (estimate(input, options, 2), taken(input, options));
    let (small, large) = (pair(&cornell, &few), pair(&office, &many));
    eprintln!("estimated and taken: {small:?}, {large:?} s");
    for (estimated, taken) in [small, large] {
        assert!(estimated < 10.0 * taken && taken < 10.0 * estimated, "{estimated} s, but it took {taken} s");
    }
    let off = (large.0 / small.0) / (large.1 / small.1);
    assert!(0.25 < off && off < 4.0, "the ratio of two bakes is estimated {off} times too large");
}

#[test]
fn estimates_fall_with_threads_and_grow_with_rays_and_texels() {
    let cornell = fixture("cornell/cornell.gltf");
    let of = |preset: &str, density: &str, threads: u64| {
        estimate(&cornell, &["--preset", preset, "--texels-per-meter", density], threads)
    };
    let plain = of("preview", "8", 1);
    assert!((of("preview", "8", 4) * 4.0 / plain - 1.0).abs() < 1e-9);
    assert!(of("production", "8", 1) > 2.0 * plain, "it has four times the rays and more");
    let finer = of("preview", "16", 1) / plain;
    assert!((2.0..4.2).contains(&finer), "four times the texels take {finer} times as long");
}
