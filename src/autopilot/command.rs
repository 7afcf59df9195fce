//! Commands that are acknowledged: one in flight for each command id (an ACK carries nothing but the id), repeated
//! with a rising `confirmation` until answered, given more time by IN_PROGRESS.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::{COMMAND_ACK_DATA, COMMAND_LONG_DATA, MavCmd, MavMessage, MavResult};

use super::outbox::{Address, Outbox};
use crate::time::Instant;

const ANSWER_TIMEOUT: Duration = Duration::from_millis(500);
const PROGRESS_TIMEOUT: Duration = Duration::from_secs(5);
const ATTEMPTS: u8 = 4;
/// A command that nobody answers is given up after this.
pub(super) const LONGEST_WAIT: Duration = ANSWER_TIMEOUT.saturating_mul(ATTEMPTS as u32);

/// What a command was sent for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Purpose {
    /// SET_MESSAGE_INTERVAL of this message.
    Interval(u32),
    /// REQUEST_MESSAGE of this message.
    Request(u32),
    /// DO_SET_MODE.
    Mode,
    /// COMPONENT_ARM_DISARM.
    Arming,
    /// NAV_TAKEOFF.
    TakeOff,
    /// A first body offset of zero, to see that the bridge script of ArduPilot's 6DoF frame is there.
    Bridge,
    /// Body offsets of that script on or off.
    Offsets,
}

/// How a command ended: the autopilot's answer, or `None` if there was none.
pub(super) type Outcome = Option<MavResult>;

/// Whether an acknowledgement is for `own`; some autopilots leave the target empty.
pub(super) fn is_meant_for(ack: &COMMAND_ACK_DATA, own: Address) -> bool {
    (ack.target_system == 0 || ack.target_system == own.0)
        && (ack.target_component == 0 || ack.target_component == own.1)
}

#[derive(Debug, Clone)]
struct Pending {
    command: COMMAND_LONG_DATA,
    purpose: Purpose,
    sent: u8,
    /// `None` until it is sent for the first time.
    waits_until: Option<Instant>,
}

/// The commands that wait to be sent or to be answered.
#[derive(Debug, Clone, Default)]
pub(super) struct CommandQueue {
    pending: Vec<Pending>,
}

impl CommandQueue {
    /// Queues a command. One with the same purpose that is still unanswered is forgotten.
    pub(super) fn push(&mut self, command: COMMAND_LONG_DATA, purpose: Purpose) {
        self.cancel(purpose);
        self.pending.push(Pending { command, purpose, sent: 0, waits_until: None });
    }

    /// Queues a command ahead of all others: it goes out although another of its id is unanswered.
    pub(super) fn push_ahead(&mut self, command: COMMAND_LONG_DATA, purpose: Purpose) {
        self.cancel(purpose);
        self.pending.insert(0, Pending { command, purpose, sent: 0, waits_until: None });
    }

    /// Forgets the command with this purpose: it is not repeated, its answer is not looked for.
    pub(super) fn cancel(&mut self, purpose: Purpose) {
        self.pending.retain(|pending| pending.purpose != purpose);
    }

    pub(super) fn clear(&mut self) {
        self.pending.clear();
    }

    /// Takes an answer that is meant for `own` and says which command it ends.
    pub(super) fn handle_ack(
        &mut self,
        ack: &COMMAND_ACK_DATA,
        own: Address,
        now: Instant,
    ) -> Option<(Purpose, Outcome)> {
        let meant_for_us = is_meant_for(ack, own);
        let index = self
            .pending
            .iter()
            .position(|p| meant_for_us && p.command.command == ack.command && p.waits_until.is_some())?;
        if ack.result == MavResult::MAV_RESULT_IN_PROGRESS {
            self.pending[index].waits_until = Some(now + PROGRESS_TIMEOUT);
            return None;
        }
        let ended = self.pending.remove(index);
        Some((ended.purpose, Some(ack.result)))
    }

    /// Sends what is due and says which commands were given up.
    pub(super) fn advance(
        &mut self,
        now: Instant,
        target: Address,
        out: &mut Outbox,
    ) -> Vec<(Purpose, Outcome)> {
        let mut ended = Vec::new();
        let mut index = 0;
        while index < self.pending.len() {
            let blocked = self.pending[..index]
                .iter()
                .any(|p| p.command.command == self.pending[index].command.command);
            let pending = &mut self.pending[index];
            let due = match pending.waits_until {
                None => !blocked,
                Some(until) => until <= now,
            };
            if due && pending.sent == ATTEMPTS {
                ended.push((pending.purpose, None));
                self.pending.remove(index);
                continue;
            }
            if due {
                (pending.command.target_system, pending.command.target_component) = target;
                pending.command.confirmation = pending.sent;
                pending.sent += 1;
                pending.waits_until = Some(now + ANSWER_TIMEOUT);
                out.send(MavMessage::COMMAND_LONG(pending.command.clone()));
            }
            index += 1;
        }
        ended
    }

    pub(super) fn timeout(&self) -> Option<Instant> {
        self.pending.iter().filter_map(|pending| pending.waits_until).min()
    }
}

/// A COMMAND_LONG with its first two parameters; the queue fills in the address.
pub(super) fn long(command: MavCmd, [param1, param2]: [f32; 2]) -> COMMAND_LONG_DATA {
    COMMAND_LONG_DATA {
        param1,
        param2,
        param3: 0.0,
        param4: 0.0,
        param5: 0.0,
        param6: 0.0,
        param7: 0.0,
        command,
        target_system: 0,
        target_component: 0,
        confirmation: 0,
    }
}
