//! Cells of space, to average over what the texel graph keeps apart: furniture has charts of a few texels, too few to
//! tell noise from structure, but their neighbours in space see much the same light.

use crate::base::parallel;
use crate::patches::Patches;

/// Edge of a cell in edges of the median texel.
const CELL: f32 = 8.0;

/// Patches, grouped by the cell that their centre lies in.
pub(super) struct Cells {
    /// Patches by cell.
    order: Vec<u32>,
    /// Where in `order` each cell starts, and the end.
    first: Vec<u32>,
}

impl Cells {
    /// Groups the first `n` patches.
    pub(super) fn new(patches: &Patches, n: usize) -> Self {
        let edge = patches.median_edge(n, |i| i);
        let key = |i: usize| (patches.position[i] / (CELL * edge)).floor().to_array().map(|v| v as i32);
        let mut keyed = parallel::map(n, |i| (key(i), i as u32));
        keyed.sort_unstable();
        let mut first: Vec<u32> =
            (0..n).filter(|&k| k == 0 || keyed[k].0 != keyed[k - 1].0).map(|k| k as u32).collect();
        first.push(n as u32);
        Self { order: keyed.into_iter().map(|(_, i)| i).collect(), first }
    }

    /// Each patch's mean over its cell.
    pub(super) fn mean(&self, values: &[f32]) -> Vec<f32> {
        let mut out = vec![0.0; values.len()];
        for cell in self.first.windows(2) {
            let members = &self.order[cell[0] as usize..cell[1] as usize];
            let sum = members.iter().fold(0.0, |sum, &i| sum + f64::from(values[i as usize]));
            let mean = (sum / members.len() as f64) as f32;
            members.iter().for_each(|&i| out[i as usize] = mean);
        }
        out
    }
}
