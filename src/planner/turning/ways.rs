//! Ways between slots where nobody is silent for longer than need be: what the search for a superframe's poses is told.

use nalgebra::Vector3;

use super::super::setup::Setup;
use super::super::volume::{Service, Ways};
use super::path::READY_S;
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

impl<'a, W> Turning<'a, W> {
    /// For users of `service`, of whom all share the limits that `setup` states.
    pub fn new(ways: &'a W, service: &Service, setup: &Setup<'_>) -> Self {
        Self { ways, guard_s: service.guard_s, settle_s: service.settle_s, tilt_rad: setup.tilt_rad }
    }
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
        Some((turns_s.fold(0.0, f64::max) + READY_S).max(self.guard_s))
    }

    fn shortest(&self, users: usize, between_s: &[f64]) -> Vec<usize> {
        self.ways.shortest(users, between_s)
    }

    fn least_s(&self) -> f64 {
        (self.guard_s - READY_S).max(0.0)
    }

    fn ready_s(&self) -> f64 {
        READY_S
    }

    fn beside_s(&self) -> f64 {
        self.guard_s + self.settle_s
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::expectation::kernel::Raw;
    use super::super::super::volume::testing::Plain;
    use super::super::super::volume::ways::{largest_s, smoothed};
    use super::*;

    const A: Raw = [5.0, 3.0, 80.0, 0.8, -0.3, 0.0, 0.5, 90.0, -210.0, 80.0, 1.1, 0.8, 0.0, 0.006];

    #[test]
    fn val_a_leg_is_the_guard_or_the_turn_or_the_way_and_all_beside_it() {
        let ways = Plain::default();
        let turning = Turning { ways: &ways, guard_s: 1.0, settle_s: 2.0, tilt_rad: [2.0; 2] };
        let mut near = A;
        near[3] += 0.4;
        let mut far = A;
        far[3] -= 1.6;
        let mut elsewhere = near;
        elsewhere[0] += 40.0;
        for (to, expected) in [(A, 1.0), (near, 1.0), (far, 2.0 + READY_S), (elsewhere, 1.0 + 2.0 + 5.0)] {
            let largest = largest_s(&turning, &A, &to);
            assert!((largest - expected).abs() < 1e-12, "{largest} {expected}");
            let smooth = smoothed(&turning, &A, &to, 12.0).time_s;
            assert!(smooth >= largest && smooth <= 5f64.powf(1.0 / 12.0) * largest);
            let numeric = |k: usize| {
                let at = |step: f64| {
                    let mut moved = to;
                    moved[k] += step;
                    smoothed(&turning, &A, &moved, 12.0).time_s
                };
                (at(1e-6) - at(-1e-6)) / 2e-6
            };
            let by = smoothed(&turning, &A, &to, 12.0).by[1];
            assert!(to == A || (by[3] - numeric(3)).abs() < 1e-6, "{by:?} {}", numeric(3));
        }
        let pose = |raw: &Raw, at: usize| Pose {
            position_enu_m: Vector3::new(raw[at], raw[at + 1], raw[at + 2]),
            roll_rad: raw[at + 3],
            pitch_rad: raw[at + 4],
            yaw_rad: raw[at + 5],
        };
        let poses = |raw: &Raw| PerVehicle { i: pose(raw, 0), j: pose(raw, 7) };
        for to in [A, near, far, elsewhere] {
            let flown = turning.transit_s(&poses(&A), &poses(&to)).unwrap();
            assert!((flown - largest_s(&turning, &A, &to)).abs() < 1e-12);
        }
    }

    #[test]
    fn val_a_slot_is_its_time_on_the_air() {
        let service = Service {
            slot_s: 10.0,
            guard_s: 1.0,
            settle_s: 2.0,
            slot_limits_s: [5.0, 20.0],
            fairness: super::super::Fairness::MaxMin,
            may_reorder: true,
        };
        let air = on_air(&service);
        assert_eq!((air.slot_s, air.guard_s, air.settle_s, air.slot_limits_s), (9.0, 0.0, 0.0, [4.0, 19.0]));
        assert!(air.may_reorder);
    }
}
