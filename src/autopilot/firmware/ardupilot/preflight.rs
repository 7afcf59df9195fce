//! ArduCopter's parameters, and its bridge script, before a flight.

use mavlink::dialects::ardupilotmega::MavResult;

use super::bridge::Bridge;
use super::shaping;
use crate::autopilot::parameter::Parameters;
use crate::autopilot::settings::Settings;
use crate::preflight::Verdict::{Fail, Pass, Warn};
use crate::preflight::{Check, check};

/// `FRAME_CLASS` of the 6DoF frame, which tracks roll and pitch apart from position and panics on a quaternion.
const FRAME_CLASS_6DOF: f64 = 16.0;
/// The longest extrapolation of a velocity whose companion is gone, in seconds.
const LONGEST_GUIDED_S: f64 = 1.0;
/// What a script may take in one run: ArduPilot's default, of which the bridge needs less than half.
const LEAST_INSTRUCTIONS: f64 = 10_000.0;

/// All checks; `bridge` is there where roll and pitch go through the script.
pub(in crate::autopilot::firmware) fn checks(
    parameters: &Parameters,
    settings: &Settings,
    bridge: Option<&Bridge>,
) -> Vec<Check> {
    let mut all = vec![
        // Without knowing the frame, body offsets are sent to a vehicle that may not have them: it just stays level.
        parameters.check("FRAME_CLASS", |value| match value == FRAME_CLASS_6DOF {
            false if bridge.is_some() => {
                (Fail, "16 (6DoF, scripting) for pose; otherwise use actuation \"position\"")
            }
            _ => (Pass, ""),
        }),
        parameters.check("GUID_TIMEOUT", |value| match value {
            v if v <= LONGEST_GUIDED_S => (Pass, ""),
            _ => (Warn, "1 s: for so long it flies on at its last velocity once the companion is gone"),
        }),
        parameters.check("GUID_OPTIONS", |value| match value as i64 & 8 {
            0 => (Pass, ""),
            _ => (Warn, "without bit 3 (thrust as thrust)"),
        }),
        parameters.check("FS_GCS_ENABLE", |value| match value {
            0.0 => (Pass, ""),
            _ => (
                Warn,
                "0, or keep a ground station connected: it returns 5 s after that one's last heartbeat",
            ),
        }),
    ];
    all.extend(shaping::checks(parameters, &settings.transit));
    if let Some(bridge) = bridge {
        all.push(match bridge.probed() {
            Some(MavResult::MAV_RESULT_ACCEPTED) => check("bridge script", Pass, "answers"),
            Some(MavResult::MAV_RESULT_FAILED) => {
                check("bridge script", Fail, "its guard does not run: install veilwing_guard.lua and restart")
            }
            Some(result) => {
                check("bridge script", Fail, format!("command 31013: {result:?}; install the script"))
            }
            None => check("bridge script", Fail, "does not answer command 31013: install it and restart"),
        });
        all.push(parameters.check("SCR_ENABLE", |value| match value {
            1.0 => (Pass, ""),
            _ => (Fail, "1: the bridge script sets the body offsets"),
        }));
        all.push(parameters.check("SCR_VM_I_COUNT", |value| match value {
            v if v >= LEAST_INSTRUCTIONS => (Pass, ""),
            _ => (Fail, "at least 10000: a burst of commands ends a script that has fewer"),
        }));
    }
    all
}
