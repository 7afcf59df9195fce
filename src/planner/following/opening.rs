//! A slot's poses, made anew for where those that move will be as it opens: of the best that a global search meets, and of the optimum
//! next to where the vehicles are, those that carry most for as long as coming to them and the slot take together.

use std::sync::Arc;

use super::question::foreseen;
use super::{Drift, believed};
use crate::geo::Pose;
use crate::planner::moving::Limits;
use crate::planner::plan::VehiclePlan;
use crate::planner::problem::Problem;
use crate::planner::search::{self, Rough};
use crate::planner::setup::Setup;
use crate::planner::{LEAST_BIT_S_HZ, Method, Options, plan_slot};
use crate::role::{PerVehicle, Role};

/// See the module. Two companions with the same question find the same poses.
#[derive(Debug, Clone)]
pub struct Opening {
    /// The slot as it was before anything moved.
    pub problem: Arc<Problem>,
    /// The served user, if it moves, by the time since the slot's opening.
    pub user: Option<Drift>,
    /// Those of the eavesdroppers that move, in the problem's order.
    pub eavesdroppers: Vec<Option<Drift>>,
    /// How the mission's slots are planned.
    pub options: Options,
    /// Where both are, with the powers that the plan has for them.
    pub from: PerVehicle<VehiclePlan>,
    /// What they may do on their way.
    pub limits: PerVehicle<Limits>,
    /// How fast they may turn on it, rad/s.
    pub turn_rate_rad_s: PerVehicle<f64>,
    /// What the slot takes, and what an agreement and coming to rest take before it, in seconds.
    pub slot_s: [f64; 2],
}

impl Opening {
    /// Poses and powers of both; `None` where nothing is gained, or what is asked has no meaning.
    #[must_use]
    pub fn answer(&self) -> Option<PerVehicle<VehiclePlan>> {
        let eavesdroppers: Vec<_> = self.eavesdroppers.iter().map(foreseen).collect();
        let problem = believed(&self.problem, (foreseen(&self.user), &eavesdroppers), 0.0, 0.0);
        if self.options.method != Method::Veilwing {
            return plan_slot(&problem, &self.options).ok().map(|plan| plan.vehicles);
        }
        let setup = Setup::new(&problem).ok()?;
        let found = search::rough(&setup, &self.options).into_iter();
        let found = found.chain(search::next_to(&setup, &self.options, &Setup::raw(&self.from)));
        let carries = found.filter(|found| found.value > LEAST_BIT_S_HZ).map(|Rough { raw, value }| {
            let vehicles = setup.vehicles(&raw);
            (value / self.takes_s(&vehicles), vehicles)
        });
        carries
            .reduce(|best, other| if other.0 > best.0 { other } else { best })
            .map(|(_, vehicles)| vehicles)
    }

    /// What coming to poses and the slot take, about, in seconds.
    fn takes_s(&self, to: &PerVehicle<VehiclePlan>) -> f64 {
        let way_s = |role: Role| {
            let (from, to): (&Pose, &Pose) = (&self.from[role].pose, &to[role].pose);
            let flies_s = self.limits[role].flies_s(&(to.position_enu_m - from.position_enu_m));
            let turns_s = from.attitude().angle_to(&to.attitude()) / self.turn_rate_rad_s[role];
            flies_s.max(turns_s)
        };
        way_s(Role::I).max(way_s(Role::J)) + self.slot_s.iter().sum::<f64>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geo::{Enu, EnuVelocity};
    use crate::planner::following::Belief;

    fn opening(slot_s: f64) -> Opening {
        let mut problem = Problem::paper([[200.0, 80.0], [-150.0, 210.0]], 0.5, 0.03);
        problem.airspace.min_separation_m = 5.0;
        let limits = Limits { speed_m_s: 8.0, climb_m_s: 3.0, acceleration_m_s2: 2.5, jerk_m_s3: Some(4.0) };
        let belief = Belief {
            position_enu_m: Enu::new(150.0, -90.0, 0.0),
            velocity_enu_m_s: EnuVelocity::new(2.0, 0.0, 0.0),
            std_m: [2.0, 4.0],
        };
        Opening {
            from: plan_slot(&problem, &Options::default()).unwrap().vehicles,
            problem: Arc::new(problem),
            user: Some(Drift { at_s: 0.0, belief }),
            eavesdroppers: vec![None, None],
            options: Options::default(),
            limits: PerVehicle { i: limits, j: limits },
            turn_rate_rad_s: PerVehicle { i: 0.8, j: 0.8 },
            slot_s: [slot_s, 3.0],
        }
    }

    fn farther_m(opening: &Opening, to: &PerVehicle<VehiclePlan>) -> f64 {
        let way = |role: Role| to[role].pose.position_enu_m - opening.from[role].pose.position_enu_m;
        way(Role::I).norm().max(way(Role::J).norm())
    }

    #[test]
    fn spec_a_long_slot_is_worth_a_long_way_and_a_short_one_is_not() {
        let (short, long) = (opening(3.0), opening(3000.0));
        let (near, best) = (short.answer().unwrap(), long.answer().unwrap());
        assert!(farther_m(&short, &near) <= farther_m(&long, &best));
        let rate = |vehicles: &PerVehicle<VehiclePlan>| {
            let mut problem = (*long.problem).clone();
            problem.user_enu_m = Enu::new(150.0, -90.0, 0.0);
            crate::planner::expectation::evaluate(&problem, vehicles, &Default::default())
                .unwrap()
                .secrecy_rate_bps
        };
        let global = {
            let mut problem = (*long.problem).clone();
            problem.user_enu_m = Enu::new(150.0, -90.0, 0.0);
            plan_slot(&problem, &Options::default()).unwrap().secrecy_rate_bps
        };
        // Where the way costs nothing, the global optimum.
        assert!(rate(&best) > 0.995 * global, "{} {global}", rate(&best));
        assert!(rate(&near) > 1.2 * rate(&short.from), "{} {}", rate(&near), rate(&short.from));
        // The same question has the same answer.
        assert_eq!(short.answer().unwrap(), near);
    }

    #[test]
    fn spec_what_has_no_meaning_has_no_answer() {
        let mut opening = opening(20.0);
        opening.user.as_mut().unwrap().belief.position_enu_m.x = f64::NAN;
        assert_eq!(opening.answer(), None);
    }
}
