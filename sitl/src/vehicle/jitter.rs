//! The attitude jitter that the mission's planner assumes, drawn for every radio sample.

use nalgebra::{UnitQuaternion, Vector3};

use crate::frames::Euler;
use crate::random::{Noise, Purpose, decay};

/// What is disturbed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum JitterModel {
    /// The Euler angles (the paper).
    #[default]
    Euler,
    /// A small rotation about the body's axes.
    Body,
}

/// About which axes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum JitterAxes {
    /// Roll and pitch (body x and y).
    #[default]
    RollPitch,
    /// All three.
    RollPitchYaw,
}

/// The jitter of both vehicles.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct JitterConfig {
    /// Standard deviation of each angle, degrees.
    pub std_deg: f64,
    /// What is disturbed.
    pub model: JitterModel,
    /// About which axes.
    pub axes: JitterAxes,
    /// Correlation time, seconds; 0 draws every radio sample (5 ms) afresh.
    pub correlation_s: f64,
}

/// One vehicle's jitter: a Gaussian vector that is redrawn at each radio sample.
#[derive(Debug, Clone)]
pub(crate) struct Jitter {
    config: JitterConfig,
    angles_rad: Vector3<f64>,
    noise: Noise,
    started: bool,
}

impl Jitter {
    pub fn new(config: JitterConfig, seed: u64, vehicle: usize) -> Self {
        let noise = Noise::new(seed, Purpose::Jitter, vehicle);
        Self { config, angles_rad: Vector3::zeros(), noise, started: false }
    }

    /// Draws the angles of the next sample, `dt` seconds after the last.
    pub fn draw(&mut self, dt: f64) {
        let std = self.config.std_deg.to_radians();
        if std <= 0.0 {
            return;
        }
        let keep = if self.started { decay(dt, self.config.correlation_s) } else { 0.0 };
        self.started = true;
        let fresh = (1.0 - keep * keep).sqrt() * std;
        let axes = if self.config.axes == JitterAxes::RollPitchYaw { 3 } else { 2 };
        for axis in 0..axes {
            self.angles_rad[axis] = keep * self.angles_rad[axis] + fresh * self.noise.normal();
        }
    }

    /// The disturbed attitude. `nominal` is where the controller has brought the body; `angles` are the Euler
    /// angles it is meant to have. Near pitch = +-pi/2 the angles cannot be read off a rotation, yet the law of the
    /// disturbance depends on them, so it is built at the angles meant and carried over to the attitude reached.
    pub fn apply(&self, nominal: &UnitQuaternion<f64>, angles: Option<Euler>) -> UnitQuaternion<f64> {
        let w = self.angles_rad;
        match self.config.model {
            JitterModel::Body => nominal * UnitQuaternion::from_scaled_axis(w),
            JitterModel::Euler => {
                let meant = angles.unwrap_or_else(|| Euler::of(nominal));
                let disturbed = Euler {
                    roll_rad: meant.roll_rad + w.x,
                    pitch_rad: meant.pitch_rad + w.y,
                    yaw_rad: meant.yaw_rad + w.z,
                };
                nominal * (meant.rotation().inverse() * disturbed.rotation())
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn config(model: JitterModel, correlation_s: f64) -> JitterConfig {
        JitterConfig { std_deg: 2.0, model, axes: JitterAxes::RollPitch, correlation_s }
    }

    #[test]
    fn val_euler_jitter_adds_to_the_planned_angles() {
        let mut jitter = Jitter::new(config(JitterModel::Euler, 0.0), 5, 0);
        let meant = Euler { roll_rad: 0.8, pitch_rad: -0.4, yaw_rad: 0.0 };
        let n = 40_000;
        let (mut sum, mut squares, mut cross) = ([0.0; 3], [0.0; 3], 0.0);
        let mut last = 0.0;
        for _ in 0..n {
            jitter.draw(0.005);
            let e = Euler::of(&jitter.apply(&meant.rotation(), Some(meant)));
            let w = [e.roll_rad - meant.roll_rad, e.pitch_rad - meant.pitch_rad, e.yaw_rad - meant.yaw_rad];
            for k in 0..3 {
                sum[k] += w[k];
                squares[k] += w[k] * w[k];
            }
            cross += w[0] * last;
            last = w[0];
        }
        let (n, s) = (f64::from(n), 2f64.to_radians());
        for k in 0..2 {
            assert!((sum[k] / n).abs() < 4.0 * s / n.sqrt());
            assert!((squares[k] / n / (s * s) - 1.0).abs() < 4.0 * (2.0 / n).sqrt());
        }
        assert!(squares[2] < 1e-20, "yaw is left alone");
        assert!((cross / n / (s * s)).abs() < 4.0 / n.sqrt(), "independent from sample to sample");
    }

    #[test]
    fn val_correlated_jitter_keeps_its_variance() {
        let mut jitter = Jitter::new(config(JitterModel::Body, 0.05), 6, 1);
        let n = 100_000;
        let (mut squares, mut cross, mut last) = (0.0, 0.0, 0.0);
        for _ in 0..n {
            jitter.draw(0.005);
            squares += jitter.angles_rad.x.powi(2);
            cross += jitter.angles_rad.x * last;
            last = jitter.angles_rad.x;
        }
        // 20 samples are one independent value: 5000 of them.
        assert!(
            (squares / f64::from(n) / 2f64.to_radians().powi(2) - 1.0).abs() < 4.0 * (2.0f64 / 5000.0).sqrt()
        );
        assert!((cross / squares - (-0.1f64).exp()).abs() < 0.02);
    }

    #[test]
    fn spec_at_vertical_pitch_the_law_follows_the_angles_meant() {
        // At pitch 90 degrees, (roll 0.5, yaw 0) and (roll 0, yaw -0.5) are one rotation with different laws.
        let mut jitter = Jitter::new(config(JitterModel::Euler, 0.0), 8, 0);
        let a = Euler { roll_rad: 0.5, pitch_rad: std::f64::consts::FRAC_PI_2, yaw_rad: 0.0 };
        let b = Euler { roll_rad: 0.0, yaw_rad: -0.5, ..a };
        assert!(a.rotation().angle_to(&b.rotation()) < 1e-7);
        jitter.draw(0.005);
        let (ja, jb) = (jitter.apply(&a.rotation(), Some(a)), jitter.apply(&a.rotation(), Some(b)));
        assert!(ja.angle_to(&jb) > 1e-3);
        let direct = Euler {
            roll_rad: a.roll_rad + jitter.angles_rad.x,
            pitch_rad: a.pitch_rad + jitter.angles_rad.y,
            yaw_rad: 0.0,
        };
        assert!(ja.angle_to(&direct.rotation()) < 1e-7);
    }
}
