//! Lines on a triangle where other surfaces meet its front.
//!
//! * A surface that crosses the triangle's plane: where it does.
//! * A surface that stands on it: its edge that lies in the plane, where the surface rises from there to the front.
//! * A surface that lies on it face to face: the outline of that surface.
//!
//! A surface that hangs together with the triangle over a whole side is no contact, unless another one goes on there: the
//! foot of a wall that stands where two triangles of a floor meet.

use super::Segment;
use super::mesh::Mesh;
use super::plane::{Plane, clip};
use crate::trace::Tracer;
use glam::{DVec2, DVec3};

/// Cosine up to which surfaces lie face to face.
const FACING: f64 = -0.98;

/// How far lines may reach beyond a triangle, in tolerances: less than one, so that ends out there move to its sides.
pub(super) const MARGIN: f64 = 0.5;

/// Length of a line up to which it is none, in tolerances.
const SHORT: f64 = 2.0;

/// Contacts with the front of a triangle, clipped to it.
pub(super) fn contacts(tracer: &Tracer<'_>, mesh: &Mesh<'_>, triangle: u32, tolerance: f64) -> Vec<Segment> {
    if !mesh.is_cut(triangle) {
        return vec![];
    }
    let Some((plane, flat)) = mesh.flat(triangle) else { return vec![] };
    let corners = mesh.scene.corners(triangle);
    let pad = glam::Vec3::splat(2.0 * tolerance as f32);
    let low = corners[0].min(corners[1]).min(corners[2]) - pad;
    let high = corners[0].max(corners[1]).max(corners[2]) + pad;
    let mut near = vec![];
    tracer.any_within(low, high, |other| {
        if other != triangle && mesh.is_opaque(other) {
            near.push(other);
        }
        false
    });
    near.sort_unstable();
    near.dedup();
    let own = Own { mesh, triangle, plane, tolerance };
    let lines = near.into_iter().flat_map(|other| own.lines(other));
    lines.filter_map(|[a, b]| part_on(flat, [plane.at(a), plane.at(b)], tolerance)).collect()
}

/// The part of a line that lies on a triangle, or along a side of it and at most [`MARGIN`] beyond.
///
/// Beyond a side that a line crosses, it is none: both triangles at the side then find one point there. Moved to the side from
/// beyond it, the points of the two lay up to 3.5 mm apart, with needles as long as the face between them. Where a line
/// along the top of a face touches the lower half of it in a corner, the same made a needle of what was within the margin
/// (office: 449 of 6,752 triangles below 0.2 mm, and charts of 0.4 m × 0.05 mm).
pub(super) fn part_on(flat: [DVec2; 3], line: Segment, tolerance: f64) -> Option<Segment> {
    let margin = MARGIN * tolerance;
    let long = |[a, b]: Segment| a.distance(b) > SHORT * tolerance;
    let beside = |part: Segment| long(part) && is_beside(flat, part, margin);
    let [a, b] = clip(flat, line, margin)?;
    let Some([p, q]) = clip(flat, line, 0.0).filter(|part| long(*part)) else {
        return beside([a, b]).then_some([a, b]);
    };
    Some([if beside([a, p]) { a } else { p }, if beside([q, b]) { b } else { q }])
}

/// Some side of a triangle is as near to both ends of a line, up to half the margin.
fn is_beside(flat: [DVec2; 3], line: Segment, margin: f64) -> bool {
    (0..3).any(|k| {
        let inward = (flat[(k + 1) % 3] - flat[k]).perp().normalize_or_zero();
        let [c, d] = line.map(|p| (p - flat[k]).dot(inward));
        c.abs().max(d.abs()) <= 2.0 * margin && (c - d).abs() <= 0.5 * margin
    })
}

/// The triangle that is looked at.
struct Own<'a> {
    mesh: &'a Mesh<'a>,
    triangle: u32,
    plane: Plane,
    tolerance: f64,
}

impl Own<'_> {
    /// Where another triangle meets the plane.
    fn lines(&self, other: u32) -> Vec<[DVec3; 2]> {
        let corners = self.mesh.corners(other);
        let height = corners.map(|p| self.plane.height(p));
        let on = height.map(|h| h.abs() <= self.tolerance);
        match on.iter().filter(|on| **on).count() {
            3 => self.outline(other, corners),
            2 => self.foot(other, corners, height, on),
            _ => self.crossing(corners, height, on).into_iter().collect(),
        }
    }

    fn crossing(&self, corners: [DVec3; 3], height: [f64; 3], on: [bool; 3]) -> Option<[DVec3; 2]> {
        let mut points: Vec<DVec3> = (0..3).filter(|&k| on[k]).map(|k| corners[k]).collect();
        for k in 0..3 {
            let l = (k + 1) % 3;
            if !on[k] && !on[l] && (height[k] > 0.0) != (height[l] > 0.0) {
                // From the lower end, so that both triangles at the edge find the same point.
                let (a, b) = if height[k] < height[l] { (k, l) } else { (l, k) };
                points.push(corners[a].lerp(corners[b], height[a] / (height[a] - height[b])));
            }
        }
        if let [a, b] = points[..] { Some([a, b]) } else { None }
    }

    fn foot(&self, other: u32, corners: [DVec3; 3], height: [f64; 3], on: [bool; 3]) -> Vec<[DVec3; 2]> {
        let Some(apex) = (0..3).find(|&k| !on[k]) else { return vec![] };
        let side = (apex + 1) % 3;
        if height[apex] <= 0.0 || !self.counts(other, side) {
            return vec![];
        }
        vec![[corners[side], corners[(side + 1) % 3]]]
    }

    /// A side that both triangles have counts where the surface goes on beyond it with a third one.
    fn counts(&self, other: u32, side: usize) -> bool {
        let sorted = |[a, b]: [u32; 2]| [a.min(b), a.max(b)];
        let foot = sorted(self.mesh.ends(other, side));
        let shared = (0..3).find(|&k| sorted(self.mesh.ends(self.triangle, k)) == foot);
        shared.is_none_or(|k| self.mesh.goes_on(self.triangle, k, self.plane.normal).any(|third| third != other))
    }

    fn outline(&self, other: u32, corners: [DVec3; 3]) -> Vec<[DVec3; 2]> {
        if !self.faces(other) {
            return vec![];
        }
        let border = |&side: &usize| {
            let mut beyond = self.mesh.around(self.mesh.ends(other, side));
            !beyond.any(|next| next != other && self.faces(next)) && self.counts(other, side)
        };
        (0..3).filter(border).map(|side| [corners[side], corners[(side + 1) % 3]]).collect()
    }

    /// The other triangle lies in the plane and looks at this one.
    fn faces(&self, other: u32) -> bool {
        let corners = self.mesh.corners(other);
        let flat = corners.iter().all(|p| self.plane.height(*p).abs() <= self.tolerance);
        flat && Plane::new(corners).is_some_and(|p| p.normal.dot(self.plane.normal) < FACING)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TOLERANCE: f64 = 1e-4;

    fn on(flat: [[f64; 2]; 3], line: [[f64; 2]; 2]) -> Option<Segment> {
        part_on(flat.map(DVec2::from_array), line.map(DVec2::from_array), TOLERANCE)
    }

    #[test]
    fn lines_end_where_they_cross_a_side_for_both_triangles_at_it() {
        // The halves of a face, 2 cm wide and 1 m high, and a line across them.
        let [low, high] = [[[0.0, 0.0], [0.02, 0.0], [0.02, 1.0]], [[0.0, 0.0], [0.02, 1.0], [0.0, 1.0]]];
        let across = [[-1.0, 0.4], [1.0, 0.4]];
        let [[p, q], [r, s]] = [low, high].map(|half| on(half, across).unwrap());
        assert!(p.distance(s) < 1e-12 && p.distance(DVec2::new(0.008, 0.4)) < 1e-12, "{p} {s}");
        assert!(q.distance(DVec2::new(0.02, 0.4)) < 1e-12 && r.distance(DVec2::new(0.0, 0.4)) < 1e-12);
        // Along the top: the lower half has but a corner of it.
        let top = [[-1.0, 1.0], [1.0, 1.0]];
        assert_eq!(on(low, top), None);
        assert!(on(high, top).is_some_and(|[a, b]| (a.distance(b) - 0.02).abs() < 2.0 * TOLERANCE));
    }

    #[test]
    fn lines_along_a_side_count_within_the_margin() {
        let flat = [[0.0, 0.0], [2.0, 0.0], [0.0, 1.0]];
        for y in [-0.4, -1e-3, 0.0, 1e-3, 0.4] {
            for slope in [0.0, 1e-3, -1e-3] {
                let [a, b] = [y * TOLERANCE, (y + slope) * TOLERANCE];
                let part = on(flat, [[0.5, a], [1.0, b]]);
                assert!(part.is_some_and(|[a, b]| (a.distance(b) - 0.5).abs() < 1e-9), "{y} {slope}: {part:?}");
            }
        }
        assert_eq!(on(flat, [[0.5, -0.6 * TOLERANCE], [1.0, -0.6 * TOLERANCE]]), None);
        assert_eq!(on(flat, [[0.5, 0.5], [0.5, 0.5 + TOLERANCE]]), None);
    }
}
