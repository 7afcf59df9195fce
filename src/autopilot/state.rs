//! What is known of the vehicle, each item with the instant at which it was received.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::MavType;

use super::boot_clock::BootTime;
use super::event::EstimatorFault;
use super::firmware::{Firmware, Mode};
use crate::geo::{Attitude, Enu, EnuVelocity, Geodetic, LocalFrame};
use crate::time::Instant;

/// A value and when it was received.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Timed<T> {
    /// The value.
    pub value: T,
    /// When the message that carried it arrived.
    pub received_at: Instant,
}

impl<T> Timed<T> {
    pub(super) fn new(value: T, received_at: Instant) -> Self {
        Self { value, received_at }
    }

    /// Time since it was received.
    pub fn age(&self, now: Instant) -> Duration {
        now.saturating_since(self.received_at)
    }
}

/// A value that the autopilot has stamped with its own time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sampled<T> {
    /// The value.
    pub value: T,
    /// The autopilot's time when it was taken.
    pub taken: BootTime,
    /// When the message that carried it arrived.
    pub received_at: Instant,
}

impl<T> Sampled<T> {
    pub(super) fn new(value: T, taken: BootTime, received_at: Instant) -> Self {
        Self { value, taken, received_at }
    }
}

/// Where the autopilot's land detector sees the vehicle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Landed {
    /// On the ground.
    OnGround,
    /// Flying.
    InAir,
    /// Leaving the ground.
    TakingOff,
    /// Coming down.
    Landing,
}

/// The weakest battery, as SYS_STATUS and BATTERY_STATUS report them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Battery {
    /// Charge left, in [0, 1].
    pub remaining: Option<f64>,
    /// Voltage in volts.
    pub voltage_v: Option<f64>,
    /// How long it lasts from now on, as the autopilot forecasts it.
    pub lasts: Option<Duration>,
}

/// A firmware's version: major, minor, patch.
pub type Version = (u8, u8, u8);

/// What is known of the vehicle. `None`: not heard yet, or forgotten after a restart of the autopilot.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct VehicleState {
    /// The autopilot's system id.
    pub system: Option<u8>,
    /// The autopilot's firmware.
    pub firmware: Option<Firmware>,
    /// The firmware's version.
    pub version: Option<Version>,
    /// The kind of vehicle, from HEARTBEAT.
    pub vehicle_type: Option<MavType>,
    /// The estimator's position in the mission frame, in metres.
    pub position_enu_m: Option<Sampled<Enu>>,
    /// The estimator's velocity in m/s, ENU.
    pub velocity_enu_m_s: Option<Timed<EnuVelocity>>,
    /// The estimator's attitude.
    pub attitude: Option<Sampled<Attitude>>,
    /// Whether the motors are armed.
    pub armed: Option<Timed<bool>>,
    /// The flight mode.
    pub mode: Option<Timed<Mode>>,
    /// Whether the last heartbeat showed a failsafe at work: MAV_STATE_CRITICAL, or worse.
    pub in_failsafe: bool,
    /// What the land detector says.
    pub landed: Option<Timed<Landed>>,
    /// The autopilot's home (where it launched) in the mission frame, in metres.
    pub home_enu_m: Option<Timed<Enu>>,
    /// The battery.
    pub battery: Option<Timed<Battery>>,
    /// Whether the GPS receiver is healthy.
    pub gps_ok: Option<Timed<bool>>,
    /// What is wrong by the flags of the estimator and the health of the sensors, if anything.
    pub estimator: Option<Timed<Result<(), EstimatorFault>>>,
    /// Whether the autopilot's own pre-arm checks pass, where it says so.
    pub prearm_ok: Option<Timed<bool>>,
    /// The origin of the autopilot's local frame.
    pub local_origin: Option<Timed<Geodetic>>,
    /// A position from GLOBAL_POSITION_INT in the mission frame, in metres: a second opinion on the local origin.
    pub global_position_enu_m: Option<Timed<Enu>>,
}

impl VehicleState {
    /// Whether the last heartbeat showed the motors armed.
    #[must_use]
    pub fn is_armed(&self) -> bool {
        self.armed.is_some_and(|armed| armed.value)
    }

    /// Whether the last heartbeat showed them disarmed; `false` while none was heard.
    #[must_use]
    pub fn is_disarmed(&self) -> bool {
        self.armed.is_some_and(|armed| !armed.value)
    }

    /// When the older of position and attitude was received; `None` while one is unknown.
    pub(super) fn pose_received_at(&self) -> Option<Instant> {
        Some(self.position_enu_m?.received_at.min(self.attitude?.received_at))
    }

    /// When the older of them was taken, by the autopilot's clock.
    pub(super) fn pose_taken(&self) -> Option<BootTime> {
        Some(self.position_enu_m?.taken.min(self.attitude?.taken))
    }

    /// The mode of the last heartbeat.
    #[must_use]
    pub fn mode(&self) -> Option<Mode> {
        self.mode.map(|mode| mode.value)
    }

    /// Whether the land detector last said that the vehicle flies; `None` if it never spoke.
    #[must_use]
    pub fn is_airborne(&self) -> Option<bool> {
        self.landed.map(|landed| landed.value != Landed::OnGround)
    }

    /// The autopilot's local frame seen from the mission's, once its origin is known.
    #[must_use]
    pub fn local_frame(&self, mission: Geodetic) -> Option<LocalFrame> {
        let projection = self.firmware.map(Firmware::projection).unwrap_or_default();
        self.local_origin.map(|origin| LocalFrame { mission, autopilot: origin.value, projection })
    }
}
