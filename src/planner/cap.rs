//! The cap: what no configuration can exceed.

use super::error::PlanError;
use super::problem::Problem;
use super::setup::Setup;

/// Upper bound on the secrecy rate in bit/s: the user at the least distance in the plane of maximum gain, J silent, every
/// eavesdropper deaf.
///
/// Without jitter a tilt limit t of I counts: at horizontal distance r and height h below or above I the gain is at most
/// `sin^2(min(b + t, 90 deg))`, tan b = r/h, and gain over distance squared falls with h; over r it is largest at
/// `b = 45 deg - t/2`. Under jitter the limit does not hold for the gain, which is then at most one.
///
/// Valid for every model of jitter and of uncertain positions and for every objective, since `R <= B log2(1 + Gamma_0)` at
/// every draw. Distances are rounded down and the rate up: no configuration exceeds it in floating point either.
///
/// # Errors
/// [`PlanError`] for a problem without meaning.
pub fn cap(problem: &Problem) -> Result<f64, PlanError> {
    Ok(cap_bps(&Setup::new(problem)?))
}

pub(super) fn cap_bps(setup: &Setup) -> f64 {
    let problem = setup.problem;
    let user = problem.user_enu_m;
    let [low, high] = problem.airspace.altitude_m;
    // Coordinates are rounded to within their own last places, and so are the distances between them.
    let slack =
        ROUNDING * (user.amax() + setup.region.polygon().farthest_m(user.xy()) + low.abs().max(high.abs()));
    let height = ((user.z.clamp(low, high) - user.z).abs() - slack).max(0.0);
    let nearest = ((setup.region.nearest(user.xy()) - user.xy()).norm() - slack).max(0.0);
    let tilt = setup.tilt_rad[0];
    let amplitude = if setup.jitters() || tilt >= std::f64::consts::FRAC_PI_2 {
        1.0 / nearest.hypot(height)
    } else {
        let best = height * (std::f64::consts::FRAC_PI_4 - tilt / 2.0).tan();
        let distance = nearest.max(best);
        let angle = distance.atan2(height) + tilt;
        angle.min(std::f64::consts::FRAC_PI_2).sin() / distance.hypot(height)
    };
    let amplitude = amplitude.min(1.0 / crate::radio::link::NEAREST_M);
    let budget = setup.scene.budget_m2_w * problem.radio.max_power_w.i;
    problem.radio.bandwidth_hz * (budget * amplitude * amplitude).ln_1p() / std::f64::consts::LN_2
        * (1.0 + 1e-14)
}

/// A few units in the last place, relative.
const ROUNDING: f64 = 2e-15;
