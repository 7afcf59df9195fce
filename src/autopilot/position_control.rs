//! Position control of a fully actuated vehicle by body thrust, for autopilots that take a three-dimensional thrust
//! but close no position loop around it.
//!
//! Force per mass, in the world: `f = g + a_ref + K_p e + K_d (v_ref - v) + i`, with `di/dt = K_i e`, frozen while thrust or
//! acceleration is at its limit or the setpoint is far (anti-windup). In the body: `u = D R^T f h / g`, where `R` is
//! the measured attitude (the force must point the right way while the vehicle turns), `h` the thrust command that
//! hovers, learned in flight, and `D` the ratio of the thrust units of the axes: one unit of x is not one unit of z.
//!
//! The loop runs over a link. What is measured is [`Measured::age_s`] old by the time that it is used: it is taken to have gone on
//! since with its velocity and with the acceleration `a_ref`, without which a vehicle at 8 m/s that is seen 0.1 s late is 0.8 m
//! ahead of where it should be, and stops beyond. A loop as fast as these gains make it bears a fifth of a second of that: beyond,
//! it swings ever wider, out of the altitude band in the end. So it is slowed in proportion: with `s = PROMPT_S / age` where that is below one, `K_p` is taken `s^2`, `K_d` `s`
//! and `K_i` `s^3` times, which is the same loop in a time that runs `s` times as fast, so that its delay is to it what
//! `PROMPT_S` is to the full gains. It slows at once, and becomes fast again over `RECOVERY_S`. How far a setpoint counts grows
//! by `1 / s^2`, so that a slowed loop can ask for as much force as ever: what the integral has learned of the wind or of a way's
//! drag may be wrong the next moment, and weak gains over a metre do not hold against that.

use nalgebra::Vector3;

use super::setpoint::Setpoint;
use crate::geo::{Attitude, Enu, EnuVelocity};

const GRAVITY_M_S2: f64 = 9.806_65;
const LEAST_HOVER_THRUST: f64 = 0.02;
/// State that is no older than this is flown on with the full gains, in seconds: a few periods and the way of a command.
const PROMPT_S: f64 = 0.08;
/// Time constant with which an age once seen is forgotten, in seconds.
const RECOVERY_S: f64 = 2.0;
/// Ages are taken for no more than this, in seconds: state that old is not flown on.
const LARGEST_AGE_S: f64 = 1.0;

/// Gains, limits and scales.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Proportional gain, 1/s^2: horizontal and vertical.
    pub proportional_s2: [f64; 2],
    /// Velocity gain, 1/s: horizontal and vertical.
    pub velocity_s: [f64; 2],
    /// Integral gain, 1/s^3: horizontal and vertical.
    pub integral_s3: [f64; 2],
    /// Largest acceleration that the integral may stand for, m/s^2.
    pub integral_limit_m_s2: f64,
    /// Largest acceleration asked for beyond gravity, m/s^2.
    pub acceleration_limit_m_s2: f64,
    /// Position errors beyond this are taken as this, in metres, at the full gains: a far setpoint is flown to, not jumped at.
    pub error_limit_m: f64,
    /// Thrust command that hovers level, for control taken in flight; a take-off finds it by itself.
    pub hover_thrust: f64,
    /// Time constant of learning the hover thrust, in seconds.
    pub hover_time_s: f64,
    /// Newtons per unit of thrust along body x, y, z; only ratios matter. `None`: from the autopilot's rotors
    /// (CA_ROTOR*), or the same on every axis if it does not say.
    pub thrust_n: Option<[f64; 3]>,
    /// Largest thrust command on any axis.
    pub thrust_limit: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            proportional_s2: [6.0, 8.0],
            velocity_s: [4.5, 5.5],
            integral_s3: [2.5, 3.0],
            integral_limit_m_s2: 5.0,
            acceleration_limit_m_s2: 6.0,
            error_limit_m: 1.0,
            hover_thrust: 0.5,
            hover_time_s: 4.0,
            thrust_n: None,
            thrust_limit: 1.0,
        }
    }
}

/// What is measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measured {
    /// Position in metres, ENU.
    pub position_enu_m: Enu,
    /// Velocity in m/s, ENU.
    pub velocity_enu_m_s: EnuVelocity,
    /// Attitude.
    pub attitude: Attitude,
    /// How long ago that was, at the most, in seconds.
    pub age_s: f64,
}

impl Measured {
    /// Position in metres and velocity in m/s that it has by now if it accelerates so, in m/s^2.
    fn now(&self, acceleration_m_s2: &Vector3<f64>) -> (Enu, Vector3<f64>) {
        let age_s = self.age_s.min(LARGEST_AGE_S);
        let (position_enu_m, velocity_m_s) = (self.position_enu_m, self.velocity_enu_m_s.vector());
        let gained_m_s = acceleration_m_s2 * age_s;
        (position_enu_m + (velocity_m_s + gained_m_s / 2.0) * age_s, velocity_m_s + gained_m_s)
    }
}

/// The controller's memory.
#[derive(Debug, Clone, PartialEq)]
pub struct PositionControl {
    settings: Settings,
    thrust_n: [f64; 3],
    integral_m_s2: Vector3<f64>,
    hover_thrust: f64,
    /// The age that the loop is slowed for, in seconds.
    delay_s: f64,
}

impl PositionControl {
    /// A controller that has learned nothing yet.
    #[must_use]
    pub fn new(settings: Settings) -> Self {
        Self {
            settings,
            thrust_n: settings.thrust_n.unwrap_or([1.0; 3]),
            integral_m_s2: Vector3::zeros(),
            hover_thrust: settings.hover_thrust,
            delay_s: PROMPT_S,
        }
    }

    /// Takes the scales of the axes from the rotors, unless they were given.
    pub fn learn_scales(&mut self, thrust_n: [f64; 3]) {
        self.thrust_n = self.settings.thrust_n.unwrap_or(thrust_n);
    }

    /// Forgets the integral and keeps the hover thrust: for a new flight, or control taken again.
    pub fn reset(&mut self) {
        self.integral_m_s2 = Vector3::zeros();
    }

    /// Learns from the thrust command at which the level vehicle has just left the ground.
    pub fn lifted_off(&mut self, thrust: f64) {
        self.hover_thrust = thrust.clamp(LEAST_HOVER_THRUST, self.settings.thrust_limit);
        self.reset();
    }

    /// The thrust command that hovers, as learned so far.
    #[must_use]
    pub fn hover_thrust(&self) -> f64 {
        self.hover_thrust
    }

    /// The thrust command along body FRD axes (up is negative z) after a step of `dt_s` in the air. Always finite and
    /// within the limit.
    pub fn step(&mut self, wanted: &Setpoint, measured: &Measured, dt_s: f64) -> Vector3<f64> {
        let s = self.settings;
        let slowed = self.slow_for(measured.age_s, dt_s);
        let ahead = wanted.acceleration_enu_m_s2.vector();
        let (position_enu_m, velocity_m_s) = measured.now(&ahead);
        let axes = |[horizontal, vertical]: [f64; 2], power: i32| {
            Vector3::new(horizontal, horizontal, vertical) * slowed.powi(power)
        };
        let error_limit_m = s.error_limit_m / slowed.powi(2);
        let far = (wanted.position_enu_m - position_enu_m).norm() > error_limit_m;
        let error = limited(wanted.position_enu_m - position_enu_m, error_limit_m);
        let velocity_error = wanted.velocity_enu_m_s.vector() - velocity_m_s;
        let feedback = axes(s.proportional_s2, 2).component_mul(&error)
            + axes(s.velocity_s, 1).component_mul(&velocity_error);
        let asked = limited(feedback + ahead + self.integral_m_s2, s.acceleration_limit_m_s2);
        let force = asked + Vector3::z() * GRAVITY_M_S2;

        let (command, saturated) = self.command_for(force, &measured.attitude);
        let limited_force = asked.norm() + 1e-9 >= s.acceleration_limit_m_s2;
        if dt_s > 0.0 && !far && !saturated && !limited_force {
            let step = axes(s.integral_s3, 3).component_mul(&error) * dt_s;
            self.integral_m_s2 = limited(self.integral_m_s2 + step, s.integral_limit_m_s2);
            self.learn_hover(dt_s);
        } else if far && !saturated {
            self.follow_command(force.z, dt_s * slowed);
        }
        command
    }

    /// The thrust command, along body FRD axes, of a vehicle in this attitude that is where it should be and at rest: it carries
    /// the weight and holds against the wind learned. Always finite and within the limit.
    #[must_use]
    pub fn hover(&self, attitude: &Attitude) -> Vector3<f64> {
        self.command_for(self.integral_m_s2 + Vector3::z() * GRAVITY_M_S2, attitude).0
    }

    /// The thrust command, along body FRD axes, for this force per mass in the world and in this attitude; whether it had to be
    /// shortened to the limit.
    fn command_for(&self, force_m_s2: Vector3<f64>, attitude: &Attitude) -> (Vector3<f64>, bool) {
        let limit = self.settings.thrust_limit;
        let body = attitude.rotation().inverse() * force_m_s2 * (self.hover_thrust / GRAVITY_M_S2);
        let scaled = Vector3::from_fn(|axis, _| body[axis] * self.thrust_n[2] / self.thrust_n[axis]);
        let largest = scaled.amax();
        let saturated = largest > limit;
        let command = if saturated { scaled * (limit / largest) } else { scaled };
        // FLU to FRD.
        let frd = Vector3::new(command.x, -command.y, -command.z);
        (if frd.iter().all(|c| c.is_finite()) { frd } else { Vector3::zeros() }, saturated)
    }

    /// Takes the hover thrust for what is commanded, in the mean over some seconds: a vehicle that goes from rest to rest is not
    /// accelerated in the mean, and where the integral is frozen this is all that finds a wrong one out. One that is 2.6
    /// times too large leaves no acceleration downwards at all (the limit is 6 m/s^2 of 9.8): such a vehicle climbs for ever.
    fn follow_command(&mut self, force_m_s2: f64, dt_s: f64) {
        let part = (dt_s / self.settings.hover_time_s).clamp(0.0, 1.0) * (force_m_s2 / GRAVITY_M_S2 - 1.0);
        let hover_thrust = self.hover_thrust * (1.0 + part);
        self.hover_thrust = hover_thrust.clamp(LEAST_HOVER_THRUST, self.settings.thrust_limit);
    }

    /// How many times as fast as with the full gains the loop may be, for state of this age.
    fn slow_for(&mut self, age_s: f64, dt_s: f64) -> f64 {
        let forgotten = PROMPT_S + (self.delay_s - PROMPT_S) * (-dt_s.max(0.0) / RECOVERY_S).exp();
        // What is not a number counts as old.
        self.delay_s = forgotten.max(age_s.min(LARGEST_AGE_S));
        PROMPT_S / self.delay_s
    }

    /// Moves the vertical part of the integral into the hover thrust, slowly, leaving their sum as it is.
    fn learn_hover(&mut self, dt_s: f64) {
        let part = (dt_s / self.settings.hover_time_s).min(1.0) * self.integral_m_s2.z / GRAVITY_M_S2;
        let hover_thrust =
            (self.hover_thrust * (1.0 + part)).clamp(LEAST_HOVER_THRUST, self.settings.thrust_limit);
        let kept = hover_thrust / self.hover_thrust;
        self.hover_thrust = hover_thrust;
        self.integral_m_s2.z = (self.integral_m_s2.z + GRAVITY_M_S2) / kept - GRAVITY_M_S2;
    }
}

/// `v`, shortened to `limit` if it is longer; zero if it is not finite.
fn limited(v: Vector3<f64>, limit: f64) -> Vector3<f64> {
    let norm = v.norm();
    if !norm.is_finite() {
        Vector3::zeros()
    } else if norm > limit {
        v * (limit / norm)
    } else {
        v
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geo::EnuAcceleration;

    /// At rest there.
    fn hold(position_enu_m: Enu) -> Setpoint {
        Setpoint {
            position_enu_m,
            velocity_enu_m_s: EnuVelocity::ZERO,
            acceleration_enu_m_s2: EnuAcceleration::ZERO,
            attitude: Attitude::level(),
        }
    }

    /// A point mass under the thrust as the airframe really turns it into force.
    struct Plant {
        mass_kg: f64,
        thrust_n: [f64; 3],
        wind_n: Vector3<f64>,
        measured: Measured,
    }

    impl Plant {
        fn step(&mut self, frd: Vector3<f64>, dt_s: f64) {
            let flu =
                Vector3::new(frd.x * self.thrust_n[0], -frd.y * self.thrust_n[1], -frd.z * self.thrust_n[2]);
            let force = self.measured.attitude.rotation() * flu + self.wind_n;
            let acceleration = force / self.mass_kg - Vector3::z() * GRAVITY_M_S2;
            let velocity = self.measured.velocity_enu_m_s.vector() + acceleration * dt_s;
            self.measured.velocity_enu_m_s = EnuVelocity::from_vector(velocity);
            self.measured.position_enu_m += velocity * dt_s;
        }
    }

    fn omnicopter() -> Settings {
        Settings { thrust_n: Some([133.9, 133.9, 115.9]), ..Settings::default() }
    }

    fn plant(roll_deg: f64, pitch_deg: f64) -> Plant {
        let attitude = Attitude::from_euler(roll_deg.to_radians(), pitch_deg.to_radians(), 0.4);
        let measured = Measured {
            position_enu_m: Enu::zeros(),
            velocity_enu_m_s: EnuVelocity::ZERO,
            attitude,
            age_s: 0.0,
        };
        Plant { mass_kg: 4.0, thrust_n: [133.9, 133.9, 115.9], wind_n: Vector3::zeros(), measured }
    }

    #[test]
    fn val_hover_thrust_of_known_attitudes() {
        let settings = Settings { hover_thrust: 0.4, ..omnicopter() };
        for (roll, pitch, expected) in [
            (0.0, 0.0, Vector3::new(0.0, 0.0, -0.4)),
            // Roll 90: body y (left) points up, so the thrust is to the left: negative in FRD.
            (90.0, 0.0, Vector3::new(0.0, -0.4 * 115.9 / 133.9, 0.0)),
            // Pitch 90 (paper's sign): body x points down, so the thrust is backwards.
            (0.0, 90.0, Vector3::new(-0.4 * 115.9 / 133.9, 0.0, 0.0)),
            (180.0, 0.0, Vector3::new(0.0, 0.0, 0.4)),
        ] {
            let mut control = PositionControl::new(settings);
            let at = plant(roll, pitch).measured;
            let thrust = control.step(&hold(Enu::zeros()), &at, 0.02);
            assert!((thrust - expected).norm() < 1e-9, "roll {roll} pitch {pitch}: {thrust}");
            assert_eq!(control.hover(&at.attitude), thrust);
        }
    }

    #[test]
    fn regress_a_hover_thrust_that_leaves_no_way_down_or_up_is_found_out() {
        // The vehicle hovers at 0.339.
        for wrong in [0.95, 0.2] {
            let mut plant = plant(0.0, 0.0);
            let mut control = PositionControl::new(Settings { hover_thrust: wrong, ..omnicopter() });
            let mut farthest_m: f64 = 0.0;
            for _ in 0..3000 {
                let thrust = control.step(&hold(Enu::zeros()), &plant.measured, 0.02);
                plant.step(thrust, 0.02);
                // Air resists: some 8 m/s at most.
                let v = plant.measured.velocity_enu_m_s.vector();
                plant.measured.velocity_enu_m_s = EnuVelocity::from_vector(v - v * v.norm() * 0.05 * 0.02);
                farthest_m = farthest_m.max(plant.measured.position_enu_m.norm());
            }
            let left_m = plant.measured.position_enu_m.norm();
            assert!(left_m < 0.05 && farthest_m < 60.0, "{wrong}: {left_m}, {farthest_m}");
        }
    }

    #[test]
    fn regress_a_loop_that_is_slowed_does_not_drift_away_on_a_wrong_hover_thrust() {
        // 1.6 times the right one, by state that is 0.2 s old: all that the slowed gains ask for over a metre is less than that.
        let mut plant = plant(0.0, 0.0);
        plant.measured.age_s = 0.2;
        plant.measured.position_enu_m = Enu::new(0.0, 0.0, 3.0);
        let mut control = PositionControl::new(Settings { hover_thrust: 0.54, ..omnicopter() });
        let mut highest_m: f64 = 0.0;
        for _ in 0..6000 {
            let thrust = control.step(&hold(Enu::zeros()), &plant.measured, 0.02);
            plant.step(thrust, 0.02);
            highest_m = highest_m.max(plant.measured.position_enu_m.z);
        }
        let left_m = plant.measured.position_enu_m.norm();
        assert!(left_m < 0.1 && highest_m < 15.0, "{left_m}, {highest_m}");
    }

    #[test]
    fn regress_a_slowed_loop_unlearns_the_drag_of_a_way_that_has_ended() {
        // At rest after a way against whose drag the integral has come to stand, by state that is old from then on.
        for age_s in [0.04, 0.2, 0.4] {
            let mut plant = plant(30.0, -70.0);
            let mut control =
                PositionControl::new(Settings { hover_thrust: 4.0 * GRAVITY_M_S2 / 115.9, ..omnicopter() });
            let mut farthest_m: f64 = 0.0;
            for k in 0..6000 {
                let on_the_way = k < 1000;
                plant.wind_n.x = if on_the_way { -8.0 } else { 0.0 };
                plant.measured.age_s = if on_the_way { 0.04 } else { age_s };
                let thrust = control.step(&hold(Enu::zeros()), &plant.measured, 0.02);
                plant.step(thrust, 0.02);
                farthest_m = farthest_m.max(plant.measured.position_enu_m.norm());
            }
            let left_m = plant.measured.position_enu_m.norm();
            assert!(left_m < 0.05 && farthest_m < 7.0, "{age_s}: {left_m}, {farthest_m}");
        }
    }

    #[test]
    fn val_holds_in_wind_with_a_wrong_hover_thrust_at_every_attitude() {
        for (roll, pitch) in [(0.0, 0.0), (30.0, 0.0), (60.0, 0.0), (90.0, 0.0), (0.0, -45.0), (180.0, 0.0)] {
            let mut plant = plant(roll, pitch);
            plant.wind_n = Vector3::new(3.0, -2.0, 1.0);
            let mut control = PositionControl::new(Settings { hover_thrust: 0.3, ..omnicopter() });
            for _ in 0..3000 {
                let thrust = control.step(&hold(Enu::zeros()), &plant.measured, 0.02);
                assert!(thrust.amax() <= 1.0);
                plant.step(thrust, 0.02);
            }
            let at = plant.measured;
            assert!(at.position_enu_m.norm() < 1e-3, "roll {roll} pitch {pitch}: {}", at.position_enu_m);
            // Hover takes m g less the wind's lift along z of what the z axis gives.
            let expected = (4.0 * GRAVITY_M_S2 - 1.0) / 115.9;
            assert!((control.hover_thrust() - expected).abs() < 1e-3, "{}", control.hover_thrust());
        }
    }

    #[test]
    fn spec_a_wrong_axis_scale_is_a_larger_error() {
        let rms = |thrust_n: [f64; 3]| {
            let mut plant = plant(90.0, 0.0);
            let mut control = PositionControl::new(Settings {
                hover_thrust: 4.0 * GRAVITY_M_S2 / 115.9,
                thrust_n: Some(thrust_n),
                ..Settings::default()
            });
            let mut sum = 0.0;
            for _ in 0..500 {
                let thrust = control.step(&hold(Enu::zeros()), &plant.measured, 0.02);
                plant.step(thrust, 0.02);
                sum += plant.measured.position_enu_m.norm_squared();
            }
            (sum / 500.0).sqrt()
        };
        assert!(rms([133.9, 133.9, 115.9]) < 1e-6);
        assert!(rms([115.9, 115.9, 115.9]) > 0.01);
    }

    #[test]
    fn spec_the_integral_stops_at_the_thrust_limit() {
        let settings = Settings { thrust_limit: 0.35, hover_thrust: 0.34, ..omnicopter() };
        let mut control = PositionControl::new(settings);
        let below = plant(0.0, 0.0).measured;
        for _ in 0..1000 {
            let thrust = control.step(&hold(Enu::new(0.0, 0.0, 50.0)), &below, 0.02);
            assert!(thrust.amax() <= 0.35 + 1e-12);
        }
        assert_eq!(control, PositionControl::new(settings));
    }

    #[test]
    fn regress_old_state_slows_the_loop_and_does_not_swing_it_out_of_the_band() {
        // A gust of 3 m/s, over a link on which thrust and state are this old together.
        let worst_after_10_s = |delay_s: f64, told_s: f64| {
            let (dt_s, mut plant) = (0.02, plant(30.0, -87.0));
            plant.measured.velocity_enu_m_s = EnuVelocity::new(3.0, 0.0, -3.0);
            let mut control =
                PositionControl::new(Settings { hover_thrust: 4.0 * GRAVITY_M_S2 / 115.9, ..omnicopter() });
            let mut under_way =
                std::collections::VecDeque::from(vec![plant.measured; (delay_s / dt_s) as usize]);
            let mut worst = 0.0_f64;
            for k in 0..1500 {
                under_way.push_back(plant.measured);
                let seen = Measured { age_s: told_s, ..under_way.pop_front().unwrap() };
                plant.step(control.step(&hold(Enu::zeros()), &seen, dt_s), dt_s);
                if k > 500 {
                    worst = worst.max(plant.measured.position_enu_m.norm());
                }
            }
            worst
        };
        // The slower the loop, the longer it takes.
        for (delay_s, within_m) in [(0.04, 0.2), (0.1, 0.2), (0.2, 0.2), (0.3, 0.5)] {
            assert!(worst_after_10_s(delay_s, delay_s) < within_m, "{delay_s} s");
        }
        // What it was: full gains, whatever the age.
        assert!(worst_after_10_s(0.45, 0.0) > 1.0);
        // A command is under way as well, which the age of the state need not show.
        assert!(worst_after_10_s(0.45, 0.25) < 0.2);
    }

    #[test]
    fn regress_a_vehicle_that_is_seen_late_stops_where_it_is_told_to() {
        // From 8 m/s at 2.5 m/s^2, against air that resists: at 8 m/s with 0.8 m/s^2.
        let beyond_m = |delay_s: f64| {
            let (dt_s, mut plant) = (0.02, plant(55.0, 80.0));
            let mut control =
                PositionControl::new(Settings { hover_thrust: 4.0 * GRAVITY_M_S2 / 115.9, ..omnicopter() });
            let mut under_way =
                std::collections::VecDeque::from(vec![plant.measured; (delay_s / dt_s).round() as usize]);
            let mut wanted = hold(Enu::zeros());
            let mut worst_m = f64::NEG_INFINITY;
            for k in 0..1500 {
                let before_end_s = 10.0 - f64::from(k) * dt_s;
                let acceleration = match before_end_s {
                    ..0.0 => 0.0,
                    ..3.2 => -2.5,
                    6.8.. => 2.5,
                    _ => 0.0,
                };
                wanted.position_enu_m.x +=
                    wanted.velocity_enu_m_s.vector().x * dt_s + acceleration * dt_s.powi(2) / 2.0;
                wanted.velocity_enu_m_s = EnuVelocity::from_vector(
                    wanted.velocity_enu_m_s.vector() + Vector3::x() * acceleration * dt_s,
                );
                wanted.acceleration_enu_m_s2 = EnuAcceleration::from_vector(Vector3::x() * acceleration);
                under_way.push_back(plant.measured);
                let seen = Measured { age_s: delay_s, ..under_way.pop_front().unwrap() };
                plant.wind_n.x = -0.4 * plant.measured.velocity_enu_m_s.vector().x;
                plant.step(control.step(&wanted, &seen, dt_s), dt_s);
                if before_end_s < 0.0 {
                    worst_m = worst_m.max(plant.measured.position_enu_m.x - wanted.position_enu_m.x);
                }
            }
            worst_m
        };
        for (delay_s, within_m) in [(0.0, 0.1), (0.04, 0.1), (0.1, 0.2), (0.2, 0.5)] {
            let beyond_m = beyond_m(delay_s);
            assert!(beyond_m < within_m, "{delay_s} s: {beyond_m} m");
        }
    }

    #[test]
    fn spec_the_loop_is_as_fast_as_ever_some_seconds_after_the_delay() {
        let mut control = PositionControl::new(omnicopter());
        assert_eq!(control.slow_for(0.05, 0.02), 1.0);
        assert!((control.slow_for(0.4, 0.02) - 0.2).abs() < 1e-12);
        let recovered: Vec<f64> = (0..500).map(|_| control.slow_for(0.05, 0.02)).collect();
        assert!(recovered.is_sorted() && recovered[10] < 0.3 && recovered[499] > 0.95, "{recovered:?}");
        for unknown in [f64::NAN, f64::INFINITY] {
            assert_eq!(control.slow_for(unknown, 0.02), PROMPT_S / LARGEST_AGE_S);
        }
    }

    #[test]
    fn spec_garbage_in_is_never_garbage_out() {
        let mut control = PositionControl::new(Settings::default());
        let mut at = plant(0.0, 0.0).measured;
        at.position_enu_m.x = f64::NAN;
        let thrust = control.step(&hold(Enu::new(f64::INFINITY, 0.0, 0.0)), &at, 0.02);
        assert!(thrust.iter().all(|c| c.is_finite()));
    }
}
