//! `EXT_lights_image_based`: faces against solid angles, orientation, coefficients, what is refused.

use crate::gltf_builder::{Builder, png, words};
use crate::solve::Stage;
use glam::Vec3;
use serde_json::{Value, json};
use std::f32::consts::{FRAC_1_SQRT_2, PI};
use std::path::Path;
use texelwalk::base::Rgb;
use texelwalk::base::color::linear_to_srgb;
use texelwalk::scene::{Error, Scene, Settings, Sky, load_bytes};

const AXES: [Vec3; 6] = [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z];

/// A floor of 2 × 2 m that faces up, with faces as RGBD pictures, top row first; none: no level 0.
fn document(faces: &[Vec<[u8; 4]>], more: Value) -> Builder {
    let mut b = Builder::new();
    let position = b.floats("VEC3", &[0., 0., 0., 0., 0., 2., 2., 0., 2., 2., 0., 0.]);
    let indices = b.accessor(5123, "SCALAR", 6, &words(&[0, 1, 2, 0, 2, 3]), json!({}));
    b.push("meshes", json!({"primitives": [{"attributes": {"POSITION": position}, "indices": indices}]}));
    b.push("nodes", json!({"mesh": 0}));
    let mut level = vec![];
    for face in faces {
        let size = (face.len() as f64).sqrt() as u32;
        let view = b.view(&png(size, face), json!({}));
        level.push(b.push("images", json!({"bufferView": view, "mimeType": "image/png"})));
    }
    let mut light = json!({"irradianceCoefficients": [], "specularImageSize": 1});
    light["specularImages"] = if level.is_empty() { json!([]) } else { json!([level]) };
    more.as_object().unwrap().iter().for_each(|(key, value)| light[key] = value.clone());
    b.json["extensionsUsed"] = json!(["EXT_lights_image_based"]);
    b.json["extensions"] = json!({"EXT_lights_image_based": {"lights": [light]}});
    b.push("scenes", json!({"nodes": [0], "extensions": {"EXT_lights_image_based": {"light": 0}}}));
    b
}

fn load_with(b: &Builder, settings: &Settings) -> Result<Scene, Error> {
    let loaded = load_bytes(b.glb(&[]), Path::new("/nowhere/a.glb"), settings)?;
    assert_eq!(loaded.warnings, []);
    Ok(loaded.output)
}

fn load(b: &Builder) -> Scene {
    load_with(b, &Settings::default()).unwrap()
}

/// Light on the floor.
fn irradiance(b: &Builder) -> Rgb {
    let scene = load(b);
    let stage = Stage::new(&scene, 8.0);
    let direct = stage.direct(256);
    direct.iter().take(stage.patches.front).fold(Rgb::ZERO, |a, e| a + *e) / stage.patches.front as f32
}

fn near(found: Rgb, expected: Rgb, part: f32) {
    assert!((found - expected).abs().cmple(expected.abs() * part + 1e-3).all(), "{found} instead of {expected}");
}

/// Faces of one pixel.
fn even(values: [[u8; 4]; 6]) -> Vec<Vec<[u8; 4]>> {
    values.map(|v| vec![v]).to_vec()
}

#[test]
fn even_faces_give_pi_times_their_radiance() {
    near(irradiance(&document(&even([[255; 4]; 6]), json!({"intensity": 2.0}))), Rgb::splat(2.0 * PI), 2e-3);
    // RGBD: sRGB 188 is 0.5029 linear, over a quarter.
    let rgbd = document(&even([[188, 255, 0, 64]; 6]), json!({}));
    near(irradiance(&rgbd), Rgb::new(0.502_886, 1.0, 0.0) * (PI * 255.0 / 64.0), 3e-3);
}

#[test]
fn every_face_looks_to_its_axis_and_their_light_adds_up() {
    let mut sum = Rgb::ZERO;
    for (bright, axis) in AXES.into_iter().enumerate() {
        let mut faces = [[0, 0, 0, 255]; 6];
        faces[bright] = [255; 4];
        let b = document(&even(faces), json!({}));
        let map = load(&b).environment.unwrap();
        for other in AXES {
            let off = other.any_orthonormal_vector() * 0.1;
            assert_eq!(map.radiance((other + off).normalize()).x > 0.5, other == axis, "face {bright} at {other}");
        }
        let light = irradiance(&b);
        assert_eq!(light.x > 0.1, axis.y >= 0.0, "face {bright}: {light}");
        sum += light;
        // A quarter turn counter-clockwise as seen from above takes +x to −z.
        let turned = document(&even(faces), json!({"rotation": [0, FRAC_1_SQRT_2, 0, FRAC_1_SQRT_2]}));
        let to = Vec3::new(axis.z, axis.y, -axis.x);
        assert!(load(&turned).environment.unwrap().radiance(to) == Rgb::ONE, "face {bright} turned to {to}");
    }
    near(sum, Rgb::splat(PI), 5e-3);
}

/// Each face as the eye in the middle of the cube sees it: where its upper left pixel is.
#[test]
fn faces_are_seen_from_inside() {
    let corners = [[1, 1, -1], [-1, 1, 1], [1, 1, 1], [1, -1, -1], [1, 1, 1], [-1, 1, -1]];
    // Upper left for the axes: left of +x is −z, of −x +z, of +z +x, of −z −x; over the head, top is −z and left +x.
    let corners = corners.map(|c| Vec3::from_array(c.map(|v| v as f32)));
    for face in 0..6 {
        let mut faces = vec![vec![[0, 0, 0, 255]; 16]; 6];
        faces[face][0] = [255; 4];
        let map = load(&document(&faces, json!({}))).environment.unwrap();
        let mut corner = corners[face];
        if face == 2 {
            corner = Vec3::new(1.0, 1.0, -1.0);
        } else if face == 3 {
            corner = Vec3::new(1.0, -1.0, 1.0);
        }
        let inward = (corner - AXES[face]) * 0.75 + AXES[face];
        assert_eq!(map.radiance(inward.normalize()), Rgb::ONE, "face {face} at {inward}");
    }
}

/// L(d) = 1 + 0.5 y + 0.3 x, of which E(n) = π + 2π/3 (0.5 n.y + 0.3 n.x).
#[test]
fn coefficients_and_level_0_of_a_smooth_light_agree() {
    let face = |axis: usize| {
        let (middle, up) = (AXES[axis], [Vec3::Y, Vec3::Y, Vec3::NEG_Z, Vec3::Z, Vec3::Y, Vec3::Y][axis]);
        let pixel = |k: usize| {
            let at = |i: usize| (i as f32 + 0.5) / 16.0 - 1.0;
            let d = (middle + middle.cross(up) * at(k % 32) - up * at(k / 32)).normalize();
            let value = (linear_to_srgb((1.0 + 0.5 * d.y + 0.3 * d.x) * 0.5) * 255.0).round() as u8;
            [value, value, value, 128]
        };
        (0..32 * 32).map(pixel).collect::<Vec<_>>()
    };
    let faces: Vec<_> = (0..6).map(face).collect();
    let band = 2.0 * PI / 3.0 / 0.488_603;
    let mut coefficients = [[0.0; 3]; 9];
    for (k, value) in [(0, PI / 0.282_095), (1, 0.5 * band), (3, 0.3 * band)] {
        coefficients[k] = [value; 3];
    }
    let exact = Rgb::splat(PI + PI / 3.0);
    let by_faces = irradiance(&document(&faces, json!({"irradianceCoefficients": coefficients})));
    let by_coefficients = irradiance(&document(&[], json!({"irradianceCoefficients": coefficients})));
    // A code of 8 bits is 0.8 % of the light, and 128/255 is no half.
    near(by_faces, exact, 0.01);
    near(by_coefficients, exact, 0.005);
    let turned = json!({"irradianceCoefficients": coefficients, "rotation": [0, 0, FRAC_1_SQRT_2, FRAC_1_SQRT_2]});
    // +x of the light comes to +y, and +y to −x.
    near(irradiance(&document(&[], turned)), Rgb::splat(PI + 0.2 * PI), 0.005);
}

#[test]
fn a_sky_of_the_settings_takes_its_place() {
    let b = document(&even([[255; 4]; 6]), json!({}));
    let settings = Settings { sky: Sky::constant(Rgb::splat(0.1)), ..Settings::default() };
    assert!(load_with(&b, &settings).unwrap().environment.is_none());
    let mut none = document(&even([[255; 4]; 6]), json!({}));
    none.json["scenes"][0].as_object_mut().unwrap().remove("extensions");
    assert!(load(&none).environment.is_none());
}

#[test]
fn what_is_no_cube_is_refused() {
    let white = vec![[255; 4]];
    let refused = [
        (document(&vec![white.clone(); 5], json!({})), "5 faces"),
        (document(&vec![vec![[255; 4]; 9]; 6], json!({})), "3 × 3"),
        (document(&[vec![white.clone(); 5], vec![vec![[255; 4]; 4]]].concat(), json!({})), "face 5"),
        (document(&vec![vec![[9; 4]; 2049 * 2049]; 6], json!({})), "scale it down"),
        (document(&[], json!({})), "neither images"),
        (document(&[], json!({"irradianceCoefficients": [[0, 0, 0]]})), "neither images"),
        (document(&vec![white.clone(); 6], json!({"intensity": -1})), "intensity"),
        (document(&vec![white.clone(); 6], json!({"rotation": [0, 0, 0, 0]})), "rotation"),
        (document(&vec![white.clone(); 6], json!({"specularImages": [[9, 9, 9, 9, 9, 9]]})), "does not exist"),
    ];
    for (b, why) in refused {
        let error = load_with(&b, &Settings::default()).unwrap_err().to_string();
        assert!(error.contains(why) && error.contains("image-based light of scene 0"), "{error}");
    }
    let mut b = document(&vec![white; 6], json!({}));
    b.set("/scenes/0/extensions/EXT_lights_image_based/light", json!(1));
    assert!(load_with(&b, &Settings::default()).unwrap_err().to_string().contains("does not exist"));
}
