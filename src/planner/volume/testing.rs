//! A superframe for tests: users, how they are served, and ways that know no schedule.

use nalgebra::Vector3;

use super::ways::{Ways, largest_s};
use super::{Fairness, Service};
use crate::geo::Pose;
use crate::planner::expectation::kernel::{ANGLES, Raw, VEHICLE};
use crate::planner::problem::Problem;
use crate::role::{PerVehicle, Role};

/// Equal slots, in the order that is listed.
pub const SERVICE: Service = Service {
    slot_s: 10.0,
    guard_s: 1.0,
    settle_s: 2.0,
    slot_limits_s: [5.0, 20.0],
    fairness: Fairness::Slots,
    may_reorder: false,
};

/// Three users some hundred metres apart among three eavesdroppers.
pub fn problems(jitter_deg: f64) -> Vec<Problem> {
    let mut problem =
        Problem::paper([[200.0, 80.0], [-150.0, 210.0], [40.0, -300.0]], 0.5, f64::to_radians(jitter_deg));
    problem.airspace.min_separation_m = 5.0;
    [[0.0, 0.0], [90.0, 40.0], [-60.0, 110.0]]
        .map(|[east, north]| Problem { user_enu_m: Vector3::new(east, north, 0.0), ..problem.clone() })
        .to_vec()
}

/// At constant speed, and never in each other's way.
pub struct Plain {
    pub speed_m_s: f64,
    pub turn_rate_rad_s: f64,
}

impl Default for Plain {
    fn default() -> Self {
        Self { speed_m_s: 8.0, turn_rate_rad_s: 0.8 }
    }
}

/// Positions and angles alone.
fn raw(poses: &PerVehicle<Pose>) -> Raw {
    let mut raw = [0.0; 14];
    for (v, pose) in [&poses.i, &poses.j].into_iter().enumerate() {
        let at = v * VEHICLE;
        raw[at..at + 3].copy_from_slice(pose.position_enu_m.as_slice());
        raw[at + ANGLES..at + ANGLES + 3].copy_from_slice(&[pose.roll_rad, pose.pitch_rad, pose.yaw_rad]);
    }
    raw
}

impl Ways for Plain {
    fn straight_s(&self, _: Role, by_m: &Vector3<f64>) -> (f64, Vector3<f64>) {
        let distance = by_m.norm();
        let along = if distance > 0.0 { by_m / distance } else { Vector3::zeros() };
        (distance / self.speed_m_s, along / self.speed_m_s)
    }

    fn turn_rate_rad_s(&self, _: Role) -> f64 {
        self.turn_rate_rad_s
    }

    fn transit_s(&self, from: &PerVehicle<Pose>, to: &PerVehicle<Pose>) -> Option<f64> {
        Some(largest_s(self, &raw(from), &raw(to)))
    }

    /// Of all orders.
    fn shortest(&self, users: usize, between_s: &[f64]) -> Vec<usize> {
        let length = |order: &[usize]| -> f64 {
            (0..users).map(|k| between_s[order[k] * users + order[(k + 1) % users]]).sum()
        };
        let mut best: Vec<usize> = (0..users).collect();
        let mut stack = vec![vec![0]];
        while let Some(begun) = stack.pop() {
            if begun.len() == users && length(&begun) < length(&best) {
                best = begun;
                continue;
            }
            stack.extend((1..users).filter(|user| !begun.contains(user)).map(|user| {
                let mut longer = begun.clone();
                longer.push(user);
                longer
            }));
        }
        best
    }
}
