//! How good can a plan be? Upper bounds on the secrecy rate that no configuration can exceed.
//!
//! # 1. The problem
//! Notation of MODEL and the paper: user at the origin, eavesdroppers `j`, vehicle I transmits and J jams. With
//! `rho_v = b0 Pmax_v / s^2` (m^2), `G = 1 - <u, Y>^2` the gain of axis `Y` towards `u`, `d` distances, `u_J` the
//! jammer's share of its power,
//!
//! `a_j = rho_I G_Ij / d_Ij^2`, `b_j = rho_J u_J G_Jj / d_Jj^2`, `A_j = log2(1 + a_j / (1 + b_j))`, `R = A_0 - max_j A_j`.
//!
//! `P_I = Pmax` without loss: `log2((1 + x a) / (1 + x c))` rises with `x` where it is positive. Sought: a number that
//! `R` (or `E[R]`) does not exceed for any admissible poses and powers. Every constraint of the field only shrinks the
//! admissible set: the geofence, the altitudes, separation and power caps are used, tilt limits and level airframes
//! are relaxed (ignored).
//!
//! The **cap** ([`cap()`]) is `R <= A_0 <= log2(1 + rho_I / d_min^2)`. It needs nothing else and is always valid.
//!
//! # 2. Without jitter: branch and bound over both positions ([`BoundKind::BranchAndBound`])
//! A threshold `T > 0` is certified by covering all pairs of positions with boxes, each excluded thus. Suppose a
//! configuration with `p_I`, `p_J` in the boxes has `R > T`.
//!
//! 1. *Interference budget.* `1 + b_0 = a_0 / Gamma_0 < rho_I / (d_0^2 (2^T - 1))`, so `b_0 <= k`; a negative `k` excludes.
//! 2. *Jamming.* As lines, `sin(Y_J, u_Jj) <= sin(u_J0, u_Jj) + sin(Y_J, u_J0)`, hence
//!    `sqrt(b_j) <= sqrt(rho_J) sin(u_J0, u_Jj) / d_Jj + sqrt(k) d_J0 / d_Jj`, and never above `sqrt(rho_J) / d_Jj`.
//!    By the law of sines `sin(u_J0, u_Jj) = L_j sin(alpha) / d_Jj`, `L_j` the distance from user to eavesdropper and
//!    `alpha` the angle at the user, which a box changes by at most its own half-angle. This gives `B_j >= b_j`.
//! 3. *Axis.* With `q_j = 1 / (1 + B_j)` some axis of I satisfies `2^T (1 + q_j a_j) < 1 + a_0` for every `j`: quadratic
//!    forms in `Y_I`. Over I's box: `a_0 <= rho_I / d_min^2 (1 - (|<Y, u>| - e)^2)` with `e` the largest change of the
//!    direction, and, since inversion about `e_j` moves `v_j = (e_j - p) / d_j^2` by `|p - c| / (d_j(p) d_j(c))`,
//!    `sqrt(a_j / rho_I) = |Y x v_j| >= |Y x v_j(c)| - r / (d_min d_c)`. The squares of the differences are bounded
//!    by forms, `(x - e)_+^2 >= (1 - t) x^2 - (1/t - 1) e^2` for every `t` in (0, 1].
//! 4. *Exclusion.* If a convex combination of forms `F_{j,t}` is positive definite, no axis satisfies all. Which
//!    `j` and `t` enter is decided by column generation at the least eigenvector (`form`). For `N <= 2` and a fixed
//!    `t` the answer is exact (Brickman's convexity theorem); for `N > 2` it is a relaxation with a gap of its own.
//!
//! Boxes not excluded are halved where the inequality at the resisting axis loses most. A true configuration at the
//! centres may refute the threshold. *Rounding*: distances, gains and the test of definiteness carry a relative
//! margin of 1e-11, a thousand times the rounding of the operations in between.
//!
//! The bound holds **under jitter too**, of any model, and with `[.]^+` inside: at each draw of the noise `R` is the
//! rate of an admissible configuration of the problem without noise (all axes are admitted, so noise past a tilt limit
//! is covered), and the mean does not exceed the supremum. It is then loose.
//!
//! # 3. With jitter: the decoupled bound ([`BoundKind::DecoupledSigned`])
//! Euler jitter of roll and pitch at yaw 0, independent on the two vehicles; two eavesdroppers (for more, any pair
//! bounds the whole: the least over pairs among the three nearest to the user). Bounded is the *signed* objective
//! `V = E[A_0 - max_j A_j]` at `P_I = Pmax`; with `[.]^+` inside the mean is larger by what the negative draws would
//! take off, about 0.003 bit/s/Hz at known plans, and no bound on that is proven here.
//!
//! 1. *User.* For fixed J, `A_0` is concave in `a_0`: `E A_0 <= log2(1 + E a_0) + log2(1 + x) - l`, `l = E log2(1 + b_0)`,
//!    `x = E b_0 / (1 + E a_0)`. If `V > T` then `x <= S / (2^T - S)` for `S >= E b_0 / 2^l`. `S = 4.5` is used; the
//!    ratio is `e^gamma` for a null under isotropic noise and `2 e^gamma = 3.56` for noise along one angle.
//! 2. *Jensen over J.* `A_j` is convex in `b_j` and the noises are independent:
//!    `E max_j A_j >= E_I max_j log2(1 + a_j 2^-s_j)`, `s_j = log2(1 + E b_j)`.
//! 3. *Interface.* `V <= max_s [F(s) - L(s)]` + the correction of 1: `F` over I's pose, `L(s)` the least `l` over J's pose
//!    and power with `E b_j >= 2^s_j - 1`. Both rise in every `s_j`.
//! 4. *J's side* (`jammer`). Given a pose the least power per area is `beta = max_j (2^s_j - 1) / k_j`,
//!    `k_j = (d_J0/d_Jj)^2 E G_Jj`. With the axis `t` off the exact null, `sqrt(E G_Jj) <= sqrt(sin^2 + 2.5 sigma^2) + t`, and
//!    `(d_J0/d_Jj) sin = |p x e_j| / d_Jj^2`. Over a box of positions `ln k_j` is bounded by its tangent at the centre
//!    plus half the largest curvature, and a maximum of two by every mean of both, so that boxes about a stationary
//!    point lose to second order only. `l` is least at the least `t` of a box.
//! 5. *Means over one vehicle's noise* (`law`). With roll and pitch as latitude and longitude,
//!    `sin^2(psi/2) = sin^2(x/2) + cos(roll) cos(roll_line) sin^2(y/2)`, `x`, `y` the differences with their noise. A
//!    symmetric unimodal function of an angle under symmetric unimodal noise has a mean that rises with the offset
//!    (Anderson): over a box the least offset counts, so that a box that holds a null loses nothing.
//! 6. *Floor.* Every axis has `psi_1 + psi_2 >=` the angle between the lines to both eavesdroppers, so
//!    `max_j A_j >= log2(1 + z)` pointwise: each mean is taken of `max(1 + c_j G_j, 1 + z)`, which keeps most of the maximum
//!    inside the expectation.
//! 7. *I's side and the interface* (`decoupled`). Boxes of I's pose times boxes of `s`. The means are convex in `s`: their
//!    tangents at the upper corner cover an interface box, which is compared with `L` on a grid, computed where it is
//!    asked for and kept.
//!
//! *Tolerances and what is not proven.* Means are taken by a rule of 96 points; two margins of 0.03 bit/s/Hz stand for
//! its error, twice the largest measured where the SINR at one standard deviation is at most 300. The unimodality of 5 holds exactly in the pitch offset; in
//! the roll offset it holds to the order of `sigma` times the tangent of the roll, and the least over directions in 4 is
//! taken over three. Rounding is far below these margins. The kind says so: a bound on the signed objective, as firm as
//! these margins.
//!
//! *Not covered*: body-axis jitter, yaw jitter and a free yaw (the bound of section 2 is given instead); the mean or a
//! quantile over uncertain positions (the cap); the worst case over discs is at most the rate at the estimated
//! positions, which is bounded.

// `!(a > b)` is how NaN is refused.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

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
use law::Law;
use link::Links;
use steady::Outcome;

use super::plan::BoundKind;
use super::problem::{JitterAxes, JitterModel, Objective, Problem, Uncertainty};
use crate::radio::jitter::is_present;

/// What a bound may cost and when it is good enough.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Budget {
    /// Boxes to examine at most. About a microsecond each without jitter, three with.
    pub boxes: usize,
    /// Stop once the bound is within this share of the lower bound, e.g. 1e-3.
    pub relative_gap: f64,
    /// Boxes are not split below this edge, metres.
    pub resolution_m: f64,
    /// Look on after a refutation, to the last box: for trials of soundness. Without jitter only.
    pub exhaustive: bool,
}

impl Budget {
    /// About a second without jitter: 0.1%.
    pub const STEADY: Self =
        Self { boxes: 800_000, relative_gap: 1e-3, resolution_m: 1e-3, exhaustive: false };
    /// About ten seconds under jitter: 2%.
    pub const JITTER: Self = Self { boxes: 3_000_000, relative_gap: 2e-2, ..Self::STEADY };
}

impl Default for Budget {
    fn default() -> Self {
        Self::STEADY
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
        /// In which sense.
        kind: BoundKind,
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
    /// A configuration beats it.
    Refuted {
        /// The secrecy rate found, bit/s.
        secrecy_rate_bps: f64,
    },
    /// A box of the smallest size resists: the threshold is within the method's resolution of what it can show.
    Resolution,
    /// The budget of boxes ended.
    Budget,
    /// The problem is not covered: see the module's documentation.
    NotCovered,
}

/// Whether no configuration of `problem` has a secrecy rate above `threshold_bps`, bit/s.
#[must_use]
pub fn certify(problem: &Problem, threshold_bps: f64, budget: Budget) -> Certificate {
    let bandwidth_hz = problem.radio.bandwidth_hz;
    if cap(problem) <= threshold_bps {
        return Certificate::Certified { kind: BoundKind::Cap, boxes_used: 0 };
    }
    let Some(prepared) = Prepared::new(problem).filter(|_| threshold_bps > 0.0) else {
        return Certificate::NotCertified { reason: Reason::NotCovered, boxes_used: 0 };
    };
    let threshold = threshold_bps / bandwidth_hz;
    let (outcome, kind, boxes_used) = if prepared.law.is_some() {
        let (outcome, boxes) = prepared.decoupled(threshold, &budget);
        (outcome, BoundKind::DecoupledSigned, boxes)
    } else {
        let mut search = steady::Search::new(&prepared.links, &prepared.region, &budget);
        (search.run(threshold), BoundKind::BranchAndBound, search.boxes)
    };
    let reason = match outcome {
        Outcome::Excluded => return Certificate::Certified { kind, boxes_used },
        // Under jitter a rate without it refutes nothing.
        Outcome::Refuted(_) if is_present(&problem.jitter) => Reason::Resolution,
        Outcome::Refuted(rate) => Reason::Refuted { secrecy_rate_bps: rate * bandwidth_hz },
        Outcome::Stuck => Reason::Resolution,
        Outcome::Exhausted => Reason::Budget,
    };
    Certificate::NotCertified { reason, boxes_used }
}

/// The best upper bound found within `budget`, given a rate known to be attained, bit/s (0 if none is).
///
/// Never above the cap. An infinite bound means that the problem has none: no noise, or the user in the airspace.
#[must_use]
pub fn best_bound(problem: &Problem, lower_bound_bps: f64, budget: Budget) -> Bound {
    let cap_bps = cap(problem);
    let mut bound = Bound { upper_bound_bps: cap_bps, kind: BoundKind::Cap, boxes_used: 0 };
    let Some(prepared) = Prepared::new(problem).filter(|_| cap_bps.is_finite()) else { return bound };
    let lower_bps = if lower_bound_bps > 0.0 { lower_bound_bps } else { 0.0 };
    if prepared.law.is_some() {
        prepared.lower_jittered(problem.radio.bandwidth_hz, lower_bps, &budget, &mut bound);
    } else {
        prepared.lower_steady(problem.radio.bandwidth_hz, lower_bps, &budget, &mut bound);
    }
    bound
}

/// Each threshold tried leaves this share of the gap of the one before.
const GAP_RATIO: f64 = 0.6;
/// Of the budget under jitter: for the gap wanted, and for each wider one if that fails.
const FIRST_SHARE: f64 = 0.75;
const LATER_SHARE: f64 = 0.05;
/// Relative to the cap, bounds below this are not looked for.
const LEAST_SHARE: f64 = 1e-3;

/// The problem in the bound's terms.
struct Prepared {
    links: Links,
    region: Region,
    /// Where the decoupled bound applies.
    law: Option<Law>,
}

impl Prepared {
    /// `None` where neither branch and bound holds.
    fn new(problem: &Problem) -> Option<Self> {
        // The mean or a quantile over positions may exceed any rate at the estimated ones; the worst case may not.
        let certain = problem.eavesdroppers.iter().all(|e| e.uncertainty == Uncertainty::None);
        if !certain && matches!(problem.objective, Objective::Mean | Objective::Quantile) {
            return None;
        }
        let jitter = &problem.jitter;
        let euler = jitter.model == JitterModel::Euler && jitter.axes == JitterAxes::RollPitch;
        let covered = euler && jitter.std_rad > 0.0 && jitter.std_rad.is_finite() && !problem.free_yaw;
        Some(Self {
            links: Links::new(problem)?,
            region: Region::new(&problem.airspace, &problem.user_enu_m)?,
            law: covered.then(|| Law::new(jitter.std_rad)),
        })
    }

    /// Ever closer to the lower bound, by a fixed ratio of gaps.
    fn lower_steady(&self, bandwidth_hz: f64, lower_bps: f64, budget: &Budget, bound: &mut Bound) {
        let mut search = steady::Search::new(&self.links, &self.region, budget);
        let least_bps = lower_bps * (1.0 + budget.relative_gap);
        let cap_bps = bound.upper_bound_bps;
        while bound.upper_bound_bps > least_bps * (1.0 + 1e-12) {
            let threshold_bps = (lower_bps + (bound.upper_bound_bps - lower_bps) * GAP_RATIO).max(least_bps);
            if threshold_bps < LEAST_SHARE * cap_bps
                || search.run(threshold_bps / bandwidth_hz) != Outcome::Excluded
            {
                break;
            }
            bound.upper_bound_bps = threshold_bps;
            bound.kind = BoundKind::BranchAndBound;
        }
        bound.boxes_used += search.boxes;
    }

    /// The gap wanted first, with most of the budget; then twice as wide each time, until one is shown.
    fn lower_jittered(&self, bandwidth_hz: f64, lower_bps: f64, budget: &Budget, bound: &mut Bound) {
        let mut gap = budget.relative_gap.max(1e-6);
        let mut share = FIRST_SHARE;
        while lower_bps * (1.0 + gap) < bound.upper_bound_bps && lower_bps > 0.0 {
            let threshold_bps = lower_bps * (1.0 + gap);
            let part = Budget { boxes: ((budget.boxes as f64) * share) as usize, ..*budget };
            let (outcome, boxes) = self.decoupled(threshold_bps / bandwidth_hz, &part);
            bound.boxes_used += boxes;
            if outcome == Outcome::Excluded {
                bound.upper_bound_bps = threshold_bps;
                bound.kind = BoundKind::DecoupledSigned;
                return;
            }
            gap *= 2.0;
            share = LATER_SHARE;
        }
        let part = Budget { boxes: budget.boxes / 10, ..*budget };
        self.lower_steady(bandwidth_hz, lower_bps, &part, bound);
    }

    /// One threshold by the decoupled bound: any pair of eavesdroppers may show it.
    fn decoupled(&self, threshold: f64, budget: &Budget) -> (Outcome, usize) {
        let Some(law) = &self.law else { return (Outcome::Stuck, 0) };
        let mut nearest = self.links.eavesdroppers.clone();
        nearest.sort_by(|a, b| a.norm_squared().total_cmp(&b.norm_squared()));
        let pairs: &[[usize; 2]] = match nearest.len() {
            1 => &[[0, 0]],
            2 => &[[0, 1]],
            _ => &[[0, 1], [0, 2], [1, 2]],
        };
        let (mut last, mut used) = (Outcome::Stuck, 0);
        for pair in pairs {
            let mut search = decoupled::Search::new(
                &self.links,
                &self.region,
                law,
                pair.map(|k| nearest[k]),
                budget.resolution_m,
            );
            last = search.run(threshold, budget.boxes / pairs.len());
            used += search.used();
            if last == Outcome::Excluded {
                break;
            }
        }
        (last, used)
    }
}

#[cfg(test)]
mod tests;
