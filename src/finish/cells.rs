//! Cells of space, to average over what the texel graph keeps apart: furniture has charts of a few texels, too few to
//! tell noise from structure, but their neighbours in space see much the same light.

use crate::base::{Groups, parallel};
use crate::patches::Patches;
use glam::{DVec3, Vec3};
use rayon::slice::ParallelSliceMut;

/// Edge of a narrow cell in edges of the median texel.
pub(super) const NARROW: f32 = 8.0;
/// Edge of a wide cell in edges of the median texel.
pub(super) const WIDE: f32 = 32.0;

/// Patches, grouped by the cell that their centre lies in.
pub(super) struct Cells(Groups);

impl Cells {
    /// Groups the first `n` patches by cells of that many texels along an edge.
    pub(super) fn new(patches: &Patches, n: usize, size: f32) -> Self {
        let edge = size * patches.median_edge(n, |i| i);
        let key = |i: usize| (patches.position[i] / edge).floor().to_array().map(|v| v as i32);
        let mut keyed = parallel::map(n, |i| (key(i), i as u32));
        keyed.par_sort_unstable();
        let mut cell = vec![0; n];
        for (c, alike) in keyed.chunk_by(|a, b| a.0 == b.0).enumerate() {
            alike.iter().for_each(|(_, i)| cell[*i as usize] = c as u32);
        }
        Self(Groups::new(cell))
    }

    /// Number of the cell of a patch.
    pub(super) fn of(&self, patch: usize) -> usize {
        self.0.of(patch)
    }

    /// Each patch's mean over its cell.
    pub(super) fn mean(&self, values: &[f32]) -> Vec<f32> {
        let means = self.means(|i| Vec3::new(values[i], 0.0, 0.0));
        parallel::map_light(values.len(), |i| means[self.of(i)].x)
    }

    /// Mean over each cell, of three values at once.
    pub(super) fn means(&self, value: impl Fn(usize) -> Vec3 + Sync) -> Vec<Vec3> {
        parallel::map(self.0.count(), |c| {
            let members = self.0.members(c);
            let sum = members.iter().fold(DVec3::ZERO, |sum, &i| sum + value(i as usize).as_dvec3());
            (sum / members.len() as f64).as_vec3()
        })
    }
}
