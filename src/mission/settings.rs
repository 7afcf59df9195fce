//! What the executive is told once.

use std::sync::Arc;

use crate::autopilot;
use crate::geo::Enu;
use crate::pair;
use crate::planner::problem::Airspace;
use crate::preflight::Check;
use crate::radio::jitter::Jitter;
use crate::role::{PerVehicle, Role};
use crate::schedule::order::Order;
use crate::schedule::table::Timing;
use crate::schedule::trajectory::Limits;
use crate::service::Ceilings;
use crate::time::Utc;
use crate::transmitter::Demands;

use super::endurance::Battery;
use super::following::Following;
use super::permission::Permission;
use super::renewal::Replanner;
use super::scene::Scene;

/// Whose commands are obeyed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Operators {
    /// Everybody's: whatever comes over the autopilot's link has proven that its sender has the key.
    Proven,
    /// Those of these MAVLink systems.
    Systems(Vec<u8>),
}

impl Operators {
    /// Whether a command of this MAVLink system is obeyed.
    #[must_use]
    pub fn include(&self, system: u32) -> bool {
        match self {
            Self::Proven => true,
            Self::Systems(ids) => ids.iter().any(|id| u32::from(*id) == system),
        }
    }
}

/// See the module.
#[derive(Debug, Clone)]
pub struct Settings {
    /// Our part in the pair.
    pub role: Role,
    /// Our MAVLink system and component id.
    pub own: (u8, u8),
    /// The autopilot's driver.
    pub autopilot: autopilot::Settings,
    /// What is known of the battery.
    pub battery: Battery,
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
    /// The attitude jitter that the mission expects.
    pub jitter: Jitter,
    /// Power ceilings beside the plan's.
    pub ceilings: Ceilings,
    /// The transmitter is simulated, or the mission authorises emission.
    pub emission_authorised: bool,
    /// The mission's permission to radiate.
    pub permission: Permission,
    /// What is asked of the radio, beside the plan's powers.
    pub demands: Demands,
    /// The preflight's checks that the files alone decide: who can speak on a real transmitter's links, whether the altitude
    /// band has room for two return altitudes.
    pub given_checks: Vec<Check>,
    /// The radio has a link of its own: nothing that the autopilot's link brings is the radio's.
    pub radio_apart: bool,
    /// Whose commands are obeyed.
    pub operators: Operators,
    /// Nodes and radio, for the live figures.
    pub scene: Scene,
    /// Those that move, if any do.
    pub following: Option<Arc<Following>>,
    /// Makes the plan anew in flight, where nothing moves and the mission asks for it.
    pub replanner: Option<Replanner>,
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
