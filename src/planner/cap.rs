//! The cap: what no configuration can exceed.

use super::error::PlanError;
use super::problem::{Problem, Uncertainty};
use super::setup::Setup;
use crate::radio::link::NEAREST_M;

/// Upper bound on the secrecy rate in bit/s: the user at the least distance in the plane of maximum gain, J silent, every
/// eavesdropper deaf.
///
/// Without jitter a tilt limit t of I counts: at horizontal distance r and height h below or above I the gain is at most
/// `sin^2(min(b + t, 90 deg))`, tan b = r/h, and gain over distance squared falls with h; over r it is largest at
/// `b = 45 deg - t/2`. Under jitter the limit does not hold for the gain, which is then at most one.
///
/// Valid for every model of jitter and of uncertain eavesdroppers and for every objective, since `R <= B log2(1 + Gamma_0)`
/// at every draw. So it is with floors and measured patterns, whose gain is at most one, and with a user anywhere in a disc.
/// Where something is scattered it bounds the mean over that: the mean power received is at most that of a gain of one,
/// and the logarithm is concave. Where the user or the vehicles are off by Gaussian errors it bounds the mean over these:
/// within so many deviations the user is only so much nearer, and beyond, with the probability of that, at the least
/// distance of the far field. Distances are rounded down and the rate up: no configuration exceeds it in floating point
/// either.
///
/// # Errors
/// [`PlanError`] for a problem without meaning.
pub fn cap(problem: &Problem) -> Result<f64, PlanError> {
    Ok(cap_bps(&Setup::new(problem)?))
}

pub(super) fn cap_bps(setup: &Setup) -> f64 {
    let problem = setup.problem;
    let [horizontal_m, vertical_m] = problem.pointing.position_std_m;
    let (disc_m, user_std_m) = match problem.user_uncertainty {
        Uncertainty::None => (0.0, 0.0),
        Uncertainty::Disc { radius_m } => (radius_m, 0.0),
        Uncertainty::Gaussian { std_m } => (0.0, std_m),
    };
    let horizontal_m = horizontal_m.hypot(user_std_m);
    let nats = if horizontal_m == 0.0 && vertical_m == 0.0 {
        nearest_nats(setup, disc_m, 0.0)
    } else {
        // A plane's Gaussian is beyond c deviations with probability exp(-c^2 / 2), a line's with less.
        let farthest = budget_m2(setup) / (NEAREST_M * NEAREST_M);
        DEVIATIONS
            .map(|c| {
                let beyond = 2.0 * (-c * c / 2.0).exp();
                nearest_nats(setup, disc_m + c * horizontal_m, c * vertical_m) + beyond * farthest.ln_1p()
            })
            .into_iter()
            .fold(f64::INFINITY, f64::min)
    };
    problem.radio.bandwidth_hz * nats / std::f64::consts::LN_2 * (1.0 + 1e-14)
}

/// Deviations within which errors are taken to stay: the best of these counts.
const DEVIATIONS: [f64; 6] = [3.0, 4.0, 4.5, 5.0, 5.5, 6.0];

/// `b0 Pmax / s^2` of I, in m^2.
fn budget_m2(setup: &Setup) -> f64 {
    setup.scene.budget_m2_w * setup.problem.radio.max_power_w.i
}

/// The user's spectral efficiency, in nats, at the least distance, where the vehicle may be nearer by so much than is
/// allowed.
fn nearest_nats(setup: &Setup, horizontal_m: f64, vertical_m: f64) -> f64 {
    let problem = setup.problem;
    let user = problem.user_enu_m;
    let [low, high] = problem.airspace.altitude_m;
    // Coordinates are rounded to within their own last places, and so are the distances between them.
    let slack =
        ROUNDING * (user.amax() + setup.region.polygon().farthest_m(user.xy()) + low.abs().max(high.abs()));
    let height = ((user.z.clamp(low, high) - user.z).abs() - slack - vertical_m).max(0.0);
    let nearest = ((setup.region.nearest(user.xy()) - user.xy()).norm() - slack - horizontal_m).max(0.0);
    let tilt = setup.tilt_rad[0];
    let turns = setup.jitters() || !problem.has_ideal_link();
    let amplitude = if turns || tilt >= std::f64::consts::FRAC_PI_2 {
        1.0 / nearest.hypot(height)
    } else {
        let best = height * (std::f64::consts::FRAC_PI_4 - tilt / 2.0).tan();
        let distance = nearest.max(best);
        let angle = distance.atan2(height) + tilt;
        angle.min(std::f64::consts::FRAC_PI_2).sin() / distance.hypot(height)
    };
    let amplitude = amplitude.min(1.0 / NEAREST_M);
    (budget_m2(setup) * amplitude * amplitude).ln_1p()
}

/// A few units in the last place, relative.
const ROUNDING: f64 = 2e-15;
