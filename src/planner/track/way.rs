//! Where one vehicle is in a slot that is served in motion, by the time since the slot opens; and how it stops on its way.

use std::sync::Arc;

use super::super::moving::{Instant, Limits, Passage, Passing, Spline};

/// Where a vehicle is in a slot. Cheap to clone.
#[derive(Debug, Clone, PartialEq)]
pub struct Way {
    path: Arc<Spline>,
    /// The motion's time as the slot opens, in seconds.
    opens_s: f64,
    /// From the opening to the close, in seconds.
    length_s: f64,
    /// Into the motion, for full speed at the opening.
    enters: Passing,
    /// Out of it from the close on.
    leaves: Passing,
    /// It is entered before this slot, left after it.
    from_rest: bool,
    to_rest: bool,
}

impl Way {
    /// The way in a slot that opens at `opens_s` of the motion's time and is `length_s` long, between two others.
    #[must_use]
    pub fn new(path: Arc<Spline>, opens_s: f64, length_s: f64, limits: &Limits) -> Self {
        Self {
            enters: Passing::shortest(&path, Passage::Enters, opens_s, limits),
            leaves: Passing::shortest(&path, Passage::Leaves, opens_s + length_s, limits),
            path,
            opens_s,
            length_s,
            from_rest: false,
            to_rest: false,
        }
    }

    /// The same for a vehicle that rests until it must enter.
    #[must_use]
    pub fn from_rest(self) -> Self {
        Self { from_rest: true, ..self }
    }

    /// The same for one that comes to rest afterwards.
    #[must_use]
    pub fn to_rest(self) -> Self {
        Self { to_rest: true, ..self }
    }

    /// So long before the opening a vehicle begins that enters, in seconds.
    #[must_use]
    pub fn enters_s(&self) -> f64 {
        self.enters.lasts_s
    }

    /// The motion's time where a vehicle rests before it enters.
    #[must_use]
    pub fn entry_s(&self) -> f64 {
        self.enters.ends_s()[0]
    }

    /// The same where it rests once it has left.
    #[must_use]
    pub fn exit_s(&self) -> f64 {
        self.leaves.ends_s()[1]
    }

    /// Where the vehicle is at a time since the opening.
    #[must_use]
    pub fn at(&self, since_opening_s: f64) -> Instant {
        let since_close_s = since_opening_s - self.length_s;
        if self.from_rest && since_opening_s < 0.0 {
            self.enters.at(&self.path, since_opening_s + self.enters.lasts_s)
        } else if self.to_rest && since_close_s >= 0.0 {
            self.leaves.at(&self.path, since_close_s)
        } else {
            self.path.at(self.opens_s + since_opening_s)
        }
    }

    /// Where it is at some time of the motion.
    #[must_use]
    pub fn spot(&self, motion_s: f64) -> Instant {
        self.path.at(motion_s)
    }

    /// Whether the vehicle is under way.
    #[must_use]
    pub fn moves(&self, since_opening_s: f64) -> bool {
        let entered = !self.from_rest || since_opening_s > -self.enters.lasts_s;
        let left = self.to_rest && since_opening_s >= self.length_s + self.leaves.lasts_s;
        entered && !left
    }

    /// How the vehicle stops that is under way at a time since the opening, and since when it does so, likewise.
    #[must_use]
    pub fn stop(&self, since_opening_s: f64, limits: &Limits) -> (Glide, f64) {
        let path = Arc::clone(&self.path);
        let leaving = |at_s: f64| Passing::shortest(&self.path, Passage::Leaves, at_s, limits);
        if self.from_rest && since_opening_s < 0.0 {
            let then = leaving(self.opens_s);
            (Glide { path, enters: Some(self.enters), then }, -self.enters.lasts_s)
        } else if self.to_rest && since_opening_s >= self.length_s {
            (Glide { path, enters: None, then: self.leaves }, self.length_s)
        } else {
            let then = leaving(self.opens_s + since_opening_s);
            (Glide { path, enters: None, then }, since_opening_s)
        }
    }

    /// From a time of the motion to that where a vehicle enters, the shorter way round, in seconds.
    fn to_entry_s(&self, from_s: f64) -> f64 {
        let by_s = self.entry_s() - from_s;
        by_s - self.path.period_s * (by_s / self.path.period_s).round()
    }

    /// Whether a vehicle that rests at this time of the motion enters from there.
    #[must_use]
    pub fn is_entered_from(&self, rests_s: f64) -> bool {
        self.to_entry_s(rests_s).abs() <= NOWHERE_S
    }

    /// How a vehicle that rests at `from_s` of the motion's time, and does not enter there, goes to where it does.
    #[must_use]
    pub fn approach(&self, from_s: f64, limits: &Limits) -> Option<Glide> {
        if self.is_entered_from(from_s) {
            return None;
        }
        let then = Passing::shortest(&self.path, Passage::Goes(self.to_entry_s(from_s)), from_s, limits);
        Some(Glide { path: Arc::clone(&self.path), enters: None, then })
    }
}

/// Nobody goes so little of the motion's time.
const NOWHERE_S: f64 = 1e-3;

/// How a vehicle comes to rest on its way, be it that it has entered its motion hardly yet. Cheap to clone.
#[derive(Debug, Clone, PartialEq)]
pub struct Glide {
    path: Arc<Spline>,
    enters: Option<Passing>,
    then: Passing,
}

impl Glide {
    /// Out of a motion on this path.
    pub(super) fn leaving(path: Arc<Spline>, then: Passing) -> Self {
        Self { path, enters: None, then }
    }

    /// How long it takes, in seconds.
    #[must_use]
    pub fn lasts_s(&self) -> f64 {
        self.enters.map_or(0.0, |enters| enters.lasts_s) + self.then.lasts_s
    }

    /// The motion's time where it ends.
    #[must_use]
    pub fn rests_s(&self) -> f64 {
        self.then.ends_s()[1]
    }

    /// Where the vehicle is so many seconds after it began.
    #[must_use]
    pub fn at(&self, elapsed_s: f64) -> Instant {
        match self.enters {
            Some(enters) if elapsed_s < enters.lasts_s => enters.at(&self.path, elapsed_s),
            enters => self.then.at(&self.path, elapsed_s - enters.map_or(0.0, |enters| enters.lasts_s)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geo::Enu;

    const LIMITS: Limits =
        Limits { speed_m_s: 8.0, climb_m_s: 3.0, acceleration_m_s2: 2.5, jerk_m_s3: Some(4.0) };

    /// Twenty seconds round and about, at some metres a second; the slot from 3 to 9 s of it.
    fn way() -> Way {
        let points =
            [[0.0, 0.0, 50.0], [20.0, 5.0, 52.0], [25.0, 25.0, 55.0], [4.0, 22.0, 51.0], [-6.0, 10.0, 48.0]];
        let path = Spline { period_s: 20.0, control_enu_m: points.map(Enu::from).to_vec() };
        Way::new(Arc::new(path), 3.0, 6.0, &LIMITS)
    }

    fn apart(a: &Instant, b: &Instant) -> f64 {
        (a.position_enu_m - b.position_enu_m).norm()
            + (a.velocity_enu_m_s.vector() - b.velocity_enu_m_s.vector()).norm()
    }

    /// However it begins and ends, a way has no jump.
    #[test]
    fn spec_a_way_goes_on_without_a_jump_from_rest_to_rest() {
        let free = way();
        for way in [
            free.clone(),
            free.clone().from_rest(),
            free.clone().to_rest(),
            free.clone().from_rest().to_rest(),
        ] {
            for k in -2000..3000 {
                let since_s = f64::from(k) * 0.01;
                let [before, now] = [since_s - 0.01, since_s].map(|s| way.at(s));
                assert!(apart(&before, &now) < 0.11 + 0.03, "{since_s}");
                let moves = now.velocity_enu_m_s.vector().norm() > 1e-9;
                assert!(way.moves(since_s) || !moves, "{since_s}");
                if (0.0..=6.0).contains(&since_s) {
                    assert_eq!(now, free.at(since_s));
                }
            }
        }
        let rested = free.clone().from_rest().to_rest();
        assert!(!rested.moves(-rested.enters_s() - 0.01) && rested.moves(3.0) && !rested.moves(20.0));
        assert!(
            apart(
                &rested.at(-50.0),
                &Passing::shortest(&free.path, Passage::Leaves, 0.0, &LIMITS).at(&free.path, 99.0)
            ) > 0.1
        );
        assert!((rested.at(-50.0).position_enu_m - free.spot(free.entry_s()).position_enu_m).norm() < 1e-9);
        assert!((rested.at(50.0).position_enu_m - free.spot(free.exit_s()).position_enu_m).norm() < 1e-9);
    }

    #[test]
    fn spec_a_vehicle_stops_from_wherever_it_is_and_comes_back_to_where_it_enters() {
        let free = way();
        for way in [free.clone(), free.clone().from_rest(), free.clone().from_rest().to_rest()] {
            for since_s in [-0.9 * free.enters_s(), -0.1, 0.0, 2.5, 5.9, 6.0, 6.5] {
                if !way.moves(since_s) {
                    continue;
                }
                let (glide, began_s) = way.stop(since_s, &LIMITS);
                assert!(apart(&glide.at(since_s - began_s), &way.at(since_s)) < 1e-9, "{since_s}");
                let rest = glide.at(glide.lasts_s());
                assert!(rest.velocity_enu_m_s.vector().norm() < 1e-9);
                let mut before = glide.at(since_s - began_s);
                for k in 1..3000 {
                    let now = glide.at(since_s - began_s + f64::from(k) * 0.01);
                    assert!((now.position_enu_m - before.position_enu_m).norm() < 0.09);
                    assert!(now.acceleration_enu_m_s2.vector().norm() <= LIMITS.acceleration_m_s2);
                    before = now;
                }
                let back = free.approach(glide.rests_s(), &LIMITS).unwrap();
                assert!(apart(&back.at(0.0), &rest) < 1e-9);
                let arrived = back.at(back.lasts_s());
                assert!((arrived.position_enu_m - free.spot(free.entry_s()).position_enu_m).norm() < 1e-9);
                assert_eq!(free.approach(back.rests_s(), &LIMITS), None);
            }
        }
    }
}
