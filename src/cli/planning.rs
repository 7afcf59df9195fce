//! Planning a whole mission, with the time each slot took: what `plan`, `fly` and `sitl` share.

use std::time::Duration;

use crate::companion::settings::transit_limits;
use crate::config::{METHODS, Mission};
use crate::geo::Pose;
use crate::link::clock::Clock;
use crate::planner::bound::{Budget, best_bound};
use crate::planner::document::{FORMAT, PlanDocument, SlotDocument};
use crate::planner::plan::SlotPlan;
use crate::planner::problem::Method;
use crate::planner::slots::{Plan, PlannedSlot, hex};
use crate::planner::{Near, Options, PlanError, plan_slot, plan_slot_near};
use crate::role::PerVehicle;
use crate::schedule::choice;
use crate::schedule::order::Order;
use crate::schedule::transit::Router;

/// A plan and what each slot's searches took.
#[derive(Debug, Clone)]
pub(crate) struct TimedPlan {
    pub plan: Plan,
    pub planning_time: Vec<Duration>,
    /// Of the search for a bound better than the cap: zero until [`certify_plan`] has run.
    pub bound_time: Vec<Duration>,
}

/// The planner has no answer for one user.
#[derive(Debug, thiserror::Error)]
#[error("no plan for user {user:?}: {error}")]
pub(crate) struct SlotError {
    user: String,
    error: PlanError,
}

/// Plans every slot of the mission.
pub(crate) fn plan_mission(mission: &Mission, options: &Options) -> Result<TimedPlan, SlotError> {
    let clock = Clock::real();
    let mut planning_time = Vec::new();
    let mut users = Vec::new();
    for (index, user) in mission.users.iter().enumerate() {
        let Some(problem) = mission.problem(index) else { continue };
        let started = clock.now();
        let plans = match mission.tdma.order {
            Order::Listed => plan_slot(&problem, options).map(|plan| vec![plan]),
            Order::Shortest => plan_slot_near(&problem, options, Near::default()),
        };
        let plans = plans.map_err(|error| SlotError { user: user.name.clone(), error })?;
        planning_time.push(clock.now().saturating_since(started));
        users.push((user.name.clone(), plans));
    }
    let chosen = choose(mission, &users);
    let slots = users.into_iter().zip(chosen).filter_map(|((user, mut plans), chosen)| {
        (chosen < plans.len()).then(|| PlannedSlot { user, plan: plans.swap_remove(chosen) })
    });
    let bound_time = vec![Duration::ZERO; planning_time.len()];
    Ok(TimedPlan { plan: Plan::new(slots.collect()), planning_time, bound_time })
}

/// Which of each user's plans is flown: the one that makes transits short, where the mission asks for that.
fn choose(mission: &Mission, users: &[(String, Vec<SlotPlan>)]) -> Vec<usize> {
    let poses: Vec<Vec<PerVehicle<Pose>>> = users
        .iter()
        .map(|(_, plans)| plans.iter().map(|plan| plan.vehicles.map(|vehicle| vehicle.pose)).collect())
        .collect();
    // An airspace in which nobody can be routed is refused when the slot table is made, with the reason.
    Router::new(&mission.airspace, &transit_limits(mission)).map_or_else(
        |_| vec![0; users.len()],
        |router| choice::shortest(&router, &poses, mission.tdma.superframes),
    )
}

/// Replaces each slot's bound by the best that a certificate's budget shows. Poses, powers and digest stay.
pub(crate) fn certify_plan(mission: &Mission, timed: &mut TimedPlan) -> Result<(), SlotError> {
    let clock = Clock::real();
    for (slot, time) in timed.plan.slots.iter_mut().zip(&mut timed.bound_time) {
        let Some(problem) = mission
            .users
            .iter()
            .position(|user| user.name == slot.user)
            .and_then(|index| mission.problem(index))
        else {
            continue;
        };
        let started = clock.now();
        let bound = best_bound(&problem, slot.plan.secrecy_rate_bps, Budget::of(&problem))
            .map_err(|error| SlotError { user: slot.user.clone(), error })?;
        *time = clock.now().saturating_since(started);
        slot.plan.upper_bound_bps = bound.upper_bound_bps;
        slot.plan.upper_bound_kind = bound.kind;
    }
    Ok(())
}

/// The options that the mission file asks for.
pub(crate) fn mission_options(mission: &Mission) -> Options {
    Options { method: mission.planner.method, seed: mission.seed, ..Options::default() }
}

/// The plan as a document.
pub(crate) fn document(mission: &Mission, options: &Options, timed: &TimedPlan) -> PlanDocument {
    let times = timed.planning_time.iter().zip(&timed.bound_time);
    let slots = timed.plan.slots.iter().zip(times);
    PlanDocument {
        format: FORMAT,
        mission_digest: mission.digest_hex(),
        plan_digest: hex(&timed.plan.digest),
        seed: options.seed,
        method: method_name(options.method).into(),
        slots: slots
            .map(|(slot, (planning, bound))| {
                let times_s = [planning, bound].map(Duration::as_secs_f64);
                slot_document(mission, &slot.user, &slot.plan, times_s)
            })
            .collect(),
    }
}

fn method_name(method: Method) -> &'static str {
    METHODS.iter().find(|(_, known)| *known == method).map_or("", |(name, _)| name)
}

/// One slot's document. `times_s`: of the search and of the bound.
pub(crate) fn slot_document(
    mission: &Mission,
    user: &str,
    slot: &SlotPlan,
    times_s: [f64; 2],
) -> SlotDocument {
    let names: Vec<String> = mission.eavesdroppers.iter().map(|e| e.name.clone()).collect();
    SlotDocument::new(user, &names, slot, times_s[0], times_s[1])
}
