//! What a vehicle is doing when the next motion is to begin.

use super::motion::Motion;
use crate::geo::{Enu, EnuAcceleration, EnuVelocity};
use crate::planner::moving::Instant;
use crate::planner::plan::VehiclePlan;
use crate::role::{PerVehicle, Role};

/// A vehicle may be so far behind its motion, in seconds.
const BEHIND_S: f64 = 0.5;

/// See the module. The two vehicles may be flying different motions: one that the other has not taken up.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Flying<'a> {
    /// It rests like this.
    Rest(&'a VehiclePlan),
    /// It flies its part of this.
    Motion(&'a Motion),
}

impl<'a> Flying<'a> {
    /// Both rest like this.
    #[must_use]
    pub fn rest(vehicles: &'a PerVehicle<VehiclePlan>) -> PerVehicle<Self> {
        vehicles.as_ref().map(Flying::Rest)
    }

    /// Both fly this.
    #[must_use]
    pub fn motion(motion: &'a Motion) -> PerVehicle<Self> {
        PerVehicle::from_fn(|_| Flying::Motion(motion))
    }

    /// Pose and power of the vehicle at an instant, and how it moves.
    pub(super) fn at(&self, role: Role, t_s: f64) -> (VehiclePlan, Instant) {
        match self {
            Flying::Rest(vehicle) => {
                let rests = Instant {
                    position_enu_m: vehicle.pose.position_enu_m,
                    velocity_enu_m_s: EnuVelocity::ZERO,
                    acceleration_enu_m_s2: EnuAcceleration::ZERO,
                };
                (**vehicle, rests)
            }
            Flying::Motion(motion) => (motion.at(t_s).vehicles[role], motion.ways[role].at(t_s)),
        }
    }

    /// Points between which all lies that the vehicle may fly from an instant on, a little behind included.
    pub(super) fn reach(&self, role: Role, t_s: f64) -> Vec<Enu> {
        match self {
            Flying::Rest(vehicle) => vec![vehicle.pose.position_enu_m],
            Flying::Motion(motion) => motion.ways[role].hull_from(t_s - BEHIND_S).collect(),
        }
    }

    /// The motion, if it is on one.
    pub(super) fn on(&self) -> Option<&'a Motion> {
        match self {
            Flying::Rest(_) => None,
            Flying::Motion(motion) => Some(motion),
        }
    }
}
