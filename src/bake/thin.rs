//! Warns of walls that are too thin for the texels: look-ups on one side read light from the other.
//!
//! In: patches with their light. Out: a warning (`thin-wall`) for each node on which dark texels lie beside lit ones of the
//! same chart that they cannot see, so near that a look-up mixes both: neighbours, or with one texel between them that both
//! sides read. What is dark must go on: the end of a board that sticks in a wall is dark behind it, and there is nothing that
//! light could leak into. Nor is anything parted around whose end both see the texel beside them: light and shadow meet at
//! the corner of a solid box. `check` looks closer (`leaks`, `dark-strip`), at points instead of texels.

use crate::atlas::Atlas;
use crate::base::{Rgb, Warning, parallel};
use crate::patches::{COS_FACING, HEIGHTS, Patches};
use crate::trace::{Ray, Tracer};
use glam::Vec3;
use std::collections::BTreeMap;

/// Light over that on the other side, below which a texel is dark.
const DARK: f32 = 0.01;
/// Light over the mean, below which nothing is lit.
const LIT: f32 = 0.05;
/// Texels that are dark, one behind the other, before it is a place and no stub.
const DEEP: i32 = 2;
/// Where one looks from beside two texels, before and behind its middle, in edges: a sheet through that hides one of them.
const ASIDE: f32 = 0.2;
/// Parts of a texel's side to look for a point in the open at.
const CELLS: u32 = 8;
/// Texels per chunk of work.
const CHUNK: usize = 1024;

/// Two texels, the lit one first.
type Pair = (usize, usize);

/// What is odd with the light of the front patches.
pub(super) fn warnings(
    tracer: &Tracer<'_>,
    atlas: &Atlas,
    patches: &Patches,
    light: &[Rgb],
    cut_contacts: bool,
) -> Vec<Warning> {
    let sum = parallel::sum(patches.front, |i| f64::from(light[i].max_element()));
    let least = LIT * (sum / (patches.front as f64).max(1.0)) as f32;
    let look = Look { tracer, patches, light, least };
    let chunks = parallel::map_chunks(patches.front, CHUNK, |range| range.flat_map(|i| look.pairs(i)).collect());
    let all: Vec<Pair> = chunks.into_iter().flat_map(|chunk: Vec<Pair>| chunk).collect();
    let scene = tracer.scene();
    let mut by_node: BTreeMap<usize, Vec<Pair>> = BTreeMap::new();
    for pair in all {
        let part = atlas.charts[patches.chart(pair.0) as usize].part;
        by_node.entry(scene.parts[part as usize].node).or_default().push(pair);
    }
    by_node.into_iter().map(|(node, pairs)| warning(scene.node_name(node), &look, &pairs, cut_contacts)).collect()
}

fn warning(node: &str, look: &Look<'_>, pairs: &[Pair], cut_contacts: bool) -> Warning {
    let brightness = |p: &Pair| look.light[p.0].max_element();
    let worst = pairs.iter().fold(pairs[0], |worst, p| if brightness(p) > brightness(&worst) { *p } else { worst });
    let place = look.patches.position[worst.1].as_dvec3() + look.tracer.scene().offset;
    let [x, y, z] = place.to_array();
    let advice = if cut_contacts { "" } else { "--cut-contacts, " };
    let message = format!(
        "something thinner than two texels parts light from dark, so light leaks in {} places, first of all at ({x:.2}, \
         {y:.2}, {z:.2}) m; use {advice}more texels per metre, or thicker walls",
        pairs.len()
    );
    Warning::new("thin-wall", message).at(node)
}

struct Look<'a> {
    tracer: &'a Tracer<'a>,
    patches: &'a Patches,
    light: &'a [Rgb],
    /// Below it nothing is lit.
    least: f32,
}

impl Look<'_> {
    /// Texels to the right of a texel, and below, that it is mixed with and parted from.
    fn pairs(&self, i: usize) -> Vec<Pair> {
        let patches = self.patches;
        let at = |axis: usize, steps: i32| self.near(i, axis, [steps, 0]);
        let mut pairs = vec![];
        for axis in [0, 1] {
            // The dark texel of a pair lies `steps` away, or is texel i; from there on it must stay dark.
            let goes_on = |&(lit, dark): &Pair, steps: i32| {
                let (from, way) = if dark == i { (0, -1) } else { (steps, 1) };
                (1..DEEP).all(|k| at(axis, from + k * way).is_some_and(|j| self.is_dark_beside(j, lit)))
            };
            let Some(next) = at(axis, 1) else { continue };
            pairs.extend(self.parted(i, next).filter(|pair| goes_on(pair, 1) && !self.meet_beside([i, next], axis, 1)));
            let Some(after) = at(axis, 2) else { continue };
            let read = |j: usize, low: bool| self.reaches(j, axis, low);
            let is_read = || patches.exposed[next] > 0.0 || (read(i, false) && read(after, true));
            pairs.extend(
                self.parted(i, after)
                    .filter(|pair| is_read() && goes_on(pair, 2) && !self.meet_beside([i, after], axis, 2)),
            );
        }
        pairs
    }

    /// The texel of the same chart so many steps along an axis of the page, and across it.
    fn near(&self, i: usize, axis: usize, [along, across]: [i32; 2]) -> Option<usize> {
        let patches = self.patches;
        let (page, (x, y)) = (patches.page(i), patches.texel_xy(i));
        let (dx, dy) = if axis == 0 { (along, across) } else { (across, along) };
        patches.front_at(page, x as i32 + dx, y as i32 + dy).filter(|&j| patches.chart(j) == patches.chart(i))
    }

    /// A texel beside two texels sees both, from before and behind its middle.
    fn meet_beside(&self, both: [usize; 2], axis: usize, steps: i32) -> bool {
        let patches = self.patches;
        let way = (patches.position[both[1]] - patches.position[both[0]]).normalize_or_zero();
        let sees_both = |j: usize| {
            let (middle, aside) = (self.nearest(j, patches.position[j]), way * (ASIDE * patches.texel_edge(j)));
            let from = [middle + aside, middle - aside];
            from.iter().all(|&from| both.iter().all(|&i| self.sees([j, i], [from, self.nearest(i, from)])))
        };
        let places = (0..=steps).flat_map(|along| [[along, -1], [along, 1]]);
        let beside = places.filter_map(|place| self.near(both[0], axis, place));
        beside.filter(|&j| patches.exposed[j] > 0.0).any(sees_both)
    }

    /// The point of a texel in the open that is nearest to another one [m]. The middle of a texel around the corner of a
    /// box lies within that.
    fn nearest(&self, i: usize, to: Vec3) -> Vec3 {
        let (mut nearest, mut least) = (self.patches.position[i], f32::INFINITY);
        self.patches.cells(i, CELLS, |point, _, _| {
            let position = self.tracer.scene().position(point.triangle, point.b);
            let distance = position.distance_squared(to);
            if distance < least {
                (nearest, least) = (position, distance);
            }
        });
        nearest
    }

    /// A ray from a place of one texel to one of the other meets nothing, at some height.
    fn sees(&self, texels: [usize; 2], places: [Vec3; 2]) -> bool {
        let patches = self.patches;
        let edge = patches.texel_edge(texels[0]).min(patches.texel_edge(texels[1]));
        !HEIGHTS.iter().all(|height| {
            let [origin, target] = [0, 1].map(|k| places[k] + patches.normal[texels[k]] * (height * edge));
            self.tracer.occluded(&Ray { origin, direction: target - origin, t_max: 1.0 })
        })
    }

    /// A texel is in the open, and dark beside that one.
    fn is_dark_beside(&self, j: usize, lit: usize) -> bool {
        self.patches.exposed[j] > 0.0 && self.light[j].max_element() < DARK * self.light[lit].max_element()
    }

    /// Exposed surface lies in the lower or upper half of a texel, so that look-ups there read the texel beyond.
    fn reaches(&self, j: usize, axis: usize, low: bool) -> bool {
        let mut found = false;
        self.patches.cells(j, 2, |_, within, _| found |= (within[axis] < 0.5) == low);
        found
    }

    /// One texel is lit, the other is dark, and they cannot see each other.
    fn parted(&self, i: usize, j: usize) -> Option<Pair> {
        let patches = self.patches;
        let (a, b) = (self.light[i].max_element(), self.light[j].max_element());
        let open = patches.exposed[i] > 0.0 && patches.exposed[j] > 0.0;
        if !open || a.max(b) <= self.least || a.min(b) >= DARK * a.max(b) {
            return None;
        }
        let facing = patches.normal[i].dot(patches.normal[j]) >= COS_FACING;
        let blocked = !self.sees([i, j], [i, j].map(|k| patches.position[k]));
        (blocked && facing).then_some(if a > b { (i, j) } else { (j, i) })
    }
}
