//! Motions that are made anew while a slot is served.

use std::sync::Arc;

use super::{SlotService, Stage};
use crate::pair::Places;
use crate::pair::adoption::Asked;
use crate::planner::following::Motion;
use crate::planner::plan::VehiclePlan;
use crate::role::PerVehicle;
use crate::time::Instant;

impl SlotService {
    /// I: whether a motion may be asked for: the slot has opened, is not being ended, and none is under way.
    #[must_use]
    pub fn may_ask_motion(&self, now: Instant) -> bool {
        let open =
            |slot: &super::Slot| !slot.closing && (slot.commitment.opens_at..slot.closes_at).contains(&now);
        self.slot().is_some_and(open) && self.pair.may_ask_motion(now)
    }

    /// I: asks for a motion, for those that move.
    pub fn ask_motion(&mut self, places: Places, now: Instant) {
        self.pair.ask_motion(places, now);
    }

    /// The motion that was asked for last in the slot.
    #[must_use]
    pub fn asked_motion(&self) -> Option<&Asked<Places>> {
        self.pair.asked_motion()
    }

    /// The motion of this number is made here, with this digest, or none was found.
    pub fn motion_planned(&mut self, number: u16, digest: Option<u64>, now: Instant) {
        self.pair.motion_planned(number, digest, now);
    }

    /// I: whether J flies the same motion, or nearly.
    #[must_use]
    pub fn flies_alike(&self, now: Instant) -> bool {
        self.pair.flies_alike(now)
    }

    /// How both are in the slot agreed on, as planned before anything moved.
    #[must_use]
    pub fn slot_vehicles(&self) -> Option<PerVehicle<VehiclePlan>> {
        Some(self.pair.slot_terms(self.slot()?.commitment.slot)?.vehicles)
    }

    /// What [`super::Event::TakeUp`] asked for: pose and power follow it from its beginning on.
    pub fn take_up(&mut self, motion: &Arc<Motion>) {
        if let Stage::Committed(slot) = &mut self.stage {
            slot.take_up(motion);
        }
    }
}
