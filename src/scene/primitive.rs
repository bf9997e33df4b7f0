//! Reads one mesh primitive into local space: vertex attributes as floats, and a plain triangle list.
//!
//! In: the document, mesh and primitive index. Out: [`LocalPrimitive`]; vertex k is element k of the accessors. Strips
//! and fans become triangles by the formulas of glTF 2.0, section 3.7.2.1. Degenerate triangles stay, so that triangle
//! t always means the same corner indices of the document.
//!
//! Odd but harmless values are replaced, with a warning: texture coordinates and colours that are not finite.

use super::Document;
use super::Error;
use super::schema::Primitive;
use crate::base::Warning;
use glam::Vec2;
use glam::Vec3;
use glam::Vec4;

/// Texture coordinate sets that can be used; materials that ask for more are refused. Every set costs 8 bytes per
/// vertex of the whole scene, also where a primitive lacks it.
pub(super) const MAX_UV_SETS: usize = 8;

/// How many vertices and triangles a primitive has; known before anything is allocated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Size {
    pub(super) vertices: usize,
    pub(super) triangles: usize,
}

/// A primitive in the space of its mesh.
#[derive(Debug, Default)]
pub(super) struct LocalPrimitive {
    pub(super) position: Vec<Vec3>,
    pub(super) normal: Option<Vec<Vec3>>,
    pub(super) color: Option<Vec<Vec4>>,
    /// By set; `None` where the primitive lacks it.
    pub(super) uv: Vec<Option<Vec<Vec2>>>,
    pub(super) triangles: Vec<[u32; 3]>,
    pub(super) warnings: Vec<Warning>,
}

impl LocalPrimitive {
    pub(super) fn size(&self) -> Size {
        Size { vertices: self.position.len(), triangles: self.triangles.len() }
    }
}

#[derive(Clone, Copy)]
enum Topology {
    List,
    Strip,
    Fan,
}

/// Checks that a primitive can be read, and tells its size; `None` = it has no triangles and is skipped.
pub(super) fn survey(
    document: &Document,
    mesh: usize,
    primitive: usize,
    warnings: &mut Vec<Warning>,
) -> Result<Option<Size>, Error> {
    let entry = &document.root.meshes[mesh].primitives[primitive];
    let name = document.root.primitive_name(mesh, primitive);
    let mode = entry.mode.unwrap_or(4);
    if mode > 6 {
        return Err(Error::invalid(format!("{name}: mode {mode} does not exist")));
    }
    let Some(&position) = entry.attributes.get("POSITION") else {
        warnings.push(Warning::new("no-positions", format!("{name} has no POSITION and was skipped")));
        return Ok(None);
    };
    if mode < 4 {
        warnings.push(Warning::new("not-triangles", format!("{name} consists of points or lines and was skipped")));
        return Ok(None);
    }
    let vertices = document.accessor_count(position).map_err(|e| e.within(&format!("{name}, POSITION")))?;
    let corners = match entry.indices {
        Some(index) => document.accessor_count(index).map_err(|e| e.within(&format!("{name}, indices")))?,
        None => vertices,
    };
    let triangles = if mode == 4 { corners / 3 } else { corners.saturating_sub(2) };
    if mode == 4 && corners % 3 != 0 {
        let what = format!("{name}: {corners} indices are no multiple of 3; the last {} were ignored", corners % 3);
        warnings.push(Warning::new("incomplete-triangle", what));
    }
    if triangles == 0 {
        warnings.push(Warning::new("no-triangles", format!("{name} has no triangle and was skipped")));
        return Ok(None);
    }
    Ok(Some(Size { vertices, triangles }))
}

/// Reads a primitive that [`survey`] found to have triangles. `uv_sets` says which texture coordinates to read.
pub(super) fn read(
    document: &Document,
    mesh: usize,
    primitive: usize,
    uv_sets: &[bool],
) -> Result<LocalPrimitive, Error> {
    let entry = &document.root.meshes[mesh].primitives[primitive];
    let name = document.root.primitive_name(mesh, primitive);
    let mut local = LocalPrimitive::default();
    let reader = Reader { document, entry, name: &name };
    let (position, _) = reader.floats("POSITION", &[3], None)?.unwrap_or_default();
    local.position = position.as_chunks().0.iter().map(|&p| Vec3::from_array(p)).collect();
    let count = local.position.len();
    if let Some(bad) = local.position.iter().position(|p| !p.is_finite()) {
        let at = local.position[bad];
        return Err(Error::invalid(format!("{name}: the position of vertex {bad} is {at}, which is not finite")));
    }
    local.normal = reader
        .floats("NORMAL", &[3], Some(count))?
        .map(|(n, _)| n.as_chunks().0.iter().map(|&n| Vec3::from_array(n)).collect());
    for (set, &wanted) in uv_sets.iter().enumerate() {
        let values = if wanted { reader.floats(&format!("TEXCOORD_{set}"), &[2], Some(count))? } else { None };
        local.uv.push(values.map(|(uv, _)| {
            let mut uv: Vec<Vec2> = uv.as_chunks().0.iter().map(|&t| Vec2::from_array(t)).collect();
            let fixed = replace(&mut uv, |t| t.is_finite(), Vec2::ZERO);
            if fixed > 0 {
                let what = format!("{name}: {fixed} coordinates of TEXCOORD_{set} are not finite; 0 was used");
                local.warnings.push(Warning::new("bad-texcoord", what));
            }
            uv
        }));
    }
    if let Some((values, components)) = reader.floats("COLOR_0", &[3, 4], Some(count))? {
        let color = |c: &[f32]| Vec4::new(c[0], c[1], c[2], c.get(3).copied().unwrap_or(1.0));
        let mut colors: Vec<Vec4> = values.chunks_exact(components).map(color).collect();
        if document.has_lost_colors(mesh, primitive) {
            colors.iter_mut().for_each(|c| *c = Vec4::ONE.truncate().extend(c.w));
        }
        let fixed = replace(&mut colors, |c| c.is_finite() && c.min_element() >= 0.0, Vec4::ONE);
        if fixed > 0 {
            let what = format!("{name}: {fixed} vertex colours are negative or not finite; white was used");
            local.warnings.push(Warning::new("bad-color", what));
        }
        local.color = Some(colors);
    }
    local.triangles = reader.triangles(count)?;
    Ok(local)
}

/// Replaces what is not good; how many that were.
fn replace<T: Copy>(values: &mut [T], good: impl Fn(&T) -> bool, instead: T) -> usize {
    let mut replaced = 0;
    for value in values.iter_mut().filter(|v| !good(v)) {
        *value = instead;
        replaced += 1;
    }
    replaced
}

/// Reads attributes of one primitive.
pub(super) struct Reader<'a> {
    pub(super) document: &'a Document,
    pub(super) entry: &'a Primitive,
    pub(super) name: &'a str,
}

impl Reader<'_> {
    /// An attribute as floats with its number of components; checked to have one of `components` and `count` elements.
    pub(super) fn floats(
        &self,
        semantic: &str,
        components: &[usize],
        count: Option<usize>,
    ) -> Result<Option<(Vec<f32>, usize)>, Error> {
        match self.entry.attributes.get(semantic) {
            None => Ok(None),
            Some(&index) => self.accessor(index, semantic, components, count).map(Some),
        }
    }

    /// The same for any accessor; `what` names it in messages.
    pub(super) fn accessor(
        &self,
        index: usize,
        what: &str,
        components: &[usize],
        count: Option<usize>,
    ) -> Result<(Vec<f32>, usize), Error> {
        let context = format!("{}, {what}", self.name);
        let have = self.document.accessor_count(index).map_err(|e| e.within(&context))?;
        if let Some(count) = count.filter(|&c| c != have) {
            return Err(Error::invalid(format!("{context}: {have} elements, but there are {count} positions")));
        }
        let data = self.document.accessor(index).map_err(|e| e.within(&context))?;
        if !components.contains(&data.components) {
            return Err(Error::invalid(format!("{context}: elements have {} components", data.components)));
        }
        if data.component_type == 5125 {
            return Err(Error::invalid(format!("{context}: 32-bit integers are not allowed here")));
        }
        Ok((data.to_f32(), data.components))
    }

    fn triangles(&self, vertices: usize) -> Result<Vec<[u32; 3]>, Error> {
        let topology = match self.entry.mode {
            Some(5) => Topology::Strip,
            Some(6) => Topology::Fan,
            _ => Topology::List,
        };
        let Some(accessor) = self.entry.indices else {
            // Parts are limited to far fewer than 2³² vertices before this is called.
            return Ok(assemble(topology, vertices, |i| i as u32));
        };
        let context = format!("{}, indices", self.name);
        let data = self.document.accessor(accessor).map_err(|e| e.within(&context))?;
        let indices = data
            .to_u32()
            .filter(|_| data.components == 1 && !data.normalized)
            .ok_or_else(|| Error::invalid(format!("{context}: must be plain unsigned 8-, 16- or 32-bit integers")))?;
        if let Some(at) = indices.iter().position(|&i| i as usize >= vertices) {
            return Err(Error::invalid(format!(
                "{context}: index {at} is {}, but there are only {vertices} vertices",
                indices[at]
            )));
        }
        Ok(assemble(topology, indices.len(), |i| indices[i]))
    }
}

/// Triangles from `n` corners, in the order and winding of glTF 2.0, section 3.7.2.1.
fn assemble(topology: Topology, n: usize, corner: impl Fn(usize) -> u32) -> Vec<[u32; 3]> {
    match topology {
        Topology::List => (0..n / 3).map(|i| [corner(3 * i), corner(3 * i + 1), corner(3 * i + 2)]).collect(),
        Topology::Strip => {
            (0..n.saturating_sub(2)).map(|i| [corner(i), corner(i + 1 + i % 2), corner(i + 2 - i % 2)]).collect()
        }
        Topology::Fan => (0..n.saturating_sub(2)).map(|i| [corner(i + 1), corner(i + 2), corner(0)]).collect(),
    }
}
