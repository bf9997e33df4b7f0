//! Start points for rays that leave a surface.
//!
//! In: corners of the triangle, barycentric weights, direction. Out: an f32 point strictly on the side that the
//! direction points to.
//!
//! Source: Pharr, Jakob, Humphreys, "Physically Based Rendering", 4th ed., §6.8.6 (push along the normal by a bound of
//! the rounding error, then round away). Where we differ, and why: the position is interpolated in f64, so its own
//! error is nil, and what has to be bounded is
//! * the rounding of the result to f32: at most one step per axis;
//! * the rounding of the corners of a flat surface, half a step per axis here and half in the neighbouring triangle,
//!   since a wall that is not axis-parallel is only flat up to that;
//! * the error of the triangle test: under 2⁻⁴⁸ of the largest coordinate, as its f64 sums have fewer than 32 roundings
//!   of 2⁻⁵³ each. This keeps the start of rays off planes through zero, where the f32 steps vanish.
//!
//! A ray to a point off another triangle ends there by its length, whose rounding grows with it, and not with how near the
//! triangle lies to a plane through zero: rounded to the nearest step, ways of 4 m to a lamp 4 mm from such a plane ended
//! behind it for whole bands of texels, and a room was a quarter too dark. [`Ground::way`] rounds it toward the start.
//!
//! Points within [`INSET`] steps of an edge are moved inward: a ray that starts exactly in the corner of a room would
//! otherwise start on its wall, and 0 < t lets it pass.
//!
//! Symbols: n unit normal, toward the side the ray leaves to; `ulp_k` spacing of f32 at the triangle's largest
//! coordinate on axis k.
//!
//! Invariant: n·(result − plane) ≥ `Σ |n_k| ulp_k` + 2⁻⁴⁶ reach. Limit: where the neighbours of a rounded flat surface
//! tilt toward the ray by more than its own elevation angle (about ulp/edge length), it meets them: they are there.

use glam::{DVec3, Vec2, Vec3};

/// Distance from the edges, in steps of the largest coordinate. Smaller: the push (up to 4 steps) leaves a room through
/// a wall that leans over the floor; larger: visible shifts on tiny triangles far from the world's origin.
const INSET: f64 = 8.0;
/// Four times the error bound of the triangle test, as part of the largest coordinate of the scene.
const TEST_ERROR: f64 = 1.0 / (1u64 << 46) as f64;

/// A triangle prepared for the starts of many rays; see [`super::Tracer::leave`].
#[derive(Debug, Clone, Copy)]
pub struct Ground {
    corners: [DVec3; 3],
    centroid: DVec3,
    normal: DVec3,
    /// Part of the push that does not depend on the scene [m].
    push: f64,
    /// Least barycentric weight of each corner: [`INSET`] steps from the opposite edge, or as far as a small triangle
    /// allows.
    least: [f64; 3],
}

impl Ground {
    /// Prepares a triangle with these corners [m].
    #[must_use]
    pub fn new(corners: [Vec3; 3]) -> Self {
        let size = corners[0].abs().max(corners[1].abs()).max(corners[2].abs());
        let ulp = DVec3::from_array(size.to_array().map(|s| f64::from(s.next_up()) - f64::from(s)));
        let p = corners.map(|c| c.as_dvec3());
        let cross = (p[1] - p[0]).cross(p[2] - p[0]);
        let normal = cross.normalize_or_zero();
        let (double_area, distance) = (cross.length(), INSET * ulp.max_element());
        let edges = [p[1].distance(p[2]), p[2].distance(p[0]), p[0].distance(p[1])];
        // The corner's distance from the opposite edge is double_area/edge.
        let least = edges.map(|e| if double_area > 0.0 { (distance * e / double_area).min(1.0 / 3.0) } else { 0.0 });
        Self { corners: p, centroid: (p[0] + p[1] + p[2]) / 3.0, normal, push: 2.0 * normal.abs().dot(ulp), least }
    }

    /// Unit normal of the front; zero for a triangle without area.
    #[must_use]
    pub fn normal(&self) -> Vec3 {
        self.normal.as_vec3()
    }

    /// `reach` is the largest absolute coordinate of the scene [m].
    #[inline]
    pub(super) fn leave(&self, b: Vec2, direction: Vec3, reach: f64) -> Vec3 {
        let p = &self.corners;
        let weights = self.inset(b);
        let position = p[0] * weights[0] + p[1] * weights[1] + p[2] * weights[2];
        let normal = if self.normal.dot(direction.as_dvec3()) < 0.0 { -self.normal } else { self.normal };
        let target = position + normal * (self.push + TEST_ERROR * reach);
        let axis = |k: usize| {
            // Across the surface: away from it. Along it: inward, so that no corner point lands on the wall beside it.
            let toward = if normal[k].abs() > 0.5 { normal[k] } else { self.centroid[k] - position[k] };
            round_toward(target[k], toward)
        };
        Vec3::new(axis(0), axis(1), axis(2))
    }

    /// The way from `origin` to a point off this triangle: added to `origin`, it ends there or a little farther off.
    #[must_use]
    #[inline]
    pub fn way(&self, origin: Vec3, target: Vec3) -> Vec3 {
        let way = target.as_dvec3() - origin.as_dvec3();
        let normal = if self.normal.dot(way) > 0.0 { -self.normal } else { self.normal };
        let axis = |k: usize| round_toward(way[k], normal[k]);
        Vec3::new(axis(0), axis(1), axis(2))
    }

    fn inset(&self, b: Vec2) -> [f64; 3] {
        let b = b.as_dvec2();
        let [a, b, c] = [1.0 - b.x - b.y, b.x, b.y];
        // Nearly all points, which add up to 1 as they are.
        if a >= self.least[0] && b >= self.least[1] && c >= self.least[2] {
            return [a, b, c];
        }
        let inside = [a.max(self.least[0]), b.max(self.least[1]), c.max(self.least[2])];
        let sum = inside[0] + inside[1] + inside[2];
        inside.map(|w| w / sum)
    }
}

/// The f32 next to `value` in the direction of the sign of `toward`; the nearest one if `toward` is 0.
///
/// Chosen by masks: which way the nearest one was rounded is a coin toss, and with two starts for every shadow ray that is
/// six of them, too many for branches.
#[inline]
fn round_toward(value: f64, toward: f64) -> f32 {
    let nearest = value as f32;
    let (up, down) = ((toward > 0.0) & (f64::from(nearest) < value), (toward < 0.0) & (f64::from(nearest) > value));
    let [up_mask, down_mask] = [up, down].map(|is| u32::from(is).wrapping_neg());
    let bits = nearest.next_up().to_bits() & up_mask
        | nearest.next_down().to_bits() & down_mask
        | nearest.to_bits() & !(up_mask | down_mask);
    f32::from_bits(bits)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounding_goes_the_right_way() {
        let third = 1.0 / 3.0;
        assert!(f64::from(round_toward(third, 1.0)) > third);
        assert!(f64::from(round_toward(third, -1.0)) < third);
        assert_eq!(round_toward(third, 0.0), third as f32);
        assert_eq!(round_toward(0.5, 1.0), 0.5);
        assert!(round_toward(-third, 1.0) > -(third as f32).next_up());
    }

    #[test]
    fn inner_points_stay_where_they_are() {
        let corners = [Vec3::new(0.0, 2.0, 0.0), Vec3::new(0.0, 2.0, 1.0), Vec3::new(1.0, 2.0, 0.0)];
        let o = Ground::new(corners).leave(Vec2::new(0.25, 0.25), Vec3::Y, 2.0);
        assert_eq!((o.x, o.z), (0.25, 0.25));
        let step = 2.0f32.next_up() - 2.0;
        assert!(o.y > 2.0 && o.y <= 2.0 + 4.0 * step, "{}", o.y);
        let below = Ground::new(corners).leave(Vec2::new(0.25, 0.25), Vec3::new(1.0, -1e-6, 0.0), 2.0);
        assert!(below.y < 2.0 && below.y >= 2.0 - 4.0 * step, "{}", below.y);
    }

    #[test]
    fn a_plane_through_zero_is_left_by_next_to_nothing() {
        let corners = [Vec3::ZERO, Vec3::Z * 10.0, Vec3::X * 10.0];
        let o = Ground::new(corners).leave(Vec2::new(0.3, 0.3), Vec3::Y, 10.0);
        assert!(o.y > 0.0 && o.y < 1e-12, "{}", o.y);
    }

    #[test]
    fn ways_end_before_what_they_lead_to() {
        for step in 1..400 {
            let z = step as f32 * 2.5e-4;
            let ground = Ground::new([Vec3::new(0.0, 1.0, z), Vec3::new(1.0, 1.0, z), Vec3::new(0.0, 2.0, z)]);
            let from = Vec3::new(1.7, 0.1, 3.0 + step as f32 * 2.3e-3);
            let target = ground.leave(Vec2::splat(0.3), Vec3::Z, 5.0);
            let way = ground.way(from, target);
            let [end, rounded] = [way, target - from].map(|way| f64::from(from.z) + f64::from(way.z) - f64::from(z));
            assert!(end > 0.0 && end < 1e-6, "{z}: ends {end} m off");
            assert!(step != 16 || rounded < 0.0, "the nearest step does as well: {rounded} m");
        }
    }

    #[test]
    fn triangles_without_area_give_their_own_points() {
        let o = Ground::new([Vec3::ONE; 3]).leave(Vec2::new(0.3, 0.3), Vec3::Y, 1.0);
        assert!((o - Vec3::ONE).length() < 1e-6);
    }
}
