//! How much memory a bake takes at its peak, before its costly stages begin.
//!
//! In: scene, atlas, settings. Out: [`Estimate`]. Rays, lines and samples take none that counts.
//!
//! Factors are fitted to measured peaks; `tests/memory.rs` bakes and compares. They are meant to be above what is
//! measured, by no more than a factor of 1.6.

use crate::atlas::Atlas;
use crate::scene::{Footprint, Scene};
use crate::settings::{Aov, Directional, Settings};
use core::fmt::Write;
use std::collections::BTreeSet;

/// Program, threads, and what the allocator keeps [bytes].
const PROGRAM: u64 = 32 << 20;
/// Charts of a triangle that has no layout of its own, once for all equal parts [bytes].
const PER_CHARTED_TRIANGLE: u64 = 150;
/// Patch and links [bytes].
const PER_PATCH: u64 = 510;
/// Solution of one group of lights on a patch [bytes].
const PER_SOLUTION: u64 = 220;
/// Light vectors on a patch [bytes].
const PER_VECTORS: u64 = 160;
/// A lightmap of 32-bit floats, on its way to a file [bytes].
const PER_PIXEL: u64 = 24;

/// Bytes at the peak of a bake, by what they are for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
pub struct Estimate {
    /// All of it.
    pub bytes: u64,
    /// Document, vertices, triangles and their ray hierarchy and charts.
    pub geometry: u64,
    /// Decoded textures.
    pub textures: u64,
    /// Patches, links and their light.
    pub texels: u64,
    /// Pictures: lightmap, light groups, directional pages, further layers.
    pub pages: u64,
}

impl Estimate {
    /// For a bake of `scene` on `atlas`.
    #[must_use]
    pub fn new(scene: &Scene, atlas: &Atlas, settings: &Settings) -> Self {
        let footprint = Footprint::of_scene(scene);
        let (layouts, layout_of) = atlas.layouts();
        let mut is_fresh = vec![false; layouts.len()];
        for (p, (part, charts)) in scene.parts.iter().zip(&atlas.parts).enumerate() {
            is_fresh[layout_of[p] as usize] |= part.receives && !charts.kept;
        }
        let charted: usize =
            layouts.iter().zip(is_fresh).filter(|(_, fresh)| *fresh).map(|(layout, _)| layout.triangles.len()).sum();
        let groups = if settings.light_groups { groups(scene) } else { 1 };
        let vectors = if settings.directional == Directional::None { 0 } else { PER_VECTORS };
        let per_patch = PER_PATCH + groups * (PER_SOLUTION + vectors);
        let [width, height] = atlas.page_size.map(u64::from);
        let geometry = footprint.geometry_bytes() + charted as u64 * PER_CHARTED_TRIANGLE;
        let texels = (atlas.covered_texels as f64 * sides(scene) * per_patch as f64) as u64;
        let pages = width * height * u64::from(atlas.pages) * pictures(settings, groups) * PER_PIXEL;
        let textures = footprint.texture_bytes();
        Self { bytes: PROGRAM + geometry + textures + texels + pages, geometry, textures, texels, pages }
    }

    /// Why a bake is refused that may take no more than `limit` bytes; `None` = it is not.
    #[must_use]
    pub fn refusal(&self, limit: Option<u64>) -> Option<String> {
        let limit = limit.filter(|&limit| self.bytes > limit)?;
        let advice = match self.geometry + self.textures {
            scene if scene > self.bytes / 2 => "bake it in several pieces, or scale its textures down",
            _ => "lower --texels-per-meter, or leave out --light-groups, --directional or layers of --aov",
        };
        let (limit, words) = (size(limit), self.words());
        Some(format!("the bake needs about {words}, above the limit of {limit}; {advice}, or raise --memory-limit"))
    }

    /// For people: all of it, and its parts.
    #[must_use]
    pub fn words(&self) -> String {
        let mut words = size(self.bytes);
        let parts =
            [("geometry", self.geometry), ("textures", self.textures), ("texels", self.texels), ("pages", self.pages)];
        let named: Vec<String> = parts.iter().map(|(name, bytes)| format!("{name} {}", size(*bytes))).collect();
        // Writing to a string cannot fail.
        let _ = write!(words, " ({})", named.join(", "));
        words
    }
}

/// Light groups: each name, and what has none.
pub(crate) fn groups(scene: &Scene) -> u64 {
    let names: BTreeSet<&Option<String>> = scene.groups.lights.iter().chain(&scene.groups.parts).collect();
    names.len().max(1) as u64
}

/// Sides that a texel has on the mean: thin two-sided surfaces have light on both.
pub(crate) fn sides(scene: &Scene) -> f64 {
    let (mut all, mut doubled) = (0.0, 0.0);
    for part in scene.parts.iter().filter(|p| p.receives) {
        let area = part.triangles.clone().map(|t| scene.area(t)).fold(0.0, |a, b| a + b);
        let area = area * f64::from(part.treatment.density).powi(2);
        all += area;
        doubled += if scene.materials[part.material].is_two_sided() { area } else { 0.0 };
    }
    if all > 0.0 { 1.0 + doubled / all } else { 1.0 }
}

/// Pictures of four channels that are held at the end of a bake.
fn pictures(settings: &Settings, groups: u64) -> u64 {
    let directional = match settings.directional {
        Directional::None => 0,
        Directional::Sh => 4,
        Directional::Dominant => 1,
    };
    let layers = settings.aov.iter().filter(|aov| !matches!(aov, Aov::Stderr)).count() as u64;
    let groups = if settings.light_groups { groups + 1 } else { 0 };
    1 + groups + directional + layers
}

/// For people: `1.2 GiB`.
fn size(bytes: u64) -> String {
    match bytes {
        0..0x4000_0000 => format!("{:.0} MiB", bytes as f64 / f64::from(1 << 20)),
        _ => format!("{:.1} GiB", bytes as f64 / f64::from(1 << 30)),
    }
}
