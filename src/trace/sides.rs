//! What is met of surfaces in the same place: of a wall without thickness that has a surface for each of its two sides, the one
//! that shows its front; of two that face the same way, one.
//!
//! In: a ray that meets a back first. Out: the front that lies in the same place, or the back.
//!
//! Where both surfaces have the same corners, or lie in a plane of two axes, their distances are equal and fronts come first
//! ([`traverse`](super::traverse)). Elsewhere they go through each other by the rounding of their corners, and a ray may meet
//! the back of the other room's wall a tenth of a micrometre before the front of its own. Two rooms turned by 27 and 11°
//! lost 1.5 % of their light to that, and up to a third in their corners.
//!
//! Only backs of single-sided surfaces that are known to be sides of walls are looked at again, as each costs a short ray; all
//! are in pictures. Limit: what lets light pass is no front to look for.

use super::{FACE_TO_FACE, Ground, Hit, NO_TRIANGLE, Ray, Tracer};
use crate::scene::Scene;
use glam::{Vec2, Vec3};

impl Tracer<'_> {
    /// The same, but of these triangles the backs are not met where a front lies on them: they are sides of walls.
    #[must_use]
    pub fn with_sides(mut self, triangles: impl Iterator<Item = u32>) -> Self {
        let words = self.scene.triangle_count().div_ceil(64);
        for triangle in triangles {
            self.sides.resize(words, 0);
            self.sides[triangle as usize / 64] |= 1 << (triangle % 64);
        }
        self
    }

    /// The same for all triangles. Each back that is met costs a short ray.
    #[must_use]
    pub fn with_any_sides(self) -> Self {
        Self { sides: vec![u64::MAX; self.scene.triangle_count().div_ceil(64)], ..self }
    }

    /// What is met instead of the nearest hit, if that is the back of such a triangle, by a ray that passes the triangle
    /// `passes`.
    #[inline]
    pub(super) fn side_met(&self, passes: u32, hit: Hit) -> Hit {
        let triangle = hit.triangle as usize;
        if hit.front || self.sides[triangle / 64] >> (triangle % 64) & 1 == 0 { hit } else { self.side_of(passes, hit) }
    }

    /// What lies on the back of a single-sided triangle at a hit of it, and is no triangle `passes`; or that hit.
    #[cold]
    fn side_of(&self, passes: u32, hit: Hit) -> Hit {
        if self.scene.material(hit.triangle).is_two_sided() {
            return hit;
        }
        let ground = Ground::new(self.scene.corners(hit.triangle));
        let counts = |other: u32| other != passes && self.scene.material(other).is_opaque();
        let front = self.sealed_by(&ground, hit.triangle, hit.b, counts);
        front.map_or(hit, |triangle| {
            let b = weights_at(self.scene, triangle, self.scene.position(hit.triangle, hit.b));
            Hit { triangle, b, front: true, ..hit }
        })
    }

    /// What rays toward a side of a triangle meet at a point instead of it, in the same place: surface that faces the same way.
    /// `None` where they meet the triangle itself.
    #[must_use]
    pub fn met_instead(&self, triangle: u32, b: Vec2, front: bool) -> Option<Hit> {
        let ground = Ground::new(self.scene.corners(triangle));
        let toward = if front { ground.normal() } else { -ground.normal() };
        let hit = self.nearest(self.through(&ground, b, toward)).filter(|hit| hit.triangle != triangle)?;
        let shows = hit.front || self.scene.material(hit.triangle).is_two_sided();
        let is_level = self.scene.geometric_normal(hit.triangle).dot(toward).abs() > -FACE_TO_FACE;
        (shows && is_level).then_some(hit)
    }

    /// What a ray meets, if the nearest hit is not the back of a wall that `is_side` says a triangle is a side of.
    #[must_use]
    pub fn closest_side(&self, ray: &Ray, is_side: impl Fn(u32) -> bool) -> Option<Hit> {
        let hit = self.closest_hit(ray)?;
        Some(if hit.front || !is_side(hit.triangle) { hit } else { self.side_of(NO_TRIANGLE, hit) })
    }
}

/// Barycentric weights of a triangle's vertices 1 and 2 at the point of it that is about nearest to a position [m]; zeros for
/// a triangle without area.
#[must_use]
pub fn weights_at(scene: &Scene, triangle: u32, position: Vec3) -> Vec2 {
    let [a, b, c] = scene.corners(triangle).map(|corner| corner.as_dvec3());
    let (u, v, p) = (b - a, c - a, position.as_dvec3() - a);
    let normal = u.cross(v);
    let scale = 1.0 / normal.length_squared().max(f64::MIN_POSITIVE);
    let [w1, w2] = [p.cross(v).dot(normal), u.cross(p).dot(normal)].map(|w| (w * scale).clamp(0.0, 1.0));
    let sum = (w1 + w2).max(1.0);
    Vec2::new((w1 / sum) as f32, (w2 / sum) as f32)
}
