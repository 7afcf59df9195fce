//! From a mission to its plan: the one road, for `fly`, `plan`, the simulation, tests and examples. Both companions make
//! the plan for themselves and compare digests, so whoever took another road would make another plan.

pub mod lean;
pub mod maps;
pub mod timetable;

use std::time::Duration;

use crate::config::Mission;
use crate::geo::Pose;
use crate::planner::plan::SlotPlan;
use crate::planner::slots::{Plan, PlannedSlot};
use crate::planner::{Near, Options, PlanError, plan_slot, plan_slot_near};
use crate::role::PerVehicle;
use crate::schedule::choice;
use crate::schedule::order::Order;
use crate::schedule::transit::Router;
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
        match lean::borne(problem, &plan.vehicles, mission.planner.target_rate_bps) {
            Ok(lean_rad) => slots.push(PlannedSlot { user, plan, lean_rad }),
            Err(error) => return Err(PlanningError { user, error }),
        }
    }
    Ok(Timed { plan: Plan::new(slots), planning_time })
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
