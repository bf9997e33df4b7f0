//! Turns what the device drew into an EXR.
//!
//! In: rows of RGBA half floats, each padded as wgpu pads them, `strata` × `strata` samples a pixel. Out: the mean of each
//! pixel's samples, as 32-bit floats, A = the share of them that hit a surface.

use bevy::render::renderer::RenderDevice;
use exr::prelude::f16;
use std::path::Path;

/// Bytes of one RGBA sample.
const SAMPLE: usize = 8;

/// Averages and writes. `size` is that of the picture in pixels.
pub fn write(path: &Path, data: &[u8], size: [u32; 2], strata: u32) -> Result<(), String> {
    let [width, height, strata] = [size[0], size[1], strata].map(|n| n as usize);
    let row = RenderDevice::align_copy_bytes_per_row(width * strata * SAMPLE);
    if data.len() != row * height * strata {
        return Err(format!("the device handed over {} bytes, not {}", data.len(), row * height * strata));
    }
    let sample = |x: usize, y: usize| {
        let at = y * row + x * SAMPLE;
        [0, 2, 4, 6].map(|c| f16::from_le_bytes([data[at + c], data[at + c + 1]]).to_f64())
    };
    let pixel = |x: usize, y: usize| {
        let mut sum = [0.0; 4];
        for (j, i) in (0..strata).flat_map(|j| (0..strata).map(move |i| (j, i))) {
            let found = sample(x * strata + i, y * strata + j);
            sum = std::array::from_fn(|c| sum[c] + found[c]);
        }
        let [r, g, b, a] = sum.map(|s| (s / (strata * strata) as f64) as f32);
        (r, g, b, a)
    };
    exr::prelude::write_rgba_file(path, width, height, pixel).map_err(|e| format!("{}: {e}", path.display()))
}
