//! The autopilot's inner loops: position and attitude, tracked independently where the airframe can.

use nalgebra::{Rotation3, UnitQuaternion, Vector3};

use super::config::{Airframe, Body};
use super::dynamics::{Dynamics, GRAVITY_M_S2, Wrench};

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

/// Greatest speeds, m/s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct SpeedLimits {
    pub horizontal_m_s: f64,
    pub up_m_s: f64,
    pub down_m_s: f64,
}

/// Cascaded loops: position to velocity to acceleration to force, attitude to rate to torque.
#[derive(Debug, Clone)]
pub(crate) struct Controller {
    body: Body,
    airframe: Airframe,
    integral_m_s2: Vector3<f64>,
    last_velocity: Option<Vector3<f64>>,
    feed_forward_m_s2: Vector3<f64>,
}

impl Controller {
    pub fn new(body: Body, airframe: Airframe) -> Self {
        Self {
            body,
            airframe,
            integral_m_s2: Vector3::zeros(),
            last_velocity: None,
            feed_forward_m_s2: Vector3::zeros(),
        }
    }

    /// Forgets what was learnt: on the ground with the motors off.
    pub fn reset(&mut self) {
        self.integral_m_s2 = Vector3::zeros();
        self.last_velocity = None;
        self.feed_forward_m_s2 = Vector3::zeros();
    }

    /// The wrench for this step of `dt` seconds.
    pub fn step(&mut self, state: &Dynamics, target: &Target, limits: SpeedLimits, dt: f64) -> Wrench {
        let acceleration = self.acceleration(state, target, limits, dt);
        let force = (acceleration + Vector3::new(0.0, 0.0, GRAVITY_M_S2)) * self.body.mass_kg;
        let attitude = match self.airframe {
            Airframe::Omnidirectional => target.attitude,
            Airframe::Conventional => lean(force, crate::frames::heading_rad(&target.attitude)),
        };
        Wrench { force_n: state.attitude.inverse() * force, torque_nm: self.torque(state, &attitude) }
    }

    fn acceleration(
        &mut self,
        state: &Dynamics,
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

    fn torque(&self, state: &Dynamics, target: &UnitQuaternion<f64>) -> Vector3<f64> {
        let rates = state.rates_rad_s();
        let error = (state.attitude.inverse() * target).scaled_axis();
        let rate_target = (error * ATTITUDE_GAIN).cap_magnitude(RATE_LIMIT_RAD_S);
        let inertia = Vector3::from(self.body.inertia_kg_m2);
        let momentum = rates.component_mul(&inertia);
        ((rate_target - rates) * RATE_GAIN).component_mul(&inertia) + rates.cross(&momentum)
    }
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
mod tests {
    use super::*;
    use crate::frames::Euler;
    use crate::vehicle::config::WindConfig;
    use crate::vehicle::wind::Wind;

    const DT: f64 = 0.0025;
    const LIMITS: SpeedLimits = SpeedLimits { horizontal_m_s: 12.0, up_m_s: 6.0, down_m_s: 6.0 };

    struct Rig {
        body: Dynamics,
        controller: Controller,
        wind: Wind,
    }

    impl Rig {
        fn new(airframe: Airframe, wind: WindConfig) -> Self {
            let mut body = Dynamics::new(Body::default(), airframe, Vector3::zeros(), 0.0);
            body.position_enu_m.z = 100.0;
            body.on_ground = false;
            Self { body, controller: Controller::new(Body::default(), airframe), wind: Wind::new(wind, 4, 0) }
        }

        fn run(
            &mut self,
            seconds: f64,
            mut target: impl FnMut(f64) -> Target,
            mut see: impl FnMut(f64, &Dynamics),
        ) {
            let steps = (seconds / DT).round() as usize;
            for k in 0..steps {
                let t = k as f64 * DT;
                let wrench = self.controller.step(&self.body, &target(t), LIMITS, DT);
                let wind = self.wind.step(DT);
                self.body.step(wrench, wind, DT);
                see(t + DT, &self.body);
            }
        }
    }

    fn hold(at: Vector3<f64>, attitude: UnitQuaternion<f64>) -> Target {
        Target { position_enu_m: [Some(at.x), Some(at.y), Some(at.z)], velocity_enu_m_s: [None; 3], attitude }
    }

    #[test]
    fn prop_hold_at_every_tilt_is_centimetres_and_tenths_of_a_degree() {
        let at = Vector3::new(0.0, 0.0, 100.0);
        for (roll, pitch) in [(0.0, 0.0), (30.0, 0.0), (60.0, -45.0), (90.0, 0.0), (0.0, 90.0), (180.0, 0.0)]
        {
            let attitude =
                Euler { roll_rad: f64::to_radians(roll), pitch_rad: f64::to_radians(pitch), yaw_rad: 0.0 }
                    .rotation();
            let mut rig = Rig::new(Airframe::Omnidirectional, WindConfig::default());
            let (mut worst_m, mut worst_rad) = (0.0f64, 0.0f64);
            rig.run(
                10.0,
                |_| hold(at, attitude),
                |t, body| {
                    if t > 5.0 {
                        worst_m = worst_m.max((body.position_enu_m - at).norm());
                        worst_rad = worst_rad.max(body.attitude.angle_to(&attitude));
                    }
                },
            );
            assert!(worst_m < 0.01 && worst_rad.to_degrees() < 0.05, "{roll} {pitch}: {worst_m} {worst_rad}");
        }
    }

    #[test]
    fn prop_hold_in_gusts() {
        let wind = WindConfig { mean_enu_m_s: [6.0, 2.0, 0.0], gust_std_m_s: 1.5, gust_correlation_s: 2.0 };
        let at = Vector3::new(0.0, 0.0, 100.0);
        let mut rig = Rig::new(Airframe::Omnidirectional, wind);
        let (mut squares, mut n) = (0.0, 0);
        rig.run(
            40.0,
            |_| hold(at, UnitQuaternion::identity()),
            |t, body| {
                if t > 10.0 {
                    squares += (body.position_enu_m - at).norm_squared();
                    n += 1;
                }
            },
        );
        let rms = (squares / f64::from(n)).sqrt();
        assert!(rms < 0.1 && rms > 1e-4, "{rms}");
    }

    #[test]
    fn prop_tracks_a_moving_setpoint_with_its_velocity() {
        // 3 m/s^2 to 8 m/s, on at 8 m/s, streamed at 50 Hz.
        let mut rig = Rig::new(Airframe::Omnidirectional, WindConfig::default());
        let path = |t: f64| {
            let ramp = 8.0 / 3.0;
            if t < ramp { (1.5 * t * t, 3.0 * t) } else { (1.5 * ramp * ramp + 8.0 * (t - ramp), 8.0) }
        };
        let mut worst = 0.0f64;
        let streamed = |t: f64| {
            let sent = (t / 0.02).floor() * 0.02;
            let (p, v) = path(sent);
            let mut target = hold(Vector3::new(p + v * (t - sent), 0.0, 100.0), UnitQuaternion::identity());
            target.velocity_enu_m_s = [Some(v), Some(0.0), Some(0.0)];
            target
        };
        rig.run(10.0, streamed, |t, body| worst = worst.max((body.position_enu_m.x - path(t).0).abs()));
        assert!(worst < 0.3, "{worst}");
    }

    #[test]
    fn prop_a_far_target_is_reached_without_overshoot() {
        for airframe in [Airframe::Omnidirectional, Airframe::Conventional] {
            let mut rig = Rig::new(airframe, WindConfig::default());
            let at = Vector3::new(60.0, -30.0, 120.0);
            let (mut beyond, mut speed) = (0.0f64, 0.0f64);
            rig.run(
                25.0,
                |_| hold(at, UnitQuaternion::identity()),
                |_, body| {
                    beyond = beyond.max(body.position_enu_m.x - at.x);
                    speed = speed.max(body.velocity_enu_m_s.xy().norm());
                },
            );
            let left = (rig.body.position_enu_m - at).norm();
            assert!(beyond < 0.5 && left < 0.05 && speed < 12.5, "{airframe:?} {beyond} {left} {speed}");
        }
    }
}
