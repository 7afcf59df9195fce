//! The paper's method and its benchmarks (MODEL section 3): closed forms for some axes, and an interior-point method over
//! the rest, from one start unless more are asked for.
//!
//! | method | I's axis | J's axis | variables |
//! |---|---|---|---|
//! | paper | phase 1 | phase 2 | positions and powers |
//! | jammer orientation | free | phase 2 | positions, I's axis and powers |
//! | interior point | free | free | all twelve |
//! | conventional | level | level | positions and powers |
//!
//! One start is the paper's, and says more of the start than of the method: `interior-point-multi-start` and
//! `conventional-multi-start` are the same two benchmarks from `MANY` starts.
//!
//! The first start of `paper` and `jammer-orientation` has I above the user and J above the eavesdroppers' middle, low;
//! all others, and every start of the benchmarks, are drawn uniformly: positions from the airspace, angles and powers
//! from their ranges. Under jitter the objective is the mean (3b) over a fixed set of 256 samples; without, the maximum
//! over eavesdroppers is smoothed by less than 1e-4 bit/s/Hz. A level vehicle stays level in every method.

use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::expectation::kernel::Raw;
use super::expectation::samples::{Samples, Sequence};
use super::expectation::sobol;
use super::model::{Local, Memory, Solver, Target};
use super::problem::Method;
use super::setup::{Setup, from_user};
use super::solver::interior_point;
use super::variables::{AxisChart, Chart, PowerChart};
use super::{Found, Options, parallel, phase1, phase2};
use crate::radio::pattern;

/// Samples of the expectation.
const SAMPLES: usize = 256;
/// Draws of uncertain positions among them.
const DRAWS: usize = 16;
/// Sharpness of the maximum over eavesdroppers, per nat.
const SHARPNESS: f64 = 2e4;

/// Starts of the benchmarks' multi-start forms: three times as many gain nothing more on the reference scenarios.
const MANY: usize = 40;

/// Plans by one of the paper's methods.
pub(super) fn plan(setup: &Setup, method: Method, options: &Options) -> Found {
    let (method, own_starts) = match method {
        Method::InteriorPointMultiStart => (Method::InteriorPoint, MANY),
        Method::ConventionalMultiStart => (Method::Conventional, MANY),
        method => (method, 1),
    };
    let chart = chart(setup, method);
    let draws = if setup.heeds_uncertainty() { DRAWS } else { 1 };
    let samples = Samples::new(setup.problem, SAMPLES, draws, sobol::mix(options.seed, 1), Sequence::Sobol);
    let starts = options.starts.unwrap_or(own_starts).max(1);
    let ends = parallel::map(options.threads, starts, |memory: &mut Memory, index| {
        let start = start(setup, method, index, options.seed);
        (climb(setup, &chart, &samples, &start, memory), start)
    });
    let mut best = Found { raw: setup.resort(&ends[0].1), converged: false };
    let mut value = f64::NEG_INFINITY;
    for local in ends.into_iter().filter_map(|(local, _)| local) {
        if local.value > value {
            value = local.value;
            best = Found { raw: local.raw, converged: local.converged };
        }
    }
    best
}

fn climb(setup: &Setup, chart: &Chart, samples: &Samples, start: &Raw, memory: &mut Memory) -> Option<Local> {
    let solver = Solver::InteriorPoint(interior_point::Settings::default());
    if setup.varies() || setup.heeds_uncertainty() {
        return memory.maximise(setup, chart, Target::Mean { samples, clip: false }, start, &solver);
    }
    memory.maximise(setup, chart, Target::Exact(SHARPNESS), start, &solver)
}

fn chart(setup: &Setup, method: Method) -> Chart {
    let problem = setup.problem;
    let about = problem.user_enu_m;
    let follow = |map, v: usize| AxisChart::Follows { map, about, limit_rad: setup.tilt_rad[v] };
    let free = |v: usize| setup.free_axis(v, false);
    let phase1 = || follow(phase1::axis_map(phase1::line_angle(&from_user(problem))), 0);
    let phase2 = || follow(phase2::axis_map(), 1);
    let level = AxisChart::Fixed([0.0; 3]);
    let axes = match method {
        Method::Conventional | Method::ConventionalMultiStart => [level, level],
        Method::Paper => [phase1(), phase2()],
        Method::JammerOrientation => [free(0), phase2()],
        Method::InteriorPoint | Method::InteriorPointMultiStart | Method::Veilwing => [free(0), free(1)],
    };
    let axes = [0, 1].map(|v: usize| if setup.tilt_rad[v] > 0.0 { axes[v] } else { level });
    let power = |max_w: f64| if max_w > 0.0 { PowerChart::Linear { max_w } } else { PowerChart::Fixed(0.0) };
    let caps = problem.radio.max_power_w;
    Chart { length_m: setup.length_m, axes, powers: [power(caps.i), power(caps.j)] }
}

fn start(setup: &Setup, method: Method, index: usize, seed: u64) -> Raw {
    let problem = setup.problem;
    let mut rng = ChaCha8Rng::seed_from_u64(sobol::mix(seed, 0x57a7 + index as u64));
    let guided = index == 0 && matches!(method, Method::Paper | Method::JammerOrientation);
    let mut raw = [0.0; 14];
    for (v, cap) in [problem.radio.max_power_w.i, problem.radio.max_power_w.j].into_iter().enumerate() {
        let [low, high] = problem.airspace.altitude_m;
        let position = if guided {
            let from_user = from_user(problem);
            let middle = from_user.iter().sum::<nalgebra::Vector2<f64>>() / from_user.len() as f64;
            let ground = problem.user_enu_m.xy() + if v == 0 { 0.0 * middle } else { middle };
            setup.allowed(Vector3::new(ground.x, ground.y, low + 0.1 * (high - low)))
        } else {
            let (x, y) = setup.uniform(&mut rng);
            setup.outside(Vector3::new(x, y, rng.random_range(low..=high)))
        };
        let (roll, pitch) = if guided || method == Method::Conventional {
            pattern::canonical_angles(&(position - problem.user_enu_m).cross(&Vector3::y()))
        } else {
            let quarter = std::f64::consts::FRAC_PI_2;
            (rng.random_range(-quarter..quarter), rng.random_range(-quarter..quarter))
        };
        let power = cap * if guided { 0.5 } else { rng.random_range(0.0..1.0) };
        raw[7 * v..7 * (v + 1)]
            .copy_from_slice(&[position.x, position.y, position.z, roll, pitch, 0.0, power]);
    }
    raw
}
