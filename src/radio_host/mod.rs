//! The radio's side of leased power (docs/radio.md): a state machine between the companion's link and one device.
//!
//! No MAVLink message sets a radio's power, so this stands beside the transmitter and speaks the numbered command for it. It
//! is fed messages ([`Host::handle_message`]), what became of the device's orders ([`Host::handle_outcome`]) and instants, and
//! drained of messages, orders and notices. It never waits for the device: an expiry is decided by the radio's clock
//! (`clock`), whatever the device is doing, and off pre-empts.
//!
//! - `series`: whose command counts, and which is newer.
//! - `rig`: what the device is wanted to do, what it was told, and what is known of it. A power is in force when it was read
//!   back, and the radio is off when off was.
//! - `line`: the kill line beside the device, if there is one.
//! - `scale`: which setting of the device gives which power, by its own word or by measurement; rounded down.
//! - `kill`: the radio kill, kept over a restart.
//! - `facts`: what the radio declares, as read-only parameters.

mod answers;
mod clock;
mod counters;
mod facts;
mod host;
mod kill;
mod line;
mod notice;
mod parameters;
mod requests;
mod rig;
mod scale;
mod series;

#[cfg(test)]
mod tests;

pub use counters::Counters;
pub use facts::Facts;
pub use host::{Host, Settings};
pub use line::{Feed, Level, LineTimes, Silence};
pub use notice::Notice;
pub use rig::{Fault, Order, OrderId, Outcome, Times};
pub use scale::{MOST_SETTINGS, Point, Scale, ScaleError, Setting, points_of_csv};

use mavlink::dialects::ardupilotmega::MavMessage;

use crate::transmitter::wire::VEILWING_RADIO_DATA;

/// The component that a payload radio is (MAV_COMP_ID_TELEMETRY_RADIO).
pub const COMPONENT: u8 = 68;

/// A message to be sent as the radio.
#[derive(Debug, Clone, PartialEq)]
pub enum Said {
    /// Of the common dialect.
    Common(Box<MavMessage>),
    /// The radio's own.
    Report(VEILWING_RADIO_DATA),
}
