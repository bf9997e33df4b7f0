//! The mip levels of a page, with which no black from between charts bleeds into them.
//!
//! In: a page with its coverage, and how many rings it was dilated by. Out: levels down to 1 × 1, each half as large
//! (rounded down). A texel of a level is the mean of the covered area below it; a dilated texel has no say. What is not
//! covered is filled by `finish::dilate` anew on every level.
//!
//! Level 0 keeps the dilated texels of the page as they are, and gets [`BLOCK_RINGS`] more: a 4 × 4 block that has one
//! good texel holds no black one then, which would take a line of the block's two or three colours for itself.
//!
//! Known limit: level k mixes charts that are nearer to each other than about 2^k texels, so levels beyond the logarithm
//! of `--padding` are for surfaces far away.

use super::half;
use crate::finish::Page;
use crate::finish::dilate;

/// A block is four texels wide, so this reaches all of it from any of its texels.
const BLOCK_RINGS: u32 = 3;

/// All levels, the largest first. The fourth value of a texel is the part of it that is covered.
#[must_use]
pub fn levels(page: &Page, padding: u32) -> Vec<Page> {
    let stored = |p: &[f32; 4]| [half(p[0]).to_f32(), half(p[1]).to_f32(), half(p[2]).to_f32(), p[3]];
    let mut covered = Page { pixels: page.pixels.iter().map(stored).collect(), ..*page };
    let mut levels = Vec::new();
    loop {
        let mut filled = covered.clone();
        dilate(&mut filled, if levels.is_empty() { padding.max(1) } else { 1 } + BLOCK_RINGS);
        levels.push(filled);
        if covered.width <= 1 && covered.height <= 1 {
            return levels;
        }
        covered = halved(&covered);
    }
}

fn halved(page: &Page) -> Page {
    let (columns, rows) = (shares(page.width), shares(page.height));
    let mut pixels = Vec::with_capacity(columns.len() * rows.len());
    for row in &rows {
        for column in &columns {
            let (mut sum, mut cover, mut area) = ([0.0f64; 3], 0.0, 0.0);
            for &(y, wy) in row {
                for &(x, wx) in column {
                    let pixel = page.pixels[(y * page.width + x) as usize];
                    let weight = wx * wy * f64::from(pixel[3]);
                    sum = core::array::from_fn(|c| sum[c] + weight * f64::from(pixel[c]));
                    (cover, area) = (cover + weight, area + wx * wy);
                }
            }
            let [r, g, b] = sum.map(|s| if cover > 0.0 { (s / cover) as f32 } else { 0.0 });
            pixels.push([r, g, b, (cover / area) as f32]);
        }
    }
    Page { width: columns.len() as u32, height: rows.len() as u32, pixels }
}

/// For each cell of a row of half as many cells, the old cells below it with the length that each shares with it.
fn shares(cells: u32) -> Vec<Vec<(u32, f64)>> {
    let half = (cells / 2).max(1);
    let step = f64::from(cells) / f64::from(half);
    let share = |new: u32| {
        let (low, high) = (f64::from(new) * step, f64::from(new + 1) * step);
        let length = |old: u32| (f64::from(old + 1).min(high) - f64::from(old).max(low)).max(0.0);
        let (first, last) = (low as u32, (libm::ceil(high) as u32).min(cells));
        (first..last).map(|old| (old, length(old))).filter(|&(_, length)| length > 0.0).collect()
    };
    (0..half).map(share).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn page(width: u32, height: u32, texel: impl Fn(u32, u32) -> [f32; 4]) -> Page {
        let pixels = (0..width * height).map(|i| texel(i % width, i / width)).collect();
        Page { width, height, pixels }
    }

    #[test]
    fn sizes_are_halved_and_rounded_down_to_one() {
        let sizes =
            |w, h| levels(&page(w, h, |_, _| [1.0; 4]), 1).iter().map(|l| (l.width, l.height)).collect::<Vec<_>>();
        assert_eq!(sizes(13, 3), [(13, 3), (6, 1), (3, 1), (1, 1)]);
        assert_eq!(sizes(1, 1), [(1, 1)]);
    }

    #[test]
    fn a_covered_page_keeps_its_mean_at_every_size() {
        for (w, h) in [(16, 16), (13, 7), (188, 3)] {
            let page = page(w, h, |x, y| [(x * 7 + y * 3) as f32 % 5.0, 1.0, 0.0, 1.0]);
            let mean =
                |p: &Page| p.pixels.iter().map(|p| f64::from(p[0])).fold(0.0, |a, b| a + b) / p.pixels.len() as f64;
            for level in levels(&page, 2) {
                assert!((mean(&level) / mean(&page) - 1.0).abs() < 1e-5, "{w} × {h}");
                assert!(level.pixels.iter().all(|p| (p[1] - 1.0).abs() < 1e-6 && p[3] > 0.999));
            }
        }
    }

    #[test]
    fn nothing_bleeds_from_what_is_not_covered() {
        // A chart of constant light; black between charts, and nonsense in what was dilated.
        let chart = |x: u32, y: u32| (3..9).contains(&x) && (5..8).contains(&y);
        let page = page(32, 24, |x, y| if chart(x, y) { [2.0, 3.0, 4.0, 1.0] } else { [9.0, 0.0, 0.0, 0.0] });
        for (k, level) in levels(&page, 1).iter().enumerate() {
            for (i, pixel) in level.pixels.iter().enumerate() {
                let filled = pixel[1] > 0.0;
                assert!(!filled || (pixel[1] - 3.0).abs() < 1e-6 && (pixel[0] - 2.0).abs() < 1e-6, "{k} {i} {pixel:?}");
            }
        }
        assert!(levels(&page, 1)[0].pixels[4 * 32][1] == 3.0, "three texels from the chart, within padding and block");
    }

    #[test]
    fn level_zero_keeps_what_dilation_made() {
        let mut before = page(40, 40, |x, y| {
            let on = (x / 9 + y / 7) % 2 == 0 && x % 9 < 4 && y % 7 < 3;
            [(x + y) as f32, x as f32, y as f32, f32::from(u8::from(on))]
        });
        dilate(&mut before, 2);
        let after = &levels(&before, 2)[0];
        for (a, b) in after.pixels.iter().zip(&before.pixels) {
            assert!(a == b || b[..3] == [0.0; 3]);
        }
    }
}
