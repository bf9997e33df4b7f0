//! How irradiance changes as a surface is tilted, as far as a linear function of the normal tells: what directional
//! lightmaps hold.
//!
//! In: light by the direction that it comes from. Out: a [`LightVector`] b, so that `E(n') ≈ E(n) + b·(n' − n)`, with the
//! light that arrives above the surface itself.
//!
//! b is that of least squares over the normals at [`TILT`] around n, exact at n. By the symmetry of that circle the fit
//! is a fixed linear functional of light, so every ray adds its own part whatever else there is: light from ω with the
//! irradiance L on a facing plane adds L·c(ω). Where ω is above the horizon of all those normals c(ω) = ω, which is exact
//! for every n' that it lights (the light vector of Gershun, "The Light Field", 1936/39, hence the name). Lower down,
//! normals that are turned away get nothing instead of less than nothing:
//!
//!   along n:        (μ − mean)/(1 − cos TILT),  mean = (B sin φ + A φ)/π, the mean over the circle
//!   across, toward ω: (B φ + A sin φ)/(π sin TILT)
//!   A = μ cos TILT,  B = √(1 − μ²) sin TILT,  φ = arccos(−A/B): up to where on the circle normals face the light
//!
//! Even light is linear in the normal, E(n') = π L (1 + n·n')/2, so for it b = π L/2 n.
//!
//! Symbols: μ = ω·n. Errors for light at elevations of 30° and more: none up to tilts of 30°, nor beyond as long as
//! n' faces the light. At 15°, as a part of the light on a facing plane: at most 0.11 up to tilts of 30°, and at the horizon
//! 0.16. A circle at 40° has 0.13 at either, and still 0.06 at 30°, where this one is exact.

use super::Rgb;
use core::f32::consts::{FRAC_1_PI, PI};
use core::ops::{Add, AddAssign, Mul, Sub};
use glam::Vec3;

/// Angle to the normal of the normals that are fitted: about the largest in usual normal maps [rad].
pub const TILT: f32 = PI / 6.0;
const SIN: f32 = 0.5;
const COS: f32 = 0.866_025_4;

/// Cosine below which one of many rays that are cosine-distributed counts for less than c(ω)/μ: there, a single ray could
/// be worth any number of others, so where few rays come from they say next to nothing. In office (64 rays a texel)
/// single texels had 300 times the mean light. Up to here lies a hundredth of the flux of even light.
const GRAZING: f32 = 0.1;

/// Irradiance per component of the normal, along the axes of the world [lx].
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct LightVector {
    /// For normals that turn toward +x.
    pub x: Rgb,
    /// For +y.
    pub y: Rgb,
    /// For +z.
    pub z: Rgb,
}

impl LightVector {
    /// That of light from a unit direction with the irradiance `light` on a surface with this normal.
    #[must_use]
    pub fn of(light: Rgb, normal: Vec3, toward: Vec3) -> Self {
        Self::outer(light, response(normal, toward))
    }

    /// Light times vector.
    #[must_use]
    pub fn outer(light: Rgb, vector: Vec3) -> Self {
        Self { x: light * vector.x, y: light * vector.y, z: light * vector.z }
    }

    /// Irradiance that it adds for a vector.
    #[must_use]
    pub fn dot(&self, vector: Vec3) -> Rgb {
        self.x * vector.x + self.y * vector.y + self.z * vector.z
    }
}

impl Add for LightVector {
    type Output = Self;
    fn add(self, o: Self) -> Self {
        Self { x: self.x + o.x, y: self.y + o.y, z: self.z + o.z }
    }
}

impl AddAssign for LightVector {
    fn add_assign(&mut self, o: Self) {
        *self = *self + o;
    }
}

impl Sub for LightVector {
    type Output = Self;
    fn sub(self, o: Self) -> Self {
        Self { x: self.x - o.x, y: self.y - o.y, z: self.z - o.z }
    }
}

impl Mul<f32> for LightVector {
    type Output = Self;
    fn mul(self, k: f32) -> Self {
        Self { x: self.x * k, y: self.y * k, z: self.z * k }
    }
}

/// c(ω)/μ; zero from below.
#[must_use]
pub fn response(normal: Vec3, toward: Vec3) -> Vec3 {
    let cosine = normal.dot(toward);
    if cosine <= 0.0 {
        return Vec3::ZERO;
    }
    let aside = toward - normal * cosine;
    let sine = aside.length();
    let (level, swing) = (cosine * COS, sine * SIN);
    if level >= swing {
        return toward / cosine;
    }
    let edge = libm::acosf(-level / swing);
    let sin_edge = (1.0 - (level / swing) * (level / swing)).max(0.0).sqrt();
    let mean = (swing * sin_edge + level * edge) * FRAC_1_PI;
    let across = (swing * edge + level * sin_edge) * (FRAC_1_PI / SIN);
    (aside * (across / sine) + normal * ((cosine - mean) / (1.0 - COS))) / cosine
}

/// Part of c(ω)/μ that a ray with this density per steradian counts for: 1 unless it is hardly to be expected.
#[must_use]
pub fn trusted(density: f32) -> f32 {
    (density * (PI / GRAZING)).min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::Frame;

    const NORMAL: Vec3 = Vec3::new(0.36, 0.48, 0.8);

    fn turned(tilt: f32, around: f32) -> Vec3 {
        let (sin, cos) = libm::sincosf(tilt);
        let (y, x) = libm::sincosf(around);
        Frame::from_normal(NORMAL).to_world(Vec3::new(sin * x, sin * y, cos))
    }

    #[test]
    fn it_is_the_least_squares_fit_on_the_circle() {
        for elevation in [0.01f32, 0.1, 0.3, 0.5, 0.53, 0.8, 1.5] {
            let toward = turned(PI / 2.0 - elevation, 0.7);
            let cosine = toward.dot(NORMAL);
            let found = LightVector::of(Rgb::splat(cosine), NORMAL, toward);
            // Derivatives of the squared error by the components of b are 0.
            let (n, mut slope) = (720, Vec3::ZERO);
            for k in 0..n {
                let normal = turned(TILT, 2.0 * PI * k as f32 / n as f32);
                let error = cosine + found.dot(normal - NORMAL).x - normal.dot(toward).max(0.0);
                slope += (normal - NORMAL) * (error / n as f32);
            }
            assert!(slope.length() < 2e-5, "elevation {elevation}: {slope}");
        }
    }

    #[test]
    fn high_light_is_exact_and_low_light_nearly() {
        for (elevation, most) in [(0.55f32, 1e-5), (0.262, 0.107)] {
            let toward = turned(PI / 2.0 - elevation, 0.0);
            let cosine = toward.dot(NORMAL);
            let vector = LightVector::of(Rgb::splat(cosine), NORMAL, toward);
            let mut worst = 0.0f32;
            for k in 0..400 {
                let normal = turned(TILT * (k % 20) as f32 / 20.0, k as f32 * 0.37);
                let linear = (cosine + vector.dot(normal - NORMAL).x).max(0.0);
                worst = worst.max((linear - normal.dot(toward).max(0.0)).abs());
            }
            assert!(worst < most && (most < 0.01 || worst > 0.03), "elevation {elevation}: {worst}");
        }
    }

    #[test]
    fn even_light_is_linear() {
        let (n, mut sum) = (4000, Vec3::ZERO);
        for k in 0..n {
            // Even in μ, so the density of a cosine is 2 μ.
            let up = (k as f32 + 0.5) / n as f32;
            sum += response(NORMAL, turned(libm::acosf(up), k as f32 * 2.399_963)) * (2.0 * up / n as f32);
        }
        assert!((sum - NORMAL * 0.5).length() < 5e-3, "{sum}");
    }
}
