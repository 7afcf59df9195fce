//! The stream of setpoints in flight: whether one may go out, what it is built on, and PX4's land detector.

use super::Address;
use super::adapter::Autopilot;
use super::control::Phase;
use super::firmware::{Firmware, rotors};
use super::guard::{self, LandDetectorGuard};
use super::position_control::Measured;
use super::setpoint::Surroundings;
use super::settings::{Actuation, Setpoint};
use crate::time::Instant;

impl Autopilot {
    /// PX4's thrust axes have scales of their own: reads the rotors for them where they matter.
    pub(super) fn learn_rotors(&mut self) {
        let px4 = self.peer.is_some_and(|(firmware, _)| firmware == Firmware::Px4);
        if !px4 || self.settings.actuation != Actuation::ThrustVector || self.rotor_scales.is_some() {
            return;
        }
        self.parameters.read_also(rotors::names(&self.parameters));
        self.rotor_scales = rotors::thrust_scales(&self.parameters);
        if let Some(scales) = self.rotor_scales {
            self.stream.learn_scales(scales);
        }
    }

    pub(super) fn guard_land_detector(&mut self, now: Instant) {
        if !self.guarded() {
            return;
        }
        let state = &self.telemetry.state;
        let level = state.attitude.is_some_and(|attitude| attitude.value.tilt_rad() < guard::LEVEL_BELOW_RAD);
        let safe = !state.is_armed() || (level && self.fresh(now));
        let in_flight = self.in_control() && self.control.climb.is_none() && self.is_flying();
        self.guard.advance(in_flight, safe, &mut self.parameters);
    }

    /// Whether the land detector must be kept from disarming a tilted vehicle.
    pub(super) fn guarded(&self) -> bool {
        self.peer.is_some_and(|(firmware, _)| firmware == Firmware::Px4)
            && self.settings.actuation != Actuation::Position
            && self.settings.planned_tilt_rad > guard::NEEDED_ABOVE_RAD
    }

    /// A vehicle that has flown is taken to fly until it disarms: idle thrust in mid-air, because a land detector took
    /// a tilted hover for the ground, would make it fall.
    fn is_flying(&self) -> bool {
        self.flown || self.telemetry.state.is_airborne() == Some(true)
    }

    /// Sends the setpoint if the phase allows it.
    pub(super) fn stream(&mut self, setpoint: &Setpoint, firmware: Firmware, target: Address, now: Instant) {
        let allowed = match self.control.phase {
            Phase::Taking { .. } => firmware.wants_stream_first(),
            Phase::Held => firmware == Firmware::Px4 || (self.control.climb.is_none() && self.is_flying()),
            Phase::HandingOver { acknowledged, .. } => !acknowledged && self.is_flying(),
            Phase::Released | Phase::HandedOver { .. } => false,
        };
        self.note_lift_off();
        let around = allowed.then(|| self.surroundings(firmware, target, now)).flatten();
        let commanded = self.stream.set(setpoint, around.as_ref(), now, &mut self.out);
        if let Some(commanded) = commanded.filter(|_| self.is_bridged()) {
            self.drive_offsets(commanded, target, now);
        }
    }

    /// Ends the search for the thrust that lifts.
    fn note_lift_off(&mut self) {
        if let (Some(climb), Some((position_enu_m, velocity_enu_m_s))) =
            (&mut self.control.climb, self.telemetry.motion())
        {
            climb.lifting &= !climb.has_left(position_enu_m, velocity_enu_m_s.z);
        }
    }

    /// `None` while position or attitude are not fresh: a setpoint would be a guess.
    fn surroundings(&self, firmware: Firmware, target: Address, now: Instant) -> Option<Surroundings> {
        let (position_enu_m, velocity_enu_m_s) = self.telemetry.motion().filter(|_| self.fresh(now))?;
        let attitude = self.telemetry.state.attitude?.value;
        Some(Surroundings {
            firmware,
            target,
            frame: self.telemetry.frame()?,
            measured: Measured { position_enu_m, velocity_enu_m_s, attitude },
            idle: self.control.climb.is_none() && !self.is_flying(),
            flying: self.is_flying() || self.control.climb.is_some_and(|climb| !climb.lifting),
            lifting: self.control.climb.is_some_and(|climb| climb.lifting),
            may_tilt: !self.guarded() || LandDetectorGuard::allows_tilt(&self.parameters),
        })
    }
}
