//! Normal maps: which way they bend normals, and the light that a bake finds on them.

use crate::gltf_builder::{Builder, words};
use crate::sealed;
use core::f32::consts::FRAC_1_PI;
use glam::{Quat, Vec2, Vec3};
use serde_json::{Value, json};
use std::path::Path;
use texelwalk::scene::{Scene, Settings, load_bytes};
use texelwalk::settings::Options;

/// Rows down from the upper edge of the picture, as glTF has it.
const UPRIGHT: [[f32; 2]; 4] = [[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]];
/// Colours of normals that are 0.6 to the right, or up, and 0.8 out.
const RIGHT: [u8; 4] = [204, 128, 230, 255];
const UP: [u8; 4] = [128, 204, 230, 255];

/// A square from (0, 0, 0) to (1, 1, 0) that faces +z, under a normal map, placed by a node.
fn square(uv: [[f32; 2]; 4], pixels: &[[u8; 4]], map: &Value, node: &Value) -> Builder {
    let mut b = Builder::new();
    let positions = b.floats("VEC3", &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 0.0]);
    b.json["accessors"][positions]["min"] = json!([0, 0, 0]);
    b.json["accessors"][positions]["max"] = json!([1, 1, 0]);
    let uv = b.floats("VEC2", uv.as_flattened());
    let indices = b.accessor(5123, "SCALAR", 6, &words(&[0, 1, 2, 0, 2, 3]), json!({}));
    let texture = b.texture(pixels.len() as u32, pixels);
    let sampler = b.push("samplers", json!({"magFilter": 9728}));
    b.json["textures"][texture]["sampler"] = json!(sampler);
    let mut info = map.clone();
    info["index"] = json!(texture);
    let material = b.push("materials", json!({"normalTexture": info}));
    let attributes = json!({"POSITION": positions, "TEXCOORD_0": uv});
    b.push("meshes", json!({"primitives": [{"attributes": attributes, "indices": indices, "material": material}]}));
    let mut placed = node.clone();
    placed["mesh"] = json!(0);
    b.push("nodes", placed);
    b.push("scenes", json!({"nodes": [0]}));
    b.json["scene"] = json!(0);
    b
}

fn load(b: &Builder, normal_maps: bool) -> Scene {
    let how = Settings { normal_maps, ..Settings::default() };
    load_bytes(b.glb(&[]), Path::new("square.glb"), &how).unwrap().output
}

fn normal_of(scene: &Scene) -> Vec3 {
    let [a, b] = [0, 1].map(|t| scene.relief_normal_over(t, Vec2::splat(0.3), scene.geometric_normal(t)));
    assert!((a - b).length() < 1e-5 && a.is_normalized(), "{a} {b}");
    a
}

fn normal(uv: [[f32; 2]; 4], color: [u8; 4], map: &Value, node: &Value) -> Vec3 {
    normal_of(&load(&square(uv, &[color], map, node), true))
}

fn assert_close(a: Vec3, b: [f32; 3]) {
    assert!((a - Vec3::from_array(b)).length() < 0.01, "{a} {b:?}");
}

#[test]
fn red_is_right_green_is_up_and_blue_is_out() {
    let plain = json!({});
    assert_close(normal(UPRIGHT, RIGHT, &plain, &plain), [0.6, 0.0, 0.8]);
    assert_close(normal(UPRIGHT, UP, &plain, &plain), [0.0, 0.6, 0.8]);
    assert_close(normal(UPRIGHT, UP, &json!({"scale": 0.5}), &plain), [0.0, 0.351, 0.936]);
    assert_close(normal(UPRIGHT, UP, &json!({"scale": -1}), &plain), [0.0, -0.6, 0.8]);
    assert_close(normal(UPRIGHT, [128, 128, 255, 255], &plain, &plain), [0.0, 0.0, 1.0]);
    // The picture is a mirror image, or lies on its side.
    let mirrored = UPRIGHT.map(|[u, v]| [1.0 - u, v]);
    assert_close(normal(mirrored, RIGHT, &plain, &plain), [-0.6, 0.0, 0.8]);
    assert_close(normal(mirrored, UP, &plain, &plain), [0.0, 0.6, 0.8]);
    // u grows upward, v to the right: the picture's right is up, its upper edge left.
    let turned = [[0.0, 0.0], [0.0, 1.0], [1.0, 1.0], [1.0, 0.0]];
    assert_close(normal(turned, RIGHT, &plain, &plain), [0.0, 0.6, 0.8]);
    assert_close(normal(turned, UP, &plain, &plain), [-0.6, 0.0, 0.8]);
    // The same by the texture's transform, of which u' is v and v' is −u for a quarter turn.
    let quarter = json!({"extensions": {"KHR_texture_transform": {"rotation": core::f32::consts::FRAC_PI_2}}});
    assert_close(normal(UPRIGHT, RIGHT, &quarter, &plain), [0.0, -0.6, 0.8]);
}

#[test]
fn nodes_that_turn_stretch_or_mirror_take_the_map_along() {
    let plain = json!({});
    let mirror = json!({"scale": [-2.0, 1.0, 1.0]});
    assert_close(normal(UPRIGHT, RIGHT, &plain, &mirror), [-0.6, 0.0, 0.8]);
    assert_close(normal(UPRIGHT, UP, &plain, &mirror), [0.0, 0.6, 0.8]);
    let lying = json!({"rotation": Quat::from_rotation_x(-core::f32::consts::FRAC_PI_2).to_array()});
    assert_close(normal(UPRIGHT, UP, &plain, &lying), [0.0, 0.8, -0.6]);
}

#[test]
fn what_makes_no_sense_changes_nothing() {
    let plain = json!({});
    assert_eq!(normal([[0.5, 0.5]; 4], RIGHT, &plain, &plain), Vec3::Z);
    assert_eq!(normal(UPRIGHT.map(|[u, _]| [u, 0.0]), RIGHT, &plain, &plain).z.min(0.8), 0.8);
    assert_eq!(normal(UPRIGHT, [204, 128, 20, 255], &plain, &plain), Vec3::Z);
    assert_eq!(normal(UPRIGHT, RIGHT, &json!({"scale": 0}), &plain), Vec3::Z);
    assert!(normal(UPRIGHT, RIGHT, &json!({"scale": 1e30}), &plain).z > 0.0);
    // Where maps are not wanted they are not read, however wrong.
    let b = square(UPRIGHT, &[RIGHT], &json!({"scale": "much"}), &plain);
    assert_eq!(normal_of(&load(&b, false)), Vec3::Z);
    let how = Settings { normal_maps: true, ..Settings::default() };
    let error = load_bytes(b.glb(&[]), Path::new("a.glb"), &how).unwrap_err().to_string();
    assert!(error.contains("normalTexture") && error.contains("scale"), "{error}");
}

/// Mean of the square's texels, and their root mean square difference from it, under a map and some light.
fn baked(pixels: &[[u8; 4]], repeats: f32, light: &dyn Fn(&mut Builder), options: &str) -> (f32, f32) {
    let mut b = square(UPRIGHT.map(|uv| uv.map(|x| x * repeats)), pixels, &json!({}), &json!({}));
    light(&mut b);
    let baked = sealed::bake_glb(&b.glb(&[]), &format!("texels-per-meter = 8\ngather = 64\n{options}"));
    let texels: Vec<f32> =
        baked.outcome.lightmap.pages[0].pixels.iter().filter(|p| p[3] == 1.0).map(|p| p[1]).collect();
    assert!(texels.len() >= 64);
    let mean = texels.iter().sum::<f32>() / texels.len() as f32;
    let square = texels.iter().map(|v| (v - mean).powi(2)).sum::<f32>() / texels.len() as f32;
    (mean, square.sqrt())
}

/// A sun of 100 lx that shines from a direction.
fn sun(b: &mut Builder, from: Vec3) {
    b.json["extensionsUsed"] = json!(["KHR_lights_punctual"]);
    b.json["extensions"] = json!({"KHR_lights_punctual": {"lights": [{"type": "directional", "intensity": 100.0}]}});
    let turn = Quat::from_rotation_arc(Vec3::Z, from).to_array();
    b.push("nodes", json!({"rotation": turn, "extensions": {"KHR_lights_punctual": {"light": 0}}}));
    b.json["scenes"][0]["nodes"] = json!([0, 1]);
}

/// As colours of eight bits have them.
fn decoded(color: [u8; 4]) -> Vec3 {
    Vec3::from_array([color[0], color[1], color[2]].map(|c| f32::from(c) / 127.5 - 1.0)).normalize()
}

#[test]
fn the_sun_on_a_map_of_one_normal_is_its_cosine() {
    let from = Vec3::new(0.3, 0.1, 0.8).normalize();
    for color in [RIGHT, UP, [60, 90, 220, 255]] {
        let (mean, spread) = baked(&[color], 1.0, &|b| sun(b, from), "normal-maps = true");
        let expected = 100.0 * FRAC_1_PI * decoded(color).dot(from);
        assert!((mean / expected - 1.0).abs() < 2e-3 && spread < 2e-3 * expected, "{mean} ± {spread}, {expected}");
        let (plain, _) = baked(&[color], 1.0, &|b| sun(b, from), "");
        assert!((plain / (100.0 * FRAC_1_PI * from.z) - 1.0).abs() < 2e-3, "{plain}");
    }
}

#[test]
fn detail_finer_than_a_texel_becomes_its_mean() {
    // Stripes to the left and to the right, sixteen in a texel; the sun is below the horizon of one kind.
    let stripes = [RIGHT, [51, 128, 230, 255]];
    let from = Vec3::new(0.9, 0.0, 0.436).normalize();
    let expected = stripes.iter().map(|c| decoded(*c).dot(from).max(0.0)).sum::<f32>() * 50.0 * FRAC_1_PI;
    let (mean, spread) = baked(&stripes, 64.0, &|b| sun(b, from), "normal-maps = true\ndirect-samples = 64");
    assert!((mean / expected - 1.0).abs() < 0.01 && spread < 0.05 * expected, "{mean} ± {spread}, {expected}");
}

#[test]
fn of_an_even_sky_a_normal_sees_what_is_above_the_surface() {
    for color in [RIGHT, [20, 128, 180, 255]] {
        let (mean, spread) =
            baked(&[color], 1.0, &|_| (), "normal-maps = true\nsky = [2, 2, 2]\nsky-ground = [2, 2, 2]");
        let expected = 2.0 * (1.0 + decoded(color).z) / 2.0;
        assert!((mean / expected - 1.0).abs() < 0.01 && spread < 0.03 * expected, "{mean} ± {spread}, {expected}");
    }
}

#[test]
fn maps_and_pages_by_normal_exclude_each_other() {
    let wrong = |text: &str| Options::from_toml(text).unwrap().settings().unwrap_err().to_string();
    assert!(wrong("normal-maps = true\ndirectional = \"dominant\"").contains("--directional"));
}
