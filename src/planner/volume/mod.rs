//! Plans a whole superframe for what is delivered in it: volume, silence included.
//!
//! A slot's best poses may lie far from the next slot's, and nobody is served on the way. Here the poses of all slots are
//! chosen together, so that
//!
//! ```text
//!             sum of (slot - guard) rate                  what is delivered in a superframe
//!   ------------------------------------------------  =  ---------------------------------
//!   sum of slots + users * settling + sum of transits     what the superframe takes
//! ```
//!
//! is as large as it can be, or with the least-served user first ([`Fairness::MaxMin`]) the least of the users' volumes in
//! place of their sum, the lengths of slots then chosen as well (`shares`). Vehicles are static and silent in between:
//! positions, attitudes and powers are those of slots.
//!
//! The superframe is a cycle: the way from the last user back to the first belongs to it, however often it is flown. The
//! ways from the start and home do not: a plan is made before anybody knows where the vehicles will stand.

mod layout;
pub(super) mod objective;
pub(super) mod place;
mod search;
pub(super) mod shares;
mod table;
#[cfg(test)]
pub(super) mod testing;
#[cfg(test)]
mod tests;
pub(super) mod ways;

pub use ways::Ways;

use super::error::PlanError;
use super::expectation::kernel::Raw;
use super::expectation::samples::Samples;
use super::plan::{SlotPlan, Status};
use super::problem::{Method, Objective, Problem};
use super::setup::Setup;
use super::{Found, Options, finish, parallel, search as slot_search};
use objective::{Case, legs};

/// Who comes first when a superframe is shared out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Fairness {
    /// Nobody: slots are equal, and the sum of all volumes counts.
    #[default]
    Slots,
    /// The least-served user: the least volume counts, and slots are as long as that asks for.
    MaxMin,
}

/// Lengths and limits of slots.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Service {
    /// Length of a slot in seconds, or with [`Fairness::MaxMin`] the most that slots may be long on average.
    pub slot_s: f64,
    /// The part of it in which nobody radiates, in seconds; shorter than any slot.
    pub guard_s: f64,
    /// Time to come to rest after each transit, in seconds.
    pub settle_s: f64,
    /// The shortest and the longest slot in seconds, about `slot_s`: with [`Fairness::MaxMin`].
    pub slot_limits_s: [f64; 2],
    /// Who comes first.
    pub fairness: Fairness,
    /// Whether users may be served in any order, rather than as they are listed.
    pub may_reorder: bool,
}

/// A superframe's plan.
#[derive(Debug, Clone, PartialEq)]
pub struct Superframe {
    /// By user, as listed.
    pub slots: Vec<SlotPlan>,
    /// The length of each one's slot in seconds.
    pub slots_s: Vec<f64>,
}

/// Samples of a first look at a place, of a second one, of the search's steps and of its last ones: with jitter alone, and where
/// more is random.
const RESOLUTIONS: [usize; 4] = [32, 64, 128, 512];
const RESOLUTIONS_OF_ERRORS: [usize; 4] = [64, 128, 256, 1024];
/// Candidates that are timed by the ways that will be flown.
const TIMED: usize = 4;
/// Slots of chosen lengths are whole multiples of so many seconds.
const SLOT_GRID_S: f64 = 0.01;

/// Plans a superframe: all users in one airspace, each with its problem.
///
/// # Errors
/// [`PlanError`] for a problem without meaning, or a method or an objective that knows no volume.
pub fn plan(
    problems: &[Problem],
    service: &Service,
    ways: &impl Ways,
    options: &Options,
) -> Result<Superframe, PlanError> {
    let mut best: Option<Choice> = None;
    for choice in choices(problems, service, ways, options)? {
        if best.as_ref().is_none_or(|known| choice.worth > known.worth) {
            best = Some(choice);
        }
    }
    let slots = best.map(|choice| choice.slots).unwrap_or_default();
    let rates: Vec<f64> = slots.iter().zip(problems).map(|(slot, problem)| nats(slot, problem)).collect();
    let slots_s = lengths_s(service, &slots, &rates);
    Ok(Superframe { slots, slots_s })
}

/// One of a search's best candidates, scored.
pub(super) struct Choice {
    /// By user.
    pub slots: Vec<SlotPlan>,
    /// In which order they are served.
    pub order: Vec<usize>,
    /// What it is worth by the ways that are flown, nats per hertz and second.
    pub worth: f64,
}

/// The best candidates of the search.
pub(super) fn choices(
    problems: &[Problem],
    service: &Service,
    ways: &impl Ways,
    options: &Options,
) -> Result<Vec<Choice>, PlanError> {
    check(problems, options)?;
    let setups: Vec<Setup> = problems.iter().map(Setup::new).collect::<Result<_, _>>()?;
    if setups.is_empty() {
        return Ok(Vec::new());
    }
    let plans: Vec<Vec<slot_search::Rough>> =
        setups.iter().map(|setup| slot_search::rough(setup, options)).collect();
    let case = Case {
        setups: &setups,
        samples: parallel::map(options.threads, setups.len(), |(): &mut (), user| {
            samples(&setups[user], options)
        }),
        service,
        ways,
        counts: plans
            .iter()
            .map(|plans| plans.iter().any(|plan| plan.value > super::LEAST_BIT_S_HZ))
            .collect(),
    };
    let own: Vec<Vec<Raw>> = plans.iter().map(|plans| plans.iter().map(|plan| plan.raw).collect()).collect();
    let mut candidates = search::candidates(&case, &own, options.seed, options.threads);
    candidates.truncate(TIMED);
    let scored = candidates.into_iter().map(|candidate| {
        let found = |raw: &Raw| Found { raw: *raw, converged: candidate.converged };
        let slots: Vec<SlotPlan> = setups
            .iter()
            .zip(&candidate.raws)
            .map(|(setup, raw)| finish(setup, options, found(raw)))
            .collect();
        let rates: Vec<f64> = slots.iter().zip(problems).map(|(slot, problem)| nats(slot, problem)).collect();
        let poses = |user: usize| slots[user].vehicles.map(|vehicle| vehicle.pose);
        let transits_s: Option<f64> =
            legs(&candidate.order).map(|(from, to)| ways.transit_s(&poses(from), &poses(to))).sum();
        // What cannot be flown is worth nothing: the slot table says why.
        let worth = transits_s.map_or(0.0, |transits_s| case.worth_of(&rates, transits_s));
        Choice { slots, order: candidate.order, worth }
    });
    Ok(scored.collect())
}

/// The lengths of slots with these rates, in nats per hertz.
pub(super) fn lengths_s(service: &Service, slots: &[SlotPlan], rates: &[f64]) -> Vec<f64> {
    let served: Vec<bool> = slots.iter().map(|slot| slot.status != Status::NoPositiveRate).collect();
    let shared = shares::shares(service, rates, &served);
    let [shortest_s, longest_s] = service.slot_limits_s;
    match service.fairness {
        Fairness::Slots => shared.slots_s,
        // Down, so that together they are no longer than they may be.
        Fairness::MaxMin => shared
            .slots_s
            .into_iter()
            .map(|slot_s| ((slot_s / SLOT_GRID_S).floor() * SLOT_GRID_S).clamp(shortest_s, longest_s))
            .collect(),
    }
}

/// A slot's rate in nats per hertz.
pub(super) fn nats(slot: &SlotPlan, problem: &Problem) -> f64 {
    slot.secrecy_rate_bps * std::f64::consts::LN_2 / problem.radio.bandwidth_hz
}

/// The sample sets of a user, the coarsest first.
pub(super) fn samples(setup: &Setup, options: &Options) -> [Samples; 4] {
    let all = slot_search::samples(setup, options);
    let sizes = if setup.heeds_uncertainty() { RESOLUTIONS_OF_ERRORS } else { RESOLUTIONS };
    sizes.map(|count| all.first(count))
}

/// Refuses what knows nothing of volume.
pub(super) fn check(problems: &[Problem], options: &Options) -> Result<(), PlanError> {
    if options.method != Method::Veilwing {
        return Err(PlanError::VolumeMethod);
    }
    let means = |problem: &Problem| matches!(problem.objective, Objective::Mean | Objective::Nominal);
    if !problems.iter().all(means) {
        return Err(PlanError::VolumeObjective);
    }
    Ok(())
}
