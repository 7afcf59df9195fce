//! One companion's half of the pair protocol: mission exchange, propose, answer, commit, on station, leases,
//! silence out of turn, operator's orders, clock comparison.
//!
//! Nothing here raises a power: that is the interlock's (`service::interlock`), which reads `lease` and `peer`.

mod acquaintance;
mod follower;
mod leader;
mod motions;
mod shared_time;
mod terms;
#[cfg(test)]
mod tests;
mod timer;

use std::collections::VecDeque;
use std::time::Duration;

use crate::role::Role;
use crate::time::{Instant, Utc};

use super::adoption::Asked;
use super::clock::Offset;
use super::orders::Orders;
use super::peer::Peer;
use super::wire::{self, MavMessage, VeilwingAnswer, VeilwingSilence};
use acquaintance::{Acquaintance, Meeting};
use follower::Follower;
use leader::Leader;
use motions::{Motions, Outcome};
use shared_time::SharedTime;
pub use terms::{
    AskedSlot, Commitment, Drifting, Event, Local, MeasuredJitter, OF_POSES, Pace, Places, PlanTerms, Rest,
    Settings, SlotTerms, Vouch,
};
pub use timer::Timer;

const STATUS_EVERY: Duration = Duration::from_millis(100);
/// After its transit should have begun, the peer gets this long to say that it is committed as well.
const PEER_LATE: Duration = Duration::from_secs(1);
/// No two crystals, nor clocks that are fit for a slot, drift apart faster than this.
const MOST_DRIFT: f64 = 200e-6;
/// A clock is read no better than this, in seconds.
const READ_WITHIN_S: f64 = 1e-3;

/// What only one of the two does.
#[derive(Debug, Clone)]
enum Part {
    I(Leader),
    J(Follower),
}

/// The slot agreed on, and what the peer has said of it.
#[derive(Debug, Clone, Copy)]
struct Agreed {
    commitment: Commitment,
    /// It is committed as well ...
    peer_went_along: bool,
    /// ... and it is not, or not in time.
    peer_left: bool,
}

/// See the module.
///
/// # Calling contract
/// Tell it local facts (`set_*`) and what is wanted of it, hand it messages and time (`handle_*`), then drain
/// `poll_transmit` and `poll_event`. `handle_timeout` is due at `poll_timeout`, which any call may move.
#[derive(Debug, Clone)]
pub struct Coordinator {
    settings: Settings,
    plan: Option<PlanTerms>,
    /// As told last.
    local: Option<Local>,
    acquaintance: Acquaintance,
    time: SharedTime,
    part: Part,
    agreed: Option<Agreed>,
    /// Of the slot agreed on, where its motion is made anew while it is served.
    motions: Option<Motions>,
    orders: Orders,
    silences: u32,
    status_sequence: u32,
    next_status: Instant,
    transmit: VecDeque<MavMessage>,
    events: VecDeque<Event>,
}

impl Coordinator {
    /// A coordinator that has heard nothing yet.
    #[must_use]
    pub fn new(settings: Settings, now: Instant) -> Self {
        Self {
            plan: None,
            local: None,
            acquaintance: Acquaintance::new(&settings, now),
            time: SharedTime::new(settings.clock_tolerance, now),
            part: match settings.role {
                Role::I => Part::I(Leader::new(settings.boot_id)),
                Role::J => Part::J(Follower::default()),
            },
            agreed: None,
            motions: None,
            orders: Orders::new(settings.orders),
            silences: 0,
            status_sequence: 0,
            next_status: now,
            transmit: VecDeque::new(),
            events: VecDeque::new(),
            settings,
        }
    }

    /// Our plan, once it is made.
    pub fn set_plan(&mut self, plan: PlanTerms) {
        self.plan = Some(plan);
        self.acquaintance.compare_again();
    }

    /// Local facts; a change of what the peer acts on is told at once.
    pub fn set_local(&mut self, local: Local, now: Instant) {
        let flags =
            |l: &Local| (l.airborne, l.on_station, l.radiating, l.ended, l.landed, l.returning, l.guarding);
        let acts_on = |l: &Local| (flags(l), l.rests);
        if self.orders.poll_untold() || self.local.as_ref().map(acts_on) != Some(acts_on(&local)) {
            self.next_status = now;
        }
        self.local = Some(local);
    }

    /// What is known of ourselves. Until we are told, nobody has found our transmitter off: a former process of ours may have
    /// left it on.
    fn local(&self) -> Local {
        self.local.unwrap_or(Local { radiating: true, ..Local::default() })
    }

    /// UTC at `now`, from our autopilot. A step of it makes every comparison with the peer's clock void.
    pub fn set_utc(&mut self, utc: Option<Utc>, now: Instant) {
        self.time.set_utc(utc, now);
    }

    /// J: the slot that comes next; `None` refuses all.
    pub fn set_readiness(&mut self, next_slot: Option<u16>) {
        if let Part::J(follower) = &mut self.part {
            follower.readiness = next_slot;
        }
    }

    /// J: the slot that I has proposed last, since the last one was over.
    #[must_use]
    pub fn asked(&self) -> Option<u16> {
        match &self.part {
            Part::I(_) => None,
            Part::J(follower) => follower.asked,
        }
    }

    /// A slot is planned anew, with the way to it, from where both rest, and perhaps those after it: they take the place of those that
    /// the plan has, or that were made before; `None`, for J: nothing was found. What is agreed on stays.
    pub fn slot_planned(&mut self, asked: &AskedSlot, terms: Option<Vec<SlotTerms>>, now: Instant) {
        let awaited = match &mut self.part {
            Part::I(leader) => !leader.is_proposing(),
            Part::J(follower) => follower.made_anew(asked),
        };
        let own = self.plan.as_mut().and_then(|plan| plan.slots.get_mut(usize::from(asked.slot)..));
        if let (true, None, Some((own, terms))) = (awaited, self.agreed, own.zip(terms)) {
            own.iter_mut().zip(terms).for_each(|(own, terms)| *own = terms);
        }
        let waiting = match &mut self.part {
            Part::J(follower) if awaited => follower.take_waiting(),
            Part::I(_) | Part::J(_) => None,
        };
        if let Some(propose) = waiting {
            self.take_proposal(&propose, now);
        }
    }

    /// I: proposes that `slot` opens at `opens`; with `places`, those that its poses were made anew for. Replaces a proposal not
    /// yet agreed on. Without our UTC and a plan that has this slot nothing is proposed; with clocks that differ too much, or are
    /// not compared yet, it is refused at once.
    pub fn propose(&mut self, slot: u16, opens: Utc, places: Option<Places>, now: Instant) {
        let (Some(opens_at), Some(lead)) =
            (self.time.instant_of(opens), self.slot_terms(slot).map(|terms| terms.lead))
        else {
            return;
        };
        let Part::I(leader) = &mut self.part else { return };
        self.agreed = None;
        if self.time.agrees() {
            leader.propose(slot, opens, (opens_at - lead, opens_at), places, now);
        } else {
            leader.withdraw();
            self.events.push_back(Event::Refused(slot, VeilwingAnswer::VEILWING_ANSWER_CLOCK));
        }
    }

    /// The committed slot is over, served or not.
    pub fn release(&mut self, now: Instant) {
        let agreed = self.agreed.take();
        self.motions = None;
        match &mut self.part {
            Part::I(leader) => leader.give_up(now),
            Part::J(follower) => follower.release(agreed.map(|agreed| agreed.commitment)),
        }
        self.next_status = now;
    }

    /// The committed slot has ended by the clock at `closes_at`, and the next one carries it on: it is agreed on from now on, by
    /// what was agreed on before. `None`, and nothing is changed, where the plan has it otherwise, or where the peer is not known
    /// to be still in it.
    pub fn carry_on(&mut self, closes_at: Instant) -> Option<Commitment> {
        let agreed = self.agreed.filter(|agreed| agreed.peer_went_along && !agreed.peer_left)?;
        let slot = agreed.commitment.slot.checked_add(1)?;
        let foreseen = closes_at + self.slot_terms(slot)?.carries_on_after?;
        let takes = foreseen.saturating_since(agreed.commitment.opens_at);
        let opens = agreed.commitment.opens + takes;
        // Two crystals drift apart over many slots; a step of a clock moves none.
        let by_clock = match &self.part {
            Part::I(_) => self.time.instant_of(opens),
            Part::J(_) => self.time.instant_by_peer(opens),
        };
        let most_s = takes.as_secs_f64() * MOST_DRIFT;
        let off_s = by_clock.map(|at| at.seconds_since(foreseen)).filter(|off_s| off_s.abs() > READ_WITHIN_S);
        let opens_at = foreseen.after_s(off_s.unwrap_or(0.0).clamp(-most_s, most_s));
        let commitment = Commitment { slot, opens_at, opens, leaves_at: closes_at, ..agreed.commitment };
        self.agreed = Some(Agreed { commitment, ..agreed });
        Some(commitment)
    }

    /// I: whether a motion may be asked for in the slot agreed on.
    #[must_use]
    pub fn may_ask_motion(&self, now: Instant) -> bool {
        self.motions.as_ref().is_some_and(|motions| motions.may_ask(now))
    }

    /// I: asks for a motion in the slot agreed on, for those that move.
    pub fn ask_motion(&mut self, places: Places, now: Instant) {
        let event = self.motions.as_mut().and_then(|motions| motions.ask(places, now));
        self.events.extend(event);
        self.advance_motions(now);
    }

    /// The motion that was asked for last in the slot agreed on.
    #[must_use]
    pub fn asked_motion(&self) -> Option<&Asked<Places>> {
        self.motions.as_ref().and_then(Motions::asked)
    }

    /// The motion of this number is made here, with this digest, or none was found.
    pub fn motion_planned(&mut self, number: u16, digest: Option<u64>, now: Instant) {
        let outcome = self.motions.as_mut().map(|motions| motions.planned(number, digest, now));
        self.take_outcome(outcome, now);
    }

    /// I: whether J flies the same motion, or nearly; where none is made anew, it does.
    #[must_use]
    pub fn flies_alike(&self, now: Instant) -> bool {
        self.motions.as_ref().is_none_or(|motions| motions.agrees(now))
    }

    /// I: the motion that is taken up asks J for more power, from then on, than what it goes on from: leases that were asked for before J
    /// had made it hold no longer.
    pub fn motion_outgrows(&mut self, outgrown_at: Instant) {
        let made_at = self.motions.as_ref().and_then(Motions::made_at);
        if let (Part::I(leader), Some(made_at)) = (&mut self.part, made_at) {
            leader.holder.outgrow(outgrown_at, made_at);
        }
    }

    fn take_outcome(&mut self, outcome: Option<Outcome>, now: Instant) {
        let (event, message) = outcome.unwrap_or((None, None));
        self.events.extend(event);
        self.transmit.extend(message);
        self.advance_motions(now);
    }

    fn advance_motions(&mut self, now: Instant) {
        let due = self.motions.as_mut().map(|motions| motions.advance(now));
        self.transmit.extend(due.into_iter().flatten().flatten());
    }

    fn take_places(&mut self, places: &wire::VEILWING_PLACES_DATA, now: Instant) {
        if !self.acquaintance.peer().is_boot(places.boot_id) {
            return;
        }
        if let (OF_POSES, Part::J(follower)) = (places.number, &mut self.part) {
            follower.take_places(places.proposal, Places::of_wire(places));
        } else {
            let outcome = self.motions.as_mut().map(|motions| motions.take_places(places));
            self.take_outcome(outcome, now);
        }
    }

    fn take_motion(&mut self, motion: &wire::VEILWING_MOTION_DATA, now: Instant) {
        let alike = self.flies_alike(now);
        let outcome = self.motions.as_mut().map(|motions| motions.take_motion(motion, now));
        // J has only now taken it up: it vouched for being elsewhere until then.
        let catches_up = !alike && self.flies_alike(now);
        if let Part::I(leader) = &mut self.part
            && catches_up
        {
            leader.holder.outgrow(now, now);
        }
        self.take_outcome(outcome, now);
    }

    /// I: whether leases are asked for.
    pub fn want_lease(&mut self, wanted: bool, now: Instant) {
        if let Part::I(leader) = &mut self.part {
            leader.want_lease(wanted, now);
        }
    }

    /// J: what leases may rest on; `None` grants nothing.
    pub fn set_vouch(&mut self, vouch: Option<Vouch>) {
        if let Part::J(follower) = &mut self.part {
            follower.vouch = vouch;
        }
    }

    /// We fell silent out of turn: the peer is told at once. Three copies, since a lost one costs a lease's length.
    pub fn silent(&mut self, reason: VeilwingSilence, now: Instant) {
        match &mut self.part {
            Part::I(leader) => leader.holder.give_up(now),
            Part::J(follower) => follower.vouch = None,
        }
        let (proposal, slot) = self.commitment().map_or((0, 0), |c| (c.proposal, c.slot));
        self.silences += 1;
        let message = wire::VEILWING_SILENT_DATA {
            boot_id: self.settings.boot_id,
            number: self.silences,
            proposal,
            slot,
            reason,
        };
        self.transmit.extend((0..3).map(|_| MavMessage::VEILWING_SILENT(message.clone())));
    }

    /// The operator's orders.
    #[must_use]
    pub fn orders(&self) -> &Orders {
        &self.orders
    }

    /// The operator's orders, to give some. The peer is told at the next [`set_local`](Self::set_local), and what comes
    /// about follows as [`Event::Ordered`].
    pub fn orders_mut(&mut self) -> &mut Orders {
        &mut self.orders
    }

    /// I: the end of the lease in force.
    #[must_use]
    pub fn lease(&self, now: Instant) -> Option<Instant> {
        match &self.part {
            Part::I(leader) if self.agreed.is_some() => leader.holder.held(now),
            Part::I(_) | Part::J(_) => None,
        }
    }

    /// The longest lease J grants.
    #[must_use]
    pub fn longest_lease(&self) -> Duration {
        self.settings.lease
    }

    /// J: whether I may hold a lease.
    #[must_use]
    pub fn leases_outstanding(&self, now: Instant) -> bool {
        matches!(&self.part, Part::J(follower) if follower.book.outstanding(now))
    }

    /// J: until when I may hold a lease at the most.
    #[must_use]
    pub fn leases_end(&self) -> Option<Instant> {
        match &self.part {
            Part::I(_) => None,
            Part::J(follower) => follower.book.outstanding_until(),
        }
    }

    /// The slot agreed on.
    #[must_use]
    pub fn commitment(&self) -> Option<Commitment> {
        self.agreed.map(|agreed| agreed.commitment)
    }

    /// Whether a proposal awaits its answer or its commit.
    #[must_use]
    pub fn is_proposing(&self) -> bool {
        match &self.part {
            Part::I(leader) => leader.is_proposing(),
            Part::J(follower) => follower.is_accepting(),
        }
    }

    /// The other side.
    #[must_use]
    pub fn peer(&self) -> &Peer {
        self.acquaintance.peer()
    }

    /// The terms of a slot of the plan.
    #[must_use]
    pub fn slot_terms(&self, slot: u16) -> Option<&SlotTerms> {
        self.plan.as_ref()?.slots.get(usize::from(slot))
    }

    /// Peer's UTC against ours.
    #[must_use]
    pub fn clock_offset(&self) -> Option<Offset> {
        self.time.offset()
    }

    /// Whether UTC is known to be the same on both sides, as far as the guard time asks for.
    #[must_use]
    pub fn clocks_agree(&self) -> bool {
        self.time.agrees()
    }

    /// Whether mission and plan are known to be the same on both sides.
    #[must_use]
    pub fn agrees(&self) -> bool {
        self.plan.as_ref().is_some_and(|plan| self.acquaintance.agrees(&plan.digest))
    }

    /// The next event.
    pub fn poll_event(&mut self) -> Option<Event> {
        self.events.pop_front().or_else(|| self.orders.poll_change().map(Event::Ordered))
    }

    /// The next message to send.
    pub fn poll_transmit(&mut self) -> Option<MavMessage> {
        self.transmit.pop_front()
    }

    /// When `handle_timeout` must be called next, and for what.
    #[must_use]
    pub fn poll_timeout(&self) -> (Instant, Timer) {
        let leader = match &self.part {
            Part::I(leader) => Some(leader),
            Part::J(_) => None,
        };
        let request = leader.filter(|_| self.agreed.is_some()).and_then(Leader::request_due);
        let others = [
            (Some(self.next_status), Timer::Status),
            (Some(self.time.due), Timer::Clock),
            (leader.and_then(Leader::proposal_due), Timer::Proposal),
            (self.orders.poll_timeout(), Timer::Start),
            (request, Timer::LeaseRequest),
            (self.motions.as_ref().and_then(Motions::timeout), Timer::Motion),
            (self.acquaintance.lost_due(), Timer::PeerLost),
        ];
        let due = others.into_iter().filter_map(|(at, timer)| at.map(|at| (at, timer)));
        due.fold(
            (self.acquaintance.due, Timer::Hello),
            |first, next| if next.0 < first.0 { next } else { first },
        )
    }

    /// Sends what is due.
    pub fn handle_timeout(&mut self, now: Instant) {
        if self.acquaintance.due <= now {
            let plan_digest = self.plan.as_ref().map(|plan| plan.digest);
            let hello = self.acquaintance.hello(&self.local(), self.agreed.is_some(), plan_digest, now);
            self.transmit.push_back(hello);
        }
        if self.next_status <= now {
            self.next_status = now + STATUS_EVERY;
            let status = self.status(now);
            self.transmit.push_back(status);
        }
        self.transmit.extend(self.time.ask(now));
        self.advance_proposal(now);
        self.orders.handle_timeout(now);
        if let (Part::I(leader), Some(agreed)) = (&mut self.part, self.agreed) {
            self.transmit.extend(leader.request(agreed.commitment, now));
        }
        self.advance_motions(now);
        self.events.extend(self.acquaintance.lost(now).map(Event::PeerLost));
    }

    /// Takes a message of the peer. What does not fit the present state changes nothing.
    pub fn handle_message(&mut self, message: &MavMessage, now: Instant) {
        match message {
            MavMessage::VEILWING_HELLO(hello) => self.take_hello(hello, now),
            MavMessage::VEILWING_STATUS(status) => self.take_status(status, now),
            MavMessage::VEILWING_PROPOSE(propose) => self.take_proposal(propose, now),
            MavMessage::VEILWING_ANSWER(answer) => self.take_answer(answer, now),
            MavMessage::VEILWING_COMMIT(commit) => self.take_commit(commit, now),
            MavMessage::VEILWING_LEASE_REQUEST(request) => self.take_request(request, now),
            MavMessage::VEILWING_LEASE_GRANT(grant) => self.take_grant(grant, now),
            MavMessage::VEILWING_SILENT(silent) => self.take_silence(silent, now),
            MavMessage::VEILWING_PLACES(places) => self.take_places(places, now),
            MavMessage::VEILWING_MOTION(motion) => self.take_motion(motion, now),
            MavMessage::VEILWING_CLOCK(clock) => self.transmit.extend(self.time.take(clock, now)),
            // Of the link, which keeps them to itself where it is signed.
            MavMessage::VEILWING_CHALLENGE(_) | MavMessage::VEILWING_RESPONSE(_) => {}
        }
    }

    fn status(&mut self, now: Instant) -> MavMessage {
        self.status_sequence += 1;
        let (proposal, slot) = self.commitment().map_or((0, 0), |c| (c.proposal, c.slot));
        let local = self.local();
        let position = local.position_enu_m.map_or([f32::NAN; 3], narrow);
        let released_at = match &mut self.part {
            _ if local.radiating => None,
            Part::I(leader) => leader.released_at(now),
            Part::J(_) => Some(now),
        };
        let mut status = wire::VEILWING_STATUS_DATA {
            released_us: released_at.map_or(0, micros),
            boot_id: self.settings.boot_id,
            sequence: self.status_sequence,
            proposal,
            position_enu_m: position,
            slot,
            flags: local.flags(self.plan.is_some(), self.agreed.is_some()),
            time_us: micros(now),
            rests_enu_m: local.rests.map_or([0.0; 3], |rest| rest.position_enu_m),
            rests_wxyz: local.rests.map_or([0.0; 4], |rest| rest.wxyz),
            jitter_cdeg: MeasuredJitter::to_wire(local.jitter),
            pace_percent: Pace::to_wire(local.pace),
            ..Default::default()
        };
        self.orders.say(&mut status);
        MavMessage::VEILWING_STATUS(status)
    }

    fn take_hello(&mut self, hello: &wire::VEILWING_HELLO_DATA, now: Instant) {
        match self.acquaintance.take(hello, now) {
            Meeting::Nobody => return,
            Meeting::SameRole { first } => {
                self.events.extend(first.then_some(Event::SameRole));
                return;
            }
            Meeting::Known => {}
            Meeting::First => self.events.push_back(Event::PeerFound),
            Meeting::Restarted => {
                self.release(now);
                if let Part::J(follower) = &mut self.part {
                    follower.new_boot();
                }
                self.orders.new_boot();
                self.time.reset();
                self.events.push_back(Event::PeerRestarted);
            }
        }
        self.events.extend(self.acquaintance.mismatch(self.plan.as_ref().map(|plan| plan.digest)));
    }

    fn take_status(&mut self, status: &wire::VEILWING_STATUS_DATA, now: Instant) {
        if !self.acquaintance.take_status(status, now) {
            return;
        }
        self.orders.hear(status, now);
        match &mut self.part {
            Part::J(follower) => follower.book.returned(status.released_us),
            Part::I(leader) => {
                if let Some(commitment) = leader.confirmed(self.acquaintance.peer().committed, now) {
                    self.agree(commitment, now);
                }
            }
        }
        self.compare_commitments(now);
    }

    /// Whether the other is (still) with us in the slot agreed on.
    fn compare_commitments(&mut self, now: Instant) {
        let Some(agreed) = self.agreed.as_mut() else { return };
        if self.acquaintance.peer().committed == Some(agreed.commitment.proposal) {
            agreed.peer_went_along = true;
        } else if (agreed.peer_went_along || now >= agreed.commitment.leaves_at + PEER_LATE)
            && !agreed.peer_left
        {
            agreed.peer_left = true;
            self.events.push_back(Event::PeerLeft);
        }
    }

    fn agree(&mut self, commitment: Commitment, now: Instant) {
        self.agreed = Some(Agreed { commitment, peer_went_along: false, peer_left: false });
        let leader_boot = match self.settings.role {
            Role::I => Some(self.settings.boot_id),
            Role::J => self.acquaintance.peer().boot_id,
        };
        let follows = self.slot_terms(commitment.slot).is_some_and(SlotTerms::follows);
        self.motions = leader_boot
            .filter(|_| follows)
            .map(|boot_id| Motions::new(self.settings.role, boot_id, commitment));
        self.next_status = now;
        self.events.push_back(Event::Committed(commitment));
    }

    /// I: sends what is due, and withdraws what was not agreed on in time.
    fn advance_proposal(&mut self, now: Instant) {
        let (Part::I(leader), Some(plan)) = (&mut self.part, &self.plan) else { return };
        match leader.advance(plan, now) {
            Ok(messages) => self.transmit.extend(messages.into_iter().flatten()),
            Err((slot, why)) => self.events.push_back(Event::Refused(slot, why)),
        }
    }

    fn take_answer(&mut self, answer: &wire::VEILWING_ANSWER_DATA, now: Instant) {
        let Part::I(leader) = &mut self.part else { return };
        match leader.take_answer(answer, now) {
            Ok(()) => self.advance_proposal(now),
            Err((slot, why)) => self.events.push_back(Event::Refused(slot, why)),
        }
    }

    fn take_proposal(&mut self, propose: &wire::VEILWING_PROPOSE_DATA, now: Instant) {
        let committed = self.commitment();
        if let Part::J(follower) = &mut self.part
            && self.acquaintance.peer().is_boot(propose.boot_id)
        {
            let plan = self.plan.as_ref();
            let (event, answer) = follower.take_proposal(propose, committed, plan, &self.time, now);
            self.events.extend(event);
            self.transmit.extend(answer);
        }
    }

    fn take_commit(&mut self, commit: &wire::VEILWING_COMMIT_DATA, now: Instant) {
        let known = self.commitment().is_some_and(|c| c.proposal == commit.proposal);
        let Part::J(follower) = &mut self.part else { return };
        if !self.acquaintance.peer().is_boot(commit.boot_id) {
            return;
        }
        if known {
            self.next_status = now; // I has not heard yet.
        } else if let Some(commitment) = follower.take_commit(commit, self.plan.as_ref(), now) {
            self.agree(commitment, now);
        }
    }

    fn take_request(&mut self, request: &wire::VEILWING_LEASE_REQUEST_DATA, now: Instant) {
        let of_slot = |c: &Commitment| c.proposal == request.proposal && c.slot == request.slot;
        let commitment = self.commitment().filter(of_slot);
        let (Part::J(follower), Some(commitment), Some(plan)) = (&mut self.part, commitment, &self.plan)
        else {
            return;
        };
        if !self.acquaintance.peer().is_boot(request.boot_id) {
            return;
        }
        // A lease counts from its request: what that was held up for is over, and J does not jam for it.
        let left = self.settings.lease.saturating_sub(self.acquaintance.asked(request.time_us, now));
        self.transmit.extend(follower.take_request(request, commitment, plan, left, now));
    }

    fn take_grant(&mut self, grant: &wire::VEILWING_LEASE_GRANT_DATA, now: Instant) {
        let commitment = self.commitment();
        if let (Part::I(leader), Some(commitment), Some(plan)) = (&mut self.part, commitment, &self.plan)
            && leader.take_grant(grant, commitment, plan, self.settings.lease, now)
        {
            self.acquaintance.heard(now);
        }
    }

    fn take_silence(&mut self, silent: &wire::VEILWING_SILENT_DATA, now: Instant) {
        let current = self.commitment().is_some_and(|c| c.proposal == silent.proposal);
        if current && self.acquaintance.take_silence(silent) {
            if let Part::I(leader) = &mut self.part {
                leader.holder.give_up(now);
            }
            self.events.push_back(Event::PeerSilent(silent.reason));
        }
    }
}

fn micros(at: Instant) -> u64 {
    u64::try_from(at.since_start().as_micros()).unwrap_or(u64::MAX)
}

fn narrow(v: nalgebra::Vector3<f64>) -> [f32; 3] {
    [v.x as f32, v.y as f32, v.z as f32]
}
