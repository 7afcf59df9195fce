//! What is known of the other companion.

use std::time::Duration;

use nalgebra::Vector3;

use crate::geo::{Enu, has_meaning};
use crate::time::Instant;

use super::age::Ages;
use super::coordinator::{MeasuredJitter, Pace, Rest};
use super::wire::{VEILWING_HELLO_DATA, VEILWING_STATUS_DATA, VeilwingFlags};

/// The other companion, as its messages describe it.
#[derive(Debug, Clone)]
pub struct Peer {
    pub(super) boot_id: Option<u32>,
    /// Our monotonic clock when this boot was taken in, microseconds.
    known_since_us: u64,
    hello_us: u64,
    /// The last hello heard, to be echoed: its boot and its sender's clock.
    heard_hello: (u32, u64),
    status_sequence: Option<u32>,
    silences: u32,
    /// When the last valid message came.
    pub last_heard: Option<Instant>,
    ages: Ages,
    /// When the youngest of its words was said, at the latest.
    spoke_at: Option<Instant>,
    /// Flags of the last status or hello.
    pub flags: VeilwingFlags,
    /// Digest of its mission.
    pub mission_digest: Option<[u8; 32]>,
    /// Digest of its plan.
    pub plan_digest: Option<[u8; 32]>,
    /// Its home in the mission frame.
    pub home_enu_m: Option<Enu>,
    /// Its last reported position.
    pub position_enu_m: Option<Enu>,
    /// Where it rests, between slots whose poses are made anew.
    pub rests: Option<Rest>,
    /// Its jitter in the last slot, where that is another than the mission says.
    pub jitter: Option<MeasuredJitter>,
    /// What it makes in this wind, where that is less than the mission says.
    pub pace: Option<Pace>,
    /// The proposal it is committed to.
    pub committed: Option<u32>,
}

impl Default for Peer {
    fn default() -> Self {
        Self {
            boot_id: None,
            known_since_us: 0,
            hello_us: 0,
            heard_hello: (0, 0),
            status_sequence: None,
            silences: 0,
            last_heard: None,
            ages: Ages::default(),
            spoke_at: None,
            flags: VeilwingFlags::empty(),
            mission_digest: None,
            plan_digest: None,
            home_enu_m: None,
            position_enu_m: None,
            rests: None,
            jitter: None,
            pace: None,
            committed: None,
        }
    }
}

/// Whether a hello came from the boot that is known.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Boot {
    First,
    Known,
    Restarted,
    /// A late message of an earlier boot, or one that has not heard us yet: to be ignored.
    Unproven,
    /// An older hello of the boot that is known.
    Late,
}

impl Peer {
    /// Whether a message of `boot_id` is from the peer's present boot.
    pub(super) fn is_boot(&self, boot_id: u32) -> bool {
        self.boot_id == Some(boot_id)
    }

    /// Whether anything was heard within `timeout`.
    #[must_use]
    pub fn heard_within(&self, timeout: Duration, now: Instant) -> bool {
        self.last_heard.is_some_and(|at| now.saturating_since(at) <= timeout)
    }

    /// Whether anything was said within `timeout`, as far as can be told: what was held up on its way is heard, and old.
    #[must_use]
    pub fn spoke_within(&self, timeout: Duration, now: Instant) -> bool {
        self.spoke_at.is_some_and(|at| now.saturating_since(at) <= timeout)
    }

    /// Takes note of a word that was sent at `sent_us` of its sender's clock: for how long it was held up, at the least.
    pub(super) fn hear(&mut self, sent_us: u64, now: Instant) -> Duration {
        self.last_heard = Some(now);
        let age = self.ages.of(sent_us, now);
        self.spoke_at = self.spoke_at.max(Some(now - age));
        age
    }

    /// For how long nothing was heard; `None` if nothing ever was.
    #[must_use]
    pub fn silent_for(&self, now: Instant) -> Option<Duration> {
        self.last_heard.map(|at| now.saturating_since(at))
    }

    /// Whether its last message carried `flag`.
    #[must_use]
    pub fn says(&self, flag: VeilwingFlags) -> bool {
        self.flags.contains(flag)
    }

    /// What our hello echoes: boot and time of the last hello heard.
    pub(super) fn echo(&self) -> (u32, u64) {
        self.heard_hello
    }

    /// Takes a hello. Another boot than the known one is believed only if it echoes a hello that this boot of ours
    /// sent after the known one was taken in: a dead boot's late messages echo older ones, since it died before its
    /// successor was born. `own_boot` and `now_us` are ours.
    pub(super) fn take_hello(
        &mut self,
        hello: &VEILWING_HELLO_DATA,
        own_boot: u32,
        now_us: u64,
        now: Instant,
    ) -> Boot {
        let known = self.boot_id == Some(hello.boot_id);
        if known && hello.time_us < self.hello_us {
            return Boot::Late;
        }
        let alive = hello.echo_boot_id == own_boot && hello.echo_us <= now_us;
        let boot = match self.boot_id {
            Some(_) if known => Boot::Known,
            None if alive => Boot::First,
            Some(_) if alive && hello.echo_us > self.known_since_us => {
                *self = Self::default();
                Boot::Restarted
            }
            _ => {
                self.heard_hello = (hello.boot_id, hello.time_us);
                return Boot::Unproven;
            }
        };
        if boot != Boot::Known {
            self.known_since_us = now_us;
        }
        self.heard_hello = (hello.boot_id, hello.time_us);
        self.hello_us = hello.time_us;
        self.boot_id = Some(hello.boot_id);
        self.hear(hello.time_us, now);
        self.mission_digest = Some(hello.mission_digest);
        let says = |flag| hello.flags.contains(flag);
        self.plan_digest = says(VeilwingFlags::VEILWING_FLAGS_PLANNED).then_some(hello.plan_digest);
        self.home_enu_m = says(VeilwingFlags::VEILWING_FLAGS_HOME)
            .then(|| Vector3::from(hello.home_enu_m))
            .filter(has_meaning);
        // In flight the status, sent more often, is the fresher word on the flags.
        if self.status_sequence.is_none() {
            self.flags = hello.flags;
        }
        boot
    }

    /// Takes the number of a falling silent; `false` for a copy or an earlier one.
    pub(super) fn take_silence(&mut self, number: u32) -> bool {
        let new = number > self.silences;
        self.silences = self.silences.max(number);
        new
    }

    /// Takes a status; `false` if it is older than one already taken.
    pub(super) fn take_status(&mut self, status: &VEILWING_STATUS_DATA, now: Instant) -> bool {
        if self.status_sequence.is_some_and(|last| status.sequence <= last) {
            return false;
        }
        self.status_sequence = Some(status.sequence);
        self.hear(status.time_us, now);
        self.flags = status.flags;
        self.committed = self.says(VeilwingFlags::VEILWING_FLAGS_COMMITTED).then_some(status.proposal);
        let position = Vector3::from(status.position_enu_m).map(f64::from);
        if has_meaning(&position) {
            self.position_enu_m = Some(position);
        }
        self.rests = Rest::of_wire(status.rests_enu_m, status.rests_wxyz);
        self.jitter = MeasuredJitter::of_wire(status.jitter_cdeg);
        self.pace = Pace::of_wire(status.pace_percent);
        true
    }
}

#[cfg(test)]
mod tests;
