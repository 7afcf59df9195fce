//! Slots as they are agreed on one after the other, and their ends.

use std::time::Duration;

use super::{SlotService, Stage};
use crate::pair::orders::Change;
use crate::pair::wire::{VeilwingAnswer, VeilwingFlags, VeilwingSilence};
use crate::pair::{self, Commitment};
use crate::role::Role;
use crate::service::refusals::{Refusal, Refusals};
use crate::service::slot::Slot;
use crate::service::terms::{Event, GiveUp, may_recover};
use crate::time::{Instant, Utc};
use crate::transmitter::NotReady;

/// A vehicle in the air whose next slot is not agreed on for so long goes home (F5) ...
const LONGEST_WAIT: Duration = Duration::from_secs(90);
/// ... and one that the operator has paused after so long.
const LONGEST_PAUSE: Duration = Duration::from_secs(600);
/// A slot is proposed no earlier before the time that the agreement takes.
const EARLY: Duration = Duration::from_secs(2);

impl SlotService {
    /// What has come of messages between the two.
    pub(super) fn on_pair(&mut self, event: pair::Event, now: Instant) {
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

    /// Wants the slot `next`: J is ready for it, I proposes it.
    pub(super) fn seek(
        &mut self,
        next: u16,
        refusals: Refusals,
        since: Instant,
        utc: Option<Utc>,
        now: Instant,
    ) {
        let next = self.asked_again(next);
        let terms = self.pair.slot_terms(next).map(|terms| (terms.opens, terms.lead));
        let (paused, waited) = (self.orders().is_paused(), now.saturating_since(since));
        // A pause holds after the last slot, too.
        let all_over = terms.is_none() && !paused;
        if self.watch_peer_ending(all_over) || self.is_elsewhere(next) {
            return self.pair.set_readiness(None);
        }
        if all_over {
            self.leave(now);
            return self.events.push_back(Event::AllOver);
        }
        if waited > LONGEST_WAIT && !paused || waited > LONGEST_PAUSE {
            return self.events.push_back(Event::GiveUp(GiveUp::NoSlot(waited)));
        }
        let Some((opens, lead)) = terms else { return self.pair.set_readiness(None) };
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

    /// Whether the peer has ended its mission while ours goes on: not so once the airtime of the last slot is over, unless a pause holds us.
    pub(super) fn watch_peer_ending(&mut self, winding_up: bool) -> bool {
        let ended = self.peer().says(VeilwingFlags::VEILWING_FLAGS_ENDED) && !winding_up;
        if ended {
            self.events.push_back(Event::GiveUp(GiveUp::PeerEnded));
        }
        ended
    }

    pub(super) fn is_over(&self, slot: &Slot, now: Instant) -> bool {
        let quiet = self.interlock.is_off(now) && self.vehicle.at_rest;
        now >= slot.closes_at || slot.closing && quiet
    }

    pub(super) fn end_slot(&mut self, now: Instant) {
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
}
