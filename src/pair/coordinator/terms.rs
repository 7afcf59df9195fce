//! What the executive tells the coordinator, and what it is told.

use std::time::Duration;

use super::super::orders::{Change, Record};
use super::super::wire::{VeilwingAnswer, VeilwingFlags, VeilwingSilence};
use crate::geo::Enu;
use crate::planner::plan::VehiclePlan;
use crate::planner::track::Track;
use crate::role::{PerVehicle, Role};
use crate::time::{Instant, Utc};

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
    /// What an earlier process kept of the operator's orders.
    pub orders: Record,
}

/// The plan both sides must share.
#[derive(Debug, Clone)]
pub struct PlanTerms {
    /// SHA-256 of the plan.
    pub digest: [u8; 32],
    /// By slot number, over all superframes.
    pub slots: Vec<SlotTerms>,
}

impl PlanTerms {
    /// Whether `slot` can follow where `next` is to be agreed on: that one, or the one before where it carries on another: the
    /// other side may not have begun it, and both are where it is served, unless they move.
    #[must_use]
    pub fn can_follow(&self, slot: u16, next: u16) -> bool {
        let again = || {
            self.slots
                .get(usize::from(slot))
                .is_some_and(|terms| terms.carries_on_after.is_some() && !terms.is_in_motion())
        };
        slot == next || slot.checked_add(1) == Some(next) && again()
    }
}

/// One slot of the plan, as the slot table has it.
#[derive(Debug, Clone, PartialEq)]
pub struct SlotTerms {
    /// Poses and powers; of a slot that is served through its turns those between two turns.
    pub vehicles: PerVehicle<VehiclePlan>,
    /// How the vehicles turn, and J's power with them, in a slot that is served through its turns.
    pub tracks: Option<PerVehicle<Track>>,
    /// The largest tilt from its pose that the slot bears of each vehicle, radians; 0 of one that has no reason to lean.
    pub lean_rad: PerVehicle<f64>,
    /// From the instant that the slot table counts from to the slot's opening.
    pub opens: Duration,
    /// The transit to the slot begins this long before its opening.
    pub lead: Duration,
    /// The slot carries on the one before, from the same positions: where that one ends by the clock on both sides, it opens so
    /// long after, under the same proposal.
    pub carries_on_after: Option<Duration>,
    /// I may radiate from this long after the opening ...
    pub radiate_from: Duration,
    /// ... to this long after it.
    pub radiate_until: Duration,
    /// From the opening to the close.
    pub length: Duration,
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
    /// Our autopilot's land detector is held off: without our companion the vehicle cannot land by itself.
    pub guarding: bool,
}

impl Local {
    /// As the wire has them. `planned`: our plan is made; `committed`: to a slot.
    pub(super) fn flags(&self, planned: bool, committed: bool) -> VeilwingFlags {
        let mut flags = VeilwingFlags::empty();
        flags.set(VeilwingFlags::VEILWING_FLAGS_PLANNED, planned);
        flags.set(VeilwingFlags::VEILWING_FLAGS_HOME, self.home_enu_m.is_some());
        flags.set(VeilwingFlags::VEILWING_FLAGS_PREFLIGHT_OK, self.preflight_ok);
        flags.set(VeilwingFlags::VEILWING_FLAGS_AIRBORNE, self.airborne);
        flags.set(VeilwingFlags::VEILWING_FLAGS_ON_STATION, self.on_station);
        flags.set(VeilwingFlags::VEILWING_FLAGS_RADIATING, self.radiating);
        flags.set(VeilwingFlags::VEILWING_FLAGS_COMMITTED, committed);
        flags.set(VeilwingFlags::VEILWING_FLAGS_ENDED, self.ended);
        flags.set(VeilwingFlags::VEILWING_FLAGS_LANDED, self.landed);
        flags.set(VeilwingFlags::VEILWING_FLAGS_RETURNING, self.returning);
        flags.set(VeilwingFlags::VEILWING_FLAGS_GUARDING, self.guarding);
        flags
    }
}

impl SlotTerms {
    /// Whether the vehicles move while it is served.
    #[must_use]
    pub fn is_in_motion(&self) -> bool {
        self.tracks.as_ref().is_some_and(|tracks| tracks.i.way().is_some())
    }
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
    /// The same by I's clock.
    pub opens: Utc,
    /// When the transit to it begins.
    pub leaves_at: Instant,
}

/// J's vouching: what a lease may rest on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Vouch {
    /// Not before this does J's own transmitter fall silent, whatever becomes of J's companion.
    pub until: Instant,
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
    /// Our proposal of this slot was refused, or not agreed on in time.
    Refused(u16, VeilwingAnswer),
    /// A slot is agreed.
    Committed(Commitment),
    /// The peer is not, or no longer, committed to the slot that we are committed to.
    PeerLeft,
    /// The peer fell silent out of turn.
    PeerSilent(VeilwingSilence),
    /// What has come about by an operator's order, given here or at the peer.
    Ordered(Change),
}
