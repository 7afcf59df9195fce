//! Power by commands that expire a time after their receipt: for radios that know no better form.
//!
//! COMMAND_ACK carries no sequence number, so an acknowledgement may belong to any command that is still unanswered.
//! It is counted for the oldest of them: a lease then only ever looks shorter than it is.

use std::collections::VecDeque;
use std::time::Duration;

use mavlink::dialects::ardupilotmega::{COMMAND_ACK_DATA, MavCmd, MavMessage, MavResult};

use super::round_trip::RoundTrips;
use super::{LONGEST_TRANSIT, Lease, PERSISTENCE, power_command, power_dbm, until_next_off};
use crate::time::Instant;
use crate::units::{Dbm, Watts};

/// What an acknowledgement reports as achieved power when there is none.
const OFF: i32 = i32::MIN;
/// An unanswered command is repeated after this; a mere renewal waits this long for the last one's answer.
const ANSWER_TIMEOUT: Duration = Duration::from_millis(100);

/// What is wanted of the radio.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Wanted {
    Off { since: Instant, confirmed: bool, repeat_at: Instant },
    On { power_w: f64, slot: u16, expires_at: Instant, send_at: Option<Instant> },
}

/// A command to radiate that is not answered yet.
#[derive(Debug, Clone, Copy)]
struct Unanswered {
    sent_at: Instant,
    slot: u16,
    expiry: Duration,
    /// Off was sent after it: its answer grants nothing.
    revoked: bool,
}

impl Unanswered {
    fn expires_at(&self) -> Instant {
        self.sent_at + self.expiry
    }
}

/// The driver of a leased transmitter.
#[derive(Debug, Clone)]
pub(super) struct Leased {
    command: MavCmd,
    own: (u8, u8),
    target: (u8, u8),
    wanted: Wanted,
    unanswered: VecDeque<Unanswered>,
    /// When the off that is unanswered was sent, if it was sent once.
    off_sent_at: Option<Instant>,
    off_unanswered: bool,
    lease: Option<Lease>,
    /// The latest instant at which the radio can still be on by any command sent so far.
    on_until: Option<Instant>,
    round_trips: RoundTrips,
    supported: Option<bool>,
    refusal: Option<MavResult>,
}

impl Leased {
    pub(super) fn new(command: MavCmd, own: (u8, u8), target: (u8, u8), off_at: Instant) -> Self {
        let wanted = Wanted::Off { since: off_at, confirmed: false, repeat_at: off_at };
        Self {
            command,
            own,
            target,
            wanted,
            unanswered: VecDeque::new(),
            off_sent_at: None,
            off_unanswered: false,
            lease: None,
            on_until: None,
            round_trips: RoundTrips::default(),
            supported: None,
            refusal: None,
        }
    }

    pub(super) fn radiate(
        &mut self,
        power_w: f64,
        slot: u16,
        expires_at: Instant,
        now: Instant,
        out: &mut VecDeque<MavMessage>,
    ) {
        let renewal = matches!(self.wanted, Wanted::On { power_w: p, slot: s, expires_at: e, .. }
            if p == power_w && s == slot && e <= expires_at);
        let same_power =
            matches!(self.wanted, Wanted::On { power_w: p, slot: s, .. } if p == power_w && s == slot);
        if !same_power {
            self.lease = None;
        }
        self.wanted = Wanted::On { power_w, slot, expires_at, send_at: None };
        match self.unanswered.back() {
            Some(last) if renewal && now < last.sent_at + ANSWER_TIMEOUT => {
                self.wanted =
                    Wanted::On { power_w, slot, expires_at, send_at: Some(last.sent_at + ANSWER_TIMEOUT) };
            }
            _ => self.send_on(now, out),
        }
    }

    pub(super) fn silence(&mut self, now: Instant, out: &mut VecDeque<MavMessage>) {
        self.lease = None;
        self.unanswered.iter_mut().for_each(|command| command.revoked = true);
        self.wanted =
            Wanted::Off { since: now, confirmed: false, repeat_at: now + until_next_off(Duration::ZERO) };
        self.send_off(now, out);
    }

    pub(super) fn link_is_back(&mut self, now: Instant, out: &mut VecDeque<MavMessage>) {
        if matches!(self.wanted, Wanted::Off { .. }) {
            self.silence(now, out);
        }
    }

    pub(super) fn handle_ack(
        &mut self,
        ack: &COMMAND_ACK_DATA,
        now: Instant,
        out: &mut VecDeque<MavMessage>,
    ) {
        let ours = (ack.target_system == 0 || ack.target_system == self.own.0)
            && (ack.target_component == 0 || ack.target_component == self.own.1);
        if ack.command != self.command || !ours || ack.result == MavResult::MAV_RESULT_IN_PROGRESS {
            return;
        }
        self.forget_lost(now);
        match (ack.result, ack.result_param2) {
            (MavResult::MAV_RESULT_ACCEPTED, OFF) => {
                self.supported = Some(true);
                self.refusal = None;
                self.off_unanswered = false;
                if let Some(sent_at) = self.off_sent_at.take() {
                    self.round_trips.add(sent_at, now);
                }
                // It may answer an earlier off than the last; while a command to radiate is unanswered, off goes on.
                if let Wanted::Off { confirmed, .. } = &mut self.wanted {
                    *confirmed = self.unanswered.is_empty();
                }
            }
            (MavResult::MAV_RESULT_ACCEPTED, achieved_mdbm) => self.accepted_on(achieved_mdbm, now, out),
            (result, _) => {
                self.unanswered.pop_front();
                self.refusal = Some(result);
                if result == MavResult::MAV_RESULT_UNSUPPORTED {
                    self.supported = Some(false);
                }
            }
        }
    }

    fn accepted_on(&mut self, achieved_mdbm: i32, now: Instant, out: &mut VecDeque<MavMessage>) {
        // An answer to nothing that we sent: after a restart, say.
        let Some(oldest) = self.unanswered.pop_front() else { return };
        self.supported = Some(true);
        self.refusal = None;
        self.round_trips.add(oldest.sent_at, now);
        match self.wanted {
            Wanted::On { .. } if oldest.revoked => {}
            Wanted::On { .. } => {
                let power_w = Watts::from(Dbm(f64::from(achieved_mdbm) * 1e-3)).0;
                // Any of those that are still unanswered may be the one that the radio follows by now.
                let ends = self.unanswered.iter().map(Unanswered::expires_at);
                let expires_at = ends.fold(oldest.expires_at(), Instant::min);
                self.lease = Some(Lease { power_w, slot: oldest.slot, expires_at });
                if matches!(self.wanted, Wanted::On { send_at: Some(_), .. }) {
                    self.send_on(now, out);
                }
            }
            // It came on after it was told off: told in the wrong order.
            Wanted::Off { confirmed: true, .. } => self.silence(now, out),
            Wanted::Off { .. } => {}
        }
    }

    pub(super) fn advance(&mut self, now: Instant, out: &mut VecDeque<MavMessage>) {
        self.forget_lost(now);
        match self.wanted {
            Wanted::Off { confirmed: false, repeat_at, since } if repeat_at <= now => {
                let interval = until_next_off(now.saturating_since(since));
                self.wanted = Wanted::Off { since, confirmed: false, repeat_at: now + interval };
                self.send_off(now, out);
            }
            Wanted::On { expires_at, .. } if expires_at <= now => self.silence(now, out),
            Wanted::On { .. } if self.send_at().is_some_and(|at| at <= now) => self.send_on(now, out),
            Wanted::Off { .. } | Wanted::On { .. } => {}
        }
    }

    pub(super) fn timeout(&self) -> Option<Instant> {
        match self.wanted {
            Wanted::Off { confirmed: true, .. } => None,
            Wanted::Off { repeat_at, .. } => Some(repeat_at),
            Wanted::On { expires_at, .. } => Some(self.send_at().map_or(expires_at, |at| at.min(expires_at))),
        }
    }

    /// When the wanted power is to be sent (again).
    fn send_at(&self) -> Option<Instant> {
        let Wanted::On { send_at, .. } = self.wanted else { return None };
        send_at.or_else(|| self.unanswered.back().map(|last| last.sent_at + ANSWER_TIMEOUT))
    }

    pub(super) fn lease(&self) -> Option<Lease> {
        self.lease
    }

    pub(super) fn is_off(&self, now: Instant) -> bool {
        match self.wanted {
            Wanted::On { .. } => false,
            Wanted::Off { confirmed: true, .. } => true,
            // What a former process of ours commanded has run out as well, if the radio lets it run out.
            Wanted::Off { since, .. } => match self.on_until {
                Some(until) => until <= now,
                None => self.supported == Some(true) && since + PERSISTENCE <= now,
            },
        }
    }

    /// The median of the last three seconds; while it is confirmed off, of what was measured last.
    pub(super) fn round_trip(&self, now: Instant) -> Option<Duration> {
        self.round_trips.median(now).or_else(|| self.round_trips.last())
    }

    pub(super) fn supported(&self) -> Option<bool> {
        self.supported
    }

    pub(super) fn refusal(&self) -> Option<MavResult> {
        self.refusal
    }

    /// Commands whose answer can no longer come.
    fn forget_lost(&mut self, now: Instant) {
        while self.unanswered.front().is_some_and(|oldest| oldest.sent_at + 2 * LONGEST_TRANSIT <= now) {
            self.unanswered.pop_front();
        }
    }

    fn send_on(&mut self, now: Instant, out: &mut VecDeque<MavMessage>) {
        let Wanted::On { power_w, slot, expires_at, .. } = self.wanted else { return };
        let expiry_ms = i32::try_from(expires_at.saturating_since(now).as_millis()).unwrap_or(i32::MAX);
        if expiry_ms <= 0 {
            return self.silence(now, out);
        }
        self.wanted = Wanted::On { power_w, slot, expires_at, send_at: None };
        let expiry = Duration::from_millis(expiry_ms.unsigned_abs().into());
        self.unanswered.push_back(Unanswered { sent_at: now, slot, expiry, revoked: false });
        // From now on the radio may be following this command instead of the acknowledged one.
        if let Some(lease) = &mut self.lease {
            lease.expires_at = lease.expires_at.min(now + expiry);
        }
        self.on_until = self.on_until.max(Some(now + expiry + LONGEST_TRANSIT));
        out.push_back(self.message(power_dbm(power_w), slot, expiry_ms));
    }

    fn send_off(&mut self, now: Instant, out: &mut VecDeque<MavMessage>) {
        // An answer to a repeated command may be to any of its copies: it measures nothing (Karn's algorithm).
        self.off_sent_at = if self.off_unanswered { None } else { Some(now) };
        self.off_unanswered = true;
        out.push_back(self.message(f32::NEG_INFINITY, 0, 0));
    }

    fn message(&self, power_dbm: f32, slot: u16, expiry_ms: i32) -> MavMessage {
        MavMessage::COMMAND_INT(power_command(self.command, self.target, power_dbm, slot, expiry_ms))
    }
}
