//! Setpoints from outside: which are taken, and whether their stream is alive.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::{
    MavFrame, SET_ATTITUDE_TARGET_DATA, SET_POSITION_TARGET_GLOBAL_INT_DATA,
    SET_POSITION_TARGET_LOCAL_NED_DATA,
};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use super::arducopter::Angle;
use super::shaper::Motion;
use crate::geodesy::{LocalFrame, Origin};
use crate::vehicle::config::{Firmware, Traps};
use crate::vehicle::control::{RateTarget, ThrustTarget};

/// PX4 wants setpoints at more than 2 Hz, for a second, before it trusts the stream.
const LONGEST_GAP: Duration = Duration::from_millis(500);
const PROVEN_AFTER: Duration = Duration::from_secs(1);
/// How long a target moves on with its velocity between two setpoints, where the firmware has no time for it.
const EXTRAPOLATE: Duration = Duration::from_millis(100);
/// How far from a unit quaternion a sender's single precision may be.
const NORM_TOLERANCE: f64 = 0.01;

/// What became of setpoints.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
pub struct SetpointCounters {
    /// Taken.
    pub accepted: u64,
    /// In a coordinate frame that the firmware does not take.
    pub wrong_frame: u64,
    /// Nothing left after the ignore bits, not finite, or not a unit quaternion.
    pub invalid: u64,
    /// ArduCopter: outside GUIDED, or before the take-off.
    pub not_in_control: u64,
}

/// A position target, mission ENU.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Setpoint {
    position: [Option<f64>; 3],
    pub velocity: [Option<f64>; 3],
    acceleration: [Option<f64>; 3],
    /// From east towards north.
    pub heading_rad: Option<f64>,
    pub at: Duration,
}

impl Setpoint {
    /// The position meant at `now`: between two setpoints it moves on with its velocity.
    pub fn position_at(&self, now: Duration) -> [Option<f64>; 3] {
        let age = now.saturating_sub(self.at).min(EXTRAPOLATE).as_secs_f64();
        std::array::from_fn(|k| self.position[k].map(|p| p + self.velocity[k].unwrap_or(0.0) * age))
    }

    /// The motion meant at `now`: it goes on with velocity and acceleration for `timeout`, and rests from then on.
    pub fn motion_at(&self, now: Duration, timeout: Duration) -> Motion {
        let filled = |v: [Option<f64>; 3]| Vector3::from(v.map(|x| x.unwrap_or(0.0)));
        let (velocity, acceleration) = (filled(self.velocity), filled(self.acceleration));
        let age = now.saturating_sub(self.at);
        let gone_on_s = age.min(timeout).as_secs_f64();
        let alive = if age <= timeout { 1.0 } else { 0.0 };
        Motion {
            position_m: filled(self.position)
                + velocity * gone_on_s
                + acceleration * (0.5 * gone_on_s * gone_on_s),
            velocity_m_s: (velocity + acceleration * gone_on_s) * alive,
            acceleration_m_s2: acceleration * alive,
        }
    }

    pub fn has_whole_position(&self) -> bool {
        self.position.iter().all(Option::is_some)
    }

    pub fn has_position(&self) -> bool {
        self.position.iter().any(Option::is_some)
    }
}

/// The latest setpoints and the health of their stream.
#[derive(Debug, Clone, Default)]
pub(super) struct Offboard {
    pub setpoint: Option<Setpoint>,
    /// Attitude, body FLU to mission ENU, and when it came.
    pub attitude: Option<(UnitQuaternion<f64>, Duration)>,
    /// PX4: attitude with thrust. Position and thrust exclude each other: the last writer wins.
    pub thrust: Option<ThrustTarget>,
    /// ArduCopter: a lean of angle control, likewise.
    pub angle: Option<Angle>,
    pub counters: SetpointCounters,
    since: Option<Duration>,
    last: Option<Duration>,
}

/// What the ignore bits leave of a target: position, velocity, acceleration (NED), yaw.
struct Fields {
    mask: u16,
    position_ned: [f64; 3],
    velocity_ned: [f64; 3],
    acceleration_ned: [f64; 3],
    yaw_rad: f64,
}

impl Offboard {
    /// A setpoint came within `timeout`.
    pub fn live(&self, now: Duration, timeout: Duration) -> bool {
        self.last.is_some_and(|last| now.saturating_sub(last) <= timeout)
    }

    /// The stream has run for long enough to be trusted with the vehicle.
    pub fn proven(&self, now: Duration) -> bool {
        self.live(now, LONGEST_GAP)
            && self.since.is_some_and(|since| now.saturating_sub(since) >= PROVEN_AFTER)
    }

    pub fn clear(&mut self) {
        self.setpoint = None;
        self.attitude = None;
        self.thrust = None;
        self.angle = None;
    }

    /// ArduCopter: stop, whatever was asked before.
    pub fn stop(&mut self, now: Duration) {
        self.clear();
        self.setpoint = Some(Setpoint {
            position: [None; 3],
            velocity: [Some(0.0); 3],
            acceleration: [None; 3],
            heading_rad: None,
            at: now,
        });
    }

    /// ArduCopter: angle control.
    pub fn lean(&mut self, angle: Angle) {
        let at = angle.at;
        self.clear();
        self.angle = Some(angle);
        self.note(at);
    }

    fn note(&mut self, now: Duration) {
        if !self.live(now, LONGEST_GAP) {
            self.since = Some(now);
        }
        self.last = Some(now);
        self.counters.accepted += 1;
    }

    pub fn local(
        &mut self,
        m: &SET_POSITION_TARGET_LOCAL_NED_DATA,
        manners: (Firmware, &Traps),
        frame: &LocalFrame,
        now: Duration,
    ) {
        if m.coordinate_frame != MavFrame::MAV_FRAME_LOCAL_NED {
            self.counters.wrong_frame += 1;
            if manners.0 == Firmware::ArduCopter && manners.1.odd_frame_stops {
                self.stop(now);
            }
            return;
        }
        let fields = Fields {
            mask: m.type_mask.bits(),
            position_ned: [m.x, m.y, m.z].map(f64::from),
            velocity_ned: [m.vx, m.vy, m.vz].map(f64::from),
            acceleration_ned: [m.afx, m.afy, m.afz].map(f64::from),
            yaw_rad: m.yaw.into(),
        };
        self.take(&fields, manners, frame, now);
    }

    pub fn global(
        &mut self,
        m: &SET_POSITION_TARGET_GLOBAL_INT_DATA,
        manners: (Firmware, &Traps),
        frame: &LocalFrame,
        home_alt_m: f64,
        now: Duration,
    ) {
        let base_m = match m.coordinate_frame {
            MavFrame::MAV_FRAME_GLOBAL | MavFrame::MAV_FRAME_GLOBAL_INT => 0.0,
            MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT | MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT_INT => {
                home_alt_m
            }
            _ => {
                self.counters.wrong_frame += 1;
                if manners.0 == Firmware::ArduCopter && manners.1.odd_frame_stops {
                    self.stop(now);
                }
                return;
            }
        };
        let mut point = Origin::from_wire(m.lat_int, m.lon_int, 0);
        point.alt_amsl_m = f64::from(m.alt) + base_m;
        let ned = frame.ned_of(point);
        let fields = Fields {
            mask: m.type_mask.bits(),
            position_ned: ned.into(),
            velocity_ned: [m.vx, m.vy, m.vz].map(f64::from),
            acceleration_ned: [m.afx, m.afy, m.afz].map(f64::from),
            yaw_rad: m.yaw.into(),
        };
        self.take(&fields, manners, frame, now);
    }

    fn take(
        &mut self,
        fields: &Fields,
        (firmware, traps): (Firmware, &Traps),
        frame: &LocalFrame,
        now: Duration,
    ) {
        let group = |first: u16, values: [f64; 3]| -> [Option<f64>; 3] {
            let given: [Option<f64>; 3] = std::array::from_fn(|k| {
                (fields.mask & (first << k) == 0 && values[k].is_finite()).then_some(values[k])
            });
            // ArduCopter: one ignored axis drops its whole group.
            let whole = given.iter().all(Option::is_some);
            if firmware == Firmware::ArduCopter && traps.whole_groups && !whole { [None; 3] } else { given }
        };
        let (position, velocity) = (group(1, fields.position_ned), group(8, fields.velocity_ned));
        let acceleration = group(64, fields.acceleration_ned);
        if position.iter().chain(&velocity).all(Option::is_none) {
            self.counters.invalid += 1;
            return;
        }
        let filled = |v: [Option<f64>; 3]| Vector3::from(v.map(|x| x.unwrap_or(0.0)));
        // The two frames' axes differ by the earth's curvature alone, so an axis left out in NED is left out in ENU.
        let mask = |values: Vector3<f64>, given: [Option<f64>; 3]| -> [Option<f64>; 3] {
            std::array::from_fn(|k| given[[1, 0, 2][k]].map(|_| values[k]))
        };
        (self.thrust, self.angle) = (None, None);
        let yaw_given = fields.mask & 1024 == 0 && fields.yaw_rad.is_finite();
        self.setpoint = Some(Setpoint {
            position: mask(frame.position_to_enu(filled(position)), position),
            velocity: mask(frame.vector_to_enu(filled(velocity)), velocity),
            acceleration: mask(frame.vector_to_enu(filled(acceleration)), acceleration),
            heading_rad: yaw_given.then_some(std::f64::consts::FRAC_PI_2 - fields.yaw_rad),
            at: now,
        });
        self.note(now);
    }

    /// SET_ATTITUDE_TARGET. With `thrust_body` or thrust it is PX4's attitude control: the position is nobody's.
    /// Without both it turns the body apart from its position, which stock PX4 does not know.
    pub fn attitude(
        &mut self,
        m: &SET_ATTITUDE_TARGET_DATA,
        (firmware, traps): (Firmware, &Traps),
        frame: &LocalFrame,
        now: Duration,
    ) {
        const TILT_RATES_IGNORE: u8 = 1 | 2;
        const THRUST_BODY_SET: u8 = 32;
        const THROTTLE_IGNORE: u8 = 64;
        const ATTITUDE_IGNORE: u8 = 128;
        let q = m.q.map(f64::from);
        let quaternion = Quaternion::new(q[0], q[1], q[2], q[3]);
        let unit = (quaternion.norm() - 1.0).abs() <= NORM_TOLERANCE;
        let mask = m.type_mask.bits();
        if mask & ATTITUDE_IGNORE != 0 || !unit {
            self.counters.invalid += 1;
            return;
        }
        let attitude = frame.attitude_to_enu(&UnitQuaternion::from_quaternion(quaternion));
        let in_body = mask & THRUST_BODY_SET != 0;
        let thrusts = firmware == Firmware::Px4 && (in_body || mask & THROTTLE_IGNORE == 0);
        if !thrusts && firmware == Firmware::Px4 && traps.attitude_needs_thrust {
            // No offboard signal, and no word of it.
            self.counters.invalid += 1;
            return;
        }
        self.attitude = Some((attitude, now));
        if thrusts {
            // A multirotor's scalar thrust goes up; in the body's FRD axes up is negative z.
            let [x, y, z] = if in_body { m.thrust_body } else { [0.0, 0.0, -m.thrust] }.map(f64::from);
            let fights = traps.rates_fight_attitude && mask & TILT_RATES_IGNORE != TILT_RATES_IGNORE;
            let rates = [m.body_roll_rate, m.body_pitch_rate, m.body_yaw_rate].map(f64::from);
            self.setpoint = None;
            self.thrust = Some(ThrustTarget {
                attitude,
                thrust_flu: Vector3::new(x, -y, -z),
                rates: fights.then(|| RateTarget {
                    rates_flu_rad_s: Vector3::new(rates[0], -rates[1], -rates[2]),
                    thrust: m.thrust.into(),
                }),
            });
        }
        self.note(now);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavlink::dialects::ardupilotmega::PositionTargetTypemask;

    fn frame() -> LocalFrame {
        let prague = Origin { lat_deg: 50.0, lon_deg: 14.0, alt_amsl_m: 200.0 };
        LocalFrame::at(prague, Vector3::new(10.0, 20.0, 0.0), crate::geodesy::Projection::Tangent)
    }

    fn target(mask: u16) -> SET_POSITION_TARGET_LOCAL_NED_DATA {
        SET_POSITION_TARGET_LOCAL_NED_DATA {
            x: 1.0,
            y: 2.0,
            z: -3.0,
            vx: 0.1,
            vy: 0.2,
            vz: 0.3,
            yaw: 0.0,
            type_mask: PositionTargetTypemask::from_bits_truncate(mask),
            coordinate_frame: MavFrame::MAV_FRAME_LOCAL_NED,
            ..SET_POSITION_TARGET_LOCAL_NED_DATA::DEFAULT
        }
    }

    fn near(a: [Option<f64>; 3], b: [Option<f64>; 3]) -> bool {
        a.iter().zip(&b).all(|(a, b)| match (a, b) {
            (Some(a), Some(b)) => (a - b).abs() < 0.02,
            (None, None) => true,
            _ => false,
        })
    }

    #[test]
    fn val_local_ned_lands_in_the_missions_enu() {
        let mut o = Offboard::default();
        o.local(&target(0), (Firmware::Px4, &Traps::default()), &frame(), Duration::ZERO);
        let s = o.setpoint.unwrap();
        assert!(near(s.position, [Some(12.0), Some(21.0), Some(3.0)]), "{s:?}");
        assert!(near(s.velocity, [Some(0.2), Some(0.1), Some(-0.3)]));
        assert!((s.heading_rad.unwrap() - std::f64::consts::FRAC_PI_2).abs() < 1e-6, "north");
        let later = s.position_at(Duration::from_millis(50));
        assert!((later[0].unwrap() - s.position[0].unwrap() - 0.01).abs() < 1e-6);
    }

    #[test]
    fn spec_ignore_bits_per_firmware() {
        let mut o = Offboard::default();
        o.local(&target(1 | 1024), (Firmware::Px4, &Traps::default()), &frame(), Duration::ZERO);
        let s = o.setpoint.unwrap();
        assert!(near(s.position, [Some(12.0), None, Some(3.0)]) && s.heading_rad.is_none());
        o.local(&target(1), (Firmware::ArduCopter, &Traps::default()), &frame(), Duration::ZERO);
        assert!(!o.setpoint.unwrap().has_position());
        o.local(&target(63), (Firmware::Px4, &Traps::default()), &frame(), Duration::ZERO);
        let mut body = target(0);
        body.coordinate_frame = MavFrame::MAV_FRAME_BODY_NED;
        o.local(&body, (Firmware::Px4, &Traps::default()), &frame(), Duration::ZERO);
        assert_eq!((o.counters.accepted, o.counters.invalid, o.counters.wrong_frame), (2, 1, 1));
    }

    #[test]
    fn spec_global_target_is_the_same_point() {
        let (mut o, f) = (Offboard::default(), frame());
        let point = f.geodetic(Vector3::new(50.0, -30.0, 90.0));
        let (lat_int, lon_int, _) = point.to_wire();
        for (coordinate_frame, alt) in [
            (MavFrame::MAV_FRAME_GLOBAL_INT, point.alt_amsl_m),
            (MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, point.alt_amsl_m - 200.0),
        ] {
            let m = SET_POSITION_TARGET_GLOBAL_INT_DATA {
                lat_int,
                lon_int,
                alt: alt as f32,
                coordinate_frame,
                type_mask: PositionTargetTypemask::from_bits_truncate(8 | 16 | 32 | 1024),
                ..SET_POSITION_TARGET_GLOBAL_INT_DATA::DEFAULT
            };
            o.global(&m, (Firmware::Px4, &Traps::default()), &f, 200.0, Duration::ZERO);
            assert!(near(o.setpoint.unwrap().position, [Some(50.0), Some(-30.0), Some(90.0)]));
        }
    }

    #[test]
    fn spec_a_stream_is_proven_after_a_second_and_dies_of_gaps() {
        let ms = Duration::from_millis;
        let mut o = Offboard::default();
        for k in 0..=5 {
            assert!(k == 5 || !o.proven(ms(k * 200)));
            o.local(&target(0), (Firmware::Px4, &Traps::default()), &frame(), ms(k * 200));
        }
        assert!(o.proven(ms(1000)) && o.live(ms(2000), ms(1000)) && !o.live(ms(2001), ms(1000)));
        o.local(&target(0), (Firmware::Px4, &Traps::default()), &frame(), ms(1600));
        assert!(!o.proven(ms(1600)), "a gap of 600 ms starts the second again");
    }

    #[test]
    fn spec_bad_quaternions_are_counted_and_ignored() {
        let mut o = Offboard::default();
        for q in [[0.0; 4], [f32::NAN, 0.0, 0.0, 0.0], [2.0, 0.0, 0.0, 0.0]] {
            o.attitude(
                &SET_ATTITUDE_TARGET_DATA { q, ..SET_ATTITUDE_TARGET_DATA::DEFAULT },
                (Firmware::Px4, &Traps::default()),
                &frame(),
                Duration::ZERO,
            );
        }
        assert_eq!((o.counters.invalid, o.attitude), (3, None));
    }
}
