//! Light beside charts that is none of theirs: what filled the padding, but a program that painted over it afterwards.
//!
//! In: [`Subject`] and its seams. Out: [`Foreign`], asked for single texels without surface. Whatever way padding is filled,
//! it goes on as the chart ends, so it has next to no light that texels around it do not have: by [`TOLERANCE`] of the
//! brightest of them. Of texels farther away, which small mip levels read, the range of the whole chart is asked for.
//! Bakes change the first texels beside seams so that both sides agree, to whatever does it: those are left out, `seams`
//! looks at them. Since not all seams are known there (a long edge beside several short ones), a chart counts if three in
//! four of what was looked at are none of its light.
//!
//! Limits: what is in the range of the chart passes, and so do single texels and those around charts of a few texels.

use super::seams::{Beyond, Seam};
use super::subject::{Subject, rgb};
use crate::base::{Rgb, parallel};
use crate::patches::around;

/// Texels around one without surface that tell what it may hold.
const REACH: i32 = 2;

/// How far out of range it may be, as a part of the brightest channel there.
const TOLERANCE: f32 = 0.25;

/// Share of the mean light below which nothing counts as bright: dark charts may have padding of some light.
const DIM: f32 = 0.1;

/// Texels that must have been looked at before something is said of a chart.
const LEAST: u32 = 24;

/// Least and most of each channel.
#[derive(Clone, Copy)]
struct Range([Rgb; 2]);

/// What is known of the light of charts.
pub(super) struct Foreign {
    /// By front patch: a seam runs through the texel.
    on_seam: Vec<bool>,
    /// By chart.
    charts: Vec<Range>,
    /// By chart: what is right beside it is none of its light.
    overwritten: Vec<bool>,
    /// Brightness below which differences are no part of it.
    floor: f32,
}

impl Range {
    const NONE: Self = Self([Rgb::INFINITY, Rgb::NEG_INFINITY]);

    fn add(&mut self, light: Rgb) {
        self.0 = [self.0[0].min(light), self.0[1].max(light)];
    }

    fn leaves_out(&self, light: Rgb, floor: f32) -> bool {
        let [least, most] = self.0;
        let off = (least - light).max(light - most).max_element();
        least.x <= most.x && off > TOLERANCE * most.max_element().max(floor)
    }
}

impl Foreign {
    pub(super) fn new(subject: &Subject<'_>, seams: &[Seam]) -> Self {
        let (patches, beyond) = (&subject.patches, Beyond::new(seams));
        let on_seam = parallel::map_light(patches.front, |i| beyond.runs_through(subject, i));
        let mut charts = vec![Range::NONE; subject.atlas.charts.len()];
        for (i, is_seam) in on_seam.iter().enumerate() {
            let Some(range) = charts.get_mut(patches.chart(i) as usize) else { continue };
            range.add(subject.light(i));
            let (page, (x, y)) = (patches.page(i), patches.texel_xy(i));
            for (dx, dy) in around().filter(|_| *is_seam) {
                range.add(rgb(subject.texel(page, x as i32 + dx, y as i32 + dy)));
            }
        }
        let mut foreign = Self { on_seam, charts, overwritten: vec![], floor: DIM * subject.mean };
        let looks = parallel::map_light(patches.front, |i| foreign.look_around(subject, i));
        foreign.overwritten = foreign.most((0..patches.front).map(|i| (patches.chart(i), looks[i])));
        foreign
    }

    /// Texels without surface around one: how many could be judged, and how many are foreign.
    fn look_around(&self, subject: &Subject<'_>, i: usize) -> [u32; 2] {
        let (page, (x, y)) = (subject.patches.page(i), subject.patches.texel_xy(i));
        let image = subject.page(page);
        let mut looks = [0; 2];
        for at in around().map(|(dx, dy)| [x as i32 + dx, y as i32 + dy]) {
            let within = at[0] >= 0 && at[1] >= 0 && at[0] < image.width as i32 && at[1] < image.height as i32;
            if within && subject.patches.front_at(page, at[0], at[1]).is_none() {
                let range = self.range_beside(subject, page, at);
                looks[0] += u32::from(range.is_some());
                looks[1] += u32::from(self.leaves_out(range, rgb(subject.texel(page, at[0], at[1]))));
            }
        }
        looks
    }

    /// Charts of which at least three in four of what could be judged are foreign.
    pub(super) fn most(&self, looks: impl Iterator<Item = (u32, [u32; 2])>) -> Vec<bool> {
        let mut sums = vec![[0u32; 2]; self.charts.len()];
        for (chart, [all, foreign]) in looks {
            let Some(sum) = sums.get_mut(chart as usize) else { continue };
            *sum = [sum[0] + all, sum[1] + foreign];
        }
        sums.into_iter().map(|[all, foreign]| all >= LEAST && 4 * foreign >= 3 * all).collect()
    }

    fn leaves_out(&self, range: Option<Range>, light: Rgb) -> bool {
        range.is_some_and(|range| range.leaves_out(light, self.floor))
    }

    /// The light around a texel without surface; `None` beside a seam.
    fn range_beside(&self, subject: &Subject<'_>, page: u32, [x, y]: [i32; 2]) -> Option<Range> {
        let mut range = Range::NONE;
        for (dx, dy) in (-REACH..=REACH).flat_map(|dy| (-REACH..=REACH).map(move |dx| (dx, dy))) {
            let Some(i) = subject.patches.front_at(page, x + dx, y + dy) else { continue };
            if self.on_seam[i] && dx.abs().max(dy.abs()) <= 1 {
                return None;
            }
            range.add(subject.light(i));
        }
        Some(range)
    }

    /// A texel without surface beside a chart has light that none around it has, as most there.
    pub(super) fn is_beside(&self, subject: &Subject<'_>, chart: u32, page: u32, at: [i32; 2]) -> bool {
        self.overwritten.get(chart as usize) == Some(&true)
            && self.leaves_out(self.range_beside(subject, page, at), rgb(subject.texel(page, at[0], at[1])))
    }

    /// The chart has no such light anywhere.
    pub(super) fn is_foreign_to(&self, chart: u32, light: Rgb) -> bool {
        self.leaves_out(self.charts.get(chart as usize).copied(), light)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_leave_out_what_is_off_by_a_quarter_of_their_brightest() {
        let mut range = Range::NONE;
        assert!(!range.leaves_out(Rgb::ONE, 0.0), "of nothing nothing is known");
        [Rgb::splat(0.5), Rgb::new(1.0, 0.75, 0.5)].into_iter().for_each(|light| range.add(light));
        let out = |r: f32, g: f32, b: f32| range.leaves_out(Rgb::new(r, g, b), 0.0);
        assert!(!out(0.7, 0.6, 0.5) && !out(1.24, 0.9, 0.74) && !out(0.26, 0.26, 0.26));
        assert!(out(0.0, 0.0, 0.0) && out(1.0, 0.75, 0.8) && out(1.3, 0.75, 0.5) && out(0.7, 0.2, 0.5));
        assert!(!range.leaves_out(Rgb::ZERO, 10.0));
    }
}
