//! ArduCopter's shaping of position targets, held against what the transits ask for.
//!
//! GUIDED moves a target of its own after the one that it is sent, by a law that lets the velocity and the acceleration
//! that come with it pass, and bounds what it corrects beyond them by WPNAV_SPEED and WPNAV_ACCEL. The change of the whole
//! acceleration is bounded by PSC_JERK_XY and PSC_JERK_Z: a transit that asks for more is left behind, and flown past at
//! its end. 4.7 has other names for all of them, and metres where there were centimetres.

use crate::autopilot::alias::{Alias, Told};
use crate::autopilot::parameter::Parameters;
use crate::preflight::Verdict::{Fail, Pass, Warn};
use crate::preflight::{Check, Verdict, check};
use crate::schedule::trajectory::Limits;

const JERK_HORIZONTAL: Alias = Alias(&[("PSC_JERK_XY", 1.0), ("PSC_JERK_NE", 1.0), ("PSC_NE_JERK", 1.0)]);
const JERK_VERTICAL: Alias = Alias(&[("PSC_JERK_Z", 1.0), ("PSC_JERK_D", 1.0), ("PSC_D_JERK", 1.0)]);
const ACCELERATION: Alias = Alias(&[("WPNAV_ACCEL", 0.01), ("WP_ACC", 1.0)]);
const SPEED: Alias = Alias(&[("WPNAV_SPEED", 0.01), ("WP_SPD", 1.0)]);

/// Asks for each limit.
pub(in crate::autopilot::firmware) fn read(parameters: &mut Parameters) {
    for alias in [JERK_HORIZONTAL, JERK_VERTICAL, ACCELERATION, SPEED] {
        alias.ask(parameters);
    }
}

/// The limits against the plan's.
pub(in crate::autopilot::firmware) fn checks(parameters: &Parameters, transit: &Limits) -> Vec<Check> {
    let past = "it would fly past the end of each transit: raise it, or lower jerk_m_s3 of this vehicle in the mission";
    let corrects =
        "what it corrects is limited to that, after a gust or a late start: raise it, or lower the mission's";
    let jerk =
        |alias| transit.jerk_m_s3.map(|planned| limit(parameters, alias, (planned, "m/s^3"), (Fail, past)));
    let mut all: Vec<Check> = [JERK_HORIZONTAL, JERK_VERTICAL].into_iter().filter_map(jerk).collect();
    let acceleration = (transit.acceleration_m_s2, "m/s^2");
    all.push(limit(parameters, ACCELERATION, acceleration, (Warn, corrects)));
    all.push(limit(parameters, SPEED, (transit.speed_m_s, "m/s"), (Warn, corrects)));
    all.push(past_the_pose(transit.acceleration_m_s2));
    all
}

/// At which acceleration a quad of stock parameters still stops within half a metre past a transit's end (0.39 to 0.49 m; 0.46 to
/// 0.67 m at 2.5 m/s^2), m/s^2. It is the vehicle's loop and no limit of its own: nothing that is sent ahead mends it.
const STOPS_WITHIN: f64 = 1.5;

fn past_the_pose(planned: f64) -> Check {
    let (verdict, more) = match planned <= STOPS_WITHIN {
        true => (Pass, ""),
        false => (
            Warn,
            ": it flies past the end of each transit by up to 0.7 m, and 1.5 m/s^2 keeps that below 0.5 m: give settle_s time for it, or lower acceleration_m_s2 of this vehicle in the mission",
        ),
    };
    check("overshoot", verdict, format!("the mission asks for {planned} m/s^2{more}"))
}

/// One limit: `planned` in its SI unit, and what it is if the autopilot's is lower, with the reason.
fn limit(
    parameters: &Parameters,
    alias: Alias,
    (planned, unit): (f64, &str),
    (worse, why): (Verdict, &str),
) -> Check {
    match alias.told(parameters) {
        (name, Told::Pending) => check(name, Fail, "not read yet"),
        (name, Told::Unknown) => check(name, Warn, "the autopilot does not answer: not known"),
        // A parameter has single precision.
        (name, Told::Known(limit)) if limit >= planned * (1.0 - 1e-6) => {
            check(name, Pass, format!("{limit} {unit}, the mission asks for {planned}"))
        }
        (name, Told::Known(limit)) => {
            check(name, worse, format!("{limit} {unit}, should be at least the mission's {planned}: {why}"))
        }
    }
}
