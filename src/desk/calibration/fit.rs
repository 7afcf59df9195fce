//! From a log to the antenna: null depth, mounting, heading, with what is known of each.

use serde::Serialize;

use super::curve::{self, PatternPoint};
use super::least_squares::{Minimum, Problem};
use super::log::Reading;
use super::model::{Parameters, Site, View};

/// A value and its standard error.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Estimate {
    /// The value.
    pub value: f64,
    /// Its standard error.
    pub standard_error: f64,
}

/// What a calibration flight says of a vehicle.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Calibration {
    /// Readings that it rests on.
    pub readings: usize,
    /// From the first to the last, seconds.
    pub duration_s: f64,
    /// How far the null is below the largest gain, dB; `null` where no floor is seen.
    pub null_depth_db: Option<Estimate>,
    /// The null is at least so deep, at two standard errors, dB.
    pub null_depth_at_least_db: f64,
    /// The antenna is turned by this against the body: a rotation vector about the body's x and y, degrees.
    pub mounting_deg: [Estimate; 2],
    /// The body is turned by this against what it believes, about the vertical, from east towards north, degrees.
    pub heading_deg: Estimate,
    /// The vehicle is displaced by this against where it believes to be, ENU, metres.
    pub position_enu_m: [Estimate; 3],
    /// What would be heard at one metre in the pattern's maximum, dBm.
    pub level_dbm: Estimate,
    /// Root mean square of what the readings are off, dB.
    pub residual_db: f64,
    /// The Rician factor that would scatter the main lobe's readings as they are scattered, the meter's own noise included:
    /// the site's is at least that, dB. `null` where there is too little of the main lobe.
    pub rician_k_at_least_db: Option<f64>,
    /// The pattern without supposing a dipole: mean gain at each angle, over the largest.
    pub pattern: Vec<PatternPoint>,
    /// The search ended where no step helps.
    pub converged: bool,
}

/// Why a log calibrates nothing.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FitError {
    /// Too few readings.
    #[error("{readings} readings in which something was heard; at least {least} are needed")]
    TooFew {
        /// How many there are.
        readings: usize,
        /// How many are needed.
        least: usize,
    },
    /// The antenna was not shown from enough angles.
    #[error(
        "the receiver was seen at {from_deg:.0} to {to_deg:.0} deg from the antenna's axis; both the null (within 15 deg of the axis) and the maximum (90 deg) must be shown"
    )]
    Angles {
        /// The least.
        from_deg: f64,
        /// The largest.
        to_deg: f64,
    },
    /// No minimum with finite numbers.
    #[error(
        "nothing fits these readings; is the receiver where it is said to be, and the attitude body (FLU) to ENU?"
    )]
    NoFit,
}

/// Fewer readings say nothing.
const FEWEST: usize = 200;
/// The log is cut into as many parts for the standard errors; of ten minutes each is as long as positions drift.
const BLOCKS: usize = 30;
/// What is known of each parameter without a flight: nothing of level and leak; a compass within 20 degrees or so, a
/// mount within ten, a position within a few metres. It keeps what a flight does not show from running away.
const DEVIATIONS: [f64; Parameters::COUNT] = [f64::INFINITY, f64::INFINITY, 20.0, 10.0, 10.0, 5.0, 5.0, 5.0];
/// The field along the axis that the search begins with: a floor of -20 dB.
const FIRST_LEAK: f64 = 0.1;
/// Nearer to its maximum than this gain a dipole is in its main lobe.
const MAIN_LOBE: f64 = 0.5;
/// Near enough to the axis to know the null.
const NULL_DEG: f64 = 15.0;

/// Finds what makes the readings what they are.
///
/// # Errors
/// A log that cannot say it.
pub fn fit(site: &Site, readings: &[Reading]) -> Result<Calibration, FitError> {
    if readings.len() < FEWEST {
        return Err(FitError::TooFew { readings: readings.len(), least: FEWEST });
    }
    let start = first_guess(site, readings)?;
    let problem = Problem {
        residual: |i: usize, p: &nalgebra::SVector<f64, { Parameters::COUNT }>| {
            let parameters = Parameters::from_array(p.data.0[0]);
            off_db(site, &parameters, &readings[i])
        },
        count: readings.len(),
        deviations: DEVIATIONS,
        blocks: BLOCKS,
    };
    let minimum = problem.minimise(start.to_array()).ok_or(FitError::NoFit)?;
    Ok(told(site, readings, &minimum))
}

/// Expected less received, dB.
fn off_db(site: &Site, parameters: &Parameters, reading: &Reading) -> f64 {
    site.expected_dbm(parameters, &site.view(parameters, reading)) - reading.received_dbm
}

/// A vehicle that is right in everything, at the level of its main lobe.
fn first_guess(site: &Site, readings: &[Reading]) -> Result<Parameters, FitError> {
    let mut guess = Parameters::from_array([0.0, FIRST_LEAK, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    let views: Vec<(View, &Reading)> = readings.iter().map(|r| (site.view(&guess, r), r)).collect();
    let degrees = views.iter().map(|(view, _)| view.angle.to_degrees());
    let from_deg = degrees.clone().fold(f64::INFINITY, f64::min);
    let to_deg = degrees.fold(0.0, f64::max);
    let main: Vec<f64> = views
        .iter()
        .filter(|(view, _)| view.sine_squared > MAIN_LOBE)
        .map(|(view, r)| r.received_dbm - site.expected_dbm(&guess, view))
        .collect();
    let null_seen = from_deg < NULL_DEG || to_deg > 180.0 - NULL_DEG;
    if !null_seen || main.len() < FEWEST / 10 {
        return Err(FitError::Angles { from_deg, to_deg });
    }
    guess.level_dbm = main.iter().sum::<f64>() / main.len() as f64;
    Ok(guess)
}

fn told(site: &Site, readings: &[Reading], minimum: &Minimum<{ Parameters::COUNT }>) -> Calibration {
    let parameters = Parameters::from_array(minimum.parameters.data.0[0]);
    let estimate = |k: usize| Estimate {
        value: minimum.parameters[k],
        standard_error: minimum.covariance[(k, k)].max(0.0).sqrt(),
    };
    let offs: Vec<f64> = readings.iter().map(|r| off_db(site, &parameters, r)).collect();
    let views: Vec<View> = readings.iter().map(|r| site.view(&parameters, r)).collect();
    let leak = estimate(1);
    let depth_db = |leak: f64| -20.0 * leak.log10();
    let (size, error) = (leak.value.abs(), leak.standard_error);
    Calibration {
        readings: readings.len(),
        duration_s: readings.last().map_or(0.0, |last| last.at_s) - readings.first().map_or(0.0, |r| r.at_s),
        null_depth_db: (size > 2.0 * error).then(|| Estimate {
            value: depth_db(size),
            standard_error: 20.0 / std::f64::consts::LN_10 * error / size,
        }),
        null_depth_at_least_db: depth_db(size + 2.0 * error),
        heading_deg: estimate(2),
        mounting_deg: [estimate(3), estimate(4)],
        position_enu_m: [estimate(5), estimate(6), estimate(7)],
        level_dbm: estimate(0),
        residual_db: (offs.iter().map(|off| off * off).sum::<f64>() / offs.len() as f64).sqrt(),
        rician_k_at_least_db: rician_k_db(&parameters, &views, &offs),
        pattern: curve::pattern(&parameters, &views, &offs, BLOCKS),
        converged: minimum.converged,
    }
}

/// The Rician factor that spreads the main lobe's readings as they are spread.
///
/// Of a power `|a + s z|^2`, x = s^2/a^2, the variance over the squared mean is 1 - 1/(1 + x)^2; x = m/(K G).
fn rician_k_db(parameters: &Parameters, views: &[View], offs: &[f64]) -> Option<f64> {
    let main: Vec<(f64, f64)> = views
        .iter()
        .zip(offs)
        .filter(|(view, _)| view.sine_squared > MAIN_LOBE)
        .map(|(view, off)| (parameters.gain(view.sine_squared), 10f64.powf(-off / 10.0)))
        .collect();
    let n = main.len() as f64;
    if main.len() < FEWEST / 10 {
        return None;
    }
    let mean = main.iter().map(|(_, ratio)| ratio).sum::<f64>() / n;
    let variance = main.iter().map(|(_, ratio)| (ratio / mean - 1.0).powi(2)).sum::<f64>() / n;
    let spread = (1.0 - variance).max(f64::MIN_POSITIVE).sqrt().recip() - 1.0;
    let scattered_over_gain = main.iter().map(|(gain, _)| parameters.mean_gain() / gain).sum::<f64>() / n;
    Some(10.0 * (scattered_over_gain / spread).log10())
}
