//! Where everybody is, and the radio they share.

use crate::geo::Enu;
use crate::planner::problem::Radio;
use crate::radio::antenna::Pattern;
use crate::radio::fading::Fading;
use crate::role::PerVehicle;

/// The nodes and the radio of a mission, for the live figures.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    /// The users, in the mission file's order, ENU.
    pub users_enu_m: Vec<Enu>,
    /// The eavesdroppers where they are thought to be, ENU.
    pub eavesdroppers_enu_m: Vec<Enu>,
    /// Bandwidth, noise and reference gain.
    pub radio: Radio,
    /// What is known of the vehicles' antennas.
    pub antennas: PerVehicle<Pattern>,
    /// What is known of scattering about the nodes.
    pub fading: Fading,
}
