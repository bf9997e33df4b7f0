//! Fills texels that show no surface of their own from the side that reads them.
//!
//! In: patches, and pages whose borders are filled ([`fill`](super::fill())). Out: texels beside partly hidden ones hold
//! the light of exactly the surface whose bilinear look-ups reach them (`Patches::unlit`).
//!
//! Between the two sides of a wall that stands on a floor lies at least one texel of nothing but hidden floor. A mean of
//! its neighbours would carry light from one side to the other. Of a wall two texels thick, a look-up from one side alone
//! reaches any hidden texel: its weight there, integrated over the exposed surface around, says which side that is.
//!
//! An exposed texel behind a sheet is filled as well, if its neighbour on the front side ends at the sheet.
//!
//! Invariants: other exposed texels stay as they are; a texel that no exposed surface reads stays as well; light that is
//! constant stays constant.

use super::Lightmap;
use crate::base::{Rgb, parallel};
use crate::patches::{Patches, Unlit, around};

/// Gives hidden texels the light of those who read them, but for those that are `kept`: numbers, ascending.
pub fn fill_hidden(patches: &Patches, lightmap: &mut Lightmap, kept: &[u32]) {
    let width = patches.page_size[0];
    let before = &*lightmap;
    let filled = parallel::map(patches.unlit.len(), |k| {
        let Unlit { texel: [page, x, y], weights } = patches.unlit[k];
        if kept.binary_search(&patches.texel_number([page, x, y])).is_ok() {
            return None;
        }
        let (mut sum, mut total) = (Rgb::ZERO, 0.0);
        for (weight, (dx, dy)) in weights.into_iter().zip(around()).filter(|(weight, _)| *weight > 0.0) {
            let at = y.saturating_add_signed(dy) * width + x.saturating_add_signed(dx);
            let pixel = before.pages[page as usize].pixels[at as usize];
            sum += Rgb::new(pixel[0], pixel[1], pixel[2]) * weight;
            total += weight;
        }
        (total > 0.0).then(|| sum / total)
    });
    for (Unlit { texel: [page, x, y], .. }, value) in patches.unlit.iter().zip(filled) {
        if let Some(value) = value {
            lightmap.pages[*page as usize].pixels[(y * width + x) as usize][..3].copy_from_slice(&value.to_array());
        }
    }
}
