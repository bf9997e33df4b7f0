//! Blocks of texels of a chart, which are close enough to have answers in common.

use super::Patches;

/// Edge of a block of texels that have answers in common.
pub const BLOCK: u32 = 4;

/// Front patches of one chart in a block, each with its place there, row by row.
pub type Block = Vec<(u32, usize)>;

impl Patches {
    /// Blocks of so many texels' edge per row and per column of a page.
    pub(super) fn blocks_per_side(&self, edge: u32) -> [u32; 2] {
        self.page_size.map(|side| side.div_ceil(edge))
    }

    /// Number of places of blocks of so many texels' edge on all pages.
    #[must_use]
    pub fn block_places(&self, edge: u32) -> usize {
        let count = |size: [u32; 2]| size[0] as usize * size[1] as usize;
        self.grid.len().checked_div(count(self.page_size)).unwrap_or(0) * count(self.blocks_per_side(edge))
    }

    /// The place of a front patch among these.
    pub(super) fn block_place(&self, front: usize, edge: u32) -> usize {
        let [columns, rows] = self.blocks_per_side(edge).map(|n| n as usize);
        let (x, y) = self.texel_xy(front);
        (self.page(front) as usize * rows + (y / edge) as usize) * columns + (x / edge) as usize
    }

    /// The blocks at such a place, page by page and row by row: one for each chart that is there.
    #[must_use]
    pub fn blocks_at(&self, place: usize, edge: u32) -> Vec<Block> {
        let [columns, rows] = self.blocks_per_side(edge).map(|n| n as usize);
        let corner = [place % columns, place / columns % rows].map(|n| n as u32 * edge);
        let page = (place / (columns * rows)) as u32;
        let texel = |k: u32| {
            let [x, y] = [corner[0] + k % edge, corner[1] + k / edge];
            Some((k, self.front_at(page, x as i32, y as i32)?))
        };
        let mut blocks: Vec<Block> = vec![];
        for (k, i) in (0..edge * edge).filter_map(texel) {
            match blocks.iter_mut().find(|block| self.chart(block[0].1) == self.chart(i)) {
                Some(block) => block.push((k, i)),
                None => blocks.push(vec![(k, i)]),
            }
        }
        blocks
    }
}
