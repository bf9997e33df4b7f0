//! Links between neighbouring patches: the texel grid's eight neighbours, where light may be shared.
//!
//! A link joins two texels of one chart and one side that touch on the surface, face the same way within
//! [`COS_FACING`], and see each other along two short segments above the surface, one close to it and one higher. So no
//! link crosses a wall that stands on the floor, or joins the top of a table to its edge.
//!
//! These are the links of the paper. Where the surface goes on beyond a chart's border, other links join what lies side
//! by side there ([`seams`](super::seams)).
//!
//! Invariants: symmetric, no duplicates, at most eight per patch, neighbours ascending.

use super::{NO_PATCH, Patches, seams};
use crate::base::{Progress, parallel};
use crate::trace::{Ray, Tracer};

/// Cosine of the largest angle between linked patches (10°): the paper links coplanar ones; on curved surfaces light
/// changes by less than 2 % over this angle.
pub const COS_FACING: f32 = 0.984_807_7;
/// Heights of the sight lines in texel edges. The lower one clears the crease of two patches at 10° (0.044 edges).
pub const HEIGHTS: [f32; 2] = [0.06, 0.3];
/// Least shared length of two texels that touch, in texel edges.
const LEAST_CONTACT: f64 = 1e-3;

/// Neighbours that come later in row order; the other four follow by symmetry.
const FORWARD: [(i32, i32); 4] = [(1, 0), (0, 1), (1, 1), (-1, 1)];

/// Neighbours of every patch, compressed rows.
#[derive(Debug, Default)]
pub struct PatchGraph {
    first: Vec<u32>,
    neighbors: Vec<u32>,
    /// Both directions of the links across borders of charts, ascending.
    across: Vec<[u32; 2]>,
}

impl PatchGraph {
    /// Finds the links of all patches.
    #[must_use]
    pub fn new(patches: &Patches, tracer: &Tracer<'_>, progress: &Progress) -> Self {
        let contact = parallel::map(patches.front, |i| contacts(patches, i));
        let reach = |i: usize, k: usize| {
            let j = forward_neighbor(patches, &contact, patches.front_patch(i), k)?;
            let j = if patches.is_back(i) { patches.back_of[j] } else { j as u32 };
            (j != NO_PATCH && linked(patches, tracer, i, j as usize)).then_some(j)
        };
        let straight =
            parallel::map_watched(patches.len(), progress, |i| [0, 1].map(|k| reach(i, k).unwrap_or(NO_PATCH)));
        let links = parallel::map_watched(patches.len(), progress, |i| {
            let diagonal = [2, 3].map(|k| {
                let around = |&j: &u32| goes_around(patches, &straight, i, j, k);
                reach(i, k).filter(around).unwrap_or(NO_PATCH)
            });
            [straight[i][0], straight[i][1], diagonal[0], diagonal[1]]
        });
        let mut graph = Self::from_forward(&links);
        graph.across = seams::find(patches, tracer, |i| graph.sides(patches, i).count(), progress);
        graph
    }

    fn from_forward(links: &[[u32; 4]]) -> Self {
        let mut degree = vec![0u32; links.len() + 1];
        let pairs = || {
            links
                .iter()
                .enumerate()
                .flat_map(|(i, row)| row.iter().filter(|&&j| j != NO_PATCH).map(move |&j| (i as u32, j)))
        };
        for (i, j) in pairs() {
            degree[i as usize + 1] += 1;
            degree[j as usize + 1] += 1;
        }
        for i in 1..degree.len() {
            degree[i] += degree[i - 1];
        }
        let first = degree.clone();
        let mut neighbors = vec![0; first[links.len()] as usize];
        for (i, j) in pairs() {
            for (from, to) in [(i, j), (j, i)] {
                neighbors[degree[from as usize] as usize] = to;
                degree[from as usize] += 1;
            }
        }
        for i in 0..links.len() {
            neighbors[first[i] as usize..first[i + 1] as usize].sort_unstable();
        }
        Self { first, neighbors, across: vec![] }
    }

    /// Linked patches of a patch, ascending.
    #[must_use]
    pub fn neighbors(&self, patch: usize) -> &[u32] {
        &self.neighbors[self.first[patch] as usize..self.first[patch + 1] as usize]
    }

    /// Linked patches that share a side of the texel.
    pub fn sides<'a>(&'a self, patches: &'a Patches, patch: usize) -> impl Iterator<Item = u32> + 'a {
        let (x, y) = patches.texel_xy(patches.front_patch(patch));
        self.neighbors(patch).iter().copied().filter(move |&j| {
            let (u, v) = patches.texel_xy(patches.front_patch(j as usize));
            u.abs_diff(x) + v.abs_diff(y) == 1
        })
    }

    /// Patches that lie side by side with one in another chart, or beyond a cut of its own.
    pub fn across(&self, patch: usize) -> impl Iterator<Item = u32> + '_ {
        let start = self.across.partition_point(|link| (link[0] as usize) < patch);
        self.across[start..].iter().take_while(move |link| link[0] as usize == patch).map(|link| link[1])
    }

    /// Number of directed links within charts.
    #[must_use]
    pub fn len(&self) -> usize {
        self.neighbors.len()
    }

    /// No link at all.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.neighbors.is_empty()
    }

    /// Bytes held.
    #[must_use]
    pub fn bytes(&self) -> usize {
        4 * (self.first.len() + self.neighbors.len()) + 8 * self.across.len()
    }
}

/// Touches the neighbour at +x (bit 0) and at +y (bit 1) along their common texel border.
fn contacts(patches: &Patches, i: usize) -> u8 {
    let (x, y) = patches.texel_xy(i);
    let page = patches.page(i);
    let mut bits = 0;
    for (axis, (dx, dy)) in [(0, (1, 0)), (1, (0, 1))] {
        let Some(j) = patches.grid_at(page, x as i32 + dx, y as i32 + dy) else { continue };
        if patches.chart[i] == patches.chart[j as usize] && touch(patches, i, j as usize, axis) {
            bits |= 1 << axis;
        }
    }
    bits
}

fn touch(patches: &Patches, i: usize, j: usize, axis: usize) -> bool {
    let full = |p: usize| patches.covered(p) > 0.999_999;
    if full(i) && full(j) {
        return true;
    }
    let (a, b) = (border(patches, i, axis, 1.0), border(patches, j, axis, 0.0));
    let overlap = |p: &(f64, f64), q: &(f64, f64)| (p.1.min(q.1) - p.0.max(q.0)).max(0.0);
    let shared = a.iter().flat_map(|p| b.iter().map(move |q| overlap(p, q))).fold(0.0, f64::max);
    shared > LEAST_CONTACT
}

/// Where the texel's polygons meet its border `axis` = `at`, as intervals of the other axis.
fn border(patches: &Patches, patch: usize, axis: usize, at: f64) -> Vec<(f64, f64)> {
    let mut intervals = vec![];
    for f in patches.fragments.range(patch) {
        let polygon = patches.polygon(patch, f);
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for c in polygon.corners().iter().filter(|c| (c[axis] - at).abs() < 1e-7) {
            low = low.min(c[1 - axis]);
            high = high.max(c[1 - axis]);
        }
        if high > low {
            intervals.push((low, high));
        }
    }
    intervals
}

/// The k-th forward neighbour, if a path of touching texels leads there around the common corner.
fn forward_neighbor(patches: &Patches, contact: &[u8], i: usize, k: usize) -> Option<usize> {
    let (x, y) = patches.texel_xy(i);
    let page = patches.page(i);
    let at = |dx: i32, dy: i32| patches.grid_at(page, x as i32 + dx, y as i32 + dy).map(|j| j as usize);
    let right = |p: usize| contact[p] & 1 != 0;
    let down = |p: usize| contact[p] & 2 != 0;
    let (dx, dy) = FORWARD[k];
    let j = at(dx, dy)?;
    let joined = match (dx, dy) {
        (1, 0) => right(i),
        (0, 1) => down(i),
        (1, 1) => (right(i) && at(1, 0).is_some_and(down)) || (down(i) && at(0, 1).is_some_and(right)),
        _ => (at(-1, 0).is_some_and(|left| right(left) && down(left))) || (down(i) && right(j)),
    };
    joined.then_some(j)
}

/// A diagonal link follows two straight ones around the common corner: the sight line alone could slip through the edge
/// where two walls meet.
fn goes_around(patches: &Patches, straight: &[[u32; 2]], i: usize, j: u32, k: usize) -> bool {
    let (x, y) = patches.texel_xy(patches.front_patch(i));
    let page = patches.page(patches.front_patch(i));
    let at = |dx: i32, dy: i32| {
        let front = patches.grid_at(page, x as i32 + dx, y as i32 + dy)?;
        let patch = if patches.is_back(i) { patches.back_of[front as usize] } else { front };
        (patch != NO_PATCH).then_some(patch as usize)
    };
    let below = straight[i][1];
    let from_below = |to: usize, from: u32| from != NO_PATCH && straight[from as usize][0] == to as u32;
    if FORWARD[k] == (1, 1) {
        let right = straight[i][0];
        let over_right = right != NO_PATCH && straight[right as usize][1] == j;
        return over_right || from_below(j as usize, below);
    }
    let over_left = at(-1, 0).is_some_and(|l| straight[l][0] == i as u32 && straight[l][1] == j);
    over_left || (below != NO_PATCH && straight[j as usize][0] == below)
}

pub(super) fn linked(patches: &Patches, tracer: &Tracer<'_>, i: usize, j: usize) -> bool {
    if patches.exposed[i] <= 0.0 || patches.exposed[j] <= 0.0 {
        return false;
    }
    if patches.normal[i].dot(patches.normal[j]) < COS_FACING {
        return false;
    }
    let edge = patches.texel_edge(i).min(patches.texel_edge(j));
    HEIGHTS.iter().all(|height| {
        let origin = patches.position[i] + patches.normal[i] * (height * edge);
        let target = patches.position[j] + patches.normal[j] * (height * edge);
        !tracer.occluded(&Ray { origin, direction: target - origin, t_max: 1.0 })
    })
}
