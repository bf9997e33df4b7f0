//! What transparent surfaces do to light along a ray.
//!
//! * [`Tracer::unblocked`]: how much light comes from a point to another, for shadow rays. What all transparent triangles on
//!   the way let pass is multiplied; nothing is left to chance, so texels agree on what they see through a veil.
//! * [`Tracer::tint`]: rays that look for what they hit pass a transparent triangle with the probability of its clearest
//!   channel (`stops` in `traverse`). What they bring is to be multiplied by transmittance over that probability. Only
//!   materials of `KHR_materials_transmission` have a colour.
//!
//! What coloured solids take (`solids`) is no chance in either: it is multiplied.
//!
//! Invariant: the mean over many rays of either kind is the same. Scenes without transparent materials pay for one branch.

use super::Ray;
use super::Ray3;
use super::Tracer;
use crate::base::Rgb;
use glam::Vec2;

impl Tracer<'_> {
    /// Share of the light that comes along a ray from `t_max`, by channel: 0 where [`Tracer::occluded`] by what is opaque.
    /// `from` is a triangle that the ray cannot meet, because it starts above it and leads away: that is cheaper to know than
    /// to find.
    #[must_use]
    #[inline]
    pub fn unblocked(&self, ray: &Ray, from: Option<u32>) -> Rgb {
        let ray = Ray3::leaving(ray, from);
        if !self.transparent {
            return if self.any(ray) { Rgb::ZERO } else { Rgb::ONE };
        }
        let clear = Ray3 { clear: true, ..ray };
        if self.any(clear) {
            return Rgb::ZERO;
        }
        self.product(&clear, |triangle, b| self.scene.transmittance(triangle, b))
    }

    /// Colour of the light that comes along a ray, if nothing stops it before `t_max`.
    #[must_use]
    #[inline]
    pub fn tint(&self, ray: &Ray) -> Rgb {
        if !self.tints {
            return Rgb::ONE;
        }
        self.product(&ray.into(), |triangle, b| {
            if self.scene.material(triangle).transmission <= 0.0 {
                return Rgb::ONE;
            }
            let through = self.scene.transmittance(triangle, b);
            let most = through.max_element();
            if most > 0.0 { through / most } else { Rgb::ONE }
        })
    }

    /// Product of a factor over all transparent triangles that a ray crosses, and of what solids between them leave.
    #[cold]
    fn product(&self, ray: &Ray3, factor: impl Fn(u32, Vec2) -> Rgb) -> Rgb {
        let (mut product, mut walls) = (Rgb::ONE, vec![]);
        self.each_veil(ray, |c| {
            product *= factor(c.triangle, c.weights()) * self.cross(&c, &mut walls);
        });
        if walls.is_empty() { product } else { product * self.left_by_solids(ray, &mut walls) }
    }
}
