//! The light vector of one texel's gather rays: how what they bring changes when the surface is tilted.
//!
//! In: rays, cosine-distributed around the normal, with the radiance that they read. Out: a `LightVector`.
//!
//! A ray with radiance L is worth `π L r(ω)` with r = c(ω)/μ (see `base::light_vector`), which grows without limit toward
//! the horizon: noise. But the mean of r is known, n/2. So what the rays' own mean of r is off by is taken off again, with
//! the light that the other half found, for the halves share no random number (a control variate; even light has no
//! noise at all, and grazing rays, of which one would outweigh all others, can be trusted less):
//!
//! `b = π/N (Σ L r − L̄ Σ (r − n/2))`, mean of the halves
//!
//! Symbols: N rays of a half, L̄ mean radiance of the other half, n shading normal, ω direction, μ = ω·n.

use crate::base::light_vector::{response, trusted};
use crate::base::{LightVector, Rgb};
use core::f32::consts::{FRAC_1_PI, PI};
use glam::Vec3;

/// Sums over rays.
#[derive(Debug, Default, Clone, Copy)]
pub(super) struct Bent {
    /// Radiance times r, of both halves together [cd/m²].
    light: LightVector,
    /// r − n/2 by half.
    even: [Vec3; 2],
}

impl Bent {
    /// A ray of a half read `light`.
    pub(super) fn add(&mut self, half: usize, normal: Vec3, direction: Vec3, light: Rgb) {
        let density = normal.dot(direction) * FRAC_1_PI;
        let response = response(normal, direction) * trusted(density);
        self.light += LightVector::outer(light, response);
        self.even[half] += response - normal * 0.5;
    }

    /// Mean of the halves [lx], which read so much radiance with so many rays each.
    pub(super) fn vector(&self, sums: [Rgb; 2], rays: u32) -> LightVector {
        let n = rays.max(1) as f32;
        let known = LightVector::outer(sums[1] / n, self.even[0]) + LightVector::outer(sums[0] / n, self.even[1]);
        (self.light - known) * (0.5 * PI / n)
    }
}
