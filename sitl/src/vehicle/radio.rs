//! The radio component's side of MAVLink: the leased power command and the transmitter's parameters.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::*;

use super::parameters::SetOutcome;
use super::router::{Sender, To};
use super::{Vehicle, transmitter};

impl Vehicle {
    /// The radio component's side of a message.
    pub(super) fn radio(&mut self, from: Sender, message: MavMessage, now: Duration) {
        let component = transmitter::COMPONENT;
        let link = To::Link(from.link);
        let ack = |command, result, result_param2| {
            MavMessage::COMMAND_ACK(COMMAND_ACK_DATA {
                command,
                result,
                progress: 0,
                result_param2,
                target_system: from.system_id,
                target_component: from.component_id,
            })
        };
        match message {
            MavMessage::COMMAND_INT(c) if c.target_component == component => {
                let reply = if c.command == transmitter::POWER_COMMAND {
                    let (result, achieved_mdbm) = self.transmitter.command(&c, now);
                    ack(c.command, result, achieved_mdbm)
                } else {
                    ack(c.command, MavResult::MAV_RESULT_UNSUPPORTED, 0)
                };
                self.router.send(link, component, &reply);
            }
            MavMessage::COMMAND_LONG(c) if c.target_component == component => {
                // The slot and the expiry are integers; a float cannot carry them safely.
                let result = if c.command == transmitter::POWER_COMMAND {
                    MavResult::MAV_RESULT_COMMAND_INT_ONLY
                } else {
                    MavResult::MAV_RESULT_UNSUPPORTED
                };
                self.router.send(link, component, &ack(c.command, result, 0));
            }
            MavMessage::PARAM_REQUEST_LIST(_) => {
                for index in 0..self.transmitter.parameters.len() {
                    self.radio_parameter(link, Some(index));
                }
            }
            MavMessage::PARAM_REQUEST_READ(m) if m.target_component == component => {
                let by_name = || self.transmitter.parameters.index_of(m.param_id.to_str().ok()?);
                self.radio_parameter(link, usize::try_from(m.param_index).ok().or_else(by_name));
            }
            MavMessage::PARAM_SET(m) if m.target_component == component => {
                match self.transmitter.parameters.handle_set(&m) {
                    SetOutcome::Stored(index) | SetOutcome::Refused(index) => {
                        self.radio_parameter(To::All, Some(index));
                    }
                    SetOutcome::Unknown => {}
                }
            }
            _ => {}
        }
    }

    fn radio_parameter(&mut self, to: To, index: Option<usize>) {
        if let Some(value) = index.and_then(|k| self.transmitter.parameters.message(k)) {
            self.router.send(to, transmitter::COMPONENT, &MavMessage::PARAM_VALUE(value));
        }
    }
}
