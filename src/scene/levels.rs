//! `MSFT_lod`: coarser levels of nodes. Only the finest, the node that has the extension, takes part in light.
//!
//! In: document. Out: which nodes are coarser levels; `nodes` hides them with all below them. A level may stand anywhere in
//! the tree; most documents leave it out of the scene. A node that names itself is no level. Levels of materials need
//! nothing: primitives refer to the finest.
//!
//! Warning: `lod-levels`.

use super::schema::Root;
use crate::base::Warning;
use serde::{Deserialize, Deserializer};

/// The extension of a node.
#[derive(Debug, Default, Clone, Deserialize)]
#[serde(default)]
pub struct Levels {
    /// Coarser nodes, the finer ones first.
    #[serde(deserialize_with = "ids")]
    pub ids: Vec<usize>,
}

fn ids<'de, D: Deserializer<'de>>(d: D) -> Result<Vec<usize>, D::Error> {
    #[derive(Deserialize)]
    struct Id(#[serde(deserialize_with = "super::schema::required")] usize);
    Vec::<Id>::deserialize(d).map(|all| all.into_iter().map(|i| i.0).collect())
}

/// By node: whose level it is.
pub(super) fn coarser(root: &Root) -> Vec<Option<usize>> {
    let mut of = vec![None; root.nodes.len()];
    for (index, node) in root.nodes.iter().enumerate() {
        for &id in node.extensions.levels.iter().flat_map(|levels| &levels.ids) {
            if let Some(entry) = of.get_mut(id).filter(|_| id != index) {
                *entry = Some(index);
            }
        }
    }
    of
}

/// That a node of the scene is left out.
pub(super) fn warning(root: &Root, level: usize, finest: usize) -> Warning {
    let (name, finest) = (root.node_name(level), root.node_name(finest));
    let what = format!("node {name} is a coarser level of {finest}: it gets no lightmap and blocks no light");
    Warning::new("lod-levels", what).at(name)
}
