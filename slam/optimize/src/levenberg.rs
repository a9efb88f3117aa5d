//! Damping of Levenberg and Marquardt's method, updated by the gain ratio (Nielsen 1999).

use slam_math::float;

/// Smallest damping: keeps a direction without information from making the system singular.
const MIN_LAMBDA: f64 = 1e-8;
/// Smallest scale of a damped diagonal: the information of one unit in a thousand, so that even a variable that nothing
/// observes stays put instead of breaking the factorisation.
const MIN_SCALE: f64 = 1e-6;

/// The factor lambda on the diagonal.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Damping {
    pub lambda: f64,
    growth: f64,
}

/// What to do after a trial step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Verdict {
    /// Take the step and go on.
    Accept,
    /// Take the step; the cost no longer changes.
    AcceptAndStop,
    /// Leave it and damp more.
    Reject,
    /// Leave it; not even the model promises a change.
    RejectAndStop,
}

impl Verdict {
    pub fn accepts(self) -> bool {
        matches!(self, Self::Accept | Self::AcceptAndStop)
    }

    pub fn stops(self) -> bool {
        matches!(self, Self::AcceptAndStop | Self::RejectAndStop)
    }
}

impl Damping {
    pub fn new(lambda: f64) -> Self {
        Self { lambda: float::max(lambda, MIN_LAMBDA), growth: 2.0 }
    }

    /// What is added to a diagonal entry.
    pub fn of(&self, diagonal: f64) -> f64 {
        self.lambda * float::max(diagonal, MIN_SCALE)
    }

    /// The system could not be solved.
    pub fn raise(&mut self) {
        self.lambda *= self.growth;
        self.growth *= 2.0;
    }

    /// Judges a step from `cost` to `trial_cost` where the model promised a decrease of `predicted`. The search stops
    /// when the decrease is below `relative` times the cost.
    pub fn judge(&mut self, cost: f64, trial_cost: f64, predicted: f64, relative: f64) -> Verdict {
        let decrease = cost - trial_cost;
        if !(decrease > 0.0 && predicted > 0.0) {
            self.raise();
            return if predicted <= relative * cost { Verdict::RejectAndStop } else { Verdict::Reject };
        }
        let s = 2.0 * decrease / predicted - 1.0;
        self.lambda = float::max(self.lambda * float::max(1.0 / 3.0, 1.0 - s * s * s), MIN_LAMBDA);
        self.growth = 2.0;
        if decrease <= relative * cost { Verdict::AcceptAndStop } else { Verdict::Accept }
    }
}

/// A step that was worked out but not yet taken.
pub(crate) struct Trial<S> {
    pub state: S,
    pub cost: f64,
    /// Decrease of the cost that the linear model promised.
    pub predicted: f64,
}

/// Budget of [`minimize`].
#[derive(Debug, Clone, Copy)]
pub(crate) struct Budget {
    /// Most linear solves, accepted or not.
    pub iterations: u32,
    /// The search stops when the cost decreases by less than this share of itself.
    pub relative_decrease: f64,
    pub initial_damping: f64,
}

/// What [`minimize`] did.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Outcome {
    pub initial_cost: f64,
    pub final_cost: f64,
    pub iterations: u32,
    pub accepted: u32,
    pub converged: bool,
}

/// Levenberg and Marquardt's iteration: `linearize` a state, `solve` the damped system for a trial (`None` when it can't
/// be solved), take or leave it.
pub(crate) fn minimize<S, L>(
    state: &mut S,
    initial_cost: f64,
    budget: Budget,
    mut linearize: impl FnMut(&S) -> L,
    mut solve: impl FnMut(&S, &L, &Damping) -> Option<Trial<S>>,
) -> Outcome {
    let mut damping = Damping::new(budget.initial_damping);
    let mut outcome = Outcome { initial_cost, final_cost: initial_cost, iterations: 0, accepted: 0, converged: false };
    let mut linear = linearize(state);
    while outcome.iterations < budget.iterations {
        outcome.iterations += 1;
        let Some(trial) = solve(state, &linear, &damping) else {
            damping.raise();
            continue;
        };
        let verdict = damping.judge(outcome.final_cost, trial.cost, trial.predicted, budget.relative_decrease);
        if verdict.accepts() {
            outcome.accepted += 1;
            outcome.final_cost = trial.cost;
            *state = trial.state;
        }
        if verdict.stops() {
            outcome.converged = true;
            break;
        }
        if verdict.accepts() && outcome.iterations < budget.iterations {
            linear = linearize(state);
        }
    }
    outcome
}
