//! Who is told what happens in a flight.

use std::time::Duration;

use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::MavMessage;
use veilwing_sitl::World;

use crate::mission::{Notice, Outgoing};
use crate::role::Role;

/// The links of a companion.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wire {
    /// To its autopilot.
    Autopilot,
    /// To the other companion.
    Pair,
}

/// Is told what happens, in simulation time. The unit type is one that does not care.
pub trait Observer {
    /// A companion said something, in this phase; without a phase, the writer of its log did.
    fn said(&mut self, _at: Duration, _role: Role, _phase: Option<&'static str>, _notice: &Notice) {}
    /// A message left a companion.
    fn sent(&mut self, _at: Duration, _role: Role, _message: &Outgoing) {}
    /// A message of the autopilot link reached a companion.
    fn received(&mut self, _at: Duration, _role: Role, _header: MavHeader, _message: &MavMessage) {}
    /// A frame left or reached a companion, and its log took it.
    fn frame(&mut self, _at: Duration, _role: Role, _wire: Wire, _bytes: &[u8]) {}
    /// The world after an event.
    fn saw(&mut self, _world: &World) {}
    /// What is on the air has changed: I and J.
    fn on_air(&mut self, _at: Duration, _on: [bool; 2]) {}
}

impl Observer for () {}
