//! Irradiance per front patch → pages of E/π or E.

use super::{Lightmap, Page};
use crate::base::Rgb;
use crate::patches::Patches;

/// Puts `values` (one per front patch) on pages. Texels of patches that lie wholly inside solids stay uncovered, so
/// that dilation fills them from their visible neighbours.
#[must_use]
pub fn assemble(patches: &Patches, pages: u32, values: &[Rgb], factor: f32) -> Lightmap {
    let [width, height] = patches.page_size;
    let blank = || Page { width, height, pixels: vec![[0.0; 4]; width as usize * height as usize] };
    let mut lightmap = Lightmap { pages: (0..pages).map(|_| blank()).collect() };
    for (i, value) in values.iter().enumerate() {
        if patches.exposed[i] <= 0.0 {
            continue;
        }
        let (x, y) = patches.texel_xy(i);
        let v = *value * factor;
        lightmap.pages[patches.page(i) as usize].pixels[(y * width + x) as usize] = [v.x, v.y, v.z, 1.0];
    }
    lightmap
}
