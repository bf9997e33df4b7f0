//! Runs stages: keeps their times, shows them, and ends them early when somebody asks to stop or their time is up.

use super::{Error, Observer};
use crate::base::Progress;
use crate::output::report;
use std::sync::Arc;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::{Duration, Instant};

/// Why a stage did not end by itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Stop {
    /// Somebody asked to stop.
    Interrupted,
    /// The time given to [`Clock::within`] was up.
    Expired,
}

/// Stages and their times.
pub(super) struct Clock<'a> {
    pub(super) observer: &'a dyn Observer,
    pub(super) progress: Arc<Progress>,
    pub(super) stages: Vec<report::Stage>,
    started: Instant,
}

impl<'a> Clock<'a> {
    pub(super) fn new(observer: &'a dyn Observer, progress: Arc<Progress>) -> Self {
        Self { observer, progress, stages: vec![], started: Instant::now() }
    }

    /// Seconds since the bake began.
    pub(super) fn elapsed(&self) -> f64 {
        self.started.elapsed().as_secs_f64()
    }

    /// Runs a stage whose result is worth nothing once somebody has asked to stop.
    pub(super) fn timed<T>(&mut self, name: &'static str, f: impl FnOnce(&Progress) -> T) -> Result<T, Stop> {
        let value = self.lasting(name, f);
        if self.progress.interrupted() {
            Err(Stop::Interrupted)
        } else if self.progress.cancelled() {
            Err(Stop::Expired)
        } else {
            Ok(value)
        }
    }

    /// Runs a stage that changes what outlives the program, and says itself whether it stopped before it did: files that
    /// are in place are there, even if somebody asked to stop a moment later.
    pub(super) fn lasting<T>(&mut self, name: &'static str, f: impl FnOnce(&Progress) -> T) -> T {
        self.progress.start(0);
        self.observer.stage(name, &self.progress);
        let start = Instant::now();
        let value = f(&self.progress);
        let seconds = start.elapsed().as_secs_f64();
        self.observer.done(name, seconds);
        self.stages.push(report::Stage { name: name.to_owned(), seconds });
        value
    }

    /// Runs stages that have to end within some seconds, if a number is given; later their results are thrown away.
    pub(super) fn within<T>(
        &mut self,
        seconds: Option<f64>,
        stages: impl FnOnce(&mut Self) -> Result<T, Stop>,
    ) -> Result<T, Stop> {
        let Some(seconds) = seconds else { return stages(self) };
        let (done, wait) = channel::<()>();
        let progress = Arc::clone(&self.progress);
        let guard = std::thread::spawn(move || {
            if wait.recv_timeout(Duration::from_secs_f64(seconds.max(0.0))) == Err(RecvTimeoutError::Timeout) {
                progress.expire(true);
            }
        });
        let result = stages(self);
        drop(done);
        // A guard that panicked has not expired anything, and there is nothing else to lose.
        let _ = guard.join();
        self.progress.expire(false);
        result
    }
}

impl From<Stop> for Error {
    fn from(_: Stop) -> Self {
        Self::Interrupted
    }
}
