//! What a transmitter is told once, and what it says.

use std::time::Duration;

use super::parameter::PowerParameter;
use crate::time::Instant;

/// How the power is set.
#[derive(Debug, Clone, PartialEq)]
pub enum Kind {
    /// By numbered COMMAND_INTs that expire at an instant of the radio's clock.
    Numbered {
        /// The MAV_CMD.
        command: u16,
    },
    /// By COMMAND_INT with this command id: power in dBm in param1, slot in x, expiry in milliseconds from receipt in y.
    Leased {
        /// The MAV_CMD.
        command: u16,
    },
    /// By a parameter of the radio component, which does not expire.
    Parameter(PowerParameter),
    /// There is no radio: nothing is ever sent, and no power achieved.
    None,
}

/// The transmitter's settings.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Our own (system, component).
    pub own: (u8, u8),
    /// The radio's (system, component).
    pub target: (u8, u8),
    /// The radio has a link of its own; else it is behind the autopilot.
    pub apart: bool,
    /// The radio's system is given, and does not follow the autopilot's.
    pub system_is_given: bool,
    /// How its power is set.
    pub kind: Kind,
    /// Differs at each start of the companion ([`Kind::Numbered`]).
    pub boot: u32,
    /// No slot is served by a radio that answers later than this ([`Kind::Numbered`]).
    pub longest_round_trip: Duration,
    /// How long after the start the first off is sent, if nothing else is commanded before. Not at once where a
    /// companion that died and came back may have promised the peer to radiate until its lease runs out (S3).
    pub first_off_after: Duration,
}

/// A power that the radio has acknowledged.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lease {
    /// The power achieved, as the radio reports it, in watts.
    pub power_w: f64,
    /// The slot that came with the command.
    pub slot: u16,
    /// The radio may be silent from here on: counted from when the command was sent, not from when it was answered.
    pub expires_at: Instant,
}

/// What the radio certainly radiates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Vouched {
    /// The slot that came with the command.
    pub slot: u16,
    /// The power achieved, as the radio reports it, in watts.
    pub power_w: f64,
    /// Not before this does it fall silent by itself, whatever becomes of the companion.
    pub until: Instant,
}

/// What a radio says of its device in answer to a command (results 7 to 10 of docs/radio.md): it is off, or told to be.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error, strum::IntoStaticStr, strum::VariantNames)]
pub enum Trouble {
    /// Below the least power that it can give.
    #[error("the power is below the least that the radio can give")]
    TooLow,
    /// It did not answer in the time that it declares.
    #[error("the radio's device is late")]
    DeviceLate,
    /// It cannot be reached, refuses, or answers what cannot be understood.
    #[error("the radio's device cannot be reached, refuses, or is not understood")]
    DeviceError,
    /// It was read back at another power than it was set to, or on when it was told off.
    #[error("the radio's device was read back at another power")]
    OtherPower,
}

/// Why a power cannot be commanded, or a slot not be served.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error, strum::IntoStaticStr, strum::VariantNames)]
pub enum NotReady {
    /// Never heard in the form that it should speak.
    #[error("the radio has not been heard")]
    NotHeard,
    /// Its clock is not known well enough for an expiry.
    #[error("the radio's clock was last heard {} ms ago", age.as_millis())]
    Stale {
        /// How long ago it was heard.
        age: Duration,
    },
    /// It has not taken this boot of the companion for its commander.
    #[error("the radio does not yet obey this companion")]
    NotTaken,
    /// No command was answered of late.
    #[error("the radio has not answered a command for 3 s")]
    NotAnswered,
    /// Commands and answers take too long for a slot to be served.
    #[error("the radio answers after {} ms, and more than {} ms cannot serve a slot", round_trip.as_millis(), longest.as_millis())]
    TooSlow {
        /// As measured of late.
        round_trip: Duration,
        /// The longest that serves.
        longest: Duration,
    },
    /// It does not know the command.
    #[error("the radio does not know the command")]
    Unsupported,
    /// Its device does not do as it is told.
    #[error("{0}")]
    Trouble(Trouble),
}
