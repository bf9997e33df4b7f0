//! Rewriting of glTF documents: what is added is right, and everything that was there still is.

use crate::gltf::*;
use glam::Vec2;
use serde_json::Value;
use serde_json::json;
use std::path::Path;
use texelwalk::atlas::Atlas;
use texelwalk::atlas::ChartedPart;
use texelwalk::atlas::Layout;
use texelwalk::atlas::NO_CHART;
use texelwalk::output::atomic::commit;
use texelwalk::output::gltf::Quantity;
use texelwalk::output::gltf::Settings;
use texelwalk::output::gltf::write_gltf;
use texelwalk::output::names::page_files;

const QUAD: [[u32; 3]; 2] = [[0, 1, 2], [0, 2, 3]];

/// Bakes into `name` beside the input and reads the result back. Warnings come as their codes.
///
/// With `TEXELWALK_TEST_OUTPUT=folder` a copy of every result stays there, for a look or a validator.
fn bake(input: &Input, atlas: &Atlas, name: &str) -> (Output, Vec<&'static str>) {
    let path = input.folder.path().join(name);
    let pages = page_files(&path, atlas.pages);
    let settings = Settings {
        quantity: Quantity::Radiosity,
        output: path.clone(),
        generator: "texelwalk 0.1.0".into(),
        quantize_uv: false,
    };
    let written = write_gltf(&input.scene, atlas, &pages, &settings).unwrap();
    let mut files = written.output;
    files.splice(0..0, pages.iter().map(|p| (p.png.clone(), PNG.to_vec().into())));
    commit(&files, std::slice::from_ref(&input.scene.document.path), None, &|| false).unwrap();
    if let Some(keep) = std::env::var_os("TEXELWALK_TEST_OUTPUT") {
        let target = Path::new(&keep).join(std::thread::current().name().unwrap().replace(':', "_"));
        copy_folder(input.folder.path(), &target);
    }
    (Output::read(&path), written.warnings.iter().map(|w| w.code).collect())
}

fn copy_folder(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).unwrap();
    for entry in std::fs::read_dir(from).unwrap() {
        let path = entry.unwrap().path();
        let target = to.join(path.file_name().unwrap());
        if path.is_dir() {
            copy_folder(&path, &target);
        } else {
            std::fs::copy(&path, &target).unwrap();
        }
    }
}

/// Everything in `old` is in `new` at the same place, but for the paths that `allowed` accepts.
fn assert_kept(old: &Value, new: &Value, path: &str, allowed: &dyn Fn(&str) -> bool) {
    match (old, new) {
        _ if allowed(path) => {}
        (Value::Object(a), Value::Object(b)) => {
            for (key, value) in a {
                let path = format!("{path}/{key}");
                assert!(allowed(&path) || b.contains_key(key), "{path} is gone");
                assert_kept(value, b.get(key).unwrap_or(&Value::Null), &path, allowed);
            }
        }
        (Value::Array(a), Value::Array(b)) => {
            assert!(b.len() >= a.len(), "{path} is shorter");
            for (i, (a, b)) in a.iter().zip(b).enumerate() {
                assert_kept(a, b, &format!("{path}/{i}"), allowed);
            }
        }
        _ => assert_eq!(old, new, "{path} changed"),
    }
}

/// Two quads with many attributes under odd formatting; mesh 0 is used by nodes 0 and 1, mesh 1 by node 2.
fn everything(builder: &mut Builder, uri: &str) -> String {
    let positions: Vec<f32> = vec![0.1, 0.0, 0.0, 1.7, 0.0, 0.0, 1.7, 1.3, 0.0, 0.1, 1.3, 0.0];
    let position = builder.floats("VEC3", &positions);
    let normal = builder.floats("VEC3", &[0.0, 0.0, 1.0].repeat(4));
    let uv0 = builder.floats("VEC2", &[0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0, 1.0]);
    let padded: Vec<u8> = (0..16).map(|i| if i % 4 == 3 { 0xEE } else { i * 7 }).collect();
    let custom = builder.raw(&padded, "VEC3", 5121, 4, &json!({"name": "custom", "extras": {"k": [1]}}));
    builder.views.last_mut().unwrap()["byteStride"] = json!(4);
    let colors: Vec<u8> = (100..116).collect();
    let color = builder.raw(&colors, "VEC4", 5121, 4, &json!({"normalized": true}));
    let sparse_indices = builder.view(&[1, 3]);
    let values: Vec<u8> = [0.5f32, 0.25, -1.0, 0.0, -2.0, 4.0].iter().flat_map(|v| v.to_le_bytes()).collect();
    let sparse_values = builder.view(&values);
    builder.accessors.push(json!({"componentType": 5126, "count": 4, "type": "VEC3", "min": [0.0, -2.0, -1.0],
        "max": [0.5, 0.25, 4.0], "sparse": {"count": 2, "indices": {"bufferView": sparse_indices, "componentType": 5121},
        "values": {"bufferView": sparse_values}}}));
    let target = builder.accessors.len() - 1;
    let indices = builder.shorts(&[0, 1, 2, 0, 2, 3]);
    let strip = builder.shorts(&[0, 1, 3, 2]);
    let (views, accessors) = (json!(builder.views), json!(builder.accessors));
    let length = builder.bin.len();
    format!(
        r#"{{ "asset" : {{"version":"2.0", "generator":"by hand","extras":{{"x":1.50}}}},
  "extensionsUsed": ["KHR_materials_unlit", "KHR_materials_variants"],
  "extensions": {{"KHR_materials_variants": {{"variants": [{{"name":"v0"}}, {{"name":"v1"}}]}}}},
  "unknownTop": {{"big": 12345678901234567890123, "e": 1e5, "s": "\u00e9\/"}},
  "scene": 0,
  "scenes": [{{"name": "main", "nodes": [0, 1, 3], "extras": {{"mine": [1.0, 2.50]}}}}, {{"name": "empty", "nodes": [4]}}],
  "nodes": [
    {{"mesh": 0, "name": "a"}},
    {{"mesh":0,"name":"b","scale":[-1.0, 1, 1], "translation": [3,0,0]}},
    {{"mesh": 1, "name": "child", "extras": 7}},
    {{"name": "parent", "children": [2], "translation": [0, 2, 0]}},
    {{"name": "lonely"}}
  ],
  "meshes": [
    {{"name": "quad", "primitives": [
      {{"attributes": {{"POSITION": {position}, "NORMAL": {normal}, "TEXCOORD_0": {uv0}, "_CUSTOM": {custom},
        "COLOR_0": {color}}}, "indices": {indices}, "material": 0, "targets": [{{"POSITION": {target}}}], "extras": {{"p": 0.10}},
        "extensions": {{"KHR_materials_variants": {{"mappings": [{{"material": 1, "variants": [0]}}]}}}}}}
    ], "weights": [0.0]}},
    {{"name": "bare", "primitives": [
      {{"attributes": {{"POSITION": {position}}}, "indices": {strip}, "mode": 5}},
      {{"attributes": {{"POSITION": {position}, "NORMAL": {normal}, "TEXCOORD_0": {uv0}}}, "indices": {indices}, "material": 2}}
    ]}}
  ],
  "materials": [
    {{"name": "red", "pbrMetallicRoughness": {{"baseColorFactor": [1.0, 0.10, 0, 1], "baseColorTexture": {{"index": 0}}}}}},
    {{"name": "variant"}},
    {{"name": "sign", "extensions": {{"KHR_materials_unlit": {{}}}}}}
  ],
  "textures": [{{"source": 0}}],
  "images": [{{"uri": "t%20ex.png"}}],
  "buffers": [{{{uri}"byteLength": {length}, "name": "data"}}],
  "bufferViews": {views},
  "accessors": {accessors}
}}"#
    )
}

fn everything_input(glb: bool) -> Input {
    let mut builder = Builder::default();
    let text = everything(&mut builder, if glb { "" } else { "\"uri\": \"data.bin\", " });
    input(&text, &builder.bin, glb, &[(0, 0, 0), (1, 0, 0), (2, 1, 0), (2, 1, 1)])
}

/// Nothing split; primitive 1 of mesh 1 (unlit) receives nothing; node 2 lies on page 1.
fn everything_atlas(input: &mut Input) -> Atlas {
    assert!(input.scene.parts[1].mirrored);
    input.scene.parts[3].receives = false;
    let parts = vec![
        unsplit(4, &QUAD, 0),
        unsplit(4, &[[0, 2, 1], [0, 3, 2]], 1),
        unsplit(4, &[[0, 1, 3], [3, 1, 2]], 2),
        unsplit(4, &QUAD, NO_CHART),
    ];
    atlas(&[0, 0, 1], parts)
}

#[test]
fn instances_share_everything_but_their_lightmap_coordinates() {
    let mut input = everything_input(false);
    let atlas = everything_atlas(&mut input);
    let (output, warnings) = bake(&input, &atlas, "out.gltf");
    assert!(warnings.is_empty(), "{warnings:?}");
    let j = &output.json;
    assert_eq!(
        (&j["nodes"][0]["mesh"], &j["nodes"][1]["mesh"], &j["nodes"][2]["mesh"]),
        (&json!(0), &json!(2), &json!(1))
    );
    let (a, b) = (&j["meshes"][0]["primitives"][0], &j["meshes"][2]["primitives"][0]);
    let mut same = b.clone();
    same["attributes"]["TEXCOORD_1"] = a["attributes"]["TEXCOORD_1"].clone();
    assert_eq!(&same, a);
    assert_ne!(a["attributes"]["TEXCOORD_1"], b["attributes"]["TEXCOORD_1"]);
    let uv = output.floats(&a["attributes"]["TEXCOORD_1"]);
    assert_eq!(uv, (0..4).map(|v| vec![(1.0 + v as f32) / 64.0, 2.0 / 32.0]).collect::<Vec<_>>());
    // Without TEXCOORD_0 and material: zeros, and a new material on page 1; the strip stays a strip.
    let bare = &j["meshes"][1]["primitives"][0];
    assert_eq!(output.floats(&bare["attributes"]["TEXCOORD_0"]), vec![vec![0.0, 0.0]; 4]);
    assert_eq!(bare["mode"], 5);
    assert_eq!(j["materials"][bare["material"].as_u64().unwrap() as usize]["extensions"]["MOZ_lightmap"]["index"], 2);
    assert!(j["meshes"][1]["primitives"][1]["attributes"].get("TEXCOORD_1").is_none());
    // Material 0 and its variant are used on page 0 only, so they carry the lightmap themselves.
    for material in [0, 1] {
        let lightmap = &j["materials"][material]["extensions"]["MOZ_lightmap"];
        assert_eq!(lightmap, &json!({"index": 1, "texCoord": 1, "intensity": std::f64::consts::PI}));
    }
    assert_eq!(j["meshes"].as_array().unwrap().len(), 3);
    assert_eq!(j["materials"].as_array().unwrap().len(), 4);
}

#[test]
fn textures_manifest_and_generator() {
    let mut input = everything_input(false);
    let atlas = everything_atlas(&mut input);
    let (output, _) = bake(&input, &atlas, "out.gltf");
    let j = &output.json;
    assert_eq!(j["asset"]["generator"], "by hand; texelwalk 0.1.0");
    assert_eq!(j["extensionsUsed"], json!(["KHR_materials_unlit", "KHR_materials_variants", "MOZ_lightmap"]));
    let texture = &j["textures"][2];
    assert_eq!(texture["extras"]["lightmap"]["uri"], "out.lightmap1.exr");
    assert_eq!(j["images"][texture["source"].as_u64().unwrap() as usize]["uri"], "out.lightmap1.png");
    assert_eq!(
        j["samplers"][texture["sampler"].as_u64().unwrap() as usize],
        json!({"magFilter": 9729, "minFilter": 9729, "wrapS": 33071, "wrapT": 33071})
    );
    assert_eq!(
        j["scenes"][0]["extras"],
        json!({"mine": [1.0, 2.5], "lightmap": {"version": 1, "quantity": "radiosity", "texCoord": 1, "mipLevels": 0, "pages": [
            {"uri": "out.lightmap0.exr", "texture": 1, "width": 64, "height": 32},
            {"uri": "out.lightmap1.exr", "texture": 2, "width": 64, "height": 32}]}})
    );
    assert!(j["scenes"][1].get("extras").is_none(), "nothing is baked in the second scene");
}

#[test]
fn everything_is_still_there_in_every_container() {
    for (glb, name) in [(false, "a.gltf"), (false, "sub/a.glb"), (true, "a.glb"), (true, "sub/de ep/a.gltf")] {
        let mut input = everything_input(glb);
        let atlas = everything_atlas(&mut input);
        let (output, _) = bake(&input, &atlas, name);
        let old: Value = serde_json::from_str(&input.scene.document.json).unwrap();
        let allowed = |path: &str| {
            ["/asset/generator", "/nodes/1/mesh", "/images/0/uri", "/buffers/0/byteLength", "/buffers/0/uri"]
                .contains(&path)
        };
        // Mesh 1's first primitive had no material; everything else is only added to.
        assert_kept(&old, &output.json, "", &allowed);
        for spelling in ["1.50", "12345678901234567890123", "1e5", "\\u00e9\\/", "[1.0, 0.10, 0, 1]", "0.10", "2.50"] {
            assert!(output.text.contains(spelling), "{name}: {spelling}");
        }
        let image = resolve(&output.path, output.json["images"][0]["uri"].as_str().unwrap());
        assert_eq!(std::fs::read(image).unwrap(), PNG);
        let source = Output {
            json: old,
            text: String::new(),
            buffers: input.scene.document.buffers.clone(),
            path: output.path.clone(),
        };
        for i in 0..source.json["accessors"].as_array().unwrap().len() {
            assert_eq!(source.elements(&json!(i)), output.elements(&json!(i)), "{name}: accessor {i}");
        }
        let uv = &output.json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_1"];
        assert_eq!(output.floats(uv)[3], [4.0 / 64.0, 2.0 / 32.0], "{name}");
        if name.ends_with("glb") {
            assert_eq!(output.buffers.len(), 1, "{name}: all bytes in the BIN chunk");
        }
    }
}

#[test]
fn json_outside_of_the_additions_is_untouched() {
    let mut input = everything_input(false);
    let atlas = everything_atlas(&mut input);
    let (output, _) = bake(&input, &atlas, "out.gltf");
    // Every line of the source that nothing was added to is a line of the output.
    let lines: Vec<&str> = output.text.lines().collect();
    let changed: Vec<&str> = input.scene.document.json.lines().filter(|line| !lines.contains(line)).collect();
    let touched = [
        "\"asset\"",
        "extensionsUsed",
        "\"main\"",
        "\"b\"",
        "COLOR_0",
        "\"targets\"",
        "\"mappings\"",
        "\"weights\"",
        "\"mode\"",
        "\"red\"",
        "\"variant\"",
        "\"sign\"",
        "\"textures\"",
        "\"images\"",
        "\"buffers\"",
        "\"bufferViews\"",
        "\"accessors\"",
        "]}",
    ];
    for line in &changed {
        assert!(touched.iter().any(|t| line.contains(t)), "changed: {line}");
    }
    assert!(lines.contains(&r#"  "unknownTop": {"big": 12345678901234567890123, "e": 1e5, "s": "\u00e9\/"},"#));
}

fn layout(atlas: &mut Atlas, part: usize) -> &mut Layout {
    std::sync::Arc::make_mut(&mut atlas.parts[part].layout)
}

/// Part 0 and 1 get five output vertices: source vertex 2 is split, vertex 0 comes last.
fn split_atlas(input: &mut Input, charts: [u32; 2], pages: &[u32]) -> Atlas {
    let mut atlas = everything_atlas(input);
    atlas.charts = crate::gltf::atlas(pages, Vec::new()).charts;
    atlas.pages = pages.iter().max().unwrap() + 1;
    let source_vertex = vec![1, 2, 2, 3, 0];
    let uv = (0..5).map(|v| Vec2::new(v as f32, 0.5)).collect::<Vec<_>>();
    for part in 0..2 {
        let triangles = if part == 0 { vec![[4, 0, 1], [4, 2, 3]] } else { vec![[4, 1, 0], [4, 3, 2]] };
        let (source_vertex, uv) = (source_vertex.clone(), uv.clone());
        let layout = Layout { source_vertex, uv, triangles, chart: charts.to_vec(), vertex_chart: vec![] };
        atlas.parts[part] = ChartedPart::on_page(layout);
    }
    atlas
}

#[test]
fn split_vertices_take_all_their_attributes_along() {
    let mut input = everything_input(true);
    let atlas = split_atlas(&mut input, [0, 0], &[0, 0, 1]);
    let (output, warnings) = bake(&input, &atlas, "split.glb");
    assert!(warnings.is_empty(), "{warnings:?}");
    let old: Value = serde_json::from_str(&input.scene.document.json).unwrap();
    let (before, after) = (&old["meshes"][0]["primitives"][0], &output.json["meshes"][0]["primitives"][0]);
    let pairs = before["attributes"].as_object().unwrap().iter().map(|(k, v)| (k, v, &after["attributes"][k]));
    let target = (&"target".to_owned(), &before["targets"][0]["POSITION"], &after["targets"][0]["POSITION"]);
    for (name, source, new) in pairs.chain([target]) {
        assert_ne!(source, new, "{name}");
        let source_elements = output.elements(source);
        let expected: Vec<_> = [1, 2, 2, 3, 0].iter().map(|&v: &usize| source_elements[v].clone()).collect();
        assert_eq!(output.elements(new), expected, "{name}");
        let of = |i: &Value| output.json["accessors"][i.as_u64().unwrap() as usize].clone();
        for key in ["componentType", "type", "normalized", "name", "extras"] {
            assert_eq!(of(source)[key], of(new)[key], "{name} {key}");
        }
        assert!(of(new).get("sparse").is_none());
    }
    let position = &output.json["accessors"][after["attributes"]["POSITION"].as_u64().unwrap() as usize];
    assert_eq!(position["max"], json!([1.7f32, 1.3f32, 0.0]));
    assert_eq!(output.indices(&after["indices"]), [4, 0, 1, 4, 2, 3]);
    // The mirrored instance is split alike: its winding is turned back, and it shares all but TEXCOORD_1.
    let mut mirrored = output.json["meshes"][2]["primitives"][0].clone();
    assert_ne!(mirrored["attributes"]["TEXCOORD_1"], after["attributes"]["TEXCOORD_1"]);
    mirrored["attributes"]["TEXCOORD_1"] = after["attributes"]["TEXCOORD_1"].clone();
    assert_eq!(&mirrored, after);
}

#[test]
fn a_primitive_on_two_pages_becomes_two() {
    let mut input = everything_input(true);
    let mut atlas = split_atlas(&mut input, [1, 0], &[0, 1, 1]);
    layout(&mut atlas, 1).chart = vec![NO_CHART, 1];
    let (output, _) = bake(&input, &atlas, "pages.glb");
    let j = &output.json;
    let primitives = j["meshes"][0]["primitives"].as_array().unwrap();
    assert_eq!(primitives.len(), 2);
    assert_eq!(primitives[0]["attributes"], primitives[1]["attributes"]);
    assert_eq!(output.indices(&primitives[0]["indices"]), [4, 2, 3], "page 0");
    assert_eq!(output.indices(&primitives[1]["indices"]), [4, 0, 1], "page 1");
    for (page, primitive) in primitives.iter().enumerate() {
        let material = &j["materials"][primitive["material"].as_u64().unwrap() as usize];
        assert_eq!(material["extensions"]["MOZ_lightmap"]["index"], 1 + page);
        assert_eq!(material["name"], "red");
        let mapping = &primitive["extensions"]["KHR_materials_variants"]["mappings"][0];
        let variant = &j["materials"][mapping["material"].as_u64().unwrap() as usize];
        assert_eq!((&variant["name"], &mapping["variants"]), (&json!("variant"), &json!([0])));
        assert_eq!(variant["extensions"]["MOZ_lightmap"]["index"], 1 + page);
    }
    // A triangle without a chart stays with its neighbours.
    let mirrored = j["meshes"][2]["primitives"].as_array().unwrap();
    assert_eq!(mirrored.len(), 1);
    assert_eq!(output.indices(&mirrored[0]["indices"]), [4, 0, 1, 4, 2, 3]);
}

#[test]
fn strips_that_are_split_become_triangles() {
    let mut input = everything_input(false);
    let mut atlas = everything_atlas(&mut input);
    let strip = layout(&mut atlas, 2);
    strip.source_vertex = vec![0, 1, 3, 2, 1];
    strip.uv.push(Vec2::ONE);
    strip.triangles = vec![[0, 1, 2], [2, 4, 3]];
    let (output, _) = bake(&input, &atlas, "strip.gltf");
    let bare = &output.json["meshes"][1]["primitives"][0];
    assert_eq!(bare["mode"], 4);
    assert_eq!(output.indices(&bare["indices"]), [0, 1, 2, 2, 4, 3]);
    assert_eq!(output.floats(&bare["attributes"]["TEXCOORD_0"]).len(), 5);
}

/// One quad with a `TEXCOORD_1` at `uv`, and a material with `occlusion` on `TEXCOORD_1` or without.
fn with_uv1(occlusion: bool, receives_elsewhere: bool) -> Input {
    let mut b = Builder::default();
    let position = b.floats("VEC3", &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 0.0]);
    let uv0 = b.floats("VEC2", &[0.0; 8]);
    let uv1 = b.floats("VEC2", &[0.25, 0.25, 0.75, 0.25, 0.75, 0.75, 0.25, 0.75]);
    let indices = b.shorts(&[0, 1, 2, 0, 2, 3]);
    let material = if occlusion {
        json!({"name": "m", "occlusionTexture": {"index": 0, "texCoord": 1}})
    } else {
        json!({"name": "m", "extensions": {"MOZ_lightmap": {"index": 0, "texCoord": 1, "intensity": 2}}})
    };
    let nodes = if receives_elsewhere { json!([{"mesh": 0}]) } else { json!([{"mesh": 0}, {"mesh": 0}]) };
    let roots: Vec<usize> = (0..nodes.as_array().unwrap().len()).collect();
    let document = json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": roots, "extras": "text"}], "nodes": nodes,
        "extensionsUsed": ["MOZ_lightmap"],
        "meshes": [{"primitives": [{"attributes": {"POSITION": position, "TEXCOORD_0": uv0, "TEXCOORD_1": uv1},
            "indices": indices, "material": 0}]}],
        "materials": [material], "textures": [{"source": 0}], "images": [{"uri": "t%20ex.png"}],
        "buffers": [{"uri": "data.bin", "byteLength": b.bin.len()}], "bufferViews": b.views, "accessors": b.accessors
    });
    let parts: Vec<_> = roots.iter().map(|&node| (node, 0, 0)).collect();
    let mut input = input(&document.to_string(), &b.bin, false, &parts);
    input.scene.parts.truncate(1);
    input
}

fn kept_atlas(input: &Input, scale: f32) -> Atlas {
    let mut atlas = atlas(&[0], vec![unsplit(4, &QUAD, 0)]);
    atlas.parts[0].kept = true;
    layout(&mut atlas, 0).uv =
        input.scene.vertices.uv[1][..4].iter().map(|uv| *uv * Vec2::new(64.0, 32.0) * scale).collect();
    atlas
}

#[test]
fn kept_coordinates_are_shared_where_they_lie_right_and_moved_where_not() {
    let input = with_uv1(false, true);
    let before: Value = serde_json::from_str(&input.scene.document.json).unwrap();
    let old = before["meshes"][0]["primitives"][0]["attributes"].clone();
    let (same, warnings) = bake(&input, &kept_atlas(&input, 1.0), "same.gltf");
    assert_eq!(same.json["meshes"][0]["primitives"][0]["attributes"], old);
    assert_eq!(same.json["accessors"], before["accessors"]);
    assert_eq!(warnings, ["scene-extras"]);
    let (moved, _) = bake(&input, &kept_atlas(&input, 0.5), "moved.gltf");
    let attributes = &moved.json["meshes"][0]["primitives"][0]["attributes"];
    assert_eq!(moved.floats(&attributes["TEXCOORD_1"])[2], [0.375, 0.375]);
    // The lightmap of an earlier bake is replaced, and the extension is listed once.
    assert_eq!(moved.json["materials"][0]["extensions"]["MOZ_lightmap"]["index"], 1);
    assert_eq!(moved.json["extensionsUsed"], json!(["MOZ_lightmap"]));
}

#[test]
fn a_document_without_scenes_gets_one_of_what_was_baked() {
    let mut input = with_uv1(false, true);
    let mut document: Value = serde_json::from_str(&input.scene.document.json).unwrap();
    let count = document["nodes"].as_array().unwrap().len();
    document["nodes"][count - 1]["children"] = json!([count]);
    document["nodes"].as_array_mut().unwrap().push(json!({"name": "child"}));
    document.as_object_mut().unwrap().remove("scenes");
    document.as_object_mut().unwrap().remove("scene");
    input.scene.document.json = document.to_string();
    let (output, warnings) = bake(&input, &kept_atlas(&input, 1.0), "unseen.gltf");
    assert_eq!(warnings, [""; 0]);
    assert_eq!(output.json["scene"], 0);
    assert_eq!(output.json["scenes"].as_array().unwrap().len(), 1);
    assert_eq!(output.json["scenes"][0]["nodes"], json!((0..count).collect::<Vec<_>>()));
    assert_eq!(output.json["scenes"][0]["extras"]["lightmap"]["pages"][0]["uri"], "unseen.lightmap0.exr");
}

#[test]
fn textures_on_texcoord_1_keep_it() {
    let input = with_uv1(true, true);
    let (output, warnings) = bake(&input, &kept_atlas(&input, 0.5), "ao.gltf");
    assert_eq!(warnings, ["lightmap-uv-set", "scene-extras"]);
    let attributes = &output.json["meshes"][0]["primitives"][0]["attributes"];
    assert_eq!(attributes["TEXCOORD_1"], 2);
    assert_eq!(output.floats(&attributes["TEXCOORD_2"])[2], [0.375, 0.375]);
    assert_eq!(output.json["materials"][0]["extensions"]["MOZ_lightmap"]["texCoord"], 2);
}

#[test]
fn what_an_unbaked_node_uses_stays_as_it_is() {
    let input = with_uv1(true, false);
    let (output, _) = bake(&input, &kept_atlas(&input, 0.5), "half.gltf");
    let before: Value = serde_json::from_str(&input.scene.document.json).unwrap();
    let nodes = [&output.json["nodes"][0]["mesh"], &output.json["nodes"][1]["mesh"]];
    assert_eq!(nodes, [&json!(1), &json!(0)]);
    assert_eq!(output.json["meshes"][0], before["meshes"][0]);
    assert_eq!(output.json["materials"][0], before["materials"][0]);
    assert_eq!(output.json["meshes"][1]["primitives"][0]["material"], 1);
}

#[test]
fn without_light_only_the_generator_changes() {
    let input = everything_input(true);
    let parts = (0..4).map(|_| unsplit(4, &QUAD, NO_CHART)).collect();
    let (output, _) = bake(&input, &atlas(&[], parts), "dark.glb");
    let expected = input.scene.document.json.replace("\"by hand\"", "\"by hand; texelwalk 0.1.0\"");
    assert_eq!(output.text.trim_end(), expected);
    assert_eq!(output.buffers, input.scene.document.buffers);
}

#[test]
fn atlases_that_do_not_fit_are_refused() {
    let mut input = everything_input(true);
    let good = everything_atlas(&mut input);
    let breaks: [fn(&mut Atlas); 6] = [
        |a| a.parts.truncate(3),
        |a| layout(a, 0).triangles[0][1] = 4,
        |a| layout(a, 0).chart[0] = 3,
        |a| a.charts[0].page = 2,
        |a| layout(a, 0).uv[0].x = f32::NAN,
        |a| layout(a, 0).source_vertex[3] = 99,
    ];
    for (i, spoil) in breaks.iter().enumerate() {
        let mut atlas = everything_atlas(&mut input);
        spoil(&mut atlas);
        let output = input.folder.path().join("x.glb");
        let settings = Settings {
            quantity: Quantity::Irradiance,
            output: output.clone(),
            generator: "t".into(),
            quantize_uv: false,
        };
        assert!(write_gltf(&input.scene, &atlas, &page_files(&output, 2), &settings).is_err(), "{i}");
        assert!(write_gltf(&input.scene, &good, &page_files(&output, 1), &settings).is_err());
    }
}
