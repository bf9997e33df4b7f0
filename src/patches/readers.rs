//! Which exposed surface reads a texel that has none itself, as one under a wall: its bilinear look-ups reach the texel.
//!
//! In: patches and tracer. Out: for texels without exposed surface that are, or touch, a texel with hidden surface, the
//! weights of their eight neighbours: that of the texel in their look-ups, integrated over their exposed surface. The same
//! for exposed texels that lie behind a sheet as seen from neighbours that end at it ([`behind`](super::behind)): the foot
//! of a wall below the ground is dark, is not to be seen, and half a texel of the wall above would show it; and for those in
//! [hollow walls](super::hollows).
//!
//! What is exposed is known by cells of a mask ([`exposed`](super::exposed)), so a look-up from beyond the middle of the
//! last open cell is overlooked. Where nothing else reads a texel, that decides whose light it holds: of a wall exactly two
//! texels thick, a millimetre from it, 2.6 % of the light of the other side was read. There the border of what is exposed is
//! found by bisection.
//!
//! Limits: walls thinner than two texels are read from both sides, turned by 45° against the texels those thinner than 2√2.

use super::Patches;
use super::behind::is_cut_off;
use super::cells::MASK_GRID;
use super::exposed;
use super::hollows::Hollow;
use super::pieces::Pieces;
use super::solids::Solids;
use crate::base::{Progress, parallel};
use glam::{DVec2, Vec2};

/// Cells per side over which the weight of a whole texel is integrated.
const CELLS: u32 = 4;
/// Width of a cell of the mask [texels].
const CELL: f64 = 1.0 / MASK_GRID as f64;
/// Halvings of a cell: to a ten-thousandth of a texel.
const HALVINGS: u32 = 10;

/// Width of what is left then [texels].
const FINEST: f64 = CELL / (1 << HALVINGS) as f64;

/// Patches per parallel task.
const CHUNK: usize = 1 << 12;

/// A texel without exposed surface, or cut off from those who read it, and who they are.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Unlit {
    /// Page, column and row.
    pub texel: [u32; 3],
    /// Weights of its neighbours, in the order of [`around`] [texel²]; some are not zero.
    pub weights: [f32; 8],
}

/// Offsets of the eight neighbours of a texel.
pub fn around() -> impl Iterator<Item = (i32, i32)> {
    (0..9).filter(|k| *k != 4).map(|k| (k % 3 - 1, k / 3 - 1))
}

/// All such texels that somebody reads, by page, column and row.
pub(super) fn find(patches: &Patches, solids: Solids<'_>, walled: &[bool], progress: &Progress) -> Vec<Unlit> {
    let mut texels = beside_hidden(patches);
    texels.extend(cut_off(patches, solids, walled));
    texels.extend(behind(patches));
    texels.sort_unstable();
    texels.dedup();
    let found = parallel::map_watched(texels.len(), progress, |k| unlit(patches, solids, texels[k]));
    found.into_iter().filter(|unlit| unlit.weights != [0.0; 8]).collect()
}

fn unlit(patches: &Patches, solids: Solids<'_>, texel: [u32; 3]) -> Unlit {
    let [page, x, y] = texel;
    let own = patches.front_at(page, x as i32, y as i32);
    let mut neighbours = [None; 8];
    for (neighbour, (dx, dy)) in neighbours.iter_mut().zip(around()) {
        let exposed = |j: &usize| {
            let reads = |i: usize| {
                let shut = patches.exposed[i] <= 0.0 || patches.hollow(i) == Hollow::Behind;
                patches.chart(i) == patches.chart(*j) && (shut || is_cut_off(patches, solids, i, *j))
            };
            let open = own.is_none() || patches.hollow(*j) == Hollow::No;
            patches.exposed[*j] > 0.0 && open && own.is_none_or(reads)
        };
        let offset = Vec2::new(dx as f32, dy as f32);
        *neighbour = patches.front_at(page, x as i32 + dx, y as i32 + dy).filter(exposed).map(|j| (j, offset));
    }
    let weigh = |by: &dyn Fn(usize, Vec2) -> f32| neighbours.map(|n| n.map_or(0.0, |(j, offset)| by(j, offset)));
    let mut weights = weigh(&|j, offset| read_by(patches, j, offset));
    if weights == [0.0; 8] {
        weights = weigh(&|j, offset| barely_read_by(patches, solids, j, offset.as_dvec2()));
    }
    Unlit { texel, weights }
}

/// Texels without exposed surface that are, or touch, a texel with hidden surface.
fn beside_hidden(patches: &Patches) -> Vec<[u32; 3]> {
    let [width, height] = patches.page_size;
    let beside = |i: usize| {
        let (page, (x, y)) = (patches.page(i), patches.texel_xy(i));
        around().chain([(0, 0)]).filter_map(move |(dx, dy)| {
            let (u, v) = (x as i32 + dx, y as i32 + dy);
            let inside = u >= 0 && v >= 0 && u < width as i32 && v < height as i32;
            let hidden = inside && patches.front_at(page, u, v).is_none_or(|j| patches.exposed[j] <= 0.0);
            hidden.then_some([page, u as u32, v as u32])
        })
    };
    let chunks = parallel::map_chunks(patches.front, CHUNK, |range| {
        range.filter(|&i| patches.exposed[i] < 1.0).flat_map(beside).collect::<Vec<_>>()
    });
    chunks.concat()
}

/// Texels that show what is behind their surface.
fn behind(patches: &Patches) -> Vec<[u32; 3]> {
    let chunks = parallel::map_chunks(patches.front, CHUNK, |range| {
        let behind = range.filter(|&i| patches.hollow(i) == Hollow::Behind);
        let texel = |i: usize| (patches.page(i), patches.texel_xy(i));
        behind.map(texel).map(|(page, (x, y))| [page, x, y]).collect::<Vec<_>>()
    });
    chunks.concat()
}

/// Exposed texels behind the sheet that their neighbour ends at.
fn cut_off(patches: &Patches, solids: Solids<'_>, walled: &[bool]) -> Vec<[u32; 3]> {
    let walled: Vec<usize> = (0..patches.front).filter(|&j| walled[j] && patches.exposed[j] > 0.0).collect();
    let found = parallel::map(walled.len(), |k| {
        let j = walled[k];
        let (page, (x, y)) = (patches.page(j), patches.texel_xy(j));
        let beyond = |(dx, dy): (i32, i32)| {
            let i = patches.front_at(page, x as i32 + dx, y as i32 + dy)?;
            let exposed = patches.exposed[i] > 0.0 && patches.chart(i) == patches.chart(j);
            let [u, v] = [x.saturating_add_signed(dx), y.saturating_add_signed(dy)];
            (exposed && is_cut_off(patches, solids, i, j)).then_some([page, u, v])
        };
        around().filter_map(beyond).collect::<Vec<_>>()
    });
    found.into_iter().flatten().collect()
}

/// Weight of a texel in the look-ups of the exposed surface of patch `j`, which lies at `offset` from it [texel²].
fn read_by(patches: &Patches, j: usize, offset: Vec2) -> f32 {
    let mut sum = 0.0;
    patches.cells(j, CELLS, |_, within, area| {
        let reach = (Vec2::ONE - (offset + within - 0.5).abs()).max(Vec2::ZERO);
        sum += area * reach.x * reach.y;
    });
    sum
}

/// The same where cells say zero: the largest weight of any look-up, over a cell of the mask [texel²].
fn barely_read_by(patches: &Patches, solids: Solids<'_>, j: usize, offset: DVec2) -> f32 {
    let mut middles = vec![];
    patches.cells(j, MASK_GRID, |_, within, _| {
        let within = within.as_dvec2();
        if (DVec2::ONE - (offset + within - 0.5).abs()).min_element() > -CELL {
            middles.push(within);
        }
    });
    let pieces = Pieces::new(patches, j);
    let is_open = |open: DVec2, within: DVec2| {
        let inside = within.cmpge(DVec2::ZERO).all() && within.cmple(DVec2::ONE).all();
        inside && exposed::is_open(patches, solids, &pieces, [open, within])
    };
    let reach = |within: DVec2| DVec2::ONE - (offset + within - 0.5).abs();
    // Most are closed where look-ups would begin to read the texel: one question instead of ten.
    let gets_there = |middle: DVec2, axis: usize| {
        let way = FINEST - reach(middle)[axis];
        way <= FINEST || way < CELL && is_open(middle, ahead(middle, -offset, axis, way))
    };
    let weight = |far: DVec2| {
        let reach = reach(far).max(DVec2::ZERO);
        (reach.x * reach.y * CELL * CELL) as f32
    };
    let farthest = |middle: DVec2| (0..2).fold(middle, |at, axis| ahead(at, -offset, axis, CELL));
    middles.into_iter().fold(0.0, |most, middle| {
        // Of the many pieces that share a texel, most could not be read more than one that is.
        if weight(farthest(middle)) <= most || !(0..2).all(|axis| gets_there(middle, axis)) {
            return most;
        }
        most.max(weight((0..2).fold(middle, |from, axis| outermost(from, -offset, axis, &is_open))))
    })
}

/// The last open point on the way from an open one along an axis, by at most the width of a cell.
fn outermost(from: DVec2, toward: DVec2, axis: usize, is_open: &dyn Fn(DVec2, DVec2) -> bool) -> DVec2 {
    if toward[axis] == 0.0 {
        return from;
    }
    let (mut open, mut closed) = (0.0, CELL);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (open + closed);
        if is_open(from, ahead(from, toward, axis, middle)) {
            open = middle;
        } else {
            closed = middle;
        }
    }
    ahead(from, toward, axis, open)
}

/// So far on the way from a point along an axis.
fn ahead(mut point: DVec2, toward: DVec2, axis: usize, way: f64) -> DVec2 {
    point[axis] += toward[axis] * way;
    point
}
