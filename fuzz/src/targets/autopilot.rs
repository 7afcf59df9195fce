//! The autopilot's driver: requests in any order, an autopilot that answers, obeys, refuses or not, and messages of any
//! content, with time.

use std::collections::VecDeque;
use std::time::Duration;

use arbitrary::Unstructured;
use mavlink::dialects::ardupilotmega::*;
use mavlink::{MavHeader, Message};
use veilwing::autopilot::{Actuation, Autopilot, Event, Firmware, Mode, Setpoint, Settings};
use veilwing::geo::{Attitude, Enu, EnuAcceleration, EnuVelocity, Geodetic};
use veilwing::time::Instant;

use crate::reached::Reached;
use crate::target::Target;
use crate::wire;

/// The driver of PX4 and ArduCopter, its bridge script's commands among them.
pub const TARGET: Target = Target {
    name: "autopilot",
    what: "requests, answers, telemetry and messages of any content to the autopilot's driver, of both firmwares",
    words: &[],
    seeds,
    run,
    generated: 400,
};

const TICK: Duration = Duration::from_millis(20);
const OWN: (u8, u8) = (1, 191);
const ORIGIN: Geodetic = Geodetic { lat_deg: 50.0, lon_deg: 14.0, alt_m: 200.0 };
/// More at one call would hold up a serial line.
const MOST_MESSAGES: usize = 64;
const MOST_CALLS: u32 = 50;

fn seeds() -> Vec<Vec<u8>> {
    // For each firmware and actuation: heard, controlled, armed, taken off, flown, landed.
    let flight =
        [0, 255, 1, 0, 8, 0, 150, 1, 1, 0, 100, 1, 2, 0, 200, 9, 1, 0, 200, 1, 3, 0, 200, 1, 7, 0, 50];
    let pilot = [0, 255, 8, 1, 0, 0, 150, 1, 1, 0, 100, 1, 2, 0, 200, 9, 1, 0, 50, 5, 2, 0, 50, 5, 0, 0, 50];
    let of = |head: u8| [&flight, &pilot].map(|tail| [&[head][..], &tail[..]].concat());
    (0..12).flat_map(of).collect()
}

/// An autopilot that is there: what its telemetry says.
struct Vehicle {
    mode: u32,
    armed: bool,
    up_m: f32,
    roll_rad: f64,
    /// Its answers to commands; obeys what it accepts.
    result: MavResult,
    silent: bool,
}

struct Bench {
    firmware: Firmware,
    driver: Autopilot,
    now: Instant,
    vehicle: Vehicle,
    /// Commands that were not answered.
    asked: VecDeque<COMMAND_LONG_DATA>,
    parameters: VecDeque<(mavlink::types::CharArray<16>, Option<f32>)>,
    streams: bool,
    setpoint: bool,
}

fn run(input: &[u8], reached: &mut Reached) {
    let Some((head, rest)) = input.split_first() else { return };
    let firmware = if head & 1 == 0 { Firmware::Px4 } else { Firmware::ArduPilot };
    let mut settings = Settings::new(OWN, ORIGIN);
    settings.actuation =
        [Actuation::Pose, Actuation::Position, Actuation::ThrustVector][usize::from(head >> 1) % 3];
    settings.planned_tilt_rad = if head & 8 == 0 { 0.6 } else { 0.2 };
    settings.autopilot_system = (head & 16 == 0).then_some(1);
    let now = Instant::from_start(Duration::from_secs(1));
    let mut bench = Bench {
        firmware,
        driver: Autopilot::new(settings, now),
        now,
        vehicle: Vehicle {
            mode: 0,
            armed: false,
            up_m: 0.0,
            roll_rad: 0.0,
            result: MavResult::MAV_RESULT_ACCEPTED,
            silent: false,
        },
        asked: VecDeque::new(),
        parameters: VecDeque::new(),
        streams: true,
        setpoint: true,
    };
    let mut u = Unstructured::new(rest);
    while !u.is_empty() {
        if bench.step(&mut u, reached).is_err() {
            break;
        }
        bench.look(reached);
    }
}

impl Bench {
    fn step(&mut self, u: &mut Unstructured<'_>, reached: &mut Reached) -> arbitrary::Result<()> {
        match u.arbitrary::<u8>()? % 12 {
            0 => {
                let ticks: u8 = u.arbitrary()?;
                (0..ticks).for_each(|_| self.tick(reached));
            }
            1 => self.request(u.arbitrary()?, reached),
            2 => {
                if let Some(message) = wire::message(u)? {
                    self.hear((1, 1), &message, reached);
                }
            }
            3 => {
                let from =
                    [(1, 1), (2, 1), (255, 190), (1, 68), (9, 9)][usize::from(u.arbitrary::<u8>()?) % 5];
                if let Some(message) = wire::message(u)? {
                    self.hear(from, &message, reached);
                }
            }
            4 => self.answer(u.arbitrary()?, reached),
            5 => {
                // The pilot's hand.
                self.vehicle.mode = self.code(u.arbitrary()?);
                self.beat(reached);
            }
            6 => {
                let results = [
                    MavResult::MAV_RESULT_ACCEPTED,
                    MavResult::MAV_RESULT_TEMPORARILY_REJECTED,
                    MavResult::MAV_RESULT_DENIED,
                    MavResult::MAV_RESULT_UNSUPPORTED,
                    MavResult::MAV_RESULT_IN_PROGRESS,
                ];
                self.vehicle.result = results[usize::from(u.arbitrary::<u8>()?) % results.len()];
            }
            7 => self.state_parameter(u.arbitrary()?, u.arbitrary()?, reached),
            8 => {
                let what: u8 = u.arbitrary()?;
                match what % 6 {
                    0 => self.streams = !self.streams,
                    1 => self.vehicle.silent = !self.vehicle.silent,
                    2 => self.vehicle.armed = !self.vehicle.armed,
                    3 => self.setpoint = !self.setpoint,
                    4 => self.vehicle.up_m = f32::from(what),
                    _ => self.vehicle.roll_rad = f64::from(what) * 0.02,
                }
            }
            9 => {
                let height: i8 = u.arbitrary()?;
                self.driver.take_off(f64::from(height) * 0.5, self.now);
                self.drain(false, reached);
            }
            10 => {
                let text = String::from_utf8_lossy(wire::bytes(u)?).into_owned();
                self.driver.statustext(MavSeverity::MAV_SEVERITY_INFO, &text);
                self.drain(false, reached);
            }
            _ => {
                let figures: [i16; 3] = u.arbitrary()?;
                let [x, y, z] =
                    figures.map(|figure| if figure == i16::MIN { f64::NAN } else { f64::from(figure) });
                let setpoint = Setpoint {
                    position_enu_m: Enu::new(x, y, z),
                    velocity_enu_m_s: EnuVelocity::ZERO,
                    acceleration_enu_m_s2: EnuAcceleration::ZERO,
                    attitude: Attitude::from_euler(x, y, 0.0),
                };
                self.driver.set_setpoint(setpoint, self.now);
                self.drain(true, reached);
            }
        }
        Ok(())
    }

    fn request(&mut self, which: u8, reached: &mut Reached) {
        let (driver, now) = (&mut self.driver, self.now);
        match which % 8 {
            0 => driver.take_control(now),
            1 => driver.arm(now),
            2 => driver.take_off(10.0, now),
            3 => driver.land(now),
            4 => driver.return_to_launch(now),
            5 => driver.hold(now),
            6 => driver.release(now),
            _ => driver.disarm(now),
        }
        self.drain(false, reached);
    }

    /// The code of a mode: the companion's, or one of others.
    fn code(&self, which: u8) -> u32 {
        let px4 = [6 << 16, 3 << 16, 4 << 16 | 3 << 24, 4 << 16 | 6 << 24, 4 << 16 | 5 << 24, 1 << 16];
        let ardupilot = [4, 5, 17, 9, 6, 0];
        let codes = if self.firmware == Firmware::Px4 { px4 } else { ardupilot };
        codes.get(usize::from(which) % 7).copied().unwrap_or(u32::from(which) << 16)
    }

    fn tick(&mut self, reached: &mut Reached) {
        self.now = self.now + TICK;
        let time_boot_ms = self.now.since_start().as_millis() as u32;
        let tick = time_boot_ms / 20;
        if !self.vehicle.silent {
            if tick.is_multiple_of(25) {
                self.beat(reached);
            }
            if self.streams {
                self.stream(time_boot_ms, tick, reached);
            }
            self.answer(0, reached);
            self.state_parameter(0, 0, reached);
        }
        let mut calls = 0;
        while let Some((at, why)) = self.driver.poll_timeout().filter(|(at, _)| *at <= self.now) {
            calls += 1;
            assert!(calls < MOST_CALLS, "{why}, due at {at:?}, is never done");
            self.driver.handle_timeout(self.now);
            self.drain(false, reached);
        }
        if self.setpoint {
            let setpoint = Setpoint {
                position_enu_m: Enu::new(0.0, 0.0, 10.0),
                velocity_enu_m_s: EnuVelocity::ZERO,
                acceleration_enu_m_s2: EnuAcceleration::ZERO,
                attitude: Attitude::from_euler(0.3, 0.1, 0.0),
            };
            self.driver.set_setpoint(setpoint, self.now);
            self.drain(true, reached);
        }
    }

    fn stream(&mut self, time_boot_ms: u32, tick: u32, reached: &mut Reached) {
        let [q1, q2, q3, q4] = Attitude::from_euler(self.vehicle.roll_rad, 0.0, 0.0)
            .to_mavlink()
            .map(|component| component as f32);
        let attitude =
            ATTITUDE_QUATERNION_DATA { time_boot_ms, q1, q2, q3, q4, ..ATTITUDE_QUATERNION_DATA::DEFAULT };
        let position = LOCAL_POSITION_NED_DATA {
            time_boot_ms,
            z: -self.vehicle.up_m,
            ..LOCAL_POSITION_NED_DATA::DEFAULT
        };
        self.hear((1, 1), &MavMessage::ATTITUDE_QUATERNION(attitude), reached);
        self.hear((1, 1), &MavMessage::LOCAL_POSITION_NED(position), reached);
        if tick.is_multiple_of(20) {
            let landed_state = if self.vehicle.up_m > 0.1 {
                MavLandedState::MAV_LANDED_STATE_IN_AIR
            } else {
                MavLandedState::MAV_LANDED_STATE_ON_GROUND
            };
            let landed = EXTENDED_SYS_STATE_DATA { landed_state, ..EXTENDED_SYS_STATE_DATA::DEFAULT };
            self.hear((1, 1), &MavMessage::EXTENDED_SYS_STATE(landed), reached);
            let origin = GPS_GLOBAL_ORIGIN_DATA {
                latitude: 500_000_000,
                longitude: 140_000_000,
                altitude: 200_000,
                ..GPS_GLOBAL_ORIGIN_DATA::DEFAULT
            };
            self.hear((1, 1), &MavMessage::GPS_GLOBAL_ORIGIN(origin), reached);
            let time_unix_usec = 1_800_000_000_000_000 + u64::from(time_boot_ms) * 1000;
            let time = SYSTEM_TIME_DATA { time_boot_ms, time_unix_usec };
            self.hear((1, 1), &MavMessage::SYSTEM_TIME(time), reached);
        }
        // In control and in the air, it goes where it is told to.
        if self.driver.in_control() && self.vehicle.up_m < 10.0 && self.vehicle.armed {
            self.vehicle.up_m += 0.05;
        }
    }

    fn beat(&mut self, reached: &mut Reached) {
        let mut base_mode = MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED;
        base_mode.set(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED, self.vehicle.armed);
        let heartbeat = HEARTBEAT_DATA {
            custom_mode: self.vehicle.mode,
            mavtype: MavType::MAV_TYPE_QUADROTOR,
            autopilot: match self.firmware {
                Firmware::Px4 => MavAutopilot::MAV_AUTOPILOT_PX4,
                Firmware::ArduPilot => MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA,
            },
            base_mode,
            system_status: MavState::MAV_STATE_ACTIVE,
            mavlink_version: 3,
        };
        self.hear((1, 1), &MavMessage::HEARTBEAT(heartbeat), reached);
        // At the very heartbeat the pilot has it (F2).
        let ours = self.firmware.mode(self.vehicle.mode) == Mode::Companion;
        assert!(!self.driver.in_control() || (ours && self.vehicle.armed), "in control against a heartbeat");
    }

    /// Answers the oldest command, and obeys it if it is accepted.
    fn answer(&mut self, other: u8, reached: &mut Reached) {
        let Some(command) = self.asked.pop_front() else { return };
        let result = if other == 0 { self.vehicle.result } else { MavResult::MAV_RESULT_FAILED };
        if result == MavResult::MAV_RESULT_ACCEPTED {
            match command.command {
                MavCmd::MAV_CMD_DO_SET_MODE => {
                    let (main, sub) = (command.param2 as u32, command.param3 as u32);
                    self.vehicle.mode =
                        if self.firmware == Firmware::Px4 { main << 16 | sub << 24 } else { main };
                }
                MavCmd::MAV_CMD_COMPONENT_ARM_DISARM => self.vehicle.armed = command.param1 == 1.0,
                MavCmd::MAV_CMD_NAV_TAKEOFF => self.vehicle.up_m = command.param7.clamp(0.0, 100.0),
                _ => {}
            }
        }
        let ack = COMMAND_ACK_DATA {
            command: command.command,
            result,
            target_system: OWN.0,
            target_component: OWN.1,
            ..COMMAND_ACK_DATA::DEFAULT
        };
        self.hear((1, 1), &MavMessage::COMMAND_ACK(ack), reached);
    }

    /// Gives the parameter that was asked for or written first.
    fn state_parameter(&mut self, kind: u8, value: u8, reached: &mut Reached) {
        let Some((param_id, written)) = self.parameters.pop_front() else { return };
        let param_type = [
            MavParamType::MAV_PARAM_TYPE_REAL32,
            MavParamType::MAV_PARAM_TYPE_INT32,
            MavParamType::MAV_PARAM_TYPE_INT8,
            MavParamType::MAV_PARAM_TYPE_UINT64,
        ][usize::from(kind) % 4];
        let value = PARAM_VALUE_DATA {
            param_value: written.unwrap_or(f32::from(value)),
            param_count: 1,
            param_index: 0,
            param_id,
            param_type,
        };
        self.hear((1, 1), &MavMessage::PARAM_VALUE(value), reached);
    }

    fn hear(&mut self, from: (u8, u8), message: &MavMessage, reached: &mut Reached) {
        let header = MavHeader { system_id: from.0.into(), component_id: from.1, sequence: 0 };
        self.driver.handle_message(header, message, self.now);
        self.drain(false, reached);
    }

    /// What is said: every figure is one, and a setpoint goes out when it is set and at no other time (F3).
    fn drain(&mut self, setting: bool, reached: &mut Reached) {
        let mut count = 0;
        while let Some(message) = self.driver.poll_transmit() {
            count += 1;
            reached.note(format_args!("{}", message.message_name()));
            match message {
                MavMessage::SET_POSITION_TARGET_LOCAL_NED(m) => {
                    assert!(setting, "a setpoint that nobody has set");
                    let figures = [m.x, m.y, m.z, m.vx, m.vy, m.vz, m.yaw];
                    assert!(figures.iter().all(|figure| figure.is_finite()), "{m:?}");
                }
                MavMessage::SET_ATTITUDE_TARGET(m) => {
                    assert!(setting, "a setpoint that nobody has set");
                    assert!(m.q.iter().chain(&m.thrust_body).all(|figure| figure.is_finite()), "{m:?}");
                    let firmware = self.driver.state().firmware;
                    assert_eq!(firmware, Some(Firmware::Px4), "a quaternion ends a 6DoF ArduCopter");
                }
                MavMessage::COMMAND_LONG(c) => {
                    let figures = [c.param1, c.param2, c.param3, c.param7];
                    assert!(figures.iter().all(|figure| figure.is_finite()), "{c:?}");
                    reached.note(format_args!("{:?}", c.command));
                    self.asked.push_back(c);
                }
                MavMessage::PARAM_REQUEST_READ(m) => self.parameters.push_back((m.param_id, None)),
                MavMessage::PARAM_SET(m) => self.parameters.push_back((m.param_id, Some(m.param_value))),
                _ => {}
            }
        }
        assert!(count <= MOST_MESSAGES, "{count} messages at once");
        while let Some(event) = self.driver.poll_event() {
            note(&event, reached);
        }
    }

    fn look(&self, reached: &mut Reached) {
        let (driver, now) = (&self.driver, self.now);
        let state = driver.state();
        let control = (state.is_armed(), driver.in_control(), driver.fresh(now));
        reached.sentence("state", &format!("{:?} {control:?}", state.mode()));
        for check in driver.preflight(now) {
            reached.note(format_args!("{} {:?}", check.name, check.result));
        }
        assert!(driver.hover_thrust().is_finite());
        assert!(
            state
                .position_enu_m
                .is_none_or(|position| position.value.iter().all(|figure| figure.is_finite()))
        );
    }
}

fn note(event: &Event, reached: &mut Reached) {
    reached.sentence("event", &format!("{event:?}"));
}
