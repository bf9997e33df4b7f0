//! How much memory a bake takes at its peak, before its costly stages begin.
//!
//! In: scene, atlas, settings. Out: [`Estimate`]. Rays, lines and samples take none that counts.
//!
//! Factors are fitted to measured peaks; `tests/memory.rs` bakes and compares. They are meant to be above what is
//! measured, by no more than a factor of 1.6.

use crate::atlas::Atlas;
use crate::base::MemoryLimit;
use crate::base::memory_limit::in_words;
use crate::scene::{Footprint, Scene};
use crate::settings::{Aov, Directional, Settings};
use core::fmt::Write;
use std::collections::BTreeSet;
use sysinfo::{MemoryRefreshKind, RefreshKind, System};

/// Program, threads, and what the allocator keeps [bytes].
const PROGRAM: u64 = 32 << 20;
/// Charts of a triangle that has no layout of its own, once for all equal parts [bytes].
const PER_CHARTED_TRIANGLE: u64 = 150;
/// Patch and links [bytes].
const PER_PATCH: u64 = 570;
/// Solution of one group of lights on a patch [bytes].
const PER_SOLUTION: u64 = 220;
/// Light vectors on a patch [bytes].
const PER_VECTORS: u64 = 160;
/// A lightmap of 32-bit floats, on its way to a file [bytes].
const PER_PIXEL: u64 = 24;
/// Size of a scene [m] from which on its unit is asked about.
const LARGE: f32 = 1000.0;

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
    pub fn refusal(&self, limit: Option<MemoryLimit>, scene: &Scene) -> Option<String> {
        let limit = limit.filter(|limit| limit.refuses(self.bytes))?;
        let advice = match self.geometry + self.textures {
            scene if scene > self.bytes / 2 => "bake it in several pieces, or scale its textures down",
            _ => "lower --texels-per-meter, or leave out --light-groups, --directional or layers of --aov",
        };
        let (words, doubt) = (self.words(), doubt_of_unit(scene));
        Some(format!("the bake needs about {words}, more than {limit}; {advice}, or raise --memory-limit{doubt}"))
    }

    /// For people: all of it, and its parts.
    #[must_use]
    pub fn words(&self) -> String {
        let mut words = in_words(self.bytes);
        let parts =
            [("geometry", self.geometry), ("textures", self.textures), ("texels", self.texels), ("pages", self.pages)];
        let named: Vec<String> = parts.iter().map(|(name, bytes)| format!("{name} {}", in_words(*bytes))).collect();
        // Writing to a string cannot fail.
        let _ = write!(words, " ({})", named.join(", "));
        words
    }
}

/// What to do about a scene so large that its unit may not be the metre.
fn doubt_of_unit(scene: &Scene) -> String {
    let size = scene.extent();
    if size.max_element() < LARGE {
        return String::new();
    }
    let [x, y, z] = size.to_array();
    format!(
        ". The scene measures {x:.0} x {y:.0} x {z:.0} m; where its unit is not the metre, as glTF wants, scale it, or \
         divide --texels-per-meter by as much"
    )
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

/// What a bake may take: what the user says, or else what the machine has, or the container that the program runs in.
#[must_use]
pub fn limit(settings: &Settings) -> Option<MemoryLimit> {
    let has = || {
        let system = System::new_with_specifics(RefreshKind::nothing().with_memory(MemoryRefreshKind::everything()));
        let container = system.cgroup_limits().map_or(u64::MAX, |limits| limits.total_memory);
        Some(system.total_memory().min(container)).filter(|&bytes| bytes > 0).map(MemoryLimit::Machine)
    };
    settings.memory_limit.map(MemoryLimit::Asked).or_else(has)
}
