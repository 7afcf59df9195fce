//! The paper's setup with random eavesdroppers, and statistics over scenarios.

use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::Failure;
use super::rates::JITTER_DEG;
use crate::config::{Mission, MissionDraft};
use crate::desk::quantile::Quantile;
use crate::planner::expectation::sobol::mix;
use crate::planner::problem::{Fading, Pattern, Pointing, Problem, Uncertainty};
use crate::planner::slots::Plan;
use crate::planning;
use crate::role::PerVehicle;

/// Half the side of the square of vehicles and eavesdroppers, about the user, in metres.
pub const REACH_M: f64 = 500.0;
/// The altitude band in metres.
pub const ALTITUDE_M: [f64; 2] = [80.0, 300.0];
/// Bandwidth; rates are divided by it.
const BANDWIDTH_HZ: f64 = 1e6;
/// Eavesdroppers of a scenario.
pub(super) const EAVESDROPPERS: usize = 2;

/// What a figure varies about the paper's setup.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Conditions {
    /// Power ceiling of both vehicles in W.
    pub max_power_w: f64,
    /// Standard deviation of roll and pitch of both vehicles, in radians.
    pub jitter_std_rad: f64,
    /// Eavesdroppers are uniform in discs of this radius about their estimates, in metres; 0: exactly known.
    pub uncertainty_m: f64,
}

/// Scenario `index` of a seed: eavesdroppers uniform in the square, on the ground. One random stream a scenario, so that
/// more scenarios leave the first ones as they are.
pub fn eavesdroppers(seed: u64, index: usize) -> Vec<Vector3<f64>> {
    let mut rng = ChaCha8Rng::seed_from_u64(mix(seed, index as u64));
    let mut coordinate = || rng.random_range(-REACH_M..=REACH_M);
    (0..EAVESDROPPERS).map(|_| Vector3::new(coordinate(), coordinate(), 0.0)).collect()
}

/// The mission of scenario `index` in the paper's arena, nobody in it yet.
pub(super) fn mission(seed: u64, index: usize, slot_s: f64) -> MissionDraft {
    // A file's numbers have a sign.
    let mut draft = MissionDraft { seed: mix(seed, index as u64) >> 1, ..MissionDraft::default() };
    draft.jitter.std_deg = JITTER_DEG;
    draft.tdma.slot_s = slot_s;
    draft
}

/// A mission, checked, and its plan.
///
/// # Errors
/// In words, where it is none, or has none.
pub(super) fn planned(draft: MissionDraft) -> Result<(Mission, Plan), String> {
    let mission = Mission::new(draft).map_err(|errors| errors.to_string())?;
    let plan = planning::plan(&mission).map_err(|error| error.to_string())?;
    Ok((mission, plan))
}

/// [`Problem::paper`] with these eavesdroppers, on the ground, under a figure's conditions.
pub fn problem(eavesdroppers: &[Vector3<f64>], conditions: &Conditions) -> Problem {
    let on_the_ground = eavesdroppers.iter().map(|p| [p.x, p.y]);
    let mut problem = Problem::paper(on_the_ground, conditions.max_power_w, conditions.jitter_std_rad);
    if conditions.uncertainty_m > 0.0 {
        for eavesdropper in &mut problem.eavesdroppers {
            eavesdropper.uncertainty = Uncertainty::Disc { radius_m: conditions.uncertainty_m };
        }
    }
    problem
}

/// The same problem for a planner that takes the estimated positions for true.
pub fn on_estimates(problem: &Problem) -> Problem {
    let mut believed = problem.clone();
    for eavesdropper in &mut believed.eavesdroppers {
        eavesdropper.uncertainty = Uncertainty::None;
    }
    believed
}

/// The same problem for a planner that knows of the jitter and takes all else for ideal.
pub fn on_ideal(problem: &Problem) -> Problem {
    let antennas = PerVehicle { i: Pattern::IDEAL, j: Pattern::IDEAL };
    let believed = on_estimates(problem);
    Problem { antennas, fading: Fading::default(), pointing: Pointing::default(), ..believed }
}

/// A rate in bit/s as spectral efficiency, bit/s/Hz.
pub fn per_hz(rate_bps: f64) -> f64 {
    rate_bps / BANDWIDTH_HZ
}

/// A sample over scenarios in short.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Summary {
    /// Mean.
    pub mean: f64,
    /// Standard error of the mean; 0 for a single value.
    pub standard_error: f64,
    /// Quartiles, interpolated between order statistics: lower, median, upper.
    pub quartiles: [f64; 3],
}

impl Summary {
    /// Of what cells have by the value of an abscissa with so many values, where they are all values of a scenario, then those of the
    /// next. A cell may have nothing.
    ///
    /// # Errors
    /// [`Failure::NoScenarios`] where none has.
    pub(super) fn by_value<T>(
        cells: &[T],
        values: usize,
        of: impl Fn(&T) -> Option<f64>,
    ) -> Result<Vec<Self>, Failure> {
        let at = |value: usize| {
            let all: Vec<f64> = cells.iter().skip(value).step_by(values).filter_map(&of).collect();
            Self::new(&all).ok_or(Failure::NoScenarios)
        };
        (0..values).map(at).collect()
    }

    /// `None` for no values.
    pub fn new(values: &[f64]) -> Option<Self> {
        let n = values.len() as f64;
        let [lower, median, upper] = [0.25, 0.5, 0.75].map(|share| Quantile::of(values, share));
        let quartiles = [lower?.value, median?.value, upper?.value];
        let mean = values.iter().sum::<f64>() / n;
        let square: f64 = values.iter().map(|v| (v - mean) * (v - mean)).sum();
        let standard_error = if values.len() == 1 { 0.0 } else { (square / (n * (n - 1.0))).sqrt() };
        Some(Self { mean, standard_error, quartiles })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_summary_of_one_to_five() {
        let summary = Summary::new(&[3.0, 1.0, 5.0, 2.0, 4.0]).unwrap();
        assert_eq!(summary.mean, 3.0);
        assert_eq!(summary.quartiles, [2.0, 3.0, 4.0]);
        assert!((summary.standard_error - 0.5f64.sqrt()).abs() < 1e-15);
        assert_eq!(Summary::new(&[7.0]).unwrap().standard_error, 0.0);
        assert_eq!(Summary::new(&[]), None);
    }

    #[test]
    fn prop_scenarios_fill_the_square() {
        let all: Vec<_> = (0..2000).flat_map(|k| eavesdroppers(5, k)).collect();
        assert!(all.iter().all(|p| p.x.abs() <= REACH_M && p.y.abs() <= REACH_M && p.z == 0.0));
        // The mean of n uniform values has standard deviation REACH_M / sqrt(3 n).
        let error = REACH_M / (3.0 * all.len() as f64).sqrt();
        let mean = all.iter().sum::<Vector3<f64>>() / all.len() as f64;
        assert!(mean.x.abs() < 4.0 * error && mean.y.abs() < 4.0 * error, "{mean}");
        assert_ne!(eavesdroppers(5, 0), eavesdroppers(6, 0));
    }
}
