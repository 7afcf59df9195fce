//! How a motion is entered from rest and left to rest.
//!
//! A motion is periodic: at its beginning the vehicles are under way. Everything in it, positions, attitudes, powers and who is
//! served, is a function of one time, the motion's own; so it can be entered and left anywhere on its own path, by letting that
//! time run up from a standstill and down to one. With s the motion's time and t the clock's,
//!
//! ```text
//! ds/dt = w(t / R) when it is entered,   w(1 - t / R) when it is left,    w(x) = x^3 (10 - 15 x + 6 x^2),
//! v = p'(s) ds/dt,      a = p''(s) (ds/dt)^2 + p'(s) d2s/dt2,
//! ```
//!
//! over R seconds of the clock, in which s passes R / 2; and a vehicle that rests goes to another place of its way, D of the motion's
//! seconds off, by s = s0 + D w(t / R). The path is the one that was verified: the area, the band and no-fly areas hold as they do
//! in the motion, and the two paths are apart wherever on them each vehicle is, so that either may do this by itself; speeds are never
//! above the motion's; R is as long as acceleration and its change ask for. Nobody is served meanwhile.
//!
//! So a mission's first superframe is flown so: the transit leads to where the motion is `R / 2` before its first slot's opening, there the
//! vehicles come to rest as before any slot, and at the opening less R each begins. After the last slot they come to rest
//! the same way, and from there a transit leads home. A vehicle that must stop on the way can do so at any instant, the same, and goes
//! to where the next slot begins along its own way.

use super::Limits;
use super::spline::{Instant, Spline};
use crate::geo::{EnuAcceleration, EnuVelocity};

/// The shortest passage, and the longest but for what the distance takes, in seconds.
const SHORTEST_S: f64 = 0.5;
const LONGEST_S: f64 = 600.0;
/// From one length that is tried to the next.
const LONGER: f64 = 1.1;
/// Instants of a passage at which limits are looked at, and what they may have between them.
const INSTANTS: usize = 200;
const PART: f64 = 0.995;
/// The largest slope of w.
const STEEPEST: f64 = 1.875;

/// What a vehicle does on its way beside flying it in its own time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Passage {
    /// From rest into the motion.
    Enters,
    /// Out of the motion to rest.
    Leaves,
    /// From rest to rest elsewhere, so many seconds of the motion on; back where they are negative.
    Goes(f64),
    /// On in the motion's own time, to where it comes to rest by itself.
    Runs,
}

/// How one vehicle enters its motion, leaves it, or goes along its way.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Passing {
    /// Which of them.
    pub passage: Passage,
    /// The motion's time in seconds at which the vehicle is at full speed; of one that goes from rest to rest, at which it begins.
    pub at_s: f64,
    /// How long it takes, in seconds.
    pub lasts_s: f64,
}

/// w and its first three derivatives.
fn warp(x: f64) -> [f64; 4] {
    let x = x.clamp(0.0, 1.0);
    let r = 1.0 - x;
    [
        x * x * x * (10.0 - 15.0 * x + 6.0 * x * x),
        30.0 * x * x * r * r,
        60.0 * x * r * (r - x),
        60.0 * (1.0 - 6.0 * x * r),
    ]
}

/// The integral of w.
fn passed(x: f64) -> f64 {
    let x = x.clamp(0.0, 1.0);
    x * x * x * x * (2.5 - 3.0 * x + x * x)
}

impl Passing {
    /// The shortest within the limits of acceleration and its change, as far as there is one within ten minutes. Limits are looked at
    /// at two hundred instants, with half a percent to spare between them.
    #[must_use]
    pub fn shortest(way: &Spline, passage: Passage, at_s: f64, limits: &Limits) -> Self {
        // No faster than the motion itself.
        let least_s = match passage {
            Passage::Enters | Passage::Leaves => SHORTEST_S,
            Passage::Goes(by_s) => SHORTEST_S.max(STEEPEST * by_s.abs()),
            Passage::Runs => 0.0,
        };
        let mut passing = Self { passage, at_s, lasts_s: least_s };
        let kept = |passing: &Self| {
            let instants = (0..=INSTANTS).map(|k| passing.lasts_s * k as f64 / INSTANTS as f64);
            instants.into_iter().all(|elapsed_s| passing.keeps(way, limits, elapsed_s))
        };
        while passing.lasts_s < least_s + LONGEST_S && !kept(&passing) {
            passing.lasts_s *= LONGER;
        }
        passing
    }

    /// The motion's time so many seconds into the passage, and its first three derivatives.
    fn time(&self, elapsed_s: f64) -> [f64; 4] {
        let r = self.lasts_s;
        let x = (elapsed_s / r).clamp(0.0, 1.0);
        match self.passage {
            Passage::Enters => {
                let [w, by, bend, _] = warp(x);
                [self.at_s - r * (0.5 - passed(x)), w, by / r, bend / (r * r)]
            }
            Passage::Leaves => {
                let [w, by, bend, _] = warp(1.0 - x);
                [self.at_s + r * (0.5 - passed(1.0 - x)), w, -by / r, bend / (r * r)]
            }
            Passage::Goes(by_s) => {
                let [w, by, bend, change] = warp(x).map(|of| by_s * of);
                [self.at_s + w, by / r, bend / (r * r), change / (r * r * r)]
            }
            Passage::Runs => [self.at_s + elapsed_s.clamp(0.0, r), 1.0, 0.0, 0.0],
        }
    }

    /// The motion's times at its beginning and at its end.
    #[must_use]
    pub fn ends_s(&self) -> [f64; 2] {
        [0.0, self.lasts_s].map(|elapsed_s| self.time(elapsed_s)[0])
    }

    /// Whether a vehicle keeps its limits.
    fn keeps(&self, way: &Spline, limits: &Limits, elapsed_s: f64) -> bool {
        let [s, w, by, bend] = self.time(elapsed_s);
        let at = way.at(s);
        let (velocity, acceleration) = (at.velocity_enu_m_s.vector(), at.acceleration_enu_m_s2.vector());
        let own = acceleration * (w * w) + velocity * by;
        let change = way.jerk_m_s3(s) * (w * w * w) + acceleration * (3.0 * w * by) + velocity * bend;
        own.norm() <= PART * limits.acceleration_m_s2
            && limits.jerk_m_s3.is_none_or(|limit| change.norm() <= PART * limit)
    }

    /// Where the vehicle is so many seconds after the passage begins; before it and after it, where it begins and ends.
    #[must_use]
    pub fn at(&self, way: &Spline, elapsed_s: f64) -> Instant {
        let [s, w, by, _] = self.time(elapsed_s);
        let at = way.at(s);
        let velocity = at.velocity_enu_m_s.vector();
        Instant {
            position_enu_m: at.position_enu_m,
            velocity_enu_m_s: EnuVelocity::from_vector(velocity * w),
            acceleration_enu_m_s2: EnuAcceleration::from_vector(
                at.acceleration_enu_m_s2.vector() * (w * w) + velocity * by,
            ),
        }
    }
}
