//! The commands given, by number, and those of them that may still matter.

use std::collections::VecDeque;

use mavlink::dialects::ardupilotmega::{COMMAND_INT_DATA, MavCmd, MavMessage};

use super::clock::RadioTime;
use crate::time::Instant;
use crate::transmitter::wire::WHOLE;
use crate::transmitter::{power_command, power_dbm};

/// Numbers left for the offs with which a boot's numbers end.
const NUMBERS_KEPT: u32 = 16;
/// Commands remembered, to find the one that an answer names.
const MOST_SENT: usize = 256;

/// What a command asked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Asked {
    Off,
    On { power_w: f64, slot: u16, expires: RadioTime },
}

/// A command on its way, or answered.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sent {
    pub number: u32,
    pub at: Instant,
    pub asked: Asked,
    pub answered: bool,
    /// Its number is taken and nothing else: it will never be in force.
    refused: bool,
}

/// Numbers commands and remembers them.
#[derive(Debug, Clone)]
pub(super) struct Commands {
    command: MavCmd,
    target: (u8, u8),
    boot: u32,
    /// The series that they name.
    series: u32,
    last_number: u32,
    sent: VecDeque<Sent>,
}

impl Commands {
    /// Of a companion whose start `boot` tells from others.
    pub fn new(command: MavCmd, target: (u8, u8), boot: u32) -> Self {
        // From 1 to the largest that single precision holds.
        let boot = boot % (WHOLE - 1) + 1;
        Self { command, target, boot, series: 0, last_number: 0, sent: VecDeque::new() }
    }

    /// The same boot's to another radio; the numbers go on, in case it is the same.
    pub fn to_another(&self, target: (u8, u8)) -> Self {
        Self { target, series: 0, sent: VecDeque::new(), ..self.clone() }
    }

    /// As if the companion had started again; `taken`: the series in which the radio holds the boot that ends.
    pub fn begun_anew(&self, taken: Option<u32>) -> Self {
        let series = taken.unwrap_or(self.series);
        Self { series, ..Self::new(self.command, self.target, self.boot) }
    }

    pub fn command(&self) -> MavCmd {
        self.command
    }

    pub fn boot(&self) -> u32 {
        self.boot
    }

    pub fn last_number(&self) -> u32 {
        self.last_number
    }

    /// Whether a new boot has to begin: after weeks.
    pub fn are_used_up(&self) -> bool {
        self.last_number + NUMBERS_KEPT >= WHOLE
    }

    /// The series that the radio states.
    pub fn name_series(&mut self, series: u32) {
        self.series = series;
    }

    /// The last one given.
    pub fn last(&self) -> Option<&Sent> {
        self.sent.back()
    }

    /// Those after `number` that may be in force, for all that was answered.
    pub fn not_refused_since(&self, number: u32) -> impl Iterator<Item = &Sent> {
        self.sent.iter().filter(move |sent| sent.number > number && !sent.refused)
    }

    /// The command of this number, which is answered now, and whether for the first time.
    pub fn answered(&mut self, number: u32) -> Option<(Sent, bool)> {
        let sent = self.sent.iter_mut().find(|sent| sent.number == number)?;
        let first = !std::mem::replace(&mut sent.answered, true);
        Some((*sent, first))
    }

    /// The command of this number changes nothing.
    pub fn refused(&mut self, number: u32) {
        if let Some(sent) = self.sent.iter_mut().find(|sent| sent.number == number) {
            sent.refused = true;
        }
    }

    /// Forgets what can neither come into force any more nor be in force unknown: `newest` is the highest number known
    /// to be taken, `in_force` that of the power known to be in force.
    pub fn forget_settled(&mut self, newest: u32, in_force: Option<u32>) {
        self.sent.retain(|sent| {
            sent.number >= newest || !sent.refused && in_force.is_some_and(|known| sent.number > known)
        });
    }

    /// The next command, and the number of the one that is no longer remembered for it.
    pub fn give(&mut self, asked: Asked, now: Instant) -> (MavMessage, Option<u32>) {
        self.last_number += 1;
        let number = self.last_number;
        let full = self.sent.len() == MOST_SENT;
        let forgotten = if full { self.sent.pop_front().map(|oldest| oldest.number) } else { None };
        self.sent.push_back(Sent { number, at: now, asked, answered: false, refused: false });
        let (dbm, slot, expires_ms) = match asked {
            Asked::Off => (f32::NEG_INFINITY, 0, 0),
            Asked::On { power_w, slot, expires } => (power_dbm(power_w), slot, expires.wire_ms()),
        };
        let command = COMMAND_INT_DATA {
            // Below 2^24 single precision holds them as they are.
            param2: number as f32,
            param3: self.boot as f32,
            param4: self.series as f32,
            ..power_command(self.command, self.target, dbm, slot, expires_ms.cast_signed())
        };
        (MavMessage::COMMAND_INT(command), forgotten)
    }

    /// As after that many commands, all of them settled.
    #[cfg(test)]
    pub fn skip_to(&mut self, number: u32) {
        self.last_number = number;
        self.sent.clear();
    }
}
