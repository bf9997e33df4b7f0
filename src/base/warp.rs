//! Maps from the unit square to directions and surfaces, with their densities.
//!
//! Sources: Shirley and Chiu, "A Low Distortion Map Between Disk and Square", JGT 2(3), 1997; Arvo, "Stratified
//! Sampling of Spherical Triangles", SIGGRAPH 1995; the rest is textbook (Pharr, Jakob, Humphreys, *Physically Based
//! Rendering*, 4th edition, appendix A.5). All maps are continuous, so that stratified points stay stratified.

use glam::{Vec2, Vec3};
use std::f32::consts::{FRAC_PI_2, FRAC_PI_4, PI};

/// Uniform point of the unit disc.
#[must_use]
pub fn square_to_disk(u: Vec2) -> Vec2 {
    let o = u * 2.0 - Vec2::ONE;
    if o == Vec2::ZERO {
        return Vec2::ZERO;
    }
    let (r, theta) =
        if o.x.abs() > o.y.abs() { (o.x, FRAC_PI_4 * (o.y / o.x)) } else { (o.y, FRAC_PI_2 - FRAC_PI_4 * (o.x / o.y)) };
    let (sin, cos) = libm::sincosf(theta);
    Vec2::new(r * cos, r * sin)
}

/// The point of the unit square that [`square_to_disk`] maps to this point of the disc.
#[must_use]
pub fn disk_to_square(point: Vec2) -> Vec2 {
    let radius = point.length();
    let (x, y) = (point.x.abs(), point.y.abs());
    // Each quarter of the square between its diagonals is mapped to one of the disc.
    let o = if x > y {
        Vec2::new(radius, radius * libm::atan2f(y, x) / FRAC_PI_4)
    } else {
        Vec2::new(radius * (FRAC_PI_2 - libm::atan2f(y, x)) / FRAC_PI_4, radius)
    };
    (o.copysign(point) + Vec2::ONE) * 0.5
}

/// Direction around +z with density cos θ / π per steradian.
#[must_use]
pub fn square_to_cosine_hemisphere(u: Vec2) -> Vec3 {
    let d = square_to_disk(u);
    let z = (1.0 - d.length_squared()).max(0.0).sqrt();
    Vec3::new(d.x, d.y, z.max(1e-6))
}

/// Density of [`square_to_cosine_hemisphere`] per steradian, for a unit vector.
#[must_use]
pub fn square_to_cosine_hemisphere_pdf(v: Vec3) -> f32 {
    v.z.max(0.0) / PI
}

/// Uniform direction of the whole sphere (density 1/4π).
#[must_use]
pub fn square_to_sphere(u: Vec2) -> Vec3 {
    square_to_cone(u, -1.0)
}

/// Uniform direction within a cone around +z; density 1/(2π(1 − `cos_max`)).
#[must_use]
pub fn square_to_cone(u: Vec2, cos_max: f32) -> Vec3 {
    let z = 1.0 - u.x * (1.0 - cos_max);
    let r = (1.0 - z * z).max(0.0).sqrt();
    let (sin, cos) = libm::sincosf(2.0 * PI * u.y);
    Vec3::new(r * cos, r * sin, z)
}

/// Density of [`square_to_cone`] per steradian, within the cone.
#[must_use]
pub fn square_to_cone_pdf(cos_max: f32) -> f32 {
    1.0 / (2.0 * PI * (1.0 - cos_max))
}

/// [`square_to_cone`] by `versine` = 1 − `cos_max`, which keeps its digits in cones as narrow as a distant lamp.
#[must_use]
pub fn square_to_narrow_cone(u: Vec2, versine: f32) -> Vec3 {
    let depth = u.x * versine;
    let r = (depth * (2.0 - depth)).max(0.0).sqrt();
    let (sin, cos) = libm::sincosf(2.0 * PI * u.y);
    Vec3::new(r * cos, r * sin, 1.0 - depth)
}

/// Barycentric weights of vertices 1 and 2 of a uniform point of a triangle.
#[must_use]
pub fn square_to_triangle(u: Vec2) -> Vec2 {
    let root = u.x.sqrt();
    Vec2::new(root * (1.0 - u.y), root * u.y)
}

/// A triangle seen from a point, as solid angle.
#[derive(Clone, Copy, Debug)]
pub struct SphericalTriangle {
    a: Vec3,
    b: Vec3,
    c: Vec3,
    /// Of the angle α at corner a.
    sin_alpha: f32,
    cos_alpha: f32,
    cos_c: f32,
    /// Solid angle [sr].
    pub solid_angle: f32,
}

impl SphericalTriangle {
    /// The triangle with these corners (relative to the point that sees it); `None` where its solid angle vanishes.
    #[must_use]
    #[inline]
    pub fn new(corners: [Vec3; 3]) -> Option<Self> {
        let [a, b, c] = corners.map(Vec3::normalize_or_zero);
        let (n_ab, n_ca) = (a.cross(b).try_normalize()?, c.cross(a).try_normalize()?);
        let solid_angle = solid_angle([a, b, c]);
        let usable = solid_angle > 0.0 && solid_angle.is_finite();
        // Sine and cosine are all that is needed of α, and the angle itself would cost more than they do.
        usable.then(|| Self {
            sin_alpha: n_ab.cross(n_ca).length(),
            cos_alpha: -n_ab.dot(n_ca),
            cos_c: a.dot(b),
            a,
            b,
            c,
            solid_angle,
        })
    }

    /// Unit direction with uniform density 1/`solid_angle` within the triangle.
    #[must_use]
    #[inline]
    pub fn sample(&self, u: Vec2) -> Vec3 {
        // φ is the angle of the part of the area that `u.x` asks for, less α; by half of it, small triangles keep their digits.
        let (sin_half, cos_half) = libm::sincosf(0.5 * u.x * self.solid_angle);
        let (sin, versine) = (2.0 * sin_half * cos_half, 2.0 * sin_half * sin_half);
        let (sin_alpha, cos_alpha) = (self.sin_alpha, self.cos_alpha);
        let k1 = sin * sin_alpha - versine * cos_alpha;
        let (sin_phi, cos_phi) = (sin * cos_alpha - (1.0 - versine) * sin_alpha, k1 + cos_alpha);
        let k2 = sin_phi + sin_alpha * self.cos_c;
        let numerator = (k2 * cos_phi - k1 * sin_phi) * cos_alpha - k2;
        let denominator = (k2 * sin_phi + k1 * cos_phi) * sin_alpha;
        let q = if denominator.abs() > 1e-12 { (numerator / denominator).clamp(-1.0, 1.0) } else { 1.0 };
        let toward_c = (self.c - self.a * self.c.dot(self.a)).normalize_or_zero();
        let c_new = self.a * q + toward_c * (1.0 - q * q).max(0.0).sqrt();
        let z = 1.0 - u.y * (1.0 - c_new.dot(self.b));
        let toward_new = (c_new - self.b * c_new.dot(self.b)).normalize_or_zero();
        (self.b * z + toward_new * (1.0 - z * z).max(0.0).sqrt()).normalize_or_zero()
    }
}

/// Solid angle of a triangle by unit directions to its corners [sr]; 0 in its plane.
///
/// Source: A. van Oosterom, J. Strackee, "The Solid Angle of a Plane Triangle", 1983: accurate also for small triangles.
#[must_use]
pub fn solid_angle([a, b, c]: [Vec3; 3]) -> f32 {
    let determinant = a.dot(b.cross(c)).abs();
    if determinant > 0.0 { 2.0 * libm::atan2f(determinant, 1.0 + a.dot(b) + b.dot(c) + c.dot(a)) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::{Stage, Stream};

    fn mean(n: u64, f: impl Fn(Vec2) -> f64) -> f64 {
        let draw = |i| {
            let mut s = Stream::new(5, Stage::Walk, 0, i);
            Vec2::new(s.next_f32(), s.next_f32())
        };
        (0..n).map(|i| f(draw(i))).fold(0.0, |a, b| a + b) / n as f64
    }

    #[test]
    fn cosine_hemisphere_has_the_moments_of_its_density() {
        // E[cos θ] = 2/3, E[cos² θ] = 1/2, E[x²] = 1/4 for density cos θ/π.
        let n = 400_000;
        let w = square_to_cosine_hemisphere;
        assert!((mean(n, |u| f64::from(w(u).z)) - 2.0 / 3.0).abs() < 2e-3);
        assert!((mean(n, |u| f64::from(w(u).z.powi(2))) - 0.5).abs() < 2e-3);
        assert!((mean(n, |u| f64::from(w(u).x.powi(2))) - 0.25).abs() < 2e-3);
        assert!(mean(n, |u| f64::from(w(u).y)).abs() < 3e-3);
    }

    #[test]
    fn a_uniform_hemisphere_would_fail_the_same_test() {
        let moment = mean(400_000, |u| f64::from(square_to_cone(u, 0.0).z));
        assert!((moment - 2.0 / 3.0).abs() > 0.1);
    }

    #[test]
    fn octant_has_solid_angle_half_pi_and_samples_stay_inside() {
        let t = SphericalTriangle::new([Vec3::X, Vec3::Y * 2.0, Vec3::Z * 3.0]).unwrap();
        assert!((t.solid_angle - FRAC_PI_2).abs() < 1e-5);
        // Mean of z over the octant: ∫ cos θ dω / Ω = (π/4) / (π/2).
        assert!((mean(200_000, |u| f64::from(t.sample(u).z)) - 0.5).abs() < 2e-3);
        assert!((mean(200_000, |u| f64::from(t.sample(u).x)) - 0.5).abs() < 2e-3);
        assert!(mean(10_000, |u| f64::from(u8::from(t.sample(u).min_element() < -1e-4))) == 0.0);
    }

    #[test]
    fn small_triangles_are_sampled_evenly() {
        // Right-angled, legs of 1 at distance 50, 2e-4 sr; E[x] = 1/3, E[x²] = 1/6, E[xy] = 1/12.
        let t =
            SphericalTriangle::new([Vec3::new(0.0, 0.0, 50.0), Vec3::new(1.0, 0.0, 50.0), Vec3::new(0.0, 1.0, 50.0)]);
        let t = t.unwrap();
        let at = |u: Vec2| {
            let d = t.sample(u);
            [f64::from(d.x / d.z) * 50.0, f64::from(d.y / d.z) * 50.0]
        };
        let n = 200_000;
        for (expected, moment) in [
            (1.0 / 3.0, mean(n, |u| at(u)[0])),
            (1.0 / 3.0, mean(n, |u| at(u)[1])),
            (1.0 / 6.0, mean(n, |u| at(u)[0].powi(2))),
            (1.0 / 12.0, mean(n, |u| at(u)[0] * at(u)[1])),
        ] {
            assert!((moment - expected).abs() < 2e-3, "{moment}, should be {expected}");
        }
    }

    #[test]
    fn samples_of_a_triangle_integrate_to_its_form_factor() {
        // A point facing the corner of a right-angled triangle: Lambert's polygon formula against sampling.
        let corners = [Vec3::new(-0.3, -0.2, 1.0), Vec3::new(0.9, -0.2, 0.8), Vec3::new(0.1, 1.4, 1.3)];
        let t = SphericalTriangle::new(corners).unwrap();
        let sampled = mean(400_000, |u| f64::from(t.sample(u).z * t.solid_angle));
        let edge = |a: Vec3, b: Vec3| {
            let (a, b) = (a.normalize(), b.normalize());
            f64::from(libm::acosf(a.dot(b)) * a.cross(b).normalize().z)
        };
        let exact = 0.5 * (edge(corners[0], corners[1]) + edge(corners[1], corners[2]) + edge(corners[2], corners[0]));
        assert!((sampled - exact).abs() < 2e-3 * exact, "{sampled} against {exact}");
    }
}
