//! Commands from those who are no operators: refused, told once, counted.

use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::{MavMessage, MavResult};

use crate::reply::acknowledgement;

use super::executive::Executive;
use super::notice::Notice;

impl Executive {
    /// Whether the message is a command of a system that is no operator, and so is none to us. One that is addressed to
    /// us and nobody else is answered; one that is addressed to all may be meant for another.
    pub(super) fn refuses_stranger(&mut self, header: MavHeader, message: &MavMessage) -> bool {
        let (system, component, command) = match message {
            MavMessage::COMMAND_LONG(c) => (c.target_system, c.target_component, c.command),
            MavMessage::COMMAND_INT(c) => (c.target_system, c.target_component, c.command),
            _ => return false,
        };
        if self.settings.operators.include(header.system_id) {
            return false;
        }
        if (system, component) == self.settings.own {
            self.count_stranger(header);
            let by = (u8::try_from(header.system_id).unwrap_or_default(), header.component_id);
            self.outbox.push_back(acknowledgement(by, command, MavResult::MAV_RESULT_DENIED));
        }
        true
    }

    /// Counts what a system that is no operator asked for, and tells of it the first time.
    pub(super) fn count_stranger(&mut self, header: MavHeader) {
        // A system id of MAVLink 2's wider form is nobody's here: all of them count as one, so that this stays small.
        let system = u8::try_from(header.system_id).unwrap_or_default();
        let count = self.strangers.entry(system).or_insert(0_u64);
        *count += 1;
        if *count == 1 {
            self.notice(Notice::NoOperator(system));
        }
    }

    /// How many commands each system that is no operator was refused.
    #[must_use]
    pub fn refused_commands(&self) -> &std::collections::BTreeMap<u8, u64> {
        &self.strangers
    }
}
