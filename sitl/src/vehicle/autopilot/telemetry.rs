//! What the autopilot tells: messages from its state.

use mavlink::MessageData;
use mavlink::dialects::ardupilotmega::*;
use nalgebra::{UnitQuaternion, Vector3};

use super::modes::Mode;
use super::{Autopilot, Sensed};
use crate::vehicle::airframe::Airframe;
use crate::vehicle::config::Firmware;

fn f32x3(v: Vector3<f64>) -> [f32; 3] {
    [v.x as f32, v.y as f32, v.z as f32]
}

/// (w, x, y, z).
fn wxyz(q: &UnitQuaternion<f64>) -> [f32; 4] {
    [q.w as f32, q.i as f32, q.j as f32, q.k as f32]
}

impl Autopilot {
    /// The message of an id from the present state; `None` where this firmware has none, or the estimator no value.
    pub(super) fn message(&self, id: u32, sensed: &Sensed) -> Option<MavMessage> {
        let px4 = self.firmware == Firmware::Px4;
        let ms = self.uptime(sensed.now).as_millis() as u32;
        let position_valid = self.estimator_ok;
        Some(match id {
            HEARTBEAT_DATA::ID => self.heartbeat(),
            AUTOPILOT_VERSION_DATA::ID => self.version(),
            // ArduCopter has none, and says so.
            PROTOCOL_VERSION_DATA::ID if px4 => MavMessage::PROTOCOL_VERSION(PROTOCOL_VERSION_DATA {
                version: 200,
                min_version: 100,
                max_version: 200,
                ..PROTOCOL_VERSION_DATA::DEFAULT
            }),
            ATTITUDE_DATA::ID => self.attitude_message(sensed, ms),
            ATTITUDE_QUATERNION_DATA::ID => self.quaternion_message(sensed, ms),
            LOCAL_POSITION_NED_DATA::ID if position_valid => self.local_position(sensed, ms),
            GLOBAL_POSITION_INT_DATA::ID if position_valid => self.global_position(sensed, ms),
            GPS_GLOBAL_ORIGIN_DATA::ID => self.origin_message(sensed),
            HOME_POSITION_DATA::ID => self.home_message(sensed),
            SYSTEM_TIME_DATA::ID => MavMessage::SYSTEM_TIME(SYSTEM_TIME_DATA {
                time_unix_usec: self.utc_us(sensed.now),
                time_boot_ms: ms,
            }),
            SYS_STATUS_DATA::ID => self.system_status(sensed),
            BATTERY_STATUS_DATA::ID => self.battery_status(sensed),
            EXTENDED_SYS_STATE_DATA::ID => MavMessage::EXTENDED_SYS_STATE(EXTENDED_SYS_STATE_DATA {
                vtol_state: MavVtolState::MAV_VTOL_STATE_UNDEFINED,
                landed_state: self.landed_state(),
            }),
            ESTIMATOR_STATUS_DATA::ID if px4 => self.estimator_status(sensed),
            EKF_STATUS_REPORT_DATA::ID if !px4 => MavMessage::EKF_STATUS_REPORT(EKF_STATUS_REPORT_DATA {
                flags: EkfStatusFlags::from_bits_truncate(self.estimator_flags()),
                ..EKF_STATUS_REPORT_DATA::DEFAULT
            }),
            GPS_RAW_INT_DATA::ID => self.gps_raw(sensed),
            VFR_HUD_DATA::ID => {
                let v = sensed.velocity_enu_m_s;
                MavMessage::VFR_HUD(VFR_HUD_DATA {
                    airspeed: v.norm() as f32,
                    groundspeed: v.xy().norm() as f32,
                    alt: self.frame.geodetic(sensed.position_enu_m).alt_amsl_m as f32,
                    climb: v.z as f32,
                    heading: (self.heading_cdeg(sensed) / 100) as i16,
                    throttle: if self.armed { 50 } else { 0 },
                })
            }
            _ => return None,
        })
    }

    pub(super) fn heartbeat(&self) -> MavMessage {
        let mut base_mode =
            MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | MavModeFlag::MAV_MODE_FLAG_STABILIZE_ENABLED;
        match self.mode {
            Mode::Companion => base_mode |= MavModeFlag::MAV_MODE_FLAG_GUIDED_ENABLED,
            Mode::Stabilize | Mode::Position => base_mode |= MavModeFlag::MAV_MODE_FLAG_MANUAL_INPUT_ENABLED,
            _ => {
                base_mode |=
                    MavModeFlag::MAV_MODE_FLAG_GUIDED_ENABLED | MavModeFlag::MAV_MODE_FLAG_AUTO_ENABLED;
            }
        }
        base_mode.set(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED, self.armed);
        MavMessage::HEARTBEAT(HEARTBEAT_DATA {
            custom_mode: self.mode.custom(self.firmware),
            mavtype: match self.airframe {
                Airframe::Omnidirectional => MavType::MAV_TYPE_OCTOROTOR,
                Airframe::Conventional => MavType::MAV_TYPE_QUADROTOR,
            },
            autopilot: match self.firmware {
                Firmware::Px4 => MavAutopilot::MAV_AUTOPILOT_PX4,
                Firmware::ArduCopter => MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA,
            },
            base_mode,
            system_status: match (self.estimator_ok && !self.failsafe, self.armed) {
                (false, true) => MavState::MAV_STATE_CRITICAL,
                (true, true) => MavState::MAV_STATE_ACTIVE,
                (_, false) => MavState::MAV_STATE_STANDBY,
            },
            mavlink_version: 3,
        })
    }

    fn version(&self) -> MavMessage {
        use MavProtocolCapability as Can;
        let encoding = match self.firmware {
            Firmware::Px4 => Can::MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE,
            Firmware::ArduCopter => Can::MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST,
        };
        // Major, minor, patch, and 255 for a release.
        let flight_sw_version = match self.firmware {
            Firmware::Px4 => 0x0110_00FF,
            Firmware::ArduCopter => 0x0406_03FF,
        };
        MavMessage::AUTOPILOT_VERSION(AUTOPILOT_VERSION_DATA {
            capabilities: encoding
                | Can::MAV_PROTOCOL_CAPABILITY_MAVLINK2
                | Can::MAV_PROTOCOL_CAPABILITY_PARAM_FLOAT
                | Can::MAV_PROTOCOL_CAPABILITY_MISSION_INT
                | Can::MAV_PROTOCOL_CAPABILITY_COMMAND_INT
                | Can::MAV_PROTOCOL_CAPABILITY_SET_ATTITUDE_TARGET
                | Can::MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
                | Can::MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_GLOBAL_INT,
            uid: u64::from(self.system_id),
            flight_sw_version,
            ..AUTOPILOT_VERSION_DATA::DEFAULT
        })
    }

    fn attitude_message(&self, sensed: &Sensed, time_boot_ms: u32) -> MavMessage {
        let (roll, pitch, yaw) = self.frame.attitude_to_ned(&sensed.attitude).euler_angles();
        let [rollspeed, pitchspeed, yawspeed] = f32x3(frd(sensed.rates_flu_rad_s));
        MavMessage::ATTITUDE(ATTITUDE_DATA {
            time_boot_ms,
            roll: roll as f32,
            pitch: pitch as f32,
            yaw: yaw as f32,
            rollspeed,
            pitchspeed,
            yawspeed,
        })
    }

    fn quaternion_message(&self, sensed: &Sensed, time_boot_ms: u32) -> MavMessage {
        let [q1, q2, q3, q4] = wxyz(&self.frame.attitude_to_ned(&sensed.attitude));
        let [rollspeed, pitchspeed, yawspeed] = f32x3(frd(sensed.rates_flu_rad_s));
        MavMessage::ATTITUDE_QUATERNION(ATTITUDE_QUATERNION_DATA {
            time_boot_ms,
            q1,
            q2,
            q3,
            q4,
            rollspeed,
            pitchspeed,
            yawspeed,
            repr_offset_q: [0.0; 4],
        })
    }

    fn local_position(&self, sensed: &Sensed, time_boot_ms: u32) -> MavMessage {
        let [x, y, z] = f32x3(self.frame.position_to_ned(sensed.position_enu_m));
        let [vx, vy, vz] = f32x3(self.frame.vector_to_ned(sensed.velocity_enu_m_s));
        MavMessage::LOCAL_POSITION_NED(LOCAL_POSITION_NED_DATA { time_boot_ms, x, y, z, vx, vy, vz })
    }

    /// NED yaw in hundredths of a degree, 0 to 35999.
    fn heading_cdeg(&self, sensed: &Sensed) -> u16 {
        let (_, _, yaw) = self.frame.attitude_to_ned(&sensed.attitude).euler_angles();
        (yaw.to_degrees().rem_euclid(360.0) * 100.0) as u16 % 36_000
    }

    fn global_position(&self, sensed: &Sensed, time_boot_ms: u32) -> MavMessage {
        let (lat, lon, alt) = self.frame.geodetic(sensed.position_enu_m).to_wire();
        let v = self.frame.vector_to_ned(sensed.velocity_enu_m_s) * 100.0;
        MavMessage::GLOBAL_POSITION_INT(GLOBAL_POSITION_INT_DATA {
            time_boot_ms,
            lat,
            lon,
            alt,
            relative_alt: ((sensed.position_enu_m.z - self.home_enu_m.z) * 1000.0) as i32,
            vx: v.x as i16,
            vy: v.y as i16,
            vz: v.z as i16,
            hdg: self.heading_cdeg(sensed),
        })
    }

    fn origin_message(&self, sensed: &Sensed) -> MavMessage {
        let (latitude, longitude, altitude) = self.frame.origin.to_wire();
        MavMessage::GPS_GLOBAL_ORIGIN(GPS_GLOBAL_ORIGIN_DATA {
            latitude,
            longitude,
            altitude,
            time_usec: self.uptime(sensed.now).as_micros() as u64,
        })
    }

    fn home_message(&self, sensed: &Sensed) -> MavMessage {
        let (latitude, longitude, altitude) = self.frame.geodetic(self.home_enu_m).to_wire();
        let [x, y, z] = f32x3(self.frame.position_to_ned(self.home_enu_m));
        MavMessage::HOME_POSITION(HOME_POSITION_DATA {
            latitude,
            longitude,
            altitude,
            x,
            y,
            z,
            q: [1.0, 0.0, 0.0, 0.0],
            time_usec: self.uptime(sensed.now).as_micros() as u64,
            ..HOME_POSITION_DATA::DEFAULT
        })
    }

    fn system_status(&self, sensed: &Sensed) -> MavMessage {
        use MavSysStatusSensor as Has;
        let mut present = Has::MAV_SYS_STATUS_SENSOR_3D_GYRO
            | Has::MAV_SYS_STATUS_SENSOR_3D_ACCEL
            | Has::MAV_SYS_STATUS_SENSOR_3D_MAG
            | Has::MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE
            | Has::MAV_SYS_STATUS_SENSOR_GPS
            | Has::MAV_SYS_STATUS_AHRS
            | Has::MAV_SYS_STATUS_SENSOR_BATTERY
            | Has::MAV_SYS_STATUS_PREARM_CHECK;
        let mut health = present;
        // PX4 says it in the health alone.
        present.set(Has::MAV_SYS_STATUS_PREARM_CHECK, self.firmware == Firmware::ArduCopter);
        health.set(Has::MAV_SYS_STATUS_AHRS, self.estimator_ok);
        // That a receiver talks is all that either firmware says here.
        let talks = self.traps.gps_health_is_talk;
        health.set(Has::MAV_SYS_STATUS_SENSOR_GPS, talks || self.estimator_ok && self.gps_ok);
        // No fence is a fence that is not breached: ArduCopter says so, and ground stations take its word.
        health.set(Has::MAV_SYS_STATUS_GEOFENCE, self.firmware == Firmware::ArduCopter);
        health.set(Has::MAV_SYS_STATUS_PREARM_CHECK, self.unready(sensed.now).is_none());
        MavMessage::SYS_STATUS(SYS_STATUS_DATA {
            onboard_control_sensors_present: present,
            onboard_control_sensors_enabled: present,
            onboard_control_sensors_health: health,
            load: 250,
            voltage_battery: millivolts(sensed.battery) * BATTERY_CELLS,
            current_battery: if self.armed { 3000 } else { 100 },
            battery_remaining: (sensed.battery * 100.0) as i8,
            ..SYS_STATUS_DATA::DEFAULT
        })
    }

    fn battery_status(&self, sensed: &Sensed) -> MavMessage {
        let mut voltages = [u16::MAX; 10];
        voltages[..usize::from(BATTERY_CELLS)].fill(millivolts(sensed.battery));
        MavMessage::BATTERY_STATUS(BATTERY_STATUS_DATA {
            current_consumed: -1,
            energy_consumed: -1,
            temperature: i16::MAX,
            voltages,
            current_battery: if self.armed { 3000 } else { 100 },
            battery_function: MavBatteryFunction::MAV_BATTERY_FUNCTION_ALL,
            mavtype: MavBatteryType::MAV_BATTERY_TYPE_LIPO,
            battery_remaining: (sensed.battery * 100.0) as i8,
            charge_state: match sensed.battery {
                b if b < 0.1 => MavBatteryChargeState::MAV_BATTERY_CHARGE_STATE_CRITICAL,
                b if b < 0.2 => MavBatteryChargeState::MAV_BATTERY_CHARGE_STATE_LOW,
                _ => MavBatteryChargeState::MAV_BATTERY_CHARGE_STATE_OK,
            },
            ..BATTERY_STATUS_DATA::DEFAULT
        })
    }

    /// The flags that ESTIMATOR_STATUS and EKF_STATUS_REPORT share: attitude, velocities, positions, predictions.
    fn estimator_flags(&self) -> u16 {
        const ATTITUDE: u16 = 1;
        const ALL_VALID: u16 = 1 | 2 | 4 | 8 | 16 | 32 | 256 | 512;
        if self.estimator_ok { ALL_VALID } else { ATTITUDE }
    }

    fn estimator_status(&self, sensed: &Sensed) -> MavMessage {
        let mut flags = EstimatorStatusFlags::from_bits_truncate(self.estimator_flags());
        // What PX4 calls so is a vehicle at rest, as well as one whose position is not known.
        let at_rest = sensed.now < self.ground.rests_until || !self.estimator_ok;
        flags.set(EstimatorStatusFlags::ESTIMATOR_CONST_POS_MODE, at_rest);
        MavMessage::ESTIMATOR_STATUS(ESTIMATOR_STATUS_DATA {
            time_usec: self.uptime(sensed.now).as_micros() as u64,
            vel_ratio: 0.05,
            pos_horiz_ratio: if self.estimator_ok { 0.05 } else { 2.0 },
            pos_vert_ratio: 0.05,
            mag_ratio: 0.05,
            pos_horiz_accuracy: if self.estimator_ok { 0.3 } else { 50.0 },
            pos_vert_accuracy: 0.4,
            flags,
            ..ESTIMATOR_STATUS_DATA::DEFAULT
        })
    }

    fn gps_raw(&self, sensed: &Sensed) -> MavMessage {
        let (lat, lon, alt) = self.frame.geodetic(sensed.position_enu_m).to_wire();
        let ok = self.estimator_ok && self.gps_ok;
        MavMessage::GPS_RAW_INT(GPS_RAW_INT_DATA {
            time_usec: self.uptime(sensed.now).as_micros() as u64,
            lat,
            lon,
            alt,
            eph: 80,
            epv: 120,
            vel: (sensed.velocity_enu_m_s.xy().norm() * 100.0) as u16,
            cog: u16::MAX,
            fix_type: if ok { GpsFixType::GPS_FIX_TYPE_3D_FIX } else { GpsFixType::GPS_FIX_TYPE_NO_FIX },
            satellites_visible: if ok { 14 } else { 3 },
            ..GPS_RAW_INT_DATA::DEFAULT
        })
    }
}

const BATTERY_CELLS: u16 = 6;

/// A lithium cell's voltage over its charge, as a straight line.
fn millivolts(charge: f64) -> u16 {
    (3300.0 + 900.0 * charge.clamp(0.0, 1.0)) as u16
}

/// Body rates, FLU to FRD.
fn frd(flu: Vector3<f64>) -> Vector3<f64> {
    Vector3::new(flu.x, -flu.y, -flu.z)
}
