//! Material extensions that decide how much light a surface reflects and lets through.
//!
//! * `KHR_materials_pbrSpecularGlossiness`: ρ = diffuse · (1 − the largest channel of specular), whether or not there is a
//!   fallback (section "Specular - Glossiness" of its text). What is reflected as a mirror would is lost, as for metals.
//! * `KHR_materials_transmission`: of the light that a diffuse surface of the same colour would scatter, the factor passes
//!   straight on, tinted by the base colour: T = f · (1 − metallic) · colour; ρ = (1 − f) · (1 − metallic) · colour. No
//!   share is taken off for the reflection at the surface (about 4 % at right angles), as none is from other materials.
//! * `KHR_materials_diffuse_transmission`: of the light that is scattered, the factor leaves on the other side, in a
//!   colour of its own: τ = d · (1 − f) · (1 − metallic) · colour there, and ρ is (1 − d) of what it was. Light falls
//!   on both sides of such a surface, also if it is single-sided.
//!
//! Limits: light that goes through a solid of glass meets two surfaces, so the base colour tints it twice (`volume` has
//! what it loses between them); roughness and refraction are left out.

use super::schema::Pbr;
use super::schema::TextureInfo;
use serde::Deserialize;

/// `KHR_materials_pbrSpecularGlossiness`.
#[derive(Debug, Clone, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub struct SpecularGlossiness {
    diffuse_factor: [f32; 4],
    diffuse_texture: Option<TextureInfo>,
    /// What its mirror-like lobe reflects.
    pub(super) specular_factor: [f32; 3],
    /// Its colour multiplies `specular_factor` (sRGB encoded).
    pub(super) specular_glossiness_texture: Option<TextureInfo>,
}

impl Default for SpecularGlossiness {
    fn default() -> Self {
        Self {
            diffuse_factor: [1.0; 4],
            diffuse_texture: None,
            specular_factor: [1.0; 3],
            specular_glossiness_texture: None,
        }
    }
}

impl SpecularGlossiness {
    /// The metal that leaves as much to the diffuse lobe. With a texture of specular colours there is none.
    pub(super) fn as_metal(&self) -> Pbr {
        let largest = self.specular_factor.into_iter().fold(0.0, f32::max);
        Pbr {
            base_color_factor: self.diffuse_factor,
            base_color_texture: self.diffuse_texture.clone(),
            metallic_factor: Some(if self.specular_glossiness_texture.is_some() { 0.0 } else { largest }),
            ..Pbr::default()
        }
    }
}

/// `KHR_materials_diffuse_transmission`.
#[derive(Debug, Clone, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub struct DiffuseTransmission {
    /// Share of the scattered light that leaves on the other side.
    pub(super) diffuse_transmission_factor: f32,
    /// Its alpha multiplies the factor.
    pub(super) diffuse_transmission_texture: Option<TextureInfo>,
    /// Colour of that light.
    pub(super) diffuse_transmission_color_factor: [f32; 3],
    /// Multiplies the colour (sRGB encoded).
    pub(super) diffuse_transmission_color_texture: Option<TextureInfo>,
}

impl Default for DiffuseTransmission {
    fn default() -> Self {
        Self {
            diffuse_transmission_factor: 0.0,
            diffuse_transmission_texture: None,
            diffuse_transmission_color_factor: [1.0; 3],
            diffuse_transmission_color_texture: None,
        }
    }
}

/// `KHR_materials_emissive_strength`.
#[derive(Debug, Clone, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub struct EmissiveStrength {
    /// Factor of the emission.
    pub emissive_strength: f32,
}

impl Default for EmissiveStrength {
    fn default() -> Self {
        Self { emissive_strength: 1.0 }
    }
}

/// `KHR_materials_transmission`.
#[derive(Debug, Default, Clone, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub struct Transmission {
    /// Share of the light that passes.
    pub(super) transmission_factor: f32,
    /// Its red channel multiplies the factor (linear).
    pub(super) transmission_texture: Option<TextureInfo>,
}
