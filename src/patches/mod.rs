//! [`Atlas`] → [`Patches`] + [`PatchGraph`]: every texel that a triangle touches becomes a patch of the solver.
//!
//! A patch is the piece of surface that lies in one texel: exact area, centroid, normal and mean reflectance of its
//! clipped polygons. Texels of double-sided and of translucent materials get a second patch for their back. Patches are
//! numbered by page, row and column; all backs come after all fronts. Front is the side that the lightmap stores: where
//! a double-sided chart is turned (`turn`), that is the back of its triangles.
//!
//! Invariants (tests in `tests/patches.rs`): the areas of the front patches add up to the charted area; a texel has at
//! most one front patch; links are symmetric and join patches of one chart and one side.
//!
//! Memory: about 120 bytes per patch here (structure of arrays), 60 more in the solver.
//!
//! Limits: a texel that is cut by a double-sided sheet without thickness belongs to both sides of it, unless one is the inside
//! of a hollow wall (`hollows`), of a single-sided one to the front.

mod behind;
mod blocks;
mod cells;
mod clear;
mod covered;
mod crossable;
mod exposed;
mod facing;
mod fragments;
mod graph;
mod hollows;
mod laid;
mod outlook;
mod overlaid;
mod party;
mod pieces;
mod place;
mod pockets;
mod readers;
mod seams;
mod sight;
mod solids;
mod surface;
mod texel;
mod tilt;
mod turn;

pub use blocks::{BLOCK, Block};
pub use graph::{COS_FACING, HEIGHTS, PatchGraph};
pub use outlook::{Dimness, Outlook};
pub use place::Seen;
pub use readers::{Unlit, around};
pub use sight::{Looked, Sight};
pub use surface::{PatchSurface, Spot};
pub use tilt::{Shine, Tilt, Tilts};
pub use turn::{Before, narrow};

use crate::atlas::Atlas;
use crate::base::{Progress, Rgb, parallel};
use crate::scene::Scene;
use crate::trace::{Closed, Tracer};
use fragments::Fragments;
use glam::{Vec2, Vec3};
use hollows::Hollow;
use laid::Laid;
use party::PartyWalls;

/// No patch.
pub const NO_PATCH: u32 = u32::MAX;

/// The patches of a scene, structure of arrays.
#[derive(Debug, Default)]
pub struct Patches {
    /// Patches 0..front are fronts; the others are backs of double-sided texels.
    pub front: usize,
    /// Centroid of the exposed part [m].
    pub position: Vec<Vec3>,
    /// Mean unit normal, on the patch's own side.
    pub normal: Vec<Vec3>,
    /// Area of the whole patch [m²].
    pub area: Vec<f32>,
    /// Share of the area in [0, 1] that does not lie inside other solids; only it takes part in light.
    pub exposed: Vec<f32>,
    /// Share of the light in [0, 1] that transparent patches stop; empty if all patches stop all of it.
    pub stopping: Vec<f32>,
    /// Mean diffuse reflectance ρ of what is stopped.
    pub reflectance: Vec<Rgb>,
    /// Mean share of what is stopped that leaves on the other side; empty if nothing does.
    pub through: Vec<Rgb>,
    /// Patches that emit, with their mean emitted radiance [cd/m²], ascending.
    pub emission: Vec<(u32, Rgb)>,
    /// Texel of each front patch: (page · height + y) · width + x.
    pub texel: Vec<u32>,
    /// Width and height of the pages [texels].
    pub page_size: [u32; 2],
    /// Centroid of the exposed part of each front patch [texels from the texel's corner].
    pub centroid: Vec<Vec2>,
    /// Texels without exposed surface, or cut off by a sheet, beside others that read them, by page, column and row.
    pub unlit: Vec<Unlit>,
    /// Front patch of each back patch, by index − `front`.
    pub front_of: Vec<u32>,
    back_of: Vec<u32>,
    chart: Vec<u32>,
    grid: Vec<u32>,
    /// Part of each front patch's texel that has surface.
    covered: Vec<f32>,
    fragments: Fragments,
    mask: Vec<u64>,
    /// A bit for each front patch of which all is exposed and that lies on the front of its triangles.
    plain: Vec<u64>,
    /// A sheet may stand within or beside the front patch.
    walled: Vec<bool>,
    /// By patch; empty if none lies in a hollow wall.
    hollows: Vec<Hollow>,
    /// Patches that rays do not meet, ascending, and what they meet instead.
    overlaid: Vec<(u32, u32)>,
    party: PartyWalls,
    surface: Laid,
    /// Charts whose front patches lie on the back of their triangles, ascending.
    turned: Vec<u32>,
}

/// A point of a patch, on one side of the surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfacePoint {
    /// Triangle of the scene, by its id.
    pub triangle: u32,
    /// Barycentric weights of the triangle's vertices 1 and 2.
    pub b: Vec2,
}

impl Patches {
    /// Makes the patches of an atlas. An atlas without charts gives no patches.
    #[must_use]
    pub fn new(tracer: &Tracer<'_>, atlas: &Atlas, progress: &Progress) -> Self {
        let mut patches = texel::patches(tracer.scene(), atlas);
        let closed = Closed::new(tracer.scene());
        exposed::find(&mut patches, tracer, &closed, progress);
        covered::take_out(&mut patches, tracer, progress);
        patches.close(tracer, progress);
        patches.find_readers(tracer, &closed, progress);
        patches.find_plain();
        patches
    }

    /// Takes what lies between double-sided sheets out of texels.
    fn close(&mut self, tracer: &Tracer<'_>, progress: &Progress) {
        let scene = tracer.scene();
        if scene.parts.iter().any(|part| scene.materials[part.material].is_two_sided()) {
            let graph = PatchGraph::new(self, tracer, progress);
            pockets::close(self, tracer, &graph, progress);
            self.hollows = hollows::open(self, tracer, &graph, progress);
        }
    }

    /// Sets the centroids of what is exposed, and who reads what is not.
    fn find_readers(&mut self, tracer: &Tracer<'_>, closed: &Closed, progress: &Progress) {
        self.centroid = parallel::map(self.front, |i| self.centroid_of(i));
        self.unlit = readers::find(self, solids::Solids { tracer, closed, party: &self.party }, &self.walled, progress);
    }

    /// Triangles that are one of the two sides of a wall without thickness, cut into other triangles than the other side is.
    pub fn sides_of_walls(&self) -> impl Iterator<Item = u32> + '_ {
        self.party.sides()
    }

    /// Number of patches, fronts and backs.
    #[must_use]
    pub fn len(&self) -> usize {
        self.area.len()
    }

    /// No patch at all.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.area.is_empty()
    }

    /// The patch is the back of a double-sided texel.
    #[must_use]
    pub fn is_back(&self, patch: usize) -> bool {
        patch >= self.front
    }

    /// The front patch of the same texel (itself for a front).
    #[must_use]
    pub fn front_patch(&self, patch: usize) -> usize {
        if patch < self.front { patch } else { self.front_of[patch - self.front] as usize }
    }

    /// The patch on the other side of the same texel.
    #[must_use]
    pub fn opposite(&self, patch: usize) -> Option<usize> {
        let other = if self.is_back(patch) { self.front_of[patch - self.front] } else { self.back_of[patch] };
        (other != NO_PATCH).then_some(other as usize)
    }

    /// What a patch sends out of the light that falls on it and on its other side.
    #[must_use]
    #[inline]
    pub fn scattered(&self, patch: usize, light: impl Fn(usize) -> Rgb) -> Rgb {
        let reflected = light(patch) * self.reflectance[patch];
        match (self.through.get(patch), self.opposite(patch)) {
            (Some(&through), Some(other)) => reflected + light(other) * through,
            _ => reflected,
        }
    }

    /// Share of the light on a patch that leaves it again, on either side.
    #[must_use]
    pub fn albedo(&self, patch: usize) -> Rgb {
        self.reflectance[patch] + self.through.get(patch).copied().unwrap_or(Rgb::ZERO)
    }

    /// Area that takes part in light [m²]: what is exposed, and of that what stops light. A patch on which E falls
    /// receives E times this area.
    #[must_use]
    pub fn exposed_area(&self, patch: usize) -> f32 {
        let exposed = self.area[patch] * self.exposed[patch];
        self.stopping.get(patch).map_or(exposed, |stopping| exposed * stopping)
    }

    /// Edge length of the patch's texel in the world [m].
    #[must_use]
    pub fn texel_edge(&self, patch: usize) -> f32 {
        (self.area[patch] / self.covered(patch).max(1e-9)).sqrt()
    }

    /// Part of the patch's texel that has surface, hidden or not, in [0, 1].
    #[must_use]
    pub fn covered(&self, patch: usize) -> f32 {
        self.covered[self.front_patch(patch)]
    }

    /// Index into `Atlas::charts` of a front patch.
    #[must_use]
    pub fn chart(&self, front: usize) -> u32 {
        self.chart[front]
    }

    /// Median edge length of the texels of `n` patches [m]; 1 if there are none.
    #[must_use]
    pub fn median_edge(&self, n: usize, patch: impl Fn(usize) -> usize + Sync) -> f32 {
        let mut edges = parallel::map(n, |k| self.texel_edge(patch(k)));
        if n == 0 { 1.0 } else { *edges.select_nth_unstable_by(n / 2, f32::total_cmp).1 }
    }

    /// Area of the fragments of one part of the scene [m²], hidden ones included.
    #[must_use]
    pub fn area_of_part(&self, scene: &Scene, part: usize) -> f64 {
        let triangles = &scene.parts[part].triangles;
        let all = (0..self.front).flat_map(|i| self.triangles(i).zip(self.fragments.range(i)));
        let area = |(t, f): (u32, usize)| f64::from(self.fragments.covered[f]) * f64::from(self.surface.of(t).scale);
        all.filter(|(t, _)| triangles.contains(t)).map(area).fold(0.0, |a, b| a + b)
    }

    /// Bytes held by these arrays.
    #[must_use]
    pub fn bytes(&self) -> usize {
        self.len() * (12 + 12 + 4 + 4 + 12 + 8)
            + self.front * (4 + 4 + 4 + 4 + 4 + 8 + 1)
            + self.grid.len() * 4
            + self.fragments.bytes()
            + self.surface.bytes()
    }
}
