//! The cells of a page that a chart needs for itself, so that no mip level up to a given one mixes charts.
//!
//! In: a footprint, the level, the padding. Out: [`Claim`], the footprint in cells of 2^level texels and where in it the
//! chart's first texel lies. Charts whose claims share no cell share none that look-ups read (`cells`), and are at least
//! the padding apart, since each claim reaches half of it beyond its chart.
//!
//! A chart can start at any texel of a cell. Of the places that need the fewest columns and rows of cells the one with
//! the fewest cells is taken, the first of those that are as good; this depends on the chart alone. A kept layout starts
//! at the texel of a cell where it does on its own page. In level 0 a cell is a texel, the claim is the footprint, and the
//! packer adds the padding.

use super::cells;
use super::shape::BitMap;
use super::shape::Footprint;
use super::shape::Shape;

/// Offsets that are tried per axis, where a footprint is no rectangle.
const OFFSETS: usize = 4;

/// Footprints of more texels than this gain too little to try them at several offsets.
const LARGE: u64 = 4096;

/// What a chart takes of a page.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Claim {
    /// Cells.
    pub(super) cells: Footprint,
    /// Place of the chart's first texel, from the first texel of the first cell.
    pub(super) offset: [u32; 2],
}

/// The claim of a shape; `most` is the number of cells along a page.
pub(super) fn claim(shape: &Shape, level: u32, padding: u32, most: u32) -> Claim {
    let kept = shape.first.map(|first| claim_on_page(&shape.footprint, level, padding, first).0);
    let fits = |claim: &Claim| claim.cells.width.max(claim.cells.height) <= most;
    kept.filter(|claim| level > 0 && fits(claim)).unwrap_or_else(|| free_claim(&shape.footprint, level, padding))
}

/// The claim of a footprint whose first texel has a place on a page, and the place of the first cell.
pub(super) fn claim_on_page(footprint: &Footprint, level: u32, padding: u32, first: [i32; 2]) -> (Claim, [i32; 2]) {
    let claim = claim_at(footprint, level, reach(level, padding), first.map(|x| x & ((1 << level) - 1)));
    let cell = [0, 1].map(|k: usize| (first[k] - claim.offset[k] as i32) >> level);
    (claim, cell)
}

/// The claim of a footprint that may start anywhere.
fn free_claim(footprint: &Footprint, level: u32, padding: u32) -> Claim {
    if level == 0 {
        return Claim { cells: footprint.clone(), offset: [0, 0] };
    }
    let reach = reach(level, padding);
    let [columns, rows] = [footprint.width, footprint.height].map(|n| offsets(n as i32, level, reach));
    let rectangle = footprint.texels == u64::from(footprint.width) * u64::from(footprint.height);
    let tries = if rectangle || footprint.texels > LARGE { 1 } else { OFFSETS };
    let mut best: Option<Claim> = None;
    for y in rows.iter().take(tries) {
        for x in columns.iter().take(tries) {
            let found = claim_at(footprint, level, reach, [*x, *y]);
            if best.as_ref().is_none_or(|best| found.cells.texels < best.cells.texels) {
                best = Some(found);
            }
        }
    }
    best.unwrap_or_else(|| claim_at(footprint, level, reach, [0, 0]))
}

/// Texels around a chart that belong to its claim.
pub(super) fn reach(level: u32, padding: u32) -> i32 {
    cells::reach(level).max(padding.div_ceil(2) as i32)
}

/// Offsets within a cell with which a row of `length` texels takes the fewest cells.
fn offsets(length: i32, level: u32, reach: i32) -> Vec<i32> {
    let span = |o: i32| cells::within(o + length - 1, level, reach)[1] - cells::within(o, level, reach)[0];
    let all = 0..1 << level;
    let least = all.clone().map(span).min().unwrap_or(0);
    all.filter(|o| span(*o) == least).collect()
}

fn claim_at(footprint: &Footprint, level: u32, reach: i32, [ox, oy]: [i32; 2]) -> Claim {
    let first = [ox, oy].map(|o| cells::within(o, level, reach)[0]);
    let last =
        [(ox, footprint.width), (oy, footprint.height)].map(|(o, n)| cells::within(o + n as i32 - 1, level, reach)[1]);
    let [width, height] = [0, 1].map(|a: usize| (last[a] - first[a] + 1) as u32);
    let mut map = BitMap::new(width, height);
    for y in 0..footprint.height {
        let [top, bottom] = cells::within(oy + y as i32, level, reach);
        for (from, to) in footprint.row(y) {
            let left = cells::within(ox + *from as i32, level, reach)[0];
            let right = cells::within(ox + *to as i32 - 1, level, reach)[1];
            for row in top..=bottom {
                map.set((row - first[1]) as u32, (left - first[0]) as u32, (right - first[0] + 1) as u32);
            }
        }
    }
    let offset = [ox - (first[0] << level), oy - (first[1] << level)].map(|o| o as u32);
    Claim { cells: Footprint::of(&map, width, height), offset }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn solid(width: u32, height: u32) -> Footprint {
        let mut map = BitMap::new(width, height);
        (0..height).for_each(|y| map.set(y, 0, width));
        Footprint::of(&map, width, height)
    }

    #[test]
    fn a_side_that_fits_between_the_middles_of_cells_takes_one_cell_more() {
        for (length, cells) in [(1, 2), (4, 2), (5, 3), (8, 3), (9, 4)] {
            let claim = free_claim(&solid(length, 1), 2, 0);
            assert_eq!([claim.cells.width, claim.cells.height], [cells, 2], "{length} texels");
        }
        assert_eq!(free_claim(&solid(8, 8), 1, 0).cells.texels, 25);
        assert_eq!(free_claim(&solid(4, 4), 3, 0).cells.texels, 4);
    }

    #[test]
    fn claims_hold_every_cell_that_look_ups_read_and_half_the_padding() {
        let mut map = BitMap::new(13, 9);
        (0..9).for_each(|y| map.set(y, y, y + 4));
        let diagonal = Footprint::of(&map, 13, 9);
        for footprint in [&diagonal, &solid(7, 3), &solid(1, 1)] {
            for (level, padding) in [(1, 0), (1, 7), (2, 2), (3, 4), (2, 24), (4, 3)] {
                let claim = free_claim(footprint, level, padding);
                let has = |x: i32, y: i32| {
                    let row = claim.cells.row((y >> level) as u32);
                    row.iter().any(|(from, to)| (*from..*to).contains(&((x >> level) as u32)))
                };
                let half = padding.div_ceil(2) as i32;
                for y in 0..footprint.height {
                    for x in footprint.row(y).iter().flat_map(|(from, to)| *from..*to) {
                        let at = [x + claim.offset[0], y + claim.offset[1]].map(|p| p as i32);
                        let [columns, rows] = at.map(|p| cells::read(p, level));
                        for (row, column) in rows.iter().flat_map(|r| columns.map(|c| (*r, c))) {
                            assert!(has(column << level, row << level), "level {level}, padding {padding}");
                        }
                        assert!(has(at[0] - half, at[1] + half) && has(at[0] + half, at[1] - half));
                    }
                }
            }
        }
    }
}
