//! The radio component's side of MAVLink: the power command in both forms, the transmitter's parameters, and what it
//! says unasked. All of it crosses the hop between autopilot and radio.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::*;
use mavlink::{Message, MessageData};

use super::Vehicle;
use super::config::{PowerForm, RadioPlace};
use super::radio_hop::{Lane, Manners, Toward};
use super::router::{Router, Sender, To};
use super::transmitter::{COMPONENT, POWER_COMMAND, REPORT_CRC_EXTRA, REPORT_ID, Report};
use crate::random::{Noise, Purpose};
use crate::wire;

/// TUNNEL's payload type for the radio's own message.
const TUNNEL_TYPE: u16 = 42_120;
const HEARTBEAT_EVERY: Duration = Duration::from_secs(1);
/// Five reports a second are the least.
const REPORT_EVERY: Duration = Duration::from_millis(150);

/// What the radio says.
#[derive(Debug, Clone)]
enum Said {
    Common(Box<MavMessage>),
    Report(Report),
}

/// The hop to the radio, and when it next speaks by itself.
#[derive(Debug, Clone)]
pub(super) struct RadioHop {
    down: Lane<(Sender, MavMessage)>,
    up: Lane<(To, Said)>,
    next_heartbeat: Duration,
    next_report: Duration,
    /// Of the frames that ride in TUNNEL.
    sequence: u8,
}

impl RadioHop {
    pub fn new(seed: u64, vehicle: usize) -> Self {
        let noise = |direction| Noise::new(seed, Purpose::RadioHop, 2 * vehicle + direction);
        Self {
            down: Lane::new(noise(0)),
            up: Lane::new(noise(1)),
            next_heartbeat: Duration::ZERO,
            next_report: Duration::ZERO,
            sequence: 0,
        }
    }

    pub fn freeze(&mut self, toward: Toward, frozen: bool) {
        match toward {
            Toward::Radio => self.down.freeze(frozen),
            Toward::Companion => self.up.freeze(frozen),
        }
    }

    /// Whether either direction is anything but good.
    pub fn is_troubled(&self) -> bool {
        self.down.is_troubled() || self.up.is_troubled()
    }

    /// When the last of the commands under way arrives, if they are not held up.
    pub fn commands_arrive_by(&self) -> Option<Duration> {
        self.down.clear_at()
    }

    pub fn behave(&mut self, toward: Toward, manners: Manners) {
        match toward {
            Toward::Radio => self.down.behave(manners),
            Toward::Companion => self.up.behave(manners),
        }
    }
}

impl Vehicle {
    /// A message for the radio component, at the autopilot's end of the hop.
    pub(super) fn hand_to_radio(&mut self, from: Sender, message: MavMessage, now: Duration) {
        self.hop.down.send((from, message), now);
        self.run_radio(now);
    }

    /// What the radio does by `now`: hears what has arrived, says what is due; and what of it has arrived goes on.
    pub(super) fn run_radio(&mut self, now: Duration) {
        while let Some((from, message)) = self.hop.down.arrived(now) {
            if !self.transmitter.dark {
                self.radio(from, message, now);
            }
        }
        let speaks = !self.transmitter.dark;
        if speaks && now >= self.hop.next_heartbeat {
            self.hop.next_heartbeat = now + HEARTBEAT_EVERY;
            let heartbeat = HEARTBEAT_DATA {
                mavtype: MavType::MAV_TYPE_RADIO,
                autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID,
                system_status: MavState::MAV_STATE_ACTIVE,
                mavlink_version: 3,
                ..HEARTBEAT_DATA::DEFAULT
            };
            self.radio_says(To::All, MavMessage::HEARTBEAT(heartbeat), now);
        }
        if speaks && now >= self.hop.next_report && self.config.power_form == PowerForm::Second {
            self.hop.next_report = now + REPORT_EVERY;
            let report = self.transmitter.report(now);
            self.hop.up.send((To::All, Said::Report(report)), now);
        }
        while let Some((to, said)) = self.hop.up.arrived(now) {
            match said {
                Said::Common(message) => self.radios_router().send(to, COMPONENT, &message),
                Said::Report(report) => self.send_report(to, &report),
            }
        }
    }

    /// Where what the radio says goes out.
    fn radios_router(&mut self) -> &mut Router {
        self.radio_router.as_mut().unwrap_or(&mut self.router)
    }

    fn radio_says(&mut self, to: To, message: MavMessage, now: Duration) {
        self.hop.up.send((to, Said::Common(Box::new(message))), now);
    }

    /// The radio's own message as it is, or in TUNNEL across an autopilot, which drops what it does not know.
    fn send_report(&mut self, to: To, report: &Report) {
        let payload = report.payload();
        if self.config.radio_place != RadioPlace::BehindAutopilot {
            return self.radios_router().send_payload(to, COMPONENT, REPORT_ID, REPORT_CRC_EXTRA, &payload);
        }
        let from = [self.config.system_id, COMPONENT];
        let inside = wire::encode_payload(self.hop.sequence, from, REPORT_ID, &payload, REPORT_CRC_EXTRA);
        self.hop.sequence = self.hop.sequence.wrapping_add(1);
        let [type_low, type_high] = TUNNEL_TYPE.to_le_bytes();
        // To all systems and components.
        let mut tunnel = vec![type_low, type_high, 0, 0, inside.len() as u8];
        tunnel.extend_from_slice(&inside);
        self.router.send_payload(
            to,
            COMPONENT,
            TUNNEL_DATA::ID,
            MavMessage::extra_crc(TUNNEL_DATA::ID),
            &tunnel,
        );
    }

    /// The radio component's side of a message.
    fn radio(&mut self, from: Sender, message: MavMessage, now: Duration) {
        let link = To::Link(from.link);
        match message {
            MavMessage::COMMAND_INT(c) if c.target_component == COMPONENT => {
                self.power_command(from, &c, now)
            }
            MavMessage::COMMAND_LONG(c) if c.target_component == COMPONENT => {
                // The slot and the expiry are integers; a float cannot carry them safely.
                let result = if c.command == POWER_COMMAND {
                    MavResult::MAV_RESULT_COMMAND_INT_ONLY
                } else {
                    MavResult::MAV_RESULT_UNSUPPORTED
                };
                self.radio_says(link, acknowledgement(from, c.command, result, 0), now);
            }
            MavMessage::PARAM_REQUEST_LIST(_) => {
                for index in 0..self.transmitter.parameters.len() {
                    self.radio_parameter(link, Some(index), now);
                }
            }
            MavMessage::PARAM_REQUEST_READ(m) if m.target_component == COMPONENT => {
                let by_name = || self.transmitter.parameters.index_of(m.param_id.to_str().ok()?);
                self.radio_parameter(link, usize::try_from(m.param_index).ok().or_else(by_name), now);
            }
            MavMessage::PARAM_SET(m) if m.target_component == COMPONENT => {
                // They say what it is, which no write changes.
                let index =
                    m.param_id.to_str().ok().and_then(|name| self.transmitter.parameters.index_of(name));
                self.radio_parameter(To::All, index, now);
            }
            _ => {}
        }
    }

    fn power_command(&mut self, from: Sender, command: &COMMAND_INT_DATA, now: Duration) {
        let link = To::Link(from.link);
        if command.command != POWER_COMMAND {
            let unsupported = MavResult::MAV_RESULT_UNSUPPORTED;
            return self.radio_says(link, acknowledgement(from, command.command, unsupported, 0), now);
        }
        match self.transmitter.form_of(self.config.power_form, command) {
            PowerForm::First => {
                let (result, achieved_mdbm) = self.transmitter.command(command, now);
                self.radio_says(link, acknowledgement(from, command.command, result, achieved_mdbm), now);
            }
            // Its commander is aboard: nobody else's numbers count.
            PowerForm::Second if from.system_id != self.config.system_id => {
                let denied = MavResult::MAV_RESULT_DENIED;
                self.radio_says(link, acknowledgement(from, command.command, denied, 0), now);
            }
            PowerForm::Second => {
                let commander = (from.system_id, from.component_id);
                if let Some(report) = self.transmitter.numbered_command(commander, command, now) {
                    self.hop.up.send((link, Said::Report(report)), now);
                }
            }
        }
    }

    fn radio_parameter(&mut self, to: To, index: Option<usize>, now: Duration) {
        if let Some(value) = index.and_then(|k| self.transmitter.parameters.message(k)) {
            self.radio_says(to, MavMessage::PARAM_VALUE(value), now);
        }
    }
}

fn acknowledgement(to: Sender, command: MavCmd, result: MavResult, result_param2: i32) -> MavMessage {
    MavMessage::COMMAND_ACK(COMMAND_ACK_DATA {
        command,
        result,
        progress: 0,
        result_param2,
        target_system: to.system_id,
        target_component: to.component_id,
    })
}
