//! Answers that every component of ours gives alike.

use mavlink::dialects::ardupilotmega::{COMMAND_ACK_DATA, MavCmd, MavMessage, MavResult, TIMESYNC_DATA};

use crate::time::Instant;

/// The answer to a command of `by`, a (system, component).
#[must_use]
pub fn acknowledgement(by: (u8, u8), command: MavCmd, result: MavResult) -> MavMessage {
    let (target_system, target_component) = by;
    MavMessage::COMMAND_ACK(COMMAND_ACK_DATA {
        command,
        result,
        target_system,
        target_component,
        ..COMMAND_ACK_DATA::default()
    })
}

/// The answer to a TIMESYNC of `by` that asks: our clock, in nanoseconds, which is never 0, the mark of a question. So the
/// other end of a signed link asks whether we are alive, and there (`link::dialogue`).
#[must_use]
pub fn time(by: (u8, u8), asked: &TIMESYNC_DATA, now: Instant) -> MavMessage {
    let (target_system, target_component) = by;
    MavMessage::TIMESYNC(TIMESYNC_DATA {
        tc1: i64::try_from(now.since_start().as_nanos()).unwrap_or(i64::MAX).max(1),
        ts1: asked.ts1,
        target_system,
        target_component,
    })
}
