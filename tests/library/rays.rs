//! Ray queries against an independent reference: brute force over all triangles, Möller–Trumbore in f64.
//!
//! A *tie* is a ray whose answer rounding may change: the two answers are the same point within a few parts in 10¹² of
//! the scene across the ray, and one f32 step along it; or the ray starts exactly on a triangle. Ties are counted,
//! printed and bounded; anything else is a fault.

#![allow(clippy::print_stdout, reason = "figures of the slow tests")]

use crate::support::{
    blob, cuboid, direction, grid, place, point, room, scene_from_triangles, scene_with_material, skew,
};
use crate::support::{soup, stream, white};
use glam::{DMat3, DVec3, Vec2, Vec3};
use texelwalk::base::{Stream, parallel};
use texelwalk::scene::{Alpha, Scene};
use texelwalk::trace::{Hit, Ray, Tracer};

/// A triangle of the reference.
struct Plain {
    p: DVec3,
    e1: DVec3,
    e2: DVec3,
}

/// What the reference knows of a ray and a triangle: t, weights of the three corners, side.
#[derive(Debug, Clone, Copy)]
struct Meeting {
    triangle: u32,
    t: f64,
    weights: [f64; 3],
    front: bool,
}

impl Meeting {
    fn t32(&self) -> f32 {
        self.t as f32
    }

    /// Nearest first, of those fronts first.
    fn order(&self) -> (f32, bool) {
        (self.t32(), !self.front)
    }
}

fn plain(triangles: &[[Vec3; 3]]) -> Vec<Plain> {
    let d = triangles.iter().map(|t| t.map(|p| p.as_dvec3()));
    d.map(|[a, b, c]| Plain { p: a, e1: b - a, e2: c - a }).collect()
}

/// The line of the ray against the plane of the triangle.
fn meeting(triangle: usize, tri: &Plain, o: DVec3, d: DVec3) -> Option<Meeting> {
    let q = d.cross(tri.e2);
    let det = tri.e1.dot(q);
    if det == 0.0 {
        return None;
    }
    let s = o - tri.p;
    let r = s.cross(tri.e1);
    let (b1, b2) = (s.dot(q) / det, d.dot(r) / det);
    let t = tri.e2.dot(r) / det;
    Some(Meeting { triangle: triangle as u32, t, weights: [1.0 - b1 - b2, b1, b2], front: det > 0.0 })
}

/// Nearest by (f32 distance, side, index).
fn reference(tris: &[Plain], ray: &Ray) -> Option<Meeting> {
    let (o, d) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
    let mut best: Option<Meeting> = None;
    for (i, tri) in tris.iter().enumerate() {
        // Early way out that a vectoriser likes; the rest is rare.
        let Some(m) = meeting(i, tri, o, d) else { continue };
        let inside = m.weights[1] >= 0.0 && m.weights[2] >= 0.0 && m.weights[0] >= 0.0;
        if inside && m.t32() > 0.0 && m.t32() < ray.t_max && best.is_none_or(|b| m.order() < b.order()) {
            best = Some(m);
        }
    }
    best
}

/// The result of a comparison.
#[derive(Default, Debug)]
struct Tally {
    rays: usize,
    hits: usize,
    ties: Vec<String>,
    faults: Vec<String>,
}

impl Tally {
    fn add(&mut self, other: Self) {
        self.rays += other.rays;
        self.hits += other.hits;
        self.ties.extend(other.ties);
        self.faults.extend(other.faults);
    }

    fn expect_ties_below(&self, part: f64) {
        assert!(self.faults.is_empty(), "{} faults, first: {}", self.faults.len(), self.faults[0]);
        assert!(self.hits * 20 > self.rays, "the test hits next to nothing: {} of {}", self.hits, self.rays);
        let limit = (part * self.rays as f64) as usize;
        assert!(self.ties.len() <= limit, "{} ties of {} rays: {:#?}", self.ties.len(), self.rays, self.ties);
    }
}

/// Whether rounding may accept this meeting: the point is within 10⁻¹² of the distances involved of the triangle.
fn borderline(tri: &Plain, m: &Meeting, ray: &Ray) -> bool {
    let (o, d) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
    let reach = (tri.p - o).length() + tri.e1.length() + tri.e2.length();
    let normal = tri.e1.cross(tri.e2);
    let cosine = (normal.dot(d) / (normal.length() * d.length())).abs();
    let edges = [(tri.e2 - tri.e1).length(), tri.e2.length(), tri.e1.length()];
    (0..3).all(|i| m.weights[i] * normal.length() / edges[i] * cosine >= -1e-12 * reach)
}

fn same_distance(a: f32, b: f32) -> bool {
    a == b || a == b.next_up() || a == b.next_down()
}

/// Compares one ray; pushes what differs.
fn compare(tracer: &Tracer<'_>, tris: &[Plain], ray: &Ray, tally: &mut Tally) {
    let expected = reference(tris, ray);
    let found = tracer.closest_hit(ray);
    tally.rays += 1;
    tally.hits += usize::from(expected.is_some());
    if tracer.occluded(ray) != found.is_some() {
        tally.faults.push(format!("occluded differs from closest_hit: {ray:?} {found:?}"));
    }
    let story = || format!("{ray:?} expected {expected:?} found {found:?}");
    let (o, d) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
    let again = |triangle: u32| meeting(triangle as usize, &tris[triangle as usize], o, d);
    let may_hit = |m: Option<Meeting>| m.is_some_and(|m| borderline(&tris[m.triangle as usize], &m, ray));
    match (&expected, &found) {
        (None, None) => {}
        (Some(e), Some(f)) if e.triangle == f.triangle => {
            if !agrees(e, f) {
                tally.faults.push(story());
            }
        }
        // Two triangles at the same distance, of which the found one may be hit; or one of them is met at its border.
        (Some(e), Some(f)) => {
            let mine = again(f.triangle);
            let border =
                |m: &Meeting| m.weights.iter().any(|w| w.abs() < 1e-9) || grazes(&tris[m.triangle as usize], d);
            let free = |m: &Meeting| border(m) || mine_at_limit(Some(*m), ray);
            let legal = may_hit(mine) && (same_distance(e.t32(), f.t) || free(e) || mine.is_some_and(|m| free(&m)));
            if legal { &mut tally.ties } else { &mut tally.faults }.push(story());
        }
        (None, Some(f)) => {
            let edge = mine_at_limit(again(f.triangle), ray);
            if edge || may_hit(again(f.triangle)) { &mut tally.ties } else { &mut tally.faults }.push(story());
        }
        (Some(e), None) => {
            let border = e.weights.iter().any(|w| w.abs() < 1e-9) || grazes(&tris[e.triangle as usize], d);
            let edge = border || mine_at_limit(Some(*e), ray);
            if edge { &mut tally.ties } else { &mut tally.faults }.push(story());
        }
    }
}

/// The hit is within one f32 step of `t_max`, or the ray starts on the triangle (rounding decides on which side).
fn mine_at_limit(m: Option<Meeting>, ray: &Ray) -> bool {
    let on_it = |m: Meeting| m.t.abs() * f64::from(ray.direction.length()) < 1e-15 * f64::from(ray.origin.length());
    m.is_some_and(|m| same_distance(m.t32(), ray.t_max) || on_it(m))
}

/// The ray is within 10⁻⁹ rad of the triangle's plane.
fn grazes(tri: &Plain, d: DVec3) -> bool {
    let n = tri.e1.cross(tri.e2);
    n.dot(d).abs() < 1e-9 * n.length() * d.length()
}

/// Distance, weights and side of the same triangle. The weights of a sliver amplify rounding, hence the floor.
fn agrees(e: &Meeting, f: &Hit) -> bool {
    same_distance(e.t32(), f.t)
        && (f64::from(f.b.x) - e.weights[1]).abs() < 1e-5
        && (f64::from(f.b.y) - e.weights[2]).abs() < 1e-5
        && e.front == f.front
}

/// Rays from everywhere to everywhere: half lines, segments, directions of any length, some along the axes.
fn random_ray(s: &mut Stream, scale: f64, offset: DVec3) -> Ray {
    let origin = (point(s) * scale * 1.3 + offset).as_vec3();
    let mut d = direction(s) * scale * [1.0, 1.0, 1e-3, 1e4][s.next_u32() as usize % 4];
    let kind = s.next_u32() % 16;
    if kind < 3 {
        d[kind as usize] = 0.0;
    } else if kind == 3 {
        d = DVec3::AXES[s.next_u32() as usize % 3] * if s.next_u32().is_multiple_of(2) { d.x } else { -1.0 };
    }
    let t_max = if kind.is_multiple_of(4) { s.next_f32() * 2.0 * (scale / d.length()) as f32 } else { f32::INFINITY };
    Ray { origin, direction: d.as_vec3(), t_max }
}

/// `rays` random rays against brute force.
fn check(triangles: &[[Vec3; 3]], rays: usize, seed: u64, ray: impl Fn(&mut Stream) -> Ray + Sync) -> Tally {
    let scene = scene_from_triangles(triangles);
    let tracer = Tracer::new(&scene);
    let tris = plain(triangles);
    let chunks = parallel::map_chunks(rays, 2000, |range| {
        let mut tally = Tally::default();
        let mut s = stream(seed ^ (range.start as u64) << 20);
        for _ in range {
            compare(&tracer, &tris, &ray(&mut s), &mut tally);
        }
        tally
    });
    let mut total = Tally::default();
    chunks.into_iter().for_each(|t| total.add(t));
    total
}

/// Scales [m] and offsets of the comparisons: 1 mm to 1 km, and far from the world's origin.
const PLACES: [(f64, f64); 5] = [(1e-3, 0.0), (1.0, 0.0), (1e3, 0.0), (1.0, 100.0), (1e3, 1e4)];

fn three_scenes() -> [(&'static str, Vec<[DVec3; 3]>, DMat3); 3] {
    [("soup", soup(300, 0.4, 1), DMat3::IDENTITY), ("room", room(5), DMat3::IDENTITY), ("blob", blob(8, 0.1), skew())]
}

fn random_rays_agree(rays_per_case: usize) -> Tally {
    let mut total = Tally::default();
    for (name, shape, rotation) in three_scenes() {
        for (i, (scale, offset)) in PLACES.into_iter().enumerate() {
            let offset = DVec3::new(offset, -0.37 * offset, 0.11 * offset);
            let triangles = place(&shape, rotation, scale, offset);
            let tally = check(&triangles, rays_per_case, i as u64, |s| random_ray(s, scale, offset));
            println!(
                "{name} {scale} m at {offset}: {} rays, {} hits, {} ties",
                tally.rays,
                tally.hits,
                tally.ties.len()
            );
            total.add(tally);
        }
    }
    for tie in &total.ties {
        println!("tie: {tie}");
    }
    total
}

#[test]
fn random_rays_agree_with_brute_force_in_every_hit() {
    random_rays_agree(8_000).expect_ties_below(1e-4);
}

#[test]
#[ignore = "slow: 15 s"]
fn three_million_random_rays_agree_with_brute_force_in_every_hit() {
    let tally = random_rays_agree(201_000);
    assert!(tally.rays >= 3_000_000);
    tally.expect_ties_below(1e-5);
}

#[test]
fn deep_hierarchies_agree_with_brute_force() {
    for (shape, seed) in [(soup(20_000, 0.05, 9), 1), (blob(50, 0.05), 2)] {
        let triangles = place(&shape, skew(), 10.0, DVec3::ZERO);
        check(&triangles, 1500, seed, |s| random_ray(s, 10.0, DVec3::ZERO)).expect_ties_below(1e-3);
    }
}

/// Rays along the axes through vertices and edges of an axis-parallel grid: the plane of a box side and a zero component
/// of the direction at once. Such rays tie by construction, but none may be lost.
#[test]
fn axis_parallel_rays_on_box_borders_are_not_lost() {
    let triangles = place(&room(4), DMat3::IDENTITY, 1.0, DVec3::ZERO);
    let scene = scene_from_triangles(&triangles);
    let tracer = Tracer::new(&scene);
    for axis in 0..3 {
        for sign in [1.0, -1.0, 1e-30, -1e30] {
            for i in 0..=16 {
                for j in 0..=16 {
                    for zero in [0.0, -0.0] {
                        let mut origin = Vec3::ZERO;
                        origin[(axis + 1) % 3] = i as f32 / 16.0 - 0.5;
                        origin[(axis + 2) % 3] = j as f32 / 16.0 - 0.5;
                        let mut direction = Vec3::splat(zero);
                        direction[axis] = sign;
                        let ray = Ray { origin, direction, t_max: f32::INFINITY };
                        assert!(tracer.closest_hit(&ray).is_some() && tracer.occluded(&ray), "{ray:?}");
                    }
                }
            }
        }
    }
}

/// Distances of exactly equal triangles: the front wins, then the smallest index, whatever the order in memory and of
/// corners.
#[test]
fn coplanar_twins_give_the_front_and_the_smallest_index() {
    let shape = place(&blob(6, 0.1), skew(), 1.0, DVec3::ZERO);
    let n = shape.len();
    let mut triangles = shape.clone();
    triangles.extend(shape.iter().rev().map(|&[a, b, c]| [b, c, a]));
    triangles.extend(shape.iter().map(|&[a, b, c]| [c, b, a]));
    let scene = scene_from_triangles(&triangles);
    let tracer = Tracer::new(&scene);
    let mut s = stream(4);
    let (mut hits, mut rounded) = ([0, 0], 0);
    for _ in 0..50_000 {
        let ray = random_ray(&mut s, 1.0, DVec3::ZERO);
        let Some(hit) = tracer.closest_hit(&ray) else { continue };
        let triangle = hit.triangle as usize;
        hits[usize::from(triangle < n)] += 1;
        // Turned corners round t differently in the last bit of f64, which shows in f32 once in 2²⁹ or so.
        rounded += usize::from(!hit.front || (n..2 * n).contains(&triangle));
    }
    assert!(hits[0] + hits[1] > 15_000 && hits[0].min(hits[1]) > 1_000 && rounded == 0, "{hits:?} {rounded}");
}

/// Rays from inside a closed surface, aimed exactly at vertices and at points of edges.
fn escapes(shape: &[[DVec3; 3]], rotation: DMat3, scale: f64, offset: DVec3, rays: usize, seed: u64) -> usize {
    let triangles = place(shape, rotation, scale, offset);
    let scene = scene_from_triangles(&triangles);
    let tracer = Tracer::new(&scene);
    let count = parallel::map_chunks(rays, 10_000, |range| {
        let mut s = stream(seed ^ (range.start as u64) << 20);
        let mut escaped = 0;
        for i in range {
            let t = triangles[s.next_u32() as usize % triangles.len()];
            let k = s.next_u32() as usize % 3;
            let along = [0.0, 0.5, s.next_f32()][i % 3];
            let target = t[k] + (t[(k + 1) % 3] - t[k]) * along;
            let inside = rotation * point(&mut s) * 0.3 * scale + offset;
            let origin = if i % 5 == 0 { offset.as_vec3() } else { inside.as_vec3() };
            let ray = Ray { origin, direction: target - origin, t_max: f32::INFINITY };
            escaped += usize::from(tracer.closest_hit(&ray).is_none());
        }
        escaped
    });
    count.into_iter().sum()
}

#[test]
fn closed_surfaces_let_no_ray_aimed_at_an_edge_or_vertex_out() {
    let mut cube = Vec::new();
    cuboid(DVec3::splat(-0.5), DVec3::splat(0.5), 3, true, &mut cube);
    for (scale, offset) in PLACES {
        let offset = DVec3::new(offset, -0.37 * offset, 0.11 * offset);
        for rotation in [DMat3::IDENTITY, skew()] {
            for shape in [&cube, &blob(20, 0.05), &blob(3, 0.0)] {
                assert_eq!(escapes(shape, rotation, scale, offset, 34_000, 5), 0, "{scale} m at {offset}");
            }
        }
    }
}

#[test]
fn broken_and_degenerate_input_is_left_out() {
    let good = [Vec3::ZERO, Vec3::X, Vec3::Y];
    let mut triangles = vec![[Vec3::ZERO; 3], [Vec3::ZERO, Vec3::X, Vec3::X * 0.5]];
    for v in [f32::INFINITY, f32::NEG_INFINITY, f32::NAN] {
        triangles.push([Vec3::ZERO, Vec3::new(v, 0.0, 0.0), Vec3::Y]);
    }
    triangles.push(good);
    let scene = scene_from_triangles(&triangles);
    let tracer = Tracer::new(&scene);
    assert_eq!(tracer.triangle_count(), 1);
    assert_eq!(tracer.bounds(), (Vec3::ZERO, Vec3::new(1.0, 1.0, 0.0)));
    let ray = Ray { origin: Vec3::new(0.25, 0.25, 1.0), direction: Vec3::NEG_Z, t_max: f32::INFINITY };
    assert_eq!(tracer.closest_hit(&ray), Some(Hit { triangle: 5, b: Vec2::splat(0.25), t: 1.0, front: true }));
    assert!(!tracer.occluded(&Ray { t_max: 1.0, ..ray }));
    assert!(tracer.occluded(&Ray { t_max: 1.0f32.next_up(), ..ray }));
}

#[test]
fn broken_rays_are_refused() {
    let scene =
        scene_from_triangles(&[[Vec3::new(-1.0, -1.0, 1.0), Vec3::new(3.0, -1.0, 1.0), Vec3::new(-1.0, 3.0, 1.0)]]);
    for tracer in [Tracer::new(&scene), Tracer::new(&scene).portable()] {
        let met = |origin: Vec3, direction: Vec3, t_max: f32| {
            let ray = Ray { origin, direction, t_max };
            let hit = tracer.closest_hit(&ray).is_some();
            assert_eq!(hit, tracer.occluded(&ray));
            hit
        };
        assert!(met(Vec3::ZERO, Vec3::Z, 2.0) && met(Vec3::ZERO, Vec3::Z, f32::INFINITY));
        assert!(met(Vec3::ZERO, Vec3::Z * 1e-38, f32::MAX) && met(Vec3::ZERO, Vec3::Z * f32::MAX, 1.0));
        for v in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            assert!(!met(Vec3::new(0.0, v, 0.0), Vec3::Z, 2.0));
            assert!(!met(Vec3::ZERO, Vec3::new(0.0, v, 1.0), 2.0));
            assert!(tracer.segment_clear(Vec3::ZERO, Vec3::new(0.0, v, 2.0)));
        }
        for t_max in [f32::NAN, 0.0, -1.0, f32::NEG_INFINITY] {
            assert!(!met(Vec3::ZERO, Vec3::Z, t_max));
        }
        assert!(!met(Vec3::ZERO, Vec3::ZERO, 2.0));
        assert!(!tracer.segment_clear(Vec3::ZERO, Vec3::Z * 2.0) && tracer.segment_clear(Vec3::ZERO, Vec3::ZERO));
    }
}

#[test]
fn empty_scenes_meet_nothing() {
    let scene = Scene::default();
    let tracer = Tracer::new(&scene);
    let ray = Ray { origin: Vec3::ZERO, direction: Vec3::X, t_max: f32::INFINITY };
    assert!(tracer.closest_hit(&ray).is_none() && !tracer.occluded(&ray));
    assert!(tracer.segment_clear(Vec3::ZERO, Vec3::X));
    assert_eq!((tracer.bounds(), tracer.node_count()), ((Vec3::ZERO, Vec3::ZERO), 0));
}

/// Every count around the sizes of packets and nodes, heaps of equal triangles, and the ends of f32's range.
#[test]
fn every_size_and_scale_builds() {
    let hit_all = |triangles: &[[Vec3; 3]], what: &str| {
        let scene = scene_from_triangles(triangles);
        let tracer = Tracer::new(&scene);
        assert_eq!(tracer.triangle_count(), triangles.len(), "{what}");
        for t in triangles.iter().take(100) {
            let centre = t[0] / 3.0 + t[1] / 3.0 + t[2] / 3.0;
            let size = (t[1] - t[0]).abs().max_element();
            let origin = centre + Vec3::new(0.0, 0.0, size);
            let ray = Ray { origin, direction: Vec3::NEG_Z, t_max: f32::INFINITY };
            let hit = tracer.closest_hit(&ray).unwrap_or_else(|| panic!("{what}: {ray:?}"));
            assert_eq!(triangles[hit.triangle as usize].map(|p| p.z), t.map(|p| p.z), "{what}");
        }
    };
    let at = |x: f32, s: f32| [Vec3::new(x, 0.0, 0.0), Vec3::new(x + s, 0.0, 0.0), Vec3::new(x, s, 0.0)];
    for n in 1..=40 {
        hit_all(&(0..n).map(|i| at(i as f32, 0.5)).collect::<Vec<_>>(), "row");
    }
    for n in [2, 9, 1000] {
        hit_all(&vec![at(1.0, 1.0); n], "heap");
    }
    for size in [1e-30, 1e-18, 1e18, 1e30] {
        let row: Vec<_> = (0..50).map(|i| at(i as f32 * size, 0.5 * size)).collect();
        hit_all(&row, &format!("size {size}"));
    }
}

/// Answers as bytes, for comparisons.
fn answers(tracer: &Tracer<'_>, rays: usize) -> Vec<u64> {
    let chunks = parallel::map_chunks(rays, 1000, |range| {
        let mut s = stream(range.start as u64);
        range
            .flat_map(|_| {
                let hit = tracer.closest_hit(&random_ray(&mut s, 1.0, DVec3::ZERO));
                hit.map_or([u64::MAX; 2], |h| {
                    let b = u64::from(h.b.x.to_bits()) << 32 | u64::from(h.b.y.to_bits());
                    [u64::from(h.triangle) << 33 | u64::from(h.t.to_bits()) << 1 | u64::from(h.front), b]
                })
            })
            .collect::<Vec<_>>()
    });
    chunks.into_iter().flatten().collect()
}

#[test]
fn the_same_bytes_from_any_number_of_threads() {
    let triangles = place(&soup(60_000, 0.06, 5), skew(), 1.0, DVec3::ZERO);
    let scene = scene_from_triangles(&triangles);
    let results: Vec<_> = [1, 2, 8]
        .into_iter()
        .map(|threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let tracer = Tracer::new(&scene);
                (answers(&tracer, 40_000), tracer.node_count(), tracer.memory_bytes())
            })
        })
        .collect();
    assert!(results[0].0.iter().filter(|&&v| v != u64::MAX).count() > 15_000);
    assert!(results.windows(2).all(|w| w[0] == w[1]));
}

/// What the CPU offers changes the speed only: every hit has the same bits without it.
#[test]
fn the_same_bytes_on_any_cpu() {
    for (shape, rotation) in [(soup(60_000, 0.06, 5), skew()), (room(5), DMat3::IDENTITY), (blob(30, 0.1), skew())] {
        let triangles = place(&shape, rotation, 1.0, DVec3::ZERO);
        let scene = scene_from_triangles(&triangles);
        let (fast, portable) = (Tracer::new(&scene), Tracer::new(&scene).portable());
        assert_eq!(answers(&fast, 60_000), answers(&portable, 60_000));
        let mut s = stream(40);
        for _ in 0..60_000 {
            let ray = random_ray(&mut s, 1.0, DVec3::ZERO);
            assert_eq!(fast.occluded(&ray), portable.occluded(&ray), "{ray:?}");
            let end = ray.origin + ray.direction;
            assert_eq!(fast.segment_clear(ray.origin, end), portable.segment_clear(ray.origin, end), "{ray:?}");
        }
    }
}

#[test]
fn front_is_the_side_that_corners_go_round_counter_clockwise() {
    let triangles = place(&soup(200, 0.5, 12), skew(), 1.0, DVec3::ZERO);
    let scene = scene_from_triangles(&triangles);
    let tracer = Tracer::new(&scene);
    let mut s = stream(12);
    let mut seen = [0, 0];
    for _ in 0..20_000 {
        let ray = random_ray(&mut s, 1.0, DVec3::ZERO);
        let Some(hit) = tracer.closest_hit(&ray) else { continue };
        let [a, b, c] = triangles[hit.triangle as usize].map(|p| p.as_dvec3());
        let cosine = (b - a).cross(c - a).normalize().dot(ray.direction.as_dvec3().normalize());
        if cosine.abs() > 1e-9 {
            assert_eq!(hit.front, cosine < 0.0);
            seen[usize::from(hit.front)] += 1;
        }
    }
    assert!(seen[0] > 1000 && seen[1] > 1000);
}

/// Part of the cosine-weighted rays from below that get through a square of 1 m at y = 0.
fn transmitted(scene: &Scene, rays: usize) -> f64 {
    let tracer = Tracer::new(scene);
    let mut s = stream(77);
    let mut through = 0;
    for _ in 0..rays {
        let target = Vec3::new(s.next_f32(), 0.0, s.next_f32());
        let mut d = direction(&mut s).as_vec3();
        d.y = d.y.abs() + 0.05;
        let ray = Ray { origin: target - d, direction: d, t_max: f32::INFINITY };
        let hit = tracer.closest_hit(&ray).is_some();
        assert_eq!(tracer.occluded(&ray), hit, "{ray:?}");
        assert_eq!(tracer.closest_hit(&ray).is_some(), hit, "the same ray must get the same answer");
        through += usize::from(!hit);
    }
    through as f64 / rays as f64
}

fn square(cells: usize) -> Vec<[Vec3; 3]> {
    let mut shape = Vec::new();
    grid(DVec3::ZERO, DVec3::Z, DVec3::X, cells, cells, &mut shape);
    place(&shape, DMat3::IDENTITY, 1.0, DVec3::ZERO)
}

#[test]
fn a_checkerboard_mask_transmits_half_of_the_rays() {
    let mut material = white();
    material.alpha = Alpha::Mask(0.5);
    let cells = 16;
    let mut scene = scene_with_material(&square(cells), material);
    for (i, color) in scene.vertices.color.iter_mut().enumerate() {
        let cell = i / 6;
        color.w = ((cell / cells + cell % cells) % 2) as f32;
    }
    let part = transmitted(&scene, 200_000);
    assert!((part - 0.5).abs() < 0.005, "{part}");
}

#[test]
fn a_mask_cuts_inside_of_a_triangle() {
    let mut material = white();
    material.alpha = Alpha::Mask(0.75);
    let mut scene = scene_with_material(&square(1), material);
    for (color, p) in scene.vertices.color.iter_mut().zip(&scene.vertices.position) {
        color.w = p.x;
    }
    let part = transmitted(&scene, 200_000);
    assert!((part - 0.75).abs() < 0.005, "{part}");
}

#[test]
fn a_blend_of_alpha_three_tenths_transmits_seven_tenths() {
    let mut material = white();
    material.alpha = Alpha::Blend;
    material.base_color.w = 0.3;
    let part = transmitted(&scene_with_material(&square(4), material.clone()), 200_000);
    assert!((part - 0.7).abs() < 0.005, "{part}");
    // Two sheets decide independently.
    let mut twice = square(4);
    twice.extend(square(4).iter().map(|t| t.map(|p| p + Vec3::Y * 1e-3)));
    let part = transmitted(&scene_with_material(&twice, material), 200_000);
    assert!((part - 0.49).abs() < 0.005, "{part}");
}

#[test]
fn what_lies_in_a_box_is_what_asking_every_triangle_tells() {
    let mut s = stream(5);
    let mut at = |size: f32| point(&mut s).as_vec3() * size;
    let triangle = |at: Vec3, a: Vec3, b: Vec3| [at, at + a, at + b];
    let triangles: Vec<[Vec3; 3]> = (0..3000).map(|_| triangle(at(20.0), at(1.0), at(1.0))).collect();
    let scene = scene_from_triangles(&triangles);
    let tracer = Tracer::new(&scene);
    let (mut some, mut none) = (0, 0);
    for _ in 0..2000 {
        let (center, size) = (at(22.0), at(2.0).abs());
        let (low, high) = (center - size, center + size);
        let meets = |t: &[Vec3; 3]| {
            let (from, to) = (t[0].min(t[1]).min(t[2]), t[0].max(t[1]).max(t[2]));
            from.cmple(high).all() && to.cmpge(low).all()
        };
        // Every second triangle is as good as not there.
        let expected = triangles.iter().step_by(2).any(meets);
        assert_eq!(tracer.any_within(low, high, |t| t.is_multiple_of(2)), expected, "{low} to {high}");
        *(if expected { &mut some } else { &mut none }) += 1;
    }
    assert!(some > 200 && none > 200, "{some}, {none}");
}
