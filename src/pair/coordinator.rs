//! One companion's half of the pair protocol: mission exchange, propose, answer, commit, on station, leases,
//! silence out of turn, operator's orders, clock comparison.
//!
//! The executive tells it local facts (`set_*`), hands it messages and time, and reads commitments and leases from
//! it. Nothing here raises a power: that is the interlock's (mission::interlock), which reads `lease` and `peer`.

use std::collections::VecDeque;
use std::time::Duration;

use crate::geo::{Enu, Pose};
use crate::planner::plan::VehiclePlan;
use crate::role::{PerVehicle, Role};
use crate::time::{Instant, Utc};

use super::clock::{ClockFilter, Offset};
use super::lease::{Book, Holder};
use super::peer::Boot;
use super::peer::Peer;
use super::wire::{
    self, MavMessage, VeilwingAnswer, VeilwingFlags, VeilwingOrder, VeilwingRole, VeilwingSilence,
};

const HELLO_EVERY: Duration = Duration::from_millis(500);
const STATUS_EVERY: Duration = Duration::from_millis(100);
const PROPOSE_EVERY: Duration = Duration::from_millis(200);
const REQUEST_EVERY: Duration = Duration::from_millis(50);
const CLOCK_EVERY: Duration = Duration::from_millis(1000);
const ORDER_EVERY: Duration = Duration::from_millis(200);
/// Poses and powers travel as f32: what is equal in f64 differs by this much relative to its size after the trip.
const WIRE_TOLERANCE: f64 = 1e-6;

/// What does not change while the companion runs.
#[derive(Debug, Clone)]
pub struct Settings {
    /// Our part; I leads.
    pub role: Role,
    /// Drawn anew at each start.
    pub boot_id: u32,
    /// SHA-256 of the mission's meaning.
    pub mission_digest: [u8; 32],
    /// The longest lease J grants, and the longest silence of the peer that J jams through.
    pub lease: Duration,
    /// After this long without a message the peer is lost.
    pub peer_timeout: Duration,
    /// The largest difference between the two UTC clocks that the guard time covers.
    pub clock_tolerance: Duration,
}

/// The plan both sides must share.
#[derive(Debug, Clone)]
pub struct PlanTerms {
    /// SHA-256 of the plan.
    pub digest: [u8; 32],
    /// Poses and powers by slot number, over all superframes.
    pub slots: Vec<PerVehicle<VehiclePlan>>,
}

/// Local facts that the peer is told.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Local {
    /// Our home.
    pub home_enu_m: Option<Enu>,
    /// Our position.
    pub position_enu_m: Option<Enu>,
    /// No preflight check fails.
    pub preflight_ok: bool,
    /// In the air and in control.
    pub airborne: bool,
    /// Own pose inside tolerance for the committed slot.
    pub on_station: bool,
    /// Own transmitter not known to be off.
    pub radiating: bool,
    /// Mission over for us.
    pub ended: bool,
    /// On the ground.
    pub landed: bool,
    /// Flying home under our control, or about to.
    pub returning: bool,
}

/// What J needs to judge a proposal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Readiness {
    /// The slot that comes next.
    pub next_slot: u16,
    /// Time needed to be on station for it.
    pub needs: Duration,
}

/// A slot both sides have agreed on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Commitment {
    /// The proposal's number in I's boot.
    pub proposal: u32,
    /// Slot number over superframes.
    pub slot: u16,
    /// When it opens, on our monotonic clock; frozen here, so that a step of UTC cannot move a running slot.
    pub opens_at: Instant,
}

/// J's vouching: what a lease may rest on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Vouch {
    /// End of the acknowledged lease of J's own transmitter.
    pub transmitter_expires_at: Instant,
    /// Round trip to the transmitter.
    pub round_trip: Duration,
    /// No lease reaches past this.
    pub closes_at: Instant,
}

/// What the executive must know.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Event {
    /// First message of the peer.
    PeerFound,
    /// Nothing heard for this long.
    PeerLost(Duration),
    /// The peer's companion restarted; whatever was agreed is void.
    PeerRestarted,
    /// The peer flies another mission.
    MissionDiffers,
    /// The peer made another plan of the same mission.
    PlanDiffers,
    /// Both companions are configured for the same role.
    SameRole,
    /// Our proposal of this slot was refused.
    Refused(u16, VeilwingAnswer),
    /// A slot is agreed.
    Committed(Commitment),
    /// The peer fell silent out of turn.
    PeerSilent(VeilwingSilence),
    /// An operator's order that came through the peer.
    Ordered(VeilwingOrder),
}

#[derive(Debug, Clone, Copy)]
struct Proposal {
    commitment: Commitment,
    opens: Utc,
    next_send: Instant,
}

#[derive(Debug, Clone, Copy)]
struct PendingOrder {
    number: u32,
    order: VeilwingOrder,
    next_send: Instant,
}

/// See the module.
#[derive(Debug)]
pub struct Coordinator {
    settings: Settings,
    plan: Option<PlanTerms>,
    local: Local,
    utc: Option<(Utc, Instant)>,
    readiness: Option<Readiness>,
    peer: Peer,
    clock: ClockFilter,
    proposals: u32,
    /// I: awaiting an answer. J: accepted, awaiting the commit.
    proposal: Option<Proposal>,
    commitment: Option<Commitment>,
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
        let acts_on = |l: &Local| (l.airborne, l.on_station, l.radiating, l.ended, l.landed, l.returning);
        if acts_on(&local) != acts_on(&self.local) {
            self.next_status = now;
        }
        self.local = local;
    }

    /// UTC at `now`, from our autopilot.
    pub fn set_utc(&mut self, utc: Option<Utc>, now: Instant) {
        self.utc = utc.map(|utc| (utc, now));
    }

    /// J: what a proposal is judged by; `None` refuses all.
    pub fn set_readiness(&mut self, readiness: Option<Readiness>) {
        self.readiness = readiness;
    }

    /// I: proposes that `slot` opens at `opens`. Replaces a proposal not yet answered. Needs our UTC and plan;
    /// without them nothing is proposed.
    pub fn propose(&mut self, slot: u16, opens: Utc, now: Instant) {
        let Some(opens_at) = self.instant_of(opens) else { return };
        if self.plan.is_none() {
            return;
        }
        self.proposals += 1;
        let commitment = Commitment { proposal: self.proposals, slot, opens_at };
        self.proposal = Some(Proposal { commitment, opens, next_send: now });
        self.commitment = None;
    }

    /// The committed slot is over, served or not.
    pub fn release(&mut self, now: Instant) {
        if let Some(commitment) = self.commitment.take() {
            self.finished = self.finished.max(commitment.proposal);
        }
        self.proposal = None;
        self.wants_lease = false;
        self.vouch = None;
        self.holder.give_up(now);
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
        let slot = self.commitment.unwrap_or(Commitment { proposal: 0, slot: 0, opens_at: Instant::ZERO });
        self.silences += 1;
        let message = wire::VEILWING_SILENT_DATA {
            boot_id: self.settings.boot_id,
            number: self.silences,
            proposal: slot.proposal,
            slot: slot.slot,
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
        consider(self.proposal.filter(|_| self.leads()).map(|p| p.next_send), "proposal");
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
            self.transmit.push_back(self.hello());
        }
        if self.next_status <= now {
            self.next_status = now + STATUS_EVERY;
            let status = self.status(now);
            self.transmit.push_back(status);
        }
        if self.next_clock <= now {
            self.next_clock = now + CLOCK_EVERY;
            if let Some(utc) = self.utc_at(now) {
                let request =
                    wire::VEILWING_CLOCK_DATA { originate_us: utc.unix_us, receive_us: 0, transmit_us: 0 };
                self.transmit.push_back(MavMessage::VEILWING_CLOCK(request));
            }
        }
        self.send_proposal(now);
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
                time_us: micros(now),
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
                    self.heard();
                    self.book.returned(status.released_us);
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

    fn heard(&mut self) {
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

    fn flags(&self) -> VeilwingFlags {
        let mut flags = VeilwingFlags::empty();
        flags.set(VeilwingFlags::VEILWING_FLAGS_PLANNED, self.plan.is_some());
        flags.set(VeilwingFlags::VEILWING_FLAGS_HOME, self.local.home_enu_m.is_some());
        flags.set(VeilwingFlags::VEILWING_FLAGS_PREFLIGHT_OK, self.local.preflight_ok);
        flags.set(VeilwingFlags::VEILWING_FLAGS_AIRBORNE, self.local.airborne);
        flags.set(VeilwingFlags::VEILWING_FLAGS_ON_STATION, self.local.on_station);
        flags.set(VeilwingFlags::VEILWING_FLAGS_RADIATING, self.local.radiating);
        flags.set(VeilwingFlags::VEILWING_FLAGS_COMMITTED, self.commitment.is_some());
        flags.set(VeilwingFlags::VEILWING_FLAGS_ENDED, self.local.ended);
        flags.set(VeilwingFlags::VEILWING_FLAGS_LANDED, self.local.landed);
        flags.set(VeilwingFlags::VEILWING_FLAGS_RETURNING, self.local.returning);
        flags
    }

    fn hello(&self) -> MavMessage {
        MavMessage::VEILWING_HELLO(wire::VEILWING_HELLO_DATA {
            boot_id: self.settings.boot_id,
            flags: self.flags(),
            role: wire_role(self.settings.role),
            mission_digest: self.settings.mission_digest,
            plan_digest: self.plan.as_ref().map_or([0; 32], |plan| plan.digest),
            home_enu_m: self.local.home_enu_m.unwrap_or_default().into(),
        })
    }

    fn status(&mut self, now: Instant) -> MavMessage {
        self.status_sequence += 1;
        let commitment =
            self.commitment.unwrap_or(Commitment { proposal: 0, slot: 0, opens_at: Instant::ZERO });
        let position = self.local.position_enu_m.map_or([f32::NAN; 3], narrow);
        let holds_nothing = !self.wants_lease && !self.local.radiating;
        MavMessage::VEILWING_STATUS(wire::VEILWING_STATUS_DATA {
            released_us: if holds_nothing { micros(now) } else { 0 },
            boot_id: self.settings.boot_id,
            sequence: self.status_sequence,
            proposal: commitment.proposal,
            position_enu_m: position,
            slot: commitment.slot,
            flags: self.flags(),
        })
    }

    fn take_hello(&mut self, hello: &wire::VEILWING_HELLO_DATA, now: Instant) {
        if hello.role == wire_role(self.settings.role) {
            if !self.mismatch_reported {
                self.mismatch_reported = true;
                self.events.push_back(Event::SameRole);
            }
            return;
        }
        match self.peer.take_hello(hello, now) {
            Boot::Old => return,
            Boot::Known => {}
            Boot::First => self.events.push_back(Event::PeerFound),
            Boot::Restarted => {
                self.release(now);
                self.finished = 0;
                self.orders_taken = None;
                self.clock.reset();
                self.mismatch_reported = false;
                self.events.push_back(Event::PeerRestarted);
            }
        }
        self.heard();
        if self.mismatch_reported {
            return;
        }
        let plans = (self.plan.as_ref().map(|plan| plan.digest), self.peer.plan_digest);
        if hello.mission_digest != self.settings.mission_digest {
            self.mismatch_reported = true;
            self.events.push_back(Event::MissionDiffers);
        } else if let (Some(ours), Some(theirs)) = plans
            && ours != theirs
        {
            self.mismatch_reported = true;
            self.events.push_back(Event::PlanDiffers);
        }
    }

    fn send_proposal(&mut self, now: Instant) {
        if !self.leads() {
            return;
        }
        if let Some(commitment) = self.commitment {
            if self.peer.committed == Some(commitment.proposal) {
                self.proposal = None;
            } else if let Some(proposal) = self.proposal.as_mut().filter(|proposal| proposal.next_send <= now)
            {
                proposal.next_send = now + PROPOSE_EVERY;
                self.transmit.push_back(self.commit(commitment));
            }
            return;
        }
        let (Some(plan), Some(proposal)) = (&self.plan, self.proposal.as_mut()) else { return };
        let slot = proposal.commitment.slot;
        let Some(terms) = plan.slots.get(usize::from(slot)).filter(|_| proposal.next_send <= now) else {
            return;
        };
        proposal.next_send = now + PROPOSE_EVERY;
        let euler = |pose: &Pose| narrow([pose.roll_rad, pose.pitch_rad, pose.yaw_rad].into());
        self.transmit.push_back(MavMessage::VEILWING_PROPOSE(wire::VEILWING_PROPOSE_DATA {
            opens_utc_us: proposal.opens.unix_us,
            boot_id: self.settings.boot_id,
            proposal: proposal.commitment.proposal,
            i_position_enu_m: narrow(terms.i.pose.position_enu_m),
            i_euler_rad: euler(&terms.i.pose),
            i_power_w: terms.i.tx_power_w as f32,
            j_position_enu_m: narrow(terms.j.pose.position_enu_m),
            j_euler_rad: euler(&terms.j.pose),
            j_power_w: terms.j.tx_power_w as f32,
            slot,
            plan_digest: wire::short(&plan.digest),
        }));
    }

    fn commit(&self, commitment: Commitment) -> MavMessage {
        MavMessage::VEILWING_COMMIT(wire::VEILWING_COMMIT_DATA {
            boot_id: self.settings.boot_id,
            proposal: commitment.proposal,
            slot: commitment.slot,
        })
    }

    fn take_proposal(&mut self, propose: &wire::VEILWING_PROPOSE_DATA, now: Instant) {
        if self.leads() || !self.peer.is_boot(propose.boot_id) || propose.proposal <= self.finished {
            return;
        }
        let answer = match self.commitment {
            Some(commitment) if commitment.proposal == propose.proposal => {
                VeilwingAnswer::VEILWING_ANSWER_ACCEPTED
            }
            // A late copy of an earlier proposal must not displace the slot that is being flown.
            Some(commitment) if commitment.proposal > propose.proposal => return,
            _ => self.judge(propose, now),
        };
        let opens = Utc { unix_us: propose.opens_utc_us };
        let newer = self.proposal.is_none_or(|known| known.commitment.proposal < propose.proposal);
        if answer == VeilwingAnswer::VEILWING_ANSWER_ACCEPTED
            && newer
            && let Some(opens_at) = self.instant_of(opens)
        {
            let commitment = Commitment { proposal: propose.proposal, slot: propose.slot, opens_at };
            self.proposal = Some(Proposal { commitment, opens, next_send: now });
        }
        self.transmit.push_back(MavMessage::VEILWING_ANSWER(wire::VEILWING_ANSWER_DATA {
            boot_id: propose.boot_id,
            proposal: propose.proposal,
            answer,
        }));
    }

    /// J judges a proposal by its own plan, readiness and clock.
    fn judge(&self, propose: &wire::VEILWING_PROPOSE_DATA, now: Instant) -> VeilwingAnswer {
        let (Some(plan), Some(readiness)) = (&self.plan, self.readiness) else {
            return VeilwingAnswer::VEILWING_ANSWER_NOT_READY;
        };
        if propose.plan_digest != wire::short(&plan.digest) {
            return VeilwingAnswer::VEILWING_ANSWER_WRONG_PLAN;
        }
        let Some(terms) =
            plan.slots.get(usize::from(propose.slot)).filter(|_| propose.slot >= readiness.next_slot)
        else {
            return VeilwingAnswer::VEILWING_ANSWER_WRONG_SLOT;
        };
        let close = |wire: &[f32], ours: &[f64]| {
            wire.iter()
                .zip(ours)
                .all(|(&w, &o)| (f64::from(w) - o).abs() <= WIRE_TOLERANCE * o.abs().max(1.0))
        };
        let same = |position: &[f32; 3], euler: &[f32; 3], power_w: f32, own: &VehiclePlan| {
            close(position, own.pose.position_enu_m.as_slice())
                && close(euler, &[own.pose.roll_rad, own.pose.pitch_rad, own.pose.yaw_rad])
                && close(&[power_w], &[own.tx_power_w])
        };
        if !same(&propose.i_position_enu_m, &propose.i_euler_rad, propose.i_power_w, &terms.i)
            || !same(&propose.j_position_enu_m, &propose.j_euler_rad, propose.j_power_w, &terms.j)
        {
            return VeilwingAnswer::VEILWING_ANSWER_WRONG_PLAN;
        }
        let certain_difference = |offset: Offset| {
            Duration::from_micros(offset.offset_us.unsigned_abs()).saturating_sub(offset.uncertainty)
        };
        let clocks_agree =
            self.clock.offset().is_some_and(|o| certain_difference(o) <= self.settings.clock_tolerance);
        let Some(opens_at) = self.instant_of(Utc { unix_us: propose.opens_utc_us }).filter(|_| clocks_agree)
        else {
            return VeilwingAnswer::VEILWING_ANSWER_CLOCK;
        };
        if opens_at < now + readiness.needs {
            return VeilwingAnswer::VEILWING_ANSWER_TOO_LATE;
        }
        VeilwingAnswer::VEILWING_ANSWER_ACCEPTED
    }

    fn take_answer(&mut self, answer: &wire::VEILWING_ANSWER_DATA, now: Instant) {
        let Some(proposal) = self.proposal.as_mut().filter(|p| p.commitment.proposal == answer.proposal)
        else {
            return;
        };
        if self.settings.role != Role::I
            || answer.boot_id != self.settings.boot_id
            || self.commitment.is_some()
        {
            return;
        }
        let commitment = proposal.commitment;
        if answer.answer == VeilwingAnswer::VEILWING_ANSWER_ACCEPTED {
            proposal.next_send = now + PROPOSE_EVERY;
            self.commitment = Some(commitment);
            self.transmit.push_back(self.commit(commitment));
            self.events.push_back(Event::Committed(commitment));
        } else {
            self.proposal = None;
            self.events.push_back(Event::Refused(commitment.slot, answer.answer));
        }
    }

    fn take_commit(&mut self, commit: &wire::VEILWING_COMMIT_DATA, now: Instant) {
        if self.leads() || !self.peer.is_boot(commit.boot_id) {
            return;
        }
        let Some(proposal) = self.proposal.filter(|p| p.commitment.proposal == commit.proposal) else {
            return;
        };
        self.proposal = None;
        self.commitment = Some(proposal.commitment);
        // Said at once: I repeats the commit until it hears so.
        let status = self.status(now);
        self.transmit.push_back(status);
        self.events.push_back(Event::Committed(proposal.commitment));
    }

    fn take_request(&mut self, request: &wire::VEILWING_LEASE_REQUEST_DATA, now: Instant) {
        let (Some(commitment), Some(vouch), Some(plan)) = (self.commitment, self.vouch, &self.plan) else {
            return;
        };
        if self.leads() || !self.peer.is_boot(request.boot_id) || request.proposal != commitment.proposal {
            return;
        }
        self.peer.last_heard = Some(now);
        let granted = self.book.grant(
            request.time_us,
            vouch.transmitter_expires_at,
            vouch.round_trip,
            self.settings.lease,
            vouch.closes_at,
            now,
        );
        let Some(duration_ms) = granted.and_then(|d| u16::try_from(d.as_millis()).ok()) else { return };
        self.transmit.push_back(MavMessage::VEILWING_LEASE_GRANT(wire::VEILWING_LEASE_GRANT_DATA {
            time_us: request.time_us,
            boot_id: request.boot_id,
            proposal: commitment.proposal,
            slot: commitment.slot,
            duration_ms,
            plan_digest: wire::short(&plan.digest),
        }));
    }

    fn take_grant(&mut self, grant: &wire::VEILWING_LEASE_GRANT_DATA, now: Instant) {
        let (Some(commitment), Some(plan)) = (self.commitment, &self.plan) else { return };
        if self.leads()
            && self.wants_lease
            && grant.boot_id == self.settings.boot_id
            && grant.proposal == commitment.proposal
            && grant.slot == commitment.slot
            && grant.plan_digest == wire::short(&plan.digest)
        {
            self.peer.last_heard = Some(now);
            let asked_at = Instant::from_start(Duration::from_micros(grant.time_us));
            self.holder.take(asked_at, Duration::from_millis(grant.duration_ms.into()), now);
        }
    }

    fn take_clock(&mut self, clock: &wire::VEILWING_CLOCK_DATA, now: Instant) {
        let Some(utc) = self.utc_at(now) else { return };
        if clock.receive_us == 0 {
            let reply = wire::VEILWING_CLOCK_DATA {
                receive_us: utc.unix_us,
                transmit_us: utc.unix_us,
                ..clock.clone()
            };
            self.transmit.push_back(MavMessage::VEILWING_CLOCK(reply));
        } else {
            self.clock.take(clock.originate_us, clock.receive_us, clock.transmit_us, utc.unix_us);
        }
    }
}

fn wire_role(role: Role) -> VeilwingRole {
    match role {
        Role::I => VeilwingRole::VEILWING_ROLE_I,
        Role::J => VeilwingRole::VEILWING_ROLE_J,
    }
}

fn narrow(v: nalgebra::Vector3<f64>) -> [f32; 3] {
    [v.x as f32, v.y as f32, v.z as f32]
}

fn micros(at: Instant) -> u64 {
    u64::try_from(at.since_start().as_micros()).unwrap_or(u64::MAX)
}
