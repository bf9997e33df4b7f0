//! Chooses the size of the pages: packs at several widths, and takes the smallest page.
//!
//! In: what charts claim, in cells of the sheet. Out: [`Choice`]. One page is made as small as it can be; several pages
//! have the largest width, a height that fills the last one too, and the order of the charts. Sides are multiples of
//! `multiple` cells.
//!
//! A trial may only use what would make a smaller page than the best so far, so most trials that lead nowhere end early.
//! How many there are depends on the charts alone, never on time: the same charts, the same pages.

use super::Error;
use super::guard::Guard;
use super::pack::Place;
use super::pack::Sheet;
use super::pack::pack;
use super::shape::Footprint;

/// Share of the page area that the first guess of a page size expects to be filled, padding included.
const EXPECTED_FILL: f64 = 0.94;

/// Page widths that are tried for one page, relative to the first guess, most promising first.
const WIDTHS: [f64; 16] = [1.0, 1.06, 0.94, 1.15, 1.3, 0.97, 1.03, 1.1, 1.22, 0.88, 1.4, 1.09, 1.18, 1.26, 1.5, 0.82];

/// Work of all trials, in charts times words of 64 cells on a page: a second, about.
const BUDGET: f64 = 1.5e8;

/// Least number of trials, whatever they cost.
const LEAST_TRIALS: usize = 2;

/// A page size [cells], the number of pages, and places.
pub(super) struct Choice {
    pub(super) size: [u32; 2],
    pub(super) pages: u32,
    pub(super) places: Vec<Place>,
}

/// Cells that footprints need together with their padding, estimated.
pub(super) fn padded_area(footprints: &[&Footprint], sheet: Sheet) -> f64 {
    let pad = u64::from(sheet.padding);
    footprints.iter().map(|f| (f.texels + pad * (u64::from(f.width + f.height) + pad)) as f64).sum()
}

/// Chooses the page size; `None` if the sheet is too small.
pub(super) fn choose(
    footprints: &[&Footprint],
    sheet: Sheet,
    multiple: u32,
    guard: &Guard,
) -> Result<Option<Choice>, Error> {
    if footprints.is_empty() {
        return Ok(Some(Choice { size: [0, 0], pages: 0, places: Vec::new() }));
    }
    let round = Round { multiple, side: sheet.size[0] };
    match one(footprints, sheet, round, guard)? {
        Some(choice) => Ok(Some(choice)),
        None => Ok(several(footprints, sheet, round, guard)?.map(Choice::in_order)),
    }
}

impl Choice {
    /// With pages in the order of the first footprints on them, whichever were packed first: pages that are packed again keep
    /// their numbers.
    fn in_order(mut self) -> Self {
        let mut number = vec![None; self.pages as usize];
        let mut next = 0;
        for place in &mut self.places {
            place.page = *number[place.page as usize].get_or_insert_with(|| {
                next += 1;
                next - 1
            });
        }
        self
    }
}

/// How sides of pages are rounded.
#[derive(Clone, Copy)]
struct Round {
    multiple: u32,
    /// Largest side.
    side: u32,
}

impl Round {
    /// The next multiple, but not more than the largest page side.
    fn up(self, cells: u32) -> u32 {
        cells.next_multiple_of(self.multiple).min(self.side)
    }

    /// The multiple below.
    fn down(self, cells: u32) -> u32 {
        cells - cells % self.multiple
    }
}

/// The smallest single page.
fn one(footprints: &[&Footprint], sheet: Sheet, round: Round, guard: &Guard) -> Result<Option<Choice>, Error> {
    let guess = (padded_area(footprints, sheet) / EXPECTED_FILL).sqrt();
    if guess > f64::from(round.side) {
        return Ok(None);
    }
    let widest = footprints.iter().map(|f| f.width + 2 * sheet.margin).max().unwrap_or(0);
    let cost = footprints.len() as f64 * guess * guess / 64.0;
    let trials = ((BUDGET / cost) as usize).clamp(LEAST_TRIALS, WIDTHS.len());
    let mut best: Option<Choice> = None;
    let mut tried = Vec::new();
    for factor in &WIDTHS[..trials] {
        let width = round.up(((guess * factor) as u32).max(widest));
        if tried.contains(&width) {
            continue;
        }
        tried.push(width);
        let height = match &best {
            Some(best) => round.down(((area(best.size) - 1) / u64::from(width)) as u32).min(round.side),
            None => round.side,
        };
        let page = Sheet { size: [width, height], pages: 1, ..sheet };
        if let Some(places) = pack(footprints, page, guard)? {
            let size = used(footprints, &places, sheet, round);
            if best.as_ref().is_none_or(|best| area(size) < area(best.size)) {
                best = Some(Choice { size, pages: 1, places });
            }
        }
    }
    Ok(best)
}

/// Several pages of full width, all of the same height.
fn several(footprints: &[&Footprint], sheet: Sheet, round: Round, guard: &Guard) -> Result<Option<Choice>, Error> {
    let Some(places) = pack(footprints, sheet, guard)? else {
        return Ok(None);
    };
    let pages = places.iter().map(|place| place.page + 1).max().unwrap_or(0);
    let side = round.side;
    let size = used(footprints, &places, sheet, round);
    if pages == 1 {
        return Ok(Some(Choice { size, pages: 1, places }));
    }
    let last = footprints.iter().zip(&places).filter(|(_, place)| place.page + 1 == pages);
    let last_height = last.map(|(f, place)| place.y + f.height + sheet.margin).max().unwrap_or(side);
    let tallest = footprints.iter().map(|f| f.height + 2 * sheet.margin).max().unwrap_or(0);
    let level = f64::from(side * (pages - 1) + last_height) / f64::from(pages);
    for slack in [1.01, 1.04] {
        let height = round.up(((level * slack) as u32).max(tallest));
        if height < size[1] {
            let lower = Sheet { size: [side, height], pages, ..sheet };
            if let Some(places) = pack(footprints, lower, guard)? {
                return Ok(Some(Choice { size: lower.size, pages, places }));
            }
        }
    }
    Ok(Some(Choice { size: [side, size[1]], pages, places }))
}

fn area(size: [u32; 2]) -> u64 {
    u64::from(size[0]) * u64::from(size[1])
}

/// Size of the page that is in use.
fn used(footprints: &[&Footprint], places: &[Place], sheet: Sheet, round: Round) -> [u32; 2] {
    let ends = footprints.iter().zip(places).map(|(f, place)| [place.x + f.width, place.y + f.height]);
    let end = ends.fold([0, 0], |a: [u32; 2], b| [a[0].max(b[0]), a[1].max(b[1])]);
    end.map(|end| round.up(end + sheet.margin))
}
