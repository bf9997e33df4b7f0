//! Which side of a double-sided sheet a texel belongs to, where one of them is the inside of a hollow wall.
//!
//! Many exporters write walls as two double-sided sheets, and floor and ceiling as one surface below and above all of it.
//! What is sealed between the sheets is a [pocket](super::pockets), but where a door is cut, a gap often leads in, and then the
//! inside is a place like any other, only dark. Texels that the inner sheet cuts would hold half of it: a dark line where
//! ceiling and wall meet, in all rooms.
//!
//! In: patches, their links, and tracer. Out: texels at such sheets without the cells that lie in the wall, and for
//! [`readers`](super::readers) which texels lie wholly in it. These keep their light; their look-ups from beyond do not.
//!
//! A side belongs to the inside where all that is between it and the next surface, away from the sheet, is narrower than
//! half a metre while on the other side there is more room, and where few paths of light get out.
//!
//! Limits: where both sides are narrow, as in shelves, or both wide, texels belong to both.

use super::graph::COS_FACING;
use super::pockets::Sides;
use super::turn::narrow;
use super::{PatchGraph, Patches};
use crate::base::random::Stage;
use crate::base::{Progress, Stream, parallel};
use crate::trace::{Ray, Tracer};
use glam::{Quat, Vec3};
use std::collections::BTreeSet;

/// Directions away from a sheet in which the next surface must be near [rad], but for one that finds a gap, and their height
/// in texel edges.
const ASIDE: [f32; 3] = [0.0, 0.5, -0.5];
const MOST_ASIDE: usize = 2;
const HEIGHT: f32 = 0.3;
/// Paths of light from each texel, and the part of those from it and around it that may get out.
const PATHS: u32 = 8;
const OUT: f32 = 1.0 / 3.0;

/// Where a patch lies beside hollow walls.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) enum Hollow {
    /// In the open, or in a place that is not looked at.
    #[default]
    No,
    /// Inside, but not at the sheet.
    Within,
    /// Inside, right behind the sheet.
    Behind,
}

/// Takes what lies inside of hollow walls from texels at their border. What each patch is; nothing if all are in the open.
pub(super) fn open(patches: &mut Patches, tracer: &Tracer<'_>, graph: &PatchGraph, progress: &Progress) -> Vec<Hollow> {
    let behind = patches.behind_sheets(tracer, graph, progress);
    if behind.is_empty() {
        return vec![];
    }
    let mut places = vec![Hollow::No; patches.len()];
    let around = behind.iter().flat_map(|&i| graph.neighbors(i as usize));
    around.for_each(|&i| places[i as usize] = Hollow::Within);
    behind.iter().for_each(|&i| places[i as usize] = Hollow::Behind);
    let inside: BTreeSet<u32> = (0..).zip(&places).filter(|(_, p)| **p != Hollow::No).map(|(i, _)| i).collect();
    let around = behind.iter().flat_map(|&i| patches.around_in_chart(i as usize).map(|j| j as u32));
    let beyond: BTreeSet<u32> = around.filter(|&j| places[j as usize] == Hollow::No).collect();
    // Of a texel that the sheet halves, the middle may lie on either side.
    let halved = |j: &u32| {
        let (from, around) = (patches.above(*j as usize), patches.around_in_chart(*j as usize));
        around.filter(|i| inside.contains(&(*i as u32))).any(|i| patches.is_seen(tracer, from, i))
    };
    let halved: BTreeSet<u32> = beyond.iter().copied().filter(halved).collect();
    let touched: Vec<u32> = beyond.into_iter().chain(behind).collect();
    let sides = Sides { closed: &inside, unknown: &halved, closed_stay: false };
    let left =
        parallel::map_watched(touched.len(), progress, |k| patches.open_cells(tracer, touched[k] as usize, &sides));
    for (i, left) in touched.into_iter().zip(left) {
        if left.exposed > 0.0 {
            places[i as usize] = Hollow::No;
            if left.is_less_than(patches.exposed[i as usize]) {
                patches.keep(i as usize, left);
            }
        }
    }
    places
}

impl Patches {
    /// Where a patch lies beside hollow walls.
    pub(super) fn hollow(&self, patch: usize) -> Hollow {
        self.hollows.get(patch).copied().unwrap_or_default()
    }

    /// Patches inside of hollow walls beside others that are not, ascending.
    fn behind_sheets(&self, tracer: &Tracer<'_>, graph: &PatchGraph, progress: &Progress) -> Vec<u32> {
        let found = parallel::map_watched(self.len(), progress, |i| {
            let is_behind = |&j: &usize| {
                let away = self.position[i] - self.position[j];
                self.is_parted(tracer, graph, i, j) && self.is_near(tracer, i, away) && !self.is_near(tracer, j, -away)
            };
            self.exposed[i] > 0.0 && self.around_in_chart(i).any(|j| is_behind(&j))
        });
        let found: Vec<u32> = (0..).zip(found).filter(|(_, found)| *found).map(|(i, _)| i).collect();
        let out = parallel::map_watched(found.len(), progress, |k| {
            let mut way = 0;
            let finds_out = |path: &u32| {
                let mut stream = Stream::new(1, Stage::Pockets, u64::from(found[k]), u64::from(*path));
                self.finds_out(tracer, found[k] as usize, &mut stream, &mut way)
            };
            (0..PATHS).filter(finds_out).count() as u32
        });
        let is_shut = |k: &usize| {
            let around = graph.neighbors(found[*k] as usize).iter().filter_map(|j| found.binary_search(j).ok());
            let (out, n) = around.chain([*k]).fold((0, 0), |(sum, n), k| (sum + out[k], n + PATHS));
            out as f32 <= OUT * n as f32
        };
        (0..found.len()).filter(is_shut).map(|k| found[k]).collect()
    }

    /// A sheet stands between two patches of a surface.
    fn is_parted(&self, tracer: &Tracer<'_>, graph: &PatchGraph, i: usize, j: usize) -> bool {
        graph.neighbors(i).binary_search(&(j as u32)).is_err()
            && self.normal[i].dot(self.normal[j]) >= COS_FACING
            && !self.is_seen(tracer, self.above(i), j)
    }

    /// Along the surface, away from a sheet, the next one is near.
    fn is_near(&self, tracer: &Tracer<'_>, patch: usize, away: Vec3) -> bool {
        let (normal, edge) = (self.normal[patch], self.texel_edge(patch));
        let origin = self.position[patch] + normal * (HEIGHT * edge);
        let along = (away - normal * away.dot(normal)).normalize_or_zero();
        let is_near = |angle: &&f32| {
            let direction = Quat::from_axis_angle(normal, **angle) * along;
            tracer.occluded(&Ray { origin, direction, t_max: narrow(edge) })
        };
        ASIDE.iter().filter(is_near).count() >= MOST_ASIDE
    }
}
