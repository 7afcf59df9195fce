//! `veilwing`: a global search over both poses and powers.
//!
//! P_I is at its cap, which is optimal with [.]^+ inside the expectation.
//!
//! 1. *Screen.* From many starts, on few samples (or a soft maximum), with J's axis on the user (phase 2), which costs
//!    next to nothing nearly everywhere and saves two variables. Under jitter all starts are followed for a few
//!    iterations, and the better ones to the end.
//! 2. *Polish.* The best distinct ends, all variables free (but J's axis where nothing leaks at its null on the user), on
//!    more and more samples (or with a sharper maximum). Each stage goes on with the curvature that the one before has
//!    learnt.
//!
//! Where J's transmitter cannot give every power, it is screened between the least and the largest that it can give, and
//! silent; every candidate is then polished at each of the levels about its own power, and the best is kept: nothing is
//! rounded afterwards.
//! A quantile or a worst case over positions is polished from the best ends of two screenings: by the mean, and with every
//! node at several places at once (`robust`).
//!
//! Starts beyond a method's own number (`Options::starts`) are a search of another kind, to check the first against:
//! see [`starts::ELSEWHERE`]. More candidates are polished then, in proportion.

use nalgebra::Vector3;

use super::expectation::kernel::{ANGLES, Raw, VEHICLE};
use super::expectation::samples::{LANES, Samples, Sequence};
use super::expectation::sobol;
use super::model::{Local, Memory, Solver, Target};
use super::problem::Objective;
use super::robust::{OverDraws, Quantile, Resolution, WorstCase};
use super::setup::Setup;
use super::solver::active_set;
use super::solver::dense::Matrix;
use super::variables::{AxisChart, Chart, PowerChart};
use super::volume::place;
use super::{Found, Near, Options, parallel, phase2, powers, robust, starts};
use crate::radio::pattern;

/// Sharpness of the smoothed maximum per nat: screening, then polishing.
const SCREEN_SHARPNESS: [f64; 2] = [15.0, 200.0];
const POLISH_SHARPNESS: [f64; 3] = [2e3, 2e4, 2e5];
/// Starts without jitter and with it; of either, at any tilt, and where tilt is limited or the yaw is free. Two more for
/// each eavesdropper beyond ten, up to thirty: they are taken in turn.
const EXACT_STARTS: [usize; 2] = [24, 112];
const SAMPLED_STARTS: [usize; 2] = [36, 96];
/// For a quantile: few draws decide, and of five nodes there are more good places than of their means.
const QUANTILE_STARTS: [usize; 2] = [72, 112];
const USUAL_EAVESDROPPERS: usize = 10;
const MORE_STARTS: usize = 40;
/// So many times the starts where there are no-fly areas.
const GAPS: usize = 4;
/// Candidates that are polished without jitter.
const EXACT_POLISHED: usize = 6;
/// Iterations from every start of a screening under jitter, and of the better ones after that.
const SCREEN_ITERATIONS: [usize; 2] = [15, 60];
/// One in so many starts is followed to its end, at least so many.
const SCREEN_SHARE: usize = 2;
const SCREEN_LEAST: usize = 12;
/// Samples of the screening.
const SCREEN_SAMPLES: usize = 64;
/// Samples, candidates and tolerance of the polishing, stage by stage.
const POLISH_SAMPLES: [(usize, usize, f64); 3] = [(256, 6, 1e-4), (512, 3, 1e-5), (2048, 1, 1e-7)];
/// The same of a measured pattern, after the first with a dipole in its place. Its curvature jumps at every measured point: to be
/// more exact takes four times as long for a thousandth of a bit/s/Hz.
const MEASURED_SAMPLES: [(usize, usize, f64); 3] = [(256, 3, 1e-4), (512, 1, 1e-5), (2048, 1, 1e-5)];
/// Candidates that are improved for a quantile, and for a worst case: first so many of either screening.
const FOR_QUANTILE: &[(Resolution, usize)] = &[
    (Resolution::First, 10),
    (Resolution::Coarse, 8),
    (Resolution::Medium, 5),
    (Resolution::Fine, 2),
    (Resolution::Finest, 1),
];
const FOR_WORST_CASE: &[(Resolution, usize)] =
    &[(Resolution::Coarse, 12), (Resolution::Medium, 4), (Resolution::Fine, 2)];
/// A candidate that is behind the best by more, in nats, is not looked at finely.
const BEHIND: f64 = 0.15;
/// Below this mean rate, in nats, with every node at several places, the signed rate and [.]^+ have optima of their own.
const LITTLE: f64 = 1.5;
/// Samples that share a draw of uncertain positions; without jitter a block, whose samples are then all the same.
const SAMPLES_PER_DRAW: usize = 16;

/// Plans by the global search.
pub(super) fn best(setup: &Setup, options: &Options) -> Found {
    let found =
        ends(setup, options, None).first().map(|end| Found { raw: end.raw, converged: end.converged });
    found.unwrap_or_else(|| resort(setup, options))
}

/// Where no local search has found a finite value.
fn resort(setup: &Setup, options: &Options) -> Found {
    Found { raw: setup.resort(&starts::start(setup, 0, options.seed)), converged: false }
}

/// Plans by the global search: the best configuration, and of the other optima met on the way those within `near` of its
/// value, best first.
pub(super) fn near(setup: &Setup, options: &Options, near: Near) -> Vec<Found> {
    let ends = ends(setup, options, Some(near));
    let Some(best) = ends.first() else { return vec![resort(setup, options)] };
    let least = best.value - near.tolerance * best.value.abs();
    let kept = ends.iter().filter(|end| end.value >= least);
    kept.map(|end| Found { raw: end.raw, converged: end.converged }).collect()
}

/// A plan of a slot as good as a search of its neighbours needs it.
pub(super) struct Rough {
    /// The configuration.
    pub raw: Raw,
    /// Its objective in nats per hertz.
    pub value: f64,
}

/// The best configurations of a slot, best first, after the first stage of the polishing; at least one.
pub(super) fn rough(setup: &Setup, options: &Options) -> Vec<Rough> {
    Quick::new(setup, options).rough()
}

/// Quick searches of a slot, on samples that are drawn once: of all of it, and about a configuration.
pub(super) struct Quick<'a> {
    setup: &'a Setup<'a>,
    options: &'a Options,
    /// What is random, if anything is: all of it, and as much as a first stage of the polishing takes.
    samples: Option<[Samples; 2]>,
    memory: Memory,
}

impl<'a> Quick<'a> {
    /// In this slot.
    pub fn new(setup: &'a Setup<'a>, options: &'a Options) -> Self {
        let random = setup.varies() || setup.heeds_uncertainty();
        let samples = random.then(|| {
            let all = samples(setup, options);
            let few = all.first(POLISH_SAMPLES[0].0);
            [all, few]
        });
        Self { setup, options, samples, memory: Memory::default() }
    }

    /// As [`rough`] has it.
    pub fn rough(&self) -> Vec<Rough> {
        let Self { setup, options, .. } = *self;
        let best = if let Some([samples, _]) = &self.samples {
            let dipoles = setup.problem.with_dipoles();
            let quick = dipoles.as_ref().and_then(|problem| Setup::new(problem).ok());
            let first = quick.as_ref().unwrap_or(setup);
            let field = Field { setup: first, clip: false };
            let mut best = screen(first, &field, options, samples, POLISH_SAMPLES[0].1);
            best.iter_mut().for_each(|end| end.curvature = None);
            let stages = if quick.is_some() { &MEASURED_SAMPLES[..1] } else { &POLISH_SAMPLES[..1] };
            polish(setup, options, None, samples, best, stages)
        } else {
            exact(setup, options, Some(Near { most: POLISH_SAMPLES[0].1, tolerance: 1.0 }))
        };
        let found: Vec<Rough> = best.iter().map(|end| Rough { raw: end.raw, value: end.value }).collect();
        if found.is_empty() { vec![Rough { raw: resort(setup, options).raw, value: 0.0 }] } else { found }
    }

    /// The optimum next to a configuration.
    pub fn next_to(&mut self, from: &Raw) -> Option<Raw> {
        let chart = polishing(self.setup, from);
        let (target, settings) = (about(&self.samples), settings(100, POLISH_SAMPLES[0].2));
        self.memory.maximise(self.setup, &chart, target, from, &settings).map(|end| end.raw)
    }

    /// I's axis and J's power that are best where a configuration is.
    pub fn in_place(&mut self, from: &Raw) -> Raw {
        place::in_place(self.setup, about(&self.samples), from, &mut self.memory).raw
    }
}

/// What is climbed about a configuration.
fn about(samples: &Option<[Samples; 2]>) -> Target<'_> {
    match samples {
        Some([_, samples]) => Target::Mean { samples, clip: true },
        None => Target::Exact(POLISH_SHARPNESS[0]),
    }
}

/// The best ends of the search; without `near` only the best one is brought to its full accuracy.
fn ends(setup: &Setup, options: &Options, near: Option<Near>) -> Vec<Local> {
    let heeds_uncertainty = setup.heeds_uncertainty();
    let random = setup.varies() || heeds_uncertainty;
    match (random, setup.problem.objective) {
        (false, _) => exact(setup, options, near),
        (true, Objective::Quantile) if heeds_uncertainty => {
            let starts = Some(options.starts.unwrap_or_else(|| own_starts(setup, QUANTILE_STARTS)));
            over_draws::<Quantile>(setup, &Options { starts, ..*options }, near, FOR_QUANTILE)
        }
        (true, Objective::WorstCase) if heeds_uncertainty => {
            over_draws::<WorstCase>(setup, options, near, FOR_WORST_CASE)
        }
        (true, _) => {
            let samples = samples(setup, options);
            let dipoles = setup.problem.with_dipoles();
            let quick = dipoles.as_ref().and_then(|problem| Setup::new(problem).ok());
            let first = quick.as_ref().unwrap_or(setup);
            let field = Field { setup: first, clip: false };
            let mut best = screen(first, &field, options, &samples, POLISH_SAMPLES[0].1);
            best.iter_mut().for_each(|end| end.curvature = None);
            if let Some(quick) = &quick {
                best = polish(quick, options, near, &samples, best, &POLISH_SAMPLES[..1]);
                return polish(setup, options, near, &samples, best, &MEASURED_SAMPLES);
            }
            polish(setup, options, near, &samples, best, &POLISH_SAMPLES)
        }
    }
}

/// How many candidates the last stage takes from `best`: those that may still end near the best one.
fn last(best: &[Local], near: Option<Near>) -> usize {
    let Some((near, first)) = near.zip(best.first()) else { return 1 };
    // Twice the tolerance: coarse values are not quite in the order of the fine ones.
    let least = first.value - 2.0 * near.tolerance * first.value.abs();
    best.iter().take(near.most).filter(|end| end.value >= least).count().max(1)
}

fn settings(iterations: usize, tolerance: f64) -> Solver {
    continued(iterations, tolerance, None)
}

/// With the curvature of an earlier search on the same chart.
fn continued(iterations: usize, tolerance: f64, curvature: Option<Matrix>) -> Solver {
    Solver::ActiveSet(active_set::Settings {
        iterations,
        tolerance,
        curvature,
        ..active_set::Settings::default()
    })
}

/// Candidates of a stage: its own number, or more where more starts are asked for, or where the screening, with J's axis
/// from phase 2, knows nothing of what a free yaw gains.
fn candidates(own: usize, setup: &Setup, options: &Options) -> usize {
    let own = if setup.problem.free_yaw { 3 * own } else { own };
    let own = if setup.region.has_gaps() { 2 * own } else { own };
    own.max(own * options.starts.unwrap_or(0) / 100)
}

/// Without anything random, at the estimated positions.
fn exact(setup: &Setup, options: &Options, near: Option<Near>) -> Vec<Local> {
    // Where J's null leaks, its power and its axis are worth a search of their own.
    let own = if setup.nulls_exactly() { EXACT_STARTS } else { SAMPLED_STARTS };
    let count = options.starts.unwrap_or_else(|| own_starts(setup, own));
    let best = screen_exact(setup, setup, options, count, EXACT_POLISHED);
    let polished = parallel::map(options.threads, best.len(), |memory: &mut Memory, index| {
        let mut end = best[index];
        let chart =
            if count > starts::ELSEWHERE { free(setup, &end.raw) } else { polishing(setup, &end.raw) };
        for sharpness in POLISH_SHARPNESS {
            let target = Target::Exact(sharpness);
            end = memory.maximise(setup, &chart, target, &end.raw, &settings(100, 1e-9)).unwrap_or(end);
        }
        Some(end)
    });
    distinct(setup, polished, near.map_or(1, |n| n.most))
}

/// The best distinct ends of many starts with nothing random, for `field`: the setup's own nodes, or those that stand for them.
fn screen_exact(setup: &Setup, field: &Setup, options: &Options, count: usize, most: usize) -> Vec<Local> {
    let mut best = Vec::new();
    for power in powers::screened(setup) {
        let charts = [chart(setup, true, nulled(setup, power)), chart(setup, false, power)];
        let screened = parallel::map(options.threads, count, |memory: &mut Memory, index| {
            let mut raw = starts::start(setup, index, options.seed);
            let mut end = None;
            for sharpness in SCREEN_SHARPNESS {
                let target = Target::Exact(sharpness);
                let chart = &charts[usize::from(starts::is_elsewhere(index))];
                end = memory.maximise(field, chart, target, &raw, &settings(60, 1e-6)).or(end);
                raw = end.map_or(raw, |e| e.raw);
            }
            end
        });
        best.extend(distinct(setup, screened, candidates(most, setup, options)));
    }
    powers::stepped(setup, best)
}

/// The sample set of a plan; the sets of its stages are the first so many of it.
pub(super) fn samples(setup: &Setup, options: &Options) -> Samples {
    let count = POLISH_SAMPLES[POLISH_SAMPLES.len() - 1].0;
    let per_draw = if setup.varies() { SAMPLES_PER_DRAW } else { LANES };
    let draws = if setup.heeds_uncertainty() { count / per_draw } else { 1 };
    Samples::new(setup.problem, count, draws, sobol::mix(options.seed, 1), Sequence::Sobol)
}

/// The method's own number of starts.
fn own_starts(setup: &Setup, [usual, many]: [usize; 2]) -> usize {
    let own = if is_restricted(setup) || setup.problem.free_yaw { many } else { usual };
    let more = 2 * setup.problem.eavesdroppers.len().saturating_sub(USUAL_EAVESDROPPERS);
    // Of two vehicles, each on one of several sides of an area, there are more kinds.
    let sides = if setup.region.has_gaps() { GAPS } else { 1 };
    sides * (own + more.min(MORE_STARTS))
}

/// What a screening on samples looks at.
struct Field<'a, 'b> {
    /// The setup's own nodes, or those that stand for them.
    setup: &'a Setup<'b>,
    /// Whether [.]^+ is inside.
    clip: bool,
}

/// The best distinct ends of many starts on few samples, for `field`.
fn screen(setup: &Setup, field: &Field, options: &Options, samples: &Samples, most: usize) -> Vec<Local> {
    let screened = powers::screened(setup);
    let at = |power| screen_at(setup, field, options, samples, most, power);
    powers::stepped(setup, screened.into_iter().flat_map(at).collect())
}

/// [`screen`] with J's power as `power` says.
fn screen_at(
    setup: &Setup,
    &Field { setup: field, clip }: &Field,
    options: &Options,
    samples: &Samples,
    most: usize,
    power: PowerChart,
) -> Vec<Local> {
    let coarse = samples.first(if field.heeds_uncertainty() { 4 * SCREEN_SAMPLES } else { SCREEN_SAMPLES });
    let charts = [chart(setup, true, power), chart(setup, false, power)];
    // With a free yaw J's axis leaves open how the noise acts on it.
    let free = |index: usize| setup.problem.free_yaw || starts::is_elsewhere(index);
    let chart_of = |index: usize| &charts[usize::from(free(index))];
    let target = Target::Mean { samples: &coarse, clip };
    let count = options.starts.unwrap_or_else(|| own_starts(setup, SAMPLED_STARTS));
    let begun = parallel::map(options.threads, count, |memory: &mut Memory, index| {
        let start = starts::start(setup, index, options.seed);
        memory.maximise(field, chart_of(index), target, &start, &settings(SCREEN_ITERATIONS[0], 1e-4))
    });
    let mut begun: Vec<(usize, Local)> =
        begun.into_iter().enumerate().filter_map(|(index, end)| Some((index, end?))).collect();
    begun.sort_by(|(_, a), (_, b)| b.value.total_cmp(&a.value));
    begun.truncate((begun.len() / SCREEN_SHARE).max(SCREEN_LEAST));
    let ends = parallel::map(options.threads, begun.len(), |memory: &mut Memory, at| {
        let (index, end) = begun[at];
        if end.converged {
            return Some(end);
        }
        let solver = continued(SCREEN_ITERATIONS[1], 1e-4, end.curvature);
        memory.maximise(field, chart_of(index), target, &end.raw, &solver).or(Some(end))
    });
    distinct(setup, ends, candidates(most, setup, options))
}

/// All variables free but as [`polishing`] has it, on more and more samples, fewer and fewer candidates.
fn polish(
    setup: &Setup,
    options: &Options,
    near: Option<Near>,
    all: &Samples,
    mut best: Vec<Local>,
    stages: &[(usize, usize, f64)],
) -> Vec<Local> {
    for (stage, &(count, own, tolerance)) in stages.iter().enumerate() {
        let kept = if own > 1 { candidates(own, setup, options) } else { last(&best, near) };
        // At first every level that was put in is worth a look.
        if stage > 0 || !powers::are_stepped(setup) {
            best.truncate(kept);
        }
        let samples = all.first(count);
        let target = Target::Mean { samples: &samples, clip: true };
        let polished = parallel::map(options.threads, best.len(), |memory: &mut Memory, index| {
            let end = best[index];
            let solver = continued(100, tolerance, end.curvature);
            let chart = polishing(setup, &end.raw);
            Some(memory.maximise(setup, &chart, target, &end.raw, &solver).unwrap_or(end))
        });
        best = distinct(setup, polished, kept);
    }
    best
}

/// The best ends of a screening in which every uncertain node is at several places at once.
fn screen_beset(setup: &Setup, options: &Options, most: usize) -> Vec<Local> {
    let problem = robust::beset(setup.problem);
    // More nodes in the same airspace: what was checked holds.
    let Ok(field) = Setup::new(&problem) else { return Vec::new() };
    if setup.varies() {
        let samples = samples(&field, options);
        let screened = |clip| screen(setup, &Field { setup: &field, clip }, options, &samples, most);
        let mut ends = screened(false);
        if ends.iter().all(|end| end.value < LITTLE) {
            ends.extend(screened(true));
        }
        return ends;
    }
    let count = options.starts.unwrap_or_else(|| own_starts(setup, EXACT_STARTS));
    screen_exact(setup, &field, options, count, most)
}

/// Another objective over uncertain positions, from the best ends of both screenings: coarsely from several, finely from
/// the best of those.
fn over_draws<T: OverDraws>(
    setup: &Setup,
    options: &Options,
    near: Option<Near>,
    stages: &[(Resolution, usize)],
) -> Vec<Local> {
    let most = stages.first().map_or(1, |(_, own)| *own);
    let field = Field { setup, clip: false };
    let mut best = screen(setup, &field, options, &samples(setup, options), most);
    best.extend(screen_beset(setup, options, most));
    // Curvature on another chart.
    best.iter_mut().for_each(|end| end.curvature = None);
    for (stage, &(resolution, own)) in stages.iter().enumerate() {
        let kept = if stage + 1 < stages.len() {
            candidates(own, setup, options)
        } else {
            last(&best, near).max(own)
        };
        if stage > 0 {
            best.truncate(kept);
        }
        if resolution == Resolution::Fine && near.is_none() {
            let least = best.first().map_or(f64::NEG_INFINITY, |end| end.value - BEHIND);
            best.retain(|end| end.value >= least);
        }
        let objective = T::new(setup, options.seed, resolution);
        let ends = parallel::map(options.threads, best.len(), |memory: &mut Memory, index| {
            let chart = polishing(setup, &best[index].raw);
            Some(objective.maximise(setup, &chart, best[index], memory))
        });
        best = distinct(setup, ends, kept);
    }
    best
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
        && powers::are_alike(setup, a, b)
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
    setup.tilt_rad[1] >= std::f64::consts::FRAC_PI_2 && setup.nulls_exactly()
}

/// J's power where its null is exact: the largest costs nothing.
pub(super) fn nulled(setup: &Setup, power: PowerChart) -> PowerChart {
    if can_null(setup) { PowerChart::Fixed(setup.highest_w[1]) } else { power }
}

/// All variables free about a configuration.
fn free(setup: &Setup, raw: &Raw) -> Chart {
    chart(setup, false, powers::of(setup, raw))
}

/// The same, but for J's axis where nothing leaks at its exact null: it stays on the user (phase 2). With the axis free J's
/// power makes a ridge of it so narrow that a search over positions stops on its way along it.
fn polishing(setup: &Setup, raw: &Raw) -> Chart {
    if setup.nulls_exactly() {
        chart(setup, true, nulled(setup, powers::of(setup, raw)))
    } else {
        free(setup, raw)
    }
}

pub(super) fn chart(setup: &Setup, nulled: bool, power: PowerChart) -> Chart {
    let problem = setup.problem;
    let yaw = problem.free_yaw && setup.jitters();
    let free = |v: usize| setup.free_axis(v, yaw);
    let j = if nulled && setup.tilt_rad[1] > 0.0 {
        AxisChart::Follows {
            map: phase2::axis_map(),
            about: problem.user_enu_m,
            limit_rad: setup.tilt_rad[1],
        }
    } else {
        free(1)
    };
    let powers = [PowerChart::Fixed(setup.highest_w[0]), power];
    Chart { length_m: setup.length_m, axes: [free(0), j], powers }
}
