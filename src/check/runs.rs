//! Faults of light that are long enough to be seen: the value that texels side by side reach over some length.
//!
//! In: the worst value of each texel. Out: the value of the worst group that is [`RUN`] texels long, and which texels belong
//! to groups of that length beyond a limit. A wall that lets light through shows along all of its foot. At the corner of a
//! box, or around a leg no wider than a texel, a few texels mix both sides of it, which is what their size does.
//!
//! Source: texels are joined from the worst on, as in the component tree of an image (Najman and Couprie, "Building the
//! component tree in quasi-linear time", IEEE TIP 15(11), 2006).
//!
use crate::base::Sets;
use crate::patches::Patches;
use glam::UVec2;

/// Columns or rows that a group of texels side by side, diagonals included, reaches over if it counts.
pub(super) const RUN: u32 = 6;

/// Texels, ascending, with a value each.
type Values = [(usize, f64)];

/// Groups of texels, grown texel by texel.
struct Groups<'a> {
    patches: &'a Patches,
    values: &'a Values,
    sets: Sets,
    /// Corners of the rectangle around the group that each representative stands for [texels]; `None` for texels that are
    /// in none yet.
    around: Vec<Option<[UVec2; 2]>>,
}

impl<'a> Groups<'a> {
    fn new(patches: &'a Patches, values: &'a Values) -> Self {
        Self { patches, values, sets: Sets::new(values.len()), around: vec![None; values.len()] }
    }

    /// One more texel, by its place among the values.
    fn add(&mut self, place: usize) {
        let texel = self.values[place].0;
        let own = UVec2::from(self.patches.texel_xy(texel));
        self.around[place] = Some([own, own]);
        for j in self.patches.around_in_chart(texel) {
            let Ok(other) = self.values.binary_search_by_key(&j, |v| v.0) else { continue };
            let (a, b) = (self.sets.find(place), self.sets.find(other));
            if let (Some([low, high]), Some([from, to])) = (self.around[a], self.around[b]) {
                self.sets.join(a, b);
                self.around[a.min(b)] = Some([low.min(from), high.max(to)]);
            }
        }
    }

    /// The group of a texel, by its place, is long enough.
    fn is_long(&mut self, place: usize) -> bool {
        let group = self.sets.find(place);
        self.around[group].is_some_and(|[low, high]| (high - low).max_element() + 1 >= RUN)
    }
}

/// The largest value that a group of texels reaches which is [`RUN`] long; 0 without one.
pub(super) fn sustained(patches: &Patches, values: &Values) -> f64 {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|&a, &b| values[b].1.total_cmp(&values[a].1));
    let mut groups = Groups::new(patches, values);
    let long = order.into_iter().find(|&k| {
        groups.add(k);
        groups.is_long(k)
    });
    long.map_or(0.0, |k| values[k].1)
}

/// Places among the values of those beyond a limit whose groups are so long.
pub(super) fn beyond(patches: &Patches, values: &Values, limit: f64) -> Vec<usize> {
    let mut groups = Groups::new(patches, values);
    let large: Vec<usize> = (0..values.len()).filter(|&k| values[k].1 > limit).collect();
    large.iter().for_each(|&k| groups.add(k));
    large.into_iter().filter(|&k| groups.is_long(k)).collect()
}
