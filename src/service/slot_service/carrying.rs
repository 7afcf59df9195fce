//! Slots that carry each other on, and vehicles that turn and move in them.

use std::time::Duration;

use super::{Slot, SlotService, Stage};
use crate::pair::SlotTerms;
use crate::pair::wire::VeilwingSilence;
use crate::role::Role;
use crate::time::Instant;

impl SlotService {
    /// The slot that carries on one which closes at `closes_at`, if it does: by the clock, and by nobody's word.
    pub(super) fn carried_on(&mut self, closes_at: Instant, now: Instant) -> Option<Slot> {
        let in_order = self.slot().is_some_and(|slot| !slot.closing) && now >= closes_at && !self.renews;
        if !in_order || self.abandoning || self.orders().is_paused() || self.orders().is_killed() {
            return None;
        }
        let commitment = self.pair.carry_on(closes_at)?;
        let terms = self.pair.slot_terms(commitment.slot)?;
        let mut slot = Slot::new(self.role, commitment, true, terms, (self.tolerance, self.apart()));
        slot.monitor.feed(&self.vehicle);
        Some(slot)
    }

    /// J: the slot before `next` where I, which leads, wants that one again: J has been carried on to it, and I has not.
    pub(super) fn asked_again(&mut self, next: u16) -> u16 {
        let again = next.checked_sub(1).filter(|slot| self.pair.asked() == Some(*slot));
        let terms = again.and_then(|slot| self.pair.slot_terms(slot));
        let moves = terms.is_some_and(|terms| terms.is_in_motion() && terms.carries_on_after.is_some());
        match (&mut self.stage, again.filter(|_| moves)) {
            (Stage::Between { next, .. }, Some(again)) => {
                *next = again;
                again
            }
            _ => next,
        }
    }

    /// Whether the vehicle is late on its way to the last slot still, or has left a motion for now, and is not back where the next
    /// slot begins.
    pub(super) fn is_elsewhere(&self, next: u16) -> bool {
        if !self.vehicle.arrived && self.pair.slot_terms(next).is_some() {
            return true;
        }
        let moves = |slot: u16| self.pair.slot_terms(slot).is_some_and(SlotTerms::is_in_motion);
        next.checked_sub(1).is_some_and(moves)
            && (!self.vehicle.at_rest || !self.renews && moves(next) && self.vehicle.rests_for != Some(next))
    }

    /// How far this vehicle's clock may be from I's, by which slots open.
    pub(super) fn apart(&self) -> Duration {
        let offset = self.pair.clock_offset().filter(|_| self.role == Role::J);
        offset.map_or(Duration::ZERO, |offset| offset.uncertainty)
    }

    /// J: tells I that the jamming is about to end, as soon as the pose is none that serves.
    pub(super) fn warn_off_track(&mut self, now: Instant) {
        let strays = |slot: &Slot| slot.monitor.check().is_ok() && !slot.monitor.serves();
        let strays = self.role == Role::J && self.interlock.is_on() && self.slot().is_some_and(strays);
        if strays && !self.off_track {
            self.pair.silent(VeilwingSilence::VEILWING_SILENCE_POSE, now);
        }
        self.off_track = strays;
    }
}
