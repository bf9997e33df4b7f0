//! Readers fed with what nobody meant to write: no panic, no hang, no memory out of proportion, and what is accepted is
//! sound. A stable-Rust equivalent of coverage-blind fuzzing.
//!
//! Inputs are small valid files (`samples`), changed at random (`support/mutate.rs`); `targets` are the readers. An execution
//! is named by target, seed and number, and can be run again by these: the same on every machine.
//!
//! `cargo test --test fuzz` runs [`QUICK`] executions, `-- --ignored` [`LONG`]. By hand, with any number and seed:
//!
//! ```sh
//! FUZZ_EXECUTIONS=1000000 FUZZ_SEED=7 cargo test --release --locked --test fuzz -- --ignored --nocapture
//! ```
//!
//! `FUZZ_TARGET=check` leaves out all other targets, `FUZZ_NUMBER=1267` all other executions.

#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "tests")]

#[path = "../support/compressed.rs"]
mod compressed;
#[path = "../support/gltf_builder.rs"]
mod gltf_builder;
#[path = "../support/mutate.rs"]
mod mutate;
#[path = "../support/rich.rs"]
mod rich;
mod samples;
mod targets;
mod watch;

use mutate::Random;
use samples::Samples;
use std::panic::AssertUnwindSafe;
use std::sync::Mutex;
use targets::Target;
use watch::{Cost, Counting};

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Executions of the default run.
const QUICK: u64 = 15_000;
/// Executions of the ignored run.
const LONG: u64 = 20_000;
/// Longest that an execution may take [s]; run again, for machines that were busy.
const PATIENCE: f64 = 2.0;
/// Memory that any execution may take, and beyond that for each byte of its input [bytes]. An even WebP of 4096² pixels has
/// a few bytes; packed pictures grow by up to 1032 bytes for one, and a pixel takes 16.
const MEMORY: (usize, usize) = (128 << 20, 4096);
/// Findings after which a run ends.
const ENOUGH: usize = 20;

/// One campaign at a time: memory is counted for the whole process.
static ALONE: Mutex<()> = Mutex::new(());

/// What the last panic said, on whatever thread.
static PANIC: Mutex<String> = Mutex::new(String::new());

#[derive(Default)]
struct Tally {
    executions: u64,
    accepted: u64,
    slowest: f64,
    /// Most memory of one execution [bytes].
    memory: usize,
}

/// Runs an execution; what became of it, its cost, and the message if it panicked.
fn execute(target: &Target, samples: &Samples, seed: u64, number: u64) -> (Result<targets::Outcome, String>, Cost) {
    let name = || format!("{} seed {seed} number {number}", target.name);
    watch::watched(name, || {
        let mut random = Random::new(target.name, seed, number);
        let result = std::panic::catch_unwind(AssertUnwindSafe(|| (target.run)(samples, &mut random)));
        result.map_err(|_| PANIC.lock().unwrap().clone())
    })
}

fn judge(target: &Target, samples: &Samples, seed: u64, number: u64, tally: &mut Tally) -> Option<String> {
    let (result, mut cost) = execute(target, samples, seed, number);
    if cost.seconds > PATIENCE {
        cost = execute(target, samples, seed, number).1;
    }
    tally.executions += 1;
    tally.slowest = tally.slowest.max(cost.seconds);
    tally.memory = tally.memory.max(cost.memory);
    let place = format!("{} seed {seed} number {number}", target.name);
    let outcome = match result {
        Ok(outcome) => outcome,
        Err(message) => return Some(format!("{place}: {message}")),
    };
    tally.accepted += u64::from(outcome.accepted);
    let most = MEMORY.0 + MEMORY.1 * outcome.bytes;
    if cost.memory > most {
        return Some(format!("{place}: {} MiB for {} bytes", cost.memory >> 20, outcome.bytes));
    }
    (cost.seconds > PATIENCE).then(|| format!("{place}: took {:.1} s", cost.seconds))
}

/// Runs about this many executions over all targets.
fn campaign(seed: u64, executions: u64) {
    let _alone = ALONE.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    watch::start_watchdog();
    let usual = std::panic::take_hook();
    std::panic::set_hook(Box::new(|info| *PANIC.lock().unwrap() = info.to_string()));
    let samples = Samples::new();
    let mut findings = vec![];
    let only = std::env::var("FUZZ_TARGET").ok();
    let number = std::env::var("FUZZ_NUMBER").ok().map(|text| text.parse().expect("FUZZ_NUMBER is a number"));
    for target in targets::ALL.iter().filter(|target| only.as_ref().is_none_or(|only| only == target.name)) {
        let mut tally = Tally::default();
        let all = 0..executions * target.share / 1000;
        for number in number.map_or(all, |one: u64| one..one + 1) {
            findings.extend(judge(target, &samples, seed, number, &mut tally));
            if findings.len() >= ENOUGH {
                break;
            }
        }
        eprintln!(
            "{:14} {:8} executions, {:5.1} % accepted, slowest {:.2} s, most memory {} MiB",
            target.name,
            tally.executions,
            100.0 * tally.accepted as f64 / tally.executions.max(1) as f64,
            tally.slowest,
            tally.memory >> 20
        );
        let share = tally.accepted as f64 / tally.executions.max(1) as f64;
        if number.is_none() && !(0.01..=0.99).contains(&share) {
            findings.push(format!("{}: {share} of its inputs are accepted; it tests only one side", target.name));
        }
    }
    std::panic::set_hook(usual);
    assert!(findings.is_empty(), "{} findings:\n{}", findings.len(), findings.join("\n"));
}

/// Found by seed 11, number 1267: every ray crossed all faces, for every face in every cell of every texel.
#[test]
fn a_thousand_faces_in_one_place_are_checked_before_the_watchdog_barks() {
    let _alone = ALONE.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    watch::start_watchdog();
    let samples = Samples::new();
    let mut document = samples.baked.clone();
    let primitives = document.json["meshes"].as_array_mut().unwrap().last_mut().unwrap()["primitives"].as_array_mut();
    let primitives = primitives.unwrap();
    let first = primitives[0].clone();
    primitives.resize(1_000, first);
    std::fs::write(samples.path("baked/box.glb"), document.glb()).unwrap();
    let (report, cost) = watch::watched(|| "a thousand faces".to_owned(), || targets::check(&samples));
    assert!(report.unwrap().faults.contains(&"uv-overlap"));
    assert!(cost.seconds < 10.0 * PATIENCE, "{} s", cost.seconds);
}

#[test]
fn nothing_panics_hangs_or_takes_memory_out_of_proportion() {
    campaign(1, QUICK);
}

#[test]
#[ignore = "slow: half a minute; more by FUZZ_EXECUTIONS and FUZZ_SEED"]
fn nothing_does_so_in_a_long_run() {
    let number = |name: &str, otherwise: u64| {
        std::env::var(name)
            .map_or(otherwise, |text| text.parse().unwrap_or_else(|_| panic!("{name} is no number: {text}")))
    };
    campaign(number("FUZZ_SEED", 2), number("FUZZ_EXECUTIONS", LONG));
}
