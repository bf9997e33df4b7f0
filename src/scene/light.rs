//! Punctual lights (`KHR_lights_punctual`, `EXT_lights_ies`) in world space, and the sky.

use super::{Profile, Scene};
use crate::base::Rgb;
use glam::{Mat3, Vec3};
use std::sync::Arc;

/// A light without a surface.
#[derive(Debug, Clone)]
pub enum Light {
    /// Parallel light.
    Sun {
        /// Unit direction in which the light travels.
        direction: Vec3,
        /// Illuminance on a plane that faces it [lx].
        illuminance: Rgb,
        /// Angular diameter [rad]; 0 = exactly parallel.
        angle: f32,
    },
    /// Point light, equal in all directions.
    Point {
        /// World position [m].
        position: Vec3,
        /// Luminous intensity [cd].
        intensity: Rgb,
        /// Distance at which the spec's window reaches zero [m]; infinite where there is none.
        range: f32,
        /// Radius of the glowing sphere [m]; 0 = a point.
        radius: f32,
    },
    /// Spot light with the spec's cone.
    Spot {
        /// World position [m].
        position: Vec3,
        /// Unit direction of the axis of the cone, away from the light.
        direction: Vec3,
        /// Luminous intensity inside the inner cone [cd].
        intensity: Rgb,
        /// As for a point light [m].
        range: f32,
        /// Radius of the glowing sphere [m]; 0 = a point.
        radius: f32,
        /// Cosine of the inner cone angle.
        cos_inner: f32,
        /// Cosine of the outer cone angle.
        cos_outer: f32,
    },
    /// A lamp with a measured distribution.
    Profiled {
        /// World position [m].
        position: Vec3,
        /// From the frame of the profile to the world: orthogonal, mirrored where the node mirrors.
        axes: Mat3,
        /// Factor of the profile's candela.
        factor: Rgb,
        /// As for a point light [m].
        range: f32,
        /// Radius of the glowing sphere [m]; 0 = a point.
        radius: f32,
        /// Candela by direction.
        profile: Arc<Profile>,
    },
}

/// Light from infinity: a vertical gradient, world +y is up.
///
/// Radiance depends on the sine h of the elevation: from `horizon` to `zenith` linearly in h for h ≥ 0; `ground` for
/// h < 0. A constant sky has three equal colours; the default is black.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Sky {
    /// Radiance straight up [cd/m²].
    pub zenith: Rgb,
    /// Radiance at the horizon [cd/m²].
    pub horizon: Rgb,
    /// Radiance of every direction below the horizon [cd/m²].
    pub ground: Rgb,
}

impl Sky {
    /// The same radiance [cd/m²] from every direction.
    #[must_use]
    pub fn constant(radiance: Rgb) -> Self {
        Self { zenith: radiance, horizon: radiance, ground: radiance }
    }

    /// Radiance [cd/m²] that arrives from a unit direction.
    #[must_use]
    pub fn radiance(&self, toward: Vec3) -> Rgb {
        if toward.y < 0.0 { self.ground } else { self.horizon + (self.zenith - self.horizon) * toward.y }
    }

    /// No direction sends light.
    #[must_use]
    pub fn is_black(&self) -> bool {
        self.zenith.max_element() <= 0.0 && self.horizon.max_element() <= 0.0 && self.ground.max_element() <= 0.0
    }
}

impl Scene {
    /// Radiance [cd/m²] that arrives from infinity from a unit direction: sky and environment together.
    #[must_use]
    pub fn light_from_infinity(&self, toward: Vec3) -> Rgb {
        self.sky.radiance(toward) + self.environment.as_ref().map_or(Rgb::ZERO, |map| map.radiance(toward))
    }
}
