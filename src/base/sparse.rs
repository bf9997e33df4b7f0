//! Sparse symmetric matrices by rows, times vectors.

use super::parallel;
use core::ops::Add;
use core::ops::Mul;

/// Rows that are added up by one task.
const CHUNK: usize = 1024;

/// Columns and entries of a row, ascending.
#[derive(Debug, Default)]
pub struct Row(Vec<(u32, f64)>);

/// A symmetric matrix.
#[derive(Debug, Clone, Default)]
pub struct Sparse {
    /// Where rows start, one more than there are rows.
    first: Vec<usize>,
    /// Columns of a row, ascending, each once.
    columns: Vec<u32>,
    entries: Vec<f64>,
    diagonal: Vec<f64>,
}

impl Sparse {
    /// A matrix of `n` rows, each of which `fill` adds up.
    #[must_use]
    pub fn new(n: usize, fill: impl Fn(usize, &mut Row) + Sync) -> Self {
        let chunks = parallel::map_chunks(n, CHUNK, |range| {
            let (mut lengths, mut all) = (vec![], vec![]);
            let mut row = Row::default();
            for i in range {
                fill(i, &mut row);
                lengths.push(row.0.len());
                all.append(&mut row.0);
            }
            (lengths, all)
        });
        let count = chunks.iter().map(|(_, all)| all.len()).sum();
        let mut matrix = Self {
            first: Vec::with_capacity(n + 1),
            columns: Vec::with_capacity(count),
            entries: Vec::with_capacity(count),
            diagonal: vec![0.0; n],
        };
        matrix.first.push(0);
        for (lengths, all) in chunks {
            let mut entries = all.into_iter();
            for length in lengths {
                let i = matrix.first.len() - 1;
                for (column, entry) in entries.by_ref().take(length) {
                    if column as usize == i {
                        matrix.diagonal[i] = entry;
                    }
                    matrix.columns.push(column);
                    matrix.entries.push(entry);
                }
                matrix.first.push(matrix.columns.len());
            }
        }
        matrix
    }

    /// Number of rows.
    #[must_use]
    pub fn count(&self) -> usize {
        self.diagonal.len()
    }

    /// Where rows start in [`Sparse::columns`], and where the last one ends.
    #[must_use]
    pub fn first(&self) -> &[usize] {
        &self.first
    }

    /// Columns of all rows.
    #[must_use]
    pub fn columns(&self) -> &[u32] {
        &self.columns
    }

    /// The diagonal; 0 where it has no entry.
    #[must_use]
    pub fn diagonal(&self) -> &[f64] {
        &self.diagonal
    }

    /// Columns and entries of a row.
    pub fn row(&self, i: usize) -> impl Iterator<Item = (u32, f64)> + '_ {
        let range = self.first[i]..self.first[i + 1];
        self.columns[range.clone()].iter().copied().zip(self.entries[range].iter().copied())
    }

    /// The matrix times x, of one channel or of three.
    #[must_use]
    pub fn times<T>(&self, x: &[T]) -> Vec<T>
    where
        T: Copy + Default + Send + Sync + Add<Output = T> + Mul<f64, Output = T>,
    {
        parallel::map_light(self.count(), |i| {
            self.row(i).fold(T::default(), |sum, (column, entry)| sum + x[column as usize] * entry)
        })
    }
}

impl Row {
    /// Adds to the entry of a column.
    pub fn add(&mut self, column: u32, entry: f64) {
        match self.0.binary_search_by_key(&column, |(column, _)| *column) {
            Ok(at) => self.0[at].1 += entry,
            Err(at) => self.0.insert(at, (column, entry)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn entries_of_a_column_are_added_and_rows_are_in_order() {
        let matrix = Sparse::new(2500, |i, row| {
            let i = i as u32;
            [(i, 1.0), (2499 - i, 2.0), (i, 3.0)].into_iter().for_each(|(column, entry)| row.add(column, entry));
        });
        assert_eq!(matrix.row(3).collect::<Vec<_>>(), [(3, 4.0), (2496, 2.0)]);
        assert_eq!(matrix.row(2496).collect::<Vec<_>>(), [(3, 2.0), (2496, 4.0)]);
        assert!(matrix.diagonal().iter().all(|d| *d == 4.0) && matrix.count() == 2500);
        let x: Vec<f64> = (0..2500).map(f64::from).collect();
        assert!(matrix.times(&x).iter().zip(&x).all(|(y, x)| *y == 4.0 * x + 2.0 * (2499.0 - x)));
    }

    #[test]
    fn a_diagonal_that_is_not_there_is_zero() {
        let matrix = Sparse::new(2, |i, row| row.add(1 - i as u32, 5.0));
        assert_eq!((matrix.diagonal(), matrix.times(&[1.0, 2.0])), (&[0.0, 0.0][..], vec![10.0, 5.0]));
    }
}
