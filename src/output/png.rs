//! PNG: the preview of a lightmap page (linear) and pictures for people (sRGB).

use super::Error;
use crate::base::color::linear_to_srgb;
use crate::base::parallel;
use crate::finish::Page;
use image::ImageEncoder;
use image::codecs::png::CompressionType;
use image::codecs::png::FilterType;
use image::codecs::png::PngEncoder;
use std::path::Path;

/// The preview of a page: 8-bit RGB, linear values clamped to [0, 1] without a transfer function, because readers of
/// `MOZ_lightmap` apply none. `path` is where it will go, for messages.
///
/// # Errors
/// If it cannot be encoded.
pub fn preview(path: &Path, page: &Page) -> Result<Vec<u8>, Error> {
    let bytes: Vec<u8> = page.pixels.iter().flat_map(|p| [p[0], p[1], p[2]].map(to_byte)).collect();
    encode(path, [page.width, page.height], &bytes)
}

/// A picture: 8-bit RGB from linear values in [0, 1], sRGB encoded. `path` is where it will go, for messages.
///
/// # Errors
/// If it cannot be encoded, or `pixels` does not fit `size`.
pub fn picture(path: &Path, size: [u32; 2], pixels: &[[f32; 3]]) -> Result<Vec<u8>, Error> {
    encode(path, size, &srgb_bytes(pixels))
}

/// Linear values, clamped to [0, 1], as sRGB.
pub(super) fn srgb_bytes(pixels: &[[f32; 3]]) -> Vec<u8> {
    let byte = |v: f32| to_byte(linear_to_srgb(if v > 0.0 { v.min(1.0) } else { 0.0 }));
    parallel::map_light(pixels.len(), |i| pixels[i].map(byte)).into_flattened()
}

/// Nearest of 256 steps; not-a-number becomes 0.
fn to_byte(value: f32) -> u8 {
    (value * 255.0 + 0.5).clamp(0.0, 255.0) as u8
}

fn encode(path: &Path, [width, height]: [u32; 2], rgb: &[u8]) -> Result<Vec<u8>, Error> {
    if rgb.len() as u64 != u64::from(width) * u64::from(height) * 3 || rgb.is_empty() {
        return Err(Error::invalid(path, format!("{} bytes do not fill {width} × {height} pixels", rgb.len())));
    }
    let mut out = Vec::new();
    PngEncoder::new_with_quality(&mut out, CompressionType::Default, FilterType::Adaptive)
        .write_image(rgb, width, height, image::ExtendedColorType::Rgb8)
        .map_err(|e| Error::invalid(path, format!("the picture cannot be encoded: {e}")))?;
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn preview_is_linear_and_clamped() {
        let pixels = vec![[0.5, 2.0, -1.0, 1.0], [f32::NAN, 1.0 / 255.0, 0.0, 0.0]];
        let bytes = preview(Path::new("x.png"), &Page { width: 2, height: 1, pixels }).unwrap();
        let image = image::load_from_memory(&bytes).unwrap().into_rgb8();
        assert_eq!(image.into_raw(), [128, 255, 0, 0, 1, 0]);
    }

    #[test]
    fn pictures_are_srgb() {
        let bytes = picture(Path::new("x.png"), [1, 2], &[[0.215_861, 0.0, 1.0], [9.0, -1.0, f32::NAN]]).unwrap();
        let image = image::load_from_memory(&bytes).unwrap().into_rgb8();
        assert_eq!(image.into_raw(), [128, 0, 255, 255, 0, 0]);
        assert!(picture(Path::new("x.png"), [2, 2], &[[0.0; 3]]).is_err());
        assert!(picture(Path::new("x.png"), [0, 0], &[]).is_err());
    }
}
