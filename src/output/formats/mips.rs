//! The mip levels of a page, with which no black from between charts bleeds into them.
//!
//! In: a page, filled, with its coverage, and the number of levels in which squares of texels belong to one chart each.
//! Out: levels down to 1 × 1, each half as large (rounded down). In these levels a texel is the mean of all below it, as
//! any loader makes it. In further ones it is the mean of the covered area below it: what was filled has no say, and what
//! is not covered is filled by `finish::dilate` anew on every level.
//!
//! Known limit: further levels mix charts that are near each other, so they are for surfaces far away.

use super::half;
use crate::finish::Page;
use crate::finish::dilate;

/// Rings around what is covered: one for look-ups, and three more that reach all of a block of four texels. A block
/// that has one good texel holds no black one then, which would take a line of the block's two or three colours for
/// itself.
const RINGS: u32 = 4;

/// All levels, the largest first. The fourth value of a texel is the part of it that is covered.
#[must_use]
pub fn levels(page: &Page, mips: u32) -> Vec<Page> {
    let stored = |p: &[f32; 4]| [half(p[0]).to_f32(), half(p[1]).to_f32(), half(p[2]).to_f32(), p[3]];
    let mut covered = Page { pixels: page.pixels.iter().map(stored).collect(), ..*page };
    let mut plain = covered.clone();
    let mut levels = vec![plain.clone()];
    let mut level = 0;
    while covered.width > 1 || covered.height > 1 {
        level += 1;
        covered = halved(&covered, |pixel| f64::from(pixel[3]));
        if level <= mips {
            plain = halved(&plain, |_| 1.0);
            levels.push(plain.clone());
        } else {
            let mut filled = covered.clone();
            dilate(&mut filled, RINGS);
            levels.push(filled);
        }
    }
    levels
}

/// Half as large; a texel is the mean by weight, and in the fourth place the covered part.
fn halved(page: &Page, weight: impl Fn(&[f32; 4]) -> f64) -> Page {
    let (columns, rows) = (shares(page.width), shares(page.height));
    let mut pixels = Vec::with_capacity(columns.len() * rows.len());
    for row in &rows {
        for column in &columns {
            let (mut sum, mut total, mut cover, mut area) = ([0.0f64; 3], 0.0, 0.0, 0.0);
            for &(y, wy) in row {
                for &(x, wx) in column {
                    let pixel = page.pixels[(y * page.width + x) as usize];
                    let share = wx * wy * weight(&pixel);
                    sum = core::array::from_fn(|c| sum[c] + share * f64::from(pixel[c]));
                    (total, cover, area) = (total + share, cover + wx * wy * f64::from(pixel[3]), area + wx * wy);
                }
            }
            let [r, g, b] = sum.map(|s| if total > 0.0 { (s / total) as f32 } else { 0.0 });
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
        // A chart of constant light; black between charts, and nonsense in what was filled.
        let chart = |x: u32, y: u32| (3..9).contains(&x) && (5..8).contains(&y);
        let page = page(32, 24, |x, y| if chart(x, y) { [2.0, 3.0, 4.0, 1.0] } else { [9.0, 0.0, 0.0, 0.0] });
        for (k, level) in levels(&page, 0).iter().enumerate().skip(1) {
            for (i, pixel) in level.pixels.iter().enumerate() {
                let filled = pixel[1] > 0.0;
                assert!(!filled || (pixel[1] - 3.0).abs() < 1e-6 && (pixel[0] - 2.0).abs() < 1e-6, "{k} {i} {pixel:?}");
            }
        }
    }

    #[test]
    fn clean_levels_are_plain_means_and_level_zero_is_the_page() {
        let page = page(16, 8, |x, y| [(x + y) as f32, x as f32, y as f32, f32::from(u8::from(x % 3 == 0))]);
        let levels = levels(&page, 2);
        assert_eq!(levels[0], page);
        for (y, x) in (0..4u32).flat_map(|y| (0..8u32).map(move |x| (y, x))) {
            let pixel = levels[1].pixels[(y * 8 + x) as usize];
            assert_eq!(pixel[..3], [(2 * x + 2 * y) as f32 + 1.0, (2 * x) as f32 + 0.5, (2 * y) as f32 + 0.5]);
        }
        assert!((levels[2].pixels[5][1] - 5.5).abs() < 1e-6);
        let covered =
            |p: &Page| p.pixels.iter().map(|p| f64::from(p[3])).fold(0.0, |a, b| a + b) / p.pixels.len() as f64;
        assert!(levels.iter().all(|level| (covered(level) - 6.0 / 16.0).abs() < 1e-6));
    }
}
