//! Materials as diffuse light sees them: reflectance, emission, alpha, sides.

use crate::base::Rgb;
use glam::{Affine2, Vec4};

/// A glTF material, reduced to what a diffuse bake uses. Factors are linear.
#[derive(Debug, Clone)]
pub struct Material {
    /// Name in the document, or `material 3`.
    pub name: String,
    /// Base colour factor, alpha in w.
    pub base_color: Vec4,
    /// Multiplies `base_color` (sRGB encoded).
    pub base_color_texture: Option<TextureRef>,
    /// Metallic factor.
    pub metallic: f32,
    /// Blue channel multiplies `metallic` (linear).
    pub metallic_texture: Option<TextureRef>,
    /// Emissive factor times strength [cd/m²].
    pub emission: Rgb,
    /// Multiplies `emission` (sRGB encoded).
    pub emission_texture: Option<TextureRef>,
    /// What alpha does.
    pub alpha: Alpha,
    /// Both sides are lit; otherwise the back absorbs.
    pub double_sided: bool,
    /// `KHR_materials_unlit`: blocks light, reflects and emits none.
    pub unlit: bool,
}

/// Alpha mode.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Alpha {
    /// Alpha is ignored.
    Opaque,
    /// Points with alpha below the cut-off do not exist.
    Mask(f32),
    /// Passes light with probability 1 − alpha.
    Blend,
}

/// A use of a texture.
#[derive(Debug, Clone, Copy)]
pub struct TextureRef {
    /// Index into `Scene::textures`.
    pub texture: usize,
    /// Index into `Vertices::uv`; always valid.
    pub uv_set: usize,
    /// `KHR_texture_transform`: texture uv = transform × mesh uv.
    pub transform: Affine2,
}
