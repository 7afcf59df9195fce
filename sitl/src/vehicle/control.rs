//! The autopilot's inner loops: position and attitude, tracked independently where the airframe can, and the
//! throttles that follow from them. They know what the estimator says, and nothing else.

use nalgebra::{Rotation3, UnitQuaternion, Vector3};

use super::airframe::{Airframe, Body};
use super::dynamics::GRAVITY_M_S2;
use super::geometry::Geometry;
use super::rotors::{Allocator, Saturation, Throttles, Wrench};

/// Position error to velocity, 1/s.
const POSITION_GAIN: f64 = 2.0;
/// Velocity error to acceleration, 1/s.
const VELOCITY_GAIN: f64 = 6.0;
/// Velocity error to the integral of acceleration, 1/s^2: what wind and drag ask for is learnt in about a second.
const INTEGRAL_GAIN: f64 = 5.0;
/// Bound of the integral, m/s^2.
const INTEGRAL_LIMIT_M_S2: f64 = 6.0;
/// Bound of the commanded acceleration, m/s^2.
const ACCELERATION_LIMIT_M_S2: f64 = 7.0;
/// Deceleration that a position error alone may count on, m/s^2: the approach speed is sqrt(2 a d).
const BRAKING_M_S2: f64 = 2.5;
/// Attitude error to rate, 1/s.
const ATTITUDE_GAIN: f64 = 8.0;
/// Rate error to angular acceleration, 1/s.
const RATE_GAIN: f64 = 22.0;
/// Rate error to the integral of angular acceleration, 1/s^2: what turns the body for long (wind on a lever, a rotor
/// that is gone) leaves no attitude error.
const RATE_INTEGRAL_GAIN: f64 = 40.0;
/// Bound of that integral on each axis, rad/s^2.
const RATE_INTEGRAL_LIMIT_RAD_S2: f64 = 40.0;
/// Bound of the commanded rates, rad/s.
const RATE_LIMIT_RAD_S: f64 = 2.6;
/// Steepest lean of a conventional airframe.
const LEAN_LIMIT_RAD: f64 = 0.6;

/// Where the vehicle shall be, per axis of the mission's ENU. An axis with neither is brought to rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Target {
    pub position_enu_m: [Option<f64>; 3],
    pub velocity_enu_m_s: [Option<f64>; 3],
    /// Body FLU to ENU. A conventional airframe takes the heading alone.
    pub attitude: UnitQuaternion<f64>,
}

/// An attitude with a thrust along the body's axes: nobody aboard minds the position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ThrustTarget {
    /// Body FLU to ENU.
    pub attitude: UnitQuaternion<f64>,
    /// In the allocator's units, FLU. Taken as it is, numbers or not.
    pub thrust_flu: Vector3<f64>,
    /// Rates and thrust from the same message, which every other step gets in the attitude's way.
    pub rates: Option<RateTarget>,
}

/// Body rates with a thrust along the body's z.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct RateTarget {
    pub rates_flu_rad_s: Vector3<f64>,
    /// In the allocator's units.
    pub thrust: f64,
}

/// What the loops know of the vehicle's motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Estimate {
    pub position_enu_m: Vector3<f64>,
    pub velocity_enu_m_s: Vector3<f64>,
    /// Body FLU to ENU.
    pub attitude: UnitQuaternion<f64>,
    pub rates_flu_rad_s: Vector3<f64>,
    /// The landing gear carries weight.
    pub contact: bool,
}

/// Greatest speeds, m/s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct SpeedLimits {
    pub horizontal_m_s: f64,
    pub up_m_s: f64,
    pub down_m_s: f64,
}

/// Cascaded loops: position to velocity to acceleration to force, attitude to rate to torque, and both to throttles.
#[derive(Debug, Clone)]
pub(crate) struct Controller {
    body: Body,
    airframe: Airframe,
    allocator: Allocator,
    integral_m_s2: Vector3<f64>,
    integral_rad_s2: Vector3<f64>,
    /// Whose turn it is where two setpoints fight.
    fighting: bool,
    last_velocity: Option<Vector3<f64>>,
    feed_forward_m_s2: Vector3<f64>,
}

impl Controller {
    pub fn new(body: Body, airframe: Airframe, geometry: &Geometry) -> Self {
        Self {
            body,
            airframe,
            allocator: Allocator::new(geometry),
            integral_m_s2: Vector3::zeros(),
            integral_rad_s2: Vector3::zeros(),
            fighting: false,
            last_velocity: None,
            feed_forward_m_s2: Vector3::zeros(),
        }
    }

    /// A rotor is known to be lost.
    pub fn drop_rotor(&mut self, rotor: usize) {
        self.allocator.drop_rotor(rotor);
    }

    /// Forgets what was learnt: on the ground with the motors off.
    pub fn reset(&mut self) {
        self.integral_m_s2 = Vector3::zeros();
        self.integral_rad_s2 = Vector3::zeros();
        self.last_velocity = None;
        self.feed_forward_m_s2 = Vector3::zeros();
    }

    /// The throttles that bring the vehicle to a target, for this step of `dt` seconds.
    pub fn step(&mut self, state: &Estimate, target: &Target, limits: SpeedLimits, dt: f64) -> Throttles {
        let acceleration = self.acceleration(state, target, limits, dt);
        let force = (acceleration + Vector3::new(0.0, 0.0, GRAVITY_M_S2)) * self.body.mass_kg;
        let attitude = match self.airframe {
            Airframe::Omnidirectional => target.attitude,
            Airframe::Conventional => lean(force, crate::frames::heading_rad(&target.attitude)),
        };
        let rates = rates_towards(state, &attitude);
        let wanted =
            Wrench { force_n: state.attitude.inverse() * force, torque_nm: self.torque(state, rates, dt) };
        self.allocator.allocate(&wanted, Saturation::Scale)
    }

    /// The throttles for an attitude and a thrust in body axes, for this step of `dt` seconds.
    pub fn step_thrust(&mut self, state: &Estimate, target: &ThrustTarget, dt: f64) -> Throttles {
        self.fighting = !self.fighting;
        let (rates, thrust_flu) = match target.rates {
            Some(other) if self.fighting => (other.rates_flu_rad_s, Vector3::new(0.0, 0.0, other.thrust)),
            _ => (rates_towards(state, &target.attitude), target.thrust_flu),
        };
        // The position loops will start afresh.
        self.integral_m_s2 = Vector3::zeros();
        self.last_velocity = None;
        let force_n = thrust_flu.component_mul(self.allocator.unit_n());
        let wanted = Wrench { force_n, torque_nm: self.torque(state, rates, dt) };
        self.allocator.allocate(&wanted, Saturation::Clip)
    }

    fn acceleration(
        &mut self,
        state: &Estimate,
        target: &Target,
        limits: SpeedLimits,
        dt: f64,
    ) -> Vector3<f64> {
        let asked = Vector3::from(target.velocity_enu_m_s.map(|v| v.unwrap_or(0.0)));
        self.feed_forward(&asked, dt);
        let error = Vector3::from_fn(|axis, _| {
            target.position_enu_m[axis].map_or(0.0, |p| p - state.position_enu_m[axis])
        });
        let distance = error.norm();
        let closing = if distance > 1e-9 {
            error / distance * (POSITION_GAIN * distance).min((2.0 * BRAKING_M_S2 * distance).sqrt())
        } else {
            Vector3::zeros()
        };
        let mut velocity = asked + closing;
        let flat = velocity.xy().cap_magnitude(limits.horizontal_m_s);
        velocity = Vector3::new(flat.x, flat.y, velocity.z.clamp(-limits.down_m_s, limits.up_m_s));

        let velocity_error = velocity - state.velocity_enu_m_s;
        let wanted = velocity_error * VELOCITY_GAIN + self.integral_m_s2 + self.feed_forward_m_s2;
        let given = wanted.cap_magnitude(ACCELERATION_LIMIT_M_S2);
        // Anti-windup: while the command is cut short the integral may only shrink.
        let step = velocity_error * (INTEGRAL_GAIN * dt);
        if given == wanted || self.integral_m_s2.dot(&step) < 0.0 {
            self.integral_m_s2 = (self.integral_m_s2 + step).cap_magnitude(INTEGRAL_LIMIT_M_S2);
        }
        given
    }

    /// The acceleration in a stream of velocities, smoothed over the steps of a slow stream.
    fn feed_forward(&mut self, asked: &Vector3<f64>, dt: f64) {
        const SMOOTHING_S: f64 = 0.06;
        let change = self.last_velocity.map_or_else(Vector3::zeros, |last| asked - last);
        self.last_velocity = Some(*asked);
        self.feed_forward_m_s2 *= crate::random::decay(dt, SMOOTHING_S);
        // A jump is a new command, not an acceleration to follow.
        if change.norm() < 0.5 {
            self.feed_forward_m_s2 += change / SMOOTHING_S;
        }
    }

    fn torque(&mut self, state: &Estimate, rate_target: Vector3<f64>, dt: f64) -> Vector3<f64> {
        let rates = state.rates_flu_rad_s;
        let error = rate_target - rates;
        // On the ground the gear holds the body against any torque: nothing is to be learnt from that.
        if !state.contact && error.iter().all(|e| e.is_finite()) {
            let bound = Vector3::repeat(RATE_INTEGRAL_LIMIT_RAD_S2);
            let grown = self.integral_rad_s2 + error * (RATE_INTEGRAL_GAIN * dt);
            self.integral_rad_s2 = grown.sup(&-bound).inf(&bound);
        }
        let inertia = Vector3::from(self.body.inertia_kg_m2);
        let momentum = rates.component_mul(&inertia);
        (error * RATE_GAIN + self.integral_rad_s2).component_mul(&inertia) + rates.cross(&momentum)
    }
}

/// The body rates that close an attitude error.
fn rates_towards(state: &Estimate, target: &UnitQuaternion<f64>) -> Vector3<f64> {
    let error = (state.attitude.inverse() * target).scaled_axis();
    (error * ATTITUDE_GAIN).cap_magnitude(RATE_LIMIT_RAD_S)
}

/// The attitude of this heading whose thrust axis lies along the force, within the lean limit.
fn lean(force: Vector3<f64>, heading: f64) -> UnitQuaternion<f64> {
    let flat = force.xy().cap_magnitude(force.z.max(1.0) * LEAN_LIMIT_RAD.tan());
    let up = Vector3::new(flat.x, flat.y, force.z.max(1.0)).normalize();
    let left = Vector3::new(-heading.sin(), heading.cos(), 0.0);
    let forward = left.cross(&up).normalize();
    let left = up.cross(&forward);
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_basis_unchecked(&[forward, left, up]))
}

#[cfg(test)]
mod tests;
