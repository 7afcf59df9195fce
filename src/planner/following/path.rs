//! A vehicle's way from now on: a cubic B-spline that is open at its beginning, where position, velocity and acceleration are
//! given, and rests at its end.

use std::ops::Range;

use crate::geo::Enu;
use crate::planner::moving::{Demand, Instant, Limits, Passage, Passing, Spline};

/// A way over some segments of equal length; afterwards the vehicle rests.
#[derive(Debug, Clone, PartialEq)]
pub struct Path {
    /// When it begins, in seconds.
    pub begins_s: f64,
    /// As the way round that it is a part of: the first of its segments lies about the second control point.
    round: Spline,
}

impl Path {
    /// Of control points, at least four; three more than segments.
    #[must_use]
    pub fn new(begins_s: f64, segment_s: f64, control_enu_m: Vec<Enu>) -> Self {
        let period_s = segment_s * control_enu_m.len() as f64;
        Self { begins_s, round: Spline { period_s, control_enu_m } }
    }

    /// Every number that it is made of.
    pub fn numbers(&self) -> impl Iterator<Item = f64> + '_ {
        let points = self.round.control_enu_m.iter().flatten().copied();
        points.chain([self.begins_s, self.round.period_s])
    }

    fn segments(&self) -> Range<usize> {
        1..self.round.control_enu_m.len() - 2
    }

    fn segment_s(&self) -> f64 {
        self.round.period_s / self.round.control_enu_m.len() as f64
    }

    /// When it ends, in seconds.
    #[must_use]
    pub fn ends_s(&self) -> f64 {
        self.begins_s + self.segment_s() * self.segments().len() as f64
    }

    /// Where it leads at an instant; before it begins, and after it ends, where it begins and ends.
    #[must_use]
    pub fn at(&self, t_s: f64) -> Instant {
        let within_s = (t_s - self.begins_s).max(0.0);
        self.round.at(self.segment_s() + within_s.min(self.last_s()))
    }

    /// The time from its beginning to its end; a hair less, since the end of the last segment is not the beginning of one that is none.
    fn last_s(&self) -> f64 {
        self.segment_s() * self.segments().len() as f64 * (1.0 - 1e-12)
    }

    /// The spline that it is a part of, and how a vehicle that is on it at an instant comes to rest: as soon as its limits let it, and
    /// no later than the way ends.
    #[must_use]
    pub fn to_rest(&self, t_s: f64, limits: &Limits) -> (Spline, Passing) {
        let at_s = self.segment_s() + (t_s - self.begins_s).max(0.0);
        let left_s = self.last_s() + self.segment_s() - at_s;
        let leaves = Passing::shortest(&self.round, Passage::Leaves, at_s, limits);
        let sooner = leaves.lasts_s < left_s;
        let runs = Passing { passage: Passage::Runs, at_s, lasts_s: left_s };
        (self.round.clone(), if sooner { leaves } else { runs })
    }

    /// What it asks of a vehicle at most.
    #[must_use]
    pub fn demand(&self) -> Demand {
        self.round.demand_over(self.segments())
    }

    /// Points between which it lies: four and four hold a short piece of it in their convex hull.
    pub fn hull(&self) -> impl Iterator<Item = Enu> {
        self.hull_from(self.begins_s)
    }

    /// The same of what is left of it at an instant, or of its end.
    pub fn hull_from(&self, t_s: f64) -> impl Iterator<Item = Enu> {
        let pieces: Vec<[Enu; 4]> = self.round.hulls(self.segments()).collect();
        let share = ((t_s - self.begins_s) / (self.ends_s() - self.begins_s)).clamp(0.0, 1.0);
        let first = ((share * pieces.len() as f64) as usize).min(pieces.len() - 1);
        pieces.into_iter().skip(first).flatten()
    }

    /// The first three control points of a way that begins like this.
    #[must_use]
    pub fn beginning(now: &Instant, segment_s: f64) -> [Enu; 3] {
        let by_velocity = now.velocity_enu_m_s.vector() * segment_s;
        let by_acceleration = now.acceleration_enu_m_s2.vector() * (segment_s * segment_s);
        let p = now.position_enu_m;
        let about = p + by_acceleration / 3.0;
        [about - by_velocity, p - by_acceleration / 6.0, about + by_velocity]
    }

    /// The control point about an instant of a way that goes on as this one does: exact where that is a single cubic.
    #[must_use]
    pub fn control(&self, t_s: f64, segment_s: f64) -> Enu {
        let now = self.at(t_s);
        let rests = !(self.begins_s..=self.ends_s()).contains(&t_s);
        let bend = if rests { Enu::zeros() } else { now.acceleration_enu_m_s2.vector() };
        now.position_enu_m - bend * (segment_s * segment_s / 6.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geo::{EnuAcceleration, EnuVelocity};

    #[test]
    fn val_a_way_begins_as_it_is_told_to_and_rests_at_its_end() {
        let now = Instant {
            position_enu_m: Enu::new(10.0, -20.0, 80.0),
            velocity_enu_m_s: EnuVelocity::new(3.0, -1.0, 0.5),
            acceleration_enu_m_s2: EnuAcceleration::from_vector(Enu::new(-0.5, 0.25, 0.1)),
        };
        let mut controls = Path::beginning(&now, 2.0).to_vec();
        controls.push(Enu::new(17.0, -22.0, 81.0));
        controls.extend([Enu::new(18.0, -22.0, 81.0); 3]);
        let path = Path::new(5.0, 2.0, controls);
        let begins = path.at(5.0);
        assert!((begins.position_enu_m - now.position_enu_m).norm() < 1e-12);
        assert!((begins.velocity_enu_m_s.vector() - now.velocity_enu_m_s.vector()).norm() < 1e-12);
        assert!((begins.acceleration_enu_m_s2.vector() - now.acceleration_enu_m_s2.vector()).norm() < 1e-12);
        assert_eq!(path.ends_s(), 13.0);
        for t_s in [13.0, 20.0] {
            let ends = path.at(t_s);
            assert!((ends.position_enu_m - Enu::new(18.0, -22.0, 81.0)).norm() < 1e-9);
            assert!(ends.velocity_enu_m_s.vector().norm() < 1e-9);
        }
        // Its hull holds it, and what it asks bounds what it does.
        let hull: Vec<Enu> = path.hull().collect();
        let demand = path.demand();
        for k in 0..=80 {
            let at = path.at(5.0 + 0.1 * f64::from(k));
            for axis in 0..3 {
                let [low, high] =
                    [f64::min, f64::max].map(|f| hull.iter().map(|p| p[axis]).reduce(f).unwrap());
                assert!((low - 1e-9..=high + 1e-9).contains(&at.position_enu_m[axis]));
            }
            assert!(at.velocity_enu_m_s.vector().xy().norm() <= demand.speed_m_s + 1e-9);
            assert!(at.acceleration_enu_m_s2.vector().norm() <= demand.acceleration_m_s2 + 1e-9);
        }
        // The same way again from its own middle.
        let again: Vec<Enu> = (-1..=3).map(|k| path.control(7.0 + 2.0 * f64::from(k), 2.0)).collect();
        assert!((again[4] - Enu::new(18.0, -22.0, 81.0)).norm() < 1e-9);
    }
}
