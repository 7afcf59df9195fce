//! The autopilot's side of the parameter protocol.

use mavlink::dialects::ardupilotmega::{MavMessage, MavSeverity, PARAM_REQUEST_READ_DATA, PARAM_SET_DATA};

use super::super::parameters::SetOutcome;
use super::super::router::{Router, Sender, To};
use super::{Autopilot, COMPONENT};

impl Autopilot {
    pub(super) fn read_parameter(&self, from: Sender, m: &PARAM_REQUEST_READ_DATA, router: &mut Router) {
        let index = usize::try_from(m.param_index)
            .ok()
            .or_else(|| m.param_id.to_str().ok().and_then(|name| self.parameters.index_of(name)));
        match index.and_then(|k| self.parameters.message(k)) {
            Some(value) => router.send(To::Link(from.link), COMPONENT, &MavMessage::PARAM_VALUE(value)),
            None => self.unknown_parameter(router),
        }
    }

    pub(super) fn set_parameter(&mut self, m: &PARAM_SET_DATA, router: &mut Router) {
        let (SetOutcome::Stored(index) | SetOutcome::Refused(index)) = self.parameters.handle_set(m) else {
            return self.unknown_parameter(router);
        };
        if let Some(value) = self.parameters.message(index) {
            router.send(To::All, COMPONENT, &MavMessage::PARAM_VALUE(value));
        }
    }

    /// An unknown parameter gets silence, from both firmwares.
    fn unknown_parameter(&self, router: &mut Router) {
        if !self.traps.silent_unknown_parameter {
            self.text(MavSeverity::MAV_SEVERITY_WARNING, "Unknown parameter", router);
        }
    }
}
