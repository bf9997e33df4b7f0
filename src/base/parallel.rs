//! Parallel loops whose results do not depend on the number of threads.
//!
//! Work is cut into chunks of a fixed size; chunk results come back in order. A sum of floats is taken chunk by chunk
//! in order, so it has the same bits for any pool (rayon's own `sum` does not).

use super::Progress;
use glam::DVec3;
use rayon::prelude::*;

/// Fewest elements that one task of a cheap function gets.
const LEAST: usize = 1024;
/// Elements per chunk of a parallel sum.
const SUM_CHUNK: usize = 4096;

/// Tasks that a loop is cut into, where it has as many elements. Rayon alone cuts it into two or four per thread, and no task
/// that has begun is cut again: where elements do not cost the same, all but one thread wait for the last of them.
const TASKS: usize = 128;

/// Number of threads that loops run on.
#[must_use]
pub fn threads() -> usize {
    rayon::current_num_threads()
}

/// Most elements of a task, of `n` in all.
fn longest(n: usize) -> usize {
    n.div_ceil(TASKS).max(1)
}

/// `f(0), f(1), … f(n − 1)` in order, computed in parallel.
pub fn map<T: Send>(n: usize, f: impl Fn(usize) -> T + Sync) -> Vec<T> {
    (0..n).into_par_iter().with_max_len(longest(n)).map(&f).collect()
}

/// [`map`] for `f` of a few nanoseconds, which small tasks would cost more than they gain.
pub fn map_light<T: Send>(n: usize, f: impl Fn(usize) -> T + Sync) -> Vec<T> {
    (0..n).into_par_iter().with_min_len(LEAST).with_max_len(longest(n).max(LEAST)).map(&f).collect()
}

/// Changes every value where it is, for functions as cheap.
pub fn update_light<T: Send>(values: &mut [T], f: impl Fn(usize, &mut T) + Sync) {
    let longest = longest(values.len()).max(LEAST);
    values.par_iter_mut().with_min_len(LEAST).with_max_len(longest).enumerate().for_each(|(i, value)| f(i, value));
}

/// `f(row, its values)` for every row of values that lie row after row, `first[i]..first[i + 1]` those of row i; a few rows
/// at a time, as `f` is cheap. Empty `first`: no rows.
pub fn update_rows<T: Send>(values: &mut [T], first: &[u32], f: impl Fn(usize, &mut [T]) + Sync) {
    let rows = first.len().saturating_sub(1);
    let chunk = longest(rows).min(LEAST);
    let mut rest = values;
    let parts = (0..rows).step_by(chunk).map(|start| {
        let end = rows.min(start + chunk);
        let (own, after) = core::mem::take(&mut rest).split_at_mut((first[end] - first[start]) as usize);
        rest = after;
        (start..end, own)
    });
    parts.collect::<Vec<_>>().into_par_iter().for_each(|(range, mut own)| {
        for row in range {
            let (values, after) = own.split_at_mut((first[row + 1] - first[row]) as usize);
            f(row, values);
            own = after;
        }
    });
}

/// `f(chunk range)` for consecutive ranges of at most `chunk` indices that cover 0..n, in order.
pub fn map_chunks<T: Send>(n: usize, chunk: usize, f: impl Fn(core::ops::Range<usize>) -> T + Sync) -> Vec<T> {
    let chunk = chunk.max(1);
    map(n.div_ceil(chunk), |c| f(c * chunk..n.min((c + 1) * chunk)))
}

/// [`map`] that counts indices, a few at a time, and stops early, with default values, when it is cancelled.
pub fn map_watched<T: Send + Default>(n: usize, progress: &Progress, f: impl Fn(usize) -> T + Sync) -> Vec<T> {
    const WATCHED: usize = 64;
    progress.start(n as u64);
    map(n, |i| {
        if i.is_multiple_of(WATCHED) {
            progress.advance(WATCHED.min(n - i) as u64);
        }
        if progress.cancelled() { T::default() } else { f(i) }
    })
}

/// Sum of `f(i)` over 0..n in double precision; the same bits at every thread count.
pub fn sum(n: usize, f: impl Fn(usize) -> f64 + Sync) -> f64 {
    map_chunks(n, SUM_CHUNK, |range| range.map(&f).fold(0.0, |a, b| a + b)).into_iter().fold(0.0, |a, b| a + b)
}

/// [`sum`] by channel.
pub fn sum_channels(n: usize, f: impl Fn(usize) -> DVec3 + Sync) -> DVec3 {
    let sum = |range: core::ops::Range<usize>| range.fold(DVec3::ZERO, |sum, i| sum + f(i));
    map_chunks(n, SUM_CHUNK, sum).into_iter().fold(DVec3::ZERO, |a, b| a + b)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_have_the_same_bits_at_every_thread_count() {
        let terms = |i: usize| f64::from(libm::sinf(i as f32 * 0.731)) * 1e3;
        let bits: Vec<u64> = [1, 2, 3, 8]
            .into_iter()
            .map(|threads| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                pool.install(|| sum(1_000_003, terms)).to_bits()
            })
            .collect();
        assert!(bits.windows(2).all(|w| w[0] == w[1]));
    }

    #[test]
    fn watched_loops_count_every_index_and_stop_when_cancelled() {
        for n in [0, 1, 63, 64, 65, 10_000] {
            let progress = Progress::default();
            assert_eq!(map_watched(n, &progress, |i| i + 1), (1..=n).collect::<Vec<_>>());
            assert_eq!(progress.state(), (n as u64, n as u64));
            progress.cancel();
            assert_eq!(map_watched(n, &progress, |i| i + 1), vec![0; n]);
        }
    }

    #[test]
    fn rows_get_the_values_that_are_theirs() {
        for rows in [0u32, 1, 5, 10_000] {
            // Row i has i mod 4 values.
            let first: Vec<u32> = (0..=rows).map(|i| i / 4 * 6 + [0, 0, 1, 3][i as usize % 4]).collect();
            let mut values = vec![u32::MAX; first.last().copied().unwrap_or(0) as usize];
            update_rows(&mut values, &first, |row, own| own.fill(row as u32));
            let expected: Vec<u32> = (0..rows).flat_map(|row| vec![row; row as usize % 4]).collect();
            assert_eq!(values, expected);
        }
        update_rows(&mut [0u8; 0], &[], |_, _| unreachable!());
    }

    #[test]
    fn chunks_cover_every_index_once() {
        let all: Vec<usize> = map_chunks(1001, 7, |r| r.collect::<Vec<_>>()).into_iter().flatten().collect();
        assert_eq!(all, (0..1001).collect::<Vec<_>>());
    }
}
