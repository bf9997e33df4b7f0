//! Which of the two sides of a sheet a texel belongs to, where a single-sided sheet without thickness cuts it: a wall that
//! goes into the ground has texels half above the ground and half below it.
//!
//! In: the solids of a scene and points of a texel's surface. Out: whether a point lies behind the back of a sheet, and
//! whether a sheet cuts a texel off from its neighbour.
//!
//! Viewers do not draw backs of single-sided surfaces, so scenes are not made to be seen from there: the part of a texel
//! that a sheet shows its front to is what people look at. Rays run along the surface, a little above it, and what they
//! meet first says on which side of a sheet they began. Of a wall in the sun that went into the ground, the last texel
//! held up to a third less light than it should, whichever part of it was below.
//!
//! Limits: double-sided sheets have no side to prefer; a texel belongs to both sides of them.

use super::Patches;
use super::exposed::{LOW, Solids};
use crate::base::Frame;
use crate::scene::Scene;
use crate::trace::{Closed, Ray};
use glam::Vec3;

/// Directions along the surface.
const DIRECTIONS: u32 = 8;
/// Length of rays along the surface, in texel edges: where a sheet cuts a texel from side to side, one of eight directions
/// meets it within that from any point.
const ACROSS: f32 = 1.1;
/// Distance beside the way from texel to texel at which a sheet must part them as well, in texel edges: a blade of grass
/// does not.
const BESIDE: f32 = 0.25;

/// A point on the surface of a patch lies behind the back of a sheet that is close.
pub(super) fn is_behind(patches: &Patches, solids: Solids<'_>, patch: usize, point: Vec3) -> bool {
    let edge = patches.texel_edge(patch);
    let frame = Frame::from_normal(patches.normal[patch]);
    let origin = point + frame.n * (LOW * edge);
    (0..DIRECTIONS).any(|k| {
        let (sin, cos) = libm::sincosf(k as f32 * (core::f32::consts::TAU / DIRECTIONS as f32));
        meets_back(solids, origin, (frame.s * cos + frame.t * sin) * (ACROSS * edge))
    })
}

/// From patch `i` one looks at the back of a sheet that parts it from its neighbour `j`.
pub(super) fn is_cut_off(patches: &Patches, solids: Solids<'_>, i: usize, j: usize) -> bool {
    let edge = patches.texel_edge(i);
    let above = |patch: usize| patches.position[patch] + patches.normal[patch] * (LOW * edge);
    let (origin, way) = (above(i), above(j) - above(i));
    let aside = way.cross(patches.normal[i]).normalize_or_zero() * (BESIDE * edge);
    [Vec3::ZERO, aside, -aside].into_iter().all(|aside| meets_back(solids, origin + aside, way))
}

/// What the way meets first is the back of a surface that has one side.
fn meets_back(Solids { tracer, closed }: Solids<'_>, origin: Vec3, way: Vec3) -> bool {
    let hit = tracer.closest_hit(&Ray { origin, direction: way, t_max: 1.0 });
    hit.is_some_and(|hit| !hit.front && is_sheet(tracer.scene(), closed, hit.triangle))
}

/// A triangle has one side, lets no light through, and does not belong to a surface that closes: of what does, all that
/// is behind lies in a solid.
pub(super) fn is_sheet(scene: &Scene, closed: &Closed, triangle: u32) -> bool {
    let material = scene.material(triangle);
    !closed.holds(triangle) && !material.is_two_sided() && material.is_opaque()
}
