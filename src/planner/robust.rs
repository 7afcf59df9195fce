//! What stays wrong during a slot: the 5% quantile and the worst case as objectives. (The mean is part of the expectation:
//! each sixteen samples of attitude noise have a draw of the eavesdroppers' positions of their own, or each sample has,
//! where more than these stays wrong.)
//!
//! *Quantile.* Let `F_d(x)` be the expected rate at draw d of what stays wrong, the same attitude noise for each draw. The
//! 5% quantile of the F_d is smoothed into their mean with a triangular weight about its rank, over the lowest tenth at first
//! and narrower at the end. Few draws matter to it, and many are needed lest a dozen variables fit the few that do: of many
//! draws those that are lowest at the present x are searched over, and those that have become low join them, until the
//! quantile over them gains no more. Which are low a few attitudes tell; how low they are is averaged over more of them, the
//! finer the more. Where nothing changes within a slot a draw is one sample, so that there are as many more of them.
//!
//! *Worst case.* `max_x min_e F(x, e)`, e within the discs (for a Gaussian: within the circle that holds 95%). A finite
//! set E of positions stands for the discs; in turn, x maximises the soft minimum of `F(x, e)` over E, and the worst e for
//! that x joins E, until it is no worse than E's own (cutting planes). The best x by its true worst case is kept.
//!
//! Coarsely F is the signed mean at first, which leads out of where no draw has any secrecy; finely it is what is asked for,
//! with `[.]^+` inside.
//!
//! *Where either starts.* The mean over positions says little about the worst of them: its optima are some starts, and a
//! second screening has others, at which every node is at several places of its disc at once ([`beset`]).

use nalgebra::Vector3;

use super::draws::{Combination, QUANTILE};
use super::expectation::kernel::Raw;
use super::expectation::samples::{Draw, Samples};
use super::expectation::sobol;
use super::model::{Local, Memory, Solver, Target};
use super::problem::{Eavesdropper, Objective, Problem, Uncertainty};
use super::setup::Setup;
use super::solver::active_set;
use super::solver::dense::Matrix;
use super::variables::Chart;
use super::worst::{Look, SETTLED, radius_m, worst_positions};

/// How finely an objective over draws is resolved.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Resolution {
    /// To sort out many candidates by their first steps.
    First,
    /// To sort out several.
    Coarse,
    /// To compare few.
    Medium,
    /// To choose.
    Fine,
    /// For the plan.
    Finest,
}
/// Of a local search, nats.
const TOLERANCE: f64 = 1e-6;
/// Iterations of a local search, and of a candidate's first steps.
const ITERATIONS: usize = 60;
const FIRST_ITERATIONS: usize = 12;
/// Attitudes for sorting out, and for which draws are the lowest.
const FEW: usize = 32;
/// Of the ranks that a quantile weighs, so many times as many draws are the lowest that it is searched over.
const LOWEST_TIMES: f64 = 1.5;
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
            // One of them as near to the user as may be: often the worst place of all.
            let towards = problem.user_enu_m - node.position_enu_m;
            let first = libm::atan2(towards.y, towards.x);
            eavesdroppers.extend((0..AROUND).map(|k| {
                let (sin, cos) = libm::sincos(first + std::f64::consts::TAU * k as f64 / AROUND as f64);
                let position_enu_m = node.position_enu_m + radius * Vector3::new(cos, sin, 0.0);
                Eavesdropper { position_enu_m, ..certain }
            }));
        }
    }
    Problem { eavesdroppers, objective: Objective::Nominal, ..problem.clone() }
}

/// An objective over draws, resolved as finely as a stage of the search wants it: what its candidates share.
pub trait OverDraws: Sync {
    /// Of `seed`'s draws.
    fn new(setup: &Setup, seed: u64, resolution: Resolution) -> Self;

    /// A local maximum from `start`, whose curvature, if it has any, is that of an earlier stage.
    fn maximise(&self, setup: &Setup, chart: &Chart, start: Local, memory: &mut Memory) -> Local;
}

/// The 5% quantile, smoothed.
pub struct Quantile {
    seed: u64,
    draws: Vec<Draw>,
    /// All draws, over few attitudes: which of them are the lowest.
    all: Samples,
    combination: Combination,
    clip: bool,
    /// Attitudes that all draws meet.
    attitudes: usize,
    /// Most rounds, and iterations of each.
    rounds: usize,
    iterations: usize,
    /// Of a round, nats.
    tolerance: f64,
    /// So many draws are searched over.
    lowest: usize,
}

impl OverDraws for Quantile {
    fn new(setup: &Setup, seed: u64, resolution: Resolution) -> Self {
        // Draws where something changes within a slot, and where nothing does.
        let coarsely = matches!(resolution, Resolution::First | Resolution::Coarse);
        let ([varying, steady], attitudes, rounds, width, tolerance) = match resolution {
            Resolution::First | Resolution::Coarse => ([256, 1024], FEW, 1, QUANTILE, TOLERANCE),
            Resolution::Medium => ([512, 2048], FEW, 2, QUANTILE, TOLERANCE),
            Resolution::Fine => ([2048, 16_384], 64, 3, 0.4 * QUANTILE, TOLERANCE),
            // Of 64 attitudes a dozen variables fit some: up to 0.16 bit/s/Hz over fresh ones.
            Resolution::Finest => ([2048, 16_384], 256, 3, 0.4 * QUANTILE, 10.0 * TOLERANCE),
        };
        let of = if setup.varies() { varying } else { steady };
        let draws = Samples::draws_of(setup.problem, of, sobol::mix(seed, 2));
        Self {
            seed,
            all: Samples::shared(setup.problem, FEW, draws.clone(), sobol::mix(seed, 1)),
            draws,
            combination: Combination::Quantile { of, width },
            clip: !coarsely,
            attitudes,
            rounds,
            tolerance,
            iterations: if resolution == Resolution::First { FIRST_ITERATIONS } else { ITERATIONS },
            lowest: (LOWEST_TIMES * (QUANTILE + width) * of as f64) as usize,
        }
    }

    fn maximise(&self, setup: &Setup, chart: &Chart, start: Local, memory: &mut Memory) -> Local {
        let &Self { combination, clip, .. } = self;
        let mut is_low = vec![false; self.draws.len()];
        self.join(setup, &start.raw, &mut is_low, memory);
        let mut low = self.low(setup, &is_low);
        let mut best =
            Local { value: memory.over_draws(setup, &start.raw, &low, combination, clip), ..start };
        let mut at = best;
        for _ in 0..self.rounds {
            let target = Target::OverDraws { samples: &low, combination, clip };
            let solver = settings(self.iterations, self.tolerance, at.curvature);
            at = memory.maximise(setup, chart, target, &at.raw, &solver).unwrap_or(at);
            let promised = at.value;
            self.join(setup, &at.raw, &mut is_low, memory);
            low = self.low(setup, &is_low);
            at.value = memory.over_draws(setup, &at.raw, &low, combination, clip);
            let gain = at.value - best.value;
            if gain > 0.0 {
                best = at;
            }
            if gain.abs() < WORTH || at.value >= promised - WORTH {
                break;
            }
        }
        best
    }
}

impl Quantile {
    /// The lowest draws of a configuration join `is_low`.
    fn join(&self, setup: &Setup, raw: &Raw, is_low: &mut [bool], memory: &mut Memory) {
        memory.over_draws(setup, raw, &self.all, self.combination, self.clip);
        memory.draws.lowest_first().iter().take(self.lowest).for_each(|draw| is_low[*draw] = true);
    }

    /// Those draws, with all attitudes.
    fn low(&self, setup: &Setup, is_low: &[bool]) -> Samples {
        let low = self.draws.iter().zip(is_low).filter(|(_, low)| **low).map(|(draw, _)| draw.clone());
        Samples::shared(setup.problem, self.attitudes, low, sobol::mix(self.seed, 1))
    }
}

/// The worst case over positions.
pub struct WorstCase {
    /// With the estimates alone.
    samples: Samples,
    /// Least step of a search for the worst positions.
    least_step: f64,
    /// Whether [.]^+ is inside and most rounds, one after the other.
    sweeps: &'static [(bool, usize)],
    /// Of the soft minimum, one after the other.
    sharpness: &'static [f64],
}

impl OverDraws for WorstCase {
    fn new(setup: &Setup, seed: u64, resolution: Resolution) -> Self {
        let (count, least_step, sweeps, sharpness): (_, _, &[_], _) = match resolution {
            Resolution::First | Resolution::Coarse => (64, 3e-2, &[(false, 3), (true, 1)], &SHARPNESS[..1]),
            Resolution::Medium => (128, 1e-2, &[(true, 8)], &SHARPNESS[..]),
            Resolution::Fine | Resolution::Finest => (512, 3e-3, &[(true, 12)], &SHARPNESS[..]),
        };
        let samples = Samples::shared(setup.problem, count, [estimates(setup)], sobol::mix(seed, 1));
        Self { samples, least_step, sweeps, sharpness }
    }

    fn maximise(&self, setup: &Setup, chart: &Chart, start: Local, memory: &mut Memory) -> Local {
        let mut samples = self.samples.clone();
        let mut known = vec![estimates(setup)];
        let mut best = start;
        for &(clip, rounds) in self.sweeps {
            let look = Look::of_search(clip, self.least_step);
            let (mut worst, value) = worst_positions(setup, &best.raw, &samples, &known, &look);
            best.value = value;
            let mut at = best;
            for _ in 0..rounds {
                samples.push_draw(worst.clone());
                known.push(worst);
                for q in self.sharpness {
                    let combination = Combination::SoftMinimum(*q);
                    let target = Target::OverDraws { samples: &samples, combination, clip };
                    at = memory
                        .maximise(setup, chart, target, &at.raw, &settings(40, TOLERANCE, None))
                        .unwrap_or(at);
                }
                let promised = at.value;
                let value;
                (worst, value) = worst_positions(setup, &at.raw, &samples, &known, &look);
                if value > best.value {
                    best = Local { value, ..at };
                }
                if value >= promised - SETTLED {
                    break;
                }
            }
        }
        best
    }
}

/// The eavesdroppers where they are said to be.
fn estimates(setup: &Setup) -> Vec<Vector3<f64>> {
    setup.problem.eavesdroppers.iter().map(|e| e.position_enu_m).collect()
}

fn settings(iterations: usize, tolerance: f64, curvature: Option<Matrix>) -> Solver {
    let usual = active_set::Settings::default();
    Solver::ActiveSet(active_set::Settings { iterations, tolerance, curvature, ..usual })
}
