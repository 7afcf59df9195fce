//! The vehicle file of a simulated vehicle's companion.

use crate::config::{Diagnostics, Mission, Vehicle};
use crate::planner::problem::Airframe;
use crate::role::Role;

use super::index;

/// What differs between the vehicle files of simulated vehicles.
#[derive(Debug, Clone)]
pub struct VehicleText<'a> {
    /// I or J.
    pub role: Role,
    /// Address of the autopilot link.
    pub autopilot_link: &'a str,
    /// Address of the pair link.
    pub pair_link: &'a str,
    /// As in the vehicle file.
    pub actuation: &'a str,
    /// The transmitter is declared to radiate nothing real.
    pub simulated: bool,
    /// Directory for logs, as a TOML value; without it, the default.
    pub log_dir: Option<String>,
}

impl VehicleText<'_> {
    /// The file's text.
    #[must_use]
    pub fn text(&self) -> String {
        let Self { role, autopilot_link, pair_link, actuation, simulated, .. } = self;
        let name = role.to_string().to_lowercase();
        let system_id = 1 + index(*role);
        let log = self.log_dir.as_ref().map_or(String::new(), |dir| format!("\n[log]\ndir = {dir}\n"));
        format!(
            "# The simulated vehicle {role}.\n\
             [vehicle]\nrole = \"{name}\"\n\n\
             [autopilot]\nlink = \"{autopilot_link}\"\nactuation = \"{actuation}\"\nsystem_id = {system_id}\n\n\
             [transmitter]\nkind = \"leased\"\nsimulated = {simulated}\n\n\
             [pair]\nlink = \"{pair_link}\"\n{log}"
        )
    }
}

/// How the simulated vehicle of this role is commanded.
#[must_use]
pub fn actuation(mission: &Mission, role: Role) -> &'static str {
    match mission.vehicles[role].airframe {
        Airframe::Omnidirectional => "pose",
        Airframe::Conventional => "position",
    }
}

/// The vehicle file for a flight in virtual time, whose links have no address.
///
/// # Errors
/// Never for the text that is written here; a change of the vehicle file's settings would show.
pub fn vehicle(mission: &Mission, role: Role) -> Result<Vehicle, Diagnostics> {
    let text = VehicleText {
        role,
        autopilot_link: "udpout:127.0.0.1:1",
        pair_link: "udpout:127.0.0.1:2",
        actuation: actuation(mission, role),
        simulated: true,
        log_dir: None,
    };
    Vehicle::parse("simulated vehicle", &text.text())
}
