//! What a plan's rate leaves out: the rate that nineteen slots in twenty exceed, how likely one misses a target, and what
//! each imperfection of the mission costs.

use super::error::PlanError;
use super::expectation::{self, EvaluateOptions};
use super::plan::VehiclePlan;
use super::problem::{Fading, Pattern, Pointing, Problem, Uncertainty};
use super::setup::Setup;
use crate::role::PerVehicle;

/// An imperfection that a mission may state.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Cause {
    /// The antennas' floors or measured patterns, against ideal dipoles.
    Antenna,
    /// Scattering about the nodes.
    Fading,
    /// Attitude jitter.
    Jitter,
    /// Errors of the headings.
    Heading,
    /// Errors of the antennas' mountings.
    Mounting,
    /// Errors of the vehicles' positions.
    Position,
    /// How well the user's position is known.
    User,
    /// How well the eavesdroppers' positions are known.
    Eavesdroppers,
}

impl Cause {
    /// All causes.
    pub const ALL: [Self; 8] = [
        Self::Antenna,
        Self::Fading,
        Self::Jitter,
        Self::Heading,
        Self::Mounting,
        Self::Position,
        Self::User,
        Self::Eavesdroppers,
    ];

    /// Its name in documents.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Antenna => "antenna",
            Self::Fading => "fading",
            Self::Jitter => "jitter",
            Self::Heading => "heading",
            Self::Mounting => "mounting",
            Self::Position => "position",
            Self::User => "user",
            Self::Eavesdroppers => "eavesdroppers",
        }
    }

    /// The problem without this imperfection.
    #[must_use]
    pub fn removed_from(self, problem: &Problem) -> Problem {
        let mut without = problem.clone();
        match self {
            Self::Antenna => without.antennas = PerVehicle { i: Pattern::IDEAL, j: Pattern::IDEAL },
            Self::Fading => without.fading = Fading::default(),
            Self::Jitter => without.jitter.std_rad = 0.0,
            Self::Heading => without.pointing.heading_std_rad = 0.0,
            Self::Mounting => without.pointing.mounting_std_rad = 0.0,
            Self::Position => {
                without.pointing = Pointing { position_std_m: [0.0; 2], ..without.pointing };
            }
            Self::User => without.user_uncertainty = Uncertainty::None,
            Self::Eavesdroppers => {
                for eavesdropper in &mut without.eavesdroppers {
                    eavesdropper.uncertainty = Uncertainty::None;
                }
            }
        }
        without
    }
}

/// What a plan's rate leaves out.
#[derive(Debug, Clone, PartialEq)]
pub struct Assessment {
    /// The rate in bit/s that a slot exceeds with a probability of 95%, over what stays wrong during it; the mean where
    /// nothing does.
    pub quantile_5pct_bps: f64,
    /// The probability that a slot's rate is below the target; `None` without a target.
    pub miss_probability: Option<f64>,
    /// By how much the mean rate of the same poses and powers would be higher without each imperfection of the problem
    /// alone, bit/s. Negative where one helps.
    pub losses_bps: Vec<(Cause, f64)>,
    /// The same without all of them.
    pub loss_to_ideal_bps: f64,
}

/// Assesses poses and powers. `target_bps`: a rate that is counted on.
///
/// # Errors
/// [`PlanError`] for a problem without meaning.
pub fn assess(
    problem: &Problem,
    vehicles: &PerVehicle<VehiclePlan>,
    target_bps: Option<f64>,
    options: &EvaluateOptions,
) -> Result<Assessment, PlanError> {
    let setup = Setup::new(problem)?;
    let mean_bps = expectation::score(&setup, vehicles, options).secrecy_rate_bps;
    let rates = expectation::slots(&setup, vehicles, mean_bps, options);
    let mut ideal = problem.clone();
    let mut losses_bps = Vec::new();
    for cause in Cause::ALL {
        let without = cause.removed_from(problem);
        if without == *problem {
            continue;
        }
        losses_bps.push((cause, rate_bps(&without, vehicles, options)? - mean_bps));
        ideal = cause.removed_from(&ideal);
    }
    let loss_to_ideal_bps = match losses_bps[..] {
        [] => 0.0,
        [(_, alone)] => alone,
        _ => rate_bps(&ideal, vehicles, options)? - mean_bps,
    };
    Ok(Assessment {
        quantile_5pct_bps: rates.quantile_bps(),
        miss_probability: target_bps.map(|target_bps| rates.below(target_bps)),
        losses_bps,
        loss_to_ideal_bps,
    })
}

fn rate_bps(
    problem: &Problem,
    vehicles: &PerVehicle<VehiclePlan>,
    options: &EvaluateOptions,
) -> Result<f64, PlanError> {
    Ok(expectation::score(&Setup::new(problem)?, vehicles, options).secrecy_rate_bps)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geo::Pose;
    use nalgebra::Vector3;

    /// Level vehicles, J right above the user: its null's floor is all that the user hears of it.
    fn level() -> PerVehicle<VehiclePlan> {
        let plan = |x, tx_power_w| VehiclePlan {
            pose: Pose {
                position_enu_m: Vector3::new(x, 0.0, 100.0),
                roll_rad: 0.0,
                pitch_rad: 0.0,
                yaw_rad: 0.0,
            },
            tx_power_w,
        };
        PerVehicle { i: plan(100.0, 0.5), j: plan(0.0, 0.1) }
    }

    #[test]
    fn val_the_loss_to_a_floor_is_its_closed_form() {
        let mut problem = Problem::paper([[1e5, 0.0]], 0.5, 0.0);
        problem.antennas.j = Pattern::with_null_depth(30.0);
        let options = EvaluateOptions::default();
        let found = assess(&problem, &level(), Some(1e6), &options).unwrap();
        // a = 0.5e12 / 2e4 / 2 at the user; J's null leaves 0.1e12 / 1e4 * 1e-3 there.
        let (a, b): (f64, f64) = (1.25e7, 1e4);
        let lost = 1e6 * ((1.0 + a).log2() - (1.0 + a / (1.0 + b)).log2());
        let [(cause, loss_bps)] = found.losses_bps[..] else { panic!("{found:?}") };
        assert_eq!((cause, loss_bps), (Cause::Antenna, found.loss_to_ideal_bps));
        // The eavesdropper is a hundred kilometres away: what it hears is all but the same.
        assert!((loss_bps / lost - 1.0).abs() < 1e-2, "{loss_bps} {lost}");
        assert_eq!(found.miss_probability, Some(0.0));
        assert_eq!(assess(&problem, &level(), Some(1e9), &options).unwrap().miss_probability, Some(1.0));
    }

    /// A target at the 5% quantile is missed by one slot in twenty.
    #[test]
    fn val_the_quantile_is_missed_by_one_in_twenty() {
        let mut problem = Problem::paper([[300.0, 100.0]], 0.5, 0.0);
        problem.pointing.heading_std_rad = 0.05;
        problem.user_uncertainty = Uncertainty::Gaussian { std_m: 2.0 };
        let options = EvaluateOptions::default();
        let first = assess(&problem, &level(), None, &options).unwrap();
        let again = assess(&problem, &level(), Some(first.quantile_5pct_bps), &options).unwrap();
        assert!((again.miss_probability.unwrap() - 0.05).abs() < 1e-3, "{again:?}");
        // An independent draw of the same: J's level null, at 100 m, is off by the user's error alone.
        let heard = (0.5e12 * (5.0 / 6.0) / 6e4) / (1.0 + 0.1e12 * (10.0 / 11.0) / 1.1e5);
        let rate = |r2: f64| {
            let b = 0.1e12 * r2 / (1e4 + r2).powi(2);
            ((1.0 + 1.25e7 / (1.0 + b)) / (1.0 + heard)).log2()
        };
        // r^2 of the worst twentieth, by Rayleigh's law; I's own gain changes with the user's place too, by little.
        let expected = 1e6 * rate(-2.0 * 4.0 * 0.05f64.ln());
        assert!((first.quantile_5pct_bps / expected - 1.0).abs() < 0.03, "{first:?} {expected}");
    }

    #[test]
    fn spec_without_anything_wrong_nothing_is_lost() {
        let problem = Problem::paper([[300.0, 100.0]], 0.5, 0.0);
        let found = assess(&problem, &level(), None, &EvaluateOptions::default()).unwrap();
        assert_eq!((found.losses_bps.len(), found.loss_to_ideal_bps), (0, 0.0));
        assert_eq!(found.miss_probability, None);
        assert!(found.quantile_5pct_bps > 0.0);
    }
}
