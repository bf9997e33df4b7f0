//! Cells of space, to average over what the texel graph keeps apart: furniture has charts of a few texels, too few to
//! tell noise from structure, but their neighbours in space see much the same light.

use crate::base::parallel;
use crate::patches::Patches;
use glam::{DVec3, Vec3};
use rayon::slice::ParallelSliceMut;

/// Edge of a narrow cell in edges of the median texel.
pub(super) const NARROW: f32 = 8.0;
/// Edge of a wide cell in edges of the median texel.
pub(super) const WIDE: f32 = 32.0;

/// Patches, grouped by the cell that their centre lies in.
pub(super) struct Cells {
    /// Patches by cell.
    order: Vec<u32>,
    /// Where in `order` each cell starts, and the end.
    first: Vec<u32>,
    /// Cell of each patch.
    cell: Vec<u32>,
}

impl Cells {
    /// Groups the first `n` patches by cells of that many texels along an edge.
    pub(super) fn new(patches: &Patches, n: usize, size: f32) -> Self {
        let edge = size * patches.median_edge(n, |i| i);
        let key = |i: usize| (patches.position[i] / edge).floor().to_array().map(|v| v as i32);
        let mut keyed = parallel::map(n, |i| (key(i), i as u32));
        keyed.par_sort_unstable();
        let is_first = |k: usize| k == 0 || keyed[k].0 != keyed[k - 1].0;
        let mut first: Vec<u32> = (0..n).filter(|&k| is_first(k)).map(|k| k as u32).collect();
        first.push(n as u32);
        let mut cell = vec![0; n];
        for (c, ends) in first.windows(2).enumerate() {
            keyed[ends[0] as usize..ends[1] as usize].iter().for_each(|k| cell[k.1 as usize] = c as u32);
        }
        Self { order: keyed.into_iter().map(|(_, i)| i).collect(), first, cell }
    }

    /// Number of the cell of a patch.
    pub(super) fn of(&self, patch: usize) -> usize {
        self.cell[patch] as usize
    }

    /// Each patch's mean over its cell.
    pub(super) fn mean(&self, values: &[f32]) -> Vec<f32> {
        let means = self.means(|i| Vec3::new(values[i], 0.0, 0.0));
        parallel::map_light(values.len(), |i| means[self.of(i)].x)
    }

    /// Mean over each cell, of three values at once.
    pub(super) fn means(&self, value: impl Fn(usize) -> Vec3 + Sync) -> Vec<Vec3> {
        parallel::map(self.first.len() - 1, |c| {
            let members = &self.order[self.first[c] as usize..self.first[c + 1] as usize];
            let sum = members.iter().fold(DVec3::ZERO, |sum, &i| sum + value(i as usize).as_dvec3());
            (sum / members.len() as f64).as_vec3()
        })
    }
}
