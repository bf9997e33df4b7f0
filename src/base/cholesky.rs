//! Sparse Cholesky factors: a symmetric positive matrix as L D Lᵀ.
//!
//! In: rows of the matrix. Out: a [`Factor`] that solves for any right-hand side. Unknowns are eliminated in an order of
//! approximately least degree (crate `amd`, after P. R. Amestoy, T. A. Davis, I. S. Duff, ACM TOMS 30, 2004); rows of L are
//! found one after the other along the elimination tree, as in T. A. Davis, "Algorithm 849: A concise sparse Cholesky
//! factorization package", ACM TOMS 31, 2005. Where we differ: where L has entries is kept apart from the numbers, so that
//! unknowns can be taken out and put back, and only the rows above them in the tree are found anew.
//!
//! Symbols: n unknowns; k row of L, i column; `parent` in the elimination tree, n for roots; `first` where columns start.
//!
//! Invariants: scalar and sequential, so the same bits on every machine and at any thread count.

use super::Sparse;
use core::cmp::Ordering;
use core::ops::Div;
use core::ops::Mul;
use core::ops::Sub;
use std::sync::Arc;

/// Order of elimination, and where L has entries.
#[derive(Debug)]
struct Pattern {
    /// Unknown that is eliminated k-th.
    order: Vec<u32>,
    /// When each unknown is eliminated.
    place: Vec<u32>,
    parent: Vec<u32>,
    /// Where columns of L start, n + 1 values.
    first: Vec<usize>,
    /// Row of each entry, ascending in a column.
    rows: Vec<u32>,
}

/// L and D.
#[derive(Debug, Clone)]
pub struct Factor {
    pattern: Arc<Pattern>,
    entries: Vec<f64>,
    diagonal: Vec<f64>,
}

/// Columns of one row of L.
struct Path {
    columns: Vec<u32>,
    /// Where stretches start that climb the tree until they meet one before.
    stretches: Vec<usize>,
    /// Last row that met each column.
    seen: Vec<u32>,
}

impl Pattern {
    /// Where the factor of a matrix has entries.
    fn new(matrix: &Sparse) -> Self {
        let n = matrix.count();
        let first: Vec<i64> = matrix.first().iter().map(|&at| at as i64).collect();
        let columns: Vec<i64> = matrix.columns().iter().map(|&column| i64::from(column)).collect();
        let as_they_come = || ((0..n as i64).collect(), (0..n as i64).collect());
        let ordered = amd::order(n as i64, &first, &columns, &amd::Control::default());
        let (order, place) = ordered.map_or_else(|_| as_they_come(), |(order, place, _)| (order, place));
        let [order, place] = [order, place].map(|list: Vec<i64>| list.into_iter().map(|k| k as u32).collect());
        let mut pattern = Self { order, place, parent: vec![n as u32; n], first: vec![0; n + 1], rows: vec![] };
        pattern.grow(matrix);
        (0..n).for_each(|k| pattern.first[k + 1] += pattern.first[k]);
        let mut next = pattern.first.clone();
        let mut rows = vec![0; pattern.first[n]];
        let mut path = Path::new(n);
        for k in 0..n as u32 {
            path.climb(&pattern, matrix, k);
            for &i in &path.columns {
                rows[next[i as usize]] = k;
                next[i as usize] += 1;
            }
        }
        pattern.rows = rows;
        pattern
    }

    /// The elimination tree, and in `first`, one behind, how many entries each column has.
    fn grow(&mut self, matrix: &Sparse) {
        let root = self.order.len() as u32;
        let mut path = Path::new(self.order.len());
        for k in 0..root {
            path.climb(self, matrix, k);
            for &i in &path.columns {
                self.first[i as usize + 1] += 1;
                self.parent[i as usize] = self.parent[i as usize].min(k);
            }
        }
    }
}

impl Path {
    fn new(n: usize) -> Self {
        Self { columns: vec![], stretches: vec![], seen: vec![n as u32; n] }
    }

    /// Finds the columns of row k, whose tree has to be known below k only.
    fn climb(&mut self, pattern: &Pattern, matrix: &Sparse, k: u32) {
        self.columns.clear();
        self.stretches.clear();
        self.seen[k as usize] = k;
        for (column, _) in matrix.row(pattern.order[k as usize] as usize) {
            let mut i = pattern.place[column as usize];
            if i > k || self.seen[i as usize] == k {
                continue;
            }
            self.stretches.push(self.columns.len());
            while i < k && self.seen[i as usize] != k {
                self.seen[i as usize] = k;
                self.columns.push(i);
                i = pattern.parent[i as usize];
            }
        }
    }

    /// The columns, each before those above it in the tree.
    fn upwards(&self) -> impl Iterator<Item = usize> + '_ {
        let ends = self.stretches.iter().skip(1).copied().chain([self.columns.len()]);
        let stretches: Vec<_> = self.stretches.iter().copied().zip(ends).collect();
        stretches.into_iter().rev().flat_map(|(start, end)| self.columns[start..end].iter().map(|&i| i as usize))
    }
}

impl Factor {
    /// Factor of a matrix; `None` where it is not positive.
    #[must_use]
    pub fn new(matrix: &Sparse) -> Option<Self> {
        let (n, pattern) = (matrix.count(), Arc::new(Pattern::new(matrix)));
        let mut factor = Self { entries: vec![0.0; pattern.rows.len()], pattern, diagonal: vec![1.0; n] };
        factor.find(matrix, 0..n as u32, |_| false).then_some(factor)
    }

    /// Factors a matrix that has entries where the one before had them. Whether it is positive; the factor is of no use
    /// else.
    pub fn renew(&mut self, matrix: &Sparse) -> bool {
        self.find(matrix, 0..matrix.count() as u32, |_| false)
    }

    /// Takes unknowns out of the matrix, as if their rows and columns were those of the identity, or puts them back:
    /// `changed` are those for which `without` is another than it was. Whether the matrix is positive; the factor is of no
    /// use else.
    pub fn change(&mut self, matrix: &Sparse, changed: &[u32], without: impl Fn(usize) -> bool) -> bool {
        let n = self.pattern.order.len();
        let mut dirty = vec![false; n];
        for &unknown in changed {
            let mut k = self.pattern.place[unknown as usize] as usize;
            while k < n && !dirty[k] {
                dirty[k] = true;
                k = self.pattern.parent[k] as usize;
            }
        }
        self.find(matrix, (0..n as u32).filter(|&k| dirty[k as usize]), without)
    }

    /// Finds rows of L, ascending, each with all that are above it in the tree.
    fn find(&mut self, matrix: &Sparse, rows: impl Iterator<Item = u32>, without: impl Fn(usize) -> bool) -> bool {
        let Self { pattern, entries, diagonal } = self;
        let mut path = Path::new(diagonal.len());
        let mut sums = vec![0.0; diagonal.len()];
        for row in rows {
            let k = row as usize;
            path.climb(pattern, matrix, row);
            diagonal[k] = 1.0;
            let own = pattern.order[k] as usize;
            let kept = |&(column, _): &(u32, f64)| !without(own) && !without(column as usize);
            for (column, entry) in matrix.row(own).filter(kept) {
                let i = pattern.place[column as usize] as usize;
                match i.cmp(&k) {
                    Ordering::Greater => {}
                    Ordering::Equal => diagonal[k] = entry,
                    Ordering::Less => sums[i] = entry,
                }
            }
            for i in path.upwards() {
                let sum = core::mem::take(&mut sums[i]);
                let mut p = pattern.first[i];
                while pattern.rows[p] < row {
                    sums[pattern.rows[p] as usize] -= entries[p] * sum;
                    p += 1;
                }
                entries[p] = sum / diagonal[i];
                diagonal[k] -= entries[p] * sum;
            }
            // Not a number is not positive, either.
            if diagonal[k].partial_cmp(&0.0) != Some(Ordering::Greater) {
                return false;
            }
        }
        true
    }

    /// The solution of the matrix times x = load.
    #[must_use]
    pub fn solve<T>(&self, load: &[T]) -> Vec<T>
    where
        T: Copy + Sub<Output = T> + Mul<f64, Output = T> + Div<f64, Output = T>,
    {
        let Pattern { order, place, first, rows, .. } = &*self.pattern;
        let mut x: Vec<T> = order.iter().map(|&i| load[i as usize]).collect();
        let column = |k: usize| {
            let range = first[k]..first[k + 1];
            rows[range.clone()].iter().map(|&row| row as usize).zip(&self.entries[range])
        };
        for k in 0..x.len() {
            let own = x[k];
            column(k).for_each(|(row, entry)| x[row] = x[row] - own * *entry);
        }
        for k in (0..x.len()).rev() {
            x[k] = column(k).fold(x[k] / self.diagonal[k], |own, (row, entry)| own - x[row] * *entry);
        }
        place.iter().map(|&k| x[k as usize]).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Neighbours on a line, and a few far apart, pull at each other; each holds on to its own a little.
    fn matrix(n: usize, far: &[(usize, usize)]) -> Sparse {
        let near = (1..n).map(|i| (i - 1, i));
        let pairs: Vec<(usize, usize)> = near.chain(far.iter().map(|&(a, b)| (a % n, b % n))).collect();
        Sparse::new(n, |i, row| {
            row.add(i as u32, 0.01 + 0.1 * (i % 3) as f64);
            for (k, &(a, b)) in pairs.iter().enumerate().filter(|(_, (a, b))| a != b) {
                let weight = 1.0 + (k % 5) as f64;
                if let Some(other) = [(a, b), (b, a)].into_iter().find(|pair| pair.0 == i).map(|pair| pair.1) {
                    row.add(i as u32, weight);
                    row.add(other as u32, -weight);
                }
            }
        })
    }

    fn off(matrix: &Sparse, x: &[f64], load: &[f64]) -> f64 {
        matrix.times(x).iter().zip(load).fold(0.0, |most, (a, b)| f64::max(most, (a - b).abs()))
    }

    proptest! {
        #[test]
        fn solutions_fit_and_unknowns_can_be_taken_out_and_put_back(
            n in 1usize..40,
            far in prop::collection::vec((0usize..40, 0usize..40), 0..12),
            out in prop::collection::vec(0usize..40, 0..10),
        ) {
            let matrix = matrix(n, &far);
            let load: Vec<f64> = (0..n).map(|i| libm::sin(i as f64)).collect();
            let mut factor = Factor::new(&matrix).unwrap();
            let whole = factor.solve(&load);
            prop_assert!(off(&matrix, &whole, &load) < 1e-9);

            let without = |i: usize| out.iter().any(|o| o % n == i);
            let changed: Vec<u32> = (0..n as u32).filter(|&i| without(i as usize)).collect();
            prop_assert!(factor.change(&matrix, &changed, without));
            let kept = Sparse::new(n, |i, row| {
                let own = matrix.row(i).filter(|&(j, _)| !without(i) && !without(j as usize));
                own.for_each(|(j, entry)| row.add(j, entry));
                if without(i) {
                    row.add(i as u32, 1.0);
                }
            });
            prop_assert!(off(&kept, &factor.solve(&load), &load) < 1e-9);

            prop_assert!(factor.change(&matrix, &changed, |_| false));
            prop_assert_eq!(factor.solve(&load), whole);
        }
    }

    #[test]
    fn what_is_not_positive_has_no_factor() {
        let of = |own: f64| {
            Sparse::new(2, |i, row| {
                row.add(i as u32, own);
                row.add(1 - i as u32, 1.0);
            })
        };
        assert!(Factor::new(&of(1.5)).is_some());
        assert!([0.5, 0.0, -1.0, f64::NAN].into_iter().all(|own| Factor::new(&of(own)).is_none()));
        assert!(Factor::new(&Sparse::new(0, |_, _| {})).unwrap().solve::<f64>(&[]).is_empty());
    }

    #[test]
    fn along_a_line_it_has_no_entry_that_the_matrix_has_not() {
        let matrix = matrix(1000, &[]);
        assert_eq!(Factor::new(&matrix).unwrap().entries.len(), 999);
    }
}
