//! Walks the node tree of the chosen scene: world transform and visibility of every node, in document order.
//!
//! Source: glTF 2.0, section 3.5; `KHR_node_visibility`. Transforms are multiplied in double precision. No recursion:
//! a chain of a million nodes is fine.
//!
//! Invariants of a [`Walk`]: `worlds` has one finite, affine matrix per node of the document; `placed` lists each node
//! of the scene once, parents before children.
//!
//! Coarser levels of `MSFT_lod` are not visible, nor is what is below them.
//!
//! A listed node whose parent is not in the scene is a root: what is above it does not move it.

use super::Error;
use super::animation::Channel;
use super::levels;
use super::schema::Node;
use super::schema::Root;
use crate::base::Warning;
use glam::DMat4;
use glam::DQuat;
use glam::DVec3;
use std::collections::BTreeSet;

/// One node of the scene.
#[derive(Debug, Clone, Copy)]
pub(super) struct Placed {
    pub(super) node: usize,
    pub(super) visible: bool,
    /// An animation moves it or a node above it.
    pub(super) animated: bool,
}

/// The node tree, resolved.
#[derive(Debug)]
pub(super) struct Walk {
    /// World transform by node, also of nodes outside the scene (joints may be).
    pub(super) worlds: Vec<DMat4>,
    /// The nodes of the scene.
    pub(super) placed: Vec<Placed>,
}

/// Resolves the tree for scene `scene`, or the default one.
///
/// Warnings: `not-a-root`, `lod-levels`.
pub(super) fn walk(root: &Root, scene: Option<usize>, warnings: &mut Vec<Warning>) -> Result<Walk, Error> {
    let mut parents = parents(root)?;
    let mut worlds = worlds(root, &parents)?;
    let roots = roots(root, scene, &parents, warnings)?;
    if roots.iter().any(|&node| parents[node].is_some()) {
        roots.iter().for_each(|&node| parents[node] = None);
        worlds = self::worlds(root, &parents)?;
    }
    let mut moved = vec![false; root.nodes.len()];
    for node in root.animations.iter().flat_map(|a| &a.channels).filter_map(Channel::moved_node) {
        if let Some(flag) = moved.get_mut(node) {
            *flag = true;
        }
    }
    let coarser = levels::coarser(root);
    let mut placed = Vec::new();
    let mut stack: Vec<(usize, bool, bool)> = roots.into_iter().rev().map(|node| (node, true, false)).collect();
    while let Some((index, visible, animated)) = stack.pop() {
        let node = &root.nodes[index];
        let shown = visible && node.extensions.visibility.as_ref().is_none_or(|v| v.visible);
        let visible = shown && coarser[index].is_none();
        if let Some(finest) = coarser[index].filter(|_| shown) {
            warnings.push(levels::warning(root, index, finest));
        }
        let animated = animated || moved[index];
        placed.push(Placed { node: index, visible, animated });
        stack.extend(node.children.iter().rev().map(|&child| (child, visible, animated)));
    }
    Ok(Walk { worlds, placed })
}

impl Walk {
    /// Moves the whole world [m].
    pub(super) fn move_by(&mut self, by: DVec3) {
        if by != DVec3::ZERO {
            self.worlds.iter_mut().for_each(|world| world.w_axis += by.extend(0.0));
        }
    }
}

/// The parent of each node; refuses missing nodes and second parents.
fn parents(root: &Root) -> Result<Vec<Option<usize>>, Error> {
    let mut parents = vec![None; root.nodes.len()];
    for (index, node) in root.nodes.iter().enumerate() {
        for &child in &node.children {
            let Some(parent) = parents.get_mut(child) else {
                let name = root.node_name(index);
                return Err(Error::invalid(format!("node {name}: its child, node {child}, does not exist")));
            };
            if let Some(first) = parent.replace(index) {
                return Err(Error::invalid(format!(
                    "node {child} is the child of both node {first} and node {index}; the nodes must form trees"
                )));
            }
        }
    }
    Ok(parents)
}

fn worlds(root: &Root, parents: &[Option<usize>]) -> Result<Vec<DMat4>, Error> {
    let mut worlds = vec![None; root.nodes.len()];
    let mut stack: Vec<usize> = (0..root.nodes.len()).rev().filter(|&n| parents[n].is_none()).collect();
    while let Some(index) = stack.pop() {
        let node = &root.nodes[index];
        let above = parents[index].and_then(|p| worlds[p]).unwrap_or(DMat4::IDENTITY);
        let world = local(node).map_err(|why| format!("node {}: {why}", root.node_name(index))).and_then(|local| {
            let world: DMat4 = above * local;
            if world.is_finite() {
                Ok(world)
            } else {
                Err(format!("node {}: its transform is not finite", root.node_name(index)))
            }
        });
        worlds[index] = Some(world.map_err(Error::invalid)?);
        stack.extend(node.children.iter().rev().filter(|&&child| parents[child] == Some(index)));
    }
    // Every node has at most one parent, so whatever no root leads to hangs on a cycle.
    worlds
        .into_iter()
        .enumerate()
        .map(|(index, world)| {
            world.ok_or_else(|| {
                Error::invalid(format!("node {} is part of a cycle in the node tree", root.node_name(index)))
            })
        })
        .collect()
}

fn local(node: &Node) -> Result<DMat4, &'static str> {
    if let Some(m) = &node.matrix {
        let m = DMat4::from_cols_array(m);
        // The row (0, 0, 0, 1) may carry rounding errors of an exporter that inverted matrices.
        if !(m.row(3) - glam::DVec4::W).abs().cmple(glam::DVec4::splat(1e-4)).all() {
            return Err("its matrix is not affine, the last row must be 0 0 0 1");
        }
        return Ok(affine(m));
    }
    let translation = DVec3::from_array(node.translation.unwrap_or([0.0; 3]));
    let scale = DVec3::from_array(node.scale.unwrap_or([1.0; 3]));
    let rotation = DQuat::from_array(node.rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]));
    let length = rotation.length();
    if !(length > 0.0 && length.is_finite()) {
        return Err("its rotation is not a quaternion of unit length");
    }
    // Not normalised when it already is up to a few ulps: that would only add noise.
    let rotation = if (length - 1.0).abs() < 1e-12 { rotation } else { rotation / length };
    Ok(DMat4::from_scale_rotation_translation(scale, rotation, translation))
}

/// The matrix with its last row set to exactly (0, 0, 0, 1).
fn affine(m: DMat4) -> DMat4 {
    let [x, y, z, w] = [m.x_axis, m.y_axis, m.z_axis, m.w_axis].map(|c| c.truncate());
    DMat4::from_cols(x.extend(0.0), y.extend(0.0), z.extend(0.0), w.extend(1.0))
}

/// The root nodes of the chosen scene. Some exporters list nodes that are children: those below another listed one are
/// there already; others are taken without what is above them, which is what viewers show that walk down from the list.
fn roots(
    root: &Root,
    scene: Option<usize>,
    parents: &[Option<usize>],
    warnings: &mut Vec<Warning>,
) -> Result<Vec<usize>, Error> {
    let chosen = scene.or(root.scene).or(if root.scenes.is_empty() { None } else { Some(0) });
    let Some(index) = chosen else {
        return Ok((0..root.nodes.len()).filter(|&n| parents[n].is_none()).collect());
    };
    let Some(entry) = root.scenes.get(index) else {
        let have = root.scenes.len();
        return Err(Error::invalid(format!("scene {index} does not exist, the document has {have} (counted from 0)")));
    };
    let mut seen = BTreeSet::new();
    for &node in &entry.nodes {
        if node >= parents.len() {
            return Err(Error::invalid(format!("scene {index} refers to node {node}, which does not exist")));
        }
        if !seen.insert(node) {
            return Err(Error::invalid(format!("scene {index} lists node {node} twice")));
        }
    }
    let covered = covered(root, parents, &seen);
    for &node in &entry.nodes {
        let Some(parent) = parents[node] else { continue };
        let how = if covered[node] { "it was taken once, as the child" } else { "it was taken without its parent" };
        let what = format!("scene {index} lists node {node}, a child of node {parent}, as a root; {how}");
        warnings.push(Warning::new("not-a-root", what));
    }
    Ok(entry.nodes.iter().copied().filter(|&node| !covered[node]).collect())
}

/// By node: whether one above it is listed. `parents` form trees.
fn covered(root: &Root, parents: &[Option<usize>], listed: &BTreeSet<usize>) -> Vec<bool> {
    let mut covered = vec![false; root.nodes.len()];
    let mut stack: Vec<(usize, bool)> =
        (0..root.nodes.len()).filter(|&n| parents[n].is_none()).map(|n| (n, false)).collect();
    while let Some((node, below)) = stack.pop() {
        covered[node] = below;
        let below = below || listed.contains(&node);
        stack.extend(root.nodes[node].children.iter().map(|&child| (child, below)));
    }
    covered
}
