//! Warnings: what was odd in the input, what was done instead, and where.

/// One thing that a user should know about, with a stable code for machines.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Warning {
    /// Stable lower-case identifier, for example `unsupported-extension`.
    pub code: &'static str,
    /// One sentence: what, where, what was done.
    pub message: String,
    /// Name (or `node 7`) of the glTF node it is about, where there is one.
    pub node: Option<String>,
}

impl Warning {
    /// A warning about the whole file.
    #[must_use]
    pub fn new(code: &'static str, message: impl Into<String>) -> Self {
        Self { code, message: message.into(), node: None }
    }

    /// The same warning, tied to a node.
    #[must_use]
    pub fn at(mut self, node: impl Into<String>) -> Self {
        self.node = Some(node.into());
        self
    }
}

/// A result together with what was odd on the way to it.
#[derive(Clone, Debug)]
pub struct Warned<T> {
    /// The result itself.
    pub output: T,
    /// In the order in which they were found.
    pub warnings: Vec<Warning>,
}
