//! The autopilot's telemetry into [`VehicleState`], and what in it is not to be trusted.

use std::time::Duration;

use mavlink::MessageData;
use mavlink::dialects::ardupilotmega as mav;
use mavlink::dialects::ardupilotmega::{
    EkfStatusFlags, EstimatorStatusFlags, GpsFixType, MavLandedState, MavMessage, MavSysStatusSensor,
};

use super::batteries::{self, Batteries};
use super::boot_clock::{BootClock, BootTime};
use super::clock::UtcEstimate;
use super::event::{EstimatorFault, Event};
use super::firmware::Firmware;
use super::outbox::Outbox;
use super::state::{Battery, Landed, Sampled, Timed, VehicleState};
use crate::geo::{Attitude, Enu, EnuVelocity, Geodetic, LocalFrame, Ned, NedVelocity, has_meaning};
use crate::time::Instant;

/// The origin may be refined by this much on the ground or in flight without being another one.
const ORIGIN_TOLERANCE_M: f64 = 0.5;
/// A variance of ArduPilot's estimator at which it calls itself failed (FS_EKF_THRESH is below).
const EKF_VARIANCE_LIMIT: f32 = 1.0;
/// A horizontal position that PX4's estimator itself gives no better than this says nothing of where an antenna points, in
/// metres, one standard deviation. With GPS alone it states 0.2 to 1 m.
const ACCURACY_LIMIT_M: f32 = 2.0;
/// A receiver that is not heard of for so long has no fix. SYS_STATUS says of it only whether it talks.
const GPS_SILENT: Duration = Duration::from_secs(3);

/// Reads telemetry.
#[derive(Debug, Clone)]
pub(super) struct Telemetry {
    mission: Geodetic,
    position_jump_m: f64,
    pub(super) state: VehicleState,
    pub(super) utc: UtcEstimate,
    pub(super) clock: BootClock,
    /// The last local position and velocity with the autopilot's own time, for the jump test.
    last_local: Option<(Ned, NedVelocity, BootTime)>,
    /// By the estimator's flags, and by the sensors' health, once they are heard.
    estimator_flags: Option<Result<(), EstimatorFault>>,
    sensors: Option<Result<(), EstimatorFault>>,
    /// By the GPS receiver's own word, once it is heard, and when it was.
    gps: Option<Timed<Result<(), EstimatorFault>>>,
    batteries: Batteries,
}

impl Telemetry {
    pub(super) fn new(mission: Geodetic, position_jump_m: f64) -> Self {
        Self {
            mission,
            position_jump_m,
            state: VehicleState::default(),
            utc: UtcEstimate::default(),
            clock: BootClock::default(),
            last_local: None,
            estimator_flags: None,
            sensors: None,
            gps: None,
            batteries: Batteries::default(),
        }
    }

    /// Forgets everything but the autopilot's identity.
    pub(super) fn forget(&mut self) {
        let VehicleState { system, firmware, .. } = self.state;
        self.state = VehicleState { system, firmware, ..VehicleState::default() };
        self.utc.clear();
        self.clock.clear();
        self.last_local = None;
        self.estimator_flags = None;
        self.sensors = None;
        self.gps = None;
        self.batteries = Batteries::default();
    }

    /// Whether this message shows that the autopilot has restarted.
    pub(super) fn shows_restart(&self, message: &MavMessage, now: Instant) -> bool {
        boot_ms(message).is_some_and(|stamp| self.clock.shows_restart(stamp, now))
    }

    pub(super) fn handle(&mut self, message: &MavMessage, now: Instant, out: &mut Outbox) {
        if let Some(stamp) = boot_ms(message) {
            let taken = self.clock.hear(stamp, now);
            match message {
                MavMessage::LOCAL_POSITION_NED(m) => self.local_position(m, taken, now, out),
                MavMessage::ATTITUDE_QUATERNION(m) => self.attitude(m, taken, now, out),
                _ => {}
            }
        }
        match message {
            MavMessage::TIMESYNC(m) => self.clock.handle_timesync(m, now),
            MavMessage::GLOBAL_POSITION_INT(m) => {
                let point = Geodetic::of_wire(m.lat, m.lon, m.alt);
                self.state.global_position_enu_m = Some(Timed::new(point.to_enu(self.mission), now));
            }
            MavMessage::GPS_GLOBAL_ORIGIN(m) => {
                self.origin(Geodetic::of_wire(m.latitude, m.longitude, m.altitude), now, out)
            }
            MavMessage::HOME_POSITION(m) => {
                let home = Geodetic::of_wire(m.latitude, m.longitude, m.altitude).to_enu(self.mission);
                self.state.home_enu_m = Some(Timed::new(home, now));
            }
            MavMessage::SYSTEM_TIME(m) => self.utc.handle_system_time(m.time_unix_usec, now),
            MavMessage::EXTENDED_SYS_STATE(m) => self.landed(m.landed_state, now, out),
            MavMessage::SYS_STATUS(m) => self.sys_status(m, now, out),
            MavMessage::BATTERY_STATUS(m) => {
                self.batteries.take(m, now);
                self.weigh_batteries(now);
            }
            MavMessage::GPS_RAW_INT(m) => {
                let fixed = m.fix_type as u32 >= GpsFixType::GPS_FIX_TYPE_3D_FIX as u32;
                self.receiver((!fixed).then_some("no 3D fix"), now, out);
            }
            MavMessage::ESTIMATOR_STATUS(m) => {
                self.estimator(mav::ESTIMATOR_STATUS_DATA::NAME, estimator_status_fault(m), now, out);
            }
            MavMessage::EKF_STATUS_REPORT(m) => {
                self.estimator(mav::EKF_STATUS_REPORT_DATA::NAME, ekf_status_fault(m), now, out);
            }
            MavMessage::AUTOPILOT_VERSION(m) => {
                let [_, patch, minor, major] = m.flight_sw_version.to_le_bytes();
                self.state.version = Some((major, minor, patch));
            }
            _ => {}
        }
    }

    fn local_position(
        &mut self,
        m: &mav::LOCAL_POSITION_NED_DATA,
        taken: BootTime,
        now: Instant,
        out: &mut Outbox,
    ) {
        let local = Ned::new(m.x.into(), m.y.into(), m.z.into());
        let velocity = NedVelocity::new(m.vx.into(), m.vy.into(), m.vz.into());
        if !(has_meaning(&local.vector()) && has_meaning(&velocity.vector())) {
            fault(out, EstimatorFault::NotFinite { message: mav::LOCAL_POSITION_NED_DATA::NAME });
            return;
        }
        // A copy, or one that was overtaken, tells nothing new.
        if self.last_local.is_some_and(|(.., last)| taken <= last) {
            return;
        }
        if let Some((last, last_velocity, last_taken)) = self.last_local {
            let span_s = taken.seconds_since(last_taken).clamp(0.0, 5.0);
            let flown = 0.5 * span_s * (velocity.vector() + last_velocity.vector());
            let distance_m = (local.vector() - last.vector() - flown).norm();
            // Over a gap in the telemetry the vehicle may have turned round: allow for 5 m/s of it.
            if distance_m > self.position_jump_m + 5.0 * span_s {
                fault(out, EstimatorFault::Jump { distance_m });
            }
        }
        self.last_local = Some((local, velocity, taken));
        self.state.velocity_enu_m_s = Some(Timed::new(velocity.into(), now));
        if let Some(frame) = self.state.local_frame(self.mission) {
            self.state.position_enu_m = Some(Sampled::new(frame.position_to_enu(local), taken, now));
        }
    }

    fn attitude(
        &mut self,
        m: &mav::ATTITUDE_QUATERNION_DATA,
        taken: BootTime,
        now: Instant,
        out: &mut Outbox,
    ) {
        let is_old = self.state.attitude.is_some_and(|last| taken <= last.taken);
        match Attitude::from_mavlink([m.q1.into(), m.q2.into(), m.q3.into(), m.q4.into()]) {
            Some(_) if is_old => {}
            Some(attitude) => self.state.attitude = Some(Sampled::new(attitude, taken, now)),
            None => fault(out, EstimatorFault::NotFinite { message: mav::ATTITUDE_QUATERNION_DATA::NAME }),
        }
    }

    fn origin(&mut self, origin: Geodetic, now: Instant, out: &mut Outbox) {
        if origin.lat_deg == 0.0 && origin.lon_deg == 0.0 {
            return; // an origin that was never set
        }
        if let Some(before) = self.state.local_origin {
            let distance_m = origin.to_enu(before.value).norm();
            if distance_m > ORIGIN_TOLERANCE_M {
                // Local coordinates mean something else now: what was known in them is void.
                self.state.position_enu_m = None;
                self.last_local = None;
                if self.state.is_armed() {
                    fault(out, EstimatorFault::OriginMoved { distance_m });
                }
            }
        }
        self.state.local_origin = Some(Timed::new(origin, now));
    }

    fn landed(&mut self, landed: MavLandedState, now: Instant, out: &mut Outbox) {
        let landed = match landed {
            MavLandedState::MAV_LANDED_STATE_ON_GROUND => Landed::OnGround,
            MavLandedState::MAV_LANDED_STATE_IN_AIR => Landed::InAir,
            MavLandedState::MAV_LANDED_STATE_TAKEOFF => Landed::TakingOff,
            MavLandedState::MAV_LANDED_STATE_LANDING => Landed::Landing,
            MavLandedState::MAV_LANDED_STATE_UNDEFINED => return,
        };
        let was_flying = self.state.landed.is_some_and(|before| before.value != Landed::OnGround);
        if was_flying && landed == Landed::OnGround {
            out.tell(Event::Landed);
        }
        self.state.landed = Some(Timed::new(landed, now));
    }

    fn sys_status(&mut self, m: &mav::SYS_STATUS_DATA, now: Instant, out: &mut Outbox) {
        let healthy = |sensor: MavSysStatusSensor| {
            let enabled = m.onboard_control_sensors_present.contains(sensor)
                && m.onboard_control_sensors_enabled.contains(sensor);
            enabled.then(|| m.onboard_control_sensors_health.contains(sensor))
        };
        let timed = |value: bool| Timed::new(value, now);
        if self.gps.is_none() {
            self.state.gps_ok = healthy(MavSysStatusSensor::MAV_SYS_STATUS_SENSOR_GPS).map(timed);
        }
        let prearm = MavSysStatusSensor::MAV_SYS_STATUS_PREARM_CHECK;
        let prearm_ok = match self.state.firmware {
            // It says so in the health alone.
            Some(Firmware::Px4) => Some(m.onboard_control_sensors_health.contains(prearm)),
            Some(Firmware::ArduPilot) | None => healthy(prearm),
        };
        self.state.prearm_ok = prearm_ok.map(timed);
        self.batteries.take_all(Battery {
            remaining: batteries::charge(m.battery_remaining),
            voltage_v: (m.voltage_battery != u16::MAX && m.voltage_battery != 0)
                .then(|| f64::from(m.voltage_battery) * 1e-3),
            lasts: None,
        });
        self.weigh_batteries(now);
        let failed = [
            (MavSysStatusSensor::MAV_SYS_STATUS_AHRS, "the attitude and position estimate is unhealthy"),
            (MavSysStatusSensor::MAV_SYS_STATUS_SENSOR_3D_GYRO, "the gyroscope is unhealthy"),
            (MavSysStatusSensor::MAV_SYS_STATUS_SENSOR_3D_ACCEL, "the accelerometer is unhealthy"),
            (MavSysStatusSensor::MAV_SYS_STATUS_SENSOR_GPS, "the GPS receiver is unhealthy"),
        ]
        .into_iter()
        .find(|(sensor, _)| healthy(*sensor) == Some(false));
        let message = mav::SYS_STATUS_DATA::NAME;
        let health = failed.map_or(Ok(()), |(_, what)| Err(EstimatorFault::Flags { message, what }));
        if let (Some(Ok(())), Err(wrong)) = (self.sensors.replace(health), health) {
            fault(out, wrong);
        }
        self.sum_up(now);
    }

    fn weigh_batteries(&mut self, now: Instant) {
        self.state.battery = self.batteries.weakest(now).map(|battery| Timed::new(battery, now));
    }

    /// Does what is due at `now`.
    pub(super) fn advance(&mut self, now: Instant, out: &mut Outbox) {
        if self.timeout().is_some_and(|at| at <= now) {
            self.receiver(Some("not heard for 3 s"), now, out);
        }
    }

    /// When [`Self::advance`] is next to be called.
    pub(super) fn timeout(&self) -> Option<Instant> {
        self.gps.filter(|gps| gps.value.is_ok()).map(|gps| gps.received_at + GPS_SILENT)
    }

    fn receiver(&mut self, what: Option<&'static str>, now: Instant, out: &mut Outbox) {
        let message = mav::GPS_RAW_INT_DATA::NAME;
        let word = what.map_or(Ok(()), |what| Err(EstimatorFault::Flags { message, what }));
        let before = self.gps.replace(Timed::new(word, now));
        if let (Some(Ok(())), Err(wrong)) = (before.map(|before| before.value), word) {
            fault(out, wrong);
        }
        self.state.gps_ok = Some(Timed::new(word.is_ok(), now));
        self.sum_up(now);
    }

    fn estimator(
        &mut self,
        message: &'static str,
        what: Option<&'static str>,
        now: Instant,
        out: &mut Outbox,
    ) {
        let flags = what.map_or(Ok(()), |what| Err(EstimatorFault::Flags { message, what }));
        // Not good from the start is not ready; the preflight says so. Good turned bad is a failure.
        if let (Some(Ok(())), Err(wrong)) = (self.estimator_flags.replace(flags), flags) {
            fault(out, wrong);
        }
        self.sum_up(now);
    }

    fn sum_up(&mut self, now: Instant) {
        let others = self.sensors.unwrap_or(Ok(())).and(self.gps.map_or(Ok(()), |gps| gps.value));
        let estimator = match (self.estimator_flags, others) {
            (Some(flags), others) => flags.and(others),
            (None, Err(wrong)) => Err(wrong),
            (None, Ok(())) => return,
        };
        self.state.estimator = Some(Timed::new(estimator, now));
    }

    /// The position now in the autopilot's frame, for setpoints.
    pub(super) fn frame(&self) -> Option<LocalFrame> {
        self.state.local_frame(self.mission)
    }

    /// Position and velocity if both are known.
    pub(super) fn motion(&self) -> Option<(Enu, EnuVelocity)> {
        Some((self.state.position_enu_m?.value, self.state.velocity_enu_m_s?.value))
    }
}

/// What a message that carries the autopilot's own time is stamped by.
fn boot_ms(message: &MavMessage) -> Option<u32> {
    match message {
        MavMessage::SYSTEM_TIME(m) => Some(m.time_boot_ms),
        MavMessage::LOCAL_POSITION_NED(m) => Some(m.time_boot_ms),
        MavMessage::ATTITUDE_QUATERNION(m) => Some(m.time_boot_ms),
        MavMessage::GLOBAL_POSITION_INT(m) => Some(m.time_boot_ms),
        _ => None,
    }
}

fn fault(out: &mut Outbox, fault: EstimatorFault) {
    out.tell(Event::EstimatorFailure(fault));
}

/// Of PX4. ESTIMATOR_CONST_POS_MODE is no fault: it also says that the vehicle is at rest, which it goes on to say after
/// lift-off; a position that is assumed for want of a better one is no absolute position either.
fn estimator_status_fault(m: &mav::ESTIMATOR_STATUS_DATA) -> Option<&'static str> {
    let flags = [
        (EstimatorStatusFlags::ESTIMATOR_ATTITUDE, true, "no attitude"),
        (EstimatorStatusFlags::ESTIMATOR_VELOCITY_HORIZ, true, "no horizontal velocity"),
        (EstimatorStatusFlags::ESTIMATOR_VELOCITY_VERT, true, "no vertical velocity"),
        (EstimatorStatusFlags::ESTIMATOR_POS_HORIZ_ABS, true, "no absolute horizontal position"),
        (EstimatorStatusFlags::ESTIMATOR_POS_VERT_ABS, true, "no absolute altitude"),
        (EstimatorStatusFlags::ESTIMATOR_GPS_GLITCH, false, "GPS glitch"),
        (EstimatorStatusFlags::ESTIMATOR_ACCEL_ERROR, false, "accelerometer error"),
    ]
    .into_iter()
    .find(|(flag, should_be, _)| m.flags.contains(*flag) != *should_be)
    .map(|(_, _, what)| what);
    flags.or((m.pos_horiz_accuracy > ACCURACY_LIMIT_M).then_some("horizontal position is worse than 2 m"))
}

fn ekf_status_fault(m: &mav::EKF_STATUS_REPORT_DATA) -> Option<&'static str> {
    let bad_variance = |v: f32| !v.is_finite() || v >= EKF_VARIANCE_LIMIT;
    let flags = [
        (EkfStatusFlags::EKF_ATTITUDE, true, "no attitude"),
        (EkfStatusFlags::EKF_VELOCITY_HORIZ, true, "no horizontal velocity"),
        (EkfStatusFlags::EKF_VELOCITY_VERT, true, "no vertical velocity"),
        (EkfStatusFlags::EKF_POS_HORIZ_ABS, true, "no absolute horizontal position"),
        (EkfStatusFlags::EKF_POS_VERT_ABS, true, "no absolute altitude"),
        (EkfStatusFlags::EKF_CONST_POS_MODE, false, "position is assumed constant"),
        (EkfStatusFlags::EKF_GPS_GLITCHING, false, "GPS glitch"),
        (EkfStatusFlags::EKF_UNINITIALIZED, false, "not initialised"),
    ]
    .into_iter()
    .find(|(flag, should_be, _)| m.flags.contains(*flag) != *should_be)
    .map(|(_, _, what)| what);
    flags.or_else(|| {
        [
            (m.velocity_variance, "velocity variance"),
            (m.pos_horiz_variance, "horizontal position variance"),
            (m.pos_vert_variance, "altitude variance"),
        ]
        .into_iter()
        .find(|(variance, _)| bad_variance(*variance))
        .map(|(_, what)| what)
    })
}
