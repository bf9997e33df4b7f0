//! What rays of the gather see of a texel that is near: the part that is there, not the mean.

use crate::solve::{Stage, square};
use crate::support;
use glam::{Affine2, Vec2, Vec3};
use texelwalk::base::Rgb;
use texelwalk::patches::Tilts;
use texelwalk::scene::{Scene, Texture, TextureRef, Wrap};

/// Edge of a texel [m].
const TEXEL: f32 = 0.25;
/// White stripe of an otherwise black floor, along the wall on it: half as wide as a texel [m].
const STRIPE: f32 = 0.125;
/// Length of wall and floor [m]; both are a metre wide.
const LENGTH: f32 = 16.0;

/// A wall in z = 0 on a floor.
fn wall_on_striped_floor() -> Scene {
    let wall = square(Vec3::ZERO, Vec3::X * LENGTH, Vec3::Y);
    let floor = square(Vec3::ZERO, Vec3::Z, Vec3::X * LENGTH);
    let mut scene = support::scene_of_two(&wall, &floor, support::white());
    for (uv, p) in scene.vertices.uv[0].iter_mut().zip(&scene.vertices.position) {
        *uv = Vec2::new(0.5, p.z);
    }
    let rows = (1.0 / STRIPE) as u32;
    let pixels = (0..rows).map(|row| if row == 0 { [255; 4] } else { [0, 0, 0, 255] }).collect();
    scene.textures.push(Texture { width: 1, height: rows, pixels, wrap: [Wrap::Clamp; 2], nearest: true });
    scene.materials[1].base_color_texture = Some(TextureRef { texture: 0, uv_set: 0, transform: Affine2::IDENTITY });
    scene
}

/// Mean irradiance of a wall from `low` to `high` [m] by a long stripe of radiosity 1 along its foot, π·½(1 − y/√(y² + w²)) in
/// each point, over π.
fn by_stripe(low: f32, high: f32) -> f32 {
    0.5 * (1.0 - (high.hypot(STRIPE) - low.hypot(STRIPE)) / (high - low))
}

#[test]
fn a_wall_gets_the_light_of_what_is_at_its_foot() {
    let scene = wall_on_striped_floor();
    let stage = Stage::new(&scene, 1.0 / TEXEL);
    let p = &stage.patches;
    // As if light of π lx fell on all of the floor.
    let floor = |i: usize| if p.normal[i].y > 0.9 { p.reflectance[i] } else { Rgb::ZERO };
    let radiance: Vec<Rgb> = (0..p.len()).map(floor).collect();
    let [light, _] = stage.gather(&radiance, &Tilts::default(), None, 2048, 3);
    let rows: [f32; 2] = [0.0, TEXEL].map(|low| {
        let row = |i: usize| {
            let (at, middle) = (p.position[i], low + 0.5 * TEXEL);
            at.z == 0.0 && (at.y - middle).abs() < 1e-3 && (at.x - 0.5 * LENGTH).abs() < 4.0
        };
        let found = stage.mean(&light, row) as f32 / core::f32::consts::PI;
        found / by_stripe(low, low + TEXEL)
    });
    // With the mean of the texel, half of it white, they would be 0.77 and 1.58 (the closed form of a stripe as wide as that).
    assert!(rows.iter().all(|row| (row - 1.0).abs() < 0.02), "{rows:?} of the light by height");
}
