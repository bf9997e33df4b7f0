//! Which of the nodes that place one mesh get light of their own.
//!
//! In: parts, each with what is said of its instances. Out: parts that receive no light, and the nodes that show the
//! lightmap of another one instead.
//!
//! A mesh is shared, or skipped, as a whole: what the first part of a node that receives light says goes for the node.
//! Of nodes that share, the first one of a mesh is lit where it stands, and all show that light. Nodes that get none
//! still block light.

use super::Part;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// What a mesh gets that several nodes place.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Instances {
    /// Every node its own texels.
    #[default]
    Unique,
    /// One lightmap, lit at the first node and shown by all.
    Shared,
    /// None.
    Skip,
}

/// Takes the light from parts that share it or go without; the nodes that show that of another: (node, the other), ascending.
pub(super) fn resolve(parts: &mut [Part]) -> Vec<(usize, usize)> {
    let mut nodes_of: BTreeMap<usize, Vec<(usize, Instances)>> = BTreeMap::new();
    for node in parts.chunk_by(|a, b| a.node == b.node) {
        let mode = node.iter().find(|p| p.receives).map(|p| p.treatment.instances);
        nodes_of.entry(node[0].mesh).or_default().push((node[0].node, mode.unwrap_or_default()));
    }
    let (mut dark, mut shown) = (vec![], vec![]);
    for nodes in nodes_of.values().filter(|nodes| nodes.len() > 1) {
        let of = |mode| nodes.iter().filter(move |n| n.1 == mode).map(|n| n.0);
        dark.extend(of(Instances::Skip));
        let first = of(Instances::Shared).next();
        let others = of(Instances::Shared).skip(1);
        shown.extend(others.filter_map(|node| Some((node, first?))));
    }
    dark.extend(shown.iter().map(|(node, _)| *node));
    dark.sort_unstable();
    shown.sort_unstable();
    for part in parts.iter_mut().filter(|p| dark.binary_search(&p.node).is_ok()) {
        part.receives = false;
        part.treatment.receives = false;
    }
    shown
}
