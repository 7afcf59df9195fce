//! One user from given positions: the best axes and power there, and other good ones.
//!
//! I's axis is tried with its null along each eavesdropper, less most of its part along the user, and along the sums and
//! differences of two of these; J's null is on the user, its power from the link budget. The best of these are followed to
//! their own ends.

use nalgebra::Vector3;

use super::super::expectation::kernel::{ANGLES, POWER, Raw, VEHICLE};
use super::super::model::{Memory, Target};
use super::super::setup::Setup;
use super::super::solver::limited::{self, Settings};
use super::super::variables::PowerChart;
use super::super::{powers, starts};
use super::layout::Layout;
use super::objective::{COARSE, Case, ROUGH};
use super::ways::Ways;
use crate::radio::pattern;

/// Of its part along the user a null along an eavesdropper loses so much.
const TURNED_AWAY: f64 = 0.9;
/// Most axes of a first look.
const ROUGH_AXES: usize = 13;
/// Ends that are kept.
const KEPT: usize = 3;
/// Steps of an axis that is followed.
const STEPS: Settings = Settings { iterations: 25, tolerance: 1e-4, first_step: 1.0 };
/// From where between its usual ends J's power starts.
const POWER_DRAW: f64 = 0.3;

/// A configuration of one user and its rate in nats per hertz.
#[derive(Debug, Clone, Copy)]
pub struct Placed {
    pub raw: Raw,
    pub rate: f64,
}

/// The best configurations of a user with the vehicles at given positions, best first; none of J's axis but its null.
/// `known` are configurations whose axes are tried as well, and `followed` the axes that are followed to their ends.
pub fn at<W: Ways>(
    case: &Case<'_, W>,
    user: usize,
    positions: [Vector3<f64>; 2],
    known: &[Raw],
    followed: usize,
    memory: &mut Memory,
) -> Vec<Placed> {
    let setup = &case.setups[user];
    let mut unused = [0.0; 14];
    let mut tried: Vec<Placed> = axes(setup, &positions[0])
        .into_iter()
        .chain(known.iter().map(|raw| pattern::antenna_axis(raw[ANGLES], raw[ANGLES + 1], raw[ANGLES + 2])))
        .map(|axis| {
            let raw = held(setup, &configuration(setup, &positions, &axis));
            let rate = memory.value_alone(setup, coarse(case, user), &raw);
            Placed { raw, rate }
        })
        .collect();
    tried.sort_by(|a, b| b.rate.total_cmp(&a.rate));
    let mut ends: Vec<Placed> = Vec::new();
    for start in tried.into_iter().filter(|start| start.rate.is_finite()).take(followed) {
        let end = in_place(setup, coarse(case, user), &start.raw, memory);
        if !ends.iter().any(|known| is_same(known, &end)) {
            ends.push(end);
        }
    }
    ends.sort_by(|a, b| b.rate.total_cmp(&a.rate));
    ends.truncate(KEPT);
    for end in &mut ends {
        end.rate = case.rate(user, COARSE, &end.raw, memory, &mut unused);
    }
    ends
}

/// A first look at what a user makes of each of J's positions with I at one: the signed rate of the best axis, none followed.
pub fn rough<W: Ways>(
    case: &Case<'_, W>,
    user: usize,
    i: Vector3<f64>,
    js: &[Vector3<f64>],
    memory: &mut Memory,
) -> Vec<f64> {
    let setup = &case.setups[user];
    let axes = axes(setup, &i);
    let axes: Vec<_> = axes.iter().step_by(axes.len().div_ceil(ROUGH_AXES).max(1)).collect();
    js.iter()
        .map(|j| {
            let rate = |axis: &&Vector3<f64>| {
                let raw = held(setup, &configuration(setup, &[i, *j], axis));
                memory.value_alone(setup, case.target(user, ROUGH, false), &raw)
            };
            axes.iter().map(rate).fold(f64::NEG_INFINITY, f64::max)
        })
        .collect()
}

fn coarse<'a, W: Ways>(case: &'a Case<'_, W>, user: usize) -> Target<'a> {
    case.target(user, COARSE, false)
}

/// A local maximum at held positions, over I's axis and J's power; J's null stays on the user.
pub fn in_place(setup: &Setup, target: Target<'_>, raw: &Raw, memory: &mut Memory) -> Placed {
    let layout = Layout::in_place(setup, raw);
    let mut x = layout.encode(std::slice::from_ref(raw));
    let setups = std::slice::from_ref(setup);
    let mut rows = layout.rows(setups, &[[0, 0]]);
    if layout.dimension == 0 || !rows.repair(&mut x) {
        let rate = memory.value(setup, target, raw, &mut [0.0; 14]);
        return Placed { raw: *raw, rate };
    }
    let mut by_raws = [[0.0; 14]];
    let mut objective = |x: &[f64], gradient: &mut [f64]| {
        let raws = layout.raws(x);
        let value = memory.value(setup, target, &raws[0], &mut by_raws[0]);
        layout.pull(x, &raws, &by_raws, gradient);
        gradient.iter_mut().for_each(|c| *c = -*c);
        -value
    };
    let end = limited::minimise(&mut objective, &mut rows, &x, &STEPS);
    Placed { raw: layout.raws(&end.x)[0], rate: -end.value }
}

/// Axes of I worth a try.
fn axes(setup: &Setup, i: &Vector3<f64>) -> Vec<Vector3<f64>> {
    let towards = |node: &Vector3<f64>| (node - i).try_normalize(0.0).unwrap_or_else(Vector3::z);
    let user = towards(&setup.problem.user_enu_m);
    let nulls: Vec<Vector3<f64>> = setup
        .problem
        .eavesdroppers
        .iter()
        .map(|e| {
            let null = towards(&e.position_enu_m);
            (null - TURNED_AWAY * null.dot(&user) * user).try_normalize(0.0).unwrap_or_else(Vector3::z)
        })
        .collect();
    let pairs = (0..nulls.len()).flat_map(|a| (0..a).map(move |b| (a, b)));
    let mixed = pairs.flat_map(|(a, b)| [nulls[a] + nulls[b], nulls[a] - nulls[b]]);
    let mixed: Vec<_> = mixed.filter_map(|axis| axis.try_normalize(1e-9)).collect();
    nulls.into_iter().chain(mixed).collect()
}

/// The configuration with I's axis so, J's null on the user and a usual power.
fn configuration(setup: &Setup, positions: &[Vector3<f64>; 2], axis: &Vector3<f64>) -> Raw {
    let [i, j] = positions;
    let mut raw = [0.0; 14];
    raw[..3].copy_from_slice(i.as_slice());
    raw[VEHICLE..VEHICLE + 3].copy_from_slice(j.as_slice());
    (raw[ANGLES], raw[ANGLES + 1]) = pattern::canonical_angles(axis);
    (raw[VEHICLE + ANGLES], raw[VEHICLE + ANGLES + 1]) =
        pattern::canonical_angles(&(j - setup.problem.user_enu_m));
    raw[POWER] = setup.highest_w[0];
    let power_w = starts::jammer_power_w(setup, j, POWER_DRAW);
    raw[VEHICLE + POWER] = match powers::screened(setup)[0] {
        PowerChart::Fixed(power_w) => power_w,
        PowerChart::Log { max_w, floor } => power_w.clamp(max_w * libm::exp(floor), max_w),
        PowerChart::Linear { max_w } => power_w.min(max_w),
    };
    raw
}

/// A configuration within the limits of tilt.
fn held(setup: &Setup, raw: &Raw) -> Raw {
    if setup.tilt_rad.iter().all(|tilt| *tilt >= std::f64::consts::FRAC_PI_2) {
        return *raw;
    }
    let layout = Layout::in_place(setup, raw);
    layout.raws(&layout.encode(std::slice::from_ref(raw)))[0]
}

/// Whether two ends are one maximum.
fn is_same(a: &Placed, b: &Placed) -> bool {
    let axis = |placed: &Placed| {
        pattern::antenna_axis(placed.raw[ANGLES], placed.raw[ANGLES + 1], placed.raw[ANGLES + 2])
    };
    (a.rate - b.rate).abs() < 0.02 && axis(a).cross(&axis(b)).norm() < 0.1
}
