//! Fills the texels beside charts, each chart's neighbourhood with its own light.
//!
//! In: pages whose covered texels (fourth value 1) hold light. Out: every other texel filled; coverage stays 0 there.
//!
//! Texels grow in rings, as in `dilate`: a ring holds the texels that touch one that is covered or filled already, and
//! each becomes the mean of those neighbours. What look-ups in a chart read, up to the mip level that is asked for
//! (`atlas::cells`), grows from that chart alone, however far it reaches; other texels grow from whatever is near, for
//! the padding and [`BLOCK_RINGS`] more. What is left is far from all charts: it gets the mean of the page, so that
//! smaller mip levels do not turn dark, and compresses to nothing.
//!
//! [`refill`] keeps what stitching of seams has changed in the first ring, which bilinear look-ups read, and grows all
//! else anew: blocks of compressed textures would spend their few bits on the steps between the two, and a texel in a
//! corner of a chart that was black and is lit by its seams would keep a black rim on its other sides.
//!
//! Invariants: constant light stays constant; a chart's own cells hold nothing outside of the range of its texels, the
//! first ring included; filling is linear in the light, so that parts of it still add up; the same bits on any run.

use super::{Lightmap, Page, fill_hidden};
use crate::atlas::cells::{Cells, NOBODY, SEVERAL};
use crate::base::parallel;
use crate::patches::Patches;

/// A block of compressed textures is four texels wide, so this reaches all of it from any of its texels.
const BLOCK_RINGS: u32 = 3;

/// Fills all pages of a lightmap, whose look-ups up to mip level `mips` read none but their own chart's light where the
/// atlas leaves room for it.
pub fn fill(patches: &Patches, lightmap: &mut Lightmap, mips: u32, padding: u32) {
    each(patches, lightmap, mips, padding, &[]);
}

/// Fills anew what is not `kept` (numbers of texels, ascending) and not covered, or hidden. Texels between the two sides of a
/// wall take light from those who read them ([`fill_hidden`]) alone: a mean of their neighbours would carry it through.
pub fn refill(patches: &Patches, lightmap: &mut Lightmap, mips: u32, padding: u32, kept: &[u32]) {
    fill_hidden(patches, lightmap, kept);
    let unlit = patches.unlit.iter().map(|unlit| patches.texel_number(unlit.texel));
    let mut kept: Vec<u32> = kept.iter().copied().chain(unlit).collect();
    kept.sort_unstable();
    each(patches, lightmap, mips, padding, &kept);
}

/// `kept` ascending.
fn each(patches: &Patches, lightmap: &mut Lightmap, mips: u32, padding: u32, kept: &[u32]) {
    let mut cells = Cells::new(mips, patches.page_size, lightmap.pages.len() as u32);
    for i in 0..patches.front {
        let (x, y) = patches.texel_xy(i);
        cells.cover(patches.page(i), [x, y], patches.chart(i));
    }
    let rings = padding.max(1) + BLOCK_RINGS;
    let filled = parallel::map(lightmap.pages.len(), |p| {
        let mut page = lightmap.pages[p].clone();
        Filling::new(&mut page, &cells, p as u32).grow(rings, kept);
        page
    });
    lightmap.pages = filled;
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum State {
    Empty,
    Queued,
    Filled,
}

struct Filling<'a> {
    page: &'a mut Page,
    number: u32,
    cells: &'a Cells,
    state: Vec<State>,
}

impl<'a> Filling<'a> {
    fn new(page: &'a mut Page, cells: &'a Cells, number: u32) -> Self {
        let state = page.pixels.iter().map(|p| if p[3] > 0.0 { State::Filled } else { State::Empty }).collect();
        Self { page, number, cells, state }
    }

    fn grow(&mut self, rings: u32, kept: &[u32]) {
        let before = self.number * self.state.len() as u32;
        let is_kept = |i: u32| kept.binary_search(&(before + i)).is_ok();
        let mut front = Vec::new();
        for i in 0..self.state.len() {
            if self.state[i] == State::Filled {
                self.queue_around(i, true, &mut front);
            }
        }
        let mut ring = 1;
        while !front.is_empty() {
            for &i in front.iter().filter(|&&i| ring > 1 || !is_kept(i)) {
                self.page.pixels[i as usize] = self.mean_around(i as usize);
            }
            front.iter().for_each(|&i| self.state[i as usize] = State::Filled);
            let mut next = Vec::new();
            front.iter().for_each(|&i| self.queue_around(i as usize, ring < rings, &mut next));
            front = next;
            ring += 1;
        }
        let mean = self.mean_of_covered();
        for (pixel, state) in self.page.pixels.iter_mut().zip(&self.state) {
            if *state != State::Filled {
                *pixel = mean;
            }
        }
    }

    /// Queues the empty texels around one that may take its light; `anywhere` also those that are nobody's.
    fn queue_around(&mut self, i: usize, anywhere: bool, front: &mut Vec<u32>) {
        let from = self.owner(i);
        for j in self.page.around(i) {
            let to = self.owner(j);
            let reaches = anywhere || (to != NOBODY && to != SEVERAL);
            if self.state[j] == State::Empty && reaches && may_take(to, from) {
                self.state[j] = State::Queued;
                front.push(j as u32);
            }
        }
    }

    fn mean_around(&self, i: usize) -> [f32; 4] {
        let to = self.owner(i);
        let (mut sum, mut count) = ([0.0f64; 3], 0.0f64);
        for j in self.page.around(i) {
            if self.state[j] == State::Filled && may_take(to, self.owner(j)) {
                sum.iter_mut().zip(self.page.pixels[j]).for_each(|(sum, value)| *sum += f64::from(value));
                count += 1.0;
            }
        }
        let [r, g, b] = sum.map(|s| (s / count.max(1.0)) as f32);
        [r, g, b, 0.0]
    }

    fn mean_of_covered(&self) -> [f32; 4] {
        let (mut sum, mut count) = ([0.0f64; 3], 0.0f64);
        for pixel in self.page.pixels.iter().filter(|p| p[3] > 0.0) {
            sum.iter_mut().zip(pixel).for_each(|(sum, value)| *sum += f64::from(*value));
            count += 1.0;
        }
        let [r, g, b] = sum.map(|s| (s / count.max(1.0)) as f32);
        [r, g, b, 0.0]
    }

    fn owner(&self, i: usize) -> u32 {
        let width = self.page.width as usize;
        self.cells.owner(self.number, [(i % width) as u32, (i / width) as u32])
    }
}

/// A texel of owner `to` may take light from one of owner `from`.
fn may_take(to: u32, from: u32) -> bool {
    to == NOBODY || to == SEVERAL || from == to || from == SEVERAL
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::patches::Unlit;

    /// Two charts of one row each, left of texel 8 and right of it.
    fn filled(mips: u32, rings: u32, kept: &[u32], edit: impl Fn(&mut Page)) -> Page {
        let mut cells = Cells::new(mips, [32, 16], 1);
        let mut page = Page { width: 32, height: 16, pixels: vec![[9.0, 9.0, 9.0, 0.0]; 512] };
        for (x, chart, value) in (2..6).map(|x| (x, 0, 1.0)).chain((11..22).map(|x| (x, 1, 5.0))) {
            cells.cover(0, [x, 7], chart);
            page.pixels[(7 * 32 + x) as usize] = [value, 2.0 * value, 0.0, 1.0];
        }
        edit(&mut page);
        Filling::new(&mut page, &cells, 0).grow(rings, kept);
        page
    }

    fn at(page: &Page, x: usize, y: usize) -> f32 {
        page.pixels[y * 32 + x][0]
    }

    #[test]
    fn cells_hold_the_light_of_their_own_chart_alone() {
        // Cells of 4: the first chart reads columns 0 to 7, the second one 8 to 23, both rows 4 to 11.
        let page = filled(2, 1, &[], |_| ());
        for y in 4..12 {
            assert!((0..8).all(|x| at(&page, x, y) == 1.0), "row {y}");
            assert!((8..24).all(|x| at(&page, x, y) == 5.0), "row {y}");
        }
        assert!(page.pixels.iter().all(|p| p[1] == 2.0 * p[0]));
    }

    #[test]
    fn nearest_texels_decide_where_nobody_reads_and_the_mean_beyond() {
        let page = filled(0, 4, &[], |_| ());
        assert_eq!([at(&page, 6, 7), at(&page, 7, 7), at(&page, 9, 7), at(&page, 10, 7)], [1.0, 1.0, 5.0, 5.0]);
        assert_eq!([at(&page, 25, 7), at(&page, 25, 11)], [5.0, 5.0]);
        let mean = (4.0 + 55.0) / 15.0;
        assert!((at(&page, 31, 15) - mean).abs() < 1e-6 && at(&page, 3, 0) == at(&page, 31, 15));
        assert_eq!(page.pixels.iter().filter(|p| p[3] > 0.0).count(), 15);
    }

    #[test]
    fn refilling_keeps_what_seams_changed_and_goes_on_from_it() {
        let changed = |page: &mut Page| {
            *page = filled(2, 1, &[], |_| ());
            page.pixels[7 * 32 + 2] = [9.0, 18.0, 0.0, 1.0];
            page.pixels[6 * 32 + 5] = [3.0, 6.0, 0.0, 0.0];
        };
        let page = filled(2, 1, &[6 * 32 + 5], changed);
        assert_eq!((at(&page, 5, 6), at(&page, 4, 6)), (3.0, 1.0));
        assert!(at(&page, 5, 5) > 1.0 && at(&page, 5, 5) < 3.0);
        assert_eq!((at(&page, 1, 7), at(&page, 1, 6)), (9.0, 9.0), "beside a covered texel that changed");
    }

    #[test]
    fn hidden_texels_that_nobody_reads_grow_anew_and_others_keep_what_their_readers_gave() {
        let unlit =
            |x: u32, weight: f32| Unlit { texel: [0, x, 6], weights: [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, weight, 0.0] };
        let mut patches = Patches::default();
        patches.page_size = [32, 16];
        patches.unlit = vec![unlit(13, 0.1)];
        // Both charts were black, and their seams lit them.
        let mut page = filled(0, 1, &[], |_| ());
        page.pixels.iter_mut().filter(|p| p[3] == 0.0).for_each(|p| *p = [0.0; 4]);
        page.pixels[7 * 32 + 13][0] = 7.0;
        let mut lightmap = Lightmap { pages: vec![page] };
        refill(&patches, &mut lightmap, 0, 1, &[]);
        let page = &lightmap.pages[0];
        assert_eq!([at(page, 3, 6), at(page, 4, 6)], [1.0, 1.0]);
        assert_eq!(at(page, 13, 6), 7.0, "the light of the one that reads it");
    }
}
