//! Tracks for tests.

use super::super::moving::{Limits, Spline};
use super::super::plan::VehiclePlan;
use super::super::turning::{Between, Course, Knot, Protected, Slot, Tolerance};
use super::{Track, tracks};
use crate::geo::{Enu, Pose};
use crate::role::PerVehicle;

pub(crate) const LIMITS: Limits =
    Limits { speed_m_s: 9.0, climb_m_s: 3.0, acceleration_m_s2: 3.0, jerk_m_s3: None };

/// East at some 6 m/s by the second second of ten, and back, in one attitude; where a plan bears no more than `tolerance` of either
/// vehicle.
pub(crate) fn on_a_way(pose: Pose, tolerance: Option<Tolerance>) -> Track {
    let points = [[0.0, 0.0, 80.0], [30.0, 0.0, 80.0], [30.0, 20.0, 80.0], [0.0, 20.0, 80.0]].map(Enu::from);
    let ways = PerVehicle::from_fn(|_| Spline { period_s: 20.0, control_enu_m: points.to_vec() });
    let vehicle = VehiclePlan { pose, tx_power_w: 0.1 };
    let knot = |at_s: f64| Knot {
        at_s,
        vehicles: PerVehicle { i: vehicle, j: vehicle },
        served: Some(0),
        rate_bps: 1e6,
        tolerance,
    };
    let slot = Slot {
        user: 0,
        on_air_s: 9.0,
        silence_s: 1.0,
        between: Between::Turn(PerVehicle { i: Course::Shortest, j: Course::Shortest }),
        volume_bits: 1e6,
        knots: vec![knot(0.5), knot(9.5)],
    };
    let turns = Protected { slots: vec![slot], superframe_s: 10.0 };
    tracks(&turns, Some(&ways), 1.0, &PerVehicle { i: LIMITS, j: LIMITS })[0].j.clone()
}

/// In its place, from one roll to another in the second between two users: J's track of the second one's slot.
pub(crate) fn between_users(pose: Pose, from_rad: f64, to_rad: f64) -> Track {
    let slot = |user: usize, roll_rad: f64| {
        let vehicle = VehiclePlan { pose: Pose { roll_rad, ..pose }, tx_power_w: 0.1 };
        let knot = |at_s: f64| Knot {
            at_s: 10.0 * user as f64 + at_s,
            vehicles: PerVehicle { i: vehicle, j: vehicle },
            served: Some(user),
            rate_bps: 1e6,
            tolerance: None,
        };
        Slot {
            user,
            on_air_s: 9.0,
            silence_s: 1.0,
            between: Between::Turn(PerVehicle { i: Course::Shortest, j: Course::Shortest }),
            volume_bits: 1e6,
            knots: vec![knot(0.5), knot(9.5)],
        }
    };
    let turns = Protected { slots: vec![slot(0, from_rad), slot(1, to_rad)], superframe_s: 20.0 };
    tracks(&turns, None, 1.0, &PerVehicle { i: LIMITS, j: LIMITS })[1].j.clone()
}
