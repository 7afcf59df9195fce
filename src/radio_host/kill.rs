//! The radio kill (31011): latched until a person lifts it at this very radio, over every restart.

use mavlink::dialects::ardupilotmega::{MavCmd, MavMessage, MavResult};

use crate::reply::acknowledgement;

/// Kills that wait for the radio to be off before they are answered; more than these are not answered.
const MOST_WAITING: usize = 16;

/// The latch, and who waits for its answer.
#[derive(Debug, Clone, Default)]
pub(super) struct Kill {
    killed: bool,
    waiting: Vec<(u8, u8)>,
    /// To be written down.
    record: Option<bool>,
}

impl Kill {
    pub fn new(killed: bool) -> Self {
        Self { killed, ..Self::default() }
    }

    pub fn holds(&self) -> bool {
        self.killed
    }

    /// Latches it for `by`; whether it was not before.
    pub fn latch(&mut self, by: (u8, u8)) -> bool {
        if !self.waiting.contains(&by) && self.waiting.len() < MOST_WAITING {
            self.waiting.push(by);
        }
        let new = !std::mem::replace(&mut self.killed, true);
        if new {
            self.record = Some(true);
        }
        new
    }

    /// Lifts it; whether it was latched before.
    pub fn lift(&mut self) -> bool {
        let new = std::mem::replace(&mut self.killed, false);
        if new {
            self.record = Some(false);
        }
        new
    }

    /// What the next process is to find.
    pub fn poll_record(&mut self) -> Option<bool> {
        self.record.take()
    }

    /// The answers to all that wait: the radio is off.
    pub fn answers(&mut self) -> Vec<MavMessage> {
        self.waiting
            .drain(..)
            .map(|by| acknowledgement(by, MavCmd::MAV_CMD_USER_2, MavResult::MAV_RESULT_ACCEPTED))
            .collect()
    }
}
