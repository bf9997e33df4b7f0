//! Which nodes animations move.
//!
//! Source: glTF 2.0, section 3.11; `KHR_animation_pointer`, whose targets are JSON pointers instead of a node and a path.
//! Animations are not played: a bake shows the document at rest, and warns of what does not stay there.
//!
//! Limit: of pointers those to the transform of a node count, not those to lights and materials.

#![allow(missing_docs, reason = "the names are those of the glTF 2.0 specification and its extensions")]

use super::schema::optional;
use serde::Deserialize;

/// What of a node moves it.
const MOVING: [&str; 3] = ["translation", "rotation", "scale"];

#[derive(Debug, Default, Clone, Deserialize)]
#[serde(default)]
pub struct Animation {
    pub channels: Vec<Channel>,
}

#[derive(Debug, Default, Clone, Deserialize)]
#[serde(default)]
pub struct Channel {
    target: Target,
}

#[derive(Debug, Default, Clone, Deserialize)]
#[serde(default)]
struct Target {
    #[serde(deserialize_with = "optional")]
    node: Option<usize>,
    path: String,
    extensions: TargetExtensions,
}

#[derive(Debug, Default, Clone, Deserialize)]
#[serde(default)]
struct TargetExtensions {
    #[serde(rename = "KHR_animation_pointer")]
    pointer: Option<Pointer>,
}

#[derive(Debug, Default, Clone, Deserialize)]
#[serde(default)]
struct Pointer {
    pointer: String,
}

impl Channel {
    /// Index of the node that it moves; it may not exist.
    pub(super) fn moved_node(&self) -> Option<usize> {
        let Target { node, path, extensions } = &self.target;
        let (node, path) = match &extensions.pointer {
            Some(to) if path == "pointer" => {
                let (node, path) = to.pointer.strip_prefix("/nodes/")?.split_once('/')?;
                (node.parse().ok()?, path)
            }
            _ => ((*node)?, path.as_str()),
        };
        MOVING.contains(&path).then_some(node)
    }
}
