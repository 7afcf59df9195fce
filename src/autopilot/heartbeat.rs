//! Our own HEARTBEAT.

use mavlink::dialects::ardupilotmega::{
    HEARTBEAT_DATA, MavAutopilot, MavMessage, MavModeFlag, MavState, MavType,
};

/// Our own HEARTBEAT: an onboard controller without an autopilot of its own. The executive sends it once a second,
/// with its true status (F3).
#[must_use]
pub fn heartbeat(status: MavState) -> MavMessage {
    MavMessage::HEARTBEAT(HEARTBEAT_DATA {
        custom_mode: 0,
        mavtype: MavType::MAV_TYPE_ONBOARD_CONTROLLER,
        autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID,
        base_mode: MavModeFlag::empty(),
        system_status: status,
        mavlink_version: 3,
    })
}
