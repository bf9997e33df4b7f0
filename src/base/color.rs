//! Colour: linear Rec.709 triples, luminance, and the sRGB transfer function.

use glam::Vec3;

/// Linear Rec.709 colour or any three-channel quantity (flux, irradiance, reflectance); the unit is the owner's.
pub type Rgb = Vec3;

/// Luminance of a linear Rec.709 colour, in the unit of the colour (ITU-R BT.709-6, item 3.2).
#[must_use]
pub fn luminance(color: Rgb) -> f32 {
    color.x * 0.2126 + color.y * 0.7152 + color.z * 0.0722
}

/// Mean of the channels, in the unit of the colour.
#[must_use]
pub fn mean(color: Rgb) -> f32 {
    color.element_sum() / 3.0
}

/// Decodes one sRGB value in [0, 1] to linear (IEC 61966-2-1).
#[must_use]
pub fn srgb_to_linear(encoded: f32) -> f32 {
    if encoded <= 0.04045 { encoded / 12.92 } else { libm::powf((encoded + 0.055) / 1.055, 2.4) }
}

/// Encodes one linear value in [0, 1] as sRGB (IEC 61966-2-1).
#[must_use]
pub fn linear_to_srgb(linear: f32) -> f32 {
    if linear <= 0.003_130_8 { linear * 12.92 } else { 1.055 * libm::powf(linear, 1.0 / 2.4) - 0.055 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn srgb_round_trip() {
        for i in 0..=255 {
            let v = i as f32 / 255.0;
            assert!((linear_to_srgb(srgb_to_linear(v)) - v).abs() < 1e-5);
        }
        assert!((srgb_to_linear(0.5) - 0.214_041).abs() < 1e-5);
    }

    #[test]
    fn white_has_unit_luminance() {
        assert!((luminance(Rgb::ONE) - 1.0).abs() < 1e-6);
    }
}
