//! Sums over radio samples, slot by slot.

use std::time::Duration;

use super::config::PlannedSlot;
use super::report::SlotReport;
use crate::vehicle::SAMPLE;

/// Samples in a batch (half a second at 200 Hz): longer than the correlation of gusts and control errors.
const BATCH: u32 = 100;
/// Fewer batches say nothing about their spread.
const FEWEST_BATCHES: f64 = 8.0;

/// The time that a number of radio samples stands for.
pub(crate) fn seconds(samples: u32) -> f64 {
    (SAMPLE * samples).as_secs_f64()
}

/// Mean and standard error of a correlated sequence.
#[derive(Debug, Clone, Default)]
pub(crate) struct Mean {
    n: f64,
    sum: f64,
    squares: f64,
    batch_sum: f64,
    batch_n: u32,
    batches: f64,
    batch_means: f64,
    batch_squares: f64,
}

impl Mean {
    pub fn add(&mut self, value: f64) {
        self.n += 1.0;
        self.sum += value;
        self.squares += value * value;
        self.batch_sum += value;
        self.batch_n += 1;
        if self.batch_n == BATCH {
            let mean = self.batch_sum / f64::from(BATCH);
            self.batches += 1.0;
            self.batch_means += mean;
            self.batch_squares += mean * mean;
            self.batch_sum = 0.0;
            self.batch_n = 0;
        }
    }

    pub fn mean(&self) -> f64 {
        if self.n > 0.0 { self.sum / self.n } else { 0.0 }
    }

    /// From the batches if there are enough of them, else as if all values were independent.
    pub fn standard_error(&self) -> f64 {
        let of = |n: f64, sum: f64, squares: f64| {
            if n < 2.0 { 0.0 } else { ((squares - sum * sum / n).max(0.0) / (n - 1.0) / n).sqrt() }
        };
        if self.batches >= FEWEST_BATCHES {
            of(self.batches, self.batch_means, self.batch_squares)
        } else {
            of(self.n, self.sum, self.squares)
        }
    }
}

/// Mean square of an error.
#[derive(Debug, Clone, Copy, Default)]
struct Rms {
    n: f64,
    squares: f64,
}

impl Rms {
    fn add(&mut self, value: f64) {
        self.n += 1.0;
        self.squares += value * value;
    }

    fn get(&self) -> Option<f64> {
        (self.n > 0.0).then(|| (self.squares / self.n).sqrt())
    }
}

/// One vehicle in one sample.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PoseError {
    pub position_m: f64,
    pub attitude_deg: f64,
    pub control_deg: f64,
}

/// The sums of one slot.
#[derive(Debug, Clone, Default)]
pub(crate) struct SlotScore {
    pub rate: Mean,
    /// Counts of samples: whole numbers do not drift.
    pub jam_out_of_tolerance: u32,
    radiated: [u32; 2],
    errors: [[Rms; 3]; 2],
}

impl SlotScore {
    /// A sample in which a vehicle radiated.
    pub fn radiated(&mut self, vehicle: usize, error: PoseError) {
        self.radiated[vehicle] += 1;
        let [position, attitude, control] = &mut self.errors[vehicle];
        position.add(error.position_m);
        attitude.add(error.attitude_deg);
        control.add(error.control_deg);
    }

    pub fn report(&self, planned: &PlannedSlot, unprotected: Duration) -> SlotReport {
        let rms = |k: usize| [self.errors[0][k].get(), self.errors[1][k].get()].into();
        SlotReport {
            user: planned.user.clone(),
            planned_secrecy_rate_bps: planned.secrecy_rate_bps,
            achieved_secrecy_rate_bps: self.rate.mean(),
            standard_error_bps: self.rate.standard_error(),
            radiated_s: self.radiated.map(seconds).into(),
            unprotected_s: unprotected.as_secs_f64(),
            jam_out_of_tolerance_s: seconds(self.jam_out_of_tolerance),
            position_rms_m: rms(0),
            attitude_rms_deg: rms(1),
            attitude_control_rms_deg: rms(2),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{Noise, Purpose};

    #[test]
    fn val_standard_error_of_independent_and_of_correlated_values() {
        let mut noise = Noise::new(2, Purpose::Wind, 0);
        let (mut white, mut slow) = (Mean::default(), Mean::default());
        let (a, mut x) = (0.9f64, 0.0);
        for _ in 0..100_000 {
            white.add(5.0 + noise.normal());
            x = a * x + (1.0 - a * a).sqrt() * noise.normal();
            slow.add(x);
        }
        // A thousand batches know a standard error to 2.2%. An AR(1) with factor a multiplies the variance of the
        // mean by (1 + a)/(1 - a).
        let plain = 1e5f64.sqrt().recip();
        assert!((white.mean() - 5.0).abs() < 4.0 * plain);
        assert!((white.standard_error() / plain - 1.0).abs() < 0.1);
        assert!((slow.standard_error() / (plain * 19f64.sqrt()) - 1.0).abs() < 0.2);
    }
}
