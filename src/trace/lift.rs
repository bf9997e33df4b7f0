//! The smooth surface that a coarse mesh with vertex normals stands for: where it lies above a facet, and where rays
//! that graze the facet start so that the facets around do not cut them off.
//!
//! In: a triangle with its vertex normals, a point on it, a direction. Out: an offset [m]; a start.
//!
//! Shading shows a smooth body, rays see facets. Where light grazes it, whole facets face away from light that their
//! shading says they get, and the border of light and shadow follows the edges of the mesh.
//!
//! Source: Hanika, "Hacking the Shadow Terminator", Ray Tracing Gems II, 2021, chapter 4: a point is projected onto the
//! tangent planes at the vertices, as far as it lies below them, and the projections are mixed by the point's weights.
//! Where we differ, and why:
//! * only rays that leave the facet below [`GRAZING`] are lifted, in full if they lead below it, and by less the steeper
//!   they are: no other ray can meet a convex body that it leaves, and what stands on the surface keeps its shadow. The
//!   "geometry offset" of Blender's Cycles is blended the same way;
//! * what lies between the point and the lifted one, a sheet on the surface or a wall that cuts the facet, is never
//!   passed: then nothing is lifted;
//! * normals that lean far away from the facet lift less and then nothing ([`BOXY`]): they belong to boxes that are shaded
//!   smoothly by mistake, whose sides would be lit around their edges;
//! * normals that lean to one side together ([`ALIKE`]) lift nothing: they are bent for shading, as those of leaves and
//!   cards are, and stand for nothing round.
//!
//! The tangent planes are above a sphere by as much as the facet is below it, so half of the lift is where the surface
//! itself lies (Boubekeur and Alexa, "Phong Tessellation", SIGGRAPH Asia 2008, eq. 3 with α = ½): of facets that span 37°
//! of a sphere, within 0.5 % of the radius. Light at a finite distance is looked for from there.
//!
//! Symbols: p point; `v_k`, `n_k` corners and their normals; `b_k` weights of the corners.
//!
//! Invariants: a triangle whose corners lie within [`FLAT`] of each other's tangent planes, or above them, has no lift at
//! all; the offset is the same from both sides of an edge unless [`BOXY`] or [`ALIKE`] has a part in it. Limit: where a
//! surface is concave its facets lie above it, and rays start on them.

use super::{Ground, Tracer};
use crate::scene::Scene;
use glam::{Vec2, Vec3};

/// Sine of the elevation over the facet from which rays start on it. Larger: things that stand on a surface lose the
/// shadow at their foot under flat light; smaller: edges show in it.
const GRAZING: f32 = 0.1;
/// Slope between a tangent plane and a corner up to which a triangle counts as flat. Larger: steps of more than that show in
/// light that grazes round bodies, relative to light that faces them; smaller: what is flat but for the eight bits of its
/// normals (off by up to 0.007), or a wall of two triangles that are not quite in one plane, pays for lifts.
const FLAT: f32 = 0.01;
/// Part of the lift that leads to the surface itself.
const ROUND: f32 = 0.5;
/// Cosines between a facet and a normal: down to the first it counts as part of something round, from the second on as
/// the side of a box. A ring of eight sides has 0.92, one of six 0.87, a cube 0.58.
const BOXY: [f32; 2] = [0.82, 0.71];
/// Distance between the unit normals that differ most, over the largest distance of one from the facet's: up to the first
/// they lean together, from the second on they bend around something. Triangles of round bodies have 1.7 to 2, one with a
/// single bent normal has 1.
const ALIKE: [f32; 2] = [0.4, 0.8];
/// How much farther than the offset the way must be free, so that a start never lies on what ends it.
const MARGIN: f32 = 1.01;

/// A triangle that stands for a part of a convex surface, on one of its sides.
#[derive(Debug, Clone, Copy)]
pub struct Lift {
    /// From the first corner [m].
    corners: [Vec3; 3],
    /// On the side of the facet.
    normals: [Vec3; 3],
    /// How much of the offset by each normal counts.
    round: [f32; 3],
}

impl Lift {
    /// Prepares one side of a triangle; `facing` is its unit normal there. `None` for triangles that are flat or concave.
    #[must_use]
    pub fn new(scene: &Scene, triangle: u32, facing: Vec3) -> Option<Self> {
        if scene.part(triangle).flat {
            return None;
        }
        let [a, b, c] = scene.corners(triangle);
        let corners = [Vec3::ZERO, b - a, c - a];
        let side = if scene.geometric_normal(triangle).dot(facing) < 0.0 { -1.0 } else { 1.0 };
        let normals = scene.corner_normals(triangle).map(|n| n * side);
        let bend = bend(&normals, facing);
        let round = normals.map(|n| ((n.dot(facing) - BOXY[1]) / (BOXY[0] - BOXY[1])).clamp(0.0, 1.0) * bend);
        let bends = |k: usize, j: usize| {
            let edge = corners[k] - corners[j];
            round[k] > 0.0 && edge.dot(normals[k]) > FLAT * edge.length()
        };
        let bent = (0..3).any(|k| bends(k, (k + 1) % 3) || bends(k, (k + 2) % 3));
        bent.then_some(Self { corners, normals, round })
    }

    /// From a point of the facet to the mixed tangent planes [m].
    fn at(&self, b: Vec2) -> Vec3 {
        let weights = [1.0 - b.x - b.y, b.x, b.y];
        let point = self.corners[1] * b.x + self.corners[2] * b.y;
        let one = |k: usize| {
            let below = (self.corners[k] - point).dot(self.normals[k]).max(0.0);
            self.normals[k] * (weights[k] * below * self.round[k])
        };
        one(0) + one(1) + one(2)
    }
}

/// How much the normals bend around something, rather than lean together, in [0, 1].
fn bend(normals: &[Vec3; 3], facing: Vec3) -> f32 {
    let spread = (0..3).map(|k| normals[k].distance(normals[(k + 1) % 3])).fold(0.0, f32::max);
    let lean = normals.iter().map(|n| n.distance(facing)).fold(f32::MIN_POSITIVE, f32::max);
    ((spread / lean - ALIKE[0]) / (ALIKE[1] - ALIKE[0])).clamp(0.0, 1.0)
}

impl Tracer<'_> {
    /// Origin for a ray that leaves a triangle at `b` toward a unit direction above its shading normal; `None` if the
    /// direction leads into the body. `facing` is the normal of the side that is left; without a lift this is
    /// [`Tracer::leave`].
    #[must_use]
    #[inline]
    pub fn leave_smooth(
        &self,
        ground: &Ground,
        lift: Option<&Lift>,
        b: Vec2,
        direction: Vec3,
        facing: Vec3,
    ) -> Option<Vec3> {
        let elevation = facing.dot(direction);
        let lifted = lift.filter(|_| elevation < GRAZING).and_then(|lift| {
            let amount = (1.0 - elevation / GRAZING).min(1.0);
            self.raise(ground, b, facing, lift.at(b) * amount)
        });
        lifted.or_else(|| (elevation > 0.0).then(|| self.leave(ground, b, direction)))
    }

    /// Where the smooth surface lies above a point of a facet at `position`, unless something is in between [m].
    #[must_use]
    pub fn smooth_position(&self, ground: &Ground, lift: &Lift, b: Vec2, facing: Vec3, position: Vec3) -> Vec3 {
        let offset = lift.at(b) * ROUND;
        if self.raise(ground, b, facing, offset).is_some() { position + offset } else { position }
    }

    /// The point at an offset from the start of rays on the facet; `None` if that is where they start, or cannot be
    /// reached.
    fn raise(&self, ground: &Ground, b: Vec2, facing: Vec3, offset: Vec3) -> Option<Vec3> {
        let start = self.leave(ground, b, facing);
        let raised = start + offset;
        (raised != start && self.segment_clear(start, start + offset * MARGIN)).then_some(raised)
    }
}
