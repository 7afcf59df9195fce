//! A committed slot: its times on our monotonic clock, our power and pose in it.

use crate::pair::{Commitment, SlotTerms};
use crate::role::Role;
use crate::time::Instant;
use crate::transmitter::{NotReady, Trouble};

use super::interlock::{Silence, Window};
use super::pose_monitor::{PoseMonitor, Tolerance};
use super::protection::{Jamming, Protection};

/// See the module.
#[derive(Debug, Clone)]
pub struct Slot {
    /// What was agreed on.
    pub commitment: Commitment,
    /// The plan's power in watts.
    pub power_w: f64,
    /// I may radiate from here ...
    pub radiate_from: Instant,
    /// ... to here; J from the opening until I is off, at most to the close.
    pub radiate_until: Instant,
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
    /// The slot agreed on, by the plan's terms.
    pub(super) fn new(role: Role, commitment: Commitment, terms: &SlotTerms, tolerance: Tolerance) -> Self {
        let vehicle = terms.vehicles[role];
        Self {
            commitment,
            power_w: vehicle.tx_power_w,
            radiate_from: commitment.opens_at + terms.radiate_from,
            radiate_until: commitment.opens_at + terms.radiate_until,
            closes_at: commitment.opens_at + terms.length,
            closing: false,
            monitor: PoseMonitor::new(vehicle.pose, tolerance.leaning(terms.lean_rad[role])),
            protection: Protection::default(),
            jamming: Jamming::Unconfirmed,
            served: Served::No(None),
            achieved: false,
            trouble: None,
        }
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

    /// When `role` may radiate. `leases_outstanding`: I may hold a lease of J.
    pub(super) fn window(&self, role: Role, leases_outstanding: bool, now: Instant) -> Window {
        let (from, until) = match role {
            Role::I if self.closing => (self.radiate_from, now),
            Role::I => (self.radiate_from, self.radiate_until),
            // Once I has said that it is off and holds nothing, J has no more to protect.
            Role::J if (self.closing || now >= self.radiate_until) && !leases_outstanding => {
                (self.commitment.opens_at, now)
            }
            Role::J => (self.commitment.opens_at, self.closes_at),
        };
        Window { slot: self.commitment.slot, from, until, power_w: self.power_w }
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::geo::{Enu, Pose};
    use crate::planner::plan::VehiclePlan;
    use crate::role::PerVehicle;

    fn at(ms: u64) -> Instant {
        Instant::from_start(Duration::from_millis(ms))
    }

    /// From 10 to 20 s, half a second of guard at each end.
    fn slot(role: Role) -> Slot {
        let pose = Pose { position_enu_m: Enu::zeros(), roll_rad: 0.0, pitch_rad: 0.0, yaw_rad: 0.0 };
        let vehicle = VehiclePlan { pose, tx_power_w: 0.5 };
        let terms = SlotTerms {
            vehicles: PerVehicle { i: vehicle, j: vehicle },
            lean_rad: PerVehicle { i: 0.0, j: 0.0 },
            opens: Duration::ZERO,
            lead: Duration::ZERO,
            radiate_from: Duration::from_millis(500),
            radiate_until: Duration::from_millis(9500),
            length: Duration::from_secs(10),
        };
        let commitment = Commitment { proposal: 1, slot: 3, opens_at: at(10_000), leaves_at: at(10_000) };
        Slot::new(role, commitment, &terms, Tolerance::for_jitter(0.0))
    }

    #[test]
    fn spec_i_radiates_within_the_guard_and_j_around_it_while_i_may() {
        for (role, closing, leases_outstanding, now_ms, from_ms, until_ms) in [
            (Role::I, false, false, 12_000, 10_500, 19_500),
            (Role::I, true, false, 12_000, 10_500, 12_000),
            (Role::J, false, false, 12_000, 10_000, 20_000),
            (Role::J, true, true, 12_000, 10_000, 20_000),
            (Role::J, true, false, 12_000, 10_000, 12_000),
            (Role::J, false, false, 19_499, 10_000, 20_000),
            (Role::J, false, false, 19_500, 10_000, 19_500),
            (Role::J, false, true, 19_500, 10_000, 20_000),
        ] {
            let slot = Slot { closing, ..slot(role) };
            let window = slot.window(role, leases_outstanding, at(now_ms));
            let expected = Window { slot: 3, from: at(from_ms), until: at(until_ms), power_w: 0.5 };
            assert_eq!(window, expected, "{role:?}, closing {closing}, leases {leases_outstanding}");
        }
    }

    #[test]
    fn spec_a_permit_that_the_device_never_carried_out_is_no_service() {
        let trouble = Trouble::DeviceLate;
        let of_device = Served::No(Some(Silence::Transmitter(NotReady::Trouble(trouble))));
        for (served, trouble, achieved, outcome) in [
            (Served::Yes, None, false, Served::Yes),
            (Served::Yes, Some(trouble), true, Served::Yes),
            (Served::Yes, Some(trouble), false, of_device),
            (Served::No(Some(Silence::Pose)), Some(trouble), false, Served::No(Some(Silence::Pose))),
        ] {
            assert_eq!(Slot { served, trouble, achieved, ..slot(Role::I) }.outcome(), outcome);
        }
    }
}
