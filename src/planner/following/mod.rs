//! Following what moves: a slot's motion from now on, made anew again and again.
//!
//! Users and eavesdroppers move. What is reported of them is filtered ([`Estimate`]); the pair's motion over the next
//! [`HORIZON_S`] seconds is planned for where they are believed to be then ([`Foresight`]), begins with the position, velocity and
//! acceleration, the attitudes and the power that the last one has at that instant, and rests at its end, so that it can be flown
//! to its end whatever becomes of the next.
//!
//! ```text
//! maximise   the mean over the horizon of  w(t) R(p_I(t), axis_I(t), p_J(t), axis_J(t), P_J(t); beliefs of t),    (MODEL 9.5)
//! ```
//!
//! over control points of one cubic B-spline a vehicle, attitudes and J's power at knots; w falls off towards the end, where the
//! motion only comes to rest. J's attitude is its null on the user's foreseen place and what is beside that, so that between knots
//! the null follows the user; where the user is foreseen elsewhere than in the last motion, J turns there at once, as fast as it
//! may. Limits are penalties in the search (`search`), and what is found is verified on its curves: a motion that breaks one is
//! not given out, and the one before goes on. A search from there ends in the optimum that the pair is in: where more is to be had
//! elsewhere in the airspace, a motion that makes for it is searched for as well, and the better of both is flown (`elsewhere`).
//! Deterministic in its inputs: two companions with the same beliefs and the same motion make the same one.
//!
//! Each vehicle keeps to its side of planes between the two (`side`), which are laid anew for each motion between all that either may
//! still fly: the one may be anywhere on its motion, or on the one before, while the other flies that one or this, and they are still
//! apart. So the two may go round each other in the course of a slot.
//!
//! The poses that a slot begins with are made anew as well: [`Opening`].

mod elsewhere;
mod estimate;
mod flying;
mod frame;
mod motion;
mod mover;
mod opening;
mod path;
mod question;
mod search;
mod side;
#[cfg(test)]
mod tests;
mod tolerance;

pub use estimate::{Belief, Drift, Estimate, Report, Unrest};
pub use flying::Flying;
pub use motion::{Motion, State};
pub use mover::{Gait, Moved, Mover, Who};
pub use opening::{Opening, Roaming};
pub use path::Path;
pub use question::Question;

use super::error::PlanError;
use super::model::Memory;
use super::moving::Limits;
use super::problem::{Problem, Uncertainty};
use super::setup::Setup;
use super::solver::boxed;
use super::solver::limited::Settings;
use crate::geo::{Attitude, Enu};
use crate::role::{PerVehicle, Role};
use frame::Frame;
use motion::Foreseen;
use search::Objective;

/// So many of a slot's user and eavesdroppers are followed at once.
pub const MOST_MOVERS: usize = 6;
/// Segments of a motion and their length in seconds.
pub const SEGMENTS: usize = 6;
/// See [`SEGMENTS`].
pub const SEGMENT_S: f64 = 2.0;
/// How far a motion is planned ahead, in seconds.
pub const HORIZON_S: f64 = SEGMENT_S * SEGMENTS as f64;
/// How often a motion's turns are looked at, per second, and the part of what may be turned that they may have between looks.
const LOOKS_HZ: f64 = 50.0;
const TURNS: f64 = 0.995;
/// Who rests on a side of the airspace may be beyond it by rounding, in metres.
const ROUNDING_M: f64 = 1e-9;
/// The shortest time in which a slip is made good, in seconds.
const SHORTEST_SLIP_S: f64 = 0.1;
/// Who is heard of goes on being heard of: what is flown later than this, in seconds, is flown by a later motion, which knows better.
const HEARD_S: f64 = 1.0;
/// Nobody's place is taken to be known better than this, in metres, once it moves.
const LEAST_STD_M: f64 = 0.1;
/// From a motion to the next there are fewer steps than from rest; and again as many where limits were not met. With 25 instead of
/// 80 a motion lags behind what could be flown, by 6% of the rate and more: what is not done now is late a second from now.
const AGAIN: Settings = Settings { iterations: 80, tolerance: 1e-6, first_step: 0.1 };
const FIRST: Settings = Settings { iterations: 150, tolerance: 1e-6, first_step: 0.3 };
/// A motion of which no more is expected, bit/s/Hz, leads nowhere.
const NOTHING_BPS_HZ: f64 = 0.01;
/// Who makes for elsewhere expects so many times more of it than of going on.
const BETTER: f64 = 1.15;
/// What a limit counts, and then, where it was not met.
const STIFFNESS: [f64; 3] = [100.0, 1_000.0, 10_000.0];

/// What is known beforehand of where somebody will be.
pub trait Foresight: std::fmt::Debug + Sync {
    /// Where it is believed to be at an instant, in seconds of the clock that both vehicles share.
    fn at(&self, t_s: f64) -> Belief;
}

impl Foresight for Estimate {
    fn at(&self, t_s: f64) -> Belief {
        Self::at(self, t_s)
    }
}

impl Foresight for Drift {
    fn at(&self, t_s: f64) -> Belief {
        Self::at(self, t_s)
    }
}

/// A slot, and what is believed of those in it.
#[derive(Debug, Clone)]
pub struct Scene<'a> {
    /// The question as it was before anything moved: everything but where things are.
    pub problem: &'a Problem,
    /// The served user, if it moves.
    pub user: Option<&'a dyn Foresight>,
    /// Those of the eavesdroppers that move, in their order; the others, and those beyond its end, stay.
    pub eavesdroppers: Vec<Option<&'a dyn Foresight>>,
    /// What the vehicles may do on their way.
    pub limits: PerVehicle<Limits>,
    /// How fast they may turn, rad/s.
    pub turn_rate_rad_s: PerVehicle<f64>,
    /// How far apart they have to be, in metres, whichever of their motions each flies, and wherever on it it is.
    pub apart_m: f64,
}

impl Scene<'_> {
    /// The question at an instant of a motion that begins at `begins_s`: places as they are believed to be then, and no less sure
    /// than they are `HEARD_S` after the beginning. That a place many seconds ahead is known badly now does not matter: its part of
    /// the motion is planned again before it is flown. (Held against all of that doubt, the pair would keep to poses that suit no
    /// place well.)
    #[must_use]
    pub fn problem_at(&self, t_s: f64, begins_s: f64) -> Problem {
        believed(self.problem, (self.user, &self.eavesdroppers), t_s, begins_s)
    }

    fn user_at(&self, t_s: f64) -> Enu {
        self.user.map_or(self.problem.user_enu_m, |user| user.at(t_s).position_enu_m)
    }
}

/// A question with the user, and the eavesdroppers, where they are believed to be: see [`Scene::problem_at`].
fn believed(
    problem: &Problem,
    (user, eavesdroppers): (Option<&dyn Foresight>, &[Option<&dyn Foresight>]),
    t_s: f64,
    begins_s: f64,
) -> Problem {
    let mut problem = problem.clone();
    let foreseen = |foresight: &dyn Foresight| {
        let std_m = foresight.at(t_s.min(begins_s + HEARD_S)).std_m[0].max(LEAST_STD_M);
        (foresight.at(t_s).position_enu_m, Uncertainty::Gaussian { std_m })
    };
    if let Some(user) = user {
        (problem.user_enu_m, problem.user_uncertainty) = foreseen(user);
    }
    for (eavesdropper, foresight) in problem.eavesdroppers.iter_mut().zip(eavesdroppers) {
        if let Some(foresight) = foresight {
            (eavesdropper.position_enu_m, eavesdropper.uncertainty) = foreseen(*foresight);
        }
    }
    problem
}

/// The pair's motion from `at_s` on; `None` where none is found that keeps all limits, so that what is flown goes on.
///
/// Places that are uncertain are averaged over unless the problem's objective is the nominal one. I's power stays what it is, and
/// powers of J that cannot vary stay too: whoever is silent stays silent.
///
/// # Errors
/// [`PlanError`] for a problem without meaning.
pub fn plan(
    scene: &Scene<'_>,
    from: &PerVehicle<Flying<'_>>,
    at_s: f64,
    seed: u64,
) -> Result<Option<Motion>, PlanError> {
    if !at_s.is_finite() {
        return Ok(None);
    }
    let problems: Vec<Problem> = Frame::nodes_s(at_s).map(|t_s| scene.problem_at(t_s, at_s)).collect();
    let setups = problems.iter().map(Setup::new).collect::<Result<Vec<_>, _>>()?;
    let user = Foreseen::new(scene, at_s);
    let frame = Frame::new(scene, &setups, &user, from, at_s);
    let rests = Role::BOTH.into_iter().all(|role| from[role].on().is_none());
    let settings = if rests { FIRST } else { AGAIN };
    let objective = Objective::new(&frame, seed);
    let (bounds, mut memory) = (frame.bounds(), Memory::default());
    let mut found = |start: Vec<f64>| {
        let mut x = start;
        STIFFNESS.iter().find_map(|stiffness| {
            let mut cost =
                |x: &[f64], gradient: &mut [f64]| objective.cost(x, *stiffness, &mut memory, gradient);
            x = boxed::minimise(&mut cost, &bounds, &x, &settings).x;
            let motion = kept(&frame, frame.motion(&x))?;
            Some(Motion { expected_bps_hz: objective.rate_bps_hz(&x, &mut memory), ..motion })
        })
    };
    let goes_on = found(frame.going_on(from));
    let expected_bps_hz = goes_on.as_ref().map_or(0.0, |motion| motion.expected_bps_hz);
    let carries = expected_bps_hz > NOTHING_BPS_HZ;
    let least_bps_hz = if carries { BETTER * expected_bps_hz } else { NOTHING_BPS_HZ };
    let goal = elsewhere::goal(&frame, &setups[setups.len() - 1], seed, carries, least_bps_hz);
    let goes = goal.and_then(|(to, turns_s)| found(frame.towards(&to, at_s + turns_s.max(SEGMENT_S))));
    // Where nothing is carried, whatever leads on, though it comes there later than a motion ends.
    Ok(goes.filter(|motion| !carries || motion.expected_bps_hz > least_bps_hz).or(goes_on))
}

/// A motion with its slip made good as soon as may be, if it keeps every limit.
fn kept(frame: &Frame<'_>, mut motion: Motion) -> Option<Motion> {
    let (scene, region) = (frame.scene, &frame.setups[0].region);
    let inside = |role: Role| {
        let way = &motion.ways[role];
        let cell = &region.cells()[region.cell_of(&way.at(way.begins_s).position_enu_m)];
        way.hull().all(|p| {
            frame.sides[role].outside_m(&p) <= ROUNDING_M
                && cell.sides.iter().all(|side| side.normal.dot(&p.xy()) <= side.offset_m + ROUNDING_M)
                && (cell.altitude_m[0] - ROUNDING_M..=cell.altitude_m[1] + ROUNDING_M).contains(&p.z)
        })
    };
    let moves = |role: Role| scene.limits[role].strain(&motion.ways[role].demand()) <= 1.0;
    if !Role::BOTH.into_iter().all(|role| moves(role) && inside(role)) {
        return None;
    }
    let may = scene.turn_rate_rad_s.map(|rate| TURNS * rate);
    let slip = motion.slip.angles;
    motion.slip = motion::Slip { angles: [0.0; 2], ..motion.slip };
    let without = fastest_turns_rad_s(&motion);
    let left = may.j - without.j;
    if !(without.i <= may.i && left > 0.0) {
        return None;
    }
    let lasts_s = (libm::hypot(slip[0], slip[1]) / left).max(SHORTEST_SLIP_S);
    motion.slip = motion::Slip { angles: slip, lasts_s };
    (lasts_s <= HORIZON_S && fastest_turns_rad_s(&motion).j <= may.j).then_some(motion)
}

/// The fastest turn of either vehicle from look to look, rad/s.
fn fastest_turns_rad_s(motion: &Motion) -> PerVehicle<f64> {
    let looks = (HORIZON_S * LOOKS_HZ) as u32;
    let at = |look: u32| motion.at(motion.begins_s() + f64::from(look) / LOOKS_HZ).attitudes();
    let mut fastest = PerVehicle { i: 0.0f64, j: 0.0 };
    let mut before: PerVehicle<Attitude> = at(0);
    for look in 1..=looks {
        let now = at(look);
        for role in Role::BOTH {
            fastest[role] = fastest[role].max(before[role].angle_to(&now[role]) * LOOKS_HZ);
        }
        before = now;
    }
    fastest
}
