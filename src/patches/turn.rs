//! Double-sided surfaces whose front nobody looks at: which they may be, and texels that stand for the back.
//!
//! A lightmap has one value for both sides of a surface. Of shells that were modelled inside out, of mouldings and tapes
//! that lie with their front on a wall or floor, and of walls of rooms with their fronts outward, where there is no outside,
//! the front is dark and nobody sees it, while the back faces the room. Such charts are [`turned`](Patches::turn): their
//! front patches then are what lies on the back of their triangles. Whether the front is dark, and whether light comes from
//! infinity, is for those to find who know the light; here it is only found what lies [`Before`] it.
//!
//! In: patches and tracer. Out: charts, ascending, and what lies before them. Invariants: a chart of single-sided surfaces
//! is never named; one most of which faces a room that one can stand in neither, lit or not.

use super::Patches;
use crate::atlas::Atlas;
use crate::base::{Frame, Progress, parallel, warp};
use crate::trace::{Closed, Ground, Ray, Tracer};
use glam::{Vec2, Vec3};

/// Most texels of a chart that are looked from.
const TEXELS: usize = 64;
/// Rays from each.
const RAYS: u32 = 4;
/// A pocket is narrower than this, half way between a wardrobe and a closet [m] …
const NARROW: f32 = 0.5;
/// … and than this in texels, whatever the scene's unit.
const NARROW_TEXELS: f32 = 16.0;
/// In a gap most rays rise no higher above the surface than this [m]: the insides of walls of half a metre are gaps …
const NEAR: f32 = 0.55;
/// … nor than this in texels.
const NEAR_TEXELS: f32 = 24.0;
/// And they are no longer than this many times as much: of rays along a corner of a room some do not rise high either.
const SLANT: f32 = 3.0;
/// Part of the rays that may leave a gap for the open, through cracks.
const ESCAPE: f64 = 0.02;
/// Nobody looks into a slit: most rays meet something within this [m]. Tapes lie 15 mm above a floor …
const THIN: f32 = 0.05;
/// … and within this in texels, whatever the scene's unit.
const THIN_TEXELS: f32 = 2.0;
/// Part of the rays of a slit that do so: of those from such tapes 82 to 98 %, from a sheet 25 mm off another so many.
const TOUCHING: f64 = 0.75;
/// Part of the rays that are lost from a surface before the void. Ground before a wall takes half of them; from a hall's
/// outer walls 79 to 95 % are lost.
const VOID: f64 = 0.7;
/// Part of the rays that a room may lose. From the insides of that hall's walls at most 2 % are lost, from a cube's without
/// ceiling a fifth, from low ones around a wide floor nearly half.
const ROOFLESS: f64 = 0.5;

/// What lies before the front of a chart.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Before {
    /// A narrow gap that only cracks lead out of.
    Gap,
    /// A slit too thin to look into, wherever it leads to.
    Slit,
    /// Hardly anything, while there is a room behind.
    Void,
}

/// How wide a pocket may be for texels of this edge [m].
#[must_use]
pub fn narrow(texel_edge: f32) -> f32 {
    NARROW.min(NARROW_TEXELS * texel_edge)
}

impl Patches {
    /// The patch lies on the back of its triangles.
    #[must_use]
    pub fn is_behind(&self, patch: usize) -> bool {
        self.is_back(patch) != self.is_turned(self.front_patch(patch))
    }

    /// Texels of this chart stand for the back.
    #[must_use]
    pub fn is_turned_chart(&self, chart: u32) -> bool {
        self.turned.binary_search(&chart).is_ok()
    }

    /// A front patch lies on the back of its triangles.
    pub(super) fn is_turned(&self, front: usize) -> bool {
        !self.turned.is_empty() && self.is_turned_chart(self.chart[front])
    }

    /// Exchanges front and back of charts, ascending, that are double-sided.
    pub fn turn(&mut self, tracer: &Tracer<'_>, charts: Vec<u32>, progress: &Progress) {
        self.turned = charts;
        if self.turned.is_empty() {
            return;
        }
        for front in 0..self.front {
            let back = self.back_of[front];
            if back != super::NO_PATCH && self.is_turned(front) {
                self.normal.swap(front, back as usize);
                self.position.swap(front, back as usize);
                self.exposed.swap(front, back as usize);
                self.mask.swap(front, back as usize);
                if !self.hollows.is_empty() {
                    self.hollows.swap(front, back as usize);
                }
            }
        }
        self.find_readers(tracer, &Closed::new(tracer.scene()), progress);
        self.find_plain();
    }

    /// Double-sided charts, ascending, that face a slit, a gap or the void.
    #[must_use]
    pub fn averted_charts(&self, tracer: &Tracer<'_>, atlas: &Atlas, progress: &Progress) -> Vec<(u32, Before)> {
        let mut texels: Vec<(u32, u32)> = self.front_of.iter().map(|&i| (self.chart[i as usize], i)).collect();
        let takes_part =
            |i: usize| self.exposed[i] > 0.0 || self.opposite(i).is_some_and(|back| self.exposed[back] > 0.0);
        texels.retain(|&(chart, i)| (chart as usize) < atlas.charts.len() && takes_part(i as usize));
        texels.sort_unstable();
        let charts: Vec<&[(u32, u32)]> = texels.chunk_by(|a, b| a.0 == b.0).collect();
        let before = parallel::map_watched(charts.len(), progress, |c| self.before(tracer, charts[c]));
        charts.iter().zip(before).filter_map(|(texels, before)| Some((texels[0].0, before?))).collect()
    }

    /// What the front of a chart looks at, if that is a slit, a gap or the void.
    fn before(&self, tracer: &Tracer<'_>, texels: &[(u32, u32)]) -> Option<Before> {
        let front = self.view(tracer, texels, true);
        if front.is_slit() && !self.view(tracer, texels, false).is_slit() {
            return Some(Before::Slit);
        }
        if front.is_gap() {
            return Some(Before::Gap);
        }
        (front.is_void() && self.view(tracer, texels, false).is_room()).then_some(Before::Void)
    }

    /// Looks from texels of a chart, on the front or the back of its triangles.
    fn view(&self, tracer: &Tracer<'_>, texels: &[(u32, u32)], front: bool) -> View {
        let count = texels.len().min(TEXELS);
        let mut view = View::default();
        for k in 0..count {
            let front_patch = texels[k * texels.len() / count].1 as usize;
            let patch = if front { Some(front_patch) } else { self.opposite(front_patch) };
            let Some(patch) = patch else { continue };
            // It lies in a pocket.
            if self.exposed[patch] <= 0.0 {
                view.pocket();
                continue;
            }
            let Some(point) = self.middle(tracer, patch) else { continue };
            let ground = Ground::new(tracer.scene().corners(point.triangle));
            let frame = Frame::from_normal(if front { ground.normal() } else { -ground.normal() });
            for r in 0..RAYS {
                let golden = (view.rays as f32 * 0.618_034).fract();
                let u = Vec2::new((r as f32 + 0.5) / RAYS as f32, golden);
                let direction = frame.to_world(warp::square_to_cosine_hemisphere(u));
                let origin = tracer.leave(&ground, point.b, direction);
                let hit = tracer.closest_hit(&Ray { origin, direction, t_max: f32::INFINITY });
                let rise = direction.dot(frame.to_world(Vec3::Z)).max(1.0 / SLANT);
                view.add(hit.map(|h| h.t), rise, self.texel_edge(patch));
            }
        }
        view
    }
}

/// How far one sees from a side of a chart: numbers of cosine-distributed rays.
#[derive(Debug, Default)]
struct View {
    rays: u32,
    /// Met nothing.
    escaped: u32,
    /// Met something less than [`NEAR`] above the surface.
    near: u32,
    /// Met something within [`THIN`].
    touching: u32,
}

impl View {
    /// A ray that met something at `distance`, and rose by `rise` per metre.
    fn add(&mut self, distance: Option<f32>, rise: f32, edge: f32) {
        let within = |distance: Option<f32>, metres: f32, texels: f32| {
            u32::from(distance.is_some_and(|t| t < metres.min(texels * edge)))
        };
        self.rays += 1;
        self.escaped += u32::from(distance.is_none());
        self.near += within(distance.map(|t| t * rise), NEAR, NEAR_TEXELS);
        self.touching += within(distance, THIN, THIN_TEXELS);
    }

    /// All rays of a point end where it is narrow.
    fn pocket(&mut self) {
        self.rays += RAYS;
        self.near += RAYS;
        self.touching += RAYS;
    }

    fn part(&self, rays: u32) -> f64 {
        f64::from(rays) / f64::from(self.rays.max(1))
    }

    fn is_gap(&self) -> bool {
        2 * self.near > self.rays && self.part(self.escaped) <= ESCAPE
    }

    fn is_slit(&self) -> bool {
        self.part(self.touching) > TOUCHING
    }

    fn is_void(&self) -> bool {
        self.part(self.escaped) > VOID
    }

    fn is_room(&self) -> bool {
        2 * self.near < self.rays && self.part(self.escaped) < ROOFLESS
    }
}
