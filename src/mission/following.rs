//! Following those that move while a slot is served: when a motion is asked for, and the motions. What is reported of them: `reported`.
//!
//! I leads: it filters the reports, and asks for a motion every second, to begin half a second later. Both vehicles plan it outside
//! of the loop; `pair::adoption` says whether it is taken up. Poses that a slot begins with: `opening`.

use std::sync::Arc;
use std::time::Duration;

use super::executive::Executive;
use super::opening::Openings;
use super::phase::Phase;
use super::renewal::{Anew, Measured};
use super::reported::Heard;
use crate::geo::Pose;
use crate::pair::adoption::{AT_REST, GRACE};
use crate::pair::{Drifting, Places};
use crate::planner::Options;
use crate::planner::following::{self, Belief, Drift, Estimate, Motion, Mover, Opening, Unrest, Who};
use crate::planner::plan::VehiclePlan;
use crate::planner::problem::Problem;
use crate::planner::slots::Plan;
use crate::planner::track::{APART_S, Track};
use crate::planner::turning::{LARGEST_RAD, Sizes};
use crate::role::{PerVehicle, Role};
use crate::schedule::separation::clearance_m;
use crate::service::Tolerance;
use crate::time::Instant;

/// A motion is asked for this often.
const EVERY: Duration = Duration::from_secs(1);
/// And begins so much later: time to tell it the other, to plan it on both sides, and to agree.
const LEAD: Duration = Duration::from_millis(500);
/// No wider errors are allowed in a slot than these, but of an attitude where a vehicle may lean.
const ERRORS: Sizes = {
    let [position_m, attitude_rad] = Tolerance::widest();
    Sizes { pointing_rad: [attitude_rad, LARGEST_RAD], position_m: [position_m; 2] }
};
/// The part of what they may turn that motions ask of them: the rest is for what has to be caught up with.
pub const TURN_PART: f64 = 0.5;

/// What does not change while the companion runs.
#[derive(Debug, Clone)]
pub struct Following {
    /// By user: its name, and what the planner is asked for it, as if nothing moved.
    pub problems: Vec<(String, Arc<Problem>)>,
    /// Those that move.
    pub movers: Vec<Mover>,
    /// How slots are planned.
    pub options: Options,
    /// What is delivered over time counts, whatever the rate.
    pub by_volume: bool,
}

impl Following {
    /// How somebody goes on that moves.
    pub(super) fn unrest(&self, who: Who) -> Option<Unrest> {
        self.movers.iter().find(|mover| mover.who == who).map(|mover| mover.gait.unrest())
    }

    /// How high somebody is, as the mission has it, in metres of its frame.
    pub(super) fn height_m(&self, who: Who) -> f64 {
        let user = |index: usize| self.problems.get(index).map(|(_, problem)| problem.user_enu_m);
        let eavesdropper = |index: usize| {
            let (_, problem) = self.problems.first()?;
            problem.eavesdroppers.get(index).map(|eavesdropper| eavesdropper.position_enu_m)
        };
        let place = match who {
            Who::User(index) => user(index),
            Who::Eavesdropper(index) => eavesdropper(index),
        };
        place.map_or(0.0, |place| place.z)
    }
}

/// Which motion an answer is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Ticket {
    /// The proposal of the slot; of poses that I has not proposed yet 0.
    pub(super) proposal: u32,
    /// The motion's number, or the slot's.
    pub(super) number: u16,
}

/// What both vehicles fly in a slot whose motions are made anew, or that is served by a plan which was, as one companion knows it.
#[derive(Debug, Clone, PartialEq)]
pub struct Flown {
    /// The slot.
    pub slot: u16,
    opens_at: Instant,
    courses: PerVehicle<Course>,
}

/// One vehicle's part: how it is held where it neither turns nor moves.
#[derive(Debug, Clone, PartialEq)]
struct Course {
    held: VehiclePlan,
    track: Option<Track>,
}

impl Course {
    fn vehicle(&self, since_s: f64) -> VehiclePlan {
        match &self.track {
            None => self.held,
            Some(Track::Followed(track)) => track.vehicle(since_s),
            Some(track) => {
                let place = track.place(since_s).map(|place| place.position_enu_m);
                let position_enu_m = place.unwrap_or(self.held.pose.position_enu_m);
                let (roll_rad, pitch_rad, yaw_rad) = track.attitude(since_s).euler();
                let pose = Pose { position_enu_m, roll_rad, pitch_rad, yaw_rad };
                VehiclePlan { pose, tx_power_w: track.protects_w(since_s) }
            }
        }
    }

    /// What it is told to radiate, in watts.
    fn commanded_w(&self, since_s: f64) -> f64 {
        self.track.as_ref().map_or(self.held.tx_power_w, |track| track.tx_power_w(since_s))
    }

    /// The same as of before a motion that began later.
    fn as_of(&self, since_s: f64) -> Self {
        let track = self.track.as_ref().map(|track| match track {
            Track::Followed(track) => Track::Followed(track.as_of(since_s)),
            planned @ Track::Planned(_) => planned.clone(),
        });
        Self { track, ..self.clone() }
    }
}

/// Both vehicles at an instant of such a slot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Due {
    /// Pose and power, by the motion that I flies.
    pub vehicles: PerVehicle<VehiclePlan>,
    /// J's by the one before, so long as I may be on while J has not taken up the newest.
    pub behind: VehiclePlan,
    /// What each may be told to radiate by either of them, in watts.
    pub most_w: PerVehicle<f64>,
}

impl Flown {
    /// What both are to do at an instant.
    #[must_use]
    pub fn at(&self, now: Instant) -> Due {
        let since_s = now.seconds_since(self.opens_at);
        let behind = self.courses.as_ref().map(|course| course.as_of(since_s - GRACE.as_secs_f64()));
        // The other's clock may be ahead.
        let most_w = PerVehicle::from_fn(|role| {
            let both = [&self.courses[role], &behind[role]].into_iter();
            both.flat_map(|course| [0.0, APART_S].map(|s| course.commanded_w(since_s + s)))
                .fold(0.0, f64::max)
        });
        let vehicles = self.courses.as_ref().map(|course| course.vehicle(since_s));
        Due { vehicles, behind: behind.j.vehicle(since_s), most_w }
    }
}

/// What is to be planned, outside of the loop.
#[derive(Debug, Clone)]
pub enum Question {
    /// A motion in the slot that is served.
    Motion(following::Question),
    /// The poses of the next slot.
    Poses(Opening),
    /// The mission's plan, from the next slot on.
    Plan(Anew),
}

/// What was found for a question, if anything was.
#[derive(Debug, Clone)]
pub enum Answer {
    /// To [`Question::Motion`].
    Motion(Option<Motion>),
    /// To [`Question::Poses`].
    Poses(Option<PerVehicle<VehiclePlan>>),
    /// To [`Question::Plan`], with what it is made for.
    Plan(Measured, Option<Arc<Plan>>),
}

impl Question {
    /// Takes its time.
    #[must_use]
    pub fn answer(&self) -> Answer {
        match self {
            Self::Motion(question) => Answer::Motion(question.answer()),
            Self::Poses(opening) => Answer::Poses(opening.answer()),
            Self::Plan(anew) => {
                let (measured, plan) = anew.answer();
                Answer::Plan(measured, plan)
            }
        }
    }
}

/// See the module.
#[derive(Debug, Clone)]
pub(super) struct Followers {
    pub(super) heard: Vec<Heard>,
    ask_at: Instant,
    /// Of the slot of this proposal: numbers, and motions that were found.
    proposal: u32,
    motions: Vec<(u16, Arc<Motion>)>,
    pub(super) question: Option<(Ticket, Question)>,
    pub(super) openings: Openings,
}

impl Followers {
    pub fn new(following: Option<&Following>, now: Instant) -> Self {
        let movers = following.map_or(0, |following| following.movers.len());
        Self {
            heard: vec![Heard::default(); movers],
            ask_at: now,
            proposal: 0,
            motions: Vec::new(),
            question: None,
            openings: Openings::default(),
        }
    }

    fn motion(&self, number: u16) -> Option<&Arc<Motion>> {
        self.motions.iter().find(|(known, _)| *known == number).map(|(_, motion)| motion)
    }
}

pub(super) fn seconds(at: Instant) -> f64 {
    at.since_start().as_secs_f64()
}

impl Executive {
    /// Puts down what is believed of this user, and of the eavesdroppers, of those that move.
    pub(super) fn believe(&self, places: &mut Places, user: usize, of: impl Fn(&Estimate) -> Belief) {
        let Some(following) = &self.settings.following else { return };
        for (mover, heard) in following.movers.iter().zip(&self.followers.heard) {
            let who = match mover.who {
                Who::User(index) if index == user => Some(0),
                Who::User(_) => None,
                Who::Eavesdropper(index) => u8::try_from(index + 1).ok(),
            };
            if let Some((who, estimate)) = who.zip(heard.estimate.as_ref()) {
                // Who is too far away to be told of is not followed.
                Drifting::of(who, &of(estimate)).into_iter().for_each(|drifting| places.push(drifting));
            }
        }
    }

    /// The user that the slot agreed on serves, by its number in the mission.
    fn served(&self) -> Option<usize> {
        self.user_of(self.service.slot()?.commitment.slot)
    }

    /// The user that a slot serves, likewise.
    pub(super) fn user_of(&self, slot: u16) -> Option<usize> {
        let name = self.user(slot);
        let following = self.settings.following.as_ref()?;
        following.problems.iter().position(|(user, _)| *user == name)
    }

    /// I: asks for the next motion once it is time.
    pub(super) fn ask_for_motion(&mut self, now: Instant) {
        if self.settings.role != Role::I || now < self.followers.ask_at || !self.service.may_ask_motion(now) {
            return;
        }
        let (Some(slot), Some(user)) = (self.service.slot(), self.served()) else { return };
        let begins = (now + LEAD).saturating_since(slot.commitment.opens_at);
        if now + LEAD >= slot.radiate_until {
            return;
        }
        let Ok(begins_ms) = u32::try_from(begins.as_millis()) else { return };
        let mut places = Places::new(begins_ms);
        places.jitter = self.agreed_jitter();
        places.paces = self.agreed_paces();
        let begins_s = seconds(slot.commitment.opens_at + places.begins());
        self.believe(&mut places, user, |estimate| estimate.at(begins_s));
        if places.moving().next().is_some() {
            self.followers.ask_at = now + EVERY;
            self.service.ask_motion(places, now);
        }
    }

    /// A motion is asked for: by us, or by the peer.
    pub(super) fn plan_motion(&mut self, now: Instant) {
        let (Some(asked), Some(slot)) = (self.service.asked_motion().copied(), self.service.slot()) else {
            return;
        };
        let proposal = slot.commitment.proposal;
        if self.followers.proposal != proposal {
            (self.followers.proposal, self.followers.motions) = (proposal, Vec::new());
        }
        // What neither flies any more nothing begins with.
        let oldest = asked.from[0].min(asked.from[1]);
        self.followers.motions.retain(|(number, _)| *number >= oldest);
        match self.question(&asked.places, asked.from) {
            Some(question) => {
                let ticket = Ticket { proposal, number: asked.number };
                self.followers.question = Some((ticket, Question::Motion(question)));
            }
            None => self.service.motion_planned(asked.number, None, now),
        }
    }

    /// `None`: a motion that this begins with is not known here.
    fn question(&self, places: &Places, from: [u16; 2]) -> Option<following::Question> {
        let following = self.settings.following.as_ref()?;
        let (_, problem) = following.problems.get(self.served()?)?;
        let rest = self.service.slot_vehicles()?;
        let [i, j] = from.map(|number| match number {
            AT_REST => Some(None),
            number => self.followers.motion(number).map(|motion| Some(Arc::clone(motion))),
        });
        let (user, eavesdroppers) = drifts(places, problem)?;
        Some(following::Question {
            problem: jittering(problem, places),
            user,
            eavesdroppers,
            limits: self.limits_at(&places.paces).map(|limits| limits.of_motion()),
            turn_rate_rad_s: self.settings.limits.map(|limits| TURN_PART * limits.tilt_rate_rad_s),
            apart_m: clearance_m(&self.settings.airspace),
            rest,
            flies: PerVehicle { i: i?, j: j? },
            begins_s: places.begins().as_secs_f64(),
            errors: ERRORS,
            seed: following.options.seed,
        })
    }

    /// What is to be planned, outside of the loop, and answered by [`Self::handle_answer`]. A newer question takes an older one's
    /// place.
    pub fn poll_question(&mut self) -> Option<(Ticket, Question)> {
        self.followers.question.take()
    }

    /// What was found for a question.
    pub fn handle_answer(&mut self, ticket: Ticket, answer: Answer, now: Instant) {
        match answer {
            Answer::Motion(motion) => self.take_motion(ticket, motion, now),
            Answer::Poses(vehicles) => self.take_poses(ticket, vehicles, now),
            Answer::Plan(measured, plan) => self.take_plan(measured, plan, now),
        }
        self.react(now);
    }

    fn take_motion(&mut self, ticket: Ticket, motion: Option<Motion>, now: Instant) {
        let current = self.service.slot().is_some_and(|slot| slot.commitment.proposal == ticket.proposal);
        if !current {
            return;
        }
        let digest = motion.as_ref().map(Motion::digest);
        if let Some(motion) = motion.map(Arc::new) {
            self.service.foresee(&motion);
            self.followers.motions.push((ticket.number, motion));
        }
        self.service.motion_planned(ticket.number, digest, now);
    }

    /// A motion is flown from its beginning on.
    pub(super) fn take_up(&mut self, number: u16) {
        let Some(motion) = self.followers.motion(number).cloned() else { return };
        self.service.take_up(&motion);
        let track = self.track();
        if let Phase::InService { motion, .. } = &mut self.phase
            && motion.track.is_some()
        {
            motion.track = track;
        }
    }

    /// What both fly in the slot that is served, as far as is known here; `None` where that is as the plan has it which was made before
    /// the flight.
    #[must_use]
    pub fn flown(&self) -> Option<Flown> {
        let slot = self.service.slot()?;
        let terms = self.service.agreed_terms()?;
        let made_anew = slot.track.as_ref().and_then(Track::followed);
        let from_rest = |track: Track| if slot.carried_on { track } else { track.from_rest() };
        let track = |role: Role| match made_anew {
            Some(track) => Some(Track::Followed(track.other(role, terms.vehicles[role]))),
            None => terms.tracks.as_ref().map(|tracks| from_rest(tracks[role].clone())),
        };
        if made_anew.is_none() && terms.anew.is_none() {
            return None;
        }
        let courses = PerVehicle::from_fn(|role| Course { held: terms.vehicles[role], track: track(role) });
        Some(Flown { slot: slot.commitment.slot, opens_at: slot.commitment.opens_at, courses })
    }

    /// I: whether J flies the same, as far as is known here. J goes by itself.
    #[must_use]
    pub fn flies_alike(&self, now: Instant) -> bool {
        self.settings.role == Role::J || self.service.flies_alike(now)
    }

    /// In a plan that follows: comes to rest as soon as the slot is to end early.
    pub(super) fn keep_to_slot(&mut self, now: Instant) {
        let limits = self.motion_limits();
        let closing = self.service.slot().is_some_and(|slot| slot.is_closing());
        if let Phase::InService { motion, .. } = &mut self.phase
            && closing
            && motion.follows(now)
        {
            *motion = motion.stopped(now, &limits);
        }
    }
}

/// A slot's problem with the jitter that is to be planned for.
pub(super) fn jittering(problem: &Arc<Problem>, places: &Places) -> Arc<Problem> {
    let Some(jitter) = places.jitter else { return Arc::clone(problem) };
    let mut jittering = Problem::clone(problem);
    jittering.jitter.std_rad = jitter.std_rad();
    Arc::new(jittering)
}

/// What is believed of the user and of the eavesdroppers of a slot, of those that move; `None` of places that are none of its.
pub(super) fn drifts(places: &Places, problem: &Problem) -> Option<(Option<Drift>, Vec<Option<Drift>>)> {
    let begins_s = places.begins().as_secs_f64();
    let (mut user, mut eavesdroppers) = (None, vec![None; problem.eavesdroppers.len()]);
    for drifting in places.moving() {
        let drift = Some(drifting.drift(begins_s));
        match usize::from(drifting.who).checked_sub(1) {
            None => user = drift,
            Some(index) => *eavesdroppers.get_mut(index)? = drift,
        }
    }
    Some((user, eavesdroppers))
}
