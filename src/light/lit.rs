//! Light that arrived at a place, and the sum of several.

use crate::base::{LightVector, Rgb};
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
