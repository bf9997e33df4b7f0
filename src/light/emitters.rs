//! Emissive triangles, and the choice among them for one patch.
//!
//! A triangle is chosen in proportion to an estimate of the light that it sends to the patch if nothing is in between;
//! a direction to it is drawn uniformly from its solid angle (Arvo 1995), so near triangles have no peak of variance.
//!
//! Limits: the estimate runs over all emissive triangles for every patch, so its cost grows with their number.

use crate::base::color::luminance;
use crate::base::{Rgb, warp};
use crate::scene::Scene;
use core::f32::consts::PI;
use glam::{Vec2, Vec3};

/// Points per side of the grid at which a textured emitter is averaged.
const TEXTURE_GRID: u32 = 8;
/// Share of the estimate that does not depend on angles, so that no triangle in front is left out.
const FLOOR: f32 = 0.05;
/// Squared distance over area below which a triangle counts as near.
const NEAR: f32 = 16.0;
/// Solid angle below which a triangle is sampled by area: single precision loses its spherical form there [sr].
const SMALL: f32 = 1e-4;

/// All emissive triangles of a scene.
#[derive(Debug, Default)]
pub struct Emitters {
    triangles: Vec<Emitter>,
}

#[derive(Debug, Clone, Copy)]
struct Emitter {
    triangle: u32,
    corners: [Vec3; 3],
    centroid: Vec3,
    normal: Vec3,
    area: f32,
    radiance: Rgb,
    two_sided: bool,
}

/// A direction toward an emitter and what comes from there if nothing is in between.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sampled {
    pub(super) direction: Vec3,
    pub(super) triangle: u32,
    pub(super) b: Vec2,
    /// Radiance over probability density [cd/m² · sr].
    pub(super) weighted: Rgb,
}

impl Emitters {
    /// Finds the emissive triangles.
    #[must_use]
    pub fn new(scene: &Scene) -> Self {
        let glows = |t: &u32| {
            let m = scene.material(*t);
            !m.unlit && m.emission.max_element() > 0.0
        };
        let emitter = |triangle: u32| {
            let corners = scene.corners(triangle);
            Emitter {
                triangle,
                corners,
                centroid: (corners[0] + corners[1] + corners[2]) / 3.0,
                normal: scene.geometric_normal(triangle),
                area: scene.area(triangle) as f32,
                radiance: mean_emission(scene, triangle),
                two_sided: scene.material(triangle).double_sided,
            }
        };
        let all = (0..scene.triangles.len() as u32).filter(glows).map(emitter);
        Self { triangles: all.filter(|e| e.area > 0.0 && e.radiance.max_element() > 0.0).collect() }
    }

    /// Nothing glows.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.triangles.is_empty()
    }

    /// Number of emissive triangles.
    #[must_use]
    pub fn len(&self) -> usize {
        self.triangles.len()
    }

    /// Flux of all emissive surfaces [lm].
    #[must_use]
    pub fn flux(&self) -> Rgb {
        self.triangles.iter().map(|e| e.flux()).fold(Rgb::ZERO, |a, b| a + b)
    }

    /// Running sum of the estimates for a patch of this centre, normal and size [m]; empty when nothing reaches it.
    pub(super) fn running_estimate(&self, position: Vec3, normal: Vec3, size: f32, running: &mut Vec<f32>) {
        running.clear();
        let mut sum = 0.0;
        for e in &self.triangles {
            sum += e.estimate(position, normal, size);
            running.push(sum);
        }
        if sum <= 0.0 {
            running.clear();
        }
    }

    /// A direction from `position` for `pick` in [0, 1) and `u` in [0, 1)².
    pub(super) fn sample(&self, scene: &Scene, position: Vec3, running: &[f32], pick: f32, u: Vec2) -> Option<Sampled> {
        let total = *running.last()?;
        let k = running.partition_point(|&s| s <= pick * total).min(running.len() - 1);
        let probability = (running[k] - if k == 0 { 0.0 } else { running[k - 1] }) / total;
        if probability <= 0.0 {
            return None;
        }
        let e = &self.triangles[k];
        let (direction, b, solid_angle) = e.direction(position, u)?;
        let radiance =
            if e.two_sided || e.normal.dot(direction) < 0.0 { scene.emission(e.triangle, b) } else { Rgb::ZERO };
        Some(Sampled { direction, triangle: e.triangle, b, weighted: radiance * (solid_angle / probability) })
    }

    /// Point, normal and radiance for a line that leaves an emitter, uniform by flux in `pick`; and its share 1/density.
    pub(super) fn leave(&self, scene: &Scene, running: &[f64], pick: f64, u: Vec2) -> Option<(u32, Vec2, Vec3, Rgb)> {
        let total = *running.last()?;
        let target = pick * total;
        let k = running.partition_point(|&s| s <= target).min(running.len() - 1);
        let e = &self.triangles[k];
        let mut normal = e.normal;
        if e.two_sided {
            let low = if k == 0 { 0.0 } else { running[k - 1] };
            if target - low > 0.5 * (running[k] - low) {
                normal = -normal;
            }
        }
        let b = warp::square_to_triangle(u);
        let mean = f64::from(e.radiance.x + e.radiance.y + e.radiance.z);
        let flux = scene.emission(e.triangle, b).as_dvec3() * (total / mean.max(f64::MIN_POSITIVE));
        Some((e.triangle, b, normal, flux.as_vec3()))
    }

    /// Running sum of the flux of the emitters [lm], sum of the channels.
    pub(super) fn running_flux(&self) -> Vec<f64> {
        let mut sum = 0.0;
        self.triangles
            .iter()
            .map(|e| {
                let f = e.flux();
                sum += f64::from(f.x + f.y + f.z);
                sum
            })
            .collect()
    }
}

impl Emitter {
    fn flux(&self) -> Rgb {
        self.radiance * (PI * self.area * if self.two_sided { 2.0 } else { 1.0 })
    }

    fn estimate(&self, position: Vec3, normal: Vec3, size: f32) -> f32 {
        let above = self.corners.iter().any(|c| (*c - position).dot(normal) > -size);
        let toward = self.centroid - position;
        let facing = -toward.dot(self.normal);
        if !above || (!self.two_sided && facing < -size) {
            return 0.0;
        }
        let power = luminance(self.radiance);
        let distance_squared = toward.length_squared();
        if distance_squared < NEAR * self.area {
            return power * self.near_estimate(position, normal);
        }
        let distance = distance_squared.sqrt();
        let cosine = (facing.abs() / distance).max(FLOOR);
        let elevation = (toward.dot(normal) / distance).max(FLOOR);
        power * self.area * cosine * elevation / distance_squared
    }

    /// Solid angle times mean elevation: from close by, the centroid says little about a triangle.
    fn near_estimate(&self, position: Vec3, normal: Vec3) -> f32 {
        let relative = self.corners.map(|c| c - position);
        let all = [relative[0], relative[1], relative[2], self.centroid - position];
        let elevation = all.map(|v| v.normalize_or_zero().dot(normal).max(0.0));
        let mean = 0.25 * (elevation[0] + elevation[1] + elevation[2] + elevation[3]);
        let solid_angle = warp::SphericalTriangle::new(relative).map_or(0.0, |s| s.solid_angle);
        // A triangle in the plane of the centre can still light the rest of the texel.
        solid_angle.max(FLOOR * FLOOR) * mean.max(FLOOR)
    }

    /// Unit direction, barycentric weights of the point that it leads to, and 1/density [sr].
    fn direction(&self, position: Vec3, u: Vec2) -> Option<(Vec3, Vec2, f32)> {
        let relative = self.corners.map(|c| c - position);
        let spherical = warp::SphericalTriangle::new(relative).filter(|s| s.solid_angle > SMALL);
        if let Some(s) = spherical {
            let direction = s.sample(u);
            return Some((direction, barycentric(relative, self.normal, direction)?, s.solid_angle));
        }
        let b = warp::square_to_triangle(u);
        let to = relative[0] * (1.0 - b.x - b.y) + relative[1] * b.x + relative[2] * b.y;
        let distance_squared = to.length_squared();
        let direction = to.try_normalize()?;
        Some((direction, b, self.area * direction.dot(self.normal).abs() / distance_squared))
    }
}

/// Where a direction from the origin meets the plane of a triangle, clamped to the triangle.
fn barycentric(corners: [Vec3; 3], normal: Vec3, direction: Vec3) -> Option<Vec2> {
    let [a, b, c] = corners.map(|v| v.as_dvec3());
    let (n, d) = (normal.as_dvec3(), direction.as_dvec3());
    let slope = d.dot(n);
    if slope == 0.0 {
        return None;
    }
    let p = d * (a.dot(n) / slope) - a;
    let (e1, e2) = (b - a, c - a);
    let inverse = 1.0 / e1.cross(e2).length_squared().max(f64::MIN_POSITIVE);
    let b1 = (p.cross(e2).dot(e1.cross(e2)) * inverse).clamp(0.0, 1.0);
    let b2 = (e1.cross(p).dot(e1.cross(e2)) * inverse).clamp(0.0, 1.0 - b1);
    Some(Vec2::new(b1 as f32, b2 as f32))
}

fn mean_emission(scene: &Scene, triangle: u32) -> Rgb {
    if scene.material(triangle).emission_texture.is_none() {
        return scene.material(triangle).emission;
    }
    let n = TEXTURE_GRID;
    let point = |k: u32| {
        let u = Vec2::new((k % n) as f32 + 0.5, (k / n) as f32 + 0.5) / n as f32;
        scene.emission(triangle, warp::square_to_triangle(u))
    };
    // A texture that glows only between these points must not be lost: a hundredth of the factor is the least.
    let mean = (0..n * n).map(point).fold(Rgb::ZERO, |a, b| a + b) / (n * n) as f32;
    mean.max(scene.material(triangle).emission * 1e-2)
}
