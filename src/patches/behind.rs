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
//! Limits: double-sided sheets have no side to prefer but where one is the inside of a wall ([`hollows`](super::hollows)); a
//! texel belongs to both sides of them.

use super::Patches;
use super::exposed::{LOW, MOST_NEAR, rounding};
use super::solids::Solids;
use crate::base::Frame;
use crate::scene::Scene;
use crate::trace::{Closed, Ray};
use glam::Vec3;

/// Directions along the surface.
const DIRECTIONS: u32 = 8;
/// Length of rays along the surface, in texel edges: where a sheet cuts a texel from side to side, one of eight directions
/// meets it within that from any point.
const ACROSS: f32 = 1.1;
/// Planes of sheets up to which they are looked at one by one.
const MOST_PLANES: usize = 32;
/// Distance beside the way from texel to texel at which a sheet must part them as well, in texel edges: a blade of grass
/// does not.
const BESIDE: f32 = 0.25;

/// The sheets that points of a texel may lie behind.
pub(super) struct Sheets<'a> {
    solids: Solids<'a>,
    frame: Frame,
    /// Of the texel [m].
    edge: f32,
    /// A corner and the normal of each; `None` for too many.
    planes: Option<Vec<[Vec3; 2]>>,
    /// Bound of rounding [m].
    pad: f32,
}

impl<'a> Sheets<'a> {
    /// For a front patch with more about it than is looked at.
    pub(super) fn anywhere(patches: &Patches, solids: Solids<'a>, patch: usize) -> Self {
        let frame = Frame::from_normal(patches.normal[patch]);
        Self { solids, frame, edge: patches.texel_edge(patch), planes: None, pad: rounding(solids.tracer) }
    }

    /// What is close to a front patch, and not over or below all rays along it, as on a round body. With the planes known,
    /// points before all of them, as beside most walls, need no rays.
    pub(super) fn near(patches: &Patches, solids: Solids<'a>, patch: usize) -> Self {
        let anywhere = Self::anywhere(patches, solids, patch);
        let Self { frame, edge, pad, .. } = anywhere;
        let (tracer, scene) = (solids.tracer, solids.tracer.scene());
        let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        // Lowest and highest coordinate of rays along the normal [m].
        let mut rays = [f32::INFINITY, f32::NEG_INFINITY];
        for f in patches.fragments.range(patch) {
            let triangle = patches.fragments.triangle(patch, f);
            let map = patches.map(triangle, patch);
            for corner in patches.polygon(patch, f).corners() {
                let corner = scene.position(triangle, map.weights(*corner)) + frame.n * (LOW * edge);
                (low, high) = (low.min(corner), high.max(corner));
                let height = (corner - patches.position[patch]).dot(frame.n);
                rays = [rays[0].min(height), rays[1].max(height)];
            }
        }
        let (middle, half) = ((low + high) * 0.5, (high - low) * 0.5);
        let (mut planes, mut looks) = (vec![], 0);
        let reach = Vec3::splat(ACROSS * edge + pad);
        let too_many = tracer.any_within(low - reach, high + reach, |t| {
            looks += 1;
            let (corner, normal) = (scene.corners(t)[0], scene.geometric_normal(t));
            let is_before = (middle - corner).dot(normal) > half.dot(normal.abs()) + pad;
            let span = span(scene, t, [patches.position[patch], frame.n]);
            let is_level = rays[0] - pad <= span[1] && span[0] <= rays[1] + pad;
            if !is_before && is_level && is_sheet(scene, solids.closed, t) {
                planes.push([corner, normal]);
            }
            planes.len() > MOST_PLANES || looks == MOST_NEAR
        });
        Self { planes: (!too_many).then_some(planes), ..anywhere }
    }

    /// A point on the surface of the texel lies behind the back of one that is close.
    pub(super) fn hide(&self, point: Vec3) -> bool {
        let origin = point + self.frame.n * (LOW * self.edge);
        let is_before = |[corner, normal]: &[Vec3; 2]| (origin - corner).dot(*normal) > self.pad;
        if self.planes.as_ref().is_some_and(|planes| planes.iter().all(is_before)) {
            return false;
        }
        (0..DIRECTIONS).any(|k| {
            let (sin, cos) = libm::sincosf(k as f32 * (core::f32::consts::TAU / DIRECTIONS as f32));
            let way = (self.frame.s * cos + self.frame.t * sin) * (ACROSS * self.edge);
            meets_back(self.solids, origin, way)
        })
    }
}

/// Lowest and highest coordinate of a triangle's corners along a normal, from a position [m].
pub(super) fn span(scene: &Scene, triangle: u32, [position, normal]: [Vec3; 2]) -> [f32; 2] {
    let [a, b, c] = scene.corners(triangle).map(|corner| (corner - position).dot(normal));
    [a.min(b).min(c), a.max(b).max(c)]
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
fn meets_back(Solids { tracer, closed, .. }: Solids<'_>, origin: Vec3, way: Vec3) -> bool {
    let hit = tracer.closest_hit(&Ray { origin, direction: way, t_max: 1.0 });
    hit.is_some_and(|hit| !hit.front && is_sheet(tracer.scene(), closed, hit.triangle))
}

/// A triangle has one side, lets no light through, and does not belong to a body: of what does, all that is behind lies in a
/// solid. Behind a room without an outside there is the void.
pub(super) fn is_sheet(scene: &Scene, closed: &Closed, triangle: u32) -> bool {
    let material = scene.material(triangle);
    (!closed.holds(triangle) || closed.faces_inward(triangle)) && !material.is_two_sided() && material.is_opaque()
}
