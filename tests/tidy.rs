//! Rules of the repository that no lint can express.

#![allow(clippy::unwrap_used, reason = "tests")]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Which folder of `src` may name which other one. Read it top-down: it is the pipeline.
const MAY_USE: &[(&str, &[&str])] = &[
    ("base", &[]),
    ("scene", &["base"]),
    ("trace", &["base", "scene"]),
    ("contacts", &["base", "scene", "trace"]),
    ("atlas", &["base", "scene", "trace"]),
    ("patches", &["base", "scene", "trace", "atlas"]),
    ("light", &["base", "scene", "trace", "patches"]),
    ("walk", &["base", "trace", "patches"]),
    ("gather", &["base", "trace", "patches"]),
    ("finish", &["base", "atlas", "patches"]),
    ("seams", &["base", "scene", "trace", "atlas", "patches", "finish"]),
    ("vertices", &["base", "scene", "atlas", "patches", "finish"]),
    ("output", &["base", "scene", "atlas", "finish", "vertices"]),
    ("render", &["base", "scene", "trace", "output"]),
    ("html", &["base", "scene", "trace", "atlas", "patches", "finish", "vertices", "output", "render"]),
    ("check", &["base", "scene", "trace", "atlas", "patches", "vertices", "output", "render"]),
];
const MOST_LINES: usize = 600;

fn rust_files(folder: &Path, out: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            rust_files(&path, out);
        } else if path.extension().is_some_and(|e| e == "rs") {
            out.push(path);
        }
    }
    out.sort();
}

/// Names after `crate::` on a line. Groups and double `super` would hide names, so they are faults themselves.
fn stages_named(line: &str) -> Vec<String> {
    if line.contains("crate::{") || line.contains("super::super::super") {
        return vec!["a hidden stage (one `use crate::…` a line)".into()];
    }
    let word = |s: &str| s.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
    line.split("crate::").skip(1).map(word).collect()
}

fn faults_of(stage: &str, name: &str, text: &str) -> Vec<String> {
    let mut faults = vec![];
    if !text.starts_with("//!") {
        faults.push(format!("{name}: no header"));
    }
    if text.lines().count() > MOST_LINES {
        faults.push(format!("{name}: over {MOST_LINES} lines"));
    }
    let Some((_, allowed)) = MAY_USE.iter().find(|(s, _)| *s == stage) else { return faults };
    for (i, line) in text.lines().enumerate().filter(|(_, l)| !l.trim_start().starts_with("//")) {
        for used in stages_named(line) {
            if used != stage && !allowed.contains(&used.as_str()) {
                faults.push(format!("{name}:{}: {stage} may not use {used}", i + 1));
            }
        }
    }
    faults
}

#[test]
fn sources_follow_the_table() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let (mut sources, mut tests) = (vec![], vec![]);
    rust_files(&root.join("src"), &mut sources);
    rust_files(&root.join("tests"), &mut tests);
    rust_files(&root.join("pipelines"), &mut tests);
    assert!(sources.len() > 50 && tests.len() > 10);
    let mut faults = vec![];
    for path in sources.iter().chain(&tests) {
        let name = path.strip_prefix(root).unwrap().to_string_lossy().replace('\\', "/");
        let inner = name.strip_prefix("src/").unwrap_or("");
        let stage = inner.split(['/', '.']).next().unwrap();
        faults.extend(faults_of(stage, &name, &fs::read_to_string(path).unwrap()));
    }
    assert!(faults.is_empty(), "\n{}\n", faults.join("\n"));
}

#[test]
fn the_table_notices_what_it_should() {
    let bad = |stage: &str, text: &str| faults_of(stage, "x.rs", &format!("//! h\n{text}")).len();
    assert_eq!(bad("walk", "use crate::light::Settings;"), 1);
    assert_eq!(bad("walk", "use crate::{base, light};"), 1);
    assert_eq!(bad("walk", "let x = crate::scene::load();"), 1);
    assert_eq!(bad("walk", "use crate::base::Rgb; // crate::base"), 0);
    assert_eq!(bad("bake", "use crate::light::Settings;"), 0);
    assert_eq!(faults_of("walk", "x.rs", "use std::io;").len(), 1);
}

/// What git tracks is the repository.
fn tracked_text() -> Vec<(String, String)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let listed = Command::new("git").arg("-C").arg(root).args(["ls-files", "-z"]).output().expect("git is needed");
    assert!(listed.status.success(), "git ls-files failed; run the tests in a clone");
    let names = String::from_utf8(listed.stdout).unwrap();
    let read = |name: &str| Some((name.to_owned(), fs::read_to_string(root.join(name)).ok()?));
    names.split('\0').filter(|n| !n.is_empty()).filter_map(read).collect()
}

#[test]
fn the_repository_speaks_of_itself_alone() {
    let hosts = ["crates", "pypi", "npmjs", "pythonhosted"]
        .map(|h| [format!("{h}.io"), format!("{h}.org"), format!("{h}.com")]);
    let mut faults = vec![];
    for (name, text) in tracked_text() {
        if name.ends_with("Cargo.lock") {
            continue; // cargo writes its registry there
        }
        for host in hosts.iter().flatten().filter(|h| text.contains(h.as_str())) {
            faults.push(format!("{name}: names the registry host {host}"));
        }
        for line in text.lines().filter(|l| l.ends_with(' ') && name.ends_with(".rs")) {
            faults.push(format!("{name}: a line ends with a space: {line}"));
        }
    }
    assert!(faults.is_empty(), "\n{}\n", faults.join("\n"));
}

#[test]
fn the_top_level_stays_small() {
    const ALLOWED: [&str; 10] = [
        "Cargo.toml",
        "Cargo.lock",
        "src",
        "pipelines",
        "fixtures",
        "tests",
        "README.md",
        "LICENSE-MIT",
        "LICENSE-APACHE",
        "build.rs",
    ];
    for (name, _) in tracked_text() {
        let top = name.split('/').next().unwrap();
        assert!(top.starts_with('.') || ALLOWED.contains(&top), "{top} does not belong on the top level");
    }
}
