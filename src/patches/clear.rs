//! Blocks of texels with nothing near them: one look tells for all of them that they are in the open.
//!
//! In: patches and tracer. Out: [`Clear`], asked by front patch.
//!
//! Between points of a plane with nothing on it no surface can be crossed, so either all of them lie in a solid or none
//! does. A block is [`BLOCK`] × [`BLOCK`] texels; those of one chart are looked at together: whether anything but their own
//! plane is in a box around them, as for a single texel ([`exposed`](super::exposed)), and whether the outermost are in the
//! open beyond doubt: below a sheet that hovers over the ground some probes say so and others do not. If either fails,
//! each texel is looked at by itself. Three in four texels of cornell are in such blocks, and three in five of office and
//! courtyard at 100 to 200 thousand texels; lightmaps have the same bytes.

use super::Patches;
use super::exposed::Plane;
use super::solids::{Solids, sees_no_back};
use crate::base::{Progress, parallel};

/// Edge of a block [texels].
const BLOCK: u32 = 4;
/// Triangles in a block from which on its texels are looked at one by one.
const MOST_FRAGMENTS: usize = 64;

/// Which front patches have nothing near them and lie in the open.
pub(super) struct Clear {
    /// Bits of the texels of each block, row by row.
    blocks: Vec<u16>,
    /// Blocks per row and per column of a page.
    size: [u32; 2],
}

impl Clear {
    /// Looks at all blocks.
    pub(super) fn find(patches: &Patches, solids: Solids<'_>, progress: &Progress) -> Self {
        let [width, height] = patches.page_size;
        let size = [width, height].map(|edge| edge.div_ceil(BLOCK));
        let per_page = (size[0] * size[1]) as usize;
        let texels = width as usize * height as usize;
        let pages = patches.grid.len().checked_div(texels).unwrap_or(0);
        let blocks = parallel::map_watched(per_page * pages, progress, |k| {
            let (page, at) = ((k / per_page) as u32, (k % per_page) as u32);
            block(patches, solids, page, [at % size[0] * BLOCK, at / size[0] * BLOCK])
        });
        Self { blocks, size }
    }

    /// Of one front patch.
    pub(super) fn has(&self, patches: &Patches, front: usize) -> bool {
        let (x, y) = patches.texel_xy(front);
        let [columns, rows] = self.size;
        let block = (patches.page(front) * rows + y / BLOCK) * columns + x / BLOCK;
        self.blocks[block as usize] >> (y % BLOCK * BLOCK + x % BLOCK) & 1 == 1
    }
}

/// Bits of the clear texels of the block with its corner at a texel.
fn block(patches: &Patches, solids: Solids<'_>, page: u32, corner: [u32; 2]) -> u16 {
    let texels = (0..BLOCK * BLOCK).filter_map(|k| {
        let [x, y] = [corner[0] + k % BLOCK, corner[1] + k / BLOCK];
        Some((k, patches.front_at(page, x as i32, y as i32)?))
    });
    let mut left: Vec<(u32, usize)> = texels.collect();
    let mut bits = 0;
    while let Some(&(_, first)) = left.first() {
        let same_chart = |&(_, i): &(u32, usize)| patches.chart(i) == patches.chart(first);
        let (together, others): (Vec<_>, Vec<_>) = left.into_iter().partition(same_chart);
        if is_clear(patches, solids, &together) {
            bits |= together.iter().fold(0, |bits, (k, _)| bits | 1 << k);
        }
        left = others;
    }
    bits
}

/// Texels of one chart have nothing near them, and lie in the open.
fn is_clear(patches: &Patches, solids: Solids<'_>, texels: &[(u32, usize)]) -> bool {
    let fragments: usize = texels.iter().map(|(_, i)| patches.fragments.range(*i).len()).sum();
    // One texel has its own look.
    if texels.len() < 2 || fragments > MOST_FRAGMENTS {
        return false;
    }
    let (tracer, middle) = (solids.tracer, texels[texels.len() / 2].1);
    let plane = Plane::of(patches, middle);
    let Some((low, high)) = plane.around(patches, tracer, texels.iter().map(|(_, i)| *i)) else { return false };
    let is_alone = !tracer.any_within(low, high, |triangle| !plane.holds(tracer.scene(), triangle));
    let outermost = [(1, 1), (-1, -1), (1, -1), (-1, 1)].map(|(x, y): (i32, i32)| {
        let along = |k: u32| x * (k % BLOCK) as i32 + y * (k / BLOCK) as i32;
        texels.iter().max_by_key(|(k, _)| along(*k)).map(|(_, i)| *i)
    });
    let is_open = |i: usize| patches.middle(tracer, i).is_some_and(|point| sees_no_back(solids, point));
    is_alone && outermost.into_iter().all(|i| i.is_some_and(is_open))
}
