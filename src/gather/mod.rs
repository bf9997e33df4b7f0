//! Final gather: the last bounce of indirect light, by cosine rays from every texel.
//!
//! In: radiosity of the patches (by the walk and direct light). Out: indirect irradiance of the front patches, as two
//! halves that share no random number, so that their difference tells the error.
//!
//! Each ray reads `B = ρ(E_direct + E_indirect)/π` where it lands; what leaves the scene or lands on an emitter's own
//! light counts as direct and is not read. Directions are Owen-scrambled low-discrepancy points around the shading
//! normal; starting points are spread over the exposed part of the texel.
//!
//! Source: Reichert, "A Two-Pass Radiosity Method Driven by Lights and Viewer Position" (thesis, Cornell, 1992), for
//! the final gather over a radiosity solution.
//!
//! Invariants: same bits at any thread count; zero rays, zero light.

use crate::base::low_discrepancy::Sequence;
use crate::base::random::{Stage, mix};
use crate::base::{Frame, Progress, Rgb, parallel, warp};
use crate::patches::Patches;
use crate::trace::{Ray, Tracer};
use glam::Vec2;

/// How to gather.
#[derive(Debug, Clone, Copy)]
pub struct Settings {
    /// Rays per texel, both halves together; rounded up to an even number.
    pub rays: u32,
    /// Chooses the random numbers.
    pub seed: u64,
}

/// What was gathered, per front patch.
#[derive(Debug, Default)]
pub struct Gathered {
    /// Indirect irradiance by each half of the rays [lx].
    pub halves: [Vec<Rgb>; 2],
    /// Harmonic mean of the lengths of the rays that hit something [m]; 0 where none did.
    pub distance: Vec<f32>,
    /// Rays traced.
    pub rays: u64,
}

/// One texel's sums.
#[derive(Default, Clone, Copy)]
struct Texel {
    halves: [Rgb; 2],
    distance: f32,
}

/// Gathers at every front patch. `radiance` is what each patch sends out [cd/m²], one solution per half.
#[must_use]
pub fn gather(
    tracer: &Tracer<'_>,
    patches: &Patches,
    radiance: [&[Rgb]; 2],
    settings: &Settings,
    progress: &Progress,
) -> Gathered {
    let per_half = settings.rays.div_ceil(2);
    let texels = parallel::map_watched(patches.front, progress, |i| {
        texel(tracer, patches, radiance, settings.seed, per_half, i)
    });
    Gathered {
        halves: [0, 1].map(|h| texels.iter().map(|t| t.halves[h]).collect()),
        distance: texels.iter().map(|t| t.distance).collect(),
        rays: patches.front as u64 * u64::from(per_half) * 2,
    }
}

fn texel(tracer: &Tracer<'_>, patches: &Patches, radiance: [&[Rgb]; 2], seed: u64, rays: u32, patch: usize) -> Texel {
    let mut out = Texel::default();
    if patches.exposed[patch] <= 0.0 || rays == 0 {
        return out;
    }
    let (mut inverse, mut hits) = (0.0f64, 0u32);
    for (half, radiance) in radiance.into_iter().enumerate() {
        let key = mix(seed ^ mix((Stage::Gather as u64) << 40 | (half as u64) << 36).wrapping_add(patch as u64));
        let sequence = Sequence::new(mix(key));
        let mut sum = Rgb::ZERO;
        for k in 0..rays {
            let [u, v, x, y] = sequence.point(k);
            let Some(ray) = ray(tracer, patches, patch, Vec2::new(u, v), Vec2::new(x, y)) else { continue };
            let Some(hit) = tracer.closest_hit(&ray) else { continue };
            inverse += 1.0 / f64::from(hit.t.max(1e-6));
            hits += 1;
            if let Some(seen) = patches.at(&hit) {
                sum += radiance[seen];
            }
        }
        out.halves[half] = sum * (core::f32::consts::PI / rays as f32);
    }
    if hits > 0 {
        out.distance = (f64::from(hits) / inverse) as f32;
    }
    out
}

/// `None` for a direction that a bent shading normal sends below the surface.
fn ray(tracer: &Tracer<'_>, patches: &Patches, patch: usize, direction: Vec2, position: Vec2) -> Option<Ray> {
    let point = patches.sample(patch, position);
    let scene = tracer.scene();
    let frame = Frame::from_normal(scene.shading_normal(point.triangle, point.b));
    let direction = frame.to_world(warp::square_to_cosine_hemisphere(direction));
    if direction.dot(scene.geometric_normal(point.triangle)) <= 0.0 {
        return None;
    }
    Some(Ray { origin: tracer.origin_on(point.triangle, point.b, direction), direction, t_max: f32::INFINITY })
}
