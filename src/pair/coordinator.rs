//! One companion's half of the pair protocol: mission exchange, propose, answer, commit, on station, leases,
//! silence out of turn, operator's orders, clock comparison.
//!
//! The executive tells it local facts (`set_*`), hands it messages and time, and reads commitments and leases from
//! it. Nothing here raises a power: that is the interlock's (mission::interlock), which reads `lease` and `peer`.

mod agreement;
mod messages;
mod terms;
#[cfg(test)]
mod tests;

use std::collections::VecDeque;
use std::time::Duration;

use crate::role::Role;
use crate::time::{Instant, Utc};

use super::clock::{ClockFilter, Offset};
use super::lease::{Book, Holder};
use super::peer::Peer;
use super::wire::{self, MavMessage, VeilwingOrder, VeilwingSilence};
use agreement::Proposal;
pub use terms::{Commitment, Event, Local, PlanTerms, Readiness, Settings, Vouch};

const HELLO_EVERY: Duration = Duration::from_millis(500);
const STATUS_EVERY: Duration = Duration::from_millis(100);
/// A hello that calls for an answer gets it at once, but no more often than this.
const HELLO_AT_MOST: Duration = Duration::from_millis(50);
const REQUEST_EVERY: Duration = Duration::from_millis(50);
const CLOCK_EVERY: Duration = Duration::from_millis(1000);
const ORDER_EVERY: Duration = Duration::from_millis(200);

/// How far I's proposal has come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Stage {
    /// Awaits J's answer (on J's side: I's commit).
    Proposed,
    /// Accepted; awaits J's word that it is committed.
    Committing,
}

#[derive(Debug, Clone, Copy)]
struct PendingOrder {
    number: u32,
    order: VeilwingOrder,
    next_send: Instant,
}

/// See the module.
#[derive(Debug, Clone)]
pub struct Coordinator {
    settings: Settings,
    plan: Option<PlanTerms>,
    local: Local,
    utc: Option<(Utc, Instant)>,
    readiness: Option<Readiness>,
    peer: Peer,
    clock: ClockFilter,
    proposals: u32,
    /// I: awaiting an answer, then J's commitment. J: accepted, awaiting the commit.
    proposal: Option<Proposal>,
    commitment: Option<Commitment>,
    /// The peer said that it is committed to our commitment ...
    peer_went_along: bool,
    /// ... and that it is not, or not in time.
    peer_left: bool,
    /// J: proposals up to this one of I's present boot are over.
    finished: u32,
    wants_lease: bool,
    vouch: Option<Vouch>,
    holder: Holder,
    book: Book,
    order: Option<PendingOrder>,
    orders_taken: Option<u32>,
    orders: u32,
    silences: u32,
    status_sequence: u32,
    lost_reported: bool,
    mismatch_reported: bool,
    hello_sent: Option<Instant>,
    next_hello: Instant,
    next_status: Instant,
    next_request: Instant,
    next_clock: Instant,
    transmit: VecDeque<MavMessage>,
    events: VecDeque<Event>,
}

impl Coordinator {
    /// A coordinator that has heard nothing yet.
    #[must_use]
    pub fn new(settings: Settings, now: Instant) -> Self {
        Self {
            settings,
            plan: None,
            local: Local::default(),
            utc: None,
            readiness: None,
            peer: Peer::default(),
            clock: ClockFilter::default(),
            proposals: 0,
            proposal: None,
            commitment: None,
            peer_went_along: false,
            peer_left: false,
            finished: 0,
            wants_lease: false,
            vouch: None,
            holder: Holder::default(),
            book: Book::default(),
            order: None,
            orders_taken: None,
            orders: 0,
            silences: 0,
            status_sequence: 0,
            lost_reported: false,
            mismatch_reported: false,
            hello_sent: None,
            next_hello: now,
            next_status: now,
            next_request: now,
            next_clock: now,
            transmit: VecDeque::new(),
            events: VecDeque::new(),
        }
    }

    /// Our plan, once it is made.
    pub fn set_plan(&mut self, plan: PlanTerms) {
        self.plan = Some(plan);
        self.mismatch_reported = false;
    }

    /// Local facts; a change of what the peer acts on is told at once.
    pub fn set_local(&mut self, local: Local, now: Instant) {
        let acts_on =
            |l: &Local| (l.airborne, l.on_station, l.radiating, l.ended, l.landed, l.returning, l.paused);
        if acts_on(&local) != acts_on(&self.local) {
            self.next_status = now;
        }
        self.local = local;
    }

    /// UTC at `now`, from our autopilot. A step of it makes every comparison with the peer's clock void.
    pub fn set_utc(&mut self, utc: Option<Utc>, now: Instant) {
        if let (Some(expected), Some(utc)) = (self.utc_at(now), utc) {
            let step = Duration::from_micros(expected.unix_us.abs_diff(utc.unix_us));
            if step > self.settings.clock_tolerance / 2 {
                self.clock.reset();
                self.next_clock = now;
            }
        }
        self.utc = utc.map(|utc| (utc, now));
    }

    /// J: what a proposal is judged by; `None` refuses all.
    pub fn set_readiness(&mut self, readiness: Option<Readiness>) {
        self.readiness = readiness;
    }

    /// The committed slot is over, served or not.
    pub fn release(&mut self, now: Instant) {
        if let Some(commitment) = self.commitment.take() {
            self.finished = self.finished.max(commitment.proposal);
        }
        if let Some(proposal) = self.proposal.take().filter(|_| !self.leads()) {
            self.finished = self.finished.max(proposal.commitment.proposal);
        }
        self.peer_went_along = false;
        self.peer_left = false;
        self.wants_lease = false;
        self.vouch = None;
        self.holder.give_up(now);
        self.next_status = now;
    }

    /// I: whether leases are asked for.
    pub fn want_lease(&mut self, wanted: bool, now: Instant) {
        if wanted && !self.wants_lease {
            self.next_request = now;
        }
        if !wanted && self.wants_lease {
            self.holder.give_up(now);
        }
        self.wants_lease = wanted;
    }

    /// J: what leases may rest on; `None` grants nothing.
    pub fn set_vouch(&mut self, vouch: Option<Vouch>) {
        self.vouch = vouch;
    }

    /// We fell silent out of turn: the peer is told at once. Three copies, since a lost one costs a lease's length.
    pub fn silent(&mut self, reason: VeilwingSilence, now: Instant) {
        self.holder.give_up(now);
        self.vouch = None;
        let (proposal, slot) = self.commitment.map_or((0, 0), |c| (c.proposal, c.slot));
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

    /// An operator's order for the peer as well; repeated until acknowledged.
    pub fn order(&mut self, order: VeilwingOrder, now: Instant) {
        self.orders += 1;
        self.order = Some(PendingOrder { number: self.orders, order, next_send: now });
    }

    /// I: the end of the lease in force.
    #[must_use]
    pub fn lease(&self, now: Instant) -> Option<Instant> {
        self.commitment.and_then(|_| self.holder.held(now))
    }

    /// The longest lease J grants.
    #[must_use]
    pub fn longest_lease(&self) -> Duration {
        self.settings.lease
    }

    /// J: whether I may hold a lease.
    #[must_use]
    pub fn leases_outstanding(&self, now: Instant) -> bool {
        self.book.outstanding(now)
    }

    /// The slot agreed on.
    #[must_use]
    pub fn commitment(&self) -> Option<Commitment> {
        self.commitment
    }

    /// Whether a proposal awaits its answer or its commit.
    #[must_use]
    pub fn is_proposing(&self) -> bool {
        self.proposal.is_some()
    }

    /// The other side.
    #[must_use]
    pub fn peer(&self) -> &Peer {
        &self.peer
    }

    /// Peer's UTC against ours.
    #[must_use]
    pub fn clock_offset(&self) -> Option<Offset> {
        self.clock.offset()
    }

    /// Whether mission and plan are known to be the same on both sides.
    #[must_use]
    pub fn agrees(&self) -> bool {
        self.peer.mission_digest == Some(self.settings.mission_digest)
            && self.plan.as_ref().is_some_and(|plan| self.peer.plan_digest == Some(plan.digest))
    }

    /// The next event.
    pub fn poll_event(&mut self) -> Option<Event> {
        self.events.pop_front()
    }

    /// The next message to send.
    pub fn poll_transmit(&mut self) -> Option<MavMessage> {
        self.transmit.pop_front()
    }

    /// When `handle_timeout` must be called next, and why.
    #[must_use]
    pub fn poll_timeout(&self) -> (Instant, &'static str) {
        let mut next = (self.next_hello, "hello");
        let mut consider = |at: Option<Instant>, why| {
            if let Some(at) = at
                && at < next.0
            {
                next = (at, why);
            }
        };
        consider(Some(self.next_status), "status");
        consider(Some(self.next_clock), "clock exchange");
        let proposal = self.proposal.filter(|_| self.leads());
        consider(proposal.map(|p| p.next_send.min(p.commitment.leaves_at)), "proposal");
        consider(self.order.map(|o| o.next_send), "order");
        consider(
            (self.wants_lease && self.commitment.is_some()).then_some(self.next_request),
            "lease request",
        );
        let lost = self.peer.last_heard.filter(|_| !self.lost_reported);
        consider(lost.map(|at| at + self.settings.peer_timeout + Duration::from_nanos(1)), "peer lost");
        next
    }

    /// Sends what is due.
    pub fn handle_timeout(&mut self, now: Instant) {
        if self.next_hello <= now {
            self.next_hello = now + HELLO_EVERY;
            self.hello_sent = Some(now);
            let hello = self.hello(now);
            self.transmit.push_back(hello);
        }
        if self.next_status <= now {
            self.next_status = now + STATUS_EVERY;
            let status = self.status(now);
            self.transmit.push_back(status);
        }
        if self.next_clock <= now {
            self.next_clock = now + CLOCK_EVERY;
            if let Some(utc) = self.utc_at(now) {
                self.clock.ask(utc.unix_us);
                let request =
                    wire::VEILWING_CLOCK_DATA { originate_us: utc.unix_us, receive_us: 0, transmit_us: 0 };
                self.transmit.push_back(MavMessage::VEILWING_CLOCK(request));
            }
        }
        self.advance_proposal(now);
        if let Some(order) = self.order.as_mut().filter(|order| order.next_send <= now) {
            order.next_send = now + ORDER_EVERY;
            self.transmit.push_back(MavMessage::VEILWING_ORDER_RELAY(wire::VEILWING_ORDER_RELAY_DATA {
                boot_id: self.settings.boot_id,
                number: order.number,
                order: order.order,
            }));
        }
        if let Some(commitment) = self.commitment.filter(|_| self.wants_lease && self.next_request <= now) {
            self.next_request = now + REQUEST_EVERY;
            self.transmit.push_back(MavMessage::VEILWING_LEASE_REQUEST(wire::VEILWING_LEASE_REQUEST_DATA {
                time_us: messages::micros(now),
                boot_id: self.settings.boot_id,
                proposal: commitment.proposal,
                slot: commitment.slot,
            }));
        }
        if let Some(heard) = self.peer.last_heard {
            let silent_for = now.saturating_since(heard);
            if silent_for > self.settings.peer_timeout && !self.lost_reported {
                self.lost_reported = true;
                self.events.push_back(Event::PeerLost(silent_for));
            }
        }
    }

    /// Takes a message of the peer. What does not fit the present state changes nothing.
    pub fn handle_message(&mut self, message: &MavMessage, now: Instant) {
        match message {
            MavMessage::VEILWING_HELLO(hello) => self.take_hello(hello, now),
            MavMessage::VEILWING_STATUS(status) => {
                if self.peer.is_boot(status.boot_id) && self.peer.take_status(status, now) {
                    self.lost_reported = false;
                    self.book.returned(status.released_us);
                    self.compare_commitments(now);
                }
            }
            MavMessage::VEILWING_PROPOSE(propose) => self.take_proposal(propose, now),
            MavMessage::VEILWING_ANSWER(answer) => self.take_answer(answer, now),
            MavMessage::VEILWING_COMMIT(commit) => self.take_commit(commit, now),
            MavMessage::VEILWING_LEASE_REQUEST(request) => self.take_request(request, now),
            MavMessage::VEILWING_LEASE_GRANT(grant) => self.take_grant(grant, now),
            MavMessage::VEILWING_SILENT(silent) => {
                let current = self.commitment.is_some_and(|c| c.proposal == silent.proposal);
                if self.peer.is_boot(silent.boot_id) && current && self.peer.take_silence(silent.number) {
                    self.holder.give_up(now);
                    self.events.push_back(Event::PeerSilent(silent.reason));
                }
            }
            MavMessage::VEILWING_ORDER_RELAY(order) => {
                if self.peer.is_boot(order.boot_id) {
                    let ack = wire::VEILWING_ORDER_ACK_DATA { boot_id: order.boot_id, number: order.number };
                    self.transmit.push_back(MavMessage::VEILWING_ORDER_ACK(ack));
                    if self.orders_taken.is_none_or(|taken| order.number > taken) {
                        self.orders_taken = Some(order.number);
                        self.events.push_back(Event::Ordered(order.order));
                    }
                }
            }
            MavMessage::VEILWING_ORDER_ACK(ack) => {
                let ours = ack.boot_id == self.settings.boot_id;
                self.order = self.order.filter(|order| !(ours && order.number == ack.number));
            }
            MavMessage::VEILWING_CLOCK(clock) => self.take_clock(clock, now),
        }
    }

    fn leads(&self) -> bool {
        self.settings.role == Role::I
    }

    fn heard(&mut self, now: Instant) {
        self.peer.last_heard = Some(now);
        self.lost_reported = false;
    }

    fn utc_at(&self, now: Instant) -> Option<Utc> {
        self.utc.map(|(utc, at)| utc + now.saturating_since(at))
    }

    fn instant_of(&self, utc: Utc) -> Option<Instant> {
        let (known, at) = self.utc?;
        if utc >= known {
            Some(at + Duration::from_micros(utc.unix_us - known.unix_us))
        } else {
            Some(at - Duration::from_micros(known.unix_us - utc.unix_us))
        }
    }
}

fn narrow(v: nalgebra::Vector3<f64>) -> [f32; 3] {
    [v.x as f32, v.y as f32, v.z as f32]
}
