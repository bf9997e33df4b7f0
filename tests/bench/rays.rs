//! Time per ray and time to build: closest hit and occlusion, incoherent cosine rays, by number of triangles and threads.
//!
//! `cargo bench --bench rays` prints comma-separated values; figures belong to the machine they were taken on. Options
//! after `--`: `--details 8,25,79` (blob subdivisions: 20 thousand, 200 thousand and 2 million triangles), `--threads 1,2`,
//! `--passes 5`, `--portable` (no CPU dispatch), `--together 64` (rays of one query; 1: each alone), `--from-nowhere` (rays
//! do not say which triangle they leave), `--dump FOLDER` (triangles and rays as little-endian f32, for
//! `pipelines/study/rays.py`, which measures Embree with them).
//!
//! Scene: a closed room of 10 × 4 × 10 m with 40 bumpy spheres. Origins are uniform over the triangles, directions
//! cosine-distributed around their normals, no two neighbouring rays alike; occlusion takes the same rays with ends 0.5 to
//! 5 m away.
//!
//! Time of a ray: the rays are cut into batches of a tenth of a millisecond; every pass takes all of them, so caches
//! are as cold as in a bake; the best times of all batches are added up. So programs that share the machine hardly
//! show. With several threads it is still the time that one thread spends on one ray.
#![allow(clippy::unwrap_used, reason = "bench")]
#![allow(clippy::print_stdout, reason = "bench")]

#[path = "../support/mod.rs"]
mod support;

use core::hint::black_box;
use glam::{DMat3, DVec3, Vec2};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;
use support::{blob, cuboid, direction, place, scene_from_triangles, stream};
use texelwalk::base::parallel;
use texelwalk::scene::Scene;
use texelwalk::trace::{Ray, Rays, Tracer};

const RAYS: usize = 500_000;
const BATCH: usize = 250;

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

/// Rays, each with the triangle that it leaves.
fn rays(tracer: &Tracer<'_>) -> Vec<(Ray, u32)> {
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
            (Ray { origin, direction, t_max: f32::INFINITY }, triangle)
        })
        .collect()
}

/// Time of a ray [ns] and the number of rays for which `work` counts something, batch by batch.
fn nanoseconds(rays: &[(Ray, u32)], passes: usize, work: impl Fn(&[(Ray, u32)]) -> usize + Sync) -> (f64, usize) {
    let mut best = vec![f64::INFINITY; rays.len().div_ceil(BATCH)];
    let mut hits = 0;
    for _ in 0..passes {
        let batches = parallel::map_chunks(rays.len(), BATCH, |range| {
            let start = Instant::now();
            let count = black_box(work(&rays[range]));
            (start.elapsed().as_secs_f64(), count)
        });
        hits = batches.iter().map(|b| b.1).sum();
        for (best, (seconds, _)) in best.iter_mut().zip(batches) {
            *best = best.min(seconds);
        }
    }
    (best.iter().fold(0.0, |a, b| a + b) / rays.len() as f64 * 1e9, hits)
}

/// Adds up what `trace` says of rays that are traced `n` at a time.
fn together(all: &[(Ray, u32)], n: usize, leave: bool, trace: impl Fn(&mut Rays) -> usize) -> usize {
    let mut rays = Rays::with_capacity(n);
    let one = |some: &[(Ray, u32)]| {
        rays.clear();
        some.iter().for_each(|(ray, from)| rays.add(ray, leave.then_some(*from)));
        trace(&mut rays)
    };
    all.chunks(n).map(one).sum()
}

/// Corners of all triangles; then, for each ray, origin, direction, and `t_max` of closest hit and occlusion.
fn dump(folder: &Path, scene: &Scene, far: &[(Ray, u32)], near: &[(Ray, u32)]) {
    let n = scene.triangles.len();
    let save = |name: String, values: Vec<f32>| {
        let bytes: Vec<u8> = values.into_iter().flat_map(f32::to_le_bytes).collect();
        std::fs::File::create(folder.join(name)).unwrap().write_all(&bytes).unwrap();
    };
    let corners = (0..n as u32).flat_map(|i| scene.corners(i)).flat_map(|p| p.to_array());
    save(format!("{n}.triangles"), corners.collect());
    let ray = |((r, _), (s, _)): (&(Ray, u32), &(Ray, u32))| {
        let ([a, b, c], [d, e, f]) = (r.origin.to_array(), r.direction.to_array());
        [a, b, c, d, e, f, r.t_max, s.t_max]
    };
    save(format!("{n}.rays"), far.iter().zip(near).flat_map(ray).collect());
}

struct Options {
    details: Vec<usize>,
    threads: Vec<usize>,
    passes: usize,
    portable: bool,
    together: usize,
    leave: bool,
    dump: Option<PathBuf>,
}

fn options() -> Options {
    let mut o = Options {
        details: vec![8, 25, 79],
        threads: vec![1, 2],
        passes: 5,
        portable: false,
        together: 64,
        leave: true,
        dump: None,
    };
    let list = |s: String| s.split(',').map(|v| v.parse().unwrap()).collect();
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        match word.as_str() {
            "--details" => o.details = list(words.next().unwrap()),
            "--threads" => o.threads = list(words.next().unwrap()),
            "--passes" => o.passes = words.next().unwrap().parse().unwrap(),
            "--portable" => o.portable = true,
            "--together" => o.together = words.next().unwrap().parse().unwrap(),
            "--from-nowhere" => o.leave = false,
            "--dump" => o.dump = Some(words.next().unwrap().into()),
            "--bench" => {}
            other => panic!("unknown option {other}"),
        }
    }
    o
}

fn build<'a>(scene: &'a Scene, options: &Options) -> (Tracer<'a>, f64) {
    let mut best = (f64::INFINITY, None);
    for _ in 0..options.passes {
        let start = Instant::now();
        let tracer = Tracer::new(scene);
        best = (best.0.min(start.elapsed().as_secs_f64()), Some(tracer));
    }
    let tracer = best.1.unwrap();
    (if options.portable { tracer.portable() } else { tracer }, best.0)
}

fn measure(scene: &Scene, threads: usize, options: &Options) {
    let (tracer, build) = build(scene, options);
    let far = rays(&tracer);
    let mut s = stream(3);
    let near: Vec<_> = far.iter().map(|&(r, from)| (Ray { t_max: 0.5 + 4.5 * s.next_f32(), ..r }, from)).collect();
    if let Some(folder) = &options.dump {
        dump(folder, scene, &far, &near);
    }
    let &Options { together: n, leave, passes, .. } = options;
    let (closest, hits) = if n > 1 {
        let count = |rays: &mut Rays| tracer.closest_hits(rays).iter().flatten().count();
        nanoseconds(&far, passes, |rays| together(rays, n, leave, count))
    } else {
        nanoseconds(&far, passes, |rays| {
            rays.iter().filter(|(r, _)| tracer.closest_hit(black_box(r)).is_some()).count()
        })
    };
    assert_eq!(hits, far.len(), "the room is closed");
    let (occlusion, occluded) = if n > 1 {
        let count = |rays: &mut Rays| tracer.occluded_each(rays).filter(|occluded| *occluded).count();
        nanoseconds(&near, passes, |rays| together(rays, n, leave, count))
    } else {
        nanoseconds(&near, passes, |rays| rays.iter().filter(|(r, _)| tracer.occluded(black_box(r))).count())
    };
    let (n, nodes) = (tracer.triangle_count(), tracer.node_count());
    let bytes = tracer.memory_bytes() as f64 / n as f64;
    println!("{n},{threads},{build:.4},{nodes},{bytes:.0},{closest:.0},{occlusion:.0},{hits},{occluded}");
}

fn main() {
    let options = options();
    println!("triangles,threads,build_s,nodes,bytes_per_triangle,closest_ns,occlusion_ns,hits,occluded");
    for &detail in &options.details {
        let scene = office(detail);
        for &threads in &options.threads {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| measure(&scene, threads, &options));
        }
    }
}
