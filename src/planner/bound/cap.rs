//! The cap: what no configuration can beat.

use super::cell::Region;
use crate::planner::problem::Problem;

/// The cap of a problem in bit/s: user at the least distance a vehicle may have to it, in the plane of maximum
/// gain, at full power, eavesdroppers deaf and jammer silent:
///
/// `B log2(1 + b0 P_I,max / (s^2 d_min^2))`, `d_min` the distance from the user to the airspace.
///
/// Valid for every model of jitter and of uncertainty and every limit on tilt, since `R <= B log2(1 + Gamma_0)`
/// pointwise. Infinite if the noise is zero or the user lies in the airspace; 0 for an empty airspace or no power.
#[must_use]
pub fn cap(problem: &Problem) -> f64 {
    problem.radio.bandwidth_hz * efficiency(problem)
}

/// The cap in bit/s/Hz.
pub(super) fn efficiency(problem: &Problem) -> f64 {
    let Some(region) = Region::new(&problem.airspace, &problem.user_enu_m) else { return 0.0 };
    let power_w = problem.radio.reference_gain * problem.radio.max_power_w.i;
    if !(power_w > 0.0) {
        return 0.0;
    }
    let floor_w = problem.radio.noise_power_w * region.least_distance().powi(2);
    // Outward: the region's own slack, and a few units of the last place for the rest.
    if floor_w > 0.0 {
        (power_w / floor_w).ln_1p() / std::f64::consts::LN_2 * (1.0 + 1e-14)
    } else {
        f64::INFINITY
    }
}
