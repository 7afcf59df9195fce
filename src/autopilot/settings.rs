//! What the adapter is told, and what it tells.

use std::fmt;
use std::time::Duration;

use mavlink::dialects::ardupilotmega::{MavResult, MavSeverity};
use nalgebra::Vector3;

use super::firmware::Firmware;
use super::position_control;
use crate::geo::{Attitude, Enu, Geodetic};

/// Which firmware to expect.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum FirmwareChoice {
    /// Whatever the heartbeat says, of the two that are known.
    #[default]
    Auto,
    /// PX4, and nothing else.
    Px4,
    /// ArduCopter, and nothing else.
    ArduPilot,
}

/// How a pose is given to the autopilot.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Actuation {
    /// Attitude and three-dimensional body thrust; the companion closes the position loop (PX4, fully actuated).
    ThrustVector,
    /// Position targets and attitude together, for firmware that tracks both.
    #[default]
    Pose,
    /// Position targets and yaw alone; the vehicle tilts as it must.
    Position,
}

impl fmt::Display for Actuation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::ThrustVector => "thrust_vector",
            Self::Pose => "pose",
            Self::Position => "position",
        })
    }
}

/// The adapter's settings. Build with [`Settings::new`] and change what differs.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Our own (system, component) on this link.
    pub own: (u8, u8),
    /// The autopilot's system id; `None` takes the only autopilot on the link and refuses to choose among several.
    pub autopilot_system: Option<u8>,
    /// The firmware expected.
    pub firmware: FirmwareChoice,
    /// How poses are given to the autopilot.
    pub actuation: Actuation,
    /// Rate of the position and attitude asked for, in Hz, and the one at which setpoints are to be set.
    pub rate_hz: f64,
    /// Origin of the mission frame.
    pub mission_origin: Geodetic,
    /// Largest tilt of the plan in radians: limits that the autopilot must not trip over are checked against it.
    pub planned_tilt_rad: f64,
    /// Largest rate at which a commanded attitude turns, in rad/s.
    pub tilt_rate_rad_s: f64,
    /// How long after a setpoint the next one still belongs to the same stream; later ones begin it anew.
    pub setpoint_lifetime: Duration,
    /// Age at which position and attitude are no longer fresh.
    pub freshness: Duration,
    /// Added to the time after which late state silences the transmitter: for a clock that runs fast, on which this
    /// machine's own delays count for more. None on a real vehicle.
    pub scheduling_allowance: Duration,
    /// Silence of the autopilot, once its telemetry streams, that counts as a lost link.
    pub link_timeout: Duration,
    /// How long an autopilot that is not ready (to arm, to enter the mode) is asked again.
    pub readiness_timeout: Duration,
    /// Disagreement of a position with the last one and the velocity that counts as an estimator fault, in metres.
    pub position_jump_m: f64,
    /// Smallest battery charge to start with, in [0, 1].
    pub min_battery: f64,
    /// Gains and limits of the position controller of [`Actuation::ThrustVector`].
    pub position_control: position_control::Settings,
}

impl Settings {
    /// The defaults for a companion at address `own` on a mission about `mission_origin`.
    #[must_use]
    pub fn new(own: (u8, u8), mission_origin: Geodetic) -> Self {
        Self {
            own,
            autopilot_system: None,
            firmware: FirmwareChoice::Auto,
            actuation: Actuation::default(),
            rate_hz: 50.0,
            mission_origin,
            planned_tilt_rad: std::f64::consts::FRAC_PI_2,
            tilt_rate_rad_s: 30f64.to_radians(),
            setpoint_lifetime: Duration::from_millis(200),
            freshness: Duration::from_millis(250),
            scheduling_allowance: Duration::ZERO,
            link_timeout: Duration::from_secs(1),
            readiness_timeout: Duration::from_secs(60),
            // Half of what a pose may be off: a jump that could hide inside the tolerance is none that matters.
            position_jump_m: 0.5,
            min_battery: 0.3,
            position_control: position_control::Settings::default(),
        }
    }

    /// Time between two setpoints, as they are to be set. Rates outside [2, 400] Hz are taken at the nearest end.
    pub(super) fn period(&self) -> Duration {
        let rate_hz = if self.rate_hz.is_finite() { self.rate_hz.clamp(2.0, 400.0) } else { 50.0 };
        Duration::from_secs_f64(1.0 / rate_hz)
    }
}

/// Where the vehicle should be now, in the mission frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Setpoint {
    /// Position in metres, ENU.
    pub position_enu_m: Enu,
    /// Velocity feed-forward in m/s, ENU.
    pub velocity_enu_m_s: Vector3<f64>,
    /// Attitude. [`Actuation::Position`] uses its yaw alone.
    pub attitude: Attitude,
}

impl Setpoint {
    /// Whether every number is finite; others are never streamed.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        let q = self.attitude.rotation();
        self.position_enu_m
            .iter()
            .chain(self.velocity_enu_m_s.iter())
            .chain(q.coords.iter())
            .all(|c| c.is_finite())
    }
}

/// Why the autopilot's estimate is not to be trusted.
#[derive(Debug, Clone, Copy, PartialEq)]
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
            Self::NotFinite { message } => write!(f, "{message} is not finite"),
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
