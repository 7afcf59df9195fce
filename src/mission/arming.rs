//! An autopilot that asks before it arms (MAV_CMD_ARM_AUTHORIZATION_REQUEST; PX4's `COM_ARM_AUTH_REQ`): may it?
//!
//! Yes where the companion arms it itself, and on the ground where no preflight check of ours fails, whoever arms it then; no
//! otherwise, and while the radio kill holds, which is one of the checks. Why not is said in words, and the answer says that
//! it is. Asked by our own autopilot alone: another's vehicle is not ours to judge.

use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::{MavArmAuthDeniedReason, MavCmd, MavMessage, MavResult};

use crate::reply::acknowledgement;

use super::executive::Executive;
use super::notice::Notice;
use super::phase::Phase;

/// An autopilot's component.
const AUTOPILOT: u8 = 1;
/// So many seconds a yes is good for: what was looked at may change.
const GOOD_FOR_S: i32 = 5;

impl Executive {
    /// Whether this was such a question, which is answered.
    pub(super) fn handle_arming(&mut self, header: MavHeader, message: &MavMessage) -> bool {
        let (system, component, command) = match message {
            MavMessage::COMMAND_LONG(c) => (c.target_system, c.target_component, c.command),
            MavMessage::COMMAND_INT(c) => (c.target_system, c.target_component, c.command),
            _ => return false,
        };
        let (own_system, own_component) = self.settings.own;
        let ours = header.system_id == u32::from(own_system) && header.component_id == AUTOPILOT;
        let to_us = [0, own_system].contains(&system) && [0, own_component].contains(&component);
        if command != MavCmd::MAV_CMD_ARM_AUTHORIZATION_REQUEST || !ours || !to_us {
            return false;
        }
        let refusal = match &self.phase {
            Phase::TakingControl(_) | Phase::Arming(_) => None,
            phase if !phase.is_waiting() => Some("this vehicle's mission is under way, or over".to_owned()),
            _ if self.ground.preflight_ok() => None,
            _ => Some(self.ground.obstacle().to_owned()),
        };
        let (result, param1, param2) = match &refusal {
            None => (MavResult::MAV_RESULT_ACCEPTED, 0, GOOD_FOR_S),
            Some(_) => (
                MavResult::MAV_RESULT_DENIED,
                MavArmAuthDeniedReason::MAV_ARM_AUTH_DENIED_REASON_NONE as u8,
                0,
            ),
        };
        let mut answer = acknowledgement((own_system, AUTOPILOT), command, result);
        if let MavMessage::COMMAND_ACK(ack) = &mut answer {
            // MAVLink calls it progress; of this command it is the reason.
            ack.progress = param1;
            ack.result_param2 = param2;
        }
        self.outbox.push_back(answer);
        if let Some(why) = refusal {
            self.notice(Notice::ArmingRefused(why));
        }
        true
    }
}
