//! JPEG: photographs for people, where a PNG would be four times as large.

use super::Error;
use super::png::srgb_bytes;
use image::ImageEncoder;
use image::codecs::jpeg::JpegEncoder;
use std::path::Path;

/// At 85, banding is not to be seen on smooth walls; at 75 it is.
const QUALITY: u8 = 85;

/// A picture: linear values in [0, 1], sRGB encoded. `path` is where it will go, for messages.
///
/// # Errors
/// If it cannot be encoded, or `pixels` does not fit `size`.
pub fn picture(path: &Path, [width, height]: [u32; 2], pixels: &[[f32; 3]]) -> Result<Vec<u8>, Error> {
    if pixels.len() as u64 != u64::from(width) * u64::from(height) || pixels.is_empty() {
        return Err(Error::invalid(path, format!("{} pixels do not fill {width} × {height}", pixels.len())));
    }
    let mut out = Vec::new();
    JpegEncoder::new_with_quality(&mut out, QUALITY)
        .write_image(&srgb_bytes(pixels), width, height, image::ExtendedColorType::Rgb8)
        .map_err(|e| Error::invalid(path, format!("the picture cannot be encoded: {e}")))?;
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_comes_back_nearly_as_it_was() {
        let bytes = picture(Path::new("x"), [16, 8], &[[0.215_861, 0.0, 1.0]; 128]).unwrap();
        let image = image::load_from_memory(&bytes).unwrap().into_rgb8();
        assert_eq!(image.dimensions(), (16, 8));
        let close = image.pixels().all(|p| p.0.iter().zip([128, 0, 255]).all(|(a, b)| a.abs_diff(b) < 6));
        assert!(close, "{:?}", image.get_pixel(0, 0));
        assert!(picture(Path::new("x"), [2, 2], &[[0.0; 3]]).is_err() && picture(Path::new("x"), [0, 0], &[]).is_err());
    }
}
