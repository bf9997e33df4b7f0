//! Pages as PNG and Radiance HDR files, and back.
//!
//! In: a page and its coding. Out: bytes, the same on every run; the reader gives linear values. PNG files carry no
//! colour space chunk: nothing may be converted on loading. HDR texels are rounded here to what RGBE can hold, because
//! the encoder of the `image` crate cuts off, which darkens everything by half a step.

use super::Coding;
use super::Error;
use super::Format;
use super::half;
use super::pack;
use crate::finish::Page;
use crate::output::exr::ImageF32;
use image::ExtendedColorType;
use image::ImageEncoder;
use image::ImageFormat;
use image::codecs::hdr::HdrEncoder;
use image::codecs::png::CompressionType;
use image::codecs::png::FilterType;
use image::codecs::png::PngEncoder;
use std::io::Cursor;
use std::path::Path;

/// Largest side of a page, as `--page-size` allows it; a header that claims more is not believed.
const MOST_TEXELS: u32 = 16_384;

/// The bytes of a page's file.
pub(super) fn encode(path: &Path, page: &Page, coding: Coding) -> Result<Vec<u8>, Error> {
    let scale = coding.scale;
    let texels = page.pixels.iter().map(|p| [p[0], p[1], p[2]].map(|v| half(v).to_f64()));
    let size = [page.width, page.height];
    match coding.format {
        Format::Rgbm => png(path, size, &rgba(texels, |t| pack::to_rgbm(t, scale)), ExtendedColorType::Rgba8),
        Format::Rgbd => png(path, size, &rgba(texels, |t| pack::to_rgbd(t, scale)), ExtendedColorType::Rgba8),
        Format::Rgbe => png(path, size, &rgba(texels, pack::to_rgbe), ExtendedColorType::Rgba8),
        Format::Png => {
            // The encoder takes 16-bit samples in the machine's byte order and stores them as PNG wants them.
            let bytes: Vec<u8> = texels.flatten().flat_map(|v| pack::to_16(v, scale).to_ne_bytes()).collect();
            png(path, size, &bytes, ExtendedColorType::Rgb16)
        }
        Format::Hdr | Format::Exr | Format::Ktx2 => hdr(path, size, texels),
    }
}

fn rgba(texels: impl Iterator<Item = [f64; 3]>, code: impl Fn([f64; 3]) -> [u8; 4]) -> Vec<u8> {
    texels.flat_map(code).collect()
}

fn png(path: &Path, [width, height]: [u32; 2], bytes: &[u8], color: ExtendedColorType) -> Result<Vec<u8>, Error> {
    let mut out = Vec::new();
    PngEncoder::new_with_quality(&mut out, CompressionType::Default, FilterType::Adaptive)
        .write_image(bytes, width, height, color)
        .map_err(|e| cannot(path, "encoded", &e))?;
    Ok(out)
}

fn hdr(path: &Path, size: [u32; 2], texels: impl Iterator<Item = [f64; 3]>) -> Result<Vec<u8>, Error> {
    let pixels: Vec<image::Rgb<f32>> = texels.map(|t| image::Rgb(pack::radiance(t))).collect();
    let mut out = Vec::new();
    HdrEncoder::new(&mut out)
        .encode(&pixels, size[0] as usize, size[1] as usize)
        .map_err(|e| cannot(path, "encoded", &e))?;
    Ok(out)
}

/// A page's file as linear values.
pub(super) fn read(path: &Path, coding: Coding) -> Result<ImageF32, Error> {
    let bytes = std::fs::read(path).map_err(|e| Error::io(path, "read", e))?;
    let (format, scale) = (coding.format, coding.scale);
    let kind = if format == Format::Hdr { ImageFormat::Hdr } else { ImageFormat::Png };
    let mut reader = image::ImageReader::with_format(Cursor::new(bytes), kind);
    let mut limits = image::Limits::no_limits();
    (limits.max_image_width, limits.max_image_height) = (Some(MOST_TEXELS), Some(MOST_TEXELS));
    reader.limits(limits);
    let picture = reader.decode().map_err(|e| cannot(path, "read", &e))?;
    let (width, height) = (picture.width(), picture.height());
    let pixel = |rgb: [f64; 3]| {
        let [r, g, b] = rgb.map(|v| v as f32);
        [r, g, b, 1.0]
    };
    let coded = |decode: &dyn Fn([u8; 4]) -> [f64; 3]| -> Vec<[f32; 4]> {
        picture.to_rgba8().pixels().map(|p| pixel(decode(p.0))).collect()
    };
    let pixels = match format {
        Format::Rgbm => coded(&|code| pack::from_rgbm(code, scale)),
        Format::Rgbd => coded(&|code| pack::from_rgbd(code, scale)),
        Format::Rgbe => coded(&pack::from_rgbe),
        Format::Png => picture.to_rgb16().pixels().map(|p| pixel(p.0.map(|c| pack::from_16(c, scale)))).collect(),
        Format::Hdr | Format::Exr | Format::Ktx2 => {
            picture.to_rgb32f().pixels().map(|p| pixel(p.0.map(f64::from))).collect()
        }
    };
    Ok(ImageF32 { width, height, pixels, has_alpha: false })
}

fn cannot(path: &Path, what: &str, why: &image::ImageError) -> Error {
    Error::invalid(path, format!("the picture cannot be {what}: {why}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn radiance_files_hold_rounded_values_exactly() {
        let values: Vec<f32> = (1..0x7BFFu16).step_by(7).map(|bits| half::f16::from_bits(bits).to_f32()).collect();
        let pixels = values.iter().map(|&v| [v, 0.3 * v, 0.003 * v, 1.0]).collect();
        let page = Page { width: values.len() as u32, height: 1, pixels };
        let coding = Coding { format: Format::Hdr, scale: 1.0 };
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), encode(file.path(), &page, coding).unwrap()).unwrap();
        let image = read(file.path(), coding).unwrap();
        let (mut bias, mut worst) = (0.0f64, 0.0f32);
        for (read, written) in image.pixels.iter().zip(&page.pixels) {
            let rgb = [written[0], written[1], written[2]].map(|v| half(v).to_f64());
            assert_eq!(read[..3], pack::radiance(rgb));
            bias += f64::from((read[0] - written[0]) / written[0]) / values.len() as f64;
            worst = worst.max((read[0] - written[0]).abs() / written[0]);
        }
        assert!(bias.abs() < 2e-4 && worst <= 1.0 / 255.0, "{bias} {worst}");
    }

    #[test]
    fn damaged_files_are_errors() {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), b"\x89PNG\r\n\x1a\nxxxx").unwrap();
        for format in [Format::Rgbm, Format::Png, Format::Hdr] {
            let message = read(file.path(), Coding { format, scale: 1.0 }).unwrap_err().to_string();
            assert!(message.contains("cannot be read"), "{message}");
        }
    }
}
