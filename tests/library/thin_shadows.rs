//! Shadows of what is thinner than a texel, by lights without size: their area is that of what casts them.

use crate::solve::{Stage, square};
use crate::support;
use glam::{Mat3, Vec3};
use texelwalk::base::Rgb;
use texelwalk::scene::{Light, Scene};

const TEXELS_PER_METER: f32 = 16.0;

/// A floor of 2 m by 2 m below things that take up no light, under a sun at the zenith that brings 1 lx.
fn under_a_sun(things: &[[Vec3; 3]]) -> Scene {
    let mut all = square(Vec3::new(-1.0, 0.0, 1.0), Vec3::X * 2.0, Vec3::Z * -2.0).to_vec();
    all.extend_from_slice(things);
    let mut scene = support::scene_from_triangles(&all);
    scene.lights = vec![Light::Sun { direction: Vec3::NEG_Y, illuminance: Rgb::ONE, angle: 0.0 }];
    scene
}

/// Share of the floor that is dark.
fn shadow(things: &[[Vec3; 3]]) -> f64 {
    let scene = under_a_sun(things);
    let stage = Stage::new(&scene, TEXELS_PER_METER);
    let light = stage.direct(32);
    1.0 - stage.mean(&light, |i| stage.patches.position[i].y < 0.1)
}

/// Bars of a width [m] every 0.113 m.
fn bars(width: f32, turn: f32) -> Vec<[Vec3; 3]> {
    let turn = Mat3::from_rotation_y(turn);
    let bar = |k: i32| {
        let corner = Vec3::new(k as f32 * 0.113 - width / 2.0, 0.4, 1.9);
        square(turn * corner, turn * Vec3::X * width, turn * Vec3::Z * -3.8)
    };
    (-16..=16).flat_map(bar).collect()
}

/// Share of the floor that lies below such bars, by points of a grid.
fn below_bars(width: f32, turn: f32) -> f64 {
    let back = Mat3::from_rotation_y(-turn);
    let at = |k: u32| (k as f32 + 0.5) / 1000.0 - 1.0;
    let is_below = |k: &u32| {
        let x = (back * Vec3::new(at(k % 2000), 0.0, at(k / 2000))).x;
        (x - (x / 0.113).round() * 0.113).abs() < width / 2.0
    };
    (0..4_000_000).filter(is_below).count() as f64 / 4e6
}

#[test]
fn bars_thinner_than_texels_cast_all_of_their_shadow() {
    // Wires of a sixteenth of a texel are seen between most points, not all.
    for (width, least) in [(0.004, 0.55), (0.008, 0.85), (0.016, 0.97), (0.025, 0.985)] {
        for turn in [0.0, 0.4] {
            let (found, whole) = (shadow(&bars(width, turn)), below_bars(width, turn));
            assert!((least..1.03).contains(&(found / whole)), "{width} m, turned by {turn}: {found} of {whole}");
        }
    }
}

#[test]
fn leaves_smaller_than_texels_cast_most_of_their_shadow() {
    let (mut random, edge) = (support::stream(4), 0.02f32);
    let leaf = |x: f32, z: f32| square(Vec3::new(x, 0.5, z), Vec3::X * edge, Vec3::Z * -edge);
    let mut leaves = vec![];
    for k in 0..1000 {
        // One in each square of a grid, so that none lies over another.
        let at = |cell: i32, u: f32| -0.98 + (cell as f32 + u * 0.6) * 1.95 / 32.0;
        leaves.extend(leaf(at(k % 32, random.next_f32()), at(k / 32, random.next_f32())));
    }
    let (found, whole) = (shadow(&leaves), 1000.0 * f64::from(edge * edge) / 4.0);
    assert!((0.9..1.02).contains(&(found / whole)), "{found} of {whole}");
}
