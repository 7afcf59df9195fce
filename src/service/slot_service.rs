//! One vehicle's half of the pair's service.

mod agreeing;
mod carrying;
mod following;

use std::collections::VecDeque;
use std::time::Duration;

use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::MavMessage;

use crate::pair::orders::Orders;
use crate::pair::wire::{self, VeilwingFlags, VeilwingSilence};
use crate::pair::{Coordinator, Local, Peer, PlanTerms, Vouch};
use crate::role::Role;
use crate::time::{Instant, Utc};
use crate::transmitter::wire::MavMessage as RadioMessage;
use crate::transmitter::{FULL_POWER, Transmitter};

use super::agreement_time::AgreementTime;
use super::evidence::Vehicle;
use super::interlock::{Facts, Interlock, Permit, Silence};
use super::pose_monitor::Tolerance;
use super::protection::Jamming;
use super::refusals::Refusals;
use super::slot::{Served, Slot};
use super::staleness::Staleness;
use super::terms::{Event, Outgoing, Settings, Standing, silence_reason};
use following::Anew;

/// I asks for leases this long before it may radiate, so that it holds one when its time comes.
const ASK_EARLY: Duration = Duration::from_millis(200);

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
    /// From the next slot on all is to be planned anew.
    renews: bool,
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
            renews: false,
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
            // A J on whose jamming I may rest comes on again at once.
            state_fresh: self.staleness.may_radiate(self.role, self.must_jam_on(now))
                && (self.interlock.is_on() || leases_outstanding || self.staleness.may_begin(now)),
            in_control: self.vehicle.in_control,
            estimator_ok: self.vehicle.estimator_ok,
            pose_ok: self.vehicle.arrived
                && slot.is_some_and(|slot| {
                    // J is off once I is (S3), where its pose is none that serves, and not lost either.
                    let owed = self.role == Role::J && leases_outstanding;
                    let placed = self.interlock.is_on() || slot.monitor.may_begin();
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
                    let ahead = self.vehicle.turns_ahead;
                    let suffices_until = slot.suffices_until(vouched.power_w / FULL_POWER, ahead, now)?;
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
            self.staleness.told_at = None;
            return;
        }
        self.pair.set_vouch(None);
        if self.staleness.is_to_be_told(self.pair.leases_outstanding(now), now) {
            self.staleness.told_at = Some(now);
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
            jitter: vehicle.jitter,
            pace: vehicle.pace,
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
}
