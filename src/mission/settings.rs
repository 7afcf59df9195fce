//! What the executive is told once.

use crate::autopilot;
use crate::geo::Enu;
use crate::pair;
use crate::planner::problem::Airspace;
use crate::role::{PerVehicle, Role};
use crate::schedule::order::Order;
use crate::schedule::table::Timing;
use crate::schedule::trajectory::Limits;
use crate::service::Ceilings;
use crate::time::Utc;

use super::scene::Scene;

/// See the module.
#[derive(Debug, Clone)]
pub struct Settings {
    /// Our part in the pair.
    pub role: Role,
    /// Our MAVLink system and component id.
    pub own: (u8, u8),
    /// The autopilot's driver.
    pub autopilot: autopilot::Settings,
    /// The pair protocol.
    pub pair: pair::Settings,
    /// Where vehicles may be.
    pub airspace: Airspace,
    /// What the slot table demands of each vehicle.
    pub limits: PerVehicle<Limits>,
    /// Lengths of slots and number of superframes.
    pub timing: Timing,
    /// The order of users.
    pub order: Order,
    /// Standard deviation of the attitude jitter the mission expects, radians per axis.
    pub jitter_rad: f64,
    /// Power ceilings beside the plan's.
    pub ceilings: Ceilings,
    /// The transmitter is simulated, or the mission authorises emission.
    pub emission_authorised: bool,
    /// Nodes and radio, for the live figures.
    pub scene: Scene,
    /// Begin as soon as both vehicles are ready, without waiting for MISSION_START.
    pub start_unasked: bool,
    /// When the transit to the first slot begins, unless the operator decides.
    pub start_utc: Option<Utc>,
}

impl Settings {
    /// The point above `home` at the bottom of the altitude band.
    pub(super) fn above(&self, home: Enu) -> Enu {
        Enu::new(home.x, home.y, self.airspace.altitude_m[0])
    }
}
