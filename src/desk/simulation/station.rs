//! An operator's ground station, as far as it gives orders.

use mavlink::dialects::ardupilotmega::{COMMAND_LONG_DATA, MavMessage};

use crate::desk::Order;
use crate::link::codec::Encoder;
use crate::role::Role;

use super::index;

/// The link of each vehicle on which its ground station is.
pub const STATION_LINK: usize = 1;
/// MAVLink's system of a ground station, and its component.
const STATION: (u8, u8) = (255, 190);
/// The companion's component.
const COMPANION: u8 = 191;

/// A companion's MAVLink system and component.
pub(super) fn companion(role: Role) -> (u8, u8) {
    (1 + index(role) as u8, COMPANION)
}

/// Gives orders in frames of its own.
#[derive(Debug, Default)]
pub(super) struct Station {
    encoder: Encoder,
}

impl Station {
    /// The frame of an order to a companion, by its own address or as one of all components aboard.
    pub fn order(&mut self, order: Order, role: Role, to_all: bool) -> Vec<u8> {
        let (command, param1) = order.command();
        let (target_system, component) = companion(role);
        let message = MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
            command,
            param1,
            target_system,
            target_component: if to_all { 0 } else { component },
            ..COMMAND_LONG_DATA::DEFAULT
        });
        self.encoder.encode(STATION, &message).raw_bytes().to_vec()
    }
}
