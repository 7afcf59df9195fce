//! Commands from outside: any MAVLink ground station addresses them to our component (PROTOCOL section 5). Each is
//! acknowledged truthfully and repeated to the peer.

use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::{COMMAND_ACK_DATA, MavCmd, MavMessage, MavResult, MavSeverity};

use crate::pair::wire::{VeilwingFlags, VeilwingOrder, VeilwingSilence};
use crate::time::Instant;

use super::executive::Executive;
use super::flight::Phase;

impl Executive {
    /// Takes a command that is addressed to us.
    pub(super) fn handle_operator(&mut self, header: MavHeader, message: &MavMessage, now: Instant) {
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
                self.pair.order(order, now);
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
            VeilwingOrder::VEILWING_ORDER_START => matches!(self.phase, Phase::Connecting | Phase::Standby),
            VeilwingOrder::VEILWING_ORDER_RETURN => self.phase.is_flying() || self.phase == Phase::Climbing,
            VeilwingOrder::VEILWING_ORDER_RADIO_KILL => true,
            VeilwingOrder::VEILWING_ORDER_PAUSE => self.phase.is_flying(),
            VeilwingOrder::VEILWING_ORDER_CONTINUE => {
                let peer_paused = self.pair.peer().says(VeilwingFlags::VEILWING_FLAGS_PAUSED);
                self.phase.is_flying() && (self.paused || peer_paused)
            }
        }
    }

    /// Does what the operator wants, whichever side was told.
    pub(super) fn obey(&mut self, order: VeilwingOrder, now: Instant) {
        if !self.can_obey(order) {
            return;
        }
        match order {
            VeilwingOrder::VEILWING_ORDER_START => self.start.ask(),
            VeilwingOrder::VEILWING_ORDER_RETURN => {
                self.pair.silent(VeilwingSilence::VEILWING_SILENCE_OPERATOR, now);
                self.abort("the operator ordered the return".into(), now);
            }
            VeilwingOrder::VEILWING_ORDER_RADIO_KILL => {
                self.interlock.kill(now);
                self.pair.silent(VeilwingSilence::VEILWING_SILENCE_OPERATOR, now);
                let text = "radio kill: silent until the companion restarts".to_owned();
                self.notice(MavSeverity::MAV_SEVERITY_CRITICAL, text);
                if self.phase.is_flying() {
                    self.abort("radio kill by the operator".into(), now);
                }
            }
            VeilwingOrder::VEILWING_ORDER_PAUSE => self.pause(now),
            VeilwingOrder::VEILWING_ORDER_CONTINUE => {
                if std::mem::take(&mut self.paused) {
                    self.notice(MavSeverity::MAV_SEVERITY_NOTICE, "going on by the operator's order".into());
                }
            }
        }
    }

    /// A slot under way is ended in order (I silent at once, J once I is), its transit flown to the end so that the
    /// next one begins where the table says. No other is agreed on before the operator lets the pair go on.
    fn pause(&mut self, now: Instant) {
        if std::mem::replace(&mut self.paused, true) {
            return;
        }
        match self.slot.as_mut() {
            Some(slot) => slot.course.closing = true,
            None => self.pair.release(now),
        }
        self.notice(MavSeverity::MAV_SEVERITY_NOTICE, "paused by the operator: silent, holding".into());
    }
}
