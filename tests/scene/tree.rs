//! Scenes, nodes, cameras, containers, files, extensions.

use super::*;

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
    b.push("nodes", json!({"camera": 2}));
    b.push("nodes", json!({"camera": 1}));
    let loaded = load_with(&b, &NONE);
    assert_eq!(loaded.warnings[0].code, "bad-camera");
    let [eye, plan] = loaded.output.cameras.as_slice() else { panic!() };
    assert_eq!(eye.name, "eye");
    // The one that is left out has a number, too.
    assert_eq!([eye.number, plan.number], [0, 2]);
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
fn optional_unknown_extensions_are_reported_once_and_kept() {
    let mut b = Builder::triangle();
    b.json["extensionsUsed"] = json!(["ACME_glow", "KHR_materials_clearcoat", "EXT_texture_avif", "ACME_glow"]);
    b.json["extensionsRequired"] = json!(["KHR_materials_clearcoat", "KHR_materials_variants"]);
    // An animation target without a node, as KHR_animation_pointer has it.
    b.json["animations"] = json!([{"channels": [{"sampler": 0, "target": {"path": "pointer"}}], "samplers": []}]);
    let loaded = load_with(&b, &NONE);
    let found: Vec<_> = loaded.warnings.iter().map(|w| w.code).collect();
    assert_eq!(found, ["unsupported-extension"; 2]);
    assert!(loaded.warnings[0].message.contains("ACME_glow") && loaded.warnings[1].message.contains("_avif"));
    assert!(loaded.output.document.json.contains("ACME_glow"));
}

#[test]
fn animated_nodes_are_reported() {
    let mut b = Builder::triangle();
    b.json["nodes"] = json!([{"mesh": 0}, {"children": [0]}]);
    b.json["animations"] = json!([{"channels": [{"sampler": 0, "target": {"node": 1, "path": "rotation"}}]}]);
    let loaded = load_with(&b, &NONE);
    assert_eq!(loaded.warnings[0].code, "animated-node");
    assert!(loaded.output.parts[0].receives);
    let pointed = |b: &mut Builder, pointer: &str| {
        let target = json!({"path": "pointer", "extensions": {"KHR_animation_pointer": {"pointer": pointer}}});
        b.json["animations"] = json!([{"channels": [{"sampler": 0, "target": target}]}]);
        codes(b)
    };
    for path in ["translation", "rotation", "scale"] {
        assert_eq!(pointed(&mut b, &format!("/nodes/1/{path}")), ["animated-node"], "{path}");
    }
    for pointer in ["/nodes/1/weights", "/nodes/77/scale", "/nodes/x/scale", "/nodes/1", "/materials/0/scale", ""] {
        assert_eq!(pointed(&mut b, pointer), [""; 0], "{pointer}");
    }
}

#[test]
fn deep_trees_load() {
    let mut b = Builder::triangle();
    let depth = 20_000;
    let mut nodes: Vec<Value> = (0..depth).map(|i| json!({"children": [i + 1], "translation": [0, 0, 5e-5]})).collect();
    nodes.push(json!({"mesh": 0}));
    b.json["nodes"] = json!(nodes);
    let scene = load(&b);
    assert!(near(scene.vertices.position[0], Vec3::Z));
}

/// The order of work over threads must not show.
#[test]
fn the_same_scene_at_every_thread_count() {
    let mut b = materials::textured(json!({}), json!({}));
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
