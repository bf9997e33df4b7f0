//! The light at a point of a patch, by one look at everything that shines.
//!
//! In: a patch, a point of it, random numbers. Out: its direct irradiance, and where a ray by cosine goes on from there.

use super::Emitters;
use super::look::Look;
use crate::base::{Frame, Rgb, Stream, warp};
use crate::patches::{Looked, Patches, SurfacePoint};
use crate::trace::{Ray, Tracer};
use glam::Vec2;

/// Looks at points.
pub struct Probe<'a> {
    look: Look<'a>,
}

impl<'a> Probe<'a> {
    /// Nothing seen yet.
    #[must_use]
    pub fn new(tracer: &'a Tracer<'a>, patches: &'a Patches, emitters: &'a Emitters) -> Self {
        Self { look: Look::new(tracer, patches, emitters, false) }
    }

    /// Looks once at each light that is looked at by itself, at one of those at a finite distance, and at the sky.
    #[must_use]
    pub fn at(&self, patch: usize, point: SurfacePoint, random: &mut Stream) -> Looked {
        let mut look = self.look.clone();
        let emitters = look.emitters;
        let place = look.place(patch, point, &mut None);
        let mut square = || Vec2::new(random.next_f32(), random.next_f32());
        let mut direct = Rgb::ZERO;
        for light in emitters.hard.iter().chain(&emitters.suns) {
            direct += look.light(&place, light, square()).all;
        }
        if emitters.has_finite() {
            let mut cut = emitters.cut(&place.site());
            let (pick, u) = (f64::from(square().x), square());
            if !cut.is_empty() {
                direct += look.finite(&place, &mut cut, pick, u, None).all;
            }
        }
        if !emitters.infinity.is_black() {
            let (pick, u) = (f64::from(square().x), square());
            direct += look.infinity(&place, None, pick, u, 0.0).all;
        }
        let direction = Frame::from_normal(place.normal()).to_world(warp::square_to_cosine_hemisphere(square()));
        let onward = look.leave(&place, direction).map(|(_, origin)| Ray { origin, direction, t_max: f32::INFINITY });
        Looked { direct, onward, normal: place.normal(), rays: look.rays }
    }
}
