//! What stays wrong during a slot: the 5% quantile and the worst case as objectives. (The mean is part of the expectation:
//! each sixteen samples of attitude noise have a draw of the eavesdroppers' positions of their own, or each sample has,
//! where more than these stays wrong.)
//!
//! *Quantile.* Let `F_d(x)` be the expected rate at draw d of what stays wrong, the same attitude noise for each draw. The
//! 5% quantile of the F_d is smoothed into their mean with a triangular weight over the lowest tenth of the ranks. Few draws
//! matter to it, and many are needed lest a dozen variables fit the few that do: of many draws those that are lowest at
//! the present x are searched over, and those that have become low join them, until the quantile over all gains no more.
//!
//! *Worst case.* `max_x min_e F(x, e)`, e within the discs (for a Gaussian: within the circle that holds 95%). A finite
//! set E of positions stands for the discs; in turn, x maximises the soft minimum of `F(x, e)` over E, and the worst e for
//! that x joins E, until it is no worse than E's own (cutting planes). The best x by its true worst case is kept.

use super::draws::Combination;
use super::expectation::kernel::Raw;
use super::expectation::samples::{Draw, Samples};
use super::expectation::sobol;
use super::model::{Local, Memory, Solver, Target};
use super::setup::Setup;
use super::solver::active_set;
use super::variables::Chart;
use super::worst::{SETTLED, worst_positions};

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

/// Maximises the quantile from a start; the value is the smoothed quantile over all draws.
pub fn maximise_quantile(
    setup: &Setup,
    chart: &Chart,
    start: Local,
    seed: u64,
    resolution: Resolution,
    memory: &mut Memory,
) -> Local {
    let (draws, count, rounds) = match resolution {
        Resolution::Coarse => (256, 32, 1),
        Resolution::Medium => (512, 32, 2),
        Resolution::Fine => (2048, 64, 4),
    };
    let all_draws = Samples::draws_of(setup.problem, draws, sobol::mix(seed, 2));
    let shared = |draws: Vec<Draw>| Samples::shared(setup.problem, count, draws, sobol::mix(seed, 1));
    let all = shared(all_draws.clone());
    let combination = Combination::Quantile { of: draws };
    let mut is_low = vec![false; draws];
    let mut best = Local { value: memory.quantile(setup, &all, &start.raw, &mut is_low), ..start };
    let mut at = best;
    for _ in 0..rounds {
        let low = all_draws.iter().zip(&is_low).filter(|(_, low)| **low).map(|(draw, _)| draw.clone());
        let samples = shared(low.collect());
        let target = Target::OverDraws { samples: &samples, combination };
        at = memory.maximise(setup, chart, target, &at.raw, &settings(60)).unwrap_or(at);
        let value = memory.quantile(setup, &all, &at.raw, &mut is_low);
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
    /// The smoothed quantile over all draws of `samples`; the lowest of them join `is_low`.
    fn quantile(&mut self, setup: &Setup, samples: &Samples, raw: &Raw, is_low: &mut [bool]) -> f64 {
        let combination = Combination::Quantile { of: is_low.len() };
        let value = self.value(setup, Target::OverDraws { samples, combination }, raw, &mut [0.0; 14]);
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
        Resolution::Coarse | Resolution::Medium => (64, 6),
        Resolution::Fine => (256, 10),
    };
    let estimates: Vec<_> = setup.problem.eavesdroppers.iter().map(|e| e.position_enu_m).collect();
    let mut known = vec![estimates];
    let mut samples = Samples::shared(setup.problem, count, known.clone(), sobol::mix(seed, 1));
    let (worst, value) = worst_positions(setup, &start.raw, &samples, &known);
    samples.push_draw(worst.clone());
    known.push(worst);
    let mut best = Local { value, ..start };
    let mut at = best;
    for _ in 0..rounds {
        for q in SHARPNESS {
            let target = Target::OverDraws { samples: &samples, combination: Combination::SoftMinimum(q) };
            at = memory.maximise(setup, chart, target, &at.raw, &settings(40)).unwrap_or(at);
        }
        let (worst, value) = worst_positions(setup, &at.raw, &samples, &known);
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
