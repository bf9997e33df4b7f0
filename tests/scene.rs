//! Loading: small documents whose scenes are known exactly.

#[path = "support/gltf_builder.rs"]
mod builder;

use builder::Builder;
use builder::data_uri;
use builder::png;
use builder::words;
use glam::Vec2;
use glam::Vec3;
use glam::Vec4;
use serde_json::Value;
use serde_json::json;
use std::path::Path;
use texelwalk::base::Warned;
use texelwalk::scene;
use texelwalk::scene::Alpha;
use texelwalk::scene::Light;
use texelwalk::scene::Projection;
use texelwalk::scene::Scene;
use texelwalk::scene::Settings;

const NONE: Settings = Settings {
    scene: None,
    sky: scene::Sky { zenith: Vec3::ZERO, horizon: Vec3::ZERO, ground: Vec3::ZERO },
    sun_angle: None,
};

fn load_with(b: &Builder, settings: &Settings) -> Warned<Scene> {
    let gltf = scene::load_bytes(b.gltf(), Path::new("a.gltf"), settings).unwrap();
    let glb = scene::load_bytes(b.glb(&[]), Path::new("a.glb"), settings).unwrap();
    assert_eq!(gltf.output.vertices.position, glb.output.vertices.position, "both containers hold the same scene");
    assert_eq!(gltf.output.triangles, glb.output.triangles);
    check(&glb.output);
    glb
}

/// Loads a document that must give no warnings.
fn load(b: &Builder) -> Scene {
    let loaded = load_with(b, &NONE);
    assert_eq!(loaded.warnings, []);
    loaded.output
}

fn codes(b: &Builder) -> Vec<&'static str> {
    load_with(b, &NONE).warnings.iter().map(|w| w.code).collect()
}

/// The invariants that every scene keeps.
fn check(scene: &Scene) {
    let v = &scene.vertices;
    let count = v.position.len();
    assert!(v.normal.len() == count && v.color.len() == count && v.uv.len() >= 2);
    assert!(v.uv.iter().all(|set| set.len() == count && set.iter().all(|uv| uv.is_finite())));
    assert!(v.normal.iter().all(|n| (n.length() - 1.0).abs() < 1e-5));
    assert!(v.position.iter().all(|p| p.is_finite()));
    assert_eq!(scene.triangles.len(), scene.triangle_part.len());
    assert_eq!(scene.materials.len(), scene.document.root.materials.len() + 1);
    assert_eq!(scene.textures.len(), scene.document.root.textures.len());
    let (mut vertex, mut triangle) = (0, 0);
    for (index, part) in scene.parts.iter().enumerate() {
        assert_eq!((part.vertices.start, part.triangles.start), (vertex, triangle));
        (vertex, triangle) = (part.vertices.end, part.triangles.end);
        for t in part.triangles.clone() {
            assert_eq!(scene.triangle_part[t as usize] as usize, index);
            assert!(scene.triangles[t as usize].iter().all(|v| part.vertices.contains(v)));
        }
        assert!(part.material < scene.materials.len());
    }
    assert_eq!((vertex as usize, triangle as usize), (count, scene.triangles.len()));
}

fn near(a: Vec3, b: Vec3) -> bool {
    (a - b).length() < 1e-5
}

#[test]
fn mirrored_instances_keep_their_front() {
    let mut b = Builder::triangle();
    b.push("nodes", json!({"mesh": 0, "scale": [-1, 1, 1]}));
    b.push("nodes", json!({"mesh": 0, "scale": [-1, -1, 1]}));
    b.push("nodes", json!({"matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, -1, 0, 5, 0, 0, 1], "children": [4]}));
    b.push("nodes", json!({"mesh": 0}));
    let scene = load(&b);
    let mirrored: Vec<bool> = scene.parts.iter().map(|p| p.mirrored).collect();
    assert_eq!(mirrored, [false, true, false, true]);
    assert_eq!(scene.triangles[0], [0, 1, 2]);
    assert_eq!(scene.triangles[1], [3, 5, 4]);
    // The front of the triangle looks along +z of its node; mirroring z turns it over, mirroring x does not.
    let fronts: Vec<Vec3> = (0..4).map(|t| scene.geometric_normal(t)).collect();
    assert_eq!(fronts, [Vec3::Z, Vec3::Z, Vec3::Z, Vec3::NEG_Z]);
}

#[test]
fn normals_stay_perpendicular_under_uneven_and_mirrored_scale() {
    let mut b = Builder::triangle();
    // The plane x + y + z = 1, whose normal is (1, 1, 1)/√3; stored three times too long.
    let position = b.floats("VEC3", &[1., 0., 0., 0., 1., 0., 0., 0., 1.]);
    let normal = b.floats("VEC3", &[1.7; 9]);
    b.set("/meshes/0/primitives/0/attributes", json!({"POSITION": position, "NORMAL": normal}));
    b.json["nodes"] = json!([
        {"mesh": 0, "scale": [2, 3, 0.5]},
        {"mesh": 0, "scale": [-2, 3, 0.5], "rotation": [0.5, 0.5, 0.5, 0.5]},
        {"mesh": 0, "scale": [1, 1, 0]},
        {"mesh": 0, "scale": [1e-12, 2e-12, 1e-12]},
    ]);
    let scene = load(&b);
    for t in 0..4u32 {
        let geometric = scene.geometric_normal(t);
        assert!(!scene.parts[t as usize].flat);
        for v in scene.triangles[t as usize] {
            let n = scene.vertices.normal[v as usize];
            assert!(near(n, geometric), "triangle {t}: {n} {geometric}");
        }
    }
    let expected = Vec3::new(1.0 / 2.0, 1.0 / 3.0, 2.0).normalize();
    assert!(near(scene.vertices.normal[0], expected));
}

#[test]
fn missing_normals_are_flat_and_still_exist() {
    let scene = load(&Builder::triangle());
    assert!(scene.parts[0].flat);
    assert_eq!(scene.vertices.normal, [Vec3::Z; 3]);
    assert_eq!(scene.shading_normal(0, Vec2::splat(0.3)), Vec3::Z);
}

#[test]
fn bad_normals_and_texture_coordinates_are_replaced() {
    let mut b = Builder::triangle();
    let normal = b.floats("VEC3", &[0., 0., 0., f32::NAN, 0., 1., 0., 0., 1e30]);
    let uv = b.floats("VEC2", &[0., 1., f32::INFINITY, 0., 0.5, 0.5]);
    let color = b.floats("VEC3", &[0.5, 0.5, 0.5, -1., 0., 0., 1., 1., f32::NAN]);
    b.set(
        "/meshes/0/primitives/0/attributes",
        json!({"POSITION": 0, "NORMAL": normal, "TEXCOORD_0": uv, "COLOR_0": color}),
    );
    let loaded = load_with(&b, &NONE);
    let codes: Vec<_> = loaded.warnings.iter().map(|w| w.code).collect();
    assert_eq!(codes, ["bad-texcoord", "bad-color", "bad-normals"]);
    assert_eq!(loaded.warnings[2].node.as_deref(), Some("node 0"));
    let v = &loaded.output.vertices;
    assert_eq!(v.normal, [Vec3::Z; 3]);
    assert_eq!(v.uv[0], [Vec2::new(0., 1.), Vec2::ZERO, Vec2::splat(0.5)]);
    assert_eq!(v.color, [Vec4::new(0.5, 0.5, 0.5, 1.0), Vec4::ONE, Vec4::ONE]);
}

/// A zigzag of six vertices around the x axis: as a strip, all its triangles face +z.
fn zigzag(mode: u32, indices: Option<(u32, &[u16])>) -> Builder {
    let mut b = Builder::triangle();
    let position = b.floats("VEC3", &[0., 0., 0., 0., -1., 0., 1., 0., 0., 1., -1., 0., 2., 0., 0., 2., -1., 0.]);
    b.set("/meshes/0/primitives/0", json!({"attributes": {"POSITION": position}, "mode": mode}));
    if let Some((component, values)) = indices {
        let bytes = match component {
            5121 => values.iter().map(|&v| v as u8).collect(),
            5123 => words(values),
            _ => values.iter().flat_map(|&v| u32::from(v).to_le_bytes()).collect(),
        };
        let accessor = b.accessor(component, "SCALAR", values.len(), &bytes, json!({}));
        b.set("/meshes/0/primitives/0/indices", json!(accessor));
    }
    b
}

#[test]
fn indices_of_every_width_and_none() {
    for component in [5121, 5123, 5125] {
        let scene = load(&zigzag(4, Some((component, &[0, 1, 2, 2, 1, 3]))));
        assert_eq!(scene.triangles, [[0, 1, 2], [2, 1, 3]], "component type {component}");
        assert_eq!(scene.vertices.position.len(), 6, "vertices that no index uses stay");
    }
    assert_eq!(load(&zigzag(4, None)).triangles, [[0, 1, 2], [3, 4, 5]]);
}

#[test]
fn strips_and_fans_follow_the_specification() {
    let strip = load(&zigzag(5, None));
    assert_eq!(strip.triangles, [[0, 1, 2], [1, 3, 2], [2, 3, 4], [3, 5, 4]]);
    assert!((0..4).all(|t| strip.geometric_normal(t) == Vec3::Z));
    let fan = load(&zigzag(6, Some((5123, &[0, 1, 3, 2]))));
    assert_eq!(fan.triangles, [[1, 3, 0], [3, 2, 0]]);
    assert!((0..2).all(|t| fan.geometric_normal(t) == Vec3::Z));
    let indexed = load(&zigzag(5, Some((5121, &[4, 2, 5, 3]))));
    assert_eq!(indexed.triangles, [[4, 2, 5], [2, 3, 5]]);
}

#[test]
fn degenerate_triangles_stay_and_leftovers_are_reported() {
    let scene = load(&zigzag(4, Some((5123, &[0, 0, 1, 0, 2, 4, 0, 1, 2]))));
    assert_eq!(scene.triangles, [[0, 0, 1], [0, 2, 4], [0, 1, 2]]);
    assert_eq!(codes(&zigzag(4, Some((5123, &[0, 1, 2, 3])))), ["incomplete-triangle"]);
    let mut b = zigzag(4, None);
    let extra = json!({"attributes": {"POSITION": 0}, "mode": 1});
    b.json["meshes"][0]["primitives"].as_array_mut().unwrap().insert(0, extra);
    let loaded = load_with(&b, &NONE);
    assert_eq!(loaded.warnings[0].code, "not-triangles");
    assert_eq!(loaded.output.parts[0].primitive, 1);
}

#[test]
fn sparse_accessors_with_and_without_a_base() {
    for base in [true, false] {
        let mut b = Builder::triangle();
        let indices = b.view(&words(&[0, 2]), json!({}));
        let values: Vec<u8> = [5f32, 6., 7., 8., 9., 10.].iter().flat_map(|v| v.to_le_bytes()).collect();
        let values = b.view(&values, json!({}));
        b.json["accessors"][0]["sparse"] = json!({"count": 2,
            "indices": {"bufferView": indices, "componentType": 5123}, "values": {"bufferView": values}});
        if !base {
            b.json["accessors"][0].as_object_mut().unwrap().remove("bufferView");
        }
        let scene = load(&b);
        let middle = if base { Vec3::X } else { Vec3::ZERO };
        assert_eq!(scene.vertices.position, [Vec3::new(5., 6., 7.), middle, Vec3::new(8., 9., 10.)]);
        let data = scene.document.accessor(0).unwrap();
        assert_eq!((data.count, data.components, data.component_type, data.bytes.len()), (3, 3, 5126, 36));
    }
}

#[test]
fn interleaved_attributes() {
    let mut b = Builder::triangle();
    let mut bytes = Vec::new();
    for (p, uv) in [([0f32, 0., 0.], [0.1f32, 0.2]), ([1., 0., 0.], [0.3, 0.4]), ([0., 1., 0.], [0.5, 0.6])] {
        bytes.extend(p.iter().chain(&uv).flat_map(|v| v.to_le_bytes()));
    }
    let view = b.view(&bytes, json!({"byteStride": 20}));
    let at = |offset: u32, kind: &str| json!({"bufferView": view, "byteOffset": offset, "componentType": 5126, "count": 3, "type": kind});
    let position = b.push("accessors", at(0, "VEC3"));
    let uv = b.push("accessors", at(12, "VEC2"));
    b.set("/meshes/0/primitives/0/attributes", json!({"POSITION": position, "TEXCOORD_1": uv}));
    let scene = load(&b);
    assert_eq!(scene.vertices.position, [Vec3::ZERO, Vec3::X, Vec3::Y]);
    assert_eq!(scene.vertices.uv[1], [Vec2::new(0.1, 0.2), Vec2::new(0.3, 0.4), Vec2::new(0.5, 0.6)]);
    assert_eq!(scene.vertices.uv[0], [Vec2::ZERO; 3]);
    assert!(scene.parts[0].has_uv1);
    assert_eq!(scene.document.accessor(uv).unwrap().bytes.len(), 24, "packed without the stride");
}

#[test]
fn quantised_meshes() {
    let mut b = Builder::triangle();
    b.json["extensionsUsed"] = json!(["KHR_mesh_quantization"]);
    b.json["extensionsRequired"] = json!(["KHR_mesh_quantization"]);
    let position: Vec<u8> = [0i16, 0, 0, 0, 200, 0, 0, 0, 0, -300, 0, 0].iter().flat_map(|v| v.to_le_bytes()).collect();
    let view = b.view(&position, json!({"byteStride": 8}));
    let position = b.push("accessors", json!({"bufferView": view, "componentType": 5122, "count": 3, "type": "VEC3"}));
    let view = b.view(&[0, 0, 129, 0, 0, 0, 129, 0, 0, 0, 129, 0], json!({"byteStride": 4}));
    let normal = json!({"bufferView": view, "componentType": 5120, "count": 3, "type": "VEC3", "normalized": true});
    let normal = b.push("accessors", normal);
    let uv = b.accessor(5123, "VEC2", 3, &words(&[0, 65535, 13107, 0, 0, 0]), json!({"normalized": true}));
    let plain = b.accessor(5121, "VEC2", 3, &[7, 9, 0, 0, 255, 1], json!({}));
    b.set(
        "/meshes/0/primitives/0/attributes",
        json!({"POSITION": position, "NORMAL": normal, "TEXCOORD_0": uv, "TEXCOORD_1": plain}),
    );
    b.json["nodes"][0]["scale"] = json!([0.01, 0.01, 0.01]);
    let scene = load(&b);
    assert!(near(scene.vertices.position[1], Vec3::new(2., 0., 0.)));
    assert!(near(scene.vertices.position[2], Vec3::new(0., -3., 0.)));
    assert_eq!(scene.vertices.normal[0], Vec3::NEG_Z);
    assert_eq!(scene.vertices.uv[0], [Vec2::new(0., 1.), Vec2::new(0.2, 0.), Vec2::ZERO]);
    assert_eq!(scene.vertices.uv[1][0], Vec2::new(7., 9.));
}

/// A square with a 2 × 2 texture whose texels are told apart by their red value: 0 1 / 2 3 from the top.
fn textured(info: Value, sampler: Value) -> Builder {
    let mut info = info;
    info["index"] = json!(0);
    let mut b = Builder::square(json!({"pbrMetallicRoughness": {"baseColorTexture": info, "metallicFactor": 0}}));
    let red = |v: u8| [v, 0, 0, 255];
    b.texture(2, &[red(0), red(85), red(170), red(255)]);
    let sampler = b.push("samplers", sampler);
    b.set("/textures/0/sampler", json!(sampler));
    b
}

/// Which texel (0 to 3) is seen at a point of the square.
fn texel(scene: &Scene, x: f32, y: f32) -> u32 {
    let (triangle, b) = if y <= x { (0, Vec2::new(x - y, y)) } else { (1, Vec2::new(x, y - x)) };
    let red = scene.reflectance(triangle, b).x;
    (0..4).min_by_key(|&i| ((red - srgb(i)).abs() * 1e6) as u32).unwrap()
}

fn srgb(texel: u32) -> f32 {
    texelwalk::base::color::srgb_to_linear(texel as f32 / 3.0)
}

#[test]
fn texture_transform_turns_as_the_example_of_its_specification() {
    let nearest = json!({"magFilter": 9728});
    let plain = load(&textured(json!({}), nearest.clone()));
    // TEXCOORD_0 = (x, y), so y grows towards the bottom row of the image.
    assert_eq!([(0.2, 0.2), (0.8, 0.2), (0.2, 0.8), (0.8, 0.8)].map(|(x, y)| texel(&plain, x, y)), [0, 1, 2, 3]);
    // "Utilizes only the lower left quadrant of the source image, rotated clockwise 90°."
    let transform = json!({"offset": [0, 1], "rotation": core::f32::consts::FRAC_PI_2, "scale": [0.5, 0.5]});
    let quadrant = json!({"extensions": {"KHR_texture_transform": transform}});
    let scene = load(&textured(quadrant, nearest.clone()));
    assert_eq!([(0.2, 0.2), (0.8, 0.2), (0.2, 0.8), (0.8, 0.8)].map(|(x, y)| texel(&scene, x, y)), [2; 4]);
    // The same turn of the whole image: u' = v, v' = 1 − u.
    let transform = json!({"offset": [0, 1], "rotation": core::f32::consts::FRAC_PI_2});
    let turned = load(&textured(json!({"extensions": {"KHR_texture_transform": transform}}), nearest.clone()));
    assert_eq!([(0.2, 0.2), (0.8, 0.2), (0.2, 0.8), (0.8, 0.8)].map(|(x, y)| texel(&turned, x, y)), [2, 0, 3, 1]);
    // Scale comes before rotation: u' = 3·v·sin = 0.6 (not 2·v).
    let transform = json!({"rotation": core::f32::consts::FRAC_PI_2, "scale": [2, 3]});
    let scene = load(&textured(json!({"extensions": {"KHR_texture_transform": transform}}), nearest));
    let map = scene.materials[0].base_color_texture.unwrap().transform;
    assert!((map.transform_point2(Vec2::new(0.1, 0.2)) - Vec2::new(0.6, -0.2)).length() < 1e-6);
}

#[test]
fn samplers_reach_the_texture() {
    let at = |wrap: u32, x: f32| {
        let transform = json!({"offset": [1, 0]});
        let sampler = json!({"magFilter": 9728, "wrapS": wrap});
        texel(&load(&textured(json!({"extensions": {"KHR_texture_transform": transform}}), sampler)), x, 0.2)
    };
    assert_eq!([10_497, 33_648, 33_071].map(|wrap| (at(wrap, 0.2), at(wrap, 0.8))), [(0, 1), (1, 0), (1, 1)]);
    let filtered = load(&textured(json!({}), json!({"magFilter": 9729, "wrapS": 33_071})));
    let middle = filtered.reflectance(0, Vec2::new(0.25, 0.25)).x;
    assert!((middle - (srgb(0) + srgb(1)) / 2.0).abs() < 1e-6, "bilinear on linear values");
    assert_eq!(codes(&textured(json!({}), json!({"wrapT": 5}))), ["bad-sampler"]);
}

#[test]
fn texture_coordinate_sets() {
    let mut b = textured(
        json!({"texCoord": 0, "extensions": {"KHR_texture_transform": {"texCoord": 3}}}),
        json!({"magFilter": 9728}),
    );
    let uv = b.floats("VEC2", &[0.75; 8]);
    b.set("/meshes/0/primitives/0/attributes/TEXCOORD_3", json!(uv));
    let scene = load(&b);
    assert_eq!(scene.materials[0].base_color_texture.unwrap().uv_set, 3);
    assert_eq!(scene.vertices.uv.len(), 4);
    assert_eq!(texel(&scene, 0.1, 0.05), 3);
    b.json["meshes"][0]["primitives"][0]["attributes"].as_object_mut().unwrap().remove("TEXCOORD_3");
    let loaded = load_with(&b, &NONE);
    assert_eq!(loaded.warnings[0].code, "missing-texcoord");
    assert_eq!(texel(&loaded.output, 0.9, 0.8), 0);
}

#[test]
fn vertex_colours_of_every_type_multiply_the_base_colour() {
    let expected = [Vec4::new(1., 0., 0.2, 1.), Vec4::new(0.2, 1., 0., 1.), Vec4::new(0., 0.2, 1., 0.4)];
    for (component, components) in [(5126, 3), (5126, 4), (5121, 3), (5121, 4), (5123, 3), (5123, 4)] {
        let mut b = Builder::triangle();
        let values: Vec<f32> = expected.iter().flat_map(|c| c.to_array()[..components].to_vec()).collect();
        let bytes: Vec<u8> = match component {
            5126 => values.iter().flat_map(|v| v.to_le_bytes()).collect(),
            5121 => values.iter().map(|v| (v * 255.0).round() as u8).collect(),
            _ => values.iter().flat_map(|v| ((v * 65535.0).round() as u16).to_le_bytes()).collect(),
        };
        let more = json!({"normalized": component != 5126});
        let color = b.accessor(component, ["VEC3", "VEC4"][components - 3], 3, &bytes, more);
        b.set("/meshes/0/primitives/0/attributes/COLOR_0", json!(color));
        b.push(
            "materials",
            json!({"pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.5, 0.5, 0.5], "metallicFactor": 0.5}}),
        );
        b.set("/meshes/0/primitives/0/material", json!(0));
        let scene = load(&b);
        for (color, mut expected) in scene.vertices.color.iter().zip(expected) {
            expected.w = if components == 3 { 1.0 } else { expected.w };
            assert!((*color - expected).abs().max_element() < 1e-6, "{component} {components}");
        }
        assert!(near(scene.reflectance(0, Vec2::ZERO), Vec3::new(0.25, 0.0, 0.05)));
    }
}

#[test]
fn metallic_emission_alpha_and_sides() {
    let mut b = Builder::square(json!({
        "pbrMetallicRoughness": {"baseColorFactor": [0.8, 0.6, 0.4, 1], "metallicFactor": 0.5,
                                 "metallicRoughnessTexture": {"index": 0}},
        "emissiveFactor": [1, 0.5, 0], "emissiveTexture": {"index": 1},
        "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 20}},
        "alphaMode": "MASK", "alphaCutoff": 0.25, "doubleSided": true
    }));
    b.texture(1, &[[255, 255, 51, 255]]);
    b.texture(1, &[[188, 188, 188, 255]]);
    let scene = load(&b);
    let at = Vec2::splat(0.3);
    assert!(near(scene.reflectance(0, at), Vec3::new(0.8, 0.6, 0.4) * 0.9));
    let texel = texelwalk::base::color::srgb_to_linear(188.0 / 255.0);
    assert!((scene.emission(0, at) - Vec3::new(20., 10., 0.) * texel).length() < 1e-4);
    assert!(scene.materials[0].double_sided);
    assert_eq!(scene.materials[0].alpha, Alpha::Mask(0.25));
    let default = &scene.materials[1];
    assert_eq!((default.metallic, default.base_color, default.alpha), (1.0, Vec4::ONE, Alpha::Opaque));
}

#[test]
fn alpha_is_factor_times_texture_times_vertex_colour() {
    let mut b = textured(json!({}), json!({"magFilter": 9728}));
    b.set("/materials/0/pbrMetallicRoughness/baseColorFactor", json!([1, 1, 1, 0.5]));
    b.set("/materials/0/alphaMode", json!("BLEND"));
    let color = b.floats("VEC4", &[1., 1., 1., 0.5].repeat(4));
    b.set("/meshes/0/primitives/0/attributes/COLOR_0", json!(color));
    let mut scene = load(&b);
    let at = Vec2::new(0.1, 0.1);
    assert!((scene.opacity(0, at) - 0.25).abs() < 1e-6);
    assert_eq!(scene.opacity(0, at), scene.base_color(0, at).w);
    scene.materials[0].alpha = Alpha::Mask(0.25);
    assert_eq!(scene.opacity(0, at), 1.0);
    scene.materials[0].alpha = Alpha::Mask(0.2501);
    assert_eq!(scene.opacity(0, at), 0.0);
}

#[test]
fn unlit_materials_block_light_and_receive_none() {
    let mut b = Builder::square(json!({"emissiveFactor": [1, 1, 1], "extensions": {"KHR_materials_unlit": {}}}));
    b.json["extensionsRequired"] = json!(["KHR_materials_unlit"]);
    let scene = load(&b);
    assert!(!scene.parts[0].receives && scene.materials[0].unlit);
    assert_eq!(scene.reflectance(0, Vec2::ZERO) + scene.emission(0, Vec2::ZERO), Vec3::ZERO);
    assert_eq!(scene.opacity(0, Vec2::ZERO), 1.0);
}

#[test]
fn lights_have_the_defaults_of_their_extension() {
    let mut b = Builder::triangle();
    b.json["extensionsRequired"] = json!(["KHR_lights_punctual"]);
    b.json["extensions"] = json!({"KHR_lights_punctual": {"lights": [
        {"type": "directional"}, {"type": "point"}, {"type": "spot"},
        {"type": "spot", "color": [1, 0.5, 0.25], "intensity": 8, "range": 4,
         "spot": {"innerConeAngle": 0.2, "outerConeAngle": 0.6}, "extras": {"radius": 0.125}},
        {"type": "directional", "extras": {"angle": 0.01}}
    ]}});
    let light = |i: u32| json!({"KHR_lights_punctual": {"light": i}});
    let half = core::f64::consts::FRAC_1_SQRT_2;
    b.push("nodes", json!({"extensions": light(0), "scale": [-3, 2, 5]}));
    b.push("nodes", json!({"extensions": light(1), "translation": [1, 2, 3], "scale": [4, 4, 4]}));
    // A quarter turn about x takes −z to +y.
    b.push("nodes", json!({"extensions": light(2), "rotation": [half, 0, 0, half]}));
    b.push("nodes", json!({"translation": [0, 0, 9], "children": [5]}));
    b.push("nodes", json!({"extensions": light(3), "translation": [0, 1, 0]}));
    b.push("nodes", json!({"extensions": light(4)}));
    let scene = load(&b);
    let [
        Light::Sun { direction, illuminance, angle },
        Light::Point { position, intensity, range, radius },
        spot,
        aimed,
        sun,
    ] = scene.lights.as_slice()
    else {
        panic!("{:?}", scene.lights)
    };
    assert_eq!((*direction, *illuminance, *angle), (Vec3::NEG_Z, Vec3::ONE, 0.0));
    assert_eq!((*position, *intensity, *range, *radius), (Vec3::new(1., 2., 3.), Vec3::ONE, f32::INFINITY, 0.0));
    let Light::Spot { direction, cos_inner, cos_outer, .. } = spot else { panic!("{spot:?}") };
    assert!(near(*direction, Vec3::Y));
    assert!(*cos_inner == 1.0 && (cos_outer - half as f32).abs() < 1e-7);
    let Light::Spot { position, intensity, range, radius, cos_inner, cos_outer, .. } = aimed else {
        panic!("{aimed:?}")
    };
    assert_eq!((*position, *intensity), (Vec3::new(0., 1., 9.), Vec3::new(8., 4., 2.)));
    assert_eq!((*range, *radius), (4.0, 0.125));
    assert!((cos_inner - 0.2f32.cos()).abs() < 1e-6 && (cos_outer - 0.6f32.cos()).abs() < 1e-6);
    assert!(matches!(sun, Light::Sun { angle, .. } if *angle == 0.01));
    let suns = load_with(&b, &Settings { sun_angle: Some(0.5), ..NONE }).output.lights;
    assert!([&suns[0], &suns[4]].iter().all(|l| matches!(l, Light::Sun { angle, .. } if *angle == 0.5)));
}

#[test]
fn odd_lights_are_reported() {
    let mut b = Builder::triangle();
    b.json["extensions"] = json!({"KHR_lights_punctual": {"lights": [
        {"type": "point", "intensity": -5}, {"type": "tube"}, {"type": "spot", "spot": {"innerConeAngle": 3, "outerConeAngle": 2}},
        {"type": "point", "range": 0, "extras": {"radius": "big"}}
    ]}});
    for i in 0..4 {
        b.push("nodes", json!({"extensions": {"KHR_lights_punctual": {"light": i}}}));
    }
    let loaded = load_with(&b, &NONE);
    assert_eq!(loaded.warnings.len(), 5);
    assert!(loaded.warnings.iter().all(|w| w.code == "bad-light" && w.node.is_some()));
    let [Light::Spot { cos_inner, cos_outer, .. }, Light::Point { range, radius, .. }] =
        loaded.output.lights.as_slice()
    else {
        panic!("{:?}", loaded.output.lights)
    };
    assert!(cos_outer.abs() < 1e-6 && cos_inner == cos_outer);
    assert_eq!((*range, *radius), (f32::INFINITY, 0.0));
}

#[test]
fn hidden_nodes_hide_what_is_below_but_not_cameras() {
    let mut b = Builder::triangle();
    b.json["extensionsRequired"] = json!(["KHR_node_visibility"]);
    b.json["extensions"] = json!({"KHR_lights_punctual": {"lights": [{"type": "point"}]}});
    b.json["cameras"] = json!([{"perspective": {"yfov": 1, "znear": 0.1}}]);
    let visible = |v: bool| json!({"visible": v});
    b.push("nodes", json!({"children": [2, 3], "extensions": {"KHR_node_visibility": visible(false)}}));
    b.push("nodes", json!({"mesh": 0, "extensions": {"KHR_node_visibility": visible(true)}}));
    b.push("nodes", json!({"camera": 0, "extensions": {"KHR_lights_punctual": {"light": 0}}}));
    let scene = load(&b);
    assert_eq!((scene.parts.len(), scene.lights.len(), scene.cameras.len()), (1, 0, 1));
}

#[test]
fn scenes() {
    let mut b = Builder::triangle();
    b.json["nodes"] =
        json!([{"mesh": 0, "name": "child"}, {"mesh": 0, "name": "other"}, {"children": [0], "name": "parent"}]);
    let names = |b: &Builder, scene| -> Vec<String> {
        load_with(b, &Settings { scene, ..NONE }).output.parts.iter().map(|p| p.name.clone()).collect()
    };
    assert_eq!(names(&b, None), ["other", "child"], "no scenes: all roots, in document order");
    b.json["scenes"] = json!([{"nodes": [1]}, {"nodes": [2]}, {"nodes": [2, 1]}]);
    assert_eq!(names(&b, None), ["other"], "scene 0 where no default is named");
    b.json["scene"] = json!(1);
    assert_eq!(names(&b, None), ["child"]);
    assert_eq!(names(&b, Some(2)), ["child", "other"], "the order of the scene");
    let error = scene::load_bytes(b.gltf(), Path::new("a.gltf"), &Settings { scene: Some(3), ..NONE }).unwrap_err();
    assert!(error.to_string().contains("scene 3 does not exist, the document has 3"));
}

#[test]
fn cameras() {
    let mut b = Builder::triangle();
    b.json["cameras"] = json!([
        {"type": "perspective", "perspective": {"yfov": 0.5, "aspectRatio": 2, "znear": 0.1}},
        {"type": "orthographic", "orthographic": {"xmag": 3, "ymag": 2, "znear": 0, "zfar": 9}},
        {"type": "perspective"}
    ]);
    // A half turn about y, scaled unevenly: the lens must not be.
    b.push(
        "nodes",
        json!({"name": "eye", "camera": 0, "rotation": [0, 1, 0, 0], "translation": [1, 2, 3], "scale": [2, 3, 4]}),
    );
    b.push("nodes", json!({"camera": 1}));
    b.push("nodes", json!({"camera": 2}));
    let loaded = load_with(&b, &NONE);
    assert_eq!(loaded.warnings[0].code, "bad-camera");
    let [eye, plan] = loaded.output.cameras.as_slice() else { panic!() };
    assert_eq!(eye.name, "eye");
    assert!(matches!(eye.projection, Projection::Perspective { yfov: 0.5, aspect: Some(2.0) }));
    let at = |p: Vec3| eye.world_from_camera.transform_point3(p);
    assert!(near(at(Vec3::NEG_Z), Vec3::new(1., 2., 4.)) && near(at(Vec3::X), Vec3::new(0., 2., 3.)));
    assert!(near(at(Vec3::Y), Vec3::new(1., 3., 3.)));
    assert!(matches!(plan.projection, Projection::Orthographic { xmag: 3.0, ymag: 2.0 }));
}

#[test]
fn glb_chunks_are_kept_and_files_are_recorded() {
    let folder = tempfile::tempdir().unwrap();
    let mut b = Builder::square(
        json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}, "normalTexture": {"index": 1}}),
    );
    b.push("images", json!({"uri": "../tex%20tures/a%C3%A9.png"}));
    b.push("images", json!({"uri": "not needed, so not read.png"}));
    b.push("textures", json!({"source": 0}));
    b.push("textures", json!({"source": 1}));
    std::fs::create_dir_all(folder.path().join("tex tures")).unwrap();
    std::fs::create_dir_all(folder.path().join("models")).unwrap();
    let image = folder.path().join("tex tures/aé.png");
    std::fs::write(&image, png(1, &[[255, 0, 0, 255]])).unwrap();
    let main = folder.path().join("models/a.glb");
    std::fs::write(&main, b.glb(&[(0x1234_5678, b"keep me!"), (0x004E_4942, b"2nd!")])).unwrap();
    let loaded = scene::load(&main, &NONE).unwrap();
    assert_eq!(loaded.warnings, []);
    let document = &loaded.output.document;
    assert!(document.glb && document.bin.is_some());
    assert_eq!(document.extra_chunks, [(0x1234_5678, b"keep me!".to_vec()), (0x004E_4942, b"2nd!".to_vec())]);
    assert_eq!(document.files_read, [main, folder.path().join("models/../tex tures/aé.png")]);
    assert_eq!(loaded.output.textures[0].pixels, [[255, 0, 0, 255]]);
    assert_eq!(loaded.output.textures[1].pixels, [[255; 4]], "a texture that no bake needs is one white texel");

    b.json["buffers"][0]["uri"] = json!("b%20in");
    std::fs::write(folder.path().join("models/b in"), [b.bin.as_slice(), &[1, 2, 3]].concat()).unwrap();
    let main = folder.path().join("models/a.gltf");
    let text = b.gltf();
    std::fs::write(&main, &text).unwrap();
    let document = scene::load(&main, &NONE).unwrap().output.document;
    assert_eq!(document.json.as_bytes(), text);
    assert_eq!(document.files_read[1], folder.path().join("models/b in"));
    assert_eq!(
        document.buffers[0],
        b.bin[..b.json["buffers"][0]["byteLength"].as_u64().map_or(b.bin.len(), |n| n as usize)]
    );
}

#[test]
fn data_uris_16_bit_png_jpeg_and_webp() {
    let gray16 = image::ImageBuffer::<image::Luma<u16>, _>::from_pixel(2, 2, image::Luma([0x8080]));
    let rgb = image::RgbImage::from_pixel(8, 8, image::Rgb([128, 128, 128]));
    let encode = |image: image::DynamicImage, format| {
        let mut bytes = std::io::Cursor::new(Vec::new());
        image.write_to(&mut bytes, format).unwrap();
        bytes.into_inner()
    };
    let files = [
        encode(gray16.into(), image::ImageFormat::Png),
        encode(rgb.clone().into(), image::ImageFormat::Jpeg),
        encode(rgb.into(), image::ImageFormat::WebP),
    ];
    for (i, bytes) in files.iter().enumerate() {
        let mut b = Builder::square(json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}));
        b.push("images", json!({"uri": data_uri("image/whatever", bytes)}));
        match i {
            2 => b.push("textures", json!({"extensions": {"EXT_texture_webp": {"source": 0}}})),
            _ => b.push("textures", json!({"source": 0})),
        };
        let [r, _, _, a] = load(&b).textures[0].pixels[0];
        assert!(r.abs_diff(128) <= 1 && a == 255, "{i}: {r}");
    }
}

#[test]
fn optional_unknown_extensions_are_reported_once_and_kept() {
    let mut b = Builder::triangle();
    b.json["extensionsUsed"] =
        json!(["ACME_glow", "KHR_materials_clearcoat", "KHR_draco_mesh_compression", "ACME_glow"]);
    b.json["extensionsRequired"] = json!(["KHR_materials_clearcoat", "KHR_materials_variants"]);
    // An animation target without a node, as KHR_animation_pointer has it.
    b.json["animations"] = json!([{"channels": [{"sampler": 0, "target": {"path": "pointer"}}], "samplers": []}]);
    let loaded = load_with(&b, &NONE);
    let found: Vec<_> = loaded.warnings.iter().map(|w| w.code).collect();
    assert_eq!(found, ["unsupported-extension"; 2]);
    assert!(loaded.warnings[0].message.contains("ACME_glow") && loaded.warnings[1].message.contains("draco"));
    assert!(loaded.output.document.json.contains("ACME_glow"));
}

#[test]
fn skinned_meshes_stand_where_their_joints_are_and_do_not_receive() {
    let mut b = Builder::triangle();
    let joints = b.accessor(5121, "VEC4", 3, &[0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0], json!({}));
    let weights = b.floats("VEC4", &[1., 0., 0., 0., 1., 0., 0., 0., 0.5, 0.5, 0., 0.]);
    b.set("/meshes/0/primitives/0/attributes/JOINTS_0", json!(joints));
    b.set("/meshes/0/primitives/0/attributes/WEIGHTS_0", json!(weights));
    let mut binds = [[1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1.]; 2];
    binds[1][12] = -1.0;
    let binds = b.floats("MAT4", &binds.concat());
    b.push("skins", json!({"joints": [1, 2], "inverseBindMatrices": binds}));
    b.set("/nodes/0", json!({"mesh": 0, "skin": 0, "translation": [100, 0, 0]}));
    b.push("nodes", json!({"translation": [0, 0, 4]}));
    b.push("nodes", json!({"translation": [3, 0, 0]}));
    let loaded = load_with(&b, &NONE);
    assert_eq!(loaded.warnings[0].code, "deforming-mesh");
    let scene = loaded.output;
    assert!(!scene.parts[0].receives);
    // Joint 0 moves by (0, 0, 4), joint 1 by (3 − 1, 0, 0); the node's own transform does not count.
    let expected = [Vec3::new(0., 0., 4.), Vec3::new(3., 0., 0.), Vec3::new(1., 1., 2.)];
    assert!(scene.vertices.position.iter().zip(expected).all(|(p, e)| near(*p, e)), "{:?}", scene.vertices.position);
}

#[test]
fn morph_targets_apply_their_weights_at_rest() {
    let mut b = Builder::triangle();
    let delta = b.floats("VEC3", &[0., 0., 2., 0., 0., 2., 0., 0., 2.]);
    b.json["meshes"][0]["primitives"][0]["targets"] = json!([{"POSITION": 0}, {"POSITION": delta}]);
    b.json["meshes"][0]["weights"] = json!([0, 0.5]);
    b.push("nodes", json!({"mesh": 0, "weights": [1, 0]}));
    let scene = load_with(&b, &NONE).output;
    assert_eq!(scene.vertices.position[0], Vec3::Z);
    assert_eq!(scene.vertices.position[4], Vec3::X * 2.0);
    assert!(scene.parts.iter().all(|p| !p.receives));
}

#[test]
fn animated_nodes_are_reported() {
    let mut b = Builder::triangle();
    b.json["nodes"] = json!([{"mesh": 0}, {"children": [0]}]);
    b.json["animations"] = json!([{"channels": [{"sampler": 0, "target": {"node": 1, "path": "rotation"}}]}]);
    let loaded = load_with(&b, &NONE);
    assert_eq!(loaded.warnings[0].code, "animated-node");
    assert!(loaded.output.parts[0].receives);
}

#[test]
fn deep_trees_load() {
    let mut b = Builder::triangle();
    let depth = 100_000;
    let mut nodes: Vec<Value> = (0..depth).map(|i| json!({"children": [i + 1], "translation": [0, 0, 1e-5]})).collect();
    nodes.push(json!({"mesh": 0}));
    b.json["nodes"] = json!(nodes);
    let scene = load(&b);
    assert!(near(scene.vertices.position[0], Vec3::Z));
}

/// The order of work over threads must not show.
#[test]
fn the_same_scene_at_every_thread_count() {
    let mut b = textured(json!({}), json!({}));
    for i in 0..50 {
        b.push("nodes", json!({"mesh": 0, "translation": [i, 0, 0], "rotation": [0.1, 0.2, 0.3, 0.9]}));
    }
    let bytes = b.glb(&[]);
    let all: Vec<_> = [1, 2, 3, 8]
        .into_iter()
        .map(|threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let loaded = pool.install(|| scene::load_bytes(bytes.clone(), Path::new("a.glb"), &NONE)).unwrap();
            let bits: Vec<u32> =
                loaded.output.vertices.position.iter().flat_map(|p| p.to_array().map(f32::to_bits)).collect();
            (bits, loaded.output.triangles, loaded.output.textures[0].pixels.clone())
        })
        .collect();
    assert!(all.windows(2).all(|w| w[0] == w[1]));
}
