//! What the planner answers.

use crate::geo::Pose;
use crate::role::PerVehicle;

/// One vehicle's part of a slot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VehiclePlan {
    /// Where it hovers and how it is turned.
    pub pose: Pose,
    /// Transmit power in W while it radiates.
    pub tx_power_w: f64,
}

/// One slot's plan.
#[derive(Debug, Clone, PartialEq)]
pub struct SlotPlan {
    /// How the search ended.
    pub status: Status,
    /// Both vehicles' poses and powers.
    pub vehicles: PerVehicle<VehiclePlan>,
    /// `E[R]` with `[.]^+` inside, bit/s, under the problem's jitter and position uncertainty.
    pub secrecy_rate_bps: f64,
    /// Standard error of `secrecy_rate_bps` as an estimate, bit/s.
    pub standard_error_bps: f64,
    /// What was maximised, bit/s: `secrecy_rate_bps` itself, or over uncertain positions the rate at the estimates, the 5%
    /// quantile or the worst case, as the problem's objective says.
    pub objective_bps: f64,
    /// Upper bound on the optimum, bit/s.
    pub upper_bound_bps: f64,
    /// What `upper_bound_bps` bounds and how firmly.
    pub upper_bound_kind: BoundKind,
    /// SINR of the user at the desired attitude, linear.
    pub user_sinr: f64,
    /// SINR of each eavesdropper at the desired attitude and estimated position, linear.
    pub eavesdropper_sinr: Vec<f64>,
}

/// How a search ended. The best point is carried either way.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Status {
    /// Not searched: given poses and powers, scored.
    Evaluated,
    /// The local solver met its tolerance at the best point.
    Converged,
    /// The iteration budget ended first.
    IterationLimit,
    /// No configuration has a positive secrecy rate: both transmitters are best left off.
    NoPositiveRate,
}

/// What an upper bound bounds and how firmly. `planner::bound` derives each.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BoundKind {
    /// The cap: user at the least distance in the plane of maximum gain, eavesdroppers deaf. Proven for every problem.
    Cap,
    /// Branch and bound over both positions, without jitter. Proven, rounding included; tilt limits are relaxed.
    BranchAndBound,
    /// The same for a problem with jitter, of any law, whose noise is left out. Proven, and loose.
    WithoutJitter,
    /// The decoupled bound under jitter, as firm as the margins of its quadrature.
    Decoupled,
    /// The same with scattered waves, on the mean of the signed rate, `[.]^+` left out.
    DecoupledSigned,
    /// Branch and bound over both positions with scattered waves, any jitter left out, on the mean of the signed rate.
    BranchAndBoundSigned,
}

impl BoundKind {
    /// Its name in documents.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Cap => "cap",
            Self::BranchAndBound => "branch-and-bound",
            Self::WithoutJitter => "without-jitter",
            Self::Decoupled => "decoupled",
            Self::BranchAndBoundSigned => "branch-and-bound-signed",
            Self::DecoupledSigned => "decoupled-signed",
        }
    }
}
