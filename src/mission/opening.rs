//! The poses that the next slot begins with, where users or eavesdroppers move: made anew for where those will be as it opens, from
//! where both vehicles rest, by both companions. I proposes the slot with them, and J agrees where it has found the same.

use std::time::Duration;

use super::executive::Executive;
use super::following::{Question, Ticket, drifts, jittering, seconds};
use super::phase::Phase;
use super::renewal::Measured;
use crate::geo::Pose;
use crate::pair::{AskedSlot, Places, Rest, SlotTerms};
use crate::planner::following::{Belief, Drift, Opening, Roaming, Who};
use crate::planner::plan::VehiclePlan;
use crate::role::{PerVehicle, Role};
use crate::schedule::trajectory::Sample;
use crate::time::Instant;

/// What planning and agreeing take, about.
const AGREEING: Duration = Duration::from_secs(1);
/// Who is heard of goes on being heard of: places are told as known as they will be about then.
const HEARD: Duration = Duration::from_secs(1);

/// See the module.
#[derive(Debug, Clone, Default)]
pub(super) struct Openings {
    /// The slot whose poses are to be made, and of J for whom.
    wanted: Option<(u16, Option<AskedSlot>)>,
    /// What is being planned, and where both rest.
    pub(super) asked: Option<(AskedSlot, PerVehicle<Rest>)>,
}

impl Executive {
    /// Where the vehicle rests, between slots whose poses are made anew.
    pub(super) fn rests(&self, now: Instant) -> Option<Rest> {
        if self.settings.following.is_none() && !self.may_replan() {
            return None;
        }
        let Phase::InService { motion, .. } = &self.phase else { return None };
        let between = self.service.slot().is_none() && motion.is_at_rest(now);
        between.then(|| {
            let Sample { position_enu_m, attitude, .. } = motion.sample(now);
            Rest::of(&position_enu_m, &attitude)
        })
    }

    pub(super) fn both_rest(&self, now: Instant) -> Option<PerVehicle<Rest>> {
        let (own, peer) = (self.rests(now)?, self.service.peer().rests?);
        Some(PerVehicle::from_fn(|role| if role == self.settings.role { own } else { peer }))
    }

    /// The slot's poses are to be made anew; of J for whom.
    pub(super) fn plan_poses(&mut self, slot: u16, asked: Option<AskedSlot>) {
        self.followers.openings.wanted = Some((slot, asked));
    }

    /// Asks for the poses, or the plan, that are wanted, once both vehicles rest.
    pub(super) fn ask_for_poses(&mut self, now: Instant) {
        let Some((slot, asked)) = self.followers.openings.wanted else { return };
        let Some(from) = self.both_rest(now) else { return };
        let asked = asked.unwrap_or_else(|| self.seen(slot, now));
        let opening = self.opening(slot, &asked, &from);
        if opening.is_none() && !self.may_replan() {
            return;
        }
        let openings = &mut self.followers.openings;
        (openings.wanted, openings.asked) = (None, Some((asked, from)));
        match opening {
            Some(opening) => {
                let ticket = Ticket { proposal: asked.proposal, number: slot };
                self.followers.question = Some((ticket, Question::Poses(opening)));
            }
            None => self.ask_for_plan(now),
        }
    }

    fn opening(&self, slot: u16, asked: &AskedSlot, from: &PerVehicle<Rest>) -> Option<Opening> {
        let (following, user) = (self.settings.following.as_ref()?, self.user_of(slot)?);
        let (_, problem) = following.problems.get(user)?;
        let roaming =
            |drift: Option<Drift>, who| Some(Roaming { drift: drift?, unrest: following.unrest(who)? });
        let (of_user, of_eavesdroppers) = drifts(&asked.places, problem)?;
        let of_eavesdroppers = of_eavesdroppers.into_iter().enumerate();
        let entry = self.itinerary.as_ref()?.entry(slot)?;
        let planned = &self.plan.as_ref()?.slots.get(entry.user_index)?.plan;
        let is_at = |role: Role| {
            let (position_enu_m, attitude) = from[role].pose()?;
            let (roll_rad, pitch_rad, yaw_rad) = attitude.euler();
            let pose = Pose { position_enu_m, roll_rad, pitch_rad, yaw_rad };
            Some(VehiclePlan { pose, tx_power_w: planned.vehicles[role].tx_power_w })
        };
        Some(Opening {
            problem: jittering(problem, &asked.places),
            user: roaming(of_user, Who::User(user)),
            eavesdroppers: of_eavesdroppers.map(|(k, drift)| roaming(drift, Who::Eavesdropper(k))).collect(),
            options: following.options,
            from: PerVehicle { i: is_at(Role::I)?, j: is_at(Role::J)? },
            limits: self.limits_at(&asked.places.paces).map(|limits| limits.of_motion()),
            turn_rate_rad_s: self.settings.limits.map(|limits| limits.tilt_rate_rad_s),
            by_volume: following.by_volume,
            slot_s: [entry.closes.saturating_sub(entry.opens), self.settings.timing.settle + AGREEING]
                .map(|time| time.as_secs_f64()),
        })
    }

    /// I: those that move, where they are now.
    fn seen(&self, slot: u16, now: Instant) -> AskedSlot {
        let [now_s, known_s] = [now, now + HEARD].map(seconds);
        let mut places = Places::new(0);
        (places.jitter, places.paces) = match self.may_replan() {
            true => {
                let Measured { jitter, paces } = self.measured();
                (jitter, paces)
            }
            false => (self.agreed_jitter(), self.agreed_paces()),
        };
        if let Some(user) = self.user_of(slot) {
            self.believe(&mut places, user, |estimate| Belief {
                std_m: estimate.at(known_s).std_m,
                ..estimate.at(now_s)
            });
        }
        AskedSlot { proposal: 0, slot, places }
    }

    /// Poses that were found, if the vehicles still rest where these were made for: the slot is served from them. Where none were found
    /// it is served from those of the plan.
    pub(super) fn take_poses(
        &mut self,
        ticket: Ticket,
        vehicles: Option<PerVehicle<VehiclePlan>>,
        now: Instant,
    ) {
        let current =
            |(asked, _): &(AskedSlot, _)| (asked.proposal, asked.slot) == (ticket.proposal, ticket.number);
        let Some((asked, from)) = self.followers.openings.asked.take_if(|asked| current(asked)) else {
            return;
        };
        let rest_there = self.both_rest(now) == Some(from);
        let limits = self.limits_at(&asked.places.paces);
        let terms = match (&mut self.itinerary, &self.plan) {
            (Some(itinerary), Some(plan)) if rest_there => {
                itinerary.serve_from(asked.slot, &from, vehicles, plan, (&self.settings, &limits))
            }
            _ => None,
        };
        let jitter = self.judged_by(asked.places.jitter);
        let terms = terms.map(|terms| SlotTerms { jitter, ..terms });
        // I asks again after a while, and J says that it has not found the same.
        if terms.is_some() || self.settings.role == Role::J {
            self.service.slot_planned(&asked, terms.map(|terms| vec![terms]), now);
        }
    }
}
