//! What looks like a thin wall and is none: neither the bake's `thin-wall` nor `check` says so. Walls are still told.

use crate::quads::{Baked, Quad, Scene, grey};
use glam::Vec3;
use serde_json::json;
use texelwalk::check::{self, Kind, Measure, Settings};

fn check(baked: &Baked, kind: Kind) -> Measure {
    let document = check::Baked::load(&baked.path("out.gltf"), None).unwrap();
    check::check(&document, &Settings::default()).unwrap().measure(kind).unwrap().clone()
}

#[test]
fn panes_are_no_walls() {
    let strip = |color: [f32; 4]| {
        let mut pane = grey(0.9);
        pane["pbrMetallicRoughness"]["baseColorFactor"] = json!(color);
        pane["alphaMode"] = "BLEND".into();
        pane["doubleSided"] = true.into();
        // A pane that stands askew on the floor of a room, between its lamp and a corner.
        let mut quads = Quad::room([-3.0, 0.0, -3.0], [6.0, 3.0, 6.0], grey(0.6));
        quads.push(Quad::new([-1.5, 0.0, 0.03], [3.0, 0.0, 0.7], [0.0, 1.5, 0.0], pane));
        let lamp = json!({"type": "point", "intensity": 50.0});
        let scene = Scene { quads, lights: vec![] };
        let scene = scene.with(lamp, Vec3::new(0.3, 2.6, 1.2), Vec3::Y);
        let baked = scene.bake(&["--preset", "preview", "--texels-per-meter", "12", "--gather", "64"]);
        check(&baked, Kind::DarkStrip)
    };
    let [glass, wall] = [0.6, 1.0].map(|alpha| strip([0.9, 0.95, 0.9, alpha]));
    assert!(!glass.fault && glass.value == 0.0, "{glass:?}");
    assert!(wall.fault && wall.count > 20, "{wall:?}");
}

/// Warnings of thin walls in a lit room with a board that goes so far into its wall, which is a single sheet [m].
fn thin_walls(depth: f32) -> usize {
    let mut quads = Quad::room([-3.0, 0.0, -3.0], [6.0, 3.0, 6.0], grey(0.6));
    let low = Vec3::new(-1.013, 1.507, -3.0 - depth);
    let board = Quad::room(low.to_array(), [2.023, 0.05, 0.3 + depth], grey(0.5));
    let middle = low + Vec3::new(2.023, 0.05, 0.3 + depth) / 2.0;
    quads.extend(board.into_iter().map(|side| {
        let out = side.middle() - middle;
        side.facing(out)
    }));
    let lamp = json!({"type": "point", "intensity": 50.0});
    let scene = Scene { quads, lights: vec![] }.with(lamp, Vec3::new(0.3, 1.53, 0.2), Vec3::Y);
    let baked = scene.bake(&["--preset", "preview", "--texels-per-meter", "16", "--gather", "64"]);
    baked.report["warnings"].as_array().unwrap().iter().filter(|w| w["code"] == "thin-wall").count()
}

#[test]
fn the_end_of_a_board_in_a_wall_is_nothing_that_light_leaks_into() {
    assert_eq!(thin_walls(0.05), 0);
    // A board that goes on behind the wall has a dark part.
    assert!(thin_walls(0.6) > 0);
}

#[test]
fn light_and_shadow_that_meet_at_the_corner_of_a_box_are_parted_by_no_wall() {
    let floor = Quad::new([-2.0, 0.0, 2.0], [4.0, 0.0, 0.0], [0.0, 0.0, -4.0], grey(0.5));
    let sides = Quad::room([-0.3, 0.0, -0.3], [0.6, 0.6, 0.6], grey(0.5)).into_iter().map(|side| {
        let out = side.middle() - Vec3::Y * 0.3;
        side.facing(out)
    });
    let quads: Vec<Quad> = core::iter::once(floor).chain(sides).collect();
    for at in [[1.0, 1.5, 0.5], [1.5, 2.0, 1.1], [0.8, 1.5, 0.2]] {
        let scene = Scene { quads: quads.clone(), lights: vec![] };
        let scene = scene.with(json!({"type": "point", "intensity": 100.0}), Vec3::from_array(at), Vec3::Y);
        let baked = scene.bake(&["--preset", "preview", "--texels-per-meter", "16"]);
        assert_eq!(baked.report["warnings"], json!([]), "{at:?}");
    }
}
