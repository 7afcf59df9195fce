//! Ways between slots where nobody is silent for longer than need be: what the search for a superframe's poses is told.

use nalgebra::Vector3;

use super::super::volume::{Service, Ways};
use super::turn::{Angles, Course};
use crate::geo::Pose;
use crate::role::{PerVehicle, Role};

/// The ways of a schedule, with the guard and the time to come to rest in them: a slot is its time on the air alone
/// ([`on_air`]). At one place nobody comes to rest, and what turns within the guard costs nothing.
pub struct Turning<'a, W> {
    pub ways: &'a W,
    pub guard_s: f64,
    pub settle_s: f64,
    /// How far I and J may tilt.
    pub tilt_rad: [f64; 2],
}

/// A service whose slots are what was their time on the air.
pub fn on_air(service: &Service) -> Service {
    let [shortest_s, longest_s] = service.slot_limits_s;
    Service {
        slot_s: service.slot_s - service.guard_s,
        guard_s: 0.0,
        settle_s: 0.0,
        slot_limits_s: [shortest_s - service.guard_s, longest_s - service.guard_s],
        ..*service
    }
}

/// Whether two slots are served from the same positions, to the last bit.
pub fn at_one_place(from: &PerVehicle<Pose>, to: &PerVehicle<Pose>) -> bool {
    Role::BOTH.iter().all(|role| {
        let [a, b] = [from, to].map(|poses| poses[*role].position_enu_m);
        (0..3).all(|k| a[k].to_bits() == b[k].to_bits())
    })
}

/// A pose's roll, pitch and yaw.
pub fn angles(pose: &Pose) -> Angles {
    [pose.roll_rad, pose.pitch_rad, pose.yaw_rad]
}

impl<W: Ways> Ways for Turning<'_, W> {
    fn straight_s(&self, role: Role, by_m: &Vector3<f64>) -> (f64, Vector3<f64>) {
        self.ways.straight_s(role, by_m)
    }

    fn turn_rate_rad_s(&self, role: Role) -> f64 {
        self.ways.turn_rate_rad_s(role)
    }

    fn transit_s(&self, from: &PerVehicle<Pose>, to: &PerVehicle<Pose>) -> Option<f64> {
        if !at_one_place(from, to) {
            return Some(self.ways.transit_s(from, to)? + self.beside_s());
        }
        let turns_s = Role::BOTH.iter().zip(self.tilt_rad).map(|(role, tilt_rad)| {
            let (angle, _) = Course::within(tilt_rad).angle_rad(&angles(&from[*role]), &angles(&to[*role]));
            angle / self.turn_rate_rad_s(*role)
        });
        Some(turns_s.fold(self.guard_s, f64::max))
    }

    fn shortest(&self, users: usize, between_s: &[f64]) -> Vec<usize> {
        self.ways.shortest(users, between_s)
    }

    fn least_s(&self) -> f64 {
        self.guard_s
    }

    fn beside_s(&self) -> f64 {
        self.guard_s + self.settle_s
    }
}
