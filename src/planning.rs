//! From a mission to its plan: the one road, for `fly`, `plan`, the simulation, tests and examples. Both companions make
//! the plan for themselves and compare digests, so whoever took another road would make another plan.

pub mod lean;
pub mod maps;
pub mod timetable;

use std::time::Duration;

use crate::config::{Mission, Optimise};
use crate::geo::Pose;
use crate::planner::plan::SlotPlan;
use crate::planner::problem::Problem;
use crate::planner::slots::{Plan, PlannedSlot};
use crate::planner::volume::{self, Fairness};
use crate::planner::{Near, Options, PlanError, plan_slot, plan_slot_near};
use crate::role::PerVehicle;
use crate::schedule::choice;
use crate::schedule::order::Order;
use crate::schedule::transit::Router;
use crate::schedule::ways;
use crate::time::Instant;

/// A plan and what each slot's search took, by user.
#[derive(Debug, Clone)]
pub struct Timed {
    /// The plan.
    pub plan: Plan,
    /// On the caller's clock.
    pub planning_time: Vec<Duration>,
}

/// The planner has no answer for one user.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("no plan for user {user:?}: {error}")]
pub struct PlanningError {
    /// The user's name.
    pub user: String,
    /// Why.
    #[source]
    pub error: PlanError,
}

/// The options that a mission asks for.
#[must_use]
pub fn options(mission: &Mission) -> Options {
    Options { method: mission.planner.method, seed: mission.seed, ..Options::default() }
}

/// The mission's plan: what both companions fly.
///
/// # Errors
/// [`PlanningError`] names the first user whose slot the planner cannot make sense of. A mission that was read or built
/// has been checked for that.
pub fn plan(mission: &Mission) -> Result<Plan, PlanningError> {
    plan_with(mission, &options(mission), || Instant::ZERO).map(|timed| timed.plan)
}

/// The same with other options than the mission's own; each slot's search is timed by `now`.
///
/// # Errors
/// As [`plan`].
pub fn plan_with(
    mission: &Mission,
    options: &Options,
    mut now: impl FnMut() -> Instant,
) -> Result<Timed, PlanningError> {
    if mission.planner.optimise == Optimise::Volume {
        return superframe(mission, options, now);
    }
    let mut planning_time = Vec::new();
    let (mut users, mut problems) = (Vec::new(), Vec::new());
    for (index, user) in mission.users.iter().enumerate() {
        let Some(problem) = mission.problem(index) else { continue };
        let started = now();
        let plans = match mission.tdma.order {
            Order::Listed => plan_slot(&problem, options).map(|plan| vec![plan]),
            Order::Shortest => plan_slot_near(&problem, options, Near::default()),
        };
        let plans = plans.map_err(|error| PlanningError { user: user.name.clone(), error })?;
        planning_time.push(now().saturating_since(started));
        users.push((user.name.clone(), plans));
        problems.push(problem);
    }
    let chosen = choose(mission, &users);
    let mut slots = Vec::new();
    for (((user, mut plans), chosen), problem) in users.into_iter().zip(chosen).zip(&problems) {
        if chosen >= plans.len() {
            continue;
        }
        let plan = plans.swap_remove(chosen);
        slots.push(planned(mission, user, plan, None, problem)?);
    }
    Ok(Timed { plan: Plan::new(slots), planning_time })
}

/// A slot that the planner has found.
fn planned(
    mission: &Mission,
    user: String,
    plan: SlotPlan,
    length: Option<Duration>,
    problem: &Problem,
) -> Result<PlannedSlot, PlanningError> {
    match lean::borne(problem, &plan.vehicles, mission.planner.target_rate_bps) {
        Ok(lean_rad) => Ok(PlannedSlot { user, plan, lean_rad, length }),
        Err(error) => Err(PlanningError { user, error }),
    }
}

/// All slots in one search, by what is delivered over a superframe. Each slot's time is its share of the search's.
fn superframe(
    mission: &Mission,
    options: &Options,
    mut now: impl FnMut() -> Instant,
) -> Result<Timed, PlanningError> {
    let of_first = |error| {
        let user = mission.users.first().map(|user| user.name.clone()).unwrap_or_default();
        PlanningError { user, error }
    };
    let problems: Vec<Problem> = (0..mission.users.len()).filter_map(|user| mission.problem(user)).collect();
    let air = &mission.airspace;
    // What the config checks refuse, and more: an area without an interior, limits that are none.
    let router = Router::new(air, &mission.transit_limits())
        .map_err(|_| of_first(PlanError::EmptyArea { vertices: air.area_enu_m.len() }))?;
    let service = mission.service();
    let started = now();
    let found = volume::plan(&problems, &service, &router, options).map_err(of_first)?;
    let took = now().saturating_since(started) / u32::try_from(problems.len().max(1)).unwrap_or(u32::MAX);
    let mut slots = Vec::new();
    let users = mission.users.iter().zip(&problems);
    for ((user, problem), (plan, slot_s)) in users.zip(found.slots.into_iter().zip(found.slots_s)) {
        let own = service.fairness == Fairness::MaxMin;
        let length = own.then(|| Duration::try_from_secs_f64(slot_s).unwrap_or_default());
        slots.push(planned(mission, user.name.clone(), plan, length, problem)?);
    }
    Ok(Timed { planning_time: vec![took; slots.len()], plan: Plan::new(slots) })
}

/// What a plan delivers in a superframe, and what that takes; per superframe that follows another.
#[derive(Debug, Clone, PartialEq)]
pub struct Delivered {
    /// Secret bits in all, by the plan's expectation.
    pub volume_bits: f64,
    /// Of the user who gets least.
    pub least_user_volume_bits: f64,
    /// Seconds in which I radiates.
    pub on_air_s: f64,
    /// The superframe's length in seconds; `None` where the slots cannot be flown one after the other.
    pub superframe_s: Option<f64>,
}

/// What a plan of this mission delivers.
#[must_use]
pub fn delivered(mission: &Mission, plan: &Plan) -> Delivered {
    let timing = mission.timing();
    let lengths = plan.lengths(timing.slot);
    let air_s = |length: &Duration| length.saturating_sub(timing.guard).as_secs_f64();
    let volumes: Vec<f64> = plan
        .slots
        .iter()
        .zip(&lengths)
        .map(|(slot, length)| air_s(length) * slot.plan.secrecy_rate_bps)
        .collect();
    let on_air = plan.slots.iter().zip(&lengths).filter(|(slot, _)| slot.plan.vehicles.i.tx_power_w > 0.0);
    let poses: Vec<PerVehicle<Pose>> =
        plan.slots.iter().map(|slot| slot.plan.vehicles.map(|vehicle| vehicle.pose)).collect();
    let superframe = Router::new(&mission.airspace, &mission.transit_limits())
        .ok()
        .and_then(|router| ways::superframe(&router, &poses, &lengths, &timing, mission.tdma.order).ok());
    Delivered {
        volume_bits: volumes.iter().sum(),
        least_user_volume_bits: volumes.iter().copied().reduce(f64::min).unwrap_or(0.0),
        on_air_s: on_air.map(|(_, length)| air_s(length)).sum(),
        superframe_s: superframe.map(|length| length.as_secs_f64()),
    }
}

/// Which of each user's plans is flown: the one that makes transits short, where the mission asks for that.
fn choose(mission: &Mission, users: &[(String, Vec<SlotPlan>)]) -> Vec<usize> {
    let poses: Vec<Vec<PerVehicle<Pose>>> = users
        .iter()
        .map(|(_, plans)| plans.iter().map(|plan| plan.vehicles.map(|vehicle| vehicle.pose)).collect())
        .collect();
    // An airspace in which nobody can be routed is refused when the slot table is made, with the reason.
    Router::new(&mission.airspace, &mission.transit_limits()).map_or_else(
        |_| vec![0; users.len()],
        |router| choice::shortest(&router, &poses, mission.tdma.superframes),
    )
}
