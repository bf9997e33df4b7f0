//! Least squares with x ≥ 0: conjugate gradients on the unknowns that are free, and rounds that fix and free them.
//!
//! In: [`Equations`], symmetric and positive. Out: values by unknown. Of each channel by itself: unknowns that come out
//! negative are fixed at zero, the rest is solved again, and unknowns at zero that want to grow are freed, until
//! nothing changes. That is the active-set method of Portugal, Júdice, Vicente, "A comparison of block pivoting and
//! interior-point algorithms for linear least squares problems with nonnegative variables", Math. Comp. 63, 1994, with
//! a limit on rounds in place of their safeguard: the last solution is cut at zero in any case. The first rounds are
//! solved roughly ([`ROUGH`]): they find most of what is fixed, and no digit of them stays.
//!
//! Preconditioned by the diagonal; a mass matrix then has a condition that does not grow with the mesh, so the number of
//! steps hardly depends on its size. Sums are taken in fixed chunks: the same bits at any thread count.
//!
//! Symbols: r residual b − A x; z = r/diagonal; p direction; a step.

use super::Progress;
use super::parallel;
use glam::BVec3;
use glam::DVec3;

/// Steps of a round. Most need 5 to 20.
const MOST_STEPS: usize = 400;
/// Rounds of fixing and freeing. Most scenes need 3 to 7.
const MOST_ROUNDS: usize = 16;
/// Residual of the first rounds, as a multiple of the last one's. Much larger: wrong ones are fixed, and not all are freed
/// again; smaller: steps that the next round does again.
const ROUGH: f64 = 10.0;

/// The symmetric matrix of a least squares problem.
pub trait Equations: Sync {
    /// Matrix times x, the same bits at any thread count.
    fn times(&self, x: &[DVec3]) -> Vec<DVec3>;
    /// Diagonal of the matrix, ≥ 0.
    fn diagonal(&self) -> &[f64];
}

/// Values that fit a right-hand side best, none of them negative, found from `x` on. A channel is solved when its residual
/// is `close` times the right-hand side, both in the norm of the preconditioner. Cancelled, it returns what it has.
#[must_use]
pub fn solve(
    system: &impl Equations,
    load: &[DVec3],
    mut x: Vec<DVec3>,
    close: f64,
    progress: &Progress,
) -> Vec<DVec3> {
    let mut free = vec![BVec3::TRUE; x.len()];
    let mut enough = ROUGH * close;
    for _ in 0..MOST_ROUNDS {
        conjugate_gradients(system, load, &mut x, &free, enough, progress);
        let changed = pivot(system, load, &mut x, &mut free, enough);
        if progress.cancelled() || (!changed && enough <= close) {
            break;
        }
        if !changed {
            enough = close;
        }
    }
    x.into_iter().map(|v| v.max(DVec3::ZERO)).collect()
}

/// [`solve`] for values that may have either sign.
#[must_use]
pub fn solve_signed(
    system: &impl Equations,
    load: &[DVec3],
    mut x: Vec<DVec3>,
    close: f64,
    progress: &Progress,
) -> Vec<DVec3> {
    let free = vec![BVec3::TRUE; x.len()];
    conjugate_gradients(system, load, &mut x, &free, close, progress);
    x
}

/// Fixes what is negative, frees what wants to grow; whether there was any.
fn pivot(system: &impl Equations, load: &[DVec3], x: &mut [DVec3], free: &mut [BVec3], close: f64) -> bool {
    let product = system.times(x);
    let mut changed = false;
    for (i, (x, free)) in x.iter_mut().zip(free).enumerate() {
        let negative = x.cmplt(DVec3::ZERO) & *free;
        let tolerance = load[i].abs() * close;
        let grows = (load[i] - product[i]).cmpgt(tolerance) & !*free;
        changed |= (negative | grows).any();
        *x = DVec3::select(negative, DVec3::ZERO, *x);
        *free = (*free & !negative) | grows;
    }
    changed
}

/// Solves for the free unknowns, from the values they have.
fn conjugate_gradients(
    system: &impl Equations,
    load: &[DVec3],
    x: &mut Vec<DVec3>,
    free: &[BVec3],
    close: f64,
    progress: &Progress,
) {
    let only_free = |i: usize, v: DVec3| DVec3::select(free[i], v, DVec3::ZERO);
    let scaled = |i: usize, v: DVec3| if system.diagonal()[i] > 0.0 { v / system.diagonal()[i] } else { DVec3::ZERO };
    let n = x.len();
    let product = system.times(x);
    let mut r = parallel::map_light(n, |i| only_free(i, load[i] - product[i]));
    let mut p = parallel::map_light(n, |i| scaled(i, r[i]));
    let mut size = dot(n, |i| r[i] * p[i]);
    let enough = dot(n, |i| load[i] * scaled(i, load[i])) * close.powi(2);
    for _ in 0..MOST_STEPS {
        if size.cmple(enough).all() || progress.cancelled() {
            return;
        }
        let product = system.times(&p);
        let curvature = dot(n, |i| only_free(i, p[i] * product[i]));
        let a = ratio(size, curvature);
        *x = parallel::map_light(n, |i| x[i] + p[i] * a);
        r = parallel::map_light(n, |i| only_free(i, r[i] - product[i] * a));
        let next = dot(n, |i| r[i] * scaled(i, r[i]));
        let turn = ratio(next, size);
        p = parallel::map_light(n, |i| scaled(i, r[i]) + p[i] * turn);
        size = next;
    }
}

/// a/b by channel; 0 where a channel is solved.
fn ratio(a: DVec3, b: DVec3) -> DVec3 {
    DVec3::select(b.cmpgt(DVec3::ZERO), a / b, DVec3::ZERO)
}

/// Sum over all unknowns, by channel.
fn dot(n: usize, f: impl Fn(usize) -> DVec3 + Sync) -> DVec3 {
    const CHUNK: usize = 4096;
    let sum = |range: core::ops::Range<usize>| range.fold(DVec3::ZERO, |sum, i| sum + f(i));
    parallel::map_chunks(n, CHUNK, sum).into_iter().fold(DVec3::ZERO, |a, b| a + b)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The product of a few rows with themselves, transposed, and a little more on the diagonal: symmetric and positive.
    #[derive(Debug)]
    struct Dense {
        matrix: Vec<Vec<f64>>,
        diagonal: Vec<f64>,
    }

    impl Dense {
        fn new(rows: &[Vec<f64>], n: usize) -> Self {
            let entry = |i: usize, j: usize| {
                let sum: f64 = rows.iter().map(|row| row[i] * row[j]).sum();
                sum + if i == j { 0.05 } else { 0.0 }
            };
            let matrix: Vec<Vec<f64>> = (0..n).map(|i| (0..n).map(|j| entry(i, j)).collect()).collect();
            Self { diagonal: (0..n).map(|i| matrix[i][i]).collect(), matrix }
        }
    }

    impl Equations for Dense {
        fn times(&self, x: &[DVec3]) -> Vec<DVec3> {
            self.matrix.iter().map(|row| row.iter().zip(x).fold(DVec3::ZERO, |sum, (a, x)| sum + *x * *a)).collect()
        }

        fn diagonal(&self) -> &[f64] {
            &self.diagonal
        }
    }

    prop_compose! {
        fn problem()(n in 1usize..12)(
            rows in prop::collection::vec(prop::collection::vec(-1.0..1.0f64, n), 1..20),
            load in prop::collection::vec(prop::array::uniform3(-1.0..1.0f64), n),
        ) -> (Dense, Vec<DVec3>) {
            (Dense::new(&rows, load.len()), load.into_iter().map(DVec3::from_array).collect())
        }
    }

    proptest! {
        /// What Karush, Kuhn and Tucker ask of the least squares with x ≥ 0: where x > 0 the residual vanishes, at x = 0
        /// nothing wants to grow.
        #[test]
        fn no_value_can_be_changed_for_the_better((system, load) in problem()) {
            let x = solve(&system, &load, vec![DVec3::ZERO; load.len()], 1e-10, &Progress::default());
            let product = system.times(&x);
            for i in 0..x.len() {
                for channel in 0..3 {
                    let (x, residual) = (x[i][channel], load[i][channel] - product[i][channel]);
                    prop_assert!(x >= 0.0);
                    prop_assert!(residual <= 1e-6, "{i} {channel}: at {x} a residual of {residual}");
                    prop_assert!(x < 1e-6 || residual.abs() <= 1e-6, "{i} {channel}: at {x} a residual of {residual}");
                }
            }
        }

        #[test]
        fn of_either_sign_nothing_is_left((system, load) in problem()) {
            let x = solve_signed(&system, &load, load.clone(), 1e-10, &Progress::default());
            for (product, load) in system.times(&x).iter().zip(&load) {
                prop_assert!((*product - *load).abs().max_element() <= 1e-6);
            }
        }
    }

    #[test]
    fn a_known_solution_is_kept_and_nothing_of_nothing() {
        let system = Dense::new(&[vec![1.0, -2.0], vec![0.5, 1.0]], 2);
        let known = vec![DVec3::new(1.0, 0.0, 2.0), DVec3::new(0.5, 3.0, 0.0)];
        let found = solve(&system, &system.times(&known), known.clone(), 1e-12, &Progress::default());
        assert!(found.iter().zip(&known).all(|(a, b)| (*a - *b).abs().max_element() < 1e-9), "{found:?}");
        assert!(solve(&Dense::new(&[], 0), &[], vec![], 1e-6, &Progress::default()).is_empty());
    }

    #[test]
    fn cancelled_it_ends_with_what_it_has() {
        let progress = Progress::default();
        progress.cancel();
        let system = Dense::new(&[vec![1.0, 0.3]], 2);
        let start = vec![DVec3::ONE, -DVec3::ONE];
        assert_eq!(solve(&system, &[DVec3::ONE; 2], start, 1e-6, &progress), [DVec3::ONE, DVec3::ZERO]);
    }
}
