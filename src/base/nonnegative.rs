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
