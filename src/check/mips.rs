//! Light of other charts in small mip levels.
//!
//! In: pages with boxes of 2ᵏ × 2ᵏ texels averaged, as graphics libraries make mip levels. At the middle of every texel at
//! the border of a chart, a look-up in level k is compared with the same look-up that reads none but the chart's own
//! texels: those it covers, and those around it that are nearer to it than to any other chart, unless they were left
//! black beside lit ones or hold, as most of them do, light that the chart has nowhere (`foreign`). So a gradient of light is no fault: without foreign texels in reach the two are equal.
//!
//! Judged are the levels of which the manifest says that they are clean (`mipLevels`), and levels 1 to 3 where it says
//! nothing, as other bakers do not. In a file that promises n levels, the texels that look-ups of one chart alone read up
//! to level n are that chart's (`atlas::cells`), nearest or not, since they are filled from it.
//!
//! Limits: of pages whose sides are no multiples of 2ᵏ the last texels are left out, as most libraries do. Block
//! compression is not simulated: its error shows in formats, and would hide what is looked for here.

use super::foreign::Foreign;
use super::measure::{Kind, Measure, Tally};
use super::page;
use super::subject::{FLOOR, Subject, rgb};
use crate::atlas::NO_CHART;
use crate::atlas::cells::{Cells, NOBODY, SEVERAL};
use crate::base::{Rgb, parallel};
use glam::Vec2;

/// Levels that are judged where nothing is promised, and of which the figures are told in any case.
const LEVELS: u32 = 3;

/// How far filled texels belong to a chart: the reach of a look-up in the last of [`LEVELS`].
const REACH: u32 = 12;

/// Between charts: nearest to more than one.
const BETWEEN: u32 = SEVERAL;

/// Border texels per chunk of work.
const CHUNK: usize = 256;

/// The chart that every texel of a page belongs to.
struct Owners {
    width: i32,
    height: i32,
    chart: Vec<u32>,
    /// What is covered near the texel is lit, so black is no light of its own.
    lit: Vec<bool>,
    /// No surface, and light that its chart has nowhere, as most of the chart's own texels without surface.
    foreign: Vec<bool>,
}

impl Owners {
    fn new(subject: &Subject<'_>, foreign: &Foreign, page: u32, cells: Option<&Cells>) -> Self {
        let image = subject.page(page);
        let (width, height) = (image.width as i32, image.height as i32);
        let count = image.pixels.len();
        let mut owners = Self { width, height, chart: vec![NO_CHART; count], lit: vec![false; count], foreign: vec![] };
        let mut front = vec![];
        for y in 0..height {
            for x in 0..width {
                if let Some(i) = subject.patches.front_at(page, x, y) {
                    let own = if subject.is_pure(i) { subject.patches.chart(i) } else { BETWEEN };
                    owners.chart[(y * width + x) as usize] = own;
                    owners.lit[(y * width + x) as usize] = subject.light(i).max_element() > FLOOR * subject.mean;
                    front.push([x, y]);
                }
            }
        }
        for _ in 0..REACH {
            front = owners.grow(&front);
        }
        if let Some(cells) = cells {
            owners.take(subject, page, cells);
        }
        owners.find_foreign(subject, foreign, page);
        owners
    }

    fn find_foreign(&mut self, subject: &Subject<'_>, foreign: &Foreign, page: u32) {
        let width = self.width;
        let light = |i: usize| {
            let [x, y] = [i as i32 % width, i as i32 / width];
            subject.patches.front_at(page, x, y).is_none().then(|| rgb(subject.texel(page, x, y)))
        };
        let looks = parallel::map_light(self.chart.len(), |i| {
            light(i).map_or([0; 2], |light| [1, u32::from(foreign.is_foreign_to(self.chart[i], light))])
        });
        let most = foreign.most(self.chart.iter().copied().zip(looks.iter().copied()));
        let is_foreign = |(chart, [_, own]): (&u32, &[u32; 2])| *own > 0 && most.get(*chart as usize) == Some(&true);
        self.foreign = self.chart.iter().zip(&looks).map(is_foreign).collect();
    }

    /// Gives the texels beside charts to the chart whose look-ups alone read them.
    fn take(&mut self, subject: &Subject<'_>, page: u32, cells: &Cells) {
        for (i, (chart, lit)) in self.chart.iter_mut().zip(&mut self.lit).enumerate() {
            let [x, y] = [i as i32 % self.width, i as i32 / self.width];
            let owner = cells.owner(page, [x as u32, y as u32]);
            if owner != NOBODY && owner != SEVERAL && subject.patches.front_at(page, x, y).is_none() {
                // That what is nearest is lit says nothing of a chart farther away, whose light may be none.
                *lit &= *chart == owner;
                *chart = owner;
            }
        }
    }

    fn at(&self, x: i32, y: i32) -> Option<usize> {
        ((0..self.width).contains(&x) && (0..self.height).contains(&y)).then(|| (y * self.width + x) as usize)
    }

    /// Gives the empty texels around `front` to the chart that all their neighbours belong to.
    fn grow(&mut self, front: &[[i32; 2]]) -> Vec<[i32; 2]> {
        let mut next: Vec<[i32; 2]> = vec![];
        for &[x, y] in front {
            for k in 0..9 {
                let (x, y) = (x + k % 3 - 1, y + k / 3 - 1);
                if self.at(x, y).is_some_and(|i| self.chart[i] == NO_CHART) {
                    next.push([x, y]);
                }
            }
        }
        next.sort_unstable();
        next.dedup();
        let owner = |&[x, y]: &[i32; 2]| {
            let around = (0..9).filter_map(|k| self.at(x + k % 3 - 1, y + k / 3 - 1));
            let known: Vec<usize> = around.filter(|&i| self.chart[i] != NO_CHART).collect();
            let first = known.first().map_or(BETWEEN, |&i| self.chart[i]);
            let one = known.iter().all(|&i| self.chart[i] == first);
            (if one { first } else { BETWEEN }, known.iter().all(|&i| self.lit[i]))
        };
        let owned: Vec<(u32, bool)> = next.iter().map(owner).collect();
        for (&[x, y], (chart, lit)) in next.iter().zip(owned) {
            let i = (y * self.width + x) as usize;
            (self.chart[i], self.lit[i]) = (chart, lit);
        }
        next
    }
}

/// Whose cells are whose in the last level that is promised to be clean.
fn cells(subject: &Subject<'_>, level: u32) -> Cells {
    let patches = &subject.patches;
    let mut cells = Cells::new(level, patches.page_size, subject.lightmaps.pages().len() as u32);
    for i in 0..patches.front {
        let (x, y) = patches.texel_xy(i);
        // No chart has this number, so what a texel of several charts reads is nobody's own.
        let chart = if subject.is_pure(i) { patches.chart(i) } else { SEVERAL };
        cells.cover(patches.page(i), [x, y], chart);
    }
    cells
}

/// Bleeding at chart borders; the value is the 99.9th percentile over them, the worst level of each.
pub(super) fn measure(subject: &Subject<'_>, foreign: &Foreign) -> Measure {
    let patches = &subject.patches;
    let promised = page::clean_levels(&subject.scene.document);
    let judged = promised.unwrap_or(LEVELS) as usize;
    let count = judged.max(LEVELS as usize);
    let cells = promised.filter(|level| *level > 0).map(|level| cells(subject, level));
    let owners = parallel::map(subject.lightmaps.pages().len(), |page| {
        Owners::new(subject, foreign, page as u32, cells.as_ref())
    });
    let border: Vec<u32> = (0..patches.front).filter(|&i| is_border(subject, i)).map(|i| i as u32).collect();
    let limit = subject.settings.limit(Kind::MipBleeding);
    let chunks = parallel::map_chunks(border.len(), CHUNK, |range| {
        let mut tallies: Vec<Tally> = (0..=count).map(|_| Tally::default()).collect();
        for k in range {
            let i = border[k] as usize;
            if subject.is_hidden(subject.middle(i)) {
                continue;
            }
            let level = |k: usize| bleeding(subject, &owners[patches.page(i) as usize], i, k as u32 + 1);
            let levels: Vec<f64> = (0..count).map(level).collect();
            let worst = levels[..judged].iter().copied().fold(0.0, f64::max);
            tallies[count].look(worst, limit, || subject.middle(i));
            tallies.iter_mut().zip(levels).for_each(|(tally, level)| tally.weigh(level as f32, 1.0));
        }
        tallies
    });
    let mut by_level: Vec<Vec<Tally>> = (0..=count).map(|_| vec![]).collect();
    for chunk in chunks {
        by_level.iter_mut().zip(chunk).for_each(|(all, tally)| all.push(tally));
    }
    let mut joined: Vec<Tally> = by_level.into_iter().map(Tally::join).collect();
    let tally = joined.pop().unwrap_or_default();
    let levels: Vec<f64> = joined.iter_mut().map(|level| level.percentile(0.999)).collect();
    let value = levels[..judged].iter().copied().fold(0.0, f64::max);
    let mut measure = tally.measure(subject, Kind::MipBleeding, value);
    let each: Vec<String> = (1..).zip(&levels).map(|(k, v)| format!("level {k}: {:.2} %", v * 100.0)).collect();
    let said = promised.map_or_else(
        || "the file does not say how many levels are clean".to_owned(),
        |levels| format!("{levels} level(s) are said to be clean"),
    );
    measure.notes.push(format!("{}; {said}", each.join(", ")));
    measure
}

/// A neighbour of the texel is not of its chart.
fn is_border(subject: &Subject<'_>, i: usize) -> bool {
    let patches = &subject.patches;
    let (page, (x, y)) = (patches.page(i), patches.texel_xy(i));
    subject.is_pure(i)
        && patches.exposed[i] > 0.0
        && (0..9).any(|k| {
            let j = patches.front_at(page, x as i32 + k % 3 - 1, y as i32 + k / 3 - 1);
            j.is_none_or(|j| patches.chart(j) != patches.chart(i))
        })
}

fn bleeding(subject: &Subject<'_>, owners: &Owners, i: usize, level: u32) -> f64 {
    let (patches, chart) = (&subject.patches, subject.patches.chart(i));
    let ((x, y), page) = (patches.texel_xy(i), patches.page(i));
    let side = 1i32 << level;
    let (columns, rows) = ((owners.width / side).max(1), (owners.height / side).max(1));
    let at = (Vec2::new(x as f32, y as f32) + patches.centroid[i]) / side as f32 - 0.5;
    let (floor, fraction) = (at.floor(), at - at.floor());
    let (mut own, mut own_weight, mut all, mut all_weight) = (Rgb::ZERO, 0.0f32, Rgb::ZERO, 0.0f32);
    for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
        let share = |d: i32, f: f32| if d == 0 { 1.0 - f } else { f };
        let weight = share(dx, fraction.x) * share(dy, fraction.y) / (side * side) as f32;
        let left = (floor.x as i32 + dx).clamp(0, columns - 1) * side;
        let top = (floor.y as i32 + dy).clamp(0, rows - 1) * side;
        for y in top..(top + side).min(owners.height) {
            for x in left..(left + side).min(owners.width) {
                let value = rgb(subject.texel(page, x, y));
                let i = (y * owners.width + x) as usize;
                let unfilled = value == Rgb::ZERO && owners.lit[i] && patches.front_at(page, x, y).is_none();
                if owners.chart[i] == chart && !unfilled && !owners.foreign[i] {
                    own += value * weight;
                    own_weight += weight;
                } else {
                    all += value * weight;
                    all_weight += weight;
                }
            }
        }
    }
    if all_weight <= 0.0 || own_weight <= 0.0 {
        return 0.0;
    }
    let mean = own / own_weight;
    let mixed = (own + all) / (own_weight + all_weight);
    let scale = mean.max_element().max(FLOOR * subject.mean);
    if scale > 0.0 { f64::from((mixed - mean).abs().max_element() / scale) } else { 0.0 }
}
