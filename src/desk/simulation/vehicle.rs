//! The settings of a simulated vehicle's companion.

use veilwing_sitl::BatteryConfig;

use crate::autopilot::{Actuation, FenceDuty};
use crate::config::{Diagnostics, Mission, Vehicle, VehicleDraft, fence_corners};
use crate::link::{HostPort, LinkAddress};
use crate::planner::problem::Airframe;
use crate::role::Role;

use super::index;

/// Every simulated vehicle has its role's MAVLink system and a simulated transmitter that expires; what else it has, its
/// user fills in. `ports` are those of the autopilot link and of the pair link, on this machine.
#[must_use]
pub fn vehicle_draft(mission: &Mission, role: Role, ports: [u16; 2]) -> VehicleDraft {
    let [autopilot, pair] = ports.map(on_this_machine);
    let mut draft = VehicleDraft::new(role, pair);
    draft.autopilot.link = autopilot;
    draft.autopilot.actuation = actuation(mission, role);
    // As the simulated PX4 does.
    draft.autopilot.tracks_pose = true;
    if fence_corners(mission).is_err() {
        draft.autopilot.fence = FenceDuty::None;
    }
    // Level: what a tilt takes more of it shows in flight.
    draft.battery.endurance_s = Some(BatteryConfig::default().endurance_s);
    draft.autopilot.system_id = Some(if index(role) == 0 { 1 } else { 2 });
    draft
}

/// A port of this machine's, as a companion reaches it.
#[must_use]
pub fn on_this_machine(port: u16) -> LinkAddress {
    LinkAddress::UdpOut(HostPort { host: "127.0.0.1".into(), port })
}

/// How the simulated vehicle of this role is commanded.
fn actuation(mission: &Mission, role: Role) -> Actuation {
    match mission.vehicles[role].airframe {
        Airframe::Omnidirectional => Actuation::Pose,
        Airframe::Conventional => Actuation::Position,
    }
}

/// The vehicle for a flight in virtual time, whose links have no address.
///
/// # Errors
/// Never for what is filled in here; a change of the vehicle file's settings would show.
pub fn vehicle(mission: &Mission, role: Role) -> Result<Vehicle, Diagnostics> {
    Vehicle::new(vehicle_draft(mission, role, [1, 2]))
}
