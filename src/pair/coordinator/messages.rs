//! What is said to the other side, and what its hellos, lease messages and clock messages change.

use std::time::Duration;

use crate::role::Role;
use crate::time::Instant;

use super::super::peer::Boot;
use super::super::wire::{self, MavMessage, VeilwingFlags, VeilwingRole};
use super::{Coordinator, Event, HELLO_AT_MOST, narrow};

impl Coordinator {
    fn flags(&self) -> VeilwingFlags {
        let mut flags = VeilwingFlags::empty();
        flags.set(VeilwingFlags::VEILWING_FLAGS_PLANNED, self.plan.is_some());
        flags.set(VeilwingFlags::VEILWING_FLAGS_HOME, self.local.home_enu_m.is_some());
        flags.set(VeilwingFlags::VEILWING_FLAGS_PREFLIGHT_OK, self.local.preflight_ok);
        flags.set(VeilwingFlags::VEILWING_FLAGS_AIRBORNE, self.local.airborne);
        flags.set(VeilwingFlags::VEILWING_FLAGS_ON_STATION, self.local.on_station);
        flags.set(VeilwingFlags::VEILWING_FLAGS_RADIATING, self.local.radiating);
        flags.set(VeilwingFlags::VEILWING_FLAGS_COMMITTED, self.commitment.is_some());
        flags.set(VeilwingFlags::VEILWING_FLAGS_ENDED, self.local.ended);
        flags.set(VeilwingFlags::VEILWING_FLAGS_LANDED, self.local.landed);
        flags.set(VeilwingFlags::VEILWING_FLAGS_RETURNING, self.local.returning);
        flags.set(VeilwingFlags::VEILWING_FLAGS_PAUSED, self.local.paused);
        flags
    }

    pub(super) fn hello(&self, now: Instant) -> MavMessage {
        let (echo_boot_id, echo_us) = self.peer.echo();
        MavMessage::VEILWING_HELLO(wire::VEILWING_HELLO_DATA {
            time_us: micros(now),
            echo_us,
            boot_id: self.settings.boot_id,
            echo_boot_id,
            flags: self.flags(),
            role: wire_role(self.settings.role),
            mission_digest: self.settings.mission_digest,
            plan_digest: self.plan.as_ref().map_or([0; 32], |plan| plan.digest),
            home_enu_m: self.local.home_enu_m.unwrap_or_default().into(),
        })
    }

    pub(super) fn status(&mut self, now: Instant) -> MavMessage {
        self.status_sequence += 1;
        let (proposal, slot) = self.commitment.map_or((0, 0), |c| (c.proposal, c.slot));
        let position = self.local.position_enu_m.map_or([f32::NAN; 3], narrow);
        let holds_nothing = !self.wants_lease && !self.local.radiating;
        MavMessage::VEILWING_STATUS(wire::VEILWING_STATUS_DATA {
            released_us: if holds_nothing { micros(now) } else { 0 },
            boot_id: self.settings.boot_id,
            sequence: self.status_sequence,
            proposal,
            position_enu_m: position,
            slot,
            flags: self.flags(),
        })
    }

    fn plan_digest(&self) -> Option<wire::ShortDigest> {
        self.plan.as_ref().map(|plan| wire::short(&plan.digest))
    }

    /// Says hello at once: the other side needs our echo to believe us.
    fn greet(&mut self, now: Instant) {
        let soonest = self.hello_sent.map_or(now, |at| at + HELLO_AT_MOST);
        self.next_hello = self.next_hello.min(soonest);
    }

    pub(super) fn take_hello(&mut self, hello: &wire::VEILWING_HELLO_DATA, now: Instant) {
        if hello.role == wire_role(self.settings.role) {
            if !self.mismatch_reported {
                self.mismatch_reported = true;
                self.events.push_back(Event::SameRole);
            }
            return;
        }
        match self.peer.take_hello(hello, self.settings.boot_id, micros(now), now) {
            Boot::Unproven => return self.greet(now),
            Boot::Late => return,
            Boot::Known => {}
            Boot::First => {
                self.greet(now);
                self.events.push_back(Event::PeerFound);
            }
            Boot::Restarted => {
                self.greet(now);
                self.release(now);
                self.book.new_boot();
                self.finished = 0;
                self.orders_taken = None;
                self.clock.reset();
                self.mismatch_reported = false;
                self.events.push_back(Event::PeerRestarted);
            }
        }
        self.lost_reported = false;
        if self.mismatch_reported {
            return;
        }
        let plans = (self.plan.as_ref().map(|plan| plan.digest), self.peer.plan_digest);
        if hello.mission_digest != self.settings.mission_digest {
            self.mismatch_reported = true;
            self.events.push_back(Event::MissionDiffers);
        } else if let (Some(ours), Some(theirs)) = plans
            && ours != theirs
        {
            self.mismatch_reported = true;
            self.events.push_back(Event::PlanDiffers);
        }
    }

    pub(super) fn take_request(&mut self, request: &wire::VEILWING_LEASE_REQUEST_DATA, now: Instant) {
        let (Some(commitment), Some(vouch), Some(plan_digest)) =
            (self.commitment, self.vouch, self.plan_digest())
        else {
            return;
        };
        if self.leads() || !self.peer.is_boot(request.boot_id) || request.proposal != commitment.proposal {
            return;
        }
        self.heard(now);
        let granted = self.book.grant(
            request.time_us,
            vouch.transmitter_expires_at,
            vouch.round_trip,
            self.settings.lease,
            vouch.closes_at,
            now,
        );
        let Some(duration_ms) = granted.and_then(|d| u16::try_from(d.as_millis()).ok()) else { return };
        self.transmit.push_back(MavMessage::VEILWING_LEASE_GRANT(wire::VEILWING_LEASE_GRANT_DATA {
            time_us: request.time_us,
            boot_id: request.boot_id,
            proposal: commitment.proposal,
            slot: commitment.slot,
            duration_ms,
            plan_digest,
        }));
    }

    pub(super) fn take_grant(&mut self, grant: &wire::VEILWING_LEASE_GRANT_DATA, now: Instant) {
        let (Some(commitment), Some(plan_digest)) = (self.commitment, self.plan_digest()) else { return };
        if self.leads()
            && self.wants_lease
            && grant.boot_id == self.settings.boot_id
            && grant.proposal == commitment.proposal
            && grant.slot == commitment.slot
            && grant.plan_digest == plan_digest
        {
            self.heard(now);
            let asked_at = Instant::from_start(Duration::from_micros(grant.time_us));
            let duration = Duration::from_millis(grant.duration_ms.into()).min(self.settings.lease);
            self.holder.take(asked_at, duration, now);
        }
    }

    pub(super) fn take_clock(&mut self, clock: &wire::VEILWING_CLOCK_DATA, now: Instant) {
        let Some(utc) = self.utc_at(now) else { return };
        if clock.receive_us == 0 {
            let reply = wire::VEILWING_CLOCK_DATA {
                receive_us: utc.unix_us,
                transmit_us: utc.unix_us,
                ..clock.clone()
            };
            self.transmit.push_back(MavMessage::VEILWING_CLOCK(reply));
        } else {
            self.clock.take(clock.originate_us, clock.receive_us, clock.transmit_us, utc.unix_us);
        }
    }
}

fn wire_role(role: Role) -> VeilwingRole {
    match role {
        Role::I => VeilwingRole::VEILWING_ROLE_I,
        Role::J => VeilwingRole::VEILWING_ROLE_J,
    }
}

pub(super) fn micros(at: Instant) -> u64 {
    u64::try_from(at.since_start().as_micros()).unwrap_or(u64::MAX)
}
