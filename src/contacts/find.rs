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
    let clipped = lines.filter_map(|[a, b]| clip(flat, [plane.at(a), plane.at(b)], MARGIN * tolerance));
    clipped.filter(|[a, b]: &[DVec2; 2]| a.distance(*b) > 2.0 * tolerance).collect()
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
