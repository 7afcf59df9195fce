//! PX4's parameters before a flight.

use super::LAND_DETECTOR_SPEED;
use crate::autopilot::parameter::Parameters;
use crate::autopilot::settings::{Actuation, Settings};
use crate::preflight::Verdict::{Fail, Pass, Warn};
use crate::preflight::{Check, check};

/// A tilt limit of the autopilot must leave this much beyond the plan, in degrees.
const TILT_MARGIN_DEG: f64 = 15.0;

/// All checks of parameters: `guarding` while this companion itself keeps the land detector off, `rotors_n` the scales of the
/// thrust axes once they are known.
pub(in crate::autopilot::firmware) fn checks(
    parameters: &Parameters,
    settings: &Settings,
    guarding: bool,
    rotors_n: Option<[f64; 3]>,
) -> Vec<Check> {
    let tilt_deg = settings.planned_tilt_rad.to_degrees();
    let needs_tilt = settings.actuation != Actuation::Position;
    let mut all = vec![
        parameters.check("COM_OF_LOSS_T", |value| match value {
            v if v <= 1.0 => (Pass, ""),
            v if v <= 5.0 => {
                (Warn, "at most 1 s: the vehicle flies on blindly for so long after a dead companion")
            }
            _ => (Fail, "at most 1 s: the vehicle flies on blindly for so long after a dead companion"),
        }),
        parameters.check("COM_OBL_RC_ACT", |value| match value {
            5.0 => (Pass, ""),
            3.0 | 4.0 => (Warn, "5 (hold): this one leaves its place when the companion dies"),
            0.0..=2.0 => (Fail, "5 (hold): without a pilot's sticks this one drifts away and down"),
            _ => (Fail, "5 (hold)"),
        }),
    ];
    for name in ["FD_FAIL_R", "FD_FAIL_P"] {
        all.push(parameters.check(name, |value| {
            let trips = value != 0.0 && needs_tilt && value < tilt_deg + TILT_MARGIN_DEG;
            if trips {
                (Fail, "0: the failure detector stops the motors at this tilt, in degrees")
            } else {
                (Pass, "")
            }
        }));
    }
    all.push(parameters.check("NAV_DLL_ACT", |value| match value {
        0.0 => (Pass, ""),
        _ => (Warn, "0, or keep a ground station connected: its loss ends the mission"),
    }));
    // At 0 on the ground it is being put right: a moment of failing, and nothing for the operator to do.
    all.push(parameters.check(LAND_DETECTOR_SPEED, |value| match value {
        v if v > 0.0 || guarding => (Pass, ""),
        _ => (Fail, "above 0 on the ground, or no landing is seen: being put back"),
    }));
    if settings.actuation != Actuation::ThrustVector {
        all.extend(speeds(parameters, settings));
    }
    if settings.actuation == Actuation::ThrustVector {
        all.push(parameters.check("THR_MDL_FAC", |_| (Pass, "")));
        all.push(thrust_scales(parameters, settings, rotors_n));
    }
    all
}

/// The speeds that PX4 cuts position targets down to. Its limits of acceleration and jerk are for its own trajectories alone.
fn speeds(parameters: &Parameters, settings: &Settings) -> [Check; 3] {
    let (speed, climb) = (settings.transit.speed_m_s, settings.transit.climb_m_s);
    [("MPC_XY_VEL_MAX", speed), ("MPC_Z_VEL_MAX_UP", climb), ("MPC_Z_VEL_MAX_DN", climb)].map(
        |(name, planned_m_s)| {
            let checked = parameters.check(name, |value| match value {
                v if v >= planned_m_s * (1.0 - 1e-6) => (Pass, ""),
                _ => (Fail, "at least the mission's speed, or its slots begin before this vehicle is there"),
            });
            let detail = match checked.result {
                Fail => format!("{} (the mission: {planned_m_s} m/s)", checked.detail),
                _ => checked.detail,
            };
            Check { detail, ..checked }
        },
    )
}

fn thrust_scales(parameters: &Parameters, settings: &Settings, rotors_n: Option<[f64; 3]>) -> Check {
    match (settings.position_control.thrust_n, rotors_n) {
        (Some(given), _) => check("thrust scales", Pass, format!("{given:?} as configured")),
        (None, Some([x, y, z])) => {
            check("thrust scales", Pass, format!("{x:.2}, {y:.2}, {z:.2} from CA_ROTOR*"))
        }
        (None, None) if parameters.is_reading("CA_ROTOR") => {
            check("thrust scales", Fail, "CA_ROTOR* not read yet")
        }
        (None, None) => check("thrust scales", Warn, "CA_ROTOR* not known: taken as equal on every axis"),
    }
}
