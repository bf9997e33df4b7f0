//! Cells of space, to average over what the texel graph keeps apart: furniture has charts of a few texels, too few to
//! tell noise from structure, but their neighbours in space see much the same light.

use crate::base::parallel;
use crate::patches::Patches;
use glam::{DVec3, Vec3};

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
}

impl Cells {
    /// Groups the first `n` patches by cells of that many texels along an edge.
    pub(super) fn new(patches: &Patches, n: usize, size: f32) -> Self {
        let edge = size * patches.median_edge(n, |i| i);
        let key = |i: usize| (patches.position[i] / edge).floor().to_array().map(|v| v as i32);
        let mut keyed = parallel::map(n, |i| (key(i), i as u32));
        keyed.sort_unstable();
        let mut first: Vec<u32> =
            (0..n).filter(|&k| k == 0 || keyed[k].0 != keyed[k - 1].0).map(|k| k as u32).collect();
        first.push(n as u32);
        Self { order: keyed.into_iter().map(|(_, i)| i).collect(), first }
    }

    /// Each patch's mean over its cell.
    pub(super) fn mean(&self, values: &[f32]) -> Vec<f32> {
        let wide: Vec<Vec3> = values.iter().map(|&v| Vec3::new(v, 0.0, 0.0)).collect();
        self.means(&wide).into_iter().map(|v| v.x).collect()
    }

    /// The same of three values at once.
    pub(super) fn means(&self, values: &[Vec3]) -> Vec<Vec3> {
        let mut out = vec![Vec3::ZERO; values.len()];
        for cell in self.first.windows(2) {
            let members = &self.order[cell[0] as usize..cell[1] as usize];
            let sum = members.iter().fold(DVec3::ZERO, |sum, &i| sum + values[i as usize].as_dvec3());
            let mean = (sum / members.len() as f64).as_vec3();
            members.iter().for_each(|&i| out[i as usize] = mean);
        }
        out
    }
}
