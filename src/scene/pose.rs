//! Where a primitive's vertices stand at rest: node transform, or morph targets and skin with the joints as they are.
//!
//! Source: glTF 2.0, sections 3.7.2.2 (morph targets) and 3.7.3 (skins). A skinned mesh ignores the transform of its
//! own node. Animations are not played: weights and joints have the values of the document.
//!
//! Symbols: Δ displacement of a morph target, w its weight; J world transform of a joint, B its inverse bind matrix.

use super::Document;
use super::Error;
use super::primitive::LocalPrimitive;
use super::primitive::Reader;
use glam::DMat4;
use glam::Vec3;

/// The transform from mesh space to world space.
pub(super) enum Pose {
    /// One matrix for all vertices.
    Rigid(DMat4),
    /// One matrix per vertex, Σ w · J · B.
    Skinned(Vec<DMat4>),
}

impl Pose {
    /// World from mesh at a vertex.
    pub(super) fn matrix(&self, vertex: usize) -> DMat4 {
        match self {
            Self::Rigid(world) => *world,
            Self::Skinned(worlds) => worlds[vertex],
        }
    }

    /// Cube root of what it multiplies volumes by; of a skin, at its first vertex.
    pub(super) fn scale(&self) -> f32 {
        let world = match self {
            Self::Rigid(world) => Some(world),
            Self::Skinned(worlds) => worlds.first(),
        };
        world.map_or(1.0, |world| libm::cbrt(world.determinant().abs()) as f32)
    }

    /// The transform turns counter-clockwise triangles into clockwise ones.
    pub(super) fn mirrors(&self) -> bool {
        match self {
            Self::Rigid(world) => world.determinant() < 0.0,
            Self::Skinned(worlds) => worlds.first().is_some_and(|w| w.determinant() < 0.0),
        }
    }
}

/// Morph target weights of a node that are not zero, as (target, weight).
pub(super) fn weights(document: &Document, node: usize, mesh: usize) -> Vec<(usize, f32)> {
    let root = &document.root;
    let weights = root.nodes[node].weights.as_ref().or(root.meshes[mesh].weights.as_ref());
    weights.into_iter().flatten().copied().enumerate().filter(|(_, w)| *w != 0.0).collect()
}

/// Adds Σ w · Δ to positions and normals.
pub(super) fn morph(reader: &Reader<'_>, weights: &[(usize, f32)], local: &mut LocalPrimitive) -> Result<(), Error> {
    let count = local.position.len();
    for &(target, weight) in weights {
        let Some(attributes) = reader.entry.targets.get(target) else { continue };
        let add = |semantic: &str, values: &mut [Vec3]| -> Result<(), Error> {
            let Some(&accessor) = attributes.get(semantic) else { return Ok(()) };
            let what = format!("morph target {target}, {semantic}");
            let (deltas, _) = reader.accessor(accessor, &what, &[3], Some(count))?;
            for (value, &delta) in values.iter_mut().zip(deltas.as_chunks().0) {
                *value += Vec3::from_array(delta) * weight;
            }
            Ok(())
        };
        add("POSITION", &mut local.position)?;
        if let Some(normal) = &mut local.normal {
            add("NORMAL", normal)?;
        }
    }
    if local.position.iter().all(|p| p.is_finite()) {
        Ok(())
    } else {
        Err(Error::invalid(format!("{}: morph targets move a vertex to a place that is not finite", reader.name)))
    }
}

/// J · B of every joint of a skin.
pub(super) fn joints(document: &Document, worlds: &[DMat4], skin: usize) -> Result<Vec<DMat4>, Error> {
    let context = format!("skin {skin}");
    let Some(entry) = document.root.skins.get(skin) else {
        return Err(Error::invalid(format!("{context} does not exist, there are {}", document.root.skins.len())));
    };
    let binds = match entry.inverse_bind_matrices {
        None => vec![DMat4::IDENTITY; entry.joints.len()],
        Some(accessor) => {
            let data = document.accessor(accessor).map_err(|e| e.within(&context))?;
            if data.components != 16 || data.component_type != 5126 || data.count < entry.joints.len() {
                let what = format!("{context}: its inverse bind matrices must be one float MAT4 per joint");
                return Err(Error::invalid(what));
            }
            data.to_f32().as_chunks().0.iter().map(|m| DMat4::from_cols_array(&m.map(f64::from))).collect()
        }
    };
    let joint = |(&node, bind): (&usize, DMat4)| match worlds.get(node) {
        Some(world) => Ok(*world * bind),
        None => Err(Error::invalid(format!("{context}: joint node {node} does not exist"))),
    };
    entry.joints.iter().zip(binds).map(joint).collect()
}

/// One matrix per vertex from `JOINTS_0` … and `WEIGHTS_0` …; `None` where the primitive has no joints.
pub(super) fn skinned(reader: &Reader<'_>, joints: &[DMat4], count: usize) -> Result<Option<Vec<DMat4>>, Error> {
    let mut worlds = vec![DMat4::ZERO; count];
    let mut totals = vec![0.0f64; count];
    let mut set = 0;
    while let Some(&index) = reader.entry.attributes.get(&format!("JOINTS_{set}")) {
        let (ids, _) = reader.accessor(index, &format!("JOINTS_{set}"), &[4], Some(count))?;
        let Some((weights, _)) = reader.floats(&format!("WEIGHTS_{set}"), &[4], Some(count))? else {
            return Err(Error::invalid(format!("{}: JOINTS_{set} without WEIGHTS_{set}", reader.name)));
        };
        for (corner, (&id, &weight)) in ids.iter().zip(&weights).enumerate() {
            if weight == 0.0 {
                continue;
            }
            let joint = joints.get(id as usize).filter(|_| weight.is_finite()).ok_or_else(|| {
                Error::invalid(format!("{}: vertex {} refers to a joint that its skin lacks", reader.name, corner / 4))
            })?;
            worlds[corner / 4] += *joint * f64::from(weight);
            totals[corner / 4] += f64::from(weight);
        }
        set += 1;
    }
    if set == 0 {
        return Ok(None);
    }
    // Weights should add up to one; where an exporter's rounding left a gap, the vertex must not shrink to the origin.
    for (world, total) in worlds.iter_mut().zip(totals) {
        if total > 0.0 {
            *world *= 1.0 / total;
        } else {
            *world = joints.first().copied().unwrap_or(DMat4::IDENTITY);
        }
    }
    Ok(Some(worlds))
}
