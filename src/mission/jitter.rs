//! How much the attitude jitters in a slot, and whether the mission knows of it.
//!
//! The plan counts on `[jitter] std_deg`: at 2 deg more than that the demonstration carries 1 bit/s/Hz less than it promises, and at a
//! tenth of it other poses would carry more. Of the error of attitude `e` about the body's x and y axes, which is what turns an antenna,
//! the mean over a slot is a lean or a bias, and what is left is the jitter: `s^2 = (mean |e|^2 - |mean e|^2) / 2`.

use nalgebra::Vector2;

use crate::geo::Attitude;
use crate::time::Instant;

/// Samples of a slot that say something: three seconds at 50 Hz, which tell a deviation to 4%.
const LEAST_SAMPLES: u32 = 150;
/// So many times what is expected, and so much beyond, is more; and less than half of what is expected is less.
const MORE: f64 = 1.5;
const BEYOND_RAD: f64 = 0.3f64.to_radians();
const LESS: f64 = 0.5;

/// See the module.
#[derive(Debug, Clone, Default)]
pub(super) struct Jitter {
    heard: Option<Instant>,
    samples: u32,
    sum: Vector2<f64>,
    sum_of_squares: f64,
    told: bool,
}

impl Jitter {
    /// Takes the attitude that was measured at `at`, in a slot, where it is meant to be so.
    pub fn hear(&mut self, measured: &Attitude, meant: &Attitude, at: Instant) {
        if self.heard.replace(at).is_some_and(|heard| at <= heard) {
            return;
        }
        let error = (meant.rotation().inverse() * measured.rotation()).scaled_axis().xy();
        self.samples += 1;
        self.sum += error;
        self.sum_of_squares += error.norm_squared();
    }

    /// A slot is over. Its jitter per axis in radians, if it is another than is expected; told once.
    pub fn slot_over(&mut self, expected_rad: f64) -> Option<f64> {
        let Self { samples, sum, sum_of_squares, told, .. } = std::mem::take(self);
        self.told = told;
        let count = f64::from(samples);
        let std_rad = ((sum_of_squares / count - (sum / count).norm_squared()) / 2.0).max(0.0).sqrt();
        let more = std_rad > MORE * expected_rad + BEYOND_RAD;
        let other = more || std_rad < LESS * expected_rad;
        let tells = samples >= LEAST_SAMPLES && other && !told;
        self.told |= tells;
        tells.then_some(std_rad)
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    /// What is told after a slot of so many samples, of an attitude that is to and fro by `std_deg` about either axis and leans by 5 deg.
    fn told(jitter: &mut Jitter, std_deg: f64, samples: u32) -> Option<f64> {
        let meant = Attitude::from_euler(0.7, -0.4, 0.2);
        for k in 0..samples {
            let side = |bit: u32| if k >> bit & 1 == 0 { std_deg } else { -std_deg };
            let off = nalgebra::Vector3::new(side(0) + 5.0, side(1), 3.0).map(f64::to_radians);
            let measured =
                Attitude::from_rotation(meant.rotation() * nalgebra::UnitQuaternion::from_scaled_axis(off));
            let at = Instant::from_start(Duration::from_millis(20) * k);
            jitter.hear(&measured, &meant, at);
            // The same again says nothing new.
            jitter.hear(&meant, &meant, at);
        }
        jitter.slot_over(2f64.to_radians()).map(f64::to_degrees)
    }

    #[test]
    fn val_the_jitter_is_measured_beside_a_lean_and_told_once_where_it_is_another() {
        for (std_deg, is_told) in [(0.5, true), (1.5, false), (2.0, false), (3.0, false), (4.0, true)] {
            let mut jitter = Jitter::default();
            assert_eq!(told(&mut jitter, std_deg, 100), None, "too short");
            let first = told(&mut jitter, std_deg, 400);
            assert_eq!(first.is_some(), is_told, "{std_deg}: {first:?}");
            assert!(first.is_none_or(|deg| (deg - std_deg).abs() < 0.02), "{std_deg}: {first:?}");
            assert_eq!(told(&mut jitter, std_deg, 400), None);
        }
    }

    #[test]
    fn spec_who_expects_none_is_told_of_none_that_a_good_vehicle_has() {
        let mut jitter = Jitter::default();
        told(&mut jitter, 0.2, 0);
        for k in 0..400 {
            let off = Attitude::from_euler(if k % 2 == 0 { 0.003 } else { -0.003 }, 0.0, 0.0);
            jitter.hear(&off, &Attitude::level(), Instant::from_start(Duration::from_millis(20) * k));
        }
        assert_eq!(jitter.slot_over(0.0), None);
    }
}
