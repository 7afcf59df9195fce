//! Planning a whole mission, with the time each slot took: what `plan`, `fly` and `sitl` share.

use std::time::Duration;

use crate::config::{METHODS, Mission};
use crate::link::clock::Clock;
use crate::planner::plan::SlotPlan;
use crate::planner::problem::Method;
use crate::planner::slots::{Plan, PlannedSlot, hex};
use crate::planner::{Options, PlanError, plan_slot};
use crate::report::plan_document::{FORMAT, PlanDocument, SlotDocument};
use crate::role::PerVehicle;
use crate::schedule::table::Timing;
use crate::schedule::trajectory::Limits;

/// A plan and what each slot's search took.
#[derive(Debug, Clone)]
pub(crate) struct TimedPlan {
    pub plan: Plan,
    pub planning_time: Vec<Duration>,
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
    let mut slots = Vec::new();
    for (index, user) in mission.users.iter().enumerate() {
        let Some(problem) = mission.problem(index) else { continue };
        let started = clock.now();
        let plan =
            plan_slot(&problem, options).map_err(|error| SlotError { user: user.name.clone(), error })?;
        planning_time.push(clock.now().saturating_since(started));
        slots.push(PlannedSlot { user: user.name.clone(), plan });
    }
    Ok(TimedPlan { plan: Plan::new(slots), planning_time })
}

/// The options that the mission file asks for.
pub(crate) fn mission_options(mission: &Mission) -> Options {
    Options { method: mission.planner.method, seed: mission.seed, ..Options::default() }
}

/// What the slot table demands of each vehicle.
pub(crate) fn transit_limits(mission: &Mission) -> PerVehicle<Limits> {
    PerVehicle::from_fn(|role| {
        let vehicle = &mission.vehicles[role];
        Limits {
            acceleration_m_s2: vehicle.acceleration_m_s2,
            ..Limits::new(vehicle.speed_m_s, vehicle.climb_m_s, vehicle.tilt_rate_rad_s)
        }
    })
}

/// Lengths of slots and number of superframes.
pub(crate) fn timing(mission: &Mission) -> Timing {
    let tdma = &mission.tdma;
    let seconds = Duration::from_secs_f64;
    let timing = Timing::new(seconds(tdma.slot_s), seconds(tdma.guard_s), tdma.superframes);
    Timing { settle: seconds(tdma.settle_s), ..timing }
}

/// The plan as a document.
pub(crate) fn document(mission: &Mission, options: &Options, timed: &TimedPlan) -> PlanDocument {
    let slots = timed.plan.slots.iter().zip(&timed.planning_time);
    PlanDocument {
        format: FORMAT,
        mission_digest: mission.digest_hex(),
        plan_digest: hex(&timed.plan.digest),
        seed: options.seed,
        method: method_name(options.method).into(),
        slots: slots
            .map(|(slot, time)| slot_document(mission, &slot.user, &slot.plan, time.as_secs_f64()))
            .collect(),
    }
}

fn method_name(method: Method) -> &'static str {
    METHODS.iter().find(|(_, known)| *known == method).map_or("", |(name, _)| name)
}

/// One slot's document.
pub(crate) fn slot_document(
    mission: &Mission,
    user: &str,
    slot: &SlotPlan,
    planning_time_s: f64,
) -> SlotDocument {
    let names: Vec<String> = mission.eavesdroppers.iter().map(|e| e.name.clone()).collect();
    SlotDocument::new(user, &names, slot, planning_time_s, 0.0)
}
