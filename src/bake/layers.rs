//! What `--aov` asks for besides the light: layers with a value per texel, in the unit of the stored quantity.
//!
//! In: a [`Solution`]. Out: per page, layers for an EXR file. A new layer is a case of [`Aov`] and one of [`layer`].
//!
//! * `direct` and `indirect` add up to the lightmap, but for its rounding to half floats.
//! * `stderr` is the standard error of a texel: the root mean square over the channels. The difference of two halves is
//!   one draw of it and says little about a single texel, so squares are averaged over neighbours on the surface and in
//!   space.

use super::Solution;
use super::solve::{Setup, mean};
use crate::base::{Rgb, parallel};
use crate::finish::Page;
use crate::output::exr::AovLayer;
use crate::settings::Aov;

/// The layers of every page.
pub(super) fn layers(setup: &Setup<'_>, pages: u32, solution: &Solution, factor: f32) -> Vec<Vec<AovLayer>> {
    let mut out = vec![vec![]; pages as usize];
    for &aov in &setup.settings.aov {
        let (name, channels, values) = layer(aov, setup, solution);
        let map = super::on_pages(setup, pages, &values, factor);
        for (page, layers) in map.pages.iter().zip(&mut out) {
            layers.push(layer_of(name, channels, page));
        }
    }
    out
}

/// Name, channels, and a value per front patch.
fn layer(aov: Aov, setup: &Setup<'_>, solution: &Solution) -> (&'static str, &'static [&'static str], Vec<Rgb>) {
    const COLOR: &[&str] = &["R", "G", "B"];
    const NUMBER: &[&str] = &["Y"];
    let halves = &solution.halves;
    let with_sky = |values: Vec<Rgb>, times: f32| parallel::map(values.len(), |i| values[i] + halves.sky[i] * times);
    match aov {
        Aov::Stderr => ("stderr", NUMBER, standard_error(setup, solution)),
        Aov::Direct => ("direct", COLOR, with_sky(mean(&halves.direct), 1.0)),
        Aov::Indirect => ("indirect", COLOR, with_sky(mean(&halves.indirect), -1.0)),
    }
}

/// Root mean square error of the channels [lx].
fn standard_error(setup: &Setup<'_>, solution: &Solution) -> Vec<Rgb> {
    let [direct, indirect] = [0, 1].map(|k: usize| solution.errors[k].expected(setup.patches, setup.graph));
    let one = |i: usize| ((direct[i].max(0.0) + indirect[i].max(0.0)) / 3.0).sqrt();
    parallel::map(setup.patches.front, |i| Rgb::splat(one(i)))
}

fn layer_of(name: &str, channels: &[&str], page: &Page) -> AovLayer {
    let values = |c: usize| page.pixels.iter().map(|p| p[c]).collect();
    let channels = channels.iter().enumerate().map(|(c, suffix)| ((*suffix).to_owned(), values(c))).collect();
    AovLayer { name: name.to_owned(), channels, float: true }
}
