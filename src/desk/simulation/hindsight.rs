//! What was lost by not knowing where users and eavesdroppers that move would be: each slot as it was flown, beside the same slot flown
//! by a pair that knows all their tracks beforehand, and by one that stays where the plan has it.
//!
//! Both are flown on paper: the rate is the evaluator's at the true places, every [`LOOK`] in which I was on the air. The pair that
//! knows plans with the companions' own planner and limits, each second. It begins the slot as the pair did that flew it: what that
//! lost is what it did not know. Or it begins with the poses that suit the first instant best: what that gains is what a pair in the air
//! would have to have flown to before.

use std::collections::BTreeMap;
use std::time::Duration;

use veilwing_sitl::{Flown, PlannedPose, World};

use super::observer::Observer;
use super::scenario::Witness;
use crate::config::Mission;
use crate::geo::{Enu, EnuVelocity, Pose};
use crate::mission::Outgoing;
use crate::mission::following::TURN_PART;
use crate::pair::OF_POSES;
use crate::pair::wire::{MavMessage, VeilwingWord};
use crate::planner::PlanError;
use crate::planner::expectation::{EvaluateOptions, evaluate};
use crate::planner::following::{self, Belief, Flying, Foresight, Motion, Scene};
use crate::planner::plan::VehiclePlan;
use crate::planner::problem::{Problem, Uncertainty};
use crate::planner::slots::Plan;
use crate::planner::{Options, plan_slot};
use crate::role::{PerVehicle, Role};
use crate::schedule::separation::clearance_m;

/// Time from look to look.
const LOOK: Duration = Duration::from_millis(200);
/// The pair that knows plans again after so many looks: each second, as companions do.
const AGAIN: usize = 5;
/// Of the evaluator, for each look.
const SAMPLES: usize = 1024;

/// A slot, by three pairs: the one that flew it is in the world's report.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hindsight {
    /// The slot's number.
    pub slot: usize,
    /// Of the pair that knows all tracks and begins as the one that flew it, bit/s: what it finds, or what was flown if that is more.
    pub knowing_bps: f64,
    /// Of the pair that knows all tracks and begins where it is best, bit/s.
    pub best_bps: f64,
    /// Of the pair that stays where the plan has it, bit/s.
    pub staying_bps: f64,
}

/// Motions that were made anew.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Agreements {
    /// How many I asked for.
    pub asked: usize,
    /// From I's first word of each that was taken up until J said that it flies it as well, seconds, in the order of the flight.
    pub took_s: Vec<f64>,
}

/// What is seen at a look.
#[derive(Debug, Clone)]
struct Look {
    users: Vec<Enu>,
    eavesdroppers: Vec<Enu>,
    /// The slot in which I is on the air.
    slot: Option<usize>,
    /// How both are meant to be, as the companions have it.
    flown: Option<Flown>,
}

/// Sees a flight, to be asked afterwards.
#[derive(Debug, Default)]
pub struct Seer {
    looks: Vec<Look>,
    /// By boot, proposal and number: when I asked for it first.
    asked: BTreeMap<(u32, u32, u16), Duration>,
    took: BTreeMap<(u32, u32, u16), Duration>,
}

impl Witness for Seer {}

impl Observer for Seer {
    fn saw(&mut self, world: &World) {
        while world.now() >= LOOK * self.looks.len() as u32 {
            let [users, eavesdroppers] = world.places();
            let i = &world.snapshot().vehicles[0];
            let slot = i.tx_power_w.and(i.slot).and_then(|slot| usize::try_from(slot).ok());
            self.looks.push(Look { users, eavesdroppers, slot, flown: world.flown() });
        }
    }

    fn sent(&mut self, at: Duration, role: Role, message: &Outgoing) {
        let Outgoing::Pair(message) = message else { return };
        match (role, &**message) {
            (Role::I, MavMessage::VEILWING_PLACES(m)) if m.number != OF_POSES => {
                self.asked.entry((m.boot_id, m.proposal, m.number)).or_insert(at);
            }
            (Role::J, MavMessage::VEILWING_MOTION(m)) if m.word == VeilwingWord::VEILWING_WORD_FOLLOWS => {
                self.took.entry((m.boot_id, m.proposal, m.number)).or_insert(at);
            }
            _ => {}
        }
    }
}

/// How both are meant to be.
fn vehicles(flown: &Flown) -> PerVehicle<VehiclePlan> {
    let vehicle = |meant: &PlannedPose| {
        let &PlannedPose { position_enu_m, roll_rad, pitch_rad, yaw_rad, tx_power_w, .. } = meant;
        let pose = Pose { position_enu_m: position_enu_m.into(), roll_rad, pitch_rad, yaw_rad };
        VehiclePlan { pose, tx_power_w }
    };
    let [i, j] = &flown.poses;
    PerVehicle { i: vehicle(i), j: vehicle(j) }
}

/// One that is known to be where it was, and to go on as it went at the last look.
#[derive(Debug)]
struct Track<'a> {
    looks: &'a [Look],
    place: fn(&Look, usize) -> Enu,
    who: usize,
}

impl Foresight for Track<'_> {
    fn at(&self, t_s: f64) -> Belief {
        let looks = t_s / LOOK.as_secs_f64();
        let before = (looks.max(0.0) as usize).min(self.looks.len().saturating_sub(2));
        let at = |k: usize| (self.place)(&self.looks[k.min(self.looks.len() - 1)], self.who);
        let step = at(before + 1) - at(before);
        Belief {
            position_enu_m: at(before) + step * (looks - before as f64),
            velocity_enu_m_s: EnuVelocity::from_vector(step / LOOK.as_secs_f64()),
            std_m: [0.0; 2],
        }
    }
}

impl Seer {
    /// What became of the motions that were made anew.
    #[must_use]
    pub fn agreements(&self) -> Agreements {
        let took =
            self.took.iter().filter_map(|(key, at)| Some((at, at.checked_sub(*self.asked.get(key)?)?)));
        let mut took: Vec<_> = took.collect();
        took.sort();
        Agreements {
            asked: self.asked.len(),
            took_s: took.into_iter().map(|(_, took)| took.as_secs_f64()).collect(),
        }
    }

    /// Each slot in which I was on the air, with hindsight.
    ///
    /// # Errors
    /// [`PlanError`] for a problem without meaning.
    pub fn hindsight(
        &self,
        mission: &Mission,
        plan: &Plan,
        world: &World,
    ) -> Result<Vec<Hindsight>, PlanError> {
        let mut all = Vec::new();
        for (slot, planned) in world.config().slots.iter().enumerate() {
            let on: Vec<usize> =
                (0..self.looks.len()).filter(|k| self.looks[*k].slot == Some(slot)).collect();
            let user = mission.users.iter().position(|user| user.name == planned.user);
            let rest = plan.slots.iter().find(|own| own.user == planned.user).map(|own| own.plan.vehicles);
            let (Some((user, rest)), Some(first)) = (user.zip(rest), on.first()) else { continue };
            let Some(problem) = mission.problem(user) else { continue };
            let told = Told { looks: &self.looks, mission, problem, user, on: &on };
            let Some(begins) = self.looks[*first].flown.as_ref().map(vehicles) else { continue };
            let best = plan_slot(&told.truth(*first), &Options { seed: mission.seed, ..Options::default() })?;
            all.push(Hindsight {
                slot,
                knowing_bps: told.knowing_bps(&begins)?.max(told.flown_bps(&begins)?),
                best_bps: told.knowing_bps(&best.vehicles)?,
                staying_bps: told.mean_bps(|_| Ok(rest))?,
            });
        }
        Ok(all)
    }
}

/// A slot as it truly was.
struct Told<'a> {
    looks: &'a [Look],
    mission: &'a Mission,
    problem: Problem,
    user: usize,
    /// The looks at which I was on the air in it, one at least.
    on: &'a [usize],
}

impl Told<'_> {
    /// Everybody where it was at a look.
    fn truth(&self, look: usize) -> Problem {
        let Look { users, eavesdroppers, .. } = &self.looks[look];
        let mut problem = self.problem.clone();
        (problem.user_enu_m, problem.user_uncertainty) = (users[self.user], Uncertainty::None);
        for (node, place) in problem.eavesdroppers.iter_mut().zip(eavesdroppers) {
            (node.position_enu_m, node.uncertainty) = (*place, Uncertainty::None);
        }
        problem
    }

    /// The mean rate over the looks at which I was on the air, of a pair that is so at a look.
    fn mean_bps(
        &self,
        mut at: impl FnMut(usize) -> Result<PerVehicle<VehiclePlan>, PlanError>,
    ) -> Result<f64, PlanError> {
        let options = EvaluateOptions { samples: SAMPLES, ..EvaluateOptions::default() };
        let mut sum_bps = 0.0;
        for look in self.on {
            sum_bps += evaluate(&self.truth(*look), &at(*look)?, &options)?.secrecy_rate_bps;
        }
        Ok(sum_bps / self.on.len() as f64)
    }

    /// The mean rate of the pair as it was meant to fly, which begins like this.
    fn flown_bps(&self, rest: &PerVehicle<VehiclePlan>) -> Result<f64, PlanError> {
        let mut last = *rest;
        self.mean_bps(|look| {
            last = self.looks[look].flown.as_ref().map_or(last, vehicles);
            Ok(last)
        })
    }

    /// The mean rate of a pair that begins like this and knows all tracks.
    fn knowing_bps(&self, rest: &PerVehicle<VehiclePlan>) -> Result<f64, PlanError> {
        let (problem, limits) = (self.truth(self.on[0]), self.mission.transit_limits());
        let user = Track { looks: self.looks, place: |look, who| look.users[who], who: self.user };
        let listeners: Vec<Track<'_>> = (0..problem.eavesdroppers.len())
            .map(|who| Track { looks: self.looks, place: |look, who| look.eavesdroppers[who], who })
            .collect();
        let scene = Scene {
            problem: &problem,
            user: Some(&user),
            eavesdroppers: listeners.iter().map(|track| Some(track as &dyn Foresight)).collect(),
            limits: limits.map(|limits| limits.of_motion()),
            turn_rate_rad_s: limits.map(|limits| TURN_PART * limits.tilt_rate_rad_s),
            apart_m: clearance_m(&self.mission.airspace),
        };
        let (mut motion, mut planned) = (None::<Motion>, None);
        self.mean_bps(|look| {
            let t_s = (LOOK * look as u32).as_secs_f64();
            if planned.is_none_or(|planned| look >= planned + AGAIN) {
                let from = motion.as_ref().map_or(Flying::rest(rest), Flying::motion);
                motion = following::plan(&scene, &from, t_s, self.mission.seed)?.or(motion.take());
                planned = Some(look);
            }
            Ok(motion.as_ref().map_or(*rest, |motion| motion.at(t_s).vehicles))
        })
    }
}
