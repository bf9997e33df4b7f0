//! Hand-made glTF documents, and a reader of accessors that shares no code with the library.

use serde_json::Value;
use serde_json::json;
use std::path::Path;
use std::path::PathBuf;
use texelwalk::atlas::Atlas;
use texelwalk::atlas::{ChartedPart, Layout};
use texelwalk::scene::Scene;

/// Collects accessors with their bytes in one buffer.
#[derive(Default)]
pub(crate) struct Builder {
    pub(crate) bin: Vec<u8>,
    pub(crate) views: Vec<Value>,
    pub(crate) accessors: Vec<Value>,
}

impl Builder {
    pub(crate) fn view(&mut self, bytes: &[u8]) -> usize {
        self.bin.resize(self.bin.len().next_multiple_of(4), 0xEE);
        self.views.push(json!({"buffer": 0, "byteOffset": self.bin.len(), "byteLength": bytes.len()}));
        self.bin.extend_from_slice(bytes);
        self.views.len() - 1
    }

    /// `extra` are further members of the accessor; `stride` is left to the caller.
    pub(crate) fn raw(&mut self, bytes: &[u8], kind: &str, component: u32, count: usize, extra: &Value) -> usize {
        let view = self.view(bytes);
        let mut accessor = json!({"bufferView": view, "componentType": component, "count": count, "type": kind});
        accessor.as_object_mut().unwrap().extend(extra.as_object().unwrap().clone());
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    pub(crate) fn floats(&mut self, kind: &str, values: &[f32]) -> usize {
        let n = components(kind);
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        let bound = |f: fn(f32, f32) -> f32| -> Vec<f32> {
            (0..n).map(|c| values.iter().skip(c).step_by(n).copied().reduce(f).unwrap()).collect()
        };
        let extra = if kind == "VEC3" { json!({"min": bound(f32::min), "max": bound(f32::max)}) } else { json!({}) };
        self.raw(&bytes, kind, 5126, values.len() / n, &extra)
    }

    pub(crate) fn shorts(&mut self, values: &[u16]) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.raw(&bytes, "SCALAR", 5123, values.len(), &json!({}))
    }
}

pub(crate) fn components(kind: &str) -> usize {
    match kind {
        "SCALAR" => 1,
        "VEC2" => 2,
        "VEC3" => 3,
        "VEC4" | "MAT2" => 4,
        "MAT3" => 9,
        _ => 16,
    }
}

/// A document in a folder of its own, as JSON with files or as GLB.
pub(crate) struct Input {
    pub(crate) folder: tempfile::TempDir,
    pub(crate) scene: Scene,
}

/// Writes `json` (its buffer 0 is `bin`) to disk and loads it. Its parts are (node, mesh, primitive); all of them receive
/// light, also those that a bake would leave out.
pub(crate) fn input(json: &str, bin: &[u8], glb: bool, parts: &[(usize, usize, usize)]) -> Input {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(if glb { "in put.glb" } else { "in put.gltf" });
    std::fs::write(folder.path().join("data.bin"), bin).unwrap();
    std::fs::write(folder.path().join("t ex.png"), PNG).unwrap();
    std::fs::write(&path, if glb { glb_bytes(json, bin) } else { json.as_bytes().to_vec() }).unwrap();
    let mut scene = texelwalk::scene::load(&path, &texelwalk::scene::Settings::default()).unwrap().output;
    let loaded: Vec<_> = scene.parts.iter().map(|p| (p.node, p.mesh, p.primitive)).collect();
    assert_eq!(loaded, parts);
    scene.parts.iter_mut().for_each(|p| p.receives = true);
    Input { folder, scene }
}

fn glb_bytes(json: &str, bin: &[u8]) -> Vec<u8> {
    let mut out = b"glTF\x02\0\0\0\0\0\0\0".to_vec();
    for (kind, data, padding) in [(b"JSON", json.as_bytes(), b' '), (b"BIN\0", bin, 0)] {
        let length = data.len().next_multiple_of(4);
        out.extend_from_slice(&(length as u32).to_le_bytes());
        out.extend_from_slice(kind);
        out.extend_from_slice(data);
        out.resize(out.len().next_multiple_of(4), padding);
    }
    let length = out.len() as u32;
    out[8..12].copy_from_slice(&length.to_le_bytes());
    out
}

/// A 1 × 1 white PNG.
pub(crate) const PNG: &[u8] = &[
    137, 80, 78, 71, 13, 10, 26, 10, 0, 0, 0, 13, 73, 72, 68, 82, 0, 0, 0, 1, 0, 0, 0, 1, 8, 0, 0, 0, 0, 58, 126, 155,
    85, 0, 0, 0, 10, 73, 68, 65, 84, 120, 218, 99, 248, 15, 0, 1, 1, 1, 0, 28, 176, 140, 153, 0, 0, 0, 0, 73, 69, 78,
    68, 174, 66, 96, 130,
];

/// Parts without splits: `vertices` source vertices, `triangles` on one chart each of the list.
pub(crate) fn unsplit(vertices: u32, triangles: &[[u32; 3]], chart: u32) -> ChartedPart {
    ChartedPart::on_page(Layout {
        source_vertex: (0..vertices).collect(),
        uv: (0..vertices).map(|v| glam::Vec2::new(1.0 + v as f32, 2.0)).collect(),
        triangles: triangles.to_vec(),
        chart: vec![chart; triangles.len()],
        vertex_chart: vec![],
    })
}

/// An atlas of 64 × 32 pages with a chart per entry of `pages`.
pub(crate) fn atlas(pages: &[u32], parts: Vec<ChartedPart>) -> Atlas {
    Atlas {
        page_size: [64, 32],
        pages: pages.iter().max().map_or(0, |p| p + 1),
        charts: pages.iter().map(|&page| texelwalk::atlas::Chart { part: 0, page }).collect(),
        parts,
        ..Atlas::default()
    }
}

/// A written document, read back without the library.
pub(crate) struct Output {
    pub(crate) json: Value,
    pub(crate) text: String,
    pub(crate) buffers: Vec<Vec<u8>>,
    pub(crate) path: PathBuf,
}

impl Output {
    pub(crate) fn read(path: &Path) -> Self {
        let bytes = std::fs::read(path).unwrap();
        let (text, bin) =
            if bytes.starts_with(b"glTF") { split_glb(&bytes) } else { (String::from_utf8(bytes).unwrap(), None) };
        let json: Value = serde_json::from_str(&text).unwrap();
        let buffers = json["buffers"].as_array().cloned().unwrap_or_default();
        let buffers = buffers
            .iter()
            .map(|buffer| {
                let bytes = match buffer["uri"].as_str() {
                    Some(uri) => std::fs::read(resolve(path, uri)).unwrap(),
                    None => bin.clone().expect("a BIN chunk"),
                };
                let length = buffer["byteLength"].as_u64().unwrap() as usize;
                assert!(bytes.len() >= length, "buffer of {length} bytes has {}", bytes.len());
                bytes[..length].to_vec()
            })
            .collect();
        Self { json, text, buffers, path: path.to_owned() }
    }

    /// Elements of an accessor as bytes, one `Vec` per element, sparse values put in.
    pub(crate) fn elements(&self, accessor: &Value) -> Vec<Vec<u8>> {
        let accessor = &self.json["accessors"][accessor.as_u64().unwrap() as usize];
        let component = accessor["componentType"].as_u64().unwrap();
        let kind = accessor["type"].as_str().unwrap();
        let size = if component < 5122 {
            1
        } else if component < 5125 {
            2
        } else {
            4
        };
        let (columns, rows) = match kind {
            "MAT2" => (2, 2),
            "MAT3" => (3, 3),
            "MAT4" => (4, 4),
            _ => (1, components(kind)),
        };
        let column = if columns > 1 { (rows * size).next_multiple_of(4) } else { rows * size };
        let number = |v: &Value| v.as_u64().unwrap_or(0) as usize;
        let read = |holder: &Value, count: usize| -> Vec<Vec<u8>> {
            let view = &self.json["bufferViews"][number(&holder["bufferView"])];
            let stride = view["byteStride"].as_u64().map_or(column * columns, |s| s as usize);
            let start = number(&view["byteOffset"]) + number(&holder["byteOffset"]);
            let buffer = &self.buffers[number(&view["buffer"])];
            assert!(
                number(&holder["byteOffset"]) + (count - 1) * stride + column * columns <= number(&view["byteLength"])
            );
            let element = |i: usize| {
                (0..columns).flat_map(move |c| {
                    let at = start + i * stride + c * column;
                    buffer[at..at + rows * size].to_vec()
                })
            };
            (0..count).map(|i| element(i).collect()).collect()
        };
        let count = number(&accessor["count"]);
        let mut out = if accessor["bufferView"].is_null() {
            vec![vec![0; rows * size * columns]; count]
        } else {
            read(accessor, count)
        };
        let sparse = &accessor["sparse"];
        if !sparse.is_null() {
            let n = number(&sparse["count"]);
            let indices = &sparse["indices"];
            let view = &self.json["bufferViews"][number(&indices["bufferView"])];
            let start = number(&view["byteOffset"]) + number(&indices["byteOffset"]);
            assert_eq!(indices["componentType"], 5121, "the test documents use byte indices");
            for (k, value) in read(&sparse["values"], n).into_iter().enumerate() {
                out[usize::from(self.buffers[number(&view["buffer"])][start + k])] = value;
            }
        }
        out
    }

    pub(crate) fn floats(&self, accessor: &Value) -> Vec<Vec<f32>> {
        let of = |e: &Vec<u8>| e.chunks(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect();
        self.elements(accessor).iter().map(of).collect()
    }

    pub(crate) fn indices(&self, accessor: &Value) -> Vec<u32> {
        self.elements(accessor).iter().map(|e| e.iter().rev().fold(0, |n, b| n << 8 | u32::from(*b))).collect()
    }
}

/// The file that a URI of the document leads to.
pub(crate) fn resolve(document: &Path, uri: &str) -> PathBuf {
    let mut bytes = Vec::new();
    let mut rest = uri.as_bytes();
    while let Some((&b, tail)) = rest.split_first() {
        if b == b'%' {
            bytes.push(u8::from_str_radix(std::str::from_utf8(&tail[..2]).unwrap(), 16).unwrap());
            rest = &tail[2..];
        } else {
            bytes.push(b);
            rest = tail;
        }
    }
    document.parent().unwrap().join(String::from_utf8(bytes).unwrap())
}

fn split_glb(bytes: &[u8]) -> (String, Option<Vec<u8>>) {
    let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
    assert_eq!((word(4), word(8) as usize), (2, bytes.len()));
    let (mut at, mut text, mut bin) = (12, String::new(), None);
    while at < bytes.len() {
        let (length, kind) = (word(at) as usize, word(at + 4));
        assert_eq!(length % 4, 0, "chunks are multiples of 4 bytes");
        let data = &bytes[at + 8..at + 8 + length];
        match kind {
            0x4E4F_534A => text = String::from_utf8(data.to_vec()).unwrap(),
            0x004E_4942 => bin = Some(data.to_vec()),
            _ => {}
        }
        at += 8 + length;
    }
    (text, bin)
}
