//! Odd documents that must load: each with what the scene has to hold. Needs `gltf_builder` at the root of the test program.

use crate::gltf_builder::{Builder, png};
use serde_json::{Value, json};
use texelwalk::scene::Scene;

/// One odd input.
pub(crate) struct Odd {
    pub(crate) name: &'static str,
    /// Files to write into an empty folder, as (name, bytes); folders in names are made.
    pub(crate) files: Vec<(String, Vec<u8>)>,
    /// The one to load.
    pub(crate) main: &'static str,
    /// Triangles that there are.
    pub(crate) triangles: usize,
    /// Codes of the warnings that there are, each once or more.
    pub(crate) warnings: &'static [&'static str],
    /// What else must hold.
    pub(crate) holds: fn(&Scene) -> bool,
}

fn any(_: &Scene) -> bool {
    true
}

fn triangle(name: &'static str, warnings: &'static [&'static str], change: impl FnOnce(&mut Builder)) -> Odd {
    let mut b = Builder::triangle();
    change(&mut b);
    Odd { name, files: vec![("a.gltf".to_owned(), b.gltf())], main: "a.gltf", triangles: 1, warnings, holds: any }
}

/// A triangle whose buffer is this file, named by this URI.
fn beside(name: &'static str, main: &'static str, file: &str, uri: &str) -> Odd {
    let mut b = Builder::triangle();
    b.json["buffers"][0]["uri"] = json!(uri);
    let files = vec![(main.to_owned(), b.gltf()), (file.to_owned(), b.bin.clone())];
    Odd { name, files, main, triangles: 1, warnings: &[], holds: any }
}

/// All of them.
pub(crate) fn cases() -> Vec<Odd> {
    let mut all = files();
    all.extend(sizes());
    all.extend(trees());
    all.extend(harmless());
    all
}

fn files() -> Vec<Odd> {
    vec![
        beside("spaces and percent signs in names", "a.gltf", "my 100% buffer.bin", "my%20100%25%20buffer.bin"),
        beside("a name that is not encoded", "a.gltf", "my buffer#1.bin", "my buffer#1.bin"),
        beside("letters beyond ASCII", "räume 部屋.gltf", "データ.bin", "%E3%83%87%E3%83%BC%E3%82%BF.bin"),
        beside("a buffer in a folder above", "deep/er/a.gltf", "a.bin", "../../a.bin"),
        beside("a detour", "deep/a.gltf", "deep/x/a.bin", "x/../x/./a.bin"),
        beside("a name of dots", "a.gltf", "...bin", "...bin"),
        beside("an extension that nobody knows", "a.scene", "a.bin", "a.bin"),
        triangle("a data URI in capitals", &[], |b| {
            let uri = crate::gltf_builder::data_uri("application/octet-stream", &b.bin);
            b.json["buffers"][0]["uri"] = json!(uri.replace("data:", "DATA:"));
        }),
        triangle("a data URI with percent signs", &[], |b| {
            let text: String = b.bin.iter().map(|byte| format!("%{byte:02x}")).collect();
            b.json["buffers"][0]["uri"] = json!(format!("data:application/octet-stream,{text}"));
        }),
        triangle("a data URI without a type", &[], |b| {
            let uri = crate::gltf_builder::data_uri("", &b.bin);
            b.json["buffers"][0]["uri"] = json!(uri);
        }),
    ]
}

/// A square of this edge, away from the origin by as much.
fn square(edge: f32) -> Builder {
    let mut b = Builder::new();
    let (low, high) = (edge, 2.0 * edge);
    let position = b.floats("VEC3", &[low, 0., low, high, 0., low, high, 0., high, low, 0., high]);
    let indices = b.accessor(5121, "SCALAR", 6, &[0, 2, 1, 0, 3, 2], json!({}));
    b.push("meshes", json!({"primitives": [{"attributes": {"POSITION": position}, "indices": indices}]}));
    b.push("nodes", json!({"mesh": 0}));
    b
}

fn sizes() -> Vec<Odd> {
    let of = |name, builder: Builder, triangles, holds| Odd {
        name,
        files: vec![("a.gltf".to_owned(), builder.gltf())],
        main: "a.gltf",
        triangles,
        warnings: &[],
        holds,
    };
    let mut many = square(1.0);
    let primitive = many.json["meshes"][0]["primitives"][0].clone();
    let with = |material: usize| {
        let mut p = primitive.clone();
        p["material"] = json!(material);
        p
    };
    many.json["meshes"][0]["primitives"] = (0..8192).map(with).collect();
    many.json["materials"] = (0..8192).map(|k| json!({"emissiveFactor": [f64::from(k) / 8192.0, 0, 0]})).collect();
    let mut chain = square(1.0);
    let link = |k: usize| json!({"children": [k + 1], "translation": [0.001, 0, 0]});
    let mut nodes: Vec<Value> = (0..50_000).map(link).collect();
    nodes.push(json!({"mesh": 0}));
    chain.json["nodes"] = json!(nodes);
    let mut wide = square(1.0);
    let grey = png(4096, &vec![[128, 128, 128, 255]; 4096]);
    let view = wide.view(&grey, json!({}));
    wide.push("images", json!({"bufferView": view, "mimeType": "image/png"}));
    wide.push("textures", json!({"source": 0}));
    let uv = wide.floats("VEC2", &[0.0; 8]);
    wide.push("materials", json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}));
    wide.set("/meshes/0/primitives/0/attributes/TEXCOORD_0", json!(uv));
    wide.set("/meshes/0/primitives/0/material", json!(0));
    vec![
        of("a million metres wide", square(1e6), 2, |s| s.area(0) > 4.9e11 && s.area(0) < 5.1e11),
        of("a tenth of a millimetre wide", square(1e-4), 2, |s| s.area(0) > 4.9e-9 && s.area(0) < 5.1e-9),
        of("8,192 materials", many, 16_384, |s| s.materials.len() == 8193 && s.parts.len() == 8192),
        of("50,000 nodes in a chain", chain, 2, |s| (s.vertices.position[0].x - 51.0).abs() < 1e-3),
        of("a texture of one row", wide, 2, any),
    ]
}

fn trees() -> Vec<Odd> {
    vec![
        triangle("a scene that lists all nodes", &["not-a-root"], |b| {
            b.json["nodes"] = json!([{"mesh": 0, "children": [1]}, {"children": [2]}, {}]);
            b.json["scenes"] = json!([{"nodes": [2, 0, 1]}]);
        }),
        Odd {
            holds: |s| s.vertices.position[1].abs_diff_eq(glam::Vec3::new(2.0, 0.0, 0.0), 1e-6),
            ..triangle("a scene that lists a child without its parent", &["not-a-root"], |b| {
                b.json["nodes"] =
                    json!([{"children": [1], "scale": [9, 9, 9]}, {"children": [2], "scale": [2, 2, 2]}, {"mesh": 0}]);
                b.json["scenes"] = json!([{"nodes": [1, 2]}]);
            })
        },
        triangle("an empty scene that is not asked for", &[], |b| {
            b.json["scenes"] = json!([{}, {"nodes": [0]}]);
            b.json["scene"] = json!(1);
        }),
        triangle("an empty list of scenes", &[], |b| b.json["scenes"] = json!([])),
        triangle("names that are empty, or hold line ends", &[], |b| {
            b.json["nodes"][0]["name"] = json!("");
            b.json["meshes"][0]["name"] = json!("a\nb\u{0}c");
        }),
        triangle("an axis that points backwards", &[], |b| b.json["nodes"][0]["scale"] = json!([1, 1, -1])),
        triangle("an animation of nothing", &[], |b| {
            b.json["animations"] =
                json!([{"channels": [{"target": {"path": "pointer"}}, {"target": {"node": 77, "path": "scale"}}]}]);
        }),
        Odd {
            triangles: 2,
            ..triangle("one of two nodes flattened to nothing", &[], |b| {
                b.push("nodes", json!({"mesh": 0, "scale": [0, 0, 0]}));
            })
        },
    ]
}

fn harmless() -> Vec<Odd> {
    vec![
        triangle("extras of any kind", &[], |b| {
            b.json["extras"] = json!([1, {"a": null}]);
            b.json["nodes"][0]["extras"] = json!("text");
            b.json["meshes"][0]["extras"] = json!(null);
        }),
        triangle("an unknown extension with anything in it", &["unsupported-extension"], |b| {
            b.json["extensionsUsed"] = json!(["XX_made_up", "XX_made_up"]);
            b.json["nodes"][0]["extensions"] = json!({"XX_made_up": [[], null, 1e300]});
        }),
        triangle("broken things that nobody uses", &[], |b| {
            b.push("accessors", json!({"bufferView": 99, "componentType": 1, "count": 7, "type": "VEC9"}));
            b.push("bufferViews", json!({"buffer": 0, "byteOffset": 1_000_000, "byteLength": 1_000_000}));
            b.push("images", json!({"uri": "gone.png"}));
            b.push("textures", json!({"source": 0}));
            b.push("materials", json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}));
        }),
        triangle("bounds that are wrong", &[], |b| {
            b.json["accessors"][0]["min"] = json!([5, 5, 5]);
            b.json["accessors"][0]["max"] = json!([-5, -5, -5]);
        }),
        triangle("an old placeholder of compressed views", &[], |b| {
            b.push("buffers", json!({"byteLength": 36}));
            let bytes = [0u8; 4];
            let view = b.view(&bytes, json!({}));
            b.json["bufferViews"][view]["buffer"] = json!(1);
            b.json["bufferViews"][view]["byteLength"] = json!(0);
            b.json["bufferViews"][view]["extensions"] = json!({"EXT_meshopt_compression":
                {"buffer": 0, "byteLength": 4, "byteStride": 4, "count": 0, "mode": "ATTRIBUTES"}});
        }),
        Odd {
            triangles: 3,
            ..triangle("triangles without area beside one with", &[], |b| {
                let indices = b.accessor(5121, "SCALAR", 9, &[0, 0, 0, 0, 1, 2, 1, 1, 2], json!({}));
                b.set("/meshes/0/primitives/0/indices", json!(indices));
            })
        },
        Odd {
            triangles: 100,
            ..triangle("the same triangle a hundred times", &[], |b| {
                let indices = b.accessor(5121, "SCALAR", 300, &[0, 1, 2].repeat(100), json!({}));
                b.set("/meshes/0/primitives/0/indices", json!(indices));
            })
        },
    ]
}
