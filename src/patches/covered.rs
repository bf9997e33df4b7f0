//! Surface right below something else, out of everybody's sight: the floor under a rug that hovers some millimetres over it,
//! the wall behind a poster, the ground under a board that is sunk in it but for its top.
//!
//! In: patches and tracer. Out: exposed shares and cells without what is covered, on each side by itself.
//!
//! Such surface is dark, and nobody sees it, but texels that it shares with what one sees would hold the mean of both: a dark
//! rim up to a texel wide around every rug (down to 0.45 of the light beside it), dotted where it is turned against the
//! texels. It takes no part in light, and is filled from what is in the open. Below a lamp it is no dark but a bright rim: the
//! light between a ceiling and a panel that glows on both sides is 60 times that beside it, and the panel's surroundings
//! were 15 times too bright. Narrow lamps cover nothing: what falls below a tube or a strip of diodes comes out beside it.
//!
//! Invariants: of a chart's side that is covered but for its edges nothing is taken out: nothing could fill it.
//!
//! Limits: what is as low as this and wide, as a slit below a cupboard, shows the light around it. Of what a lamp sends into
//! a gap, only what meets the open surface at once comes out, and not what is reflected in it: beside a panel that glows on
//! both sides, up to 5 mm below a ceiling, texels have four fifths of their light.

use super::blocks::BLOCK;
use super::exposed::{outline, rounding};
use super::pockets::Left;
use super::{Patches, SurfacePoint};
use crate::base::{Frame, Progress, parallel};
use crate::scene::{Alpha, Scene};
use crate::trace::{Ground, Ray, Tracer};
use core::f32::consts::PI;
use glam::Vec3;
use std::collections::{BTreeMap, BTreeSet};

/// Height up to which something covers a surface, in texel edges: 6 mm at 16 texels per metre. Light reaches about as far
/// into a gap as that is high.
const HEIGHT: f32 = 0.1;
/// The same at most, however large the texels are [m]: books stand a centimetre from the side of their shelf.
const MOST_HEIGHT: f32 = 0.008;
/// Cosine between the normals of a surface and of what covers it, at least: what is steeper is as low as that over a sliver.
const ALONG: f32 = 0.9;
/// Height of its plane over the middle of a texel, over that which covers: it may slope.
const STEEP: f32 = 3.0;
/// Width from which on a lamp covers what is below it, in heights up to which something does: less than a seventh of the
/// light below a strip as wide as that comes out.
const WIDE: f32 = 4.0;
/// Directions in which a lamp is as wide as that around a point, of [`ACROSS`]: of the corner of a panel all but one, of a
/// tube at most one.
const WIDE_ACROSS: usize = 3;
/// Directions in which one looks for its width.
const ACROSS: u8 = 4;
/// Triangles of a texel from which on it is not looked at: what is folded as finely as that covers itself.
const MOST_FRAGMENTS: usize = 8;
/// One of so many patches of a chart's side must have nothing over it: between books side by side it is dark, and their edges
/// shall not tell how light it is there.
const LEAST_OPEN: usize = 8;

/// Takes what is covered out of the light.
pub(super) fn take_out(patches: &mut Patches, tracer: &Tracer<'_>, progress: &Progress) {
    let found = parallel::map_watched(patches.block_places(BLOCK), progress, |place| patches.covered_at(tracer, place));
    let found: Vec<(usize, Left)> = found.into_iter().flatten().collect();
    if found.is_empty() {
        return;
    }
    let mut covered = vec![false; patches.len()];
    found.iter().for_each(|(i, _)| covered[*i] = true);
    let side = |i: usize| (patches.chart[patches.front_patch(i)], patches.is_back(i));
    // Of a chart's side, patches in all and those with nothing over them.
    let mut sides: BTreeMap<(u32, bool), [usize; 2]> = BTreeMap::new();
    for i in (0..patches.len()).filter(|&i| patches.exposed[i] > 0.0) {
        let [all, open] = sides.entry(side(i)).or_default();
        *all += 1;
        *open += usize::from(!covered[i]);
    }
    let is_open = |[all, open]: [usize; 2]| LEAST_OPEN * open >= all;
    let sides: BTreeSet<(u32, bool)> = sides.into_iter().filter(|(_, of)| is_open(*of)).map(|(side, _)| side).collect();
    let taken: Vec<(usize, Left)> = found.into_iter().filter(|(i, _)| sides.contains(&side(*i))).collect();
    taken.into_iter().for_each(|(i, left)| patches.keep(i, left));
}

/// It can cover what is below it: one does not see through it.
fn covers(scene: &Scene, triangle: u32) -> bool {
    let (material, part) = (scene.material(triangle), scene.part(triangle));
    let is_solid = material.alpha != Alpha::Blend && material.transmission == 0.0 && material.translucency.is_none();
    is_solid && part.treatment.casts
}

impl Patches {
    /// Patches at a place of blocks of which something is covered, and what is left of them.
    fn covered_at(&self, tracer: &Tracer<'_>, place: usize) -> Vec<(usize, Left)> {
        let scene = tracer.scene();
        let mut found = vec![];
        for block in self.blocks_at(place, BLOCK) {
            let of_few = |i: &usize| self.exposed[*i] > 0.0 && self.fragments.range(*i).len() <= MOST_FRAGMENTS;
            let fronts: Vec<usize> = block.iter().map(|(_, i)| *i).filter(of_few).collect();
            let mut own: Vec<u32> = fronts.iter().flat_map(|i| self.triangles(*i)).collect();
            own.sort_unstable();
            let mut sides: Vec<usize> = fronts.iter().flat_map(|i| [Some(*i), self.opposite(*i)]).flatten().collect();
            let (pad, is_other) = (rounding(tracer), |t: u32| own.binary_search(&t).is_err() && covers(scene, t));
            let is_over = |i: usize, t: u32| self.is_over(scene, pad, i, t);
            let (low, high) = self.slab(pad, &sides);
            if sides.is_empty() || !tracer.any_within(low, high, is_other) {
                continue;
            }
            sides.retain(|&i| {
                let (low, high) = self.slab(pad, &[i]);
                self.exposed[i] > 0.0
                    && tracer.any_within(low, high, |t| is_other(t) && is_over(i, t))
                    && outline(self, self.front_patch(i)).iter().any(|point| self.is_covered(tracer, i, *point))
            });
            for i in sides {
                let left = self.left_where(tracer, i, |point, _| !self.is_covered(tracer, i, point));
                if left.is_less_than(self.exposed[i]) {
                    found.push((i, left));
                }
            }
        }
        found
    }

    /// Height up to which something covers a patch [m].
    fn low(&self, patch: usize) -> f32 {
        (HEIGHT * self.texel_edge(patch)).min(MOST_HEIGHT)
    }

    /// Bounds of patches, taken for discs, and of what is right over them [m].
    fn slab(&self, pad: f32, patches: &[usize]) -> (Vec3, Vec3) {
        let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        for &i in patches {
            let (position, normal, edge) = (self.position[i], self.normal[i], self.texel_edge(i));
            let disc = (Vec3::ONE - normal * normal).max(Vec3::ZERO).map(f32::sqrt) * edge;
            let over = position + normal * self.low(i);
            low = low.min(position.min(over) - disc);
            high = high.max(position.max(over) + disc);
        }
        (low - pad, high + pad)
    }

    /// A triangle lies along a patch, and its plane over the middle of that, as low as what covers it. Planes of triangles
    /// beside it on a hollow body lie below it there.
    fn is_over(&self, scene: &Scene, pad: f32, patch: usize, triangle: u32) -> bool {
        let normal = scene.geometric_normal(triangle);
        let along = normal.dot(self.normal[patch]);
        let height = normal.dot(scene.corners(triangle)[0] - self.position[patch]) / along;
        along.abs() > ALONG && height > pad && height < STEEP * self.low(patch) + pad
    }

    /// Something is right over a point of a patch, and not in its place.
    fn is_covered(&self, tracer: &Tracer<'_>, patch: usize, point: SurfacePoint) -> bool {
        let scene = tracer.scene();
        let ground = Ground::new(scene.corners(point.triangle));
        let normal = if self.is_behind(patch) { -ground.normal() } else { ground.normal() };
        let height = self.low(patch);
        let origin = tracer.leave(&ground, point.b, normal);
        let over = |aside: Vec3| {
            let hit = tracer.closest_hit(&Ray { origin: origin + aside, direction: normal * height, t_max: 1.0 })?;
            (hit.t * height > rounding(tracer) && covers(scene, hit.triangle)).then_some(hit.triangle)
        };
        let Some(cover) = over(Vec3::ZERO) else { return false };
        if !scene.glows(scene.part(cover)) {
            return true;
        }
        let (frame, width) = (Frame::from_normal(normal), WIDE * height);
        let is_wide = |way: u8| {
            let (sin, cos) = libm::sincosf(PI * f32::from(way) / f32::from(ACROSS));
            let is_over = |part: f32| over(frame.to_world(Vec3::new(cos, sin, 0.0)) * (part * width)).is_some();
            is_over(1.0) || is_over(-1.0) || (is_over(0.5) && is_over(-0.5))
        };
        (0..ACROSS).filter(|way| is_wide(*way)).count() >= WIDE_ACROSS
    }
}
