//! Lines that leave the emitters, for direct light shot as in the paper.
//!
//! In: scene. Out: line k of n, with flux [lm]; the flux of all n lines adds up to the emitted flux on average. Lines
//! are dealt out to emissive surfaces, lights and sky in proportion to their flux.
//!
//! Suns and sky shine on a disc that covers the scene's bounding sphere; what passes the scene by escapes.

use super::{Emitters, punctual};
use crate::base::random::Stage;
use crate::base::{Frame, Rgb, Stream, warp};
use crate::scene::Light;
use crate::trace::{Line, Ray, Tracer};
use core::f32::consts::PI;
use glam::{Vec2, Vec3};

/// Everything that shoots direct light.
pub struct Sources<'a> {
    tracer: &'a Tracer<'a>,
    emitters: &'a Emitters,
    running_flux: Vec<f64>,
    /// Running sum of the mean flux of: all surfaces, each light, the sky.
    running: Vec<f64>,
    flux: Rgb,
    center: Vec3,
    radius: f32,
    seed: u64,
}

impl<'a> Sources<'a> {
    /// Collects the sources of a scene.
    #[must_use]
    pub fn new(tracer: &'a Tracer<'a>, emitters: &'a Emitters, seed: u64) -> Self {
        let scene = tracer.scene();
        let (low, high) = tracer.bounds();
        let (center, radius) = ((low + high) * 0.5, (high - low).length() * 0.5);
        let disc = PI * radius * radius;
        let light = |l: &Light| match *l {
            Light::Sun { illuminance, .. } => illuminance * disc,
            Light::Point { intensity, .. } => intensity * (4.0 * PI),
            Light::Spot { intensity, cos_outer, .. } => intensity * (2.0 * PI * (1.0 - cos_outer)),
            Light::Profiled { factor, ref profile, .. } => factor * profile.flux(),
        };
        let sky = emitters.infinity.total(scene);
        let parts = core::iter::once(emitters.flux())
            .chain(emitters.lights.iter().map(light))
            .chain(core::iter::once(sky * disc));
        let (mut flux, mut running, mut sum) = (Rgb::ZERO, vec![], 0.0);
        for part in parts {
            flux += part;
            sum += f64::from(part.x + part.y + part.z) / 3.0;
            running.push(sum);
        }
        Self { tracer, emitters, running_flux: emitters.running_flux(), running, flux, center, radius, seed }
    }

    /// Flux of all sources [lm]; of spots and lights with a range, of the cone without falloff.
    #[must_use]
    pub fn flux(&self) -> Rgb {
        self.flux
    }

    /// Line k of n.
    #[must_use]
    pub fn line(&self, k: u64, n: u64) -> Line {
        let mut stream = Stream::new(self.seed, Stage::Light, n, k);
        let offset = Stream::new(self.seed, Stage::Light, n, u64::MAX).next_f64();
        let total = self.running.last().copied().unwrap_or(0.0);
        let target = (k as f64 + offset) / n as f64 * total;
        let source = self.running.partition_point(|&s| s <= target).min(self.running.len() - 1);
        let low = if source == 0 { 0.0 } else { self.running[source - 1] };
        let own = self.running[source] - low;
        let pick = ((target - low) / own.max(f64::MIN_POSITIVE)).clamp(0.0, 1.0 - 1e-12);
        // 1/(n · probability of this source), for flux per source.
        let share = (total / (own.max(f64::MIN_POSITIVE) * n as f64)) as f32;
        let mut square = || Vec2::new(stream.next_f32(), stream.next_f32());
        let lights = &self.emitters.lights;
        let (ray, flux) = match source {
            0 => self.surface(pick, square(), square()),
            s if s <= lights.len() => self.light(&lights[s - 1], square(), square()),
            _ => self.sky(pick as f32, square(), square()),
        };
        Line { ray, flux: flux * share }
    }

    fn surface(&self, pick: f64, position: Vec2, direction: Vec2) -> (Ray, Rgb) {
        let scene = self.tracer.scene();
        let Some((triangle, b, normal, flux)) = self.emitters.leave(scene, &self.running_flux, pick, position) else {
            return (nowhere(), Rgb::ZERO);
        };
        let direction = Frame::from_normal(normal).to_world(warp::square_to_cosine_hemisphere(direction));
        let origin = self.tracer.origin_on(triangle, b, direction);
        (Ray { origin, direction, t_max: f32::INFINITY }, flux)
    }

    fn light(&self, light: &Light, u: Vec2, v: Vec2) -> (Ray, Rgb) {
        match *light {
            Light::Sun { direction, illuminance, angle } => {
                let direction = -punctual::toward_sun(direction, angle, v);
                (self.line_from_outside(direction, u), illuminance * (PI * self.radius * self.radius))
            }
            Light::Point { position, intensity, radius, .. } => {
                let direction = warp::square_to_sphere(u);
                let ray = from_light(light, position, radius, direction, v);
                (ray, intensity * (4.0 * PI) * self.window(light, position, &ray))
            }
            Light::Spot { position, direction: axis, intensity, radius, cos_inner, cos_outer, .. } => {
                let local = warp::square_to_cone(u, cos_outer);
                let direction = Frame::from_normal(axis).to_world(local);
                let cone = ((local.z - cos_outer) / (cos_inner - cos_outer).max(0.001)).clamp(0.0, 1.0);
                let flux = intensity * (2.0 * PI * (1.0 - cos_outer) * cone * cone);
                let ray = from_light(light, position, radius, direction, v);
                (ray, flux * self.window(light, position, &ray))
            }
            Light::Profiled { position, axes, factor, radius, ref profile, .. } => {
                let Some((local, lumens)) = profile.sample(u) else { return (nowhere(), Rgb::ZERO) };
                let ray = from_light(light, position, radius, axes * local, v);
                (ray, factor * (lumens * self.window(light, position, &ray)))
            }
        }
    }

    /// The range window at the distance where the line lands.
    fn window(&self, light: &Light, position: Vec3, ray: &Ray) -> f32 {
        let (Light::Point { range, .. } | Light::Spot { range, .. } | Light::Profiled { range, .. }) = *light else {
            return 1.0;
        };
        if !range.is_finite() {
            return 1.0;
        }
        let landed = |t: f32| (ray.origin + ray.direction * t).distance_squared(position);
        self.tracer.closest_hit(ray).map_or(0.0, |hit| punctual::window(range, landed(hit.t)))
    }

    fn sky(&self, pick: f32, u: Vec2, v: Vec2) -> (Ray, Rgb) {
        let scene = self.tracer.scene();
        let (toward, density) = self.emitters.infinity.anywhere(scene, pick, v);
        let radiance = scene.light_from_infinity(toward);
        (self.line_from_outside(-toward, u), radiance * (PI * self.radius * self.radius / density))
    }

    fn line_from_outside(&self, direction: Vec3, u: Vec2) -> Ray {
        let frame = Frame::from_normal(direction);
        let disk = warp::square_to_disk(u) * self.radius;
        let origin = self.center + frame.s * disk.x + frame.t * disk.y - direction * (self.radius * 1.01);
        Ray { origin, direction, t_max: f32::INFINITY }
    }
}

/// A line from a glowing sphere: those of one direction cover its disc evenly, as its radiance is even.
fn from_light(light: &Light, position: Vec3, radius: f32, direction: Vec3, u: Vec2) -> Ray {
    let mut origin = position + direction * punctual::standing(light);
    if radius > 0.0 {
        let frame = Frame::from_normal(direction);
        let disc = warp::square_to_disk(u);
        let out = (1.0 - disc.length_squared()).max(0.0).sqrt();
        origin += (frame.s * disc.x + frame.t * disc.y + direction * out) * radius;
    }
    Ray { origin, direction, t_max: f32::INFINITY }
}

fn nowhere() -> Ray {
    Ray { origin: Vec3::ZERO, direction: Vec3::Z, t_max: 0.0 }
}
