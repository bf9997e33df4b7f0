//! What `--aov` asks for: layers with a value per texel, of the light and of the surface that it falls on.
//!
//! In: a [`Solution`]. Out: per page, layers for an EXR file. A new layer is a case of [`Aov`] and one of [`layer`].
//!
//! Light has the unit of the stored quantity, and goes beyond charts as the lightmap does:
//! * `direct` and `indirect` add up to the lightmap, but for its rounding to half floats.
//! * `stderr` is the standard error of a texel: the root mean square over the channels. The difference of two halves is
//!   one draw of it and says little about a single texel, so squares are averaged over neighbours on the surface and in
//!   space.
//!
//! What describes the surface is zero beside charts, and in texels that lie wholly inside solids: `albedo` (diffuse
//! reflectance), `normal` (unit, in the world), `position` (centre of the exposed part, in the world) [m], `chart` (number
//! from 1), `density` [texels/m], `coverage` (part of the texel that is exposed surface, in [0, 1]).
//!
//! What is open above the surface (`gather::openness`) goes beyond charts, so that it can be filtered: `ao` (share of the
//! hemisphere, by cosine) and `bent` (mean direction of that share, unit, in the world).

use super::Solution;
use super::solve::{Setup, mean};
use crate::base::{Rgb, color, parallel};
use crate::finish::{self, Lightmap, Page};
use crate::gather::Openness;
use crate::html::DIM;
use crate::output::exr::AovLayer;
use crate::settings::Aov;

const COLOR: &[&str] = &["R", "G", "B"];
const VECTOR: &[&str] = &["X", "Y", "Z"];
const NUMBER: &[&str] = &["Y"];

/// A layer before it is put on pages.
struct Layer {
    name: &'static str,
    /// After the dot; as many of a value's numbers are written.
    channels: &'static [&'static str],
    /// By front patch.
    values: Vec<Rgb>,
    kind: Kind,
}

/// How a layer gets onto pages.
#[derive(Clone, Copy)]
enum Kind {
    /// As the lightmap does: light in its unit, borders filled, seams stitched.
    Stitched,
    /// In its unit, borders filled.
    Filled,
    /// As it is, borders filled.
    Spread,
    /// As it is, borders filled, of unit length there, too.
    Directions,
    /// As it is.
    Bare,
}

/// The layers of every page.
pub(super) fn layers(
    setup: &Setup<'_>,
    pages: u32,
    solution: &Solution,
    factor: f32,
    finish: &dyn Fn(&[Rgb]) -> Lightmap,
) -> Vec<Vec<AovLayer>> {
    let mut out = vec![vec![]; pages as usize];
    for &aov in &setup.settings.aov {
        let layer = layer(aov, setup, solution);
        let map = match layer.kind {
            Kind::Stitched => finish(&layer.values),
            Kind::Filled => super::on_pages(setup, pages, &layer.values, factor),
            Kind::Spread => super::on_pages(setup, pages, &layer.values, 1.0),
            Kind::Directions => unit(super::on_pages(setup, pages, &layer.values, 1.0)),
            Kind::Bare => finish::assemble(setup.patches, pages, &layer.values, 1.0),
        };
        for (page, layers) in map.pages.iter().zip(&mut out) {
            layers.push(layer_of(&layer, page));
        }
    }
    out
}

fn layer(aov: Aov, setup: &Setup<'_>, solution: &Solution) -> Layer {
    let Setup { patches, .. } = *setup;
    let offset = setup.tracer.scene().offset;
    let halves = &solution.halves;
    let with_sky = |values: Vec<Rgb>, times: f32| parallel::map(values.len(), |i| values[i] + halves.sky[i] * times);
    let light = |name, kind, channels, values| Layer { name, channels, values, kind };
    let surface = |name, channels, value: &(dyn Fn(usize) -> Rgb + Sync)| Layer {
        name,
        channels,
        values: parallel::map(patches.front, value),
        kind: Kind::Bare,
    };
    match aov {
        Aov::Stderr => light("stderr", Kind::Filled, NUMBER, standard_error(setup, solution)),
        Aov::Direct => light("direct", Kind::Stitched, COLOR, with_sky(mean(&halves.direct), 1.0)),
        Aov::Indirect => light("indirect", Kind::Stitched, COLOR, with_sky(mean(&halves.indirect), -1.0)),
        Aov::Albedo => surface("albedo", COLOR, &|i| patches.reflectance[i]),
        Aov::Normal => surface("normal", VECTOR, &|i| patches.normal[i]),
        Aov::Position => surface("position", VECTOR, &|i| (patches.position[i].as_dvec3() + offset).as_vec3()),
        Aov::Chart => surface("chart", NUMBER, &|i| Rgb::splat((patches.chart(i) + 1) as f32)),
        Aov::Density => surface("density", NUMBER, &|i| Rgb::splat(1.0 / patches.texel_edge(i))),
        Aov::Ao => light("ao", Kind::Spread, NUMBER, open(setup, |o| Rgb::splat(o.share))),
        Aov::Bent => light("bent", Kind::Directions, VECTOR, open(setup, |o| o.direction)),
        Aov::Coverage => surface("coverage", NUMBER, &|i| Rgb::splat(patches.covered(i) * patches.exposed[i])),
    }
}

fn open(setup: &Setup<'_>, value: fn(&Openness) -> Rgb) -> Vec<Rgb> {
    setup.openness.iter().map(value).collect()
}

/// Directions of unit length; means of them are shorter.
fn unit(mut map: Lightmap) -> Lightmap {
    for pixel in map.pages.iter_mut().flat_map(|page| &mut page.pixels) {
        let direction = Rgb::new(pixel[0], pixel[1], pixel[2]).normalize_or_zero();
        pixel[..3].copy_from_slice(&direction.to_array());
    }
    map
}

/// Root mean square error of the channels [lx].
fn standard_error(setup: &Setup<'_>, solution: &Solution) -> Vec<Rgb> {
    let network = setup.network();
    let [direct, indirect] = [0, 1].map(|k: usize| solution.errors[k].expected(setup.patches, &network));
    let one = |i: usize| ((direct[i].max(0.0) + indirect[i].max(0.0)) / 3.0).sqrt();
    parallel::map(setup.patches.front, |i| Rgb::splat(one(i)))
}

/// Standard error of each front patch as a part of its light, or of [`DIM`] of the mean light where it is darker.
pub(super) fn relative_error(setup: &Setup<'_>, solution: &Solution) -> Vec<f32> {
    let front = setup.patches.front;
    let light = |i: usize| color::mean(solution.halves.at(i)).max(0.0);
    let least = DIM * (parallel::sum(front, |i| f64::from(light(i))) / front.max(1) as f64) as f32;
    let errors = standard_error(setup, solution);
    parallel::map(front, |i| errors[i].x / light(i).max(least).max(f32::MIN_POSITIVE))
}

fn layer_of(layer: &Layer, page: &Page) -> AovLayer {
    let values = |c: usize| page.pixels.iter().map(|p| p[c]).collect();
    let channels = layer.channels.iter().enumerate().map(|(c, suffix)| ((*suffix).to_owned(), values(c))).collect();
    AovLayer { name: layer.name.to_owned(), channels, float: true }
}
