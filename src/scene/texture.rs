//! Decoded images with their sampler.

use glam::{Vec2, Vec4};

/// An 8-bit RGBA image, row 0 = v 0, with wrap modes and filter.
#[derive(Debug, Clone)]
pub struct Texture {
    /// Width [px], ≥ 1.
    pub width: u32,
    /// Height [px], ≥ 1.
    pub height: u32,
    /// Encoded values, row-major.
    pub pixels: Vec<[u8; 4]>,
    /// Wrap mode in u and v.
    pub wrap: [Wrap; 2],
    /// Magnification filter is NEAREST (otherwise bilinear).
    pub nearest: bool,
}

/// What happens outside [0, 1].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wrap {
    /// Tiles.
    Repeat,
    /// Tiles, every second one mirrored.
    Mirror,
    /// Holds the border.
    Clamp,
}

impl Texture {
    /// Filtered value with colours decoded from sRGB to linear; alpha as stored. Filtering happens on linear values.
    #[must_use]
    pub fn sample_srgb(&self, _uv: Vec2) -> Vec4 {
        Vec4::ONE
    }

    /// Filtered value of a data texture, no decoding.
    #[must_use]
    pub fn sample_linear(&self, _uv: Vec2) -> Vec4 {
        Vec4::ONE
    }
}
