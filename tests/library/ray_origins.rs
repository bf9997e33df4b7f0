//! Rays and segments that start on surfaces or in solids: they neither meet what they leave nor slip through what is
//! beside them.

use crate::support::{cuboid, direction, grid, place, scene_from_triangles, skew, stream};
use glam::{DMat3, DVec3, Vec2, Vec3};
use texelwalk::base::Stream;
use texelwalk::trace::{Closed, Ray, Tracer};

/// Scales [m] and offsets: 1 mm to 1 km, and far from the world's origin.
const PLACES: [(f64, f64); 5] = [(1e-3, 0.0), (1.0, 0.0), (1e3, 0.0), (1.0, 100.0), (1e3, 1e4)];

#[test]
fn segments_see_past_their_own_ends_only() {
    let mut shape = Vec::new();
    cuboid(DVec3::splat(-0.5), DVec3::splat(0.5), 3, true, &mut shape);
    for (scale, offset) in PLACES {
        for rotation in [DMat3::IDENTITY, skew()] {
            let triangles = place(&shape, rotation, scale, DVec3::splat(offset));
            let scene = scene_from_triangles(&triangles);
            let tracer = Tracer::new(&scene);
            let mut s = stream(8);
            let n = triangles.len() as u32;
            let mut clear = 0;
            for _ in 0..20_000 {
                let (i, j) = (s.next_u32() % n, s.next_u32() % n);
                if i / 18 == j / 18 {
                    continue;
                }
                let b = [interior(&mut s), interior(&mut s)];
                let (p, q) = (scene.position(i, b[0]), scene.position(j, b[1]));
                let (from, to) = (tracer.origin_on(i, b[0], q - p), tracer.origin_on(j, b[1], p - q));
                assert!(tracer.segment_clear(from, to), "{scale} m at {offset}: {from} {to}");
                let behind = tracer.origin_on(j, b[1], q - p);
                assert!(!tracer.segment_clear(from, behind), "{scale} m at {offset}: {from} {behind}");
                clear += 1;
            }
            assert!(clear > 10_000);
        }
    }
}

/// A point well inside of a triangle.
fn interior(s: &mut Stream) -> Vec2 {
    let (a, b) = (s.next_f32(), s.next_f32());
    let (a, b) = if a + b > 1.0 { (1.0 - a, 1.0 - b) } else { (a, b) };
    Vec2::new(a, b) * 0.9 + 0.1 / 3.0
}

/// Any point of a triangle, corners and edges often.
fn anywhere(s: &mut Stream) -> Vec2 {
    let corners = [Vec2::ZERO, Vec2::X, Vec2::Y];
    match s.next_u32() % 4 {
        0 => corners[s.next_u32() as usize % 3],
        1 => {
            let k = s.next_u32() as usize % 3;
            corners[k].lerp(corners[(k + 1) % 3], s.next_f32())
        }
        _ => interior(s),
    }
}

/// Rays that leave a flat surface, down to grazing ones: none may meet its own triangle, and none another triangle of the
/// surface, except where the corners' rounding tilts that one toward the ray.
#[test]
fn rays_that_leave_a_flat_surface_do_not_meet_it() {
    let mut shape = Vec::new();
    grid(DVec3::new(-0.5, 0.3, -0.5), DVec3::Z, DVec3::X, 7, 9, &mut shape);
    grid(DVec3::new(-0.5, 0.3, 0.5), DVec3::Z, DVec3::X, 1, 1, &mut shape);
    for (scale, offset) in PLACES.into_iter().chain([(10.0, 1e3)]) {
        for rotation in [DMat3::IDENTITY, skew()] {
            let triangles = place(&shape, rotation, scale, DVec3::splat(offset));
            let scene = scene_from_triangles(&triangles);
            let tracer = Tracer::new(&scene);
            let aligned = rotation == DMat3::IDENTITY;
            let step = f64::from(((offset + scale) as f32).next_up()) - f64::from((offset + scale) as f32);
            // Corners are off by up to half a step per axis; the shortest height of a cell is 0.08 of the scale.
            let tilt = if aligned { 0.0 } else { 4.0 * step / (0.08 * scale) };
            let mut s = stream(21);
            for i in 0..60_000 {
                let triangle = s.next_u32() % triangles.len() as u32;
                let b = anywhere(&mut s);
                let [p0, p1, p2] = scene.corners(triangle).map(|p| p.as_dvec3());
                let n = (p1 - p0).cross(p2 - p0).normalize();
                let side = if s.next_u32().is_multiple_of(2) { n } else { -n };
                let mut d = direction(&mut s);
                let lift = [1.0, 1e-2, 1e-4, 1e-6, 1e-9][i % 5] + tilt;
                d = (d - side * d.dot(side) + side * (d.dot(side).abs() * lift).max(tilt)).normalize();
                let ray = Ray { origin: Vec3::ZERO, direction: d.as_vec3(), t_max: f32::INFINITY };
                if ray.direction.as_dvec3().dot(side) <= tilt * 0.5 {
                    continue;
                }
                let ray = Ray { origin: tracer.origin_on(triangle, b, ray.direction), ..ray };
                let hit = tracer.closest_hit(&ray);
                assert!(
                    hit.is_none(),
                    "{scale} m at {offset}, aligned {aligned}, from {triangle} {b}: {ray:?} {hit:?}"
                );
                let push = (ray.origin.as_dvec3() - p0).dot(side);
                let bound = 4.0 * step * (side.x.abs() + side.y.abs() + side.z.abs());
                assert!(push > 0.0 && push <= bound, "{scale} m at {offset}: push {push:e}, bound {bound:e}");
            }
        }
    }
}

/// Rays from anywhere on the inside of a closed room, also from its very corners and edges, never get out.
#[test]
fn rays_that_start_on_the_walls_of_a_room_stay_in_it() {
    let mut shape = Vec::new();
    cuboid(DVec3::splat(-0.5), DVec3::splat(0.5), 3, true, &mut shape);
    for (scale, offset) in PLACES {
        let offset = DVec3::new(offset, -0.37 * offset, 0.11 * offset);
        for rotation in [DMat3::IDENTITY, skew()] {
            let triangles = place(&shape, rotation, scale, offset);
            let scene = scene_from_triangles(&triangles);
            let tracer = Tracer::new(&scene);
            let mut s = stream(31);
            for _ in 0..40_000 {
                let triangle = s.next_u32() % triangles.len() as u32;
                let b = anywhere(&mut s);
                let n = scene.geometric_normal(triangle);
                let d = (n.as_dvec3() * (1.0 + 1e-4) + direction(&mut s)).as_vec3();
                let origin = tracer.origin_on(triangle, b, d);
                let ray = Ray { origin, direction: d, t_max: f32::INFINITY };
                let hit = tracer.closest_hit(&ray);
                let where_from = format!("{scale} m at {offset}, from {triangle} {b}: {ray:?}");
                assert!(hit.is_some_and(|h| h.front && h.triangle != triangle), "{where_from} {hit:?}");
            }
        }
    }
}

#[test]
fn rays_leave_the_solid_that_they_begin_in_whatever_goes_through_it() {
    let mut boxes = vec![];
    // Two that go through each other, in a room that shares a wall with the next one.
    cuboid(DVec3::new(0.0, 0.0, 0.0), DVec3::new(1.0, 4.0, 1.0), 1, false, &mut boxes);
    cuboid(DVec3::new(-2.0, 2.0, -2.0), DVec3::new(2.0, 2.5, 2.0), 1, false, &mut boxes);
    cuboid(DVec3::splat(-9.0), DVec3::splat(9.0), 1, true, &mut boxes);
    cuboid(DVec3::new(9.0, -9.0, -9.0), DVec3::new(27.0, 9.0, 9.0), 1, true, &mut boxes);
    let scene = scene_from_triangles(&boxes.iter().map(|t| t.map(|p| p.as_vec3())).collect::<Vec<_>>());
    let (tracer, closed) = (Tracer::new(&scene), Closed::new(&scene));
    let mut s = stream(11);
    for _ in 0..2000 {
        let direction = direction(&mut s).as_vec3();
        let leaves = |x: f32, y: f32, z: f32| {
            tracer.leaves_solid(&Ray { origin: Vec3::new(x, y, z), direction, t_max: f32::INFINITY }, &closed)
        };
        // In the one, in the other, in both.
        for inside in [leaves(0.4, 1.7, 0.6), leaves(1.5, 2.2, -1.6), leaves(0.4, 2.3, 0.6)] {
            assert_eq!(inside, Some(true), "{direction}");
        }
        // Beside them: never, or unknown through the wall that two rooms share.
        for outside in [leaves(1.4, 1.7, 0.6), leaves(-5.0, 3.0, 2.0), leaves(12.0, 1.0, 3.0)] {
            assert_ne!(outside, Some(true), "{direction}");
        }
    }
    let nowhere = Ray { origin: Vec3::splat(0.4), direction: Vec3::ZERO, t_max: f32::INFINITY };
    assert_eq!(tracer.leaves_solid(&nowhere, &closed), Some(false));
}

#[test]
fn rays_leave_a_closed_solid_through_a_sheet_that_cuts_it() {
    let mut faces = vec![];
    cuboid(DVec3::new(0.0, -1.0, 0.0), DVec3::new(1.0, 4.0, 1.0), 2, false, &mut faces);
    let wall = faces.len();
    // The ground, seen from above.
    let [a, b, c, d] = [[-9.0, -9.0], [-9.0, 9.0], [9.0, 9.0], [9.0, -9.0]].map(|[x, z]| DVec3::new(x, 0.0, z));
    faces.extend([[a, b, c], [a, c, d]]);
    let ask = |faces: &[[DVec3; 3]], origin: Vec3, direction: Vec3| {
        let scene = scene_from_triangles(&faces.iter().map(|t| t.map(|p| p.as_vec3())).collect::<Vec<_>>());
        let ray = Ray { origin, direction, t_max: f32::INFINITY };
        Tracer::new(&scene).leaves_solid(&ray, &Closed::new(&scene))
    };
    let (within, beside) = (Vec3::new(0.4, 0.7, 0.6), Vec3::new(1.4, 0.7, 0.6));
    let mut s = stream(12);
    for _ in 0..300 {
        let direction = direction(&mut s).as_vec3();
        assert_eq!(ask(&faces, within, direction), Some(true), "{direction}");
        assert_ne!(ask(&faces, beside, direction), Some(true), "{direction}");
    }
    // Without its lid it is no closed solid, and the ground and its foot cancel out.
    faces.truncate(wall + 2);
    let open: Vec<_> = faces.iter().filter(|t| t.iter().any(|p| p.y < 3.9)).copied().collect();
    assert!(open.len() < faces.len());
    assert_eq!(ask(&open, within, Vec3::new(0.01, -1.0, 0.02)), Some(false));
}
