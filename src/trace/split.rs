//! Cuts a list of boxes in two where rays will pay least.
//!
//! In: [`Item`]s. Out: they are reordered, and the place of the cut.
//!
//! Source: Wald, "On fast Construction of SAH-based Bounding Volume Hierarchies", 2007, §3 (surface area heuristic over
//! bins of centroids, here along all three axes). Where we differ, and why: a side costs its area times the number of
//! *packets* that its triangles fill, because a packet costs the same whether it is full or not.
//!
//! Bins take most of the time to build. Each corner of a box is one aligned load: 30 % less, of the time of the whole
//! hierarchy. Two sets of bins in turn ([`LONG`]), as many as there is use for, a number of the bin by way of u8, and
//! boxes around centres from the pass that moves items: a fifth less.
//!
//! Invariants: both sides have items; boxes and counts are merged by minimum, maximum and integer sum, so the cut is
//! the same at every thread count. NaN and infinity in areas (a scene as large as f32) only make the cut a worse one.

use super::build::LANES;
use super::build::Packet;
use crate::base::parallel;
use glam::{Vec3, Vec3A, Vec4};

/// Most bins per axis. More: time to build; fewer: cuts farther from the best place.
const BINS: usize = 32;
/// Items from which on every other one goes into a second set of bins: neighbours in a list often fall into the same bin,
/// and each would wait until the one before is stored.
const LONG: usize = 1 << 9;
/// Items per task.
const CHUNK: usize = 1 << 14;

/// A triangle on its way into the hierarchy, with the box around it. 32 bytes: this is what building moves around.
///
/// The fourth number of `min` is the triangle, so that each corner of the box is one load. Sums and products of corners
/// take the fourth number along, so its bits must be a number that needs no care: see [`Item::NORMAL`].
#[derive(Clone, Copy)]
pub(super) struct Item {
    min: Vec4,
    max: Vec4,
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
        Self::around(items, Item::ends)
    }

    /// Around the centres of the items' boxes.
    pub(super) fn of_centres(items: &[Item]) -> Self {
        Self::around(items, |item| [item.centre(); 2])
    }

    fn around(items: &[Item], ends: impl Fn(&Item) -> [Vec3A; 2] + Sync) -> Self {
        let some = |items: &[Item]| {
            let mut bounds = Self::EMPTY;
            for [min, max] in items.iter().map(&ends) {
                bounds.include(min, max);
            }
            bounds
        };
        joined(items, some, Self::and)
    }
}

impl Item {
    /// Set in the bits of the fourth number, above those of the triangle and below the sign: makes it at least 2, and
    /// finite. Without it it would be denormal, and each sum or product a hundred times as slow.
    const NORMAL: u32 = 1 << 30;

    /// Box of a triangle; `tagged` is one of [`Packet::triangles`], and below 2²⁸ but for the flag.
    pub(super) fn new(min: Vec3, max: Vec3, tagged: u32) -> Self {
        Self { min: min.extend(f32::from_bits(tagged | Self::NORMAL)), max: max.extend(1.0) }
    }

    /// What stands in a list for a triangle that is left out of it. Its box adds nothing to others.
    pub(super) const NOTHING: Self = Self { min: Vec4::splat(f32::INFINITY), max: Vec4::splat(f32::NEG_INFINITY) };

    pub(super) fn is_nothing(&self) -> bool {
        self.min.w == f32::INFINITY
    }

    /// As [`Packet::triangles`] has it.
    pub(super) fn tagged(&self) -> u32 {
        self.min.w.to_bits() & !Self::NORMAL
    }

    pub(super) fn triangle(&self) -> u32 {
        self.tagged() & !Packet::TRANSPARENT
    }

    /// Smallest and largest coordinates.
    pub(super) fn bounds(&self) -> (Vec3, Vec3) {
        (self.min.truncate(), self.max.truncate())
    }

    pub(super) fn set_bounds(&mut self, (min, max): (Vec3, Vec3)) {
        *self = Self { min: min.extend(self.min.w), max: max.extend(self.max.w) };
    }

    #[inline]
    fn ends(&self) -> [Vec3A; 2] {
        [Vec3A::from_vec4(self.min), Vec3A::from_vec4(self.max)]
    }

    #[inline]
    fn centre(&self) -> Vec3A {
        let [min, max] = self.ends();
        min * 0.5 + max * 0.5
    }
}

/// What `some` finds in all items, in parallel in chunks of long lists; `join` must not care for the order.
fn joined<T: Send>(items: &[Item], some: impl Fn(&[Item]) -> T + Sync, join: impl Fn(T, T) -> T) -> T {
    if items.len() <= 2 * CHUNK {
        return some(items);
    }
    let chunks = parallel::map_chunks(items.len(), CHUNK, |range| some(&items[range]));
    chunks.into_iter().reduce(join).unwrap_or_else(|| some(&[]))
}

/// The place of a centre among the bins.
struct Grid {
    low: Vec3A,
    per_unit: Vec3A,
    last: u8,
}

impl Grid {
    fn new(centres: &Bounds, items: usize) -> Self {
        let bins = (4 + items / 8).min(BINS);
        // An axis without extent gives 0, so that all items are in its first bin.
        let extent = centres.max - centres.min;
        let per_unit = extent.cmpgt(Vec3A::ZERO);
        let per_unit = Vec3A::select(per_unit, Vec3A::splat(bins as f32 * 0.999_999) / extent, Vec3A::ZERO);
        Self { low: centres.min, per_unit, last: bins as u8 - 1 }
    }

    fn count(&self) -> usize {
        usize::from(self.last) + 1
    }

    #[inline]
    fn at(&self, centre: Vec3A) -> Vec3A {
        (centre - self.low) * self.per_unit
    }

    /// The bin along each axis.
    #[inline]
    fn bins(&self, item: &Item) -> [usize; 3] {
        let bin = |v: f32| usize::from((v as u8).min(self.last));
        // As u8, a maximum and a minimum keep it in range. Not `array::map`: it is not always inlined.
        let at = self.at(item.centre());
        [bin(at.x), bin(at.y), bin(at.z)]
    }

    /// Whether a centre lies in a bin before this one (1 or more) along an axis: as `bins` says, NaN included.
    #[inline]
    fn is_before(&self, axis: usize, bin: usize) -> impl Fn(Vec3A) -> bool {
        // Nothing is above NaN, so the other axes do not count.
        let mut first = [f32::NAN; 3];
        first[axis] = bin as f32;
        let first = Vec3A::from_array(first);
        move |centre| !self.at(centre).cmpge(first).any()
    }
}

/// What is in the bins, by axis.
#[derive(Clone)]
struct Bins<const N: usize> {
    bounds: [[Bounds; N]; 3],
    counts: [[u32; N]; 3],
}

impl<const N: usize> Bins<N> {
    const EMPTY: Self = Self { bounds: [[Bounds::EMPTY; N]; 3], counts: [[0; N]; 3] };

    #[inline]
    fn add(&mut self, bins: [usize; 3], item: &Item) {
        let [min, max] = item.ends();
        for (axis, bin) in bins.into_iter().enumerate() {
            self.bounds[axis][bin % N].include(min, max);
            self.counts[axis][bin % N] += 1;
        }
    }

    fn and(mut self, other: Self) -> Self {
        for axis in 0..3 {
            for bin in 0..N {
                self.bounds[axis][bin] = self.bounds[axis][bin].and(other.bounds[axis][bin]);
                self.counts[axis][bin] += other.counts[axis][bin];
            }
        }
        self
    }

    fn of(items: &[Item], grid: &Grid) -> Self {
        let some = |items: &[Item]| {
            let mut bins = Self::EMPTY;
            if items.len() < LONG {
                items.iter().for_each(|item| bins.add(grid.bins(item), item));
                return bins;
            }
            let mut other = Self::EMPTY;
            let (pairs, rest) = items.as_chunks::<2>();
            for [a, b] in pairs {
                bins.add(grid.bins(a), a);
                other.add(grid.bins(b), b);
            }
            rest.iter().for_each(|item| bins.add(grid.bins(item), item));
            bins.and(other)
        };
        joined(items, some, Self::and)
    }

    /// Cheapest first bin of the right side along an axis, with its cost.
    fn cheapest(&self, axis: usize, bins: usize, scale: f32) -> Option<(f32, usize)> {
        let (bounds, counts) = (&self.bounds[axis], &self.counts[axis]);
        let cost = |b: &Bounds, n: u32| b.area(scale) * n.div_ceil(LANES as u32) as f32;
        let mut right = [(0.0, 0); N];
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

/// The cheapest cut: an axis, the first bin of the right side, and the boxes of both sides.
struct Cut {
    axis: usize,
    bin: usize,
    bounds: [Bounds; 2],
}

/// The cheapest cut along any axis; `None` if all centres are in one bin. `N` is at least the number of bins, and not
/// many more, as all are emptied even where few items are left.
fn cheapest<const N: usize>(items: &[Item], grid: &Grid, scale: f32) -> Option<Cut> {
    let bins = Bins::<N>::of(items, grid);
    let mut best: Option<(f32, usize, usize)> = None;
    for axis in 0..3 {
        if let Some((cost, bin)) = bins.cheapest(axis, grid.count(), scale)
            && best.is_none_or(|(least, ..)| cost < least)
        {
            best = Some((cost, axis, bin));
        }
    }
    let (_, axis, bin) = best?;
    let union = |bounds: &[Bounds]| bounds.iter().fold(Bounds::EMPTY, |a, &b| a.and(b));
    let (l, r) = bins.bounds[axis].split_at(bin);
    Some(Cut { axis, bin, bounds: [union(l), union(r)] })
}

/// One side of a cut.
#[derive(Clone, Copy)]
pub(super) struct Side {
    pub(super) count: usize,
    pub(super) bounds: Bounds,
    /// Box around the centres of the items' boxes.
    pub(super) centres: Bounds,
}

/// Reorders at least two items, whose centres have this box, so that those of the left side come first; both sides.
/// `scale` brings areas near 1.
pub(super) fn split(items: &mut [Item], centres: &Bounds, scale: f32) -> [Side; 2] {
    let grid = Grid::new(centres, items.len());
    let cut = match grid.count() {
        0..=8 => cheapest::<8>(items, &grid, scale),
        9..=16 => cheapest::<16>(items, &grid, scale),
        _ => cheapest::<BINS>(items, &grid, scale),
    };
    // All centres in one bin: any cut is as good.
    let Some(Cut { axis, bin, bounds: [left, right] }) = cut else { return halve(items) };
    let (count, centres) = partition(items, grid.is_before(axis, bin));
    [
        Side { count, bounds: left, centres: centres[0] },
        Side { count: items.len() - count, bounds: right, centres: centres[1] },
    ]
}

/// Cuts in the middle of the list.
pub(super) fn halve(items: &[Item]) -> [Side; 2] {
    let (l, r) = items.split_at(items.len() / 2);
    [l, r].map(|items| Side { count: items.len(), bounds: Bounds::of(items), centres: Bounds::of_centres(items) })
}

/// Brings the items for whose centres `left` holds to the front; their number, and the boxes around the centres of both
/// sides.
fn partition(items: &mut [Item], left: impl Fn(Vec3A) -> bool) -> (usize, [Bounds; 2]) {
    let (mut low, mut high) = (0, items.len());
    let mut centres = [Bounds::EMPTY; 2];
    loop {
        while low < high {
            let centre = items[low].centre();
            if !left(centre) {
                break;
            }
            centres[0].include(centre, centre);
            low += 1;
        }
        while low < high {
            let centre = items[high - 1].centre();
            if left(centre) {
                break;
            }
            centres[1].include(centre, centre);
            high -= 1;
        }
        if low >= high {
            return (low, centres);
        }
        items.swap(low, high - 1);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn item(x: f32, size: f32, triangle: u32) -> Item {
        Item::new(Vec3::new(x, 0.0, 0.0), Vec3::new(x + size, size, size), triangle)
    }

    fn cut(items: &mut [Item], scale: f32) -> [Side; 2] {
        let centres = Bounds::of_centres(items);
        split(items, &centres, scale)
    }

    #[test]
    fn items_keep_their_triangle_through_everything() {
        for triangle in [0, 1, (1 << 28) - 1, 1 << 31, 1 << 31 | 0xfff_ffff] {
            let mut item = item(3.0, 2.0, triangle);
            assert!([item.min.w, item.max.w].iter().all(|w| w.is_normal()), "{triangle}");
            item.set_bounds((Vec3::splat(-1.0), Vec3::splat(7.0)));
            assert_eq!((item.tagged(), item.triangle()), (triangle, triangle & !(1 << 31)));
            assert!(!item.is_nothing());
            assert_eq!(item.bounds(), (Vec3::splat(-1.0), Vec3::splat(7.0)));
            assert_eq!(item.centre(), Vec3A::splat(3.0));
        }
        assert!(Item::NOTHING.is_nothing());
    }

    fn corners(bounds: &Bounds) -> [Vec3A; 2] {
        [bounds.min, bounds.max]
    }

    /// Boxes from the bins and from the partition are those of the items that lie on each side, wherever items lie.
    #[test]
    fn sides_are_what_they_hold() {
        for n in (2..300).step_by(7) {
            for size in [1e-30, 1.0, 1e37, f32::MAX] {
                let random = |i: u32| (i.wrapping_mul(2_654_435_761) >> 8) as f32 / 16_777_216.0 - 0.5;
                let mut items: Vec<_> = (0..n).map(|i| item(random(i) * size, random(i + n).abs() * size, i)).collect();
                let [l, r] = cut(&mut items, 1.0 / size);
                let (a, b) = items.split_at(l.count);
                for (side, items) in [(l, a), (r, b)] {
                    assert_eq!(corners(&side.bounds), corners(&Bounds::of(items)), "{size} {n}");
                    assert_eq!(corners(&side.centres), corners(&Bounds::of_centres(items)), "{size} {n}");
                }
            }
        }
    }

    #[test]
    fn two_heaps_are_cut_between_them() {
        let mut items: Vec<_> = (0..40).map(|i| item(if i % 2 == 0 { 0.0 } else { 100.0 }, 1.0, i)).collect();
        let [l, r] = cut(&mut items, 0.01);
        assert_eq!((l.count, l.bounds.max.x, r.bounds.min.x), (20, 1.0, 100.0));
        assert!(items[..20].iter().all(|i| i.triangle().is_multiple_of(2)));
        assert!(items[20..].iter().all(|i| !i.triangle().is_multiple_of(2)));
    }

    #[test]
    fn heaps_of_one_place_and_of_any_size_are_cut_as_well() {
        for size in [0.0, 1e-38, 1.0, 1e38, f32::MAX] {
            for n in 2..30 {
                let mut items: Vec<_> = (0..n).map(|i| item(0.0, size, i)).collect();
                let [l, r] = cut(&mut items, 1.0);
                assert!(l.count > 0 && r.count > 0 && l.count + r.count == n as usize, "{size} {n}");
            }
        }
    }

    #[test]
    fn a_parallel_cut_is_the_serial_one() {
        let list: Vec<_> = (0..100_000u32).map(|i| item((i.wrapping_mul(2_654_435_761) >> 8) as f32, 9.0, i)).collect();
        let order = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let mut items = list.clone();
            let [left, _] = pool.install(|| cut(&mut items, 1e-6));
            (left.count, items.iter().map(Item::triangle).collect::<Vec<_>>())
        };
        assert_eq!(order(1), order(3));
    }
}
