//! What surfaces let through: alpha without colour, `KHR_materials_transmission` with it; and what they reflect then.

use crate::gltf_builder::Builder;
use crate::gltf_builder::words;
use crate::solve::Stage;
use glam::Vec3;
use serde_json::Value;
use serde_json::json;
use std::path::Path;
use texelwalk::base::Rgb;
use texelwalk::patches::Tilts;
use texelwalk::scene::Scene;
use texelwalk::scene::Settings;
use texelwalk::scene::Sky;
use texelwalk::scene::load_bytes;
use texelwalk::trace::{Ray, Tracer};
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
    let black = vec![Rgb::ZERO; stage.patches.len()];
    let sky = |_: usize, _: Vec3, direction: Vec3| scene.light_from_infinity(direction);
    let [a, _] = stage.gather(&black, &Tilts::default(), Some(&sky), 64, 3);
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

/// A coloured body: a tenth of a metre leaves the square root of this colour.
const COLOR: [f32; 3] = [0.9, 0.5, 0.1];

fn body(thickness: f32) -> Value {
    let mut out = glass([1.0; 3], 1.0, &json!({}));
    out["extensions"]["KHR_materials_volume"] =
        json!({"thicknessFactor": thickness, "attenuationDistance": 0.2, "attenuationColor": COLOR});
    out
}

fn left(metres: f32) -> Rgb {
    Rgb::from_array(COLOR.map(|c| libm::powf(c, metres / 0.2)))
}

/// A box around (0, y, 0) of material 1, as one primitive; `inside_out` turns its faces inward.
fn block(b: &mut Builder, half: f32, [low, high]: [f32; 2], inside_out: bool) {
    let corner = |k: u16| {
        [
            if k & 1 == 0 { -half } else { half },
            if k & 2 == 0 { low } else { high },
            if k & 4 == 0 { -half } else { half },
        ]
    };
    let position = b.floats("VEC3", &(0..8).flat_map(corner).collect::<Vec<f32>>());
    let quads = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let mut indices: Vec<u16> = quads.iter().flat_map(|q| [q[0], q[1], q[2], q[0], q[2], q[3]]).collect();
    if inside_out {
        indices.reverse();
    }
    let indices = b.accessor(5123, "SCALAR", 36, &words(&indices), json!({}));
    let mesh = b.push(
        "meshes",
        json!({"primitives": [{"attributes": {"POSITION": position}, "indices": indices, "material": 1}]}),
    );
    b.push("nodes", json!({"mesh": mesh}));
}

fn floor_under_block(inside_out: bool) -> Builder {
    let mut b = Builder::new();
    b.push("materials", json!({"pbrMetallicRoughness": {"metallicFactor": 0}}));
    b.push("materials", body(1.0));
    rectangle(&mut b, level(1.0, 0.0), 0);
    block(&mut b, 8.0, [1.0, 1.1], inside_out);
    b
}

/// Light on the floor by a sun of 1 lx at an angle from the zenith.
fn sunlit_at(mut b: Builder, angle: f32) -> Rgb {
    b.json["extensionsUsed"] = json!(["KHR_lights_punctual"]);
    b.json["extensions"] = json!({"KHR_lights_punctual": {"lights": [{"type": "directional", "intensity": 1.0}]}});
    let turn = glam::Quat::from_rotation_z(angle) * glam::Quat::from_rotation_x(-std::f32::consts::FRAC_PI_2);
    b.push("nodes", json!({"rotation": turn.to_array(), "extensions": {"KHR_lights_punctual": {"light": 0}}}));
    let scene = scene(&b, &Settings::default());
    let stage = Stage::new(&scene, 8.0);
    floor_mean(&stage, &stage.direct(16))
}

#[test]
fn a_slab_of_coloured_glass_tints_the_sun_by_the_way_through_it() {
    for (angle, inside_out) in [(0.0f32, false), (0.5, false), (1.0, false), (0.5, true)] {
        let cos = libm::cosf(angle);
        let found = sunlit_at(floor_under_block(inside_out), angle);
        let expected = left(0.1 / cos) * cos;
        near(found, expected, 0.005);
    }
}

#[test]
fn what_is_not_closed_takes_what_its_thickness_says() {
    near(sunlit_at(under(body(0.1), None), 0.7), left(0.1) * libm::cosf(0.7), 0.005);
    near(sunlit_at(under(body(0.0), None), 0.0), Rgb::ONE, 0.005);
    let mut twice = under(body(0.1), None);
    twice.set("/nodes/1/scale", json!([2, 2, 2]));
    near(sunlit_at(twice, 0.0), left(0.2), 0.005);
    let mut textured = body(0.2);
    textured["extensions"]["KHR_materials_volume"]["thicknessTexture"] = json!({"index": 0});
    near(sunlit_at(under(textured, Some((1, &[[0, 51, 255, 255]]))), 0.0), left(0.04), 0.005);
    // Without a distance nothing is taken.
    let mut clear = body(0.1);
    clear["extensions"]["KHR_materials_volume"].as_object_mut().unwrap().remove("attenuationDistance");
    near(sunlit_at(under(clear, None), 0.0), Rgb::ONE, 0.005);
}

#[test]
fn rays_into_out_of_and_along_edges_of_solids() {
    let scene = scene(&floor_under_block(false), &Settings::default());
    let tracer = Tracer::new(&scene);
    let ask = |origin: [f32; 3], direction: [f32; 3], t_max: f32, metres: f32| {
        let ray = Ray { origin: Vec3::from_array(origin), direction: Vec3::from_array(direction), t_max };
        for (how, found) in [("shadow ray", tracer.unblocked(&ray, None)), ("path", tracer.tint(&ray))] {
            let off = (found - left(metres)).abs().max_element();
            assert!(off < 1e-4, "{how} from {origin:?}: {found} instead of {}", left(metres));
        }
    };
    // Through the diagonals of top and bottom, upward without an end, at a length of the direction other than 1.
    ask([0.0, 0.5, 0.0], [0.0, 1.0, 0.0], f32::INFINITY, 0.1);
    ask([0.0, 0.5, 0.0], [0.0, 4.0, 0.0], f32::INFINITY, 0.1);
    ask([1.0, 2.0, 0.3], [0.0, -1.0, 0.0], 1.5, 0.1);
    // Begins inside, ends inside, both, neither.
    ask([0.4, 1.04, 0.7], [0.0, 1.0, 0.0], 5.0, 0.06);
    ask([0.4, 2.0, 0.7], [0.0, -1.0, 0.0], 0.97, 0.07);
    ask([0.4, 1.02, 0.7], [1.0, 0.0, 0.0], 0.5, 0.0);
    ask([0.4, 0.2, 0.7], [0.0, 1.0, 0.0], 0.5, 0.0);
}

/// The shadow of half a plane of tinted glass: its edge divides a column of texels, wherever in it it lies.
#[test]
fn edges_of_tinted_shadows_divide_texels() {
    for cut in [0.05f32, 0.2, 0.4, 0.6, 0.8, 0.95] {
        let mut b = Builder::new();
        b.push("materials", json!({"pbrMetallicRoughness": {"metallicFactor": 0}}));
        b.push("materials", glass([0.8, 0.8, 0.8], 0.5, &json!({})));
        rectangle(&mut b, level(1.0, 0.0), 0);
        let edge = cut / 16.0;
        rectangle(&mut b, [[-4.0, 1.0, 4.0], [edge, 1.0, 4.0], [edge, 1.0, -4.0], [-4.0, 1.0, -4.0]], 1);
        shine(&mut b);
        let scene = scene(&b, &Settings::default());
        let stage = Stage::new(&scene, 16.0);
        let light = stage.direct(64);
        let mut found = vec![];
        for (at, light) in stage.patches.position.iter().zip(&light).take(stage.patches.front) {
            let (x, inside) = (at.x * 16.0, at.y < 0.1 && at.x.abs() < 0.9 && at.z.abs() < 0.9);
            let expected = if inside && (0.0..1.0).contains(&x) {
                1.0 - 0.6 * cut
            } else if x < 0.0 {
                0.4
            } else {
                1.0
            };
            if inside {
                assert!((light.x - expected).abs() < 0.05, "{} at x = {x} texels instead of {expected}", light.x);
                found.extend((0.0..1.0).contains(&x).then_some(light.x));
            }
        }
        let mean = found.iter().sum::<f32>() / found.len() as f32;
        assert!(
            found.len() > 20 && (mean - (1.0 - 0.6 * cut)).abs() < 0.01,
            "{} texels, {mean} for {cut}",
            found.len()
        );
    }
}
