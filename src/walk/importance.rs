//! Which lines matter: how much a line from each patch counts where it arrives.
//!
//! In: patches, and flux that each has to shoot. Out: a factor for each patch; lines start in proportion to flux times factor,
//! and carry so much less.
//!
//! Lines by power alone go where the light is, and where most of it leaves the scene: of a house with a window under a sky, 97 of
//! 100 started on its outside and met nothing, and the room, a fiftieth as bright, had three for ten texels. What counts is the
//! variance that a line brings to where it lands, over the light there: half-way between an absolute error and a relative one, as
//! for shadow rays. It is least if a patch of flux P has lines in proportion to P·√I, where I is the mean of one over the
//! light that lines from there arrive in, 0 for those that leave the scene (the variance of n lines is P²·I/n). Rays from
//! blocks of texels find that.
//!
//! A share of the lines goes by power alone, so no line carries more than `1 / (1 − SHARE)` times what it would.
//!
//! Symbols: E light that falls on a patch, mean of a block [lx]   I as above, times the mean of E
//!
//! Invariants: the light is the same in the mean for any factors. Same bits at any thread count.
//!
//! Limits: light that comes by reflections alone is not known yet, and counts as [`DARK`] of the mean.

use crate::base::random::Stage;
use crate::base::{Progress, Rgb, Stream, color, parallel, warp};
use crate::patches::{PatchSurface, Patches};
use crate::trace::{Ray, Tracer};
use glam::Vec2;

/// Edge of a block [texels].
const BLOCK: u32 = 8;
/// Rays of a block.
const RAYS: usize = 16;
/// Share of the lines that go by what counts: of a house with a window (5,535 texels of its room, `preview`), indirect light has 2.7 %
/// error by it, 2.6 % with 0.75, 10.9 % without.
const SHARE: f64 = 0.5;
/// Variance of lines by power alone over that of lines by what counts, from which on that is worth it. Rooms without an outside
/// stay below, and lose a little by what rays tell of them.
const WORTH: f64 = 2.0;
/// Share of the mean light that is thought to be everywhere.
const DARK: f64 = 0.05;
/// Least reflectance by which light is told from what is sent on.
const LEAST_ALBEDO: f32 = 0.05;

/// Factor of each patch, about 1 in the mean over the flux; empty where lines by power alone do as well.
pub(super) fn importance(tracer: &Tracer<'_>, patches: &Patches, unshot: &[Rgb], progress: &Progress) -> Vec<f32> {
    let blocks = blocks(patches);
    let light = light(patches, unshot, &blocks);
    let area = |i: usize| f64::from(patches.exposed_area(i));
    let n = patches.len();
    let (all, whole) = (parallel::sum(n, |i| f64::from(light[i]) * area(i)), parallel::sum(n, area));
    if all <= 0.0 {
        return vec![];
    }
    let mean = (all / whole) as f32;
    let met = parallel::map_watched(blocks.len(), progress, |b| {
        let members = &blocks[b];
        let ray = |k: usize| count(tracer, patches, members[k * members.len() / RAYS], k, &light, mean);
        ((0..RAYS).map(ray).sum::<f32>() / RAYS as f32).sqrt()
    });
    let mut factors = vec![0.0; n];
    for (members, root) in blocks.iter().zip(met) {
        members.iter().for_each(|&i| factors[i as usize] = root);
    }
    let flux = |i: usize| f64::from(color::mean(unshot[i]));
    let counted = parallel::sum(n, |i| flux(i) * f64::from(factors[i]));
    let by_power = parallel::sum(n, |i| flux(i) * f64::from(factors[i].powi(2)));
    let power = parallel::sum(n, flux);
    if power * by_power <= WORTH * counted * counted {
        return vec![];
    }
    let scale = SHARE * power / counted;
    parallel::map(n, |i| (1.0 - SHARE + scale * f64::from(factors[i])) as f32)
}

/// Patches that lie in the open, by block of texels, chart and side.
fn blocks(patches: &Patches) -> Vec<Vec<u32>> {
    let sides = parallel::map(patches.block_places(BLOCK), |place| {
        let mut sides: Vec<Vec<u32>> = vec![];
        for block in patches.blocks_at(place, BLOCK) {
            let open = |i: &u32| patches.exposed[*i as usize] > 0.0;
            sides.push(block.iter().map(|(_, i)| *i as u32).filter(open).collect());
            let back = |(_, i): &(u32, usize)| patches.opposite(*i).map(|i| i as u32);
            sides.push(block.iter().filter_map(back).filter(open).collect());
        }
        sides.retain(|side| !side.is_empty());
        sides
    });
    sides.into_iter().flatten().collect()
}

/// Light that falls on each patch, mean of its block [lx].
fn light(patches: &Patches, unshot: &[Rgb], blocks: &[Vec<u32>]) -> Vec<f32> {
    let received = |i: usize| color::mean(unshot[i]) / color::mean(patches.albedo(i)).max(LEAST_ALBEDO);
    let of_block = parallel::map(blocks.len(), |b| {
        let sum = |value: &dyn Fn(usize) -> f32| blocks[b].iter().map(|&i| value(i as usize)).sum::<f32>();
        let area = sum(&|i| patches.exposed_area(i));
        if area > 0.0 { sum(&received) / area } else { 0.0 }
    });
    let mut light = vec![0.0; patches.len()];
    for (members, mean) in blocks.iter().zip(of_block) {
        members.iter().for_each(|&i| light[i as usize] = mean);
    }
    light
}

/// Mean light over that where a ray of a patch arrives; 0 if it leaves the scene.
fn count(tracer: &Tracer<'_>, patches: &Patches, patch: u32, k: usize, light: &[f32], mean: f32) -> f32 {
    let mut stream = Stream::new(1, Stage::Walk, u64::from(patch), k as u64);
    let mut square = || Vec2::new(stream.next_f32(), stream.next_f32());
    let surface = PatchSurface::new(tracer, patches, patch as usize);
    let spot = surface.sample(square());
    let direction = surface.frame(&spot).to_world(warp::square_to_cosine_hemisphere(square()));
    let ray = Ray { origin: surface.origin(&spot, direction), direction, t_max: f32::INFINITY };
    let seen = tracer.closest_hit(&ray).and_then(|hit| patches.seen(&hit));
    seen.map_or(0.0, |seen| mean / (light[seen.patch] + DARK as f32 * mean))
}
