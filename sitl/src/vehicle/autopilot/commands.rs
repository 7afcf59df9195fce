//! COMMAND_LONG, COMMAND_INT and SET_MODE: carried out or refused, and always answered.

use std::time::Duration;

use mavlink::MessageData;
use mavlink::dialects::ardupilotmega::*;

use super::super::router::{Router, Sender, To};
use super::{Autopilot, COMPONENT, Mode, streams};
use crate::vehicle::config::Firmware;

/// The magic number of MAV_CMD_COMPONENT_ARM_DISARM's second parameter.
const FORCE: f32 = 21_196.0;
/// ArduCopter's main loop: no stream is faster.
const FASTEST_INTERVAL: Duration = Duration::from_micros(2500);

/// A day: a longer interval is no stream any more.
const SLOWEST_INTERVAL: Duration = Duration::from_secs(86_400);

/// A command of either message, as far as both have it.
pub(super) struct Command {
    id: MavCmd,
    pub params: [f32; 4],
    /// Latitude and longitude, where both are given.
    pub lat_lon_deg: Option<[f64; 2]>,
    /// The third coordinate, and the frame that COMMAND_INT gives it.
    pub z: f32,
    pub frame: Option<MavFrame>,
}

impl Autopilot {
    pub(super) fn handle_command(
        &mut self,
        from: Sender,
        message: &MavMessage,
        now: Duration,
        router: &mut Router,
    ) {
        let command = match message {
            MavMessage::COMMAND_LONG(c) => Command {
                id: c.command,
                params: [c.param1, c.param2, c.param3, c.param4],
                lat_lon_deg: (c.param5.is_finite() && c.param6.is_finite())
                    .then(|| [c.param5.into(), c.param6.into()]),
                z: c.param7,
                frame: None,
            },
            MavMessage::COMMAND_INT(c) => Command {
                id: c.command,
                params: [c.param1, c.param2, c.param3, c.param4],
                // The greatest integer in both says that there is no point.
                lat_lon_deg: ([c.x, c.y] != [i32::MAX; 2])
                    .then(|| [c.x, c.y].map(|degrees| f64::from(degrees) * 1e-7)),
                z: c.z,
                frame: Some(c.frame),
            },
            MavMessage::SET_MODE(m) => {
                if m.target_system == self.system_id {
                    let result = match Mode::from_custom(self.firmware, m.custom_mode) {
                        Some(mode) => self.command_mode(mode, now, router),
                        None => MavResult::MAV_RESULT_UNSUPPORTED,
                    };
                    self.acknowledge(from, MavCmd::MAV_CMD_DO_SET_MODE, result, router);
                }
                return;
            }
            _ => return,
        };
        if self.passes_the_script(command.id, now, router) {
            return;
        }
        let result = self.execute(&command, from, now, router);
        self.acknowledge(from, command.id, result, router);
    }

    fn acknowledge(&self, from: Sender, command: MavCmd, result: MavResult, router: &mut Router) {
        let ack = COMMAND_ACK_DATA {
            command,
            result,
            target_system: from.system_id,
            target_component: from.component_id,
            ..COMMAND_ACK_DATA::DEFAULT
        };
        router.send(To::Link(from.link), COMPONENT, &MavMessage::COMMAND_ACK(ack));
    }

    fn execute(&mut self, c: &Command, from: Sender, now: Duration, router: &mut Router) -> MavResult {
        let [p1, p2, p3, _] = c.params;
        match c.id {
            MavCmd::MAV_CMD_COMPONENT_ARM_DISARM => {
                if p1 == 1.0 {
                    self.command_arm(p2 == FORCE, now, router)
                } else if p1 == 0.0 {
                    self.command_disarm(p2 == FORCE, router)
                } else {
                    MavResult::MAV_RESULT_UNSUPPORTED
                }
            }
            MavCmd::MAV_CMD_DO_SET_MODE => {
                let custom = p1.is_finite() && (p1 as u8) & 1 != 0;
                match Mode::from_command(self.firmware, p2.into(), p3.into()) {
                    Some(mode) if custom => self.command_mode(mode, now, router),
                    _ => MavResult::MAV_RESULT_UNSUPPORTED,
                }
            }
            MavCmd::MAV_CMD_NAV_TAKEOFF => self.command_takeoff(c, now, router),
            MavCmd::MAV_CMD_NAV_LAND => self.command_mode(Mode::Land, now, router),
            MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH => self.command_mode(Mode::ReturnToLaunch, now, router),
            MavCmd::MAV_CMD_DO_REPOSITION => self.command_reposition(c, now, router),
            MavCmd::MAV_CMD_USER_4 | MavCmd::MAV_CMD_USER_5 => self.command_offsets(c.id, [p1, p2]),
            MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL => self.command_interval(from.link, p1, p2, now),
            MavCmd::MAV_CMD_GET_MESSAGE_INTERVAL => self.command_get_interval(from.link, p1, router),
            MavCmd::MAV_CMD_REQUEST_MESSAGE => self.command_request(from.link, p1, router),
            MavCmd::MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES if p1 == 1.0 => {
                self.command_request(from.link, AUTOPILOT_VERSION_DATA::ID as f32, router)
            }
            MavCmd::MAV_CMD_REQUEST_PROTOCOL_VERSION if p1 == 1.0 => {
                self.command_request(from.link, PROTOCOL_VERSION_DATA::ID as f32, router)
            }
            MavCmd::MAV_CMD_GET_HOME_POSITION => {
                self.command_request(from.link, HOME_POSITION_DATA::ID as f32, router)
            }
            _ => MavResult::MAV_RESULT_UNSUPPORTED,
        }
    }

    /// The firmware's way of saying no for now.
    pub(super) fn refusal(&self) -> MavResult {
        match self.firmware {
            Firmware::Px4 => MavResult::MAV_RESULT_TEMPORARILY_REJECTED,
            Firmware::ArduCopter => MavResult::MAV_RESULT_FAILED,
        }
    }

    fn refuse(&self, why: &str, router: &mut Router) -> MavResult {
        self.text(MavSeverity::MAV_SEVERITY_CRITICAL, why, router);
        self.refusal()
    }

    fn command_arm(&mut self, force: bool, now: Duration, router: &mut Router) -> MavResult {
        if self.armed {
            return MavResult::MAV_RESULT_ACCEPTED;
        }
        if !force {
            if let Some(why) = self.unready(now) {
                return self.refuse(why, router);
            }
            if self.firmware == Firmware::Px4 && self.mode == Mode::Companion && !self.offboard.proven(now) {
                return self.refuse("Arming denied: no offboard signal", router);
            }
            let unarmable = [Mode::Land, Mode::ReturnToLaunch].contains(&self.mode);
            if self.firmware == Firmware::ArduCopter && unarmable {
                return self.refuse("Arm: mode not armable", router);
            }
        }
        let Some(sensed) = self.sensed else { return self.refusal() };
        self.armed = true;
        self.home_enu_m = sensed.position_enu_m;
        let (mode, takeoff) = (self.mode, self.flight.takeoff_altitude_enu_m);
        self.enter(mode, &sensed);
        self.flight.takeoff_altitude_enu_m = takeoff;
        (self.ground.armed_at, self.ground.flown) = (now, false);
        self.text(MavSeverity::MAV_SEVERITY_INFO, "Armed by command", router);
        MavResult::MAV_RESULT_ACCEPTED
    }

    fn command_disarm(&mut self, force: bool, router: &mut Router) -> MavResult {
        if self.armed && !self.landed && !force {
            return self.refuse("Disarming denied: not landed", router);
        }
        if self.armed {
            self.disarm();
            self.text(MavSeverity::MAV_SEVERITY_INFO, "Disarmed by command", router);
        }
        MavResult::MAV_RESULT_ACCEPTED
    }

    pub(super) fn command_mode(&mut self, mode: Mode, now: Duration, router: &mut Router) -> MavResult {
        let Some(sensed) = self.sensed else { return self.refusal() };
        let blind = self.armed && !self.estimator_ok && ![Mode::Land, Mode::Stabilize].contains(&mode);
        if blind {
            return self.refuse("Mode change denied: no valid position estimate", router);
        }
        if mode == Mode::Companion
            && self.firmware == Firmware::Px4
            && (self.armed || !self.traps.ack_without_stream)
            && !self.offboard.proven(now)
        {
            return self.refuse("Switching to Offboard denied: no offboard signal", router);
        }
        if mode == Mode::Companion && self.traps.mode_ack_alone && !self.mode_forgotten {
            self.mode_forgotten = true;
            return MavResult::MAV_RESULT_ACCEPTED;
        }
        if self.mode != mode {
            if self.firmware == Firmware::ArduCopter {
                // GUIDED starts from where it is, not from what was sent before.
                self.offboard.clear();
            }
            self.enter(mode, &sensed);
        } else {
            self.traces.changes(mode, mode, now);
        }
        self.asked_for(mode);
        if mode == Mode::Takeoff {
            let above_m = f64::from(self.parameters.real("MIS_TAKEOFF_ALT"));
            self.flight.takeoff_altitude_enu_m = Some(sensed.position_enu_m.z + above_m);
        }
        self.resumes = false;
        MavResult::MAV_RESULT_ACCEPTED
    }

    fn command_takeoff(&mut self, c: &Command, now: Duration, router: &mut Router) -> MavResult {
        let Some(sensed) = self.sensed else { return self.refusal() };
        let relative = match (c.frame, self.firmware) {
            (
                Some(MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT | MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT_INT),
                _,
            ) => true,
            (Some(_), _) | (None, Firmware::Px4) => false,
            (None, Firmware::ArduCopter) => true,
        };
        let ground_m = if self.armed { self.home_enu_m.z } else { sensed.position_enu_m.z };
        let altitude_enu_m = match (c.z.is_finite(), relative) {
            (false, _) => ground_m + f64::from(self.parameters.real("MIS_TAKEOFF_ALT")),
            (true, true) => ground_m + f64::from(c.z),
            // Near the origin a height above the sea and the frame's z differ by a constant.
            (true, false) => {
                let here = self.frame.geodetic(sensed.position_enu_m).alt_amsl_m;
                sensed.position_enu_m.z + f64::from(c.z) - here
            }
        };
        match self.firmware {
            Firmware::Px4 => {
                let result = self.command_mode(Mode::Takeoff, now, router);
                if result == MavResult::MAV_RESULT_ACCEPTED {
                    self.flight.takeoff_altitude_enu_m = Some(altitude_enu_m);
                }
                result
            }
            Firmware::ArduCopter => {
                if self.mode != Mode::Companion || !self.armed || !self.landed || altitude_enu_m <= ground_m {
                    return MavResult::MAV_RESULT_FAILED;
                }
                self.enter(Mode::Companion, &sensed);
                self.flight.takeoff_altitude_enu_m = Some(altitude_enu_m);
                MavResult::MAV_RESULT_ACCEPTED
            }
        }
    }

    fn command_interval(&mut self, link: usize, id: f32, interval_us: f32, now: Duration) -> MavResult {
        let (Some(id), true) = (message_id(id), interval_us.is_finite()) else {
            return MavResult::MAV_RESULT_DENIED;
        };
        if !streams::has_stream(id, self.firmware) {
            return self.unknown_message();
        }
        let firmware = self.firmware;
        let refuses = firmware == Firmware::ArduCopter && self.traps.fast_interval_refused;
        let streams = self.streams(link, now);
        if interval_us < 0.0 {
            streams.stop(id);
        } else if interval_us == 0.0 {
            streams.set_default(id, firmware, now);
        } else {
            let asked = Duration::from_micros(interval_us as u64).min(SLOWEST_INTERVAL);
            if asked < FASTEST_INTERVAL && refuses {
                return MavResult::MAV_RESULT_DENIED;
            }
            streams.set(id, asked.max(FASTEST_INTERVAL), now);
        }
        MavResult::MAV_RESULT_ACCEPTED
    }

    fn unknown_message(&self) -> MavResult {
        match self.firmware {
            Firmware::Px4 => MavResult::MAV_RESULT_DENIED,
            Firmware::ArduCopter => MavResult::MAV_RESULT_FAILED,
        }
    }

    fn command_get_interval(&self, link: usize, id: f32, router: &mut Router) -> MavResult {
        let Some(id) = message_id(id) else { return MavResult::MAV_RESULT_DENIED };
        let interval = self.streams.get(&link).and_then(|s| s.interval(id));
        let reply = MESSAGE_INTERVAL_DATA {
            interval_us: interval.map_or(-1, |d| d.as_micros() as i32),
            message_id: id as u16,
        };
        router.send(To::Link(link), COMPONENT, &MavMessage::MESSAGE_INTERVAL(reply));
        MavResult::MAV_RESULT_ACCEPTED
    }

    fn command_request(&self, link: usize, id: f32, router: &mut Router) -> MavResult {
        let message =
            message_id(id).and_then(|id| self.sensed.as_ref().and_then(|sensed| self.message(id, sensed)));
        match message {
            Some(message) => {
                router.send(To::Link(link), COMPONENT, &message);
                MavResult::MAV_RESULT_ACCEPTED
            }
            None => self.unknown_message(),
        }
    }
}

/// A message id from a command's float.
fn message_id(id: f32) -> Option<u32> {
    (id.is_finite() && (0.0..16_777_216.0).contains(&id)).then_some(id as u32)
}
