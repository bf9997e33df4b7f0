//! The surface of one patch, prepared for the many rays that leave it.
//!
//! In: tracer, patches, a patch. Out: points that are uniform over its exposed part, with normals and starts of rays.
//!
//! What does not change from ray to ray is found once per patch: clipped polygons, the map from the texel to its
//! triangles, normals and the bounds of rounding errors. Found anew for each ray, a gather took
//! 1.36 times as long (office, 50,000 texels).
//!
//! A cell of the exposure mask counts whole by what was found at its middle. At the border of what is exposed, and of a
//! partly hidden texel, a solid may take up the rest of it, so there points are drawn at the middle alone. Drawn from all
//! of the cells, 0.13 % of the lines of the walk started inside a solid, and as much was missing in the direct light of
//! cut texels (office, texels of 14 cm).
//!
//! Invariants: a point drawn on a patch lies on its exposed part, so a patch does not send light from where it is
//! inside another solid; well-spread numbers give well-spread points.

use super::cells::{MASK_GRID, cell_index};
use super::{Patches, SurfacePoint, Tilt};
use crate::atlas::raster::Polygon;
use crate::base::random::{mix, unit_f32};
use crate::base::{Frame, warp};
use crate::trace::{Ground, Lift, Ray, Tracer};
use glam::{DVec2, Vec2, Vec3};

/// Draws before a point where light is tilted is given up on: at least three in sixteen are taken.
const MOST_DRAWS: u32 = 16;
/// Area of a cell of the exposure mask [texel²].
const CELL_AREA: f32 = 1.0 / (MASK_GRID * MASK_GRID) as f32;

/// The surface of one patch, on its own side.
pub struct PatchSurface<'a> {
    tracer: &'a Tracer<'a>,
    back: bool,
    /// Covered part of the texel [texel²].
    covered: f32,
    fragments: Vec<Fragment>,
    /// What is exposed of a texel that is partly hidden; empty for others.
    open: Vec<OpenCell>,
}

/// What one triangle covers of an exposed cell of the mask.
struct OpenCell {
    fragment: usize,
    /// Its middle, which was found to be exposed [texels from the texel's corner].
    middle: DVec2,
    /// Points are drawn from a square of this edge around the middle; 0 where a solid may be close [texels].
    edge: f64,
    /// Area of the cells up to this one [texel²].
    running: f32,
}

/// The part of a triangle within the texel.
struct Fragment {
    triangle: u32,
    covered: f32,
    /// `None` where it covers the whole texel.
    polygon: Option<Polygon>,
    map: Map,
    ground: Ground,
    /// What it stands for where it is a facet of something smooth.
    lift: Option<Lift>,
    /// Geometric normal on the patch's side.
    normal: Vec3,
    /// Around that normal.
    frame: Frame,
    /// Around the normal that light falls on; `None` where that is not the same everywhere, or was not asked for.
    shading: Option<Frame>,
}

/// From texel coordinates to the weights of a triangle's vertices 1 and 2.
pub(super) struct Map {
    corner: DVec2,
    edges: [DVec2; 2],
    area: f64,
}

/// A point on the surface of a patch.
#[derive(Debug, Clone, Copy)]
pub struct Spot {
    fragment: usize,
    /// Where it is in the scene.
    pub point: SurfacePoint,
    /// Where it is in the texel [texels from the texel's corner].
    pub within: Vec2,
}

impl Map {
    /// `corners` in texels relative to the texel.
    pub(super) fn new([a, b, c]: [DVec2; 3]) -> Self {
        Self { corner: a, edges: [b - a, c - a], area: (b - a).perp_dot(c - a) }
    }

    /// How far a point is outside the triangle, as a weight; 0 inside.
    pub(super) fn outside(&self, point: DVec2) -> f64 {
        let p = point - self.corner;
        let (b1, b2) = (p.perp_dot(self.edges[1]) / self.area, self.edges[0].perp_dot(p) / self.area);
        (-b1).max(-b2).max(b1 + b2 - 1.0).max(0.0)
    }

    /// Clamped to the triangle.
    pub(super) fn weights(&self, point: DVec2) -> Vec2 {
        let p = point - self.corner;
        let b1 = (p.perp_dot(self.edges[1]) / self.area).clamp(0.0, 1.0);
        let b2 = (self.edges[0].perp_dot(p) / self.area).clamp(0.0, 1.0 - b1);
        Vec2::new(b1 as f32, b2 as f32)
    }
}

impl<'a> PatchSurface<'a> {
    /// Prepares a patch.
    #[must_use]
    pub fn new(tracer: &'a Tracer<'a>, patches: &'a Patches, patch: usize) -> Self {
        let (front, back, scene) = (patches.front_patch(patch), patches.is_behind(patch), tracer.scene());
        let fragment = |f: usize| {
            let (triangle, covered) = (patches.fragments.triangle(front, f), patches.fragments.covered[f]);
            let ground = Ground::new(scene.corners(triangle));
            let normal = if back { -ground.normal() } else { ground.normal() };
            Fragment {
                triangle,
                covered,
                polygon: (covered <= 0.999_999).then(|| patches.polygon(front, f)),
                map: patches.map(triangle, front),
                ground,
                lift: Lift::new(scene, triangle, normal),
                normal,
                frame: Frame::from_normal(normal),
                shading: None,
            }
        };
        let fragments: Vec<_> = patches.fragments.range(front).map(fragment).collect();
        let covered = fragments.iter().map(|f| f.covered).fold(0.0, |a, b| a + b);
        let open = if patches.mask[patch] == u64::MAX { vec![] } else { open_cells(patches, patch) };
        Self { tracer, back, covered, fragments, open }
    }

    /// Prepares a patch for many looks at its shading normals.
    #[must_use]
    pub fn shaded(tracer: &'a Tracer<'a>, patches: &'a Patches, patch: usize) -> Self {
        let mut surface = Self::new(tracer, patches, patch);
        let back = surface.back;
        for Fragment { triangle, ground, shading, .. } in &mut surface.fragments {
            let normal = tracer.scene().even_normal(*triangle, ground.normal());
            *shading = normal.map(|n| Frame::from_normal(if back { -n } else { n }));
        }
        surface
    }

    /// A point of the exposed part, uniform by area for uniform `u`.
    #[must_use]
    pub fn sample(&self, u: Vec2) -> Spot {
        match self.open.last() {
            None => self.draw(u),
            Some(last) => {
                let target = u.x * last.running;
                let k = self.open.partition_point(|c| c.running <= target).min(self.open.len() - 1);
                let low = if k == 0 { 0.0 } else { self.open[k - 1].running };
                let cell = &self.open[k];
                let within = DVec2::new(f64::from((target - low) / (cell.running - low)), f64::from(u.y));
                self.spot(cell.fragment, cell.middle + (within - 0.5) * cell.edge)
            }
        }
    }

    /// The point of the patch at `within` [texels from the texel's corner], or the nearest that one of its triangles has.
    #[must_use]
    pub fn at(&self, within: Vec2) -> Spot {
        let at = within.as_dvec2();
        let outside = |f: &Fragment| f.map.outside(at);
        let nearest = (1..self.fragments.len())
            .fold(0, |best, k| if outside(&self.fragments[k]) < outside(&self.fragments[best]) { k } else { best });
        self.spot(nearest, at)
    }

    fn spot(&self, fragment: usize, at: DVec2) -> Spot {
        let Fragment { triangle, map, .. } = &self.fragments[fragment];
        let point = SurfacePoint { triangle: *triangle, b: map.weights(at) };
        Spot { fragment, point, within: at.as_vec2() }
    }

    /// A point of the exposed part where light is tilted, in proportion to it.
    #[must_use]
    pub fn sample_tilted(&self, u: Vec2, tilt: Tilt) -> Spot {
        let (mut u, mut spot) = (u, self.sample(u));
        for k in 0..MOST_DRAWS {
            let bits = mix(u64::from(u.y.to_bits()) << 32 | u64::from(u.x.to_bits()) ^ u64::from(k));
            if unit_f32(bits as u32) * tilt.most() <= tilt.at(spot.within) {
                break;
            }
            let bits = mix(bits);
            u = Vec2::new(unit_f32(bits as u32), unit_f32((bits >> 32) as u32));
            spot = self.sample(u);
        }
        spot
    }

    /// A point of a patch of which nothing is hidden.
    fn draw(&self, u: Vec2) -> Spot {
        let (mut k, mut u) = (0, u);
        if self.fragments.len() > 1 {
            let mut target = u.x * self.covered;
            for (i, f) in self.fragments.iter().enumerate() {
                k = i;
                if target < f.covered || i + 1 == self.fragments.len() {
                    u.x = (target / f.covered.max(f32::MIN_POSITIVE)).clamp(0.0, 0.999_999_9);
                    break;
                }
                target -= f.covered;
            }
        }
        let fragment = &self.fragments[k];
        let at = fragment.polygon.as_ref().map_or_else(|| u.as_dvec2(), |p| p.sample(u));
        self.spot(k, at)
    }

    /// Geometric normal, on the patch's side.
    #[must_use]
    pub fn normal(&self, spot: &Spot) -> Vec3 {
        self.fragments[spot.fragment].normal
    }

    /// A frame around the geometric normal, on the patch's side.
    #[must_use]
    pub fn frame(&self, spot: &Spot) -> Frame {
        self.fragments[spot.fragment].frame
    }

    /// A frame around the normal that light falls on, on the patch's side.
    #[must_use]
    pub fn shading_frame(&self, spot: &Spot) -> Frame {
        let fragment = &self.fragments[spot.fragment];
        fragment.shading.unwrap_or_else(|| {
            let SurfacePoint { triangle, b } = spot.point;
            let normal = self.tracer.scene().relief_normal_over(triangle, b, fragment.ground.normal());
            Frame::from_normal(if self.back { -normal } else { normal })
        })
    }

    /// The triangle below a point, prepared for rays.
    #[must_use]
    pub fn ground(&self, spot: &Spot) -> &Ground {
        &self.fragments[spot.fragment].ground
    }

    /// What the triangle below a point stands for, if it is a facet of something smooth.
    #[must_use]
    pub fn lift(&self, spot: &Spot) -> Option<&Lift> {
        self.fragments[spot.fragment].lift.as_ref()
    }

    /// Origin for a ray from a point toward a unit direction above the shading normal; see [`Tracer::leave_smooth`].
    #[must_use]
    #[inline]
    pub fn origin_smooth(&self, spot: &Spot, direction: Vec3) -> Option<Vec3> {
        let Fragment { ground, lift, normal, .. } = &self.fragments[spot.fragment];
        self.tracer.leave_smooth(ground, lift.as_ref(), spot.point.b, direction, *normal)
    }

    /// Origin for a ray from a point toward a direction; see [`Tracer::origin_on`].
    #[must_use]
    #[inline]
    pub fn origin(&self, spot: &Spot, direction: Vec3) -> Vec3 {
        self.tracer.leave(self.ground(spot), spot.point.b, direction)
    }

    /// A cosine-distributed ray from a point, around the normal of its triangle.
    #[must_use]
    #[inline]
    pub fn cosine_ray(&self, spot: &Spot, u: Vec2) -> Ray {
        let direction = self.frame(spot).to_world(warp::square_to_cosine_hemisphere(u));
        Ray { origin: self.origin(spot, direction), direction, t_max: f32::INFINITY }
    }
}

/// Exposed cells of a patch, triangle by triangle.
fn open_cells(patches: &Patches, patch: usize) -> Vec<OpenCell> {
    let (mut open, mut running) = (vec![], 0.0);
    let front = patches.front_patch(patch);
    for (fragment, f) in patches.fragments.range(front).enumerate() {
        patches.cell_centroids(front, f, MASK_GRID, |_, middle, area| {
            if patches.is_exposed_at(patch, middle) {
                running += area;
                let inner = area > 0.999 * CELL_AREA && patches.is_inside_exposed(patch, middle);
                let edge = if inner { 1.0 / f64::from(MASK_GRID) } else { 0.0 };
                open.push(OpenCell { fragment, middle, edge, running });
            }
        });
    }
    open
}

impl Patches {
    /// The cell of the exposure mask that a point of a patch lies in is exposed [texels from the texel's corner].
    #[must_use]
    pub fn is_exposed_at(&self, patch: usize, point: DVec2) -> bool {
        self.mask[patch] >> cell_index(point, MASK_GRID) & 1 == 1
    }
}
