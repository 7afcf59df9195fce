//! Where a global search starts.
//!
//! What the optima look like (MODEL section 5), vehicle by vehicle:
//! - I, free to tilt: near the user and low, its axis across a line through the user that avoids the eavesdroppers, or
//!   with its null on one of them. Tilt limited or level: above an eavesdropper, or where its axis at the limit points at
//!   one, at any altitude.
//! - J, free to tilt: near an eavesdropper, low; sometimes above the user. Tilt limited: on the cone over the user within
//!   which it can null it, at any altitude; level: right above the user.
//! - J's power: where the interference that it leaves at the user, at its null (jitter, floor, scattering), is 3 to 100 times the
//!   noise: from the link budget, never from its cap.
//!
//! A start that falls into a no-fly area leaves it by one of its ways out, drawn at random: round it on either side, over or
//! under it.
//!
//! The first starts take the kinds in turn, so that few of them suffice where the optimum is of the usual kind. From
//! [`ELSEWHERE`] on, half of them are drawn uniformly from all there is, in order to find what the kinds leave out.

use nalgebra::{Vector2, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::expectation::kernel::{ANGLES, POWER, Raw, VEHICLE};
use super::expectation::sobol;
use super::phase1;
use super::setup::{Setup, from_user};
use crate::radio::pattern;

/// A tilt limit below this changes the usual kinds of optima.
pub const RESTRICTED_RAD: f64 = 1.2;

/// From this start on, every other eight know nothing of what optima look like.
pub const ELSEWHERE: usize = 128;

/// Whether a start is drawn uniformly.
pub fn is_elsewhere(index: usize) -> bool {
    index >= ELSEWHERE && (index / 8) % 2 == 1
}

/// A start drawn uniformly: positions from the airspace, axes from the sphere, J's power from the whole logarithmic range.
fn elsewhere(setup: &Setup, rng: &mut ChaCha8Rng) -> Raw {
    let [low, high] = setup.problem.airspace.altitude_m;
    let [of_i, of_j] = setup.highest_w;
    let mut raw = [0.0; 14];
    for part in raw.chunks_mut(VEHICLE) {
        let (x, y) = setup.uniform(rng);
        let at = setup.outside(Vector3::new(x, y, rng.random_range(low..=high)));
        part[..3].copy_from_slice(at.as_slice());
        let (sin, cos) = libm::sincos(rng.random_range(0.0..std::f64::consts::TAU));
        let z = rng.random_range(0.0f64..1.0);
        let r = (1.0 - z * z).sqrt();
        (part[ANGLES], part[ANGLES + 1]) = pattern::canonical_angles(&Vector3::new(r * cos, r * sin, z));
    }
    raw[POWER] = of_i;
    raw[VEHICLE + POWER] = of_j * libm::pow(10.0, -6.0 * rng.random_range(0.0..1.0));
    raw
}

/// Start `index`.
pub fn start(setup: &Setup, index: usize, seed: u64) -> Raw {
    let mut rng = ChaCha8Rng::seed_from_u64(sobol::mix(seed, 0x57a7 + index as u64));
    if is_elsewhere(index) {
        return elsewhere(setup, &mut rng);
    }
    let (i, axis) = information(setup, index, &mut rng);
    let j = jammer(setup, index, &mut rng);
    let user = setup.problem.user_enu_m;
    let mut raw = [0.0; 14];
    raw[..3].copy_from_slice(i.as_slice());
    raw[VEHICLE..VEHICLE + 3].copy_from_slice(j.as_slice());
    (raw[ANGLES], raw[ANGLES + 1]) = pattern::canonical_angles(&axis);
    (raw[VEHICLE + ANGLES], raw[VEHICLE + ANGLES + 1]) = pattern::canonical_angles(&(j - user));
    raw[POWER] = setup.highest_w[0];
    raw[VEHICLE + POWER] = jammer_power_w(setup, &j, rng.random_range(0.0..1.0));
    if setup.problem.free_yaw {
        turn(&mut raw, &mut rng);
    }
    raw
}

/// The same axes at yaws drawn at random: noise in roll and pitch acts otherwise on each.
fn turn(raw: &mut Raw, rng: &mut ChaCha8Rng) {
    for vehicle in raw.chunks_mut(VEHICLE) {
        let axis = pattern::antenna_axis(vehicle[ANGLES], vehicle[ANGLES + 1], 0.0);
        let yaw = rng.random_range(-std::f64::consts::PI..std::f64::consts::PI);
        let (sin, cos) = libm::sincos(yaw);
        let back = Vector3::new(cos * axis.x + sin * axis.y, cos * axis.y - sin * axis.x, axis.z);
        (vehicle[ANGLES], vehicle[ANGLES + 1]) = pattern::canonical_angles(&back);
        vehicle[ANGLES + 2] = yaw;
    }
}

/// I's position and axis.
fn information(setup: &Setup, index: usize, rng: &mut ChaCha8Rng) -> (Vector3<f64>, Vector3<f64>) {
    let problem = setup.problem;
    let from_user = from_user(problem);
    let n = from_user.len();
    let restricted = setup.tilt_rad[0] < RESTRICTED_RAD;
    // Every eavesdropper at either end of the altitude band in turn.
    if (restricted && !index.is_multiple_of(4)) || (!restricted && index % 8 == 7) {
        let turn = index / 2;
        let node = problem.eavesdroppers[turn % n].position_enu_m;
        let altitude = altitude(setup, turn / n, rng);
        let reach = libm::tan(setup.tilt_rad[0].min(1.3)) * (altitude - node.z).abs();
        let radius = if index.is_multiple_of(3) { reach } else { reach * rng.random_range(0.0f64..1.0) };
        let at = around(node.xy(), radius, altitude, rng);
        let at = setup.allowed_by_some_way(at, rng);
        return (at, at - node);
    }
    let spread = 0.3 * setup.length_m;
    let (dx, dy) = (rng.random_range(-spread..=spread), rng.random_range(-spread..=spread));
    let user = problem.user_enu_m;
    let at = Vector3::new(user.x + dx, user.y + dy, problem.airspace.altitude_m[0]);
    let at = setup.allowed_by_some_way(at, rng);
    let nu = match index % 3 {
        0 => phase1::line_angle(&from_user),
        1 => {
            let p = from_user[(index / 3) % n];
            libm::atan2(p.y, p.x) + std::f64::consts::FRAC_PI_2
        }
        _ => rng.random_range(0.0..std::f64::consts::PI),
    };
    // Straight over the user the map is that of a point a little above it.
    (at, phase1::axis_map(nu) * (at - user + Vector3::new(0.0, 0.0, 1e-3)))
}

/// J's position.
fn jammer(setup: &Setup, index: usize, rng: &mut ChaCha8Rng) -> Vector3<f64> {
    let problem = setup.problem;
    let n = problem.eavesdroppers.len();
    let user = problem.user_enu_m;
    let [low, high] = problem.airspace.altitude_m;
    let restricted = setup.tilt_rad[1] < RESTRICTED_RAD;
    let above_user = if restricted { index % 3 != 2 } else { index % 8 == 5 };
    if above_user {
        let altitude = altitude(setup, index / 3, rng);
        let reach = libm::tan(setup.tilt_rad[1].min(1.0)) * (altitude - user.z).abs();
        let radius = if index.is_multiple_of(2) { reach } else { reach * rng.random_range(0.0f64..1.0) };
        let at = around(user.xy(), radius, altitude, rng);
        return setup.allowed_by_some_way(at, rng);
    }
    if index % 8 == 3 {
        let (x, y) = setup.uniform(rng);
        return setup.outside(Vector3::new(x, y, rng.random_range(low..=high)));
    }
    let node = problem.eavesdroppers[(index / 2) % n].position_enu_m;
    let z = if index % 4 == 2 { rng.random_range(low..=high) } else { low };
    let spread = 0.5 * setup.length_m;
    let (dx, dy) = (rng.random_range(-spread..=spread), rng.random_range(-spread..=spread));
    setup.allowed_by_some_way(Vector3::new(node.x + dx, node.y + dy, z), rng)
}

/// High, low and anywhere between, in turn.
fn altitude(setup: &Setup, turn: usize, rng: &mut ChaCha8Rng) -> f64 {
    let [low, high] = setup.problem.airspace.altitude_m;
    match turn % 3 {
        0 => high,
        1 => low,
        _ => rng.random_range(low..=high),
    }
}

/// A point at a distance from `centre`, in a random direction.
fn around(centre: Vector2<f64>, radius: f64, z: f64, rng: &mut ChaCha8Rng) -> Vector3<f64> {
    let angle = rng.random_range(0.0..std::f64::consts::TAU);
    let (sin, cos) = libm::sincos(angle);
    Vector3::new(centre.x + radius * cos, centre.y + radius * sin, z)
}

/// J's power at a start.
pub fn jammer_power_w(setup: &Setup, j: &Vector3<f64>, draw: f64) -> f64 {
    let problem = setup.problem;
    let cap = setup.highest_w[1];
    let distance2 = (j - problem.user_enu_m).norm_squared();
    let leak = setup.leak(distance2.sqrt());
    if leak <= 0.0 {
        return cap;
    }
    let over_noise = 3.0 * libm::pow(33.0, draw);
    (over_noise * distance2 / (setup.scene.budget_m2_w * leak)).min(cap)
}
