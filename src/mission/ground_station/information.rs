//! Who we are, on request.

use mavlink::MessageData;
use mavlink::dialects::ardupilotmega::{
    AUTOPILOT_VERSION_DATA, COMPONENT_INFORMATION_BASIC_DATA, COMPONENT_METADATA_DATA, MavMessage,
    MavProtocolCapability,
};

use crate::mission::executive::Executive;
use crate::mission::ground_station::metadata;
use crate::role::Role;
use crate::time::Instant;

/// All our parameters are floats, for which both ways of encoding are the same; we name the one that says so plainly.
fn capabilities() -> MavProtocolCapability {
    MavProtocolCapability::MAV_PROTOCOL_CAPABILITY_COMMAND_INT
        | MavProtocolCapability::MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST
        | MavProtocolCapability::MAV_PROTOCOL_CAPABILITY_FTP
        | MavProtocolCapability::MAV_PROTOCOL_CAPABILITY_MAVLINK2
}

/// Major, minor and patch of this program in the upper three bytes; the lowest says "development" (0) or release (255).
fn version() -> u32 {
    let part = |text: &str| text.parse::<u8>().unwrap_or(0);
    let numbers = [
        part(env!("CARGO_PKG_VERSION_MAJOR")),
        part(env!("CARGO_PKG_VERSION_MINOR")),
        part(env!("CARGO_PKG_VERSION_PATCH")),
    ];
    let release = if env!("CARGO_PKG_VERSION_PRE").is_empty() { u8::MAX } else { 0 };
    u32::from_be_bytes([numbers[0], numbers[1], numbers[2], release])
}

/// What we are, for people.
pub(super) fn model(role: Role) -> String {
    format!("companion of vehicle {role}")
}

impl Executive {
    /// The message with this id about ourselves; `None` if there is none.
    pub(in crate::mission) fn information(&self, id: f32, now: Instant) -> Option<MavMessage> {
        if id == COMPONENT_INFORMATION_BASIC_DATA::ID as f32 {
            let role = self.settings.role;
            return Some(MavMessage::COMPONENT_INFORMATION_BASIC(COMPONENT_INFORMATION_BASIC_DATA {
                capabilities: capabilities(),
                time_boot_ms: boot_ms(now),
                time_manufacture_s: 0,
                vendor_name: "veilwing".into(),
                model_name: model(role).as_str().into(),
                software_version: env!("CARGO_PKG_VERSION").into(),
                hardware_version: "".into(),
                serial_number: "".into(),
            }));
        }
        if id == COMPONENT_METADATA_DATA::ID as f32 {
            return Some(metadata::announced(self.settings.role, now));
        }
        // Stations ask this of every component.
        (id == AUTOPILOT_VERSION_DATA::ID as f32).then(|| {
            MavMessage::AUTOPILOT_VERSION(AUTOPILOT_VERSION_DATA {
                capabilities: capabilities(),
                flight_sw_version: version(),
                ..AUTOPILOT_VERSION_DATA::default()
            })
        })
    }
}

/// Milliseconds since the companion's start; wraps after 49 days as MAVLink's does.
pub(super) fn boot_ms(now: Instant) -> u32 {
    now.since_start().as_millis() as u32
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn spec_stations_are_told_what_we_can_do_and_which_version_we_are() {
        let bits = [
            MavProtocolCapability::MAV_PROTOCOL_CAPABILITY_COMMAND_INT,
            MavProtocolCapability::MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST,
            MavProtocolCapability::MAV_PROTOCOL_CAPABILITY_FTP,
            MavProtocolCapability::MAV_PROTOCOL_CAPABILITY_MAVLINK2,
        ];
        assert!(bits.into_iter().all(|bit| capabilities().contains(bit)));
        let [major, minor, patch, _] = version().to_be_bytes();
        assert!(env!("CARGO_PKG_VERSION").starts_with(&format!("{major}.{minor}.{patch}")));
        assert_eq!(boot_ms(Instant::from_start(Duration::from_millis(1500))), 1500);
    }
}
