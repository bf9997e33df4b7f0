//! Light that arrived at a place, and the sum of several.

use crate::base::{LightVector, Rgb};
use core::f32::consts::PI;
use core::ops::{Add, Div};

/// What was found by one look, or a sum of looks.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Lit {
    /// Irradiance [lx].
    pub(super) all: Rgb,
    /// Part of it that the final gather finds, too.
    pub(super) gathered: Rgb,
    /// What emissive surfaces would bring if nothing were in between [lx].
    pub(super) unhidden: Rgb,
    /// Light vector of the rest, if it is asked for [lx].
    pub(super) vector: LightVector,
}

/// Share of the light from a direction that is left to rays by cosine, if there are so many of them for each sample whose
/// density per steradian is `density`: the balance heuristic (Veach and Guibas, SIGGRAPH 1995, eq. 9).
pub(super) fn gathered(cosine: f32, density: f32, rays: f32) -> f32 {
    let rays = rays * cosine.max(0.0) / PI;
    if rays <= 0.0 { 0.0 } else { rays / (rays + density) }
}

impl Lit {
    /// Irradiance that the gather does not find.
    pub(super) fn own(&self) -> Rgb {
        self.all - self.gathered
    }
}

impl Add for Lit {
    type Output = Self;
    fn add(self, o: Self) -> Self {
        Self {
            all: self.all + o.all,
            gathered: self.gathered + o.gathered,
            unhidden: self.unhidden + o.unhidden,
            vector: self.vector + o.vector,
        }
    }
}

impl Div<f32> for Lit {
    type Output = Self;
    fn div(self, k: f32) -> Self {
        Self {
            all: self.all / k,
            gathered: self.gathered / k,
            unhidden: self.unhidden / k,
            vector: self.vector * k.recip(),
        }
    }
}
