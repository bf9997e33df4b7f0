//! Environment maps: light from infinity by an equirectangular picture, Radiance HDR or OpenEXR.
//!
//! In: file, factor, rotation. Out: radiance by direction [cd/m²]; a pixel is constant, so its light is its value times
//! its solid angle, exactly.
//!
//! Convention, that of three.js and of Blender's world seen through a glTF export (world +y is up): the top row looks
//! up, the middle column toward +x, the column at a quarter of the width toward −z, at three quarters toward +z, and
//! the left and right borders toward −x. A positive rotation turns the map counter-clockwise as seen from above: by 90°
//! what was at +x comes to −z.
//!
//! Negative values, which filters leave in EXR files, count as 0, with a warning (`negative-environment`). Not-a-number
//! and infinity are errors. An EXR whose only colour is `Y` is grey. The display window of an EXR is the sphere: where its
//! layer has no pixels it is black, and what of a layer lies beyond is left out.
//!
//! Bounds, checked before anything is decoded: [`MAX_PIXELS`], [`PIXELS_PER_BYTE`].

use super::Error;
use crate::base::exr_tiles::has_sound_tiles;
use crate::base::{Rgb, Warned, Warning, parallel};
use core::f32::consts::{PI, TAU};
use glam::{Vec2, Vec3};
use image::codecs::hdr::HdrDecoder;
use image::{DynamicImage, ImageDecoder};
use std::io::Cursor;
use std::path::Path;

/// Most pixels: 16,384 × 8,192, 1.5 GiB decoded.
const MAX_PIXELS: u64 = 1 << 27;
/// Most pixels that a byte of file can stand for: zlib packs 1032 : 1, and a pixel takes 4 bytes or more before that.
const PIXELS_PER_BYTE: u64 = 258;
/// Most channels that a message names.
const SHOWN_CHANNELS: usize = 8;

/// Light from infinity by picture.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Environment {
    width: u32,
    height: u32,
    /// Radiance [cd/m²], row-major, top row first.
    pixels: Vec<Rgb>,
    /// Counter-clockwise rotation from above, in turns.
    turns: f32,
}

impl Environment {
    /// A map of these radiances [cd/m²], top row first, turned by `rotation` [rad]. `None` if the sizes do not match,
    /// there are no pixels, or a value is not finite.
    #[must_use]
    pub fn new(width: u32, height: u32, pixels: Vec<Rgb>, rotation: f32) -> Option<Self> {
        let count = width as usize * height as usize;
        let usable = count > 0 && count == pixels.len() && pixels.iter().all(|p| p.is_finite());
        let pixels = pixels.into_iter().map(|p| p.max(Rgb::ZERO)).collect();
        usable.then_some(Self { width, height, pixels, turns: rotation / TAU })
    }

    /// Reads a file; radiances are its values times `factor` [cd/m²]. Warns of negative ones.
    ///
    /// # Errors
    /// The file cannot be read, is neither HDR nor EXR, is broken, or is too large.
    pub fn load(path: &Path, factor: f32, rotation: f32) -> Result<Warned<Self>, Error> {
        let bytes = std::fs::read(path).map_err(|e| Error::io(path, e))?;
        let read = if bytes.starts_with(&[0x76, 0x2f, 0x31, 0x01]) { read_exr(&bytes) } else { read_hdr(&bytes) };
        let map = read.and_then(|(width, height, pixels)| {
            let scaled = parallel::map(pixels.len(), |i| pixels[i] * factor);
            let warnings = negative(&pixels).into_iter().collect();
            Self::new(width, height, scaled, rotation)
                .map(|output| Warned { output, warnings })
                .ok_or_else(|| Error::invalid("environment map: it has no pixels, or values that are not finite"))
        });
        map.map_err(|e| e.in_file(path))
    }

    /// Width and height [px].
    #[must_use]
    pub fn size(&self) -> [usize; 2] {
        [self.width as usize, self.height as usize]
    }

    /// Radiance of a pixel [cd/m²].
    #[must_use]
    pub fn pixel(&self, x: usize, y: usize) -> Rgb {
        self.pixels[y * self.width as usize + x]
    }

    /// Solid angle of every pixel of a row [sr].
    #[must_use]
    pub fn solid_angle(&self, y: usize) -> f32 {
        let edge = |y: usize| libm::cos(core::f64::consts::PI * y as f64 / f64::from(self.height));
        (core::f64::consts::TAU / f64::from(self.width) * (edge(y) - edge(y + 1))) as f32
    }

    /// The pixel that a unit direction looks at.
    #[must_use]
    pub fn pixel_at(&self, toward: Vec3) -> [usize; 2] {
        let u = libm::atan2f(toward.z, toward.x) / TAU + 0.5 + self.turns;
        let v = libm::acosf(toward.y.clamp(-1.0, 1.0)) / PI;
        let cell = |t: f32, n: u32| ((t * n as f32) as usize).min(n as usize - 1);
        [cell(u - u.floor(), self.width), cell(v, self.height)]
    }

    /// Unit direction to a place in [0, 1)² of a pixel, uniform by solid angle.
    #[must_use]
    pub fn toward(&self, [x, y]: [usize; 2], place: Vec2) -> Vec3 {
        let phi = ((x as f32 + place.x) / self.width as f32 - 0.5 - self.turns) * TAU;
        let edge = |y: usize| libm::cosf(PI * y as f32 / self.height as f32);
        let up = edge(y) + (edge(y + 1) - edge(y)) * place.y;
        let (sin, cos) = libm::sincosf(phi);
        let flat = (1.0 - up * up).max(0.0).sqrt();
        Vec3::new(flat * cos, up, flat * sin)
    }

    /// Radiance [cd/m²] that arrives from a unit direction.
    #[must_use]
    pub fn radiance(&self, toward: Vec3) -> Rgb {
        let [x, y] = self.pixel_at(toward);
        self.pixel(x, y)
    }

    /// Integral of the radiance over all directions [lx], and over the sphere's 4π the mean.
    #[must_use]
    pub fn total(&self) -> Rgb {
        let row = |y: usize| {
            let sum = (0..self.width as usize).fold(glam::DVec3::ZERO, |sum, x| sum + self.pixel(x, y).as_dvec3());
            sum * f64::from(self.solid_angle(y))
        };
        parallel::map(self.height as usize, row).into_iter().fold(glam::DVec3::ZERO, |a, b| a + b).as_vec3()
    }
}

type Picture = (u32, u32, Vec<Rgb>);

fn negative(pixels: &[Rgb]) -> Option<Warning> {
    let is_negative = |p: &&Rgb| p.min_element() < 0.0;
    let least = pixels.iter().map(|p| p.min_element()).fold(0.0, f32::min);
    let count = pixels.iter().filter(is_negative).count();
    let what = || {
        format!(
            "environment map: {count} of {} pixels have negative values, down to {least}; these count as 0",
            pixels.len()
        )
    };
    (count > 0).then(|| Warning::new("negative-environment", what()))
}

fn check_size(width: u64, height: u64, bytes: usize) -> Result<(), Error> {
    if width.saturating_mul(height) > MAX_PIXELS {
        let what =
            format!("environment map: it has {width} × {height} pixels; 16384 × 8192 are the limit, scale it down");
        return Err(Error::unsupported(what));
    }
    if width * height > PIXELS_PER_BYTE * bytes as u64 {
        let what = format!("environment map: it claims {width} × {height} pixels but has only {bytes} bytes");
        return Err(Error::invalid(what));
    }
    Ok(())
}

fn read_hdr(bytes: &[u8]) -> Result<Picture, Error> {
    if !bytes.starts_with(b"#?") {
        return Err(Error::invalid("environment map: it is neither Radiance HDR nor OpenEXR"));
    }
    let broken = |e| Error::invalid(format!("environment map: it cannot be read as Radiance HDR: {e}"));
    let decoder = HdrDecoder::new(Cursor::new(bytes)).map_err(broken)?;
    let (width, height) = decoder.dimensions();
    check_size(u64::from(width), u64::from(height), bytes.len())?;
    let image = DynamicImage::from_decoder(decoder).map_err(broken)?.into_rgb32f();
    Ok((width, height, image.into_raw().as_chunks().0.iter().map(|&p| Rgb::from_array(p)).collect()))
}

/// The width of a picture, and its pixels.
type Rows = (usize, Vec<Rgb>);

fn blank(size: exr::math::Vec2<usize>) -> Rows {
    (size.width(), vec![Rgb::ZERO; size.area()])
}

fn put((width, pixels): &mut Rows, at: exr::math::Vec2<usize>, value: Rgb) {
    if let Some(pixel) = pixels.get_mut(at.y() * *width + at.x()) {
        *pixel = value;
    }
}

/// A layer in its place of the window that is shown.
fn placed((width, pixels): Rows, from: exr::math::Vec2<i32>, window: exr::meta::attribute::IntegerBounds) -> Picture {
    let (size, to) = (window.size, window.position);
    let offset = [from.x() as isize - to.x() as isize, from.y() as isize - to.y() as isize];
    let picture = |pixels| (size.width() as u32, size.height() as u32, pixels);
    if offset == [0, 0] && width == size.width() && pixels.len() == size.area() {
        return picture(pixels);
    }
    let at = |i: usize, offset: isize, end: usize| i.checked_add_signed(offset).filter(|&i| i < end);
    let mut shown = blank(size).1;
    for (y, row) in pixels.chunks(width.max(1)).enumerate() {
        let Some(y) = at(y, offset[1], size.height()) else { continue };
        for (x, pixel) in row.iter().enumerate() {
            if let Some(x) = at(x, offset[0], size.width()) {
                shown[y * size.width() + x] = *pixel;
            }
        }
    }
    picture(shown)
}

/// Checks sizes and tiles; says whether the only colour is `Y`.
fn check_headers(meta: &exr::meta::MetaData, bytes: usize) -> Result<bool, Error> {
    for header in &meta.headers {
        for size in [header.layer_size, header.shared_attributes.display_window.size] {
            check_size(size.width() as u64, size.height() as u64, bytes)?;
        }
        if !has_sound_tiles(header) {
            let what = "environment map: its tiles are larger than the picture, and beyond a million texels";
            return Err(Error::invalid(what));
        }
    }
    let names = |header: &exr::meta::header::Header| -> Vec<String> {
        header.channels.list.iter().map(|channel| channel.name.to_string()).collect()
    };
    let layers: Vec<Vec<String>> = meta.headers.iter().map(names).collect();
    let has = |layer: &[String], name: &str| layer.iter().any(|own| own == name);
    let any = |name: &str| layers.iter().any(|layer| has(layer, name));
    let is_grey = any("Y") && !["R", "G", "B", "RY", "BY"].into_iter().any(any);
    if !is_grey && !layers.iter().any(|layer| ["R", "G", "B"].into_iter().all(|name| has(layer, name))) {
        let all = layers.concat();
        let more = if all.len() > SHOWN_CHANNELS { ", …" } else { "" };
        let shown = all[..all.len().min(SHOWN_CHANNELS)].join(", ");
        let what = format!(
            "environment map: it needs channels named R, G and B, or Y alone, and has {shown}{more}; of a picture of \
             several layers, save the one that is the map by itself"
        );
        return Err(Error::unsupported(what));
    }
    Ok(is_grey)
}

fn read_exr(bytes: &[u8]) -> Result<Picture, Error> {
    use exr::prelude::{ReadChannels, ReadLayers, ReadSpecificChannel};
    let broken =
        |e: exr::error::Error| Error::invalid(format!("environment map: it cannot be read as an EXR picture: {e}"));
    let meta = exr::meta::MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(broken)?;
    let read = exr::prelude::read().no_deep_data().largest_resolution_level();
    let (pixels, from, window) = if check_headers(&meta, bytes.len())? {
        let create = |size, _: &_| blank(size);
        let set = |map: &mut _, at, (y,): (f32,)| put(map, at, Rgb::splat(y));
        let read = read.specific_channels().required("Y").collect_pixels(create, set);
        let image = read.first_valid_layer().all_attributes().from_buffered(Cursor::new(bytes)).map_err(broken)?;
        let layer = image.layer_data;
        (layer.channel_data.pixels, layer.attributes.layer_position, image.attributes.display_window)
    } else {
        let set = |map: &mut _, at, (r, g, b): (f32, f32, f32)| put(map, at, Rgb::new(r, g, b));
        let read = read.rgb_channels(|size, _| blank(size), set);
        let image = read.first_valid_layer().all_attributes().from_buffered(Cursor::new(bytes)).map_err(broken)?;
        let layer = image.layer_data;
        (layer.channel_data.pixels, layer.attributes.layer_position, image.attributes.display_window)
    };
    Ok(placed(pixels, from, window))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 8 × 4 pixels, each with its own value.
    fn numbered(rotation: f32) -> Environment {
        let pixels = (0..32).map(|i| Rgb::splat(i as f32)).collect();
        Environment::new(8, 4, pixels, rotation).unwrap()
    }

    #[test]
    fn columns_look_where_the_header_says() {
        let map = numbered(0.0);
        let near = |v: Vec3| (v + Vec3::new(1e-3, 0.0, 1e-3)).normalize();
        for (toward, column) in [(Vec3::X, 4), (Vec3::Z, 5), (-Vec3::Z, 2), (-Vec3::X, 7)] {
            assert_eq!(map.pixel_at(near(toward))[0], column, "{toward}");
        }
        assert_eq!(map.pixel_at(Vec3::Y)[1], 0);
        assert_eq!(map.pixel_at(-Vec3::Y)[1], 3);
        // A quarter turn counter-clockwise from above takes +x to −z.
        let turned = numbered(PI / 2.0);
        assert_eq!(turned.radiance(near(-Vec3::Z)), map.radiance((Vec3::X + Vec3::new(-1e-3, 0.0, 1e-3)).normalize()));
    }

    #[test]
    fn directions_and_pixels_are_inverse_and_solid_angles_fill_the_sphere() {
        for rotation in [0.0, 1.1, -40.0] {
            let map = numbered(rotation);
            for i in 0..32 {
                let pixel = [i % 8, i / 8];
                for place in [Vec2::splat(0.02), Vec2::new(0.5, 0.97), Vec2::new(0.97, 0.4)] {
                    let toward = map.toward(pixel, place);
                    assert!((toward.length() - 1.0).abs() < 1e-5);
                    assert_eq!(map.pixel_at(toward), pixel);
                }
            }
            let sum: f32 = (0..4).map(|y| 8.0 * map.solid_angle(y)).fold(0.0, |a, b| a + b);
            assert!((sum - 4.0 * PI).abs() < 1e-4);
        }
    }

    #[test]
    fn unusable_maps_are_refused() {
        assert!(Environment::new(2, 1, vec![Rgb::ONE], 0.0).is_none());
        assert!(Environment::new(0, 0, vec![], 0.0).is_none());
        assert!(Environment::new(1, 1, vec![Rgb::NAN], 0.0).is_none());
        assert_eq!(Environment::new(1, 1, vec![Rgb::NEG_ONE], 0.0).unwrap().pixel(0, 0), Rgb::ZERO);
    }
}
