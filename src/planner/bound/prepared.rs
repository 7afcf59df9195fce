//! A problem in the bounds' terms, and the search for the lowest threshold that a budget shows.

use nalgebra::Vector3;

use super::budget::{Bound, Budget};
use super::cell::Region;
use super::decoupled;
use super::law::Law;
use super::link::Links;
use super::steady::{self, Outcome};
use crate::planner::plan::BoundKind;
use crate::planner::problem::{JitterAxes, JitterModel, Problem};
use crate::radio::jitter::is_present;
use crate::radio::link::NEAREST_M;

/// Each threshold tried leaves this share of the gap of the one before.
const GAP_RATIO: f64 = 0.6;
/// How near the bound without jitter comes to the optimum without jitter.
const STEADY_GAP: f64 = 1e-3;
/// Points of the rule for I's means.
pub(super) const POINTS: usize = 768;
/// Relative to the cap, bounds below this are not looked for.
const LEAST_SHARE: f64 = 1e-3;

/// The problem in the bound's terms.
pub(super) struct Prepared {
    pub links: Links,
    pub region: Region,
    /// Where the decoupled bound applies.
    pub law: Option<Law>,
    /// What branch and bound over the positions bounds.
    pub steady_kind: BoundKind,
}

impl Prepared {
    /// `None` where neither branch and bound holds: over uncertain positions the mean may exceed every rate at the
    /// estimates.
    pub fn new(problem: &Problem) -> Option<Self> {
        // Floors, patterns, scattering and errors of poses are in none of the derivations.
        if !problem.has_ideal_link() || problem.eavesdroppers.iter().any(|e| e.uncertainty.is_present()) {
            return None;
        }
        let jitter = &problem.jitter;
        let euler = jitter.model == JitterModel::Euler && jitter.axes == JitterAxes::RollPitch;
        let jitters = is_present(jitter);
        let links = Links::new(problem)?;
        let region = Region::new(&problem.airspace, &problem.user_enu_m)?;
        // Nearer to a node the links are not those of the formulas.
        let apart = |node: &Vector3<f64>| region.bounds.least_distance_squared(node) > NEAREST_M * NEAREST_M;
        let apart = apart(&Vector3::zeros()) && links.eavesdroppers.iter().all(apart);
        let covered = euler && jitters && apart && !problem.free_yaw;
        Some(Self {
            links,
            region,
            law: covered.then(|| Law::new(jitter.std_rad, POINTS)),
            steady_kind: if jitters { BoundKind::WithoutJitter } else { BoundKind::BranchAndBound },
        })
    }

    /// Ever closer to the lower bound, by a fixed ratio of gaps; under jitter to the optimum without it, which lies half a
    /// percent below the cap, whatever gap is wanted. A refutation raises the lower bound: under jitter, or
    /// past a tilt limit, this bound ends at the optimum without them.
    pub fn lower_steady(&self, bandwidth_hz: f64, lower_bps: f64, budget: &Budget, bound: &mut Bound) {
        let mut search = steady::Search::new(&self.links, &self.region, budget);
        let mut lower_bps = lower_bps;
        let gap = if self.steady_kind == BoundKind::WithoutJitter {
            budget.relative_gap.min(STEADY_GAP)
        } else {
            budget.relative_gap
        };
        let cap_bps = bound.upper_bound_bps;
        loop {
            let least_bps = lower_bps * (1.0 + gap);
            let threshold_bps = (lower_bps + (bound.upper_bound_bps - lower_bps) * GAP_RATIO).max(least_bps);
            let close = bound.upper_bound_bps <= least_bps * (1.0 + 1e-12);
            if close || !(threshold_bps >= LEAST_SHARE * cap_bps) {
                break;
            }
            match search.run(threshold_bps / bandwidth_hz) {
                Outcome::Excluded => {
                    bound.upper_bound_bps = threshold_bps;
                    bound.kind = self.steady_kind;
                }
                Outcome::Refuted(rate) => lower_bps = lower_bps.max(rate * bandwidth_hz),
                // What cannot be shown here is looked for above.
                Outcome::Stuck => lower_bps = threshold_bps,
                Outcome::Exhausted => break,
            }
        }
        bound.boxes_used += search.boxes;
    }

    /// A wide gap first, which costs little and tabulates much that the others need; then the one wanted, with most of the
    /// budget, and if that fails what lies between; or wider ones.
    pub fn lower_jittered(&self, bandwidth_hz: f64, lower_bps: f64, budget: &Budget, bound: &mut Bound) {
        let mut searches = self.searches(budget);
        let gap = budget.relative_gap.max(1e-6);
        let mut left = budget.boxes;
        // So many times the gap wanted, by this share of what is left of the budget.
        let mut shows = |times: f64, share: f64| {
            let threshold_bps = lower_bps * (1.0 + times * gap);
            if bound.upper_bound_bps <= threshold_bps {
                return true;
            }
            let boxes = (left as f64 * share) as usize;
            let (outcome, used) = run(&mut searches, threshold_bps / bandwidth_hz, boxes);
            bound.boxes_used += used;
            left = left.saturating_sub(used);
            let shown = outcome == Outcome::Excluded;
            if shown {
                bound.upper_bound_bps = threshold_bps;
                bound.kind = BoundKind::DecoupledSigned;
            }
            shown
        };
        let _ = lower_bps > 0.0
            && if shows(8.0, 0.3) {
                shows(1.0, 0.7) || shows(4.0, 0.5) && shows(2.0, 1.0)
            } else {
                shows(16.0, 0.4) || shows(32.0, 0.6) || shows(64.0, 1.0)
            };
        if bound.kind == BoundKind::DecoupledSigned {
            return;
        }
        let part = Budget { boxes: budget.boxes / 10, ..*budget };
        self.lower_steady(bandwidth_hz, lower_bps, &part, bound);
    }

    /// The decoupled bound by pairs of eavesdroppers; none where it does not apply.
    pub fn searches(&self, budget: &Budget) -> Vec<decoupled::Search<'_>> {
        let Some(law) = &self.law else { return Vec::new() };
        let mut nearest = self.links.eavesdroppers.clone();
        nearest.sort_by(|a, b| a.norm_squared().total_cmp(&b.norm_squared()));
        let pairs: &[[usize; 2]] = match nearest.len() {
            1 => &[[0, 0]],
            2 => &[[0, 1]],
            _ => &[[0, 1], [0, 2], [1, 2]],
        };
        let search = |pair: &[usize; 2]| {
            let pair = pair.map(|k| nearest[k]);
            decoupled::Search::new(&self.links, &self.region, law, pair, budget.resolution_m)
        };
        pairs.iter().map(search).collect()
    }
}

/// One threshold by the decoupled bound: any pair of eavesdroppers may show it. The outcome and the boxes used.
pub(super) fn run(searches: &mut [decoupled::Search], threshold: f64, boxes: usize) -> (Outcome, usize) {
    let (mut last, mut used) = (Outcome::Stuck, 0);
    let share = boxes / searches.len().max(1);
    for search in searches {
        let before = search.used();
        last = search.run(threshold, before + share);
        used += search.used() - before;
        if last == Outcome::Excluded {
            break;
        }
    }
    (last, used)
}
