//! MAVLink to and from the vehicle's autopilot, as a state machine without I/O.
//!
//! [`Autopilot`] finds the autopilot on the link, asks for the telemetry it needs and checks that it comes, takes
//! the autopilot's companion mode (PX4 OFFBOARD, ArduCopter GUIDED) on the executive's request, streams the
//! executive's setpoints while they are fresh, and hands the vehicle back. Whatever PX4 and ArduCopter do
//! differently is in [`firmware`].
//!
//! The owner feeds it with [`Autopilot::handle_message`] and [`Autopilot::handle_timeout`], then drains
//! [`Autopilot::poll_transmit`] and [`Autopilot::poll_event`] until both are empty.
//!
//! Two rules shape it. *The pilot wins* (F2): a heartbeat that shows another mode than the companion's ends the
//! stream at once, cancels what is still unanswered, and nothing is taken up again unasked. *Setpoints never outlive
//! the mind behind them* (F3): a setpoint is streamed for its lifetime only.

mod adapter;
mod bridge;
mod clock;
mod command;
mod control;
mod discovery;
pub mod firmware;
mod flight;
mod goal;
mod guard;
mod link;
mod parameter;
pub mod position_control;
mod preflight;
mod setpoint;
mod settings;
pub mod state;
pub(crate) mod statustext;
mod streams;
mod telemetry;

#[cfg(test)]
mod tests;

pub use crate::preflight::{Check, Verdict};
pub use adapter::{Autopilot, heartbeat};
pub use firmware::{Firmware, Mode};
pub use parameter::ParamValue;
pub use settings::{Actuation, EstimatorFault, Event, FirmwareChoice, Setpoint, Settings};
pub use state::{Battery, Landed, Timed, VehicleState};

use mavlink::dialects::ardupilotmega::MavMessage;
use std::collections::VecDeque;

/// What the parts of the adapter have to say, in order: messages for the wire and events for the executive.
#[derive(Debug, Default)]
struct Outbox {
    messages: VecDeque<MavMessage>,
    events: VecDeque<Event>,
}

impl Outbox {
    fn send(&mut self, message: MavMessage) {
        self.messages.push_back(message);
    }

    fn tell(&mut self, event: Event) {
        self.events.push_back(event);
    }
}

/// The MAVLink address of a component: (system, component).
type Address = (u8, u8);
