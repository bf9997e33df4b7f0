//! What `--instances` means.

use super::{Options, Settings};
use crate::scene::Instances;
use serde::{Deserialize, Serialize};

/// What a mesh gets that several nodes place.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum InstancesMode {
    /// Every node its own texels.
    #[default]
    Unique,
    /// One lightmap, lit at the first node and shown by all.
    Shared,
    /// No lightmap; it still blocks light.
    Skip,
}

impl InstancesMode {
    /// The default; it is left out of what outputs say of their settings.
    pub(super) fn is_unique(&self) -> bool {
        *self == Self::Unique
    }
}

impl Options {
    pub(super) fn instances(&self) -> InstancesMode {
        self.instances.unwrap_or_default()
    }
}

impl Settings {
    /// The scene stage's word for `instances`.
    #[must_use]
    pub fn scene_instances(&self) -> Instances {
        match self.instances {
            InstancesMode::Unique => Instances::Unique,
            InstancesMode::Shared => Instances::Shared,
            InstancesMode::Skip => Instances::Skip,
        }
    }
}
