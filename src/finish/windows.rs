//! Means around patches, of what single patches show too noisily: windows of 3.6 texels on the texel graph.
//!
//! In: a network and values by patch. Out: the mean around each block of up to 2 × 2 linked texels, which all of them get.
//! Constants stay constant.
//!
//! Blocks are a coarser network: conductances between two blocks add up, and count twice because a step leads twice as
//! far (Braess, "Towards algebraic multigrid for elliptic problems of second order", Computing 55, 1995: aggregates that
//! are constant inside are stiff by that factor). Flow on it takes a seventh of the operations of flow between texels.
//!
//! Symbols: A exposed area [m²]   g conductance [m²]
//!
//! Limits: texels of one block have one mean, so windows are off by up to half a texel.

use super::network::{CHUNK, Field, Network};
use crate::base::{Groups, Sets, parallel};
use crate::patches::Patches;

/// Steps of flow from block to block: each spreads by 1.6 texels² per axis.
const STEPS: usize = 8;
/// Texels that such a window averages over, on a plane: 4π times the variance of the flow.
const TEXELS: f32 = 161.0;

/// Blocks of patches, and what flows between them.
pub(super) struct Windows {
    blocks: Groups,
    /// Exposed area of each patch [m²].
    area: Vec<f32>,
    network: Network,
    /// Texels that the window around each block averages over.
    sizes: Vec<f32>,
}

impl Windows {
    /// Over the patches of a network.
    pub(super) fn new(patches: &Patches, network: &Network) -> Self {
        let square = |i: usize| {
            let front = patches.front_patch(i);
            let (x, y) = patches.texel_xy(front);
            (patches.is_back(i), patches.page(front), x / 2, y / 2)
        };
        let area = parallel::map_light(network.len(), |i| patches.exposed_area(i));
        Self::of(network, area, square)
    }

    /// Blocks are patches in one square that are linked within it.
    pub(super) fn of<S: PartialEq>(network: &Network, area: Vec<f32>, square: impl Fn(usize) -> S + Sync) -> Self {
        let together = parallel::map_chunks(network.len(), CHUNK, |range| {
            let mut pairs = vec![];
            for i in range {
                let own = square(i);
                // Each link is in the rows of both of its ends.
                let linked = network.row(i).iter().filter(|(j, rate)| *rate > 0.0 && (*j as usize) < i);
                pairs.extend(linked.filter(|(j, _)| square(*j as usize) == own).map(|(j, _)| [i as u32, *j]));
            }
            pairs
        });
        let mut sets = Sets::new(network.len());
        together.into_iter().flatten().for_each(|[i, j]| sets.join(i as usize, j as usize));
        let blocks = Groups::new(sets.numbers());
        let network = network.merged(&blocks, &area);
        let sizes = network.sizes(|b| blocks.members(b).len() as u32);
        let sizes = sizes.into_iter().map(|n| (n as f32).min(TEXELS)).collect();
        Self { blocks, area, network, sizes }
    }

    /// The mean around each block, weighted by area.
    pub(super) fn means<T: Field>(&self, value: impl Fn(usize) -> T + Sync) -> Vec<T> {
        let own = parallel::map_light(self.blocks.count(), |b| {
            let members = self.blocks.members(b);
            let first = value(members[0] as usize);
            let all = members.iter().map(|&i| self.area[i as usize]).fold(0.0, |a, b| a + b);
            let others = members[1..].iter().fold(first * 0.0, |sum, &i| {
                sum + (value(i as usize) - first) * (self.area[i as usize] / all.max(f32::MIN_POSITIVE))
            });
            first + others
        });
        self.network.flow(own, STEPS)
    }

    /// The block of a patch.
    pub(super) fn block(&self, patch: usize) -> usize {
        self.blocks.of(patch)
    }

    /// Texels that the window around a patch averages over.
    pub(super) fn size(&self, patch: usize) -> f32 {
        self.sizes[self.block(patch)]
    }
}

#[cfg(test)]
mod tests {
    use super::super::network::STEP;
    use super::*;

    /// A plane of n × n equal texels.
    fn plane(n: i32) -> Network {
        let row = |i: i32| {
            let (x, y) = (i % n, i / n);
            let near = [(x - 1, y), (x + 1, y), (x, y - 1), (x, y + 1)];
            let within = near.into_iter().filter(|&(x, y)| x.min(y) >= 0 && x.max(y) < n);
            within.map(|(x, y)| ((y * n + x) as u32, STEP)).collect::<Vec<_>>()
        };
        Network::from_chunks((0..n * n).map(|i| (row(i), vec![row(i).len() as u32])).collect())
    }

    fn windows(n: i32) -> Windows {
        let square = |i: usize| (i as i32 % n / 2, i as i32 / n / 2);
        Windows::of(&plane(n), vec![0.01; (n * n) as usize], square)
    }

    #[test]
    fn a_peak_spreads_as_far_as_said() {
        let n = 81;
        let (windows, middle) = (windows(n), (n * n / 2) as usize);
        let spread = windows.means(|i| if i == middle { 1.0f32 } else { 0.0 });
        let at = |i: usize| f64::from(spread[windows.block(i)]);
        let far = |i: usize| f64::from((i as i32 % n - n / 2).pow(2));
        let sum = |f: &dyn Fn(usize) -> f64| (0..(n * n) as usize).map(f).fold(0.0, |a, b| a + b);
        assert!((sum(&at) - 1.0).abs() < 1e-4, "{}", sum(&at));
        // The variance of the flow, and of places within a block.
        let variance = sum(&|i| at(i) * far(i));
        assert!((variance - 12.8).abs() < 1.0, "{variance}");
        let width = 1.0 / sum(&|i| at(i) * at(i));
        assert!((width / f64::from(TEXELS) - 1.0).abs() < 0.1, "{width}");
    }

    #[test]
    fn constants_stay_and_sizes_count_texels() {
        for n in [1, 3, 10, 31] {
            let windows = windows(n);
            assert!(windows.means(|_| 0.7f32).iter().all(|v| (v - 0.7).abs() < 1e-6));
            assert_eq!(windows.size(0), ((n * n) as f32).min(TEXELS));
        }
    }
}
