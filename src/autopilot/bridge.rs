//! Body offsets of ArduPilot's 6DoF frame.
//!
//! Such a vehicle tracks a roll and pitch of its own apart from its position, but takes them from a script on board
//! alone (the repository's `ardupilot/`): COMMAND_LONG 31013 carries the angles, 31014 switches them on and off, and
//! each is acknowledged. An attitude target is never sent to it: a quaternion panics that frame. Offsets are setpoints,
//! so one is never repeated for want of an answer; the next one is on its way.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::{COMMAND_ACK_DATA, MavCmd, MavMessage, MavResult};

use super::Address;
use super::adapter::Autopilot;
use super::command::{Outcome, Purpose, is_meant_for};
use super::control::Phase;
use super::firmware::Firmware;
use super::setpoint::frd_euler;
use super::settings::{Actuation, Event};
use super::streams::long;
use crate::geo::Attitude;
use crate::time::Instant;

/// The script answers each offset, so they are sent no faster than this.
const OFFSET_INTERVAL: Duration = Duration::from_millis(50);
/// Offsets without an answer for so long are not followed.
const UNANSWERED: Duration = Duration::from_secs(1);
/// A refused switch is asked for again after this.
const ASK_AGAIN: Duration = Duration::from_secs(1);

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
enum Switch {
    #[default]
    Off,
    Asked,
    On,
    Refused {
        ask_at: Instant,
    },
}

/// What the script was asked and what it answered.
#[derive(Debug, Default)]
pub(super) struct Bridge {
    probed: Outcome,
    switch: Switch,
    sent_at: Option<Instant>,
    unanswered_since: Option<Instant>,
    /// The trouble at hand has been told.
    told: bool,
}

impl Bridge {
    /// The answer to the first offset of zero; `None` if there was none.
    pub(super) fn probed(&self) -> Outcome {
        self.probed
    }

    /// The script was told to go level, or does so by itself.
    fn is_off(&mut self) {
        *self = Self { probed: self.probed, ..Self::default() };
    }
}

impl Autopilot {
    /// Whether roll and pitch go through the script.
    pub(super) fn is_bridged(&self) -> bool {
        self.settings.actuation == Actuation::Pose
            && self.peer.is_some_and(|(firmware, _)| firmware == Firmware::ArduPilot)
    }

    /// Asks the script whether it is there, by an offset of zero.
    pub(super) fn probe_bridge(&mut self) {
        self.bridge = Bridge::default();
        if self.is_bridged() {
            self.commands.push(long(MavCmd::MAV_CMD_USER_4, [0.0, 0.0]), Purpose::Bridge);
        }
    }

    pub(super) fn bridge_probed(&mut self, outcome: Outcome) {
        self.bridge.probed = outcome;
    }

    /// Switches the offsets off: the autopilot is to land, hold or return by itself.
    pub(super) fn level_offsets(&mut self) {
        if self.is_bridged() {
            self.bridge.is_off();
            self.commands.push(long(MavCmd::MAV_CMD_USER_5, [0.0, 0.0]), Purpose::Offsets);
        }
    }

    /// Control is gone: nothing is asked of the script any more, which goes level by itself.
    pub(super) fn forget_offsets(&mut self) {
        if self.bridge.switch == Switch::Asked {
            self.commands.cancel(Purpose::Offsets);
        }
        self.bridge.is_off();
    }

    /// Has the script follow this attitude, once it has agreed to.
    pub(super) fn drive_offsets(&mut self, attitude: Attitude, target: Address, now: Instant) {
        let may_ask = match self.bridge.switch {
            Switch::Off => true,
            Switch::Refused { ask_at } => now >= ask_at,
            Switch::Asked | Switch::On => false,
        };
        if self.control.phase == Phase::Held && may_ask {
            self.bridge.switch = Switch::Asked;
            self.commands.push(long(MavCmd::MAV_CMD_USER_5, [1.0, 0.0]), Purpose::Offsets);
        }
        let too_soon = self.bridge.sent_at.is_some_and(|at| now < at + OFFSET_INTERVAL);
        if self.bridge.switch != Switch::On || too_soon {
            return;
        }
        if self.bridge.unanswered_since.is_some_and(|since| now >= since + UNANSWERED) {
            self.tell_refused(None);
        }
        self.bridge.sent_at = Some(now);
        self.bridge.unanswered_since.get_or_insert(now);
        let (roll_rad, pitch_rad, _) = frd_euler(attitude);
        let angles = [roll_rad.to_degrees() as f32, pitch_rad.to_degrees() as f32];
        let mut command = long(MavCmd::MAV_CMD_USER_4, angles);
        (command.target_system, command.target_component) = target;
        self.out.send(MavMessage::COMMAND_LONG(command));
    }

    /// The answer to 31014.
    pub(super) fn switch_answered(&mut self, outcome: Outcome, now: Instant) {
        if self.bridge.switch != Switch::Asked {
            return; // to the order to go level
        }
        if outcome == Some(MavResult::MAV_RESULT_ACCEPTED) {
            self.bridge.switch = Switch::On;
            self.bridge.told = false;
        } else {
            self.bridge.switch = Switch::Refused { ask_at: now + ASK_AGAIN };
            self.tell_refused(outcome);
        }
    }

    /// The answer to an offset, if this is one.
    pub(super) fn offset_answered(&mut self, ack: &COMMAND_ACK_DATA, now: Instant) {
        let is_ours = ack.command == MavCmd::MAV_CMD_USER_4 && is_meant_for(ack, self.settings.own);
        if !is_ours || self.bridge.switch != Switch::On {
            return;
        }
        self.bridge.unanswered_since = None;
        match ack.result {
            MavResult::MAV_RESULT_ACCEPTED => self.bridge.told = false,
            // The script has gone level by itself and wants to be switched on again.
            MavResult::MAV_RESULT_TEMPORARILY_REJECTED => {
                self.bridge.switch = Switch::Refused { ask_at: now + ASK_AGAIN };
                self.tell_refused(Some(ack.result));
            }
            other => self.tell_refused(Some(other)),
        }
    }

    fn tell_refused(&mut self, result: Outcome) {
        if !std::mem::replace(&mut self.bridge.told, true) {
            let statustext = self.last_text.as_ref().map(|text| text.value.clone());
            self.out.tell(Event::Refused { what: "body offsets", result, statustext });
        }
    }
}
