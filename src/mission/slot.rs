//! The course of one committed slot: transit, on station, jam first, transmit second, stop in the reverse order.

use std::time::Duration;

use crate::pair::wire::{VeilwingFlags, VeilwingSilence};
use crate::pair::{Commitment, Vouch};
use crate::role::Role;
use crate::time::Instant;

use super::executive::{Executive, Motion};
use super::flight::Phase;
use super::interlock::{Facts, Silence, Window};
use super::pose_monitor::{PoseMonitor, Tolerance};

/// I asks for leases this long before it may radiate, so that it holds one when its time comes.
const ASK_EARLY: Duration = Duration::from_millis(200);

/// A committed slot.
#[derive(Debug, Clone)]
pub(super) struct SlotRun {
    pub commitment: Commitment,
    pub monitor: PoseMonitor,
    pub power_w: f64,
    pub user: String,
    /// I may radiate from here ...
    pub radiate_from: Instant,
    /// ... to here; J from the opening until I is off, at most to the close.
    pub radiate_until: Instant,
    pub closes_at: Instant,
    /// The switching on has been said.
    pub announced: bool,
}

/// What the peer is told of a silence out of turn; `None` for those that are its own news or in turn.
pub(super) fn silence_reason(silence: Silence) -> Option<VeilwingSilence> {
    match silence {
        Silence::Killed | Silence::NotAuthorised => Some(VeilwingSilence::VEILWING_SILENCE_OPERATOR),
        Silence::Stale => Some(VeilwingSilence::VEILWING_SILENCE_LINK),
        Silence::NotInControl => Some(VeilwingSilence::VEILWING_SILENCE_CONTROL),
        Silence::Estimator => Some(VeilwingSilence::VEILWING_SILENCE_ESTIMATOR),
        Silence::Pose => Some(VeilwingSilence::VEILWING_SILENCE_POSE),
        Silence::NoPower => Some(VeilwingSilence::VEILWING_SILENCE_TRANSMITTER),
        Silence::NoSlot | Silence::NoLease | Silence::NoPeer => None,
    }
}

impl Executive {
    /// Both sides have agreed: the transit begins at the table's time before the opening.
    pub(super) fn begin_slot(&mut self, commitment: Commitment, now: Instant) {
        let role = self.settings.role;
        let Some((entry, plan)) = self.entry(commitment.slot).zip(self.plan.as_ref()) else { return };
        let Some(planned) = plan.slots.get(entry.user_index) else { return };
        let vehicle = planned.plan.vehicles[role];
        let after_opening = |t: Duration| commitment.opens_at + t.saturating_sub(entry.opens);
        let motion = Motion {
            trajectory: entry.transit[role].clone(),
            starts_at: commitment.opens_at - entry.opens.saturating_sub(entry.transit_starts),
        };
        let slot = SlotRun {
            commitment,
            monitor: PoseMonitor::new(vehicle.pose, Tolerance::for_jitter(self.settings.jitter_rad)),
            power_w: vehicle.tx_power_w,
            user: planned.user.clone(),
            radiate_from: after_opening(entry.radiate_from),
            radiate_until: after_opening(entry.radiate_until),
            closes_at: after_opening(entry.closes),
            announced: false,
        };
        let opens_in = commitment.opens_at.saturating_since(now).as_secs_f64();
        let text = format!("slot {} for {}: agreed, opens in {opens_in:.1} s", commitment.slot, slot.user);
        self.motion = Some(motion);
        self.slot = Some(slot);
        self.enter(Phase::Slot, now);
        self.notice(mavlink::dialects::ardupilotmega::MavSeverity::MAV_SEVERITY_INFO, text);
    }

    /// Whether the slot's time is over.
    pub(super) fn slot_over(&self, now: Instant) -> bool {
        self.slot.as_ref().is_none_or(|slot| now >= slot.closes_at)
    }

    /// Feeds the pose monitor with the newest state.
    pub(super) fn watch_pose(&mut self) {
        let state = self.autopilot.state();
        if let Some(slot) = self.slot.as_mut() {
            if let Some(position) = state.position_enu_m {
                slot.monitor.position(position.value);
            }
            if let Some(attitude) = state.attitude {
                slot.monitor.attitude(&attitude.value, attitude.received_at);
            }
        }
    }

    /// The interlock's facts while a slot is committed.
    pub(super) fn slot_facts(&self, slot: &SlotRun, base: Facts, now: Instant) -> Facts {
        let arrived = self.motion.as_ref().is_some_and(|motion| now >= motion.ends_at());
        let (from, until) = match self.settings.role {
            Role::I => (slot.radiate_from, slot.radiate_until),
            // Once I has said that it is off and holds nothing, J has no more to protect.
            Role::J if now >= slot.radiate_until && !base.leases_outstanding => {
                (slot.commitment.opens_at, now)
            }
            Role::J => (slot.commitment.opens_at, slot.closes_at),
        };
        let peer = self.pair.peer();
        Facts {
            window: Some(Window { slot: slot.commitment.slot, from, until, power_w: slot.power_w }),
            pose_ok: arrived && slot.monitor.check().is_ok(),
            peer_on_station: peer.heard_within(self.settings.pair.lease, now)
                && peer.committed == Some(slot.commitment.proposal)
                && peer.says(VeilwingFlags::VEILWING_FLAGS_ON_STATION),
            ..base
        }
    }

    /// I: asks for leases while it could use one. J: vouches while its transmitter is acknowledged on and its own
    /// interlock agrees.
    pub(super) fn tell_pair_of_slot(&mut self, now: Instant) {
        let Some(slot) = &self.slot else {
            self.pair.want_lease(false, now);
            self.pair.set_vouch(None);
            return;
        };
        let facts = self.facts(now);
        match self.settings.role {
            Role::I => {
                let in_time = slot.radiate_from <= now + ASK_EARLY && now < slot.radiate_until;
                let able = facts.pose_ok && facts.state_fresh && facts.in_control && facts.estimator_ok;
                let allowed = self.interlock.may_radiate();
                self.pair.want_lease(in_time && able && allowed, now);
            }
            Role::J => {
                let lease = self.interlock.transmitter().acknowledged().filter(|lease| {
                    lease.slot == slot.commitment.slot && lease.power_w >= 0.99 * slot.power_w
                });
                let ending = self.pending_abort.is_some() || self.stop_wanted;
                let on = self.interlock.is_on() && now < slot.radiate_until && !ending;
                self.pair.set_vouch(lease.filter(|_| on).map(|lease| Vouch {
                    transmitter_expires_at: lease.expires_at,
                    round_trip: self.interlock.transmitter().round_trip().unwrap_or_default(),
                    closes_at: slot.closes_at,
                }));
            }
        }
    }
}
