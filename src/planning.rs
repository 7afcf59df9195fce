//! From a mission to its plan: the one road, for `fly`, `plan`, the simulation, tests and examples. Both companions make
//! the plan for themselves and compare digests, so whoever took another road would make another plan.

pub mod lean;
pub mod maps;
pub mod timetable;

use std::time::Duration;

use crate::config::{Mission, Mode, Optimise};
use crate::geo::Pose;
use crate::planner::moving::{self, Flight};
use crate::planner::plan::SlotPlan;
use crate::planner::problem::Problem;
use crate::planner::slots::{Plan, PlannedSlot};
use crate::planner::turning::{self, Standing, TOLERATED};
use crate::planner::volume::{self, Fairness, Service};
use crate::planner::{Near, Options, PlanError, plan_slot, plan_slot_near};
use crate::role::{PerVehicle, Role};
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
    let timed = match (mission.planner.optimise, mission.planner.mode) {
        (Optimise::Rate, _) => each_by_itself(mission, options, &mut now)?,
        (Optimise::Volume, Mode::Static) => return superframe(mission, options, &mut now),
        (Optimise::Volume, Mode::Turning) => return turning_superframe(mission, options, &mut now),
        (Optimise::Volume, Mode::Moving) => return moving_superframe(mission, options, &mut now),
    };
    match mission.planner.mode {
        Mode::Static => Ok(timed),
        // Slots by themselves are far from each other: there is no motion to begin with.
        Mode::Turning | Mode::Moving => through(mission, options, timed, &mut now),
    }
}

/// The mission's plan once more, for what was measured in flight: another jitter, in radians, and shares of the speeds that ways and
/// motions may count on. Its users are served in this order, each of them once.
#[must_use]
pub fn again(mission: &Mission, jitter_rad: f64, shares: &PerVehicle<f64>, order: &[usize]) -> Option<Plan> {
    let listed = mission.users.len();
    let mission = mission.changed(|draft| {
        draft.jitter.std_deg = jitter_rad.to_degrees();
        for role in Role::BOTH {
            draft.vehicles[role].speed_m_s *= shares[role];
        }
        draft.tdma.order = Order::Listed;
        draft.users = order.iter().filter_map(|&user| draft.users.get(user).cloned()).collect();
    });
    let mission = mission.ok().filter(|again| again.users.len() == listed)?;
    plan(&mission).ok()?.relisted(order)
}

/// Every slot by itself, wherever its best poses are.
fn each_by_itself(
    mission: &Mission,
    options: &Options,
    now: &mut impl FnMut() -> Instant,
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

/// What a search for all slots together is given.
struct Together {
    problems: Vec<Problem>,
    service: Service,
    router: Router,
}

impl Together {
    fn of(mission: &Mission) -> Result<Self, PlanningError> {
        let problems = (0..mission.users.len()).filter_map(|user| mission.problem(user)).collect();
        let air = &mission.airspace;
        // What the config checks refuse, and more: an area without an interior, limits that are none.
        let router = Router::new(air, &mission.transit_limits())
            .map_err(|_| of_first(mission, PlanError::EmptyArea { vertices: air.area_enu_m.len() }))?;
        Ok(Self { problems, service: mission.service(), router })
    }

    /// The slots that it found. Each one's time is its share of the search's.
    fn slots(
        &self,
        mission: &Mission,
        (plans, slots_s): (Vec<SlotPlan>, Vec<f64>),
        took: Duration,
    ) -> Result<(Vec<PlannedSlot>, Vec<Duration>), PlanningError> {
        let own = self.service.fairness == Fairness::MaxMin;
        let slots = mission.users.iter().zip(&self.problems).zip(plans.into_iter().zip(slots_s));
        let slots: Vec<_> = slots
            .map(|((user, problem), (plan, slot_s))| {
                let length = own.then(|| Duration::try_from_secs_f64(slot_s).unwrap_or_default());
                planned(mission, user.name.clone(), plan, length, problem)
            })
            .collect::<Result<_, _>>()?;
        let times = vec![took / u32::try_from(slots.len().max(1)).unwrap_or(u32::MAX); slots.len()];
        Ok((slots, times))
    }
}

/// What is wrong with a search for all users is said of the first.
fn of_first(mission: &Mission, error: PlanError) -> PlanningError {
    let user = mission.users.first().map(|user| user.name.clone()).unwrap_or_default();
    PlanningError { user, error }
}

/// All slots in one search, by what is delivered over a superframe.
fn superframe(
    mission: &Mission,
    options: &Options,
    now: &mut impl FnMut() -> Instant,
) -> Result<Timed, PlanningError> {
    let all = Together::of(mission)?;
    let started = now();
    let found = volume::plan(&all.problems, &all.service, &all.router, options);
    let found = found.map_err(|error| of_first(mission, error))?;
    let took = now().saturating_since(started);
    let (slots, planning_time) = all.slots(mission, (found.slots, found.slots_s), took)?;
    Ok(Timed { planning_time, plan: Plan::new(slots) })
}

/// The same with the pair on the air while it turns.
fn turning_superframe(
    mission: &Mission,
    options: &Options,
    now: &mut impl FnMut() -> Instant,
) -> Result<Timed, PlanningError> {
    let all = Together::of(mission)?;
    let started = now();
    let found = turning::plan(&all.problems, &all.service, &all.router, options, Some(TOLERATED));
    let found = found.map_err(|error| of_first(mission, error))?;
    let took = now().saturating_since(started);
    let (slots, planning_time) = all.slots(mission, (found.slots, found.slots_s), took)?;
    Ok(Timed { planning_time, plan: Plan::turning(slots, found.protected) })
}

/// The same with the pair in motion while it is on the air, where that gains anything.
fn moving_superframe(
    mission: &Mission,
    options: &Options,
    now: &mut impl FnMut() -> Instant,
) -> Result<Timed, PlanningError> {
    let all = Together::of(mission)?;
    let limits = mission.transit_limits().map(|limits| limits.of_motion());
    let started = now();
    let found = moving::plan(&all.problems, &all.service, &all.router, &limits, options, Some(TOLERATED));
    let found = found.map_err(|error| of_first(mission, error))?;
    let took = now().saturating_since(started);
    let (slots, planning_time) = all.slots(mission, (found.slots, found.slots_s), took)?;
    let plan = match found.flight {
        Flight::Turning(turns) => Plan::turning(slots, turns),
        Flight::Moving(moving) => Plan::moving(slots, moving),
    };
    Ok(Timed { planning_time, plan })
}

/// Gives slots that were planned by themselves their turns.
fn through(
    mission: &Mission,
    options: &Options,
    timed: Timed,
    now: &mut impl FnMut() -> Instant,
) -> Result<Timed, PlanningError> {
    let Timed { plan, mut planning_time } = timed;
    let all = Together::of(mission)?;
    let started = now();
    let vehicles: Vec<_> = plan.slots.iter().map(|slot| slot.plan.vehicles).collect();
    let slots_s = vec![mission.tdma.slot_s; vehicles.len()];
    let standing = Standing { vehicles: &vehicles, slots_s: &slots_s, order: None };
    let turns =
        turning::through(&all.problems, &standing, &all.service, &all.router, options, Some(TOLERATED));
    let turns = turns.map_err(|error| of_first(mission, error))?;
    let share = now().saturating_since(started) / u32::try_from(vehicles.len().max(1)).unwrap_or(u32::MAX);
    planning_time.iter_mut().for_each(|time| *time += share);
    Ok(Timed { planning_time, plan: Plan::turning(plan.slots, turns) })
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
    if let Some(turns) = &plan.turns {
        return Delivered {
            volume_bits: turns.volume_bits(),
            least_user_volume_bits: turns.least_user_volume_bits(),
            on_air_s: turns.share_on_air() * turns.superframe_s,
            superframe_s: Some(turns.superframe_s),
        };
    }
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
