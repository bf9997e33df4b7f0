//! Blocks of texels with nothing near them: one look tells for all of them that they are in the open.
//!
//! In: patches and tracer. Out: [`Clear`], asked by front patch.
//!
//! Between points of a plane with nothing on it no surface can be crossed, so either all of them lie in a solid or none
//! does. The texels of a block are looked at together: whether anything but their own plane is in a box around them, as
//! for a single texel ([`exposed`](super::exposed)), and whether the outermost are in the open beyond doubt: below a sheet
//! that hovers over the ground some probes say so and others do not. If either fails, each texel is looked at by itself.
//! Three in four texels of cornell are in such blocks, and three in five of office and courtyard at 100 to 200 thousand
//! texels; lightmaps have the same bytes.

use super::Patches;
use super::blocks::{BLOCK, Block};
use super::exposed::{Around, Plane, SAME_PLANE};
use super::solids::{Solids, sees_no_back};
use crate::base::{Progress, parallel};

/// Triangles in a block from which on its texels are looked at one by one.
const MOST_FRAGMENTS: usize = 64;

/// Which front patches have nothing near them and lie in the open.
pub(super) struct Clear {
    /// Bits of the texels at each place of blocks, row by row.
    places: Vec<u16>,
    /// Blocks per row and per column of a page.
    size: [u32; 2],
}

impl Clear {
    /// Looks at all blocks.
    pub(super) fn find(patches: &Patches, solids: Solids<'_>, progress: &Progress) -> Self {
        let bits = |block: &Block| block.iter().fold(0, |bits, (k, _)| bits | 1 << k);
        let places = parallel::map_watched(patches.block_places(BLOCK), progress, |place| {
            let clear = patches.blocks_at(place, BLOCK).into_iter().filter(|block| is_clear(patches, solids, block));
            clear.fold(0, |all, block| all | bits(&block))
        });
        Self { places, size: patches.blocks_per_side(BLOCK) }
    }

    /// Of one front patch.
    pub(super) fn has(&self, patches: &Patches, front: usize) -> bool {
        let (x, y) = patches.texel_xy(front);
        let [columns, rows] = self.size;
        let place = (patches.page(front) * rows + y / BLOCK) * columns + x / BLOCK;
        self.places[place as usize] >> (y % BLOCK * BLOCK + x % BLOCK) & 1 == 1
    }
}

/// The texels have nothing near them, and lie in the open.
fn is_clear(patches: &Patches, solids: Solids<'_>, texels: &Block) -> bool {
    let fragments: usize = texels.iter().map(|(_, i)| patches.fragments.range(*i).len()).sum();
    // One texel has its own look.
    if texels.len() < 2 || fragments > MOST_FRAGMENTS {
        return false;
    }
    let (tracer, middle) = (solids.tracer, texels[texels.len() / 2].1);
    let plane = Plane::of(patches, middle);
    let all = texels.iter().map(|(_, i)| *i);
    let Some(Around { low, high, .. }) = plane.around(patches, tracer, all, SAME_PLANE) else { return false };
    let is_alone = !tracer.any_within(low, high, |triangle| !plane.holds(tracer.scene(), triangle));
    let outermost = [(1, 1), (-1, -1), (1, -1), (-1, 1)].map(|(x, y): (i32, i32)| {
        let along = |k: u32| x * (k % BLOCK) as i32 + y * (k / BLOCK) as i32;
        texels.iter().max_by_key(|(k, _)| along(*k)).map(|(_, i)| *i)
    });
    let is_open = |i: usize| patches.middle(tracer, i).is_some_and(|point| sees_no_back(solids, point));
    is_alone && outermost.into_iter().all(|i| i.is_some_and(is_open))
}
