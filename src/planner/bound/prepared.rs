//! A problem in the bounds' terms, and the search for the lowest threshold that a budget shows.

use nalgebra::Vector3;

use super::budget::{Bound, Budget};
use super::cell::Region;
use super::decoupled;
use super::law::Law;
use super::link::Links;
use super::steady::{self, Outcome};
use super::view;
use crate::planner::plan::BoundKind;
use crate::planner::problem::{JitterAxes, JitterModel, Problem};
use crate::planner::{Options, plan_slot};
use crate::radio::jitter::is_present;
use crate::radio::link::NEAREST_M;

/// Each threshold tried leaves this share of the gap of the one before.
const GAP_RATIO: f64 = 0.6;
/// How near the bound without jitter comes to the optimum without jitter.
const STEADY_GAP: f64 = 1e-3;
/// Points of the rule for I's means.
pub(super) const POINTS: usize = 768;
/// The first gap tried under jitter, over the one wanted.
const WIDE: f64 = 16.0;
/// Shares of the boxes left for one gap: the first and those by halves, the one wanted, and those between two gaps.
const FIRST_SHARE: f64 = 0.4;
const LAST_SHARE: f64 = 0.7;
const SHARE: f64 = 0.5;
/// Gaps this near to one another need no third between them.
const CLOSE: f64 = 1.1;
/// A budget's last part that is not worth another threshold.
const LEAST_PART: usize = 50;
/// Eavesdroppers among which a pair is looked for, and the starts of the planner for each pair.
const NEAREST: usize = 6;
const PAIR_STARTS: usize = 12;
/// Relative to the cap, bounds below this are not looked for.
const LEAST_SHARE: f64 = 1e-3;

/// The problem in the bound's terms.
pub(super) struct Prepared {
    pub links: Links,
    pub region: Region,
    /// Where the decoupled bound applies.
    pub law: Option<Law>,
    /// The eavesdroppers that the decoupled bound heeds.
    heeded: Vec<usize>,
    /// What branch and bound over the positions bounds.
    pub steady_kind: BoundKind,
    /// What the decoupled bound bounds.
    pub decoupled_kind: BoundKind,
    jitters: bool,
}

impl Prepared {
    /// `None` where neither branch and bound holds: over uncertain positions the mean may exceed every rate at the
    /// estimates.
    pub fn new(problem: &Problem) -> Option<Self> {
        // Measured patterns and errors of poses are in none of the derivations.
        if problem.errs() || problem.eavesdroppers.iter().any(|e| e.uncertainty.is_present()) {
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
        let leaks = links.scatters || links.user.j.mean.flat > 0.0;
        let covered = apart && if jitters { euler && !problem.free_yaw } else { leaks };
        let [steady_kind, decoupled_kind] = match (links.scatters, jitters) {
            (true, _) => [BoundKind::BranchAndBoundSigned, BoundKind::DecoupledSigned],
            (false, true) => [BoundKind::WithoutJitter, BoundKind::Decoupled],
            (false, false) => [BoundKind::BranchAndBound, BoundKind::Decoupled],
        };
        Some(Self {
            heeded: if covered { decisive(problem, &links) } else { Vec::new() },
            links,
            region,
            law: covered.then(|| if jitters { Law::new(jitter.std_rad, POINTS) } else { Law::new(0.0, 1) }),
            steady_kind,
            decoupled_kind,
            jitters,
        })
    }

    /// Ever closer to the lower bound, by a fixed ratio of gaps; under jitter to the optimum without it, which lies half a
    /// percent below the cap, whatever gap is wanted. A refutation raises the lower bound: under jitter, or
    /// past a tilt limit, this bound ends at the optimum without them.
    pub fn lower_steady(&self, bandwidth_hz: f64, lower_bps: f64, budget: &Budget, bound: &mut Bound) {
        let mut search = steady::Search::new(&self.links, &self.region, budget);
        let mut lower_bps = lower_bps;
        let gap = if self.jitters { budget.relative_gap.min(STEADY_GAP) } else { budget.relative_gap };
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

    /// A wide gap first, which costs little and tabulates much that the others need; then narrower ones, and between the least
    /// that was shown and the largest that was not: whenever the boxes end, what was shown last is the bound.
    pub fn lower_decoupled(&self, bandwidth_hz: f64, lower_bps: f64, budget: &Budget, bound: &mut Bound) {
        let Some(mut search) = self.search(budget) else { return };
        let wanted = budget.relative_gap.max(1e-6);
        let mut left = budget.boxes;
        // A gap, by this share of what is left of the budget.
        let mut shows = |gap: f64, share: f64| {
            let threshold_bps = lower_bps * (1.0 + gap);
            if bound.upper_bound_bps <= threshold_bps {
                return (true, left);
            }
            let boxes = (left as f64 * share) as usize;
            let before = search.used();
            let outcome = search.run(threshold_bps / bandwidth_hz, before + boxes);
            let used = search.used() - before;
            bound.boxes_used += used;
            left = left.saturating_sub(used);
            let shown = outcome == Outcome::Excluded;
            if shown {
                bound.upper_bound_bps = threshold_bps;
                bound.kind = self.decoupled_kind;
            }
            (shown, left)
        };
        if lower_bps > 0.0 {
            narrow(wanted, budget.boxes / LEAST_PART, &mut shows);
        }
    }

    /// The decoupled bound by the eavesdroppers that count; none where it does not apply.
    pub fn search(&self, budget: &Budget) -> Option<decoupled::Search<'_>> {
        let law = self.law.as_ref()?;
        let heeded = self.heeded.iter().map(|&k| self.links.eavesdroppers[k]).collect();
        Some(decoupled::Search::new(&self.links, &self.region, law, heeded, budget.resolution_m))
    }
}

/// Tries gaps by `shows`, which takes a gap and a share of the boxes left and says whether the gap was shown and what is left
/// then: wider ones until one is shown, narrower ones by halves until one is not, then between the two. Ends at the gap
/// wanted, or where a third between the two gains little, or with fewer boxes left than `least`.
fn narrow(wanted: f64, least: usize, shows: &mut impl FnMut(f64, f64) -> (bool, usize)) {
    let (mut gap, mut failed) = (WIDE * wanted, 0.0);
    let (mut shown, mut left) = shows(gap, FIRST_SHARE);
    while !shown && left > least {
        failed = gap;
        gap *= 2.0;
        (shown, left) = shows(gap, SHARE);
    }
    while shown && failed == 0.0 && gap > wanted {
        let next = (0.5 * gap).max(wanted);
        (shown, left) = shows(next, if next > wanted { FIRST_SHARE } else { LAST_SHARE });
        if shown {
            gap = next;
        } else {
            failed = next;
        }
    }
    while gap > (failed * CLOSE).max(wanted) && left > least {
        let middle = (gap * failed).sqrt();
        (shown, left) = shows(middle, SHARE);
        if shown {
            gap = middle;
        } else {
            failed = middle;
        }
    }
}

/// The eavesdroppers to heed: all, where those are few, or else, of the nearest to the user, the two against which the planner does
/// worst alone. A guide: every choice is as sound.
fn decisive(problem: &Problem, links: &Links) -> Vec<usize> {
    let mut nearest: Vec<usize> = (0..links.eavesdroppers.len()).collect();
    let distance = |k: &usize| links.eavesdroppers[*k].norm_squared();
    nearest.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
    if nearest.len() <= view::MOST {
        return nearest;
    }
    nearest.truncate(NEAREST);
    let options = Options { starts: Some(PAIR_STARTS), score_samples: 512, ..Options::default() };
    let rate = |pair: [usize; 2]| {
        let eavesdroppers = pair.map(|k| problem.eavesdroppers[k]).to_vec();
        let alone = Problem { eavesdroppers, ..problem.clone() };
        plan_slot(&alone, &options).map_or(f64::INFINITY, |plan| plan.secrecy_rate_bps)
    };
    let pairs = nearest.iter().enumerate().flat_map(|(k, &a)| nearest[k + 1..].iter().map(move |&b| [a, b]));
    let rated = pairs.map(|pair| (rate(pair), pair));
    rated.min_by(|a, b| a.0.total_cmp(&b.0)).map_or_else(Vec::new, |(_, pair)| pair.to_vec())
}
