//! Following those that move while a slot is served: what is reported of them, when a motion is asked for, and the motions.
//!
//! I leads: it filters the reports, and asks for a motion every second, to begin half a second later. Both vehicles plan it outside
//! of the loop; `pair::adoption` says whether it is taken up. Poses that a slot begins with: `opening`.

use std::sync::Arc;
use std::time::Duration;

use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::MavMessage;

use super::executive::Executive;
use super::opening::Openings;
use super::phase::Phase;
use crate::geo::{Enu, Geodetic};
use crate::pair::adoption::{AT_REST, GRACE};
use crate::pair::{Drifting, Places};
use crate::planner::Options;
use crate::planner::following::{self, Belief, Drift, Estimate, Motion, Mover, Opening, Report, Who};
use crate::planner::plan::VehiclePlan;
use crate::planner::problem::Problem;
use crate::planner::track::{APART_S, Track};
use crate::role::{PerVehicle, Role};
use crate::schedule::separation::clearance_m;
use crate::time::Instant;

/// A motion is asked for this often.
const EVERY: Duration = Duration::from_secs(1);
/// And begins so much later: time to tell it the other, to plan it on both sides, and to agree.
const LEAD: Duration = Duration::from_millis(500);
/// The part of what they may turn that motions ask of them: the rest is for what has to be caught up with.
pub const TURN_PART: f64 = 0.5;
/// A report from farther away than this is none, in metres.
const FARTHEST_M: f64 = 20_000.0;
/// No report is overtaken by more than so many seconds: a clock that goes back by more has started anew.
const OVERTAKEN_S: f64 = 10.0;
/// How well a height is known, over how well a place is.
const UP: f64 = 2.0;

/// What does not change while the companion runs.
#[derive(Debug, Clone)]
pub struct Following {
    /// By user: its name, and what the planner is asked for it, as if nothing moved.
    pub problems: Vec<(String, Arc<Problem>)>,
    /// Those that move.
    pub movers: Vec<Mover>,
    /// How slots are planned.
    pub options: Options,
}

/// Which motion an answer is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Ticket {
    /// The proposal of the slot; of poses that I has not proposed yet 0.
    pub(super) proposal: u32,
    /// The motion's number, or the slot's.
    pub(super) number: u16,
}

/// What is to be planned, outside of the loop.
#[derive(Debug, Clone)]
pub enum Question {
    /// A motion in the slot that is served.
    Motion(following::Question),
    /// The poses of the next slot.
    Poses(Opening),
}

/// What was found for a question, if anything was.
#[derive(Debug, Clone)]
pub enum Answer {
    /// To [`Question::Motion`].
    Motion(Option<Motion>),
    /// To [`Question::Poses`].
    Poses(Option<PerVehicle<VehiclePlan>>),
}

impl Question {
    /// Takes its time.
    #[must_use]
    pub fn answer(&self) -> Answer {
        match self {
            Self::Motion(question) => Answer::Motion(question.answer()),
            Self::Poses(opening) => Answer::Poses(opening.answer()),
        }
    }
}

/// What has been heard of one that moves.
#[derive(Debug, Clone, Copy, Default)]
struct Heard {
    estimate: Option<Estimate>,
    /// Our clock less the sender's, by the report that was fastest, in seconds.
    less_s: Option<f64>,
    /// The sender's clock in the last report, in seconds, and the place.
    last: Option<(f64, Enu)>,
}

impl Heard {
    /// A place that is reported, when by the sender's clock and received when by ours, and how well it is known across. What is
    /// overtaken on its way, and copies, say nothing.
    fn take(&mut self, position_enu_m: Enu, (sent_s, received_s): (f64, f64), std_m: f64, mover: &Mover) {
        let back_s = self.last.map(|(last_s, _)| last_s - sent_s);
        let overtaken = back_s.is_some_and(|back_s| back_s > 0.0 && back_s < OVERTAKEN_S);
        if overtaken || self.last == Some((sent_s, position_enu_m)) {
            return;
        }
        self.last = Some((sent_s, position_enu_m));
        // A clock that does not go on has started anew, or is none.
        let goes_on = back_s.is_some_and(|back_s| back_s < 0.0);
        let by_receipt_s = received_s - sent_s;
        let less_s = self.less_s.filter(|_| goes_on).map_or(by_receipt_s, |less_s| less_s.min(by_receipt_s));
        self.less_s = Some(less_s);
        let report = Report { at_s: sent_s + less_s, position_enu_m, std_m: [std_m, UP * std_m] };
        match &mut self.estimate {
            Some(estimate) => {
                estimate.take(&report);
            }
            None => self.estimate = Some(Estimate::new(&report, mover.gait.unrest())),
        }
    }
}

/// See the module.
#[derive(Debug, Clone)]
pub(super) struct Followers {
    heard: Vec<Heard>,
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

/// A report's position, the sender's clock in seconds, and how well the place is known across, if it says so.
fn report(message: &MavMessage) -> Option<(Geodetic, f64, Option<f64>)> {
    match message {
        MavMessage::GLOBAL_POSITION_INT(m) => {
            Some((Geodetic::of_wire(m.lat, m.lon, m.alt), f64::from(m.time_boot_ms) * 1e-3, None))
        }
        MavMessage::FOLLOW_TARGET(m) => {
            let place = Geodetic { alt_m: f64::from(m.alt), ..Geodetic::of_wire(m.lat, m.lon, 0) };
            let variance = f64::from(m.position_cov[0].max(m.position_cov[1]));
            let std_m = (variance.is_finite() && variance > 0.0).then(|| variance.sqrt());
            Some((place, m.timestamp as f64 * 1e-3, std_m))
        }
        _ => None,
    }
}

fn seconds(at: Instant) -> f64 {
    at.since_start().as_secs_f64()
}

impl Executive {
    /// A message of whoever is on the autopilot's link, if it says where one is that moves.
    pub(super) fn hear_of_movers(&mut self, header: MavHeader, message: &MavMessage, now: Instant) {
        let Some(following) = &self.settings.following else { return };
        // Its own vehicle's place is nobody else's.
        if self.autopilot.state().system.is_some_and(|own| u32::from(own) == header.system_id) {
            return;
        }
        let of = following.movers.iter().position(|mover| header.system_id == u32::from(mover.system_id));
        let Some((index, (place, sent_s, std_m))) = of.zip(report(message)) else { return };
        let mover = &following.movers[index];
        let std_m = std_m.unwrap_or(mover.std_m);
        let position_enu_m = place.to_enu(self.settings.autopilot.mission_origin);
        // What is no number is not nearer either.
        if position_enu_m.norm() <= FARTHEST_M {
            self.followers.heard[index].take(position_enu_m, (sent_s, seconds(now)), std_m, mover);
        }
    }

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
            problem: Arc::clone(problem),
            user,
            eavesdroppers,
            limits: self.settings.limits.map(|limits| limits.of_motion()),
            turn_rate_rad_s: self.settings.limits.map(|limits| TURN_PART * limits.tilt_rate_rad_s),
            apart_m: clearance_m(&self.settings.airspace),
            rest,
            flies: PerVehicle { i: i?, j: j? },
            begins_s: places.begins().as_secs_f64(),
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
        }
        self.react(now);
    }

    fn take_motion(&mut self, ticket: Ticket, motion: Option<Motion>, now: Instant) {
        let current = self.service.slot().is_some_and(|slot| slot.commitment.proposal == ticket.proposal);
        if !current {
            return;
        }
        let digest = motion.as_ref().map(Motion::digest);
        if let Some(motion) = motion {
            self.followers.motions.push((ticket.number, Arc::new(motion)));
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

    /// The slot that is served, pose and power of both in it as this vehicle's motion has them, and what each may be told to radiate:
    /// by that motion or, so long as I may be on while J has not taken it up, by the one before. `None` where no motion is made anew.
    #[must_use]
    pub fn followed(&self, now: Instant) -> Option<(u16, PerVehicle<(VehiclePlan, f64)>)> {
        let slot = self.service.slot()?;
        let track = slot.track.as_ref().and_then(Track::followed)?;
        let rest = self.service.slot_vehicles()?;
        let since_s = now.seconds_since(slot.commitment.opens_at);
        let of = |role: Role| {
            let own = track.other(role, rest[role]);
            let behind = own.as_of(since_s - GRACE.as_secs_f64());
            // The other's clock may be ahead.
            let powers_w = [&own, &behind]
                .into_iter()
                .flat_map(|track| [0.0, APART_S].map(|s| track.tx_power_w(since_s + s)));
            (own.vehicle(since_s), powers_w.fold(0.0, f64::max))
        };
        Some((slot.commitment.slot, PerVehicle::from_fn(of)))
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

#[cfg(test)]
mod tests {
    use mavlink::dialects::ardupilotmega::{FOLLOW_TARGET_DATA, GLOBAL_POSITION_INT_DATA};

    use super::*;
    use crate::planner::following::Gait;

    const MOVER: Mover = Mover { who: Who::User(0), system_id: 51, gait: Gait::Drives, std_m: 3.0 };

    fn east(heard: &Heard, at_s: f64) -> f64 {
        heard.estimate.unwrap().at(at_s).position_enu_m.x
    }

    /// Eight metres a second to the east, told once a second; a report takes a tenth of a second or more.
    fn driven(delays_s: &[f64]) -> Heard {
        let mut heard = Heard::default();
        for (k, delay_s) in delays_s.iter().enumerate() {
            let (sent_s, at_s) = (500.0 + k as f64, 100.0 + k as f64);
            heard.take(Enu::new(8.0 * k as f64, 0.0, 0.0), (sent_s, at_s + delay_s), 0.5, &MOVER);
        }
        heard
    }

    #[test]
    fn spec_a_report_is_of_its_senders_time_however_late_it_comes() {
        let even = driven(&[0.1; 10]);
        let uneven = driven(&[0.1, 0.9, 0.1, 0.4, 0.8, 0.1, 0.7, 0.3, 0.9, 0.6]);
        assert_eq!(even.estimate, uneven.estimate);
        // By the fastest of them it is as late as that.
        assert!((east(&even, 109.1) - 72.0).abs() < 0.5, "{}", east(&even, 109.1));
    }

    #[test]
    fn spec_copies_and_what_was_overtaken_say_nothing() {
        let mut heard = driven(&[0.1; 5]);
        let before = heard.estimate;
        heard.take(Enu::new(32.0, 0.0, 0.0), (504.0, 104.9), 0.5, &MOVER);
        heard.take(Enu::new(24.0, 0.0, 0.0), (503.0, 104.95), 0.5, &MOVER);
        assert_eq!(heard.estimate, before);
    }

    #[test]
    fn spec_a_sender_that_starts_anew_or_has_no_clock_is_taken_by_receipt() {
        let mut heard = driven(&[0.1; 5]);
        for k in 5..9 {
            heard.take(
                Enu::new(8.0 * f64::from(k), 0.0, 0.0),
                (f64::from(k) - 4.0, 100.1 + f64::from(k)),
                0.5,
                &MOVER,
            );
        }
        assert!((east(&heard, 108.1) - 64.0).abs() < 0.5, "{}", east(&heard, 108.1));
        let mut heard = Heard::default();
        for k in 0..9 {
            heard.take(Enu::new(8.0 * f64::from(k), 0.0, 0.0), (0.0, 100.0 + f64::from(k)), 0.5, &MOVER);
        }
        assert!((east(&heard, 108.0) - 64.0).abs() < 0.5, "{}", east(&heard, 108.0));
    }

    #[test]
    fn spec_places_are_read_of_both_messages_and_of_no_other() {
        let (lat, lon) = (500_000_000, 140_000_000);
        let own = MavMessage::GLOBAL_POSITION_INT(GLOBAL_POSITION_INT_DATA {
            time_boot_ms: 1500,
            lat,
            lon,
            alt: 200_500,
            ..Default::default()
        });
        let place = Geodetic { lat_deg: 50.0, lon_deg: 14.0, alt_m: 200.5 };
        assert_eq!(report(&own), Some((place, 1.5, None)));
        let target = |position_cov: [f32; 3]| {
            MavMessage::FOLLOW_TARGET(FOLLOW_TARGET_DATA {
                timestamp: 1500,
                lat,
                lon,
                alt: 200.5,
                position_cov,
                ..Default::default()
            })
        };
        assert_eq!(report(&target([4.0, 1.0, 9.0])), Some((place, 1.5, Some(2.0))));
        for unknown in [[0.0; 3], [f32::NAN; 3], [-1.0, -2.0, 0.0]] {
            assert_eq!(report(&target(unknown)), Some((place, 1.5, None)));
        }
        assert_eq!(report(&MavMessage::HEARTBEAT(Default::default())), None);
    }
}
