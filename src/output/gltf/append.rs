//! New accessors, buffer views and bytes, collected for the end of the document.
//!
//! Accessors of one kind share a buffer view: all lightmap coordinates, all indices of one width, and so on. Offsets
//! and strides of vertex attributes are multiples of 4 (glTF 2.0, section 3.6.2.4: data alignment).

use crate::atlas::ChartedPart;
use crate::output::Contents;
use crate::output::splice::Element;
use crate::output::splice::quoted;
use crate::scene::AccessorData;

/// glTF component type of unsigned 16-bit integers.
const U16: u32 = 5123;
/// glTF component type of unsigned 32-bit integers.
const U32: u32 = 5125;
/// glTF component type of 32-bit floats.
const F32: u32 = 5126;
/// `bufferView.target` of vertex attributes.
const ARRAY_BUFFER: u32 = 34962;
/// Vertices below which coordinates are kept rather than made when the file is written.
const FEW: usize = 512;
/// `bufferView.target` of indices.
const ELEMENT_ARRAY_BUFFER: u32 = 34963;

/// What is added behind the accessors and buffer views of a document.
pub(super) struct Append {
    first_view: usize,
    first_accessor: usize,
    views: Vec<View>,
    accessors: Vec<String>,
}

/// Bytes of one new buffer view; equal `target`, `stride` and `kind` share one.
struct View {
    target: u32,
    stride: usize,
    kind: &'static str,
    bytes: Contents,
}

/// All that was added, ready to be spliced.
pub(super) struct Appended {
    pub(super) bytes: Contents,
    pub(super) views: Vec<String>,
    pub(super) accessors: Vec<String>,
}

impl Append {
    /// For a document that has so many views and accessors.
    pub(super) fn new(first_view: usize, first_accessor: usize) -> Self {
        Self { first_view, first_accessor, views: Vec::new(), accessors: Vec::new() }
    }

    /// Index of the view and offset of the next byte in it.
    fn view(&mut self, target: u32, stride: usize, kind: &'static str) -> (usize, &mut Contents) {
        let same = |v: &View| (v.target, v.stride, v.kind) == (target, stride, kind);
        let i = self.views.iter().position(same).unwrap_or_else(|| {
            self.views.push(View { target, stride, kind, bytes: Contents::default() });
            self.views.len() - 1
        });
        (self.first_view + i, &mut self.views[i].bytes)
    }

    fn accessor(&mut self, text: String) -> usize {
        self.accessors.push(text);
        self.first_accessor + self.accessors.len() - 1
    }

    /// Lightmap coordinates of a part: a VEC2 attribute of floats or, if they are `short`, of normalised 16-bit numbers.
    pub(super) fn lightmap_uv(&mut self, charted: &ChartedPart, page_size: [u32; 2], short: bool) -> usize {
        let (kind, size, what) = match short {
            true => (U16, 4, "short lightmap coordinates"),
            false => (F32, 8, "lightmap coordinates"),
        };
        let (view, bytes) = self.view(ARRAY_BUFFER, size, what);
        let (offset, count) = (bytes.len(), charted.layout.uv.len());
        let normalized = if short { ", \"normalized\": true" } else { "" };
        if count < FEW {
            bytes.extend(&uv_bytes(charted, page_size, short));
        } else {
            let charted = charted.clone();
            bytes.promise(count * size, move || uv_bytes(&charted, page_size, short));
        }
        self.accessor(format!(
            "{{\"bufferView\": {view}, \"byteOffset\": {offset}, \"componentType\": {kind}{normalized}, \"count\": {count}, \"type\": \"VEC2\"}}"
        ))
    }

    /// A VEC3 float attribute.
    pub(super) fn vectors(&mut self, vectors: impl ExactSizeIterator<Item = [f32; 3]>) -> usize {
        let count = vectors.len();
        let (view, bytes) = self.view(ARRAY_BUFFER, 12, "light");
        let offset = bytes.len();
        bytes.extend(&vectors.flatten().flat_map(f32::to_le_bytes).collect::<Vec<u8>>());
        self.accessor(format!(
            "{{\"bufferView\": {view}, \"byteOffset\": {offset}, \"componentType\": {F32}, \"count\": {count}, \"type\": \"VEC3\"}}"
        ))
    }

    /// A VEC4 attribute of normalised 16-bit numbers.
    pub(super) fn colors(&mut self, colors: impl ExactSizeIterator<Item = [u16; 4]>) -> usize {
        let count = colors.len();
        let (view, bytes) = self.view(ARRAY_BUFFER, 8, "colors");
        let offset = bytes.len();
        bytes.extend(&colors.flatten().flat_map(u16::to_le_bytes).collect::<Vec<u8>>());
        self.accessor(format!(
            "{{\"bufferView\": {view}, \"byteOffset\": {offset}, \"componentType\": {U16}, \"normalized\": true, \"count\": {count}, \"type\": \"VEC4\"}}"
        ))
    }

    /// A VEC2 float attribute of zeros; all of them share their bytes.
    pub(super) fn zero_uv(&mut self, count: usize) -> usize {
        let (view, bytes) = self.view(ARRAY_BUFFER, 8, "zeros");
        bytes.pad(count * 8);
        self.accessor(format!(
            "{{\"bufferView\": {view}, \"componentType\": {F32}, \"count\": {count}, \"type\": \"VEC2\"}}"
        ))
    }

    /// Indices of triangles, as 16-bit numbers where they fit (65535 is kept free, it can mean a restart).
    pub(super) fn indices(&mut self, indices: &[u32]) -> usize {
        let small = indices.iter().all(|&i| i < 65535);
        let size = if small { 2 } else { 4 };
        let (view, bytes) = self.view(ELEMENT_ARRAY_BUFFER, size, "indices");
        let offset = bytes.len();
        bytes.extend(&indices.iter().flat_map(|i| i.to_le_bytes().into_iter().take(size)).collect::<Vec<u8>>());
        let (kind, count) = (if small { U16 } else { U32 }, indices.len());
        self.accessor(format!(
            "{{\"bufferView\": {view}, \"byteOffset\": {offset}, \"componentType\": {kind}, \"count\": {count}, \"type\": \"SCALAR\"}}"
        ))
    }

    /// A vertex attribute with the elements `picked` from `data`. `kind` is its glTF type; `rest` are further members
    /// of the accessor as JSON, each with a comma before it. Every index must be below `data.count`.
    fn attribute(&mut self, data: &AccessorData, kind: &str, picked: &[u32], rest: &str) -> usize {
        let size = component_size(data.component_type);
        // Columns of matrices start at multiples of 4 bytes (glTF 2.0, section 3.6.2.4).
        let rows = match kind {
            "MAT2" => 2,
            "MAT3" => 3,
            _ => data.components,
        };
        let column = rows * size;
        let matrix = rows != data.components;
        let (padded_column, columns) =
            if matrix { (column.next_multiple_of(4), data.components / rows) } else { (column, 1) };
        let stride = (padded_column * columns).next_multiple_of(4);
        let (view, bytes) = self.view(ARRAY_BUFFER, stride, "attributes");
        let offset = bytes.len();
        let mut elements = Vec::with_capacity(picked.len() * stride);
        for &i in picked {
            let start = elements.len();
            let element = i as usize * data.components * size;
            for c in 0..columns {
                elements.extend_from_slice(&data.bytes[element + c * column..element + (c + 1) * column]);
                elements.resize(start + (c + 1) * padded_column, 0);
            }
            elements.resize(start + stride, 0);
        }
        bytes.extend(&elements);
        let (component, count) = (data.component_type, picked.len());
        self.accessor(format!(
            "{{\"bufferView\": {view}, \"byteOffset\": {offset}, \"componentType\": {component}, \"count\": {count}, \"type\": \"{kind}\"{rest}}}"
        ))
    }

    /// The attribute `name` anew: the elements `picked` from `data`, and all that its old accessor says besides. Every
    /// index must be below `data.count`.
    pub(super) fn rewritten(&mut self, old: &Element<'_>, name: &str, data: &AccessorData, picked: &[u32]) -> usize {
        const REWRITTEN: [&str; 8] =
            ["bufferView", "byteOffset", "componentType", "count", "type", "sparse", "min", "max"];
        let kind = old.get("type").and_then(|t| t.string()).unwrap_or_default();
        let mut rest = String::new();
        for (key, value) in old.members() {
            if !REWRITTEN.contains(&key.as_str()) {
                rest += &format!(", {}: {}", quoted(&key), value.text());
            }
        }
        if name == "POSITION" || old.get("min").is_some() {
            let (least, most) = bounds(data, picked);
            rest += &format!(", \"min\": {least}, \"max\": {most}");
        }
        self.attribute(data, &kind, picked, &rest)
    }

    /// Everything, laid out from byte `base` of buffer `buffer` (`base` is a multiple of 4).
    pub(super) fn finish(self, buffer: usize, base: usize) -> Appended {
        let mut out = Appended { bytes: Contents::default(), views: Vec::new(), accessors: self.accessors };
        for view in self.views {
            let (offset, length) = (base + out.bytes.len(), view.bytes.len());
            let stride =
                if view.target == ARRAY_BUFFER { format!(", \"byteStride\": {}", view.stride) } else { String::new() };
            out.views.push(format!(
                "{{\"buffer\": {buffer}, \"byteOffset\": {offset}, \"byteLength\": {length}{stride}, \"target\": {}}}",
                view.target
            ));
            out.bytes.append(view.bytes);
            out.bytes.pad(out.bytes.len().next_multiple_of(4));
        }
        out
    }
}

/// Lightmap coordinates of a part in parts of its page, or each the nearest of 65,536 numbers in [0, 1].
fn uv_bytes(charted: &ChartedPart, page_size: [u32; 2], short: bool) -> Vec<u8> {
    let [width, height] = page_size.map(|n| n as f32);
    let uv = charted.uvs().flat_map(|uv| [uv.x / width, uv.y / height]);
    // In f64: 65535 · f32 does not fit into an f32.
    let nearest = |v: f32| (f64::from(v).clamp(0.0, 1.0) * 65535.0).round() as u16;
    if short { uv.flat_map(|v| nearest(v).to_le_bytes()).collect() } else { uv.flat_map(f32::to_le_bytes).collect() }
}

/// Bytes of a component.
pub(super) fn component_size(component_type: u32) -> usize {
    match component_type {
        5120 | 5121 => 1,
        5122 | 5123 => 2,
        _ => 4,
    }
}

/// `min` and `max` of the elements `picked`, as two JSON arrays. Floats are written so that they read back exactly.
fn bounds(data: &AccessorData, picked: &[u32]) -> (String, String) {
    let size = component_size(data.component_type);
    let mut least = vec![f64::INFINITY; data.components];
    let mut most = vec![f64::NEG_INFINITY; data.components];
    for &i in picked {
        for c in 0..data.components {
            let at = (i as usize * data.components + c) * size;
            let value = component(data.component_type, &data.bytes[at..at + size]);
            least[c] = least[c].min(value);
            most[c] = most[c].max(value);
        }
    }
    let list = |values: Vec<f64>| {
        let texts: Vec<String> = values.iter().map(|v| serde_json::Value::from(*v).to_string()).collect();
        format!("[{}]", texts.join(", "))
    };
    (list(least), list(most))
}

/// The value of one component.
pub(super) fn component(component_type: u32, bytes: &[u8]) -> f64 {
    match (component_type, bytes) {
        (5120, &[a]) => f64::from(a as i8),
        (5121, &[a]) => f64::from(a),
        (5122, &[a, b]) => f64::from(i16::from_le_bytes([a, b])),
        (5123, &[a, b]) => f64::from(u16::from_le_bytes([a, b])),
        (5125, &[a, b, c, d]) => f64::from(u32::from_le_bytes([a, b, c, d])),
        (_, &[a, b, c, d]) => f64::from(f32::from_le_bytes([a, b, c, d])),
        _ => 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::atlas::Layout;
    use glam::Vec2;

    #[test]
    fn short_elements_and_matrix_columns_are_padded() {
        let mut append = Append::new(3, 5);
        let bytes: Vec<u8> = (0..27).collect();
        let colors =
            AccessorData { count: 9, components: 3, component_type: 5121, normalized: true, bytes: bytes.clone() };
        assert_eq!(append.attribute(&colors, "VEC3", &[1, 0], ", \"normalized\": true"), 5);
        let matrices = AccessorData { count: 3, components: 9, component_type: 5121, normalized: false, bytes };
        assert_eq!(append.attribute(&matrices, "MAT3", &[2], ""), 6);
        let out = append.finish(1, 100);
        assert_eq!(out.bytes.to_vec(), [3, 4, 5, 0, 0, 1, 2, 0, 18, 19, 20, 0, 21, 22, 23, 0, 24, 25, 26, 0]);
        assert!(out.views[0].contains("\"byteOffset\": 100") && out.views[1].contains("\"byteOffset\": 108"));
        assert!(out.views[1].contains("\"byteStride\": 12"));
        assert!(out.accessors[0].contains("\"bufferView\": 3") && out.accessors[0].contains("\"normalized\": true"));
    }

    #[test]
    fn short_coordinates_are_the_nearest_and_stay_inside() {
        for repeat in [1, FEW] {
            let corners = [Vec2::new(0.0, 1.0), Vec2::new(-1e-7, 1.000_001), Vec2::new(0.3, 0.5)];
            let uv = core::iter::repeat_n(corners, repeat).flatten().map(|uv| uv * 100.0).collect();
            let charted = ChartedPart::on_page(Layout { uv, ..Layout::default() });
            let mut append = Append::new(0, 0);
            append.lightmap_uv(&charted, [100, 100], true);
            append.lightmap_uv(&charted, [100, 100], false);
            let out = append.finish(0, 0);
            let bytes = out.bytes.to_vec();
            assert_eq!(bytes.len(), out.bytes.len());
            let (short, long) = bytes.split_at(repeat * 12);
            let read: Vec<u16> = short.chunks(2).map(|b| u16::from_le_bytes([b[0], b[1]])).collect();
            assert_eq!(read, [0, 65535, 0, 65535, 19661, 32768].repeat(repeat));
            let read: Vec<f32> = long.chunks(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect();
            assert_eq!(read.len(), 6 * repeat);
            assert!((read[4] - 0.3).abs() < 1e-6 && (read[3] - 1.000_001).abs() < 1e-6);
            assert!(out.views[0].contains("\"byteStride\": 4") && out.accessors[0].contains("\"normalized\": true"));
            assert!(out.views[1].contains("\"byteStride\": 8") && !out.accessors[1].contains("normalized"));
        }
    }

    #[test]
    fn indices_are_short_where_they_fit() {
        let mut append = Append::new(0, 0);
        append.indices(&[0, 65534, 1]);
        append.indices(&[0, 65535, 1]);
        append.indices(&[7]);
        let out = append.finish(0, 0);
        assert_eq!(out.views.len(), 2);
        assert_eq!(out.bytes.len(), 8 + 12);
        assert!(out.accessors[0].contains("5123") && out.accessors[1].contains("5125"));
        assert!(out.accessors[2].contains("\"byteOffset\": 6"));
    }

    #[test]
    fn bounds_read_back_exactly() {
        let values = [0.1f32, -3.5, 1e-8, 7.0];
        let bytes = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        let data = AccessorData { count: 2, components: 2, component_type: 5126, normalized: false, bytes };
        let (least, most) = bounds(&data, &[0, 1]);
        let least: Vec<f64> = serde_json::from_str(&least).unwrap();
        let most: Vec<f64> = serde_json::from_str(&most).unwrap();
        assert_eq!(least.iter().map(|v| *v as f32).collect::<Vec<_>>(), [1e-8, -3.5]);
        assert_eq!(most.iter().map(|v| *v as f32).collect::<Vec<_>>(), [0.1, 7.0]);
    }
}
