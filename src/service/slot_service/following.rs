//! Poses, or a whole plan, made anew before a slot is agreed on, and motions while it is served.

use std::sync::Arc;
use std::time::Duration;

use super::{SlotService, Stage};
use crate::pair::adoption::Asked;
use crate::pair::{AskedSlot, Places, SlotTerms};
use crate::planner::following::Motion;
use crate::planner::plan::VehiclePlan;
use crate::role::{PerVehicle, Role};
use crate::time::Instant;

/// Poses that were made so long ago are made anew once more: those that they are for have moved.
const MADE_FOR: Duration = Duration::from_millis(1500);
/// Whoever was asked for them, and has none after so long, is asked again.
const ASKED_FOR: Duration = Duration::from_secs(3);

/// I: poses of a slot that are made anew.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Anew {
    /// Nobody was asked for any.
    No,
    /// The owner was, then.
    Asked(u16, Instant),
    /// They are there since then, for those that move; `None`: as the plan has them.
    Made(u16, Instant, Option<Places>),
}

impl Anew {
    /// For whom they are made; the next slot's are made by themselves.
    pub fn take(&mut self) -> Option<Places> {
        match std::mem::replace(self, Self::No) {
            Self::Made(.., places) => places,
            Self::No | Self::Asked(..) => None,
        }
    }
}

impl SlotService {
    /// I: opening and lead of a slot that is to be proposed, once its poses are made; of one whose poses are the plan's, at once.
    pub(super) fn terms_anew(
        &mut self,
        next: u16,
        planned: (Duration, Duration),
        now: Instant,
    ) -> Option<(Duration, Duration)> {
        if !self.renews && !self.pair.slot_terms(next).is_some_and(SlotTerms::follows) {
            return Some(planned);
        }
        match self.anew {
            Anew::Made(slot, at, _) if slot == next && now < at + MADE_FOR => {
                self.pair.slot_terms(next).map(|terms| (terms.opens, terms.lead))
            }
            Anew::Asked(slot, at) if slot == next && now < at + ASKED_FOR => None,
            _ => {
                self.anew = Anew::Asked(next, now);
                self.events.push_back(super::Event::PlanSlot(next, None));
                None
            }
        }
    }

    /// The slots from the next one on are to be planned anew before it is agreed on, from where both rest: none carries on the one under
    /// way.
    pub fn set_renewing(&mut self, renews: bool) {
        self.renews = renews;
    }

    /// What [`super::Event::PlanSlot`] asked for: the slot's poses and the way to them, from where both rest, and of those after it where
    /// they are planned with it. `None`: none were found; I then proposes the slot as the plan has it, which is for a vehicle that rests
    /// where the slot before left it.
    pub fn slot_planned(&mut self, asked: &AskedSlot, terms: Option<Vec<SlotTerms>>, now: Instant) {
        if let Anew::Asked(slot, _) = self.anew
            && slot == asked.slot
        {
            self.anew = Anew::Made(slot, now, terms.is_some().then_some(asked.places));
        }
        self.pair.slot_planned(asked, terms, now);
    }

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

    /// J: this motion is made here, and I takes it up once it is [told](Self::motion_planned): what is vouched for from now on holds in it,
    /// too.
    pub fn foresee(&mut self, motion: &Arc<Motion>) {
        if let (Role::J, Stage::Committed(slot)) = (self.role, &mut self.stage) {
            slot.foresee(motion);
            self.pair.set_vouch(None);
        }
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
        Some(self.agreed_terms()?.vehicles)
    }

    /// The terms of the slot agreed on.
    #[must_use]
    pub fn agreed_terms(&self) -> Option<&SlotTerms> {
        self.pair.slot_terms(self.slot()?.commitment.slot)
    }

    /// What [`super::Event::TakeUp`] asked for: pose and power follow it from its beginning on.
    pub fn take_up(&mut self, motion: &Arc<Motion>) {
        let Stage::Committed(slot) = &mut self.stage else { return };
        slot.take_up(motion);
        if let Some(outgrown_at) = slot.outgrown_at() {
            self.pair.motion_outgrows(outgrown_at);
        }
    }
}
