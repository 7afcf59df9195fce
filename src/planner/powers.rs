//! J's power in a search: any up to its ceiling, any from a least one on, or one of a few levels; or none.

use super::expectation::kernel::{POWER, Raw, VEHICLE};
use super::model::Local;
use super::problem::PowerSteps;
use super::setup::Setup;
use super::variables::PowerChart;

/// Least P_J over its cap, as a logarithm.
const LEAST_LOG_POWER: f64 = -25.0;
/// How far a power is looked for about a given one, as a logarithm, and in how many steps.
const REACH: f64 = 1.2;
const STEPS: usize = 9;
/// Levels on either side of a candidate's own power at which it is planned.
const NEIGHBOURS: usize = 2;

fn steps<'a>(setup: &Setup<'a>) -> &'a PowerSteps {
    &setup.problem.power_steps.j
}

/// Whether J's transmitter gives any power.
pub fn are_stepped(setup: &Setup) -> bool {
    *steps(setup) != PowerSteps::Any
}

/// The ranges of power that are screened.
pub fn screened(setup: &Setup) -> Vec<PowerChart> {
    let highest_w = setup.highest_w[1];
    if highest_w <= 0.0 {
        return vec![PowerChart::Fixed(0.0)];
    }
    let from = |least_w: f64| {
        // A range of one power is that power.
        if least_w >= highest_w {
            PowerChart::Fixed(highest_w)
        } else {
            PowerChart::Log { max_w: highest_w, floor: libm::log(least_w / highest_w) }
        }
    };
    let silent = PowerChart::Fixed(0.0);
    match steps(setup) {
        PowerSteps::Any => vec![PowerChart::Log { max_w: highest_w, floor: LEAST_LOG_POWER }],
        PowerSteps::AtLeast(least_w) => vec![from(*least_w), silent],
        PowerSteps::Levels(levels_w) => {
            vec![from(levels_w.first().copied().unwrap_or(highest_w)), silent]
        }
    }
}

/// How the power of a candidate may still vary.
pub fn of(setup: &Setup, raw: &Raw) -> PowerChart {
    let power_w = raw[VEHICLE + POWER];
    match steps(setup) {
        PowerSteps::AtLeast(_) if power_w > 0.0 => screened(setup)[0],
        PowerSteps::Any => screened(setup)[0],
        PowerSteps::AtLeast(_) | PowerSteps::Levels(_) => PowerChart::Fixed(power_w),
    }
}

/// Candidates whose power J's transmitter can give: of levels, those about each one's own.
pub fn stepped(setup: &Setup, candidates: Vec<Local>) -> Vec<Local> {
    let PowerSteps::Levels(levels_w) = steps(setup) else { return candidates };
    let possible = levels_w.iter().take_while(|level| **level <= setup.highest_w[1]).count();
    let mut out = Vec::new();
    for candidate in candidates {
        let power_w = candidate.raw[VEHICLE + POWER];
        if power_w <= 0.0 {
            out.push(candidate);
            continue;
        }
        let above = levels_w.partition_point(|level| *level < power_w);
        let near = above.saturating_sub(NEIGHBOURS)..(above + NEIGHBOURS).min(possible);
        out.extend(levels_w[near].iter().map(|level| {
            let mut at_level = Local { converged: false, curvature: None, ..candidate };
            at_level.raw[VEHICLE + POWER] = *level;
            at_level
        }));
    }
    out
}

/// Whether two ends have powers between which a search may move.
pub fn are_alike(setup: &Setup, a: &Local, b: &Local) -> bool {
    let power = |local: &Local| of(setup, &local.raw);
    match (power(a), power(b)) {
        (PowerChart::Fixed(a), PowerChart::Fixed(b)) => a == b,
        (PowerChart::Fixed(_), _) | (_, PowerChart::Fixed(_)) => false,
        _ => true,
    }
}

/// The best power of J by `value`, near one in W: of levels any, else within `range`, its ceiling in W and its least logarithm;
/// the same where it does not vary.
pub fn best_w(
    setup: &Setup,
    own_w: f64,
    range: Option<(f64, f64)>,
    mut value: impl FnMut(f64) -> f64,
) -> f64 {
    if let PowerSteps::Levels(levels_w) = steps(setup) {
        let possible = levels_w.iter().copied().take_while(|level| *level <= setup.highest_w[1]);
        let rated = std::iter::once(0.0).chain(possible).map(|level| (value(level), level));
        return rated.max_by(|a, b| a.0.total_cmp(&b.0)).map_or(own_w, |(_, level)| level);
    }
    let Some((max_w, floor)) = range else { return own_w };
    // The golden section, in the logarithm.
    const GOLDEN: f64 = 0.618_033_988_749_894_8;
    let middle = libm::log(own_w / max_w);
    let (mut low, mut high) = ((middle - REACH).clamp(floor, 0.0), (middle + REACH).clamp(floor, 0.0));
    let at = |log: f64| max_w * libm::exp(log);
    let mut inner = [high - GOLDEN * (high - low), low + GOLDEN * (high - low)];
    let mut values = inner.map(|log| value(at(log)));
    for _ in 0..STEPS {
        if values[0] > values[1] {
            high = inner[1];
            inner = [high - GOLDEN * (high - low), inner[0]];
            values = [value(at(inner[0])), values[0]];
        } else {
            low = inner[0];
            inner = [inner[1], low + GOLDEN * (high - low)];
            values = [values[1], value(at(inner[1]))];
        }
    }
    let found = if values[0] > values[1] { inner[0] } else { inner[1] };
    at(found)
}
