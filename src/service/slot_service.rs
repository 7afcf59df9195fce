//! One vehicle's half of the pair's service.

mod carrying;
mod following;

use following::Anew;
use std::collections::VecDeque;
use std::time::Duration;

use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::MavMessage;

use crate::pair::orders::{Change, Orders};
use crate::pair::wire::{self, VeilwingAnswer, VeilwingFlags, VeilwingSilence};
use crate::pair::{self, Commitment, Coordinator, Local, Peer, PlanTerms, Vouch};
use crate::role::Role;
use crate::time::{Instant, Utc};
use crate::transmitter::wire::MavMessage as RadioMessage;
use crate::transmitter::{FULL_POWER, NotReady, Transmitter};

use super::agreement_time::AgreementTime;
use super::evidence::Vehicle;
use super::interlock::{Facts, Interlock, Permit, Silence};
use super::pose_monitor::Tolerance;
use super::protection::Jamming;
use super::refusals::{Refusal, Refusals};
use super::slot::{Served, Slot};
use super::staleness::Staleness;
use super::terms::{Event, GiveUp, Outgoing, Settings, Standing, may_recover, silence_reason};

/// I asks for leases this long before it may radiate, so that it holds one when its time comes.
const ASK_EARLY: Duration = Duration::from_millis(200);
/// A vehicle in the air whose next slot is not agreed on for so long goes home (F5) ...
const LONGEST_WAIT: Duration = Duration::from_secs(90);
/// ... and one that the operator has paused after so long.
const LONGEST_PAUSE: Duration = Duration::from_secs(600);
/// A slot is proposed no earlier before the time that the agreement takes.
const EARLY: Duration = Duration::from_secs(2);

/// Where the vehicle stands in the mission's slots.
#[derive(Debug, Clone)]
enum Stage {
    /// Takes no part: on the ground, or on its way up or home.
    Away,
    /// Between slots; `next` is to be agreed on. `since`: the wait began, or begins.
    Between { next: u16, refusals: Refusals, since: Instant },
    /// A slot is agreed on; the transit to it included.
    Committed(Box<Slot>),
}

/// See the module of the room.
///
/// # Calling contract
/// 1. Hand in what happened: any of `handle_pair`, `handle_radio`, `handle_timeout`, an operator's order (`orders_mut`).
/// 2. [`advance`](Self::advance): agreements, refusals and the ends of slots follow from it.
/// 3. Drain [`poll_event`](Self::poll_event) and do what the events ask for.
/// 4. [`decide`](Self::decide): the interlock decides on what is known now. A fault silences the transmitter at the very
///    input that shows it (S4), so this must follow every input, at the same instant.
/// 5. Drain [`poll_transmit`](Self::poll_transmit), and `poll_event` for what was switched.
///
/// Then sleep until [`poll_timeout`](Self::poll_timeout), which any of the calls may have moved, and call
/// `handle_timeout` then. `now` never goes back.
#[derive(Debug, Clone)]
pub struct SlotService {
    role: Role,
    pair: Coordinator,
    interlock: Interlock,
    staleness: Staleness,
    tolerance: Tolerance,
    stage: Stage,
    /// J: I has been told that our pose is none that serves.
    off_track: bool,
    /// J: to leave as soon as I is off (S3).
    abandoning: bool,
    agreement_time: AgreementTime,
    /// I: the instant the slot table counts from, known from the first proposal on.
    table_zero: Option<Instant>,
    /// I: the slot whose poses are to be made anew, or are.
    anew: Anew,
    vehicle: Vehicle,
    /// The mission's permission to radiate holds at present.
    permitted: bool,
    events: VecDeque<Event>,
}

impl SlotService {
    /// A service that has heard nothing yet, and takes no part.
    #[must_use]
    pub fn new(settings: Settings, transmitter: Transmitter, tolerance: Tolerance, now: Instant) -> Self {
        let role = settings.pair.role;
        let lease = settings.pair.lease;
        Self {
            role,
            interlock: Interlock::new(
                role,
                transmitter,
                settings.ceilings,
                lease,
                settings.emission_authorised,
            ),
            pair: Coordinator::new(settings.pair, now),
            staleness: Staleness::new(settings.freshness, now),
            tolerance,
            stage: Stage::Away,
            off_track: false,
            abandoning: false,
            agreement_time: AgreementTime::default(),
            table_zero: None,
            anew: Anew::No,
            vehicle: Vehicle::default(),
            permitted: true,
            events: VecDeque::new(),
        }
    }

    /// Our plan, once it is made and its slots have their times.
    pub fn set_plan(&mut self, plan: PlanTerms) {
        self.pair.set_plan(plan);
    }

    /// How far a pose may be off in the slots to come.
    pub fn set_tolerance(&mut self, tolerance: Tolerance) {
        self.tolerance = tolerance;
    }

    /// A message of the peer.
    pub fn handle_pair(&mut self, message: &wire::MavMessage, now: Instant) {
        self.pair.handle_message(message, now);
    }

    /// A message of the link on which the transmitter is; what is not the transmitter's is ignored.
    pub fn handle_radio(&mut self, header: MavHeader, message: &MavMessage, now: Instant) {
        self.interlock.handle_message(header, message, now);
    }

    /// The transmitter's own message; another's is ignored.
    pub fn handle_report(&mut self, header: MavHeader, message: &RadioMessage, now: Instant) {
        self.interlock.handle_radio(header, message, now);
    }

    /// Does what is due.
    pub fn handle_timeout(&mut self, now: Instant) {
        self.staleness.judge_at(now);
        self.pair.handle_timeout(now);
        self.interlock.handle_timeout(now);
    }

    /// When `handle_timeout` must be called next, and why.
    #[must_use]
    pub fn poll_timeout(&self) -> (Instant, &'static str) {
        let pair = self.pair.poll_timeout();
        let overdue = self.staleness.overdue_at(self.pair.leases_end()).filter(|_| self.interlock.is_on());
        let pair = (pair.0, pair.1.name());
        let others = [self.interlock.poll_timeout(), overdue.map(|at| (at, "late state"))];
        others.into_iter().flatten().chain([pair]).min_by_key(|(at, _)| *at).unwrap_or(pair)
    }

    /// The next message to send.
    pub fn poll_transmit(&mut self) -> Option<Outgoing> {
        // Power first: nothing may delay an off.
        let radio = self.interlock.poll_transmit().map(|m| Outgoing::Radio(Box::new(m)));
        radio.or_else(|| self.pair.poll_transmit().map(|m| Outgoing::Pair(Box::new(m))))
    }

    /// The next event.
    pub fn poll_event(&mut self) -> Option<Event> {
        self.events.pop_front()
    }

    /// The vehicle is in the air: slots may be agreed on, from `next` on. `table_zero`: the instant that the slot table
    /// counts from, if the mission begins at a given time; the vehicle hovers until then.
    pub fn join(&mut self, next: u16, table_zero: Option<Instant>, now: Instant) {
        self.table_zero = table_zero;
        let since = table_zero.map_or(now, |zero| zero.max(now));
        self.stage = Stage::Between { next, refusals: Refusals::none(now), since };
    }

    /// The vehicle takes no part any more, but for the end of a slot under way: J jams until I is off, for a lease's
    /// length at most, unless a fault of its own silences it (S3). `true` if that is now; [`Event::Abandoned`] follows
    /// otherwise.
    pub fn abandon(&mut self, now: Instant) -> bool {
        if !self.must_jam_on(now) {
            self.leave(now);
            return true;
        }
        self.abandoning = true;
        if let Stage::Committed(slot) = &mut self.stage {
            slot.closing = true;
        }
        false
    }

    /// Whether the end of a slot under way is still waited for.
    #[must_use]
    pub fn is_abandoning(&self) -> bool {
        self.abandoning
    }

    /// The vehicle takes no part any more, at once, for this reason: silent even where S3 asks for jamming on.
    pub fn drop_out(&mut self, reason: VeilwingSilence, now: Instant) {
        self.pair.silent(reason, now);
        self.leave(now);
    }

    /// The companion is about to end: as [`Self::abandon`], and the peer is told.
    pub fn shut_down(&mut self, now: Instant) -> bool {
        if !self.abandoning {
            self.pair.silent(VeilwingSilence::VEILWING_SILENCE_SHUTDOWN, now);
        }
        let quiet = self.abandon(now);
        if quiet {
            self.interlock.silence(now);
        }
        quiet
    }

    /// Whether the mission's permission to radiate holds at present: as long as nobody says otherwise. Where it ends in a slot
    /// the vehicle is silent, J once I is (S3).
    pub fn set_permitted(&mut self, permitted: bool) {
        self.permitted = permitted;
    }

    /// Tells the peer of a reason for silence that the vehicle's state does not show.
    pub fn tell_silence(&mut self, reason: VeilwingSilence, now: Instant) {
        self.pair.silent(reason, now);
    }

    /// The operator's orders.
    #[must_use]
    pub fn orders(&self) -> &Orders {
        self.pair.orders()
    }

    /// The operator's orders, to give some: what comes about follows as [`Event::Ordered`].
    pub fn orders_mut(&mut self) -> &mut Orders {
        self.pair.orders_mut()
    }

    /// Everything aboard shares the autopilot's MAVLink system, which is known once the autopilot is found.
    pub fn adopt_system(&mut self, system: u8, now: Instant) {
        self.interlock.adopt_system(system, now);
    }

    /// The slot that is agreed on.
    #[must_use]
    pub fn slot(&self) -> Option<&Slot> {
        match &self.stage {
            Stage::Committed(slot) => Some(slot),
            Stage::Away | Stage::Between { .. } => None,
        }
    }

    /// What it is doing.
    #[must_use]
    pub fn standing(&self) -> Standing {
        match &self.stage {
            Stage::Away => Standing::Away,
            Stage::Between { .. } if self.orders().is_paused() => Standing::Paused,
            Stage::Between { .. } => Standing::Between,
            Stage::Committed(_) if self.orders().is_killed() && self.interlock.is_on() => {
                Standing::JammingOnKilled
            }
            Stage::Committed(_) if self.abandoning => Standing::JammingOnLeaving,
            Stage::Committed(slot) => match (slot.closing, self.interlock.is_on(), slot.served) {
                (true, true, _) => Standing::Closing,
                (true, false, _) => Standing::Closed,
                (false, true, _) => Standing::OnAir,
                (false, false, Served::Yes) => Standing::Interrupted,
                (false, false, Served::No(None)) => Standing::Agreed,
                (false, false, Served::No(Some(_))) => Standing::Hindered,
            },
        }
    }

    /// The number of the slot under way, or of the next one; 0 while the vehicle takes no part.
    #[must_use]
    pub fn slot_number(&self) -> u16 {
        match &self.stage {
            Stage::Away => 0,
            Stage::Between { next, .. } => *next,
            Stage::Committed(slot) => slot.commitment.slot,
        }
    }

    /// I: the end of the jam lease in force.
    #[must_use]
    pub fn jam_lease(&self, now: Instant) -> Option<Instant> {
        self.pair.lease(now)
    }

    /// The end of the lease that I holds, or at the most of those that J has granted, which may be past.
    #[must_use]
    pub fn lease_end(&self, now: Instant) -> Option<Instant> {
        match self.role {
            Role::I => self.pair.lease(now),
            Role::J => self.pair.leases_end(),
        }
    }

    /// Why this vehicle must be silent, by what is known at `now`; `None` where it may be on the air. Decides nothing.
    #[must_use]
    pub fn silence(&self, now: Instant) -> Option<Silence> {
        self.interlock.silence_for(&self.facts(now), now)
    }

    /// The other side.
    #[must_use]
    pub fn peer(&self) -> &Peer {
        self.pair.peer()
    }

    /// Whether mission and plan are known to be the same on both sides.
    #[must_use]
    pub fn agrees(&self) -> bool {
        self.pair.agrees()
    }

    /// Whether the peer is told that this vehicle's land detector is held off.
    #[must_use]
    pub fn says_guarding(&self) -> bool {
        self.vehicle.guarding
    }

    /// Whether slots can be agreed on by the two clocks: not so while they are not compared, or differ too much.
    #[must_use]
    pub fn clocks_agree(&self) -> bool {
        self.pair.clocks_agree()
    }

    /// The peer's UTC minus ours, in seconds; `None` while they are not compared.
    #[must_use]
    pub fn clock_offset_s(&self) -> Option<f64> {
        self.pair.clock_offset().map(|offset| offset.offset_us as f64 * 1e-6)
    }

    /// How long before its transit a slot is proposed, as things are.
    #[must_use]
    pub fn agreement_time(&self) -> Duration {
        self.agreement_time.time(&self.pair)
    }

    /// The transmitter behind the interlock, for everything but power.
    #[must_use]
    pub fn interlock(&self) -> &Interlock {
        &self.interlock
    }

    /// Takes in what has happened: agreements, refusals, the ends of slots.
    pub fn advance(&mut self, utc: Option<Utc>, now: Instant) {
        self.pair.set_utc(utc, now);
        while let Some(event) = self.pair.poll_event() {
            self.on_pair(event, now);
        }
        if self.abandoning && !self.must_jam_on(now) {
            self.leave(now);
            self.events.push_back(Event::Abandoned);
        }
        // J keeps what it has vouched for (S3): by then I is off, for it was told.
        let killed = self.orders().is_killed() && !self.must_jam_on(now);
        self.interlock.set_killed(killed, now);
        self.interlock.set_permitted(self.permitted || self.must_jam_on(now));
        if let Stage::Committed(slot) = &self.stage {
            if self.is_over(slot, now) {
                self.end_slot(now);
            } else {
                let last = self.pair.slot_terms(slot.commitment.slot.saturating_add(1)).is_none();
                self.watch_peer_ending(last && now >= slot.radiate_until);
            }
        }
        // At once after a slot: who hears that it is over here may already propose the next one.
        if let Stage::Between { next, refusals, since } = &self.stage {
            self.seek(*next, *refusals, *since, utc, now);
        }
    }

    /// Lets the interlock decide, switches the transmitter accordingly, tells the peer of a silence out of turn, and
    /// asks for leases (I) or vouches (J) as far as the decision allows.
    pub fn decide(&mut self, vehicle: &Vehicle, now: Instant) {
        self.vehicle = *vehicle;
        self.staleness.feed(vehicle);
        if let Stage::Committed(slot) = &mut self.stage {
            slot.monitor.feed(vehicle);
        }
        let facts = self.facts(now);
        let was_on = self.interlock.is_on();
        let decision = self.interlock.apply(&facts, now);
        self.note(decision, now);
        match decision {
            Ok(permit) if !was_on => self.events.push_back(Event::On(permit)),
            Err(silence) if was_on => {
                if let Some(reason) = silence_reason(silence) {
                    self.pair.silent(reason, now);
                }
                self.events.push_back(Event::Off(silence));
            }
            Ok(_) | Err(_) => {}
        }
        self.follow_device(now);
        self.weigh_protection(now);
        self.ask_or_vouch(&facts, now);
        self.warn_if_late(now);
        self.warn_off_track(now);
        self.tell_peer(now);
    }

    fn facts(&self, now: Instant) -> Facts {
        let slot = self.slot();
        let leases_outstanding = self.pair.leases_outstanding(now);
        Facts {
            window: slot.map(|slot| slot.window(self.role, leases_outstanding, now)),
            state_fresh: self.staleness.may_radiate(self.role, self.must_jam_on(now)),
            in_control: self.vehicle.in_control,
            estimator_ok: self.vehicle.estimator_ok,
            pose_ok: self.vehicle.arrived
                && slot.is_some_and(|slot| {
                    // J is off once I is (S3), where its pose is none that serves, and not lost either.
                    let owed = self.role == Role::J && leases_outstanding;
                    let placed = self.interlock.is_on() || slot.monitor.is_near();
                    placed && slot.monitor.check().is_ok() && (slot.monitor.serves() || owed)
                }),
            // A lease vouches for J's part of the motion that I flies.
            jam_lease: self.pair.lease(now).filter(|_| self.pair.flies_alike(now)),
            peer_on_station: slot.is_some_and(|slot| self.is_peer_on_station(slot, now)),
            leases_outstanding,
        }
    }

    fn is_peer_on_station(&self, slot: &Slot, now: Instant) -> bool {
        let peer = self.pair.peer();
        peer.spoke_within(self.pair.longest_lease(), now)
            && peer.committed == Some(slot.commitment.proposal)
            && peer.says(VeilwingFlags::VEILWING_FLAGS_ON_STATION)
    }

    /// What the slot's end will say of it.
    fn note(&mut self, decision: Result<Permit, Silence>, now: Instant) {
        let Stage::Committed(slot) = &mut self.stage else { return };
        let airtime = slot.radiate_from <= now && now < slot.radiate_until;
        match (decision, slot.served) {
            (Ok(_), _) => slot.served = Served::Yes,
            (Err(silence), Served::No(_)) if airtime => slot.served = Served::No(Some(silence)),
            (Err(_), _) => {}
        }
    }

    /// Whether the radio's device does what it may. J tells I where it does not: I follows then, and does not wait for its lease
    /// to run out.
    fn follow_device(&mut self, now: Instant) {
        let transmitter = self.interlock.transmitter();
        let (trouble, achieved) = (transmitter.trouble(), transmitter.on_until_at_least(now).is_some());
        let on = self.interlock.is_on();
        let Stage::Committed(slot) = &mut self.stage else { return };
        if on && achieved {
            (slot.achieved, slot.trouble) = (true, None);
        }
        let Some(trouble) = trouble.filter(|trouble| on && slot.trouble != Some(*trouble)) else { return };
        slot.trouble = Some(trouble);
        self.events.push_back(Event::Troubled(slot.commitment.slot, trouble));
        if self.role == Role::J {
            self.pair.silent(VeilwingSilence::VEILWING_SILENCE_TRANSMITTER, now);
        }
    }

    /// J: ends a slot in which its jamming protects nobody.
    fn weigh_protection(&mut self, now: Instant) {
        let i_on = self.peer().says(VeilwingFlags::VEILWING_FLAGS_RADIATING);
        let jams = self.role == Role::J && self.interlock.is_on();
        let Stage::Committed(slot) = &mut self.stage else { return };
        let airtime = slot.radiate_from <= now && now < slot.radiate_until && !slot.closing;
        slot.protection.feed((jams && airtime).then_some(i_on), now);
        if slot.protection.is_in_vain() {
            slot.closing = true;
            self.events.push_back(Event::JammedInVain(slot.commitment.slot, slot.jamming));
        }
    }

    /// I: asks for leases while it could use one. J: vouches while its transmitter certainly is on and its own interlock
    /// agrees.
    fn ask_or_vouch(&mut self, facts: &Facts, now: Instant) {
        let Stage::Committed(slot) = &mut self.stage else {
            self.pair.want_lease(false, now);
            self.pair.set_vouch(None);
            return;
        };
        match self.role {
            Role::I => {
                let in_time = slot.radiate_from <= now + ASK_EARLY && now < slot.radiate_until;
                let able = facts.pose_ok && facts.state_fresh && facts.in_control && facts.estimator_ok;
                let wanted = in_time && able && self.interlock.may_radiate() && !slot.closing;
                self.pair.want_lease(wanted, now);
            }
            Role::J => {
                let on = self.interlock.is_on() && now < slot.radiate_until && !slot.closing;
                let on = on && slot.monitor.serves();
                let confirmed = self.interlock.transmitter().on_until_at_least(now);
                let confirmed = confirmed.filter(|vouched| on && vouched.slot == slot.commitment.slot);
                // What is as good as the full power suffices for as long as that does, and no longer than the vehicle's loss
                // is foreseen: who has lost control is off at once.
                let vouch = confirmed.and_then(|vouched| {
                    let suffices_until = slot.suffices_until(vouched.power_w / FULL_POWER, now)?;
                    let closes_at =
                        self.vehicle.lost_at.map_or(suffices_until, |lost| lost.min(suffices_until));
                    Some(Vouch { until: vouched.until, closes_at })
                });
                if let Some(vouched) = confirmed {
                    let (given_w, planned_w) = (vouched.power_w, slot.power_w(now));
                    slot.jamming =
                        if vouch.is_some() { Jamming::Full } else { Jamming::Short { given_w, planned_w } };
                }
                self.pair.set_vouch(vouch);
            }
        }
    }

    /// J: tells I that the jamming may end, as soon as state is late.
    fn warn_if_late(&mut self, now: Instant) {
        if !self.staleness.is_late() || !self.interlock.is_on() {
            self.staleness.told = false;
            return;
        }
        self.pair.set_vouch(None);
        if !std::mem::replace(&mut self.staleness.told, true) {
            self.pair.silent(VeilwingSilence::VEILWING_SILENCE_LINK, now);
        }
    }

    fn tell_peer(&mut self, now: Instant) {
        let vehicle = &self.vehicle;
        let serves = |slot: &Slot| slot.monitor.check().is_ok() && slot.monitor.serves();
        let in_pose = self.slot().is_some_and(serves);
        let local = Local {
            home_enu_m: vehicle.home_enu_m,
            position_enu_m: vehicle.position.map(|(position, _)| position),
            rests: vehicle.rests.filter(|_| matches!(self.stage, Stage::Between { .. })),
            preflight_ok: vehicle.preflight_ok,
            airborne: !matches!(self.stage, Stage::Away) && vehicle.in_control,
            on_station: in_pose && self.staleness.is_fresh(now) && vehicle.in_control,
            radiating: !self.interlock.is_off(now),
            ended: vehicle.ended,
            returning: vehicle.returning,
            landed: vehicle.landed,
            guarding: vehicle.guarding,
        };
        self.pair.set_local(local, now);
    }

    /// Wants the slot `next`: J is ready for it, I proposes it.
    fn seek(&mut self, next: u16, refusals: Refusals, since: Instant, utc: Option<Utc>, now: Instant) {
        let next = self.asked_again(next);
        let terms = self.pair.slot_terms(next).map(|terms| (terms.opens, terms.lead));
        if self.watch_peer_ending(terms.is_none()) || self.is_elsewhere(next) {
            return self.pair.set_readiness(None);
        }
        let (paused, waited) = (self.orders().is_paused(), now.saturating_since(since));
        let Some((opens, lead)) = terms else {
            // A pause holds after the last slot, too, unless the other has gone home.
            let peer_ended = self.peer().says(VeilwingFlags::VEILWING_FLAGS_ENDED);
            if paused && waited <= LONGEST_PAUSE && !peer_ended {
                return self.pair.set_readiness(None);
            }
            self.leave(now);
            return self.events.push_back(Event::AllOver);
        };
        if waited > LONGEST_WAIT && !paused || waited > LONGEST_PAUSE {
            return self.events.push_back(Event::GiveUp(GiveUp::NoSlot(waited)));
        }
        // A peer that is still in the last slot, be it for milliseconds, would refuse, and a refusal costs half a second.
        let free =
            self.peer().says(VeilwingFlags::VEILWING_FLAGS_AIRBORNE) && self.peer().committed.is_none();
        let peer_ready = free && self.pair.agrees();
        if let Err(reason) = self.interlock.transmitter().ready(now)
            && !paused
        {
            self.pair.set_readiness(None);
            return self.wait_for_radio(next, reason, now);
        }
        match self.role {
            _ if paused => self.pair.set_readiness(None),
            Role::J => self.pair.set_readiness(Some(next)),
            Role::I => {
                let may = peer_ready && !self.pair.is_proposing();
                let Some(utc) = utc.filter(|_| may && refusals.may_propose(now)) else { return };
                let Some((opens, lead)) = self.terms_anew(next, (opens, lead), now) else { return };
                let earliest = now + self.agreement_time() + lead;
                let opens_at = self.table_zero.map_or(earliest, |zero| (zero + opens).max(earliest));
                // Before a start at a given time both hover: a proposal now would be agreed on too early.
                if opens_at <= earliest + EARLY {
                    self.table_zero = Some(opens_at - opens);
                    let places = self.anew.take();
                    self.pair.propose(next, utc + opens_at.saturating_since(now), places, now);
                }
            }
        }
    }

    /// Our own transmitter cannot serve the slot: said once, and not waited for for ever.
    fn wait_for_radio(&mut self, slot: u16, reason: NotReady, now: Instant) {
        let Stage::Between { refusals, .. } = &mut self.stage else { return };
        if !refusals.may_propose(now) {
            return;
        }
        match refusals.count(now) {
            Refusal::First => self.events.push_back(Event::Unready(slot, reason)),
            Refusal::Another => {}
            Refusal::Last => self.events.push_back(Event::GiveUp(GiveUp::Unready(slot, reason))),
        }
    }

    /// Whether the peer has ended its mission while ours goes on: not so in the last slot, once its airtime is over.
    fn watch_peer_ending(&mut self, winding_up: bool) -> bool {
        let ended = self.peer().says(VeilwingFlags::VEILWING_FLAGS_ENDED) && !winding_up;
        if ended {
            self.events.push_back(Event::GiveUp(GiveUp::PeerEnded));
        }
        ended
    }

    fn is_over(&self, slot: &Slot, now: Instant) -> bool {
        let quiet = self.interlock.is_off(now) && self.vehicle.at_rest;
        now >= slot.closes_at || slot.closing && quiet
    }

    fn end_slot(&mut self, now: Instant) {
        let Some(slot) = self.slot() else { return };
        let (number, served) = (slot.commitment.slot, slot.outcome());
        let to_be_repeated = slot.is_to_be_repeated(now);
        if let Some(next) = self.carried_on(slot.closes_at, now) {
            self.events.push_back(Event::Over(number, served));
            self.events.push_back(Event::CarriedOn(next.commitment));
            self.stage = Stage::Committed(Box::new(next));
            return;
        }
        self.events.push_back(if to_be_repeated {
            Event::PutOff(number)
        } else {
            Event::Over(number, served)
        });
        self.pair.release(now);
        let next = if to_be_repeated { number } else { number.saturating_add(1) };
        self.stage = Stage::Between { next, refusals: Refusals::none(now), since: now };
    }

    /// J jams while I may radiate, whatever ends the mission, unless a fault of its own silences it (S3).
    fn must_jam_on(&self, now: Instant) -> bool {
        self.role == Role::J
            && self.slot().is_some()
            && self.interlock.is_on()
            && self.pair.leases_outstanding(now)
    }

    fn leave(&mut self, now: Instant) {
        self.abandoning = false;
        self.stage = Stage::Away;
        self.pair.release(now);
        self.pair.set_readiness(None);
    }

    fn on_pair(&mut self, event: pair::Event, now: Instant) {
        use pair::Event as Pair;
        let event = match event {
            Pair::PeerFound => Event::PeerFound,
            Pair::MissionDiffers => Event::MissionDiffers,
            Pair::PlanDiffers => Event::PlanDiffers,
            Pair::SameRole => Event::SameRole,
            Pair::Ordered(change) => {
                self.obey(change, now);
                Event::Ordered(change)
            }
            Pair::PeerLost(silent_for) => Event::GiveUp(GiveUp::PeerLost(silent_for)),
            Pair::PeerRestarted => Event::GiveUp(GiveUp::PeerRestarted),
            Pair::PeerSilent(reason) => {
                self.events.push_back(Event::PeerSilent(reason));
                if may_recover(reason) {
                    return;
                }
                Event::GiveUp(GiveUp::PeerSilent(reason))
            }
            Pair::PeerLeft => {
                // The other has ended the slot before in its own way, just before its end: both go on from where they are.
                if let Stage::Committed(slot) = &mut self.stage
                    && slot.carried_on
                {
                    slot.closing = true;
                    return;
                }
                // Later in a slot the leases decide, and the clocks may differ at its end.
                let on_the_way = self.slot().is_some_and(|slot| now < slot.commitment.opens_at);
                if !on_the_way || self.orders().is_paused() {
                    return;
                }
                Event::GiveUp(GiveUp::PeerLeft)
            }
            Pair::Refused(slot, answer) => match self.count_refusal(answer, now) {
                Some(Refusal::First) => Event::Refused(slot, answer),
                Some(Refusal::Last) => Event::GiveUp(GiveUp::Refused(slot, answer)),
                Some(Refusal::Another) | None => return,
            },
            Pair::PlanMotion => Event::PlanMotion,
            Pair::PlanSlot(asked) => Event::PlanSlot(asked.slot, Some(asked)),
            Pair::TakeUp(number) => Event::TakeUp(number),
            Pair::Committed(commitment) => match self.commit(commitment) {
                true => Event::Agreed(commitment),
                false => return self.pair.release(now),
            },
        };
        self.events.push_back(event);
    }

    /// A pause ends a slot under way in order (I silent at once, J once I is), its transit flown to the end so that the
    /// next one begins where the table says; no other is agreed on. A kill likewise, and I is told at once.
    fn obey(&mut self, change: Change, now: Instant) {
        let silent = matches!(change, Change::Killed | Change::Held(true));
        match &mut self.stage {
            Stage::Committed(slot) => slot.closing |= silent,
            Stage::Between { since, .. } if matches!(change, Change::Held(_)) => *since = now,
            Stage::Away | Stage::Between { .. } => {}
        }
        if silent && self.slot().is_none() {
            self.pair.release(now);
        }
        if change == Change::Killed {
            self.pair.silent(VeilwingSilence::VEILWING_SILENCE_OPERATOR, now);
        }
    }

    fn count_refusal(&mut self, answer: VeilwingAnswer, now: Instant) -> Option<Refusal> {
        self.agreement_time.refused(answer);
        match &mut self.stage {
            Stage::Between { refusals, .. } => Some(refusals.count(now)),
            Stage::Away | Stage::Committed(_) => None,
        }
    }

    /// Takes up an agreed slot, if it is still wanted.
    fn commit(&mut self, commitment: Commitment) -> bool {
        if !matches!(self.stage, Stage::Between { .. }) || self.orders().is_paused() {
            return false;
        }
        let Some(terms) = self.pair.slot_terms(commitment.slot) else { return false };
        let mut slot = Slot::new(self.role, commitment, false, terms, (self.tolerance, self.apart()));
        slot.monitor.feed(&self.vehicle);
        // Until the owner has begun the transit.
        self.vehicle.arrived = false;
        self.stage = Stage::Committed(Box::new(slot));
        self.agreement_time.agreed();
        self.pair.set_readiness(None);
        true
    }
}
