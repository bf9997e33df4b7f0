//! Decompresses primitives of `KHR_draco_mesh_compression`.
//!
//! In: a [`Document`] with its buffers. Out: accessors without bytes of compressed primitives show buffers with their
//! decompressed values, in the component type that the accessor names. Accessors that have bytes of their own beside the
//! compressed ones keep them.
//!
//! Source: the extension's specification; the decoder is the crate `draco-core`.
//!
//! Limits: triangle lists only (exporters write nothing else). The order of vertices is that of this decoder, so `output`
//! writes what it bakes uncompressed.

use super::Document;
use super::Error;
use super::schema::Attributes;
use super::schema::BufferView;
use super::schema::Primitive;
use super::schema::map;
use super::schema::optional;
use draco_core::DataType;
use draco_core::DecoderBuffer;
use draco_core::FaceIndex;
use draco_core::Mesh;
use draco_core::MeshDecoder;
use draco_core::PointAttribute;
use draco_core::PointIndex;
use serde::Deserialize;
use std::collections::BTreeMap;

/// Zeros for each byte of a compressed mesh, at most. Enough for 64 vertices to a byte; what was met has up to 10.
const MOST_ROOM: usize = 8;

/// Where a primitive's compressed mesh is.
#[derive(Debug, Default, Clone, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub struct Draco {
    #[serde(deserialize_with = "optional")]
    buffer_view: Option<usize>,
    /// Attribute semantic → number in the compressed mesh.
    #[serde(deserialize_with = "map")]
    attributes: Attributes,
}

/// Values for an accessor.
struct Values {
    accessor: usize,
    bytes: Vec<u8>,
}

impl Document {
    /// Decompresses all primitives that have no other values.
    pub(super) fn decompress_primitives(&mut self) -> Result<(), Error> {
        // Accessor → the compressed bytes that its values came from.
        let mut done: BTreeMap<usize, usize> = BTreeMap::new();
        for mesh in 0..self.root.meshes.len() {
            for primitive in 0..self.root.meshes[mesh].primitives.len() {
                let name = self.root.primitive_name(mesh, primitive);
                let values = self.primitive(mesh, primitive, &mut done).map_err(|e| e.within(&name))?;
                for values in values {
                    self.store(values);
                }
            }
        }
        Ok(())
    }

    fn store(&mut self, values: Values) {
        let byte_length = values.bytes.len();
        let buffer = Some(self.add_buffer(values.bytes));
        self.root.buffer_views.push(BufferView { buffer, byte_length, ..BufferView::default() });
        let accessor = &mut self.root.accessors[values.accessor];
        (accessor.buffer_view, accessor.byte_offset) = (Some(self.root.buffer_views.len() - 1), 0);
    }

    fn primitive(
        &self,
        mesh: usize,
        primitive: usize,
        done: &mut BTreeMap<usize, usize>,
    ) -> Result<Vec<Values>, Error> {
        let entry = &self.root.meshes[mesh].primitives[primitive];
        let Some(draco) = &entry.extensions.draco else { return Ok(vec![]) };
        let Some(view) = draco.buffer_view else {
            return Err(Error::invalid("its Draco extension names no buffer view"));
        };
        let wanted = self.wanted(entry, draco, view, done)?;
        if wanted.is_empty() {
            return Ok(vec![]);
        }
        if entry.mode.is_some_and(|mode| mode != 4) {
            return Err(Error::unsupported("Draco compression of anything but triangle lists is not supported"));
        }
        let bytes = self.buffer_view(view)?;
        let count = wanted.iter().filter_map(|(a, ..)| self.root.accessors.get(*a)).map(|a| a.count).max();
        let mut padded = with_room(bytes, count.unwrap_or_default());
        claim_a_point(&mut padded);
        let (mut decoded, mut buffer) = (Mesh::new(), DecoderBuffer::new(&padded));
        MeshDecoder::new()
            .decode(&mut buffer, &mut decoded)
            .map_err(|e| Error::invalid(format!("its Draco bytes cannot be decoded: {e}")))?;
        if buffer.remaining_size() < padded.len() - bytes.len() {
            return Err(Error::invalid("its Draco bytes cannot be decoded: they end too early"));
        }
        let mut out = Vec::with_capacity(wanted.len());
        for (accessor, what, number) in wanted {
            let values = match number {
                Some(number) => self.attribute(&decoded, accessor, number),
                None => self.indices(&decoded, accessor),
            };
            let bytes = values.map_err(|e| e.within(&what))?;
            out.push(Values { accessor, bytes });
            done.insert(accessor, view);
        }
        Ok(out)
    }

    /// Accessors that lack values: what for, and the number of the attribute; indices have none.
    fn wanted(
        &self,
        entry: &Primitive,
        draco: &Draco,
        view: usize,
        done: &BTreeMap<usize, usize>,
    ) -> Result<Vec<(usize, String, Option<usize>)>, Error> {
        let mut wanted = vec![];
        if let Some(indices) = entry.indices {
            wanted.push((indices, "indices".to_owned(), None));
        }
        for (semantic, &number) in &draco.attributes {
            if let Some(&accessor) = entry.attributes.get(semantic) {
                wanted.push((accessor, semantic.clone(), Some(number)));
            }
        }
        for (accessor, what, _) in &wanted {
            if done.get(accessor).is_some_and(|&other| other != view) {
                return Err(Error::unsupported(format!(
                    "{what}: accessor {accessor} is the place of two compressed meshes"
                )));
            }
        }
        wanted.retain(|(a, ..)| {
            !done.contains_key(a) && self.root.accessors.get(*a).is_some_and(|a| a.buffer_view.is_none())
        });
        Ok(wanted)
    }

    fn indices(&self, mesh: &Mesh, accessor: usize) -> Result<Vec<u8>, Error> {
        let entry = &self.root.accessors[accessor];
        let (count, faces) = (entry.count, mesh.num_faces());
        if count != 3 * faces {
            return Err(Error::invalid(format!("{count} are claimed, but {faces} triangles were decoded")));
        }
        let corners = (0..faces).flat_map(|f| mesh.face(FaceIndex(f as u32))).map(|PointIndex(i)| f64::from(i));
        encoded(corners, entry.component_type)
    }

    fn attribute(&self, mesh: &Mesh, accessor: usize, number: usize) -> Result<Vec<u8>, Error> {
        let entry = &self.root.accessors[accessor];
        let attribute = u32::try_from(number).ok().and_then(|n| mesh.attribute_by_unique_id(n));
        let attribute =
            attribute.ok_or_else(|| Error::invalid(format!("the compressed mesh has no attribute {number}")))?;
        let points = mesh.num_points();
        if entry.count != points {
            let count = entry.count;
            return Err(Error::invalid(format!("{count} vertices are claimed, but {points} were decoded")));
        }
        let components = usize::from(attribute.num_components());
        let values = (0..points as u32).flat_map(|p| (0..components).map(move |c| (p, c)));
        let mut whole = true;
        let values = values.map(|(p, c)| {
            let value = component(attribute, p, c);
            whole &= value.is_some();
            value.unwrap_or_default()
        });
        let bytes = encoded(values, entry.component_type)?;
        if !whole {
            return Err(Error::invalid(format!("values of attribute {number} are missing or of an unknown type")));
        }
        Ok(bytes)
    }
}

/// Zeros behind a mesh with `count` vertices or corners, a bit for each, but at most [`MOST_ROOM`] bytes for one.
///
/// `draco-core` 1.2.0 takes a mesh for damaged when it has more orientations of texture coordinates (at most one for a
/// vertex) than bits are left (`prediction_scheme_tex_coords_portable.rs`). Where they are all alike, real encoders spend
/// far less than a bit on one.
fn with_room(bytes: &[u8], count: usize) -> Vec<u8> {
    let room = (count / 8 + 1).min(bytes.len().saturating_mul(MOST_ROOM));
    let mut padded = Vec::with_capacity(bytes.len() + room);
    padded.extend_from_slice(bytes);
    padded.resize(bytes.len() + room, 0);
    padded
}

/// Makes a mesh of no points one of a single point, if its triangles follow one after the other: it has no values, but
/// indices. glTF-Transform 4.5 leaves such meshes beside sparse positions; `draco-core` 1.2.0 would skip the indices.
fn claim_a_point(bytes: &mut [u8]) {
    /// Version 2.2, triangles in sequence, no metadata.
    const HEAD: &[u8] = b"DRACO\x02\x02\x01\x00\x00\x00";
    let Some(counts) = bytes.strip_prefix(HEAD) else { return };
    // Two numbers of seven bits to a byte: triangles, then points.
    let Some(last) = counts.iter().take(5).position(|b| b & 0x80 == 0) else { return };
    if let Some(points @ 0) = bytes.get_mut(HEAD.len() + last + 1) {
        *points = 1;
    }
}

/// Component `c` of an attribute at a point; `None` if the mesh lacks it.
fn component(attribute: &PointAttribute, point: u32, c: usize) -> Option<f64> {
    let data = attribute.buffer().data();
    let size = attribute.data_type().byte_length();
    let row = attribute.mapped_index(PointIndex(point)).0 as usize;
    let start = row.checked_mul(usize::try_from(attribute.byte_stride()).ok()?)?.checked_add(c * size)?;
    let b = data.get(start..start.checked_add(size)?)?;
    Some(match attribute.data_type() {
        DataType::Int8 => f64::from(b[0] as i8),
        DataType::Uint8 | DataType::Bool => f64::from(b[0]),
        DataType::Int16 => f64::from(i16::from_le_bytes(b.try_into().ok()?)),
        DataType::Uint16 => f64::from(u16::from_le_bytes(b.try_into().ok()?)),
        DataType::Int32 => f64::from(i32::from_le_bytes(b.try_into().ok()?)),
        DataType::Uint32 => f64::from(u32::from_le_bytes(b.try_into().ok()?)),
        DataType::Float32 => f64::from(f32::from_le_bytes(b.try_into().ok()?)),
        DataType::Float64 => f64::from_le_bytes(b.try_into().ok()?),
        _ => return None,
    })
}

/// Values in a glTF component type.
fn encoded(values: impl Iterator<Item = f64>, component_type: usize) -> Result<Vec<u8>, Error> {
    Ok(match component_type {
        5120 => values.flat_map(|v| (v as i8).to_le_bytes()).collect(),
        5121 => values.map(|v| v as u8).collect(),
        5122 => values.flat_map(|v| (v as i16).to_le_bytes()).collect(),
        5123 => values.flat_map(|v| (v as u16).to_le_bytes()).collect(),
        5125 => values.flat_map(|v| (v as u32).to_le_bytes()).collect(),
        5126 => values.flat_map(|v| (v as f32).to_le_bytes()).collect(),
        other => return Err(Error::invalid(format!("component type {other} does not exist"))),
    })
}
