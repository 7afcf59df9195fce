//! Whatever PX4 and ArduCopter do differently: what a [`Firmware`] asks of its companion is answered here, and what it
//! needs besides (PX4's land detector and rotors, ArduPilot's bridge script, the checks of each one's parameters) is
//! kept by `specifics`. Nowhere else is one told from the other.

pub(super) mod airframe;
mod ardupilot;
pub(super) mod choice;
pub(super) mod fencing;
mod mode;
mod px4;
pub(super) mod returning;
mod signing;
pub(super) mod specifics;
pub(super) mod version;

use std::fmt;

use mavlink::MessageData;
use mavlink::dialects::ardupilotmega::{
    EKF_STATUS_REPORT_DATA, ESTIMATOR_STATUS_DATA, HEARTBEAT_DATA, MavAutopilot,
};

use super::param_value::IntegerForm;
use super::settings::{Actuation, FirmwareChoice, Settings};
use crate::geo::Projection;

pub use mode::Mode;
pub(super) use mode::ModeNumber;
#[cfg(test)]
pub(super) use px4::rotors::tests::OMNICOPTER;

/// The firmware of an autopilot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Firmware {
    /// PX4.
    Px4,
    /// ArduPilot's copter.
    ArduPilot,
}

impl fmt::Display for Firmware {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Px4 => "PX4",
            Self::ArduPilot => "ArduCopter",
        })
    }
}

impl Firmware {
    /// The firmware of the sender of a heartbeat; `None` if it is neither of the two.
    #[must_use]
    pub fn of(heartbeat: &HEARTBEAT_DATA) -> Option<Self> {
        match heartbeat.autopilot {
            MavAutopilot::MAV_AUTOPILOT_PX4 => Some(Self::Px4),
            MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA => Some(Self::ArduPilot),
            _ => None,
        }
    }

    /// Whether this is the firmware asked for.
    pub(super) fn is(self, choice: FirmwareChoice) -> bool {
        match choice {
            FirmwareChoice::Auto => true,
            FirmwareChoice::Px4 => self == Self::Px4,
            FirmwareChoice::ArduPilot => self == Self::ArduPilot,
        }
    }

    /// The mode behind a heartbeat's `custom_mode`.
    #[must_use]
    pub fn mode(self, custom_mode: u32) -> Mode {
        match self {
            Self::Px4 => px4::mode(custom_mode),
            Self::ArduPilot => ardupilot::mode(custom_mode),
        }
    }

    /// What this firmware calls a mode.
    #[must_use]
    pub fn mode_name(self, mode: Mode) -> &'static str {
        match (self, mode) {
            (_, Mode::Other { name, .. }) => name,
            (Self::Px4, Mode::Companion) => "OFFBOARD",
            (Self::Px4, Mode::Land) => "AUTO.LAND",
            (Self::Px4, Mode::Return) => "AUTO.RTL",
            (Self::Px4, Mode::Hold) => "AUTO.LOITER",
            (Self::ArduPilot, Mode::Companion) => "GUIDED",
            (Self::ArduPilot, Mode::Land) => "LAND",
            (Self::ArduPilot, Mode::Return) => "RTL",
            (Self::ArduPilot, Mode::Hold) => "BRAKE",
        }
    }

    /// The numbers by which a mode is asked for. `None` for modes that the companion never asks for.
    pub(super) fn mode_number(self, mode: Mode) -> Option<ModeNumber> {
        match self {
            Self::Px4 => px4::mode_number(mode),
            Self::ArduPilot => ardupilot::mode_number(mode),
        }
    }

    /// The mode to ask for when this one is refused. ArduCopter's BRAKE can be left out of a build.
    pub(super) fn next_best(self, mode: Mode) -> Option<Mode> {
        (self == Self::ArduPilot && mode == Mode::Hold).then_some(ardupilot::LOITER)
    }

    /// Whether setpoints must stream before the companion's mode is accepted.
    pub(super) fn wants_stream_first(self) -> bool {
        self == Self::Px4
    }

    /// Whether setpoints end the failsafe that their absence began, from whatever mode it took.
    pub(super) fn resumes_by_setpoints(self) -> bool {
        self == Self::Px4
    }

    /// Whether the companion's setpoints fly the take-off. Otherwise the autopilot climbs by itself when it is told to,
    /// and setpoints are kept from it until it has: they would end the climb.
    pub(super) fn takes_off_by_setpoints(self) -> bool {
        self == Self::Px4
    }

    /// Whether a pose goes out as a position target and an attitude target. Otherwise the heading goes with the
    /// position, and roll and pitch another way: ArduPilot's 6DoF frame panics on a quaternion.
    pub(super) fn takes_attitude_targets(self) -> bool {
        self == Self::Px4
    }

    /// The message in which the estimator tells its health: id and name.
    pub(super) fn estimator_message(self) -> (u32, &'static str) {
        match self {
            Self::Px4 => (ESTIMATOR_STATUS_DATA::ID, ESTIMATOR_STATUS_DATA::NAME),
            Self::ArduPilot => (EKF_STATUS_REPORT_DATA::ID, EKF_STATUS_REPORT_DATA::NAME),
        }
    }

    /// How parameters of integer types travel.
    pub(super) fn integer_form(self) -> IntegerForm {
        match self {
            Self::Px4 => IntegerForm::Bytes,
            Self::ArduPilot => IntegerForm::Number,
        }
    }

    /// How this firmware makes its local frame.
    pub fn projection(self) -> Projection {
        match self {
            Self::Px4 => Projection::Equidistant,
            Self::ArduPilot => Projection::Equirectangular,
        }
    }

    /// The parameters read at the start, for the preflight checks and the land detector's guard.
    pub(super) fn parameters(self) -> &'static [&'static str] {
        match self {
            Self::Px4 => px4::PARAMETERS,
            Self::ArduPilot => ardupilot::PARAMETERS,
        }
    }

    /// Why this firmware cannot do what the settings ask of it at all.
    pub(super) fn cannot(self, settings: &Settings) -> Option<&'static str> {
        match (self, settings.actuation) {
            (Self::ArduPilot, Actuation::ThrustVector) => {
                Some("ArduCopter ignores thrust_body: use actuation \"pose\" (6DoF frame) or \"position\"")
            }
            (Self::Px4, Actuation::Pose) if !settings.tracks_pose => Some(
                "stock PX4 obeys the last of position and attitude target, and never lifts: use actuation \"thrust_vector\" \
                 (fully actuated) or \"position\"; firmware that tracks both is declared by tracks_pose = true",
            ),
            (_, Actuation::Auto) => Some("what its airframe can do is not known yet"),
            _ => None,
        }
    }
}
