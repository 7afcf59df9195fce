//! What the autopilot believes of its own motion: the truth with a lag, slow errors, and what goes wrong with it.
//!
//! Each error is a first-order Gauss-Markov process, advanced exactly. The autopilot flies by this and reports it.

use std::collections::VecDeque;
use std::time::Duration;

use nalgebra::{UnitQuaternion, Vector3};

use super::bias::OwnFrame;
use super::config::SensorConfig;
use super::control::Estimate;
use crate::random::{Noise, Purpose, decay};

/// Correlation times of the errors of position, velocity and attitude, seconds.
const CORRELATION_S: [f64; 3] = [20.0, 1.0, 5.0];
/// The errors are advanced every so many steps (20 ms of 2.5 ms) and held in between.
const HOLD_STEPS: u32 = 8;
/// Without GPS the inertial solution runs away at this acceleration, m/s^2.
const DRIFT_M_S2: f64 = 0.06;
/// And is given up after this long.
const DEAD_RECKONING: Duration = Duration::from_secs(5);
/// A lag beyond this is none that any estimator has; it bounds what is remembered.
const LONGEST_LAG_S: f64 = 1.0;

/// One vehicle's estimator.
#[derive(Debug, Clone)]
pub(crate) struct Estimator {
    config: SensorConfig,
    /// What it takes for the mission's frame.
    frame: OwnFrame,
    noise: Noise,
    /// Errors of position (m), velocity (m/s) and attitude (rad).
    errors: [Vector3<f64>; 3],
    tilt: UnitQuaternion<f64>,
    steps: u32,
    /// The truth of the last steps, oldest first.
    past: VecDeque<Estimate>,
    delay_steps: usize,
    /// What a reset has left.
    jump_m: Vector3<f64>,
    lost_at: Option<Duration>,
    drift_m_s: Vector3<f64>,
    drift_m: Vector3<f64>,
}

impl Estimator {
    pub fn new(config: SensorConfig, frame: OwnFrame, seed: u64, vehicle: usize, step_s: f64) -> Self {
        let delay_steps = (config.lag_s.clamp(0.0, LONGEST_LAG_S) / step_s).round() as usize;
        let mut made = Self {
            config,
            frame,
            noise: Noise::new(seed, Purpose::Sensors, vehicle),
            errors: [Vector3::zeros(); 3],
            tilt: UnitQuaternion::identity(),
            steps: 0,
            past: VecDeque::with_capacity(delay_steps + 1),
            delay_steps,
            jump_m: Vector3::zeros(),
            lost_at: None,
            drift_m_s: Vector3::zeros(),
            drift_m: Vector3::zeros(),
        };
        for k in 0..3 {
            made.draw(k, 0.0);
        }
        made
    }

    fn deviations(&self) -> [f64; 3] {
        let c = &self.config;
        [c.position_std_m, c.velocity_std_m_s, c.attitude_std_deg.to_radians()]
    }

    fn draw(&mut self, kind: usize, keep: f64) {
        let std = self.deviations()[kind];
        if std > 0.0 {
            let fresh = (1.0 - keep * keep).sqrt() * std;
            for axis in 0..3 {
                self.errors[kind][axis] = keep * self.errors[kind][axis] + fresh * self.noise.normal();
            }
            self.tilt = UnitQuaternion::from_scaled_axis(self.errors[2]);
        }
    }

    /// The estimate `dt` seconds after the last.
    pub fn step(&mut self, truth: Estimate, now: Duration, dt: f64) -> Estimate {
        if self.steps == 0 {
            for (kind, correlation_s) in CORRELATION_S.into_iter().enumerate() {
                self.draw(kind, decay(dt * f64::from(HOLD_STEPS), correlation_s));
            }
        }
        self.steps = (self.steps + 1) % HOLD_STEPS;
        if self.lost_at.is_some_and(|at| now > at) {
            self.drift_m_s +=
                self.drift_m_s.try_normalize(1e-12).unwrap_or_else(Vector3::x) * (DRIFT_M_S2 * dt);
            self.drift_m += self.drift_m_s * dt;
        }
        self.past.push_back(truth);
        let seen = if self.past.len() > self.delay_steps {
            self.past.pop_front()
        } else {
            self.past.front().copied()
        };
        let seen = seen.unwrap_or(truth);
        Estimate {
            position_enu_m: self.frame.position(&seen.position_enu_m)
                + self.errors[0]
                + self.jump_m
                + self.drift_m,
            velocity_enu_m_s: seen.velocity_enu_m_s + self.errors[1] + self.drift_m_s,
            attitude: self.reported(&seen.attitude),
            contact: truth.contact,
            ..seen
        }
    }

    /// What is said of a body of this attitude.
    pub fn reported(&self, truth: &UnitQuaternion<f64>) -> UnitQuaternion<f64> {
        self.frame.attitude(truth) * self.tilt
    }

    /// By how far the estimate is off for a reason that nobody aboard can know, metres ENU.
    pub fn lie_m(&self) -> Vector3<f64> {
        self.jump_m + self.drift_m
    }

    /// The position jumps, as when a filter starts afresh on other evidence.
    pub fn reset(&mut self, jump_enu_m: Vector3<f64>) {
        self.jump_m += jump_enu_m;
    }

    /// GPS is lost, or back. When it is back the position jumps to where it should be.
    pub fn set_gps(&mut self, lost: bool, now: Duration) {
        if lost && self.lost_at.is_none() {
            self.lost_at = Some(now);
            // Away in a direction of its own, from nothing.
            let angle = std::f64::consts::TAU * self.noise.uniform();
            self.drift_m_s = Vector3::new(angle.cos(), angle.sin(), 0.0) * 1e-9;
        } else if !lost {
            (self.lost_at, self.drift_m_s, self.drift_m) = (None, Vector3::zeros(), Vector3::zeros());
        }
    }

    /// There is a fix.
    pub fn has_gps(&self) -> bool {
        self.lost_at.is_none()
    }

    /// The position can still be trusted, as far as the autopilot knows.
    pub fn trusted(&self, now: Duration) -> bool {
        self.lost_at.is_none_or(|at| now.saturating_sub(at) < DEAD_RECKONING)
    }
}

#[cfg(test)]
mod tests {
    use super::super::bias::Bias;
    use super::*;

    const DT: f64 = 0.0025;

    fn truth(x: f64) -> Estimate {
        Estimate {
            position_enu_m: Vector3::new(x, 0.0, 30.0),
            velocity_enu_m_s: Vector3::zeros(),
            attitude: UnitQuaternion::identity(),
            rates_flu_rad_s: Vector3::zeros(),
            contact: false,
        }
    }

    #[test]
    fn val_errors_have_their_deviations() {
        let config =
            SensorConfig { position_std_m: 0.3, velocity_std_m_s: 0.1, attitude_std_deg: 0.5, lag_s: 0.0 };
        let (mut squares, mut n) = ([0.0; 3], 0.0);
        // Many short runs: the errors are slow.
        for seed in 0..800 {
            let mut estimator = Estimator::new(config, OwnFrame::default(), seed, 0, DT);
            let mut last = truth(0.0);
            for _ in 0..80 {
                last = estimator.step(truth(0.0), Duration::ZERO, DT);
            }
            squares[0] += (last.position_enu_m - truth(0.0).position_enu_m).norm_squared() / 3.0;
            squares[1] += last.velocity_enu_m_s.norm_squared() / 3.0;
            squares[2] += last.attitude.scaled_axis().norm_squared() / 3.0;
            n += 1.0;
        }
        for (sum, std) in squares.into_iter().zip([0.3, 0.1, 0.5f64.to_radians()]) {
            // 2400 independent values.
            assert!((sum / n / (std * std) - 1.0).abs() < 4.0 * (2.0f64 / 2400.0).sqrt(), "{sum} {std}");
        }
    }

    #[test]
    fn val_the_lag_is_its_length_and_contact_has_none() {
        let config = SensorConfig { lag_s: 0.05, ..SensorConfig::default() };
        let mut estimator = Estimator::new(config, OwnFrame::default(), 1, 0, DT);
        for k in 0..200u32 {
            let x = f64::from(k) * DT;
            let seen = estimator.step(Estimate { contact: k == 150, ..truth(x) }, Duration::ZERO, DT);
            assert!((seen.position_enu_m.x - (x - 0.05).max(0.0)).abs() < 1e-12);
            assert_eq!(seen.contact, k == 150);
        }
    }

    #[test]
    fn spec_without_gps_it_runs_away_and_jumps_back() {
        let mut estimator = Estimator::new(SensorConfig::default(), OwnFrame::default(), 1, 0, DT);
        estimator.set_gps(true, Duration::ZERO);
        let mut last = truth(0.0);
        for k in 1..=1600u32 {
            last = estimator.step(truth(0.0), Duration::from_micros(2500) * k, DT);
        }
        // 4 s at 0.06 m/s^2.
        let error = (last.position_enu_m - truth(0.0).position_enu_m).norm();
        assert!((error - 0.48).abs() < 0.01 && !estimator.has_gps(), "{error}");
        assert!(estimator.trusted(Duration::from_millis(4999)) && !estimator.trusted(Duration::from_secs(5)));
        estimator.set_gps(false, Duration::from_secs(6));
        let back = estimator.step(truth(0.0), Duration::from_secs(6), DT);
        assert_eq!(back, truth(0.0));
        estimator.reset(Vector3::new(0.0, 3.0, 0.0));
        let reset = estimator.step(truth(0.0), Duration::from_secs(6), DT);
        assert_eq!(reset.position_enu_m, Vector3::new(0.0, 3.0, 30.0));
    }

    #[test]
    fn spec_a_bias_stays_and_shows_in_no_speed() {
        let bias = Bias { heading_deg: 3.0, position_enu_m: [0.5, -0.25, 1.0], ..Bias::default() };
        let mut estimator = Estimator::new(SensorConfig::default(), OwnFrame::from(bias), 1, 0, DT);
        let moving = Estimate { velocity_enu_m_s: Vector3::new(2.0, 0.0, 0.0), ..truth(4.0) };
        for _ in 0..100 {
            let seen = estimator.step(moving, Duration::ZERO, DT);
            assert_eq!(seen.position_enu_m, Vector3::new(3.5, 0.25, 29.0));
            assert_eq!(seen.velocity_enu_m_s, moving.velocity_enu_m_s);
            let turned = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), -3f64.to_radians());
            assert!(seen.attitude.angle_to(&turned) < 1e-12);
        }
        assert_eq!(estimator.lie_m(), Vector3::zeros());
    }
}
