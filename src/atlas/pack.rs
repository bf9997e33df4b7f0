//! Packs footprints into pages: each at the lowest free place of the first page that has one, largest first.
//!
//! A page is a bit map of texels (or of cells of several texels, see `claim`) that are taken: footprints widened by the
//! padding on all sides. A footprint fits where it meets no taken texel, so it may lie in holes of others, and every gap
//! counts the padding once. All places in a row of the page are tried at once: for a run of n texels the row is OR-ed
//! with itself shifted by 1 … n − 1 (in log₂ n steps).
//!
//! Three things keep it fast: rows without a long enough gap are skipped; the first footprint row that excludes the
//! last place ends a trial; and footprints of the size of an earlier one start where that one was put, since pages only
//! fill up (for footprints that are no rectangles this can miss a hole, never cause an overlap).

use super::Error;
use super::guard::Guard;
use super::shape::BitMap;
use super::shape::Footprint;
use std::collections::HashMap;

/// Pages to fill.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Sheet {
    /// Width and height of a page [texels].
    pub(super) size: [u32; 2],
    /// Number of pages.
    pub(super) pages: u32,
    /// Empty texels between footprints.
    pub(super) padding: u32,
    /// Empty texels along the border of a page.
    pub(super) margin: u32,
}

/// Where a footprint lies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Place {
    /// Page.
    pub(super) page: u32,
    /// First column.
    pub(super) x: u32,
    /// First row.
    pub(super) y: u32,
}

/// Places in the order of the footprints; `None` if the sheet is too small.
///
/// Tried: longest side or largest rectangle first instead of highest first; pages were as large or larger.
pub(super) fn pack(footprints: &[&Footprint], sheet: Sheet, guard: &Guard) -> Result<Option<Vec<Place>>, Error> {
    let mut order: Vec<usize> = (0..footprints.len()).collect();
    order.sort_by_key(|i| {
        let f = footprints[*i];
        (core::cmp::Reverse((f.height, f.width, f.texels)), *i)
    });
    let mut pages: Vec<Page> = Vec::new();
    let mut places = vec![Place::default(); footprints.len()];
    for (step, i) in order.into_iter().enumerate() {
        if step % 64 == 0 {
            guard.check()?;
        }
        let footprint = footprints[i];
        let rows = rows_by_width(footprint);
        let mut place = None;
        for page in 0..sheet.pages {
            if page as usize == pages.len() {
                pages.push(Page::new(sheet));
            }
            if let Some((x, y)) = pages[page as usize].find(footprint, &rows) {
                pages[page as usize].put(footprint, x, y);
                place = Some(Place { page, x, y });
                break;
            }
        }
        match place {
            Some(place) => places[i] = place,
            None => return Ok(None),
        }
    }
    Ok(Some(places))
}

/// Longest run and number of each row, longest first: they exclude most places.
fn rows_by_width(footprint: &Footprint) -> Vec<(u32, u32)> {
    let longest = |r: u32| footprint.row(r).iter().map(|(from, to)| to - from).max().unwrap_or(0);
    let mut rows: Vec<(u32, u32)> = (0..footprint.height).map(|r| (longest(r), r)).collect();
    rows.sort_by_key(|(run, r)| (core::cmp::Reverse(*run), *r));
    rows
}

struct Page {
    sheet: Sheet,
    taken: BitMap,
    longest_gap: Vec<u32>,
    /// Row where a footprint of this size was put last, or the height if there was no place.
    start: HashMap<(u32, u32, u64), u32>,
    scratch: Vec<u64>,
    free: Vec<u64>,
}

impl Page {
    fn new(sheet: Sheet) -> Self {
        let [width, height] = sheet.size;
        let taken = BitMap::new(width, height);
        let longest_gap = vec![width; height as usize];
        Self { sheet, taken, longest_gap, start: HashMap::new(), scratch: Vec::new(), free: Vec::new() }
    }

    /// Lowest row, and leftmost place in it, where the footprint meets nothing.
    fn find(&mut self, footprint: &Footprint, rows: &[(u32, u32)]) -> Option<(u32, u32)> {
        let margin = self.sheet.margin;
        let [width, height] = self.sheet.size;
        if footprint.width + 2 * margin > width || footprint.height + 2 * margin > height {
            return None;
        }
        let key = (footprint.width, footprint.height, footprint.texels);
        let start = self.start.get(&key).copied().unwrap_or(margin);
        for y in start..=height - margin - footprint.height {
            if rows.iter().all(|(run, r)| self.longest_gap[(y + r) as usize] >= *run)
                && let Some(x) = self.first_free(footprint, rows, y)
            {
                self.start.insert(key, y);
                return Some((x, y));
            }
        }
        self.start.insert(key, height);
        None
    }

    /// Leftmost place in row y.
    fn first_free(&mut self, footprint: &Footprint, rows: &[(u32, u32)], y: u32) -> Option<u32> {
        let margin = self.sheet.margin;
        let last_place = self.sheet.size[0] - margin - footprint.width;
        let mut places = BitMap::new(last_place + 1, 0);
        places.words = core::mem::take(&mut self.free);
        places.words.clear();
        places.words.resize(places.stride, 0);
        places.set(0, margin, last_place + 1);
        let mut bounds = 0..places.stride;
        for (_, r) in rows {
            for (from, to) in footprint.row(*r) {
                let row = self.taken.row(y + r);
                exclude(row, (*from, *to), &mut places.words, &mut bounds, &mut self.scratch);
                if bounds.is_empty() {
                    self.free = places.words;
                    return None;
                }
            }
        }
        let word = bounds.start;
        let found = word as u32 * 64 + places.words[word].trailing_zeros();
        self.free = places.words;
        Some(found)
    }

    fn put(&mut self, footprint: &Footprint, x: u32, y: u32) {
        let pad = self.sheet.padding;
        let first = y.saturating_sub(pad);
        let last = (y + footprint.height + pad).min(self.sheet.size[1]);
        for r in 0..footprint.height {
            for (from, to) in footprint.row(r) {
                let (from, to) = ((x + from).saturating_sub(pad), x + to + pad);
                for row in (y + r).saturating_sub(pad)..(y + r + pad + 1).min(last) {
                    self.taken.set(row, from, to);
                }
            }
        }
        for row in first..last {
            self.longest_gap[row as usize] = self.taken.longest_gap(row);
        }
    }
}

/// Clears the places whose texels [place + from, place + to) meet a taken one; narrows `bounds` to words with places
/// left.
fn exclude(
    row: &[u64],
    (from, to): (u32, u32),
    places: &mut [u64],
    bounds: &mut core::ops::Range<usize>,
    scratch: &mut Vec<u64>,
) {
    let length = to - from;
    let (shift_words, shift) = (from as usize / 64, from % 64);
    let word = |i: usize| row.get(i).copied().unwrap_or(0);
    scratch.clear();
    let needed = bounds.len() + length as usize / 64 + 1;
    for i in bounds.start + shift_words..bounds.start + shift_words + needed {
        let high = if shift == 0 { 0 } else { word(i + 1) << (64 - shift) };
        scratch.push(word(i) >> shift | high);
    }
    let mut covered = 1;
    while covered < length {
        let step = covered.min(length - covered);
        let (words, bits) = (step as usize / 64, step % 64);
        for i in 0..scratch.len() {
            let low = scratch.get(i + words).copied().unwrap_or(0);
            let high = scratch.get(i + words + 1).copied().unwrap_or(0);
            scratch[i] |= if bits == 0 { low } else { low >> bits | high << (64 - bits) };
        }
        covered += step;
    }
    let first = bounds.start;
    for i in bounds.clone() {
        places[i] &= !scratch[i - first];
    }
    while bounds.start < bounds.end && places[bounds.start] == 0 {
        bounds.start += 1;
    }
    while bounds.start < bounds.end && places[bounds.end - 1] == 0 {
        bounds.end -= 1;
    }
}
