//! How far a stage is, and whether it should stop; written by the workers, read by whoever shows it.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};

/// Counters shared between a stage and its observer.
#[derive(Debug, Default)]
pub struct Progress {
    done: AtomicU64,
    total: AtomicU64,
    cancelled: Arc<AtomicBool>,
    expired: AtomicBool,
}

impl Progress {
    /// Starts a piece of work of `total` units.
    pub fn start(&self, total: u64) {
        self.done.store(0, Relaxed);
        self.total.store(total, Relaxed);
    }

    /// Adds finished units.
    pub fn advance(&self, units: u64) {
        self.done.fetch_add(units, Relaxed);
    }

    /// Finished units and all units; all units are 0 where nobody knows.
    #[must_use]
    pub fn state(&self) -> (u64, u64) {
        (self.done.load(Relaxed), self.total.load(Relaxed))
    }

    /// Asks the workers to stop; their results are then meaningless.
    pub fn cancel(&self) {
        self.cancelled.store(true, Relaxed);
    }

    /// Asks the workers to stop because their time is up, or takes that back.
    pub fn expire(&self, expired: bool) {
        self.expired.store(expired, Relaxed);
    }

    /// The workers should stop, for whatever reason.
    #[must_use]
    pub fn cancelled(&self) -> bool {
        self.interrupted() || self.expired.load(Relaxed)
    }

    /// Somebody asked to stop.
    #[must_use]
    pub fn interrupted(&self) -> bool {
        self.cancelled.load(Relaxed)
    }

    /// The flag behind [`Progress::interrupted`], for code that takes a flag.
    #[must_use]
    pub fn cancel_flag(&self) -> Arc<AtomicBool> {
        Arc::clone(&self.cancelled)
    }
}
