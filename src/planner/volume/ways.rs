//! How long the vehicles take from the poses of one slot to those of the next: what a search must know of transits.
//!
//! The ways themselves are the schedule's, which lies above the planner and hands in what is asked for here. A search
//! takes vehicles to fly straight on and to turn on the way, whichever takes longest, and smooths that maximum; what it
//! ends with is timed by the ways that will be flown.

use nalgebra::{Quaternion, Vector3};

use super::super::expectation::kernel::{ANGLES, Raw, VEHICLE};
use crate::geo::Pose;
use crate::role::{PerVehicle, Role};

/// What a search asks of whoever times transits.
pub trait Ways: Sync {
    /// How long a vehicle takes straight on from rest to rest, in seconds, and how that changes with the way, in s/m.
    fn straight_s(&self, role: Role, by_m: &Vector3<f64>) -> (f64, Vector3<f64>);

    /// How fast a vehicle turns, in rad/s.
    fn turn_rate_rad_s(&self, role: Role) -> f64;

    /// How long both vehicles take from poses to poses by the way that is flown, in seconds; `None` where there is none.
    fn transit_s(&self, from: &PerVehicle<Pose>, to: &PerVehicle<Pose>) -> Option<f64>;

    /// The order of all users that makes a superframe shortest, by the time between any two: row-major (from, to), in
    /// seconds. The first is user 0: a superframe has no beginning.
    fn shortest(&self, users: usize, between_s: &[f64]) -> Vec<usize>;

    /// The least time between two slots that are served from the same positions, in seconds: a turn that takes no longer costs
    /// nothing.
    fn least_s(&self) -> f64 {
        0.0
    }

    /// What a turn between two slots that are served from the same positions takes beside that, in seconds.
    fn ready_s(&self) -> f64 {
        0.0
    }

    /// What a way between different positions takes beside the flight, in seconds.
    fn beside_s(&self) -> f64 {
        0.0
    }
}

/// Whether two configurations have both positions in common, to the last bit.
pub fn is_same_place(a: &Raw, b: &Raw) -> bool {
    [0, VEHICLE].iter().all(|at| (0..3).all(|k| a[at + k].to_bits() == b[at + k].to_bits()))
}

/// The least time of a leg, and what it takes beside the flight.
fn fixed_s(ways: &impl Ways, from: &Raw, to: &Raw) -> [f64; 2] {
    if is_same_place(from, to) { [ways.least_s(), ways.ready_s()] } else { [0.0, ways.beside_s()] }
}

/// The angle between the attitudes of two vehicles, roll, pitch and yaw, and how it changes with either.
pub fn turn_rad(from: &[f64], to: &[f64]) -> (f64, [[f64; 3]; 2]) {
    let [(a, by_a), (b, by_b)] = [from, to].map(attitude);
    let cosine = a.coords.dot(&b.coords);
    // The vector part keeps its accuracy where the cosine of half the angle is close to 1.
    let sine = (a.conjugate() * b).vector().norm();
    let angle = 2.0 * libm::atan2(sine, cosine.abs());
    // A turn of nothing has no direction.
    let slope = if sine > 1e-12 { -2.0 * cosine.signum() / sine } else { 0.0 };
    let by =
        |own: [Quaternion<f64>; 3], other: Quaternion<f64>| own.map(|q| slope * q.coords.dot(&other.coords));
    (angle, [by(by_a, b), by(by_b, a)])
}

/// `Rz(yaw) Ry(pitch) Rx(roll)` as a quaternion, and its derivatives by roll, pitch and yaw.
fn attitude(angles: &[f64]) -> (Quaternion<f64>, [Quaternion<f64>; 3]) {
    let [(sr, cr), (sp, cp), (sy, cy)] = [0, 1, 2].map(|k: usize| libm::sincos(0.5 * angles[k]));
    let x = Quaternion::new(cr, sr, 0.0, 0.0);
    let y = Quaternion::new(cp, 0.0, sp, 0.0);
    let z = Quaternion::new(cy, 0.0, 0.0, sy);
    let by_x = Quaternion::new(-sr, cr, 0.0, 0.0) * 0.5;
    let by_y = Quaternion::new(-sp, 0.0, cp, 0.0) * 0.5;
    let by_z = Quaternion::new(-sy, 0.0, 0.0, cy) * 0.5;
    (z * y * x, [z * y * by_x, z * by_y * x, by_z * y * x])
}

/// The time of a transit and how it changes with the configurations that it joins.
pub struct Smoothed {
    /// In seconds.
    pub time_s: f64,
    /// By the configuration that it leaves, and by the one that it reaches.
    pub by: [Raw; 2],
}

/// The larger of all times that a transit takes, smoothed to a norm of this power: never less than the largest, and at most
/// `5^(1/power)` times it. Without slopes where nobody asks for them.
pub fn smoothed(ways: &impl Ways, from: &Raw, to: &Raw, power: f64) -> Smoothed {
    let [least_s, beside_s] = fixed_s(ways, from, to);
    let mut times = [0.0, 0.0, 0.0, 0.0, least_s];
    let mut moves = [Vector3::zeros(); 2];
    let mut turns = [[[0.0; 3]; 2]; 2];
    for (v, role) in Role::BOTH.into_iter().enumerate() {
        let at = v * VEHICLE;
        let by_m = Vector3::from_fn(|k, _| to[at + k] - from[at + k]);
        (times[2 * v], moves[v]) = ways.straight_s(role, &by_m);
        let angles = at + ANGLES..at + ANGLES + 3;
        let (angle, slopes) = turn_rad(&from[angles.clone()], &to[angles]);
        let rate = ways.turn_rate_rad_s(role);
        times[2 * v + 1] = angle / rate;
        turns[v] = slopes.map(|slope| slope.map(|c| c / rate));
    }
    let largest = times.iter().fold(0.0, |a: f64, b| a.max(*b));
    let mut by = [[0.0; 14]; 2];
    if largest <= 0.0 {
        return Smoothed { time_s: beside_s, by };
    }
    let sum: f64 = times.iter().map(|t| libm::pow(t / largest, power)).sum();
    let time_s = largest * libm::pow(sum, 1.0 / power);
    for v in 0..2 {
        let at = v * VEHICLE;
        let [move_share, turn_share] =
            [2 * v, 2 * v + 1].map(|k: usize| libm::pow(times[k] / time_s, power - 1.0));
        for k in 0..3 {
            by[0][at + k] = -move_share * moves[v][k];
            by[1][at + k] = move_share * moves[v][k];
            by[0][at + ANGLES + k] = turn_share * turns[v][0][k];
            by[1][at + ANGLES + k] = turn_share * turns[v][1][k];
        }
    }
    Smoothed { time_s: time_s + beside_s, by }
}

/// The largest of the times of straight ways and turns, in seconds.
pub fn largest_s(ways: &impl Ways, from: &Raw, to: &Raw) -> f64 {
    let [mut largest, beside_s] = fixed_s(ways, from, to);
    for (v, role) in Role::BOTH.into_iter().enumerate() {
        let at = v * VEHICLE;
        let by_m = Vector3::from_fn(|k, _| to[at + k] - from[at + k]);
        let angles = at + ANGLES..at + ANGLES + 3;
        let turn_s = turn_rad(&from[angles.clone()], &to[angles]).0 / ways.turn_rate_rad_s(role);
        largest = largest.max(ways.straight_s(role, &by_m).0).max(turn_s);
    }
    largest + beside_s
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geo::Attitude;
    use crate::planner::volume::testing::Plain;

    const A: Raw = [5.0, 3.0, 80.0, 0.8, -0.3, 0.2, 0.5, 90.0, -210.0, 80.0, 1.1, 0.8, -0.1, 0.006];
    const B: Raw = [-15.0, 9.0, 85.0, 0.1, 0.9, 0.0, 0.5, 60.0, -200.0, 99.0, 0.4, -0.8, 0.3, 0.006];

    #[test]
    fn val_a_turn_is_the_angle_between_the_attitudes() {
        let attitude = |raw: &Raw, at: usize| Attitude::from_euler(raw[at], raw[at + 1], raw[at + 2]);
        for at in [ANGLES, VEHICLE + ANGLES] {
            let expected = attitude(&A, at).angle_to(&attitude(&B, at));
            let (angle, _) = turn_rad(&A[at..at + 3], &B[at..at + 3]);
            assert!((angle - expected).abs() < 1e-12, "{angle} {expected}");
        }
        assert_eq!(turn_rad(&A[3..6], &A[3..6]).1, [[0.0; 3]; 2]);
    }

    #[test]
    fn val_slopes_are_those_of_central_differences() {
        let ways = Plain::default();
        for power in [2.0, 12.0] {
            let found = smoothed(&ways, &A, &B, power);
            for (end, from) in [A, B].into_iter().enumerate() {
                for k in 0..14 {
                    let at = |step: f64| {
                        let mut moved = from;
                        moved[k] += step;
                        let ends = if end == 0 { [moved, B] } else { [A, moved] };
                        smoothed(&ways, &ends[0], &ends[1], power).time_s
                    };
                    let numeric = (at(1e-5) - at(-1e-5)) / 2e-5;
                    assert!(
                        (numeric - found.by[end][k]).abs() < 1e-7,
                        "{end} {k}: {numeric} {}",
                        found.by[end][k]
                    );
                }
            }
        }
    }

    #[test]
    fn val_the_norm_comes_down_to_the_largest() {
        let ways = Plain::default();
        let largest = largest_s(&ways, &A, &B);
        let mut before = f64::INFINITY;
        for power in [2.0, 12.0, 100.0, 1000.0] {
            let time_s = smoothed(&ways, &A, &B, power).time_s;
            assert!(
                time_s >= largest
                    && time_s <= before
                    && time_s <= largest * 4f64.powf(1.0 / power) * (1.0 + 1e-12)
            );
            before = time_s;
        }
        assert!(smoothed(&ways, &A, &A, 12.0).time_s < 1e-15);
    }
}
