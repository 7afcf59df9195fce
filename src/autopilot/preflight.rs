//! What speaks for or against a flight: named checks, each with the offending value and what it should be.

use mavlink::dialects::ardupilotmega::{MavResult, MavType};

use super::adapter::Autopilot;
use super::firmware::px4::LAND_DETECTOR_SPEED;
use super::firmware::{Firmware, ardupilot};
use super::parameter::{Knowledge, ParamValue};
use super::settings::Actuation;
use super::state::Landed;
use crate::preflight::{Check, Verdict, check};
use crate::time::Instant;

/// A tilt limit of the autopilot must leave this much beyond the plan, in degrees.
const TILT_MARGIN_DEG: f64 = 15.0;
/// Position and attitude at this part of the rate asked for still fly: an autopilot on a loaded machine is slow evenly.
const FLYABLE: f64 = 0.4;
/// Local and global position may disagree by this much, in metres.
const ORIGIN_TOLERANCE_M: f64 = 5.0;

/// All checks that concern the autopilot.
pub(super) fn checks(autopilot: &Autopilot, candidates: usize, now: Instant) -> Vec<Check> {
    let Some((firmware, address)) = autopilot.peer else {
        let detail = match candidates {
            0 => "no heartbeat of a PX4 or ArduCopter autopilot on the link: check the link's address"
                .to_owned(),
            n => format!("{n} autopilots on the link: name one with autopilot.system_id"),
        };
        return vec![check("autopilot", Verdict::Fail, detail)];
    };
    let version = autopilot.state().version.map_or(String::new(), |(a, b, c)| format!(" {a}.{b}.{c}"));
    let mut all =
        vec![check("autopilot", Verdict::Pass, format!("{firmware}{version}, system {}", address.0))];
    all.extend(vehicle(autopilot, firmware));
    all.extend(telemetry(autopilot, now));
    all.extend(readiness(autopilot));
    match firmware {
        Firmware::Px4 => px4(autopilot, &mut all),
        Firmware::ArduPilot => arducopter(autopilot, &mut all),
    }
    all
}

fn vehicle(autopilot: &Autopilot, firmware: Firmware) -> Vec<Check> {
    let multirotor = matches!(
        autopilot.state().vehicle_type,
        Some(
            MavType::MAV_TYPE_QUADROTOR
                | MavType::MAV_TYPE_COAXIAL
                | MavType::MAV_TYPE_HEXAROTOR
                | MavType::MAV_TYPE_OCTOROTOR
                | MavType::MAV_TYPE_TRICOPTER
                | MavType::MAV_TYPE_DODECAROTOR
                | MavType::MAV_TYPE_DECAROTOR
                | MavType::MAV_TYPE_GENERIC_MULTIROTOR
        )
    );
    let kind = autopilot.state().vehicle_type.map_or("unknown".to_owned(), |kind| format!("{kind:?}"));
    let kind = if multirotor {
        check("vehicle type", Verdict::Pass, kind)
    } else {
        check("vehicle type", Verdict::Fail, format!("{kind}, should be a multirotor: set MAV_TYPE"))
    };
    let actuation = autopilot.settings().actuation;
    let detail = format!("{actuation} on {firmware}");
    let actuation = match (firmware.cannot(actuation), firmware, actuation) {
        (Some(why), ..) => check("actuation", Verdict::Fail, why),
        (None, Firmware::Px4, Actuation::Pose) => check(
            "actuation",
            Verdict::Warn,
            "pose: stock PX4 obeys the last of position and attitude target; use a fork that tracks both, or thrust_vector",
        ),
        _ => check("actuation", Verdict::Pass, detail),
    };
    vec![kind, actuation]
}

fn telemetry(autopilot: &Autopilot, now: Instant) -> Vec<Check> {
    let mut all = Vec::new();
    let fresh = autopilot.fresh(now);
    all.push(if fresh {
        check("position and attitude", Verdict::Pass, "fresh")
    } else {
        check("position and attitude", Verdict::Fail, "not received within the freshness limit")
    });
    let slow = autopilot.streams.report().filter(|stream| !stream.good).collect::<Vec<_>>();
    if slow.is_empty() {
        all.push(check("telemetry", Verdict::Pass, "every stream comes at its rate"));
    }
    for stream in slow {
        let rate = stream.measured_hz.map_or("not yet measured".to_owned(), |hz| format!("{hz:.1} Hz"));
        let flyable = stream.measured_hz.is_some_and(|hz| hz >= FLYABLE * stream.wanted_hz);
        let result = if stream.essential && !flyable { Verdict::Fail } else { Verdict::Warn };
        all.push(check(
            "telemetry",
            result,
            format!("{}: {rate}, should be {:.0} Hz", stream.name, stream.wanted_hz),
        ));
    }
    all.push(match autopilot.utc_uncertainty() {
        Some(within) => {
            check("clock", Verdict::Pass, format!("UTC from SYSTEM_TIME within {} ms", within.as_millis()))
        }
        None => check("clock", Verdict::Fail, "no UTC in SYSTEM_TIME: wait for GPS"),
    });
    all
}

fn readiness(autopilot: &Autopilot) -> Vec<Check> {
    let state = autopilot.state();
    let flag = |name, value: Option<bool>, worst: Verdict, bad: &str| match value {
        Some(true) => check(name, Verdict::Pass, "good"),
        Some(false) => check(name, worst, bad),
        None => check(name, Verdict::Warn, "the autopilot does not say"),
    };
    let local = state.position_enu_m.map(|position| position.value);
    let global = state.global_position_enu_m.map(|position| position.value);
    let origin = match (state.local_origin, local, global) {
        (None, ..) => check("local origin", Verdict::Fail, "GPS_GLOBAL_ORIGIN not received: wait for GPS"),
        (Some(_), Some(local), Some(global)) if (local - global).norm() > ORIGIN_TOLERANCE_M => {
            let apart_m = (local - global).norm();
            let detail = format!("local and global position are {apart_m:.1} m apart, should be below 5 m");
            check("local origin", Verdict::Fail, detail)
        }
        _ => check("local origin", Verdict::Pass, "known"),
    };
    let min_percent = autopilot.settings().min_battery * 100.0;
    let battery = match state.battery.and_then(|battery| battery.value.remaining) {
        None => check("battery", Verdict::Warn, "the autopilot does not say"),
        Some(left) if left * 100.0 < min_percent => check(
            "battery",
            Verdict::Fail,
            format!("{:.0}%, should be at least {min_percent:.0}%", left * 100.0),
        ),
        Some(left) => check("battery", Verdict::Pass, format!("{:.0}%", left * 100.0)),
    };
    let home = match state.home_enu_m {
        Some(_) => check("home", Verdict::Pass, "known"),
        None => check("home", Verdict::Fail, "HOME_POSITION not received: return to launch has no goal"),
    };
    let ground = match (state.is_armed(), state.landed.map(|landed| landed.value)) {
        (false, _) | (true, Some(Landed::OnGround)) => check("armed", Verdict::Pass, "on the ground"),
        (true, _) => check("armed", Verdict::Warn, "already flying"),
    };
    vec![
        origin,
        home,
        flag(
            "estimator",
            state.estimator_ok.map(|ok| ok.value),
            Verdict::Fail,
            "unhealthy: see its messages",
        ),
        flag("gps", state.gps_ok.map(|ok| ok.value), Verdict::Fail, "unhealthy: wait for a fix"),
        // Judged for the present mode, which is not yet ours: arming itself has the last word, with its reason.
        flag(
            "pre-arm",
            state.prearm_ok.map(|ok| ok.value),
            Verdict::Warn,
            "the autopilot's own checks do not pass",
        ),
        battery,
        ground,
    ]
}

/// Judges a parameter: `judge` gives the verdict and what the value should be.
fn parameter(
    autopilot: &Autopilot,
    name: &'static str,
    judge: impl FnOnce(f64) -> (Verdict, &'static str),
) -> Check {
    match autopilot.parameters.get(name) {
        // It may be the one that should fail. Asking ends: what does not answer is unknown.
        Knowledge::Pending => check(name, Verdict::Fail, "not read yet"),
        Knowledge::Unknown => check(name, Verdict::Warn, "the autopilot does not answer: not known"),
        Knowledge::Known(value) => {
            let (result, should_be) = judge(value.as_f64());
            let shown = match value {
                ParamValue::Int(value) => value.to_string(),
                ParamValue::Real(value) => value.to_string(),
            };
            let detail =
                if result == Verdict::Pass { shown } else { format!("{shown}, should be {should_be}") };
            check(name, result, detail)
        }
    }
}

fn px4(autopilot: &Autopilot, all: &mut Vec<Check>) {
    use Verdict::{Fail, Pass, Warn};
    let tilt_deg = autopilot.settings().planned_tilt_rad.to_degrees();
    let needs_tilt = autopilot.settings().actuation != Actuation::Position;
    all.push(parameter(autopilot, "COM_OF_LOSS_T", |value| match value {
        v if v <= 1.0 => (Pass, ""),
        v if v <= 5.0 => {
            (Warn, "at most 1 s: the vehicle flies on blindly for so long after a dead companion")
        }
        _ => (Fail, "at most 1 s: the vehicle flies on blindly for so long after a dead companion"),
    }));
    all.push(parameter(autopilot, "COM_OBL_RC_ACT", |value| match value {
        5.0 => (Pass, ""),
        3.0 | 4.0 => (Warn, "5 (hold): this one leaves its place when the companion dies"),
        0.0..=2.0 => (Warn, "5 (hold): without a pilot's sticks this one drifts"),
        _ => (Fail, "5 (hold)"),
    }));
    for name in ["FD_FAIL_R", "FD_FAIL_P"] {
        all.push(parameter(autopilot, name, |value| {
            let trips = value != 0.0 && needs_tilt && value < tilt_deg + TILT_MARGIN_DEG;
            if trips {
                (Fail, "0: the failure detector stops the motors at this tilt, in degrees")
            } else {
                (Pass, "")
            }
        }));
    }
    all.push(parameter(autopilot, "NAV_DLL_ACT", |value| match value {
        0.0 => (Pass, ""),
        _ => (Warn, "0, or keep a ground station connected: its loss ends the mission"),
    }));
    if autopilot.guarded() {
        all.push(parameter(autopilot, LAND_DETECTOR_SPEED, |value| match value {
            v if v > 0.0 => (Pass, ""),
            _ => (Warn, "0.25 on the ground: put back before take-off"),
        }));
    }
    if autopilot.settings().actuation == Actuation::ThrustVector {
        all.push(parameter(autopilot, "THR_MDL_FAC", |_| (Pass, "")));
        all.push(match (autopilot.settings().position_control.thrust_n, autopilot.rotor_scales) {
            (Some(given), _) => check("thrust scales", Pass, format!("{given:?} as configured")),
            (None, Some([x, y, z])) => {
                check("thrust scales", Pass, format!("{x:.2}, {y:.2}, {z:.2} from CA_ROTOR*"))
            }
            (None, None) if autopilot.parameters.is_reading("CA_ROTOR") => {
                check("thrust scales", Fail, "CA_ROTOR* not read yet")
            }
            (None, None) => check("thrust scales", Warn, "CA_ROTOR* not known: taken as equal on every axis"),
        });
    }
}

fn arducopter(autopilot: &Autopilot, all: &mut Vec<Check>) {
    use Verdict::{Fail, Pass, Warn};
    let pose = autopilot.settings().actuation == Actuation::Pose;
    let frame = parameter(autopilot, "FRAME_CLASS", |value| match value == ardupilot::FRAME_CLASS_6DOF {
        false if pose => (Fail, "16 (6DoF, scripting) for pose; otherwise use actuation \"position\""),
        _ => (Pass, ""),
    });
    // Without knowing the frame, body offsets are sent to a vehicle that may not have them: it just stays level.
    all.push(frame);
    all.push(parameter(autopilot, "GUID_TIMEOUT", |value| match value {
        v if v <= 3.0 => (Pass, ""),
        _ => (Warn, "at most 3 s"),
    }));
    all.push(parameter(autopilot, "GUID_OPTIONS", |value| match value as i64 & 8 {
        0 => (Pass, ""),
        _ => (Warn, "without bit 3 (thrust as thrust)"),
    }));
    all.push(parameter(autopilot, "FS_GCS_ENABLE", |value| match value {
        0.0 => (Pass, ""),
        _ => (Warn, "0, or keep a ground station connected: it returns 5 s after that one's last heartbeat"),
    }));
    if pose {
        all.push(match autopilot.bridge.probed() {
            Some(MavResult::MAV_RESULT_ACCEPTED) => check("bridge script", Pass, "answers"),
            Some(result) => {
                check("bridge script", Fail, format!("command 31013: {result:?}; install the script"))
            }
            None => check("bridge script", Fail, "does not answer command 31013: install it and restart"),
        });
        all.push(parameter(autopilot, "SCR_ENABLE", |value| match value {
            1.0 => (Pass, ""),
            _ => (Fail, "1: the bridge script sets the body offsets"),
        }));
    }
}
