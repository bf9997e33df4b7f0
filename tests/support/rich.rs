//! A document that uses everything the reader knows, for tests that change it. Needs `gltf_builder` at the root of the test
//! program.

use crate::gltf_builder::Builder;
use serde_json::json;

/// The document.
pub(crate) fn document() -> Builder {
    let info = |set: u32| {
        json!({"index": 0, "texCoord": set,
               "extensions": {"KHR_texture_transform": {"offset": [0, 1], "rotation": 1, "scale": [2, 2], "texCoord": 0}}})
    };
    let mut b = Builder::square(json!({
        "pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 1], "baseColorTexture": info(0),
                                 "metallicFactor": 1, "metallicRoughnessTexture": info(1)},
        "emissiveFactor": [1, 1, 1], "emissiveTexture": info(0), "alphaMode": "MASK", "alphaCutoff": 0.5,
        "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 2}}
    }));
    b.texture(2, &[[9, 8, 7, 6]; 4]);
    b.push("samplers", json!({"magFilter": 9728, "wrapS": 33648, "wrapT": 33071}));
    b.set("/textures/0/sampler", json!(0));
    let indices = b.view(&[0, 2], json!({}));
    let values = b.view(&[0; 24], json!({}));
    let sparse = json!({"count": 2, "indices": {"bufferView": indices, "byteOffset": 0, "componentType": 5121},
                        "values": {"bufferView": values, "byteOffset": 0}});
    b.set("/accessors/0/sparse", sparse);
    b.set("/accessors/0/byteOffset", json!(0));
    b.set("/bufferViews/0/byteStride", json!(12));
    let joints = b.accessor(5121, "VEC4", 4, &[0; 16], json!({}));
    let weights = b.floats("VEC4", &[1., 0., 0., 0.].repeat(4));
    let binds = b.floats("MAT4", &glam::Mat4::IDENTITY.to_cols_array());
    b.set("/meshes/0/primitives/0/attributes/JOINTS_0", json!(joints));
    b.set("/meshes/0/primitives/0/attributes/WEIGHTS_0", json!(weights));
    b.set("/meshes/0/primitives/0/attributes/COLOR_0", json!(weights));
    b.set("/meshes/0/primitives/0/targets", json!([{"POSITION": 0}]));
    b.set("/meshes/0/primitives/0/mode", json!(4));
    b.set("/meshes/0/weights", json!([0.5]));
    b.push("skins", json!({"joints": [1], "inverseBindMatrices": binds}));
    b.set("/nodes/0/skin", json!(0));
    b.push(
        "nodes",
        json!({"translation": [1, 2, 3], "rotation": [0, 0, 0, 1], "scale": [1, 2, 3], "children": [2, 3]}),
    );
    b.push("nodes", json!({"matrix": glam::Mat4::IDENTITY.to_cols_array(), "camera": 0, "mesh": 0, "weights": [1]}));
    b.push(
        "nodes",
        json!({"extensions": {"KHR_lights_punctual": {"light": 0}, "KHR_node_visibility": {"visible": true}}}),
    );
    b.push("cameras", json!({"perspective": {"yfov": 1, "aspectRatio": 1}}));
    b.push("scenes", json!({"nodes": [0, 1]}));
    b.push("animations", json!({"channels": [{"target": {"node": 1, "path": "scale"}}]}));
    let wishes = json!({"texelwalk": {"density": 2, "receives": true, "casts": 1, "emission": 2, "light_group": "a"}});
    for at in ["/nodes/0", "/meshes/0", "/materials/0"] {
        b.set(&format!("{at}/extras"), wishes.clone());
    }
    b.json["scene"] = json!(0);
    b.json["extensions"] = json!({"KHR_lights_punctual": {"lights": [
        {"type": "spot", "color": [1, 1, 1], "intensity": 5, "range": 9, "extras": {"radius": 0.1, "angle": 0.1, "texelwalk": {"intensity": 2}},
         "spot": {"innerConeAngle": 0.1, "outerConeAngle": 0.2}}]}});
    b
}
