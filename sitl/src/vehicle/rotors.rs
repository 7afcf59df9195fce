//! The rotors at work, and the allocation of force and torque to them.
//!
//! Allocation is the pseudo-inverse of the rotors' effectiveness. The units of a thrust command are PX4's: along each
//! axis the command 1 is what the rotors give when the mean magnitude of their throttles is 1, so the axes' units
//! differ with the geometry.

use nalgebra::{DMatrix, Vector3};

use super::geometry::{Geometry, MAX_ROTORS, Rotor};

/// Throttle of each rotor: thrust over its greatest, from -1 (0 where it cannot reverse) to 1.
pub(crate) type Throttles = [f64; MAX_ROTORS];

/// Part of every rotor that forces leave to torques: an attitude is kept before an acceleration.
const TORQUE_RESERVE: f64 = 0.2;
/// Smaller entries of the pseudo-inverse are rounding.
const NO_ENTRY: f64 = 1e-7;

/// Force and torque on the body, body axes (FLU).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Wrench {
    pub force_n: Vector3<f64>,
    pub torque_nm: Vector3<f64>,
}

impl Wrench {
    pub fn zero() -> Self {
        Self { force_n: Vector3::zeros(), torque_nm: Vector3::zeros() }
    }

    /// Of one rotor at full throttle.
    fn of(rotor: &Rotor) -> Self {
        let axis = Vector3::from(rotor.axis_flu).try_normalize(1e-9).unwrap_or_else(Vector3::zeros);
        let force_n = axis * rotor.thrust_n;
        let torque_nm = Vector3::from(rotor.position_flu_m).cross(&force_n) - force_n * rotor.moment_m;
        Self { force_n, torque_nm }
    }
}

fn full_wrenches(geometry: &Geometry) -> Vec<Wrench> {
    geometry.rotors.iter().take(MAX_ROTORS).map(Wrench::of).collect()
}

/// Rows: force x, y, z, torque x, y, z. A column for each rotor at full throttle.
fn effectiveness(full: &[Wrench]) -> DMatrix<f64> {
    DMatrix::from_fn(
        6,
        full.len(),
        |row, k| {
            if row < 3 { full[k].force_n[row] } else { full[k].torque_nm[row - 3] }
        },
    )
}

/// How many of the six directions of force and torque the rotors control.
pub(crate) fn rank(geometry: &Geometry) -> usize {
    effectiveness(&full_wrenches(geometry)).rank(1e-6)
}

/// The rotors themselves.
#[derive(Debug, Clone)]
pub(crate) struct Rotors {
    full: Vec<Wrench>,
    state: Throttles,
    healthy: [bool; MAX_ROTORS],
    low: f64,
    lag_s: f64,
}

impl Rotors {
    pub fn new(geometry: &Geometry) -> Self {
        Self {
            full: full_wrenches(geometry),
            state: [0.0; MAX_ROTORS],
            healthy: [true; MAX_ROTORS],
            low: if geometry.reversible { -1.0 } else { 0.0 },
            lag_s: geometry.lag_s,
        }
    }

    /// A rotor gives nothing any more. One that is not there changes nothing.
    pub fn lose(&mut self, rotor: usize) {
        if let Some(healthy) = self.healthy.get_mut(rotor) {
            *healthy = false;
        }
    }

    /// Follows the commands for `dt` seconds and returns what the rotors then give. A command that is not a number
    /// stops its motor.
    pub fn step(&mut self, commands: &Throttles, dt: f64) -> Wrench {
        let part = 1.0 - crate::random::decay(dt, self.lag_s);
        let mut sum = Wrench::zero();
        for (k, full) in self.full.iter().enumerate() {
            let works = self.healthy[k] && commands[k].is_finite();
            let target = if works { commands[k].clamp(self.low, 1.0) } else { 0.0 };
            self.state[k] += (target - self.state[k]) * part;
            sum.force_n += full.force_n * self.state[k];
            sum.torque_nm += full.torque_nm * self.state[k];
        }
        sum
    }

    /// Power drawn, as a part of all rotors at full throttle.
    pub fn load(&self) -> f64 {
        load(&self.state[..self.full.len()])
    }
}

/// Momentum theory: the power of a rotor goes with its thrust to the power of 3/2.
fn load(throttles: &[f64]) -> f64 {
    throttles.iter().map(|u| u.abs() * u.abs().sqrt()).sum::<f64>() / throttles.len().max(1) as f64
}

/// What becomes of commands that ask for more than the rotors have.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Saturation {
    /// Force and torque are scaled down, keeping their directions.
    Scale,
    /// Each throttle is cut off at its limit.
    Clip,
}

/// From force and torque to throttles.
#[derive(Debug, Clone)]
pub(crate) struct Allocator {
    full: Vec<Wrench>,
    count: usize,
    /// Throttle of each rotor per newton and per newton metre.
    force: [Vector3<f64>; MAX_ROTORS],
    torque: [Vector3<f64>; MAX_ROTORS],
    low: f64,
    unit_n: Vector3<f64>,
}

impl Allocator {
    pub fn new(geometry: &Geometry) -> Self {
        let mut made = Self {
            full: full_wrenches(geometry),
            count: geometry.rotors.len().min(MAX_ROTORS),
            force: [Vector3::zeros(); MAX_ROTORS],
            torque: [Vector3::zeros(); MAX_ROTORS],
            low: if geometry.reversible { -1.0 } else { 0.0 },
            unit_n: Vector3::repeat(1.0),
        };
        made.invert();
        let unit = |axis: usize| {
            let entries = made.force[..made.count].iter().map(|f| f[axis].abs());
            let used = entries.clone().filter(|e| *e > NO_ENTRY).count();
            (used > 0).then(|| used as f64 / entries.sum::<f64>())
        };
        // An axis that no rotor serves is scaled as z is.
        let z = unit(2).unwrap_or(1.0);
        made.unit_n = Vector3::new(unit(0).unwrap_or(z), unit(1).unwrap_or(z), z);
        made
    }

    fn invert(&mut self) {
        let Ok(mix) = effectiveness(&self.full).pseudo_inverse(1e-6) else { return };
        for k in 0..self.count {
            self.force[k] = Vector3::from_fn(|axis, _| mix[(k, axis)]);
            self.torque[k] = Vector3::from_fn(|axis, _| mix[(k, 3 + axis)]);
        }
    }

    /// Does without a rotor that is known to be lost. The units stay as they were.
    pub fn drop_rotor(&mut self, rotor: usize) {
        if let Some(full) = self.full.get_mut(rotor) {
            *full = Wrench::zero();
            self.invert();
        }
    }

    /// Newtons per unit of thrust command, body axes.
    pub fn unit_n(&self) -> &Vector3<f64> {
        &self.unit_n
    }

    /// Power drawn in a level hover of this weight, as a part of all rotors at full throttle.
    pub fn hover_load(&self, weight_n: f64) -> f64 {
        let hover = Wrench { force_n: Vector3::new(0.0, 0.0, weight_n), torque_nm: Vector3::zeros() };
        load(&self.allocate(&hover, Saturation::Scale)[..self.count])
    }

    /// The throttles for a wrench.
    pub fn allocate(&self, wanted: &Wrench, saturation: Saturation) -> Throttles {
        let mut throttles = [0.0; MAX_ROTORS];
        if saturation == Saturation::Clip {
            for (k, throttle) in throttles.iter_mut().enumerate().take(self.count) {
                let u = self.force[k].dot(&wanted.force_n) + self.torque[k].dot(&wanted.torque_nm);
                *throttle = u.clamp(self.low, 1.0);
            }
            return throttles;
        }
        let reversible = self.low < 0.0;
        let mut peak = 0.0f64;
        for (throttle, force) in throttles.iter_mut().zip(&self.force[..self.count]) {
            *throttle = force.dot(&wanted.force_n);
            peak = peak.max(if reversible { throttle.abs() } else { *throttle });
        }
        let scale = ((1.0 - TORQUE_RESERVE) / peak).min(1.0);
        let mut turns = [0.0; MAX_ROTORS];
        let mut room = 1.0f64;
        for k in 0..self.count {
            throttles[k] = (throttles[k] * scale).clamp(self.low, 1.0);
            turns[k] = self.torque[k].dot(&wanted.torque_nm);
            // At the bottom a rotor that cannot reverse is cut off alone: thrust would rise if all turned less.
            if turns[k] > 0.0 {
                room = room.min((1.0 - throttles[k]) / turns[k]);
            } else if turns[k] < 0.0 && reversible {
                room = room.min((self.low - throttles[k]) / turns[k]);
            }
        }
        for k in 0..self.count {
            throttles[k] = (throttles[k] + turns[k] * room).clamp(self.low, 1.0);
        }
        throttles
    }
}

/// The thrust that a motor of this curve gives where the autopilot believes in another (`THR_MDL_FAC`): both are
/// `c s^2 + (1 - c) s` of the signal `s`.
pub(crate) fn through_curves(throttle: f64, believed: f64, real: f64) -> f64 {
    if believed == real {
        return throttle;
    }
    let wanted = throttle.abs();
    let linear = 1.0 - believed;
    let signal = if believed > 1e-9 {
        ((linear * linear + 4.0 * believed * wanted).sqrt() - linear) / (2.0 * believed)
    } else {
        wanted
    };
    (real * signal * signal + (1.0 - real) * signal) * throttle.signum()
}

#[cfg(test)]
mod tests;
