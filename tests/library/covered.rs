//! Surface right below a rug or behind a poster takes no part in light, so that no dark rim shows around them.

use crate::solve::{Stage, square};
use crate::support;
use core::f32::consts::PI;
use glam::{Mat3, Vec3};
use texelwalk::base::Rgb;
use texelwalk::scene::{Scene, Sky};

/// A floor of 3 m by 3 m under a white sky, and a rug of `size` [m] that hovers over its middle.
fn rug_over_floor(size: [f32; 2], height: f32, turn: f32, double_sided: bool) -> Scene {
    let turn = Mat3::from_rotation_y(turn);
    let mut all = square(Vec3::new(-1.5, 0.0, 1.5), Vec3::X * 3.0, Vec3::Z * -3.0).to_vec();
    let corner = Vec3::new(-size[0] / 2.0, height, size[1] / 2.0);
    all.extend(square(turn * corner, turn * Vec3::X * size[0], turn * Vec3::Z * -size[1]));
    let mut material = support::white();
    material.double_sided = double_sided;
    let mut scene = support::scene_with_material(&all, material);
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
