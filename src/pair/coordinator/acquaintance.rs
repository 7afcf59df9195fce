//! Who the peer is: the exchange of hellos, and whether it is still there.

use std::time::Duration;

use crate::role::Role;
use crate::time::Instant;

use super::super::peer::{Boot, Peer};
use super::super::wire::{self, MavMessage, VeilwingRole};
use super::micros;
use super::terms::{Event, Local, Settings};

const HELLO_EVERY: Duration = Duration::from_millis(500);
/// A hello that calls for an answer gets it at once, but no more often than this.
const HELLO_AT_MOST: Duration = Duration::from_millis(50);

/// Whom a hello came from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Meeting {
    /// Nobody who counts: an earlier boot, or one that has not proved itself.
    Nobody,
    /// A companion of our own role; `first`: not told yet.
    SameRole { first: bool },
    /// The peer as we know it.
    Known,
    /// The peer, for the first time.
    First,
    /// Another boot of the peer.
    Restarted,
}

/// See the module.
#[derive(Debug, Clone)]
pub(super) struct Acquaintance {
    role: Role,
    boot_id: u32,
    mission_digest: [u8; 32],
    lost_after: Duration,
    peer: Peer,
    sent: Option<Instant>,
    /// When the next hello is due.
    pub due: Instant,
    mismatch_told: bool,
    lost_told: bool,
}

impl Acquaintance {
    pub fn new(settings: &Settings, now: Instant) -> Self {
        Self {
            role: settings.role,
            boot_id: settings.boot_id,
            mission_digest: settings.mission_digest,
            lost_after: settings.lost_after,
            peer: Peer::default(),
            sent: None,
            due: now,
            mismatch_told: false,
            lost_told: false,
        }
    }

    pub fn peer(&self) -> &Peer {
        &self.peer
    }

    /// Our hello. `committed`: to a slot.
    pub fn hello(
        &mut self,
        local: &Local,
        committed: bool,
        plan_digest: Option<[u8; 32]>,
        now: Instant,
    ) -> MavMessage {
        self.due = now + HELLO_EVERY;
        self.sent = Some(now);
        let (echo_boot_id, echo_us) = self.peer.echo();
        MavMessage::VEILWING_HELLO(wire::VEILWING_HELLO_DATA {
            time_us: micros(now),
            echo_us,
            boot_id: self.boot_id,
            echo_boot_id,
            flags: local.flags(plan_digest.is_some(), committed),
            role: wire_role(self.role),
            mission_digest: self.mission_digest,
            plan_digest: plan_digest.unwrap_or([0; 32]),
            home_enu_m: local.home_enu_m.unwrap_or_default().into(),
        })
    }

    /// Says hello at once: the other side needs our echo to believe us.
    fn greet(&mut self, now: Instant) {
        let soonest = self.sent.map_or(now, |at| at + HELLO_AT_MOST);
        self.due = self.due.min(soonest);
    }

    /// Takes a hello.
    pub fn take(&mut self, hello: &wire::VEILWING_HELLO_DATA, now: Instant) -> Meeting {
        if hello.role == wire_role(self.role) {
            return Meeting::SameRole { first: !std::mem::replace(&mut self.mismatch_told, true) };
        }
        let meeting = match self.peer.take_hello(hello, self.boot_id, micros(now), now) {
            Boot::Late => return Meeting::Nobody,
            Boot::Unproven => {
                self.greet(now);
                return Meeting::Nobody;
            }
            Boot::Known => Meeting::Known,
            Boot::First => {
                self.greet(now);
                Meeting::First
            }
            Boot::Restarted => {
                self.greet(now);
                self.mismatch_told = false;
                Meeting::Restarted
            }
        };
        self.lost_told = false;
        meeting
    }

    /// Takes a status; `false` if it is not the peer's newest.
    pub fn take_status(&mut self, status: &wire::VEILWING_STATUS_DATA, now: Instant) -> bool {
        let newest = self.peer.is_boot(status.boot_id) && self.peer.take_status(status, now);
        self.lost_told &= !newest;
        newest
    }

    /// Takes a falling silent; `false` if it is not the peer's newest.
    pub fn take_silence(&mut self, silent: &wire::VEILWING_SILENT_DATA) -> bool {
        self.peer.is_boot(silent.boot_id) && self.peer.take_silence(silent.number)
    }

    /// A request has come, sent at `sent_us` of the peer's clock: for how long it was held up, at the least.
    pub fn asked(&mut self, sent_us: u64, now: Instant) -> Duration {
        self.lost_told = false;
        self.peer.hear(sent_us, now)
    }

    /// Another message of the peer has come.
    pub fn heard(&mut self, now: Instant) {
        self.peer.last_heard = Some(now);
        self.lost_told = false;
    }

    /// Whether mission and plan are known to be the same on both sides.
    pub fn agrees(&self, plan_digest: &[u8; 32]) -> bool {
        self.peer.mission_digest == Some(self.mission_digest) && self.peer.plan_digest == Some(*plan_digest)
    }

    /// Our plan is new: a mismatch is told again.
    pub fn compare_again(&mut self) {
        self.mismatch_told = false;
    }

    /// What does not agree, once.
    pub fn mismatch(&mut self, plan_digest: Option<[u8; 32]>) -> Option<Event> {
        let differs = plan_digest.zip(self.peer.plan_digest).is_some_and(|(ours, theirs)| ours != theirs);
        let mismatch = if self.peer.mission_digest != Some(self.mission_digest) {
            Event::MissionDiffers
        } else if differs {
            Event::PlanDiffers
        } else {
            return None;
        };
        (!std::mem::replace(&mut self.mismatch_told, true)).then_some(mismatch)
    }

    /// When the peer will be lost, if it is not heard.
    pub fn lost_due(&self) -> Option<Instant> {
        let heard = self.peer.last_heard.filter(|_| !self.lost_told);
        heard.map(|at| at + self.lost_after + Duration::from_nanos(1))
    }

    /// For how long the peer has been silent, once that is too long.
    pub fn lost(&mut self, now: Instant) -> Option<Duration> {
        self.lost_due().filter(|due| *due <= now)?;
        self.lost_told = true;
        self.peer.last_heard.map(|at| now.saturating_since(at))
    }
}

fn wire_role(role: Role) -> VeilwingRole {
    match role {
        Role::I => VeilwingRole::VEILWING_ROLE_I,
        Role::J => VeilwingRole::VEILWING_ROLE_J,
    }
}
