//! Direct irradiance by shadow rays from every patch.
//!
//! Lights without size are evaluated at the centroids of 2 × 2 cells of the texel, which is exact for linear
//! functions; where the cells do not agree on which lights they see, at 8 × 8. Surfaces, sky and lights with a size get
//! `samples` low-discrepancy shadow rays each in two independent halves, and four times as many where the halves differ.
//! cos θ is taken with the shading normal; what is below the surface itself is dark.
//!
//! Invariants: same bits at any thread count; hidden patches get nothing.

use super::emitters::Emitters;
use super::{Settings, punctual};
use crate::base::low_discrepancy::Sequence;
use crate::base::random::{Stage, mix};
use crate::base::{Frame, Progress, Rgb, parallel, warp};
use crate::patches::{Patches, SurfacePoint};
use crate::scene::{Light, Scene};
use crate::trace::{Ray, Tracer};
use core::f32::consts::PI;
use glam::{Vec2, Vec3};

/// Cells per side of a texel that shadow edges of lights without size do not cut, and of one that they cut.
const CELLS: u32 = 2;
const FINE_CELLS: u32 = 8;
/// Relative difference of the two halves from which a texel gets more rays: 3 % is below what a picture shows.
const DISAGREEMENT: f32 = 0.03;
/// Rays of the second round, as a multiple of the first.
const REFINEMENT: u32 = 3;
/// Least share of a texel that is cut into cells [texel²].
const LEAST_CELLS: f32 = 1e-9;

/// One place on a patch.
#[derive(Clone, Copy)]
struct Place {
    point: SurfacePoint,
    position: Vec3,
    normal: Vec3,
    geometric: Vec3,
}

struct Context<'a> {
    tracer: &'a Tracer<'a>,
    patches: &'a Patches,
    emitters: &'a Emitters,
    settings: &'a Settings,
}

/// Irradiance [lx] of every patch, fronts and backs.
#[must_use]
pub fn direct(
    tracer: &Tracer<'_>,
    patches: &Patches,
    emitters: &Emitters,
    settings: &Settings,
    progress: &Progress,
) -> Vec<Rgb> {
    let context = Context { tracer, patches, emitters, settings };
    parallel::map_watched(patches.len(), progress, |i| context.patch(i, &mut vec![]))
}

impl Context<'_> {
    fn scene(&self) -> &Scene {
        self.tracer.scene()
    }

    fn patch(&self, patch: usize, running: &mut Vec<f32>) -> Rgb {
        if self.patches.exposed[patch] <= 0.0 {
            return Rgb::ZERO;
        }
        let mut sum = self.hard_lights(patch);
        if self.scene().lights.iter().any(punctual::is_soft) {
            sum += self.sampled(patch, 0, |place, _, u| self.soft_lights(place, u));
        }
        if !self.emitters.is_empty() {
            let edge = self.patches.texel_edge(patch);
            self.emitters.running_estimate(self.patches.position[patch], self.patches.normal[patch], edge, running);
            if !running.is_empty() {
                let running = &*running;
                sum += self.sampled(patch, 1, |place, pick, u| self.emitter(place, running, pick, u));
            }
        }
        if !self.scene().sky.is_black() {
            sum += self.sampled(patch, 2, |place, _, u| self.sky(place, u));
        }
        sum
    }

    fn place(&self, patch: usize, point: SurfacePoint) -> Place {
        let scene = self.scene();
        let sign = if self.patches.is_back(patch) { -1.0 } else { 1.0 };
        Place {
            point,
            position: scene.position(point.triangle, point.b),
            normal: scene.shading_normal(point.triangle, point.b) * sign,
            geometric: scene.geometric_normal(point.triangle) * sign,
        }
    }

    fn hard_lights(&self, patch: usize) -> Rgb {
        if self.scene().lights.iter().all(punctual::is_soft) {
            return Rgb::ZERO;
        }
        let (coarse, agreed) = self.cells(patch, CELLS);
        if agreed { coarse } else { self.cells(patch, FINE_CELLS).0 }
    }

    /// Mean over the cells, and whether all of them see the same lights.
    fn cells(&self, patch: usize, n: u32) -> (Rgb, bool) {
        let (mut sum, mut weight, mut first, mut agreed) = (Rgb::ZERO, 0.0f32, None, true);
        self.patches.cells(patch, n, |point, area| {
            let place = self.place(patch, point);
            let mut seen_lights = 0u64;
            for (k, light) in self.scene().lights.iter().enumerate().filter(|(_, l)| !punctual::is_soft(l)) {
                let light = self.light(&place, light, Vec2::ZERO);
                if light.max_element() > 0.0 {
                    sum += light * area;
                    seen_lights ^= mix(k as u64 + 1);
                }
            }
            weight += area;
            agreed &= *first.get_or_insert(seen_lights) == seen_lights;
        });
        (sum / weight.max(LEAST_CELLS), agreed)
    }

    fn soft_lights(&self, place: &Place, u: Vec2) -> Rgb {
        let soft = self.scene().lights.iter().filter(|l| punctual::is_soft(l));
        soft.map(|l| self.light(place, l, u)).fold(Rgb::ZERO, |a, b| a + b)
    }

    fn light(&self, place: &Place, light: &Light, u: Vec2) -> Rgb {
        let Some(seen) = punctual::seen_from(light, place.position, u) else { return Rgb::ZERO };
        let cosine = place.normal.dot(seen.toward.normalize_or_zero());
        if cosine <= 0.0 || place.geometric.dot(seen.toward) <= 0.0 {
            return Rgb::ZERO;
        }
        let origin = self.tracer.origin_on(place.point.triangle, place.point.b, seen.toward);
        let ray = if seen.far {
            Ray { origin, direction: seen.toward, t_max: f32::INFINITY }
        } else {
            Ray { origin, direction: place.position + seen.toward - origin, t_max: 1.0 }
        };
        if self.tracer.occluded(&ray) { Rgb::ZERO } else { seen.illuminance * cosine }
    }

    fn emitter(&self, place: &Place, running: &[f32], pick: f32, u: Vec2) -> Rgb {
        let Some(s) = self.emitters.sample(self.scene(), place.position, running, pick, u) else { return Rgb::ZERO };
        let cosine = place.normal.dot(s.direction);
        if cosine <= 0.0 || place.geometric.dot(s.direction) <= 0.0 || s.weighted.max_element() <= 0.0 {
            return Rgb::ZERO;
        }
        let origin = self.tracer.origin_on(place.point.triangle, place.point.b, s.direction);
        let target = self.tracer.origin_on(s.triangle, s.b, -s.direction);
        if self.tracer.occluded(&Ray { origin, direction: target - origin, t_max: 1.0 }) {
            return Rgb::ZERO;
        }
        s.weighted * cosine
    }

    fn sky(&self, place: &Place, u: Vec2) -> Rgb {
        let direction = Frame::from_normal(place.normal).to_world(warp::square_to_cosine_hemisphere(u));
        let radiance = self.scene().sky.radiance(direction);
        if place.geometric.dot(direction) <= 0.0 || radiance.max_element() <= 0.0 {
            return Rgb::ZERO;
        }
        let origin = self.tracer.origin_on(place.point.triangle, place.point.b, direction);
        if self.tracer.occluded(&Ray { origin, direction, t_max: f32::INFINITY }) {
            return Rgb::ZERO;
        }
        radiance * PI
    }

    /// Mean of `f` over low-discrepancy samples; more of them where two halves differ.
    fn sampled(&self, patch: usize, kind: u64, f: impl Fn(&Place, f32, Vec2) -> Rgb) -> Rgb {
        let half = self.settings.samples.div_ceil(2).max(1);
        let round = |index: u64, n: u32| {
            let key = (Stage::Light as u64) << 48 | kind << 40 | index << 36;
            let sequence = Sequence::new(mix(self.settings.seed ^ mix(key).wrapping_add(patch as u64)));
            let offset = sequence.point(u32::MAX)[0];
            let mut sum = Rgb::ZERO;
            for k in 0..n {
                let [u, v, x, y] = sequence.point(k);
                let place = self.place(patch, self.patches.sample(patch, Vec2::new(x, y)));
                // The golden ratio spreads the choice of emitter against the other dimensions.
                let pick = (offset + k as f32 * 0.618_034).fract();
                sum += f(&place, pick, Vec2::new(u, v));
            }
            sum / n as f32
        };
        let (a, b) = (round(0, half), round(1, half));
        let mean = (a + b) * 0.5;
        if (a - b).abs().max_element() <= DISAGREEMENT * mean.max_element() {
            return mean;
        }
        let more = round(2, half * 2 * REFINEMENT);
        (mean + more * REFINEMENT as f32) / (1 + REFINEMENT) as f32
    }
}
