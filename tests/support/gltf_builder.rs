//! Builds small glTF documents for tests: JSON by hand, binary data by helper, either container.

#![allow(dead_code, reason = "each test crate uses its own part of this file")]
#![allow(clippy::unwrap_used, reason = "a test that cannot go on should panic")]

use serde_json::Value;
use serde_json::json;

/// A document in the making; `json` is open to any change.
pub(crate) struct Builder {
    pub(crate) json: Value,
    pub(crate) bin: Vec<u8>,
}

impl Builder {
    /// An empty document with one buffer, to be filled.
    pub(crate) fn new() -> Self {
        Self { json: json!({"asset": {"version": "2.0"}, "buffers": [{}]}), bin: Vec::new() }
    }

    /// One white triangle (0,0,0) (1,0,0) (0,1,0) in mesh 0, placed by node 0. Accessor 0 = positions.
    pub(crate) fn triangle() -> Self {
        let mut b = Self::new();
        let position = b.floats("VEC3", &[0., 0., 0., 1., 0., 0., 0., 1., 0.]);
        b.push("meshes", json!({"primitives": [{"attributes": {"POSITION": position}}]}));
        b.push("nodes", json!({"mesh": 0}));
        b
    }

    /// [`Builder::square`] whose base colour is an image that only an extension can name, which is required.
    pub(crate) fn textured(image: &[u8], mime_type: &str, extension: &str) -> Self {
        let mut b = Self::square(
            json!({"name": "Wood", "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "metallicFactor": 0}}),
        );
        let view = b.view(image, json!({}));
        let image = b.push("images", json!({"bufferView": view, "mimeType": mime_type}));
        b.push("textures", json!({"extensions": {extension: {"source": image}}}));
        b.json["extensionsUsed"] = json!([extension]);
        b.json["extensionsRequired"] = json!([extension]);
        b
    }

    /// A square in the xy plane from (0,0) to (1,1), `TEXCOORD_0` = (x, y), two triangles, material 0, node 0.
    pub(crate) fn square(material: Value) -> Self {
        let mut b = Self::new();
        let position = b.floats("VEC3", &[0., 0., 0., 1., 0., 0., 1., 1., 0., 0., 1., 0.]);
        let uv = b.floats("VEC2", &[0., 0., 1., 0., 1., 1., 0., 1.]);
        let indices = b.accessor(5123, "SCALAR", 6, &words(&[0, 1, 2, 0, 2, 3]), json!({}));
        b.push("materials", material);
        b.push(
            "meshes",
            json!({"primitives": [{"attributes": {"POSITION": position, "TEXCOORD_0": uv}, "indices": indices,
                   "material": 0}]}),
        );
        b.push("nodes", json!({"mesh": 0}));
        b
    }

    /// Appends to a top-level array; returns the index.
    pub(crate) fn push(&mut self, list: &str, value: Value) -> usize {
        let list = self.json.as_object_mut().unwrap().entry(list).or_insert_with(|| json!([]));
        let list = list.as_array_mut().unwrap();
        list.push(value);
        list.len() - 1
    }

    /// Sets the value at a JSON pointer; its parent must exist.
    pub(crate) fn set(&mut self, pointer: &str, value: Value) -> &mut Self {
        let (parent, key) = pointer.rsplit_once('/').unwrap();
        let parent = self.json.pointer_mut(parent).unwrap_or_else(|| panic!("{pointer}"));
        match key.parse::<usize>() {
            Ok(index) if parent.is_array() => parent[index] = value,
            _ => parent[key] = value,
        }
        self
    }

    /// Appends bytes as a buffer view, aligned to 4; returns its index.
    pub(crate) fn view(&mut self, bytes: &[u8], more: Value) -> usize {
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        let mut view = json!({"buffer": 0, "byteOffset": self.bin.len(), "byteLength": bytes.len()});
        merge(&mut view, more);
        self.bin.extend_from_slice(bytes);
        self.push("bufferViews", view)
    }

    /// Appends an accessor with its own view; `more` adds or overrides properties.
    pub(crate) fn accessor(&mut self, component: u32, kind: &str, count: usize, bytes: &[u8], more: Value) -> usize {
        let view = self.view(bytes, json!({}));
        let mut accessor = json!({"bufferView": view, "componentType": component, "count": count, "type": kind});
        merge(&mut accessor, more);
        self.push("accessors", accessor)
    }

    /// A float accessor.
    pub(crate) fn floats(&mut self, kind: &str, values: &[f32]) -> usize {
        let size = match kind {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            "MAT4" => 16,
            _ => 4,
        };
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.accessor(5126, kind, values.len() / size, &bytes, json!({}))
    }

    /// A texture with an embedded PNG; returns the texture's index.
    pub(crate) fn texture(&mut self, width: u32, pixels: &[[u8; 4]]) -> usize {
        let view = self.view(&png(width, pixels), json!({}));
        let image = self.push("images", json!({"bufferView": view, "mimeType": "image/png"}));
        self.push("textures", json!({"source": image}))
    }

    fn finished(&self) -> Value {
        let mut json = self.json.clone();
        if json["buffers"][0].get("byteLength").is_none() {
            json["buffers"][0]["byteLength"] = json!(self.bin.len());
        }
        json
    }

    /// The document as .gltf with its buffer in a data URI.
    pub(crate) fn gltf(&self) -> Vec<u8> {
        let mut json = self.finished();
        if json["buffers"][0].get("uri").is_none() {
            json["buffers"][0]["uri"] = json!(data_uri("application/octet-stream", &self.bin));
        }
        json.to_string().into_bytes()
    }

    /// The document as .glb, with more chunks after the first two.
    pub(crate) fn glb(&self, more: &[(u32, &[u8])]) -> Vec<u8> {
        glb(self.finished().to_string().as_bytes(), Some(&self.bin), more)
    }
}

/// A GLB from its parts.
pub(crate) fn glb(json: &[u8], bin: Option<&[u8]>, more: &[(u32, &[u8])]) -> Vec<u8> {
    let mut body = Vec::new();
    let mut chunk = |kind: u32, bytes: &[u8], pad: u8| {
        let length = bytes.len().next_multiple_of(4);
        body.extend_from_slice(&(length as u32).to_le_bytes());
        body.extend_from_slice(&kind.to_le_bytes());
        body.extend_from_slice(bytes);
        body.resize(body.len() + length - bytes.len(), pad);
    };
    chunk(0x4E4F_534A, json, b' ');
    if let Some(bin) = bin {
        chunk(0x004E_4942, bin, 0);
    }
    more.iter().for_each(|(kind, bytes)| chunk(*kind, bytes, 0));
    let mut out = b"glTF".to_vec();
    out.extend_from_slice(&2u32.to_le_bytes());
    out.extend_from_slice(&(body.len() as u32 + 12).to_le_bytes());
    out.extend_from_slice(&body);
    out
}

/// Little-endian 16-bit integers.
pub(crate) fn words(values: &[u16]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

/// A PNG, row 0 on top.
pub(crate) fn png(width: u32, pixels: &[[u8; 4]]) -> Vec<u8> {
    let height = pixels.len() as u32 / width;
    let image = image::RgbaImage::from_raw(width, height, pixels.concat()).unwrap();
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
    bytes.into_inner()
}

/// A base64 data URI.
pub(crate) fn data_uri(mime: &str, bytes: &[u8]) -> String {
    const ALPHABET: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = format!("data:{mime};base64,");
    for group in bytes.chunks(3) {
        let bits = group.iter().fold(0u32, |b, &x| b << 8 | u32::from(x)) << (8 * (3 - group.len()));
        for i in 0..4 {
            text.push(if i <= group.len() { ALPHABET[(bits >> (18 - 6 * i)) as usize & 63] as char } else { '=' });
        }
    }
    text
}

fn merge(into: &mut Value, from: Value) {
    for (key, value) in from.as_object().unwrap() {
        if value.is_null() {
            into.as_object_mut().unwrap().remove(key);
        } else {
            into[key] = value.clone();
        }
    }
}
