//! The plan of a mission with the times it took, and as a document: what `plan`, `campaign` and `sitl` share.

use std::time::Duration;

use crate::config::{METHODS, Mission};
use crate::link::clock::Clock;
use crate::planner::Options;
use crate::planner::bound::{Budget, best_bound};
use crate::planner::document::{FORMAT, PlanDocument, SlotDocument};
use crate::planner::plan::SlotPlan;
use crate::planner::problem::Method;
use crate::planner::slots::{Plan, hex};
use crate::planning::{self, PlanningError};

/// A plan and what each slot's searches took.
#[derive(Debug, Clone)]
pub(crate) struct TimedPlan {
    pub plan: Plan,
    pub planning_time: Vec<Duration>,
    /// Of the search for a bound better than the cap: zero until [`certify_plan`] has run.
    pub bound_time: Vec<Duration>,
}

/// Plans every slot of the mission.
pub(crate) fn plan_mission(mission: &Mission, options: &Options) -> Result<TimedPlan, PlanningError> {
    let clock = Clock::real();
    let planning::Timed { plan, planning_time } = planning::plan_with(mission, options, || clock.now())?;
    let bound_time = vec![Duration::ZERO; planning_time.len()];
    Ok(TimedPlan { plan, planning_time, bound_time })
}

/// Replaces each slot's bound by the best that a certificate's budget shows. Poses, powers and digest stay.
pub(crate) fn certify_plan(mission: &Mission, timed: &mut TimedPlan) -> Result<(), PlanningError> {
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
            .map_err(|error| PlanningError { user: slot.user.clone(), error })?;
        *time = clock.now().saturating_since(started);
        slot.plan.upper_bound_bps = bound.upper_bound_bps;
        slot.plan.upper_bound_kind = bound.kind;
    }
    Ok(())
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
