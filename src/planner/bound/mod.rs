//! How good can a plan be? Upper bounds on the secrecy rate.
//! (text to come)

mod cap;
mod cell;
mod decoupled;
mod form;
mod jammer;
mod law;
mod link;
mod steady;

pub use cap::cap;

use cell::Region;
use link::Links;
use steady::{Outcome, Search};

use super::plan::BoundKind;
use super::problem::{Objective, Problem, Uncertainty};

/// What a bound may cost and when it is good enough.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Budget {
    /// Boxes to examine at most.
    pub boxes: usize,
    /// Stop once the bound is within this share of the lower bound, e.g. 1e-3.
    pub relative_gap: f64,
}

impl Default for Budget {
    /// About a second.
    fn default() -> Self {
        Self { boxes: 500_000, relative_gap: 1e-3 }
    }
}

/// An upper bound on the secrecy rate of a problem.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bound {
    /// The bound in bit/s.
    pub upper_bound_bps: f64,
    /// What it bounds and how firmly.
    pub kind: BoundKind,
    /// Boxes examined.
    pub boxes_used: usize,
}

/// The answer to "does any configuration beat this threshold?".
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Certificate {
    /// None does.
    Certified {
        /// Boxes examined.
        boxes_used: usize,
    },
    /// Not shown.
    NotCertified {
        /// Why not.
        reason: Reason,
        /// Boxes examined.
        boxes_used: usize,
    },
}

/// Why a threshold was not certified.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Reason {
    /// A configuration beats it; its secrecy rate in bit/s.
    Refuted {
        /// The rate found.
        secrecy_rate_bps: f64,
    },
    /// A box of the smallest size resists: the threshold is within the method's resolution of the optimum.
    Resolution,
    /// The budget of boxes ended.
    Budget,
    /// The problem is not covered: see the module's documentation.
    NotCovered,
}

/// Whether no configuration of `problem` has a secrecy rate above `threshold_bps`.
#[must_use]
pub fn certify(problem: &Problem, threshold_bps: f64, budget: Budget) -> Certificate {
    let not = |reason, boxes_used| Certificate::NotCertified { reason, boxes_used };
    if cap(problem) <= threshold_bps {
        return Certificate::Certified { boxes_used: 0 };
    }
    let Some((links, region)) = prepare(problem) else { return not(Reason::NotCovered, 0) };
    let threshold = threshold_bps / problem.radio.bandwidth_hz;
    if !(threshold > 0.0) {
        return not(Reason::NotCovered, 0);
    }
    let mut search = Search::new(&links, &region);
    let outcome = search.run(threshold, budget.boxes, None);
    match outcome {
        Outcome::Excluded => Certificate::Certified { boxes_used: search.boxes },
        Outcome::Refuted(rate) => {
            not(Reason::Refuted { secrecy_rate_bps: rate * problem.radio.bandwidth_hz }, search.boxes)
        }
        Outcome::Stuck => not(Reason::Resolution, search.boxes),
        Outcome::Exhausted => not(Reason::Budget, search.boxes),
    }
}

/// The best upper bound found within `budget`, given a rate known to be attained (0 if none is).
#[must_use]
pub fn best_bound(problem: &Problem, lower_bound_bps: f64, budget: Budget) -> Bound {
    let cap_bps = cap(problem);
    let mut bound = Bound { upper_bound_bps: cap_bps, kind: BoundKind::Cap, boxes_used: 0 };
    let Some((links, region)) = prepare(problem) else { return bound };
    if !cap_bps.is_finite() {
        return bound;
    }
    let bandwidth_hz = problem.radio.bandwidth_hz;
    let mut search = Search::new(&links, &region);
    let lower = lower_bound_bps.max(0.0);
    // Ever closer to the lower bound by a fixed ratio of gaps.
    while bound.upper_bound_bps > lower * (1.0 + budget.relative_gap) * (1.0 + 1e-12) {
        let gap = (bound.upper_bound_bps - lower) * GAP_RATIO;
        let threshold_bps = lower + gap.max(lower * budget.relative_gap);
        if !(threshold_bps > 1e-3 * cap_bps) {
            break;
        }
        match search.run(threshold_bps / bandwidth_hz, budget.boxes, None) {
            Outcome::Excluded => {
                bound.upper_bound_bps = threshold_bps;
                bound.kind = BoundKind::BranchAndBound;
            }
            _ => break,
        }
    }
    bound.boxes_used = search.boxes;
    bound
}

/// Each threshold tried leaves this share of the gap of the one before.
const GAP_RATIO: f64 = 0.6;

/// The problem in the bound's terms, where the branch and bound holds.
fn prepare(problem: &Problem) -> Option<(Links, Region)> {
    // The mean or a quantile over positions may exceed any rate at the estimated ones; the worst case may not.
    let certain = problem.eavesdroppers.iter().all(|e| e.uncertainty == Uncertainty::None);
    if !certain && matches!(problem.objective, Objective::Mean | Objective::Quantile) {
        return None;
    }
    Some((Links::new(problem)?, Region::new(&problem.airspace, &problem.user_enu_m)?))
}

/// Trial.
pub fn jitter_trial(problem: &Problem, lower_bound_bps: f64, budget: Budget, tolerance: f64) -> (f64, usize, usize) {
    let Some((links, region)) = prepare(problem) else { return (0.0, 0, 0) };
    let law = law::Law::new(problem.jitter.std_rad);
    let pair = [links.eavesdroppers[0], links.eavesdroppers[1]];
    let mut search = decoupled::Search::new(&links, &region, &law, pair, tolerance);
    let lower = lower_bound_bps / 1e6;
    let mut best = cap(problem) / 1e6;
    for gap in [0.2, 0.1, 0.06, 0.04, 0.03, 0.02] {
        let t = lower * (1.0 + gap);
        if t > best { continue; }
        let out = search.run(t, budget.boxes);
        if out != Outcome::Excluded { eprintln!("{gap} {out:?}"); break; }
        best = t;
    }
    eprintln!("L calls {} limited {} boxes {}", search.jammer.calls, search.jammer.limited, search.jammer.boxes);
    (best, search.boxes, search.used())
}
