//! Lamps that are closed in, and suns that shine on backs alone, are told; lights that do what they should are not. Nor are
//! lamps lost that stand right on a surface.

use crate::quads::{Quad, Scene, grey};
use glam::{Quat, Vec3};
use serde_json::{Value, json};

/// A box around a place with its fronts outward, or inward.
fn around(at: Vec3, half: f32, inward: bool, double_sided: bool) -> Vec<Quad> {
    let mut material = grey(0.5);
    material["doubleSided"] = json!(double_sided);
    let sides = Quad::room((at - half).to_array(), [2.0 * half; 3], material);
    let facing = |quad: Quad| {
        let out = quad.middle() - at;
        quad.facing(if inward { -out } else { out })
    };
    sides.into_iter().map(facing).collect()
}

fn light(kind: &str) -> Value {
    let mut light = json!({"type": kind, "intensity": 3.0});
    if kind == "spot" {
        light["spot"] = json!({"outerConeAngle": 0.7});
    }
    light
}

/// What is told of lost lights.
fn told(quads: Vec<Quad>, kind: &str, at: Vec3, from: Vec3) -> Vec<String> {
    let options = ["--preset", "preview", "--texels-per-meter", "2", "--gather", "4"];
    let baked = Scene { quads, lights: vec![] }.with(light(kind), at, from).bake(&options);
    let warnings = baked.report["warnings"].as_array().unwrap().clone();
    let lost = warnings.into_iter().filter(|w| w["code"] == "lost-light");
    lost.map(|w| w["message"].as_str().unwrap().to_owned()).collect()
}

fn room() -> Vec<Quad> {
    Quad::room([-4.0, 0.0, -4.0], [8.0, 3.0, 8.0], grey(0.5))
}

const LAMP: Vec3 = Vec3::new(0.5, 2.0, -0.3);

#[test]
fn a_lamp_within_its_bulb_is_told() {
    for kind in ["point", "spot"] {
        for [inward, double_sided] in [[false, false], [false, true], [true, false]] {
            let quads = [room(), around(LAMP, 0.1, inward, double_sided)].concat();
            let told = told(quads, kind, LAMP, Vec3::Y);
            let [message] = &told[..] else { panic!("{kind} {inward} {double_sided}: {told:?}") };
            assert!(message.contains("closed in") && message.contains("0.1"), "{message}");
        }
    }
}

#[test]
fn a_lamp_in_a_room_or_in_a_shade_with_a_hole_is_not() {
    let mut shade = around(LAMP, 0.1, false, true);
    shade.retain(|side| side.middle().y > LAMP.y - 0.05);
    for quads in [room(), [room(), shade].concat()] {
        assert_eq!(told(quads, "point", LAMP, Vec3::Y), Vec::<String>::new());
    }
    // Out in the open, far from the only thing that there is.
    let floor = Quad::floor(-1.0, 2.0, grey(0.5));
    assert_eq!(told(vec![floor], "point", Vec3::Y * 50.0, Vec3::Y), Vec::<String>::new());
}

#[test]
fn a_lamp_in_a_cellar_below_a_terrain_is_not() {
    let mut terrain = Quad::floor(-30.0, 60.0, grey(0.5));
    terrain.lift(2.8);
    let cellar = Quad::room([-2.0, 0.0, -2.0], [4.0, 2.5, 4.0], grey(0.5));
    let quads = [vec![terrain], cellar].concat();
    for texels in ["0.1", "1"] {
        let options = ["--preset", "preview", "--texels-per-meter", texels, "--gather", "4"];
        let scene = Scene { quads: quads.clone(), lights: vec![] }.with(light("point"), LAMP, Vec3::Y);
        let warnings = scene.bake(&options).report["warnings"].to_string();
        assert!(!warnings.contains("lost-light"), "{warnings}");
    }
}

/// Turned, it stands a step of rounding above or below. Half of its light would fall on the ceiling if it stood lower, nearly
/// all of that on one texel.
#[test]
fn a_lamp_right_on_the_ceiling_lights_the_room_below_alone() {
    for (double_sided, kind, flux) in [(false, "point", 2.0), (true, "point", 2.0), (true, "spot", 0.157)] {
        for k in 0..6 {
            let turn = Quat::from_rotation_y(0.7 * k as f32) * Quat::from_rotation_x(0.3 * k as f32);
            let mut quads = around(Vec3::ZERO, 3.0, true, double_sided);
            // The floor of a room above.
            quads.push(Quad::floor(-8.0, 16.0, grey(0.5)));
            quads.last_mut().unwrap().lift(3.5);
            let quads = quads.into_iter().map(|quad| quad.turned(turn)).collect();
            let lit =
                Scene { quads, lights: vec![] }.with(light(kind), turn * Vec3::new(0.5, 3.0, -0.3), turn * Vec3::Y);
            let options = ["--preset", "preview", "--texels-per-meter", "4", "--gather", "0"];
            let baked = lit.bake(&options);
            let power = baked.report["walk"]["power_in"][0].as_f64().unwrap();
            let most = baked.page("lightmap0.exr").iter().fold(0.0f32, |most, t| most.max(t[0]));
            assert!(most < 3.0, "{kind} {double_sided} {k}: a texel has {most}");
            let right = flux * 3.0 * core::f64::consts::PI;
            assert!((power / right - 1.0).abs() < 0.02, "{kind} {double_sided} {k}: {power} lm instead of {right}");
        }
    }
}

#[test]
fn a_sun_outside_of_a_dome_is_told_and_one_over_a_floor_is_not() {
    let floor = || Quad::floor(-2.0, 4.0, grey(0.5));
    let dome = [vec![floor()], around(Vec3::ZERO, 8.0, true, false)].concat();
    let told_of_dome = told(dome, "directional", Vec3::ZERO, Vec3::new(0.2, 1.0, 0.3));
    assert!(told_of_dome.len() == 1 && told_of_dome[0].contains("next to nothing"), "{told_of_dome:?}");
    assert_eq!(told(vec![floor()], "directional", Vec3::ZERO, Vec3::Y), Vec::<String>::new());
}
