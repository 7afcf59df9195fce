//! `veilwing`: a global search over both poses and powers.
//!
//! P_I is at its cap, which is optimal with [.]^+ inside the expectation.
//!
//! 1. *Screen.* From many starts, on few samples (or a soft maximum), with J's axis on the user (phase 2), which costs
//!    next to nothing nearly everywhere and saves two variables.
//! 2. *Polish.* The best distinct ends, all variables free, on more and more samples (or with a sharper maximum).

use nalgebra::Vector3;

use super::expectation::kernel::{ANGLES, VEHICLE};
use super::expectation::samples::{Samples, Sequence};
use super::expectation::sobol;
use super::model::{Local, Memory, Solver, Target};
use super::problem::Objective;
use super::setup::Setup;
use super::solver::active_set;
use super::variables::{AxisChart, Chart, PowerChart};
use super::{Found, Options, parallel, phase2, robust, starts};
use crate::radio::pattern;

/// Sharpness of the smoothed maximum per nat: screening, then polishing.
const SCREEN_SHARPNESS: [f64; 2] = [15.0, 200.0];
const POLISH_SHARPNESS: [f64; 3] = [2e3, 2e4, 2e5];
/// Starts: without jitter, with, and with where tilt is limited.
const EXACT_STARTS: usize = 24;
const SAMPLED_STARTS: usize = 48;
const RESTRICTED_STARTS: usize = 96;
/// Candidates that are polished without jitter.
const EXACT_POLISHED: usize = 4;
/// Samples of the screening.
const SCREEN_SAMPLES: usize = 64;
/// Samples and candidates of the polishing.
const POLISH_SAMPLES: [(usize, usize); 3] = [(256, 6), (512, 3), (2048, 1)];
/// Candidates that are improved for a quantile or a worst case.
const OVER_DRAWS: usize = 3;
/// Samples that share a draw of uncertain positions.
const SAMPLES_PER_DRAW: usize = 16;
/// Least P_J over its cap, as a logarithm.
const LEAST_LOG_POWER: f64 = -25.0;

/// Plans by the global search.
pub(super) fn plan(setup: &Setup, options: &Options) -> Found {
    let heeds_uncertainty = setup.heeds_uncertainty();
    let random = setup.jitters() || heeds_uncertainty;
    let ends = match (random, setup.problem.objective) {
        (false, _) => exact(setup, options),
        (true, Objective::Quantile) if heeds_uncertainty => {
            over_draws(setup, options, robust::maximise_quantile)
        }
        (true, Objective::WorstCase) if heeds_uncertainty => {
            over_draws(setup, options, robust::maximise_worst_case)
        }
        (true, _) => polish(setup, options, screen(setup, options)),
    };
    match ends.first() {
        Some(best) => Found { raw: best.raw, converged: best.converged },
        None => Found { raw: starts::start(setup, 0, options.seed), converged: false },
    }
}

fn settings(iterations: usize, tolerance: f64) -> Solver {
    Solver::ActiveSet(active_set::Settings { iterations, tolerance, ..active_set::Settings::default() })
}

/// Without jitter, at the estimated positions.
fn exact(setup: &Setup, options: &Options) -> Vec<Local> {
    let chart = chart(setup, true, can_null(setup));
    let count = options.starts.unwrap_or(EXACT_STARTS);
    let screened = parallel::map(options.threads, count, |memory: &mut Memory, index| {
        let mut raw = starts::start(setup, index, options.seed);
        let mut end = None;
        for sharpness in SCREEN_SHARPNESS {
            let target = Target::Exact(sharpness);
            end = memory.maximise(setup, &chart, target, &raw, &settings(60, 1e-6)).or(end);
            raw = end.map_or(raw, |e| e.raw);
        }
        end
    });
    let best = distinct(setup, screened, EXACT_POLISHED);
    let polished = parallel::map(options.threads, best.len(), |memory: &mut Memory, index| {
        let mut end = best[index];
        for sharpness in POLISH_SHARPNESS {
            let target = Target::Exact(sharpness);
            end = memory.maximise(setup, &chart, target, &end.raw, &settings(100, 1e-9)).unwrap_or(end);
        }
        Some(end)
    });
    distinct(setup, polished, 1)
}

/// The sample set of a plan; the sets of its stages are the first so many of it.
fn samples(setup: &Setup, options: &Options) -> Samples {
    let count = POLISH_SAMPLES[POLISH_SAMPLES.len() - 1].0;
    let draws = if setup.heeds_uncertainty() { count / SAMPLES_PER_DRAW } else { 1 };
    Samples::new(setup.problem, count, draws, sobol::mix(options.seed, 1), Sequence::Sobol)
}

/// The best distinct ends of many starts on few samples.
fn screen(setup: &Setup, options: &Options) -> Vec<Local> {
    let coarse = samples(setup, options).first(SCREEN_SAMPLES);
    let chart = chart(setup, true, false);
    let target = Target::Mean { samples: &coarse, clip: false };
    let count =
        options.starts.unwrap_or(if is_restricted(setup) { RESTRICTED_STARTS } else { SAMPLED_STARTS });
    let screened = parallel::map(options.threads, count, |memory: &mut Memory, index| {
        let start = starts::start(setup, index, options.seed);
        memory.maximise(setup, &chart, target, &start, &settings(60, 1e-4))
    });
    distinct(setup, screened, POLISH_SAMPLES[0].1)
}

/// All variables free, on more and more samples, fewer and fewer candidates.
fn polish(setup: &Setup, options: &Options, mut best: Vec<Local>) -> Vec<Local> {
    let all = samples(setup, options);
    let chart = chart(setup, false, false);
    for (count, candidates) in POLISH_SAMPLES {
        best.truncate(candidates);
        let samples = all.first(count);
        let target = Target::Mean { samples: &samples, clip: true };
        let polished = parallel::map(options.threads, best.len(), |memory: &mut Memory, index| {
            let end = best[index];
            Some(memory.maximise(setup, &chart, target, &end.raw, &settings(100, 1e-7)).unwrap_or(end))
        });
        best = distinct(setup, polished, candidates);
    }
    best
}

/// Another objective over uncertain positions, from the best ends for the mean.
fn over_draws(
    setup: &Setup,
    options: &Options,
    maximise: impl Fn(&Setup, &Chart, Local, u64, &mut Memory) -> Local + Sync,
) -> Vec<Local> {
    let mut best = screen(setup, options);
    best.truncate(OVER_DRAWS);
    let chart = chart(setup, false, false);
    let ends = parallel::map(options.threads, best.len(), |memory: &mut Memory, index| {
        Some(maximise(setup, &chart, best[index], options.seed, memory))
    });
    distinct(setup, ends, 1)
}

/// The best ends, best first, no two of them the same configuration.
fn distinct(setup: &Setup, ends: Vec<Option<Local>>, most: usize) -> Vec<Local> {
    let mut ends: Vec<Local> = ends.into_iter().flatten().collect();
    ends.sort_by(|a, b| b.value.total_cmp(&a.value));
    let mut kept: Vec<Local> = Vec::with_capacity(most);
    for end in ends {
        if kept.len() < most && !kept.iter().any(|k| is_same(setup, k, &end)) {
            kept.push(end);
        }
    }
    kept
}

/// Whether two ends are one local maximum, found to the accuracy of a screening.
fn is_same(setup: &Setup, a: &Local, b: &Local) -> bool {
    (a.value - b.value).abs() < 0.02
        && [0, VEHICLE].iter().all(|at| {
            let position = |l: &Local| Vector3::new(l.raw[*at], l.raw[at + 1], l.raw[at + 2]);
            let axis = |l: &Local| {
                let angles = &l.raw[at + ANGLES..];
                pattern::antenna_axis(angles[0], angles[1], angles[2])
            };
            (position(a) - position(b)).norm() < 0.1 * setup.length_m && axis(a).cross(&axis(b)).norm() < 0.1
        })
}

/// Whether a vehicle's tilt is limited enough to change where the good configurations are.
fn is_restricted(setup: &Setup) -> bool {
    setup.tilt_rad.iter().any(|t| *t < starts::RESTRICTED_RAD)
}

/// Whether J can null the user exactly wherever it is.
fn can_null(setup: &Setup) -> bool {
    setup.tilt_rad[1] >= std::f64::consts::FRAC_PI_2 && !setup.jitters()
}

fn chart(setup: &Setup, nulled: bool, full_power: bool) -> Chart {
    let problem = setup.problem;
    let yaw = problem.free_yaw && setup.jitters();
    let caps = problem.radio.max_power_w;
    let free = |v: usize| AxisChart::free(setup.tilt_rad[v], yaw);
    let j = if nulled && setup.tilt_rad[1] > 0.0 {
        AxisChart::Follows {
            map: phase2::axis_map(),
            about: problem.user_enu_m,
            limit_rad: setup.tilt_rad[1],
        }
    } else {
        free(1)
    };
    let power = if full_power || caps.j <= 0.0 {
        PowerChart::Fixed(caps.j)
    } else {
        PowerChart::Log { max_w: caps.j, floor: LEAST_LOG_POWER }
    };
    Chart { length_m: setup.length_m, axes: [free(0), j], powers: [PowerChart::Fixed(caps.i), power] }
}
