//! What short segments over a texel cross: only what is near can be crossed, so no segment need be traced.
//!
//! In: triangles near a texel. Out: whether a segment is clear, as [`Tracer::segment_clear`] has it.
//!
//! Limits: with many triangles near, or with transparent ones, segments are traced after all.

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
        let passes_by = |near: &&Near| {
            let [low, high] = near.bounds;
            let [corner, normal] = near.plane;
            let [a, b] = [from, to].map(|end| (end - corner).dot(normal));
            Some(near.triangle) == known
                || low.cmpgt(from.max(to)).any()
                || high.cmplt(from.min(to)).any()
                || a.min(b) > self.pad
                || a.max(b) < -self.pad
        };
        let Some(near) = &self.triangles else { return tracer.segment_clear(from, to) };
        let close = || near.iter().filter(|near| !passes_by(near)).map(|near| near.triangle);
        if close().any(|t| !tracer.scene().material(t).is_opaque()) {
            return tracer.segment_clear(from, to);
        }
        tracer.segment_misses([from, to], close())
    }
}
