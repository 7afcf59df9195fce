//! A committed slot: its times on our monotonic clock, our power and pose in it.

use crate::pair::{Commitment, SlotTerms};
use crate::planner::turning::Track;
use crate::role::Role;
use crate::time::Instant;
use crate::transmitter::{NotReady, Trouble};

use super::interlock::{Silence, Window};
use super::pose_monitor::{PoseMonitor, Reference, Tolerance};
use super::protection::{Jamming, Protection};

/// See the module.
#[derive(Debug, Clone)]
pub struct Slot {
    /// What was agreed on.
    pub commitment: Commitment,
    power_w: f64,
    /// How this vehicle turns in it, where it is served through its turns.
    pub track: Option<Track>,
    /// It carries on the slot before, by the clock.
    pub carried_on: bool,
    /// I may radiate from here ...
    pub radiate_from: Instant,
    /// ... to here; J from the opening, or from when it is turned, until I is off, at most to the close.
    pub radiate_until: Instant,
    /// From when to when the vehicle is turned as serving the user asks for.
    in_place: [Instant; 2],
    /// The slot's end.
    pub closes_at: Instant,
    /// To be ended early, in order: I is off at once, J vouches no more and is off once I is.
    pub(super) closing: bool,
    pub(super) monitor: PoseMonitor,
    pub(super) protection: Protection,
    pub(super) jamming: Jamming,
    pub(super) served: Served,
    /// Its radio was at the slot's power, as it answered.
    pub(super) achieved: bool,
    /// What was wrong with the radio's device while it was to radiate, last.
    pub(super) trouble: Option<Trouble>,
}

/// Whether this vehicle's transmitter was on in a slot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Served {
    /// It was.
    Yes,
    /// It was not: the last reason that was found within the slot's airtime, if that ever began.
    No(Option<Silence>),
}

impl Slot {
    /// The slot agreed on, by the plan's terms; or one that carries on the one before, and is agreed on with that.
    pub(super) fn new(
        role: Role,
        commitment: Commitment,
        carried_on: bool,
        terms: &SlotTerms,
        tolerance: Tolerance,
    ) -> Self {
        let vehicle = terms.vehicles[role];
        let track = terms.tracks.as_ref().map(|tracks| tracks[role].clone());
        let track = if carried_on { track } else { track.map(Track::from_rest) };
        let reference = Reference { pose: vehicle.pose, track: track.clone(), opens_at: commitment.opens_at };
        let (opens_at, closes_at) = (commitment.opens_at, commitment.opens_at + terms.length);
        let turned = track.as_ref().map_or([None; 2], Track::in_place);
        let turned = turned.map(|since_s| since_s.map(|since_s| opens_at.after_s(since_s)));
        Self {
            commitment,
            power_w: vehicle.tx_power_w,
            track,
            carried_on,
            radiate_from: commitment.opens_at + terms.radiate_from,
            radiate_until: commitment.opens_at + terms.radiate_until,
            in_place: [
                turned[0].map_or(opens_at, |at| at.max(opens_at)),
                turned[1].map_or(closes_at, |at| at.min(closes_at)),
            ],
            closes_at,
            closing: false,
            monitor: PoseMonitor::new(reference, tolerance.leaning(terms.lean_rad[role])),
            protection: Protection::default(),
            jamming: Jamming::Unconfirmed,
            served: Served::No(None),
            achieved: false,
            trouble: None,
        }
    }

    /// The plan's power in watts.
    #[must_use]
    pub fn power_w(&self, now: Instant) -> f64 {
        let since_opening_s = now.seconds_since(self.commitment.opens_at);
        self.track.as_ref().map_or(self.power_w, |track| track.tx_power_w(since_opening_s))
    }

    /// J: up to when I may rest on this much power, if it may: not beyond where the plan asks for more, nor on a vehicle that turns
    /// away.
    pub(super) fn suffices_until(&self, power_w: f64, now: Instant) -> Option<Instant> {
        let opens_at = self.commitment.opens_at;
        let more_at = match &self.track {
            Some(track) => {
                let outgrown_s = track.outgrows(power_w, now.seconds_since(opens_at));
                outgrown_s.map(|since_s| opens_at.after_s(since_s))
            }
            None => (power_w < self.power_w).then_some(now),
        };
        Some(more_at.map_or(self.in_place[1], |at| at.min(self.in_place[1]))).filter(|until| now < *until)
    }

    /// Whether this vehicle's transmitter was on, as far as is known: a permit is nothing where the radio's device never did it.
    pub(super) fn outcome(&self) -> Served {
        match (self.served, self.trouble) {
            (Served::Yes, Some(trouble)) if !self.achieved => {
                Served::No(Some(Silence::Transmitter(NotReady::Trouble(trouble))))
            }
            (served, _) => served,
        }
    }

    /// Whether the next slot to be agreed on is this one again: it was carried on to, and ended before this vehicle was on the air
    /// in it. The other one may not have begun it at all.
    pub(super) fn is_to_be_repeated(&self, now: Instant) -> bool {
        self.carried_on && now < self.closes_at && matches!(self.served, Served::No(_))
    }

    /// When `role` may radiate. `leases_outstanding`: I may hold a lease of J.
    pub(super) fn window(&self, role: Role, leases_outstanding: bool, now: Instant) -> Window {
        let (from, until) = match role {
            Role::I if self.closing => (self.radiate_from, now),
            Role::I => (self.radiate_from, self.radiate_until),
            // Once I has said that it is off and holds nothing, J has no more to protect.
            Role::J if (self.closing || now >= self.radiate_until) && !leases_outstanding => {
                (self.in_place[0], now)
            }
            Role::J => (self.in_place[0], self.closes_at),
        };
        Window { slot: self.commitment.slot, from, until, power_w: self.power_w(now) }
    }
}
