//! Where solids touch: what lies face to face takes no light, and what is left of a texel takes all of its own.

use crate::solve::{Stage, load, square};
use crate::support;
use glam::{Mat3, Vec2, Vec3};
use texelwalk::base::Rgb;
use texelwalk::patches::PatchSurface;
use texelwalk::scene::{Light, Scene, Sky};

/// A box with outward fronts.
fn solid(low: Vec3, high: Vec3) -> Vec<[Vec3; 3]> {
    let d = high - low;
    let (x, y, z) = (Vec3::X * d.x, Vec3::Y * d.y, Vec3::Z * d.z);
    let sides = [
        square(low, z, y),
        square(low, x, z),
        square(low, y, x),
        square(high, -y, -z),
        square(high, -z, -x),
        square(high, -x, -y),
    ];
    sides.concat()
}

/// A crate of 1 m on a sheet of floor, turned and moved; white sky all around, below the floor as well.
fn crate_on_floor(turn: Mat3, shift: Vec3) -> Scene {
    let mut all = square(Vec3::ZERO, Vec3::Z * 3.0, Vec3::X * 3.0).to_vec();
    all.extend(solid(Vec3::new(1.0, 0.0, 1.0), Vec3::new(2.0, 1.0, 2.0)));
    for corner in all.iter_mut().flatten() {
        *corner = turn * *corner + shift;
    }
    let mut scene = support::scene_from_triangles(&all);
    scene.sky = Sky::constant(Rgb::ONE);
    scene
}

#[test]
fn the_underside_of_a_crate_sees_nothing_through_the_floor() {
    let tilted = Mat3::from_rotation_x(0.3) * Mat3::from_rotation_z(-0.7);
    for (turn, shift) in [
        (Mat3::IDENTITY, Vec3::ZERO),
        (Mat3::from_rotation_y(0.4), Vec3::new(17.0, 3.3, -40.0)),
        (tilted, Vec3::new(-300.0, 120.0, 77.0)),
    ] {
        let scene = crate_on_floor(turn, shift);
        let stage = Stage::new(&scene, 10.0);
        let (p, light) = (&stage.patches, stage.direct(16));
        let (down, up) = (turn * Vec3::NEG_Y, turn * Vec3::Y);
        let (mut under, mut open) = (0, 0);
        for (i, &light) in light.iter().enumerate().take(p.front) {
            let local = turn.transpose() * (p.position[i] - shift);
            if p.normal[i].dot(down) > 0.99 {
                assert_eq!(p.exposed[i], 0.0, "underside at {local}");
                assert_eq!(light, Rgb::ZERO, "underside at {local}");
                under += 1;
            }
            let covered = (local - Vec3::new(1.5, 0.0, 1.5)).abs().max_element();
            if p.normal[i].dot(up) > 0.99 && local.y.abs() < 0.01 && covered < 0.4 {
                assert_eq!(p.exposed[i], 0.0, "floor under the crate at {local}");
            }
            if p.normal[i].dot(up) > 0.99 && (local.y > 0.5 || covered > 0.7) {
                assert_eq!(p.exposed[i], 1.0, "open at {local}");
                open += 1;
            }
        }
        assert!(under >= 100 && open > 400, "{under} under, {open} open");
    }
}

#[test]
fn points_of_texels_that_a_crate_cuts_lie_beside_it() {
    let turn = Mat3::from_rotation_y(0.3);
    let floor = square(Vec3::ZERO, Vec3::Z * 3.0, Vec3::X * 3.0).to_vec();
    let middle = Vec3::new(1.5, 0.0, 1.5);
    let shape = solid(Vec3::new(-0.52, -0.1, -0.41), Vec3::new(0.52, 0.7, 0.41));
    let placed = shape.iter().map(|t| t.map(|corner| middle + turn * corner));
    let scene = support::scene_from_triangles(&floor.into_iter().chain(placed).collect::<Vec<_>>());
    let stage = Stage::new(&scene, 7.0);
    let patches = &stage.patches;
    let on_floor = |i: &usize| patches.normal[*i].y > 0.99 && patches.position[*i].y.abs() < 1e-4;
    let cut: Vec<usize> =
        (0..patches.front).filter(|i| on_floor(i) && patches.exposed[*i] > 0.0 && patches.exposed[*i] < 1.0).collect();
    assert!(cut.len() > 20, "{} texels are cut", cut.len());
    for i in cut {
        let surface = PatchSurface::new(&stage.tracer, patches, i);
        for k in 0..400 {
            let u = Vec2::new((k as f32 + 0.5) / 400.0, (k as f32 * 0.618_034).fract());
            let spot = surface.sample(u);
            let local = turn.transpose() * (scene.position(spot.point.triangle, spot.point.b) - middle);
            assert!(local.x.abs() > 0.52 || local.z.abs() > 0.41, "texel {i} starts light inside the crate at {local}");
        }
    }
}

#[test]
fn sheets_that_lie_on_each_other_stay_lit() {
    // A poster on a wall, both facing the room: whoever lies in front by chance, neither is sealed.
    let wall = square(Vec3::ZERO, Vec3::X * 2.0, Vec3::Y * 2.0);
    let poster = square(Vec3::new(0.5, 0.5, 0.0), Vec3::X, Vec3::Y);
    let mut scene = support::scene_from_triangles(&[wall, poster].concat());
    scene.sky = Sky::constant(Rgb::ONE);
    let stage = Stage::new(&scene, 8.0);
    assert!(stage.patches.exposed.iter().all(|&e| e == 1.0));
    // A sheet whose back is seen, on a floor that it faces.
    let floor = square(Vec3::ZERO, Vec3::Z * 2.0, Vec3::X * 2.0);
    let sheet = square(Vec3::ZERO, Vec3::X * 2.0, Vec3::Z * 2.0);
    let mut scene = support::scene_from_triangles(&[floor, sheet].concat());
    scene.materials[0].double_sided = true;
    scene.sky = Sky::constant(Rgb::ONE);
    let stage = Stage::new(&scene, 8.0);
    assert!(stage.patches.exposed.iter().all(|&e| e == 1.0));
}

#[test]
fn the_open_strip_of_a_texel_gets_its_light() {
    // A block against a wall ends 8 mm above the middle of a texel row of 100 mm: two fifths of the row are open.
    let wall = square(Vec3::ZERO, Vec3::X * 2.0, Vec3::Y * 1.0);
    let mut all = wall.to_vec();
    all.extend(solid(Vec3::new(0.0, 0.0, 0.0), Vec3::new(2.0, 0.558, 0.3)));
    let mut scene = support::scene_from_triangles(&all);
    let toward = Vec3::new(0.0, 1.0, 3.0).normalize();
    scene.lights.push(Light::Sun { direction: -toward, illuminance: Rgb::ONE, angle: 0.0 });
    let stage = Stage::new(&scene, 10.0);
    let (p, light) = (&stage.patches, stage.direct(16));
    let mut strips = 0;
    for i in (0..p.front).filter(|&i| p.normal[i].z > 0.99 && p.position[i].z < 0.01) {
        let partly = p.exposed[i] > 0.0 && p.exposed[i] < 1.0;
        strips += usize::from(partly);
        if p.exposed[i] > 0.0 {
            assert!((light[i].x / toward.z - 1.0).abs() < 1e-3, "{} at {}", light[i], p.position[i]);
        }
    }
    assert!(strips >= 10, "{strips} partly open texels");
}

#[test]
fn hidden_texels_that_nobody_reads_are_not_kept_from_being_filled() {
    let scene = load("office/office.glb");
    let unlit = Stage::new(&scene, 16.0).patches.unlit;
    assert!(unlit.len() > 100, "{}", unlit.len());
    assert!(unlit.iter().all(|texel| texel.weights.iter().any(|weight| *weight > 0.0)));
}
