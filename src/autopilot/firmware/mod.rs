//! What PX4 and ArduCopter do differently: mode numbers, the order of entry, parameters.

pub mod ardupilot;
pub mod px4;
pub(super) mod rotors;

use std::fmt;

use mavlink::dialects::ardupilotmega::{HEARTBEAT_DATA, MavAutopilot};

use super::settings::{Actuation, FirmwareChoice};
use crate::geo::Projection;

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

/// A flight mode, as far as the companion has business with it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mode {
    /// The mode in which the companion flies: PX4 OFFBOARD, ArduCopter GUIDED.
    Companion,
    /// The autopilot lands by itself.
    Land,
    /// The autopilot returns to launch by itself.
    Return,
    /// The autopilot holds its place by itself: PX4 AUTO.LOITER, ArduCopter BRAKE.
    Hold,
    /// Any other mode.
    Other {
        /// Its name.
        name: &'static str,
        /// Its number on the wire.
        custom_mode: u32,
    },
}

/// What DO_SET_MODE takes in its parameters 2 and 3, with base mode "custom" in parameter 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct ModeNumber {
    pub(super) main: u8,
    pub(super) sub: u8,
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

    /// Why this firmware cannot do an actuation at all.
    pub(super) fn cannot(self, actuation: Actuation) -> Option<&'static str> {
        match (self, actuation) {
            (Self::ArduPilot, Actuation::ThrustVector) => {
                Some("ArduCopter ignores thrust_body: use actuation \"pose\" (6DoF frame) or \"position\"")
            }
            _ => None,
        }
    }
}
