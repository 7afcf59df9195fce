//! The plan of a mission with the times it took, and as a document: what `plan`, `campaign` and `sitl` share.

use std::time::Duration;

use crate::config::{METHODS, Mission};
use crate::link::clock::Clock;
use crate::planner::assessment::{Assessment, assess};
use crate::planner::bound::{Budget, best_bound};
use crate::planner::document::{FORMAT, MotionDocument, PlanDocument, SlotDocument, TurningDocument};
use crate::planner::explanation::{Explanation, explain, unprotected};
use crate::planner::problem::{Method, Problem};
use crate::planner::slots::{Plan, PlannedSlot, hex};
use crate::planner::{EvaluateOptions, Options};
use crate::planning::{self, PlanningError};
use crate::service::Tolerance;

use super::progress::Progress;

/// Samples by which a plan is assessed.
const ASSESSED_SAMPLES: usize = 16_384;

/// A plan and what each slot's searches took.
#[derive(Debug, Clone)]
pub(crate) struct TimedPlan {
    pub plan: Plan,
    pub planning_time: Vec<Duration>,
    /// Of the search for a bound better than the cap: zero until [`certify_plan`] has run.
    pub bound_time: Vec<Duration>,
    /// What each slot's rate leaves out.
    pub assessments: Vec<Assessment>,
    /// Why each slot's rate is what it is.
    pub explanations: Vec<Explanation>,
    /// Of each slot, the rate of the best plan in which J is silent, bit/s: none until [`add_unprotected`] has run.
    pub best_unprotected_bps: Vec<Option<f64>>,
}

/// Plans every slot of the mission.
pub(crate) fn plan_mission(mission: &Mission, options: &Options) -> Result<TimedPlan, PlanningError> {
    let clock = Clock::real();
    assessed(mission, options, planning::plan_with(mission, options, || clock.now())?)
}

/// A plan with what each slot's rate leaves out.
pub(crate) fn assessed(
    mission: &Mission,
    options: &Options,
    timed: planning::Timed,
) -> Result<TimedPlan, PlanningError> {
    let planning::Timed { plan, planning_time } = timed;
    let bound_time = vec![Duration::ZERO; planning_time.len()];
    let score =
        EvaluateOptions { samples: ASSESSED_SAMPLES, seed: options.seed, ..EvaluateOptions::default() };
    let (mut assessments, mut explanations) = (Vec::new(), Vec::new());
    for slot in &plan.slots {
        let Some(problem) = problem_of(mission, &slot.user) else { continue };
        let failed = |error| PlanningError { user: slot.user.clone(), error };
        let vehicles = &slot.plan.vehicles;
        let target_bps = mission.planner.target_rate_bps;
        assessments.push(assess(&problem, vehicles, target_bps, &score).map_err(failed)?);
        explanations.push(explain(&problem, vehicles, &score).map_err(failed)?);
    }
    let best_unprotected_bps = vec![None; explanations.len()];
    Ok(TimedPlan { plan, planning_time, bound_time, assessments, explanations, best_unprotected_bps })
}

/// Plans every slot once more with J silent, and keeps the rates: what jamming is to be compared with.
pub(crate) fn add_unprotected(
    mission: &Mission,
    options: &Options,
    timed: &mut TimedPlan,
) -> Result<(), PlanningError> {
    for (slot, best_bps) in timed.plan.slots.iter().zip(&mut timed.best_unprotected_bps) {
        let Some(problem) = problem_of(mission, &slot.user) else { continue };
        let plan = unprotected(&problem, options)
            .map_err(|error| PlanningError { user: slot.user.clone(), error })?;
        *best_bps = Some(plan.secrecy_rate_bps);
    }
    Ok(())
}

/// What the planner is asked for a user, by name.
fn problem_of(mission: &Mission, user: &str) -> Option<Problem> {
    let index = mission.users.iter().position(|known| known.name == user)?;
    mission.problem(index)
}

/// Replaces each slot's bound by the best that a certificate's budget shows. Poses, powers and digest stay.
pub(crate) fn certify_plan(mission: &Mission, timed: &mut TimedPlan) -> Result<(), PlanningError> {
    let clock = Clock::real();
    let progress = Progress::new("slots certified", timed.plan.slots.len() as u64);
    for (slot, time) in timed.plan.slots.iter_mut().zip(&mut timed.bound_time) {
        let Some(problem) = problem_of(mission, &slot.user) else { continue };
        let started = clock.now();
        let bound = best_bound(&problem, slot.plan.secrecy_rate_bps, Budget::of(&problem))
            .map_err(|error| PlanningError { user: slot.user.clone(), error })?;
        *time = clock.now().saturating_since(started);
        slot.plan.upper_bound_bps = bound.upper_bound_bps;
        slot.plan.upper_bound_kind = bound.kind;
        progress.step();
    }
    Ok(())
}

/// The plan as a document.
pub(crate) fn document(mission: &Mission, options: &Options, timed: &TimedPlan) -> PlanDocument {
    let times = timed.planning_time.iter().zip(&timed.bound_time);
    let slots = timed.plan.slots.iter().zip(times);
    let slots = slots.zip(timed.assessments.iter().zip(&timed.explanations)).zip(&timed.best_unprotected_bps);
    let slots = slots
        .map(|(((slot, (planning, bound)), why), best_unprotected_rate_bps)| {
            let times_s = [planning, bound].map(Duration::as_secs_f64);
            let best_unprotected_rate_bps = *best_unprotected_rate_bps;
            SlotDocument { best_unprotected_rate_bps, ..slot_document(mission, slot, why, times_s) }
        })
        .collect();
    plan_document(mission, options.seed, method_name(options.method), &timed.plan, slots)
}

/// A plan's document around those of its slots.
pub(crate) fn plan_document(
    mission: &Mission,
    seed: u64,
    method: &str,
    plan: &Plan,
    mut slots: Vec<SlotDocument>,
) -> PlanDocument {
    let delivered = planning::delivered(mission, plan);
    let users: Vec<&str> = mission.users.iter().map(|user| user.name.as_str()).collect();
    for turn in plan.turns.iter().flat_map(|turns| &turns.slots) {
        if let Some(slot) = slots.get_mut(turn.user) {
            slot.turning = Some(TurningDocument::new(turn, &users));
        }
    }
    PlanDocument {
        format: FORMAT,
        mission_digest: mission.digest_hex(),
        plan_digest: hex(&plan.digest),
        seed,
        method: method.into(),
        secrecy_volume_bits: delivered.volume_bits,
        superframe_s: delivered.superframe_s,
        on_air_s: delivered.on_air_s,
        least_user_volume_bits: delivered.least_user_volume_bits,
        slots,
        motion: plan.ways.as_ref().map(MotionDocument::new),
    }
}

fn method_name(method: Method) -> &'static str {
    METHODS.iter().find(|(_, known)| *known == method).map_or("", |(name, _)| name)
}

/// One slot's document. `times_s`: of the search and of the bound.
pub(crate) fn slot_document(
    mission: &Mission,
    slot: &PlannedSlot,
    why: (&Assessment, &Explanation),
    times_s: [f64; 2],
) -> SlotDocument {
    let names: Vec<String> = mission.eavesdroppers.iter().map(|e| e.name.clone()).collect();
    let held = Tolerance::for_jitter(mission.jitter.std_rad);
    let tolerance_deg =
        slot.lean_rad.map(|lean_rad| held.leaning(lean_rad.unwrap_or_default()).attitude_rad.to_degrees());
    let slot_s = slot.length.map_or(mission.tdma.slot_s, |length| length.as_secs_f64());
    SlotDocument::new(&slot.user, &names, &slot.plan, why, tolerance_deg, slot_s, times_s)
}
