//! Whether anybody gets to see a place of the surface.
//!
//! In: [`Subject`] and a point. Out: yes or no. Rays look from the point into the open, by cosine, also from the back of
//! what is double-sided. Where next to none goes farther than a camera could be away, no picture shows the place: it lies
//! in a slit, behind books, or in a body whose parts go through each other, and what is wrong there is wrong for nobody.
//!
//! Limits: what can be seen from the inside of a body that is wider than that counts as seen.

use super::subject::Subject;
use crate::base::low_discrepancy::Sequence;
use crate::base::{Frame, warp};
use crate::patches::{SurfacePoint, narrow};
use crate::trace::{Ground, Ray};
use glam::{Vec2, Vec3};

/// Rays from either side, and how many must go far: one in 16, as at the bottom of a slit that is eight times as deep as
/// wide, or between plates a quarter of that apart.
const LOOKS: u32 = 64;
const LEAST_OPEN: usize = 4;

/// Part of the scene's diagonal within which a camera may be nearer than anywhere else: things for the palm of a hand have
/// their own idea of a metre.
const OF_SCENE: f32 = 0.25;

impl Subject<'_> {
    /// Nobody gets to see the point: surfaces closer than a narrow gap is wide cover the view.
    pub(super) fn is_hidden(&self, point: SurfacePoint) -> bool {
        let two_sided = self.scene.material(point.triangle).is_two_sided();
        let ground = Ground::new(self.scene.corners(point.triangle));
        let (low, high) = self.tracer.bounds();
        let reach = narrow(self.texel_edge(point.triangle)).min(OF_SCENE * low.distance(high));
        let hidden = |normal: Vec3| {
            let (frame, sequence) = (Frame::from_normal(normal), Sequence::new(u64::from(point.triangle)));
            let is_open = |k: &u32| {
                let [u, v, ..] = sequence.point(*k);
                let direction = frame.to_world(warp::square_to_cosine_hemisphere(Vec2::new(u, v)));
                let origin = self.tracer.leave(&ground, point.b, direction);
                !self.tracer.occluded(&Ray { origin, direction, t_max: reach })
            };
            (0..LOOKS).filter(is_open).nth(LEAST_OPEN - 1).is_none()
        };
        hidden(ground.normal()) && (!two_sided || hidden(-ground.normal()))
    }
}
