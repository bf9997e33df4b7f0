//! Warns of light that is brighter than the files can hold: pages are half floats, and what is above their largest is
//! written as that.
//!
//! In: the pages as they were computed. Out: a warning (`clipped`) that names pages and texels, for all of a bake.
//!
//! Limits: of light groups nothing is said that is not true of their sum. Layers of `--aov` and light at vertices are
//! 32-bit floats, and lose nothing.

use super::write::Results;
use crate::base::Warning;
use crate::finish::Page;
use crate::output::exr::LARGEST;
use crate::settings::Quantity;
use core::f32::consts::FRAC_1_PI;

/// Some texels are brighter than what can be written.
pub(super) fn warning(results: &Results, quantity: Quantity) -> Option<Warning> {
    let maps = || results.directional.iter().map(|(_, map)| map).chain([&results.lightmap]);
    let pages: Vec<Vec<&Page>> =
        (0..results.lightmap.pages.len()).map(|k| maps().filter_map(|map| map.pages.get(k)).collect()).collect();
    let clipped: Vec<(usize, u64)> =
        pages.iter().map(|maps| clipped(maps)).enumerate().filter(|(_, count)| *count > 0).collect();
    if clipped.is_empty() {
        return None;
    }
    let values = pages.iter().flatten().flat_map(|page| &page.pixels).filter(|p| p[3] > 0.0);
    let most = values.map(brightness).fold(0.0, f32::max);
    let places: Vec<String> = clipped.iter().map(|(page, count)| format!("{count} of page {page}")).collect();
    let advice = match quantity {
        Quantity::Irradiance if most * FRAC_1_PI <= LARGEST => {
            "use --quantity radiosity, whose numbers are π times smaller"
        }
        _ => {
            "dim all that shines by one factor in rules (intensity, emission; --environment-intensity), and have it multiplied \
             in again where the lightmap is shown"
        }
    };
    let message = format!(
        "texels are brighter than {LARGEST}, the most that half floats hold, and were written as that: {}; the brightest \
         would be {most:.0}; {advice}; --aov direct,indirect and --target vertex write 32-bit floats",
        places.join(", ")
    );
    Some(Warning::new("clipped", message))
}

/// Texels of charts that some of the pictures of a page cannot hold.
fn clipped(maps: &[&Page]) -> u64 {
    let count = maps.first().map_or(0, |page| page.pixels.len());
    let is_clipped =
        |i: &usize| maps.iter().any(|page| page.pixels[*i][3] > 0.0 && brightness(&page.pixels[*i]) > LARGEST);
    (0..count).filter(is_clipped).count() as u64
}

/// The largest channel, of either sign.
fn brightness(pixel: &[f32; 4]) -> f32 {
    pixel[..3].iter().fold(0.0, |most, v| v.abs().max(most))
}
