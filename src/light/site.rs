//! Where light is looked for: a texel as one position, radius and normal, for choices among emitters.
//!
//! Invariant: what says that nothing can arrive says so for every point of the texel.

use super::piece::FLOOR;
use glam::Vec3;

/// Cosine between the normals of a texel from which it counts as flat.
const FLAT: f32 = 0.9999;
/// Least elevation that is assumed where the surface bends: some of it faces what its mean does not.
const BENT: f32 = 0.3;

/// A texel seen from afar.
#[derive(Debug, Clone, Copy)]
pub(super) struct Site {
    pub(super) position: Vec3,
    pub(super) normal: Vec3,
    /// All points of the texel are within this distance of the position [m].
    pub(super) radius: f32,
    /// All normals are the same.
    pub(super) flat: bool,
}

impl Site {
    /// The site of some positions with normals, around a centre; `edge` is the texel's [m].
    pub(super) fn new(position: Vec3, normal: Vec3, edge: f32, points: &[(Vec3, Vec3)]) -> Self {
        let far = points.iter().map(|(p, _)| p.distance(position)).fold(0.0, f32::max);
        let flat = points.iter().all(|(_, n)| n.dot(normal) > FLAT);
        // The points are centres of quarters, so the corners are twice as far away.
        Self { position, normal, radius: (2.0 * far).max(0.75 * edge), flat }
    }

    /// Some point of a convex shape with these corners may be above the horizon of some point of the texel.
    pub(super) fn can_see(&self, corners: &[Vec3]) -> bool {
        !self.flat || corners.iter().any(|c| (*c - self.position).dot(self.normal) > -self.radius)
    }

    /// Cosine of a unit direction to the normal, at least a little.
    pub(super) fn elevation(&self, toward: Vec3) -> f32 {
        toward.dot(self.normal).max(if self.flat { FLOOR } else { BENT })
    }
}
