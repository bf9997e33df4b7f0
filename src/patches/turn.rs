//! Double-sided surfaces whose front looks into a narrow gap: which they are, and texels that stand for the back.
//!
//! A lightmap has one value for both sides of a surface. Of shells that were modelled inside out, and of mouldings that
//! lie with their front on a wall, the front is dark and nobody sees it, while the back faces the room. Such charts are
//! [`turned`](Patches::turn): their front patches then are what lies on the back of their triangles. Whether a gap is
//! dark is for those to find who know the light; here it is only found that it is narrow.
//!
//! In: patches and tracer. Out: charts, ascending. Invariants: a chart of single-sided surfaces is never named; a room
//! that one can stand in is no gap.

use super::Patches;
use crate::atlas::Atlas;
use crate::base::{Frame, Progress, parallel, warp};
use crate::trace::{Closed, Ground, Ray, Tracer};
use glam::Vec2;

/// Most texels of a chart that are looked from.
const TEXELS: usize = 64;
/// Rays from each.
const RAYS: u32 = 4;
/// A gap is narrower than this, half way between a wardrobe and a closet [m] …
pub(super) const NARROW: f32 = 0.5;
/// … and than this in texels, whatever the scene's unit.
pub(super) const NARROW_TEXELS: f32 = 16.0;
/// Part of the rays that may leave a gap for the open, through cracks.
const ESCAPE: f64 = 0.02;

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
            }
        }
        self.find_readers(tracer, &Closed::new(tracer.scene()), progress);
    }

    /// Double-sided charts whose fronts see nothing but what is near.
    #[must_use]
    pub fn narrow_charts(&self, tracer: &Tracer<'_>, atlas: &Atlas, progress: &Progress) -> Vec<u32> {
        let mut texels: Vec<(u32, u32)> = self.front_of.iter().map(|&i| (self.chart[i as usize], i)).collect();
        let takes_part =
            |i: usize| self.exposed[i] > 0.0 || self.opposite(i).is_some_and(|back| self.exposed[back] > 0.0);
        texels.retain(|&(chart, i)| (chart as usize) < atlas.charts.len() && takes_part(i as usize));
        texels.sort_unstable();
        let charts: Vec<&[(u32, u32)]> = texels.chunk_by(|a, b| a.0 == b.0).collect();
        let narrow = parallel::map_watched(charts.len(), progress, |c| self.is_narrow(tracer, charts[c]));
        charts.iter().zip(narrow).filter(|(_, narrow)| *narrow).map(|(texels, _)| texels[0].0).collect()
    }

    fn is_narrow(&self, tracer: &Tracer<'_>, texels: &[(u32, u32)]) -> bool {
        let count = texels.len().min(TEXELS);
        let (mut rays, mut escaped, mut near) = (0u32, 0u32, 0u32);
        for k in 0..count {
            let patch = texels[k * texels.len() / count].1 as usize;
            // It lies in a pocket.
            if self.exposed[patch] <= 0.0 {
                (rays, near) = (rays + RAYS, near + RAYS);
                continue;
            }
            let Some(point) = self.middle(tracer, patch) else { continue };
            let ground = Ground::new(tracer.scene().corners(point.triangle));
            let frame = Frame::from_normal(ground.normal());
            let limit = NARROW.min(NARROW_TEXELS * self.texel_edge(patch));
            for r in 0..RAYS {
                let golden = (rays as f32 * 0.618_034).fract();
                let u = Vec2::new((r as f32 + 0.5) / RAYS as f32, golden);
                let direction = frame.to_world(warp::square_to_cosine_hemisphere(u));
                let origin = tracer.leave(&ground, point.b, direction);
                let hit = tracer.closest_hit(&Ray { origin, direction, t_max: f32::INFINITY });
                rays += 1;
                escaped += u32::from(hit.is_none());
                near += u32::from(hit.is_some_and(|h| h.t < limit));
            }
        }
        2 * near > rays && f64::from(escaped) <= ESCAPE * f64::from(rays)
    }
}
