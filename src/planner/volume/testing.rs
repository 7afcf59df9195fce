//! Ways for tests that know no schedule.

use nalgebra::Vector3;

use super::ways::{Ways, largest_s};
use crate::geo::Pose;
use crate::planner::expectation::kernel::{ANGLES, Raw, VEHICLE};
use crate::role::{PerVehicle, Role};

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
