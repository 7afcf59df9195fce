//! `veilwing`: a global search over both poses and powers.
//!
//! P_I is at its cap, which is optimal with [.]^+ inside the expectation.
//!
//! 1. *Screen.* From many starts, on few samples (or a soft maximum), with J's axis on the user (phase 2), which costs
//!    next to nothing nearly everywhere and saves two variables.
//! 2. *Polish.* The best distinct ends, all variables free, on more and more samples (or with a sharper maximum).
//!
//! Starts: I near the user, with its null towards one eavesdropper, or across a line that is far from all of them; J near
//! each eavesdropper and at random, its power from the link budget: where J's interference at the user, at its null and
//! under jitter, is some ten times the noise.

use nalgebra::{Vector2, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::baseline::uniform_in;
use super::expectation::kernel::{ANGLES, POWER, Raw, VEHICLE};
use super::expectation::samples::{Samples, Sequence};
use super::expectation::sobol;
use super::model::{Local, Memory, Solver, Target};
use super::setup::{Setup, from_user};
use super::solver::active_set;
use super::variables::{AxisChart, Chart, PowerChart};
use super::{Found, Options, parallel, phase1, phase2};
use crate::radio::pattern;

/// Sharpness of the smoothed maximum per nat: screening, then polishing.
const SCREEN_SHARPNESS: [f64; 2] = [15.0, 200.0];
const POLISH_SHARPNESS: [f64; 3] = [2e3, 2e4, 2e5];
/// Samples: screening, then polishing.
const SCREEN_SAMPLES: usize = 64;
const POLISH_SAMPLES: [usize; 2] = [512, 2048];
/// Candidates that are polished.
const POLISHED: usize = 4;
/// Least P_J over its cap, as a logarithm.
const LEAST_LOG_POWER: f64 = -25.0;

/// Plans by the global search.
pub(super) fn plan(setup: &Setup, options: &Options) -> Found {
    let random = setup.jitters() || setup.is_uncertain();
    let starts = options.starts.unwrap_or(if random { 48 } else { 24 });
    if random { sampled(setup, options, starts) } else { exact(setup, options, starts) }
}

fn settings(iterations: usize, tolerance: f64) -> Solver {
    Solver::ActiveSet(active_set::Settings { iterations, tolerance, ..active_set::Settings::default() })
}

fn exact(setup: &Setup, options: &Options, starts: usize) -> Found {
    let chart = chart(setup, true, can_null(setup));
    let start = |index| start(setup, index, options.seed);
    let screened = parallel::map(options.threads, starts, |memory: &mut Memory, index| {
        let mut raw = start(index);
        let mut end = None;
        for sharpness in SCREEN_SHARPNESS {
            let target = Target::Exact(sharpness);
            end = memory.maximise(setup, &chart, target, &raw, &settings(60, 1e-6)).or(end);
            raw = end.map_or(raw, |e| e.raw);
        }
        end
    });
    let best = distinct(screened, POLISHED);
    let polished = parallel::map(options.threads, best.len(), |memory: &mut Memory, index| {
        let mut end = best[index];
        for sharpness in POLISH_SHARPNESS {
            let target = Target::Exact(sharpness);
            end = memory.maximise(setup, &chart, target, &end.raw, &settings(100, 1e-9)).unwrap_or(end);
        }
        Some(end)
    });
    best_of(polished, || start(0))
}

fn sampled(setup: &Setup, options: &Options, starts: usize) -> Found {
    let draws = |count: usize| if setup.is_uncertain() { count / 16 } else { 1 };
    let set = |count: usize| {
        Samples::new(setup.problem, count, draws(count), sobol::mix(options.seed, 1), Sequence::Sobol)
    };
    let coarse = set(SCREEN_SAMPLES);
    let (nulled, free) = (chart(setup, true, false), chart(setup, false, false));
    let start = |index| start(setup, index, options.seed);
    let screened = parallel::map(options.threads, starts, |memory: &mut Memory, index| {
        let target = Target::Mean { samples: &coarse, clip: false };
        memory.maximise(setup, &nulled, target, &start(index), &settings(60, 1e-4))
    });
    let mut best = distinct(screened, POLISHED);
    for count in POLISH_SAMPLES {
        let samples = set(count);
        let target = Target::Mean { samples: &samples, clip: true };
        let polished = parallel::map(options.threads, best.len(), |memory: &mut Memory, index| {
            let end = best[index];
            Some(memory.maximise(setup, &free, target, &end.raw, &settings(100, 1e-7)).unwrap_or(end))
        });
        best = distinct(polished, 1);
    }
    best_of(best.into_iter().map(Some).collect(), || start(0))
}

/// The best ends, best first, no two of them in the same basin.
fn distinct(ends: Vec<Option<Local>>, most: usize) -> Vec<Local> {
    let mut ends: Vec<Local> = ends.into_iter().flatten().collect();
    ends.sort_by(|a, b| b.value.total_cmp(&a.value));
    let mut kept: Vec<Local> = Vec::with_capacity(most);
    for end in ends {
        if kept.len() < most && !kept.iter().any(|k| (k.value - end.value).abs() < 1e-5) {
            kept.push(end);
        }
    }
    kept
}

fn best_of(ends: Vec<Option<Local>>, fallback: impl Fn() -> Raw) -> Found {
    match distinct(ends, 1).first() {
        Some(best) => Found { raw: best.raw, converged: best.converged },
        None => Found { raw: fallback(), converged: false },
    }
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

/// Start `index`.
fn start(setup: &Setup, index: usize, seed: u64) -> Raw {
    let problem = setup.problem;
    let mut rng = ChaCha8Rng::seed_from_u64(sobol::mix(seed, 0x57a7 + index as u64));
    let user = problem.user_enu_m;
    let from_user = from_user(problem);
    let n = from_user.len();
    let [low, high] = problem.airspace.altitude_m;
    let near = |rng: &mut ChaCha8Rng, p: Vector2<f64>, spread: f64, z: f64| {
        let (dx, dy) = (rng.random_range(-spread..=spread), rng.random_range(-spread..=spread));
        setup.allowed(Vector3::new(p.x + dx, p.y + dy, z))
    };
    let i = near(&mut rng, user.xy(), 0.3 * setup.length_m, low);
    let nu = match index % 3 {
        0 => phase1::line_angle(&from_user),
        1 => {
            let p = from_user[(index / 3) % n];
            p.y.atan2(p.x) + std::f64::consts::FRAC_PI_2
        }
        _ => rng.random_range(0.0..std::f64::consts::PI),
    };
    let axis = phase1::axis_map(nu) * (i - user + Vector3::new(0.0, 0.0, 1e-3));
    let j = if index % 4 == 3 {
        let (x, y) = uniform_in(setup, &mut rng);
        Vector3::new(x, y, rng.random_range(low..=high))
    } else {
        let node = problem.eavesdroppers[(index / 2) % n].position_enu_m;
        let z = if index % 4 == 2 { rng.random_range(low..=high) } else { low };
        near(&mut rng, node.xy(), 0.5 * setup.length_m, z)
    };
    let mut raw = [0.0; 14];
    raw[..3].copy_from_slice(i.as_slice());
    raw[VEHICLE..VEHICLE + 3].copy_from_slice(j.as_slice());
    (raw[ANGLES], raw[ANGLES + 1]) = pattern::canonical_angles(&axis);
    (raw[VEHICLE + ANGLES], raw[VEHICLE + ANGLES + 1]) = pattern::canonical_angles(&(j - user));
    raw[POWER] = problem.radio.max_power_w.i;
    raw[VEHICLE + POWER] = start_power_w(setup, &j, rng.random_range(0.0..1.0));
    raw
}

/// J's power at a start: the interference it leaves at the user at its null is 3 to 100 times the noise.
fn start_power_w(setup: &Setup, j: &Vector3<f64>, draw: f64) -> f64 {
    let problem = setup.problem;
    let cap = problem.radio.max_power_w.j;
    let leak = 2.0 * problem.jitter.std_rad * problem.jitter.std_rad;
    if leak <= 0.0 {
        return cap;
    }
    let level = 3.0 * 33f64.powf(draw);
    (level * (j - problem.user_enu_m).norm_squared() / (setup.scene.budget_m2_w * leak)).min(cap)
}
