//! What surfaces let through: alpha without colour, `KHR_materials_transmission` with it; and what they reflect then.

#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "support/gltf_builder.rs"]
mod gltf_builder;
#[path = "support/solve.rs"]
mod solve;

use glam::Vec3;
use gltf_builder::Builder;
use gltf_builder::words;
use serde_json::Value;
use serde_json::json;
use solve::Stage;
use std::path::Path;
use texelwalk::base::Progress;
use texelwalk::base::Rgb;
use texelwalk::gather;
use texelwalk::patches::Tilts;
use texelwalk::scene::Scene;
use texelwalk::scene::Settings;
use texelwalk::scene::Sky;
use texelwalk::scene::load_bytes;
use texelwalk::walk::Splat;

/// Corners of rectangles, front toward (b − a) × (d − a), with `TEXCOORD_0` from (0, 0) to (1, 1).
fn rectangle(b: &mut Builder, corners: [[f32; 3]; 4], material: usize) {
    let position = b.floats("VEC3", corners.as_flattened());
    let uv = b.floats("VEC2", &[0., 0., 1., 0., 1., 1., 0., 1.]);
    let indices = b.accessor(5123, "SCALAR", 6, &words(&[0, 1, 2, 0, 2, 3]), json!({}));
    let primitive =
        json!({"attributes": {"POSITION": position, "TEXCOORD_0": uv}, "indices": indices, "material": material});
    let mesh = b.push("meshes", json!({"primitives": [primitive]}));
    b.push("nodes", json!({"mesh": mesh}));
}

/// A level square around (0, height, 0), front up.
fn level(half: f32, height: f32) -> [[f32; 3]; 4] {
    let h = half;
    [[-h, height, h], [h, height, h], [h, height, -h], [-h, height, -h]]
}

fn scene(b: &Builder, settings: &Settings) -> Scene {
    let loaded = load_bytes(b.gltf(), Path::new("a.gltf"), settings).unwrap();
    assert_eq!(loaded.warnings, []);
    loaded.output
}

/// A floor of 4 m² under a sheet of 64 m².
fn under(sheet: Value, texture: Option<(u32, &[[u8; 4]])>) -> Builder {
    let mut b = Builder::new();
    b.push("materials", json!({"pbrMetallicRoughness": {"metallicFactor": 0}}));
    b.push("materials", sheet);
    rectangle(&mut b, level(1.0, 0.0), 0);
    rectangle(&mut b, level(4.0, 1.0), 1);
    if let Some((width, pixels)) = texture {
        b.texture(width, pixels);
        b.push("samplers", json!({"magFilter": 9728}));
        b.json["textures"][0]["sampler"] = json!(0);
    }
    b
}

/// Light on the floor, by a sun of 1 lx overhead.
fn sunlit(mut b: Builder) -> Rgb {
    shine(&mut b);
    let scene = scene(&b, &Settings::default());
    let stage = Stage::new(&scene, 16.0);
    floor_mean(&stage, &stage.direct(64))
}

/// A sun overhead.
fn shine(b: &mut Builder) {
    b.json["extensionsUsed"] = json!(["KHR_lights_punctual"]);
    b.json["extensions"] = json!({"KHR_lights_punctual": {"lights": [{"type": "directional", "intensity": 1.0}]}});
    let down =
        json!({"rotation": [-0.707_106_77, 0, 0, 0.707_106_77], "extensions": {"KHR_lights_punctual": {"light": 0}}});
    b.push("nodes", down);
}

fn floor_mean(stage: &Stage<'_>, values: &[Rgb]) -> Rgb {
    let floor = |i: &usize| stage.patches.position[*i].abs().cmplt(Vec3::new(1.1, 0.1, 1.1)).all();
    let (mut sum, mut count) = (Rgb::ZERO, 0.0);
    for i in (0..stage.patches.front).filter(floor) {
        (sum, count) = (sum + values[i], count + 1.0);
    }
    assert!(count > 200.0);
    sum / count
}

fn near(found: Rgb, expected: Rgb, part: f32) {
    let off = (found - expected).abs();
    assert!(off.cmple(expected.abs() * part + 1e-4).all(), "{found} instead of {expected}");
}

const CHECKER: [[u8; 4]; 4] = [[255, 255, 255, 255], [255, 255, 255, 0], [255, 255, 255, 0], [255, 255, 255, 255]];

/// Squares come in `pairs` along each edge.
fn checkered(mode: &str, factor: f32, pairs: u32) -> Value {
    let scale = json!({"KHR_texture_transform": {"scale": [pairs, pairs]}});
    json!({"alphaMode": mode, "pbrMetallicRoughness": {"metallicFactor": 0, "baseColorFactor": [1, 1, 1, factor],
        "baseColorTexture": {"index": 0, "extensions": scale}}})
}

#[test]
fn a_checkerboard_of_alpha_transmits_half() {
    let found = sunlit(under(checkered("MASK", 1.0, 32), Some((2, &CHECKER))));
    near(found, Rgb::splat(0.5), 0.01);
    let found = sunlit(under(checkered("BLEND", 1.0, 32), Some((2, &CHECKER))));
    near(found, Rgb::splat(0.5), 0.01);
    let found = sunlit(under(checkered("BLEND", 0.5, 32), Some((2, &CHECKER))));
    near(found, Rgb::splat(0.75), 0.01);
}

fn glass(color: [f32; 3], transmission: f32, more: &Value) -> Value {
    let [r, g, b] = color;
    let mut out = json!({"extensions": {"KHR_materials_transmission": {"transmissionFactor": transmission}},
        "pbrMetallicRoughness": {"metallicFactor": 0, "baseColorFactor": [r, g, b, 1]}});
    for (key, value) in more.as_object().unwrap() {
        out[key] = value.clone();
    }
    out
}

#[test]
fn blend_has_no_colour_and_glass_has() {
    let veil = json!({"alphaMode": "BLEND", "pbrMetallicRoughness": {"metallicFactor": 0, "baseColorFactor": [0.9, 0.5, 0.1, 0.3]}});
    near(sunlit(under(veil, None)), Rgb::splat(0.7), 0.01);
    let color = [0.9, 0.5, 0.1];
    near(sunlit(under(glass(color, 0.8, &json!({})), None)), Rgb::new(0.72, 0.4, 0.08), 0.01);
    near(sunlit(under(glass(color, 1.0, &json!({})), None)), Rgb::from_array(color), 0.01);
    // Half of the light goes past the glass, half through it.
    let half = json!({"alphaMode": "BLEND", "pbrMetallicRoughness": {"metallicFactor": 0, "baseColorFactor": [0.9, 0.5, 0.1, 0.5]}});
    near(sunlit(under(glass(color, 0.8, &half), None)), Rgb::new(0.86, 0.7, 0.54), 0.01);
    let metal = json!({"pbrMetallicRoughness": {"metallicFactor": 0.25, "baseColorFactor": [0.9, 0.5, 0.1, 1]}});
    near(sunlit(under(glass(color, 0.8, &metal), None)), Rgb::new(0.54, 0.3, 0.06), 0.01);
}

#[test]
fn a_texture_says_where_light_passes() {
    let mut sheet = glass([0.9, 0.5, 0.1], 0.8, &json!({}));
    let scale = json!({"KHR_texture_transform": {"scale": [32, 32]}});
    sheet["extensions"]["KHR_materials_transmission"]["transmissionTexture"] = json!({"index": 0, "extensions": scale});
    let pixels = [[255, 9, 9, 255], [0, 99, 9, 255], [0, 9, 99, 255], [255, 9, 9, 255]];
    near(sunlit(under(sheet, Some((2, &pixels)))), Rgb::new(0.36, 0.2, 0.04), 0.01);
}

/// Two panes one above the other: tints multiply, and what neither lets pass does not.
#[test]
fn panes_multiply() {
    let mut b = under(glass([0.9, 0.5, 0.0], 1.0, &json!({})), None);
    b.push("materials", glass([0.5, 0.8, 0.7], 0.5, &json!({})));
    rectangle(&mut b, level(4.0, 2.0), 2);
    near(sunlit(b), Rgb::new(0.9 * 0.25, 0.5 * 0.4, 0.0), 0.01);
}

/// A sky of radiance 1 around everything: what shadow rays and gather rays find through glass agrees with the integral.
#[test]
fn every_kind_of_ray_sees_the_same_colour() {
    let color = [0.9, 0.5, 0.1];
    let mut b = under(glass(color, 0.8, &json!({})), None);
    // Panes all around, so that no light comes past them: a closed case.
    let (l, h) = (4.0, 1.0);
    for [a, c] in [[[-l, l], [l, l]], [[l, l], [l, -l]], [[l, -l], [-l, -l]], [[-l, -l], [-l, l]]] {
        rectangle(&mut b, [[a[0], -h, a[1]], [c[0], -h, c[1]], [c[0], h, c[1]], [a[0], h, a[1]]], 1);
    }
    let settings = Settings { sky: Sky::constant(Rgb::ONE), ..Settings::default() };
    let scene = scene(&b, &settings);
    let stage = Stage::new(&scene, 16.0);
    let expected = Rgb::new(0.72, 0.4, 0.08) * core::f32::consts::PI;
    near(floor_mean(&stage, &stage.direct(64)), expected, 0.01);
    let (patches, tracer) = (&stage.patches, &stage.tracer);
    let black = vec![Rgb::ZERO; patches.len()];
    let sky = |_: Vec3, direction: Vec3| scene.light_from_infinity(direction);
    let field = gather::Field {
        tracer,
        patches,
        radiance: [black.as_slice(), black.as_slice()],
        tilts: &Tilts::default(),
        sky: Some(&sky),
        seed: 3,
    };
    let mut gathered = gather::Gathered::new(patches);
    gathered.add(&field, |_| 64, &Progress::default());
    let [a, _] = gathered.halves();
    near(floor_mean(&stage, &a), expected, 0.01);
}

/// A closed box that glows, with walls that reflect half: light is the same everywhere, E = πL with L = e/(1 − ρ). A white
/// sheet in it reflects what it does not let pass, so it changes nothing, whatever it lets pass.
#[test]
fn white_veils_in_a_furnace_change_nothing() {
    let veil = |mode: &str, alpha: f32| json!({"alphaMode": mode, "doubleSided": true, "pbrMetallicRoughness": {"metallicFactor": 0, "baseColorFactor": [1, 1, 1, alpha]}});
    let mut pane = glass([1.0; 3], 0.6, &json!({"doubleSided": true}));
    let mut fence = checkered("MASK", 1.0, 8);
    fence["doubleSided"] = json!(true);
    pane["name"] = json!("pane");
    for (name, sheet) in
        [("opaque", veil("OPAQUE", 1.0)), ("veil", veil("BLEND", 0.5)), ("pane", pane), ("fence", fence)]
    {
        let mut b = Builder::new();
        b.push(
            "materials",
            json!({"emissiveFactor": [0.5, 0.5, 0.5],
            "pbrMetallicRoughness": {"metallicFactor": 0, "baseColorFactor": [0.5, 0.5, 0.5, 1]}}),
        );
        b.push("materials", sheet);
        let [o, e] = [-1.0, 1.0];
        rectangle(&mut b, [[o, o, e], [e, o, e], [e, o, o], [o, o, o]], 0);
        rectangle(&mut b, [[o, e, o], [e, e, o], [e, e, e], [o, e, e]], 0);
        rectangle(&mut b, [[o, o, o], [e, o, o], [e, e, o], [o, e, o]], 0);
        rectangle(&mut b, [[e, o, e], [o, o, e], [o, e, e], [e, e, e]], 0);
        rectangle(&mut b, [[o, o, e], [o, o, o], [o, e, o], [o, e, e]], 0);
        rectangle(&mut b, [[e, o, o], [e, o, e], [e, e, e], [e, e, o]], 0);
        rectangle(&mut b, level(0.6, 0.1), 1);
        b.texture(2, &CHECKER);
        b.json["textures"][0]["sampler"] = json!(0);
        b.push("samplers", json!({"magFilter": 9728}));
        let scene = scene(&b, &Settings::default());
        let stage = Stage::new(&scene, 8.0);
        let direct = stage.direct(64);
        let walk = stage.walk(Some(&direct), Splat::None, 2_000_000, 5);
        let all: Vec<Rgb> = direct.iter().zip(&walk.indirect).map(|(a, b)| *a + *b).collect();
        let expected = core::f64::consts::PI;
        for (what, on_sheet) in [("sheet", true), ("walls", false)] {
            let mean = stage.mean(&all, |i| (stage.patches.position[i].abs().max_element() < 0.9) == on_sheet);
            assert!((mean / expected - 1.0).abs() < 0.01, "{name}, {what}: {mean} instead of {expected}");
        }
    }
}

/// Share of the light of an endless plane that a rectangle from right above a point to (a, b) at height 1 gives.
fn corner_factor(a: f32, b: f32) -> f32 {
    let part = |a: f32, b: f32| a / (1.0 + a * a).sqrt() * (b / (1.0 + a * a).sqrt()).atan();
    (part(a, b) + part(b, a)) / core::f32::consts::TAU
}

/// A sheet under the sun lights what is below as a lamp would, by τ · E and the form factor.
#[test]
fn a_translucent_sheet_lights_its_back() {
    for (double_sided, metallic) in [(true, 0.0), (false, 0.5)] {
        let extension = json!({"KHR_materials_diffuse_transmission": {"diffuseTransmissionFactor": 0.5,
            "diffuseTransmissionColorFactor": [0.8, 0.4, 0.2]}});
        let sheet = json!({"doubleSided": double_sided, "pbrMetallicRoughness": {"metallicFactor": metallic}, "extensions": extension});
        let mut b = under(sheet, None);
        b.json["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] = json!([0, 0, 0, 1]);
        shine(&mut b);
        let scene = scene(&b, &Settings::default());
        let stage = Stage::new(&scene, 8.0);
        let direct = stage.direct(16);
        assert_eq!(floor_mean(&stage, &direct), Rgb::ZERO, "no light goes straight through");
        let walk = stage.walk(Some(&direct), Splat::None, 4_000_000, 5);
        let factors: Vec<Rgb> = (stage.patches.position.iter())
            .map(|p| {
                let (x, z) = ([4.0 + p.x, 4.0 - p.x], [4.0 + p.z, 4.0 - p.z]);
                Rgb::splat(x.iter().flat_map(|&x| z.map(|z| corner_factor(x, z))).sum::<f32>())
            })
            .collect();
        let expected = Rgb::new(0.4, 0.2, 0.1) * (1.0 - metallic) * floor_mean(&stage, &factors);
        near(floor_mean(&stage, &walk.indirect), expected, 0.01);
        let top = (0..stage.patches.front).find(|&i| stage.patches.position[i].y > 0.9).unwrap();
        near(stage.patches.reflectance[top], Rgb::splat(0.5 * (1.0 - metallic)), 1e-5);
    }
}

#[test]
fn specular_and_glossiness_leave_the_rest_to_diffuse() {
    let material = |more: Value| {
        let mut extension = json!({"diffuseFactor": [0.8, 0.4, 0.2, 1], "specularFactor": [0.1, 0.25, 0.05]});
        more.as_object().unwrap().iter().for_each(|(k, v)| extension[k] = v.clone());
        // The fallback must not be read.
        let mut b = Builder::square(json!({"pbrMetallicRoughness": {"baseColorFactor": [0, 0, 1, 1]},
            "extensions": {"KHR_materials_pbrSpecularGlossiness": extension}}));
        b.texture(1, &[[255, 188, 0, 7]]);
        scene(&b, &Settings::default()).reflectance(0, glam::Vec2::splat(0.3))
    };
    near(material(json!({})), Rgb::new(0.6, 0.3, 0.15), 1e-5);
    // 188 is 0.503 in linear light, so the largest channel is 0.1258.
    near(
        material(json!({"specularGlossinessTexture": {"index": 0}})),
        Rgb::new(0.8, 0.4, 0.2) * (1.0 - 0.25 * 0.5029),
        1e-3,
    );
    near(material(json!({"diffuseTexture": {"index": 0}})), Rgb::new(0.6, 0.3 * 0.5029, 0.0), 1e-3);
    let plain = json!({"extensions": {"KHR_materials_pbrSpecularGlossiness": {}}});
    let scene = scene(&Builder::square(plain), &Settings::default());
    assert_eq!(scene.reflectance(0, glam::Vec2::ZERO), Rgb::ZERO, "specular is white by default");
}
