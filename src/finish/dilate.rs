//! Fills texels around charts from whatever is near: for pictures of which nothing but the coverage is known.
//!
//! In: a page whose covered texels (fourth value 1) hold light. Out: up to `radius` rings of texels around them filled;
//! coverage stays 0 there, and texels farther away are set to zero.
//!
//! Ring k holds the empty texels that touch (one of eight neighbours) a texel that was covered or filled before ring k;
//! each becomes the mean of those neighbours. So a value depends on nothing but the page, and a constant stays
//! constant. Known limit: between two charts that are nearer than 2 · `radius` the rings meet in the middle and mix
//! there.

use super::Page;

const EMPTY: u8 = 0;
const QUEUED: u8 = 1;
const FILLED: u8 = 2;

/// Fills `radius` rings of uncovered texels around the covered ones of `page`; farther ones become zero.
pub fn dilate(page: &mut Page, radius: u32) {
    if page.pixels.len() != page.width as usize * page.height as usize || page.pixels.is_empty() {
        return;
    }
    let mut state = vec![EMPTY; page.pixels.len()];
    for (pixel, state) in page.pixels.iter_mut().zip(&mut state) {
        if pixel[3] > 0.0 {
            *state = FILLED;
        } else {
            *pixel = [0.0; 4];
        }
    }
    let mut front: Vec<u32> = Vec::new();
    for i in 0..state.len() {
        if state[i] == FILLED {
            page.around(i).for_each(|j| queue(j, &mut state, &mut front));
        }
    }
    for _ in 0..radius {
        if front.is_empty() {
            break;
        }
        for &i in &front {
            page.pixels[i as usize] = mean_of_filled(page, &state, i as usize);
        }
        let mut next = Vec::new();
        for &i in &front {
            state[i as usize] = FILLED;
        }
        for &i in &front {
            page.around(i as usize).for_each(|j| queue(j, &mut state, &mut next));
        }
        front = next;
    }
}

fn queue(i: usize, state: &mut [u8], front: &mut Vec<u32>) {
    if state[i] == EMPTY {
        state[i] = QUEUED;
        front.push(i as u32);
    }
}

fn mean_of_filled(page: &Page, state: &[u8], i: usize) -> [f32; 4] {
    let (mut sum, mut count) = ([0.0f64; 3], 0.0f64);
    for j in page.around(i).filter(|&j| state[j] == FILLED) {
        sum.iter_mut().zip(page.pixels[j]).for_each(|(sum, value)| *sum += f64::from(value));
        count += 1.0;
    }
    let mean = sum.map(|s| (s / count.max(1.0)) as f32);
    [mean[0], mean[1], mean[2], 0.0]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn page(width: u32, height: u32, covered: &[(u32, u32, f32)]) -> Page {
        let mut pixels = vec![[9.0, 9.0, 9.0, 0.0]; (width * height) as usize];
        for &(x, y, value) in covered {
            pixels[(y * width + x) as usize] = [value, 2.0 * value, 3.0 * value, 1.0];
        }
        Page { width, height, pixels }
    }

    #[test]
    fn rings_are_the_chebyshev_distance_and_the_rest_is_zero() {
        let mut p = page(17, 13, &[(8, 6, 0.5)]);
        dilate(&mut p, 3);
        for y in 0..13i32 {
            for x in 0..17i32 {
                let distance = (x - 8).abs().max((y - 6).abs());
                let expected = if distance <= 3 { 0.5 } else { 0.0 };
                let pixel = p.pixels[(y * 17 + x) as usize];
                assert_eq!(pixel[..3], [expected, 2.0 * expected, 3.0 * expected], "at {x} {y}");
                assert_eq!(pixel[3], if distance == 0 { 1.0 } else { 0.0 });
            }
        }
    }

    #[test]
    fn a_ring_is_the_mean_of_earlier_rings_only() {
        let mut p = page(4, 1, &[(0, 0, 1.0), (3, 0, 5.0)]);
        dilate(&mut p, 1);
        assert_eq!(p.pixels.iter().map(|p| p[0]).collect::<Vec<_>>(), [1.0, 1.0, 5.0, 5.0]);
        let mut p = page(3, 2, &[(0, 0, 1.0), (1, 0, 2.0), (2, 0, 6.0)]);
        dilate(&mut p, 1);
        assert_eq!(p.pixels[3..].iter().map(|p| p[0]).collect::<Vec<_>>(), [1.5, 3.0, 4.0]);
    }

    #[test]
    fn covered_texels_never_change_and_values_stay_between_their_bounds() {
        let covered: Vec<(u32, u32, f32)> =
            (0..200u32).map(|i| (i * 37 % 64, i * 53 % 64, 1.0 + (i % 7) as f32)).collect();
        let before = page(64, 64, &covered);
        let mut after = before.clone();
        dilate(&mut after, 64);
        for (a, b) in after.pixels.iter().zip(&before.pixels) {
            if b[3] > 0.0 {
                assert_eq!(a, b);
            } else {
                assert!(a[0] >= 1.0 && a[0] <= 7.0 && a[3] == 0.0);
            }
        }
    }

    #[test]
    fn nothing_covered_nothing_filled() {
        let mut p = page(5, 5, &[]);
        dilate(&mut p, 4);
        assert!(p.pixels.iter().all(|p| *p == [0.0; 4]));
        let mut empty = Page::default();
        dilate(&mut empty, 4);
        let mut radius_zero = page(3, 3, &[(1, 1, 1.0)]);
        dilate(&mut radius_zero, 0);
        assert_eq!(radius_zero.pixels.iter().filter(|p| p[0] != 0.0).count(), 1);
    }
}
