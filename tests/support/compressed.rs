//! Meshopt and Draco streams in their simplest form, for documents that need a decoder.
//!
//! Source: the bitstreams as `EXT_meshopt_compression` (vertex codec version 0, index sequence codec version 1) and the
//! Draco bitstream specification 2.2 (sequential connectivity, plain indices, generic attributes) describe them.

#![allow(dead_code, reason = "each test crate uses its own part of this file")]

use crate::gltf_builder::Builder;
use serde_json::{Value, json};

const QUAD: [u32; 6] = [0, 1, 2, 0, 2, 3];
const POSITIONS: [f32; 12] = [0., 0., 0., 1., 0., 0., 1., 1., 0., 0., 1., 0.];
const UVS: [f32; 8] = [0., 0., 1., 0., 1., 1., 0., 1.];

fn bytes_of(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

/// Elements of `stride` bytes: byte by byte differences to the element before, all of them stored whole.
pub(crate) fn vertex_stream(elements: &[u8], stride: usize) -> Vec<u8> {
    let count = elements.len() / stride;
    let block = ((8192 / stride) & !15).min(256);
    let mut out = vec![0xa0];
    let mut last: Vec<u8> = elements[..stride].to_vec();
    for start in (0..count).step_by(block) {
        let rows: Vec<&[u8]> = elements.chunks(stride).skip(start).take(block).collect();
        for k in 0..stride {
            let groups = rows.len().div_ceil(16);
            // Two bits per group of 16: 3 = whole bytes.
            out.resize(out.len() + groups.div_ceil(4), 0xff);
            let mut previous = last[k];
            for row in 0..groups * 16 {
                let value = rows.get(row).map_or(previous, |r| r[k]);
                let delta = value.wrapping_sub(previous) as i8;
                out.push(((delta << 1) ^ (delta >> 7)) as u8);
                previous = value;
            }
        }
        last = rows[rows.len() - 1].to_vec();
    }
    out.resize(out.len() + 32usize.saturating_sub(stride), 0);
    out.extend(&elements[..stride]);
    out
}

/// Indices as differences to the one before, in either of two running values.
pub(crate) fn index_sequence(indices: &[u32]) -> Vec<u8> {
    let mut out = vec![0xd1];
    let mut last = 0u32;
    for &index in indices {
        let delta = index.wrapping_sub(last) as i32;
        let mut code = (((delta << 1) ^ (delta >> 31)) as u32) << 1;
        while code > 127 {
            out.push(code as u8 | 0x80);
            code >>= 7;
        }
        out.push(code as u8);
        last = index;
    }
    out.extend([0; 4]);
    out
}

/// Adds a compressed view, with an empty buffer 1 as the place of its bytes.
pub(crate) fn view(b: &mut Builder, name: &str, bytes: &[u8], count: usize, stride: usize, mode: &str) -> usize {
    if b.json["buffers"].as_array().is_some_and(|all| all.len() == 1) {
        b.push("buffers", json!({"byteLength": 1 << 20, "extensions": {name: {"fallback": true}}}));
    }
    let at = b.bin.len();
    b.bin.extend(bytes);
    let mut how = json!({"buffer": 0, "byteOffset": at, "byteLength": bytes.len(), "byteStride": stride});
    (how["count"], how["mode"]) = (json!(count), json!(mode));
    let mut view = json!({"buffer": 1, "byteLength": count * stride, "extensions": {name: how}});
    if mode == "ATTRIBUTES" {
        view["byteStride"] = json!(stride);
    }
    b.push("bufferViews", view)
}

fn square(b: &mut Builder, views: [Option<usize>; 3]) {
    let accessor = |view: Option<usize>, component: u32, count: usize, kind: &str| {
        let mut accessor = json!({"componentType": component, "count": count, "type": kind});
        if let Some(view) = view {
            accessor["bufferView"] = json!(view);
        }
        accessor
    };
    let position = b.push("accessors", accessor(views[0], 5126, 4, "VEC3"));
    let uv = b.push("accessors", accessor(views[1], 5126, 4, "VEC2"));
    let indices = b.push("accessors", accessor(views[2], 5125, 6, "SCALAR"));
    (b.json["accessors"][position]["min"], b.json["accessors"][position]["max"]) = (json!([0, 0, 0]), json!([1, 1, 0]));
    let texture = b.texture(1, &[[255; 4]]);
    b.push("materials", json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": texture}}}));
    let attributes = json!({"POSITION": position, "TEXCOORD_0": uv});
    b.push("meshes", json!({"primitives": [{"attributes": attributes, "indices": indices, "material": 0}]}));
    b.push("nodes", json!({"mesh": 0}));
    b.push("scenes", json!({"nodes": [0]}));
}

fn requires(b: &mut Builder, name: &str) {
    (b.json["extensionsUsed"], b.json["extensionsRequired"]) = (json!([name]), json!([name]));
}

/// The square of [`Builder::square`], everything compressed.
pub(crate) fn meshopt_square(name: &str) -> Builder {
    let mut b = Builder::new();
    requires(&mut b, name);
    let indices: Vec<u32> = QUAD.to_vec();
    let views = [
        view(&mut b, name, &vertex_stream(&bytes_of(&POSITIONS), 12), 4, 12, "ATTRIBUTES"),
        view(&mut b, name, &vertex_stream(&bytes_of(&UVS), 8), 4, 8, "ATTRIBUTES"),
        view(&mut b, name, &index_sequence(&indices), 6, 4, "INDICES"),
    ];
    square(&mut b, views.map(Some));
    b
}

/// The square's positions (attribute 7) and texture coordinates (attribute 3).
pub(crate) fn draco_mesh() -> Vec<u8> {
    draco_mesh_of(QUAD, &POSITIONS)
}

/// The same with other corners and positions.
fn draco_mesh_of(corners: [u32; 6], positions: &[f32; 12]) -> Vec<u8> {
    const FLOAT: u8 = 9;
    let mut out = b"DRACO".to_vec();
    // Version 2.2, a mesh, sequential, no flags; 2 faces, 4 points, plain indices.
    out.extend([2, 2, 1, 0, 0, 0, 2, 4, 1]);
    out.extend(corners.map(|i| i as u8));
    // One decoder of two attributes: kind, type, components, normalised, number; then how each is coded (as it is).
    out.extend([1, 2, 0, FLOAT, 3, 0, 7, 3, FLOAT, 2, 0, 3, 0, 0]);
    out.extend(bytes_of(positions));
    out.extend(bytes_of(&UVS));
    out
}

/// The same square by Draco.
pub(crate) fn draco_square() -> Builder {
    let mut b = Builder::new();
    requires(&mut b, "KHR_draco_mesh_compression");
    let view = b.view(&draco_mesh(), json!({}));
    square(&mut b, [None; 3]);
    let numbers: Value = json!({"POSITION": 7, "TEXCOORD_0": 3});
    let draco = json!({"bufferView": view, "attributes": numbers});
    b.set("/meshes/0/primitives/0/extensions", json!({"KHR_draco_mesh_compression": draco}));
    b
}

/// The same square, another one 3 m beside it that is cut along the other diagonal, and the first again, all in one mesh.
/// The second has compressed bytes of its own; it names the accessors of the first for `shared` (`indices` or a
/// semantic), else its own.
pub(crate) fn draco_squares(shared: &[&str]) -> Builder {
    let mut b = draco_square();
    let mut positions = POSITIONS;
    positions.iter_mut().step_by(3).for_each(|x| *x += 3.0);
    let view = b.view(&draco_mesh_of([1, 2, 3, 1, 3, 0], &positions), json!({}));
    let first = b.json["meshes"][0]["primitives"][0].clone();
    let mut second = first.clone();
    second["extensions"]["KHR_draco_mesh_compression"]["bufferView"] = json!(view);
    for place in ["/indices", "/attributes/POSITION", "/attributes/TEXCOORD_0"] {
        let own = second.pointer_mut(place).filter(|_| !shared.iter().any(|name| place.ends_with(name)));
        if let Some(accessor) = own {
            let entry = b.json["accessors"][accessor.as_u64().map_or(usize::MAX, |a| a as usize)].clone();
            *accessor = json!(b.push("accessors", entry));
        }
    }
    b.json["meshes"][0]["primitives"] = json!([first, second, first]);
    b
}
