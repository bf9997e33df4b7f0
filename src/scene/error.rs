//! Why a document could not be turned into a scene: a class for exit codes, and one message for people.

use std::io;
use std::path::Path;
use std::path::PathBuf;

/// What kind of failure it is; callers map it to an exit code.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Class {
    /// A valid document that needs something that is not implemented, or that exceeds a limit.
    Unsupported,
    /// The document breaks its own format.
    Invalid,
    /// The operating system refused to read a file.
    Io,
    /// It needs more memory than it may have.
    Memory,
}

/// Failure of [`load()`](super::load()).
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// See [`Class::Unsupported`].
    #[error("{}: {what}", file.display())]
    Unsupported {
        /// The document.
        file: PathBuf,
        /// What, where in the document, what to do.
        what: String,
    },
    /// See [`Class::Invalid`].
    #[error("{}: {what}", file.display())]
    Invalid {
        /// The document.
        file: PathBuf,
        /// What, where in the document, what to do.
        what: String,
    },
    /// See [`Class::Memory`].
    #[error("{}: {what}", file.display())]
    Memory {
        /// The document.
        file: PathBuf,
        /// How much, for what, what to do.
        what: String,
    },
    /// See [`Class::Io`].
    #[error("cannot read {}: {source}", file.display())]
    Io {
        /// The file that could not be read.
        file: PathBuf,
        /// What the operating system said.
        source: io::Error,
    },
}

/// Longest message, in characters; names in a document may be of any length.
const MAX_MESSAGE: usize = 400;

/// A message without control characters (names of a document may hold line ends and terminal sequences), cut if long.
pub(super) fn one_line(message: &str) -> String {
    let mut line: String = message.chars().take(MAX_MESSAGE).map(|c| if c.is_control() { ' ' } else { c }).collect();
    if message.chars().nth(MAX_MESSAGE).is_some() {
        line.push('…');
    }
    line
}

impl Error {
    /// The class of the failure.
    #[must_use]
    pub fn class(&self) -> Class {
        match self {
            Self::Unsupported { .. } => Class::Unsupported,
            Self::Invalid { .. } => Class::Invalid,
            Self::Io { .. } => Class::Io,
            Self::Memory { .. } => Class::Memory,
        }
    }

    pub(super) fn unsupported(what: impl Into<String>) -> Self {
        Self::Unsupported { file: PathBuf::new(), what: what.into() }
    }

    pub(super) fn invalid(what: impl Into<String>) -> Self {
        Self::Invalid { file: PathBuf::new(), what: what.into() }
    }

    pub(super) fn memory(what: impl Into<String>) -> Self {
        Self::Memory { file: PathBuf::new(), what: what.into() }
    }

    pub(super) fn io(file: impl Into<PathBuf>, source: io::Error) -> Self {
        Self::Io { file: file.into(), source }
    }

    /// Names the document, where that has not happened yet, and makes the message one line.
    pub(super) fn in_file(mut self, path: &Path) -> Self {
        match &mut self {
            Self::Unsupported { file, what } | Self::Invalid { file, what } | Self::Memory { file, what }
                if file.as_os_str().is_empty() =>
            {
                *file = path.to_path_buf();
                *what = one_line(what);
            }
            _ => {}
        }
        self
    }

    /// Puts the place in front of the message: `context: message`.
    pub(super) fn within(mut self, context: &str) -> Self {
        match &mut self {
            Self::Unsupported { what, .. } | Self::Invalid { what, .. } | Self::Memory { what, .. } => {
                *what = format!("{context}: {what}");
            }
            Self::Io { .. } => {}
        }
        self
    }
}
