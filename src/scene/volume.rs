//! `KHR_materials_volume`: what a solid takes from the light that goes through it.
//!
//! Of light that has gone d metres, `attenuationColor`^(d / `attenuationDistance`) is left (Beer's law): extinction σ = −ln
//! colour / distance. `trace` measures d between entry and exit of closed solids; through sheets it is
//! `thicknessFactor` × texture, in units of the node. A factor of 0 is a thin wall, which takes nothing. Only what
//! `KHR_materials_transmission` lets pass goes through the solid; it goes straight, whatever `KHR_materials_ior` says.

use super::TextureRef;
use super::schema::TextureInfo;
use crate::base::Rgb;
use serde::Deserialize;

/// The extension of a material.
#[derive(Debug, Clone, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub struct VolumeEntry {
    /// Thickness of what a sheet stands for [m of the mesh].
    pub(super) thickness_factor: f32,
    /// Its green channel multiplies the thickness (linear).
    pub(super) thickness_texture: Option<TextureInfo>,
    /// Distance after which white light has the colour [m]; none: nothing is taken.
    attenuation_distance: Option<f32>,
    attenuation_color: [f32; 3],
}

impl Default for VolumeEntry {
    fn default() -> Self {
        Self { thickness_factor: 0.0, thickness_texture: None, attenuation_distance: None, attenuation_color: [1.0; 3] }
    }
}

/// What a material takes from light inside it.
#[derive(Debug, Clone)]
pub struct Volume {
    /// σ, 0 or above, not all 0 [1/m].
    pub extinction: Rgb,
    /// Thickness of what a sheet stands for, > 0 [m of the mesh].
    pub thickness: f32,
    /// Green channel multiplies `thickness` (linear).
    pub thickness_texture: Option<TextureRef>,
}

impl VolumeEntry {
    /// The volume without its texture. `None` if it takes nothing; numbers that make no sense take nothing.
    pub(super) fn volume(&self) -> Option<Volume> {
        let distance = self.attenuation_distance.filter(|d| *d > 0.0 && d.is_finite())?;
        let color = Rgb::from_array(self.attenuation_color);
        let thick = self.thickness_factor > 0.0 && self.thickness_factor.is_finite();
        if !(thick && color.is_finite()) {
            return None;
        }
        let extinction = color.clamp(Rgb::splat(f32::MIN_POSITIVE), Rgb::ONE).map(|c| -libm::logf(c) / distance);
        let takes = extinction.is_finite() && extinction.max_element() > 0.0;
        takes.then_some(Volume { extinction, thickness: self.thickness_factor, thickness_texture: None })
    }
}

impl Volume {
    /// Share of light that is left after a distance [m].
    #[must_use]
    pub fn left_after(&self, distance: f32) -> Rgb {
        (self.extinction * distance).map(|depth| libm::expf(-depth))
    }
}
