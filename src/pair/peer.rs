//! What is known of the other companion.

use std::collections::VecDeque;
use std::time::Duration;

use nalgebra::Vector3;

use crate::geo::Enu;
use crate::time::Instant;

use super::wire::{VEILWING_HELLO_DATA, VEILWING_STATUS_DATA, VeilwingFlags};

/// How many earlier boots of the peer are remembered, so that their late messages are not taken for a new one.
const OLD_BOOTS: usize = 8;

/// The other companion, as its messages describe it.
#[derive(Debug, Clone)]
pub struct Peer {
    boot_id: Option<u32>,
    old_boots: VecDeque<u32>,
    status_sequence: Option<u32>,
    silences: u32,
    /// When the last valid message came.
    pub last_heard: Option<Instant>,
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
    /// The proposal it is committed to.
    pub committed: Option<u32>,
}

impl Default for Peer {
    fn default() -> Self {
        Self {
            boot_id: None,
            old_boots: VecDeque::new(),
            status_sequence: None,
            silences: 0,
            last_heard: None,
            flags: VeilwingFlags::empty(),
            mission_digest: None,
            plan_digest: None,
            home_enu_m: None,
            position_enu_m: None,
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
    /// A late message of an earlier boot: to be ignored.
    Old,
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

    /// Whether its last message carried `flag`.
    #[must_use]
    pub fn says(&self, flag: VeilwingFlags) -> bool {
        self.flags.contains(flag)
    }

    pub(super) fn take_hello(&mut self, hello: &VEILWING_HELLO_DATA, now: Instant) -> Boot {
        let boot = match self.boot_id {
            _ if self.old_boots.contains(&hello.boot_id) => return Boot::Old,
            None => Boot::First,
            Some(known) if known == hello.boot_id => Boot::Known,
            Some(known) => {
                if self.old_boots.len() == OLD_BOOTS {
                    self.old_boots.pop_front();
                }
                self.old_boots.push_back(known);
                let old_boots = std::mem::take(&mut self.old_boots);
                *self = Self { old_boots, ..Self::default() };
                Boot::Restarted
            }
        };
        self.boot_id = Some(hello.boot_id);
        self.last_heard = Some(now);
        self.mission_digest = Some(hello.mission_digest);
        let says = |flag| hello.flags.contains(flag);
        self.plan_digest = says(VeilwingFlags::VEILWING_FLAGS_PLANNED).then_some(hello.plan_digest);
        self.home_enu_m = says(VeilwingFlags::VEILWING_FLAGS_HOME)
            .then(|| Vector3::from(hello.home_enu_m))
            .filter(|home| home.iter().all(|x| x.is_finite()));
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
        self.last_heard = Some(now);
        self.flags = status.flags;
        self.committed = self.says(VeilwingFlags::VEILWING_FLAGS_COMMITTED).then_some(status.proposal);
        let position = Vector3::from(status.position_enu_m).map(f64::from);
        if position.iter().all(|x| x.is_finite()) {
            self.position_enu_m = Some(position);
        }
        true
    }
}
