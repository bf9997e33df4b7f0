//! One look at the light from a point of a texel: shadow rays, each worth what it brings over its probability.
//!
//! cos θ is taken with the shading normal, bent by a normal map if there is one. What is below the triangle itself is
//! dark, unless the triangle is a facet of something smooth: then it is looked at over the smooth surface, and what is
//! at a finite distance is seen from there (`trace::Lift`). Rays that find out whether that is free are not counted.
//!
//! Texels close to an emitter look for it in two ways, each with the share of the light that the balance heuristic gives it
//! (Veach and Guibas, SIGGRAPH 1995, eq. 9): a direction to a chosen piece, and one by cosine, whatever it meets; where it is
//! seen through an opening ([`openings`](super::openings)), one that goes by the map of that.

use super::Emitters;
use super::emitters::Leaf;
use super::lit::{self, Lit};
use super::openings::{COUNTED, Opening};
use super::piece::{Piece, Sampled};
use super::punctual;
use super::site::Site;
use super::tree::Cut;
use crate::base::light_vector::trusted;
use crate::base::{Frame, LightVector, Rgb, warp};
use crate::patches::{PatchSurface, Patches, Sight, Spot, SurfacePoint};
use crate::scene::{Light, Scene};
use crate::trace::{Ground, Lift, Ray, Tracer};
use core::f32::consts::PI;
use glam::{Vec2, Vec3};

/// One place on a patch.
#[derive(Clone, Copy)]
pub(super) struct Place {
    triangle: u32,
    ground: Ground,
    lift: Option<Lift>,
    b: Vec2,
    /// What is at a finite distance is seen from here.
    pub(super) position: Vec3,
    normal: Vec3,
    geometric: Vec3,
}

/// Rays that look around for what glows: by cosine, and through an opening if there is one.
#[derive(Debug, Clone, Copy)]
struct Around<'a> {
    opening: Option<Opening<'a>>,
}

impl Around<'_> {
    fn direction(&self, place: &Place, pick: f32, u: Vec2) -> Vec3 {
        let through = self.opening.and_then(|opening| opening.sample(pick, u).ok());
        through.unwrap_or_else(|| Frame::from_normal(place.normal).to_world(warp::square_to_cosine_hemisphere(u)))
    }

    /// Density per steradian of a unit direction.
    fn density(&self, place: &Place, direction: Vec3) -> f32 {
        let by_cosine = place.normal.dot(direction).max(0.0) / PI;
        self.opening.map_or(by_cosine, |opening| opening.density(direction, by_cosine, 1.0))
    }
}

/// A triangle on the side of a patch.
#[derive(Clone, Copy)]
pub(super) struct Facet {
    triangle: u32,
    ground: Ground,
    lift: Option<Lift>,
    /// 1, or −1 on its back.
    sign: f32,
}

impl Place {
    /// The triangle, which a ray toward a direction cannot meet, unless it leads below that from a lifted start.
    fn left(&self, direction: Vec3) -> Option<u32> {
        (self.geometric.dot(direction) > 0.0).then_some(self.triangle)
    }

    /// Shading normal.
    pub(super) fn normal(&self) -> Vec3 {
        self.normal
    }

    /// The place as the choice among emitters sees it.
    pub(super) fn site(&self) -> Site {
        Site { position: self.position, normal: self.normal, radius: 0.0, flat: true }
    }
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
        PatchSurface::shaded(self.tracer, self.patches, patch)
    }

    pub(super) fn scene(&self) -> &'a Scene {
        self.tracer.scene()
    }

    /// A point of a patch; `last` keeps what points of one triangle have in common.
    pub(super) fn place(&self, patch: usize, point: SurfacePoint, last: &mut Option<Facet>) -> Place {
        let scene = self.scene();
        let facet = match last {
            Some(facet) if facet.triangle == point.triangle => facet,
            _ => last.insert(self.facet(patch, point.triangle)),
        };
        let Facet { triangle, ground, lift, sign } = *facet;
        self.rounded(Place {
            triangle,
            ground,
            lift,
            b: point.b,
            position: scene.position(triangle, point.b),
            normal: scene.relief_normal_over(triangle, point.b, ground.normal()) * sign,
            geometric: ground.normal() * sign,
        })
    }

    fn facet(&self, patch: usize, triangle: u32) -> Facet {
        let scene = self.scene();
        let sign = if self.patches.is_behind(patch) { -1.0 } else { 1.0 };
        let ground = Ground::new(scene.corners(triangle));
        Facet { triangle, ground, lift: Lift::new(scene, triangle, ground.normal() * sign), sign }
    }

    /// A place that was drawn on a patch.
    pub(super) fn spot(&self, surface: &PatchSurface<'_>, spot: &Spot) -> Place {
        self.rounded(Place {
            triangle: spot.point.triangle,
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
    pub(super) fn leave(&self, place: &Place, direction: Vec3) -> Option<(f32, Vec3)> {
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
        let (mut points, mut last) = (Vec::with_capacity(8), None);
        self.patches.cells(patch, 2, |point, _, _| {
            let place = self.place(patch, point, &mut last);
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
        Lit { all, gathered, unhidden: Rgb::ZERO, vector }
    }

    /// What a light brings.
    pub(super) fn light(&mut self, place: &Place, light: &Light, u: Vec2) -> Lit {
        self.light_and_passing(place, light, u).0
    }

    /// What a light brings, and the share of it that nothing stopped on the way.
    pub(super) fn light_and_passing(&mut self, place: &Place, light: &Light, u: Vec2) -> (Lit, f32) {
        let none = (Lit::default(), 0.0);
        let Some(seen) = punctual::seen_from(light, place.position, u) else { return none };
        let is_flat = !seen.far && place.lift.is_none();
        if is_flat && place.geometric.dot(seen.toward).abs() <= punctual::standing(light) {
            return none;
        }
        let toward = seen.toward.normalize_or_zero();
        let Some((cosine, origin)) = self.leave(place, toward) else { return none };
        let ray = if seen.far {
            Ray { origin, direction: seen.toward, t_max: f32::INFINITY }
        } else {
            Ray { origin, direction: place.position + seen.toward - origin, t_max: 1.0 }
        };
        self.rays += 1;
        let unblocked = self.tracer.unblocked(&ray, place.left(toward));
        if unblocked == Rgb::ZERO {
            return none;
        }
        let passing = unblocked.element_sum() / 3.0;
        (self.lit(place, toward, seen.illuminance * unblocked * cosine, Rgb::ZERO), passing)
    }

    /// What everything in the tree brings, from one choice and, close to it or through an opening, one ray that looks for it.
    pub(super) fn finite(
        &mut self,
        place: &Place,
        cut: &mut Cut,
        pick: f64,
        u: Vec2,
        opening: Option<Opening<'_>>,
    ) -> Lit {
        let point = place.site();
        self.emitters.weigh(cut, &point);
        let looks_around = cut.is_close || opening.is_some();
        let around = Around { opening: opening.filter(|_| !cut.is_close) };
        let chosen = match self.emitters.pick(cut, &point, pick) {
            Some((Leaf::Piece(piece), probability)) => {
                let sampled = piece.sample(self.scene(), place.position, probability, u);
                let shared = looks_around && piece.solid;
                sampled.map_or(Lit::default(), |s| self.surface(place, piece, &s, shared.then_some(around)))
            }
            Some((Leaf::Bulb(light), probability)) => self.light(place, light, u) / probability,
            None => Lit::default(),
        };
        if looks_around { chosen + self.around(place, cut, &point, around, (pick, u)) } else { chosen }
    }

    /// What a point of a piece brings, shared with a ray that looks around.
    fn surface(&mut self, place: &Place, piece: &Piece, s: &Sampled, shared: Option<Around<'_>>) -> Lit {
        if s.weighted.max_element() <= 0.0 {
            return Lit::default();
        }
        let Some((cosine, origin)) = self.leave(place, s.direction) else { return Lit::default() };
        let target = self.tracer.leave(&piece.ground, s.b, -s.direction);
        self.rays += 1;
        let ray = Ray { origin, direction: piece.ground.way(origin, target), t_max: 1.0 };
        let (unblocked, unhidden) = (self.tracer.unblocked(&ray, place.left(s.direction)), s.weighted * cosine);
        if unblocked == Rgb::ZERO {
            return Lit { unhidden, ..Lit::default() };
        }
        let share = shared.map_or(1.0, |around| s.density / (s.density + around.density(place, s.direction)));
        Lit { unhidden, ..self.lit(place, s.direction, unhidden * unblocked * share, Rgb::ZERO) }
    }

    /// The share of a ray that looks around in the light of the emitters: where one fills much of the view, its pieces are hard
    /// to choose well among, and where most of it is hidden, those in sight are.
    fn around(&mut self, place: &Place, cut: &Cut, point: &Site, around: Around<'_>, (pick, u): (f64, Vec2)) -> Lit {
        let direction = around.direction(place, pick as f32, Vec2::new(u.y, u.x + 0.5).fract());
        let Some((cosine, origin)) = self.leave(place, direction) else { return Lit::default() };
        self.rays += 1;
        let ray = Ray { origin, direction, t_max: f32::INFINITY };
        let Some(hit) = self.tracer.closest_hit(&ray) else { return Lit::default() };
        let Some((radiance, density)) = self.emitters.met(self.scene(), cut, point, direction, &hit) else {
            return Lit::default();
        };
        let weight = cosine / (density + around.density(place, direction));
        let tint = self.tracer.tint(&Ray { t_max: hit.t, ..ray });
        self.lit(place, direction, radiance * tint * weight, Rgb::ZERO)
    }

    /// A point of another patch, and the share of its light that arrives; `None` if nothing does.
    pub(super) fn patch(
        &mut self,
        place: &Place,
        patch: usize,
        surface: &PatchSurface<'_>,
        spot: &Spot,
    ) -> Option<(Sight, Rgb)> {
        let to = self.scene().position(spot.point.triangle, spot.point.b) - place.position;
        let (direction, distance) = (to.normalize_or_zero(), to.length());
        let facing = -direction.dot(surface.normal(spot));
        if facing <= 0.0 {
            return None;
        }
        let (_, origin) = self.leave(place, direction)?;
        let target = surface.origin(spot, -direction);
        self.rays += 1;
        let ray = Ray { origin, direction: surface.ground(spot).way(origin, target), t_max: 1.0 };
        let unblocked = self.tracer.unblocked(&ray, place.left(direction));
        let Place { position, normal, .. } = *place;
        let sight = Sight { patch, position, normal, direction, distance, facing };
        (unblocked != Rgb::ZERO).then_some((sight, unblocked))
    }

    /// What sky and environment bring from one direction, for a gather with `rays` rays for each of these samples.
    pub(super) fn infinity(
        &mut self,
        place: &Place,
        opening: Option<Opening<'_>>,
        pick: f64,
        u: Vec2,
        rays: f32,
    ) -> Lit {
        let scene = self.scene();
        let (direction, density) = self.emitters.infinity.above(scene, place.normal, opening, pick as f32, u);
        let radiance = scene.light_from_infinity(direction);
        if density <= 0.0 || radiance.max_element() <= 0.0 {
            return Lit::default();
        }
        let Some((cosine, origin)) = self.leave(place, direction) else { return Lit::default() };
        self.rays += 1;
        let ray = Ray { origin, direction, t_max: f32::INFINITY };
        let unblocked = self.tracer.unblocked(&ray, place.left(direction));
        if unblocked == Rgb::ZERO {
            return Lit::default();
        }
        let light = radiance * unblocked * (cosine / density);
        let counted = match opening {
            Some(_) => self.emitters.infinity.density_above(scene, place.normal, opening, direction, COUNTED),
            None => density,
        };
        let lit = self.lit(place, direction, light, light * lit::gathered(cosine, counted, rays));
        Lit { vector: lit.vector * trusted(density), ..lit }
    }
}
