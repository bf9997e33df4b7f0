//! How many passes the solver makes, and how large each is, until an error or a time is reached.
//!
//! In: what is asked for, and budget, error and seconds of the passes so far. Out: the budget of the next pass, as a
//! multiple of the settings' own, or why there is none. Numbers only, so that it can be tested without a scene.
//!
//! Noise falls with the square root of the budget, and with it the distance over which light is shared. So a first pass
//! by a part of the budget tells how much is needed. Every pass adds to the ones before; none is wasted.
//!
//! Invariants: without a goal there is one pass of 1; without a time limit no step depends on the clock; every pass
//! adds at least [`LEAST_STEP`] of what there is and all together at most [`MOST_BUDGET`], so there is an end.

/// Part of the settings' budget that the first pass takes, if that leaves it [`LEAST_RAYS`].
const FIRST: f64 = 0.25;
/// Gather rays per texel below which the error estimate is not to be trusted: from 16 rays it was within a sixth.
const LEAST_RAYS: f64 = 16.0;
/// Of that, what the first pass takes when time is short.
const FIRST_IN_HASTE: f64 = 0.125;
/// Part of the target that is aimed at. The estimate is sometimes low and a pass too small costs another one; 0.9 costs
/// a tenth more rays.
const AIM: f64 = 0.95;
/// A pass is at most this multiple of what there is: the estimate gets better on the way.
const MOST_STEP: f64 = 16.0;
/// A pass is at least this part of what there is.
const LEAST_STEP: f64 = 0.1;
/// The same for what time is left over: it is worth less effort than it takes below this.
const LEAST_REST: f64 = 0.02;
/// Part of the time left that a pass may be expected to take: it is lost if it takes more than all, as on a machine
/// that has other things to do as well.
const CAREFUL: f64 = 0.6;
/// Part of what the smallest pass that is worth it is expected to take that must be left, where it is this or the end: a
/// tenth of a first pass is not needed again (in two rooms 0.05 and 0.18). Without that, half of 3 s was left over after a
/// first pass of 1 s. With 0.75, most such passes were lost.
const HOPEFUL: f64 = 0.9;
/// Part of the time below which what is left is left over.
const NO_TIME: f64 = 0.1;
/// Part of a first pass's seconds that grows with its budget; the rest is the same for any budget.
const GROWING: f64 = 0.7;
/// Most budget of all passes, as a multiple of the settings': a sixteenth of the error. Half floats hold no less by
/// much.
const MOST_BUDGET: f64 = 256.0;

/// What is asked for.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Goals {
    /// Estimated error at which to stop.
    pub(super) error: Option<f64>,
    /// Seconds of the whole bake.
    pub(super) seconds: Option<f64>,
}

/// A pass that was made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Done {
    /// Multiple of the settings' budget.
    pub(super) budget: f64,
    /// Estimated error of all passes up to this one.
    pub(super) error: f64,
    /// Seconds that it took.
    pub(super) seconds: f64,
}

/// What comes next.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Step {
    /// A pass of this multiple of the settings' budget.
    Pass(f64),
    /// Nothing.
    End(End),
}

/// Why there are no more passes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum End {
    /// The budget is used up: the settings' own, or the most there is.
    Budget,
    /// The error is reached.
    Error,
    /// The time is over.
    Time,
}

impl End {
    /// The word for it in reports.
    pub(super) fn word(self) -> &'static str {
        match self {
            Self::Budget => "budget",
            Self::Error => "target-error",
            Self::Time => "time-limit",
        }
    }
}

/// The course of a bake.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Plan {
    goals: Goals,
    /// Budget from which the error is trusted.
    trusted: f64,
    /// Most budget of one pass.
    most: f64,
    /// Most budget of all passes.
    most_of_all: f64,
    pub(super) done: Vec<Done>,
    /// Seconds from the end of the last pass to the end of the bake.
    pub(super) reserve: f64,
}

impl Plan {
    /// `gather` is the settings' number of rays per texel; `most` the largest budget of one pass, and of all.
    pub(super) fn new(goals: Goals, gather: u32, most: [f64; 2]) -> Self {
        let enough = if gather == 0 { 0.0 } else { LEAST_RAYS / f64::from(gather) };
        let [most, most_of_all] = [most[0], most[1].min(MOST_BUDGET)];
        Self { goals, trusted: FIRST.max(enough).min(1.0), most, most_of_all, done: vec![], reserve: 0.0 }
    }

    /// Budget of all passes.
    pub(super) fn total(&self) -> f64 {
        self.done.iter().fold(0.0, |sum, d| sum + d.budget)
    }

    /// Seconds that a pass may take, `elapsed` seconds after the start. The first may take what it needs.
    pub(super) fn left(&self, elapsed: f64) -> Option<f64> {
        self.goals.seconds.filter(|_| !self.done.is_empty()).map(|limit| limit - elapsed - self.reserve)
    }

    /// The next step.
    pub(super) fn next(&self, elapsed: f64) -> Step {
        let Some(last) = self.done.last() else { return Step::Pass(self.first()) };
        if self.goals == Goals::default() {
            return Step::End(End::Budget);
        }
        let (total, rest) = (self.total(), self.most_of_all - self.total());
        let wanted = match self.goals.error {
            Some(target) if last.error <= target && total >= self.trusted => return Step::End(End::Error),
            Some(target) if last.error <= target => self.trusted - total,
            Some(target) => total * ((last.error / (AIM * target)).powi(2) - 1.0),
            None => f64::INFINITY,
        };
        if rest < LEAST_STEP * total {
            return Step::End(End::Budget);
        }
        let wanted = wanted.max(LEAST_STEP * total).min(MOST_STEP * total).min(rest).min(self.most);
        let Some(left) = self.left(elapsed) else { return Step::Pass(wanted) };
        let slope = self.slope(last);
        let fixed = last.seconds - slope * last.budget;
        let affordable = (CAREFUL * left - fixed) / slope;
        let step = wanted.min(affordable);
        let least = wanted.min((LEAST_REST * total).max(self.first()));
        if step >= least {
            return Step::Pass(step);
        }
        let has_time = self.goals.seconds.is_some_and(|limit| left > NO_TIME * limit);
        let fits = HOPEFUL * (fixed + slope * least) <= left;
        if has_time && fits { Step::Pass(least) } else { Step::End(End::Time) }
    }

    /// Seconds per budget, besides those that any pass takes.
    fn slope(&self, last: &Done) -> f64 {
        let all = last.seconds.max(1e-6) / last.budget;
        match self.done.as_slice() {
            [.., before, _] if (last.budget / before.budget - 1.0).abs() > 0.25 => {
                ((last.seconds - before.seconds) / (last.budget - before.budget)).clamp(0.5 * GROWING * all, all)
            }
            _ => GROWING * all,
        }
    }

    fn first(&self) -> f64 {
        match self.goals {
            Goals { error: None, seconds: None } => 1.0,
            Goals { seconds: None, .. } => self.trusted,
            Goals { .. } => self.trusted * FIRST_IN_HASTE,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Passes until the end, where a unit of budget takes a second and has this error; the reason, total and seconds.
    fn play(goals: Goals, unit_error: f64, overhead: f64) -> (End, f64, f64, usize) {
        play_with(goals, unit_error, |budget, _| budget + overhead)
    }

    /// The same where a pass takes so many seconds, by its budget and number. One that takes too long is lost.
    fn play_with(goals: Goals, unit_error: f64, seconds: impl Fn(f64, usize) -> f64) -> (End, f64, f64, usize) {
        let mut plan = Plan::new(goals, 128, [64.0, 1e9]);
        let mut elapsed = 0.0;
        for passes in 0..100 {
            match plan.next(elapsed) {
                Step::End(end) => return (end, plan.total(), elapsed, passes),
                Step::Pass(budget) => {
                    let seconds = seconds(budget, passes);
                    if let Some(left) = plan.left(elapsed).filter(|left| seconds > *left) {
                        return (End::Time, plan.total(), elapsed + left, passes);
                    }
                    elapsed += seconds;
                    let error = unit_error / (plan.total() + budget).sqrt();
                    plan.done.push(Done { budget, error, seconds });
                }
            }
        }
        panic!("no end: {plan:?}");
    }

    #[test]
    fn without_a_goal_there_is_one_pass() {
        assert_eq!(play(Goals::default(), 0.1, 0.0), (End::Budget, 1.0, 1.0, 1));
    }

    #[test]
    fn a_target_is_met_with_little_more_than_it_needs() {
        for unit_error in [0.011, 0.03, 0.06, 0.2] {
            let (end, total, _, passes) = play(Goals { error: Some(0.02), seconds: None }, unit_error, 0.1);
            let needed = (unit_error / 0.02f64).powi(2);
            assert_eq!(end, End::Error);
            assert!(total >= needed && total <= (1.2 * needed).max(0.25), "{unit_error}: {total} for {needed}");
            assert!(passes <= 4, "{unit_error}: {passes}");
        }
    }

    #[test]
    fn an_impossible_target_ends_at_the_budget() {
        let (end, total, _, passes) = play(Goals { error: Some(1e-9), seconds: None }, 0.02, 0.1);
        assert_eq!(end, End::Budget);
        assert!(total <= MOST_BUDGET && total > 0.8 * MOST_BUDGET, "{total}");
        assert!(passes < 10, "{passes}");
    }

    #[test]
    fn time_is_used_but_not_overrun() {
        for (limit, overhead) in [(3.0, 0.0), (10.0, 0.01), (100.0, 1.0)] {
            let (end, _, elapsed, passes) = play(Goals { error: None, seconds: Some(limit) }, 0.02, overhead);
            assert_eq!(end, End::Time);
            assert!(elapsed <= limit && elapsed > 0.9 * limit, "{elapsed} of {limit}");
            assert!(passes < 12, "{passes}");
        }
    }

    #[test]
    fn little_time_is_left_over_where_the_first_pass_is_slow() {
        for limit in [2.2, 3.0, 6.0, 20.0] {
            for (once, each) in [(0.0, 0.1), (0.65, 0.3), (0.3, 0.3), (1.0, 0.05), (0.5, 0.5)] {
                let seconds = |budget: f64, pass: usize| budget + each + if pass == 0 { once } else { 0.0 };
                let goals = Goals { error: None, seconds: Some(limit) };
                let (end, _, elapsed, passes) = play_with(goals, 0.02, seconds);
                assert_eq!(end, End::Time);
                assert!(elapsed <= limit && elapsed > 0.8 * limit, "{once}, {each}: {elapsed} of {limit}");
                assert!(passes > 1 && passes < 12, "{once}, {each}: {passes}");
            }
        }
    }

    #[test]
    fn whichever_comes_first() {
        let both = |error, seconds| play(Goals { error: Some(error), seconds: Some(seconds) }, 0.02, 0.01);
        assert_eq!(both(0.01, 100.0).0, End::Error);
        assert_eq!(both(0.001, 10.0).0, End::Time);
        // A first pass in haste that looks good enough is not trusted.
        assert!(both(1.0, 100.0).1 >= 0.25);
    }
}
