//! Refining until an error or a time is reached, and what the report says of it.

#![allow(clippy::unwrap_used, reason = "tests")]

use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Instant;
use texelwalk::compare;
use texelwalk::output::exr;

/// A bake of cornell: exit code, standard error, report, folder.
struct Baked {
    code: Option<i32>,
    said: String,
    report: Value,
    home: tempfile::TempDir,
}

fn bake(options: &[&str]) -> Baked {
    let home = tempfile::tempdir().unwrap();
    let input = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/cornell/cornell.gltf");
    let report = home.path().join("r.json");
    let mut command = Command::new(env!("CARGO_BIN_EXE_texelwalk"));
    command.arg("bake").arg(&input).arg("-o").arg(home.path()).arg("--report").arg(&report);
    let out = command.args(["--texels-per-meter", "5"]).args(options).stdin(Stdio::null()).output().unwrap();
    let report = fs::read(&report).map_or(Value::Null, |bytes| serde_json::from_slice(&bytes).unwrap());
    let said = String::from_utf8_lossy(&out.stderr).into_owned();
    Baked { code: out.status.code(), said, report, home }
}

impl Baked {
    fn page(&self) -> PathBuf {
        self.home.path().join("cornell.lightmap0.exr")
    }

    fn budgets(&self) -> Vec<f64> {
        let passes = self.report["refinement"]["passes"].as_array().unwrap();
        passes.iter().map(|p| p["budget"].as_f64().unwrap()).collect()
    }

    fn stated(&self) -> f64 {
        self.report["error"]["estimated_nrmse"].as_f64().unwrap()
    }

    fn ended_by(&self) -> &str {
        self.report["refinement"]["ended_by"].as_str().unwrap()
    }

    fn warns_of(&self, code: &str) -> bool {
        let listed = self.report["warnings"].as_array().unwrap().iter().any(|w| w["code"] == code);
        assert_eq!(listed, self.said.contains(&format!("warning: {code}: ")), "{}", self.said);
        listed
    }
}

#[test]
fn without_a_goal_the_budget_ends_it() {
    let plain = bake(&["--preset", "preview"]);
    assert_eq!((plain.code, plain.ended_by(), plain.budgets()), (Some(0), "budget", vec![1.0]));
    assert!(plain.report["settings"].get("target-error").is_none(), "settings of old files stay as they were");
}

#[test]
fn a_target_is_met_in_truth_and_at_any_thread_count() {
    let reference =
        bake(&["--splat", "none", "--gather", "1024", "--lines-per-texel", "300", "--direct-samples", "256"]);
    let target = |threads| bake(&["--target-error", "0.03", "--threads", threads]);
    let (one, three) = (target("1"), target("3"));
    assert_eq!((one.code, one.ended_by()), (Some(0), "target-error"));
    assert!(one.stated() <= 0.03 && one.stated() > 0.015, "{}", one.stated());
    assert_eq!(fs::read(one.page()).unwrap(), fs::read(three.page()).unwrap());
    let read = |b: &Baked| exr::read_rgba(&b.page()).unwrap();
    let measured = compare::compare(&read(&reference), &read(&one), None).unwrap().nrmse;
    assert!(measured <= 0.03 * 1.25, "{measured}");
    assert!(!one.warns_of("target-error-missed"));
}

#[test]
fn an_impossible_target_ends_and_says_so() {
    let little = ["--gather", "2", "--lines-per-texel", "1", "--direct-samples", "1"];
    let missed = bake(&[&["--target-error", "1e-9"], &little[..]].concat());
    assert_eq!((missed.code, missed.ended_by()), (Some(0), "budget"));
    assert!(missed.warns_of("target-error-missed"));
    let total: f64 = missed.budgets().iter().sum();
    assert!(total > 200.0 && total <= 256.0, "{total}");
    assert!(missed.page().exists());
}

#[test]
fn a_target_that_is_no_error_is_refused() {
    for bad in [["--target-error", "0"], ["--target-error", "nan"], ["--time-limit", "-1"], ["--time-limit", "inf"]] {
        let option = format!("{}={}", bad[0], bad[1]);
        let refused = bake(&[&option]);
        assert_eq!(refused.code, Some(2), "{bad:?}");
        assert!(refused.said.contains(bad[0]), "{}", refused.said);
    }
}

#[test]
fn time_is_kept() {
    let start = Instant::now();
    let limited = bake(&["--time-limit", "3"]);
    let seconds = start.elapsed().as_secs_f64();
    assert_eq!((limited.code, limited.ended_by()), (Some(0), "time-limit"));
    assert!(seconds <= 4.0, "{seconds}");
    assert!(limited.budgets().len() > 1);
    assert!(!limited.warns_of("time-limit-exceeded"));

    let late = bake(&["--time-limit", "0.001", "--target-error", "0.001"]);
    assert_eq!((late.code, late.ended_by(), late.budgets().len()), (Some(0), "time-limit", 1));
    assert!(late.warns_of("time-limit-exceeded") && late.warns_of("target-error-missed"));
    assert_eq!(bake(&["--time-limit", "0.001", "--strict"]).code, Some(5));
}
