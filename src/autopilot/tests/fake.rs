//! A scripted autopilot, in virtual time. It states what real programs were seen to do, by hand.

mod commands;

use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

use mavlink::dialects::ardupilotmega::*;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use super::super::*;
use crate::geo::{Attitude, Geodetic, LocalFrame, Ned};
use crate::time::Instant;

pub const MISSION: Geodetic = Geodetic { lat_deg: 50.0755, lon_deg: 14.4378, alt_m: 200.0 };
/// The autopilot's own origin, elsewhere and higher.
pub const ORIGIN: Geodetic = Geodetic { lat_deg: 50.0771, lon_deg: 14.4350, alt_m: 203.0 };
pub const OWN: (u8, u8) = (1, 191);
pub const LATENCY: Duration = Duration::from_millis(10);
pub const STEP: Duration = Duration::from_millis(5);
/// 2026-01-01 at our instant zero.
pub const EPOCH_US: u64 = 1_767_225_600_000_000;

pub const PX4_OFFBOARD: u32 = 6 << 16;
pub const PX4_POSCTL: u32 = 3 << 16;
pub const PX4_LOITER: u32 = 4 << 16 | 3 << 24;
pub const PX4_LAND: u32 = 4 << 16 | 6 << 24;

/// How a command is answered.
#[derive(Debug, Clone, PartialEq)]
pub enum Manners {
    Obey,
    /// Do it and say nothing.
    ObeyInSilence,
    /// Say that it is under way for so many milliseconds, then do it.
    TakeTime(u64),
    /// Acknowledge and do nothing.
    PayLipService,
    Refuse(MavResult, &'static str),
    Ignore,
}

pub struct Fake {
    pub firmware: Firmware,
    pub address: (u8, u8),
    pub custom_mode: u32,
    pub armed: bool,
    pub landed: MavLandedState,
    /// Local NED.
    pub position: Vector3<f64>,
    pub velocity: Vector3<f64>,
    pub target: Option<Vector3<f64>>,
    pub attitude: [f32; 4],
    pub set_mode: Manners,
    pub arming: Manners,
    pub takeoff: Manners,
    /// A mode that this build does not have.
    pub missing_mode: Option<u32>,
    /// No bridge script.
    pub without_bridge: bool,
    /// The bridge script follows offsets.
    pub offsets_on: bool,
    /// The bridge script says nothing.
    pub mute_bridge: bool,
    /// The main loop's rate: no stream is faster.
    pub fastest_hz: f64,
    pub parameters: BTreeMap<String, (f32, MavParamType)>,
    /// As AUTOPILOT_VERSION has it: major, minor, patch, kind.
    pub version: u32,
    pub silent: bool,
    pub estimator: EstimatorStatusFlags,
    /// What the estimator states of its horizontal position, in metres.
    pub accuracy_m: f32,
    pub fix: GpsFixType,
    pub ekf: EkfStatusFlags,
    /// It does not answer TIMESYNC.
    pub without_timesync: bool,
    /// Streams that never come, whatever is asked for.
    pub mute: Vec<u32>,
    /// Every stream takes so many times as long as asked for.
    pub slowness: f64,
    pub received: Vec<(Instant, MavMessage)>,
    /// Moves by forces instead of following its targets.
    pub body: Option<super::omnicopter::Body>,
    booted_at: Instant,
    intervals: BTreeMap<u32, (Duration, Instant)>,
    pub heartbeat_at: Instant,
    setpoint_at: Option<Instant>,
    /// Offboard was left for want of a stream: PX4 goes back by itself when it resumes.
    lapsed: bool,
    climb_to: Option<f64>,
    under_way: Option<(Instant, COMMAND_LONG_DATA)>,
    pub out: VecDeque<MavMessage>,
}

pub fn quaternion(q: [f32; 4]) -> UnitQuaternion<f64> {
    let [w, x, y, z] = q.map(f64::from);
    UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z))
}

pub fn px4_ready() -> EstimatorStatusFlags {
    EstimatorStatusFlags::from_bits_retain(1 | 2 | 4 | 8 | 16 | 32 | 256 | 512)
}

pub fn int(value: i32, firmware: Firmware) -> (f32, MavParamType) {
    let raw = match firmware {
        Firmware::Px4 => f32::from_le_bytes(value.to_le_bytes()),
        Firmware::ArduPilot => value as f32,
    };
    (raw, MavParamType::MAV_PARAM_TYPE_INT32)
}

pub fn real(value: f32) -> (f32, MavParamType) {
    (value, MavParamType::MAV_PARAM_TYPE_REAL32)
}

impl Fake {
    pub fn new(firmware: Firmware) -> Self {
        let parameters = match firmware {
            Firmware::Px4 => vec![
                ("COM_OF_LOSS_T", real(1.0)),
                ("COM_OBL_RC_ACT", int(5, firmware)),
                ("FD_FAIL_R", int(0, firmware)),
                ("FD_FAIL_P", int(0, firmware)),
                ("NAV_DLL_ACT", int(0, firmware)),
                ("MAV_TYPE", int(14, firmware)),
                ("THR_MDL_FAC", real(0.0)),
                ("CA_AIRFRAME", int(0, firmware)),
                ("COM_RC_OVERRIDE", int(1, firmware)),
                ("NAV_RCL_ACT", int(2, firmware)),
                ("LNDMC_Z_VEL_MAX", real(0.3)),
                ("MPC_XY_VEL_MAX", real(12.0)),
                ("MPC_Z_VEL_MAX_DN", real(3.0)),
                ("MPC_Z_VEL_MAX_UP", real(3.0)),
            ],
            Firmware::ArduPilot => vec![
                ("FRAME_CLASS", int(16, firmware)),
                ("GUID_TIMEOUT", real(1.0)),
                ("GUID_OPTIONS", int(0, firmware)),
                ("FS_GCS_ENABLE", int(0, firmware)),
                ("SCR_ENABLE", int(1, firmware)),
                ("SCR_VM_I_COUNT", int(10_000, firmware)),
                ("PSC_JERK_XY", real(5.0)),
                ("PSC_JERK_Z", real(5.0)),
                ("WPNAV_ACCEL", real(250.0)),
                ("WPNAV_SPEED", real(1000.0)),
            ],
        };
        let mut parameters: BTreeMap<String, _> =
            parameters.into_iter().map(|(name, value)| (name.to_owned(), value)).collect();
        if firmware == Firmware::Px4 {
            parameters.extend(super::omnicopter::rotors());
        }
        Self {
            firmware,
            address: (1, 1),
            custom_mode: match firmware {
                Firmware::Px4 => PX4_POSCTL,
                Firmware::ArduPilot => 0,
            },
            armed: false,
            landed: MavLandedState::MAV_LANDED_STATE_ON_GROUND,
            position: Vector3::new(5.0, -3.0, 0.0),
            velocity: Vector3::zeros(),
            target: None,
            attitude: Attitude::from_euler(0.0, 0.0, 0.3).to_mavlink().map(|c| c as f32),
            set_mode: Manners::Obey,
            arming: Manners::Obey,
            takeoff: Manners::Obey,
            missing_mode: None,
            without_bridge: false,
            offsets_on: false,
            mute_bridge: false,
            fastest_hz: 400.0,
            parameters,
            version: match firmware {
                Firmware::Px4 => 0x010f_02ff,
                Firmware::ArduPilot => 0x0406_03ff,
            },
            silent: false,
            estimator: px4_ready(),
            accuracy_m: 0.4,
            fix: GpsFixType::GPS_FIX_TYPE_3D_FIX,
            ekf: EkfStatusFlags::from_bits_retain(1 | 2 | 4 | 8 | 16 | 32 | 256 | 512),
            without_timesync: false,
            mute: Vec::new(),
            slowness: 1.0,
            received: Vec::new(),
            body: None,
            booted_at: Instant::ZERO,
            intervals: BTreeMap::new(),
            heartbeat_at: Instant::ZERO,
            setpoint_at: None,
            lapsed: false,
            climb_to: None,
            under_way: None,
            out: VecDeque::new(),
        }
    }

    /// A watchdog reset in flight: the clock starts anew, streams and modes are the defaults.
    pub fn restart(&mut self, now: Instant) {
        self.booted_at = now;
        self.intervals.clear();
        self.custom_mode = if self.firmware == Firmware::Px4 { PX4_POSCTL } else { 0 };
        self.setpoint_at = None;
        self.lapsed = false;
    }

    /// Its own frame.
    pub fn frame(&self) -> LocalFrame {
        LocalFrame { mission: MISSION, autopilot: ORIGIN, projection: self.firmware.projection() }
    }

    pub fn setpoints_since(&self, since: Instant) -> usize {
        let is_setpoint = |m: &MavMessage| {
            matches!(m, MavMessage::SET_POSITION_TARGET_LOCAL_NED(_) | MavMessage::SET_ATTITUDE_TARGET(_))
        };
        self.received.iter().filter(|(at, m)| *at > since && is_setpoint(m)).count()
    }

    pub fn commands(&self, command: MavCmd) -> Vec<COMMAND_LONG_DATA> {
        let wanted = |m: &MavMessage| match m {
            MavMessage::COMMAND_LONG(c) if c.command == command => Some(c.clone()),
            _ => None,
        };
        self.received.iter().filter_map(|(_, m)| wanted(m)).collect()
    }

    pub fn say(&mut self, text: &str) {
        self.out.push_back(MavMessage::STATUSTEXT(STATUSTEXT_DATA {
            severity: MavSeverity::MAV_SEVERITY_CRITICAL,
            text: text.into(),
            id: 0,
            chunk_seq: 0,
        }));
    }

    fn companion_mode(&self) -> u32 {
        if self.firmware == Firmware::Px4 { PX4_OFFBOARD } else { 4 }
    }

    fn streaming(&self, now: Instant) -> bool {
        self.setpoint_at.is_some_and(|at| now.saturating_since(at) < Duration::from_millis(500))
    }

    pub fn handle(&mut self, message: MavMessage, now: Instant) {
        self.received.push((now, message.clone()));
        match &message {
            MavMessage::COMMAND_LONG(c) => self.command(c, now),
            MavMessage::TIMESYNC(question) if question.tc1 == 0 && !self.without_timesync => {
                let tc1 = now.saturating_since(self.booted_at).as_nanos() as i64;
                self.out.push_back(MavMessage::TIMESYNC(TIMESYNC_DATA { tc1, ..question.clone() }));
            }
            MavMessage::PARAM_REQUEST_READ(p) => self.answer_parameter(p.param_id.to_str().unwrap()),
            MavMessage::PARAM_SET(p) => {
                let name = p.param_id.to_str().unwrap();
                if let Some(entry) = self.parameters.get_mut(name) {
                    *entry = (p.param_value, p.param_type);
                    self.answer_parameter(name);
                }
            }
            MavMessage::SET_POSITION_TARGET_LOCAL_NED(p) => {
                self.live_setpoint(now);
                if self.custom_mode == self.companion_mode() && self.armed && self.climb_to.is_none() {
                    self.target = Some(Vector3::new(p.x.into(), p.y.into(), p.z.into()));
                    let ignored = PositionTargetTypemask::POSITION_TARGET_TYPEMASK_YAW_IGNORE;
                    if !p.type_mask.contains(ignored) {
                        self.head(p.yaw.into());
                    }
                }
            }
            MavMessage::SET_ATTITUDE_TARGET(a) => {
                if a.type_mask.contains(AttitudeTargetTypemask::ATTITUDE_TARGET_TYPEMASK_THRUST_BODY_SET) {
                    self.live_setpoint(now);
                }
                match &mut self.body {
                    Some(body) => body.command(a),
                    None => self.attitude = a.q,
                }
            }
            _ => {}
        }
    }

    fn live_setpoint(&mut self, now: Instant) {
        self.setpoint_at = Some(now);
        if self.lapsed {
            self.lapsed = false;
            self.custom_mode = self.companion_mode();
        }
    }

    fn answer_parameter(&mut self, name: &str) {
        let Some((name, (param_value, param_type))) = self.parameters.get_key_value(name) else { return };
        self.out.push_back(MavMessage::PARAM_VALUE(PARAM_VALUE_DATA {
            param_value: *param_value,
            param_count: 900,
            param_index: 0,
            param_id: name.as_str().into(),
            param_type: *param_type,
        }));
    }

    /// Turns to this heading at once.
    fn head(&mut self, heading_rad: f64) {
        let (roll, pitch, _) = quaternion(self.attitude).euler_angles();
        let turned = UnitQuaternion::from_euler_angles(roll, pitch, heading_rad);
        self.attitude = [turned.w, turned.i, turned.j, turned.k].map(|c| c as f32);
    }

    fn telemetry(&self, id: u32, now: Instant) -> Option<MavMessage> {
        let time_boot_ms = now.saturating_since(self.booted_at).as_millis() as u32;
        let e7 = |deg: f64| (deg * 1e7).round() as i32;
        let (latitude, longitude, altitude) =
            (e7(ORIGIN.lat_deg), e7(ORIGIN.lon_deg), (ORIGIN.alt_m * 1e3) as i32);
        let message = match id {
            0 => self.heartbeat(),
            32 => {
                let noise = self.body.as_ref().map_or_else(Default::default, |body| body.noise);
                let (position, velocity) = (self.position + noise.0, self.velocity + noise.1);
                MavMessage::LOCAL_POSITION_NED(LOCAL_POSITION_NED_DATA {
                    time_boot_ms,
                    x: position.x as f32,
                    y: position.y as f32,
                    z: position.z as f32,
                    vx: velocity.x as f32,
                    vy: velocity.y as f32,
                    vz: velocity.z as f32,
                })
            }
            31 => MavMessage::ATTITUDE_QUATERNION(ATTITUDE_QUATERNION_DATA {
                time_boot_ms,
                q1: self.attitude[0],
                q2: self.attitude[1],
                q3: self.attitude[2],
                q4: self.attitude[3],
                ..Default::default()
            }),
            33 => {
                let point = self.firmware.projection().from_ned(Ned::from_vector(self.position), ORIGIN);
                MavMessage::GLOBAL_POSITION_INT(GLOBAL_POSITION_INT_DATA {
                    time_boot_ms,
                    lat: e7(point.lat_deg),
                    lon: e7(point.lon_deg),
                    alt: (point.alt_m * 1e3) as i32,
                    ..Default::default()
                })
            }
            49 => MavMessage::GPS_GLOBAL_ORIGIN(GPS_GLOBAL_ORIGIN_DATA {
                latitude,
                longitude,
                altitude,
                time_usec: 0,
            }),
            242 => MavMessage::HOME_POSITION(HOME_POSITION_DATA {
                latitude,
                longitude,
                altitude,
                ..Default::default()
            }),
            2 => MavMessage::SYSTEM_TIME(SYSTEM_TIME_DATA {
                time_unix_usec: EPOCH_US + now.since_start().as_micros() as u64,
                time_boot_ms,
            }),
            245 => MavMessage::EXTENDED_SYS_STATE(EXTENDED_SYS_STATE_DATA {
                vtol_state: MavVtolState::MAV_VTOL_STATE_UNDEFINED,
                landed_state: self.landed,
            }),
            230 => MavMessage::ESTIMATOR_STATUS(ESTIMATOR_STATUS_DATA {
                flags: self.estimator,
                pos_horiz_accuracy: self.accuracy_m,
                ..Default::default()
            }),
            24 => MavMessage::GPS_RAW_INT(GPS_RAW_INT_DATA { fix_type: self.fix, ..Default::default() }),
            193 => MavMessage::EKF_STATUS_REPORT(EKF_STATUS_REPORT_DATA {
                flags: self.ekf,
                ..Default::default()
            }),
            1 => MavMessage::SYS_STATUS(SYS_STATUS_DATA {
                onboard_control_sensors_present: MavSysStatusSensor::all(),
                onboard_control_sensors_enabled: MavSysStatusSensor::all(),
                onboard_control_sensors_health: MavSysStatusSensor::all(),
                battery_remaining: 80,
                voltage_battery: 22_000,
                ..Default::default()
            }),
            147 => MavMessage::BATTERY_STATUS(BATTERY_STATUS_DATA {
                battery_remaining: 80,
                ..Default::default()
            }),
            148 => MavMessage::AUTOPILOT_VERSION(AUTOPILOT_VERSION_DATA {
                flight_sw_version: self.version,
                ..Default::default()
            }),
            _ => return None,
        };
        Some(message)
    }

    pub fn step(&mut self, now: Instant) {
        self.offsets_on &= self.armed && self.custom_mode == 4;
        if self.heartbeat_at <= now {
            self.heartbeat_at = now + Duration::from_secs(1);
            self.beat();
        }
        if let Some((_, command)) = self.under_way.take_if(|(at, _)| *at <= now) {
            let result = self.obey(&command, now);
            self.answer(command.command, result);
        }
        let due: Vec<u32> =
            self.intervals.iter().filter(|(_, (_, at))| *at <= now).map(|(id, _)| *id).collect();
        for id in due {
            if let Some((interval, at)) = self.intervals.get_mut(&id) {
                *at = *at + interval.mul_f64(self.slowness);
            }
            if !self.mute.contains(&id) {
                let message = self.telemetry(id, now);
                self.out.extend(message);
            }
        }
        let patience_s = self.parameters.get("COM_OF_LOSS_T").map_or(1.0, |(value, _)| f64::from(*value));
        let lost =
            self.setpoint_at.is_none_or(|at| now.saturating_since(at) > Duration::from_secs_f64(patience_s));
        if self.firmware == Firmware::Px4 && self.custom_mode == PX4_OFFBOARD && lost && self.armed {
            self.custom_mode = PX4_LOITER;
            self.lapsed = true;
            self.beat();
        }
        match self.body.take() {
            Some(mut body) => {
                body.step(self, STEP.as_secs_f64());
                self.body = Some(body);
            }
            None => self.fly(),
        }
    }

    fn fly(&mut self) {
        if let Some(z) = self.climb_to {
            self.target = Some(Vector3::new(self.position.x, self.position.y, z));
            if (self.position.z - z).abs() < 0.1 {
                self.climb_to = None;
            }
        }
        if self.custom_mode == PX4_LAND || self.custom_mode == 9 {
            self.target = Some(Vector3::new(self.position.x, self.position.y, 0.0));
        }
        let (true, Some(target)) = (self.armed, self.target) else { return };
        let way = target - self.position;
        let step = 3.0 * STEP.as_secs_f64();
        self.position += if way.norm() > step { way * (step / way.norm()) } else { way };
        if self.position.z < -0.3 {
            self.landed = MavLandedState::MAV_LANDED_STATE_IN_AIR;
        } else if self.landed == MavLandedState::MAV_LANDED_STATE_IN_AIR && self.position.z > -0.05 {
            self.landed = MavLandedState::MAV_LANDED_STATE_ON_GROUND;
            self.armed = false;
        }
    }

    /// Sends a heartbeat now.
    pub fn beat(&mut self) {
        self.out.push_back(self.heartbeat());
    }

    fn heartbeat(&self) -> MavMessage {
        let mut base_mode = MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED;
        if self.armed {
            base_mode |= MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED;
        }
        MavMessage::HEARTBEAT(HEARTBEAT_DATA {
            custom_mode: self.custom_mode,
            mavtype: MavType::MAV_TYPE_OCTOROTOR,
            autopilot: match self.firmware {
                Firmware::Px4 => MavAutopilot::MAV_AUTOPILOT_PX4,
                Firmware::ArduPilot => MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA,
            },
            base_mode,
            system_status: MavState::MAV_STATE_STANDBY,
            mavlink_version: 3,
        })
    }
}
