//! Where each mode takes the vehicle.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::MavSeverity;
use nalgebra::{UnitQuaternion, Vector3};

use super::super::router::Router;
use super::shaper::{Motion, Shaper};
use super::tuning::Tuning;
use super::{Autopilot, Mode, Sensed};
use crate::vehicle::TICK;
use crate::vehicle::config::Firmware;
use crate::vehicle::control::{SpeedLimits, Target, ThrustTarget};

/// Take-off and return count as arrived within this distance.
const ARRIVED_M: f64 = 0.4;
const TAKEOFF_CLIMB_M_S: f64 = 3.0;
/// Descent far above the ground; below `LAND_SLOW_M` it slows down to the landing speed.
const LAND_FAST_M_S: f64 = 3.0;
const LAND_SLOW_M: f64 = 10.0;
/// How long a velocity is kept where that is no trap.
const VELOCITY_KEPT: Duration = Duration::from_millis(100);
/// Without sticks the real program went 23 m sideways and 10 m down in 15 s.
const DRIFT_ENU_M_S: [f64; 3] = [1.5, 0.0, -0.67];
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
    /// Left to sticks that nobody holds.
    drifts: bool,
}

impl Flight {
    pub fn at(position_enu_m: Vector3<f64>, heading_rad: f64) -> Self {
        Self {
            hold_enu_m: position_enu_m,
            heading_rad,
            takeoff_altitude_enu_m: None,
            over_home: false,
            drifts: false,
        }
    }

    pub fn hold_here(&mut self, position_enu_m: Vector3<f64>, heading_rad: f64) {
        self.hold_enu_m = position_enu_m;
        self.heading_rad = heading_rad;
        self.takeoff_altitude_enu_m = None;
        self.over_home = false;
        self.drifts = false;
    }

    /// Nobody holds the sticks.
    pub fn drift(&mut self) {
        self.drifts = true;
    }

    fn drifting(&self) -> Target {
        Target {
            position_enu_m: [None; 3],
            velocity_enu_m_s: DRIFT_ENU_M_S.map(Some),
            attitude: self.level(),
        }
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
            _ if self.flight.drifts => Guidance::Fly(self.flight.drifting(), limits),
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
            if self.firmware == Firmware::ArduCopter
                && self.traps.targets_shaped
                && setpoint.has_whole_position()
                && (!stale || self.traps.position_kept)
            {
                let goes_on = if self.traps.velocity_kept { timeout } else { timeout.min(VELOCITY_KEPT) };
                let aim = setpoint.motion_at(sensed.now, goes_on);
                return self.follow_shaped(target, &aim, sensed);
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
        self.shaper = None;
        target.attitude = self.attitude_wanted(target.attitude, sensed.now);
        Guidance::Fly(target, limits)
    }

    /// ArduCopter's own target on its way after the companion's.
    fn follow_shaped(&mut self, mut target: Target, aim: &Motion, sensed: &Sensed) -> Guidance {
        let Tuning { limits, shaping, .. } = &self.tuning;
        let starts = Shaper::at(sensed.position_enu_m, sensed.velocity_enu_m_s);
        let own = self.shaper.get_or_insert(starts).step(aim, shaping, limits, TICK.as_secs_f64());
        target.position_enu_m = <[f64; 3]>::from(own.position_m).map(Some);
        target.velocity_enu_m_s = <[f64; 3]>::from(own.velocity_m_s).map(Some);
        // The limits are those of what is corrected, beside the target's own motion.
        let limits = SpeedLimits {
            horizontal_m_s: limits.horizontal_m_s + own.velocity_m_s.xy().norm(),
            up_m_s: limits.up_m_s + own.velocity_m_s.z.abs(),
            down_m_s: limits.down_m_s + own.velocity_m_s.z.abs(),
        };
        target.attitude = self.attitude_wanted(target.attitude, sensed.now);
        Guidance::Fly(target, limits)
    }

    /// The body's attitude apart from its position, where something asks for one.
    fn attitude_wanted(&self, level: UnitQuaternion<f64>, now: Duration) -> UnitQuaternion<f64> {
        if let Some(attitude) = self.with_offsets(self.flight.heading_rad, now) {
            return attitude;
        }
        // Old roll and pitch are levelled; the heading stays.
        let fresh = |at| now.saturating_sub(at) <= self.tuning.stream_timeout;
        match self.offboard.attitude {
            Some((attitude, at)) if fresh(at) => attitude,
            _ => level,
        }
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
        // ArduCopter stays below its ceiling, as far as that needs no descent.
        let above_m = self.highest_return_m().map_or(above_m, |most_m| above_m.min(most_m));
        let altitude = (self.home_enu_m.z + above_m).max(self.flight.hold_enu_m.z);
        let goal = self.return_enu_m;
        let mut target = self.flight.hold();
        target.position_enu_m[2] = Some(altitude);
        if sensed.position_enu_m.z > altitude - 1.0 {
            target.position_enu_m[0] = Some(goal.x);
            target.position_enu_m[1] = Some(goal.y);
        }
        if (sensed.position_enu_m.xy() - goal.xy()).norm() < ARRIVED_M {
            self.flight.over_home = true;
            self.flight.hold_enu_m = Vector3::new(goal.x, goal.y, altitude);
        }
        Guidance::Fly(target, limits)
    }
}
