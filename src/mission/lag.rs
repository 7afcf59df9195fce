//! How late the vehicle turns, and moves, as it is told to.
//!
//! An attitude loop without feed-forward of rates, PX4's among them, follows a turn at a steady rate so much later: the inverse of its
//! gain and the links' delays, 0.15 to 0.2 s, which are 7 to 9 deg at 45 deg/s. While a user is served that counts, so the attitude
//! that is commanded is the track's so much ahead. How much is learnt from the turns themselves: where the reference turns at the
//! rate `w` (rad/s, in the body), an error of attitude `e` is a time of `e . w / |w|^2`. A link that stands still for a while holds up
//! setpoints as it does states, and the vehicle with them: that is no lag. Nor is one that is kept level for a while. Who is
//! late for such a reason in a turn near its largest rate stays late to the turn's end, which teaches nothing any more.

use std::time::Duration;

use nalgebra::Vector3;

use crate::geo::{Attitude, Enu};
use crate::time::Instant;

use super::phase::{HELD_UP, Motion};

/// Before anything is learnt: the inverse of PX4's MC_ROLL_P of 6.5.
const BEFOREHAND_S: f64 = 0.15;
/// No vehicle that can serve in a turn is later.
const LARGEST_S: f64 = 0.4;
/// The share of what a sample says that is taken over: at 50 Hz nearly all of a turn of half a second.
const GAIN: f64 = 0.1;
/// Slower turns say nothing in the jitter, rad/s.
const LEAST_RATE_RAD_S: f64 = 10f64.to_radians();
/// A turn has gone on for so long before its lag is all there.
const STEADY: Duration = Duration::from_millis(500);
/// The rates then and now differ by this share at the most.
const STEADY_WITHIN: f64 = 0.05;
/// Half the time over which a rate is taken.
const STEP: Duration = Duration::from_millis(10);

/// Of a position, before anything is learnt.
const PLACE_BEFOREHAND_S: f64 = 0.03;
/// Slower motion says nothing over the estimator's noise, m/s.
const LEAST_SPEED_M_S: f64 = 2.0;
/// The share of what a sample of it says that is taken over.
const PLACE_GAIN: f64 = 0.02;

/// What has been heard of a vehicle.
#[derive(Debug, Clone, Default)]
struct Heard {
    last: Option<Instant>,
    /// Its link has stood still, or it was kept from following, since it last followed.
    held_up: bool,
}

impl Heard {
    /// Whether a state that was measured at `at` is a new one.
    fn is_news(&mut self, at: Instant, now: Instant) -> bool {
        let before = self.last.replace(at);
        let apart = before.map_or(Duration::ZERO, |last| at.saturating_since(last));
        self.held_up |= now.saturating_since(at).max(apart) > HELD_UP;
        before.is_none_or(|last| at > last)
    }

    /// Whether it is held up no more once what it follows is as slow as it is now.
    fn follows(&mut self, is_slow: bool) -> bool {
        self.held_up &= !is_slow;
        !self.held_up
    }
}

/// How late the vehicle is where it is told to be on a way: links and loops have a position with its velocity and acceleration ahead,
/// and yet some hundredths of a second late, and each tenth on the way to the autopilot is one more. Learnt and led likewise: of an error
/// `e` at the velocity `v` it is `e . v / |v|^2`.
#[derive(Debug, Clone)]
pub(super) struct PlaceLag {
    lag_s: f64,
    heard: Heard,
}

impl Default for PlaceLag {
    fn default() -> Self {
        Self { lag_s: PLACE_BEFOREHAND_S, heard: Heard::default() }
    }
}

impl PlaceLag {
    /// So long before it is due a place is commanded.
    pub fn lead(&self) -> Duration {
        Duration::from_secs_f64(self.lag_s)
    }

    /// Learns from the position that was measured at `at`, while the vehicle follows `motion`.
    pub fn hear(&mut self, motion: &Motion, position_enu_m: &Enu, at: Instant, now: Instant) {
        if !self.heard.is_news(at, now) || !motion.is_on_way(at) {
            return;
        }
        let meant = motion.sample(at);
        let velocity = meant.velocity_enu_m_s.vector();
        let is_slow = velocity.norm() < LEAST_SPEED_M_S;
        if !self.heard.follows(is_slow) || is_slow {
            return;
        }
        let late_s = (meant.position_enu_m - position_enu_m).dot(&velocity) / velocity.norm_squared();
        let lag_s = self.lag_s + late_s;
        if lag_s.is_finite() {
            self.lag_s += PLACE_GAIN * (lag_s.clamp(0.0, LARGEST_S) - self.lag_s);
        }
    }
}

/// See the module.
#[derive(Debug, Clone)]
pub(super) struct AttitudeLag {
    lag_s: f64,
    heard: Heard,
}

impl Default for AttitudeLag {
    fn default() -> Self {
        Self { lag_s: BEFOREHAND_S, heard: Heard::default() }
    }
}

impl AttitudeLag {
    /// So long before it is due an attitude is commanded where the vehicle must be on its track.
    pub fn lead(&self) -> Duration {
        Duration::from_secs_f64(self.lag_s)
    }

    /// The vehicle is not told to follow the motion: it is late for that reason, to the turn's end.
    pub fn hold_up(&mut self) {
        self.heard.held_up = true;
    }

    /// Learns from the attitude that was measured at `at`, while the vehicle follows `motion`.
    pub fn hear(&mut self, motion: &Motion, attitude: &Attitude, at: Instant, now: Instant) {
        if !self.heard.is_news(at, now) {
            return;
        }
        let rate = rate_at(motion, at);
        let square = rate.norm_squared();
        let is_slow = square < LEAST_RATE_RAD_S.powi(2);
        if !self.heard.follows(is_slow) || is_slow {
            return;
        }
        let was = rate_at(motion, at - STEADY);
        if (rate - was).norm_squared() > STEADY_WITHIN.powi(2) * square {
            return;
        }
        let meant = motion.sample(at).attitude.rotation();
        let error = (attitude.rotation().inverse() * meant).scaled_axis();
        let lead_s = if motion.is_on_track(at) { self.lag_s } else { 0.0 };
        let lag_s = lead_s + error.dot(&rate) / square;
        if lag_s.is_finite() {
            self.lag_s += GAIN * (lag_s.clamp(0.0, LARGEST_S) - self.lag_s);
        }
    }
}

/// The rate at which the reference turns, in the body's axes, rad/s.
fn rate_at(motion: &Motion, at: Instant) -> Vector3<f64> {
    let [before, after] = [at - STEP, at + STEP].map(|at| motion.sample(at).attitude.rotation());
    (before.inverse() * after).scaled_axis() / (2.0 * STEP.as_secs_f64())
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::planner::moving::Spline;
    use crate::planner::track::Way;
    use crate::planner::track::samples::LIMITS;
    use crate::schedule::trajectory::{Limits, Start, Trajectory};

    /// A turn about an axis askew, at 45 deg/s for two seconds, followed by a vehicle as late as that.
    fn learnt_s(late_s: f64, jitter_rad: f64) -> f64 {
        let start = Start { position_enu_m: Enu::new(0.0, 0.0, 30.0), attitude: Attitude::level() };
        let mut trajectory = Trajectory::rest(&start);
        trajectory.turn(Attitude::from_euler(1.2, 0.9, 0.3), 0.0, &Limits::new(5.0, 3.0, 45f64.to_radians()));
        let motion = Motion::new(trajectory, Instant::from_start(Duration::from_secs(1)));
        let mut lag = AttitudeLag::default();
        for k in 0..200u32 {
            let at = Instant::from_start(Duration::from_millis(1000) + Duration::from_millis(20) * k);
            let was = motion.sample(at.after_s(-late_s)).attitude.rotation();
            // To and fro, as jitter is.
            let off = jitter_rad * f64::from(k % 4).mul_add(1.0, -1.5);
            let off = nalgebra::UnitQuaternion::from_scaled_axis(Vector3::new(off, -off, off));
            lag.hear(&motion, &Attitude::from_rotation(was * off), at, at);
        }
        lag.lead().as_secs_f64()
    }

    #[test]
    fn val_the_lag_is_learnt_from_a_turn() {
        for late_s in [0.0, 0.1, 0.15, 0.3] {
            assert!((learnt_s(late_s, 0.0) - late_s).abs() < 0.01, "{late_s}: {}", learnt_s(late_s, 0.0));
            assert!((learnt_s(late_s, 0.03) - late_s).abs() < 0.03, "{late_s}: {}", learnt_s(late_s, 0.03));
        }
        assert!(learnt_s(0.8, 0.0) <= LARGEST_S);
    }

    /// Along a way of some metres a second, from then on.
    fn along_a_way(start: Instant) -> Motion {
        let points =
            [[0.0, 0.0, 50.0], [60.0, 5.0, 52.0], [65.0, 55.0, 55.0], [-4.0, 52.0, 51.0]].map(Enu::from);
        let path = Arc::new(Spline { period_s: 36.0, control_enu_m: points.to_vec() });
        let way = Way::new(path, 0.0, 10.0, &LIMITS);
        Motion::along(way.approach(20.0, &LIMITS).unwrap(), Attitude::level(), start)
    }

    /// And so late, until it rests for as long again.
    #[test]
    fn val_how_late_a_place_is_is_learnt_along_the_way() {
        let start = Instant::from_start(Duration::from_secs(1));
        let motion = along_a_way(start);
        for late_s in [0.0, 0.05, 0.2] {
            let mut lag = PlaceLag::default();
            for k in 0..3000u32 {
                let at = start + Duration::from_millis(20) * k;
                let flown = motion.commanded(at.after_s(-late_s), [Duration::ZERO, lag.lead()]);
                lag.hear(&motion, &flown.position_enu_m, at, at);
            }
            assert!((lag.lead().as_secs_f64() - late_s).abs() < 0.01, "{late_s}: {:?}", lag.lead());
        }
    }

    #[test]
    fn spec_a_place_that_was_heard_or_overtaken_teaches_nothing_again() {
        let start = Instant::from_start(Duration::from_secs(1));
        let motion = along_a_way(start);
        let is_fast =
            |at: &Instant| motion.sample(*at).velocity_enu_m_s.vector().norm() > 2.0 * LEAST_SPEED_M_S;
        let at = (1..60).map(|k| start + Duration::from_secs(k)).find(is_fast).unwrap();
        let behind = motion.sample(at.after_s(-0.3)).position_enu_m;
        let mut lag = PlaceLag::default();
        lag.hear(&motion, &behind, at, at);
        let learnt = lag.lead();
        assert_ne!(learnt, PlaceLag::default().lead());
        lag.hear(&motion, &behind, at, at);
        lag.hear(&motion, &behind, at.after_s(-0.02), at);
        assert_eq!(lag.lead(), learnt);
    }

    /// What was measured in it comes in one go, or not at all; and who was held up in a turn is late to its end. The next turn
    /// teaches again.
    #[test]
    fn regress_a_link_that_stands_still_is_no_lag() {
        let ms = |ms: u64| Instant::from_start(Duration::from_millis(ms));
        let turn = |from_rad: f64, to_rad: f64| {
            let attitude = |pitch_rad| Attitude::from_euler(0.0, pitch_rad, 0.0);
            let start = Start { position_enu_m: Enu::new(0.0, 0.0, 30.0), attitude: attitude(from_rad) };
            let mut trajectory = Trajectory::rest(&start);
            trajectory.turn(attitude(to_rad), 0.0, &Limits::new(5.0, 3.0, 15f64.to_radians()));
            trajectory
        };
        let turns = [Motion::new(turn(0.0, 1.5), ms(1000)), Motion::new(turn(1.5, 0.0), ms(8000))];
        for arrives in [true, false] {
            let mut lag = AttitudeLag::default();
            for at_ms in (1000..15_000).step_by(20) {
                // Its setpoints and states are held up from 2000 to 2800, in the first turn.
                let late_ms = match at_ms {
                    2000..2800 => at_ms - 1850,
                    2800..8000 => 950,
                    _ => 250,
                };
                let now = ms(if (2000..2800).contains(&at_ms) { 2800 } else { at_ms });
                let motion = &turns[usize::from(at_ms >= 8000)];
                let attitude = motion.sample(ms(at_ms - late_ms)).attitude;
                if arrives || now == ms(at_ms) {
                    lag.hear(motion, &attitude, ms(at_ms), now);
                }
                if at_ms == 7900 {
                    let learnt_s = lag.lead().as_secs_f64();
                    assert!((learnt_s - 0.25).abs() < 0.01, "before it stood still, {arrives}: {learnt_s}");
                    lag.lag_s = 0.1;
                }
            }
            let learnt_s = lag.lead().as_secs_f64();
            assert!((learnt_s - 0.25).abs() < 0.01, "the next turn, {arrives}: {learnt_s}");
        }
    }

    /// It stays late to the turn's end, when it may turn at last.
    #[test]
    fn regress_a_vehicle_that_is_kept_level_has_no_lag() {
        let start = Start { position_enu_m: Enu::new(0.0, 0.0, 30.0), attitude: Attitude::level() };
        let mut trajectory = Trajectory::rest(&start);
        let rate_rad_s = 45f64.to_radians();
        trajectory.turn(Attitude::from_euler(1.5, 0.0, 0.0), 0.0, &Limits::new(5.0, 3.0, rate_rad_s));
        let motion = Motion::new(trajectory, Instant::from_start(Duration::from_secs(1)));
        let mut lag = AttitudeLag::default();
        for k in 0..300u32 {
            let at = Instant::from_start(Duration::from_millis(20) * k);
            if (50..80).contains(&k) {
                lag.hold_up();
            } else {
                lag.hear(&motion, &motion.sample(at.after_s(-0.8)).attitude, at, at);
            }
        }
        assert_eq!(lag.lead(), Duration::from_secs_f64(BEFOREHAND_S));
    }

    #[test]
    fn spec_a_vehicle_at_rest_teaches_nothing() {
        let start = Start { position_enu_m: Enu::new(0.0, 0.0, 30.0), attitude: Attitude::level() };
        let motion = Motion::new(Trajectory::rest(&start), Instant::ZERO);
        let mut lag = AttitudeLag::default();
        for k in 0..100 {
            let at = Instant::from_start(Duration::from_millis(20 * k));
            lag.hear(&motion, &Attitude::from_euler(0.1, 0.0, 0.0), at, at);
        }
        assert_eq!(lag.lead(), Duration::from_secs_f64(BEFOREHAND_S));
    }
}
