//! Rays per second: closest hit and occlusion, incoherent cosine rays, by number of triangles and threads.
//!
//! `cargo bench --bench rays` prints comma-separated values; figures belong to the machine they were taken on.
//!
//! Scene: a closed room of 10 × 4 × 10 m with 40 bumpy spheres. Origins are uniform over the triangles, directions
//! cosine-distributed around their normals, no two neighbouring rays alike; occlusion takes the same rays with ends 0.5 to
//! 5 m away. Rates are the best of three runs over all rays. The time of one ray on one thread is the sum of the best times
//! of short batches, with a warm cache: it hardly moves when other programs share the machine.
#![allow(clippy::unwrap_used, reason = "bench")]
#![allow(clippy::print_stdout, reason = "bench")]

#[path = "../support/mod.rs"]
mod support;

use core::hint::black_box;
use glam::{DMat3, DVec3, Vec2};
use std::time::Instant;
use support::{blob, cuboid, direction, place, scene_from_triangles, stream};
use texelwalk::base::parallel;
use texelwalk::scene::Scene;
use texelwalk::trace::{Ray, Tracer};

const RAYS: usize = 500_000;

fn office(detail: usize) -> Scene {
    let mut shape = Vec::new();
    cuboid(DVec3::new(-5.0, 0.0, -5.0), DVec3::new(5.0, 4.0, 5.0), 8, true, &mut shape);
    let mut triangles = place(&shape, DMat3::IDENTITY, 1.0, DVec3::ZERO);
    let mut s = stream(1);
    for _ in 0..40 {
        let centre = DVec3::new(s.next_f64() * 8.0 - 4.0, s.next_f64() * 2.4 + 0.8, s.next_f64() * 8.0 - 4.0);
        triangles.extend(place(&blob(detail, 0.1), DMat3::IDENTITY, 0.6 + s.next_f64(), centre));
    }
    scene_from_triangles(&triangles)
}

fn rays(tracer: &Tracer<'_>) -> Vec<Ray> {
    let scene = tracer.scene();
    let mut s = stream(2);
    (0..RAYS)
        .map(|_| {
            let triangle = s.next_u32() % scene.triangles.len() as u32;
            let (mut a, mut b) = (s.next_f32(), s.next_f32());
            if a + b > 1.0 {
                (a, b) = (1.0 - a, 1.0 - b);
            }
            let normal = scene.geometric_normal(triangle);
            let direction = (normal * 1.0001 + direction(&mut s).as_vec3()).normalize();
            let origin = tracer.origin_on(triangle, Vec2::new(a, b), direction);
            Ray { origin, direction, t_max: f32::INFINITY }
        })
        .collect()
}

/// Millions of rays per second, best of three.
fn rate(rays: &[Ray], work: impl Fn(&Ray) -> bool + Sync) -> (f64, usize) {
    let mut best = (0.0, 0);
    for _ in 0..3 {
        let start = Instant::now();
        let counts =
            parallel::map_chunks(rays.len(), 4096, |r| rays[r].iter().filter(|&ray| black_box(work(ray))).count());
        let seconds = start.elapsed().as_secs_f64();
        let hits = counts.into_iter().sum();
        best = (f64::max(best.0, rays.len() as f64 / seconds / 1e6), hits);
    }
    best
}

/// Time of one ray on this thread [ns]: batches of about a millisecond, each the best of 25.
fn nanoseconds(rays: &[Ray], work: impl Fn(&Ray) -> bool) -> f64 {
    let rays = &rays[..20_000];
    let mut total = 0.0;
    for batch in rays.chunks(500) {
        let mut best = f64::INFINITY;
        for _ in 0..25 {
            let start = Instant::now();
            for ray in batch {
                black_box(work(ray));
            }
            best = best.min(start.elapsed().as_secs_f64());
        }
        total += best;
    }
    total / rays.len() as f64 * 1e9
}

fn main() {
    println!(
        "triangles,threads,build_s,nodes,bytes_per_triangle,closest_mrays_s,occlusion_mrays_s,closest_ns,occlusion_ns"
    );
    for detail in [1, 8, 25] {
        let scene = office(detail);
        for threads in [1, 2] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let start = Instant::now();
                let tracer = Tracer::new(&scene);
                let build = start.elapsed().as_secs_f64();
                let far = rays(&tracer);
                let mut s = stream(3);
                let near: Vec<Ray> = far.iter().map(|&r| Ray { t_max: 0.5 + 4.5 * s.next_f32(), ..r }).collect();
                let (closest, hits) = rate(&far, |r| tracer.closest_hit(r).is_some());
                assert_eq!(hits, far.len(), "the room is closed");
                let (occlusion, _) = rate(&near, |r| tracer.occluded(r));
                let closest_ns = nanoseconds(&far, |r| tracer.closest_hit(r).is_some());
                let occlusion_ns = nanoseconds(&near, |r| tracer.occluded(r));
                let (n, nodes) = (tracer.triangle_count(), tracer.node_count());
                let bytes = tracer.memory_bytes() as f64 / n as f64;
                println!(
                    "{n},{threads},{build:.3},{nodes},{bytes:.0},{closest:.2},{occlusion:.2},{closest_ns:.0},{occlusion_ns:.0}"
                );
            });
        }
    }
}
