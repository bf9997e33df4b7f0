//! Patches that are as bright as lamps: samples and rays together find the same light as rays alone, with less noise.

use crate::solve::Stage;
use crate::support::{place, room, scene_from_triangles, skew};
use glam::DVec3;
use texelwalk::base::{Progress, Rgb};
use texelwalk::gather::{Field, Gathered};
use texelwalk::light::glare::{Glare, Glared, Sent};
use texelwalk::patches::Tilts;
use texelwalk::scene::Scene;

/// Rays for each sample.
const RAYS: f32 = 2.0;

/// A furnished room, askew.
fn furnished() -> Scene {
    scene_from_triangles(&place(&room(2), skew(), 1.0, DVec3::ZERO))
}

/// Radiance 1, and `bright` in a corner of the ceiling.
fn radiance(stage: &Stage<'_>, bright: f32) -> Vec<Rgb> {
    let at = |i: usize| skew().transpose() * stage.patches.position[i].as_dvec3();
    let in_corner = |i: usize| at(i).y > 0.499 && at(i).x > 0.35 && at(i).z > 0.35;
    (0..stage.patches.len()).map(|i| Rgb::splat(if in_corner(i) { bright } else { 1.0 })).collect()
}

/// What was found: both halves.
type Halves = [Vec<Rgb>; 2];

/// Light by `rays` rays of each half alone, if `glare` is `None`, or with the samples that it asks for. Rays are told of
/// `told` rays for each sample.
fn found(stage: &Stage<'_>, radiance: &[Rgb], glare: Option<&Glare>, rays: u32, told: f32) -> Halves {
    let (tracer, patches, tilts) = (&stage.tracer, &stage.patches, &Tilts::default());
    let sent = Sent { tracer, patches, radiance: [radiance; 2], tilts, seed: 11 };
    let viewers = glare.map(|glare| glare.viewers(&sent, &stage.emitters, told));
    let of = viewers.as_ref().map(|viewers| |front| viewers.left_out(front));
    let left_out = of.as_ref().map(|of| of as &(dyn Fn(usize) -> _ + Sync));
    let field = Field { tracer, patches, radiance: [radiance; 2], left_out, tilts, sky: None, anew: None, seed: 12 };
    let mut gathered = Gathered::new(patches);
    gathered.add(&field, |_| rays, &Progress::default());
    let mut halves = gathered.halves();
    if let Some(glare) = glare {
        let samples = (rays as f32 / RAYS) as u32;
        let mut glared = Glared::default();
        // Some texels go on, others do not.
        let sampler = glare.sampler(&sent, &stage.emitters, RAYS);
        for round in [|_| 1, |i: usize| (i % 2) as u32] {
            sampler.add(&mut glared, |i| samples * round(i), &Progress::default());
        }
        assert!(glared.rays > 0);
        for (half, light) in halves.iter_mut().zip(glared.halves()) {
            half.iter_mut().zip(light).for_each(|(sum, own)| *sum += own);
        }
    }
    halves
}

/// Mean of the halves over all of the surface, and the mean squared difference of the halves.
fn judged(stage: &Stage<'_>, [a, b]: &Halves) -> (f64, f64) {
    let mean: Vec<Rgb> = a.iter().zip(b).map(|(a, b)| (*a + *b) * 0.5).collect();
    let noise: Vec<Rgb> = a.iter().zip(b).map(|(a, b)| (*a - *b) * (*a - *b)).collect();
    (stage.mean(&mean, |_| true), stage.mean(&noise, |_| true))
}

#[test]
fn samples_and_rays_together_find_what_rays_alone_find() {
    let scene = furnished();
    let stage = Stage::new(&scene, 12.0);
    let radiance = radiance(&stage, 400.0);
    let dim = vec![0.1; stage.patches.len()];
    let glare = Glare::new(&stage.tracer, &stage.patches, &radiance, &dim);
    assert!(!glare.is_empty());
    let (truth, _) = judged(&stage, &found(&stage, &radiance, None, 4096, RAYS));
    let (alone, noise_alone) = judged(&stage, &found(&stage, &radiance, None, 256, RAYS));
    let (both, noise) = judged(&stage, &found(&stage, &radiance, Some(&glare), 256, RAYS));
    assert!((alone / truth - 1.0).abs() < 0.01, "{alone}, {truth}");
    assert!((both / truth - 1.0).abs() < 2.5e-3, "{both}, {truth}");
    assert!(noise < 0.1 * noise_alone, "{noise} against {noise_alone}");
    // Shares that do not add up are noticed.
    let (wrong, _) = judged(&stage, &found(&stage, &radiance, Some(&glare), 256, 4.0 * RAYS));
    assert!((wrong / truth - 1.0).abs() > 0.01, "{wrong}, {truth}");
}

#[test]
fn what_is_as_bright_as_what_it_sees_asks_for_nothing() {
    let scene = furnished();
    let stage = Stage::new(&scene, 8.0);
    let radiance = radiance(&stage, 400.0);
    let sent =
        |tilts| Sent { tracer: &stage.tracer, patches: &stage.patches, radiance: [&radiance; 2], tilts, seed: 1 };
    let tilts = Tilts::default();
    let bright = vec![400.0; stage.patches.len()];
    let glare = Glare::new(&stage.tracer, &stage.patches, &radiance, &bright);
    let mut glared = Glared::default();
    glare.sampler(&sent(&tilts), &stage.emitters, RAYS).add(&mut glared, |_| 16, &Progress::default());
    assert!(glared.rays == 0 && glared.halves().iter().flatten().all(|light| *light == Rgb::ZERO));
    let even = vec![Rgb::ONE; stage.patches.len()];
    assert!(Glare::new(&stage.tracer, &stage.patches, &even, &bright).is_empty(), "even light has no glare");
}

#[test]
fn lamps_that_add_little_noise_are_left_to_rays() {
    let scene = furnished();
    let stage = Stage::new(&scene, 8.0);
    let radiance = radiance(&stage, 110.0);
    let tilts = &Tilts::default();
    let sent = Sent { tracer: &stage.tracer, patches: &stage.patches, radiance: [&radiance; 2], tilts, seed: 1 };
    let glare = |light: f32| Glare::new(&stage.tracer, &stage.patches, &radiance, &vec![light; stage.patches.len()]);
    let rays = |glare: &Glare| {
        let mut glared = Glared::default();
        glare.sampler(&sent, &stage.emitters, RAYS).add(&mut glared, |_| 16, &Progress::default());
        glared.rays
    };
    let (dim, bright) = (glare(0.1), glare(40.0));
    assert!(!bright.is_empty() && 5 * rays(&bright) < rays(&dim), "{} of {}", rays(&bright), rays(&dim));
    let (alone, _) = judged(&stage, &found(&stage, &radiance, None, 1024, RAYS));
    let (both, _) = judged(&stage, &found(&stage, &radiance, Some(&bright), 1024, RAYS));
    assert!((both / alone - 1.0).abs() < 2.5e-3, "{both}, {alone}");
}

#[test]
fn the_same_bits_at_any_number_of_threads() {
    let scene = furnished();
    let stage = Stage::new(&scene, 8.0);
    let radiance = radiance(&stage, 400.0);
    let dim = vec![0.1; stage.patches.len()];
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let glare = Glare::new(&stage.tracer, &stage.patches, &radiance, &dim);
            found(&stage, &radiance, Some(&glare), 16, RAYS)
        })
    };
    assert!(run(1) == run(3));
}
