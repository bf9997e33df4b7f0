//! Cuts a list of boxes in two where rays will pay least.
//!
//! In: [`Item`]s. Out: they are reordered, and the place of the cut.
//!
//! Source: Wald, "On fast Construction of SAH-based Bounding Volume Hierarchies", 2007, §3 (surface area heuristic over
//! bins of centroids, here along all three axes). Where we differ, and why: a side costs its area times the number of
//! *packets* that its triangles fill, because a packet costs the same whether it is full or not.
//!
//! Invariants: both sides have items; boxes and counts are merged by minimum, maximum and integer sum, so the cut is
//! the same at every thread count. NaN and infinity in areas (a scene as large as f32) only make the cut a worse one.

use super::build::LANES;
use crate::base::parallel;
use glam::{Vec3, Vec3A};

/// Most bins per axis. More: time to build; fewer: cuts farther from the best place.
const BINS: usize = 32;
/// Items per task.
const CHUNK: usize = 1 << 14;

/// A triangle on its way into the hierarchy. 32 bytes: this is what building moves around.
#[derive(Clone, Copy)]
pub(super) struct Item {
    pub(super) min: Vec3,
    pub(super) triangle: u32,
    pub(super) max: Vec3,
    /// Of [`super::build::Packet::triangles`].
    pub(super) flags: u32,
}

/// A box. Nothing: +∞ to −∞.
#[derive(Clone, Copy)]
pub(super) struct Bounds {
    pub(super) min: Vec3A,
    pub(super) max: Vec3A,
}

impl Bounds {
    pub(super) const EMPTY: Self = Self { min: Vec3A::INFINITY, max: Vec3A::NEG_INFINITY };

    #[inline]
    fn include(&mut self, min: Vec3A, max: Vec3A) {
        self.min = self.min.min(min);
        self.max = self.max.max(max);
    }

    #[inline]
    pub(super) fn and(mut self, other: Self) -> Self {
        self.include(other.min, other.max);
        self
    }

    /// Half of the surface, in units of 1/`scale`².
    #[inline]
    pub(super) fn area(&self, scale: f32) -> f32 {
        let e = (self.max - self.min) * scale;
        e.x * e.y + e.y * e.z + e.z * e.x
    }

    pub(super) fn of(items: &[Item]) -> Self {
        fold(
            items,
            Self::EMPTY,
            |mut b, i| {
                b.include(i.min.into(), i.max.into());
                b
            },
            Self::and,
        )
    }
}

impl Item {
    #[inline]
    fn centre(&self) -> Vec3A {
        Vec3A::from(self.min) * 0.5 + Vec3A::from(self.max) * 0.5
    }
}

/// A fold in parallel; `join` must not care for the order.
fn fold<T: Clone + Send + Sync>(
    items: &[Item],
    empty: T,
    add: impl Fn(T, &Item) -> T + Sync,
    join: impl Fn(T, T) -> T,
) -> T {
    if items.len() <= 2 * CHUNK {
        return items.iter().fold(empty, add);
    }
    let chunks = parallel::map_chunks(items.len(), CHUNK, |range| items[range].iter().fold(empty.clone(), &add));
    chunks.into_iter().fold(empty, join)
}

/// Maps centres to bins.
struct Grid {
    low: Vec3A,
    per_unit: Vec3A,
    last: i32,
}

impl Grid {
    fn new(items: &[Item]) -> Self {
        let add = |mut b: Bounds, i: &Item| {
            let c = i.centre();
            b.include(c, c);
            b
        };
        let centres = fold(items, Bounds::EMPTY, add, Bounds::and);
        let bins = (4 + items.len() / 8).min(BINS);
        // An axis without extent gives 0, so that all items are in its first bin.
        let extent = centres.max - centres.min;
        let per_unit = extent.cmpgt(Vec3A::ZERO);
        let per_unit = Vec3A::select(per_unit, Vec3A::splat(bins as f32 * 0.999_999) / extent, Vec3A::ZERO);
        Self { low: centres.min, per_unit, last: bins as i32 - 1 }
    }

    /// The bin along each axis.
    #[inline]
    fn bins(&self, item: &Item) -> [usize; 3] {
        let at = (item.centre() - self.low) * self.per_unit;
        let bin = |v: f32| (v as i32).clamp(0, self.last) as usize;
        [bin(at.x), bin(at.y), bin(at.z)]
    }

    /// The same as `bins` for one axis.
    #[inline]
    fn bin(&self, item: &Item, axis: usize) -> usize {
        let centre = item.min[axis] * 0.5 + item.max[axis] * 0.5;
        let at = (centre - self.low[axis]) * self.per_unit[axis];
        (at as i32).clamp(0, self.last) as usize
    }
}

/// What is in the bins, by axis.
#[derive(Clone)]
struct Bins {
    bounds: [[Bounds; BINS]; 3],
    counts: [[u32; BINS]; 3],
}

impl Bins {
    const EMPTY: Self = Self { bounds: [[Bounds::EMPTY; BINS]; 3], counts: [[0; BINS]; 3] };

    #[inline]
    fn add(&mut self, bins: [usize; 3], item: &Item) {
        let (min, max) = (item.min.into(), item.max.into());
        for (axis, bin) in bins.into_iter().enumerate() {
            self.bounds[axis][bin % BINS].include(min, max);
            self.counts[axis][bin % BINS] += 1;
        }
    }

    fn and(mut self, other: Self) -> Self {
        for axis in 0..3 {
            for bin in 0..BINS {
                self.bounds[axis][bin] = self.bounds[axis][bin].and(other.bounds[axis][bin]);
                self.counts[axis][bin] += other.counts[axis][bin];
            }
        }
        self
    }

    fn of(items: &[Item], grid: &Grid) -> Self {
        if items.len() <= 2 * CHUNK {
            let mut bins = Self::EMPTY;
            items.iter().for_each(|item| bins.add(grid.bins(item), item));
            return bins;
        }
        let chunks = parallel::map_chunks(items.len(), CHUNK, |range| {
            let mut bins = Self::EMPTY;
            items[range].iter().for_each(|item| bins.add(grid.bins(item), item));
            bins
        });
        chunks.into_iter().fold(Self::EMPTY, Self::and)
    }

    /// Cheapest first bin of the right side along an axis, with its cost.
    fn cheapest(&self, axis: usize, bins: usize, scale: f32) -> Option<(f32, usize)> {
        let (bounds, counts) = (&self.bounds[axis], &self.counts[axis]);
        let cost = |b: &Bounds, n: u32| b.area(scale) * n.div_ceil(LANES as u32) as f32;
        let mut right = [(0.0, 0); BINS];
        let (mut b, mut n) = (Bounds::EMPTY, 0);
        for i in (1..bins).rev() {
            b = b.and(bounds[i]);
            n += counts[i];
            right[i] = (cost(&b, n), n);
        }
        let mut best: Option<(f32, usize)> = None;
        (b, n) = (Bounds::EMPTY, 0);
        for i in 1..bins {
            b = b.and(bounds[i - 1]);
            n += counts[i - 1];
            if n == 0 || right[i].1 == 0 {
                continue;
            }
            let c = cost(&b, n) + right[i].0;
            if best.is_none_or(|(least, _)| c < least) {
                best = Some((c, i));
            }
        }
        best
    }
}

/// Reorders at least two items; how many belong to the left side, and the boxes of both sides. `scale` brings areas
/// near 1.
pub(super) fn split(items: &mut [Item], scale: f32) -> (usize, [Bounds; 2]) {
    let grid = Grid::new(items);
    let bins = Bins::of(items, &grid);
    let mut best: Option<(f32, usize, usize)> = None;
    for axis in 0..3 {
        if let Some((cost, bin)) = bins.cheapest(axis, grid.last as usize + 1, scale)
            && best.is_none_or(|(least, ..)| cost < least)
        {
            best = Some((cost, axis, bin));
        }
    }
    // All centres in one bin: any cut is as good.
    let Some((_, axis, bin)) = best else { return halve(items) };
    let left = partition(items, |item| grid.bin(item, axis) < bin);
    let union = |bounds: &[Bounds]| bounds.iter().fold(Bounds::EMPTY, |a, &b| a.and(b));
    let (l, r) = bins.bounds[axis].split_at(bin);
    (left, [union(l), union(r)])
}

/// Cuts in the middle of the list.
pub(super) fn halve(items: &[Item]) -> (usize, [Bounds; 2]) {
    let (l, r) = items.split_at(items.len() / 2);
    (l.len(), [Bounds::of(l), Bounds::of(r)])
}

/// Brings the items for which `left` holds to the front; their number.
fn partition(items: &mut [Item], left: impl Fn(&Item) -> bool) -> usize {
    let (mut low, mut high) = (0, items.len());
    loop {
        while low < high && left(&items[low]) {
            low += 1;
        }
        while low < high && !left(&items[high - 1]) {
            high -= 1;
        }
        if low >= high {
            return low;
        }
        items.swap(low, high - 1);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn item(x: f32, size: f32, triangle: u32) -> Item {
        Item { min: Vec3::new(x, 0.0, 0.0), max: Vec3::new(x + size, size, size), triangle, flags: 0 }
    }

    #[test]
    fn two_heaps_are_cut_between_them() {
        let mut items: Vec<_> = (0..40).map(|i| item(if i % 2 == 0 { 0.0 } else { 100.0 }, 1.0, i)).collect();
        let (left, [l, r]) = split(&mut items, 0.01);
        assert_eq!((left, l.max.x, r.min.x), (20, 1.0, 100.0));
        assert!(items[..20].iter().all(|i| i.triangle.is_multiple_of(2)));
        assert!(items[20..].iter().all(|i| !i.triangle.is_multiple_of(2)));
    }

    #[test]
    fn heaps_of_one_place_and_of_any_size_are_cut_as_well() {
        for size in [0.0, 1e-38, 1.0, 1e38, f32::MAX] {
            for n in 2..30 {
                let mut items: Vec<_> = (0..n).map(|i| item(0.0, size, i)).collect();
                let (left, _) = split(&mut items, 1.0);
                assert!(left > 0 && left < n as usize, "{size} {n}");
            }
        }
    }

    #[test]
    fn a_parallel_cut_is_the_serial_one() {
        let list: Vec<_> = (0..100_000u32).map(|i| item((i.wrapping_mul(2_654_435_761) >> 8) as f32, 9.0, i)).collect();
        let cut = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let mut items = list.clone();
            let (left, _) = pool.install(|| split(&mut items, 1e-6));
            (left, items.iter().map(|i| i.triangle).collect::<Vec<_>>())
        };
        assert_eq!(cut(1), cut(3));
    }
}
