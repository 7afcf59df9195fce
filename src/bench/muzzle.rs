//! What the bench may say, and nothing else: whatever the parts that it is made of would like to send.

use mavlink::dialects::ardupilotmega::{MavCmd, MavMessage};

use crate::pair::wire;

/// Whether a message may go to an autopilot or a radio on the bench. Questions, the requests for telemetry that are asked of
/// every autopilot, answers to be found by, and one command of power: off. No arming, no mode, no setpoint, no parameter set, no
/// mission or fence written, no power above off.
#[must_use]
pub fn may_be_said(message: &MavMessage, power_command: Option<u16>) -> bool {
    match message {
        MavMessage::HEARTBEAT(_)
        | MavMessage::TIMESYNC(_)
        | MavMessage::PARAM_REQUEST_READ(_)
        | MavMessage::PARAM_EXT_REQUEST_READ(_)
        | MavMessage::MISSION_REQUEST_LIST(_)
        | MavMessage::MISSION_REQUEST_INT(_)
        | MavMessage::MISSION_ACK(_) => true,
        MavMessage::COMMAND_LONG(asked) => match asked.command {
            MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL | MavCmd::MAV_CMD_REQUEST_MESSAGE => true,
            // Whether ArduPilot's bridge script is there: no offset, to a script that follows none.
            MavCmd::MAV_CMD_USER_4 => [
                asked.param1,
                asked.param2,
                asked.param3,
                asked.param4,
                asked.param5,
                asked.param6,
                asked.param7,
            ]
            .iter()
            .all(|value| *value == 0.0),
            _ => false,
        },
        MavMessage::COMMAND_INT(command) => {
            power_command == Some(command.command as u16) && command.param1 == f32::NEG_INFINITY
        }
        _ => false,
    }
}

/// Whether a message may go to the other vehicle: the time, asked and told. Nothing is agreed on by it.
#[must_use]
pub fn may_be_said_to_the_peer(message: &wire::MavMessage) -> bool {
    matches!(message, wire::MavMessage::VEILWING_CLOCK(_))
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavlink::Message;
    use mavlink::dialects::ardupilotmega::{COMMAND_INT_DATA, COMMAND_LONG_DATA};

    #[test]
    fn spec_of_all_messages_the_few_that_change_nothing_may_be_said() {
        let (mut known, mut said) = (0, Vec::new());
        for id in 0..=60_000 {
            let Some(message) = MavMessage::default_message_from_id(id) else { continue };
            known += 1;
            if may_be_said(&message, Some(31_010)) {
                said.push(message.message_name());
            }
        }
        assert!(known > 250, "{known}");
        assert_eq!(
            said,
            [
                "HEARTBEAT",
                "PARAM_REQUEST_READ",
                "MISSION_REQUEST_LIST",
                "MISSION_ACK",
                "MISSION_REQUEST_INT",
                "TIMESYNC",
                "PARAM_EXT_REQUEST_READ"
            ]
        );
    }

    #[test]
    fn spec_of_all_commands_power_off_and_questions_may_be_given() {
        use num_traits::FromPrimitive;
        let mut long = Vec::new();
        for command in (0..=u16::MAX).filter_map(MavCmd::from_u16) {
            let asked = COMMAND_LONG_DATA { command, param1: 1.0, ..Default::default() };
            if may_be_said(&MavMessage::COMMAND_LONG(asked), Some(31_010)) {
                long.push(command);
            }
            for param1 in [f32::NEG_INFINITY, f32::NAN, -200.0, 0.0, 27.0, f32::INFINITY] {
                let given =
                    MavMessage::COMMAND_INT(COMMAND_INT_DATA { command, param1, ..Default::default() });
                let off = command == MavCmd::MAV_CMD_USER_1 && param1 == f32::NEG_INFINITY;
                assert_eq!(may_be_said(&given, Some(31_010)), off, "{command:?} {param1}");
                assert!(!may_be_said(&given, None), "{command:?} {param1}");
            }
        }
        assert_eq!(long, [MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL, MavCmd::MAV_CMD_REQUEST_MESSAGE]);
        for (param1, may) in [(0.0, true), (0.1, false), (f32::NAN, false)] {
            let asked = COMMAND_LONG_DATA { command: MavCmd::MAV_CMD_USER_4, param1, ..Default::default() };
            assert_eq!(may_be_said(&MavMessage::COMMAND_LONG(asked), None), may, "{param1}");
        }
    }
}
