//! A level of a texture as BC6H blocks (unsigned half floats, 16 texels in 16 bytes).
//!
//! In: a page of any size. Out: blocks in rows from the top. A side that is no multiple of 4 is padded by its last
//! texels. Rows of blocks are encoded in parallel; a block depends on nothing but its texels, so the bytes are always
//! the same.
//!
//! The encoder is the crate `block_compression`, a port of Intel's ISPC kernels to plain Rust: on the pages of the office
//! its error is that of the kernels themselves (`intel_tex_2`) to four digits. It takes 6.5 s for a million texels on one
//! thread, six times as long, but has no binary blobs and no code paths that depend on the CPU.

use super::half;
use crate::base::parallel;
use crate::finish::Page;
use block_compression::BC6HSettings;
use block_compression::CompressionVariant;
use block_compression::encode::compress_rgba16;
use half::f16;

/// Texels along a side of a block.
const SIDE: u32 = 4;
/// Bytes of a block.
pub(super) const BYTES: usize = 16;

pub(super) fn bc6h(page: &Page) -> Vec<u8> {
    let [columns, rows] = [page.width, page.height].map(|n| n.div_ceil(SIDE));
    let rows = parallel::map(rows as usize, |row| encode_row(page, columns, row as u32));
    rows.concat()
}

fn encode_row(page: &Page, columns: u32, row: u32) -> Vec<u8> {
    let width = columns * SIDE;
    let mut texels: Vec<f16> = Vec::with_capacity((width * SIDE * 4) as usize);
    for y in row * SIDE..(row + 1) * SIDE {
        for x in 0..width {
            let (x, y) = (x.min(page.width - 1), y.min(page.height - 1));
            let [r, g, b, _] = page.pixels[(y * page.width + x) as usize].map(half);
            texels.extend([r, g, b, f16::ONE]);
        }
    }
    let mut blocks = vec![0; columns as usize * BYTES];
    let how = CompressionVariant::BC6H(BC6HSettings::basic());
    compress_rgba16(how, &texels, &mut blocks, width, SIDE, width * 4);
    blocks
}

#[cfg(test)]
mod tests {
    use super::*;

    fn page(width: u32, height: u32) -> Page {
        let value = |i: u32| [(i % 7) as f32, (i % 5) as f32 * 0.1, (i % 11) as f32 * 100.0, 1.0];
        Page { width, height, pixels: (0..width * height).map(value).collect() }
    }

    #[test]
    fn sizes_are_padded_to_whole_blocks() {
        for (w, h, blocks) in [(4, 4, 1), (5, 4, 2), (1, 1, 1), (9, 6, 6)] {
            assert_eq!(bc6h(&page(w, h)).len(), blocks * BYTES, "{w} × {h}");
        }
    }

    #[test]
    fn bytes_do_not_depend_on_threads_and_padding_repeats_the_border() {
        let blocks = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| bc6h(&page(37, 90)))
        };
        assert_eq!(blocks(1), blocks(3));
        let small = page(6, 3);
        let at = |x: u32, y: u32| small.pixels[(y.min(2) * 6 + x.min(5)) as usize];
        let padded = Page { width: 8, height: 4, pixels: (0..32).map(|i| at(i % 8, i / 8)).collect() };
        assert_eq!(bc6h(&small), bc6h(&padded));
    }
}
