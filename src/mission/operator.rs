//! Commands from outside: any MAVLink ground station addresses them to our component (PROTOCOL section 5). Each is
//! acknowledged truthfully and repeated to the peer.

use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::{COMMAND_ACK_DATA, MavCmd, MavMessage, MavResult};

use crate::pair::wire::{VeilwingOrder, VeilwingSilence};
use crate::time::Instant;

use super::cause::Cause;
use super::executive::Executive;
use super::notice::Notice;

impl Executive {
    /// Takes a command that is addressed to us.
    pub(super) fn handle_operator(&mut self, header: MavHeader, message: &MavMessage, now: Instant) {
        if self.refuses_stranger(header, message) {
            return;
        }
        let (system, component, command, param1) = match message {
            MavMessage::COMMAND_LONG(c) => (c.target_system, c.target_component, c.command, c.param1),
            MavMessage::COMMAND_INT(c) => (c.target_system, c.target_component, c.command, c.param1),
            _ => return,
        };
        if (system, component) != self.settings.own {
            return;
        }
        let order = match command {
            MavCmd::MAV_CMD_MISSION_START => Some(VeilwingOrder::VEILWING_ORDER_START),
            MavCmd::MAV_CMD_DO_PAUSE_CONTINUE if param1 == 0.0 => Some(VeilwingOrder::VEILWING_ORDER_PAUSE),
            MavCmd::MAV_CMD_DO_PAUSE_CONTINUE if param1 == 1.0 => {
                Some(VeilwingOrder::VEILWING_ORDER_CONTINUE)
            }
            MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH => Some(VeilwingOrder::VEILWING_ORDER_RETURN),
            MavCmd::MAV_CMD_USER_2 => Some(VeilwingOrder::VEILWING_ORDER_RADIO_KILL),
            _ => None,
        };
        let mut information = None;
        let result = match order {
            Some(order) if self.can_obey(order) => {
                self.service.relay(order, now);
                self.obey(order, now);
                MavResult::MAV_RESULT_ACCEPTED
            }
            Some(_) => MavResult::MAV_RESULT_DENIED,
            None => {
                let asks = command == MavCmd::MAV_CMD_REQUEST_MESSAGE;
                information = asks.then(|| self.information(param1, now)).flatten();
                match information {
                    Some(_) => MavResult::MAV_RESULT_ACCEPTED,
                    None => MavResult::MAV_RESULT_UNSUPPORTED,
                }
            }
        };
        let target_system = u8::try_from(header.system_id).unwrap_or_default();
        self.outbox.push_back(MavMessage::COMMAND_ACK(COMMAND_ACK_DATA {
            command,
            result,
            target_system,
            target_component: header.component_id,
            ..COMMAND_ACK_DATA::default()
        }));
        self.outbox.extend(information);
    }

    fn can_obey(&self, order: VeilwingOrder) -> bool {
        match order {
            // An order that is older than the vehicle's last time on the ground is none (F4).
            VeilwingOrder::VEILWING_ORDER_START => {
                self.phase.is_waiting() && !self.autopilot.state().is_armed()
            }
            VeilwingOrder::VEILWING_ORDER_RETURN => self.phase.is_outward(),
            VeilwingOrder::VEILWING_ORDER_RADIO_KILL => true,
            VeilwingOrder::VEILWING_ORDER_PAUSE => self.phase.is_in_service(),
            VeilwingOrder::VEILWING_ORDER_CONTINUE => self.phase.is_in_service() && self.service.is_paused(),
        }
    }

    /// Does what the operator wants, whichever side was told.
    pub(super) fn obey(&mut self, order: VeilwingOrder, now: Instant) {
        if !self.can_obey(order) {
            return;
        }
        match order {
            VeilwingOrder::VEILWING_ORDER_START => self.ground.start.ask(),
            VeilwingOrder::VEILWING_ORDER_RETURN => {
                self.service.tell_silence(VeilwingSilence::VEILWING_SILENCE_OPERATOR, now);
                self.abort(Cause::ReturnOrdered, now);
            }
            VeilwingOrder::VEILWING_ORDER_RADIO_KILL => {
                self.service.kill(now);
                self.notice(Notice::Killed);
                if self.phase.is_in_service() {
                    self.abort(Cause::Killed, now);
                }
            }
            VeilwingOrder::VEILWING_ORDER_PAUSE => {
                if self.service.pause(now) {
                    self.notice(Notice::Paused);
                }
            }
            VeilwingOrder::VEILWING_ORDER_CONTINUE => {
                if self.service.go_on() {
                    self.notice(Notice::GoingOn);
                }
            }
        }
    }
}
