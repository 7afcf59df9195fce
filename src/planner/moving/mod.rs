//! Service while both vehicles move: a superframe as one periodic motion.
//!
//! A plan that turns ([`turning`]) serves users from positions that it does not leave, or flies from one pair of
//! positions to another in silence. Here a slot is a trajectory of both vehicles, positions, attitudes and J's power over time,
//! which begins where the last one ended. The superframe is a cycle: times on the air are those of the plan that turns, silences
//! as long as the turns in them, and each vehicle's way is one periodic cubic B-spline over all of it ([`Spline`]).
//!
//! ```text
//! maximise   sum over slots of the integral of R(p_I(t), axis_I(t), p_J(t), axis_J(t), P_J(t)) dt / T,      (MODEL 9.4)
//! ```
//!
//! (the least user's integral with [`Fairness::MaxMin`](super::volume::Fairness)) over control points, attitudes at knots, and
//! powers between them, within the area, the band, no-fly areas, the separation, and the limits of speed, climb, acceleration,
//! its change, tilt and rates of turning.
//!
//! 1. *Starts* (`starts`): the poses of the plan that turns, which is the way whose control points are all one; parts of
//!    the way to each user's best poses; random ones. In the order of the plan that turns and, where users may be served in any
//!    order, round the shortest tour over them.
//! 2. *Search* (`objective`, `frame`): quasi-Newton within bounds from each on few samples, from the best few on more, which a
//!    slot's nodes take in turns; limits as penalties, at 95% of each.
//! 3. *What is flown* (`flown`): limits met exactly, and verified on the curves.
//! 4. Nothing moves for less than [`WORTH_MOVING`]: then the plan is the one that turns.
//!
//! A vehicle stays in the convex cell of the airspace in which the plan that turns has it, and one that is level when it hovers
//! stays where it is, since it leans to move. How a motion is entered from rest and left to rest: `rest`. Deterministic, like all
//! plans, whatever the number of threads.

mod flown;
mod frame;
mod limits;
mod objective;
mod rest;
pub(super) mod spline;
mod starts;
#[cfg(test)]
mod tests;

pub(super) use frame::null;
pub use limits::Limits;
pub(super) use objective::{NODES, hinge};
pub use rest::{Passage, Passing};
pub use spline::{Demand, Instant, Spline};

use super::error::PlanError;
use super::expectation::kernel::Raw;
use super::model::Memory;
use super::plan::SlotPlan;
use super::problem::Problem;
use super::search as slot_search;
use super::setup::Setup;
use super::solver::boxed::Descent;
use super::solver::limited::Settings;
use super::turning::{self, Joint, Protected};
use super::volume::objective::{COARSE, Case, MEDIUM, ROUGH, View};
use super::volume::{self, Fairness, Service, Ways};
use super::{Found, Options, finish, parallel};
use crate::geo::{Attitude, Enu, EnuAcceleration, EnuVelocity};
use crate::role::{PerVehicle, Role};
use flown::{Flown, Maker};
use frame::Frame;
use objective::{Look, Objective};

/// What a motion must gain over the plan that turns, as a part of it.
pub const WORTH_MOVING: f64 = 0.01;
/// A part of the search: one function, climbed in heats.
struct Phase {
    /// On which samples; and where more is random than jitter, of whose samples each costs twice as much and more, on as many of those.
    views: [View; 2],
    /// Of whose samples each node takes one of so many parts.
    turns: usize,
    /// What a limit counts.
    stiffness: f64,
    settings: Settings,
    /// How many go into each heat, the best so far, and for how many iterations.
    heats: [(usize, usize); 2],
}

const fn phase(
    (views, turns): ([View; 2], usize),
    stiffness: f64,
    (tolerance, first_step): (f64, f64),
    heats: [(usize, usize); 2],
) -> Phase {
    Phase { views, turns, stiffness, settings: Settings { iterations: 0, tolerance, first_step }, heats }
}

/// Few steps from all starts, and ever more from ever fewer.
const PHASES: [Phase; 3] = [
    phase(([COARSE, ROUGH], 4), 30.0, (1e-4, 0.5), [(usize::MAX, 30), (8, 30)]),
    phase(([COARSE, ROUGH], 4), 100.0, (1e-5, 0.3), [(4, 100), (2, 100)]),
    phase(([MEDIUM, COARSE], 2), 300.0, (1e-6, 0.2), [(2, 200), (1, 250)]),
];
/// How many of the last that are given up are kept: they may still be what can be flown.
const SPARE: usize = 3;
/// Of the largest angle that a turn may have, the part that is turned on the air on either side of the silence.
const TURNED_ON_AIR: f64 = 0.5;

/// A superframe's motion.
#[derive(Debug, Clone, PartialEq)]
pub struct Moving {
    /// Slots, silences and knots. A knot's positions are those of the ways at its instant.
    pub protected: Protected,
    /// Each vehicle's way; its period is the superframe.
    pub ways: PerVehicle<Spline>,
}

/// The pair at an instant of its motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct State {
    /// Positions in metres, ENU.
    pub positions_enu_m: PerVehicle<Enu>,
    /// Velocities in m/s, ENU.
    pub velocities_enu_m_s: PerVehicle<EnuVelocity>,
    /// Accelerations in m/s^2, ENU.
    pub accelerations_enu_m_s2: PerVehicle<EnuAcceleration>,
    /// Attitudes.
    pub attitudes: PerVehicle<Attitude>,
    /// Powers in W.
    pub tx_powers_w: PerVehicle<f64>,
    /// Who is served.
    pub served: Option<usize>,
}

impl Moving {
    /// The pair so many seconds after the beginning of the first slot's service, in any superframe; `None` of a plan without
    /// slots.
    #[must_use]
    pub fn at(&self, t_s: f64) -> Option<State> {
        let turned = self.protected.at(t_s)?;
        let PerVehicle { i, j } = &self.ways;
        let (i, j) = (i.at(t_s), j.at(t_s));
        Some(State {
            positions_enu_m: PerVehicle { i: i.position_enu_m, j: j.position_enu_m },
            velocities_enu_m_s: PerVehicle { i: i.velocity_enu_m_s, j: j.velocity_enu_m_s },
            accelerations_enu_m_s2: PerVehicle { i: i.acceleration_enu_m_s2, j: j.acceleration_enu_m_s2 },
            attitudes: turned.attitudes,
            tx_powers_w: turned.tx_powers_w,
            served: turned.served,
        })
    }
}

/// A plan of a superframe.
#[derive(Debug, Clone, PartialEq)]
pub struct Planned {
    /// By user, as listed: of a motion the poses in the middle of its slot.
    pub slots: Vec<SlotPlan>,
    /// The length of each one's slot in seconds, the guard included.
    pub slots_s: Vec<f64>,
    /// What is flown.
    pub flight: Flight,
}

/// What is flown.
#[derive(Debug, Clone, PartialEq)]
pub enum Flight {
    /// The plan that turns: no motion is worth it.
    Turning(Protected),
    /// A motion.
    Moving(Moving),
}

impl Flight {
    /// Slots, silences and knots.
    #[must_use]
    pub fn protected(&self) -> &Protected {
        match self {
            Self::Turning(protected) => protected,
            Self::Moving(moving) => &moving.protected,
        }
    }
}

/// Plans poses, turns and motion. `share` is the part of the rate by which the tolerances of knots are measured; none are where it
/// is not given.
///
/// # Errors
/// As [`turning::plan`].
pub fn plan(
    problems: &[Problem],
    service: &Service,
    ways: &impl Ways,
    limits: &PerVehicle<Limits>,
    options: &Options,
    share: Option<f64>,
) -> Result<Planned, PlanError> {
    let joint = turning::plan(problems, service, ways, options, share)?;
    beyond(problems, joint, service, ways, limits, options, share)
}

/// The same from a plan that turns.
///
/// # Errors
/// [`PlanError`] for a problem without meaning.
pub fn beyond(
    problems: &[Problem],
    joint: Joint,
    service: &Service,
    ways: &impl Ways,
    limits: &PerVehicle<Limits>,
    options: &Options,
    share: Option<f64>,
) -> Result<Planned, PlanError> {
    let setups: Vec<Setup> = problems.iter().map(Setup::new).collect::<Result<_, _>>()?;
    let stays = |joint: Joint| Planned {
        slots: joint.slots,
        slots_s: joint.slots_s,
        flight: Flight::Turning(joint.protected),
    };
    // Nobody is nearer to one user alone.
    if joint.protected.slots.len() < 2 {
        return Ok(stays(joint));
    }
    let limits = [limits.i, limits.j];
    let case = Case {
        setups: &setups,
        samples: parallel::map(options.threads, setups.len(), |(): &mut (), user| {
            volume::samples(&setups[user], options)
        }),
        service,
        ways,
        counts: vec![true; setups.len()],
    };
    let standing: Vec<Raw> = joint.slots.iter().map(|slot| Setup::raw(&slot.vehicles)).collect();
    let frames = frames(&case, &joint.protected, &standing);
    let Some((index, mut flown)) = best(&case, &frames, &limits, &standing, options) else {
        return Ok(stays(joint));
    };
    if !(flown.worth >= (1.0 + WORTH_MOVING) * worth(&joint.protected, problems, service)) {
        return Ok(stays(joint));
    }
    let frame = &frames[index];
    if let Some(share) = share {
        let maker = Maker { case: &case, frame, limits, guard_s: service.guard_s };
        maker.add_tolerances(&mut flown, share, options.threads);
    }
    let mut slots = joint.slots;
    for slot in &flown.protected.slots {
        // Whom nobody serves keeps what the plan that turns says of it.
        let middle_s = 0.5 * slot.on_air_s;
        let begins_s = slot.knots.first().map_or(0.0, |knot| knot.at_s);
        let middle = slot.knots.iter().take_while(|knot| knot.at_s - begins_s <= middle_s).last();
        if let Some(knot) = middle.filter(|knot| knot.served.is_some()) {
            let found = Found { raw: Setup::raw(&knot.vehicles), converged: true };
            slots[slot.user] = finish(&setups[slot.user], options, found);
        }
    }
    let [i, j] = flown.ways;
    let moving = Moving { protected: flown.protected, ways: PerVehicle { i, j } };
    Ok(Planned { slots, slots_s: joint.slots_s, flight: Flight::Moving(moving) })
}

/// What counts of a plan for each second, nats per hertz and second.
fn worth(plan: &Protected, problems: &[Problem], service: &Service) -> f64 {
    let volumes = plan
        .slots
        .iter()
        .map(|slot| slot.volume_bits * std::f64::consts::LN_2 / problems[slot.user].radio.bandwidth_hz);
    let counted = match service.fairness {
        Fairness::Slots => volumes.sum::<f64>(),
        Fairness::MaxMin => {
            let served = volumes.filter(|volume| *volume > 0.0);
            served.reduce(f64::min).unwrap_or(0.0)
        }
    };
    counted / plan.superframe_s
}

/// The superframe in the orders that are tried.
fn frames<'a, W: Ways>(case: &Case<'a, W>, turning: &Protected, standing: &[Raw]) -> Vec<Frame<'a>> {
    let own: Vec<usize> = turning.slots.iter().map(|slot| slot.user).collect();
    let rate = Role::BOTH.iter().map(|role| case.ways.turn_rate_rad_s(*role)).fold(f64::INFINITY, f64::min);
    let times = (TURNED_ON_AIR * std::f64::consts::FRAC_PI_2 / rate, case.service.guard_s);
    let mut orders = vec![own];
    let n = orders[0].len();
    if case.service.may_reorder && n >= 4 && n == case.setups.len() {
        let user = |user: usize| case.setups[user].problem.user_enu_m;
        let between: Vec<f64> = (0..n * n).map(|k| (user(k / n) - user(k % n)).norm()).collect();
        let tour = case.ways.shortest(n, &between);
        // A cycle is the same from wherever it begins.
        let at = orders[0].iter().position(|user| *user == tour[0]).unwrap_or(0);
        if (0..n).any(|k| orders[0][(at + k) % n] != tour[k]) {
            orders.push(tour);
        }
    }
    orders.iter().map(|order| Frame::new(case.setups, turning, standing, order, times)).collect()
}

/// The best motion that is found, and in which frame.
fn best<W: Ways>(
    case: &Case<'_, W>,
    frames: &[Frame<'_>],
    limits: &[Limits; 2],
    standing: &[Raw],
    options: &Options,
) -> Option<(usize, Flown)> {
    let own = parallel::map(options.threads, case.setups.len(), |(): &mut (), user| {
        let found = slot_search::rough(&case.setups[user], options);
        found.first().map_or(standing[user], |plan| plan.raw)
    });
    let mut at: Vec<(usize, Vec<f64>)> = Vec::new();
    for (index, frame) in frames.iter().enumerate() {
        at.extend(starts::all(case, frame, limits, &own, options.seed).into_iter().map(|x| (index, x)));
    }
    let objectives: Vec<Objective<'_, '_, W>> =
        frames.iter().map(|frame| Objective::new(case, frame, *limits)).collect();
    let bounds: Vec<Vec<[f64; 2]>> = frames.iter().map(Frame::bounds).collect();
    let errs = usize::from(case.setups.iter().any(Setup::heeds_uncertainty));
    let mut given_up = Vec::new();
    for phase in &PHASES {
        let look = Look::new(case, phase.views[errs], phase.turns, phase.stiffness);
        let mut climbing: Vec<(usize, Descent)> =
            at.into_iter().map(|(index, x)| (index, Descent::new(&bounds[index], &x))).collect();
        for (of, iterations) in phase.heats {
            given_up.extend(climbing.split_off(of.min(climbing.len())));
            let settings = Settings { iterations, ..phase.settings };
            climbing = parallel::map(options.threads, climbing.len(), |memory: &mut Memory, k| {
                let (index, mut descent) = climbing[k].clone();
                let mut cost =
                    |x: &[f64], gradient: &mut [f64]| objectives[index].cost(x, &look, memory, gradient);
                descent.go_on(&mut cost, &bounds[index], &settings);
                (index, descent)
            });
            climbing.retain(|(_, descent)| descent.value.is_finite());
            climbing.sort_by(|(_, a), (_, b)| a.value.total_cmp(&b.value));
        }
        at = climbing.into_iter().map(|(index, descent)| (index, descent.x)).collect();
    }
    let spare = given_up.split_off(given_up.len().saturating_sub(SPARE));
    at.extend(spare.into_iter().map(|(index, descent)| (index, descent.x)));
    let made = parallel::map(options.threads, at.len(), |memory: &mut Memory, k| {
        let (index, x) = &at[k];
        let maker = Maker { case, frame: &frames[*index], limits: *limits, guard_s: case.service.guard_s };
        maker.flown(x, memory).map(|flown| (*index, flown))
    });
    let mut best: Option<(usize, Flown)> = None;
    for (index, flown) in made.into_iter().flatten() {
        if best.as_ref().is_none_or(|(_, known)| flown.worth > known.worth) {
            best = Some((index, flown));
        }
    }
    best
}
