//! What a person sees on the terminal: progress, warnings, what was written where.
//!
//! Standard error only; standard output is for data. On a terminal there is a bar per stage with the time that is left,
//! elsewhere a line per stage.

#![allow(clippy::print_stderr, reason = "this file is the terminal")]

use crate::commands::Exit;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::collections::BTreeMap;
use std::io::{IsTerminal, Write};
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;
use texelwalk::bake::{Observer, Outcome};
use texelwalk::base::{Progress, Warning};

/// Time between two looks at the progress of a stage.
const REFRESH: Duration = Duration::from_millis(100);
/// Warnings of one kind that are told one by one.
const MOST_ALIKE: usize = 5;

/// One clear line.
pub(crate) fn error(message: &str) {
    eprintln!("error: {message}");
}

/// One file that was written.
pub(crate) fn wrote(what: &str) {
    eprintln!("wrote {what}");
}

/// Writes data to standard output; a reader that went away is no error.
pub(crate) fn data(bytes: &[u8]) -> Result<(), (Exit, String)> {
    let mut out = std::io::stdout().lock();
    match out.write_all(bytes).and_then(|()| out.flush()) {
        Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => Err((Exit::Io, format!("standard output: {e}"))),
        _ => Ok(()),
    }
}

/// The observer that fits the terminal and the options.
pub(crate) fn observer(quiet: bool, verbose: bool) -> Box<dyn Observer> {
    if quiet {
        Box::new(Silent)
    } else if std::io::stderr().is_terminal() && !verbose {
        Box::new(Bars::default())
    } else {
        Box::new(Lines)
    }
}

/// Warnings, then files, then one line of figures.
pub(crate) fn outcome(outcome: &Outcome, verbose: bool) {
    let report = &outcome.report;
    warnings(&report.warnings, verbose);
    for (path, bytes) in &outcome.files {
        eprintln!("wrote {} ({})", path.display(), size(*bytes));
    }
    let atlas = &report.atlas;
    let error = report.error.estimated_nrmse.map_or(String::new(), |e| format!(", estimated error {:.2} %", e * 100.0));
    // A lamp's own shade can be all there is to an error.
    let [all, most] = [report.error.estimated_nrmse, report.error.estimated_nrmse_99].map(Option::unwrap_or_default);
    let of_most = format!(" ({:.2} % without the brightest hundredth of the texels)", most * 100.0);
    let error = if 0.0 < most && most < 0.5 * all { error + &of_most } else { error };
    eprintln!(
        "{} texels on {} page{} of {}x{} ({:.0} % used), {} bounces{error}",
        atlas.texels,
        atlas.pages,
        if atlas.pages == 1 { "" } else { "s" },
        atlas.page_size[0],
        atlas.page_size[1],
        atlas.utilization * 100.0,
        // The gather is one more.
        report.walk.bounces + u32::from(report.gather.rays > 0),
    );
    if let Some(vertices) = &report.vertices {
        let [fit, sampled] = [vertices.fit_nrmse, vertices.sampled_nrmse].map(|e| e * 100.0);
        let count = vertices.vertices;
        eprintln!("{count} vertices, {fit:.1} % off the texels (the texels at the vertices alone: {sampled:.1} %)");
    }
    if verbose {
        let rate = report.rays_per_second / 1e6;
        eprintln!("{} rays at {rate:.2} M/s, peak memory {}", report.rays, size(report.peak_memory_bytes));
    }
}

/// Of many of one kind the first ones, and how many there are besides; a model of 50 animated parts gives one for each.
fn warnings(all: &[Warning], verbose: bool) {
    let most = if verbose { usize::MAX } else { MOST_ALIKE };
    let mut seen: BTreeMap<&str, usize> = BTreeMap::new();
    for w in all {
        let count = seen.entry(w.code).or_default();
        *count += 1;
        if *count <= most {
            let node = w.node.as_ref().map_or(String::new(), |n| format!(" [{n}]"));
            eprintln!("warning: {}{node}: {}", w.code, w.message);
        }
    }
    for (code, count) in seen.into_iter().filter(|(_, count)| *count > most) {
        eprintln!("warning: {code}: {} more of these; -v tells all, and --report", count - most);
    }
}

fn size(bytes: u64) -> String {
    let units = [(1u64 << 30, "GiB"), (1 << 20, "MiB"), (1 << 10, "KiB")];
    match units.iter().find(|(unit, _)| bytes >= *unit) {
        Some((unit, name)) => format!("{:.1} {name}", bytes as f64 / *unit as f64),
        None => format!("{bytes} B"),
    }
}

struct Silent;

impl Observer for Silent {
    fn stage(&self, _: &'static str, _: &Arc<Progress>) {}
    fn done(&self, _: &'static str, _: f64) {}
}

struct Lines;

impl Observer for Lines {
    fn stage(&self, _: &'static str, _: &Arc<Progress>) {}

    fn done(&self, name: &'static str, seconds: f64) {
        eprintln!("{name:<8} {seconds:8.2} s");
    }
}

/// A bar per stage, drawn by a thread of its own.
#[derive(Default)]
struct Bars {
    current: Mutex<Option<Running>>,
}

struct Running {
    bar: ProgressBar,
    stop: Arc<AtomicBool>,
    thread: Option<std::thread::JoinHandle<()>>,
}

impl Observer for Bars {
    fn stage(&self, name: &'static str, progress: &Arc<Progress>) {
        let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::stderr());
        let style = ProgressStyle::with_template("{prefix:>8} {bar:30} {percent:>3} %  {elapsed} left {eta}  ");
        if let Ok(style) = style {
            bar.set_style(style);
        }
        bar.set_prefix(name);
        let stop = Arc::new(AtomicBool::new(false));
        let (b, s, p) = (bar.clone(), Arc::clone(&stop), Arc::clone(progress));
        let thread = std::thread::spawn(move || {
            while !s.load(Relaxed) {
                let (done, total) = p.state();
                if total > 0 {
                    b.set_length(total);
                    b.set_position(done.min(total));
                }
                std::thread::park_timeout(REFRESH);
            }
        });
        let running = Running { bar, stop, thread: Some(thread) };
        *self.current.lock().unwrap_or_else(PoisonError::into_inner) = Some(running);
    }

    fn done(&self, name: &'static str, seconds: f64) {
        let running = self.current.lock().unwrap_or_else(PoisonError::into_inner).take();
        if let Some(mut running) = running {
            running.stop.store(true, Relaxed);
            if let Some(thread) = running.thread.take() {
                thread.thread().unpark();
                let _ = thread.join();
            }
            running.bar.finish_and_clear();
        }
        eprintln!("{name:>8} {seconds:8.2} s");
    }
}
