//! What was baked → files: EXR pages, PNG previews, the glTF with its additions, USD layers, report, depfile.
//!
//! The EXR is the lightmap; [`formats`] are copies of its half floats for engines that load something else. What they
//! need to be decoded (formula, scale) is in the manifest beside each URI, so a reader never has to guess from a file
//! name. A document names one file as *the* page, so that readers that know a single URI keep working, and lists all of
//! them only where there is more than the plain EXR.
//!
//! Nothing here writes to a file but [`atomic::commit`], which puts a whole set of files in place at once; [`targets`]
//! tells before the work what it would refuse. The other functions return bytes, or [`Contents`] that make them in time,
//! and the same bytes on every run and at any thread count.

pub mod atomic;
mod contents;
pub mod depfile;
pub mod directional;
pub mod exr;
pub mod formats;
pub mod gltf;
mod journal;
pub mod jpeg;
pub mod names;
#[cfg(unix)]
pub mod placer;
pub mod png;
pub mod report;
pub mod targets;
pub mod usd;

pub use crate::base::splice;
pub use contents::Contents;
pub use contents::File;
pub use contents::Files;

use std::path::Path;
use std::path::PathBuf;

/// What can go wrong on the way from results to files.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The file system said no.
    #[error("{}: cannot {action}: {source}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What was tried, as a verb with its object.
        action: &'static str,
        /// Why it failed.
        source: std::io::Error,
    },
    /// Data that cannot be written, or a file that cannot be read, as it is.
    #[error("{}: {message}", path.display())]
    Invalid {
        /// The file that it is about.
        path: PathBuf,
        /// What is wrong, where in the file, and what to do.
        message: String,
    },
    /// What is there already must not be replaced by a file.
    #[error("{}: {message}", path.display())]
    Target {
        /// The output.
        path: PathBuf,
        /// What it is, and what to do.
        message: String,
    },
    /// The source document turned out to be damaged when more of it was read.
    #[error(transparent)]
    Scene(#[from] crate::scene::Error),
    /// The write was called off before any file was put in place.
    #[error("interrupted; nothing was written")]
    Interrupted,
}

impl Error {
    pub(crate) fn io(path: &Path, action: &'static str, source: std::io::Error) -> Self {
        Self::Io { path: path.to_path_buf(), action, source }
    }

    pub(crate) fn invalid(path: &Path, message: impl Into<String>) -> Self {
        Self::Invalid { path: path.to_path_buf(), message: message.into() }
    }
}
