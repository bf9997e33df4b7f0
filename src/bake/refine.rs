//! Passes of the solver until what is asked for is reached: one pass where nothing is.
//!
//! In: [`Setup`] and the settings. Out: a [`Solution`], shared between neighbours, with its error and the course that
//! led to it. [`solve`](super::solve) makes the passes, [`plan`](super::plan) says how large they are. Light is shared
//! anew after every pass, because less noise wants less sharing.
//!
//! With a time limit, outputs are encoded once on trial to know how long that takes; a pass that is not done in time is
//! thrown away.

use super::clock::{Clock, Stop};
use super::groups::Group;
use super::halves::Halves;
use super::plan::{Done, End, Goals, Plan, Step};
use super::power;
use super::solve::{Budget, Setup, Solver};
use super::{Error, Solution};
use crate::base::random::mix;
use crate::base::{LightVector, Rgb, Warning};
use crate::finish::{self, Along, Errors};
use crate::output::report;
use crate::settings::{Aov, SplatMode};

/// Seconds to hold back for putting files in place.
const WRITE_SECONDS: f64 = 0.1;
/// Keeps the seeds of groups apart from those of passes.
const GROUPS: u64 = 0x6c69_6768_7473;
/// Times what was measured, to hold back for sharing and encoding.
const SLOWER: f64 = 1.2;

/// Solves, each group by itself. `rehearse` does what comes after, up to the encoded files, and forgets it.
pub(super) fn refine(
    setup: &Setup<'_>,
    groups: &[Group],
    clock: &mut Clock<'_>,
    rehearse: &dyn Fn(&Solution) -> Result<(), Error>,
) -> Result<Solution, Error> {
    let settings = setup.settings;
    let goals = Goals { error: settings.target_error, seconds: settings.time_limit };
    let mut plan =
        Plan::new(goals, settings.gather, [Budget::most(settings, setup.patches), Budget::most_of_all(settings)]);
    let seed = |k: u64| if k == 0 { settings.seed } else { mix(settings.seed ^ mix(GROUPS ^ k)) };
    let mut solvers: Vec<Solver<'_>> =
        (0..).zip(groups).map(|(k, g)| Solver::new(setup, &g.emitters, seed(k))).collect();
    let mut best = Solution::default();
    let end = loop {
        let budget = match plan.next(clock.elapsed()) {
            Step::Pass(budget) => budget,
            Step::End(end) => break end,
        };
        let start = clock.elapsed();
        let own = Budget::new(settings, setup.patches, budget, plan.done.len() as u64);
        match clock.within(plan.left(start), |clock| solvers.iter_mut().try_for_each(|s| s.pass(setup, &own, clock))) {
            Ok(()) => {}
            Err(Stop::Expired) => break End::Time,
            Err(stop) => return Err(stop.into()),
        }
        let seconds = clock.elapsed() - start;
        best = shared(setup, &solvers, clock)?;
        let sharing = clock.elapsed() - start - seconds;
        plan.done.push(Done { budget, error: best.estimated_nrmse(setup.patches).unwrap_or(0.0), seconds });
        if let Some(limit) = goals.seconds.filter(|&limit| plan.done.len() == 1 && clock.elapsed() < limit) {
            let start = clock.elapsed();
            clock.timed("rehearse", |_| rehearse(&best))??;
            plan.reserve = (SLOWER * (clock.elapsed() - start)).min(limit) + WRITE_SECONDS;
        }
        plan.reserve = plan.reserve.max(WRITE_SECONDS) + if plan.done.len() == 1 { SLOWER * sharing } else { 0.0 };
    };
    best.warnings = warnings(&goals, &plan, end, clock.elapsed());
    best.refinement = refinement(&goals, &plan, end);
    Ok(best)
}

/// The light that was found, shared, and its error.
fn shared(setup: &Setup<'_>, solvers: &[Solver<'_>], clock: &mut Clock<'_>) -> Result<Solution, Stop> {
    let mut all = Solution::default();
    for (k, solver) in solvers.iter().enumerate() {
        let mut halves = solver.halves(setup);
        let errors = clock.timed("share", |_| share(setup, &mut halves))?;
        if solvers.len() > 1 {
            all.groups.push(halves.irradiance());
        }
        if k == 0 {
            (all.halves, all.errors, all.power) = (halves, errors, solver.power);
        } else {
            all.halves.add(&halves);
            // Groups have random numbers of their own, so squares add up.
            all.errors.iter_mut().zip(&errors).for_each(|(sum, own)| sum.add(own));
            all.power = power::sum(&all.power, &solver.power);
        }
        all.shadow_rays += solver.shadow_rays;
        all.gather_rays += solver.gather_rays();
    }
    Ok(all)
}

/// Lets light flow between linked texels, direct light apart from the rest, because its shadows are sharper. Errors of
/// the two.
fn share(setup: &Setup<'_>, halves: &mut Halves) -> [Errors; 2] {
    let shares = setup.settings.splat == SplatMode::Share;
    let flow = |halves: &mut [Vec<Rgb>; 2], part: Option<&mut Vec<Rgb>>, vectors: &mut Vec<LightVector>| {
        if !shares {
            return Errors::of_noise(halves);
        }
        let [a, b] = halves;
        let along = Along { part, vectors: Some(vectors) };
        finish::share(setup.patches, setup.ways(setup.patches.front), [a, b], along)
    };
    let splits = setup.settings.aov.iter().any(|aov| matches!(aov, Aov::Direct | Aov::Indirect));
    let Halves { direct, indirect, sky, vectors: [vectors, bounced], .. } = halves;
    let mut indirect = || flow(indirect, splits.then_some(sky), bounced);
    let mut direct = || flow(direct, None, vectors);
    // Of few texels, single steps are too short for two threads: 15,246 take 62 ms one after the other, 43 side by side.
    let (indirect, direct) = if setup.ways.is_some() { rayon::join(indirect, direct) } else { (indirect(), direct()) };
    [direct, indirect]
}

fn warnings(goals: &Goals, plan: &Plan, end: End, elapsed: f64) -> Vec<Warning> {
    let mut warnings = vec![];
    let error = plan.done.last().map_or(0.0, |d| d.error);
    if let Some(target) = goals.error.filter(|_| end != End::Error) {
        let why = match end {
            End::Time => "the time limit came first".to_owned(),
            _ => format!("it was not reached with {:.0} times the rays of the settings", plan.total()),
        };
        let what = format!("the estimated error is {error:.4}, above the target of {target}: {why}");
        warnings.push(Warning::new("target-error-missed", what));
    }
    if let Some(limit) = goals.seconds.filter(|limit| elapsed + plan.reserve > *limit && plan.done.len() == 1) {
        let what = format!("the least possible bake takes longer than the time limit of {limit} s");
        warnings.push(Warning::new("time-limit-exceeded", what));
    }
    warnings
}

fn refinement(goals: &Goals, plan: &Plan, end: End) -> report::Refinement {
    let pass = |d: &Done| report::Pass { budget: d.budget, estimated_nrmse: d.error, seconds: d.seconds };
    report::Refinement {
        target_error: goals.error,
        time_limit: goals.seconds,
        ended_by: end.word().to_owned(),
        passes: plan.done.iter().map(pass).collect(),
    }
}
