//! Pockets: where a surface goes on inside a wall that is made of double-sided sheets, or under what stands on it.
//!
//! A floor is often one surface below all rooms and their walls. Inside of a wall of single-sided surfaces rays meet backs
//! ([`exposed`](super::exposed)); double-sided ones have none, and many exporters write nothing else. Their pockets are
//! known by what they are: out of sight of the surface around, narrow, and sealed: paths of light that start there do not
//! get to where it is wide. They take no part in light, and are filled from what is in the open. Left as it was, every wall
//! of a flat had a dark strip at its foot, up to one and a half texels wide.
//!
//! In: patches, their links, and tracer. Out: exposed shares and cells without pockets.
//!
//! Invariants: what sees surface of its own chart in the open is in no pocket; a room that one can stand in is none. A
//! chart that lies in pockets as a whole stays: nothing could fill it, and no look-up mixes it with what is lit.
//!
//! Limits: of walls thinner than two texels, and of shells that are half a metre wide or more and open to the floor, the
//! inside stays.

use super::cells::{MASK_GRID, cell_index};
use super::exposed::{LEAST_EXPOSED, LOW};
use super::turn::narrow;
use super::{PatchGraph, Patches, SurfacePoint, readers};
use crate::base::random::Stage;
use crate::base::{Frame, Progress, Sets, Stream, parallel, warp};
use crate::trace::{Ground, Ray, Tracer};
use glam::{Vec2, Vec3};
use std::collections::{BTreeMap, BTreeSet};

/// Paths that start in a pocket: so many per texel, at least and at most; and their segments.
const PATHS_PER_TEXEL: usize = 4;
const LEAST_PATHS: usize = 8;
const MOST_PATHS: usize = 64;
const SEGMENTS: usize = 12;
/// One of so many may find a way out, through cracks. Of 700 such places in two flats, one in nine had fewer ways out than
/// this, but not none, and the others mostly three in four.
const ONE_OUT_OF: usize = 16;

/// Shares of a texel that differ by less are the same.
const ROUNDING: f32 = 1e-4;

/// Texels that see each other, and others beside them that they do not see.
#[derive(Debug, Default)]
struct Pocket {
    /// Ascending.
    inside: Vec<u32>,
    /// Patches of the same charts that touch it on the page.
    beside: Vec<u32>,
}

/// Takes pockets out of the light, and the parts of texels around that lie in them.
pub(super) fn close(patches: &mut Patches, tracer: &Tracer<'_>, graph: &PatchGraph, progress: &Progress) {
    let pockets = patches.pockets(tracer, graph, progress);
    let closed: BTreeSet<u32> = pockets.iter().flat_map(|pocket| pocket.inside.iter().copied()).collect();
    let mut cut: Vec<u32> = pockets.iter().flat_map(|pocket| pocket.beside.iter().copied()).collect();
    let is_cut = |i: &u32| patches.around_in_chart(*i as usize).any(|j| !closed.contains(&(j as u32)));
    cut.extend(closed.iter().copied().filter(is_cut));
    cut.sort_unstable();
    cut.dedup();
    let sides = Sides { closed: &closed, unknown: &BTreeSet::new(), closed_stay: true };
    let left = parallel::map_watched(cut.len(), progress, |k| patches.open_cells(tracer, cut[k] as usize, &sides));
    let left: BTreeMap<u32, Left> = cut.into_iter().zip(left).collect();
    let stays = |i: &u32| left.get(i).map_or(!closed.contains(i), |left| left.exposed > 0.0);
    let side = |i: u32| (patches.chart[patches.front_patch(i as usize)], patches.is_back(i as usize));
    let exposed = (0..patches.len() as u32).filter(|&i| patches.exposed[i as usize] > 0.0);
    let open: BTreeSet<(u32, bool)> = exposed.filter(stays).map(side).collect();
    let shut: Vec<u32> =
        closed.iter().copied().filter(|&i| open.contains(&side(i)) && !left.contains_key(&i)).collect();
    let left: Vec<(u32, Left)> = left.into_iter().filter(|(i, _)| open.contains(&side(*i))).collect();
    for (i, left) in left.into_iter().chain(shut.into_iter().map(|i| (i, Left::default()))) {
        patches.keep(i as usize, left);
    }
}

impl Patches {
    /// Narrow and sealed places in which surface goes on, out of sight of the surface around.
    fn pockets(&self, tracer: &Tracer<'_>, graph: &PatchGraph, progress: &Progress) -> Vec<Pocket> {
        let regions = self.regions(graph);
        let mut found: BTreeMap<u32, Pocket> = BTreeMap::new();
        let beside = parallel::map(self.len(), |i| {
            let apart = |j: &usize| self.exposed[i] > 0.0 && regions[*j] != regions[i];
            self.around_in_chart(i).filter(apart).map(|j| j as u32).collect::<Vec<u32>>()
        });
        for (i, beside) in beside.into_iter().enumerate().filter(|(_, beside)| !beside.is_empty()) {
            found.entry(regions[i]).or_default().beside.extend(beside);
        }
        for i in (0..self.len()).filter(|&i| self.exposed[i] > 0.0) {
            if let Some(pocket) = found.get_mut(&regions[i]) {
                pocket.inside.push(i as u32);
            }
        }
        let mut pockets: Vec<Pocket> = found.into_values().collect();
        let sealed =
            parallel::map_watched(pockets.len(), progress, |p| self.is_sealed_place(tracer, &pockets[p].inside));
        let mut sealed = sealed.into_iter();
        pockets.retain(|_| sealed.next().unwrap_or(false));
        pockets
    }

    /// Patches around one in its chart, on its side, that take part in light.
    pub fn around_in_chart(&self, patch: usize) -> impl Iterator<Item = usize> + '_ {
        let front = self.front_patch(patch);
        let (page, (x, y)) = (self.page(front), self.texel_xy(front));
        let at = move |(dx, dy)| self.front_at(page, x as i32 + dx, y as i32 + dy);
        let of_chart = readers::around().filter_map(at).filter(move |&j| self.chart[j] == self.chart[front]);
        let on_side = of_chart.filter_map(move |j| if self.is_back(patch) { self.opposite(j) } else { Some(j) });
        on_side.filter(|&j| self.exposed[j] > 0.0)
    }

    /// Patches that are linked, by a number for each.
    #[must_use]
    pub fn regions(&self, graph: &PatchGraph) -> Vec<u32> {
        let mut sets = Sets::new(self.len());
        for i in 0..self.len() {
            graph.neighbors(i).iter().copied().chain(graph.across(i)).for_each(|j| sets.join(i, j as usize));
        }
        sets.numbers()
    }

    /// Paths from these texels stay where it is narrow.
    fn is_sealed_place(&self, tracer: &Tracer<'_>, texels: &[u32]) -> bool {
        let (mut out, paths) = (0, (PATHS_PER_TEXEL * texels.len()).clamp(LEAST_PATHS, MOST_PATHS));
        let mut way = 0;
        for k in 0..paths {
            let patch = texels[k * texels.len() / paths] as usize;
            let mut stream = Stream::new(0, Stage::Pockets, patch as u64, k as u64);
            out += usize::from(self.finds_out(tracer, patch, &mut stream, &mut way));
            if out > paths / ONE_OUT_OF {
                return false;
            }
        }
        true
    }

    /// A diffuse path from a patch gets to where it is not narrow. `way` is as in [`is_narrow`].
    pub(super) fn finds_out(&self, tracer: &Tracer<'_>, patch: usize, stream: &mut Stream, way: &mut usize) -> bool {
        let scene = tracer.scene();
        let Some(point) = self.middle(tracer, patch) else { return true };
        // The bottom of a cupboard lies on it.
        let ground = || Ground::new(scene.corners(point.triangle));
        if !self.is_behind(patch) && self.party.sealed_by(tracer, &ground(), point).is_some() {
            return false;
        }
        let limit = narrow(self.texel_edge(patch));
        let mut is_wide = |middle: Vec3| !is_narrow(tracer, middle, limit, way);
        let (mut triangle, mut b, mut front) = (point.triangle, point.b, !self.is_behind(patch));
        let mut last = Width::Narrow;
        for _ in 0..SEGMENTS {
            let ground = Ground::new(scene.corners(triangle));
            let normal = if front { ground.normal() } else { -ground.normal() };
            let u = Vec2::new(stream.next_f32(), stream.next_f32());
            let direction = Frame::from_normal(normal).to_world(warp::square_to_cosine_hemisphere(u));
            let origin = tracer.leave(&ground, b, direction);
            let Some(hit) = tracer.closest_hit(&Ray { origin, direction, t_max: f32::INFINITY }) else { return true };
            // Where walls meet at a corner, it is a little wider than in them: two in a row must be wide.
            let middle = origin + direction * (0.5 * hit.t);
            last = match last {
                Width::Narrow => Width::Unknown(middle),
                Width::Unknown(_) | Width::Wide if !is_wide(middle) => Width::Narrow,
                Width::Unknown(before) if !is_wide(before) => Width::Wide,
                Width::Unknown(_) | Width::Wide => return true,
            };
            (triangle, b, front) = (hit.triangle, hit.b, hit.front);
        }
        false
    }

    /// What does not lie in closed pockets of a texel at their border: cells that see no closed texel beside it, or also
    /// one that stays.
    pub(super) fn open_cells(&self, tracer: &Tracer<'_>, patch: usize, sides: &Sides<'_>) -> Left {
        let (shut, open): (Vec<usize>, Vec<usize>) =
            self.around_in_chart(patch).partition(|&j| sides.closed.contains(&(j as u32)));
        let known = |j: &usize| !sides.unknown.contains(&(*j as u32));
        let open: Vec<usize> = open.into_iter().filter(known).collect();
        let stays_unseen = sides.closed_stay || !sides.closed.contains(&(patch as u32));
        let sees_any = |from: Vec3, others: &[usize]| others.iter().any(|&j| self.is_seen(tracer, from, j));
        let stays = |position: Vec3| {
            let from = self.lifted(patch, position);
            // What is open first: most cells see the next texel, and few see none of either.
            sees_any(from, &open) || stays_unseen && !sees_any(from, &shut)
        };
        self.left_where(tracer, patch, |_, position| stays(position))
    }

    /// What is left of what is exposed of a patch where points of it, which lie at a position [m], stay.
    pub(super) fn left_where(
        &self,
        tracer: &Tracer<'_>,
        patch: usize,
        stays: impl Fn(SurfacePoint, Vec3) -> bool,
    ) -> Left {
        let front = self.front_patch(patch);
        let mut cells = [Cell::default(); (MASK_GRID * MASK_GRID) as usize];
        for f in self.fragments.range(front) {
            let mut points = [None; (MASK_GRID * MASK_GRID) as usize];
            let mut areas = [0.0; (MASK_GRID * MASK_GRID) as usize];
            self.cell_centroids(front, f, MASK_GRID, |point, centroid, area| {
                let k = cell_index(centroid, MASK_GRID);
                let position = tracer.scene().position(point.triangle, point.b);
                cells[k].area += area;
                cells[k].position += position * area;
                areas[k] = area;
                points[k] = self.is_exposed_at(patch, centroid).then_some((point, position));
            });
            let known = between(|k| points[k].map(|(point, position)| stays(point, position)));
            (0..cells.len()).filter(|&k| known[k] && points[k].is_some()).for_each(|k| cells[k].open += areas[k]);
        }
        Left::of(&cells)
    }

    /// A position on a patch, a little above it [m].
    fn lifted(&self, patch: usize, position: Vec3) -> Vec3 {
        position + self.normal[patch] * (LOW * self.texel_edge(patch))
    }

    /// A little above the middle of a patch [m].
    pub(super) fn above(&self, patch: usize) -> Vec3 {
        self.lifted(patch, self.position[patch])
    }

    /// From a place above the surface, one sees the middle of a patch.
    pub(super) fn is_seen(&self, tracer: &Tracer<'_>, from: Vec3, patch: usize) -> bool {
        !tracer.occluded(&Ray { origin: from, direction: self.above(patch) - from, t_max: 1.0 })
    }

    /// Sets what of a texel takes part in light.
    pub(super) fn keep(&mut self, patch: usize, left: Left) {
        (self.mask[patch], self.exposed[patch]) = (left.mask, left.exposed);
        if left.exposed > 0.0 {
            self.position[patch] = left.position;
        }
    }
}

/// Which cells of a mask have an answer that says so. Asked is at some columns and rows, and between them where they do not
/// agree, or have none: both sides of a straight border are convex.
fn between(ask: impl Fn(usize) -> Option<bool>) -> [bool; (MASK_GRID * MASK_GRID) as usize] {
    /// The nearest of columns or rows 0, 2, 5 and 7 before and behind each.
    const AROUND: [[usize; 2]; MASK_GRID as usize] = [[0, 0], [0, 2], [2, 2], [2, 5], [2, 5], [5, 5], [5, 7], [7, 7]];
    let mut known = [None; (MASK_GRID * MASK_GRID) as usize];
    let mut is = |k: usize| *known[k].get_or_insert_with(|| ask(k));
    core::array::from_fn(|k| {
        let cell = |x: usize, y: usize| y * MASK_GRID as usize + x;
        let [columns, rows] = [AROUND[k % MASK_GRID as usize], AROUND[k / MASK_GRID as usize]];
        let around = rows.map(|y| columns.map(|x| is(cell(x, y))));
        let [first, ..] = around.as_flattened() else { return false };
        let alike = first.is_some() && around.as_flattened().iter().all(|other| other == first);
        (if alike { *first } else { is(k) }) == Some(true)
    })
}

/// Surface in one cell of the mask.
#[derive(Clone, Copy, Default)]
struct Cell {
    area: f32,
    open: f32,
    /// Position times area [m³].
    position: Vec3,
}

/// Patches by the side of a border that they lie on; all others are in the open.
pub(super) struct Sides<'a> {
    pub(super) closed: &'a BTreeSet<u32>,
    /// The border runs through them.
    pub(super) unknown: &'a BTreeSet<u32>,
    /// Cells of closed ones that see neither side are in the open.
    pub(super) closed_stay: bool,
}

/// What of a texel takes part in light.
#[derive(Debug, Default)]
pub(super) struct Left {
    mask: u64,
    /// Share of the texel's surface.
    pub(super) exposed: f32,
    /// Its centroid [m].
    position: Vec3,
}

impl Left {
    /// A cell counts whole or not at all, as the lines that land on it do.
    fn of(cells: &[Cell]) -> Self {
        let total = cells.iter().fold(0.0, |sum, cell| sum + cell.area);
        let (mut left, mut area) = (Self::default(), 0.0);
        for (k, cell) in cells.iter().enumerate().filter(|(_, c)| c.area > 0.0 && c.open >= 0.5 * c.area) {
            left.mask |= 1 << k;
            area += cell.area;
            left.position += cell.position;
        }
        if area < LEAST_EXPOSED * total || area <= 0.0 {
            return Self::default();
        }
        Self { exposed: area / total, position: left.position / area, ..left }
    }

    /// It is less than a share of the texel that was exposed before.
    pub(super) fn is_less_than(&self, exposed: f32) -> bool {
        self.exposed < exposed - ROUNDING
    }
}

/// How wide it is in the middle of a path's last segment. That is not looked at where the one before is narrow: if the next
/// one is narrow too, it does not matter.
enum Width {
    Narrow,
    /// At a position [m].
    Unknown(Vec3),
    Wide,
}

/// Half of the directions from a cube's middle to its faces, edges and corners.
const WAYS: [[i8; 3]; 13] = [
    [0, 0, 1],
    [0, 1, 0],
    [1, 0, 0],
    [0, 1, 1],
    [1, 0, 1],
    [1, 1, 0],
    [0, 1, -1],
    [1, 0, -1],
    [1, -1, 0],
    [1, 1, 1],
    [1, 1, -1],
    [1, -1, 1],
    [-1, 1, 1],
];

/// Through a point in the open, in some direction there is less room than this [m]. It is tried first in the direction
/// in which it was narrow before: all along a wall that is the same.
fn is_narrow(tracer: &Tracer<'_>, origin: Vec3, limit: f32, way: &mut usize) -> bool {
    let narrow = |k: &usize| {
        let direction = Vec3::from_array(WAYS[*k].map(f32::from)).normalize();
        let Some(hit) = tracer.closest_hit(&Ray { origin, direction, t_max: limit }) else { return false };
        tracer.occluded(&Ray { origin, direction: -direction, t_max: limit - hit.t })
    };
    let found = core::iter::once(*way).chain((0..WAYS.len()).filter(|k| k != way)).find(narrow);
    *way = found.unwrap_or(*way);
    found.is_some()
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::cell::Cell;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn cells_beside_a_straight_border_are_known_from_a_few(normal in -1.0f32..1.0, at in -8.0f32..8.0, hole in 0usize..64) {
            let asked = Cell::new(0);
            let answer = |k: usize| (k != hole).then_some((k % 8) as f32 * normal + (k / 8) as f32 > at);
            let found = between(|k| {
                asked.set(asked.get() + 1);
                answer(k)
            });
            let expected: Vec<usize> = (0..64).filter(|&k| k != hole && answer(k) == Some(true)).collect();
            let found: Vec<usize> = (0..64).filter(|&k| k != hole && found[k]).collect();
            prop_assert_eq!(found, expected);
            prop_assert!(asked.get() < 52, "{} questions", asked.get());
        }
    }
}
