//! The expected rate: scrambled Sobol samples of attitude noise and positions, the objective on them, and the evaluator of a plan.

pub mod antenna;
pub mod attitude;
pub mod beams;
pub mod errors;
pub mod exact;
mod full;
pub mod kernel;
mod lanes;
pub mod logarithm;
pub mod noise;
pub mod normal;
mod parts;
mod plain;
pub mod samples;
pub mod sobol;
mod trigonometry;

use super::draws::QUANTILE;
use super::error::PlanError;
use super::plan::VehiclePlan;
use super::problem::{Fading, Objective, Problem, Radio};
use super::setup::Setup;
use super::worst::{Look, worst_positions};
use crate::radio::link::{self, Transmitter};
use crate::role::{PerVehicle, Role};
use kernel::Raw;
use samples::{LANES, Samples, Sequence};

/// How a plan is scored.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EvaluateOptions {
    /// Number of samples over all scrambles, at least 128.
    pub samples: usize,
    /// Seed of the scrambles.
    pub seed: u64,
    /// Scrambled Sobol points, or plain Monte Carlo for comparison.
    pub sequence: Sequence,
}

impl Default for EvaluateOptions {
    fn default() -> Self {
        Self { samples: 65_536, seed: 0, sequence: Sequence::Sobol }
    }
}

/// What poses and powers are worth.
#[derive(Debug, Clone, PartialEq)]
pub struct Evaluation {
    /// `E[R]` with `[.]^+` inside, bit/s, over everything that is random in the problem.
    pub secrecy_rate_bps: f64,
    /// Standard error of `secrecy_rate_bps`, from independent scrambles; 0 without anything random.
    pub standard_error_bps: f64,
    /// The mission's objective, bit/s: `secrecy_rate_bps` itself, or over what stays wrong during a slot the rate with nothing
    /// wrong (nominal), the 5% quantile, or the worst case over the eavesdroppers' discs, in the mean over the rest (a local
    /// search: an upper estimate of it).
    pub objective_rate_bps: f64,
    /// E of the signed rate, [.]^+ dropped (paper 3b), bit/s.
    pub signed_rate_bps: f64,
    /// SINR of the user at the desired attitude and estimated position, linear: mean power over mean power where waves are
    /// scattered.
    pub user_sinr: f64,
    /// SINR of each eavesdropper at the same, linear.
    pub eavesdropper_sinr: Vec<f64>,
}

/// Independent scrambles from which the standard error is taken.
const SCRAMBLES: usize = 16;
/// Samples that share a draw of uncertain positions.
const PER_DRAW: usize = 2 * LANES;
/// Most draws of the positions for a quantile, and least samples of the attitudes for each.
const QUANTILE_DRAWS: usize = 2048;
const QUANTILE_SAMPLES: usize = 128;
/// Most draws where more than the eavesdroppers' positions stays wrong.
const SLOT_DRAWS: usize = 1024;
/// Most samples by which the worst positions are looked for.
const WORST_SAMPLES: usize = 1024;

/// Scores poses and powers under the problem's model (2.2b): the mean over samples of both attitudes' noise, of scattered
/// waves, and of what stays wrong during a slot.
///
/// The samples are split over sixteen independent scrambles, and the standard error is that of their means: an honest
/// figure for randomised quasi-Monte Carlo, whose error within a scramble is far below that of independent samples.
///
/// # Errors
/// [`PlanError`] for a problem without meaning, or poses and powers that are not finite.
pub fn evaluate(
    problem: &Problem,
    vehicles: &PerVehicle<VehiclePlan>,
    options: &EvaluateOptions,
) -> Result<Evaluation, PlanError> {
    let setup = Setup::new(problem)?;
    let raw = Setup::raw(vehicles);
    if let Some(value) = raw.iter().find(|v| !v.is_finite()) {
        return Err(PlanError::OutOfRange {
            what: "pose or power",
            value: *value,
            least: f64::MIN,
            most: f64::MAX,
        });
    }
    let mut evaluation = score(&setup, vehicles, options);
    if let Some(objective_bps) = objective_bps(&setup, vehicles, evaluation.secrecy_rate_bps, options) {
        evaluation.objective_rate_bps = objective_bps;
    }
    Ok(evaluation)
}

/// The mission's objective in bit/s where it is another one than the mean, which is `mean_bps`.
pub(super) fn objective_bps(
    setup: &Setup,
    vehicles: &PerVehicle<VehiclePlan>,
    mean_bps: f64,
    options: &EvaluateOptions,
) -> Option<f64> {
    if !setup.is_uncertain() {
        return None;
    }
    let raw = Setup::raw(vehicles);
    let to_bps = setup.problem.radio.bandwidth_hz / std::f64::consts::LN_2;
    match setup.problem.objective {
        Objective::Mean => None,
        Objective::Nominal => Some(to_bps * nominal(setup, &raw, options)),
        Objective::Quantile => Some(slots(setup, vehicles, mean_bps, options).quantile_bps()),
        Objective::WorstCase => Some(to_bps * worst_case(setup, &raw, options)),
    }
}

/// [`evaluate`] of a checked problem, `objective_rate_bps` being the mean.
pub(super) fn score(
    setup: &Setup,
    vehicles: &PerVehicle<VehiclePlan>,
    options: &EvaluateOptions,
) -> Evaluation {
    let problem = setup.problem;
    let raw = Setup::raw(vehicles);
    let (clipped, signed) = if setup.varies() || setup.is_uncertain() {
        let draws = if setup.is_uncertain() { per_scramble(options).div_ceil(PER_DRAW).max(2) } else { 1 };
        scrambles(setup, &raw, options, draws)
    } else {
        let f = exact::Exact::default().value(&setup.scene, setup.eavesdroppers(), &raw, f64::INFINITY, None);
        (vec![f.max(0.0)], vec![f])
    };
    let to_bps = problem.radio.bandwidth_hz / std::f64::consts::LN_2;
    let (rate, error) = mean_and_error(&clipped);
    let [i, j] = [Role::I, Role::J].map(|role| Transmitter {
        position_enu_m: vehicles[role].pose.position_enu_m,
        axis: vehicles[role].pose.antenna_axis(),
        tx_power_w: vehicles[role].tx_power_w,
        antenna: &problem.antennas[role],
    });
    let Radio { reference_gain, noise_power_w, .. } = problem.radio;
    let sinr = |node, rician| link::sinr(&i, &j, node, rician, reference_gain, noise_power_w);
    let Fading { user, eavesdropper } = problem.fading;
    Evaluation {
        secrecy_rate_bps: rate * to_bps,
        standard_error_bps: error * to_bps,
        objective_rate_bps: rate * to_bps,
        signed_rate_bps: mean_and_error(&signed).0 * to_bps,
        user_sinr: sinr(&problem.user_enu_m, user),
        eavesdropper_sinr: problem
            .eavesdroppers
            .iter()
            .map(|e| sinr(&e.position_enu_m, eavesdropper))
            .collect(),
    }
}

fn per_scramble(options: &EvaluateOptions) -> usize {
    options.samples.div_ceil(SCRAMBLES).max(LANES)
}

/// Means of max(f, 0) and of f by each scramble, nats per hertz.
fn scrambles(setup: &Setup, raw: &Raw, options: &EvaluateOptions, draws: usize) -> (Vec<f64>, Vec<f64>) {
    let mut workspace = kernel::Workspace::default();
    (0..SCRAMBLES as u64)
        .map(|scramble| {
            let seed = sobol::mix(options.seed, scramble);
            let samples = Samples::new(setup.problem, per_scramble(options), draws, seed, options.sequence);
            let (mut clipped, mut signed) = (0.0, 0.0);
            workspace.each(&setup.scene, &samples, raw, |_, f| {
                clipped += f.max(0.0);
                signed += f;
            });
            (clipped / samples.len() as f64, signed / samples.len() as f64)
        })
        .unzip()
}

/// The rates of slots, one for each draw of what stays wrong during a slot, each the mean over what does not; rising, bit/s.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct SlotRates(Vec<f64>);

impl SlotRates {
    /// The rate that 5% of the slots do not reach.
    pub fn quantile_bps(&self) -> f64 {
        // Between the two ranks whose middles enclose the quantile.
        let count = self.0.len();
        let rank = (QUANTILE * count as f64 - 0.5).max(0.0);
        let low = (rank.floor() as usize).min(count - 1);
        let high = (low + 1).min(count - 1);
        self.0[low] + (rank - rank.floor()) * (self.0[high] - self.0[low])
    }

    /// The share of slots whose rate is below `target_bps`.
    pub fn below(&self, target_bps: f64) -> f64 {
        self.0.partition_point(|rate| *rate < target_bps) as f64 / self.0.len() as f64
    }
}

/// The rates of slots. `mean_bps` is the mean rate, from more samples than a slot has here.
pub(super) fn slots(
    setup: &Setup,
    vehicles: &PerVehicle<VehiclePlan>,
    mean_bps: f64,
    options: &EvaluateOptions,
) -> SlotRates {
    if !setup.is_uncertain() {
        return SlotRates(vec![mean_bps]);
    }
    let problem = setup.problem;
    let alone = problem.has_ideal_link();
    let (share, most) = match (alone, setup.varies()) {
        (true, _) => (32, QUANTILE_DRAWS),
        (false, true) => (64, SLOT_DRAWS),
        // Each slot is a single sample then, and costs a block.
        (false, false) => (LANES, LANES * SLOT_DRAWS),
    };
    let draws = (options.samples / share).clamp(20, most);
    let all = Samples::draws_of(problem, draws, sobol::mix(options.seed, 2));
    let least = if alone { QUANTILE_SAMPLES } else { 1 };
    let samples = Samples::shared(problem, options.samples.div_ceil(draws).max(least), all, options.seed);
    let to_bps = problem.radio.bandwidth_hz / std::f64::consts::LN_2;
    let mut rates: Vec<f64> =
        clipped_by_draw(setup, &Setup::raw(vehicles), &samples).iter().map(|f| f * to_bps).collect();
    if !alone && setup.varies() {
        // All draws meet the same few samples of jitter and scattering, whose error is much the same in each: it is
        // taken off by the mean, which is known better.
        let offset = mean_bps - rates.iter().sum::<f64>() / draws as f64;
        rates.iter_mut().for_each(|rate| *rate = (*rate + offset).max(0.0));
    }
    rates.sort_by(f64::total_cmp);
    SlotRates(rates)
}

/// The mean over attitudes and scattered waves with nothing wrong, nats per hertz.
fn nominal(setup: &Setup, raw: &Raw, options: &EvaluateOptions) -> f64 {
    mean_and_error(&scrambles(setup, raw, options, 1).0).0
}

/// The mean over attitudes at the worst positions found, nats per hertz.
fn worst_case(setup: &Setup, raw: &Raw, options: &EvaluateOptions) -> f64 {
    let estimates: Vec<_> = setup.problem.eavesdroppers.iter().map(|e| e.position_enu_m).collect();
    let count = options.samples.clamp(LANES, WORST_SAMPLES);
    let samples = Samples::shared(setup.problem, count, vec![estimates], options.seed);
    let (worst, _) = worst_positions(setup, raw, &samples, &[], &Look::FINAL);
    let samples = Samples::shared(setup.problem, options.samples, vec![worst], options.seed);
    clipped_by_draw(setup, raw, &samples)[0]
}

fn clipped_by_draw(setup: &Setup, raw: &Raw, samples: &Samples) -> Vec<f64> {
    let mut rates = Vec::new();
    kernel::Workspace::default().means_of_draws(&setup.scene, samples, raw, true, &mut rates);
    rates
}

/// Mean of independent estimates and its standard error (0 of a single one).
fn mean_and_error(estimates: &[f64]) -> (f64, f64) {
    let n = estimates.len().max(1) as f64;
    let mean = estimates.iter().sum::<f64>() / n;
    if estimates.len() < 2 {
        return (mean, 0.0);
    }
    let square: f64 = estimates.iter().map(|e| (e - mean) * (e - mean)).sum();
    (mean, (square / (n * (n - 1.0))).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geo::Pose;
    use crate::planner::problem::Problem;
    use crate::planner::problem::Uncertainty;
    use nalgebra::Vector3;

    fn vehicles() -> PerVehicle<VehiclePlan> {
        let plan = |x, y, roll_rad, pitch_rad, tx_power_w| VehiclePlan {
            pose: Pose { position_enu_m: Vector3::new(x, y, 80.0), roll_rad, pitch_rad, yaw_rad: 0.0 },
            tx_power_w,
        };
        // Best known for scenario 0, N = 2, 2 deg.
        PerVehicle {
            i: plan(4.4390, 2.6647, 0.893_334, -0.209_762, 0.5),
            j: plan(88.3027, -238.1365, 1.100_552, 0.836_346, 0.005_690_5),
        }
    }

    fn scenario() -> Problem {
        Problem::paper(
            [[21.385_737_975, 103.841_847_006], [-29.058_202_678, -296.752_057_455]],
            0.5,
            2f64.to_radians(),
        )
    }

    fn options(samples: usize, seed: u64) -> EvaluateOptions {
        EvaluateOptions { samples, seed, sequence: Sequence::Sobol }
    }

    #[test]
    fn val_known_plan_has_its_known_rate() {
        let evaluation = evaluate(&scenario(), &vehicles(), &EvaluateOptions::default()).unwrap();
        assert!((evaluation.secrecy_rate_bps / 1e6 - 14.773_794).abs() < 5e-4, "{evaluation:?}");
        assert!(evaluation.standard_error_bps < 1e3);
        assert_eq!(evaluation.objective_rate_bps, evaluation.secrecy_rate_bps);
    }

    #[test]
    fn prop_standard_error_is_honest() {
        // Over 24 seeds the errors against a long run have the size that is claimed.
        let truth = evaluate(&scenario(), &vehicles(), &options(1 << 17, 1)).unwrap().secrecy_rate_bps;
        for sequence in [Sequence::Sobol, Sequence::MonteCarlo] {
            let squares: Vec<f64> = (0..24)
                .map(|seed| {
                    let options = EvaluateOptions { samples: 2048, seed: 100 + seed, sequence };
                    let e = evaluate(&scenario(), &vehicles(), &options).unwrap();
                    ((e.secrecy_rate_bps - truth) / e.standard_error_bps).powi(2)
                })
                .collect();
            let mean = squares.iter().sum::<f64>() / 24.0;
            // Student's t with 15 degrees has variance 1.15; four standard errors of a mean of 24 squares.
            assert!((0.3..2.6).contains(&mean), "{sequence:?}: {mean}");
        }
    }

    #[test]
    fn prop_sobol_needs_far_fewer_points_than_monte_carlo() {
        let error = |sequence| {
            evaluate(&scenario(), &vehicles(), &EvaluateOptions { samples: 16_384, seed: 5, sequence })
                .unwrap()
                .standard_error_bps
        };
        assert!(error(Sequence::Sobol) * 8.0 < error(Sequence::MonteCarlo));
    }

    #[test]
    fn regress_256_points_are_within_a_tenth_of_a_percent() {
        let truth = evaluate(&scenario(), &vehicles(), &options(1 << 17, 1)).unwrap().signed_rate_bps;
        let scene = kernel::Scene::of(&scenario());
        let squares = (0..32).map(|seed| {
            let samples = Samples::new(&scenario(), 256, 1, seed, Sequence::Sobol);
            let mean =
                kernel::Workspace::default().mean(&scene, &samples, &Setup::raw(&vehicles()), false, None);
            (mean / std::f64::consts::LN_2 * 1e6 / truth - 1.0).powi(2)
        });
        let rms = (squares.sum::<f64>() / 32.0).sqrt();
        assert!(rms < 1e-3, "{rms}");
    }

    #[test]
    fn spec_objectives_over_discs_are_in_order() {
        let mut problem = scenario();
        for e in &mut problem.eavesdroppers {
            e.uncertainty = Uncertainty::Disc { radius_m: 50.0 };
        }
        let value = |objective| {
            let problem = Problem { objective, ..problem.clone() };
            evaluate(&problem, &vehicles(), &options(1 << 15, 2)).unwrap()
        };
        let [mean, quantile, worst] =
            [Objective::Mean, Objective::Quantile, Objective::WorstCase].map(|o| value(o).objective_rate_bps);
        assert!(worst < quantile && quantile < mean, "{worst} {quantile} {mean}");
        let nominal = value(Objective::Nominal);
        assert!((nominal.objective_rate_bps / 1e6 - 14.7738).abs() < 2e-3);
        assert!((nominal.secrecy_rate_bps - mean).abs() < 1.0);
    }

    #[test]
    fn val_without_anything_random_the_rate_is_exact() {
        let mut problem = scenario();
        problem.jitter.std_rad = 0.0;
        let e = evaluate(&problem, &vehicles(), &EvaluateOptions::default()).unwrap();
        let strongest = e.eavesdropper_sinr.iter().copied().fold(0.0, f64::max);
        assert!((e.secrecy_rate_bps - 1e6 * ((1.0 + e.user_sinr) / (1.0 + strongest)).log2()).abs() < 1e-3);
        assert_eq!(e.standard_error_bps, 0.0);
    }
}
