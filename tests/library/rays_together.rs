//! Rays that are traced together meet what each of them meets alone, bit for bit: whatever is beside them, however many they
//! are, on any CPU, and if they say which triangle they leave.

use crate::support::{blob, direction, place, room, scene_from_triangles, skew, soup, stream};
use glam::{DMat3, DVec3, Vec2, Vec3};
use texelwalk::base::Stream;
use texelwalk::scene::Scene;
use texelwalk::trace::{Hit, Ray, Rays, Tracer};

/// Numbers of rays around the number that is on the way at once.
const SIZES: [usize; 9] = [1, 2, 3, 4, 5, 7, 8, 64, 3000];

fn bits(hit: Option<Hit>) -> Option<(u32, [u32; 3], bool)> {
    hit.map(|h| (h.triangle, [h.b.x, h.b.y, h.t].map(f32::to_bits), h.front))
}

/// One in seven is broken, far out, or has no length.
fn ray(s: &mut Stream, k: usize) -> Ray {
    let origin = Vec3::from_array([(); 3].map(|()| s.next_f32() * 2.0 - 1.0));
    let t_max = if k.is_multiple_of(3) { 0.5 * s.next_f32() } else { f32::INFINITY };
    let ray = Ray { origin, direction: direction(s).as_vec3(), t_max };
    match k % 28 {
        0 => Ray { direction: Vec3::ZERO, ..ray },
        7 => Ray { origin: Vec3::new(f32::NAN, 0.0, 0.0), ..ray },
        14 => Ray { t_max: 0.0, ..ray },
        21 if k.is_multiple_of(5) => Ray { origin: ray.origin - ray.direction * 3e8, ..ray },
        _ => ray,
    }
}

fn scenes() -> Vec<Scene> {
    let shapes = [(soup(3000, 0.15, 5), skew()), (room(5), DMat3::IDENTITY), (blob(20, 0.1), skew())];
    shapes.into_iter().map(|(s, turn)| scene_from_triangles(&place(&s, turn, 1.0, DVec3::ZERO))).collect()
}

fn agree(tracer: &Tracer<'_>, rays: &[(Ray, Option<u32>)]) -> usize {
    let (mut together, mut met) = (Rays::with_capacity(8), 0);
    for (ray, from) in rays {
        together.add(ray, *from);
    }
    assert_eq!((together.len(), together.is_empty()), (rays.len(), rays.is_empty()));
    let hits = tracer.closest_hits(&mut together).to_vec();
    assert_eq!(hits.len(), rays.len());
    for ((ray, _), hit) in rays.iter().zip(&hits) {
        assert_eq!(bits(*hit), bits(tracer.closest_hit(ray)), "{ray:?}");
        met += usize::from(hit.is_some());
    }
    for ((ray, _), occluded) in rays.iter().zip(tracer.occluded_each(&mut together)) {
        assert_eq!(occluded, tracer.occluded(ray), "{ray:?}");
    }
    met
}

#[test]
fn rays_together_meet_what_each_meets_alone() {
    for scene in scenes() {
        for tracer in [Tracer::new(&scene), Tracer::new(&scene).portable()] {
            let (mut s, mut met) = (stream(8), 0);
            for size in SIZES.into_iter().cycle().take(90) {
                let rays: Vec<_> = (0..size).map(|k| (ray(&mut s, k + size), None)).collect();
                met += agree(&tracer, &rays);
            }
            assert!(met > 1_500, "{met}");
        }
    }
}

/// What transparent surfaces let pass is decided by a hash of the ray, the same in every query.
#[test]
fn rays_together_pass_the_same_transparent_triangles() {
    let mut scene = scene_from_triangles(&place(&soup(3000, 0.3, 2), skew(), 1.0, DVec3::ZERO));
    let mut s = stream(3);
    let rays: Vec<_> = (0..20_000).map(|k| (ray(&mut s, k), None)).collect();
    let opaque = agree(&Tracer::new(&scene), &rays);
    scene.materials[0].alpha = texelwalk::scene::Alpha::Blend;
    scene.materials[0].base_color.w = 0.4;
    let met = agree(&Tracer::new(&scene), &rays);
    assert!(met > 1_000 && met * 10 < opaque * 9, "{met} of {opaque}");
}

#[test]
fn a_ray_that_says_which_triangle_it_leaves_meets_the_same() {
    for scene in scenes() {
        for tracer in [Tracer::new(&scene), Tracer::new(&scene).portable()] {
            let mut s = stream(31);
            let leave = |s: &mut Stream| {
                let triangle = s.next_u32() % scene.triangles.len() as u32;
                let b = Vec2::new(s.next_f32(), s.next_f32()) * 0.5;
                let normal = scene.geometric_normal(triangle);
                let towards = (normal + direction(s).as_vec3()).normalize_or_zero();
                let t_max = if s.next_f32() < 0.5 { f32::INFINITY } else { s.next_f32() };
                (Ray { origin: tracer.origin_on(triangle, b, towards), direction: towards, t_max }, triangle)
            };
            let rays: Vec<_> = (0..20_000).map(|_| leave(&mut s)).map(|(ray, from)| (ray, Some(from))).collect();
            assert!(agree(&tracer, &rays) > 1_000);
        }
    }
}

/// Hierarchies of one packet, one node, and a few.
#[test]
fn rays_together_meet_the_same_in_small_scenes() {
    let mut met = 0;
    for n in (1..=20).chain([64, 65, 200]) {
        let scene = scene_from_triangles(&place(&soup(n, 1.0, 6), skew(), 1.0, DVec3::ZERO));
        let mut s = stream(n as u64);
        let rays: Vec<_> = (0..2000).map(|k| (ray(&mut s, k), None)).collect();
        met += agree(&Tracer::new(&scene), &rays);
    }
    assert!(met > 1_000, "{met}");
}

#[test]
fn no_rays_and_no_scene_give_nothing() {
    let scene = Scene::default();
    let tracer = Tracer::new(&scene);
    assert_eq!(agree(&tracer, &[]), 0);
    let ray = Ray { origin: Vec3::ZERO, direction: Vec3::X, t_max: f32::INFINITY };
    assert_eq!(agree(&tracer, &[(ray, None); 9]), 0);
    let mut rays = Rays::default();
    rays.add(&ray, None);
    rays.clear();
    assert!(rays.is_empty() && tracer.closest_hits(&mut rays).is_empty());
}
