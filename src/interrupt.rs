//! What Ctrl-C does to a command.
//!
//! While a command only reads and computes, it is ended at once, with a line and the exit code of an interrupt. A bake,
//! and whatever writes files, says with [`Interrupt::hold`] that it stops by itself, between two steps of its own: either
//! nothing is written then, or everything is and the command succeeds.

use crate::commands::Exit;
use crate::show;
use std::sync::{Arc, Mutex, PoisonError};
use texelwalk::base::Progress;

/// Ctrl-C, and who takes care of it.
pub(crate) struct Interrupt {
    progress: Arc<Progress>,
    held: Arc<Mutex<bool>>,
}

impl Interrupt {
    /// Begins to listen; once in a program.
    pub(crate) fn listen() -> Result<Self, (Exit, String)> {
        let this = Self { progress: Arc::default(), held: Arc::default() };
        let (progress, held) = (Arc::clone(&this.progress), Arc::clone(&this.held));
        let handler = move || {
            // Locked while it exits, so that nothing begins to write meanwhile.
            let held = held.lock().unwrap_or_else(PoisonError::into_inner);
            if *held {
                progress.cancel();
            } else {
                show::error("interrupted; nothing was written");
                std::process::exit(i32::from(Exit::Interrupted as u8));
            }
        };
        ctrlc::set_handler(handler).map_err(|e| (Exit::Failed, e.to_string()))?;
        Ok(this)
    }

    /// From here on the command stops by itself, when this says so.
    pub(crate) fn hold(&self) -> Arc<Progress> {
        *self.held.lock().unwrap_or_else(PoisonError::into_inner) = true;
        Arc::clone(&self.progress)
    }
}
