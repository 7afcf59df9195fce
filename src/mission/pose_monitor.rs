//! Is the vehicle where, and turned as, the plan says?
//!
//! The mission expects the attitude to jitter, so a single sample proves little. Two limits are kept: the error of
//! the *smoothed* attitude (a first-order filter that averages the jitter out) must stay inside the tolerance, and
//! no single sample may be off by more than the tolerance plus five standard deviations of the jitter. A step out
//! of pose is seen at the first sample if it is large and within a few filter times if it is small.

use std::time::Duration;

use nalgebra::Vector3;

use crate::geo::{Attitude, Enu, Pose};
use crate::time::Instant;

/// Time constant of the attitude filter.
const FILTER: Duration = Duration::from_millis(100);

/// How far a pose may be off.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tolerance {
    /// Position error in metres.
    pub position_m: f64,
    /// Error of the smoothed attitude in radians.
    pub attitude_rad: f64,
    /// Standard deviation of the expected jitter per axis, radians.
    pub jitter_rad: f64,
}

impl Tolerance {
    /// Position within 1 m; smoothed attitude within 3 deg plus one standard deviation of the jitter (what is left
    /// of it after the filter).
    #[must_use]
    pub fn for_jitter(jitter_rad: f64) -> Self {
        let [position_m, attitude_rad] = Self::widest();
        Self::of(position_m, attitude_rad, jitter_rad)
    }

    /// The widest that is ever allowed: position in metres, attitude in radians without the jitter's share.
    #[must_use]
    pub const fn widest() -> [f64; 2] {
        [1.0, 3f64.to_radians()]
    }

    /// As [`Self::for_jitter`], within these limits or the widest, whichever is stricter.
    #[must_use]
    pub fn of(position_m: f64, attitude_rad: f64, jitter_rad: f64) -> Self {
        let [widest_m, widest_rad] = Self::widest();
        Self {
            position_m: position_m.min(widest_m),
            attitude_rad: attitude_rad.min(widest_rad) + jitter_rad,
            jitter_rad,
        }
    }

    fn single_sample_rad(&self) -> f64 {
        self.attitude_rad + 5.0 * self.jitter_rad
    }
}

/// Why a pose does not count as held.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Off {
    /// Metres from the planned position.
    Position(f64),
    /// Radians from the planned attitude.
    Attitude(f64),
    /// Nothing known yet.
    Unknown,
}

/// Watches one pose.
#[derive(Debug, Clone)]
pub struct PoseMonitor {
    target: Pose,
    tolerance: Tolerance,
    /// Smoothed rotation vector from the planned to the measured attitude, and when it was last fed.
    error: Option<(Vector3<f64>, Instant)>,
    last_sample_rad: f64,
    position_error_m: Option<f64>,
}

impl PoseMonitor {
    /// A monitor that has seen nothing.
    #[must_use]
    pub fn new(target: Pose, tolerance: Tolerance) -> Self {
        Self { target, tolerance, error: None, last_sample_rad: 0.0, position_error_m: None }
    }

    /// Feeds the measured position.
    pub fn position(&mut self, position_enu_m: Enu) {
        self.position_error_m = Some((position_enu_m - self.target.position_enu_m).norm());
    }

    /// Feeds the attitude measured at `at`; a sample already fed is ignored.
    pub fn attitude(&mut self, attitude: &Attitude, at: Instant) {
        let error = (self.target.attitude().rotation().inverse() * attitude.rotation()).scaled_axis();
        let smoothed = match self.error {
            Some((_, last)) if at <= last => return,
            Some((smoothed, last)) => {
                let dt = at.saturating_since(last).as_secs_f64();
                smoothed + (error - smoothed) * (1.0 - (-dt / FILTER.as_secs_f64()).exp())
            }
            None => error,
        };
        self.error = Some((smoothed, at));
        self.last_sample_rad = error.norm();
    }

    /// `Ok` while the pose is held.
    ///
    /// # Errors
    /// What is off, with the figure.
    pub fn check(&self) -> Result<(), Off> {
        let (Some(position_m), Some((smoothed, _))) = (self.position_error_m, self.error) else {
            return Err(Off::Unknown);
        };
        if position_m.is_nan() || position_m > self.tolerance.position_m {
            return Err(Off::Position(position_m));
        }
        let smoothed_rad = smoothed.norm();
        if smoothed_rad.is_nan() || smoothed_rad > self.tolerance.attitude_rad {
            return Err(Off::Attitude(smoothed_rad));
        }
        if self.last_sample_rad > self.tolerance.single_sample_rad() {
            return Err(Off::Attitude(self.last_sample_rad));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};

    use super::*;

    fn pose() -> Pose {
        Pose { position_enu_m: Vector3::new(1.0, 2.0, 80.0), roll_rad: 0.9, pitch_rad: -0.3, yaw_rad: 0.0 }
    }

    fn at(ms: u64) -> Instant {
        Instant::from_start(Duration::from_millis(ms))
    }

    #[test]
    fn val_unknown_until_both_are_fed() {
        let mut monitor = PoseMonitor::new(pose(), Tolerance::for_jitter(0.0));
        assert_eq!(monitor.check(), Err(Off::Unknown));
        monitor.position(pose().position_enu_m);
        assert_eq!(monitor.check(), Err(Off::Unknown));
        monitor.attitude(&pose().attitude(), at(0));
        assert_eq!(monitor.check(), Ok(()));
    }

    #[test]
    fn val_position_beyond_a_metre_is_off() {
        let mut monitor = PoseMonitor::new(pose(), Tolerance::for_jitter(0.0));
        monitor.attitude(&pose().attitude(), at(0));
        monitor.position(pose().position_enu_m + Vector3::new(0.0, 0.0, 0.99));
        assert_eq!(monitor.check(), Ok(()));
        monitor.position(pose().position_enu_m + Vector3::new(0.8, 0.0, 0.8));
        assert!(matches!(monitor.check(), Err(Off::Position(m)) if (m - 0.8 * 2f64.sqrt()).abs() < 1e-12));
        monitor.position(Vector3::new(f64::NAN, 0.0, 0.0));
        assert!(matches!(monitor.check(), Err(Off::Position(_))));
    }

    #[test]
    fn val_jitter_as_planned_is_tolerated_for_ten_minutes_and_a_step_is_not() {
        let std = 2f64.to_radians();
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1);
        // Sum of twelve uniforms: close enough to a Gaussian, with tails to six standard deviations.
        let mut gauss = || std * ((0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0);
        let mut monitor = PoseMonitor::new(pose(), Tolerance::for_jitter(std));
        monitor.position(pose().position_enu_m);
        for k in 0..30_000 {
            let jittered = Attitude::from_euler(0.9 + gauss(), -0.3 + gauss(), 0.0);
            monitor.attitude(&jittered, at(20 * k));
            assert_eq!(monitor.check(), Ok(()), "sample {k}");
        }
        let tilted = Attitude::from_euler(0.9 + 20f64.to_radians(), -0.3, 0.0);
        monitor.attitude(&tilted, at(600_020));
        assert!(matches!(monitor.check(), Err(Off::Attitude(_))));
    }

    #[test]
    fn val_small_step_is_seen_within_100_ms() {
        let mut monitor = PoseMonitor::new(pose(), Tolerance::for_jitter(2f64.to_radians()));
        monitor.position(pose().position_enu_m);
        monitor.attitude(&pose().attitude(), at(0));
        let off = Attitude::from_euler(0.9 + 8f64.to_radians(), -0.3, 0.0);
        let seen = (1..).find(|k| {
            monitor.attitude(&off, at(20 * k));
            monitor.check().is_err()
        });
        assert!(seen.unwrap() * 20 <= 100, "seen after {} ms", seen.unwrap() * 20);
    }
}
