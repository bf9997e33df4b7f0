//! Punctual lights that stand right on a surface are moved off it, to the side that they are meant to light.
//!
//! In: tracer. Out: the lights of its scene.
//!
//! Lamps are put on ceilings at the ceiling's very height, and the products of turned nodes leave them a step of rounding
//! above or below. Above, the room was dark; on it bit by bit, the floor above had as much light as the room below.
//!
//! Single-sided surfaces are lit on their front. Of others a spot light lights the side that it points to; another lamp the
//! side on which more rays meet something, of two alike the front. A light is moved by [`ROUNDING`] of its largest
//! coordinate beyond what it may be off, micrometres, and does not light what it stands on ([`standing`]). Lights with a size
//! stay where they are.
//!
//! Limit: with `--direct shoot` half of the lines of such a lamp go to the other side.
//!
//! [`standing`]: super::punctual::standing

use super::punctual::ROUNDING;
use crate::base::{Frame, parallel, warp};
use crate::scene::{Light, Scene};
use crate::trace::{Ray, Tracer, weights_at};
use glam::{Vec2, Vec3};

/// Triangles up to which those near a light are looked at.
const MOST: usize = 64;
/// Rays to either side.
const RAYS: u32 = 32;

/// The lights of a scene, none of them on a surface.
#[must_use]
pub fn moved(tracer: &Tracer<'_>) -> Vec<Light> {
    let lights = &tracer.scene().lights;
    parallel::map(lights.len(), |k| off_surface(tracer, lights[k].clone()))
}

fn off_surface(tracer: &Tracer<'_>, mut light: Light) -> Light {
    let axis = if let Light::Spot { direction, .. } = light { Some(direction) } else { None };
    if let Light::Point { position, radius, .. }
    | Light::Spot { position, radius, .. }
    | Light::Profiled { position, radius, .. } = &mut light
        && *radius <= 0.0
    {
        *position += way_off(tracer, *position, axis);
    }
    light
}

/// From a point, off the surfaces that it is on [m].
fn way_off(tracer: &Tracer<'_>, point: Vec3, axis: Option<Vec3>) -> Vec3 {
    let (scene, reach) = (tracer.scene(), ROUNDING * point.abs().max_element());
    let mut near = vec![];
    tracer.any_within(point - reach, point + reach, |triangle| {
        near.push(triangle);
        near.len() == MOST
    });
    near.retain(|&triangle| distance(scene, triangle, point) <= reach);
    let Some(&first) = near.first() else { return Vec3::ZERO };
    let one_sided = near.iter().filter(|&&triangle| !scene.material(triangle).is_two_sided());
    let fronts = one_sided.map(|&triangle| scene.geometric_normal(triangle)).sum::<Vec3>().normalize_or_zero();
    let toward = if fronts == Vec3::ZERO {
        let normal = scene.geometric_normal(first);
        let [front, back] = [normal, -normal].map(|side| match axis {
            Some(axis) => u32::from(axis.dot(side) > 0.0),
            None => hits(tracer, point + side * (2.0 * reach), side),
        });
        if back > front { -normal } else { normal }
    } else {
        fronts
    };
    toward * (2.0 * reach)
}

/// From a point to the nearest of a triangle, about [m].
fn distance(scene: &Scene, triangle: u32, point: Vec3) -> f32 {
    point.distance(scene.position(triangle, weights_at(scene, triangle, point)))
}

/// Rays of a hemisphere that meet something.
fn hits(tracer: &Tracer<'_>, origin: Vec3, side: Vec3) -> u32 {
    let frame = Frame::from_normal(side);
    let meets = |k: u32| {
        let u = Vec2::new((k as f32 + 0.5) / RAYS as f32, (k as f32 * 0.618_034).fract());
        let direction = frame.to_world(warp::square_to_cosine_hemisphere(u));
        tracer.occluded(&Ray { origin, direction, t_max: f32::INFINITY })
    };
    (0..RAYS).map(|k| u32::from(meets(k))).sum()
}
