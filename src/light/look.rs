//! One look at the light from a point of a texel: shadow rays, each worth what it brings over its probability.
//!
//! cos θ is taken with the shading normal, bent by a normal map if there is one. What is below the triangle itself is
//! dark, unless the triangle is a facet of something smooth: then it is looked at over the smooth surface, and what is
//! at a finite distance is seen from there (`trace::Lift`). Rays that find out whether that is free are not counted.

use super::Emitters;
use super::emitters::Leaf;
use super::infinity::Infinity;
use super::lit::Lit;
use super::piece::{Piece, Sampled};
use super::punctual;
use super::site::Site;
use super::tree::Cut;
use crate::base::light_vector::trusted;
use crate::base::{LightVector, Rgb};
use crate::patches::{PatchSurface, Patches, Spot, SurfacePoint};
use crate::scene::{Light, Scene};
use crate::trace::{Ground, Lift, Ray, Tracer};
use glam::{Vec2, Vec3};

/// One place on a patch.
#[derive(Clone, Copy)]
pub(super) struct Place {
    ground: Ground,
    lift: Option<Lift>,
    b: Vec2,
    /// What is at a finite distance is seen from here.
    position: Vec3,
    normal: Vec3,
    geometric: Vec3,
}

/// What is looked at, and a count of the shadow rays.
#[derive(Clone)]
pub(super) struct Look<'a> {
    tracer: &'a Tracer<'a>,
    pub(super) patches: &'a Patches,
    pub(super) emitters: &'a Emitters,
    /// Light vectors are wanted, too.
    pub(super) directional: bool,
    /// Something is at a finite distance.
    finite: bool,
    /// Some surface has a normal map.
    relief: bool,
    pub(super) rays: u64,
}

impl<'a> Look<'a> {
    pub(super) fn new(tracer: &'a Tracer<'a>, patches: &'a Patches, emitters: &'a Emitters, directional: bool) -> Self {
        let relief = tracer.scene().materials.iter().any(|material| material.normal_map.is_some());
        Self { tracer, patches, emitters, directional, finite: emitters.any_finite(), relief, rays: 0 }
    }

    pub(super) fn patch_surface(&self, patch: usize) -> PatchSurface<'a> {
        PatchSurface::new(self.tracer, self.patches, patch)
    }

    fn scene(&self) -> &'a Scene {
        self.tracer.scene()
    }

    pub(super) fn place(&self, patch: usize, point: SurfacePoint) -> Place {
        let scene = self.scene();
        let sign = if self.patches.is_behind(patch) { -1.0 } else { 1.0 };
        let ground = Ground::new(scene.corners(point.triangle));
        let geometric = ground.normal() * sign;
        self.rounded(Place {
            ground,
            lift: Lift::new(scene, point.triangle, geometric),
            b: point.b,
            position: scene.position(point.triangle, point.b),
            normal: scene.relief_normal_over(point.triangle, point.b, ground.normal()) * sign,
            geometric,
        })
    }

    /// A place that was drawn on a patch.
    pub(super) fn spot(&self, surface: &PatchSurface<'_>, spot: &Spot) -> Place {
        self.rounded(Place {
            ground: *surface.ground(spot),
            lift: surface.lift(spot).copied(),
            b: spot.point.b,
            position: self.scene().position(spot.point.triangle, spot.point.b),
            normal: surface.shading_frame(spot).n,
            geometric: surface.normal(spot),
        })
    }

    /// The place, on the smooth surface if that matters.
    fn rounded(&self, mut place: Place) -> Place {
        if let Some(lift) = place.lift.as_ref().filter(|_| self.finite) {
            let Place { ground, b, position, geometric, .. } = &place;
            place.position = self.tracer.smooth_position(ground, lift, *b, *geometric, *position);
        }
        place
    }

    /// Cosine to the shading normal and origin of a ray toward a unit direction; `None` if that leads below the surface.
    fn leave(&self, place: &Place, direction: Vec3) -> Option<(f32, Vec3)> {
        let cosine = place.normal.dot(direction);
        if cosine <= 0.0 {
            return None;
        }
        let origin =
            self.tracer.leave_smooth(&place.ground, place.lift.as_ref(), place.b, direction, place.geometric)?;
        Some((cosine, origin))
    }

    /// A normal map bends the normals of a texel, from point to point.
    pub(super) fn has_relief(&self, patch: usize) -> bool {
        self.relief && self.patches.triangles(self.patches.front_patch(patch)).any(|t| self.scene().has_relief(t))
    }

    /// The texel as the choice among emitters sees it.
    pub(super) fn site(&self, patch: usize) -> Site {
        let mut points = Vec::with_capacity(8);
        self.patches.cells(patch, 2, |point, _, _| {
            let place = self.place(patch, point);
            points.push((place.position, place.normal));
        });
        let (position, normal) = (self.patches.position[patch], self.patches.normal[patch]);
        let site = Site::new(position, normal, self.patches.texel_edge(patch), &points);
        Site { flat: site.flat && !self.has_relief(patch), ..site }
    }

    /// Irradiance from a unit direction, of which the final gather finds `gathered`, too.
    fn lit(&self, place: &Place, toward: Vec3, all: Rgb, gathered: Rgb) -> Lit {
        let vector = if self.directional {
            LightVector::of(all - gathered, place.normal, toward)
        } else {
            LightVector::default()
        };
        Lit { all, gathered, vector }
    }

    /// What a light brings.
    pub(super) fn light(&mut self, place: &Place, light: &Light, u: Vec2) -> Lit {
        self.light_and_passing(place, light, u).0
    }

    /// What a light brings, and the share of it that nothing stopped on the way.
    pub(super) fn light_and_passing(&mut self, place: &Place, light: &Light, u: Vec2) -> (Lit, f32) {
        let none = (Lit::default(), 0.0);
        let Some(seen) = punctual::seen_from(light, place.position, u) else { return none };
        let toward = seen.toward.normalize_or_zero();
        let Some((cosine, origin)) = self.leave(place, toward) else { return none };
        let ray = if seen.far {
            Ray { origin, direction: seen.toward, t_max: f32::INFINITY }
        } else {
            Ray { origin, direction: place.position + seen.toward - origin, t_max: 1.0 }
        };
        self.rays += 1;
        let unblocked = self.tracer.unblocked(&ray);
        if unblocked == Rgb::ZERO {
            return none;
        }
        let passing = unblocked.element_sum() / 3.0;
        (self.lit(place, toward, seen.illuminance * unblocked * cosine, Rgb::ZERO), passing)
    }

    /// What everything in the tree brings, from one choice.
    pub(super) fn finite(&mut self, place: &Place, cut: &mut Cut, pick: f64, u: Vec2) -> Lit {
        let point = Site { position: place.position, normal: place.normal, radius: 0.0, flat: true };
        self.emitters.weigh(cut, &point);
        match self.emitters.pick(cut, &point, pick) {
            Some((Leaf::Piece(piece), probability)) => {
                let sampled = piece.sample(self.scene(), place.position, probability, u);
                sampled.map_or(Lit::default(), |s| self.surface(place, piece, &s))
            }
            Some((Leaf::Bulb(light), probability)) => self.light(place, light, u) / probability,
            None => Lit::default(),
        }
    }

    fn surface(&mut self, place: &Place, piece: &Piece, s: &Sampled) -> Lit {
        if s.weighted.max_element() <= 0.0 {
            return Lit::default();
        }
        let Some((cosine, origin)) = self.leave(place, s.direction) else { return Lit::default() };
        let target = self.tracer.leave(&piece.ground, s.b, -s.direction);
        self.rays += 1;
        let ray = Ray { origin, direction: target - origin, t_max: 1.0 };
        let unblocked = self.tracer.unblocked(&ray);
        if unblocked == Rgb::ZERO {
            return Lit::default();
        }
        self.lit(place, s.direction, s.weighted * unblocked * cosine, Rgb::ZERO)
    }

    /// What sky and environment bring from one direction, for a gather with `rays` rays for each of these samples.
    pub(super) fn infinity(&mut self, place: &Place, pick: f64, u: Vec2, rays: f32) -> Lit {
        let scene = self.scene();
        let (direction, density) = self.emitters.infinity.above(scene, place.normal, pick as f32, u);
        let radiance = scene.light_from_infinity(direction);
        if density <= 0.0 || radiance.max_element() <= 0.0 {
            return Lit::default();
        }
        let Some((cosine, origin)) = self.leave(place, direction) else { return Lit::default() };
        self.rays += 1;
        let ray = Ray { origin, direction, t_max: f32::INFINITY };
        let unblocked = self.tracer.unblocked(&ray);
        if unblocked == Rgb::ZERO {
            return Lit::default();
        }
        let light = radiance * unblocked * (cosine / density);
        let lit = self.lit(place, direction, light, light * Infinity::gathered(place.normal, direction, density, rays));
        Lit { vector: lit.vector * trusted(density), ..lit }
    }
}
