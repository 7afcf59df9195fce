//! Who is told what happens in a flight.

use std::time::Duration;

use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::MavMessage;
use veilwing_sitl::World;

use crate::mission::{Notice, Outgoing};
use crate::role::Role;
use crate::service::Standing;

/// The links of a companion.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wire {
    /// To its autopilot.
    Autopilot,
    /// To its radio, where that has a link of its own.
    Radio,
    /// To the other companion.
    Pair,
}

/// Is told what happens, in simulation time. The unit type is one that does not care.
pub trait Observer {
    /// A companion said something, in this phase; without a phase, the writer of its log did.
    fn said(&mut self, _at: Duration, _role: Role, _phase: Option<&'static str>, _notice: &Notice) {}
    /// A companion has come into this phase, and its service to this.
    fn stands(&mut self, _at: Duration, _role: Role, _phase: &'static str, _standing: Standing) {}
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

/// Two who are both told.
impl<A: Observer, B: Observer> Observer for (&mut A, &mut B) {
    fn said(&mut self, at: Duration, role: Role, phase: Option<&'static str>, notice: &Notice) {
        self.0.said(at, role, phase, notice);
        self.1.said(at, role, phase, notice);
    }

    fn stands(&mut self, at: Duration, role: Role, phase: &'static str, standing: Standing) {
        self.0.stands(at, role, phase, standing);
        self.1.stands(at, role, phase, standing);
    }

    fn sent(&mut self, at: Duration, role: Role, message: &Outgoing) {
        self.0.sent(at, role, message);
        self.1.sent(at, role, message);
    }

    fn received(&mut self, at: Duration, role: Role, header: MavHeader, message: &MavMessage) {
        self.0.received(at, role, header, message);
        self.1.received(at, role, header, message);
    }

    fn frame(&mut self, at: Duration, role: Role, wire: Wire, bytes: &[u8]) {
        self.0.frame(at, role, wire, bytes);
        self.1.frame(at, role, wire, bytes);
    }

    fn saw(&mut self, world: &World) {
        self.0.saw(world);
        self.1.saw(world);
    }

    fn on_air(&mut self, at: Duration, on: [bool; 2]) {
        self.0.on_air(at, on);
        self.1.on_air(at, on);
    }
}
