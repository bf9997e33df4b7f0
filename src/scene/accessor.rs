//! Reads accessors (glTF 2.0, section 3.6.2): strides, sparse substitution, padded matrix columns, every component
//! type.
//!
//! In: a [`Document`] with its buffers. Out: [`AccessorData`], tightly packed. Everything is checked against the bytes
//! that exist before anything is allocated; the one exception, accessors without a buffer view (all zeros), has the cap
//! [`MAX_ZEROS`].

use super::Document;
use super::Error;
use super::schema::Accessor;
use super::schema::Sparse;

/// Largest count of an accessor that has no buffer view. Such accessors exist as bases of sparse ones, mostly in morph
/// targets. Larger would let a document of a hundred bytes claim gigabytes; smaller could refuse big morph targets.
const MAX_ZEROS: usize = 1 << 22;

/// The elements of an accessor, tightly packed in their stored component type, sparse substitution applied.
#[derive(Debug, Clone, PartialEq)]
pub struct AccessorData {
    /// Number of elements.
    pub count: usize,
    /// Components per element (1 to 16).
    pub components: usize,
    /// glTF component type (5120 … 5126).
    pub component_type: u32,
    /// Integers stand for [0, 1] or [−1, 1].
    pub normalized: bool,
    /// `count` × `components` little-endian values without padding.
    pub bytes: Vec<u8>,
}

/// How one element lies in memory.
#[derive(Debug, Clone, Copy)]
struct Layout {
    columns: usize,
    column_bytes: usize,
    column_stride: usize,
    components: usize,
}

impl Layout {
    fn new(accessor: &Accessor) -> Result<Self, Error> {
        let size = component_size(accessor.component_type)
            .ok_or_else(|| Error::invalid(format!("component type {} does not exist", accessor.component_type)))?;
        let (columns, rows) = match accessor.kind.as_str() {
            "SCALAR" => (1, 1),
            "VEC2" => (1, 2),
            "VEC3" => (1, 3),
            "VEC4" => (1, 4),
            "MAT2" => (2, 2),
            "MAT3" => (3, 3),
            "MAT4" => (4, 4),
            other => return Err(Error::invalid(format!("accessor type {other:?} does not exist"))),
        };
        let column_bytes = rows * size;
        let column_stride = if columns > 1 { column_bytes.next_multiple_of(4) } else { column_bytes };
        Ok(Self { columns, column_bytes, column_stride, components: columns * rows })
    }

    /// Bytes from one element to the next where no stride is given.
    fn pitch(self) -> usize {
        self.columns * self.column_stride
    }

    /// Bytes that an element really needs: the last column has no padding.
    fn reach(self) -> usize {
        (self.columns - 1) * self.column_stride + self.column_bytes
    }

    fn packed(self) -> usize {
        self.columns * self.column_bytes
    }

    fn copy(self, element: &[u8], out: &mut [u8]) {
        for column in 0..self.columns {
            let from = column * self.column_stride;
            let to = column * self.column_bytes;
            out[to..to + self.column_bytes].copy_from_slice(&element[from..from + self.column_bytes]);
        }
    }
}

fn component_size(component_type: usize) -> Option<usize> {
    match component_type {
        5120 | 5121 => Some(1),
        5122 | 5123 => Some(2),
        5125 | 5126 => Some(4),
        _ => None,
    }
}

/// A run of elements that was checked against the bytes that exist.
struct Elements<'a> {
    bytes: &'a [u8],
    stride: usize,
}

impl Document {
    /// The elements of an accessor.
    ///
    /// # Errors
    /// It does not exist, or reaches beyond its buffer view, or contradicts itself.
    pub fn accessor(&self, index: usize) -> Result<AccessorData, Error> {
        self.read_accessor(index).map_err(|e| e.in_file(&self.path))
    }

    /// The number of elements of an accessor, after checking that all of them exist; reads none of them.
    ///
    /// # Errors
    /// As for [`Document::accessor`].
    pub fn accessor_count(&self, index: usize) -> Result<usize, Error> {
        let context = format!("accessor {index}");
        let accessor = self.root.accessors.get(index).ok_or_else(|| {
            let have = self.root.accessors.len();
            Error::invalid(format!("{context} does not exist, there are {have}")).in_file(&self.path)
        })?;
        let check = || -> Result<(), Error> {
            let layout = Layout::new(accessor)?;
            self.base(accessor, layout)?;
            if let Some(sparse) = &accessor.sparse {
                self.sparse(accessor, sparse, layout)?;
            }
            Ok(())
        };
        check().map_err(|e| e.within(&context).in_file(&self.path))?;
        Ok(accessor.count)
    }

    fn read_accessor(&self, index: usize) -> Result<AccessorData, Error> {
        let context = format!("accessor {index}");
        let Some(accessor) = self.root.accessors.get(index) else {
            let have = self.root.accessors.len();
            return Err(Error::invalid(format!("{context} does not exist, there are {have}")));
        };
        let layout = Layout::new(accessor).map_err(|e| e.within(&context))?;
        let packed = layout.packed();
        let base = self.base(accessor, layout).map_err(|e| e.within(&context))?;
        let mut bytes = vec![0; accessor.count * packed];
        if let Some(base) = base {
            for (i, out) in bytes.chunks_exact_mut(packed).enumerate() {
                layout.copy(&base.bytes[i * base.stride..], out);
            }
        }
        if let Some(sparse) = &accessor.sparse {
            let (indices, values) = self.sparse(accessor, sparse, layout).map_err(|e| e.within(&context))?;
            for i in 0..sparse.count {
                let at = unsigned(&indices.bytes[i * indices.stride..], indices.stride) as usize;
                let Some(out) = bytes.chunks_exact_mut(packed).nth(at) else {
                    let count = accessor.count;
                    let what = format!("{context}: sparse index {at} is out of range, there are {count} elements");
                    return Err(Error::invalid(what));
                };
                layout.copy(&values.bytes[i * values.stride..], out);
            }
        }
        Ok(AccessorData {
            count: accessor.count,
            components: layout.components,
            component_type: accessor.component_type as u32,
            normalized: accessor.normalized,
            bytes,
        })
    }

    /// The stored elements; `None` = all zeros.
    fn base(&self, accessor: &Accessor, layout: Layout) -> Result<Option<Elements<'_>>, Error> {
        let Some(view) = accessor.buffer_view else {
            if accessor.count > MAX_ZEROS {
                return Err(Error::unsupported(format!(
                    "claims {} elements without a buffer view; at most {MAX_ZEROS} are accepted",
                    accessor.count
                )));
            }
            return Ok(None);
        };
        let stride = self.root.buffer_views.get(view).and_then(|v| v.byte_stride);
        self.elements(view, accessor.byte_offset, accessor.count, stride, layout).map(Some)
    }

    fn sparse(
        &self,
        accessor: &Accessor,
        sparse: &Sparse,
        layout: Layout,
    ) -> Result<(Elements<'_>, Elements<'_>), Error> {
        if sparse.count > accessor.count {
            return Err(Error::invalid(format!(
                "{} sparse elements replace only {} elements",
                sparse.count, accessor.count
            )));
        }
        let size = match sparse.indices.component_type {
            5121 => 1,
            5123 => 2,
            5125 => 4,
            other => return Err(Error::invalid(format!("sparse indices cannot have component type {other}"))),
        };
        let index_layout = Layout { columns: 1, column_bytes: size, column_stride: size, components: 1 };
        let missing = || Error::invalid("its sparse part has no buffer view");
        let view = sparse.indices.buffer_view.ok_or_else(missing)?;
        let indices = self.elements(view, sparse.indices.byte_offset, sparse.count, None, index_layout)?;
        let view = sparse.values.buffer_view.ok_or_else(missing)?;
        let values = self.elements(view, sparse.values.byte_offset, sparse.count, None, layout)?;
        Ok((indices, values))
    }

    fn elements(
        &self,
        view: usize,
        offset: usize,
        count: usize,
        stride: Option<usize>,
        layout: Layout,
    ) -> Result<Elements<'_>, Error> {
        let bytes = self.buffer_view(view)?;
        let stride = stride.unwrap_or(layout.pitch());
        if stride < layout.reach() {
            let size = layout.reach();
            return Err(Error::invalid(format!(
                "buffer view {view} has a stride of {stride} bytes, an element has {size}"
            )));
        }
        let needed = match count {
            0 => Some(0),
            _ => stride.checked_mul(count - 1).and_then(|n| n.checked_add(layout.reach())),
        };
        let end = needed.and_then(|n| n.checked_add(offset));
        match end.and_then(|end| bytes.get(offset..end)) {
            Some(bytes) => Ok(Elements { bytes, stride }),
            None => Err(Error::invalid(format!(
                "{count} elements at offset {offset} reach beyond buffer view {view} of {} bytes",
                bytes.len()
            ))),
        }
    }
}

impl AccessorData {
    /// All values as floats; normalised integers become [0, 1] or [−1, 1] (glTF 2.0, section 3.11).
    #[must_use]
    pub fn to_f32(&self) -> Vec<f32> {
        let scale = |max: f32| if self.normalized { 1.0 / max } else { 1.0 };
        // The division, not a product with the inverse, so that max itself becomes exactly 1.
        let signed = |v: f32, max: f32| if self.normalized { (v / max).max(-1.0) } else { v };
        let unsigned = |v: f32, max: f32| if self.normalized { v / max } else { v };
        let b = &self.bytes;
        match self.component_type {
            5120 => b.iter().map(|&v| signed(f32::from(v as i8), 127.0)).collect(),
            5121 => b.iter().map(|&v| unsigned(f32::from(v), 255.0)).collect(),
            5122 => b.as_chunks().0.iter().map(|&v| signed(f32::from(i16::from_le_bytes(v)), 32767.0)).collect(),
            5123 => b.as_chunks().0.iter().map(|&v| unsigned(f32::from(u16::from_le_bytes(v)), 65535.0)).collect(),
            5125 => b.as_chunks().0.iter().map(|&v| u32::from_le_bytes(v) as f32 * scale(u32::MAX as f32)).collect(),
            _ => b.as_chunks().0.iter().map(|&v| f32::from_le_bytes(v)).collect(),
        }
    }

    /// All values of an accessor of unsigned integers; `None` for other component types.
    #[must_use]
    pub fn to_u32(&self) -> Option<Vec<u32>> {
        let size = match self.component_type {
            5121 => 1,
            5123 => 2,
            5125 => 4,
            _ => return None,
        };
        Some(self.bytes.chunks_exact(size).map(|v| unsigned(v, size)).collect())
    }
}

/// The little-endian unsigned integer in the first `size` ≤ 4 bytes.
fn unsigned(bytes: &[u8], size: usize) -> u32 {
    bytes[..size].iter().rev().fold(0, |value, &byte| value << 8 | u32::from(byte))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::schema::BufferView;

    fn document(bytes: Vec<u8>, accessor: &str, stride: Option<usize>) -> Document {
        let view = BufferView { buffer: Some(0), byte_length: bytes.len(), byte_stride: stride, ..Default::default() };
        let mut document = Document { buffers: vec![bytes], ..Default::default() };
        document.root.buffer_views.push(view);
        document.root.accessors.push(serde_json::from_str(accessor).unwrap());
        document
    }

    #[test]
    fn padded_matrix_columns_are_packed() {
        // MAT3 of bytes: columns start at multiples of 4; the last column needs no padding.
        let bytes = vec![1, 2, 3, 99, 4, 5, 6, 99, 7, 8, 9];
        let accessor = r#"{"bufferView": 0, "componentType": 5121, "count": 1, "type": "MAT3"}"#;
        assert_eq!(document(bytes, accessor, None).accessor(0).unwrap().bytes, [1, 2, 3, 4, 5, 6, 7, 8, 9]);
    }

    #[test]
    fn strides_and_integral_decimals() {
        let bytes = vec![1, 2, 0, 0, 3, 4, 0, 0, 5, 6];
        let accessor = r#"{"bufferView": 0, "componentType": 5121.0, "count": 3, "type": "VEC2", "normalized": true}"#;
        let data = document(bytes.clone(), accessor, Some(4)).accessor(0).unwrap();
        assert_eq!(data.bytes, [1, 2, 3, 4, 5, 6]);
        assert_eq!(data.to_f32()[1], 2.0 / 255.0);
        assert!(document(bytes.clone(), accessor, Some(1)).accessor(0).is_err(), "a stride below the element");
        assert!(document(bytes[..9].to_vec(), accessor, Some(4)).accessor(0).is_err(), "one byte short");
    }

    #[test]
    fn normalised_ends_are_exact() {
        let data = |component_type, bytes: &[u8]| AccessorData {
            count: 1,
            components: bytes.len(),
            component_type,
            normalized: true,
            bytes: bytes.to_vec(),
        };
        assert_eq!(data(5120, &[127, 128, 129, 0]).to_f32(), [1.0, -1.0, -1.0, 0.0]);
        assert_eq!(data(5121, &[255, 0]).to_f32(), [1.0, 0.0]);
        assert_eq!(data(5122, &[0xff, 0x7f, 0, 0x80]).to_f32(), [1.0, -1.0]);
        assert_eq!(data(5123, &[255, 255]).to_f32(), [1.0]);
    }

    #[test]
    fn claims_are_not_allocated() {
        let accessor = r#"{"bufferView": 0, "componentType": 5126, "count": 1000000000, "type": "VEC3"}"#;
        assert!(document(vec![0; 36], accessor, None).accessor(0).is_err());
        let huge = format!(r#"{{"bufferView": 0, "componentType": 5126, "count": {}, "type": "MAT4"}}"#, usize::MAX);
        assert!(document(vec![0; 36], &huge, None).accessor(0).is_err());
        let zeros = r#"{"componentType": 5126, "count": 1000000000, "type": "VEC3"}"#;
        assert!(document(vec![], zeros, None).accessor(0).is_err());
    }
}
