//! Least squares with x ≥ 0: rounds that solve for the unknowns that are free, and fix and free them.
//!
//! In: a matrix, symmetric and positive. Out: values by unknown. Of each channel by itself: unknowns that come out
//! negative are fixed at zero, the rest is solved again, and unknowns at zero that want to grow are freed, until
//! nothing changes. That is the active-set method of Portugal, Júdice, Vicente, "A comparison of block pivoting and
//! interior-point algorithms for linear least squares problems with nonnegative variables", Math. Comp. 63, 1994, with
//! their safeguard against going round in circles ([`Exchange`]: without it one in some 8,000 small problems was left
//! unsolved) and a limit on rounds: the last solution is cut at zero in any case.
//!
//! [`solve`] takes conjugate gradients, preconditioned by the diagonal: a mass matrix then has a condition that does not
//! grow with the mesh, so the number of steps hardly depends on its size. Its first rounds are solved roughly ([`ROUGH`]):
//! they find most of what is fixed, and no digit of them stays. [`solve_by`] takes a factor, for matrices that are stiff
//! and sparse, as those of seams are, whose weights span six orders of magnitude. On a bumpy surface of 346,944 triangles,
//! without the weights of shadows, gradients took 223 s and left steps of 82 %: even rounds of a small prop would need more
//! than [`MOST_STEPS`]. The factor has 1.5 times the entries of the matrix, took 20 s and left 3.2 %. Sums are taken in
//! fixed chunks, or in order: the same bits at any thread count.
//!
//! Symbols: r residual b − A x; z = r/diagonal; p direction; a step.

use super::Progress;
use super::Sparse;
use super::cholesky::Factor;
use super::parallel;
use glam::BVec3;
use glam::DVec3;

/// Steps of a round. Most need 5 to 20.
const MOST_STEPS: usize = 400;
/// Rounds of fixing and freeing. Vertices of most scenes need 3 to 7, seams of a small prop 20; one in 46,000 small problems
/// is not through after 16 by gradients and 32 by a factor, none of 1.5 million after this many.
const MOST_ROUNDS: usize = 64;
/// Residual of the first rounds, as a multiple of the last one's. Much larger: wrong ones are fixed, and not all are freed
/// again; smaller: steps that the next round does again.
const ROUGH: f64 = 10.0;

/// Values that fit a right-hand side best, none of them negative, found from `x` on. A channel is solved when its residual
/// is `close` times the right-hand side, both in the norm of the preconditioner. Cancelled, it returns what it has.
#[must_use]
pub fn solve(matrix: &Sparse, load: &[DVec3], mut x: Vec<DVec3>, close: f64, progress: &Progress) -> Vec<DVec3> {
    let mut free = vec![BVec3::TRUE; x.len()];
    let mut exchanges = [Exchange::new(); 3];
    let mut enough = ROUGH * close;
    for _ in 0..MOST_ROUNDS {
        conjugate_gradients(matrix, load, &mut x, &free, enough, progress);
        let changed = pivot(matrix, load, &mut x, &mut free, enough, &mut exchanges);
        if progress.cancelled() || (!changed && enough <= close) {
            break;
        }
        if !changed {
            (enough, exchanges) = (close, [Exchange::new(); 3]);
        }
    }
    x.into_iter().map(|v| v.max(DVec3::ZERO)).collect()
}

/// [`solve`] by the matrix' factor, of one channel. What is smaller than `close` times the typical value counts as none.
#[must_use]
pub fn solve_by(factor: &Factor, matrix: &Sparse, load: &[f64], close: f64, progress: &Progress) -> Vec<f64> {
    let (n, mut factor) = (load.len(), factor.clone());
    let mut free = vec![true; n];
    let mut x = factor.solve(load);
    let mut exchange = Exchange::new();
    for _ in 0..MOST_ROUNDS {
        let [least, tolerance] = [&x, load].map(|values| close * root_mean_square(values));
        let product = matrix.times(&x);
        let wrong = |i: usize| if free[i] { x[i] < -least } else { load[i] - product[i] > tolerance };
        let mut changed: Vec<u32> = (0..n).filter(|&i| wrong(i)).map(|i| i as u32).collect();
        if !exchange.takes_all(changed.len()) {
            changed.drain(..changed.len().saturating_sub(1));
        }
        changed.iter().for_each(|&i| free[i as usize] = !free[i as usize]);
        if changed.is_empty() || progress.cancelled() || !factor.change(matrix, &changed, |i| !free[i]) {
            break;
        }
        let only_free: Vec<f64> = (0..n).map(|i| if free[i] { load[i] } else { 0.0 }).collect();
        x = factor.solve(&only_free);
    }
    x.into_iter().map(|v| v.max(0.0)).collect()
}

fn root_mean_square(values: &[f64]) -> f64 {
    (values.iter().fold(0.0, |sum, v| sum + v * v) / values.len().max(1) as f64).sqrt()
}

/// Which of the wrong unknowns a round exchanges: all, as long as that makes them fewer, and when it has not for
/// [`Exchange::CHANCES`] rounds only the last one, after Murty, which ends for sure, until they are fewer than ever.
#[derive(Clone, Copy)]
struct Exchange {
    fewest: usize,
    chances: usize,
}

impl Exchange {
    /// Rounds for all after the last one that made them fewer.
    const CHANCES: usize = 3;

    fn new() -> Self {
        Self { fewest: usize::MAX, chances: Self::CHANCES }
    }

    /// Whether this round exchanges all, where that many are wrong.
    fn takes_all(&mut self, wrong: usize) -> bool {
        if wrong < self.fewest {
            *self = Self { fewest: wrong, chances: Self::CHANCES };
            return true;
        }
        let left = self.chances > 0;
        self.chances = self.chances.saturating_sub(1);
        left
    }
}

/// Fixes what is negative, frees what wants to grow; whether there was any.
fn pivot(
    matrix: &Sparse,
    load: &[DVec3],
    x: &mut [DVec3],
    free: &mut [BVec3],
    close: f64,
    exchanges: &mut [Exchange; 3],
) -> bool {
    let product = matrix.times(x);
    let wrong = |i: usize| {
        let grows = (load[i] - product[i]).cmpgt(load[i].abs() * close);
        (x[i].cmplt(DVec3::ZERO) & free[i]) | (grows & !free[i])
    };
    let wrong: Vec<BVec3> = (0..x.len()).map(wrong).collect();
    let count = [0, 1, 2].map(|channel| wrong.iter().filter(|wrong| wrong.test(channel)).count());
    let last = [0, 1, 2].map(|channel| wrong.iter().rposition(|wrong| wrong.test(channel)));
    let all = [0, 1, 2].map(|channel| exchanges[channel].takes_all(count[channel]));
    for (i, &wrong) in wrong.iter().enumerate() {
        let changed = wrong & BVec3::from_array([0, 1, 2].map(|channel| all[channel] || last[channel] == Some(i)));
        x[i] = DVec3::select(changed, DVec3::ZERO, x[i]);
        free[i] ^= changed;
    }
    count != [0; 3]
}

/// Solves for the free unknowns, from the values they have.
fn conjugate_gradients(
    matrix: &Sparse,
    load: &[DVec3],
    x: &mut Vec<DVec3>,
    free: &[BVec3],
    close: f64,
    progress: &Progress,
) {
    let only_free = |i: usize, v: DVec3| DVec3::select(free[i], v, DVec3::ZERO);
    let scaled = |v: DVec3, diagonal: f64| if diagonal > 0.0 { v / diagonal } else { DVec3::ZERO };
    let n = x.len();
    let inverse = |r: &[DVec3]| parallel::map_light(n, |i| scaled(r[i], matrix.diagonal()[i]));
    let product = matrix.times(x);
    let mut r = parallel::map_light(n, |i| only_free(i, load[i] - product[i]));
    let mut z = inverse(&r);
    let mut p = parallel::map_light(n, |i| only_free(i, z[i]));
    let mut size = parallel::sum_channels(n, |i| r[i] * z[i]);
    let whole = inverse(load);
    let enough = parallel::sum_channels(n, |i| load[i] * whole[i]) * close.powi(2);
    for _ in 0..MOST_STEPS {
        if size.cmple(enough).all() || progress.cancelled() {
            return;
        }
        let product = matrix.times(&p);
        let curvature = parallel::sum_channels(n, |i| p[i] * product[i]);
        let a = ratio(size, curvature);
        *x = parallel::map_light(n, |i| x[i] + p[i] * a);
        r = parallel::map_light(n, |i| only_free(i, r[i] - product[i] * a));
        z = inverse(&r);
        let next = parallel::sum_channels(n, |i| r[i] * z[i]);
        let turn = ratio(next, size);
        p = parallel::map_light(n, |i| only_free(i, z[i]) + p[i] * turn);
        size = next;
    }
}

/// a/b by channel; 0 where a channel is solved.
pub(crate) fn ratio(a: DVec3, b: DVec3) -> DVec3 {
    DVec3::select(b.cmpgt(DVec3::ZERO), a / b, DVec3::ZERO)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The product of a few rows with themselves, transposed, and a little more on the diagonal: symmetric and positive.
    fn matrix(rows: &[Vec<f64>], n: usize) -> Sparse {
        Sparse::new(n, |i, row| {
            row.add(i as u32, 0.05);
            for (j, other) in (0..n).flat_map(|j| rows.iter().map(move |other| (j, other))) {
                row.add(j as u32, other[i] * other[j]);
            }
        })
    }

    /// By the factor, channel by channel.
    fn by_factor(matrix: &Sparse, load: &[DVec3]) -> Vec<DVec3> {
        let factor = Factor::new(matrix).unwrap();
        let channel = |c: usize| {
            let load: Vec<f64> = load.iter().map(|v| v[c]).collect();
            solve_by(&factor, matrix, &load, 1e-10, &Progress::default())
        };
        let [r, g, b] = [0, 1, 2].map(channel);
        (0..load.len()).map(|i| DVec3::new(r[i], g[i], b[i])).collect()
    }

    prop_compose! {
        fn problem()(n in 1usize..12)(
            rows in prop::collection::vec(prop::collection::vec(-1.0..1.0f64, n), 1..20),
            load in prop::collection::vec(prop::array::uniform3(-1.0..1.0f64), n),
        ) -> (Sparse, Vec<DVec3>) {
            (matrix(&rows, load.len()), load.into_iter().map(DVec3::from_array).collect())
        }
    }

    proptest! {
        /// What Karush, Kuhn and Tucker ask of the least squares with x ≥ 0: where x > 0 the residual vanishes, at x = 0
        /// nothing wants to grow.
        #[test]
        fn no_value_can_be_changed_for_the_better((matrix, load) in problem()) {
            let by_gradients = solve(&matrix, &load, vec![DVec3::ZERO; load.len()], 1e-10, &Progress::default());
            for solution in [by_gradients, by_factor(&matrix, &load)] {
                let product = matrix.times(&solution);
                for (i, channel) in (0..load.len()).flat_map(|i| (0..3).map(move |channel| (i, channel))) {
                    let (x, residual) = (solution[i][channel], load[i][channel] - product[i][channel]);
                    prop_assert!(x >= 0.0);
                    prop_assert!(residual <= 1e-6, "{i} {channel}: at {x} a residual of {residual}");
                    prop_assert!(x < 1e-6 || residual.abs() <= 1e-6, "{i} {channel}: at {x} a residual of {residual}");
                }
            }
        }
    }

    #[test]
    fn a_known_solution_is_kept_and_nothing_of_nothing() {
        let known = vec![DVec3::new(1.0, 0.0, 2.0), DVec3::new(0.5, 3.0, 0.0)];
        let (two, none) = (matrix(&[vec![1.0, -2.0], vec![0.5, 1.0]], 2), matrix(&[], 0));
        let load = two.times(&known);
        for found in [solve(&two, &load, known.clone(), 1e-12, &Progress::default()), by_factor(&two, &load)] {
            assert!(found.iter().zip(&known).all(|(a, b)| (*a - *b).abs().max_element() < 1e-9), "{found:?}");
        }
        assert!(solve(&none, &[], vec![], 1e-6, &Progress::default()).is_empty() && by_factor(&none, &[]).is_empty());
    }

    #[test]
    fn cancelled_it_ends_with_what_it_has() {
        let progress = Progress::default();
        progress.cancel();
        let start = vec![DVec3::ONE, -DVec3::ONE];
        let found = solve(&matrix(&[vec![1.0, 0.3]], 2), &[DVec3::ONE; 2], start, 1e-6, &progress);
        assert_eq!(found, [DVec3::ONE, DVec3::ZERO]);
    }
}
