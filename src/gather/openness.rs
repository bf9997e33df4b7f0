//! How open the surroundings of every texel are: ambient occlusion and bent normals.
//!
//! In: tracer and patches. Out: per front patch the share of [`RAYS`] cosine-distributed rays that meet nothing nearer than
//! `distance`, and the direction from which they come on average. Surfaces that let light through (masks, glass) do so
//! here, too. Rays and random numbers are its own, so that nothing else depends on it.
//!
//! Starting points are spread over the exposed part of the texel, and directions over the texels of a tile, as those of
//! the final gather are (see `gather`). Rays that a smooth shading normal sends below the surface are not counted, so a
//! faceted ball is as open as a round one.
//!
//! Invariants: an open plane has 1 and its normal, what is closed in within the distance has 0; same bits at any thread
//! count. A texel without open rays has its own normal; hidden ones have nothing.
//!
//! Error of the share by [`RAYS`]: below 1/RAYS in the open, at most 0.5/√RAYS = 0.03 where half is open.

use super::Aim;
use crate::base::low_discrepancy::Sequence;
use crate::base::random::{Stage, mix};
use crate::base::{Progress, parallel};
use crate::patches::{PatchSurface, Patches};
use crate::trace::{Rays, Tracer};
use glam::{Vec2, Vec3};

/// Rays of a texel.
pub const RAYS: u32 = 256;

/// What is open above one texel.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Openness {
    /// Share of the hemisphere, by cosine, in [0, 1].
    pub share: f32,
    /// Mean direction of that share, by cosine; unit length, or zero where the texel is hidden.
    pub direction: Vec3,
}

/// Looks around from every front patch, as far as `distance` [m], which may be infinite.
#[must_use]
pub fn openness(
    tracer: &Tracer<'_>,
    patches: &Patches,
    distance: f32,
    seed: u64,
    progress: &Progress,
) -> Vec<Openness> {
    parallel::map_watched(patches.front, progress, |i| texel(tracer, patches, distance, seed, i))
}

fn texel(tracer: &Tracer<'_>, patches: &Patches, distance: f32, seed: u64, patch: usize) -> Openness {
    if patches.exposed[patch] <= 0.0 {
        return Openness::default();
    }
    let surface = PatchSurface::shaded(tracer, patches, patch);
    let (tile, place) = patches.tile(patch);
    let sequence = Sequence::new(mix(seed ^ mix((Stage::Openness as u64) << 56 | tile)));
    let aims: Vec<Aim> = (0..RAYS)
        .map(|k| {
            let [u, v, x, y] = sequence.point(place * RAYS + k);
            Aim::new(&surface, Vec2::new(u, v), Vec2::new(x, y))
        })
        .collect();
    let mut rays = Rays::with_capacity(aims.len());
    aims.iter().for_each(|aim| aim.add_to(&mut rays, distance));
    let counted = rays.len();
    let mut occluded = tracer.occluded_each(&mut rays);
    let (mut open, mut sum, mut normals) = (0u32, Vec3::ZERO, Vec3::ZERO);
    for aim in &aims {
        normals += aim.normal;
        if aim.origin.is_some() && occluded.next() == Some(false) {
            open += 1;
            sum += aim.direction;
        }
    }
    let direction = sum.try_normalize().unwrap_or_else(|| normals.normalize_or_zero());
    Openness { share: open as f32 / counted.max(1) as f32, direction }
}
