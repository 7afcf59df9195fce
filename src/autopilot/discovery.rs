//! Which of the components on the link is our autopilot, from heartbeats alone.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::{HEARTBEAT_DATA, MavAutopilot, MavType};

use super::event::Event;
use super::firmware::Firmware;
use super::outbox::{Address, Outbox};
use super::settings::FirmwareChoice;
use crate::time::Instant;

/// Without a configured system id, how long to listen for a second autopilot before the first is taken.
const WINDOW: Duration = Duration::from_millis(1500);

#[derive(Debug, Clone, Copy)]
struct Candidate {
    address: Address,
    firmware: Firmware,
    heard_at: Instant,
}

/// The search for the autopilot.
#[derive(Debug, Clone)]
pub(super) struct Discovery {
    wanted: Option<u8>,
    choice: FirmwareChoice,
    using: Option<Address>,
    candidates: Vec<Candidate>,
    told: Vec<u8>,
}

impl Discovery {
    pub(super) fn new(wanted: Option<u8>, choice: FirmwareChoice) -> Self {
        Self { wanted, choice, using: None, candidates: Vec::new(), told: Vec::new() }
    }

    /// Considers the sender of a heartbeat. Says which autopilot is taken, once.
    pub(super) fn handle_heartbeat(
        &mut self,
        address: Address,
        heartbeat: &HEARTBEAT_DATA,
        now: Instant,
        out: &mut Outbox,
    ) -> Option<(Address, Firmware)> {
        if !is_autopilot(heartbeat) || self.using == Some(address) {
            return None;
        }
        if self.using.is_some() || self.wanted.is_some_and(|wanted| wanted != address.0) {
            self.tell_once(
                address.0,
                out,
                Event::AnotherAutopilot { system: address.0, using: self.using.map(|a| a.0) },
            );
            return None;
        }
        let Some(firmware) = Firmware::of(heartbeat).filter(|firmware| firmware.is(self.choice)) else {
            self.tell_once(address.0, out, Event::WrongFirmware { system: address.0 });
            return None;
        };
        if self.wanted.is_some() {
            self.using = Some(address);
            return Some((address, firmware));
        }
        if !self.candidates.iter().any(|candidate| candidate.address == address) {
            self.candidates.push(Candidate { address, firmware, heard_at: now });
        }
        if self.candidates.len() > 1 {
            let systems: Vec<u8> = self.candidates.iter().map(|candidate| candidate.address.0).collect();
            for system in systems {
                self.tell_once(system, out, Event::AnotherAutopilot { system, using: None });
            }
        }
        None
    }

    /// Takes the only candidate once the others have had the time to speak.
    pub(super) fn advance(&mut self, now: Instant) -> Option<(Address, Firmware)> {
        match (self.using, self.candidates.as_slice()) {
            (None, [only]) if now >= only.heard_at + WINDOW => {
                self.using = Some(only.address);
                Some((only.address, only.firmware))
            }
            _ => None,
        }
    }

    pub(super) fn timeout(&self) -> Option<Instant> {
        match (self.using, self.candidates.as_slice()) {
            (None, [only]) => Some(only.heard_at + WINDOW),
            _ => None,
        }
    }

    /// How many autopilots compete for being ours.
    pub(super) fn candidates(&self) -> usize {
        self.candidates.len()
    }

    fn tell_once(&mut self, system: u8, out: &mut Outbox, event: Event) {
        if !self.told.contains(&system) {
            self.told.push(system);
            out.tell(event);
        }
    }
}

/// Ground stations, companions, radios and the like say MAV_AUTOPILOT_INVALID, or give their kind away.
fn is_autopilot(heartbeat: &HEARTBEAT_DATA) -> bool {
    heartbeat.autopilot != MavAutopilot::MAV_AUTOPILOT_INVALID
        && !matches!(
            heartbeat.mavtype,
            MavType::MAV_TYPE_GCS
                | MavType::MAV_TYPE_ONBOARD_CONTROLLER
                | MavType::MAV_TYPE_GIMBAL
                | MavType::MAV_TYPE_ADSB
                | MavType::MAV_TYPE_CAMERA
                | MavType::MAV_TYPE_CHARGING_STATION
                | MavType::MAV_TYPE_FLARM
                | MavType::MAV_TYPE_SERVO
                | MavType::MAV_TYPE_ODID
                | MavType::MAV_TYPE_BATTERY
                | MavType::MAV_TYPE_PARACHUTE
                | MavType::MAV_TYPE_LOG
                | MavType::MAV_TYPE_OSD
                | MavType::MAV_TYPE_IMU
                | MavType::MAV_TYPE_GPS
                | MavType::MAV_TYPE_WINCH
                | MavType::MAV_TYPE_ILLUMINATOR
                | MavType::MAV_TYPE_GRIPPER
                | MavType::MAV_TYPE_RADIO
        )
}
