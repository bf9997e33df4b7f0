//! Where prims are: a unique path for every node, primitive and material of the document.
//!
//! * `/World/NODE/NODE_K` is primitive K as node NODE places it;
//! * `/World/Materials/MATERIAL` is a material, `/World/BakedMaterials/MATERIAL_pageP` the one that also has page P,
//!   `/World/BakedMaterials/MATERIAL_vertices` the one that also has light at vertices.
//!
//! Names are those of the document with every character outside of `[A-Za-z0-9_]` turned into `_`, because older readers
//! know no others. Later ones of the same name get `_2`, `_3`, and so on, in document order. Nodes without a triangle
//! have no prim.

use crate::scene::Part;
use crate::scene::Scene;
use std::collections::BTreeMap;
use std::collections::BTreeSet;

/// Folder of the materials.
pub(super) const MATERIALS: &str = "Materials";

/// Folder of the materials that know of light. Every name in it has a suffix, so that no two can be equal.
pub(super) const BAKED: &str = "BakedMaterials";

/// Names of prims.
#[derive(Debug)]
pub(super) struct Paths {
    /// Nodes with the indices of their parts, in the order in which the scene has them.
    pub(super) nodes: Vec<(usize, Vec<usize>)>,
    node: BTreeMap<usize, String>,
    material: Vec<String>,
}

impl Paths {
    pub(super) fn new(scene: &Scene) -> Self {
        let mut taken = BTreeSet::from([MATERIALS.to_owned(), BAKED.to_owned()]);
        let (mut nodes, mut node) = (Vec::<(usize, Vec<usize>)>::new(), BTreeMap::new());
        let mut at = BTreeMap::new();
        for (p, part) in scene.parts.iter().enumerate() {
            node.entry(part.node).or_insert_with(|| unique(&part.name, &mut taken));
            let i = *at.entry(part.node).or_insert(nodes.len());
            if i == nodes.len() {
                nodes.push((part.node, vec![]));
            }
            nodes[i].1.push(p);
        }
        let mut taken = BTreeSet::new();
        let material = scene.materials.iter().map(|m| unique(&m.name, &mut taken)).collect();
        Self { nodes, node, material }
    }

    /// Name of a node's prim.
    pub(super) fn node(&self, node: usize) -> &str {
        self.node.get(&node).map_or("", String::as_str)
    }

    /// Name of the mesh that a node has for a primitive; Blender shows it without the node's.
    pub(super) fn mesh(&self, part: &Part) -> String {
        format!("{}_{}", self.node(part.node), part.primitive)
    }

    /// Name of a material's prim.
    pub(super) fn material(&self, material: usize) -> &str {
        &self.material[material]
    }
}

/// A valid name that is not taken.
fn unique(name: &str, taken: &mut BTreeSet<String>) -> String {
    let plain = |c: char| if c.is_ascii_alphanumeric() { c } else { '_' };
    let mut stem: String = name.chars().map(plain).collect();
    if stem.is_empty() || stem.starts_with(|c: char| c.is_ascii_digit()) {
        stem.insert(0, '_');
    }
    let mut found = stem.clone();
    let mut n = 2;
    while !taken.insert(found.clone()) {
        found = format!("{stem}_{n}");
        n += 1;
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_valid_and_different() {
        let mut taken = BTreeSet::new();
        let names = ["Tür 1", "Tür 1", "T_r_1", "7", "", "a/b", "T_r_1_2"].map(|n| unique(n, &mut taken));
        assert_eq!(names, ["T_r_1", "T_r_1_2", "T_r_1_3", "_7", "_", "a_b", "T_r_1_2_2"]);
    }
}
