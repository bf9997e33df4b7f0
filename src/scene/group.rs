//! Names of light groups: `light_group` of rules and of `extras.texelwalk` (`treat.rs`).

/// Which group each source of light belongs to, where something says so.
#[derive(Debug, Default, Clone, PartialEq, Eq)]
pub struct Groups {
    /// By index into `Scene::lights`.
    pub lights: Vec<Option<String>>,
    /// By index into `Scene::parts`; `None` also where nothing glows.
    pub parts: Vec<Option<String>>,
}
