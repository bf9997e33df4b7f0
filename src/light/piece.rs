//! Pieces of emissive triangles (see [`divide`](super::divide)): what a sample aims at.
//!
//! A direction to a piece is drawn uniformly from its solid angle (Arvo 1995), so near pieces have no peak of variance.

use super::site::Site;
use crate::base::color::luminance;
use crate::base::{Rgb, warp};
use crate::scene::{Alpha, Scene};
use crate::trace::Ground;
use core::f32::consts::PI;
use glam::{Vec2, Vec3};

/// Least radiance of a piece for the choice, as a share of the most that it can have: its mean may be a little off.
pub(super) const LEAST: f32 = 1e-2;
/// Share of the estimate that does not depend on angles, so that nothing in front is left out.
pub(super) const FLOOR: f32 = 0.05;
/// Squared distance over area below which a piece counts as near.
const NEAR: f32 = 16.0;
/// Solid angle below which a piece is sampled by area: single precision loses its spherical form there [sr].
const SMALL: f32 = 1e-4;
/// Distance in radii of a piece from which it is sampled by area, too: it looks alike from one end to the other.
const FAR: f32 = 8.0;

/// A part of an emissive triangle, or all of it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Piece {
    pub(super) triangle: u32,
    /// Its corners in barycentric weights of the triangle's vertices 1 and 2.
    b: [Vec2; 3],
    pub(super) corners: [Vec3; 3],
    pub(super) centroid: Vec3,
    pub(super) normal: Vec3,
    pub(super) area: f32,
    /// Squared distance from which it is sampled by area [m²].
    far: f32,
    /// Mean emission [cd/m²].
    mean: Rgb,
    /// The same, or a little in the dark: what it is chosen by.
    pub(super) radiance: Rgb,
    pub(super) two_sided: bool,
    /// No ray passes it by chance, so one that looks around meets it where a shadow ray does.
    pub(super) solid: bool,
    /// Its triangle, prepared for the ends of shadow rays.
    pub(super) ground: Ground,
}

/// A direction toward an emitter and what comes from there if nothing is in between.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sampled {
    pub(super) direction: Vec3,
    pub(super) b: Vec2,
    /// Radiance over probability density [cd/m² · sr].
    pub(super) weighted: Rgb,
    /// Probability density [1/sr].
    pub(super) density: f32,
}

/// The triangle's weights at a point of a piece.
pub(super) fn inside(b: [Vec2; 3], at: Vec2) -> Vec2 {
    b[0] * (1.0 - at.x - at.y) + b[1] * at.x + b[2] * at.y
}

impl Piece {
    /// The part of a triangle between three points in its weights, with its mean emission and what no point of it
    /// exceeds [cd/m²]; `None` without area.
    pub(super) fn new(scene: &Scene, triangle: u32, b: [Vec2; 3], mean: Rgb, most: Rgb) -> Option<Self> {
        let corners = b.map(|b| scene.position(triangle, b));
        // A piece of a thousandth of a triangle has rounded corners; what it is of the whole is exact.
        let [p0, p1, p2] = scene.corners(triangle);
        let whole = (p1 - p0).as_dvec3().cross((p2 - p0).as_dvec3()).length() * 0.5;
        let area = whole * f64::from((b[1] - b[0]).perp_dot(b[2] - b[0]).abs());
        let material = scene.material(triangle);
        let centroid = (corners[0] + corners[1] + corners[2]) / 3.0;
        let radius_squared = corners.map(|c| c.distance_squared(centroid)).into_iter().fold(0.0, f32::max);
        let piece = Self {
            triangle,
            b,
            corners,
            centroid,
            normal: scene.geometric_normal(triangle),
            area: area as f32,
            far: FAR * FAR * radius_squared,
            mean,
            radiance: mean.max(most * LEAST),
            two_sided: material.double_sided,
            solid: material.alpha == Alpha::Opaque && material.transmission == 0.0,
            ground: Ground::new(scene.corners(triangle)),
        };
        (piece.area > 0.0 && piece.radiance.is_finite()).then_some(piece)
    }

    /// Distance of the box around it from a position [m].
    pub(super) fn distance(&self, position: Vec3) -> f32 {
        let [a, b, c] = self.corners;
        position.distance(position.clamp(a.min(b).min(c), a.max(b).max(c)))
    }

    /// Mean emission [cd/m²].
    pub(super) fn mean(&self) -> Rgb {
        self.mean
    }

    /// Flux [lm].
    pub(super) fn flux(&self) -> Rgb {
        self.mean * self.flux_per_radiance()
    }

    /// What its choice is in proportion to where no receiver is known: the flux, a little in the dark [lm].
    pub(super) fn weight(&self) -> f64 {
        f64::from(self.radiance.element_sum()) * f64::from(self.flux_per_radiance())
    }

    fn flux_per_radiance(&self) -> f32 {
        PI * self.area * if self.two_sided { 2.0 } else { 1.0 }
    }

    /// A uniform point in weights of its triangle, and the flux of all of it if it were everywhere as there.
    pub(super) fn leave(&self, scene: &Scene, u: Vec2) -> (Vec2, Rgb) {
        let b = inside(self.b, warp::square_to_triangle(u));
        (b, scene.emission(self.triangle, b) * self.flux_per_radiance())
    }

    /// About the illuminance that it gives to a site if nothing is in between [lx]; 0 only where it gives none.
    pub(super) fn estimate(&self, site: &Site) -> f32 {
        let toward = self.centroid - site.position;
        let facing = -toward.dot(self.normal);
        if !site.can_see(&self.corners) || (!self.two_sided && facing < -site.radius) {
            return 0.0;
        }
        let power = luminance(self.radiance);
        let distance_squared = toward.length_squared();
        if distance_squared < NEAR * self.area {
            return power * self.near_estimate(site);
        }
        let distance = distance_squared.sqrt();
        let cosine = (facing.abs() / distance).max(FLOOR);
        power * self.area * cosine * site.elevation(toward / distance) / distance_squared
    }

    /// Solid angle times mean elevation: from close by, the centroid says little about a triangle.
    fn near_estimate(&self, site: &Site) -> f32 {
        let relative = self.corners.map(|c| c - site.position);
        let all = [relative[0], relative[1], relative[2], self.centroid - site.position];
        let [a, b, c, middle] = all.map(Vec3::normalize_or_zero);
        let elevation = [a, b, c, middle].map(|v| site.elevation(v));
        let mean = 0.25 * (elevation[0] + elevation[1] + elevation[2] + elevation[3]);
        // A triangle in the plane of the centre can still light the rest of the texel.
        warp::solid_angle([a, b, c]).max(FLOOR * FLOOR) * mean
    }

    /// A direction from `position`; its density per steradian is 1/(solid angle) where that is not too small.
    pub(super) fn sample(&self, scene: &Scene, position: Vec3, probability: f32, u: Vec2) -> Option<Sampled> {
        let (direction, at, solid_angle) = self.direction(position, u)?;
        let b = inside(self.b, at);
        let radiance = self.toward(scene, direction, b);
        let density = probability / solid_angle.max(f32::MIN_POSITIVE);
        Some(Sampled { direction, b, weighted: radiance * (solid_angle / probability), density })
    }

    /// Radiance toward `position` from a point of its triangle, and 1/density of the unit direction there by
    /// [`Piece::sample`] [sr].
    pub(super) fn seen(&self, scene: &Scene, position: Vec3, direction: Vec3, b: Vec2) -> (Rgb, f32) {
        let solid_angle = self.spherical(position).map_or_else(
            || self.flat_angle(direction, scene.position(self.triangle, b).distance_squared(position)),
            |s| s.solid_angle,
        );
        (self.toward(scene, direction, b), solid_angle)
    }

    /// Radiance from a point of its triangle to where a direction leads there from.
    pub(super) fn toward(&self, scene: &Scene, direction: Vec3, b: Vec2) -> Rgb {
        let lit = self.two_sided || self.normal.dot(direction) < 0.0;
        if lit { scene.emission(self.triangle, b) } else { Rgb::ZERO }
    }

    /// How far inside the piece a point of its triangle lies: from 1/3 at its middle to negative numbers outside.
    pub(super) fn depth(&self, b: Vec2) -> f32 {
        let [e1, e2, e] = [self.b[1] - self.b[0], self.b[2] - self.b[0], b - self.b[0]];
        let inverse = e1.perp_dot(e2).recip();
        let (x, y) = (e.perp_dot(e2) * inverse, e1.perp_dot(e) * inverse);
        x.min(y).min(1.0 - x - y)
    }

    /// Solid angle of the piece as if it were all at one distance and angle [sr].
    fn flat_angle(&self, direction: Vec3, distance_squared: f32) -> f32 {
        self.area * direction.dot(self.normal).abs() / distance_squared
    }

    /// Unit direction, weights of the point of the piece that it leads to, and 1/density [sr].
    fn direction(&self, position: Vec3, u: Vec2) -> Option<(Vec3, Vec2, f32)> {
        let relative = self.corners.map(|c| c - position);
        if let Some(s) = self.spherical(position) {
            let direction = s.sample(u);
            return Some((direction, barycentric(relative, self.normal, direction)?, s.solid_angle));
        }
        let b = warp::square_to_triangle(u);
        let to = relative[0] * (1.0 - b.x - b.y) + relative[1] * b.x + relative[2] * b.y;
        let distance_squared = to.length_squared();
        let direction = to.try_normalize()?;
        Some((direction, b, self.flat_angle(direction, distance_squared)))
    }

    /// The triangle as a point sees it, unless it is too small or too far away for that.
    #[inline]
    fn spherical(&self, position: Vec3) -> Option<warp::SphericalTriangle> {
        if self.centroid.distance_squared(position) > self.far {
            return None;
        }
        warp::SphericalTriangle::new(self.corners.map(|c| c - position)).filter(|s| s.solid_angle > SMALL)
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
