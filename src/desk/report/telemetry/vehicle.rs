//! One vehicle's state from the messages of its autopilot link, both directions.

use std::collections::VecDeque;

use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::{
    COMMAND_ACK_DATA, COMMAND_INT_DATA, HEARTBEAT_DATA, MavCmd, MavLandedState, MavMessage, MavModeFlag,
    MavResult,
};

use crate::autopilot::Firmware;
use crate::autopilot::statustext::Assembly;
use crate::desk::report::timeline::{Severity, VehicleState};
use crate::geo::{Attitude, Enu, Geodetic, LocalFrame, Ned};
use crate::transmitter::wire::VEILWING_RADIO_DATA;
use crate::units::{Dbm, Watts};

/// What a transmitter's acknowledgement reports as achieved when it is off.
const OFF: i32 = i32::MIN;

/// A command that is not answered within this time will not be.
const ANSWER_US: u64 = 500_000;

/// So many numbered commands are remembered: more than are under way to a radio at any time.
const REMEMBERED: usize = 64;

/// A radio's clock that is further off than this was set anew, or has wrapped.
const SAME_CLOCK_US: i64 = 1_000_000;

/// A power command of the first form that is not answered yet.
#[derive(Debug, Clone, Copy)]
struct Asked {
    at_us: u64,
    slot: Option<u16>,
    /// `None`: off.
    until_us: Option<u64>,
}

/// An acknowledged power.
#[derive(Debug, Clone, Copy, PartialEq)]
struct On {
    power_w: f64,
    slot: Option<u16>,
    until_us: u64,
}

/// Follows one vehicle.
#[derive(Debug)]
pub(super) struct Tracker {
    mission: Option<Geodetic>,
    firmware: Option<Firmware>,
    autopilot: Option<(u32, u8)>,
    local_origin: Option<Geodetic>,
    position: Option<Enu>,
    attitude: Option<Attitude>,
    mode: String,
    armed: bool,
    landed: Option<bool>,
    battery: Option<f64>,
    asked: VecDeque<Asked>,
    /// Of the second form: number and slot of the last commands.
    numbered: VecDeque<(u32, Option<u16>)>,
    /// The radio's clock at 0, as this log's time has it.
    radio_clock_us: Option<i64>,
    on: Option<On>,
    /// Of the companion and of the autopilot.
    texts: [Assembly; 2],
    changed: bool,
}

impl Tracker {
    /// Nothing heard yet; `mission` is the origin of the mission's frame, if it is known.
    pub fn new(mission: Option<Geodetic>) -> Self {
        Self {
            mission,
            firmware: None,
            autopilot: None,
            local_origin: None,
            position: None,
            attitude: None,
            mode: String::new(),
            armed: false,
            landed: None,
            battery: None,
            asked: VecDeque::new(),
            numbered: VecDeque::new(),
            radio_clock_us: None,
            on: None,
            texts: Default::default(),
            changed: false,
        }
    }

    /// Whether mode, arming, ground contact or power changed since this was last asked.
    pub fn changed(&mut self) -> bool {
        std::mem::take(&mut self.changed)
    }

    /// The state, once position and attitude are known.
    pub fn state(&self) -> Option<VehicleState> {
        Some(VehicleState {
            position_enu_m: self.position?.into(),
            attitude: self.attitude?,
            held: None,
            mode: self.mode.clone(),
            armed: self.armed,
            landed: self.landed.unwrap_or(!self.armed),
            battery: self.battery,
            tx_power_w: self.on.map(|on| on.power_w),
            slot: self.on.and_then(|on| on.slot),
        })
    }

    /// The transmitter falls silent by its last command's expiry, if that was before `now_us`; when.
    pub fn expire(&mut self, now_us: u64) -> Option<u64> {
        let on = self.on.filter(|on| on.until_us < now_us)?;
        self.set_power(None);
        Some(on.until_us)
    }

    /// A position that a companion told its peer.
    pub fn pair_status(&mut self, from: MavHeader, position_enu_m: [f32; 3]) {
        let own = self.autopilot.is_some_and(|(system, _)| system == from.system_id);
        if own && self.mission.is_none() && position_enu_m.iter().all(|metres| metres.is_finite()) {
            self.position = Some(Enu::from(position_enu_m.map(f64::from)));
        }
    }

    /// Takes a message; a line for the story, if it is one.
    pub fn handle(
        &mut self,
        from: MavHeader,
        message: &MavMessage,
        now_us: u64,
    ) -> Option<(Severity, String)> {
        let by_autopilot = self.autopilot == Some((from.system_id, from.component_id));
        match message {
            MavMessage::HEARTBEAT(m) => self.heartbeat(from, m),
            MavMessage::COMMAND_INT(m) if m.command == MavCmd::MAV_CMD_USER_1 => self.asked(m, now_us),
            MavMessage::COMMAND_ACK(m) if m.command == MavCmd::MAV_CMD_USER_1 => self.answered(m),
            MavMessage::STATUSTEXT(m) => {
                let text = self.texts[usize::from(by_autopilot)].handle(m)?;
                let severity = Severity::from(m.severity);
                return match by_autopilot {
                    false => Some((severity, text)),
                    // An autopilot talks much; its warnings matter.
                    true => {
                        (severity > Severity::Info).then(|| (Severity::Warning, format!("autopilot: {text}")))
                    }
                };
            }
            _ if by_autopilot => self.telemetry(message),
            _ => {}
        }
        None
    }

    fn heartbeat(&mut self, from: MavHeader, m: &HEARTBEAT_DATA) {
        let Some(firmware) = Firmware::of(m) else { return };
        self.firmware = Some(firmware);
        self.autopilot = Some((from.system_id, from.component_id));
        let mode = firmware.mode_name(firmware.mode(m.custom_mode));
        let armed = m.base_mode.contains(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED);
        if self.mode != mode || self.armed != armed {
            self.changed = true;
            mode.clone_into(&mut self.mode);
            self.armed = armed;
        }
    }

    fn telemetry(&mut self, message: &MavMessage) {
        match message {
            MavMessage::GPS_GLOBAL_ORIGIN(m) => {
                self.local_origin = Some(Geodetic {
                    lat_deg: f64::from(m.latitude) * 1e-7,
                    lon_deg: f64::from(m.longitude) * 1e-7,
                    alt_m: f64::from(m.altitude) * 1e-3,
                });
            }
            MavMessage::LOCAL_POSITION_NED(m) => {
                if let (Some(mission), Some(autopilot), Some(firmware)) =
                    (self.mission, self.local_origin, self.firmware)
                {
                    let frame = LocalFrame { mission, autopilot, projection: firmware.projection() };
                    let position = frame.position_to_enu(Ned::new(m.x.into(), m.y.into(), m.z.into()));
                    self.position =
                        Some(position).filter(|p| p.iter().all(|v| v.is_finite())).or(self.position);
                }
            }
            MavMessage::ATTITUDE_QUATERNION(m) => {
                let read = Attitude::from_mavlink([m.q1, m.q2, m.q3, m.q4].map(f64::from));
                self.attitude = read.or(self.attitude);
            }
            MavMessage::EXTENDED_SYS_STATE(m) => {
                let landed = match m.landed_state {
                    MavLandedState::MAV_LANDED_STATE_UNDEFINED => self.landed,
                    state => Some(state == MavLandedState::MAV_LANDED_STATE_ON_GROUND),
                };
                self.changed |= landed != self.landed;
                self.landed = landed;
            }
            MavMessage::BATTERY_STATUS(m) => {
                let percent = f64::from(m.battery_remaining);
                self.battery = (percent >= 0.0).then_some(percent / 100.0);
            }
            _ => {}
        }
    }

    /// Acknowledgements of the first form carry no number: each belongs to the oldest command that is still unanswered.
    fn asked(&mut self, m: &COMMAND_INT_DATA, now_us: u64) {
        if m.param2 >= 1.0 {
            self.numbered.push_back((m.param2 as u32, u16::try_from(m.x).ok()));
            self.numbered.drain(..self.numbered.len().saturating_sub(REMEMBERED));
            return;
        }
        let expiry_ms = u64::try_from(m.y).unwrap_or(0);
        let until_us = (expiry_ms > 0 && m.param1.is_finite()).then_some(now_us + expiry_ms * 1000);
        self.asked.retain(|asked| asked.at_us + ANSWER_US >= now_us);
        self.asked.push_back(Asked { at_us: now_us, slot: u16::try_from(m.x).ok(), until_us });
    }

    fn answered(&mut self, m: &COMMAND_ACK_DATA) {
        let Some(asked) = self.asked.pop_front() else { return };
        if m.result != MavResult::MAV_RESULT_ACCEPTED {
            return;
        }
        let power_w = Watts::from(Dbm(f64::from(m.result_param2) / 1000.0)).0;
        let on = asked.until_us.filter(|_| m.result_param2 != OFF);
        self.set_power(on.map(|until_us| On { power_w, slot: asked.slot, until_us }));
    }

    /// What the radio says of itself: the power in force, and until when by its own clock.
    pub fn radio(&mut self, m: &VEILWING_RADIO_DATA, now_us: u64) {
        // Both wrap at 2^32.
        let left_ms = m.expires_ms.wrapping_sub(m.time_ms) as i32;
        // A report that came late says the radio's clock too late: the promptest one tells where it stands.
        let offset_us = now_us.cast_signed() - 1000 * i64::from(m.time_ms);
        let known_us = self.radio_clock_us.filter(|known| (offset_us - known).abs() < SAME_CLOCK_US);
        let offset_us = known_us.map_or(offset_us, |known| known.min(offset_us));
        self.radio_clock_us = Some(offset_us);
        let until_us = offset_us + 1000 * (i64::from(m.time_ms) + i64::from(left_ms.max(0)));
        let until_us = u64::try_from(until_us).unwrap_or(0);
        let slot =
            self.numbered.iter().rev().find(|(number, _)| *number == m.newest).and_then(|(_, slot)| *slot);
        let power_w = Watts::from(Dbm(f64::from(m.power_mdbm) / 1000.0)).0;
        self.set_power((m.power_mdbm != OFF).then_some(On { power_w, slot, until_us }));
    }

    fn set_power(&mut self, on: Option<On>) {
        let seen = |on: Option<On>| on.map(|on| (on.power_w, on.slot));
        self.changed |= seen(on) != seen(self.on);
        self.on = on;
    }
}
