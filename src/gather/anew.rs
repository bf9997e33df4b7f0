//! Light where near rays hit, looked for anew: a texel that is as near as its own edge is not seen in the mean, and its light
//! is known no finer than by a slope.
//!
//! In: a hit, and what is known of its patch. Out: what the point that is hit sends on, by one look at each kind of light and
//! a ray onward, again and again while what is met is near.
//!
//! One in eight of the rays to such patches is looked at, and what it finds beyond what is known counts eight times: right in
//! the mean. That is noise, too, so it is for those who ask for many rays: from ray [`FROM`] of a half on, about eight times
//! `production`; below, not a ray changes. What is wrong of the first rays fades with their share. Which patches are near
//! goes by their middles, so of what is seen from a point a texel is looked at everywhere or nowhere; by the distance of the
//! hit, near parts alone would be right, and the sum wrong.
//!
//! Against Mitsuba (office, 4,130 judged texels, two seeds): 0.35 → 0.26 % NRMSE with 64 times the rays of `production`, of
//! which seeds agree on 0.29 → 0.19 %, for about 1.2 times the time. From the first ray on, with 16 times the rays:
//! 0.45 → 0.43 %, of which 0.30 → 0.23 %, for 1.26 times the time; all such rays 0.39, 0.22 %, 2.5 times; within 1.5 edges 0.47,
//! 0.25 %, 1.3 times.
//!
//! Limits: not of patches that let light pass, nor of backs. The light of lamps that dazzle (`light::glare`) stays that of the
//! patch. Not where bounces are limited: a ray onward is one more.

use super::Field;
use crate::base::{Rgb, Stream};
use crate::patches::{Looked, Sight, SurfacePoint};
use crate::trace::{Hit, Ray};
use core::f32::consts::{FRAC_1_PI, PI};
use core::sync::atomic::{AtomicU64, Ordering};
use glam::Vec3;

/// Ray of a half from which on near hits are looked at.
pub(super) const FROM: u32 = 512;
/// Share of them that are.
const CHANCE: f32 = 1.0 / 8.0;
/// What is near [edges of the texel that is hit].
const NEAR: f32 = 1.0;
/// Most looks one after the other.
const DEPTH: u32 = 8;

/// What finds light anew.
pub struct Anew<'a> {
    /// Looks at a point of a patch.
    pub look: &'a (dyn Fn(usize, SurfacePoint, &mut Stream) -> Looked + Sync),
    /// Irradiance of front patches that rays leave out, by half [lx]; empty if there is none.
    pub glared: &'a [Vec<Rgb>; 2],
    /// Rays that were shot.
    pub rays: AtomicU64,
}

/// A path that looks for light, from a hit on.
struct Path<'f, 'a> {
    field: &'f Field<'a>,
    anew: &'f Anew<'a>,
    half: usize,
    random: Stream,
}

impl Field<'_> {
    /// What a hit of a ray from a point sends on, but for what tints it on its way: as known, or by chance anew; right in the
    /// mean.
    pub(super) fn corrected(
        &self,
        known: Rgb,
        (from, hit): (Vec3, &Hit),
        patch: usize,
        half: usize,
        mut random: Stream,
    ) -> Rgb {
        match self.anew.filter(|_| self.is_near(from, patch) && random.next_f32() < CHANCE) {
            Some(anew) => {
                known + (Path { field: self, anew, half, random }.sent_on(hit, patch, DEPTH) - known) / CHANCE
            }
            None => known,
        }
    }

    fn is_near(&self, from: Vec3, patch: usize) -> bool {
        let patches = self.patches;
        let plain = patch < patches.front && patches.albedo(patch) == patches.reflectance[patch];
        plain && from.distance(patches.position[patch]) < NEAR * patches.texel_edge(patch)
    }
}

impl Path<'_, '_> {
    /// Radiance of a point of a patch; at most so many looks follow.
    fn sent_on(&mut self, hit: &Hit, patch: usize, depth: u32) -> Rgb {
        let point = SurfacePoint { triangle: hit.triangle, b: hit.b };
        let looked = (self.anew.look)(patch, point, &mut self.random);
        let known = self.anew.glared[self.half].get(patch).copied().unwrap_or(Rgb::ZERO);
        let falls = looked.direct + known + self.onward(&looked, patch, depth) * PI;
        self.anew.rays.fetch_add(looked.rays + u64::from(looked.onward.is_some()), Ordering::Relaxed);
        self.field.tracer.scene().reflectance(hit.triangle, hit.b) * falls * FRAC_1_PI
    }

    /// Radiance from where the ray goes on, but for what comes by other ways.
    fn onward(&mut self, looked: &Looked, from: usize, depth: u32) -> Rgb {
        let Field { tracer, patches, radiance, tilts, left_out, .. } = *self.field;
        let Some((ray, hit)) = looked.onward.and_then(|ray| Some((ray, tracer.closest_hit(&ray)?))) else {
            return Rgb::ZERO;
        };
        let Some(seen) = patches.seen(&hit) else { return Rgb::ZERO };
        let light = if depth > 0 && self.field.is_near(ray.origin, seen.patch) {
            self.sent_on(&hit, seen.patch, depth - 1)
        } else {
            radiance[self.half][seen.patch] * tilts.of(seen.patch).at(seen.within) * self.field.grain(&hit, seen.patch)
        };
        let sight = || Sight {
            patch: seen.patch,
            position: ray.origin,
            normal: looked.normal,
            direction: ray.direction,
            distance: hit.t,
            facing: tracer.scene().geometric_normal(hit.triangle).dot(ray.direction).abs(),
        };
        let elsewhere = left_out.map_or(0.0, |of| of(from)(&sight()));
        light * tracer.tint(&Ray { t_max: hit.t, ..ray }) * (1.0 - elsewhere)
    }
}
