//! What rays of the gather see of a texel that is near: the part that is there, not the mean.

use crate::solve::{Stage, square};
use crate::support;
use core::sync::atomic::{AtomicU64, Ordering};
use glam::{Affine2, Vec2, Vec3};
use texelwalk::base::{Progress, Rgb, Stream};
use texelwalk::gather::{Anew, Field, Gathered};
use texelwalk::patches::{Looked, SurfacePoint, Tilts};
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

/// Irradiance of the lowest row of a wall over that by a stripe of light along its foot, on a floor that is white all over; as
/// the patches know it, the light is even. `looks` for it where rays hit nearby.
fn beside_stripe_of_light(rays: u32, looks: bool) -> f32 {
    let wall = square(Vec3::ZERO, Vec3::X * LENGTH, Vec3::Y);
    let floor = square(Vec3::ZERO, Vec3::Z, Vec3::X * LENGTH);
    let scene = support::scene_of_two(&wall, &floor, support::white());
    let stage = Stage::new(&scene, 1.0 / TEXEL);
    let (tracer, p) = (&stage.tracer, &stage.patches);
    let row = |normal: Vec3, i: usize| p.normal[i] == normal && p.position[i].dot(Vec3::Y + Vec3::Z) < TEXEL;
    let radiance: Vec<Rgb> =
        (0..p.len()).map(|i| if row(Vec3::Y, i) { p.reflectance[i] * (STRIPE / TEXEL) } else { Rgb::ZERO }).collect();
    let look = |patch: usize, point: SurfacePoint, _: &mut Stream| {
        let is_lit = p.normal[patch] == Vec3::Y && scene.position(point.triangle, point.b).z < STRIPE;
        let direct = Rgb::splat(if is_lit { core::f32::consts::PI } else { 0.0 });
        Looked { direct, onward: None, normal: p.normal[patch], rays: 1 }
    };
    let anew = Anew { look: &look, glared: &[vec![], vec![]], rays: AtomicU64::new(0) };
    let (tilts, anew) = (&Tilts::default(), looks.then_some(&anew));
    let field = Field { tracer, patches: p, radiance: [&radiance; 2], left_out: None, tilts, sky: None, anew, seed: 5 };
    let mut gathered = Gathered::new(p);
    gathered.add(&field, |_| rays, &Progress::default());
    let [a, _] = gathered.halves();
    assert_eq!(anew.is_some_and(|anew| anew.rays.load(Ordering::Relaxed) > 0), looks && rays > 512);
    let middle = |i: usize| row(Vec3::Z, i) && (p.position[i].x - 0.5 * LENGTH).abs() < 4.0;
    stage.mean(&a, middle) as f32 / core::f32::consts::PI / by_stripe(0.0, TEXEL)
}

#[test]
fn with_many_rays_light_within_a_near_texel_is_looked_for_anew() {
    let known = beside_stripe_of_light(512, true);
    assert_eq!(known, beside_stripe_of_light(512, false));
    let found = beside_stripe_of_light(1 << 14, true);
    // Of the lowest row's upper part the middles of the nearest texels are farther than an edge.
    assert!((known - 0.77).abs() < 0.01 && (found - 1.0).abs() < 0.05, "{known} and {found} of the light");
}
