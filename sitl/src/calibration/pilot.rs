//! The script that flies a calibration: out to the circle, then round and back, turning as it goes.

use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::time::Duration;

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

use super::{CalibrationConfig, Reading, since};
use crate::vehicle::airframe::{Airframe, Body};
use crate::vehicle::bias::OwnFrame;
use crate::vehicle::config::Role;
use crate::vehicle::control::{Controller, Estimate, SpeedLimits, Target};
use crate::vehicle::dynamics::Dynamics;
use crate::vehicle::estimator::Estimator;
use crate::vehicle::jitter::Jitter;
use crate::vehicle::wind::Wind;
use crate::vehicle::{SAMPLE, TICK, TICKS_PER_SAMPLE, tick_time, truth};

/// Along the circle, at most. It goes round and back again: a position that is told late is off to one side all the way round,
/// which nothing tells from a heading that is off.
const SPEED_M_S: f64 = 2.0;
/// Heights above the receiver between which it goes up and down as it goes round, over the radius.
const HEIGHTS: [f64; 2] = [0.3, 0.9];
/// Periods of what is turned through, seconds: the climb, the angle between antenna and receiver from 0 to 180 degrees and
/// back, the side to which it is turned, and the turn about the antenna itself. They do not divide each other, so that no
/// combination is left out.
const PERIODS_S: [f64; 4] = [71.0, 43.0, 173.0, 97.0];
/// Time to reach the circle from the ground.
const OUT: Duration = Duration::from_secs(40);
const LIMITS: SpeedLimits = SpeedLimits { horizontal_m_s: 6.0, up_m_s: 3.0, down_m_s: 2.0 };

/// One vehicle under a script.
pub(super) struct Pilot {
    receiver_enu_m: Vector3<f64>,
    radius_m: f64,
    dynamics: Dynamics,
    controller: Controller,
    wind: Wind,
    jitter: Jitter,
    estimator: Estimator,
    estimate: Estimate,
    /// True, jitter included.
    attitude: UnitQuaternion<f64>,
    ticks: u64,
}

impl Pilot {
    /// On the ground under the circle's first point.
    pub fn new(config: &CalibrationConfig, frame: OwnFrame) -> Self {
        let (body, geometry) = (Body::default(), Airframe::Omnidirectional.rotors());
        let index = Role::I.index();
        let receiver_enu_m = Vector3::from(config.receiver_enu_m);
        let home = Vector3::new(receiver_enu_m.x + config.radius_m, receiver_enu_m.y, 0.0);
        let dynamics = Dynamics::new(body, &geometry, home, 0.0);
        Self {
            receiver_enu_m,
            radius_m: config.radius_m,
            controller: Controller::new(body, Airframe::Omnidirectional, &geometry),
            wind: Wind::new(config.wind, config.seed, index),
            jitter: Jitter::new(config.jitter, config.seed, index),
            estimator: Estimator::new(config.sensors, frame, config.seed, index, TICK.as_secs_f64()),
            estimate: truth(&dynamics),
            attitude: dynamics.attitude,
            dynamics,
            ticks: 0,
        }
    }

    fn now(&self) -> Duration {
        tick_time(self.ticks)
    }

    /// True position, ENU, metres.
    pub fn position_enu_m(&self) -> Vector3<f64> {
        self.dynamics.position_enu_m
    }

    /// The body's true attitude, jitter included.
    pub fn attitude(&self) -> &UnitQuaternion<f64> {
        &self.attitude
    }

    /// Draws the jitter of a radio sample.
    pub fn sample(&mut self) {
        self.jitter.draw(SAMPLE.as_secs_f64());
        self.attitude = self.jitter.apply(&self.dynamics.attitude, None);
    }

    /// The line of the log for this instant.
    pub fn reading(&self, begins: Duration, received_dbm: f64) -> Reading {
        let wxyz = |q: &UnitQuaternion<f64>| [q.w, q.i, q.j, q.k];
        Reading {
            time_s: since(begins, self.now()),
            position_enu_m: self.estimate.position_enu_m.into(),
            attitude_wxyz: wxyz(&self.estimator.reported(&self.attitude)),
            received_dbm,
            true_position_enu_m: self.dynamics.position_enu_m.into(),
            true_attitude_wxyz: wxyz(&self.attitude),
        }
    }

    /// Takes off and settles at the circle's first point; when it begins.
    pub fn fly_to_the_circle(&mut self) -> Duration {
        let begins = self.now() + OUT;
        let first = self.script(0.0);
        let still = Target { velocity_enu_m_s: [None; 3], ..first };
        while self.now() < begins {
            // Level until it is well off the ground.
            let high = self.estimate.position_enu_m.z > 0.5 * HEIGHTS[0] * self.radius_m;
            let attitude = if high { still.attitude } else { UnitQuaternion::identity() };
            self.tick(&Target { attitude, ..still });
        }
        begins
    }

    /// One radio sample's time on the circle.
    pub fn fly_a_sample(&mut self) {
        for _ in 0..TICKS_PER_SAMPLE {
            let target = self.script(since(OUT, self.now()));
            self.tick(&target);
        }
    }

    /// Where it shall be, so long after the circle began.
    fn script(&self, at_s: f64) -> Target {
        let [climb, angle, side, spin] = PERIODS_S.map(|period_s| TAU * at_s / period_s);
        let [low, high] = HEIGHTS.map(|of| of * self.radius_m);
        // Once round and back, with its largest speed on the far side.
        let (turn_s, turn_c) = (SPEED_M_S / (PI * self.radius_m) * at_s).sin_cos();
        let (speed_m_s, around) = (SPEED_M_S * turn_s, PI * (1.0 - turn_c));
        let (s, c) = around.sin_cos();
        let height_m = (low + high) / 2.0 - (high - low) / 2.0 * climb.cos();
        let offset = Vector3::new(self.radius_m * c, self.radius_m * s, height_m);
        let climb_m_s = (high - low) / 2.0 * (TAU / PERIODS_S[0]) * climb.sin();
        Target {
            position_enu_m: <[f64; 3]>::from(self.receiver_enu_m + offset).map(Some),
            velocity_enu_m_s: [-speed_m_s * s, speed_m_s * c, climb_m_s].map(Some),
            attitude: facing(&-offset, FRAC_PI_2 * (1.0 - angle.cos()), side, spin),
        }
    }

    /// One step.
    fn tick(&mut self, target: &Target) {
        let dt = TICK.as_secs_f64();
        self.estimate = self.estimator.step(truth(&self.dynamics), self.now(), dt);
        let throttles = self.controller.step(&self.estimate, target, LIMITS, dt);
        let air = self.wind.step(dt, self.dynamics.position_enu_m.z, &self.dynamics.velocity_enu_m_s);
        self.dynamics.step(&throttles, air, dt);
        self.ticks += 1;
    }
}

/// The attitude whose body z makes an angle with a line, to one side of it, with a turn about itself; radians. All three
/// may go round without a jump; the line must not be vertical.
fn facing(line: &Vector3<f64>, angle: f64, side: f64, spin: f64) -> UnitQuaternion<f64> {
    let along = line.normalize();
    let level = Vector3::z().cross(&along).normalize();
    let outward = level * side.cos() + along.cross(&level) * side.sin();
    let axis = along * angle.cos() + outward * angle.sin();
    let ahead = outward * angle.cos() - along * angle.sin();
    let basis = Matrix3::from_columns(&[ahead, axis.cross(&ahead), axis]);
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(basis))
        * UnitQuaternion::from_axis_angle(&Vector3::z_axis(), spin)
}
