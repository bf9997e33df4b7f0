//! How open the surroundings of a chart smaller than a texel are, in a few steps.
//!
//! In: tracer, piece, distance. Out: the step of the share of [`RAYS`] cosine-distributed rays from its front that meet
//! nothing nearer than the distance. What shares a texel shares its light, and what stands open beside what lies in a gap
//! does not have the same: keys of a keyboard were as dark as the gaps between them.
//!
//! Invariant: depends on the piece and on what is nearer than the distance alone; the same at any thread count.
//!
//! Error of the share: below 0.5/√RAYS = 0.09, less than a step.

use super::align::Piece;
use crate::base::Frame;
use crate::base::distribution::Running;
use crate::base::low_discrepancy::Sequence;
use crate::base::random::{Stage, mix};
use crate::base::warp::square_to_cosine_hemisphere;
use crate::base::warp::square_to_triangle;
use crate::trace::Ray;
use crate::trace::Tracer;
use glam::Vec2;

/// Rays of a chart.
const RAYS: u32 = 32;

/// Steps that are told apart.
const STEPS: u32 = 8;

/// The step in which a piece of one part lies, seen as far as `distance` [m]; 0 is closed in.
pub(super) fn openness(tracer: &Tracer<'_>, piece: &Piece, distance: f32) -> u8 {
    let scene = tracer.scene();
    let first = scene.parts[piece.owners[0][0] as usize].triangles.start;
    let faces: Vec<u32> = piece.faces.iter().map(|face| first + face.triangle).collect();
    let areas = Running::new(faces.iter().map(|t| scene.area(*t) as f32));
    let sequence = Sequence::new(mix((Stage::Openness as u64) << 56 | u64::from(piece.faces[0].triangle)));
    let is_open = |k: &u32| {
        let [x, y, u, v] = sequence.point(*k);
        let Some((i, y)) = areas.sample(y) else { return false };
        let direction = square_to_cosine_hemisphere(Vec2::new(u, v));
        let direction = Frame::from_normal(scene.geometric_normal(faces[i])).to_world(direction);
        let origin = tracer.origin_on(faces[i], square_to_triangle(Vec2::new(x, y)), direction);
        !tracer.occluded(&Ray { origin, direction, t_max: distance })
    };
    let open = (0..RAYS).filter(is_open).count() as u32;
    (open * STEPS / RAYS).min(STEPS - 1) as u8
}
