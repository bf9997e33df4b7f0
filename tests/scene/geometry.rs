//! Vertices and triangles: winding, normals, indices, accessors of every kind, poses.

use super::*;

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
        assert!(scene.parts[t as usize].has_normals);
        for v in scene.triangles[t as usize] {
            let n = scene.vertices.normal[v as usize];
            assert!(near(n, geometric), "triangle {t}: {n} {geometric}");
        }
    }
    let expected = Vec3::new(1.0 / 2.0, 1.0 / 3.0, 2.0).normalize();
    assert!(near(scene.vertices.normal[0], expected));
}

#[test]
fn normals_count_for_none_only_where_they_say_the_same() {
    for (normal, flat) in [([0.0, 0.0, 1.0], true), ([3e-6, 0.0, 1.0], true), ([0.001, 0.0, 1.0], false)] {
        let mut b = Builder::triangle();
        let normals = b.floats("VEC3", &[[0.0, 0.0, 1.0], normal, [0.0, 0.0, 1.0]].concat());
        b.set("/meshes/0/primitives/0/attributes/NORMAL", json!(normals));
        let part = &load(&b).parts[0];
        assert_eq!((part.flat, part.has_normals), (flat, true), "{normal:?}");
    }
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
