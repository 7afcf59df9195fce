//! Where each mode takes the vehicle.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::{MavLandedState, MavSeverity};
use nalgebra::{UnitQuaternion, Vector3};

use super::super::router::Router;
use super::{Autopilot, Mode, Sensed};
use crate::vehicle::config::Firmware;
use crate::vehicle::control::{SpeedLimits, Target};

/// Contact for this long is landed.
const LANDED_AFTER: Duration = Duration::from_secs(1);
/// Above this height it has left the ground.
const LIFT_OFF_M: f64 = 0.3;
/// Take-off and return count as arrived within this distance.
const ARRIVED_M: f64 = 0.4;
const TAKEOFF_CLIMB_M_S: f64 = 3.0;
/// Descent far above the ground; below `LAND_SLOW_M` it slows down to the landing speed.
const LAND_FAST_M_S: f64 = 3.0;
const LAND_SLOW_M: f64 = 10.0;
/// A quick landing still meets the ground with a speed that the gear takes.
const LAND_MINIMUM_M_S: f64 = 0.2;

/// What the motors shall do.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Guidance {
    Off,
    Fly(Target, SpeedLimits),
}

/// What a mode remembers.
#[derive(Debug, Clone)]
pub(super) struct Flight {
    hold_enu_m: Vector3<f64>,
    heading_rad: f64,
    /// A take-off that has been ordered and is not over.
    pub takeoff_altitude_enu_m: Option<f64>,
    /// Landing gear in contact since.
    contact_since: Option<Duration>,
    armed_at: Duration,
    /// Has left the ground since arming.
    flown: bool,
    /// The return to launch has reached home.
    over_home: bool,
}

impl Flight {
    pub fn at(position_enu_m: Vector3<f64>, heading_rad: f64) -> Self {
        Self {
            hold_enu_m: position_enu_m,
            heading_rad,
            takeoff_altitude_enu_m: None,
            contact_since: Some(Duration::ZERO),
            armed_at: Duration::ZERO,
            flown: false,
            over_home: false,
        }
    }

    pub fn hold_here(&mut self, position_enu_m: Vector3<f64>, heading_rad: f64) {
        self.hold_enu_m = position_enu_m;
        self.heading_rad = heading_rad;
        self.takeoff_altitude_enu_m = None;
        self.over_home = false;
    }

    /// The point to hold, and the heading there if it shall change.
    pub fn go_to(&mut self, position_enu_m: Vector3<f64>, heading_rad: Option<f64>) {
        self.hold_here(position_enu_m, heading_rad.unwrap_or(self.heading_rad));
    }

    pub fn taking_off(&self) -> bool {
        self.takeoff_altitude_enu_m.is_some()
    }

    /// Armed, with the take-off that had been ordered before, if any.
    pub fn begin(&mut self, now: Duration, takeoff_altitude_enu_m: Option<f64>) {
        self.takeoff_altitude_enu_m = takeoff_altitude_enu_m;
        self.armed_at = now;
        self.flown = false;
    }

    pub fn end(&mut self) {
        self.takeoff_altitude_enu_m = None;
    }

    fn level(&self) -> UnitQuaternion<f64> {
        UnitQuaternion::from_axis_angle(&Vector3::z_axis(), self.heading_rad)
    }

    fn hold(&self) -> Target {
        let p = self.hold_enu_m;
        Target {
            position_enu_m: [Some(p.x), Some(p.y), Some(p.z)],
            velocity_enu_m_s: [None; 3],
            attitude: self.level(),
        }
    }
}

impl Autopilot {
    pub(super) fn landed_state(&self) -> MavLandedState {
        match (self.landed, self.mode) {
            (true, _) => MavLandedState::MAV_LANDED_STATE_ON_GROUND,
            (false, Mode::Land) => MavLandedState::MAV_LANDED_STATE_LANDING,
            (false, _) if self.flight.taking_off() => MavLandedState::MAV_LANDED_STATE_TAKEOFF,
            (false, _) => MavLandedState::MAV_LANDED_STATE_IN_AIR,
        }
    }

    /// Lift-off, touch-down, and the disarming that follows it.
    pub(super) fn watch_land(&mut self, sensed: &Sensed, router: &mut Router) {
        let flight = &mut self.flight;
        if !sensed.contact {
            flight.contact_since = None;
            if sensed.position_enu_m.z > self.home_enu_m.z + LIFT_OFF_M && self.landed {
                self.landed = false;
                flight.flown = true;
            }
            return;
        }
        let since = *flight.contact_since.get_or_insert(sensed.now);
        self.landed |= sensed.now.saturating_sub(since) >= LANDED_AFTER;
        if !self.armed || !self.landed {
            return;
        }
        let landing = self.mode == Mode::Land || (self.mode == Mode::ReturnToLaunch && self.flight.over_home);
        let (after_s, from) = match (self.firmware, self.flight.flown) {
            (Firmware::Px4, true) => (self.parameters.real("COM_DISARM_LAND"), since),
            (Firmware::Px4, false) => (self.parameters.real("COM_DISARM_PRFLT"), self.flight.armed_at),
            (Firmware::ArduCopter, _) if landing => (0.0, since),
            (Firmware::ArduCopter, _) => {
                (self.parameters.real("DISARM_DELAY"), since.max(self.flight.armed_at))
            }
        };
        // Zero or less switches PX4's off; a take-off that has been ordered keeps the motors on.
        let wanted = after_s > 0.0 || landing && self.firmware == Firmware::ArduCopter;
        let waited = sensed.now.saturating_sub(from).as_secs_f32() >= after_s;
        if wanted && waited && !self.flight.taking_off() {
            self.disarm();
            self.text(MavSeverity::MAV_SEVERITY_INFO, "Disarmed by landing", router);
        }
    }

    fn limits(&self) -> SpeedLimits {
        let real = |name: &str| f64::from(self.parameters.real(name)).max(0.1);
        match self.firmware {
            Firmware::Px4 => SpeedLimits {
                horizontal_m_s: real("MPC_XY_VEL_MAX"),
                up_m_s: real("MPC_Z_VEL_MAX_UP"),
                down_m_s: real("MPC_Z_VEL_MAX_DN"),
            },
            Firmware::ArduCopter => SpeedLimits {
                horizontal_m_s: real("WPNAV_SPEED") / 100.0,
                up_m_s: real("WPNAV_SPEED_UP") / 100.0,
                down_m_s: real("WPNAV_SPEED_DN") / 100.0,
            },
        }
    }

    /// The present mode's target.
    pub(super) fn guide(&mut self, sensed: &Sensed, router: &mut Router) -> Guidance {
        if !self.armed {
            return Guidance::Off;
        }
        let limits = self.limits();
        if self.flight.taking_off() && [Mode::Takeoff, Mode::Companion].contains(&self.mode) {
            return self.take_off(sensed, limits, router);
        }
        match self.mode {
            Mode::Companion => self.follow(sensed, limits),
            Mode::Land => self.land(sensed, limits),
            Mode::ReturnToLaunch => self.come_home(sensed, limits),
            // On the ground, sticks down.
            _ if self.landed => Guidance::Off,
            _ => Guidance::Fly(self.flight.hold(), limits),
        }
    }

    fn take_off(&mut self, sensed: &Sensed, limits: SpeedLimits, router: &mut Router) -> Guidance {
        let altitude = self.flight.takeoff_altitude_enu_m.unwrap_or(sensed.position_enu_m.z);
        self.flight.hold_enu_m.z = altitude;
        if (sensed.position_enu_m.z - altitude).abs() < ARRIVED_M {
            self.flight.takeoff_altitude_enu_m = None;
            if self.mode == Mode::Takeoff {
                self.mode = Mode::Hold;
                self.text(MavSeverity::MAV_SEVERITY_INFO, "Takeoff completed", router);
            }
        }
        Guidance::Fly(
            self.flight.hold(),
            SpeedLimits { up_m_s: limits.up_m_s.min(TAKEOFF_CLIMB_M_S), ..limits },
        )
    }

    /// The companion's setpoints.
    fn follow(&mut self, sensed: &Sensed, limits: SpeedLimits) -> Guidance {
        let timeout_name = match self.firmware {
            Firmware::Px4 => "COM_OF_LOSS_T",
            Firmware::ArduCopter => "GUID_TIMEOUT",
        };
        let timeout = self.parameters.seconds(timeout_name);
        let mut target = self.flight.hold();
        if let Some(setpoint) = &self.offboard.setpoint {
            let stale = sensed.now.saturating_sub(setpoint.at) > timeout;
            if let Some(heading) = setpoint.heading_rad {
                self.flight.heading_rad = heading;
                target.attitude = self.flight.level();
            }
            // ArduCopter keeps a position for ever, and stops a velocity.
            if !stale || setpoint.has_position() {
                target.position_enu_m = setpoint.position_at(sensed.now);
                target.velocity_enu_m_s = if stale { [None; 3] } else { setpoint.velocity };
            } else {
                target.position_enu_m = [None; 3];
            }
        } else if self.landed && self.firmware == Firmware::ArduCopter {
            return Guidance::Off;
        }
        if let Some((attitude, at)) = self.offboard.attitude {
            // Old roll and pitch are levelled; the heading stays.
            if sensed.now.saturating_sub(at) <= timeout {
                target.attitude = attitude;
            }
        }
        Guidance::Fly(target, limits)
    }

    fn land(&mut self, sensed: &Sensed, limits: SpeedLimits) -> Guidance {
        let slow = match self.firmware {
            Firmware::Px4 => f64::from(self.parameters.real("MPC_LAND_SPEED")),
            Firmware::ArduCopter => f64::from(self.parameters.real("LAND_SPEED")) / 100.0,
        };
        let slow = slow.clamp(LAND_MINIMUM_M_S, LAND_FAST_M_S);
        let height = (sensed.position_enu_m.z - self.home_enu_m.z).max(0.0);
        let part = (height / LAND_SLOW_M).min(1.0);
        let mut target = self.flight.hold();
        target.position_enu_m[2] = None;
        target.velocity_enu_m_s[2] = Some(-(slow + (LAND_FAST_M_S - slow) * part));
        Guidance::Fly(target, limits)
    }

    /// Up to the return altitude, across, down.
    fn come_home(&mut self, sensed: &Sensed, limits: SpeedLimits) -> Guidance {
        if self.flight.over_home {
            return self.land(sensed, limits);
        }
        let above_m = match self.firmware {
            Firmware::Px4 => f64::from(self.parameters.real("RTL_RETURN_ALT")),
            Firmware::ArduCopter => f64::from(self.parameters.real("RTL_ALT")) / 100.0,
        };
        let altitude = (self.home_enu_m.z + above_m).max(self.flight.hold_enu_m.z);
        let mut target = self.flight.hold();
        target.position_enu_m[2] = Some(altitude);
        if sensed.position_enu_m.z > altitude - 1.0 {
            target.position_enu_m[0] = Some(self.home_enu_m.x);
            target.position_enu_m[1] = Some(self.home_enu_m.y);
        }
        if (sensed.position_enu_m.xy() - self.home_enu_m.xy()).norm() < ARRIVED_M {
            self.flight.over_home = true;
            self.flight.hold_enu_m = Vector3::new(self.home_enu_m.x, self.home_enu_m.y, altitude);
        }
        Guidance::Fly(target, limits)
    }
}
