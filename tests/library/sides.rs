//! Which side of double-sided surfaces is stored: the back of what faces a narrow dark gap, a slit or the void, the front
//! of all else.

use crate::quads::{Baked, Quad, Scene, grey};
use glam::Vec3;
use serde_json::json;

const OPTIONS: [&str; 6] = ["--preset", "preview", "--texels-per-meter", "20", "--gather", "32"];

/// A double-sided box of quads with their fronts to its inside, or to its outside.
fn shell(low: [f32; 3], size: [f32; 3], inward: bool) -> Vec<Quad> {
    sides(low, size, inward, true)
}

/// A box of quads with their fronts to its inside, or to its outside.
fn sides(low: [f32; 3], size: [f32; 3], inward: bool, double_sided: bool) -> Vec<Quad> {
    let mut material = grey(0.5);
    material["doubleSided"] = json!(double_sided);
    let sides = Quad::room(low, size, material);
    let middle = Vec3::from_array(low) + Vec3::from_array(size) / 2.0;
    let facing = |quad: Quad| {
        let out = quad.middle() - middle;
        quad.facing(if inward { -out } else { out })
    };
    sides.into_iter().map(facing).collect()
}

fn lit(quads: Vec<Quad>, kind: &str, at: Vec3) -> Scene {
    let light = json!({"type": kind, "intensity": 3.0});
    Scene { quads, lights: vec![] }.with(light, at, Vec3::new(0.3, 0.8, 0.5))
}

fn turned(baked: &Baked) -> usize {
    baked.report["warnings"].as_array().unwrap().iter().filter(|w| w["code"] == "turned-side").count()
}

/// Light summed over the charts of a page.
fn sum(baked: &Baked) -> f64 {
    baked.page("lightmap0.exr").iter().filter(|t| t[3] > 0.0).map(|t| f64::from(t[0])).sum()
}

#[test]
fn a_box_that_was_modelled_inside_out_is_stored_as_seen_from_outside() {
    let scene = |inward| {
        let mut quads = shell([-0.15, 0.1, -0.15], [0.3, 0.25, 0.3], inward);
        quads.push(Quad::floor(-0.6, 1.2, grey(0.5)));
        lit(quads, "directional", Vec3::ZERO).bake(&[&OPTIONS[..], &["--sky", "0.5"]].concat())
    };
    let [inward, outward] = [true, false].map(scene);
    assert_eq!(turned(&inward), 6, "{}", inward.report["warnings"]);
    assert_eq!(turned(&outward), 0);
    let ratio = sum(&inward) / sum(&outward);
    assert!((ratio - 1.0).abs() < 0.03, "the page holds {ratio} of the light that it should");
}

#[test]
fn walls_half_a_metre_thick_are_stored_as_seen_from_the_room() {
    let house = |inward| {
        let mut quads = shell([-1.5, 0.0, -1.5], [3.0, 2.4, 3.0], inward);
        quads.extend(shell([-2.0, -0.5, -2.0], [4.0, 3.4, 4.0], false));
        let lamp = json!({"type": "point", "intensity": 3.0});
        lit(quads, "directional", Vec3::ZERO).with(lamp, Vec3::new(0.2, 1.6, 0.1), Vec3::Y).bake(&OPTIONS)
    };
    let [inward, outward] = [true, false].map(house);
    assert_eq!(turned(&inward), 0, "{}", inward.report["warnings"]);
    assert_eq!(turned(&outward), 6, "{}", outward.report["warnings"]);
    let ratio = sum(&outward) / sum(&inward);
    assert!((ratio - 1.0).abs() < 0.03, "the page holds {ratio} of the light that it should");
}

#[test]
fn a_dark_room_stays_dark() {
    let room = shell([-1.5, 0.0, -1.5], [3.0, 2.4, 3.0], true);
    let baked = lit(room, "directional", Vec3::ZERO).bake(&OPTIONS);
    assert_eq!(turned(&baked), 0);
    assert!(sum(&baked) < 1e-6, "{}", sum(&baked));
}

#[test]
fn a_small_box_with_a_lamp_in_it_keeps_its_inside() {
    let quads = || shell([0.0, 0.0, 0.0], [0.3, 0.3, 0.3], true);
    let inside = lit(quads(), "point", Vec3::splat(0.15)).bake(&OPTIONS);
    assert_eq!(turned(&inside), 0);
    assert!(sum(&inside) > 1.0);
}

/// A room with a lamp in it, and nothing around.
fn hall(inward: bool) -> Scene {
    lit(shell([-1.5, 0.0, -1.5], [3.0, 2.4, 3.0], inward), "point", Vec3::new(0.2, 1.6, 0.1))
}

#[test]
fn walls_that_face_the_void_are_stored_as_seen_from_the_room() {
    let [inward, outward] = [true, false].map(|inward| hall(inward).bake(&OPTIONS));
    assert_eq!(turned(&inward), 0);
    assert_eq!(turned(&outward), 6, "{}", outward.report["warnings"]);
    let ratio = sum(&outward) / sum(&inward);
    assert!((ratio - 1.0).abs() < 0.03, "the page holds {ratio} of the light that it should");
}

#[test]
fn walls_that_face_the_open_are_stored_as_seen_from_outside() {
    let sky = hall(false).bake(&[&OPTIONS[..], &["--sky", "0.001"]].concat());
    let sun = json!({"type": "directional", "intensity": 3.0});
    let sun = hall(false).with(sun, Vec3::ZERO, Vec3::new(0.3, 0.8, 0.5)).bake(&OPTIONS);
    assert_eq!([turned(&sky), turned(&sun)], [0, 0]);
}

#[test]
fn the_dark_side_of_a_wall_between_rooms_stays_dark() {
    let mut scene = hall(true);
    let dark = shell([1.5, 0.0, -1.5], [3.0, 2.4, 3.0], true);
    scene.quads.retain(|quad| quad.middle().x < 1.49);
    scene.quads.extend(dark);
    assert_eq!(turned(&scene.bake(&OPTIONS)), 0);
}

#[test]
fn a_screen_with_a_lamp_behind_keeps_its_dark_front() {
    let mut material = grey(0.5);
    material["doubleSided"] = json!(true);
    let screen = Quad::floor(-1.0, 2.0, material);
    assert_eq!(turned(&lit(vec![screen], "point", Vec3::new(0.0, -1.0, 0.0)).bake(&OPTIONS)), 0);
}

#[test]
fn a_tape_with_its_front_down_is_stored_as_seen_from_above() {
    let page = |up: bool, density: &str| {
        let mut scene = hall(true);
        let mut material = grey(0.5);
        material["doubleSided"] = json!(true);
        let tape = Quad::new([-1.0, 0.015, 0.4], [2.0, 0.0, 0.0], [0.0, 0.0, 0.14], material);
        scene.quads.push(tape.facing(if up { Vec3::Y } else { Vec3::NEG_Y }));
        scene.bake(&["--preset", "preview", "--gather", "32", "--texels-per-meter", density])
    };
    for density in ["6", "16", "40"] {
        let [up, down] = [true, false].map(|up| page(up, density));
        assert_eq!([turned(&up), turned(&down)], [0, 1], "{density}: {}", down.report["warnings"]);
        let ratio = sum(&down) / sum(&up);
        assert!((ratio - 1.0).abs() < 0.03, "the page holds {ratio} of the light that it should");
    }
}

/// As some exporters write what has two sides. The copies lie on each other face to face, as crate and floor do.
#[test]
fn a_room_whose_faces_are_there_once_for_each_side_is_lit_as_one_with_a_single_side() {
    let lamp = json!({"type": "point", "intensity": 3.0});
    let bake = |order: &[bool]| {
        let quads = order.iter().flat_map(|&inward| sides([-1.5, 0.0, -1.5], [3.0, 2.4, 3.0], inward, false)).collect();
        let scene = Scene { quads, lights: vec![] };
        sum(&scene.with(lamp.clone(), Vec3::new(0.2, 1.6, 0.1), Vec3::Y).bake(&OPTIONS))
    };
    let single = bake(&[true]);
    for order in [[true, false], [false, true]] {
        let ratio = bake(&order) / single;
        assert!((ratio - 1.0).abs() < 0.01, "the page holds {ratio} of the light that it should");
    }
}
