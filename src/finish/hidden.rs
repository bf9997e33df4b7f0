//! Fills texels without exposed surface from the side that reads them.
//!
//! In: patches, and pages whose borders are filled ([`fill`](super::fill())). Out: texels beside partly hidden ones hold
//! the light of exactly the surface whose bilinear look-ups reach them.
//!
//! Between the two sides of a wall that stands on a floor lies at least one texel of nothing but hidden floor. A mean of
//! its neighbours would carry light from one side to the other. Of a wall two texels thick, a look-up from one side alone
//! reaches any hidden texel: its weight there, integrated over the exposed surface around, says which side that is.
//!
//! Invariants: exposed texels stay as they are; a texel that no exposed surface reads stays as well; light that is
//! constant stays constant.
//!
//! Limits: walls thinner than two texels are read from both sides, turned by 45° against the texels those thinner than 2√2.
//! What is exposed is known to half a cell of the mask (1/16 texel), so of walls thinner than 2.5 texels a hidden texel may
//! stay a mean of both sides where less than that of a side reads it: 2.6 % of the lit side's light a millimetre from a wall.

use super::Lightmap;
use crate::base::{Rgb, parallel};
use crate::patches::Patches;
use glam::Vec2;

/// Cells per side over which the weight of a whole texel is integrated.
const CELLS: u32 = 4;

/// Gives hidden texels the light of those who read them.
pub fn fill_hidden(patches: &Patches, lightmap: &mut Lightmap) {
    let texels = beside_hidden(patches);
    let light = |lightmap: &Lightmap, page: u32, x: i32, y: i32| {
        let pixel = lightmap.pages[page as usize].pixels[(y as u32 * patches.page_size[0] + x as u32) as usize];
        Rgb::new(pixel[0], pixel[1], pixel[2])
    };
    let before = &*lightmap;
    let filled = parallel::map(texels.len(), |k| {
        let [page, x, y] = texels[k];
        let own = patches.front_at(page, x as i32, y as i32);
        let (mut sum, mut weight) = (Rgb::ZERO, 0.0);
        for (dx, dy) in around() {
            let (u, v) = (x as i32 + dx, y as i32 + dy);
            let Some(j) = patches.front_at(page, u, v).filter(|&j| patches.exposed[j] > 0.0) else { continue };
            if own.is_some_and(|i| patches.chart(i) != patches.chart(j)) {
                continue;
            }
            let share = read_by(patches, j, Vec2::new(dx as f32, dy as f32));
            sum += light(before, page, u, v) * share;
            weight += share;
        }
        (weight > 0.0).then(|| sum / weight)
    });
    for ([page, x, y], value) in texels.into_iter().zip(filled) {
        if let Some(value) = value {
            let at = (y * patches.page_size[0] + x) as usize;
            lightmap.pages[page as usize].pixels[at][..3].copy_from_slice(&value.to_array());
        }
    }
}

/// Offsets of the eight neighbours.
fn around() -> impl Iterator<Item = (i32, i32)> {
    (0..9).filter(|k| *k != 4).map(|k| (k % 3 - 1, k / 3 - 1))
}

/// Texels without exposed surface that are, or touch, a texel with hidden surface: page, column, row.
fn beside_hidden(patches: &Patches) -> Vec<[u32; 3]> {
    let [width, height] = patches.page_size;
    let mut texels = vec![];
    for i in (0..patches.front).filter(|&i| patches.exposed[i] < 1.0) {
        let (page, (x, y)) = (patches.page(i), patches.texel_xy(i));
        for (dx, dy) in around().chain([(0, 0)]) {
            let (u, v) = (x as i32 + dx, y as i32 + dy);
            let inside = u >= 0 && v >= 0 && u < width as i32 && v < height as i32;
            if inside && patches.front_at(page, u, v).is_none_or(|j| patches.exposed[j] <= 0.0) {
                texels.push([page, u as u32, v as u32]);
            }
        }
    }
    texels.sort_unstable();
    texels.dedup();
    texels
}

/// Weight of a texel in the look-ups of the exposed surface of patch `j`, which lies at `offset` from it [texel²].
fn read_by(patches: &Patches, j: usize, offset: Vec2) -> f32 {
    let mut sum = 0.0;
    patches.cells(j, CELLS, |_, within, area| {
        let reach = (Vec2::ONE - (offset + within - 0.5).abs()).max(Vec2::ZERO);
        sum += area * reach.x * reach.y;
    });
    sum
}
