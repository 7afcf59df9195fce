//! How wrong a vehicle's pose may be at a knot: the least error that costs a given share of the rate there.
//!
//! An error of pointing turns the antenna's axis by so much about any axis across it, `R exp([w])` with w across body z; an
//! error of position moves the vehicle in any direction. The rate is the model's expectation with that error on top of all that
//! the mission says of jitter, floors, scattering and errors. The direction that costs most is found among those of a star, the
//! size along it by bisection, and again until no direction of the star costs more at that size.
//!
//! What J's error does to the user is said as well: its SINR, mean power over mean power and noise under jitter and scattering,
//! by three points of Gauss and Hermite for each angle that jitters.

use nalgebra::{Matrix3, Vector3};

use super::super::expectation::kernel::{ANGLES, POWER, Raw, VEHICLE};
use super::super::setup::Setup;
use super::turn::Angles;
use crate::radio::jitter::{self, JitterAxes};
use crate::radio::link::{self, Transmitter};
use crate::role::{PerVehicle, Role};

/// How wrong poses may be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tolerance {
    /// Error of each vehicle's antenna axis in radians, at most [`LARGEST_RAD`].
    pub pointing_rad: PerVehicle<f64>,
    /// Error of each vehicle's position in metres, at most [`LARGEST_M`].
    pub position_m: PerVehicle<f64>,
    /// What the user's SINR is with J wrong by that angle in the worst direction, over what it is without.
    pub user_sinr_ratio: f64,
}

impl Tolerance {
    /// What both of two allow.
    #[must_use]
    pub fn and(&self, other: &Self) -> Self {
        Self {
            pointing_rad: PerVehicle::from_fn(|role| self.pointing_rad[role].min(other.pointing_rad[role])),
            position_m: PerVehicle::from_fn(|role| self.position_m[role].min(other.position_m[role])),
            user_sinr_ratio: self.user_sinr_ratio.min(other.user_sinr_ratio),
        }
    }
}

/// Errors of pointing beyond this are not looked at.
pub const LARGEST_RAD: f64 = 0.5;
/// Errors of position beyond this are not looked at.
pub const LARGEST_M: f64 = 100.0;
/// The part of the rate that errors within their tolerances may cost in what is flown.
pub const TOLERATED: f64 = 0.02;
/// Which errors are looked at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sizes {
    /// Of pointing: where the search for a size begins, and up to which, radians.
    pub pointing_rad: [f64; 2],
    /// Of position, likewise, metres.
    pub position_m: [f64; 2],
}

impl Sizes {
    /// All that a plan tells.
    pub const ALL: Self =
        Self { pointing_rad: [LARGEST_RAD / 64.0, LARGEST_RAD], position_m: [LARGEST_M / 64.0, LARGEST_M] };
}

/// Bisections of a size.
const BISECTIONS: usize = 7;
/// Changes of the direction.
const ROUNDS: usize = 3;
/// Directions across an axis.
const ACROSS: usize = 8;

/// Tolerances of a configuration whose rate is `rate(raw)`, for losses of a share of it; `None` without a positive rate.
pub fn of(
    setup: &Setup,
    raw: &Raw,
    share: f64,
    sizes: &Sizes,
    mut rate: impl FnMut(&Raw) -> f64,
) -> Option<Tolerance> {
    let least = (1.0 - share) * rate(raw);
    if !(least > 0.0) {
        return None;
    }
    let mut pointing = |v: usize| {
        let star: Vec<[f64; 2]> = (0..ACROSS)
            .map(|k| {
                let (sin, cos) = libm::sincos(std::f64::consts::TAU * k as f64 / ACROSS as f64);
                [cos, sin]
            })
            .collect();
        smallest(&star, sizes.pointing_rad, least, |w, size| rate(&turned(raw, v, w.map(|c| c * size))))
    };
    let [(i_rad, _), (j_rad, worst)] = [0, 1].map(|v: usize| pointing(v));
    let star = directions();
    let mut position = |v: usize| {
        let moved = |d: [f64; 3], size: f64| {
            let mut moved = *raw;
            for k in 0..3 {
                moved[v * VEHICLE + k] += size * d[k];
            }
            rate(&moved)
        };
        smallest(&star, sizes.position_m, least, moved).0
    };
    let [i_m, j_m] = [0, 1].map(|v: usize| position(v));
    let astray = turned(raw, 1, worst.map(|c| c * j_rad));
    Some(Tolerance {
        pointing_rad: PerVehicle { i: i_rad, j: j_rad },
        position_m: PerVehicle { i: i_m, j: j_m },
        user_sinr_ratio: user_sinr(setup, &astray) / user_sinr(setup, raw),
    })
}

/// The least size, in any direction of a star, at which a rate falls to `least`, and the direction, between the size at which
/// the search begins and the largest.
fn smallest<D: Copy>(
    star: &[D],
    [beginning, largest]: [f64; 2],
    least: f64,
    mut rate: impl FnMut(D, f64) -> f64,
) -> (f64, D) {
    let mut worst_at = |size: f64| {
        let rated = star.iter().map(|d| (rate(*d, size), *d));
        rated.fold((f64::INFINITY, star[0]), |known, other| if other.0 < known.0 { other } else { known })
    };
    // The first size of a doubling series at which some direction costs too much.
    let mut size = beginning;
    let mut worst = worst_at(size);
    while worst.0 > least && size < largest {
        size = (2.0 * size).min(largest);
        worst = worst_at(size);
    }
    if worst.0 > least {
        return (largest, worst.1);
    }
    let mut outside = size;
    let mut direction = worst.1;
    for _ in 0..ROUNDS {
        let mut inside = 0.0;
        for _ in 0..BISECTIONS {
            let middle = 0.5 * (inside + outside);
            if rate(direction, middle) > least { inside = middle } else { outside = middle }
        }
        outside = inside;
        let rated = star.iter().map(|d| (rate(*d, inside), *d));
        let worst = rated
            .fold((f64::INFINITY, star[0]), |known, other| if other.0 < known.0 { other } else { known });
        if worst.0 > least {
            break;
        }
        direction = worst.1;
    }
    (outside, direction)
}

/// Along axes and space diagonals.
fn directions() -> Vec<[f64; 3]> {
    let third = 1.0 / 3f64.sqrt();
    let axes = (0..6).map(|k| {
        let mut axis = [0.0; 3];
        axis[k / 2] = if k % 2 == 0 { 1.0 } else { -1.0 };
        axis
    });
    let diagonals =
        (0..8).map(|k: usize| [0, 1, 2].map(|axis: usize| if k >> axis & 1 == 0 { third } else { -third }));
    axes.chain(diagonals).collect()
}

/// `Rz(yaw) Ry(pitch) Rx(roll)`, by functions that are the same on every machine.
fn rotation([roll, pitch, yaw]: Angles) -> Matrix3<f64> {
    let [(sr, cr), (sp, cp), (sy, cy)] = [roll, pitch, yaw].map(libm::sincos);
    Matrix3::new(
        cy * cp,
        cy * sp * sr - sy * cr,
        cy * sp * cr + sy * sr,
        sy * cp,
        sy * sp * sr + cy * cr,
        sy * sp * cr - cy * sr,
        -sp,
        cp * sr,
        cp * cr,
    )
}

/// The configuration with a vehicle's attitude turned by a rotation vector across its antenna's axis.
fn turned(raw: &Raw, v: usize, [x, y]: [f64; 2]) -> Raw {
    let at = v * VEHICLE + ANGLES;
    let [s, qx, qy, _] = jitter::body_rotation([x, y, 0.0]);
    // Of a unit quaternion without a z.
    let small = Matrix3::new(
        1.0 - 2.0 * qy * qy,
        2.0 * qx * qy,
        2.0 * s * qy,
        2.0 * qx * qy,
        1.0 - 2.0 * qx * qx,
        -2.0 * s * qx,
        -2.0 * s * qy,
        2.0 * s * qx,
        1.0 - 2.0 * (qx * qx + qy * qy),
    );
    let m = rotation([raw[at], raw[at + 1], raw[at + 2]]) * small;
    let mut out = *raw;
    out[at] = libm::atan2(m[(2, 1)], m[(2, 2)]);
    out[at + 1] = libm::atan2(-m[(2, 0)], libm::hypot(m[(2, 1)], m[(2, 2)]));
    out[at + 2] = libm::atan2(m[(1, 0)], m[(0, 0)]);
    out
}

/// The user's mean power from I over its mean power from J and noise.
fn user_sinr(setup: &Setup, raw: &Raw) -> f64 {
    let problem = setup.problem;
    let received = |v: usize| {
        let role = Role::BOTH[v];
        let at = v * VEHICLE;
        let antenna = &problem.antennas[role];
        let position_enu_m = Vector3::new(raw[at], raw[at + 1], raw[at + 2]);
        let path = problem.user_enu_m - position_enu_m;
        let gain =
            mean_over_jitter(setup, [raw[at + ANGLES], raw[at + ANGLES + 1], raw[at + ANGLES + 2]], |axis| {
                antenna.gain(&path, axis)
            });
        let gain = problem.fading.user.mean_gain(gain, antenna.mean());
        let from = Transmitter { position_enu_m, axis: Vector3::z(), tx_power_w: raw[at + POWER], antenna };
        link::power_at_gain_w(&from, &problem.user_enu_m, gain, problem.radio.reference_gain)
    };
    received(0) / (received(1) + problem.radio.noise_power_w)
}

/// A mean over an attitude's jitter, exact for what is of the fifth order in each angle.
fn mean_over_jitter(setup: &Setup, desired: Angles, value: impl Fn(&Vector3<f64>) -> f64) -> f64 {
    let noise = &setup.problem.jitter;
    let points = [(0.0, 2.0 / 3.0), (3f64.sqrt(), 1.0 / 6.0), (-(3f64.sqrt()), 1.0 / 6.0)];
    let yaws: &[(f64, f64)] = if noise.axes == JitterAxes::RollPitchYaw { &points } else { &[(0.0, 1.0)] };
    let mut sum = 0.0;
    for (roll, by_roll) in points {
        for (pitch, by_pitch) in points {
            for (yaw, by_yaw) in yaws {
                let w = [roll, pitch, *yaw].map(|c| c * noise.std_rad);
                let axis = match noise.model {
                    jitter::JitterModel::Euler => jitter::axis(noise.model, desired, w),
                    // By functions that are the same on every machine.
                    jitter::JitterModel::Body => rotation(desired) * jitter::body_axis(w),
                };
                sum += by_roll * by_pitch * by_yaw * value(&axis);
            }
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::planner::problem::Problem;
    use crate::radio::pattern;
    use proptest::prelude::*;

    const RAW: Raw = [25.0, 30.0, 85.0, 0.7, -0.4, 0.3, 0.5, 150.0, -210.0, 120.0, 0.9, 0.5, -0.2, 0.02];

    proptest! {
        #[test]
        fn prop_an_error_turns_the_axis_by_its_size(angle in 0.0..6.3f64, size in 0.0..0.5f64, v in 0..2usize) {
            let (sin, cos) = angle.sin_cos();
            let axis = |raw: &Raw| pattern::antenna_axis(raw[v * 7 + 3], raw[v * 7 + 4], raw[v * 7 + 5]);
            let wrong = turned(&RAW, v, [size * cos, size * sin]);
            prop_assert!((axis(&wrong).dot(&axis(&RAW)) - size.cos()).abs() < 1e-12);
        }
    }

    #[test]
    fn val_the_least_size_in_closed_form() {
        // A rate of 1 - 4 (d . a)^2 / a^2 falls by 2% at sqrt(0.02) / 2 along a, which is one of the star's directions.
        let star: Vec<[f64; 2]> = directions().iter().map(|d| [d[0], d[1]]).collect();
        let (size, direction) = smallest(&star, [0.01, 0.5], 0.98, |d, s| 1.0 - 4.0 * (s * d[1]).powi(2));
        assert!((size / (0.02f64.sqrt() / 2.0) - 1.0).abs() < 0.02, "{size}");
        assert!(direction[1].abs() == 1.0);
        assert_eq!(smallest(&star, [0.01, 0.5], 0.98, |_, _| 1.0).0, 0.5);
        // Begun at the largest it is the same, or the largest.
        let near = |largest| smallest(&star, [largest; 2], 0.98, |d, s| 1.0 - 4.0 * (s * d[1]).powi(2)).0;
        assert!((near(0.5) / size - 1.0).abs() < 0.02 && near(0.05) == 0.05, "{} {size}", near(0.5));
    }

    #[test]
    fn val_a_null_that_points_elsewhere_is_heard() {
        // J right above its user, its null on it: without jitter an angle d lets in sin^2 d.
        let mut problem = Problem::paper([[200.0, 80.0]], 0.5, 0.0);
        let raw: Raw = [30.0, 0.0, 80.0, 0.0, 0.0, 0.0, 0.5, 0.0, 0.0, 100.0, 0.0, 0.0, 0.0, 0.01];
        let ratio = |problem: &Problem| {
            let setup = Setup::new(problem).unwrap();
            user_sinr(&setup, &turned(&raw, 1, [0.0, 0.01])) / user_sinr(&setup, &raw)
        };
        let over_noise = 0.01 / 1e4 / 1e-12 * 0.01f64.sin().powi(2);
        assert!((ratio(&problem) * (1.0 + over_noise) - 1.0).abs() < 1e-9);
        // Under jitter of s in roll and pitch there is about 2 s^2 of it anyway.
        problem.jitter.std_rad = 0.02;
        let always = 0.01 / 1e4 / 1e-12 * 2.0 * 0.0004;
        let expected = (1.0 + always) / (1.0 + always + over_noise);
        assert!((ratio(&problem) / expected - 1.0).abs() < 0.01, "{}", ratio(&problem));
    }
}
