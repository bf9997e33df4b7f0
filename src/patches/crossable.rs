//! What short segments over a texel may cross: most cross nothing, and are not traced then.
//!
//! In: triangles near a texel. Out: whether a segment can be told to be clear.
//!
//! Invariant: a segment that a triangle crosses is never told to be clear.

use crate::scene::Scene;
use crate::trace::Tracer;
use glam::Vec3;

/// Triangles up to which they are kept; with more, anything may be crossed.
const MOST: usize = 32;

/// The triangles near a texel.
pub(super) struct Crossable {
    /// `None` for too many, or where it is not known.
    triangles: Option<Vec<Near>>,
    /// Bound of the rounding of positions [m].
    pad: f32,
}

struct Near {
    triangle: u32,
    /// Lowest and highest coordinates [m].
    bounds: [Vec3; 2],
    /// A corner, and the normal.
    plane: [Vec3; 2],
}

impl Crossable {
    /// Anything may be crossed.
    pub(super) fn anything() -> Self {
        Self { triangles: None, pad: 0.0 }
    }

    /// Nothing yet; `pad` is a bound of rounding [m].
    pub(super) fn nothing(pad: f32) -> Self {
        Self { triangles: Some(vec![]), pad }
    }

    /// Anything may be crossed, whatever is added.
    pub(super) fn is_anything(&self) -> bool {
        self.triangles.is_none()
    }

    /// Adds a triangle.
    pub(super) fn add(&mut self, scene: &Scene, triangle: u32) {
        let Some(triangles) = &mut self.triangles else { return };
        if triangles.len() == MOST {
            self.triangles = None;
            return;
        }
        let [a, b, c] = scene.corners(triangle);
        let bounds = [a.min(b).min(c) - self.pad, a.max(b).max(c) + self.pad];
        triangles.push(Near { triangle, bounds, plane: [a, scene.geometric_normal(triangle)] });
    }

    /// Nothing lies between two points, other than a triangle that is known not to.
    pub(super) fn is_clear(&self, tracer: &Tracer<'_>, [from, to]: [Vec3; 2], known: Option<u32>) -> bool {
        let passes_by = |near: &Near| {
            let [low, high] = near.bounds;
            let [corner, normal] = near.plane;
            let [a, b] = [from, to].map(|end| (end - corner).dot(normal));
            Some(near.triangle) == known
                || low.cmpgt(from.max(to)).any()
                || high.cmplt(from.min(to)).any()
                || a.min(b) > self.pad
                || a.max(b) < -self.pad
        };
        self.triangles.as_ref().is_some_and(|near| near.iter().all(passes_by)) || tracer.segment_clear(from, to)
    }
}
