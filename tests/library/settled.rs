//! Rooms with a small hole: how much light there is in them is known, and few rays find out. In white ones it stays for
//! hundreds of bounces.

use crate::quads::{Quad, Scene, grey};
use glam::Vec3;
use serde_json::json;

/// Edge [m].
const ROOM: f32 = 2.0;
/// Where the hole of the ceiling starts and ends on both axes [m]: one ray in six hundred finds out.
const HOLE: [f32; 2] = [0.9, 1.1];

fn room(reflectance: f32) -> Scene {
    let mut quads = Quad::room([0.0; 3], [ROOM; 3], grey(reflectance));
    quads.remove(1);
    let [low, high] = HOLE;
    let strips = [[0.0, 0.0, ROOM, low], [0.0, high, ROOM, ROOM], [0.0, low, low, high], [high, low, ROOM, high]];
    quads.extend(strips.map(|[left, near, right, far]| {
        let (u, v) = ([right - left, 0.0, 0.0], [0.0, 0.0, far - near]);
        Quad::new([left, ROOM, near], u, v, grey(reflectance)).facing(-Vec3::Y)
    }));
    Scene { quads, lights: vec![] }
}

/// Light of all texels, in the unit of the sky's radiance.
fn light(scene: &Scene, options: &[&str]) -> Vec<f32> {
    let baked = scene.bake(&[&["--texels-per-meter", "10"], options].concat());
    baked.page("lightmap0.exr").iter().filter(|texel| texel[3] > 0.0).map(|texel| texel[1]).collect()
}

fn mean(light: &[f32]) -> f32 {
    light.iter().sum::<f32>() / light.len() as f32
}

fn median(light: &[f32]) -> f32 {
    let mut sorted = light.to_vec();
    sorted.sort_by(f32::total_cmp);
    sorted[sorted.len() / 2]
}

#[test]
fn a_white_room_is_as_bright_as_the_sky_outside_its_hole() {
    for preset in ["preview", "production"] {
        let light = light(&room(1.0), &["--preset", preset, "--sky", "1,1,1"]);
        let worst = light.iter().map(|light| (light - 1.0).abs()).fold(0.0, f32::max);
        let mean = mean(&light);
        assert!((mean - 1.0).abs() < 0.05 && worst < 0.2, "{preset}: {mean} in the mean, off by {worst} at most");
    }
}

#[test]
fn as_much_light_leaves_by_the_hole_as_the_sun_sends_in() {
    let sun = json!({"type": "directional", "intensity": core::f32::consts::PI});
    let scene = room(1.0).with(sun, Vec3::ZERO, Vec3::Y);
    let seeds = ["1", "2", "3", "4", "5", "6", "7", "8"];
    for preset in ["preview", "production"] {
        let means = seeds.map(|seed| {
            let light = light(&scene, &["--preset", preset, "--seed", seed]);
            let level = median(&light);
            // All but the sunlit place on the floor, which is as bright again.
            let shaded: Vec<f32> = light.into_iter().filter(|light| *light < 1.5 * level).collect();
            let mean = mean(&shaded);
            let worst = shaded.iter().map(|light| (light / mean - 1.0).abs()).fold(0.0, f32::max);
            assert!(worst < 0.15, "{preset} {seed}: off by {worst} at most");
            mean
        });
        // About sixty rays find out, whichever half: 12 % of error in each run, and more than too little.
        let mean = mean(&means);
        assert!((mean - 1.0).abs() < 0.2, "{preset}: {mean} in the mean");
    }
}

#[test]
fn a_limit_of_bounces_holds_where_the_walk_knows_little() {
    let few = light(&room(1.0), &["--preset", "preview", "--sky", "1,1,1", "--bounces", "3"]);
    assert!(mean(&few) < 0.1, "{}", mean(&few));
}

#[test]
fn as_much_light_of_the_sky_is_found_as_comes_in() {
    // What one texel's samples find decides how many more its neighbours get, not it: no light goes missing.
    let (low, high) = (HOLE[0], HOLE[1]);
    let hole = (high - low).powi(2);
    let truth = hole / (6.0 * ROOM.powi(2) - hole);
    let runs = 16;
    let options = ["--preset", "preview", "--gather", "0", "--bounces", "0", "--sky", "1,1,1", "--seed"];
    let found = |seed: u32| mean(&light(&room(0.0), &[&options[..], &[&seed.to_string()]].concat()));
    let found: Vec<f32> = (0..runs).map(found).collect();
    let ratio = mean(&found) / truth;
    assert!((ratio - 1.0).abs() < 0.15, "{ratio} of the light");
}

#[test]
fn what_the_walk_leaves_is_added_in_rooms_that_are_nearly_white() {
    for (reflectance, options) in
        [(0.985f32, &[][..]), (0.99, &[]), (0.995, &["--gather", "512", "--lines-per-texel", "256"])]
    {
        let mut walls = grey(reflectance);
        walls["emissiveFactor"] = json!([1.0, 1.0, 1.0]);
        let scene = Scene { quads: Quad::room([0.0; 3], [ROOM; 3], walls), lights: vec![] };
        // Every bounce keeps as much of the light: a geometric series.
        let ratio = mean(&light(&scene, options)) * (1.0 - reflectance);
        assert!((ratio - 1.0).abs() < 0.01, "{reflectance}: {ratio} of the light");
    }
}
