//! Surface right below a rug or behind a poster takes no part in light, so that no dark rim shows around them, and no bright
//! one around lamps.

use crate::solve::{Stage, square};
use crate::support;
use core::f32::consts::PI;
use glam::{Mat3, Vec3};
use texelwalk::base::Rgb;
use texelwalk::scene::{Material, Scene, Sky};

/// A floor of 3 m by 3 m, and a rug of `size` [m] that hovers over its middle.
fn floor_and_rug(size: [f32; 2], height: f32, turn: f32) -> ([[Vec3; 3]; 2], [[Vec3; 3]; 2]) {
    let turn = Mat3::from_rotation_y(turn);
    let floor = square(Vec3::new(-1.5, 0.0, 1.5), Vec3::X * 3.0, Vec3::Z * -3.0);
    let corner = Vec3::new(-size[0] / 2.0, height, size[1] / 2.0);
    (floor, square(turn * corner, turn * Vec3::X * size[0], turn * Vec3::Z * -size[1]))
}

/// The same under a white sky.
fn rug_over_floor(size: [f32; 2], height: f32, turn: f32, double_sided: bool) -> Scene {
    let (floor, rug) = floor_and_rug(size, height, turn);
    let mut material = support::white();
    material.double_sided = double_sided;
    let mut scene = support::scene_with_material(&[floor, rug].concat(), material);
    scene.sky = Sky::constant(Rgb::ONE);
    scene
}

#[test]
fn the_floor_beside_a_rug_is_as_bright_as_elsewhere() {
    for height in [0.0005, 0.002, 0.005] {
        for turn in [0.0, 0.58] {
            for double_sided in [false, true] {
                let scene = rug_over_floor([1.3, 0.9], height, turn, double_sided);
                let stage = Stage::new(&scene, 16.0);
                let (p, light) = (&stage.patches, stage.direct(64));
                let is_floor = |i: &usize| p.position[*i].y < height / 2.0 && p.normal[*i].y > 0.9;
                let floor: Vec<usize> = (0..p.front).filter(is_floor).collect();
                let parts = floor.iter().filter(|i| p.exposed[**i] > 0.0 && p.exposed[**i] < 0.99).count();
                let hidden = floor.iter().filter(|i| p.exposed[**i] == 0.0).count();
                assert!(parts > 30 && hidden > 200, "{height} m, {turn}: {parts} cut, {hidden} hidden");
                // A gap as high as this keeps off a little light right beside it.
                let open = floor.iter().filter(|i| p.exposed[**i] > 0.0);
                let least = open.map(|i| light[*i].x / PI).fold(f32::INFINITY, f32::min);
                assert!(least > 0.9 - 40.0 * height, "{height} m, {turn}, {double_sided}: {least} of the light");
                let rug = (0..p.front).filter(|i| p.position[*i].y > height / 2.0 && !p.is_behind(*i));
                assert!(rug.map(|i| light[i].x / PI).all(|light| light > 0.97));
            }
        }
    }
}

#[test]
fn what_is_too_high_or_covers_all_is_left() {
    for (size, height) in [([1.3, 0.9], 0.02), ([3.4, 3.4], 0.002)] {
        let scene = rug_over_floor(size, height, 0.0, true);
        let stage = Stage::new(&scene, 16.0);
        let p = &stage.patches;
        let floor = (0..p.front).filter(|i| p.position[*i].y < height / 2.0);
        assert!(floor.map(|i| p.exposed[i]).all(|exposed| exposed > 0.99), "{size:?} at {height} m");
    }
}

const GLOW: f32 = 20.0;

/// Flux over π that a lamp in the place of the rug, which glows on both sides, sends to the floor, `height` above it [lm].
fn flux_on_floor(size: [f32; 2], height: f32, turn: f32) -> f32 {
    let (floor, rug) = floor_and_rug(size, height, turn);
    let lamp = Material { emission: Rgb::splat(GLOW), double_sided: true, ..support::white() };
    let scene = support::scene_of_two(&floor, &rug, lamp);
    let stage = Stage::new(&scene, 16.0);
    let (p, light) = (&stage.patches, stage.direct(256));
    let floor = (0..p.front).filter(|i| p.position[*i].y < height / 2.0);
    floor.map(|i| light[i].x / PI * p.exposed_area(i)).fold(0.0, |a, b| a + b)
}

#[test]
fn a_flat_lamp_lights_the_floor_beside_it_only() {
    for (height, turn) in [(0.0005, 0.58), (0.002, 0.0), (0.005, 0.0), (0.005, 0.58)] {
        let flux = flux_on_floor([1.3, 0.9], height, turn);
        // Beside the edge of a wide lamp E is π L (1 − x / √(x² + h²)) / 2 at a distance x.
        // Where a cell of the mask is half covered, a part of it is missing.
        let (expected, below) = (4.4 * GLOW * height / 2.0, 1.17 * GLOW);
        let off = (flux - expected).abs();
        assert!(off < 0.2 * expected + 2e-3 * below, "{height} m, {turn}: {flux} instead of {expected}");
    }
}

#[test]
fn below_a_narrow_lamp_the_floor_is_lit() {
    for turn in [0.0, 0.58] {
        let flux = flux_on_floor([1.3, 0.02], 0.005, turn);
        let expected = GLOW * 1.3 * 0.02;
        assert!(flux > 0.95 * expected && flux < 1.05 * expected, "{turn}: {flux} of {expected}");
    }
}
