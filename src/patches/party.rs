//! Walls without thickness: two surfaces back to back, each with its front to a room of its own, are the two sides of one
//! wall, though each is cut into other triangles. They lie on each other face to face as a crate and the floor do, but no
//! solid has either of them around it.
//!
//! In: texels that something lies on, and solids. Out: [`PartyWalls`], the pairs of triangles that seal nothing.
//!
//! From points where one of the two lies on the other, rays go to both sides, and on to infinity. Above a floor that a crate
//! stands on they leave the crate; in the two rooms beside a wall they leave nothing. Many rooms wall to wall and many crates
//! on each other are the same but for their outermost faces, so what a ray meets first does not tell. Taken for contacts,
//! walls between two rooms had no light of their own on either side.
//!
//! Limits: told for a pair of triangles as a whole. What is left open on the side of a crate's floor, so that most rays that
//! start below it leave it, counts as a room.

use super::SurfacePoint;
use super::facing::Contact;
use super::solids::{PROBES, Solids, bounds_solids, rays_out};
use crate::base::parallel;
use crate::scene::Scene;
use crate::trace::{Ground, Tracer, weights_at};
use std::collections::{BTreeMap, BTreeSet};

/// Points that are looked at of two triangles.
const MOST_POINTS: usize = 4;
/// Of so many rays one may seem to leave a solid, to either side: through the back of a curtain, or what stands before the
/// wall.
const ONE_OUT_OF: u32 = 4;

/// Pairs of triangles that are the two sides of a wall.
#[derive(Debug, Default)]
pub(super) struct PartyWalls {
    /// Triangles in ascending order.
    pairs: BTreeSet<[u32; 2]>,
    /// All triangles of them.
    sides: BTreeSet<u32>,
}

impl PartyWalls {
    /// Two triangles are such a pair.
    pub(super) fn has(&self, pair: [u32; 2]) -> bool {
        !self.pairs.is_empty() && self.pairs.contains(&sorted(pair))
    }

    /// What lies on a point face to face, and is not the other side of the wall that its triangle is one side of.
    pub(super) fn sealed_by(&self, tracer: &Tracer<'_>, ground: &Ground, point: SurfacePoint) -> Option<u32> {
        tracer.sealed_by(ground, point.triangle, point.b, |other| !self.has([point.triangle, other]))
    }

    /// A triangle belongs to one.
    pub(super) fn has_side(&self, triangle: u32) -> bool {
        !self.sides.is_empty() && self.sides.contains(&triangle)
    }

    /// Triangles that belong to one, ascending.
    pub(super) fn sides(&self) -> impl Iterator<Item = u32> + '_ {
        self.sides.iter().copied()
    }

    /// Number of pairs.
    pub(super) fn len(&self) -> usize {
        self.pairs.len()
    }

    /// Of all triangles that belong to one [m²].
    pub(super) fn area(&self, scene: &Scene) -> f64 {
        self.sides.iter().map(|&triangle| scene.area(triangle)).sum()
    }

    /// Those among what lies on texels.
    pub(super) fn among<'a>(solids: Solids<'_>, contacts: impl Iterator<Item = &'a Contact>) -> Self {
        let mut points = BTreeMap::<[u32; 2], Vec<SurfacePoint>>::new();
        let scene = solids.tracer.scene();
        for contact in contacts.filter(|contact| contact.pair().iter().all(|&t| is_opaque_side(scene, t))) {
            points.entry(contact.pair()).or_default().push(contact.point);
        }
        let points: Vec<_> = points.into_iter().collect();
        let are_rooms = parallel::map(points.len(), |k| are_rooms(solids, points[k].0, &points[k].1));
        let rooms = points.iter().zip(are_rooms).filter(|(_, yes)| *yes);
        let pairs: BTreeSet<_> = rooms.map(|((pair, _), _)| sorted(*pair)).collect();
        let sides = pairs.iter().flatten().copied().collect();
        Self { pairs, sides }
    }

    /// Takes over the pairs of another set.
    pub(super) fn extend(&mut self, other: Self) {
        self.pairs.extend(other.pairs);
        self.sides.extend(other.sides);
    }
}

fn sorted([a, b]: [u32; 2]) -> [u32; 2] {
    [a.min(b), a.max(b)]
}

/// A triangle has one side and lets no light through.
fn is_opaque_side(scene: &Scene, triangle: u32) -> bool {
    let material = scene.material(triangle);
    bounds_solids(material) && material.is_opaque()
}

/// Neither of two triangles lies in a solid where the second lies on points of the first.
fn are_rooms(solids: Solids<'_>, [triangle, other]: [u32; 2], points: &[SurfacePoint]) -> bool {
    let scene = solids.tracer.scene();
    let step = points.len().div_ceil(MOST_POINTS).max(1);
    let (mut out, mut asked) = ([0; 2], 0);
    for point in points.iter().step_by(step) {
        let opposite = SurfacePoint { triangle: other, b: weights_at(scene, other, scene.position(triangle, point.b)) };
        for (out, side) in out.iter_mut().zip([*point, opposite]) {
            *out += rays_out(solids, side);
        }
        asked += PROBES;
    }
    out.iter().all(|out| out * ONE_OUT_OF <= asked)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_have_no_order() {
        let walls = PartyWalls { pairs: [[3, 8]].into(), sides: [3, 8].into() };
        assert!(walls.has([3, 8]) && walls.has([8, 3]));
        assert!(walls.has_side(8) && !walls.has_side(4));
        assert!(!walls.has([3, 3]) && !PartyWalls::default().has([3, 8]));
    }
}
