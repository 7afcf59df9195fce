//! The stream of setpoints: when one is due, and what it looks like on the wire.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::{
    AttitudeTargetTypemask, MavFrame, MavMessage, PositionTargetTypemask, SET_ATTITUDE_TARGET_DATA,
    SET_POSITION_TARGET_LOCAL_NED_DATA,
};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use super::firmware::Firmware;
use super::position_control::{Measured, PositionControl};
use super::settings::{Actuation, Setpoint, Settings};
use super::{Address, Outbox};
use crate::geo::{Attitude, LocalFrame, swap_enu_ned};
use crate::time::Instant;

/// Thrust while armed on the ground.
const IDLE_THRUST: f64 = 0.05;
/// How fast thrust rises to find the one that lifts the vehicle, 1/s.
const SPOOL_RATE_S: f64 = 0.2;

/// What the stream needs to know of the vehicle at a tick.
#[derive(Debug, Clone, Copy)]
pub(super) struct Surroundings {
    pub(super) firmware: Firmware,
    pub(super) target: Address,
    pub(super) frame: LocalFrame,
    /// Fresh position, velocity and attitude.
    pub(super) measured: Measured,
    /// On the ground and not taking off: no more than idle thrust.
    pub(super) idle: bool,
    /// Taking off and still on the ground: thrust rises until the vehicle leaves it.
    pub(super) lifting: bool,
    /// Off the ground: what the controller learns means something.
    pub(super) flying: bool,
    /// Whether the attitude may leave the level.
    pub(super) may_tilt: bool,
}

/// The current setpoint and its stream.
#[derive(Debug)]
pub(super) struct Stream {
    actuation: Actuation,
    period: Duration,
    lifetime: Duration,
    tilt_rate_rad_s: f64,
    setpoint: Option<(Setpoint, Instant)>,
    tick_at: Option<Instant>,
    /// Since when setpoints have gone out at every tick.
    since: Option<Instant>,
    commanded: Option<Attitude>,
    control: PositionControl,
    /// The thrust that rises until the vehicle leaves the ground.
    spool: Option<f64>,
}

impl Stream {
    pub(super) fn new(settings: &Settings) -> Self {
        Self {
            actuation: settings.actuation,
            period: settings.period(),
            lifetime: settings.setpoint_lifetime,
            tilt_rate_rad_s: settings.tilt_rate_rad_s,
            setpoint: None,
            tick_at: None,
            since: None,
            commanded: None,
            control: PositionControl::new(settings.position_control),
            spool: None,
        }
    }

    /// A new setpoint, good for its lifetime. One that is not finite is none at all.
    pub(super) fn set(&mut self, setpoint: Setpoint, now: Instant) {
        if !setpoint.is_finite() {
            return;
        }
        self.setpoint = Some((setpoint, now + self.lifetime));
        self.tick_at.get_or_insert(now);
    }

    /// Forgets the setpoint: nothing is streamed until there is a new one.
    pub(super) fn stop(&mut self) {
        self.setpoint = None;
        self.tick_at = None;
        self.interrupt();
        self.spool = None;
        self.control.reset();
    }

    fn interrupt(&mut self) {
        self.since = None;
        self.commanded = None;
    }

    /// How long setpoints have gone out without a gap.
    pub(super) fn streamed_for(&self, now: Instant) -> Duration {
        self.since.map_or(Duration::ZERO, |since| now.saturating_since(since))
    }

    pub(super) fn timeout(&self) -> Option<Instant> {
        self.tick_at
    }

    /// The setpoint of this tick if one is due and alive. Ticks keep to their deadlines; missed ones are left out.
    pub(super) fn due(&mut self, now: Instant) -> Option<Setpoint> {
        let at = self.tick_at.filter(|at| *at <= now)?;
        let Some((setpoint, _)) = self.setpoint.filter(|(_, expires_at)| now < *expires_at) else {
            self.stop();
            return None;
        };
        let next = at + self.period;
        self.tick_at = Some(if next > now { next } else { now + self.period });
        Some(setpoint)
    }

    /// Takes the scales of the thrust axes from the rotors.
    pub(super) fn learn_scales(&mut self, thrust_n: [f64; 3]) {
        self.control.learn_scales(thrust_n);
    }

    /// The thrust command that hovers, as learned so far.
    pub(super) fn hover_thrust(&self) -> f64 {
        self.control.hover_thrust()
    }

    /// Nothing may be sent at this tick: the stream has a gap.
    pub(super) fn skip(&mut self) {
        self.interrupt();
    }

    /// Sends one setpoint in the form that actuation and firmware ask for. The attitude that it commands.
    pub(super) fn send(
        &mut self,
        setpoint: &Setpoint,
        around: &Surroundings,
        now: Instant,
        out: &mut Outbox,
    ) -> Attitude {
        self.since.get_or_insert(now);
        let attitude = self.ramp(setpoint.attitude, around);
        match self.actuation {
            Actuation::ThrustVector => out.send(self.thrust_vector(setpoint, attitude, around, now)),
            Actuation::Position => out.send(position(setpoint, Some(attitude), around, now)),
            Actuation::Pose => match around.firmware {
                Firmware::Px4 => {
                    out.send(position(setpoint, None, around, now));
                    out.send(MavMessage::SET_ATTITUDE_TARGET(SET_ATTITUDE_TARGET_DATA {
                        type_mask: rates_ignored()
                            | AttitudeTargetTypemask::ATTITUDE_TARGET_TYPEMASK_THROTTLE_IGNORE,
                        ..attitude_target(attitude, around.target, now)
                    }));
                }
                // Never a quaternion: the 6DoF frame panics on it. The heading goes with the position, roll and pitch
                // through the bridge script.
                Firmware::ArduPilot => out.send(position(setpoint, Some(attitude), around, now)),
            },
        }
        attitude
    }

    /// The commanded attitude follows the wanted one at no more than the tilt rate, starting from the measured one.
    fn ramp(&mut self, wanted: Attitude, around: &Surroundings) -> Attitude {
        let level = Attitude::from_euler(0.0, 0.0, wanted.euler().2);
        let wanted = if around.may_tilt { wanted } else { level };
        let from = self.commanded.unwrap_or(around.measured.attitude);
        let angle = from.angle_to(&wanted);
        let step = self.tilt_rate_rad_s * self.period.as_secs_f64();
        let commanded = if angle <= step { wanted } else { from.slerp(&wanted, step / angle) };
        self.commanded = Some(commanded);
        commanded
    }

    fn thrust_vector(
        &mut self,
        wanted: &Setpoint,
        attitude: Attitude,
        around: &Surroundings,
        now: Instant,
    ) -> MavMessage {
        let dt_s = self.period.as_secs_f64();
        let thrust = if around.lifting {
            let spool = self.spool.unwrap_or(IDLE_THRUST) + SPOOL_RATE_S * dt_s;
            Vector3::new(0.0, 0.0, -*self.spool.insert(spool.min(1.0)))
        } else if around.idle {
            Vector3::new(0.0, 0.0, -IDLE_THRUST)
        } else {
            if let Some(lifts) = self.spool.take() {
                self.control.lifted_off(lifts);
            }
            self.control.step(
                wanted.position_enu_m,
                wanted.velocity_enu_m_s,
                &around.measured,
                dt_s,
                around.flying,
            )
        };
        MavMessage::SET_ATTITUDE_TARGET(SET_ATTITUDE_TARGET_DATA {
            type_mask: rates_ignored() | AttitudeTargetTypemask::ATTITUDE_TARGET_TYPEMASK_THRUST_BODY_SET,
            thrust_body: [thrust.x as f32, thrust.y as f32, thrust.z as f32],
            ..attitude_target(attitude, around.target, now)
        })
    }
}

fn rates_ignored() -> AttitudeTargetTypemask {
    AttitudeTargetTypemask::ATTITUDE_TARGET_TYPEMASK_BODY_ROLL_RATE_IGNORE
        | AttitudeTargetTypemask::ATTITUDE_TARGET_TYPEMASK_BODY_PITCH_RATE_IGNORE
        | AttitudeTargetTypemask::ATTITUDE_TARGET_TYPEMASK_BODY_YAW_RATE_IGNORE
}

/// Roll, pitch and heading of the quaternion that MAVLink carries, in radians.
pub(super) fn frd_euler(attitude: Attitude) -> (f64, f64, f64) {
    let [w, x, y, z] = attitude.to_mavlink();
    UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z)).euler_angles()
}

/// The attitude alone; mask and thrust are the caller's.
fn attitude_target(attitude: Attitude, target: Address, now: Instant) -> SET_ATTITUDE_TARGET_DATA {
    SET_ATTITUDE_TARGET_DATA {
        time_boot_ms: boot_ms(now),
        q: attitude.to_mavlink().map(|c| c as f32),
        body_roll_rate: 0.0,
        body_pitch_rate: 0.0,
        body_yaw_rate: 0.0,
        thrust: 0.0,
        target_system: target.0,
        target_component: target.1,
        type_mask: rates_ignored(),
        thrust_body: [0.0; 3],
    }
}

/// Position with velocity feed-forward, and the attitude's heading if given. Groups are whole, as ArduCopter asks.
fn position(
    setpoint: &Setpoint,
    heading_of: Option<Attitude>,
    around: &Surroundings,
    now: Instant,
) -> MavMessage {
    let local = around.frame.position_to_ned(setpoint.position_enu_m);
    let velocity = swap_enu_ned(setpoint.velocity_enu_m_s);
    let mut type_mask = PositionTargetTypemask::POSITION_TARGET_TYPEMASK_AX_IGNORE
        | PositionTargetTypemask::POSITION_TARGET_TYPEMASK_AY_IGNORE
        | PositionTargetTypemask::POSITION_TARGET_TYPEMASK_AZ_IGNORE
        | PositionTargetTypemask::POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE;
    if heading_of.is_none() {
        type_mask |= PositionTargetTypemask::POSITION_TARGET_TYPEMASK_YAW_IGNORE;
    }
    MavMessage::SET_POSITION_TARGET_LOCAL_NED(SET_POSITION_TARGET_LOCAL_NED_DATA {
        time_boot_ms: boot_ms(now),
        x: local.x as f32,
        y: local.y as f32,
        z: local.z as f32,
        vx: velocity.x as f32,
        vy: velocity.y as f32,
        vz: velocity.z as f32,
        afx: 0.0,
        afy: 0.0,
        afz: 0.0,
        yaw: heading_of.map_or(0.0, |attitude| frd_euler(attitude).2 as f32),
        yaw_rate: 0.0,
        type_mask,
        target_system: around.target.0,
        target_component: around.target.1,
        coordinate_frame: MavFrame::MAV_FRAME_LOCAL_NED,
    })
}

/// Milliseconds since our start; wraps after 49 days as MAVLink's does.
fn boot_ms(now: Instant) -> u32 {
    now.since_start().as_millis() as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_body_offsets_turn_the_antenna_as_the_quaternion_does() {
        use std::f64::consts::FRAC_PI_2;
        // The paper's roll is about body x, which FLU and FRD share; pitch and heading change their sign and zero.
        for (roll, pitch, yaw) in [(0.3, 0.0, 0.0), (0.0, 0.4, 0.0), (-0.7, 0.9, 1.1), (1.2, -1.3, -2.0)] {
            let (r, p, h) = frd_euler(Attitude::from_euler(roll, pitch, yaw));
            assert!((r - roll).abs() < 1e-9 && (p + pitch).abs() < 1e-9, "{r} {p}");
            let turn = (h - (FRAC_PI_2 - yaw)).rem_euclid(std::f64::consts::TAU);
            assert!(turn.min(std::f64::consts::TAU - turn) < 1e-9, "{h}");
        }
    }
}
