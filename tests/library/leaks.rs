//! Leaks: rooms sealed by walls that touch, overlap or go through each other, on a floor that goes on outside in the sun.
//! Look-ups at all that can be seen, up to a millimetre from the walls: inside it is dark, and outside no strip is.

use crate::sealed::{Baked, LIT, Place, Rect, Seen, bake_glb};
use crate::solve::Stage;
use crate::support::{self, cuboid};
use glam::{DMat3, DVec3, Mat3, Vec3};
use texelwalk::base::Rgb;
use texelwalk::check::{self, Kind};
use texelwalk::scene::Sky;

/// How the walls of a room meet.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Walls {
    /// They end where others begin, stand on the floor and carry the roof.
    Touching,
    /// Two run through to the corners, where the others lie within them; the roof lies partly in them.
    Overlapping,
    /// They go on beyond each other, this deep into the ground [m], and through the roof.
    Crossing(f32),
}

/// A room of `size` between walls of a thickness, `offset` from where texels begin.
fn room(walls: Walls, [width, depth]: [f32; 2], thick: f32, offset: f32) -> Place {
    let mut place = Place::default();
    let (w, d, height) = (width / 2.0, depth / 2.0, 0.8);
    let (foot, over, top, roof) = match walls {
        Walls::Touching => (0.0, 0.0, height, height),
        Walls::Overlapping => (0.0, thick, height, height - 0.3 * thick),
        Walls::Crossing(foot) => (-foot, thick + 0.3, height + 0.4, height - 0.3),
    };
    let margin = 0.9;
    place.sheet("floor", [-w - thick - margin, -d - thick - margin], [w + thick + margin, d + thick + margin]);
    let at = Vec3::new(offset, 0.0, 0.7 * offset);
    let mut wall = |name: &str, low: [f32; 3], high: [f32; 3]| {
        place.solid(name, Vec3::from_array(low) + at, Vec3::from_array(high) + at);
    };
    let ends = d + thick;
    wall("east", [w, foot, -ends], [w + thick, top, ends + over - over.min(thick)]);
    wall("west", [-w - thick, foot, -ends], [-w, top, ends]);
    wall("south", [-w - over, foot, d], [w + over, top, d + thick]);
    wall("north", [-w - over, foot, -d - thick], [w + over, top, -d]);
    let inset = if walls == Walls::Touching { 0.0 } else { 0.4 * thick };
    let (x, z) = (w + thick - inset, d + thick - inset);
    wall("roof", [-x, roof, -z], [x, roof + thick, z]);
    for (x, y, z) in [(0.0, 0.5, 0.0), (0.8, 0.9, 0.8), (-0.8, 0.1, 0.8), (0.8, 0.2, -0.8), (-0.8, 0.8, -0.8)] {
        place.inside.push(Vec3::new(x * w, y * (height - 0.35), z * d) + at);
    }
    place
}

/// Nothing shines in, and nothing outside is darker than the sun alone makes it.
fn assert_tight(what: &str, seen: Seen) {
    assert!(seen.dark_points > 1500 && seen.lit_points > 500, "{what}: {seen:?}");
    assert!(seen.dark <= 1e-6, "{what}: light inside: {seen:?}");
    assert!(seen.lit >= LIT, "{what}: a dark strip outside: {seen:?}");
}

const THICK: &str = "texels-per-meter = 8.0\ngather = 8\nlines-per-texel = 4\npadding = 2";

#[test]
fn rooms_with_walls_of_two_texels_are_tight() {
    for (k, offset) in [0.0, 0.031, 0.056, 0.119].into_iter().enumerate() {
        let mut place = room(Walls::Touching, [1.4, 1.1], 0.25, offset);
        (place.turn, place.shift) = (0.37 * k as f32, Vec3::new(3.0, -1.0, 7.0) * k as f32);
        let baked = place.bake(THICK);
        assert_tight(&format!("touching {offset}"), place.look(&baked));
    }
}

#[test]
fn rooms_of_walls_that_go_into_each_other_are_tight() {
    // The ground begins within a texel of the walls, or, 0.2 m above their feet, about where one does.
    for (offset, foot) in [(0.0, 0.2), (0.031, 0.15), (0.056, 0.205), (0.119, 0.3)] {
        for thick in [0.25, 0.26] {
            for walls in [Walls::Overlapping, Walls::Crossing(foot)] {
                let place = room(walls, [1.4, 1.1], thick, offset);
                assert_tight(&format!("{walls:?} {thick} {offset}"), place.look(&place.bake(THICK)));
            }
        }
    }
}

#[test]
fn a_room_turned_against_the_texels_is_tight_from_three_texels() {
    // The floor is a sheet along the axes; walls stand on it at an angle.
    let mut place = room(Walls::Touching, [1.4, 1.1], 0.375, 0.0);
    place.turn = 0.6;
    let mut built = place.clone();
    built.things[0].1 = turned(&place.things[0].1, -0.6);
    assert_tight("turned", place.look(&built.bake(THICK)));
}

/// Rectangles turned about the up axis, so that a turn of the scene turns them back.
fn turned(rects: &[Rect], by: f32) -> Vec<Rect> {
    let turn = Mat3::from_rotation_y(by);
    let one = |r: &Rect| Rect { corner: turn * r.corner, u: turn * r.u, v: turn * r.v };
    rects.iter().map(one).collect()
}

#[test]
fn furniture_leaves_no_dark_strip_on_the_floor_around_it() {
    for (offset, size) in [(0.0, 0.5), (0.04, 0.5), (0.09, 0.62)] {
        let mut place = Place::default();
        place.sheet("floor", [-1.6, -1.4], [1.6, 1.4]);
        place.solid("crate", Vec3::new(offset, 0.0, offset), Vec3::new(offset + size, 0.4, offset + 0.45));
        place.solid("cupboard", Vec3::new(-0.9 + offset, -0.03, -0.2), Vec3::new(-0.5 + offset, 0.7, 0.6));
        let seen = place.look(&place.bake(THICK));
        assert!(seen.lit >= LIT && seen.lit_points > 500, "{offset}: {seen:?}");
    }
}

/// The same bake with all surfaces double-sided, as many exporters write them.
fn two_sided(place: &Place) -> Baked {
    bake_glb(&place.glb_with(|b| b.json["materials"][0]["doubleSided"] = true.into()), THICK)
}

#[test]
fn walls_of_double_sided_sheets_are_tight_too() {
    for (k, (thick, offset)) in [(0.3, 0.031), (0.32, 0.056), (0.375, 0.0), (0.4, 0.119)].into_iter().enumerate() {
        for walls in [Walls::Touching, Walls::Overlapping] {
            let mut place = room(walls, [1.4, 1.1], thick, offset);
            (place.turn, place.shift) = (0.37 * k as f32, Vec3::new(3.0, -1.0, 7.0) * k as f32);
            assert_tight(&format!("{walls:?} {thick} {offset}"), place.look(&two_sided(&place)));
        }
    }
}

#[test]
fn double_sided_furniture_leaves_no_dark_strip_either() {
    let mut place = Place::default();
    place.sheet("floor", [-1.6, -1.4], [1.6, 1.4]);
    place.solid("crate", Vec3::new(0.04, 0.0, 0.04), Vec3::new(0.54, 0.4, 0.49));
    place.solid("cupboard", Vec3::new(-0.86, 0.0, -0.2), Vec3::new(-0.16, 0.7, 0.6));
    let seen = place.look(&two_sided(&place));
    assert!(seen.lit >= LIT && seen.lit_points > 500, "{seen:?}");
}

#[test]
fn a_hollow_wall_with_a_gap_leaves_no_dark_strip_on_its_other_side() {
    // On the dark side, a tenth of a metre of the sheet is missing: what lies in the wall is joined with the room.
    for (thick, offset) in [(0.3, 0.031), (0.32, 0.056), (0.4, 0.119)] {
        let mut place = room(Walls::Touching, [1.4, 1.1], thick, offset);
        let (_, sides) = place.things.iter_mut().find(|(name, _)| name == "east").unwrap();
        sides[0].u.z -= 0.1 + thick;
        let seen = place.look(&two_sided(&place));
        assert!(seen.lit >= LIT && seen.lit_points > 500, "{thick} {offset}: {seen:?}");
    }
}

/// Walls of a centimetre, texels of six.
const THIN: &str = "texels-per-meter = 16.0\ngather = 8\nlines-per-texel = 4\ncut-contacts = true";

#[test]
fn rooms_with_walls_of_a_centimetre_are_tight_if_contacts_are_cut() {
    for walls in [Walls::Touching, Walls::Overlapping, Walls::Crossing(0.2)] {
        for (k, offset) in [0.0, 0.023].into_iter().enumerate() {
            let mut place = room(walls, [0.9, 0.7], 0.01, offset);
            (place.turn, place.shift) = (0.37 * k as f32, Vec3::new(3.0, -1.0, 7.0) * k as f32);
            let baked = place.bake(THIN);
            assert_tight(&format!("{walls:?} {offset}"), place.look(&baked));
            let checked = check::Baked::load(&baked.path, None).unwrap();
            let report = check::check(&checked, &check::Settings::default()).unwrap();
            for kind in [Kind::Leaks, Kind::DarkStrip] {
                assert!(!report.measure(kind).unwrap().fault, "{walls:?}: {:?}", report.measure(kind));
            }
            assert!(!baked.outcome.report.warnings.iter().any(|w| w.code == "thin-wall"), "{walls:?}");
        }
    }
}

#[test]
fn thin_walls_that_are_not_cut_are_warned_of_and_found() {
    let place = room(Walls::Crossing(0.2), [0.9, 0.7], 0.01, 0.023);
    let baked = place.bake(&THIN.replace("true", "false"));
    let seen = place.look(&baked);
    assert!(seen.dark > 0.1 && seen.lit < 0.9, "{seen:?}");
    let warning =
        baked.outcome.report.warnings.iter().find(|w| w.code == "thin-wall" && w.node.as_deref() == Some("floor"));
    let message = &warning.unwrap().message;
    assert!(message.contains("--cut-contacts") && message.contains(" m;"), "{message}");
    let checked = check::Baked::load(&baked.path, None).unwrap();
    let report = check::check(&checked, &check::Settings::default()).unwrap();
    for kind in [Kind::Leaks, Kind::DarkStrip] {
        let measure = report.measure(kind).unwrap();
        assert!(measure.fault && !measure.places.is_empty(), "{measure:?}");
    }
    // Walls that are thick enough are not warned of.
    let thick = room(Walls::Touching, [0.9, 0.7], 0.3125, 0.023).bake(THICK);
    assert!(!thick.outcome.report.warnings.iter().any(|w| w.code == "thin-wall"));
}

#[test]
fn a_wall_that_ends_within_the_floor_is_tight_if_contacts_are_cut() {
    let mut place = Place::default();
    place.sheet("floor", [-1.5, -1.2], [1.5, 1.2]);
    place.solid("wall", Vec3::new(-0.8, 0.0, 0.013), Vec3::new(0.9, 0.6, 0.023));
    let lit = |options: &str| {
        let baked = place.bake(options);
        (place.look(&baked), baked.outcome.report.contacts)
    };
    let (cut, contacts) = lit(THIN);
    assert!(cut.lit >= LIT && cut.lit_points > 500, "{cut:?}");
    assert_eq!(contacts.unwrap().lines_continued, 1);
    let (whole, contacts) = lit(&THIN.replace("true", "false"));
    assert!(whole.lit < 0.9 && contacts.is_none(), "{whole:?}");
}

/// Behind its walls there is the void, under the sky, though they close.
#[test]
fn a_room_without_an_outside_is_dark_where_a_box_is_sunk_into_its_floor() {
    let mut room = vec![];
    cuboid(DVec3::new(-2.0, 0.0, -1.5), DVec3::new(2.0, 2.5, 1.5), 1, true, &mut room);
    let mut chest = vec![];
    cuboid(DVec3::new(-0.5, -0.02, -0.4), DVec3::new(0.5, 0.6, 0.4), 1, false, &mut chest);
    let mut all = support::place(&room, DMat3::IDENTITY, 1.0, DVec3::ZERO);
    all.extend(support::place(&chest, DMat3::from_rotation_y(0.4), 1.0, DVec3::ZERO));
    let mut scene = support::scene_from_triangles(&all);
    scene.sky = Sky::constant(Rgb::ONE);
    let stage = Stage::new(&scene, 12.0);
    let (p, light) = (&stage.patches, stage.direct(64));
    let of_chest = |i: &usize| {
        p.exposed[*i] > 0.0 && p.position[*i].y > 0.0 && p.position[*i].y < 0.7 && p.position[*i].x.abs() < 0.9
    };
    let most = (0..p.front).filter(of_chest).map(|i| light[i].max_element()).fold(0.0, f32::max);
    assert!(most < 1e-3, "{most}");
    let low = (0..p.front).filter(|i| of_chest(i) && p.normal[*i].y.abs() < 0.1 && p.position[*i].y < 0.1);
    assert!(low.count() > 30, "the texels that the floor cuts are there");
}
