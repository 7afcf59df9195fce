//! What the adapter tells the executive.

use std::fmt;
use std::time::Duration;

use mavlink::dialects::ardupilotmega::{MavResult, MavSeverity};

use super::firmware::Firmware;

/// Why the autopilot's estimate is not to be trusted.
#[derive(Debug, Clone, Copy, PartialEq, strum::IntoStaticStr, strum::VariantNames)]
pub enum EstimatorFault {
    /// A message carried a number that is not finite, or a quaternion that is no rotation.
    NotFinite {
        /// The message.
        message: &'static str,
    },
    /// The position jumped against its own velocity.
    Jump {
        /// By how much, in metres.
        distance_m: f64,
    },
    /// The autopilot moved its local origin in flight.
    OriginMoved {
        /// By how much, in metres.
        distance_m: f64,
    },
    /// The estimator's own health flags say so.
    Flags {
        /// The message that carries them.
        message: &'static str,
        /// What is missing or wrong.
        what: &'static str,
    },
}

impl fmt::Display for EstimatorFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotFinite { message } => write!(f, "{message} is not finite, or absurd"),
            Self::Jump { distance_m } => write!(f, "position jumped by {distance_m:.1} m"),
            Self::OriginMoved { distance_m } => {
                write!(f, "local origin moved by {distance_m:.1} m in flight")
            }
            Self::Flags { message, what } => write!(f, "{message}: {what}"),
        }
    }
}

/// What happened, for the executive.
#[derive(Debug, Clone, PartialEq)]
pub enum Event {
    /// The autopilot was found.
    Discovered {
        /// Its system id.
        system: u8,
        /// What it runs.
        firmware: Firmware,
    },
    /// Another autopilot speaks on the link. Said once for each; it is never listened to.
    AnotherAutopilot {
        /// Its system id.
        system: u8,
        /// The one in use; `None` if there is none yet: then name one in the vehicle file.
        using: Option<u8>,
    },
    /// The autopilot runs a firmware that is not the configured one, or not one of the two known.
    WrongFirmware {
        /// Its system id.
        system: u8,
    },
    /// The autopilot restarted: its clock went back. Everything known of it is forgotten, control is lost.
    Restarted,
    /// A heartbeat shows the companion's mode, as asked.
    ControlTaken,
    /// A heartbeat shows the motors armed, as asked.
    Armed,
    /// The take-off that was asked for has reached its altitude.
    Airborne,
    /// A heartbeat shows the mode that was asked for by `land`, `return_to_launch` or `hold`.
    HandedOver {
        /// That mode's name.
        mode: &'static str,
    },
    /// The autopilot left the companion's mode by another hand than ours (F2). Nothing is streamed any more.
    ControlLost {
        /// The mode it is in now.
        mode: String,
    },
    /// After its own failsafe had taken control, the autopilot went back to the companion's mode by itself, and is asked for
    /// one of its own.
    CalledBack {
        /// That mode's name.
        to: &'static str,
    },
    /// The autopilot is not heard. Control is lost, and not taken again by itself.
    LinkLost {
        /// What is not heard, in words: nothing at all, or no heartbeat.
        missing: &'static str,
        /// For how long.
        silent_for: Duration,
    },
    /// The autopilot is heard again.
    LinkRestored,
    /// The autopilot's estimate of its state is not to be trusted.
    EstimatorFailure(EstimatorFault),
    /// The autopilot does not do it yet; it is asked again.
    NotReady {
        /// What was asked for.
        what: &'static str,
        /// Its answer.
        result: MavResult,
        /// Its last STATUSTEXT since it was asked.
        statustext: Option<String>,
        /// Since when it has been asked.
        waited: Duration,
    },
    /// The autopilot does not do it, and is not asked again.
    Refused {
        /// What was asked for.
        what: &'static str,
        /// Its answer; accepted means acknowledged but not done, `None` that there was no answer.
        result: Option<MavResult>,
        /// Its last STATUSTEXT since it was asked, or why it was not asked at all.
        statustext: Option<String>,
    },
    /// A parameter that a companion had left as only one that flies may have it is as it should be again.
    PutRight {
        /// Its name.
        parameter: &'static str,
        /// As it was found.
        was: f64,
        /// As it is now.
        is: f64,
    },
    /// ArduPilot's bridge script follows the body offsets no more, and nobody answers in its place.
    BridgeDead {
        /// Since the first of the offsets that were not answered.
        silent_for: Duration,
    },
    /// On the ground after a flight.
    Landed,
    /// The motors are off.
    Disarmed,
    /// The autopilot says something, reassembled from its chunks.
    StatusText {
        /// How bad it is.
        severity: MavSeverity,
        /// What it says.
        text: String,
    },
}
