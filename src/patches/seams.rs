//! Links across the borders of charts: texels of two charts, or of two meshes, that lie side by side on one surface.
//!
//! In: patches, and how many of its four sides each has linked within its chart. Out: pairs of patches. The texel grid
//! knows nothing of them, so they are found in space: the centroids are closer than [`NEAR`] texel edges and lie in one
//! plane, the normals agree, and the two see each other as linked texels do. Texels of very different size, as rules may ask
//! for, lie in different lattices; of a pair, the one with the smaller texel finds the other.
//!
//! Invariants: symmetric, no duplicates, at most [`MOST`] links that a patch chose itself; the same at any thread count.
//!
//! Limits: of many texels that lie in one place, more than [`CROWD`] in three cells of space, some links are missing.

use super::Patches;
use super::graph::linked;
use crate::base::{Progress, parallel};
use crate::scene::Scene;
use crate::trace::Tracer;
use glam::{IVec3, Vec3};
use rayon::slice::ParallelSliceMut;
use std::collections::{BTreeMap, BTreeSet};

/// Distance of centroids in mean texel edges, below which texels may touch: 1 for whole ones side by side.
const NEAR: f32 = 1.2;
/// Distance of a centroid from the other's plane, in texel edges: half the bend of the sharpest link (10°), and a little.
const OFF_PLANE: f32 = 0.12;
/// Links that a patch looks for.
const MOST: usize = 2;
/// Candidates that are looked at, nearest first: each costs rays.
const LOOKS: usize = 4;

/// Largest texel edge in the lattice around the median one, in median edges; in the others by powers of two.
const LARGEST: f32 = 1.25;
/// Powers of two, up and down.
const MOST_OCTAVES: f32 = 20.0;
/// Cell of space in median texel edges: all that are near lie in the cells around.
const CELL: f32 = LARGEST * NEAR;
/// Most patches that are looked at in three cells in a row, so that time stays in proportion to the patches.
const CROWD: usize = 256;

/// Border patches of texels of about one size by the cell of space that they lie in.
struct Lattice {
    cell: f32,
    /// Cell and patch, ascending.
    members: Vec<([i32; 3], u32)>,
}

/// Both directions of all links, ascending.
pub(super) fn find(
    patches: &Patches,
    tracer: &Tracer<'_>,
    sides: impl Fn(usize) -> usize + Sync,
    progress: &Progress,
) -> Vec<[u32; 2]> {
    let border: Vec<u32> =
        (0..patches.len()).filter(|&i| patches.exposed[i] > 0.0 && sides(i) < 4).map(|i| i as u32).collect();
    let lattices = Lattices::new(patches, &border);
    let found = parallel::map_watched(border.len(), progress, |k| lattices.links(patches, tracer, border[k] as usize));
    let mut links: Vec<[u32; 2]> = vec![];
    for (&i, chosen) in border.iter().zip(found) {
        links.extend(chosen.into_iter().flat_map(|j| [[i, j], [j, i]]));
    }
    links.par_sort_unstable();
    links.dedup();
    links
}

/// Lattices for all sizes.
struct Lattices {
    median: f32,
    by_octave: BTreeMap<i32, Lattice>,
}

impl Lattices {
    fn new(patches: &Patches, border: &[u32]) -> Self {
        let median = patches.median_edge(border.len(), |k| border[k] as usize).max(f32::MIN_POSITIVE);
        let mut lattices = Self { median, by_octave: BTreeMap::new() };
        let octaves = parallel::map(border.len(), |k| lattices.octave(patches, border[k] as usize));
        let all: BTreeSet<i32> = octaves.iter().copied().collect();
        for octave in all {
            let own: Vec<u32> = border.iter().zip(&octaves).filter(|(_, o)| **o == octave).map(|(i, _)| *i).collect();
            let cell = CELL * median * libm::exp2f(octave as f32);
            lattices.by_octave.insert(octave, Lattice::new(patches, &own, cell));
        }
        lattices
    }

    /// 0 for texels of about median size, 1 for those up to twice as long, and so on.
    fn octave(&self, patches: &Patches, i: usize) -> i32 {
        let octave = libm::log2f(patches.texel_edge(i) / (LARGEST * self.median)).ceil();
        octave.clamp(-MOST_OCTAVES, MOST_OCTAVES) as i32
    }

    fn links(&self, patches: &Patches, tracer: &Tracer<'_>, i: usize) -> Vec<u32> {
        let mut near: Vec<(f32, u32)> = vec![];
        for lattice in self.by_octave.range(self.octave(patches, i)..).map(|(_, lattice)| lattice) {
            lattice.around(patches.position[i], |j| {
                if let Some(distance) = beside(patches, tracer.scene(), i, j) {
                    near.push((distance, j as u32));
                }
            });
        }
        near.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let sees = |&(_, j): &(f32, u32)| linked(patches, tracer, i, j as usize);
        near.into_iter().take(LOOKS).filter(sees).take(MOST).map(|(_, j)| j).collect()
    }
}

impl Lattice {
    fn new(patches: &Patches, border: &[u32], cell: f32) -> Self {
        let mut lattice = Self { cell: cell.max(f32::MIN_POSITIVE), members: vec![] };
        lattice.members = parallel::map(border.len(), |k| {
            (lattice.cell_of(patches.position[border[k] as usize]).to_array(), border[k])
        });
        lattice.members.par_sort_unstable();
        lattice
    }

    fn cell_of(&self, position: Vec3) -> IVec3 {
        (position / self.cell).floor().as_ivec3()
    }

    /// Calls `visit` for the patches in the 27 cells around a position.
    fn around(&self, position: Vec3, mut visit: impl FnMut(usize)) {
        let middle = self.cell_of(position);
        for k in 0..9 {
            // Cells along z follow each other.
            let row = middle.saturating_add(IVec3::new(k % 3 - 1, k / 3 - 1, 0));
            let key = |dz: i32| [row.x, row.y, row.z.saturating_add(dz)];
            let start = self.members.partition_point(|m| m.0 < key(-1));
            self.members[start..].iter().take(CROWD).take_while(|m| m.0 <= key(1)).for_each(|m| visit(m.1 as usize));
        }
    }
}

/// Distance between two patches in texel edges, if they can be side by side and the texel grid does not know.
fn beside(patches: &Patches, scene: &Scene, i: usize, j: usize) -> Option<f32> {
    if i == j || patches.is_back(i) != patches.is_back(j) {
        return None;
    }
    // Distance comes first: it leaves few of the hundreds of texels that lie in the same cells of space.
    let offset = patches.position[j] - patches.position[i];
    let edge = 0.5 * (patches.texel_edge(i) + patches.texel_edge(j));
    let distance = offset.length() / edge;
    let off_plane = || offset.dot(patches.normal[i]).abs().max(offset.dot(patches.normal[j]).abs()) / edge;
    if !(distance < NEAR && off_plane() < OFF_PLANE) || on_grid(patches, i, j) {
        return None;
    }
    // The walk's light is missing on what casts none; shared with it, it would be lost.
    (patches.casts(scene, i) == patches.casts(scene, j)).then_some(distance)
}

/// The texels are neighbours in one chart.
fn on_grid(patches: &Patches, i: usize, j: usize) -> bool {
    let [i, j] = [i, j].map(|patch| patches.front_patch(patch));
    let ((x, y), (u, v)) = (patches.texel_xy(i), patches.texel_xy(j));
    patches.chart[i] == patches.chart[j] && patches.page(i) == patches.page(j) && x.abs_diff(u).max(y.abs_diff(v)) <= 1
}
