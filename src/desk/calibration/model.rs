//! What a receiver should hear of a dipole with a floor, on a vehicle whose instruments are off.

use crate::radio::exponential::ln_and_integral;
use nalgebra::{UnitQuaternion, Vector3};

use super::log::Reading;

/// What is known of the site.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Site {
    /// Where the receiver is, metres ENU.
    pub receiver_enu_m: Vector3<f64>,
    /// The Rician factor between vehicle and receiver, dB; `None`: nothing is scattered, or it is not known, and what is
    /// scattered counts as the antenna's.
    pub rician_k_db: Option<f64>,
    /// The receiver's noise, dBm, as far as it is in its readings.
    pub noise_dbm: Option<f64>,
}

/// What is looked for. The unit of each is chosen so that 1 is a fair step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Parameters {
    /// What would be heard at one metre in the pattern's maximum, dBm.
    pub level_dbm: f64,
    /// The field along the axis over the largest, of either sign: its square is the floor. Unlike the floor in decibels it
    /// has a value, and an uncertainty, where there is none.
    pub leak: f64,
    /// The truth is turned by this about the vertical, from east towards north, degrees.
    pub heading_deg: f64,
    /// The antenna is turned by this about body x and y, degrees.
    pub mounting_deg: [f64; 2],
    /// The truth is displaced by this, metres.
    pub position_enu_m: Vector3<f64>,
}

impl Parameters {
    /// How many numbers they are.
    pub const COUNT: usize = 8;

    pub fn to_array(self) -> [f64; Self::COUNT] {
        let [x, y] = self.mounting_deg;
        let p = self.position_enu_m;
        [self.level_dbm, self.leak, self.heading_deg, x, y, p.x, p.y, p.z]
    }

    pub fn from_array([level_dbm, leak, heading_deg, x, y, e, n, u]: [f64; Self::COUNT]) -> Self {
        Self { level_dbm, leak, heading_deg, mounting_deg: [x, y], position_enu_m: Vector3::new(e, n, u) }
    }

    /// The dipole's gain at an angle whose sine squared this is (MODEL: `1 - (1 - f) c^2`).
    pub fn gain(&self, sine_squared: f64) -> f64 {
        let floor = (self.leak * self.leak).min(1.0);
        (floor + (1.0 - floor) * sine_squared).max(LEAST_GAIN)
    }

    /// Its mean over the sphere.
    pub fn mean_gain(&self) -> f64 {
        1.0 - (1.0 - (self.leak * self.leak).min(1.0)) / 3.0
    }
}

/// Nothing is heard of less; it keeps the logarithm finite.
const LEAST_GAIN: f64 = 1e-12;

/// A vehicle's antenna as a receiver sees it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct View {
    pub distance_m: f64,
    /// Between the antenna's axis (body z) and the line to the receiver, radians.
    pub angle: f64,
    pub sine_squared: f64,
}

impl Site {
    /// How the receiver truly sees the antenna in a reading, if these parameters are right.
    pub(super) fn view(&self, parameters: &Parameters, reading: &Reading) -> View {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), parameters.heading_deg.to_radians());
        let [x, y] = parameters.mounting_deg.map(f64::to_radians);
        let antenna = UnitQuaternion::from_scaled_axis(Vector3::new(x, y, 0.0)) * Vector3::z();
        let axis = turn * (reading.attitude * antenna);
        let line = self.receiver_enu_m - reading.position_enu_m - parameters.position_enu_m;
        let (across, along) = (axis.cross(&line).norm(), axis.dot(&line));
        let distance_m = line.norm();
        View { distance_m, angle: across.atan2(along), sine_squared: (across / distance_m).powi(2) }
    }

    /// The mean of what a receiver shows in decibels of an antenna so seen.
    ///
    /// Of a power `|sqrt(k G) + sqrt((1 - k) m) z|^2` with z complex normal, the logarithm's mean is that of
    /// `(1 - k) m` and `ln x + E1(x)`, x = k G / ((1 - k) m).
    pub(super) fn expected_dbm(&self, parameters: &Parameters, view: &View) -> f64 {
        let gain = parameters.gain(view.sine_squared);
        let ln_gain = match self.rician_k_db {
            None => gain.ln(),
            Some(k_db) => {
                let scattered = parameters.mean_gain() / (1.0 + 10f64.powf(k_db / 10.0));
                let direct = gain / (1.0 + 10f64.powf(-k_db / 10.0));
                scattered.ln() + ln_and_integral(direct / scattered)
            }
        };
        let alone_dbm = parameters.level_dbm + decibels(ln_gain) - decibels(2.0 * view.distance_m.ln());
        match self.noise_dbm {
            None => alone_dbm,
            Some(noise_dbm) => 10.0 * (10f64.powf(alone_dbm / 10.0) + 10f64.powf(noise_dbm / 10.0)).log10(),
        }
    }
}

/// Decibels of a power whose natural logarithm this is.
fn decibels(ln: f64) -> f64 {
    10.0 * ln / std::f64::consts::LN_10
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parameters() -> Parameters {
        Parameters {
            level_dbm: -20.0,
            leak: 0.1,
            heading_deg: 0.0,
            mounting_deg: [0.0; 2],
            position_enu_m: Vector3::zeros(),
        }
    }

    fn site() -> Site {
        Site { receiver_enu_m: Vector3::new(0.0, 0.0, 2.0), rician_k_db: None, noise_dbm: None }
    }

    #[test]
    fn val_the_level_in_the_maximum_and_in_the_null_by_hand() {
        // 20 m beside a level vehicle: the maximum. 10 m below: the null, 20 dB down.
        let at = |position| {
            let reading = Reading {
                at_s: 0.0,
                position_enu_m: position,
                attitude: UnitQuaternion::identity(),
                received_dbm: 0.0,
            };
            let view = site().view(&parameters(), &reading);
            (view, site().expected_dbm(&parameters(), &view))
        };
        let (view, dbm) = at(Vector3::new(20.0, 0.0, 2.0));
        assert!((view.angle.to_degrees() - 90.0).abs() < 1e-9 && (dbm - (-20.0 - 26.020_6)).abs() < 1e-4);
        let (view, dbm) = at(Vector3::new(0.0, 0.0, 12.0));
        assert!((view.angle.to_degrees() - 180.0).abs() < 1e-9 && (dbm + 60.0).abs() < 1e-9);
        let noisy = Site { noise_dbm: Some(-60.0), ..site() };
        assert!((noisy.expected_dbm(&parameters(), &view) + 56.989_7).abs() < 1e-4);
    }

    #[test]
    fn val_scattering_raises_a_null_by_the_mean_logarithm() {
        let view = View { distance_m: 1.0, angle: 0.0, sine_squared: 0.0 };
        let at = |k_db| Site { rician_k_db: Some(k_db), ..site() }.expected_dbm(&parameters(), &view);
        // Against the sum over a fine grid of the field's Gaussian plane.
        for k_db in [3.0, 12.0, 18.0, 30.0] {
            let k = 10f64.powf(k_db / 10.0);
            let (direct, scattered) = (0.01 * k / (k + 1.0), 0.67 / (k + 1.0));
            let (mut sum, mut weight) = (0.0, 0.0);
            for a in 0..1000 {
                for b in 0..1000 {
                    let (x, y) = (f64::from(a) * 0.01 - 4.995, f64::from(b) * 0.01 - 4.995);
                    let w = (-(x * x + y * y)).exp();
                    let power = (direct.sqrt() + scattered.sqrt() * x).powi(2) + scattered * y * y;
                    sum += w * power.log10() * 10.0;
                    weight += w;
                }
            }
            let expected = -20.0 + sum / weight;
            assert!((at(k_db) - expected).abs() < 2e-3, "{k_db}: {} {expected}", at(k_db));
        }
        assert!((at(200.0) - site().expected_dbm(&parameters(), &view)).abs() < 1e-9);
    }
}
