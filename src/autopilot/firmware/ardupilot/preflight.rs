//! ArduCopter's parameters, and its bridge script, before a flight.

use mavlink::dialects::ardupilotmega::MavResult;

use super::bridge::Bridge;
use crate::autopilot::parameter::Parameters;
use crate::preflight::Verdict::{Fail, Pass, Warn};
use crate::preflight::{Check, check};

/// `FRAME_CLASS` of the 6DoF frame, which tracks roll and pitch apart from position and panics on a quaternion.
const FRAME_CLASS_6DOF: f64 = 16.0;

/// All checks; `bridge` is there where roll and pitch go through the script.
pub(in crate::autopilot::firmware) fn checks(parameters: &Parameters, bridge: Option<&Bridge>) -> Vec<Check> {
    let mut all = vec![
        // Without knowing the frame, body offsets are sent to a vehicle that may not have them: it just stays level.
        parameters.check("FRAME_CLASS", |value| match value == FRAME_CLASS_6DOF {
            false if bridge.is_some() => {
                (Fail, "16 (6DoF, scripting) for pose; otherwise use actuation \"position\"")
            }
            _ => (Pass, ""),
        }),
        parameters.check("GUID_TIMEOUT", |value| match value {
            v if v <= 3.0 => (Pass, ""),
            _ => (Warn, "at most 3 s"),
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
    if let Some(bridge) = bridge {
        all.push(match bridge.probed() {
            Some(MavResult::MAV_RESULT_ACCEPTED) => check("bridge script", Pass, "answers"),
            Some(result) => {
                check("bridge script", Fail, format!("command 31013: {result:?}; install the script"))
            }
            None => check("bridge script", Fail, "does not answer command 31013: install it and restart"),
        });
        all.push(parameters.check("SCR_ENABLE", |value| match value {
            1.0 => (Pass, ""),
            _ => (Fail, "1: the bridge script sets the body offsets"),
        }));
    }
    all
}
