//! [`Scene`] → [`Tracer`]: what a ray meets first, and whether two points see each other.
//!
//! `build` makes a hierarchy of eight boxes per node (cut by `split`), `copies` one per mesh that many parts share,
//! `traverse` walks it with a `stack`, `many` does so along several rays at once, `triangle` decides watertightly what
//! is met, `origin` finds starts of rays that never meet the surface they leave, `lift` those of rays that graze a
//! smooth body made of facets. `crossings` are all that a ray crosses: `tint` knows from them what glass does to light,
//! `solid` what the ray began in, for which `closed` knows what closes around a space. `lanes` are the eight-fold
//! numbers of all that, `machine` has their AVX2 kind, chosen once per [`Tracer`].
//!
//! Invariants:
//! * [`Tracer::closest_hit`] and [`Tracer::occluded`] accept exactly the same hits, so one is the other's existence;
//! * a ray's answer depends on the scene and the ray alone: not on threads, other rays, or the machine. What is done in
//!   f32 lanes only refuses what f64 would refuse; what is left is decided in f64 without fused multiply-add, the same
//!   way on every CPU;
//! * a ray that is not finite, has no direction, or a `t_max` that is not above zero, meets nothing.
//!
//! Limits: 2²⁸ triangles; further ones are not seen. Distances are f32: surfaces closer to each other than one part in
//! 2²⁴ of the ray's length count as equally far.

mod build;
mod closed;
mod collapse;
mod copies;
mod crossings;
mod lanes;
mod lift;
mod machine;
mod many;
mod origin;
mod sides;
mod solid;
mod solids;
mod split;
mod stack;
mod tint;
mod traverse;
mod triangle;
mod within;

pub use closed::Closed;
pub use lift::Lift;
pub use many::Rays;
pub use origin::Ground;
pub use sides::weights_at;

use crate::scene::{Part, Scene};
use build::Hierarchy;
use copies::Shared;
use glam::{DVec3, Vec2, Vec3};
use lanes::Portable;
use traverse::traverse;

/// Cosine between the normals of two surfaces that lie on each other, at most.
const FACE_TO_FACE: f32 = -0.99;

/// A half line or segment.
#[derive(Debug, Clone, Copy)]
pub struct Ray {
    /// Start [m].
    pub origin: Vec3,
    /// Need not have unit length; `t` is in units of it.
    pub direction: Vec3,
    /// Hits at or beyond this t do not count; infinite for a half line.
    pub t_max: f32,
}

/// What a ray met first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Triangle of the scene, by its id.
    pub triangle: u32,
    /// Barycentric weights of the triangle's vertices 1 and 2.
    pub b: Vec2,
    /// Distance in units of the ray's direction, > 0.
    pub t: f32,
    /// The ray came from the front side.
    pub front: bool,
}

/// Light on its way along a ray.
#[derive(Debug, Clone, Copy)]
pub struct Line {
    /// Its geometry.
    pub ray: Ray,
    /// Flux that it carries [lm].
    pub flux: crate::base::Rgb,
}

/// A scene prepared for ray queries.
pub struct Tracer<'a> {
    scene: &'a Scene,
    hierarchy: Hierarchy,
    /// What of `hierarchy` lets light pass, if that is little of it: most rays cross none. In two interiors with tinted glass
    /// the gather took 30 and 35 % less time with it.
    veils: Option<Hierarchy>,
    /// Parts that share their geometry, which are not in `hierarchy`.
    shared: Shared,
    /// Largest absolute coordinate of all [m].
    reach: f64,
    /// Some material lets light pass.
    transparent: bool,
    /// Some material gives light a colour that passes it.
    tints: bool,
    /// What parts are to light inside of them; empty if that does not matter.
    bodies: Vec<solids::Body>,
    /// A bit per triangle that a front may lie on, see [`Tracer::with_sides`]; empty if none.
    sides: Vec<u64>,
    /// The machine has AVX2.
    #[cfg(target_arch = "x86_64")]
    avx2: Option<machine::Avx2>,
}

/// A [`Ray`] with a direction in double precision.
#[derive(Clone, Copy)]
struct Ray3 {
    origin: Vec3,
    direction: DVec3,
    t_max: f32,
    /// Triangle that it passes, or [`NO_TRIANGLE`].
    passes: u32,
    /// It passes all transparent triangles, too.
    clear: bool,
}

/// One in so many triangles may let light pass and be kept twice.
const MOST_VEILS: usize = 8;
/// A hit of which nothing more is known.
const SOMETHING: Hit = Hit { triangle: NO_TRIANGLE, b: Vec2::ZERO, t: 0.0, front: true };
/// No triangle.
const NO_TRIANGLE: u32 = u32::MAX;

impl Ray3 {
    /// A ray that leaves a triangle, if there is one `from` which it starts.
    #[inline]
    fn leaving(ray: &Ray, from: Option<u32>) -> Self {
        Self { passes: from.unwrap_or(NO_TRIANGLE), ..ray.into() }
    }

    /// It can meet something. Written so that NaN fails.
    #[inline(always)]
    fn is_valid(&self) -> bool {
        let valid = self.origin.is_finite() && self.direction.is_finite() && self.t_max > 0.0;
        valid && self.direction != DVec3::ZERO
    }
}

impl From<&Ray> for Ray3 {
    #[inline]
    fn from(ray: &Ray) -> Self {
        Self {
            origin: ray.origin,
            direction: ray.direction.as_dvec3(),
            t_max: ray.t_max,
            passes: NO_TRIANGLE,
            clear: false,
        }
    }
}

impl<'a> Tracer<'a> {
    /// Of what takes part in light: parts that cast none are left out.
    ///
    /// Builds the hierarchy, in parallel; the same bytes at every thread count. An empty scene is fine. Triangles
    /// without area or with a coordinate that is not finite are left out.
    #[must_use]
    pub fn new(scene: &'a Scene) -> Self {
        Self::of(scene, |part| part.treatment.casts)
    }

    /// Of everything, for pictures.
    #[must_use]
    pub fn of_all(scene: &'a Scene) -> Self {
        Self::of(scene, |_| true).with_any_sides()
    }

    fn of(scene: &'a Scene, keep: impl Fn(&Part) -> bool) -> Self {
        let shared = Shared::new(scene, &keep);
        let hierarchy = Hierarchy::new(scene, &keep);
        let is_veil = |part: &Part| keep(part) && !scene.materials[part.material].is_opaque();
        let veils = scene.parts.iter().filter(|part| is_veil(part)).map(|part| part.triangles.len()).sum::<usize>();
        let few = veils <= hierarchy.triangle_count / MOST_VEILS;
        let reach = hierarchy.reach().max(f64::from(shared.bounds.0.abs().max(shared.bounds.1.abs()).max_element()));
        #[cfg(target_arch = "x86_64")]
        let avx2 = machine::Avx2::detect().filter(|_| machine::Avx2::within(reach as f32));
        Self {
            scene,
            veils: few.then(|| hierarchy.part_of(scene, is_veil)),
            hierarchy,
            shared,
            reach,
            transparent: scene.materials.iter().any(|m| !m.is_opaque()),
            tints: scene.materials.iter().any(|m| m.transmission > 0.0),
            bodies: solids::bodies(scene),
            sides: vec![],
            #[cfg(target_arch = "x86_64")]
            avx2,
        }
    }

    /// The same, without instructions that not every machine of this architecture has; the same answers, bit by bit.
    #[must_use]
    pub fn portable(self) -> Self {
        Self {
            #[cfg(target_arch = "x86_64")]
            avx2: None,
            ..self
        }
    }

    /// The scene that this was built from.
    #[must_use]
    pub fn scene(&self) -> &'a Scene {
        self.scene
    }

    /// The nearest hit with 0 < t < `t_max`; of equal distances fronts come first, then the smallest triangle index.
    /// Triangles have two sides. Transparent ones are passed with probability 1 − opacity, decided by a hash of the ray
    /// and the triangle.
    #[must_use]
    pub fn closest_hit(&self, ray: &Ray) -> Option<Hit> {
        let hit = self.nearest(ray.into())?;
        Some(if self.sides.is_empty() { hit } else { self.side_met(NO_TRIANGLE, hit) })
    }

    /// What [`Tracer::closest_hit`] says of each of these rays, in their order.
    pub fn closest_hits<'r>(&self, rays: &'r mut Rays) -> &'r [Option<Hit>] {
        self.each_of::<false>(rays)
    }

    /// What [`Tracer::occluded`] says of each of these rays, in their order.
    pub fn occluded_each<'r>(&self, rays: &'r mut Rays) -> impl ExactSizeIterator<Item = bool> + use<'r> {
        self.each_of::<true>(rays).iter().map(Option::is_some)
    }

    /// Anything between 0 and `t_max`.
    #[must_use]
    pub fn occluded(&self, ray: &Ray) -> bool {
        self.any(ray.into())
    }

    /// Nothing lies strictly between two points [m]. For points on surfaces, take both from [`Tracer::origin_on`].
    ///
    /// Better than [`Tracer::occluded`] with the difference as direction: that difference, rounded to f32, misses the
    /// end by as much as `origin_on` has pushed it off its surface.
    #[must_use]
    pub fn segment_clear(&self, from: Vec3, to: Vec3) -> bool {
        !self.any(Ray3 {
            origin: from,
            direction: to.as_dvec3() - from.as_dvec3(),
            t_max: 1.0,
            passes: NO_TRIANGLE,
            clear: false,
        })
    }

    /// What lies on this point of a triangle's front, face to face, as the foot of a chair on the floor, and `counts`; not
    /// the same triangle once more with its front on the other side, which makes a sheet with two sides. Rays that leave
    /// the point start beyond that surface, as its distance is less than the push of [`Tracer::origin_on`]. Of many surfaces in
    /// one place some are looked at.
    #[must_use]
    pub fn sealed_by(&self, ground: &Ground, triangle: u32, b: Vec2, counts: impl Fn(u32) -> bool) -> Option<u32> {
        let normal = ground.normal();
        let ray = Ray3 { passes: triangle, ..self.through(ground, b, normal) };
        let faces = |other: u32, front: bool| !front && self.scene.geometric_normal(other).dot(normal) < FACE_TO_FACE;
        let seals = |other: u32| !solid::are_sides(self.scene, other, triangle) && counts(other);
        let hit = self.nearest(ray)?;
        if faces(hit.triangle, hit.front) && seals(hit.triangle) {
            return Some(hit.triangle);
        }
        // A chair may stand on a floor that has a ceiling as its other side, or lies there twice.
        let (mut first, mut met): (Option<(f32, u32)>, usize) = (None, 0);
        self.each_crossed(&ray, |c| {
            met += 1;
            if c.triangle != triangle && !c.transparent && faces(c.triangle, c.front) && seals(c.triangle) {
                let this = (c.t, c.triangle);
                first = Some(first.map_or(this, |first| if this < first { this } else { first }));
            }
            met < solid::MOST_TOGETHER
        });
        first.map(|(_, other)| other)
    }

    /// The short way through a point of a triangle, from a side of it to the other, between where rays start that leave it.
    fn through(&self, ground: &Ground, b: Vec2, side: Vec3) -> Ray3 {
        let [above, below] = [side, -side].map(|side| self.leave(ground, b, side));
        let direction = below.as_dvec3() - above.as_dvec3();
        Ray3 { origin: above, direction, t_max: 1.0, passes: NO_TRIANGLE, clear: false }
    }

    #[inline]
    fn nearest(&self, ray: Ray3) -> Option<Hit> {
        let hit = match self.avx2_for(&ray) {
            #[cfg(target_arch = "x86_64")]
            Some(avx2) => avx2.closest(self, ray),
            _ => traverse::<Portable, false>(self, ray),
        };
        if self.shared.is_empty() { hit } else { self.nearest_too(&ray, hit) }
    }

    /// The nearest hit of what is shared, or the one `before`.
    fn nearest_too(&self, ray: &Ray3, before: Option<Hit>) -> Option<Hit> {
        match self.avx2_for(ray) {
            #[cfg(target_arch = "x86_64")]
            Some(avx2) => avx2.closest_shared(self, ray, before),
            _ => self.shared.closest::<Portable>(self, ray, before),
        }
    }

    fn each_of<'r, const ANY: bool>(&self, rays: &'r mut Rays) -> &'r [Option<Hit>] {
        let (rays, hits) = rays.parts();
        #[cfg(target_arch = "x86_64")]
        let avx2 = self.avx2.filter(|_| rays.iter().all(|ray| self.avx2_for(ray).is_some()));
        #[cfg(not(target_arch = "x86_64"))]
        let avx2 = None::<core::convert::Infallible>;
        match avx2 {
            #[cfg(target_arch = "x86_64")]
            Some(avx2) if ANY => avx2.any_many(self, rays, hits),
            #[cfg(target_arch = "x86_64")]
            Some(avx2) => avx2.closest_many(self, rays, hits),
            _ => many::trace::<Portable, ANY>(self, rays, hits),
        }
        if !self.shared.is_empty() {
            for (ray, hit) in rays.iter().zip(hits.iter_mut()) {
                if !ANY {
                    *hit = self.nearest_too(ray, *hit);
                } else if hit.is_none() && self.any_too(ray) {
                    *hit = Some(SOMETHING);
                }
            }
        }
        if !ANY && !self.sides.is_empty() {
            for (ray, hit) in rays.iter().zip(hits.iter_mut()) {
                *hit = hit.map(|hit| self.side_met(ray.passes, hit));
            }
        }
        hits
    }

    #[inline]
    fn any(&self, ray: Ray3) -> bool {
        let met = match self.avx2_for(&ray) {
            #[cfg(target_arch = "x86_64")]
            Some(avx2) => avx2.any(self, ray),
            _ => traverse::<Portable, true>(self, ray).is_some(),
        };
        met || !self.shared.is_empty() && self.any_too(&ray)
    }

    /// It meets what is shared.
    fn any_too(&self, ray: &Ray3) -> bool {
        match self.avx2_for(ray) {
            #[cfg(target_arch = "x86_64")]
            Some(avx2) => avx2.any_shared(self, ray),
            _ => self.shared.any::<Portable>(self, ray),
        }
    }

    /// The machine has AVX2, and a ray is not too far out for it.
    #[cfg(target_arch = "x86_64")]
    #[inline]
    fn avx2_for(&self, ray: &Ray3) -> Option<machine::Avx2> {
        self.avx2.filter(|_| machine::Avx2::within(ray.origin.abs().max_element()))
    }

    #[cfg(not(target_arch = "x86_64"))]
    fn avx2_for(&self, _ray: &Ray3) -> Option<core::convert::Infallible> {
        None
    }

    /// Origin for a ray that leaves a triangle at `b` toward `direction`: pushed off the surface, to the side that the
    /// direction points to, by a bound of the rounding errors, so that the ray cannot meet the triangle it starts from.
    ///
    /// The push is at most 4 f32 steps (ulps) of the triangle's coordinates per axis, in proportion to the normal:
    /// under 4 µm within 8 m of the world's origin. A point nearer than 8 steps to an edge is moved that far inward, so
    /// that a ray from a corner of a room starts inside it.
    #[must_use]
    pub fn origin_on(&self, triangle: u32, b: Vec2, direction: Vec3) -> Vec3 {
        self.leave(&Ground::new(self.scene.corners(triangle)), b, direction)
    }

    /// The same for a triangle that many rays leave.
    #[must_use]
    #[inline]
    pub fn leave(&self, ground: &Ground, b: Vec2, direction: Vec3) -> Vec3 {
        ground.leave(b, direction, self.reach)
    }

    /// Smallest and largest coordinates of the triangles that rays can meet [m]; zeros for an empty scene.
    #[must_use]
    pub fn bounds(&self) -> (Vec3, Vec3) {
        let (own, shared) = (self.hierarchy.bounds, self.shared.bounds);
        match (self.hierarchy.nodes.is_empty(), self.shared.is_empty()) {
            (_, true) => own,
            (true, false) => shared,
            (false, false) => (own.0.min(shared.0), own.1.max(shared.1)),
        }
    }

    /// Number of triangles that rays can meet.
    #[must_use]
    pub fn triangle_count(&self) -> usize {
        self.hierarchy.triangle_count + self.shared.triangle_count
    }

    /// Number of eight-wide nodes.
    #[must_use]
    pub fn node_count(&self) -> usize {
        self.hierarchy.node_count + self.shared.node_count()
    }

    /// Memory of the hierarchy [bytes].
    #[must_use]
    pub fn memory_bytes(&self) -> usize {
        let veils = self.veils.as_ref().map_or(0, Hierarchy::memory_bytes);
        self.hierarchy.memory_bytes() + veils + self.shared.memory_bytes()
    }
}
