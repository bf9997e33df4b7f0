//! Which triangles reach into which texels.
//!
//! In: where the triangles lie. Out: the texels with surface, ascending, and for each its [`Fragments`]. Charts move by
//! whole texels, so parts that share their triangles on the page share their fragments too.
//!
//! Invariant: the fragments of a texel are in the order of their triangles, whatever the number of threads.

use super::NO_PATCH;
use super::laid::{Laid, SurfaceTriangle};
use crate::atlas::raster;
use crate::base::parallel;
use rayon::slice::ParallelSliceMut;

/// The triangles that reach into each texel.
#[derive(Debug, Default)]
pub(super) struct Fragments {
    /// Of each front patch.
    spans: Vec<Span>,
    /// Triangle, less the span's `shift`.
    triangle: Vec<u32>,
    /// Covered part of the texel [texel²].
    pub(super) covered: Vec<f32>,
}

/// The fragments of a texel.
#[derive(Debug, Clone, Copy)]
struct Span {
    first: u32,
    end: u32,
    /// What makes ids of triangles of those that are stored.
    shift: u32,
}

impl Fragments {
    /// Places of a front patch's fragments.
    pub(super) fn range(&self, front: usize) -> core::ops::Range<usize> {
        let Span { first, end, .. } = self.spans[front];
        first as usize..end as usize
    }

    /// Triangle of the scene, by its id, of a front patch's fragment.
    #[inline]
    pub(super) fn triangle(&self, front: usize, fragment: usize) -> u32 {
        self.triangle[fragment] + self.spans[front].shift
    }

    /// Memory that they take [bytes].
    pub(super) fn bytes(&self) -> usize {
        self.spans.len() * size_of::<Span>() + self.triangle.len() * 8
    }
}

/// Part of a triangle in a texel.
struct Piece<K> {
    texel: K,
    triangle: u32,
    covered: f32,
}

/// Texels with surface as (page · height + y) · width + x, ascending, and what reaches into them.
pub(super) fn find(laid: &Laid, [width, height]: [u32; 2]) -> (Vec<u32>, Fragments) {
    let on_pages = |[x, y]: [i32; 2]| (0..width as i32).contains(&x) && (0..height as i32).contains(&y);
    let number = |page: u32, [x, y]: [i32; 2]| (page * height + y as u32) * width + x as u32;
    let mut fragments = Fragments::default();
    let mut texels: Vec<(u32, Span)> = vec![];
    let own = collect(laid.unshared(), |i| laid.nth_unshared(i), |t, _, at| on_pages(at).then(|| number(t.page, at)));
    fragments.append(own, |texel, span| texels.push((texel, span)));
    for shared in laid.shared() {
        // Texels of charts that are not placed yet, rows first.
        let here = |_: &SurfaceTriangle, chart: u32, [x, y]: [i32; 2]| Some((chart, y, x));
        let pieces = collect(shared.len(), |i| shared.nth(i), here);
        fragments.append(pieces, |(chart, y, x), span| {
            for (shift, place, page) in shared.places(chart) {
                let at = [x + place.x as i32, y + place.y as i32];
                if on_pages(at) {
                    texels.push((number(page, at), Span { shift, ..span }));
                }
            }
        });
    }
    texels.par_sort_unstable_by_key(|(texel, span)| (*texel, span.first));
    fragments.spans = texels.iter().map(|(_, span)| *span).collect();
    (texels.into_iter().map(|(texel, _)| texel).collect(), fragments)
}

/// The pieces of `n` triangles, ordered by texel and then by triangle; `texel` names the texel at a column and row.
fn collect<K: Ord + Copy + Send + Sync>(
    n: usize,
    nth: impl Fn(usize) -> (u32, SurfaceTriangle, u32) + Sync,
    texel: impl Fn(&SurfaceTriangle, u32, [i32; 2]) -> Option<K> + Sync,
) -> Vec<Piece<K>> {
    // Few triangles are large ones.
    let chunks = parallel::map_chunks(n, (n / 1024).clamp(1, 256), |range| {
        let mut pieces = vec![];
        for i in range {
            let (triangle, t, chart) = nth(i);
            if t.page == NO_PATCH {
                continue;
            }
            raster::cover(t.uv, |x, y, polygon| {
                if let Some(texel) = texel(&t, chart, [x, y]) {
                    pieces.push(Piece { texel, triangle, covered: polygon.area() as f32 });
                }
            });
        }
        pieces
    });
    let mut pieces: Vec<Piece<K>> = chunks.into_iter().flatten().collect();
    pieces.par_sort_unstable_by_key(|p| (p.texel, p.triangle));
    pieces
}

impl Fragments {
    /// Stores pieces in their order; `each` hears of every texel.
    fn append<K: PartialEq + Copy>(&mut self, pieces: Vec<Piece<K>>, mut each: impl FnMut(K, Span)) {
        for texel in pieces.chunk_by(|a, b| a.texel == b.texel) {
            let first = self.triangle.len() as u32;
            self.triangle.extend(texel.iter().map(|p| p.triangle));
            self.covered.extend(texel.iter().map(|p| p.covered));
            each(texel[0].texel, Span { first, end: self.triangle.len() as u32, shift: 0 });
        }
    }
}
