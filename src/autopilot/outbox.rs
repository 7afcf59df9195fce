//! What the parts of the adapter have to say, in order.

use std::collections::VecDeque;

use mavlink::dialects::ardupilotmega::MavMessage;

use super::event::Event;

/// The MAVLink address of a component: (system, component).
pub(super) type Address = (u8, u8);

/// Messages for the wire and events for the executive.
#[derive(Debug, Clone, Default)]
pub(super) struct Outbox {
    messages: VecDeque<MavMessage>,
    events: VecDeque<Event>,
}

impl Outbox {
    pub(super) fn send(&mut self, message: MavMessage) {
        self.messages.push_back(message);
    }

    pub(super) fn tell(&mut self, event: Event) {
        self.events.push_back(event);
    }

    pub(super) fn next_message(&mut self) -> Option<MavMessage> {
        self.messages.pop_front()
    }

    pub(super) fn next_event(&mut self) -> Option<Event> {
        self.events.pop_front()
    }
}
