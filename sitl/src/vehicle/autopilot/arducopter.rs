//! ArduCopter's own ways with attitudes: angle control, the 6DoF frame, and the script that gives it body offsets.

use std::f64::consts::FRAC_PI_2;
use std::time::Duration;

use mavlink::dialects::ardupilotmega::{MavCmd, MavResult, MavSeverity, SET_ATTITUDE_TARGET_DATA};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use super::super::router::Router;
use super::{Autopilot, Guidance, Mode, Sensed};
use crate::vehicle::config::Firmware;
use crate::vehicle::control::ThrustTarget;
use crate::vehicle::dynamics::GRAVITY_M_S2;

/// FRAME_CLASS of a fully actuated vehicle.
const SIX_DOF: f32 = 16.0;
/// Climb rate error to vertical acceleration, 1/s.
const CLIMB_GAIN_S: f64 = 3.0;
/// A thrust vector that leans further than this is not made up for.
const LEAST_LIFT: f64 = 0.3;
const NORM_TOLERANCE: f64 = 0.01;

/// A target of angle control.
#[derive(Debug, Clone, Copy)]
pub(super) struct Angle {
    pub attitude: UnitQuaternion<f64>,
    /// 0 to 1: a climb rate about 0.5, or throttle itself (GUID_OPTIONS bit 3).
    thrust: f64,
    pub at: Duration,
}

impl Autopilot {
    fn is_six_dof(&self) -> bool {
        self.firmware == Firmware::ArduCopter && self.parameters.real("FRAME_CLASS") == SIX_DOF
    }

    /// SET_ATTITUDE_TARGET where it has a meaning of ArduCopter's own; `false` where it is taken as it is elsewhere.
    pub(super) fn take_angle(
        &mut self,
        m: &SET_ATTITUDE_TARGET_DATA,
        now: Duration,
        router: &mut Router,
    ) -> bool {
        const THROTTLE_IGNORE: u8 = 64;
        const ATTITUDE_IGNORE: u8 = 128;
        let mask = m.type_mask.bits();
        if self.is_six_dof() && self.traps.six_dof_panics && mask & ATTITUDE_IGNORE == 0 {
            let text = "PANIC: quaternions are not supported by this frame";
            self.text(MavSeverity::MAV_SEVERITY_EMERGENCY, text, router);
            self.disarm();
            self.silent_until = Duration::MAX;
            return true;
        }
        if self.firmware != Firmware::ArduCopter || !self.traps.angle_control {
            return false;
        }
        let [w, x, y, z] = m.q.map(f64::from);
        let quaternion = Quaternion::new(w, x, y, z);
        let unit = (quaternion.norm() - 1.0).abs() <= NORM_TOLERANCE;
        if !unit || mask & (THROTTLE_IGNORE | ATTITUDE_IGNORE) != 0 || !m.thrust.is_finite() {
            // Not a word of it.
            self.offboard.counters.invalid += 1;
            self.offboard.stop(now);
            return true;
        }
        let attitude = self.frame.attitude_to_enu(&UnitQuaternion::from_quaternion(quaternion));
        self.offboard.lean(Angle { attitude, thrust: f64::from(m.thrust).clamp(0.0, 1.0), at: now });
        true
    }

    /// Angle control: attitude and climb rate; the position drifts. After GUID_TIMEOUT it levels and holds its height.
    pub(super) fn follow_angle(&self, angle: &Angle, sensed: &Sensed) -> Guidance {
        const THRUST_AS_THRUST: i32 = 8;
        let stale = sensed.now.saturating_sub(angle.at) > self.tuning.stream_timeout;
        let attitude = if stale { self.flight.level() } else { angle.attitude };
        let limits = self.tuning.limits;
        let asked = if stale { 0.0 } else { 2.0 * angle.thrust - 1.0 };
        let climb_m_s = asked * if asked > 0.0 { limits.up_m_s } else { limits.down_m_s };
        let up_m_s2 = CLIMB_GAIN_S * (climb_m_s - sensed.velocity_enu_m_s.z);
        let lift = (sensed.nominal * Vector3::z()).z.max(LEAST_LIFT);
        let direct = !stale && self.parameters.real("GUID_OPTIONS") as i32 & THRUST_AS_THRUST != 0;
        let thrust = if direct {
            angle.thrust
        } else {
            (self.hover_thrust * (1.0 + up_m_s2 / GRAVITY_M_S2) / lift).clamp(0.0, 1.0)
        };
        Guidance::Thrust(ThrustTarget { attitude, thrust_flu: Vector3::new(0.0, 0.0, thrust), rates: None })
    }

    /// The bridge script of a 6DoF frame: roll and pitch of the body (FRD, degrees), and their switch.
    pub(super) fn command_offsets(&mut self, command: MavCmd, params: [f32; 2]) -> MavResult {
        if !self.is_six_dof() {
            return MavResult::MAV_RESULT_UNSUPPORTED;
        }
        if !params.iter().all(|p| p.is_finite()) {
            return MavResult::MAV_RESULT_DENIED;
        }
        if command == MavCmd::MAV_CMD_USER_4 {
            self.script.want(params.map(|p| f64::from(p).to_radians()));
            return MavResult::MAV_RESULT_ACCEPTED;
        }
        if params[0] != 0.0 && self.mode != Mode::Companion {
            return MavResult::MAV_RESULT_TEMPORARILY_REJECTED;
        }
        self.script.switch(params[0] != 0.0);
        MavResult::MAV_RESULT_ACCEPTED
    }

    /// A command of whatever kind passes by the script. `true` if nobody answers it: it is one of a dead script's.
    pub(super) fn passes_the_script(&mut self, command: MavCmd, now: Duration, router: &mut Router) -> bool {
        if !self.is_six_dof() {
            return false;
        }
        if self.traps.script_dies_of_bursts && self.script.dies_of(now) {
            let text = "Lua: APM/scripts/veilwing.lua exceeded time limit";
            self.text(MavSeverity::MAV_SEVERITY_CRITICAL, text, router);
        }
        self.script.is_dead() && matches!(command, MavCmd::MAV_CMD_USER_4 | MavCmd::MAV_CMD_USER_5)
    }

    /// The attitude of a heading (from east towards north) with the script's offsets, if they are on.
    pub(super) fn with_offsets(&self, heading_rad: f64, now: Duration) -> Option<UnitQuaternion<f64>> {
        let [roll, pitch] = self.script.offsets_rad(!self.traps.script_without_guard, now)?;
        let ned = UnitQuaternion::from_euler_angles(roll, pitch, FRAC_PI_2 - heading_rad);
        Some(self.frame.attitude_to_enu(&ned))
    }
}
