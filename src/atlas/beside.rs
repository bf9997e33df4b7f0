//! Finds kept layouts that lie side by side on one page, as those of a scene that was laid out as a whole do.
//!
//! In: kept blocks, one for each node. Out: sets of those that can be one block. They are of one page if they have its density
//! within [`EQUAL`] and do not meet on it. Materials that name lightmaps tell pages apart; else blocks that meet those of one
//! page may be of another one: each goes to the first with room.
//!
//! Packed one by one, every block takes the room between its own charts along: office, baked on 276 × 164 texels, took
//! 276 × 636 when it was baked again.
//!
//! Limit: at most [`PAGES`] pages are told apart for each of at most [`SIZES`] densities of a lightmap; what is left stays by
//! itself.

use super::Error;
use super::Settings;
use super::align::Piece;
use super::claim::claim_on_page;
use super::claim::reach;
use super::flatten::twice_area;
use super::guard::Guard;
use super::shape::BitMap;
use super::shape::Footprint;
use super::shape::Shape;
use super::shape::fraction_bits;
use super::shape::shape_on_page;
use super::shape::whole_side;
use crate::base::parallel;
use crate::base::percentile::percentile;
use glam::DVec2;
use std::collections::BTreeMap;

/// Largest logarithm of the density of a block over that of its page, per length.
const EQUAL: f64 = 0.05;

/// Pages of one density: as bits, those of 16,384² texels take 32 MiB each.
const PAGES: usize = 16;

/// Densities.
const SIZES: usize = 8;

/// Cells around a page: coordinates may leave it by rounding.
const MARGIN: u32 = 2;

/// Share of the cells of what should be of one page that has to be on it.
const MOST: f64 = 0.75;

/// Share of the rectangle around them that blocks of one of several pages take at least.
const LEAST_FILL: f64 = 0.5;

/// The sets of two and more blocks, each in the order of the blocks; `lightmap` tells what blocks of one page have in common.
pub(super) fn sets(
    pieces: &[Piece],
    lightmap: impl Fn(&Piece) -> Option<usize>,
    settings: &Settings,
    guard: &Guard,
) -> Result<Vec<Vec<usize>>, Error> {
    let mut of_lightmap: BTreeMap<Option<usize>, Vec<usize>> = BTreeMap::new();
    for (i, piece) in pieces.iter().enumerate().filter(|(_, piece)| piece.copies() == 1) {
        of_lightmap.entry(lightmap(piece)).or_default().push(i);
    }
    let mut found = Vec::new();
    for (lightmap, mut left) in of_lightmap {
        for _ in 0..SIZES {
            let Some(page) = common_page(pieces, &left) else { break };
            let is_of_it = |i: &usize| pieces[*i].page.is_some_and(|own| is_equal(own, page));
            let (of_it, others): (Vec<usize>, Vec<usize>) = left.into_iter().partition(is_of_it);
            left = others;
            found.extend(on_pages(pieces, &of_it, lightmap.is_some(), page, settings, guard)?);
        }
    }
    Ok(found)
}

/// Size and proportions that most of the blocks have, by area.
fn common_page(pieces: &[Piece], of: &[usize]) -> Option<DVec2> {
    let median = |value: &dyn Fn(DVec2) -> f64| {
        let mut values: Vec<(f64, f64)> = of
            .iter()
            .filter_map(|i| {
                Some((value(pieces[*i].page?), pieces[*i].corners.iter().map(|c| twice_area(*c).abs()).sum()))
            })
            .collect();
        values.sort_by(|a, b| a.0.total_cmp(&b.0));
        percentile(&values, 0.5)
    };
    let area = median(&|page| page.element_product())?;
    let wide = median(&|page| page.x / page.y)?;
    Some(DVec2::new((area * wide).sqrt(), (area / wide).sqrt()))
}

/// Pages have the same density, whatever their proportions: curved pieces do not tell those.
fn is_equal(own: DVec2, page: DVec2) -> bool {
    (own.element_product() / page.element_product()).ln().abs() < 2.0 * EQUAL
}

/// What a block takes of its page.
struct Taken {
    cells: Footprint,
    /// Place of the first cell.
    first: [i32; 2],
}

/// Blocks by page, of those of one density: on one page if no look-up reads two of them; else on as many as it takes to keep
/// them as far apart as charts packed here, without pages that they hardly fill, or, if they are known to be of one page, that
/// do not have [`MOST`] of them. Those may be leftovers of a layout made for more texels, and blocks by themselves leave less
/// of a page empty: a room of 60 objects at a lower density took 356 × 768 texels instead of 284 × 568.
fn on_pages(
    pieces: &[Piece],
    of: &[usize],
    is_one: bool,
    page: DVec2,
    settings: &Settings,
    guard: &Guard,
) -> Result<Vec<Vec<usize>>, Error> {
    let density = f64::from(settings.texels_per_meter).min(f64::from(settings.page_size) / page.max_element());
    let (bits, level) = (fraction_bits(settings.page_size), settings.mips);
    let shapes = parallel::map(of.len(), |k| {
        let piece = &pieces[of[k]];
        let turned = piece.page.map_or(DVec2::ONE, |own| page / own);
        let corners = piece.corners.iter().map(|c| c.map(|p| p * turned)).collect();
        shape_on_page(&Piece { corners, ..piece.clone() }, page, density, bits)
    });
    let sides = page.to_array().map(|side| whole_side(side * density).ceil() as u32);
    let claimed: Vec<Taken> = shapes.iter().map(|shape| Taken::claimed(shape, level, settings.padding)).collect();
    let reach = reach(level, settings.padding) as u32;
    let mut pages = first_with_room(&claimed, sides.map(|side| (side + reach) >> level), reach >> level, guard)?;
    if pages.len() > 1 {
        let read: Vec<Taken> = shapes.iter().map(Taken::read).collect();
        let near = first_with_room(&read, sides, 0, guard)?;
        let all: Vec<usize> = (0..of.len()).collect();
        let cells = |members: &[usize]| members.iter().map(|k| claimed[*k].cells.texels as f64).sum::<f64>();
        match near.len() {
            1 => pages = near,
            _ if is_one => pages.retain(|members| cells(members) > MOST * cells(&all)),
            _ => pages.retain(|members| fill(members.iter().map(|k| &claimed[*k])) > LEAST_FILL),
        }
    }
    pages.retain(|members| members.len() > 1);
    Ok(pages.iter().map(|members| members.iter().map(|k| of[*k]).collect()).collect())
}

/// Each on the first page of `size` cells, and `around` as many on all sides, where it has room.
fn first_with_room(taken: &[Taken], size: [u32; 2], around: u32, guard: &Guard) -> Result<Vec<Vec<usize>>, Error> {
    let margin = MARGIN + around;
    let mut pages: Vec<(BitMap, Vec<usize>)> = Vec::new();
    for (k, taken) in taken.iter().enumerate() {
        guard.check()?;
        let has_room = |(map, _): &(BitMap, _)| !taken.rows(margin).any(|(y, from, to)| map.any(y, from, to));
        let at = pages.iter().position(has_room).unwrap_or(pages.len());
        if at == PAGES {
            continue;
        }
        if at == pages.len() {
            let [width, height] = size.map(|side| side + 2 * margin);
            pages.push((BitMap::new(width, height), Vec::new()));
        }
        let (map, members) = &mut pages[at];
        taken.rows(margin).for_each(|(y, from, to)| map.set(y, from, to));
        members.push(k);
    }
    Ok(pages.into_iter().map(|(_, members)| members).collect())
}

/// Share of the rectangle around cells that they take.
fn fill<'a>(all: impl Iterator<Item = &'a Taken>) -> f64 {
    let (mut low, mut high, mut cells) = ([i32::MAX; 2], [i32::MIN; 2], 0);
    for taken in all {
        let size = [taken.cells.width, taken.cells.height];
        for k in 0..2 {
            low[k] = low[k].min(taken.first[k]);
            high[k] = high[k].max(taken.first[k] + size[k] as i32);
        }
        cells += taken.cells.texels;
    }
    cells as f64 / [0, 1].map(|k| f64::from(high[k]) - f64::from(low[k])).iter().product::<f64>()
}

impl Taken {
    /// The cells that no others of a page may have.
    fn claimed(shape: &Shape, level: u32, padding: u32) -> Self {
        let (claim, first) = claim_on_page(&shape.footprint, level, padding, shape.first.unwrap_or_default());
        Self { cells: claim.cells, first }
    }

    /// Its texels and those to the right and below: if such do not meet, there is a free one between the blocks.
    fn read(shape: &Shape) -> Self {
        let Footprint { width, height, .. } = shape.footprint;
        let mut map = BitMap::new(width + 1, height + 1);
        for y in 0..height {
            for (from, to) in shape.footprint.row(y) {
                (y..y + 2).for_each(|row| map.set(row, *from, to + 1));
            }
        }
        Self { cells: Footprint::of(&map, width + 1, height + 1), first: shape.first.unwrap_or_default() }
    }

    /// Row and range of the cells in a map with a margin.
    fn rows(&self, margin: u32) -> impl Iterator<Item = (u32, u32, u32)> + '_ {
        let [left, top] = self.first.map(|at| at.saturating_add_unsigned(margin).max(0) as u32);
        (0..self.cells.height)
            .flat_map(move |y| self.cells.row(y).iter().map(move |(from, to)| (top + y, left + from, left + to)))
    }
}

#[cfg(test)]
mod tests {
    use super::super::align::Face;
    use super::*;

    /// A square of a page of 10 m with 100 × 50 texels, by its lower corner and edge in parts of the page's width.
    fn square(low: [f64; 2], edge: f64) -> Piece {
        let page = DVec2::new(10.0, 5.0);
        let at = |x: f64, y: f64| (DVec2::from(low) + DVec2::new(x, y) * edge) * page.x;
        let corners = vec![[at(0.0, 0.0), at(1.0, 0.0), at(1.0, 1.0)], [at(0.0, 0.0), at(1.0, 1.0), at(0.0, 1.0)]];
        let faces = (0..2).map(|triangle| Face { part: 0, triangle, chart: 0 }).collect();
        Piece { owners: [vec![0]].into(), parts: vec![0], faces, corners, page: Some(page) }
    }

    fn found(pieces: &[Piece], mips: u32) -> Vec<Vec<usize>> {
        let settings = Settings { texels_per_meter: 10.0, mips, ..Settings::default() };
        sets(pieces, |_| None, &settings, &Guard::new(None, None)).unwrap()
    }

    #[test]
    fn blocks_that_are_apart_are_of_one_page() {
        let two = |gap: f64| [square([0.02, 0.02], 0.08), square([0.1 + gap, 0.02], 0.2)];
        assert_eq!(found(&two(0.03), 0), [[0, 1]]);
        assert_eq!(found(&two(0.01), 0), [[0, 1]], "one texel apart");
        assert!(found(&two(0.0), 0).is_empty(), "look-ups read both");
        assert!(found(&[], 2).is_empty());
    }

    #[test]
    fn what_meets_is_of_another_page_and_what_is_denser_of_none() {
        let (a, b) = (square([0.02, 0.02], 0.2), square([0.6, 0.1], 0.2));
        let denser = square([0.85, 0.1], 0.1).scaled(0.5);
        assert_eq!(found(&[a.clone(), b.clone(), denser], 2), [[0, 1]]);
        assert!(found(&[a.clone(), a.clone(), b.clone()], 2).is_empty(), "hardly a tenth of a page");
        let named = |pieces: &[Piece]| {
            let settings = Settings { texels_per_meter: 10.0, mips: 2, ..Settings::default() };
            sets(pieces, |_| Some(0), &settings, &Guard::new(None, None)).unwrap()
        };
        assert!(named(&[a.clone(), a.clone(), b.clone()]).is_empty(), "two thirds of what should be of the page");
        let small = square([0.02, 0.02], 0.05);
        assert_eq!(named(&[a.clone(), small, b.clone()]), [[0, 2]]);
        let full = square([0.02, 0.02], 0.45);
        assert_eq!(found(&[full.clone(), full.clone(), b.clone(), b.clone()], 2), [[0, 2], [1, 3]]);
        let two = [a.clone(), b.clone()];
        let apart = |piece: &Piece| Some(usize::from(piece.corners[0][0].x > 2.5));
        assert!(sets(&two, apart, &Settings::default(), &Guard::new(None, None)).unwrap().is_empty(), "two lightmaps");
        let copied = a.clone().of(&[vec![0], vec![1]].into());
        assert!(found(&[a, copied], 2).is_empty());
    }

    #[test]
    fn proportions_are_those_of_most_of_the_area() {
        let mut round = square([0.6, 0.1], 0.1);
        // As if for a square page: the same density, other proportions.
        let own = DVec2::splat(50f64.sqrt());
        let turned = own / DVec2::new(10.0, 5.0);
        round.corners.iter_mut().flatten().for_each(|p| *p *= turned);
        round.page = Some(own);
        assert_eq!(found(&[square([0.02, 0.02], 0.3), round], 2), [[0, 1]]);
    }
}
