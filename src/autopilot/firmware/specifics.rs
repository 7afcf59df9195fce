//! What one firmware alone needs kept and done: for PX4 the guard of its land detector and the scales of its thrust
//! axes, for ArduPilot the bridge to its 6DoF frame; each only where the actuation asks for it.

use mavlink::dialects::ardupilotmega::COMMAND_ACK_DATA;

use super::Firmware;
use super::ardupilot::bridge::Bridge;
use super::mode::Mode;
use super::px4::land_detector::{LEVEL_BELOW_RAD, LandDetectorGuard};
use super::px4::rotors::RotorScales;
use super::{ardupilot, fencing, px4, returning};
use crate::autopilot::command::{CommandQueue, Outcome, Purpose};
use crate::autopilot::context::Context;
use crate::autopilot::fence::FenceDuty;
use crate::autopilot::parameter::Parameters;
use crate::autopilot::settings::{Actuation, Settings};
use crate::autopilot::state::Version;
use crate::geo::Attitude;
use crate::preflight::Check;

/// The parts of one firmware.
#[derive(Debug, Clone)]
pub(in crate::autopilot) enum Specifics {
    Px4 { guard: LandDetectorGuard, rotors: Option<RotorScales> },
    ArduPilot { bridge: Option<Bridge> },
}

impl Specifics {
    /// The parts that `settings` ask for. Nothing is asked before [`Self::begin`].
    pub(in crate::autopilot) fn new(firmware: Firmware, settings: &Settings) -> Self {
        let actuation = settings.actuation;
        match firmware {
            Firmware::Px4 => Self::Px4 {
                guard: LandDetectorGuard::new(settings),
                rotors: matches!(actuation, Actuation::ThrustVector | Actuation::Auto)
                    .then(RotorScales::default),
            },
            Firmware::ArduPilot => {
                Self::ArduPilot { bridge: (actuation == Actuation::Pose).then(Bridge::default) }
            }
        }
    }

    /// Begins with an autopilot that has just been found or has restarted, its parameters not read yet. What is to be
    /// put back in it is remembered.
    pub(in crate::autopilot) fn begin(&mut self, context: &mut Context) {
        match self {
            Self::Px4 { rotors, .. } => {
                if context.settings.actuation == Actuation::Auto {
                    *rotors = Some(RotorScales::default());
                }
                if let Some(rotors) = rotors {
                    *rotors = RotorScales::default();
                    rotors.learn(context.parameters);
                }
            }
            Self::ArduPilot { bridge } => {
                if context.settings.actuation == Actuation::Auto {
                    *bridge = None;
                }
                if let Some(bridge) = bridge {
                    *bridge = Bridge::default();
                    bridge.probe(context.state.is_armed(), context.commands, context.now);
                }
            }
        }
    }

    /// The actuation is known: what it needs stays, or begins.
    pub(in crate::autopilot) fn choose(&mut self, context: &mut Context) {
        match self {
            Self::Px4 { guard, rotors } => {
                guard.choose(context.settings);
                if context.settings.actuation != Actuation::ThrustVector {
                    *rotors = None;
                }
            }
            Self::ArduPilot { bridge } => {
                if context.settings.actuation == Actuation::Pose {
                    let mut new = Bridge::default();
                    new.probe(context.state.is_armed(), context.commands, context.now);
                    *bridge = Some(new);
                }
            }
        }
    }

    /// Looks at the parameters after one was heard. The newtons per unit of thrust along body x, y, z, once they follow
    /// from them.
    pub(in crate::autopilot) fn parameter_heard(&mut self, parameters: &mut Parameters) -> Option<[f64; 3]> {
        match self {
            Self::Px4 { rotors: Some(rotors), .. } => rotors.learn(parameters),
            Self::Px4 { .. } | Self::ArduPilot { .. } => None,
        }
    }

    /// Does what flying by setpoints (`in_flight`) asks of the autopilot's parameters, and puts them back once that is
    /// over and the vehicle stands, or flies level in a mode that nobody's setpoints tilt; `fresh` being whether its attitude
    /// is known. Asks on the ground whether the bridge is there, and for parameters by the names that they have.
    pub(in crate::autopilot) fn advance(&mut self, in_flight: bool, fresh: bool, context: &mut Context) {
        let state = context.state;
        if state.is_disarmed() && context.settings.return_altitude_m.is_some() {
            returning::read(context.firmware, context.parameters);
        }
        let fenced = context.settings.fence.as_ref().is_some_and(|fence| fence.duty != FenceDuty::None);
        if state.is_disarmed() && fenced {
            fencing::read(context.firmware, context.parameters);
        }
        match self {
            Self::Px4 { guard, .. } => {
                let level =
                    state.attitude.is_some_and(|attitude| attitude.value.tilt_rad() < LEVEL_BELOW_RAD);
                let flown_by_itself = state.mode().is_some_and(|mode| mode != Mode::Companion);
                if let Some(version) = state.version.filter(|_| state.is_disarmed()) {
                    px4::release::read(context.parameters, version);
                }
                let safe = state.is_disarmed() || (level && fresh && flown_by_itself);
                if let Some(event) = guard.advance(in_flight, safe, context.parameters) {
                    context.out.tell(event);
                }
            }
            Self::ArduPilot { bridge } => {
                if state.is_disarmed() {
                    ardupilot::shaping::read(context.parameters);
                }
                if let Some(bridge) = bridge {
                    bridge.probe(state.is_armed(), context.commands, context.now);
                }
            }
        }
    }

    /// Whether the autopilot still has a parameter as only a companion that flies it may leave it.
    pub(in crate::autopilot) fn is_guarding(&self, parameters: &Parameters) -> bool {
        matches!(self, Self::Px4 { .. }) && LandDetectorGuard::is_off(parameters)
    }

    /// The charge, of 1, down to which a battery falls that the autopilot simulates; `None` of a real one.
    pub(in crate::autopilot) fn simulated_charge_floor(&self, parameters: &Parameters) -> Option<f64> {
        match self {
            Self::Px4 { .. } => px4::battery::floor(parameters),
            Self::ArduPilot { .. } => None,
        }
    }

    /// Whether the attitude may leave the level.
    pub(in crate::autopilot) fn allows_tilt(&self, parameters: &Parameters) -> bool {
        match self {
            Self::Px4 { guard, .. } => guard.allows_tilt(parameters),
            Self::ArduPilot { bridge } => !bridge.as_ref().is_some_and(Bridge::is_dead),
        }
    }

    /// The attitude that a setpoint commands has gone out as far as messages for setpoints carry it.
    pub(in crate::autopilot) fn drive(
        &mut self,
        attitude: Attitude,
        in_control: bool,
        context: &mut Context,
    ) {
        if let Some(bridge) = self.bridge() {
            bridge.drive(attitude, in_control, context);
        }
    }

    /// The autopilot is to fly by itself: whatever tilts it beside its setpoints ends first.
    pub(in crate::autopilot) fn level(&mut self, commands: &mut CommandQueue) {
        if let Some(bridge) = self.bridge() {
            bridge.level(commands);
        }
    }

    /// Nobody here flies the vehicle.
    pub(in crate::autopilot) fn released(&mut self, commands: &mut CommandQueue) {
        if let Some(bridge) = self.bridge() {
            bridge.forget(commands);
        }
    }

    /// Takes the end of a command with one of the bridge's purposes.
    pub(in crate::autopilot) fn answered(
        &mut self,
        purpose: Purpose,
        outcome: Outcome,
        context: &mut Context,
    ) {
        let Some(bridge) = self.bridge() else { return };
        match purpose {
            Purpose::Bridge => bridge.probe_answered(outcome, context.now),
            Purpose::Offsets => bridge.switch_answered(outcome, context),
            _ => {}
        }
    }

    /// Takes an acknowledgement that ended no command of the queue.
    pub(in crate::autopilot) fn acknowledged(&mut self, ack: &COMMAND_ACK_DATA, context: &mut Context) {
        if let Some(bridge) = self.bridge() {
            bridge.offset_answered(ack, context);
        }
    }

    /// The checks before a flight that concern this firmware alone.
    pub(in crate::autopilot) fn checks(
        &self,
        parameters: &Parameters,
        settings: &Settings,
        version: Option<Version>,
    ) -> Vec<Check> {
        match self {
            Self::Px4 { guard, rotors } => {
                let rotors_n = rotors.as_ref().and_then(RotorScales::thrust_n);
                let mut all = px4::preflight::checks(parameters, settings, guard.is_ours(), rotors_n);
                all.extend(px4::battery::checked(parameters));
                all.extend(version.into_iter().flat_map(|v| px4::release::checks(parameters, settings, v)));
                all
            }
            Self::ArduPilot { bridge } => ardupilot::preflight::checks(parameters, settings, bridge.as_ref()),
        }
    }

    fn bridge(&mut self) -> Option<&mut Bridge> {
        match self {
            Self::ArduPilot { bridge } => bridge.as_mut(),
            Self::Px4 { .. } => None,
        }
    }
}
