//! A calibration flight: one vehicle circles a receiver whose place is known and turns its antenna through all angles,
//! while the receiver notes what it hears. What the log says of the vehicle is the vehicle's own belief; the truth is in
//! columns of its own.
//!
//! The same body, rotors, loops, wind and estimator as in a mission, flown by a script instead of a companion.

mod pilot;

use std::fmt::{self, Write as _};
use std::time::Duration;

use nalgebra::Vector3;

use crate::random::{Noise, Purpose};
use crate::vehicle::antenna::{Antenna, Pattern, linear};
use crate::vehicle::bias::{Bias, OwnFrame};
use crate::vehicle::config::{SensorConfig, WindConfig};
use crate::vehicle::jitter::JitterConfig;
use crate::world::scattering::{Fading, Path, Rician};
use pilot::Pilot;

/// What is flown, and what is true.
#[derive(Debug, Clone, PartialEq)]
pub struct CalibrationConfig {
    /// The same seed gives the same log, bit for bit.
    pub seed: u64,
    /// The antenna.
    pub antenna: Antenna,
    /// By how much the truth is off what the vehicle believes.
    pub bias: Bias,
    /// What the site scatters.
    pub fading: Option<Rician>,
    /// Where the receiver is, ENU, metres; the ground is at 0.
    pub receiver_enu_m: [f64; 3],
    /// Of the circle, metres.
    pub radius_m: f64,
    /// Time on the circle, seconds.
    pub duration_s: f64,
    /// Radiated power over the path's loss at one metre, dBm: what a receiver would hear there in the pattern's maximum.
    pub level_dbm: f64,
    /// Of the receiver, dBm.
    pub noise_dbm: f64,
    /// Standard deviation of a reading of the received power, dB.
    pub meter_std_db: f64,
    /// Mean wind and turbulence.
    pub wind: WindConfig,
    /// What the estimator gets wrong, beside the bias.
    pub sensors: SensorConfig,
    /// The vehicle's jitter.
    pub jitter: JitterConfig,
}

impl Default for CalibrationConfig {
    fn default() -> Self {
        Self {
            seed: 1,
            antenna: Antenna::NullDepth { depth_db: 25.0 },
            bias: Bias::default(),
            fading: None,
            receiver_enu_m: [0.0, 0.0, 1.5],
            radius_m: 30.0,
            duration_s: 600.0,
            level_dbm: -20.0,
            noise_dbm: -110.0,
            meter_std_db: 0.5,
            wind: WindConfig { mean_enu_m_s: [2.0, -1.0, 0.0], turbulence_m_s: 2.2 },
            sensors: SensorConfig::typical(),
            jitter: JitterConfig { std_deg: 1.0, correlation_s: 0.1, ..JitterConfig::default() },
        }
    }
}

/// Radio samples from one line of the log to the next: 20 Hz.
const SAMPLES_PER_LINE: u32 = 10;

impl CalibrationConfig {
    /// The first value that cannot be flown.
    fn fault(&self) -> Option<(&'static str, f64)> {
        let positive =
            [("radius_m", self.radius_m), ("duration_s", self.duration_s)].into_iter().find(|(_, v)| {
                // Nearer than this the circle leads through the receiver's mast; longer than a day it is none.
                !(3.0..=86_400.0).contains(v)
            });
        let [x, y, z] = self.receiver_enu_m;
        let finite = [
            ("receiver", x),
            ("receiver", y),
            ("receiver", z),
            ("level_dbm", self.level_dbm),
            ("noise_dbm", self.noise_dbm),
            ("meter_std_db", self.meter_std_db),
            ("bias.heading_deg", self.bias.heading_deg),
        ];
        let biases = self.bias.mounting_deg.map(|v| ("bias.mounting_deg", v)).into_iter();
        let biases = biases.chain(self.bias.position_enu_m.map(|v| ("bias.position_enu_m", v)));
        let infinite = finite.into_iter().chain(biases).find(|(_, v)| !v.is_finite());
        let fading = Fading { user: self.fading, eavesdropper: None }.fault();
        positive.or(infinite).or_else(|| self.antenna.fault()).or(fading)
    }
}

/// A value with which no calibration can be flown.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{what} is {value}: it must be finite, and a length or time from 3 on")]
pub struct CalibrationError {
    /// Which one.
    pub what: &'static str,
    /// Its value.
    pub value: f64,
}

/// One line of the log.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading {
    /// Time on the circle, seconds.
    pub time_s: f64,
    /// Where the vehicle believes to be, ENU, metres.
    pub position_enu_m: [f64; 3],
    /// Its attitude as it believes: w, x, y, z of body FLU to ENU.
    pub attitude_wxyz: [f64; 4],
    /// Received power, noise included, dBm.
    pub received_dbm: f64,
    /// Where it truly is.
    pub true_position_enu_m: [f64; 3],
    /// The body's true attitude.
    pub true_attitude_wxyz: [f64; 4],
}

/// The log's columns.
pub const COLUMNS: [&str; 16] = [
    "time_s",
    "east_m",
    "north_m",
    "up_m",
    "qw",
    "qx",
    "qy",
    "qz",
    "received_dbm",
    "true_east_m",
    "true_north_m",
    "true_up_m",
    "true_qw",
    "true_qx",
    "true_qy",
    "true_qz",
];

/// Readings as CSV.
#[derive(Debug, Clone, Copy)]
pub struct Csv<'a>(pub &'a [Reading]);

impl fmt::Display for Csv<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}", COLUMNS.join(","))?;
        for reading in self.0 {
            write!(f, "{:.3}", reading.time_s)?;
            let numbers = |f: &mut fmt::Formatter<'_>, values: &[f64], places: usize| {
                values.iter().try_for_each(|v| write!(f, ",{v:.places$}"))
            };
            numbers(f, &reading.position_enu_m, 4)?;
            numbers(f, &reading.attitude_wxyz, 7)?;
            write!(f, ",{:.3}", reading.received_dbm)?;
            numbers(f, &reading.true_position_enu_m, 4)?;
            numbers(f, &reading.true_attitude_wxyz, 7)?;
            f.write_char('\n')?;
        }
        Ok(())
    }
}

/// Flies a calibration.
///
/// # Errors
/// The first value that cannot be flown.
pub fn fly(config: &CalibrationConfig) -> Result<Vec<Reading>, CalibrationError> {
    if let Some((what, value)) = config.fault() {
        return Err(CalibrationError { what, value });
    }
    let frame = OwnFrame::from(config.bias);
    let mut pilot = Pilot::new(config, frame);
    let mut receiver = Receiver::new(config);
    let mut readings = Vec::new();
    let lines = (config.duration_s / (crate::vehicle::SAMPLE * SAMPLES_PER_LINE).as_secs_f64()) as usize;
    let begins = pilot.fly_to_the_circle();
    let mut samples = 0u32;
    while readings.len() < lines {
        pilot.sample();
        receiver.sample();
        if samples.is_multiple_of(SAMPLES_PER_LINE) {
            let received_dbm = receiver.reads(&pilot.position_enu_m(), &frame.antenna_axis(pilot.attitude()));
            readings.push(pilot.reading(begins, received_dbm));
        }
        samples += 1;
        pilot.fly_a_sample();
    }
    Ok(readings)
}

/// Who notes what is heard.
struct Receiver {
    position_enu_m: Vector3<f64>,
    pattern: Pattern,
    path: Option<Path>,
    level: f64,
    noise: f64,
    meter_std_db: f64,
    meter: Noise,
}

impl Receiver {
    fn new(config: &CalibrationConfig) -> Self {
        let path = |law| Path::new(law, Noise::new(config.seed, Purpose::PathsToUsers, 0));
        Self {
            position_enu_m: Vector3::from(config.receiver_enu_m),
            pattern: Pattern::new(&config.antenna),
            path: config.fading.map(path),
            level: linear(config.level_dbm),
            noise: linear(config.noise_dbm),
            meter_std_db: config.meter_std_db,
            meter: Noise::new(config.seed, Purpose::Meter, 0),
        }
    }

    fn sample(&mut self) {
        self.path.iter_mut().for_each(Path::advance);
    }

    /// What the meter shows of an antenna here with this axis, dBm.
    fn reads(&mut self, from_enu_m: &Vector3<f64>, axis: &Vector3<f64>) -> f64 {
        let line = self.position_enu_m - from_enu_m;
        let direct = self.pattern.gain(axis, &line);
        let gain = self.path.as_ref().map_or(direct, |path| path.gain(direct, self.pattern.mean()));
        let power = self.level * gain / line.norm_squared() + self.noise;
        10.0 * power.log10() + self.meter_std_db * self.meter.normal()
    }
}

/// Simulation time of a duration since the circle began.
fn since(begins: Duration, now: Duration) -> f64 {
    now.saturating_sub(begins).as_secs_f64()
}

#[cfg(test)]
mod tests;
