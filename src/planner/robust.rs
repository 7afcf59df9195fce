//! What stays wrong during a slot: the 5% quantile and the worst case as objectives. (The mean is part of the expectation:
//! each sixteen samples of attitude noise have a draw of the eavesdroppers' positions of their own, or each sample has,
//! where more than these stays wrong.)
//!
//! *Quantile.* Let `F_d(x)` be the expected rate at draw d of what stays wrong, the same attitude noise for each draw. The
//! 5% quantile of the F_d is smoothed into their mean with a triangular weight about its rank, over the lowest tenth at first
//! and narrower at the end. Few draws matter to it, and many are needed lest a dozen variables fit the few that do: of many
//! draws those that are lowest at the present x are searched over, and those that have become low join them, until the
//! quantile over all gains no more. Where nothing changes within a slot a draw is one sample, so that there are as many more of
//! them.
//!
//! *Worst case.* `max_x min_e F(x, e)`, e within the discs (for a Gaussian: within the circle that holds 95%). A finite
//! set E of positions stands for the discs; in turn, x maximises the soft minimum of `F(x, e)` over E, and the worst e for
//! that x joins E, until it is no worse than E's own (cutting planes). The best x by its true worst case is kept.
//!
//! Coarsely F is the signed mean, which leads out of where no draw has any secrecy; finely it is what is asked for, with
//! `[.]^+` inside.
//!
//! *Where either starts.* The mean over positions says little about the worst of them: its optima are some starts, and a
//! second screening has others, at which every node is at several places of its disc at once ([`beset`]).

use nalgebra::Vector3;

use super::draws::{Combination, QUANTILE};
use super::expectation::kernel::Raw;
use super::expectation::samples::{Draw, LANES, Samples};
use super::expectation::sobol;
use super::model::{Local, Memory, Solver, Target};
use super::problem::{Eavesdropper, Objective, Problem, Uncertainty};
use super::setup::Setup;
use super::solver::active_set;
use super::variables::Chart;
use super::worst::{SETTLED, radius_m, worst_positions};

/// How finely an objective over draws is resolved.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Resolution {
    /// To sort out many candidates.
    Coarse,
    /// To compare few.
    Medium,
    /// For the plan.
    Fine,
}
/// Of so many draws one is among the lowest that a quantile is searched over: these hold its weights twice over.
const LOWEST_SHARE: usize = 5;
/// A gain of the quantile, in nats, that is worth another round.
const WORTH: f64 = 1e-4;
/// Sharpness of the soft minimum, per nat.
const SHARPNESS: [f64; 2] = [30.0, 1000.0];

/// Places of a disc at which a node counts at once: its centre and so many on a circle.
const AROUND: usize = 6;
/// The circle's radius: of the disc for a worst case; smaller for a quantile, since few draws have every node at its worst.
const RIM: f64 = 1.0;
const QUANTILE_RIM: f64 = 0.6;

/// `problem` with every uncertain node at several places of its disc at once, all of them known: what its worst case, or
/// its quantile, looks like to a search that knows neither. The strongest of many places at each instant is stronger than
/// the worst single one, so that its value is a lower bound, tight without jitter but for the places in between.
pub fn beset(problem: &Problem) -> Problem {
    let share = if problem.objective == Objective::WorstCase { RIM } else { QUANTILE_RIM };
    let mut eavesdroppers = Vec::with_capacity(problem.eavesdroppers.len() * (AROUND + 1));
    for node in &problem.eavesdroppers {
        let certain = Eavesdropper { uncertainty: Uncertainty::None, ..*node };
        eavesdroppers.push(certain);
        let radius = share * radius_m(node);
        if radius > 0.0 {
            eavesdroppers.extend((0..AROUND).map(|k| {
                let (sin, cos) = libm::sincos(std::f64::consts::TAU * k as f64 / AROUND as f64);
                let position_enu_m = node.position_enu_m + radius * Vector3::new(cos, sin, 0.0);
                Eavesdropper { position_enu_m, ..certain }
            }));
        }
    }
    Problem { eavesdroppers, objective: Objective::Nominal, ..problem.clone() }
}

/// Maximises the quantile from a start; the value is the smoothed quantile over all draws.
pub fn maximise_quantile(
    setup: &Setup,
    chart: &Chart,
    start: Local,
    seed: u64,
    resolution: Resolution,
    memory: &mut Memory,
) -> Local {
    let (draws, count, rounds, width) = match resolution {
        Resolution::Coarse => (256, 32, 1, QUANTILE),
        Resolution::Medium => (512, 32, 2, QUANTILE),
        Resolution::Fine => (2048, 64, 4, 0.4 * QUANTILE),
    };
    let draws = if setup.varies() { draws } else { draws * count / LANES };
    let clip = resolution == Resolution::Fine;
    let all_draws = Samples::draws_of(setup.problem, draws, sobol::mix(seed, 2));
    let shared = |draws: Vec<Draw>| Samples::shared(setup.problem, count, draws, sobol::mix(seed, 1));
    let all = shared(all_draws.clone());
    let combination = Combination::Quantile { of: draws, width };
    let mut is_low = vec![false; draws];
    let whole = Target::OverDraws { samples: &all, combination, clip };
    let mut best = Local { value: memory.quantile(setup, whole, &start.raw, &mut is_low), ..start };
    let mut at = best;
    for _ in 0..rounds {
        let low = all_draws.iter().zip(&is_low).filter(|(_, low)| **low).map(|(draw, _)| draw.clone());
        let samples = shared(low.collect());
        let target = Target::OverDraws { samples: &samples, combination, clip };
        at = memory.maximise(setup, chart, target, &at.raw, &settings(60)).unwrap_or(at);
        let value = memory.quantile(setup, whole, &at.raw, &mut is_low);
        let gain = value - best.value;
        if gain > 0.0 {
            best = Local { value, ..at };
        }
        if gain < WORTH && gain > -WORTH {
            break;
        }
    }
    best
}

impl Memory {
    /// The smoothed quantile over all draws of a target; the lowest of them join `is_low`.
    fn quantile(&mut self, setup: &Setup, all: Target, raw: &Raw, is_low: &mut [bool]) -> f64 {
        let value = self.value(setup, all, raw, &mut [0.0; 14]);
        self.draws
            .lowest_first()
            .iter()
            .take(is_low.len() / LOWEST_SHARE)
            .for_each(|draw| is_low[*draw] = true);
        value
    }
}

fn settings(iterations: usize) -> Solver {
    Solver::ActiveSet(active_set::Settings { iterations, tolerance: 1e-6, ..active_set::Settings::default() })
}

/// Maximises the worst case from a start; the value is the true worst case.
pub fn maximise_worst_case(
    setup: &Setup,
    chart: &Chart,
    start: Local,
    seed: u64,
    resolution: Resolution,
    memory: &mut Memory,
) -> Local {
    let (count, rounds) = match resolution {
        Resolution::Coarse => (64, 4),
        Resolution::Medium => (128, 8),
        Resolution::Fine => (512, 12),
    };
    let clip = resolution != Resolution::Coarse;
    let estimates: Vec<_> = setup.problem.eavesdroppers.iter().map(|e| e.position_enu_m).collect();
    let mut known = vec![estimates];
    let mut samples = Samples::shared(setup.problem, count, known.clone(), sobol::mix(seed, 1));
    let (worst, value) = worst_positions(setup, &start.raw, &samples, &known, clip);
    samples.push_draw(worst.clone());
    known.push(worst);
    let mut best = Local { value, ..start };
    let mut at = best;
    for _ in 0..rounds {
        for q in SHARPNESS {
            let combination = Combination::SoftMinimum(q);
            let target = Target::OverDraws { samples: &samples, combination, clip };
            at = memory.maximise(setup, chart, target, &at.raw, &settings(40)).unwrap_or(at);
        }
        let (worst, value) = worst_positions(setup, &at.raw, &samples, &known, clip);
        let promised = at.value;
        if value > best.value {
            best = Local { value, ..at };
        }
        if value >= promised - SETTLED {
            break;
        }
        samples.push_draw(worst.clone());
        known.push(worst);
    }
    best
}
