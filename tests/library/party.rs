//! Walls without thickness: each room's side of one is lit as if the other room were not there, though their triangles
//! differ and lie on each other face to face.

use crate::quads::{Baked, Quad, Scene, glowing, grey};
use glam::{Quat, Vec3};
use serde_json::json;

const OPTIONS: [&str; 6] = ["--preset", "preview", "--texels-per-meter", "8", "--gather", "64"];

fn bake(quads: Vec<Quad>, lamp: Vec3) -> Baked {
    let light = json!({"type": "point", "intensity": 30.0});
    Scene { quads, lights: vec![] }.with(light, lamp, Vec3::Y).bake(&OPTIONS)
}

/// Sum of the light, number of texels, and how many of them are black.
fn tally(baked: &Baked) -> (f64, usize, usize) {
    let page = baked.page("lightmap0.exr");
    let texels = || page.iter().filter(|t| t[3] > 0.0);
    (texels().map(|t| f64::from(t[0])).sum(), texels().count(), texels().filter(|t| t[0] == 0.0).count())
}

fn assert_same(this: f64, other: f64, most: f64) {
    assert!((this / other - 1.0).abs() < most, "{this} instead of {other}");
}

#[test]
fn a_room_beside_a_dark_one_is_lit_as_if_it_were_alone() {
    // Along an axis of the world distances to both sides are equal; turned, they differ by rounding.
    for turn in [Quat::IDENTITY, Quat::from_rotation_y(0.47) * Quat::from_rotation_x(0.19)] {
        let lit = Quad::room([-4.0, 0.0, -2.0], [4.0, 3.0, 4.0], grey(0.7));
        let dark = Quad::room([0.0, 0.0, -3.0], [3.0, 3.0, 6.0], grey(0.5));
        let turned = |quads: &[Quad]| quads.iter().map(|quad| quad.clone().turned(turn)).collect::<Vec<_>>();
        let lamp = turn * Vec3::new(-2.0, 2.2, 0.0);
        let alone = tally(&bake(turned(&lit), lamp));
        let both = tally(&bake([turned(&lit), turned(&dark)].concat(), lamp));
        assert_same(both.0, alone.0, 0.003);
        assert_eq!((alone.2, both.2), (0, both.1 - alone.1), "light went through the wall");
    }
}

#[test]
fn a_room_with_rooms_on_all_sides_is_lit_as_if_it_were_alone() {
    let room = Quad::room([0.0, 0.0, 0.0], [3.0, 3.0, 3.0], grey(0.7));
    let lamp = Vec3::new(1.2, 2.0, 1.4);
    let mut all = room.clone();
    // Larger along z, so that their triangles differ, and along y where others do not stand.
    for (low, size) in [
        ([-4.0, -0.5, -0.5], [4.0, 4.0, 4.0]),
        ([3.0, -0.5, -0.5], [2.0, 4.0, 4.0]),
        ([0.0, -2.0, -0.5], [3.0, 2.0, 4.0]),
        ([0.0, 3.0, -0.5], [3.0, 2.0, 4.0]),
        ([0.0, 0.0, -2.0], [3.0, 3.0, 2.0]),
        ([0.0, 0.0, 3.0], [3.0, 3.0, 1.0]),
    ] {
        all.extend(Quad::room(low, size, grey(0.5)));
    }
    let (alone, all) = (tally(&bake(room, lamp)), tally(&bake(all, lamp)));
    assert_same(all.0, alone.0, 0.003);
    assert_eq!((alone.2, all.2), (0, all.1 - alone.1));
}

/// What stands on such a wall covers it still.
#[test]
fn a_crate_on_a_floor_that_is_the_ceiling_below_covers_it() {
    let scene = |gap: f32| {
        let mut quads = Quad::room([0.0, 0.0, 0.0], [3.0, 3.0, 3.0], grey(0.6));
        quads.extend(Quad::room([-1.0, -3.0 - gap, -1.0], [5.0, 3.0, 5.0], grey(0.6)));
        let crate_ = Quad::room([1.0, 0.0, 1.0], [1.0, 0.8, 1.0], grey(0.5));
        quads.extend(crate_.into_iter().map(|side| side.clone().facing(side.middle() - Vec3::new(1.5, 0.4, 1.5))));
        let lamp = json!({"type": "point", "intensity": 30.0});
        let lit = Scene { quads, lights: vec![] }.with(lamp.clone(), Vec3::new(0.5, 2.2, 0.5), Vec3::Y);
        tally(&lit.with(lamp, Vec3::new(0.5, -1.0 - gap, 0.5), Vec3::Y).bake(&OPTIONS))
    };
    let (together, apart) = (scene(0.0), scene(0.125));
    assert_same(together.0, apart.0, 0.003);
    assert_eq!((together.2, apart.2), (0, 0), "the dark inside of the crate shows");
}

#[test]
fn a_banner_of_two_sheets_cut_in_other_ways_is_lit_on_both_sides() {
    let banner = |double: bool| {
        let mut material = grey(0.5);
        material["doubleSided"] = json!(double);
        let front = Quad::new([-1.0, 0.5, 0.0], [2.0, 0.0, 0.0], [0.0, 1.5, 0.0], material);
        let mut quads = vec![Quad::floor(-2.0, 4.0, grey(0.5)), front.clone()];
        if !double {
            quads.push(front.other_side());
        }
        quads.push(Quad::new([-2.0, 3.0, 2.0], [4.0, 0.0, 0.0], [0.0, 0.0, -4.0], glowing([1.0; 3])).facing(-Vec3::Y));
        tally(&bake(quads, Vec3::new(0.3, 1.0, 1.5)))
    };
    let (sheets, sheet) = (banner(false), banner(true));
    // The back of a double-sided sheet has no texels of its own.
    assert_eq!((sheets.2, sheets.1), (0, sheet.1 + 16 * 12));
    let back = sheets.0 - sheet.0;
    assert!(back > 0.0, "{back}");
}

/// As some exporters write what has two sides, but with the quads of the copy cut along the other diagonal.
#[test]
fn a_room_whose_faces_have_copies_cut_in_other_ways_is_lit_as_one_without() {
    let room = Quad::room([-1.5, 0.0, -1.5], [3.0, 2.4, 3.0], grey(0.5));
    let lamp = Vec3::new(0.2, 1.6, 0.1);
    let alone = tally(&bake(room.clone(), lamp)).0;
    let others: Vec<Quad> = room.iter().map(|quad| quad.clone().other_side()).collect();
    for quads in [[room.clone(), others.clone()].concat(), [others, room].concat()] {
        assert_same(tally(&bake(quads, lamp)).0, alone, 0.003);
    }
}
