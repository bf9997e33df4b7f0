//! Blocks of texels of a chart, which are close enough to have answers in common.

use super::Patches;

/// Edge of a block [texels].
pub const BLOCK: u32 = 4;

/// Front patches of one chart in a block, each with its place there, row by row.
pub type Block = Vec<(u32, usize)>;

impl Patches {
    /// Blocks per row and per column of a page.
    #[must_use]
    pub fn blocks_per_side(&self) -> [u32; 2] {
        self.page_size.map(|edge| edge.div_ceil(BLOCK))
    }

    /// Number of places of blocks on all pages.
    #[must_use]
    pub fn block_places(&self) -> usize {
        let count = |size: [u32; 2]| size[0] as usize * size[1] as usize;
        self.grid.len().checked_div(count(self.page_size)).unwrap_or(0) * count(self.blocks_per_side())
    }

    /// The blocks at such a place, page by page and row by row: one for each chart that is there.
    #[must_use]
    pub fn blocks_at(&self, place: usize) -> Vec<Block> {
        let [columns, rows] = self.blocks_per_side().map(|n| n as usize);
        let corner = [place % columns, place / columns % rows].map(|n| n as u32 * BLOCK);
        let page = (place / (columns * rows)) as u32;
        let texel = |k: u32| {
            let [x, y] = [corner[0] + k % BLOCK, corner[1] + k / BLOCK];
            Some((k, self.front_at(page, x as i32, y as i32)?))
        };
        let mut blocks: Vec<Block> = vec![];
        for (k, i) in (0..BLOCK * BLOCK).filter_map(texel) {
            match blocks.iter_mut().find(|block| self.chart(block[0].1) == self.chart(i)) {
                Some(block) => block.push((k, i)),
                None => blocks.push(vec![(k, i)]),
            }
        }
        blocks
    }
}
