//! The stream of setpoints: each goes out once, at the instant that it is for, and what it looks like on the wire.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::{
    AttitudeTargetTypemask, MavFrame, MavMessage, PositionTargetTypemask, SET_ATTITUDE_TARGET_DATA,
    SET_POSITION_TARGET_LOCAL_NED_DATA,
};
use nalgebra::Vector3;

use super::outbox::{Address, Outbox};
use super::position_control::{Measured, PositionControl};
use super::settings::{Actuation, Settings};
use crate::geo::{Attitude, Enu, EnuAcceleration, EnuVelocity, LocalFrame, NedAcceleration, NedVelocity};
use crate::time::Instant;

/// Thrust while armed on the ground.
const IDLE_THRUST: f64 = 0.05;
/// How fast thrust rises to find the one that lifts the vehicle, 1/s.
const SPOOL_RATE_S: f64 = 0.2;
/// How long the weight is carried on over state that is too old to close a loop over. After that setpoints end, and the
/// autopilot's own failsafe follows: it knows where it is.
const CARRIES_ON: Duration = Duration::from_millis(500);
/// An attitude so near to the one asked for is that one: at 45 deg/s it is 10 ms.
const AS_ASKED_RAD: f64 = 0.5f64.to_radians();

/// Where the vehicle should be at an instant, in the mission frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Setpoint {
    /// Position in metres, ENU.
    pub position_enu_m: Enu,
    /// Velocity feed-forward in m/s, ENU.
    pub velocity_enu_m_s: EnuVelocity,
    /// Acceleration feed-forward in m/s^2, ENU.
    pub acceleration_enu_m_s2: EnuAcceleration,
    /// Attitude. [`Actuation::Position`] uses its yaw alone.
    pub attitude: Attitude,
}

impl Setpoint {
    /// Whether every number is finite; others are never streamed.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        let q = self.attitude.rotation();
        self.position_enu_m
            .iter()
            .chain(self.velocity_enu_m_s.vector().iter())
            .chain(self.acceleration_enu_m_s2.vector().iter())
            .chain(q.coords.iter())
            .all(|c| c.is_finite())
    }
}

/// How the vehicle stands to the ground.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Footing {
    /// On the ground and not taking off: no more than idle thrust.
    Standing,
    /// Taking off and still on the ground: thrust rises until the vehicle leaves it.
    Lifting,
    /// Off the ground: what the controller learns means something.
    Airborne,
}

/// What the stream needs to know of the vehicle.
#[derive(Debug, Clone, Copy)]
pub(super) struct Surroundings {
    pub(super) target: Address,
    /// A pose goes out as two targets, one of them an attitude.
    pub(super) takes_attitude_targets: bool,
    pub(super) frame: LocalFrame,
    /// Fresh position, velocity and attitude; `None`: too old to close a loop over.
    pub(super) measured: Option<Measured>,
    pub(super) footing: Footing,
    /// Whether the attitude may leave the level.
    pub(super) may_tilt: bool,
}

/// The stream of setpoints. It has no clock of its own: who sets setpoints sets the pace.
#[derive(Debug, Clone)]
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
    /// When state was last fresh.
    measured_at: Instant,
    commanded: Attitude,
    /// What is left from there to the attitude that was asked for, radians.
    short_rad: f64,
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

    /// Ends the stream: the next one begins anew, with what the controller had integrated forgotten. The thrust that was being
    /// raised is kept as the one that lifts: the vehicle may have left the ground on it meanwhile.
    pub(super) fn stop(&mut self) {
        self.set_at = None;
        self.run = None;
        self.control.reset();
        if let Some(lifts) = self.spool.take() {
            self.control.lifted_off(lifts);
        }
    }

    /// How long setpoints have gone out without a gap.
    pub(super) fn streamed_for(&self, now: Instant) -> Duration {
        let run = self.run.filter(|run| now.saturating_since(run.sent_at) <= self.lifetime);
        run.map_or(Duration::ZERO, |run| now.saturating_since(run.since))
    }

    /// Whether the attitude that went out last is the one that was asked for, and not one that the vehicle may not, or cannot yet,
    /// be told to leave.
    pub(super) fn commands_as_asked(&self) -> bool {
        self.run.is_some_and(|run| run.short_rad <= AS_ASKED_RAD)
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
        let sent = around.and_then(|around| match &around.measured {
            Some(measured) => Some(self.send(setpoint, around, measured, now, out)),
            None => self.carry_on(setpoint, around, now, out),
        });
        if sent.is_none() {
            self.run = None;
        }
        sent
    }

    /// Setpoints take this form from now on.
    pub(super) fn choose(&mut self, actuation: Actuation) {
        self.stop();
        self.actuation = actuation;
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
        measured: &Measured,
        now: Instant,
        out: &mut Outbox,
    ) -> Attitude {
        let dt_s = self.run.map_or(self.period, |run| now.saturating_since(run.sent_at)).as_secs_f64();
        let attitude = self.ramp(setpoint.attitude, around.may_tilt, measured, dt_s);
        let since = self.run.map_or(now, |run| run.since);
        let short_rad = attitude.angle_to(&setpoint.attitude);
        self.run = Some(Run { since, sent_at: now, measured_at: now, commanded: attitude, short_rad });
        match self.actuation {
            Actuation::ThrustVector => {
                let thrust = self.thrust(setpoint, around.footing, measured, dt_s);
                out.send(thrust_vector(attitude, thrust, around.target, now));
            }
            Actuation::Position => out.send(position(setpoint, Some(attitude), around, now)),
            Actuation::Pose if around.takes_attitude_targets => {
                out.send(position(setpoint, None, around, now));
                out.send(MavMessage::SET_ATTITUDE_TARGET(SET_ATTITUDE_TARGET_DATA {
                    type_mask: rates_ignored()
                        | AttitudeTargetTypemask::ATTITUDE_TARGET_TYPEMASK_THROTTLE_IGNORE,
                    ..attitude_target(attitude, around.target, now)
                }));
            }
            Actuation::Pose => out.send(position(setpoint, Some(attitude), around, now)),
            // Not chosen yet: nothing is sent in a form that may be another's.
            Actuation::Auto => {}
        }
        attitude
    }

    /// Carries the weight on where no loop can be closed: the attitude commanded last, and the thrust that hovers in it and
    /// holds against the wind learned. An autopilot keeps the last thrust that reaches it, until it misses the next: that of a
    /// vehicle that brakes would throw it back, and fall out of line with an attitude that turns. This one is right on
    /// whichever of these it ends, however late and in whatever order they come. `None` if nothing went out: this
    /// goes on a flight in the air alone, and not for long.
    fn carry_on(
        &mut self,
        setpoint: &Setpoint,
        around: &Surroundings,
        now: Instant,
        out: &mut Outbox,
    ) -> Option<Attitude> {
        let run = self.run.filter(|run| now.saturating_since(run.measured_at) <= CARRIES_ON)?;
        if self.actuation != Actuation::ThrustVector || around.footing != Footing::Airborne {
            return None;
        }
        let short_rad = run.commanded.angle_to(&setpoint.attitude);
        self.run = Some(Run { sent_at: now, short_rad, ..run });
        let thrust = self.control.hover(&run.commanded);
        out.send(thrust_vector(run.commanded, thrust, around.target, now));
        Some(run.commanded)
    }

    /// The commanded attitude follows the wanted one at no more than the tilt rate, starting from the measured one.
    fn ramp(&self, wanted: Attitude, may_tilt: bool, measured: &Measured, dt_s: f64) -> Attitude {
        let level = Attitude::from_euler(0.0, 0.0, wanted.euler().2);
        let wanted = if may_tilt { wanted } else { level };
        let from = self.run.map_or(measured.attitude, |run| run.commanded);
        let angle = from.angle_to(&wanted);
        let step = self.tilt_rate_rad_s * dt_s;
        if angle <= step { wanted } else { from.slerp(&wanted, step / angle) }
    }

    /// The thrust command along body FRD axes.
    fn thrust(
        &mut self,
        wanted: &Setpoint,
        footing: Footing,
        measured: &Measured,
        dt_s: f64,
    ) -> Vector3<f64> {
        match footing {
            Footing::Standing => Vector3::new(0.0, 0.0, -IDLE_THRUST),
            Footing::Lifting => {
                // After a pause no more than after a period: what the last thrust does is not seen yet.
                let spool =
                    self.spool.unwrap_or(IDLE_THRUST) + SPOOL_RATE_S * dt_s.min(self.period.as_secs_f64());
                Vector3::new(0.0, 0.0, -*self.spool.insert(spool.min(1.0)))
            }
            Footing::Airborne => {
                if let Some(lifts) = self.spool.take() {
                    self.control.lifted_off(lifts);
                }
                self.control.step(wanted, measured, dt_s)
            }
        }
    }
}

/// An attitude, and a thrust command along its FRD axes.
fn thrust_vector(attitude: Attitude, thrust: Vector3<f64>, target: Address, now: Instant) -> MavMessage {
    MavMessage::SET_ATTITUDE_TARGET(SET_ATTITUDE_TARGET_DATA {
        type_mask: rates_ignored() | AttitudeTargetTypemask::ATTITUDE_TARGET_TYPEMASK_THRUST_BODY_SET,
        thrust_body: [thrust.x as f32, thrust.y as f32, thrust.z as f32],
        ..attitude_target(attitude, target, now)
    })
}

fn rates_ignored() -> AttitudeTargetTypemask {
    AttitudeTargetTypemask::ATTITUDE_TARGET_TYPEMASK_BODY_ROLL_RATE_IGNORE
        | AttitudeTargetTypemask::ATTITUDE_TARGET_TYPEMASK_BODY_PITCH_RATE_IGNORE
        | AttitudeTargetTypemask::ATTITUDE_TARGET_TYPEMASK_BODY_YAW_RATE_IGNORE
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

/// Position with velocity and acceleration feed-forward, and the attitude's heading if given. Groups are whole, as
/// ArduCopter asks. It follows a position by its own limits of acceleration and jerk, ten metres past the end of a transit
/// if it is not told when that slows down.
fn position(
    setpoint: &Setpoint,
    heading_of: Option<Attitude>,
    around: &Surroundings,
    now: Instant,
) -> MavMessage {
    let local = around.frame.position_to_ned(setpoint.position_enu_m).vector();
    let velocity = NedVelocity::from(setpoint.velocity_enu_m_s).vector();
    let acceleration = NedAcceleration::from(setpoint.acceleration_enu_m_s2).vector();
    let mut type_mask = PositionTargetTypemask::POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE;
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
        afx: acceleration.x as f32,
        afy: acceleration.y as f32,
        afz: acceleration.z as f32,
        yaw: heading_of.map_or(0.0, |attitude| attitude.to_mavlink_euler().2 as f32),
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
    use crate::autopilot::context::tests::settings;
    use crate::geo::Projection;

    const PERIOD: Duration = Duration::from_millis(20);

    fn around(footing: Footing) -> Surroundings {
        let origin = settings().mission_origin;
        Surroundings {
            target: (1, 1),
            takes_attitude_targets: true,
            frame: LocalFrame { mission: origin, autopilot: origin, projection: Projection::Tangent },
            measured: Some(Measured {
                position_enu_m: Enu::new(1.0, 2.0, 10.0),
                velocity_enu_m_s: EnuVelocity::ZERO,
                attitude: Attitude::level(),
                age_s: 0.02,
            }),
            footing,
            may_tilt: true,
        }
    }

    fn setpoint(roll_rad: f64) -> Setpoint {
        Setpoint {
            position_enu_m: Enu::new(1.0, 2.0, 10.0),
            velocity_enu_m_s: EnuVelocity::ZERO,
            acceleration_enu_m_s2: EnuAcceleration::ZERO,
            attitude: Attitude::from_euler(roll_rad, 0.0, 0.0),
        }
    }

    fn stream(actuation: Actuation) -> Stream {
        let mut settings = settings();
        settings.actuation = actuation;
        settings.tilt_rate_rad_s = 0.5;
        Stream::new(&settings)
    }

    fn thrust(out: &mut Outbox) -> f64 {
        match out.next_message() {
            Some(MavMessage::SET_ATTITUDE_TARGET(target)) => f64::from(-target.thrust_body[2]),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn regress_a_vehicle_that_lifts_off_in_a_pause_is_flown_on_the_thrust_that_lifted_it() {
        let mut stream = stream(Actuation::ThrustVector);
        let mut out = Outbox::default();
        let mut now = Instant::from_start(Duration::from_secs(1));
        let mut step = |stream: &mut Stream, footing, after: Duration| {
            now = now + after;
            stream.set(&setpoint(0.0), Some(&around(footing)), now, &mut out);
            thrust(&mut out)
        };
        let lifts = (0..40).map(|_| step(&mut stream, Footing::Lifting, PERIOD)).last().unwrap();
        assert!((lifts - (IDLE_THRUST + 40.0 * 0.02 * SPOOL_RATE_S)).abs() < 1e-6, "{lifts}");
        // A pause that does not end the stream does not raise it at a leap either.
        let after = step(&mut stream, Footing::Lifting, settings().setpoint_lifetime);
        assert!((after - lifts - 0.02 * SPOOL_RATE_S).abs() < 1e-6, "{after}");
        let hovers = step(&mut stream, Footing::Airborne, Duration::from_millis(650));
        assert!((hovers - after).abs() < 1e-6 && (stream.hover_thrust() - after).abs() < 1e-6, "{hovers}");
    }

    #[test]
    fn spec_a_pause_within_the_lifetime_is_one_stream_and_a_longer_one_ends_it() {
        let mut stream = stream(Actuation::Position);
        let (mut out, around) = (Outbox::default(), around(Footing::Airborne));
        let mut now = Instant::from_start(Duration::from_secs(1));
        assert!(stream.set(&setpoint(0.0), Some(&around), now, &mut out).is_some());
        now = now + settings().setpoint_lifetime;
        assert_eq!(stream.streamed_for(now), settings().setpoint_lifetime);
        assert!(stream.set(&setpoint(0.0), Some(&around), now, &mut out).is_some());
        now = now + settings().setpoint_lifetime + Duration::from_millis(1);
        assert_eq!(stream.streamed_for(now), Duration::ZERO);
        assert!(stream.set(&setpoint(0.0), Some(&around), now, &mut out).is_some());
        assert_eq!(stream.streamed_for(now + PERIOD), PERIOD);
        // A setpoint that may not go out is a gap.
        assert!(stream.set(&setpoint(0.0), None, now + PERIOD, &mut out).is_none());
        assert_eq!(stream.streamed_for(now + PERIOD), Duration::ZERO);
    }

    #[test]
    fn spec_what_is_not_finite_is_no_setpoint() {
        let mut stream = stream(Actuation::Pose);
        let (mut out, around) = (Outbox::default(), around(Footing::Airborne));
        let mut broken = setpoint(0.0);
        broken.velocity_enu_m_s = EnuVelocity::new(0.0, f64::NAN, 0.0);
        assert!(stream.set(&broken, Some(&around), Instant::ZERO, &mut out).is_none());
        assert!(out.next_message().is_none());
    }

    #[test]
    fn val_the_attitude_turns_by_the_rate_times_the_time_that_passed() {
        let mut stream = stream(Actuation::Pose);
        let (mut out, around) = (Outbox::default(), around(Footing::Airborne));
        let mut now = Instant::from_start(Duration::from_secs(1));
        let mut expected_rad = 0.0;
        for passed in [PERIOD, PERIOD, 2 * PERIOD, PERIOD / 4, PERIOD] {
            // The first of a stream stands for a period.
            expected_rad += 0.5 * passed.as_secs_f64();
            now = now + passed;
            let commanded = stream.set(&setpoint(1.0), Some(&around), now, &mut out).unwrap();
            assert!((commanded.tilt_rad() - expected_rad).abs() < 1e-9, "{}", commanded.tilt_rad());
        }
    }

    #[test]
    fn spec_one_that_is_turned_at_its_rate_or_kept_level_is_not_commanded_as_asked() {
        let mut stream = stream(Actuation::Pose);
        let mut out = Outbox::default();
        let mut now = Instant::ZERO;
        let mut commands_as_asked = |roll_rad: f64, may_tilt: bool| {
            now = now + PERIOD;
            let around = Surroundings { may_tilt, ..around(Footing::Airborne) };
            stream.set(&setpoint(roll_rad), Some(&around), now, &mut out).unwrap();
            stream.commands_as_asked()
        };
        assert!(commands_as_asked(0.0, true));
        // 10 mrad a period: two are left, one, none.
        assert_eq!([0.03; 3].map(|rad| commands_as_asked(rad, true)), [false, false, true]);
        assert!([0.04, 0.05].into_iter().all(|rad| commands_as_asked(rad, true)));
        assert!(!commands_as_asked(0.06, false));
    }

    #[test]
    fn spec_without_fresh_state_the_weight_is_carried_on_for_half_a_second_in_the_attitude_commanded_last() {
        let carried = |actuation, footing: Footing| {
            let mut stream = stream(actuation);
            let mut out = Outbox::default();
            let mut now = Instant::from_start(Duration::from_secs(1));
            // On the way to a setpoint far away, and turning.
            let far = Setpoint { position_enu_m: Enu::new(30.0, 2.0, 5.0), ..setpoint(1.0) };
            let commanded = (0..50)
                .map(|_| {
                    now = now + PERIOD;
                    stream.set(&far, Some(&around(footing)), now, &mut out).unwrap()
                })
                .last()
                .unwrap();
            while out.next_message().is_some() {}
            let blind = Surroundings { measured: None, ..around(footing) };
            let mut sent = 0;
            for _ in 0..100 {
                now = now + PERIOD;
                let Some(carried) = stream.set(&far, Some(&blind), now, &mut out) else { break };
                sent += 1;
                assert!(carried.angle_to(&commanded) < 1e-9 && !stream.commands_as_asked());
                let Some(MavMessage::SET_ATTITUDE_TARGET(target)) = out.next_message() else { panic!() };
                let frd = target.thrust_body.map(f64::from);
                let force = commanded.rotation() * Vector3::new(frd[0], -frd[1], -frd[2]);
                let hovers = Vector3::z() * stream.hover_thrust();
                assert!((force - hovers).norm() < 1e-6, "{force} {hovers}");
            }
            assert!(out.next_message().is_none() && stream.streamed_for(now) == Duration::ZERO);
            sent
        };
        assert_eq!(carried(Actuation::ThrustVector, Footing::Airborne), 25);
        assert_eq!(carried(Actuation::ThrustVector, Footing::Lifting), 0);
        assert_eq!(carried(Actuation::ThrustVector, Footing::Standing), 0);
        assert_eq!(carried(Actuation::Pose, Footing::Airborne), 0);
        // Nor is there anything to carry on with before state has been fresh once.
        let blind = Surroundings { measured: None, ..around(Footing::Airborne) };
        let first = stream(Actuation::ThrustVector).set(
            &setpoint(0.0),
            Some(&blind),
            Instant::ZERO,
            &mut Outbox::default(),
        );
        assert!(first.is_none());
    }

    #[test]
    fn val_thrust_rises_from_idle_and_what_lifted_is_the_hover_thrust() {
        let mut stream = stream(Actuation::ThrustVector);
        let mut out = Outbox::default();
        let mut now = Instant::from_start(Duration::from_secs(1));
        let mut fly = |stream: &mut Stream, footing| {
            now = now + PERIOD;
            _ = stream.set(&setpoint(0.0), Some(&around(footing)), now, &mut out);
            thrust(&mut out)
        };
        assert!((fly(&mut stream, Footing::Standing) - IDLE_THRUST).abs() < 1e-6);
        let mut lifting = 0.0;
        for tick in 1..=50 {
            lifting = fly(&mut stream, Footing::Lifting);
            let expected = IDLE_THRUST + SPOOL_RATE_S * 0.02 * f64::from(tick);
            assert!((lifting - expected).abs() < 1e-6, "{lifting}");
        }
        // At its place and at rest, the controller asks for what hovers.
        assert!((fly(&mut stream, Footing::Airborne) - lifting).abs() < 1e-6);
        assert!((stream.hover_thrust() - lifting).abs() < 1e-6);
    }

    #[test]
    fn val_a_position_target_carries_velocity_and_acceleration_in_ned() {
        let mut out = Outbox::default();
        let mut moving = setpoint(0.0);
        moving.velocity_enu_m_s = EnuVelocity::new(1.0, 2.0, 3.0);
        moving.acceleration_enu_m_s2 = EnuAcceleration::from_vector(Vector3::new(0.25, 0.5, 0.75));
        let around = around(Footing::Airborne);
        _ = stream(Actuation::Position).set(&moving, Some(&around), Instant::ZERO, &mut out);
        let Some(MavMessage::SET_POSITION_TARGET_LOCAL_NED(target)) = out.next_message() else {
            panic!("no position target")
        };
        assert_eq!([target.vx, target.vy, target.vz], [2.0, 1.0, -3.0]);
        assert_eq!([target.afx, target.afy, target.afz], [0.5, 0.25, -0.75]);
        // The rate of yaw (2048) is all that is ignored.
        assert_eq!(target.type_mask.bits(), 2048);
    }

    #[test]
    fn spec_a_pose_is_two_targets_or_one_without_a_quaternion() {
        for (takes_attitude_targets, forms) in [(true, 2), (false, 1)] {
            let around = Surroundings { takes_attitude_targets, ..around(Footing::Airborne) };
            let mut out = Outbox::default();
            _ = stream(Actuation::Pose).set(&setpoint(0.3), Some(&around), Instant::ZERO, &mut out);
            let sent: Vec<_> = std::iter::from_fn(|| out.next_message()).collect();
            assert_eq!(sent.len(), forms);
            assert!(matches!(sent[0], MavMessage::SET_POSITION_TARGET_LOCAL_NED(_)));
        }
    }
}
