//! What a bound may cost, and what it is.

use crate::planner::plan::BoundKind;
use crate::planner::problem::Problem;
use crate::radio::jitter::is_present;

/// Boxes of branch and bound over the positions for one where nulls are blurred: an eighth of its time.
const STEADY_BOXES: usize = 6;

/// What a bound may cost and when it is good enough.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Budget {
    /// Boxes to examine at most. About a microsecond each without jitter, some fifty with.
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
    /// Three to fifteen seconds where nulls are blurred, by jitter or by what comes in beside them: 2% at two degrees, and two
    /// eavesdroppers, in three of four.
    pub const JITTER: Self = Self { boxes: 200_000, relative_gap: 2e-2, ..Self::STEADY };
}

impl Budget {
    /// [`Budget::STEADY`] or [`Budget::JITTER`], as the problem has it.
    #[must_use]
    pub fn of(problem: &Problem) -> Self {
        if blurs(problem) { Self::JITTER } else { Self::STEADY }
    }

    /// Of branch and bound over the positions, where no other bound of this problem is to be had.
    pub(super) fn steady(self, problem: &Problem) -> Self {
        let boxes = if blurs(problem) { self.boxes.saturating_mul(STEADY_BOXES) } else { self.boxes };
        Self { boxes, ..self }
    }
}

/// Whether nulls are blurred, by jitter or by what comes in beside them.
fn blurs(problem: &Problem) -> bool {
    is_present(&problem.jitter) || !problem.has_ideal_link()
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
