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
//! over R seconds of the clock, in which s passes R / 2. The path is the one that was verified: the area, the band and the
//! separation hold as they do in the motion, both vehicles having one time; speeds are never above the motion's; R is as long as
//! acceleration and its change ask for. Nobody is served meanwhile.
//!
//! So a mission's first superframe is flown so: the transit leads to where the motion is `R / 2` before its first slot, there the
//! vehicles come to rest as before any slot, and at the slot's opening less R both begin. After the last slot's service they come to rest
//! the same way, and from there a transit leads home. A pair that must stop on the way can do so at any instant, the same.

use super::spline::Spline;
use super::{Limits, Moving, State};
use crate::geo::{EnuAcceleration, EnuVelocity};
use crate::role::{PerVehicle, Role};

/// The shortest passage, and the longest, in seconds.
const SHORTEST_S: f64 = 0.5;
const LONGEST_S: f64 = 600.0;
/// From one length that is tried to the next.
const LONGER: f64 = 1.1;
/// Instants of a passage at which limits are looked at, and what they may have between them.
const INSTANTS: usize = 200;
const PART: f64 = 0.995;

/// From rest to motion, or back.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Passage {
    /// From rest into the motion.
    Enters,
    /// Out of the motion to rest.
    Leaves,
}

/// How a motion is entered or left.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Passing {
    /// Which of both.
    pub passage: Passage,
    /// The motion's time at which the pair is at full speed, in seconds.
    pub at_s: f64,
    /// How long it takes, in seconds.
    pub lasts_s: f64,
}

/// w and its first two derivatives.
fn warp(x: f64) -> [f64; 3] {
    let x = x.clamp(0.0, 1.0);
    let r = 1.0 - x;
    [x * x * x * (10.0 - 15.0 * x + 6.0 * x * x), 30.0 * x * x * r * r, 60.0 * x * r * (r - x)]
}

/// The integral of w.
fn passed(x: f64) -> f64 {
    let x = x.clamp(0.0, 1.0);
    x * x * x * x * (2.5 - 3.0 * x + x * x)
}

impl Passing {
    /// The shortest passage within the limits of acceleration and its change with full speed at `at_s` of the motion; `None` where
    /// there is none. Limits are looked at at two hundred instants, with half a percent to spare between them.
    #[must_use]
    pub fn shortest(
        moving: &Moving,
        passage: Passage,
        at_s: f64,
        limits: &PerVehicle<Limits>,
    ) -> Option<Self> {
        let mut lasts_s = SHORTEST_S;
        while lasts_s <= LONGEST_S {
            let passing = Self { passage, at_s, lasts_s };
            let kept = |role: Role| {
                let own = &limits[role];
                (0..=INSTANTS)
                    .all(|k| passing.keeps(&moving.ways[role], own, lasts_s * k as f64 / INSTANTS as f64))
            };
            if Role::BOTH.into_iter().all(kept) {
                return Some(passing);
            }
            lasts_s *= LONGER;
        }
        None
    }

    /// The motion's time so many seconds into the passage, and its first three derivatives.
    fn time(&self, elapsed_s: f64) -> [f64; 4] {
        let r = self.lasts_s;
        let x = (elapsed_s / r).clamp(0.0, 1.0);
        match self.passage {
            Passage::Enters => {
                let [w, by, bend] = warp(x);
                [self.at_s - r * (0.5 - passed(x)), w, by / r, bend / (r * r)]
            }
            Passage::Leaves => {
                let [w, by, bend] = warp(1.0 - x);
                [self.at_s + r * (0.5 - passed(1.0 - x)), w, -by / r, bend / (r * r)]
            }
        }
    }

    /// The motion's time at which the pair rests.
    #[must_use]
    pub fn rests_at_s(&self) -> f64 {
        match self.passage {
            Passage::Enters => self.at_s - 0.5 * self.lasts_s,
            Passage::Leaves => self.at_s + 0.5 * self.lasts_s,
        }
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

    /// The pair so many seconds after the passage begins, both transmitters off; before it and after it, where it begins and ends.
    #[must_use]
    pub fn at(&self, moving: &Moving, elapsed_s: f64) -> Option<State> {
        let [s, w, by, _] = self.time(elapsed_s);
        let state = moving.at(s)?;
        let own = |way: &Spline| {
            let at = way.at(s);
            let velocity = at.velocity_enu_m_s.vector();
            (velocity * w, at.acceleration_enu_m_s2.vector() * (w * w) + velocity * by)
        };
        let (i, j) = (own(&moving.ways.i), own(&moving.ways.j));
        Some(State {
            velocities_enu_m_s: PerVehicle {
                i: EnuVelocity::from_vector(i.0),
                j: EnuVelocity::from_vector(j.0),
            },
            accelerations_enu_m_s2: PerVehicle {
                i: EnuAcceleration::from_vector(i.1),
                j: EnuAcceleration::from_vector(j.1),
            },
            tx_powers_w: PerVehicle { i: 0.0, j: 0.0 },
            served: None,
            ..state
        })
    }
}
