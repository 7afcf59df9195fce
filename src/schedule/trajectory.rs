//! One vehicle's path in time.
//!
//! Position: straight legs, each from rest to rest (`profile`), so that speed is continuous through every corner.
//! Attitude: one rotation along the shortest way (slerp) at constant rate, in parallel with the motion. Times are
//! seconds since the trajectory's start.

mod profile;

use std::time::Duration;

use nalgebra::Vector3;

use crate::geo::{Attitude, Enu, EnuAcceleration, EnuVelocity};
use crate::planner::moving;
use profile::Profile;

/// Limits beyond this, in SI units, are taken for mistakes.
pub const LIMIT_RANGE: std::ops::RangeInclusive<f64> = 1e-6..=1e6;

/// What a trajectory demands of a vehicle at most.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Horizontal speed in m/s.
    pub speed_m_s: f64,
    /// Vertical speed in m/s, up and down.
    pub climb_m_s: f64,
    /// Acceleration in any direction in m/s^2.
    pub acceleration_m_s2: f64,
    /// Change of acceleration in m/s^3; `None`: at once.
    pub jerk_m_s3: Option<f64>,
    /// Rate of rotation about any axis in rad/s.
    pub tilt_rate_rad_s: f64,
}

impl Limits {
    /// Acceleration where nobody says otherwise, in m/s^2: a quarter of g, within reach of a multirotor in any
    /// attitude it can hold.
    pub const DEFAULT_ACCELERATION_M_S2: f64 = 2.5;

    /// Limits with the default acceleration, of any jerk.
    #[must_use]
    pub const fn new(speed_m_s: f64, climb_m_s: f64, tilt_rate_rad_s: f64) -> Self {
        let acceleration_m_s2 = Self::DEFAULT_ACCELERATION_M_S2;
        Self { speed_m_s, climb_m_s, acceleration_m_s2, jerk_m_s3: None, tilt_rate_rad_s }
    }

    /// What of them bounds a motion of the planner's.
    #[must_use]
    pub fn of_motion(&self) -> moving::Limits {
        let Self { speed_m_s, climb_m_s, acceleration_m_s2, jerk_m_s3, tilt_rate_rad_s: _ } = *self;
        moving::Limits { speed_m_s, climb_m_s, acceleration_m_s2, jerk_m_s3 }
    }

    /// The first limit outside [`LIMIT_RANGE`], as (key, value).
    #[must_use]
    pub fn fault(&self) -> Option<(&'static str, f64)> {
        let all = [
            ("speed_m_s", self.speed_m_s),
            ("climb_m_s", self.climb_m_s),
            ("acceleration_m_s2", self.acceleration_m_s2),
            ("tilt_rate_rad_s", self.tilt_rate_rad_s),
        ];
        let jerk = self.jerk_m_s3.map(|jerk| ("jerk_m_s3", jerk));
        all.into_iter().chain(jerk).find(|(_, value)| !LIMIT_RANGE.contains(value))
    }

    /// How long a polyline takes from rest to rest at every corner, in seconds.
    pub(super) fn path_s(&self, path: &[Enu]) -> f64 {
        path.windows(2).filter_map(|w| Some(self.profile(&w[0], &w[1])?.lasts_s())).sum()
    }

    /// The profile of the leg between two points; `None` if they are the same.
    fn profile(&self, from: &Enu, to: &Enu) -> Option<Profile> {
        let direction = (to - from).try_normalize(0.0)?;
        let (speed, acceleration) = (self.speed_along(&direction), self.acceleration_m_s2);
        Some(Profile::new((to - from).norm(), speed, acceleration, self.jerk_m_s3))
    }

    /// How long a straight leg takes, in seconds, and how that changes with the leg, in s/m; of no leg, nothing.
    #[must_use]
    pub fn straight_s(&self, by_m: &Vector3<f64>) -> (f64, Vector3<f64>) {
        let distance = by_m.norm();
        let Some(direction) = by_m.try_normalize(0.0) else { return (0.0, Vector3::zeros()) };
        let speed = self.speed_along(&direction);
        let profile = Profile::new(distance, speed, self.acceleration_m_s2, self.jerk_m_s3);
        let [by_distance, by_speed] =
            profile::slopes(distance, speed, self.acceleration_m_s2, self.jerk_m_s3);
        // The speed is the lesser of v d / h and c d / |z|.
        let level = direction.xy().norm();
        let across = Vector3::new(direction.x, direction.y, 0.0) / level;
        let turns = if self.speed_m_s / level <= self.climb_m_s / direction.z.abs() {
            (direction - across / level) * (speed / distance)
        } else {
            (direction - Vector3::z() / direction.z) * (speed / distance)
        };
        (profile.lasts_s(), direction * by_distance + turns * by_speed)
    }

    /// The highest speed along `direction` (unit length) in m/s.
    fn speed_along(&self, direction: &Vector3<f64>) -> f64 {
        // A division by zero is infinite and loses to the other axis.
        (self.speed_m_s / direction.xy().norm()).min(self.climb_m_s / direction.z.abs())
    }
}

/// Where a trajectory begins.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Start {
    /// Position in metres, ENU.
    pub position_enu_m: Enu,
    /// Attitude.
    pub attitude: Attitude,
}

/// A trajectory at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Position in metres, ENU.
    pub position_enu_m: Enu,
    /// Velocity in m/s, ENU.
    pub velocity_enu_m_s: EnuVelocity,
    /// Acceleration in m/s^2, ENU.
    pub acceleration_enu_m_s2: EnuAcceleration,
    /// Attitude.
    pub attitude: Attitude,
}

/// A vehicle's path in time; before its start and after its end the vehicle rests there.
#[derive(Debug, Clone, PartialEq)]
pub struct Trajectory {
    start: Enu,
    legs: Vec<Leg>,
    /// When the last leg or hold ends.
    motion_s: f64,
    turn: Turn,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Leg {
    from: Enu,
    to: Enu,
    starts_s: f64,
    profile: Profile,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Turn {
    from: Attitude,
    to: Attitude,
    starts_s: f64,
    lasts_s: f64,
}

impl Leg {
    fn ends_s(&self) -> f64 {
        self.starts_s + self.profile.lasts_s()
    }
}

impl Turn {
    fn ends_s(&self) -> f64 {
        self.starts_s + self.lasts_s
    }
}

impl Trajectory {
    /// Resting at `start`; legs, holds and a turn are appended.
    #[must_use]
    pub fn rest(start: &Start) -> Self {
        let turn = Turn { from: start.attitude, to: start.attitude, starts_s: 0.0, lasts_s: 0.0 };
        Self { start: start.position_enu_m, legs: Vec::new(), motion_s: 0.0, turn }
    }

    /// Appends straight legs from the present end to each of `points` in turn. `limits` must have no
    /// [`fault`](Limits::fault).
    pub fn fly(&mut self, points: &[Enu], limits: &Limits) {
        for &to in points {
            let from = self.end_position_enu_m();
            let Some(profile) = limits.profile(&from, &to) else { continue };
            self.legs.push(Leg { from, to, starts_s: self.motion_s, profile });
            self.motion_s += profile.lasts_s();
        }
    }

    /// Rests at the present end until `t_s`, if that is later.
    pub fn hold_until(&mut self, t_s: f64) {
        self.motion_s = self.motion_s.max(t_s);
    }

    /// Turns to `attitude` from `starts_s` on at the limited rate, in place of any turn before.
    pub fn turn(&mut self, attitude: Attitude, starts_s: f64, limits: &Limits) {
        let from = self.turn.from;
        self.turn =
            Turn { from, to: attitude, starts_s, lasts_s: from.angle_to(&attitude) / limits.tilt_rate_rad_s };
    }

    /// The same from another attitude: the turn takes as long as it then does.
    #[must_use]
    pub fn from_attitude(mut self, attitude: Attitude, limits: &Limits) -> Self {
        if attitude != self.turn.from {
            let Turn { to, starts_s, .. } = self.turn;
            self.turn.from = attitude;
            self.turn(to, starts_s, limits);
        }
        self
    }

    /// When position and attitude have both arrived, rounded up to a nanosecond.
    #[must_use]
    pub fn duration(&self) -> Duration {
        let end_s = self.motion_s.max(self.turn.ends_s());
        let nearest = Duration::try_from_secs_f64(end_s).unwrap_or(Duration::MAX);
        let short = nearest.as_secs_f64() < end_s;
        nearest.saturating_add(Duration::from_nanos(u64::from(short)))
    }

    /// Position, velocity, acceleration and attitude at `t` after the start.
    #[must_use]
    pub fn sample(&self, t: Duration) -> Sample {
        let t_s = t.as_secs_f64();
        let attitude = self.attitude_at(t_s);
        let at_rest = |position_enu_m| Sample {
            position_enu_m,
            velocity_enu_m_s: EnuVelocity::ZERO,
            acceleration_enu_m_s2: EnuAcceleration::ZERO,
            attitude,
        };
        let started = self.legs.partition_point(|leg| leg.starts_s <= t_s);
        let Some(leg) = started.checked_sub(1).and_then(|k| self.legs.get(k)) else {
            return at_rest(self.start);
        };
        if t_s >= leg.ends_s() {
            return at_rest(leg.to);
        }
        let along = leg.profile.at(t_s - leg.starts_s);
        let direction = (leg.to - leg.from) / leg.profile.distance_m();
        Sample {
            position_enu_m: leg.from + direction * along.distance_m,
            velocity_enu_m_s: EnuVelocity::from_vector(direction * along.speed_m_s),
            acceleration_enu_m_s2: EnuAcceleration::from_vector(direction * along.acceleration_m_s2),
            attitude,
        }
    }

    /// The corners of the path, both ends included: one point for a trajectory that rests.
    #[must_use]
    pub fn path(&self) -> Vec<Enu> {
        std::iter::once(self.start).chain(self.legs.iter().map(|leg| leg.to)).collect()
    }

    /// When it next sets off from rest, later than `after` (`None`: at all): legs that follow one another without a
    /// hold are one departure.
    #[must_use]
    pub fn departure_after(&self, after: Option<Duration>) -> Option<Duration> {
        let before = std::iter::once(None).chain(self.legs.iter().map(|leg| Some(leg.ends_s())));
        let from_rest =
            self.legs.iter().zip(before).filter(|(leg, before)| before.is_none_or(|s| leg.starts_s > s));
        from_rest
            .filter_map(|(leg, _)| Duration::try_from_secs_f64(leg.starts_s).ok())
            .find(|&departs| after.is_none_or(|after| departs > after))
    }

    /// Where it ends.
    #[must_use]
    pub fn end(&self) -> Start {
        Start { position_enu_m: self.end_position_enu_m(), attitude: self.turn.to }
    }

    /// When the motion appended so far ends, in seconds.
    pub(super) fn motion_s(&self) -> f64 {
        self.motion_s
    }

    /// When the first leg ends, in seconds; 0 without one.
    pub(super) fn first_leg_ends_s(&self) -> f64 {
        self.legs.first().map_or(0.0, Leg::ends_s)
    }

    fn end_position_enu_m(&self) -> Enu {
        self.legs.last().map_or(self.start, |leg| leg.to)
    }

    fn attitude_at(&self, t_s: f64) -> Attitude {
        let turn = &self.turn;
        if t_s >= turn.ends_s() {
            turn.to
        } else if t_s <= turn.starts_s {
            turn.from
        } else {
            turn.from.slerp(&turn.to, (t_s - turn.starts_s) / turn.lasts_s)
        }
    }
}

#[cfg(test)]
mod tests {
    use rand::RngExt;

    use super::*;
    use crate::schedule::testing;

    const LIMITS: Limits = Limits::new(10.0, 3.0, 0.5);

    fn at_rest(position: [f64; 3]) -> Trajectory {
        Trajectory::rest(&Start { position_enu_m: Enu::from(position), attitude: Attitude::level() })
    }

    fn flown(points: &[[f64; 3]]) -> Trajectory {
        let mut trajectory = at_rest([0.0; 3]);
        trajectory.fly(&points.iter().map(|&p| Enu::from(p)).collect::<Vec<_>>(), &LIMITS);
        trajectory
    }

    #[test]
    fn val_durations_of_a_trapezoid_a_triangle_and_a_climb() {
        // v/a + L/v; 2 sqrt(L/a); the climb's own limit.
        for (to, expected_s) in [
            ([100.0, 0.0, 0.0], 4.0 + 10.0),
            ([0.0, 10.0, 0.0], 4.0),
            ([0.0, 0.0, 30.0], 1.2 + 10.0),
            ([0.0, 0.0, -30.0], 1.2 + 10.0),
            // At 45 deg the climb binds: 3 sqrt 2 along the path.
            ([30.0, 0.0, 30.0], 3.0 * 2f64.sqrt() / 2.5 + 10.0),
            ([0.0, 0.0, 0.0], 0.0),
        ] {
            let duration_s = flown(&[to]).duration().as_secs_f64();
            assert!((duration_s - expected_s).abs() < 2e-9, "{to:?}: {duration_s} {expected_s}");
        }
    }

    #[test]
    fn val_slopes_of_straight_legs_are_those_of_differences() {
        for jerk_m_s3 in [None, Some(4.0)] {
            let limits = Limits { jerk_m_s3, ..LIMITS };
            for by in
                [[100.0, -30.0, 4.0], [3.0, 2.0, 1.0], [0.2, 0.1, -0.3], [1.0, 2.0, 60.0], [0.0, 50.0, 0.0]]
            {
                let by = Vector3::from(by);
                let (time_s, slope) = limits.straight_s(&by);
                assert!((time_s - limits.path_s(&[Enu::zeros(), by])).abs() < 1e-12);
                for k in 0..3 {
                    let at = |step: f64| {
                        let mut moved = by;
                        moved[k] += step;
                        limits.straight_s(&moved).0
                    };
                    let numeric = (at(1e-6) - at(-1e-6)) / 2e-6;
                    assert!(
                        (numeric - slope[k]).abs() < 1e-6,
                        "{by:?} {jerk_m_s3:?} {k}: {numeric} {}",
                        slope[k]
                    );
                }
            }
            assert_eq!(limits.straight_s(&Vector3::zeros()), (0.0, Vector3::zeros()));
        }
    }

    #[test]
    fn val_samples_of_a_trapezoid() {
        let trajectory = flown(&[[100.0, 0.0, 0.0]]);
        for (t_s, x, v) in
            [(0.0, 0.0, 0.0), (2.0, 5.0, 5.0), (4.0, 20.0, 10.0), (7.0, 50.0, 10.0), (12.0, 95.0, 5.0)]
        {
            let sample = trajectory.sample(Duration::from_secs_f64(t_s));
            assert!(
                (sample.position_enu_m.x - x).abs() < 1e-12
                    && (sample.velocity_enu_m_s.vector().x - v).abs() < 1e-12
            );
        }
    }

    #[test]
    fn val_a_turn_takes_its_angle_over_the_rate_and_a_hold_delays() {
        let mut trajectory = at_rest([1.0, 2.0, 3.0]);
        let tilted = Attitude::from_euler(1.0, 0.0, 0.0);
        trajectory.turn(tilted, 1.0, &LIMITS);
        assert!((trajectory.duration().as_secs_f64() - 3.0).abs() < 2e-9);
        let half = trajectory.sample(Duration::from_secs(2)).attitude;
        assert!(half.angle_to(&Attitude::from_euler(0.5, 0.0, 0.0)) < 1e-9);
        trajectory.hold_until(20.0);
        trajectory.fly(&[Enu::new(1.0, 12.0, 3.0)], &LIMITS);
        assert!((trajectory.duration().as_secs_f64() - 24.0).abs() < 2e-9);
        let held = trajectory.sample(Duration::from_secs(19));
        assert_eq!(
            (held.position_enu_m, held.velocity_enu_m_s),
            (Enu::new(1.0, 2.0, 3.0), EnuVelocity::ZERO)
        );
        assert_eq!(held.attitude, tilted);
    }

    #[test]
    fn spec_limits_that_are_none_are_named() {
        assert_eq!(LIMITS.fault(), None);
        assert_eq!(Limits::new(10.0, 0.0, 0.5).fault(), Some(("climb_m_s", 0.0)));
        assert_eq!(Limits::new(-1.0, 0.0, 0.5).fault(), Some(("speed_m_s", -1.0)));
        assert_eq!(Limits::new(1.0, 1.0, f64::INFINITY).fault(), Some(("tilt_rate_rad_s", f64::INFINITY)));
    }

    #[test]
    fn prop_within_limits_continuous_and_exact_at_both_ends() {
        let mut rng = testing::rng(2);
        for k in 0..300 {
            let mut u = |range: std::ops::Range<f64>| rng.random_range(range);
            let limits = Limits {
                acceleration_m_s2: u(0.5..5.0),
                jerk_m_s3: (k % 2 == 0).then(|| u(0.5..20.0)),
                ..Limits::new(u(0.5..20.0), u(0.5..8.0), u(0.1..2.0))
            };
            let mut attitude = || Attitude::from_euler(u(-3.1..3.1), u(-1.5..1.5), u(-3.1..3.1));
            let (from, to) = (attitude(), attitude());
            let start = Start {
                position_enu_m: Enu::new(u(-50.0..50.0), u(-50.0..50.0), u(0.0..50.0)),
                attitude: from,
            };
            let scale = 10f64.powf(u(-3.0..2.0));
            let points: Vec<_> =
                (0..3).map(|_| Enu::new(u(-scale..scale), u(-scale..scale), u(-scale..scale))).collect();
            let mut trajectory = Trajectory::rest(&start);
            trajectory.fly(&points, &limits);
            trajectory.turn(to, u(0.0..3.0), &limits);
            let first = trajectory.sample(Duration::ZERO);
            let last = trajectory.sample(trajectory.duration());
            assert_eq!((first.position_enu_m, first.attitude), (start.position_enu_m, from));
            assert_eq!((last.position_enu_m, last.attitude), (points[2], to));
            assert_eq!(last.velocity_enu_m_s, EnuVelocity::ZERO);

            let n = 2000;
            let step = trajectory.duration() / n;
            let dt = step.as_secs_f64();
            let mut before = first;
            for k in 1..=n {
                let now = trajectory.sample(step * k);
                let v = now.velocity_enu_m_s.vector();
                assert!(
                    v.xy().norm() <= limits.speed_m_s * (1.0 + 1e-9)
                        && v.z.abs() <= limits.climb_m_s * (1.0 + 1e-9)
                );
                let a = (v - before.velocity_enu_m_s.vector()).norm() / dt;
                assert!(a <= limits.acceleration_m_s2 * (1.0 + 1e-6), "{a}");
                let mean = (v + before.velocity_enu_m_s.vector()) * 0.5;
                let moved = now.position_enu_m - before.position_enu_m;
                // The trapezoidal rule is off by at most a dt^2 / 4 where the acceleration jumps.
                assert!((moved - mean * dt).norm() <= 0.51 * limits.acceleration_m_s2 * dt * dt + 1e-9);
                let change = now.acceleration_enu_m_s2.vector() - before.acceleration_enu_m_s2.vector();
                let jerk = limits.jerk_m_s3.unwrap_or(f64::INFINITY);
                // A corner is passed at rest.
                assert!(change.norm() <= jerk * dt * (1.0 + 1e-6) + 1e-9, "{}", change.norm() / dt);
                assert!(before.attitude.angle_to(&now.attitude) <= limits.tilt_rate_rad_s * dt + 1e-7);
                before = now;
            }
        }
    }
}
