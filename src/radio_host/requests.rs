//! What is asked of the radio beside power: the kill, its declaration, its time.

use mavlink::dialects::ardupilotmega::{MavCmd, MavMessage, MavResult, TIMESYNC_DATA};

use super::host::Host;
use super::notice::Notice;
use super::parameters;
use crate::reply::{self, acknowledgement};
use crate::time::Instant;

impl Host {
    /// A command other than power.
    pub(super) fn handle_command(
        &mut self,
        sender: (u8, u8),
        target: (u8, u8),
        command: MavCmd,
        param1: f32,
        now: Instant,
    ) {
        let own = self.settings.own;
        if command == MavCmd::MAV_CMD_USER_2 {
            let to_all = [0, own.0].contains(&target.0) && [0, own.1].contains(&target.1);
            let lifts = param1 == 1.0;
            if target == own || to_all && !lifts {
                self.handle_kill(sender, lifts, now);
            }
        } else if target == own {
            let power = u32::from(self.settings.command) == command as u32;
            let only_int = if power {
                MavResult::MAV_RESULT_COMMAND_INT_ONLY
            } else {
                MavResult::MAV_RESULT_UNSUPPORTED
            };
            self.say(acknowledgement(sender, command, only_int));
        }
    }

    /// The kill is obeyed from whoever may, at once; it is lifted where the radio is off.
    fn handle_kill(&mut self, sender: (u8, u8), lifts: bool, now: Instant) {
        let own_system = sender.0 == self.settings.own.0;
        let result = if !(self.settings.signed || own_system || self.settings.operators.contains(&sender.0)) {
            self.is_stranger(sender, now);
            MavResult::MAV_RESULT_DENIED
        } else if !lifts {
            if self.kill.latch(sender) {
                self.tell(Notice::Killed);
            }
            self.silence(now);
            if !self.rig.is_silent() {
                self.say(acknowledgement(sender, MavCmd::MAV_CMD_USER_2, MavResult::MAV_RESULT_IN_PROGRESS));
            }
            return self.answer_settled(now);
        } else if self.rig.is_off() {
            if self.kill.lift() {
                self.tell(Notice::Lifted);
            }
            MavResult::MAV_RESULT_ACCEPTED
        } else {
            MavResult::MAV_RESULT_DENIED
        };
        self.say(acknowledgement(sender, MavCmd::MAV_CMD_USER_2, result));
    }

    pub(super) fn answer_parameters(&mut self, target: (u8, u8), message: &MavMessage) {
        let own = self.settings.own;
        if [0, own.0].contains(&target.0) && [0, own.1].contains(&target.1) {
            for answer in parameters::answers(&self.settings.facts, message) {
                self.say(answer);
            }
        }
    }

    /// A signed link's other end asks this way whether we are alive, and there.
    pub(super) fn answer_time(&mut self, sender: (u8, u8), question: &TIMESYNC_DATA, now: Instant) {
        let own = self.settings.own;
        let for_us =
            [0, own.0].contains(&question.target_system) && [0, own.1].contains(&question.target_component);
        if for_us {
            self.say(reply::time(sender, question, now));
        }
    }
}
