//! Chooses both poses and both transmit powers of a slot.
//!
//! [`plan_slot`] answers a [`problem::Problem`] by one of the methods of [`problem::Method`], [`plan_slot_near`] with
//! nearly equal answers to choose among; [`evaluate`] scores any
//! poses and powers; [`cap`] bounds every answer. Deterministic in problem and options, whatever the number of threads;
//! iterations are budgeted and no clock is read.

// Kernels index several arrays in step, and `!(a > b)` is how NaN is refused.
#![allow(clippy::needless_range_loop, clippy::neg_cmp_op_on_partial_ord)]

pub mod assessment;
pub mod baseline;
pub mod bound;
mod cap;
pub mod document;
mod draws;
mod error;
pub mod expectation;
pub mod explanation;
pub mod following;
mod model;
pub mod moving;
pub(crate) mod parallel;
pub mod phase1;
pub mod phase2;
pub mod plan;
mod powers;
pub mod problem;
pub(crate) mod region;
mod robust;
mod search;
mod setup;
pub mod slots;
mod solver;
mod starts;
pub mod track;
pub mod turning;
mod variables;
pub mod volume;
mod worst;

pub use cap::cap;
pub use error::PlanError;
pub use expectation::{EvaluateOptions, Evaluation, evaluate};

use expectation::kernel::{POWER, Raw, VEHICLE};
use expectation::samples::Sequence;
use plan::{BoundKind, SlotPlan, Status};
use problem::{Method, PowerSteps, Problem};
use setup::Setup;

/// How to plan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// The method.
    pub method: Method,
    /// Seed of starts and samples.
    pub seed: u64,
    /// Threads; the plan does not depend on them.
    pub threads: usize,
    /// Starts of the local solver; `None` is the method's own number (1 for the paper's methods).
    pub starts: Option<usize>,
    /// Samples by which the plan's own rate is scored.
    pub score_samples: usize,
}

impl Default for Options {
    fn default() -> Self {
        Self { method: Method::Veilwing, seed: 0, threads: 1, starts: None, score_samples: 2048 }
    }
}

/// Plans one slot.
///
/// # Errors
/// [`PlanError`] for a problem without meaning. A search that ends early is no error: the plan's status says so.
pub fn plan_slot(problem: &Problem, options: &Options) -> Result<SlotPlan, PlanError> {
    let setup = Setup::new(problem)?;
    check_steps(problem, options)?;
    let found = match options.method {
        Method::Veilwing => search::best(&setup, options),
        method => baseline::plan(&setup, method, options),
    };
    Ok(finish(&setup, options, found))
}

/// Which plans beside the best one are good enough to choose among.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Near {
    /// Most plans in all.
    pub most: usize,
    /// How far the objective may lie below the best one's, as a part of it.
    pub tolerance: f64,
}

impl Default for Near {
    /// Four plans, a thousandth of the objective: what the search itself is trusted to.
    fn default() -> Self {
        Self { most: 4, tolerance: 1e-3 }
    }
}

/// Plans one slot several times over: the best plan, and other optima that are nearly as good, best first. All of them
/// were met on the way to the best one; the paper's methods look for no others.
///
/// # Errors
/// As [`plan_slot`].
pub fn plan_slot_near(problem: &Problem, options: &Options, near: Near) -> Result<Vec<SlotPlan>, PlanError> {
    let setup = Setup::new(problem)?;
    check_steps(problem, options)?;
    let near = Near { most: near.most.max(1), ..near };
    let found = match options.method {
        Method::Veilwing => search::near(&setup, options, near),
        method => vec![baseline::plan(&setup, method, options)],
    };
    Ok(found.into_iter().map(|found| finish(&setup, options, found)).collect())
}

/// Refuses what a method knows nothing of.
fn check_steps(problem: &Problem, options: &Options) -> Result<(), PlanError> {
    let steps = [&problem.power_steps.i, &problem.power_steps.j];
    if options.method != Method::Veilwing && steps.iter().any(|steps| **steps != PowerSteps::Any) {
        return Err(PlanError::PowerSteps);
    }
    Ok(())
}

/// A rate below this is rounding, not secrecy.
const LEAST_BIT_S_HZ: f64 = 1e-9;

/// A method's answer: the configuration, and whether its local solver met its tolerance there.
#[derive(Debug, Clone, Copy)]
struct Found {
    raw: Raw,
    converged: bool,
}

/// Samples by which an objective other than the mean is scored.
const OBJECTIVE_SAMPLES: usize = 65_536;

/// Scores a configuration and, where it has no positive rate, turns both transmitters off.
fn finish(setup: &Setup, options: &Options, found: Found) -> SlotPlan {
    let score = EvaluateOptions {
        samples: options.score_samples,
        seed: expectation::sobol::mix(options.seed, 0x5c0e),
        sequence: Sequence::Sobol,
    };
    let mut vehicles = setup.vehicles(&found.raw);
    let mut evaluation = expectation::score(setup, &vehicles, &score);
    let mut status = if found.converged { Status::Converged } else { Status::IterationLimit };
    if !(evaluation.secrecy_rate_bps > LEAST_BIT_S_HZ * setup.problem.radio.bandwidth_hz) {
        let mut silent = found.raw;
        silent[POWER] = 0.0;
        silent[VEHICLE + POWER] = 0.0;
        vehicles = setup.vehicles(&silent);
        evaluation = expectation::score(setup, &vehicles, &score);
        status = Status::NoPositiveRate;
    }
    let objective = EvaluateOptions { samples: OBJECTIVE_SAMPLES, ..score };
    let objective_bps = expectation::objective_bps(setup, &vehicles, evaluation.secrecy_rate_bps, &objective);
    SlotPlan {
        status,
        vehicles,
        objective_bps: objective_bps.unwrap_or(evaluation.secrecy_rate_bps),
        secrecy_rate_bps: evaluation.secrecy_rate_bps,
        standard_error_bps: evaluation.standard_error_bps,
        upper_bound_bps: cap::cap_bps(setup),
        upper_bound_kind: BoundKind::Cap,
        user_sinr: evaluation.user_sinr,
        eavesdropper_sinr: evaluation.eavesdropper_sinr,
    }
}
