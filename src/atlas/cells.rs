//! Which squares of a page bilinear look-ups in a chart read, in mip levels too, and whose these squares are.
//!
//! In: the texels that charts cover. Out: the owner of every cell.
//!
//! A texel of mip level k is the mean of a cell of 2ᵏ × 2ᵏ texels, cells counted from the first texel of the page. A
//! look-up at a point reads, along each axis, the cell that the point lies in and the neighbour whose middle is nearer.
//! So a texel in the left half of its cell reads one cell to the left, one in the right half one to the right (in level
//! 0, where the texel is the cell, both). Cells that a level reads lie within those that the next one reads: charts that
//! share none in level n share none in any level up to n, nor in blocks of 2ᵏ × 2ᵏ texels with k ≤ n.

use super::NO_CHART;

/// No look-up reads the cell.
pub const NOBODY: u32 = NO_CHART;

/// Look-ups of several charts read the cell.
pub const SEVERAL: u32 = NO_CHART - 1;

/// First and last cell of 2^`level` texels along an axis that look-ups anywhere in a texel read.
#[must_use]
pub const fn read(texel: i32, level: u32) -> [i32; 2] {
    within(texel, level, reach(level))
}

/// Cells of 2^`level` texels along an axis that hold anything within `reach` texels of a texel.
pub(super) const fn within(texel: i32, level: u32, reach: i32) -> [i32; 2] {
    [(texel - reach) >> level, (texel + reach) >> level]
}

/// How far from a texel [texels] the cells begin that look-ups in it read: half a cell.
pub(super) const fn reach(level: u32) -> i32 {
    if level == 0 { 1 } else { 1 << (level - 1) }
}

/// The owners of the cells of all pages.
#[derive(Debug, Clone)]
pub struct Cells {
    level: u32,
    /// Cells per row and column of a page.
    size: [u32; 2],
    owner: Vec<u32>,
}

impl Cells {
    /// Cells of 2^`level` texels that nobody owns.
    #[must_use]
    pub fn new(level: u32, page_size: [u32; 2], pages: u32) -> Self {
        let size = page_size.map(|side| side.div_ceil(1 << level));
        Self { level, size, owner: vec![NOBODY; size[0] as usize * size[1] as usize * pages as usize] }
    }

    /// Notes that a chart covers a texel, so that its look-ups read the cells around.
    pub fn cover(&mut self, page: u32, [x, y]: [u32; 2], chart: u32) {
        let range = |texel: u32, cells: u32| {
            let [first, last] = read(texel as i32, self.level);
            first.max(0) as u32..=(last as u32).min(cells - 1)
        };
        for row in range(y, self.size[1]) {
            for column in range(x, self.size[0]) {
                let i = self.index(page, column, row);
                let owner = &mut self.owner[i];
                *owner = if *owner == NOBODY || *owner == chart { chart } else { SEVERAL };
            }
        }
    }

    /// The chart whose look-ups read the cell of a texel, or [`NOBODY`], or [`SEVERAL`].
    #[must_use]
    pub fn owner(&self, page: u32, [x, y]: [u32; 2]) -> u32 {
        self.owner[self.index(page, x >> self.level, y >> self.level)]
    }

    /// Look-ups of two charts read the same cell somewhere.
    #[must_use]
    pub fn are_shared(&self) -> bool {
        self.owner.contains(&SEVERAL)
    }

    fn index(&self, page: u32, column: u32, row: u32) -> usize {
        (page as usize * self.size[1] as usize + row as usize) * self.size[0] as usize + column as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_are_those_that_a_look_up_reads() {
        for level in 0..5u32 {
            let side = f64::from(1u32 << level);
            for texel in 0..40i32 {
                // The two cells whose middles are around a point, at points all over the texel.
                let read_at = |i: i32| libm::floor((f64::from(texel) + (f64::from(i) + 0.5) / 8.0) / side - 0.5) as i32;
                let first = (0..8).map(read_at).min().unwrap();
                let last = (0..8).map(|i| read_at(i) + 1).max().unwrap();
                assert_eq!(read(texel, level), [first, last], "texel {texel}, level {level}");
            }
        }
    }

    #[test]
    fn what_a_level_reads_lies_within_what_the_next_one_reads() {
        for level in 0..5 {
            for texel in 0..40 {
                let [low, high] = [read(texel, level), read(texel, level + 1)];
                assert!(low[0] >> 1 >= high[0] && low[1] >> 1 <= high[1], "texel {texel}, level {level}");
            }
        }
    }

    #[test]
    fn owners_are_kept_apart_and_found_where_they_meet() {
        let mut cells = Cells::new(2, [32, 8], 2);
        cells.cover(1, [2, 2], 5);
        cells.cover(1, [5, 2], 5);
        // The middle of cell 0 to that of cell 1: cells 0 and 1 in x and in y.
        let owners = |cells: &Cells| (0..8).map(|c| cells.owner(1, [4 * c, 3])).collect::<Vec<_>>();
        assert_eq!(owners(&cells)[..3], [5, 5, NOBODY]);
        assert_eq!(cells.owner(0, [2, 2]), NOBODY);
        cells.cover(1, [10, 2], 6);
        assert!(!cells.are_shared());
        assert_eq!(owners(&cells)[..5], [5, 5, 6, 6, NOBODY]);
        cells.cover(1, [6, 2], 5);
        assert!(cells.are_shared());
        assert_eq!(owners(&cells)[..4], [5, 5, SEVERAL, 6]);
    }
}
