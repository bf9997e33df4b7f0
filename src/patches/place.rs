//! From a hit to its patch, and from a patch to its place on the page.
//!
//! Invariant: with [`Patches::receives`], a patch receives no light where it is inside another solid, a cell of the
//! exposure mask along its border aside.
//!
//! A wall can leave a strip of a texel open that is narrower than half a cell, so that the texel counts as hidden. What
//! hits the strip hits the texel beside it: taken as dark, strips in two rooms at 6.5 texels per metre swallowed 0.15 % of
//! all power, and indirect light was 0.5 % too low.

use super::cells::MASK_GRID;
use super::readers::around;
use super::surface::Map;
use super::{NO_PATCH, Patches, SurfacePoint};
use crate::atlas::raster::{self, Polygon};
use crate::scene::Scene;
use crate::trace::Hit;
use glam::{DVec2, Vec2};

/// Texels of a tile that share a low-discrepancy sequence; the rest of its 2³² points are for rays.
const TILE: u32 = 1 << 16;

/// Where a ray meets a patch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seen {
    /// The patch.
    pub patch: usize,
    /// The point, from the corner of the texel [texels].
    pub within: Vec2,
}

impl Patches {
    /// The patch that a hit lands on; `None` on triangles without texels and on the back of single-sided ones.
    #[must_use]
    pub fn at(&self, hit: &Hit) -> Option<usize> {
        self.seen(hit).map(|seen| seen.patch)
    }

    /// The same, and where in its texel the hit lies.
    #[must_use]
    #[inline]
    pub fn seen(&self, hit: &Hit) -> Option<Seen> {
        let t = self.surface.of(hit.triangle);
        if t.page == NO_PATCH || (!hit.front && !t.two_sided) {
            return None;
        }
        let uv = t.at(hit);
        let corner = uv.floor();
        let at_corner = self.grid_at(t.page, corner.x as i32, corner.y as i32);
        let (patch, corner) = match at_corner {
            Some(front) if self.is_plain(front as usize) => {
                (if hit.front { front } else { self.back_of[front as usize] }, corner)
            }
            _ => self.seen_beside(t.page, uv, at_corner, hit)?,
        };
        let within = (uv - corner).clamp(Vec2::ZERO, Vec2::ONE);
        (patch != NO_PATCH).then_some(Seen { patch: patch as usize, within })
    }

    /// The same where that is not as simple: the patch, and the corner of its texel. `at_corner` is what the grid has at the
    /// hit, which is at `uv` on its page [texels].
    fn seen_beside(&self, page: u32, uv: Vec2, at_corner: Option<u32>, hit: &Hit) -> Option<(u32, Vec2)> {
        let mut front = at_corner.or_else(|| self.nearest(page, uv, hit.triangle))?;
        if self.exposed[front as usize] <= 0.0 {
            front = self.exposed_beside(front as usize, uv).unwrap_or(front);
        }
        let patch = if hit.front != self.is_turned(front as usize) { front } else { self.back_of[front as usize] };
        let (x, y) = self.texel_xy(front as usize);
        Some((patch, Vec2::new(x as f32, y as f32)))
    }

    /// See `plain`; false for back patches. Most of what rays meet is plain, and a bit is in the cache when the rest of a
    /// patch is not.
    #[inline]
    fn is_plain(&self, patch: usize) -> bool {
        self.plain.get(patch / 64).is_some_and(|bits| bits >> (patch % 64) & 1 == 1)
    }

    /// Finds `plain`, once the other lists are known.
    pub(super) fn find_plain(&mut self) {
        let mut plain = vec![0; self.front.div_ceil(64)];
        for i in (0..self.front).filter(|&i| self.exposed[i] > 0.0 && self.mask[i] == u64::MAX && !self.is_turned(i)) {
            plain[i / 64] |= 1 << (i % 64);
        }
        self.plain = plain;
    }

    /// A hit that landed on `patch` lies on its exposed part, or at most a cell of the mask away from it: cells are in
    /// or out by their centroid, and light that reaches the open half of one that is out makes up for what the closed
    /// half of another cannot receive. Flux from farther in would be spread over too small an area.
    #[must_use]
    pub fn receives(&self, patch: usize, hit: &Hit) -> bool {
        if self.is_plain(patch) || self.mask[patch] == u64::MAX {
            return true;
        }
        let uv = self.surface.of(hit.triangle).at(hit);
        let (x, y) = self.texel_xy(self.front_patch(patch));
        let local = (uv - Vec2::new(x as f32, y as f32)).clamp(Vec2::ZERO, Vec2::ONE);
        self.is_near_exposed(patch, local.as_dvec2())
    }

    /// The front patch of a texel.
    #[must_use]
    pub fn front_at(&self, page: u32, x: i32, y: i32) -> Option<usize> {
        self.grid_at(page, x, y).map(|id| id as usize)
    }

    /// Number of the front patch of a texel.
    pub(super) fn grid_at(&self, page: u32, x: i32, y: i32) -> Option<u32> {
        let [width, height] = self.page_size;
        if x < 0 || y < 0 || x >= width as i32 || y >= height as i32 {
            return None;
        }
        let id = self.grid[self.texel_number([page, x as u32, y as u32]) as usize];
        (id != NO_PATCH).then_some(id)
    }

    /// Rounding can put a point of a chart's border into a texel next to the chart: the nearest texel that has this
    /// triangle is meant.
    fn nearest(&self, page: u32, uv: Vec2, triangle: u32) -> Option<u32> {
        let (x, y) = (uv.x.floor() as i32, uv.y.floor() as i32);
        let mut best: Option<(f32, u32)> = None;
        for (dx, dy) in [(0, -1), (-1, 0), (1, 0), (0, 1), (-1, -1), (1, -1), (-1, 1), (1, 1)] {
            let Some(id) = self.grid_at(page, x + dx, y + dy) else { continue };
            if !self.triangles(id as usize).any(|t| t == triangle) {
                continue;
            }
            let center = Vec2::new((x + dx) as f32 + 0.5, (y + dy) as f32 + 0.5);
            let distance = center.distance_squared(uv);
            if best.is_none_or(|(d, _)| distance < d) {
                best = Some((distance, id));
            }
        }
        best.map(|(_, id)| id)
    }

    /// The exposed texel of the chart that a point on a hidden one is closest to, at most the width of a cell of the mask
    /// away; the point on the page [texels].
    fn exposed_beside(&self, hidden: usize, uv: Vec2) -> Option<u32> {
        const REACH: f32 = 1.0 / MASK_GRID as f32;
        let (page, (x, y)) = (self.page(hidden), self.texel_xy(hidden));
        let beside = around().filter_map(|(dx, dy)| {
            let (x, y) = (x as i32 + dx, y as i32 + dy);
            let open = |id: &u32| self.exposed[*id as usize] > 0.0 && self.chart[*id as usize] == self.chart[hidden];
            let id = self.grid_at(page, x, y).filter(open)?;
            let corner = Vec2::new(x as f32, y as f32);
            Some((uv.distance_squared(uv.clamp(corner, corner + 1.0)), id))
        });
        let nearest = beside.min_by(|a, b| a.0.total_cmp(&b.0))?;
        (nearest.0 <= REACH * REACH).then_some(nearest.1)
    }

    /// Column and row of a front patch's texel within its page.
    #[must_use]
    pub fn texel_xy(&self, front: usize) -> (u32, u32) {
        let [width, height] = self.page_size;
        let texel = self.texel[front];
        (texel % width, (texel / width) % height)
    }

    /// Position of a front patch's texel on the Z-order curve of its page: texels that are close to each other on the
    /// curve are close on the page.
    fn curve_index(&self, front: usize) -> u32 {
        let (x, y) = self.texel_xy(front);
        spread_bits(x) | spread_bits(y) << 1
    }

    /// Page of a front patch's texel.
    #[must_use]
    pub fn page(&self, front: usize) -> u32 {
        self.texel[front] / (self.page_size[0] * self.page_size[1])
    }

    /// Number of a texel by page, column and row: (page · height + y) · width + x.
    #[must_use]
    pub fn texel_number(&self, [page, x, y]: [u32; 3]) -> u32 {
        let [width, height] = self.page_size;
        (page * height + y) * width + x
    }

    /// The tile that a front patch's texel belongs to, along the Z-order curves of all pages, and its place there, below
    /// 2¹⁶: texels of a tile share a low-discrepancy sequence that has as many points for each of them.
    #[must_use]
    pub fn tile(&self, front: usize) -> (u64, u32) {
        let place = self.curve_index(front);
        (u64::from(self.page(front)) << 32 | u64::from(place / TILE), place % TILE)
    }

    /// The polygon of fragment `f` (absolute index) within its texel, in texel coordinates.
    pub(super) fn polygon(&self, front: usize, f: usize) -> Polygon {
        // Most texels are of this kind, and cutting one out of a triangle takes a tenth of a microsecond.
        if self.fragments.covered[f] >= 1.0 {
            return Polygon::square();
        }
        let (x, y) = self.texel_xy(front);
        raster::within_texel(self.surface.of(self.fragments.triangle(front, f)).uv, x, y)
    }

    /// The triangles that reach into a front patch's texel, each with its polygon in texel coordinates.
    pub fn pieces(&self, front: usize) -> impl Iterator<Item = (u32, Polygon)> + '_ {
        self.fragments.range(front).map(move |f| (self.fragments.triangle(front, f), self.polygon(front, f)))
    }

    /// The triangles that reach into a front patch's texel.
    pub fn triangles(&self, front: usize) -> impl Iterator<Item = u32> + '_ {
        self.fragments.range(front).map(move |f| self.fragments.triangle(front, f))
    }

    /// A patch lights others: see [`Treatment::casts`](crate::scene::Treatment). Of patches that do not, no ray meets the
    /// surface.
    #[must_use]
    pub fn casts(&self, scene: &Scene, patch: usize) -> bool {
        let first = self.triangles(self.front_patch(patch)).next();
        first.is_none_or(|t| scene.part(t).treatment.casts)
    }

    /// Where a point of a front patch's texel lies on a triangle, clamped to it [texels from the texel's corner].
    #[must_use]
    pub fn point_on(&self, front: usize, triangle: u32, within: DVec2) -> SurfacePoint {
        SurfacePoint { triangle, b: self.map(triangle, front).weights(within) }
    }

    /// What lies at a position on a page [texels]: front patch, and point of the first of its triangles that covers it.
    #[must_use]
    pub fn surface_at(&self, page: u32, uv: Vec2) -> Option<(usize, SurfacePoint)> {
        let corner = uv.floor();
        let front = self.front_at(page, corner.x as i32, corner.y as i32).filter(|_| uv.is_finite())?;
        let within = (uv - corner).as_dvec2();
        let covers = |t: &u32| self.map(*t, front).outside(within) <= 0.0;
        let triangle = self.triangles(front).find(covers)?;
        Some((front, self.point_on(front, triangle, within)))
    }

    /// From the texel's coordinates to the weights of a triangle.
    pub(super) fn map(&self, triangle: u32, front: usize) -> Map {
        let (x, y) = self.texel_xy(front);
        let origin = DVec2::new(f64::from(x), f64::from(y));
        Map::new(self.surface.of(triangle).uv.map(|p| p.as_dvec2() - origin))
    }
}

/// The lower 16 bits of v, a zero between any two of them.
fn spread_bits(v: u32) -> u32 {
    let mut v = v & 0xffff;
    for (shift, mask) in [(8, 0x00ff_00ff), (4, 0x0f0f_0f0f), (2, 0x3333_3333), (1, 0x5555_5555)] {
        v = (v | v << shift) & mask;
    }
    v
}
