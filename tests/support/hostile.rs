//! Broken and hostile inputs, with what a reader must say about each. Shared by the tests of the library and of the
//! command.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on should panic")]

#[path = "gltf_builder.rs"]
pub(crate) mod builder;

use builder::Builder;
use builder::data_uri;
use builder::glb;
use builder::png;
use builder::words;
use serde_json::json;

/// What kind of error is due.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Class {
    Unsupported,
    Invalid,
    Io,
}

/// One broken input.
pub(crate) struct Case {
    pub(crate) name: &'static str,
    /// Files to write into an empty folder, as (name, bytes).
    pub(crate) files: Vec<(&'static str, Vec<u8>)>,
    /// The one to load; it may be missing.
    pub(crate) main: &'static str,
    pub(crate) class: Class,
    /// Each must occur in the message.
    pub(crate) message_contains: Vec<&'static str>,
}

use Class::Invalid;
use Class::Unsupported;

/// All cases.
pub(crate) fn cases() -> Vec<Case> {
    let mut cases = containers();
    cases.extend(versions_and_extensions());
    cases.extend(buffers());
    cases.extend(accessors());
    cases.extend(sparse());
    cases.extend(geometry());
    cases.extend(trees());
    cases.extend(instances());
    cases.extend(materials());
    cases.extend(images());
    cases.extend(names());
    cases.extend(spellings());
    cases
}

fn bytes(name: &'static str, bytes: Vec<u8>, class: Class, words: &[&'static str]) -> Case {
    let main = if bytes.starts_with(b"glTF") { "a.glb" } else { "a.gltf" };
    Case { name, files: vec![(main, bytes)], main, class, message_contains: words.to_vec() }
}

/// One white triangle, changed.
fn triangle(name: &'static str, class: Class, words: &[&'static str], change: impl FnOnce(&mut Builder)) -> Case {
    let mut b = Builder::triangle();
    change(&mut b);
    bytes(name, b.gltf(), class, words)
}

fn containers() -> Vec<Case> {
    let good = Builder::triangle().glb(&[]);
    let cut = |n: usize| good[..n].to_vec();
    let patched = |at: usize, with: &[u8]| {
        let mut glb = good.clone();
        glb[at..at + with.len()].copy_from_slice(with);
        glb
    };
    let deep = |open: &str| {
        format!("{{\"asset\": {{\"version\": \"2.0\"}}, \"extras\": {}", open.repeat(200_000)).into_bytes()
    };
    let typed_deep = |open: &str| format!("{{\"nodes\": {}", open.repeat(200_000)).into_bytes();
    vec![
        Case {
            name: "missing file",
            files: vec![],
            main: "nowhere.gltf",
            class: Class::Io,
            message_contains: vec!["nowhere.gltf"],
        },
        bytes("empty file", vec![], Invalid, &["empty"]),
        bytes("only white space", b" \n ".to_vec(), Invalid, &["empty"]),
        bytes("random bytes", vec![0xff, 0x00, 0xd8, 0x80, 0x13], Invalid, &["not glTF"]),
        bytes("an OBJ file", b"v 0 0 0\nv 1 0 0\n".to_vec(), Invalid, &["not valid glTF"]),
        bytes("JSON cut off", Builder::triangle().gltf()[..100].to_vec(), Invalid, &["not valid glTF", "line 1"]),
        bytes("JSON that is an array", b"[]".to_vec(), Invalid, &["asset"]),
        bytes(
            "JSON of the wrong types",
            br#"{"asset": {"version": "2.0"}, "nodes": 5}"#.to_vec(),
            Invalid,
            &["not valid glTF", "line 1 column 40"],
        ),
        bytes(
            "an index that is a fraction",
            br#"{"asset": {"version": "2.0"}, "scene": 0.5}"#.to_vec(),
            Invalid,
            &["0.5"],
        ),
        bytes("a negative index", br#"{"asset": {"version": "2.0"}, "scene": -1}"#.to_vec(), Invalid, &["-1"]),
        bytes("endless arrays", deep("["), Invalid, &["nested deeper"]),
        bytes("endless objects", typed_deep("[{\"a\":"), Invalid, &["nested deeper"]),
        bytes("GLB header alone", cut(12), Invalid, &["truncated"]),
        bytes("GLB header cut", cut(7), Invalid, &["truncated"]),
        bytes("GLB cut in the JSON", cut(60), Invalid, &["truncated"]),
        bytes("GLB cut in the last byte", cut(good.len() - 1), Invalid, &["truncated"]),
        bytes("GLB version 1", patched(4, &[1]), Unsupported, &["GLB version 1"]),
        bytes("GLB chunk of 4 GB", patched(12, &[0xff; 4]), Invalid, &["chunk 0", "4294967295"]),
        bytes("GLB that starts with BIN", patched(16, b"BIN\0"), Invalid, &["first GLB chunk"]),
        bytes("GLB without chunks", glb(b"{}", None, &[])[..12].to_vec(), Invalid, &["truncated"]),
        bytes("GLB of no length", patched(8, &[12, 0, 0, 0]), Invalid, &["no JSON chunk"]),
    ]
}

fn versions_and_extensions() -> Vec<Case> {
    let require = |name: &'static str| move |b: &mut Builder| b.json["extensionsRequired"] = json!([name]);
    vec![
        triangle("no asset", Invalid, &["asset"], |b| {
            b.json.as_object_mut().unwrap().remove("asset");
        }),
        triangle("glTF 1.0", Unsupported, &["1.0"], |b| b.json["asset"]["version"] = json!("1.0")),
        triangle("a future minVersion", Unsupported, &["2.7"], |b| {
            b.json["asset"] = json!({"version": "2.9", "minVersion": "2.7"});
        }),
        triangle("unknown required extension", Unsupported, &["ACME_quantum_mesh"], require("ACME_quantum_mesh")),
        triangle("required AVIF", Unsupported, &["EXT_texture_avif", "PNG"], require("EXT_texture_avif")),
        triangle("Draco without bytes", Invalid, &["mesh 0, primitive 0", "no buffer view"], |b| {
            b.json["extensionsUsed"] = json!(["KHR_draco_mesh_compression"]);
            b.json["accessors"][0].as_object_mut().unwrap().remove("bufferView");
            b.set("/meshes/0/primitives/0/extensions", json!({"KHR_draco_mesh_compression": {}}));
        }),
        triangle("a plain view of a meshopt fallback", Invalid, &["buffer view 0", "beyond buffer 1"], |b| {
            b.push("buffers", json!({"byteLength": 36, "extensions": {"EXT_meshopt_compression": {"fallback": true}}}));
            b.set("/bufferViews/0/buffer", json!(1));
        }),
    ]
}

fn buffers() -> Vec<Case> {
    let uri = |uri: &'static str| move |b: &mut Builder| b.json["buffers"][0]["uri"] = json!(uri);
    let mut short_file = triangle("buffer file too short", Invalid, &["buffer 0", "36", "10"], uri("a.bin"));
    short_file.files.push(("a.bin", vec![0; 10]));
    let mut folder = triangle("buffer is a folder", Class::Io, &["not a regular file", "buffer 0"], uri("."));
    folder.files.push(("b.bin", vec![]));
    vec![
        short_file,
        folder,
        triangle("missing buffer file", Invalid, &["buffer 0", "gone.bin"], uri("gone.bin")),
        triangle("buffer at an absolute path", Invalid, &["buffer 0", "absolute"], uri("/etc/passwd")),
        triangle("buffer at an encoded absolute path", Invalid, &["absolute"], uri("%2fetc%2fpasswd")),
        triangle("buffer in the web", Invalid, &["buffer 0", "https"], uri("https://example.org/a.bin")),
        triangle("buffer by file scheme", Invalid, &["buffer 0", "absolute"], uri("file:///etc/passwd")),
        triangle("broken base64", Invalid, &["buffer 0", "base64"], uri("data:;base64,@@@@")),
        triangle("data URI too short", Invalid, &["buffer 0", "has 3"], uri("data:;base64,AAAA")),
        triangle("buffer of 10^18 bytes", Invalid, &["buffer 0", "1000000000000000000"], |b| {
            b.json["buffers"][0]["byteLength"] = json!(1_000_000_000_000_000_000u64);
        }),
        bytes(
            "buffer without URI outside a GLB",
            br#"{"asset": {"version": "2.0"}, "buffers": [{"byteLength": 4}]}"#.to_vec(),
            Invalid,
            &["buffer 0", "neither"],
        ),
    ]
}

fn accessors() -> Vec<Case> {
    let set = |pointer: &'static str, value: serde_json::Value| {
        move |b: &mut Builder| {
            b.set(pointer, value);
        }
    };
    let place = "mesh 0, primitive 0";
    vec![
        triangle(
            "count of 10^9",
            Invalid,
            &[place, "1000000000 elements"],
            set("/accessors/0/count", json!(1_000_000_000)),
        ),
        triangle("count of 2^64 - 1", Invalid, &[place, "beyond"], set("/accessors/0/count", json!(u64::MAX))),
        triangle("offset of 2^64 - 1", Invalid, &[place, "beyond"], set("/accessors/0/byteOffset", json!(u64::MAX))),
        triangle(
            "view beyond its buffer",
            Invalid,
            &["buffer view 0", "beyond"],
            set("/bufferViews/0/byteLength", json!(37)),
        ),
        triangle(
            "view offset overflow",
            Invalid,
            &["buffer view 0"],
            set("/bufferViews/0/byteOffset", json!(u64::MAX)),
        ),
        triangle("view of a missing buffer", Invalid, &["buffer"], set("/bufferViews/0/buffer", json!(9))),
        triangle("accessor of a missing view", Invalid, &["buffer view 7"], set("/accessors/0/bufferView", json!(7))),
        triangle(
            "missing accessor",
            Invalid,
            &[place, "accessor 5"],
            set("/meshes/0/primitives/0/attributes/POSITION", json!(5)),
        ),
        triangle("stride below the element", Invalid, &["stride of 4"], set("/bufferViews/0/byteStride", json!(4))),
        triangle("stride of zero", Invalid, &["stride of 0"], set("/bufferViews/0/byteStride", json!(0))),
        triangle(
            "component type that does not exist",
            Invalid,
            &["5124"],
            set("/accessors/0/componentType", json!(5124)),
        ),
        triangle("accessor type that does not exist", Invalid, &["VEC9"], set("/accessors/0/type", json!("VEC9"))),
        triangle(
            "positions with two components",
            Invalid,
            &[place, "2 components"],
            set("/accessors/0/type", json!("VEC2")),
        ),
        triangle(
            "positions as 32-bit integers",
            Invalid,
            &[place, "32-bit"],
            set("/accessors/0/componentType", json!(5125)),
        ),
        triangle("attribute of another length", Invalid, &[place, "NORMAL", "2 elements"], |b| {
            let normal = b.floats("VEC3", &[0.0; 6]);
            b.set("/meshes/0/primitives/0/attributes/NORMAL", json!(normal));
        }),
    ]
}

fn sparse() -> Vec<Case> {
    let sparse = |index: u8| {
        move |b: &mut Builder| {
            let indices = b.view(&[index], json!({}));
            let values = b.view(&[0; 12], json!({}));
            b.json["accessors"][0]["sparse"] = json!({"count": 1,
                "indices": {"bufferView": indices, "componentType": 5121}, "values": {"bufferView": values}});
        }
    };
    vec![
        triangle("10^9 zeros without a view", Unsupported, &["1000000000"], |b| {
            b.json["accessors"][0] = json!({"componentType": 5126, "count": 1_000_000_000, "type": "VEC3"});
            sparse(0)(b);
        }),
        triangle("sparse index out of range", Invalid, &["sparse index 3"], sparse(3)),
        triangle("more sparse elements than elements", Invalid, &["sparse"], |b| {
            sparse(0)(b);
            b.set("/accessors/0/sparse/count", json!(1_000_000_000));
        }),
        triangle("sparse values missing", Invalid, &["no buffer view"], |b| {
            sparse(0)(b);
            b.set("/accessors/0/sparse/values", json!({}));
        }),
    ]
}

fn geometry() -> Vec<Case> {
    let place = "mesh 0, primitive 0";
    let indices = |values: &'static [u16]| {
        move |b: &mut Builder| {
            let accessor = b.accessor(5123, "SCALAR", values.len(), &words(values), json!({}));
            b.set("/meshes/0/primitives/0/indices", json!(accessor));
        }
    };
    let position =
        |at: usize, value: f32| move |b: &mut Builder| b.bin[at * 4..at * 4 + 4].copy_from_slice(&value.to_le_bytes());
    vec![
        triangle("index out of range", Invalid, &[place, "index 2 is 3"], indices(&[0, 1, 3])),
        triangle("primitive restart index", Invalid, &[place, "65535"], indices(&[0, 1, 2, 65535])),
        triangle("indices as floats", Invalid, &[place, "indices"], |b| {
            b.set("/meshes/0/primitives/0/indices", json!(0));
        }),
        triangle("NaN position", Invalid, &[place, "vertex 1", "not finite"], position(3, f32::NAN)),
        triangle("infinite position", Invalid, &[place, "vertex 2"], position(7, f32::INFINITY)),
        triangle("position beyond the limit", Invalid, &[place, "vertex 1", "limit"], position(3, 2e7)),
        triangle("placed beyond the limit", Invalid, &[place, "node 0", "limit"], |b| {
            b.json["nodes"][0]["scale"] = json!([1e9, 1, 1]);
        }),
        triangle(
            "beyond the limit of the document, not of what is moved",
            Invalid,
            &[place, "vertex 1", "limit"],
            |b| {
                b.json["nodes"][0]["translation"] = json!([6e6, 0, 0]);
                position(3, 6e6)(b);
            },
        ),
        triangle("mode 7", Invalid, &[place, "mode 7"], |b| {
            b.set("/meshes/0/primitives/0/mode", json!(7));
        }),
        triangle("only lines", Invalid, &["nothing to bake"], |b| {
            b.set("/meshes/0/primitives/0/mode", json!(1));
        }),
        triangle("no mesh in the scene", Invalid, &["nothing to bake"], |b| b.json["nodes"][0] = json!({})),
        triangle("hidden mesh", Invalid, &["nothing to bake"], |b| {
            b.json["nodes"][0]["extensions"] = json!({"KHR_node_visibility": {"visible": false}});
        }),
        triangle("primitive without positions", Invalid, &["nothing to bake"], |b| {
            b.set("/meshes/0/primitives/0/attributes", json!({}));
        }),
        bytes("empty document", br#"{"asset": {"version": "2.0"}}"#.to_vec(), Invalid, &["nothing to bake"]),
        triangle("one mesh from very many nodes", Unsupported, &["vertices or triangles"], |b| {
            // 4,000 vertices × 40,000 nodes: a megabyte of JSON that asks for ten gigabytes.
            let accessor = b.floats("VEC3", &vec![0.0; 12_000]);
            b.set("/meshes/0/primitives/0/attributes/POSITION", json!(accessor));
            b.json["nodes"] = json!(vec![json!({"mesh": 0}); 40_000]);
        }),
        triangle("skin that does not exist", Invalid, &["skin 4"], |b| b.json["nodes"][0]["skin"] = json!(4)),
    ]
}

fn trees() -> Vec<Case> {
    let nodes = |nodes: serde_json::Value| move |b: &mut Builder| b.json["nodes"] = nodes;
    vec![
        triangle(
            "node that is its own child",
            Invalid,
            &["node 0", "cycle"],
            nodes(json!([{"mesh": 0, "children": [0]}])),
        ),
        triangle(
            "cycle of two",
            Invalid,
            &["cycle"],
            nodes(json!([{"mesh": 0}, {"children": [2]}, {"children": [1]}])),
        ),
        triangle(
            "two parents",
            Invalid,
            &["node 2", "child of both"],
            nodes(json!([{"children": [2]}, {"children": [2]}, {"mesh": 0}])),
        ),
        triangle("missing child", Invalid, &["node 9"], nodes(json!([{"children": [9]}]))),
        triangle("missing mesh", Invalid, &["mesh 3"], nodes(json!([{"mesh": 3}]))),
        triangle("missing root", Invalid, &["scene 0", "node 5"], |b| b.json["scenes"] = json!([{"nodes": [5]}])),
        triangle("root listed twice", Invalid, &["twice"], |b| b.json["scenes"] = json!([{"nodes": [0, 0]}])),
        triangle("missing scene", Invalid, &["scene 8"], |b| b.json["scene"] = json!(8)),
        triangle("matrix with perspective", Invalid, &["node 0", "affine"], |b| {
            b.json["nodes"][0]["matrix"] = json!([1, 0, 0, 1, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]);
        }),
        triangle("zero quaternion", Invalid, &["node 0", "rotation"], |b| {
            b.json["nodes"][0]["rotation"] = json!([0, 0, 0, 0]);
        }),
        triangle("transforms that overflow", Invalid, &["not finite"], |b| {
            let scale = json!([1e200, 1e200, 1e200]);
            b.json["nodes"] = json!([{"scale": scale, "children": [1]}, {"scale": scale, "mesh": 0}]);
        }),
        triangle("a name of a megabyte with line ends", Invalid, &["mesh 3"], |b| {
            b.json["nodes"][0] = json!({"mesh": 3, "name": format!("a\n\u{1b}[31m{}", "x".repeat(1 << 20))});
        }),
        triangle("missing light", Invalid, &["node 0", "light"], |b| {
            b.json["nodes"][0]["extensions"] = json!({"KHR_lights_punctual": {"light": 2}});
        }),
    ]
}

fn instances() -> Vec<Case> {
    let instanced = |attributes: fn(&mut Builder) -> serde_json::Value| {
        move |b: &mut Builder| {
            let attributes = attributes(b);
            b.json["nodes"][0]["name"] = json!("Trees");
            b.json["nodes"][0]["extensions"] = json!({"EXT_mesh_gpu_instancing": {"attributes": attributes}});
        }
    };
    let zeros = |count: usize| json!({"componentType": 5126, "count": count, "type": "VEC3"});
    let all = ["Trees", "EXT_mesh_gpu_instancing"];
    let words = |more: &'static str| [all[0], all[1], more];
    vec![
        triangle("instances that disagree", Invalid, &words("TRANSLATION has 3 elements, but SCALE has 2"), {
            instanced(|b| json!({"TRANSLATION": b.floats("VEC3", &[0.0; 9]), "SCALE": b.floats("VEC3", &[1.0; 6])}))
        }),
        triangle("instances without an accessor", Invalid, &words("accessor 77 does not exist"), {
            instanced(|_| json!({"TRANSLATION": 77}))
        }),
        triangle("instances moved by pairs", Invalid, &words("TRANSLATION: elements have 2 components"), {
            instanced(|b| json!({"TRANSLATION": b.floats("VEC2", &[0.0; 4])}))
        }),
        triangle("an instance that is nowhere", Invalid, &words("TRANSLATION: element 1 is not finite"), {
            instanced(|b| json!({"TRANSLATION": b.floats("VEC3", &[0.0, 0.0, 0.0, 0.0, f32::NAN, 0.0])}))
        }),
        triangle(
            "an instance that is turned by nothing",
            Invalid,
            &words("ROTATION: element 0 is not a quaternion"),
            instanced(|b| json!({"ROTATION": b.floats("VEC4", &[0.0; 4])})),
        ),
        triangle("a million instances of nothing", Unsupported, &words("more than 262144 instances"), move |b| {
            let accessor = b.push("accessors", zeros(1 << 20));
            b.json["nodes"][0]["name"] = json!("Trees");
            let attributes = json!({"TRANSLATION": accessor});
            b.json["nodes"][0]["extensions"] = json!({"EXT_mesh_gpu_instancing": {"attributes": attributes}});
        }),
        triangle(
            "more triangles than fit, by instances",
            Unsupported,
            &["Trees.", "all instances", "pieces"],
            move |b| {
                let indices = b.accessor(5121, "SCALAR", 3000, &[0, 1, 2].repeat(1000), json!({}));
                b.json["meshes"][0]["primitives"][0]["indices"] = json!(indices);
                let accessor = b.push("accessors", zeros(200_000));
                b.json["nodes"][0]["name"] = json!("Trees");
                let attributes = json!({"TRANSLATION": accessor});
                b.json["nodes"][0]["extensions"] = json!({"EXT_mesh_gpu_instancing": {"attributes": attributes}});
            },
        ),
    ]
}

fn materials() -> Vec<Case> {
    let material = |material: serde_json::Value| {
        move |b: &mut Builder| {
            b.push("materials", material);
            b.set("/meshes/0/primitives/0/material", json!(0));
        }
    };
    let color = |index: u64| json!({"name": "Wood", "pbrMetallicRoughness": {"baseColorTexture": {"index": index}}});
    vec![
        triangle("missing material", Invalid, &["mesh 0, primitive 0", "material 4"], |b| {
            b.set("/meshes/0/primitives/0/material", json!(4));
        }),
        triangle("missing texture", Invalid, &["Wood", "texture 3"], material(color(3))),
        triangle(
            "negative emission",
            Invalid,
            &["Lamp", "emission"],
            material(json!({"name": "Lamp", "emissiveFactor": [-1, 0, 0]})),
        ),
        triangle("TEXCOORD_99", Unsupported, &["TEXCOORD_99"], |b| {
            b.push("textures", json!({"source": 0}));
            let info = json!({"index": 0, "texCoord": 99});
            material(json!({"pbrMetallicRoughness": {"baseColorTexture": info}}))(b);
        }),
        triangle("DDS that is not there", Invalid, &["image 0", "Wood", "does not exist"], |b| {
            b.push("textures", json!({"extensions": {"MSFT_texture_dds": {"source": 0}}}));
            material(color(0))(b);
        }),
        triangle("texture without an image", Invalid, &["Wood", "no image"], |b| {
            b.push("textures", json!({}));
            material(color(0))(b);
        }),
        triangle("missing sampler", Invalid, &["sampler 6"], |b| {
            b.texture(1, &[[255; 4]]);
            b.set("/textures/0/sampler", json!(6));
            material(color(0))(b);
        }),
    ]
}

fn images() -> Vec<Case> {
    let image = |image: serde_json::Value| {
        move |b: &mut Builder| {
            b.push("images", image);
            b.push("textures", json!({"source": 0}));
            b.push("materials", json!({"name": "Wood", "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}));
            b.set("/meshes/0/primitives/0/material", json!(0));
        }
    };
    let data = |bytes: &[u8]| image(json!({"uri": data_uri("image/png", bytes)}));
    let good = png(2, &[[1, 2, 3, 255]; 4]);
    // The size stands at byte 16 of a PNG, behind it the checksum of the chunk.
    let resized = |width: u32, height: u32| {
        let mut png = good.clone();
        png[16..20].copy_from_slice(&width.to_be_bytes());
        png[20..24].copy_from_slice(&height.to_be_bytes());
        let crc = crc32(&png[12..29]);
        png[29..33].copy_from_slice(&crc.to_be_bytes());
        png
    };
    vec![
        triangle("missing image file", Invalid, &["gone.png", "Wood"], image(json!({"uri": "gone.png"}))),
        triangle("missing image", Invalid, &["image 0", "Wood"], |b| {
            image(json!({}))(b);
            b.json.as_object_mut().unwrap().remove("images");
        }),
        triangle("image without bytes", Invalid, &["image 0", "Wood", "neither"], image(json!({"name": "x"}))),
        triangle("image at an absolute path", Invalid, &["image 0", "absolute"], image(json!({"uri": "/etc/passwd"}))),
        triangle("image that is text", Invalid, &["image 0", "Wood", "neither PNG"], data(b"hello, I am not an image")),
        triangle("PNG cut off", Invalid, &["image 0", "Wood", "decoded"], data(&good[..good.len() - 20])),
        triangle("PNG of 10^9 × 10^9", Unsupported, &["image 0", "Wood"], data(&resized(1_000_000_000, 1_000_000_000))),
        triangle("PNG of 20000 × 20000", Unsupported, &["image 0", "Wood", "20000"], data(&resized(20_000, 20_000))),
        triangle(
            "PNG that claims a gigabyte",
            Invalid,
            &["image 0", "claims 16384 × 16384"],
            data(&resized(16_384, 16_384)),
        ),
        triangle("JPEG of a header alone", Invalid, &["image 0", "Wood"], data(&[0xff, 0xd8, 0xff, 0xe0, 0, 16])),
    ]
}

/// References that lead out of the document's folder, or nowhere.
fn names() -> Vec<Case> {
    let uri = |uri: String| move |b: &mut Builder| b.json["buffers"][0]["uri"] = json!(uri);
    let image = |uri: &'static str| {
        move |b: &mut Builder| {
            b.push("images", json!({"uri": uri}));
            b.push("textures", json!({"source": 0}));
            b.push("materials", json!({"name": "Wood", "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}));
            b.set("/meshes/0/primitives/0/material", json!(0));
        }
    };
    vec![
        triangle("far above the root", Invalid, &["buffer 0"], uri("../".repeat(99) + "gone/a.bin")),
        triangle("a path with a NUL", Invalid, &["buffer 0", "absolute"], uri("a%00.bin".to_owned())),
        triangle("a drive of Windows", Invalid, &["buffer 0", "absolute"], uri("C:\\a.bin".to_owned())),
        triangle("a share of Windows", Invalid, &["buffer 0", "absolute"], uri("\\\\server\\a.bin".to_owned())),
        triangle("a URI of a megabyte", Invalid, &["buffer 0", "1048576 bytes"], uri("a".repeat(1 << 20))),
        triangle("a URI that is empty", Invalid, &["buffer 0", "empty"], uri(String::new())),
        triangle("a data URI without a comma", Invalid, &["buffer 0", "comma"], uri("data:".to_owned())),
        triangle(
            "an image far above the root",
            Invalid,
            &["image 0", "Wood"],
            image("../../../../../../../../gone.png"),
        ),
        triangle("an image by script", Invalid, &["image 0", "absolute"], image("javascript:alert(1)")),
        triangle("an image that is its document", Invalid, &["image 0", "neither PNG"], image("a.gltf")),
    ]
}

/// Text that some readers accept.
fn spellings() -> Vec<Case> {
    let text = |text: &str| format!("{{\"asset\": {{\"version\": \"2.0\"}}, {text}}}").into_bytes();
    let refused = |name, text: Vec<u8>, words| bytes(name, text, Invalid, words);
    vec![
        refused("a number beyond all", text("\"scene\": 1e999"), &["not valid glTF"]),
        refused("NaN", text("\"scene\": NaN"), &["not valid glTF"]),
        refused("half of a letter", text("\"extensionsUsed\": [\"\\ud800\"]"), &["not valid glTF"]),
        refused("a comma too many", text("\"nodes\": [],"), &["not valid glTF"]),
        refused("a comment", text("// nodes\n\"nodes\": []"), &["not valid glTF"]),
        refused("a list twice", text("\"nodes\": [], \"nodes\": []"), &["duplicate"]),
        refused("two documents", b"{\"asset\": {\"version\": \"2.0\"}} {}".to_vec(), &["not valid glTF"]),
        refused("UTF-16", "{\"asset\": 1}".encode_utf16().flat_map(u16::to_le_bytes).collect(), &["glTF"]),
        triangle("8,192 textures that are missing", Invalid, &["texture"], |b| {
            b.json["materials"] =
                (0..8192).map(|k| json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": k + 9}}})).collect();
            b.set("/meshes/0/primitives/0/material", json!(8191));
        }),
    ]
}

/// CRC-32 as PNG uses it (ISO 3309), bit by bit.
fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0u32, |crc, &byte| {
        (0..8).fold(crc ^ u32::from(byte), |c, _| if c & 1 == 1 { c >> 1 ^ 0xedb8_8320 } else { c >> 1 })
    })
}
