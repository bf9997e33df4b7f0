//! Decompresses primitives of `KHR_draco_mesh_compression`.
//!
//! In: a [`Document`] with its buffers. Out: accessors without bytes of compressed primitives show buffers with their
//! decompressed values, in the component type that the accessor names. Accessors that have bytes of their own beside the
//! compressed ones keep them. Where primitives with different compressed bytes name one accessor, as Blender's exporter
//! lets them, the first keeps it; the others get copies of it, which only `root` has: the text names the first's.
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
use std::collections::BTreeSet;

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

/// What an accessor should hold: values of a compressed mesh.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Content {
    /// The accessor that the text names.
    accessor: usize,
    /// The compressed bytes.
    view: usize,
    /// Of the attribute; indices have none.
    number: Option<usize>,
}

/// Where decompressed values are.
#[derive(Debug, Default)]
struct Places {
    /// Accessors that had no bytes of their own.
    filled: BTreeSet<usize>,
    /// The accessor that holds them, which is another than the text names where that is taken.
    of: BTreeMap<Content, usize>,
}

impl Document {
    /// Decompresses all primitives that have no other values.
    pub(super) fn decompress_primitives(&mut self) -> Result<(), Error> {
        let mut places = Places::default();
        for mesh in 0..self.root.meshes.len() {
            for primitive in 0..self.root.meshes[mesh].primitives.len() {
                let entry = &self.root.meshes[mesh].primitives[primitive];
                let within = |e: Error| e.within(&self.root.primitive_name(mesh, primitive));
                let values = self.missing_values(entry, &places).map_err(within)?;
                for (content, bytes) in values {
                    self.store(content, bytes, &mut places);
                }
                self.root.meshes[mesh].primitives[primitive].turn_to(&places);
            }
        }
        Ok(())
    }

    fn store(&mut self, content: Content, bytes: Vec<u8>, places: &mut Places) {
        let mut place = content.accessor;
        if !places.filled.insert(place) {
            self.root.accessors.push(self.root.accessors[place].clone());
            place = self.root.accessors.len() - 1;
        }
        let byte_length = bytes.len();
        let buffer = Some(self.add_buffer(bytes));
        self.root.buffer_views.push(BufferView { buffer, byte_length, ..BufferView::default() });
        let accessor = &mut self.root.accessors[place];
        (accessor.buffer_view, accessor.byte_offset) = (Some(self.root.buffer_views.len() - 1), 0);
        places.of.insert(content, place);
    }

    /// Decompresses what a primitive has nowhere else.
    fn missing_values(&self, entry: &Primitive, places: &Places) -> Result<Vec<(Content, Vec<u8>)>, Error> {
        let Some(draco) = &entry.extensions.draco else { return Ok(vec![]) };
        let Some(view) = draco.buffer_view else {
            return Err(Error::invalid("its Draco extension names no buffer view"));
        };
        let missing = self.missing(entry, draco, view, places);
        if missing.is_empty() {
            return Ok(vec![]);
        }
        if entry.mode.is_some_and(|mode| mode != 4) {
            return Err(Error::unsupported("Draco compression of anything but triangle lists is not supported"));
        }
        let count = missing.keys().map(|content| self.root.accessors[content.accessor].count).max();
        let decoded = self.decode(view, count.unwrap_or_default())?;
        let values = missing.into_iter().map(|(content, what)| {
            let values = match content.number {
                Some(number) => self.attribute(&decoded, content.accessor, number),
                None => self.indices(&decoded, content.accessor),
            };
            values.map(|bytes| (content, bytes)).map_err(|e| e.within(&what))
        });
        values.collect()
    }

    /// The mesh of a buffer view; `count` of vertices or corners is the most that is expected of it.
    fn decode(&self, view: usize, count: usize) -> Result<Mesh, Error> {
        let bytes = self.buffer_view(view)?;
        let mut padded = with_room(bytes, count);
        claim_a_point(&mut padded);
        let (mut decoded, mut buffer) = (Mesh::new(), DecoderBuffer::new(&padded));
        MeshDecoder::new()
            .decode(&mut buffer, &mut decoded)
            .map_err(|e| Error::invalid(format!("its Draco bytes cannot be decoded: {e}")))?;
        if buffer.remaining_size() < padded.len() - bytes.len() {
            return Err(Error::invalid("its Draco bytes cannot be decoded: they end too early"));
        }
        Ok(decoded)
    }

    /// What a primitive should have but no accessor holds yet, and what it is for.
    fn missing(&self, entry: &Primitive, draco: &Draco, view: usize, places: &Places) -> BTreeMap<Content, String> {
        let mut missing = BTreeMap::new();
        if let Some(accessor) = entry.indices {
            missing.insert(Content { accessor, view, number: None }, "indices".to_owned());
        }
        for (semantic, &number) in &draco.attributes {
            if let Some(&accessor) = entry.attributes.get(semantic) {
                missing.insert(Content { accessor, view, number: Some(number) }, semantic.clone());
            }
        }
        let lacks_bytes = |accessor: usize| {
            places.filled.contains(&accessor)
                || self.root.accessors.get(accessor).is_some_and(|a| a.buffer_view.is_none())
        };
        missing.retain(|content, _| !places.of.contains_key(content) && lacks_bytes(content.accessor));
        missing
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

impl Primitive {
    /// Makes it name the accessors that hold its own values.
    fn turn_to(&mut self, places: &Places) {
        let Some(draco) = &self.extensions.draco else { return };
        let Some(view) = draco.buffer_view else { return };
        let place = |accessor: usize, number: Option<usize>| {
            places.of.get(&Content { accessor, view, number }).copied().unwrap_or(accessor)
        };
        self.indices = self.indices.map(|accessor| place(accessor, None));
        for (semantic, &number) in &draco.attributes {
            if let Some(accessor) = self.attributes.get_mut(semantic) {
                *accessor = place(*accessor, Some(number));
            }
        }
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
