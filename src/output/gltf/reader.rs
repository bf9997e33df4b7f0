//! Reads the elements of an accessor as they are stored, tightly packed.

use crate::output::Error;
use crate::output::splice::Element;
use crate::scene::AccessorData;
use crate::scene::Document;

/// The elements of an accessor; sparse substitution applied.
pub(super) fn accessor(document: &Document, index: usize) -> Result<AccessorData, Error> {
    read(document, index).ok_or_else(|| Error::invalid(&document.path, format!("accessor {index} cannot be read")))
}

fn read(document: &Document, index: usize) -> Option<AccessorData> {
    let root = Element::root(&document.json).ok()?;
    let accessor = *root.array("accessors").get(index)?;
    let views = root.array("bufferViews");
    let component_type = u32::try_from(accessor.index_at("componentType")?).ok()?;
    let kind = accessor.get("type")?.string()?;
    let (columns, rows) = match kind.as_str() {
        "SCALAR" => (1, 1),
        "VEC2" => (1, 2),
        "VEC3" => (1, 3),
        "VEC4" => (1, 4),
        "MAT2" => (2, 2),
        "MAT3" => (3, 3),
        "MAT4" => (4, 4),
        _ => return None,
    };
    let size = super::append::component_size(component_type);
    let column = rows * size;
    let padded = if columns > 1 { column.next_multiple_of(4) } else { column };
    let count = accessor.index_at("count")?;
    let packed = |bytes: &[u8], stride: usize, count: usize| -> Option<Vec<u8>> {
        let mut out = Vec::new();
        for i in 0..count {
            for c in 0..columns {
                out.extend_from_slice(bytes.get(i * stride + c * padded..i * stride + c * padded + column)?);
            }
        }
        Some(out)
    };
    let element = padded * columns;
    let mut bytes = match accessor.index_at("bufferView") {
        Some(view) => {
            let view = views.get(view)?;
            let offset = accessor.index_at("byteOffset").unwrap_or(0);
            let stride = view.index_at("byteStride").unwrap_or(element);
            packed(view_bytes(document, view)?.get(offset..)?, stride, count)?
        }
        None => vec![0; count.checked_mul(column * columns)?],
    };
    if let Some(sparse) = accessor.get("sparse") {
        let (indices, values) = (sparse.get("indices")?, sparse.get("values")?);
        let part = |e: &Element<'_>| {
            let view = *views.get(e.index_at("bufferView")?)?;
            view_bytes(document, &view)?.get(e.index_at("byteOffset").unwrap_or(0)..)
        };
        let width = super::append::component_size(u32::try_from(indices.index_at("componentType")?).ok()?);
        let (places, count) = (part(&indices)?, sparse.index_at("count")?);
        let values = packed(part(&values)?, element, count)?;
        for k in 0..count {
            let place = places.get(k * width..(k + 1) * width)?.iter().rev().fold(0, |n, b| n << 8 | usize::from(*b));
            let target = place * column * columns;
            let value = values.get(k * column * columns..(k + 1) * column * columns)?;
            bytes.get_mut(target..target + column * columns)?.copy_from_slice(value);
        }
    }
    let normalized = accessor.get("normalized").is_some_and(|n| n.text() == "true");
    Some(AccessorData { count, components: rows * columns, component_type, normalized, bytes })
}

fn view_bytes<'a>(document: &'a Document, view: &Element<'_>) -> Option<&'a [u8]> {
    let start = view.index_at("byteOffset").unwrap_or(0);
    document.buffers.get(view.index_at("buffer")?)?.get(start..start.checked_add(view.index_at("byteLength")?)?)
}
