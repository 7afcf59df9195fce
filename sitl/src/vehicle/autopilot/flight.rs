//! Where each mode takes the vehicle.

use mavlink::dialects::ardupilotmega::MavSeverity;
use nalgebra::{UnitQuaternion, Vector3};

use super::super::router::Router;
use super::{Autopilot, Mode, Sensed};
use crate::vehicle::config::Firmware;
use crate::vehicle::control::{SpeedLimits, Target, ThrustTarget};

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
    /// PX4: the companion's own thrust.
    Thrust(ThrustTarget),
}

/// What a mode remembers.
#[derive(Debug, Clone)]
pub(super) struct Flight {
    hold_enu_m: Vector3<f64>,
    heading_rad: f64,
    /// A take-off that has been ordered and is not over.
    pub takeoff_altitude_enu_m: Option<f64>,
    /// The return to launch has reached home.
    over_home: bool,
}

impl Flight {
    pub fn at(position_enu_m: Vector3<f64>, heading_rad: f64) -> Self {
        Self { hold_enu_m: position_enu_m, heading_rad, takeoff_altitude_enu_m: None, over_home: false }
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

    /// The return to launch has reached home.
    pub fn over_home(&self) -> bool {
        self.over_home
    }

    pub fn end(&mut self) {
        self.takeoff_altitude_enu_m = None;
    }

    pub fn level(&self) -> UnitQuaternion<f64> {
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
    /// The present mode's target.
    pub(super) fn guide(&mut self, sensed: &Sensed, router: &mut Router) -> Guidance {
        if !self.armed {
            return Guidance::Off;
        }
        let limits = self.tuning.limits;
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

    /// What a dead script has left behind, in whatever mode.
    pub(super) fn tilted_by_the_dead(&self, guidance: Guidance, sensed: &Sensed) -> Guidance {
        match guidance {
            Guidance::Fly(mut target, limits) if self.script.is_dead() => {
                if let Some(attitude) = self.with_offsets(self.flight.heading_rad, sensed.now) {
                    target.attitude = attitude;
                }
                Guidance::Fly(target, limits)
            }
            other => other,
        }
    }

    /// The companion's setpoints.
    fn follow(&mut self, sensed: &Sensed, limits: SpeedLimits) -> Guidance {
        if let Some(target) = self.offboard.thrust {
            return Guidance::Thrust(target);
        }
        if let Some(angle) = &self.offboard.angle {
            return self.follow_angle(angle, sensed);
        }
        let timeout = self.tuning.stream_timeout;
        let mut target = self.flight.hold();
        if let Some(setpoint) = &self.offboard.setpoint {
            let stale = sensed.now.saturating_sub(setpoint.at) > timeout;
            if let Some(heading) = setpoint.heading_rad {
                self.flight.heading_rad = heading;
                target.attitude = self.flight.level();
            }
            // ArduCopter keeps a position for ever, and stops a velocity.
            if !stale || setpoint.has_position() && self.traps.position_kept {
                target.position_enu_m = setpoint.position_at(sensed.now);
                target.velocity_enu_m_s = if stale { [None; 3] } else { setpoint.velocity };
            } else {
                target.position_enu_m = [None; 3];
            }
        } else if self.landed && self.firmware == Firmware::ArduCopter {
            return Guidance::Off;
        }
        if let Some(attitude) = self.with_offsets(self.flight.heading_rad, sensed.now) {
            target.attitude = attitude;
        } else if let Some((attitude, at)) = self.offboard.attitude {
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
