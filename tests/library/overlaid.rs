//! What is there twice, in the same place with the same side as front, sends light on once: rays meet one of the two.

use crate::quads::{Baked, Quad, Scene, glowing, grey};
use glam::{Quat, Vec3};
use serde_json::{Value, json};

const OPTIONS: [&str; 6] = ["--preset", "preview", "--texels-per-meter", "8", "--lines-per-texel", "32"];

fn bake(quads: Vec<Quad>, gather: &str) -> Baked {
    let light = json!({"type": "point", "intensity": 30.0});
    let scene = Scene { quads, lights: vec![] }.with(light, Vec3::new(1.2, 2.0, 1.4), Vec3::Y);
    scene.bake(&[&OPTIONS[..], &["--gather", gather]].concat())
}

/// Mean light of the texels.
fn mean(baked: &Baked) -> f64 {
    let page = baked.page("lightmap0.exr");
    let lit: Vec<f64> = page.iter().filter(|t| t[3] > 0.0).map(|t| f64::from(t[0])).collect();
    lit.iter().sum::<f64>() / lit.len() as f64
}

fn assert_same(this: f64, other: f64, most: f64) {
    assert!((this / other - 1.0).abs() < most, "{this} instead of {other}");
}

fn room(material: Value) -> Vec<Quad> {
    Quad::room([0.0, 0.0, 0.0], [3.0, 3.0, 3.0], material)
}

fn double_sided(reflectance: f32) -> Value {
    let mut material = grey(reflectance);
    material["doubleSided"] = json!(true);
    material
}

#[test]
fn a_room_whose_meshes_are_there_twice_is_as_bright_as_one() {
    for gather in ["64", "0"] {
        for material in [grey(0.7), double_sided(0.7)] {
            let one = mean(&bake(room(material.clone()), gather));
            let two = mean(&bake([room(material.clone()), room(material)].concat(), gather));
            assert_same(two, one, 0.006);
        }
    }
}

#[test]
fn a_floor_over_a_floor_is_one() {
    let one = bake(room(grey(0.7)), "0");
    // Another rectangle, so that its triangles are others; and one that shows its back to the room.
    let floor = Quad::new([0.0, 0.0, 0.0], [0.0, 0.0, 3.0], [3.0, 0.0, 0.0], grey(0.7));
    let below = Quad::new([0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [0.0, 0.0, 3.0], double_sided(0.7));
    for other in [floor, below] {
        let two = bake([room(grey(0.7)), vec![other]].concat(), "0");
        let arrives = |baked: &Baked| baked.report["walk"]["power_absorbed"][0].as_f64().unwrap();
        assert_same(arrives(&two), arrives(&one), 0.006);
    }
}

#[test]
fn a_wall_of_two_double_sided_rooms_sends_on_what_falls_on_it_once() {
    // Turned, rays meet either side by chance, and texels of the other room's larger wall are half beyond this one.
    let turns = [(Quat::IDENTITY, 0.003), (Quat::from_rotation_y(0.47) * Quat::from_rotation_x(0.19), 0.015)];
    for (turn, most) in turns {
        let turned = |quads: Vec<Quad>| quads.into_iter().map(|quad| quad.turned(turn)).collect::<Vec<_>>();
        let lamp = json!({"type": "point", "intensity": 30.0});
        let sum = |quads: Vec<Quad>| {
            let scene = Scene { quads: turned(quads), lights: vec![] };
            let baked = scene
                .with(lamp.clone(), turn * Vec3::new(1.2, 2.0, 1.4), Vec3::Y)
                .bake(&[&OPTIONS[..], &["--gather", "64"]].concat());
            baked.page("lightmap0.exr").iter().filter(|t| t[3] > 0.0).map(|t| f64::from(t[0])).sum::<f64>()
        };
        let beside = Quad::room([3.0, -0.5, -0.5], [2.0, 4.0, 4.0], double_sided(0.7));
        assert_same(sum([room(double_sided(0.7)), beside].concat()), sum(room(double_sided(0.7))), most);
    }
}

#[test]
fn a_lamp_that_is_there_twice_gives_the_light_of_one() {
    let panel = || Quad::new([-0.5, 2.0, 0.5], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0], glowing([3.0; 3])).facing(-Vec3::Y);
    let floor = || Quad::floor(-1.0, 2.0, grey(0.5));
    // The panels get less than the floor, and each has texels.
    let most = |quads: Vec<Quad>| {
        let baked = Scene { quads, lights: vec![] }.bake(&[&OPTIONS[..], &["--gather", "64"]].concat());
        f64::from(baked.page("lightmap0.exr").iter().fold(0.0f32, |most, t| most.max(t[0])))
    };
    assert_same(most(vec![floor(), panel(), panel()]), most(vec![floor(), panel()]), 0.003);
}
