//! The texel graph as a network of conductances, through which received light flows.
//!
//! One step is `Φ_i += Σ_j g_ij (E_j − E_i)` with `g_ij = g_ji ≥ 0`: a reversible random walk on the texels. Flux is
//! conserved and constant irradiance stays constant, whatever the areas. A splat that gives shares to neighbours by
//! distance alone (the paper's eq. (4)) is not reversible: on a chain of five patches with areas 1 1 1 1 0.1 it turns
//! constant 1 into up to 3.
//!
//! Light flows between the four neighbours of the texel grid. A step moves it by one texel with probability [`STEP`]
//! per link, a variance of 2·STEP texels² per axis.
//!
//! Symbols: A exposed area [m²]   E irradiance [lx]   Φ = A E   c factor of a link in [0, 1]
//!
//! Invariant: the sum of `g_ij` over j is at most 0.8 A, so a step never overshoots.

use crate::base::parallel;
use crate::patches::{PatchGraph, Patches};
use core::ops::{Add, Mul, Sub};

/// Share of a patch that flows over one link per step. Four links take 0.8; above 0.25 the explicit step would ring.
pub(super) const STEP: f32 = 0.2;

/// Links with their rates g/A, compressed rows.
pub(super) struct Network {
    first: Vec<u32>,
    links: Vec<(u32, f32)>,
}

/// What can flow: one or several irradiances at once.
pub(super) trait Field:
    Copy + Send + Sync + Add<Output = Self> + Sub<Output = Self> + Mul<f32, Output = Self>
{
}
impl<T: Copy + Send + Sync + Add<Output = T> + Sub<Output = T> + Mul<f32, Output = T>> Field for T {}

impl Network {
    /// Full conductances between the first `n` patches.
    pub(super) fn new(patches: &Patches, graph: &PatchGraph, n: usize) -> Self {
        let row = |i: usize| {
            let (x, y) = patches.texel_xy(patches.front_patch(i));
            let area = patches.exposed_area(i);
            let beside = |j: usize| {
                let (u, v) = patches.texel_xy(patches.front_patch(j));
                u.abs_diff(x) + v.abs_diff(y) == 1
            };
            let rate = |j: usize| STEP * area.min(patches.exposed_area(j)) / area.max(f32::MIN_POSITIVE);
            let links = graph.neighbors(i).iter().filter(|&&j| (j as usize) < n && beside(j as usize));
            links.map(|&j| (j, rate(j as usize))).collect::<Vec<_>>()
        };
        Self::from_rows(parallel::map_chunks(n, 1 << 12, |range| range.map(row).collect::<Vec<_>>()))
    }

    fn from_rows(chunks: Vec<Vec<Vec<(u32, f32)>>>) -> Self {
        let (mut first, mut links) = (vec![0u32], vec![]);
        for row in chunks.into_iter().flatten() {
            links.extend(row);
            first.push(links.len() as u32);
        }
        Self { first, links }
    }

    /// The same links, each narrowed so that light flows about as far in `steps` steps as it did in `wanted` of them at
    /// full width; of two ends the smaller wish counts, so g stays symmetric.
    pub(super) fn narrowed(&self, wanted: &[f32], steps: usize) -> Self {
        let links = parallel::map(wanted.len(), |i| {
            let narrow = |&(j, rate): &(u32, f32)| {
                (j, rate * (wanted[i].min(wanted[j as usize]) / steps.max(1) as f32).min(1.0))
            };
            self.row(i).iter().map(narrow).collect::<Vec<_>>()
        });
        Self { first: self.first.clone(), links: links.into_iter().flatten().collect() }
    }

    /// `field` after so many steps.
    pub(super) fn flow<T: Field>(&self, mut field: Vec<T>, steps: usize) -> Vec<T> {
        for _ in 0..steps {
            field = parallel::map(field.len(), |i| {
                let own = field[i];
                self.row(i).iter().fold(own, |e, &(j, rate)| e + (field[j as usize] - own) * rate)
            });
        }
        field
    }

    fn row(&self, i: usize) -> &[(u32, f32)] {
        &self.links[self.first[i] as usize..self.first[i + 1] as usize]
    }
}
