//! Time limit and cancellation, asked between pieces of work.

use super::Error;
use core::time::Duration;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::sync::atomic::Ordering;
use std::time::Instant;

/// Knows when to give up.
#[derive(Clone, Debug)]
pub(super) struct Guard {
    start: Instant,
    limit: Option<Duration>,
    cancel: Option<Arc<AtomicBool>>,
}

impl Guard {
    /// Starts the clock.
    pub(super) fn new(limit: Option<Duration>, cancel: Option<Arc<AtomicBool>>) -> Self {
        Self { start: Instant::now(), limit, cancel }
    }

    /// An error once the time is over or the caller has cancelled.
    pub(super) fn check(&self) -> Result<(), Error> {
        if self.cancel.as_ref().is_some_and(|cancel| cancel.load(Ordering::Relaxed)) {
            return Err(Error::Cancelled);
        }
        match self.limit {
            Some(limit) if self.start.elapsed() > limit => Err(Error::TimeLimit(limit)),
            _ => Ok(()),
        }
    }
}
