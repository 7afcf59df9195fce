//! The stream of setpoints: each goes out once, at the instant that it is for, and what it looks like on the wire.

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

/// The stream of setpoints. It has no clock of its own: who sets setpoints sets the pace.
#[derive(Debug)]
pub(super) struct Stream {
    actuation: Actuation,
    /// Time that the first setpoint of a stream stands for.
    period: Duration,
    lifetime: Duration,
    tilt_rate_rad_s: f64,
    set_at: Option<Instant>,
    run: Option<Run>,
    control: PositionControl,
    /// The thrust that rises until the vehicle leaves the ground.
    spool: Option<f64>,
}

/// Setpoints that have gone out without a gap.
#[derive(Debug, Clone, Copy)]
struct Run {
    since: Instant,
    sent_at: Instant,
    commanded: Attitude,
}

impl Stream {
    pub(super) fn new(settings: &Settings) -> Self {
        Self {
            actuation: settings.actuation,
            period: settings.period(),
            lifetime: settings.setpoint_lifetime,
            tilt_rate_rad_s: settings.tilt_rate_rad_s,
            set_at: None,
            run: None,
            control: PositionControl::new(settings.position_control),
            spool: None,
        }
    }

    /// Ends the stream: the next one begins anew, with what the controller had integrated forgotten.
    pub(super) fn stop(&mut self) {
        self.set_at = None;
        self.run = None;
        self.spool = None;
        self.control.reset();
    }

    /// How long setpoints have gone out without a gap.
    pub(super) fn streamed_for(&self, now: Instant) -> Duration {
        let run = self.run.filter(|run| now.saturating_since(run.sent_at) <= self.lifetime);
        run.map_or(Duration::ZERO, |run| now.saturating_since(run.since))
    }

    /// Takes a setpoint for `now` and sends it in the form that actuation and firmware ask for. The attitude that it
    /// commands; `None` if nothing went out: without surroundings none may, and what is not finite is no setpoint.
    pub(super) fn set(
        &mut self,
        setpoint: &Setpoint,
        around: Option<&Surroundings>,
        now: Instant,
        out: &mut Outbox,
    ) -> Option<Attitude> {
        if !setpoint.is_finite() {
            return None;
        }
        if self.set_at.is_some_and(|at| now.saturating_since(at) > self.lifetime) {
            self.stop();
        }
        self.set_at = Some(now);
        let Some(around) = around else {
            self.run = None;
            return None;
        };
        Some(self.send(setpoint, around, now, out))
    }

    /// Takes the scales of the thrust axes from the rotors.
    pub(super) fn learn_scales(&mut self, thrust_n: [f64; 3]) {
        self.control.learn_scales(thrust_n);
    }

    /// The thrust command that hovers, as learned so far.
    pub(super) fn hover_thrust(&self) -> f64 {
        self.control.hover_thrust()
    }

    fn send(
        &mut self,
        setpoint: &Setpoint,
        around: &Surroundings,
        now: Instant,
        out: &mut Outbox,
    ) -> Attitude {
        let dt_s = self.run.map_or(self.period, |run| now.saturating_since(run.sent_at)).as_secs_f64();
        let attitude = self.ramp(setpoint.attitude, around, dt_s);
        let since = self.run.map_or(now, |run| run.since);
        self.run = Some(Run { since, sent_at: now, commanded: attitude });
        match self.actuation {
            Actuation::ThrustVector => out.send(self.thrust_vector(setpoint, attitude, around, dt_s, now)),
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
    fn ramp(&self, wanted: Attitude, around: &Surroundings, dt_s: f64) -> Attitude {
        let level = Attitude::from_euler(0.0, 0.0, wanted.euler().2);
        let wanted = if around.may_tilt { wanted } else { level };
        let from = self.run.map_or(around.measured.attitude, |run| run.commanded);
        let angle = from.angle_to(&wanted);
        let step = self.tilt_rate_rad_s * dt_s;
        if angle <= step { wanted } else { from.slerp(&wanted, step / angle) }
    }

    fn thrust_vector(
        &mut self,
        wanted: &Setpoint,
        attitude: Attitude,
        around: &Surroundings,
        dt_s: f64,
        now: Instant,
    ) -> MavMessage {
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
