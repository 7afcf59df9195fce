//! What the adapter is told once.

use std::fmt;
use std::time::Duration;

use super::fence::Fence;
use super::position_control;
use crate::geo::Geodetic;
use crate::schedule::trajectory::Limits;

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
    /// Position targets and attitude together, for firmware that tracks both ([`Settings::tracks_pose`]), or for ArduPilot's
    /// 6DoF frame.
    #[default]
    Pose,
    /// Position targets and yaw alone; the vehicle tilts as it must.
    Position,
    /// One of the others, by what the autopilot's parameters say of the airframe, once they are read.
    Auto,
}

impl fmt::Display for Actuation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::ThrustVector => "thrust_vector",
            Self::Pose => "pose",
            Self::Position => "position",
            Self::Auto => "auto",
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
    /// The firmware tracks position and attitude targets together, as no stock PX4 does.
    pub tracks_pose: bool,
    /// Rate of the position and attitude asked for, in Hz, and the one at which setpoints are to be set.
    pub rate_hz: f64,
    /// Origin of the mission frame.
    pub mission_origin: Geodetic,
    /// Largest tilt of the plan in radians, 0 for one that stays level: limits that the autopilot must not trip over are checked against it.
    pub planned_tilt_rad: f64,
    /// The lowest and the highest altitude at which the autopilot's own return is to cross, in metres above the mission's
    /// origin; `None`: any.
    pub return_altitude_m: Option<[f64; 2]>,
    /// The fence that the autopilot is to have; `None`: nothing is said of one.
    pub fence: Option<Fence>,
    /// What transits ask of the vehicle at most: the autopilot's own limits are checked against it.
    pub transit: Limits,
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
            tracks_pose: false,
            rate_hz: 50.0,
            mission_origin,
            planned_tilt_rad: std::f64::consts::FRAC_PI_2,
            return_altitude_m: None,
            fence: None,
            transit: Limits::new(8.0, 3.0, 30f64.to_radians()),
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
