//! A motion that is asked for, with all that it depends on.

use std::sync::Arc;

use super::{Drift, Flying, Foresight, Motion, Scene, plan};
use crate::planner::moving::Limits;
use crate::planner::plan::VehiclePlan;
use crate::planner::problem::Problem;
use crate::planner::turning::Sizes;
use crate::role::{PerVehicle, Role};

/// See the module. Two companions with the same question find the same motion.
#[derive(Debug, Clone)]
pub struct Question {
    /// The slot as it was before anything moved.
    pub problem: Arc<Problem>,
    /// The served user, if it moves, by the time since the slot's opening.
    pub user: Option<Drift>,
    /// Those of the eavesdroppers that move, in the problem's order.
    pub eavesdroppers: Vec<Option<Drift>>,
    /// What the vehicles may do on their way.
    pub limits: PerVehicle<Limits>,
    /// How fast they may turn, rad/s.
    pub turn_rate_rad_s: PerVehicle<f64>,
    /// How far apart they have to be, in metres, whichever motion each flies, and wherever on it it is.
    pub apart_m: f64,
    /// How they rest as the slot has it.
    pub rest: PerVehicle<VehiclePlan>,
    /// What each flies; `None` of one that rests.
    pub flies: PerVehicle<Option<Arc<Motion>>>,
    /// When the motion begins, in seconds since the slot's opening.
    pub begins_s: f64,
    /// Up to which errors it is looked at what they cost.
    pub errors: Sizes,
    /// Seed of what is random in planning.
    pub seed: u64,
}

impl Question {
    /// The motion, and nothing where none is found that keeps every limit, or where what is asked has no meaning: what is flown goes on.
    #[must_use]
    pub fn answer(&self) -> Option<Motion> {
        let scene = Scene {
            problem: &self.problem,
            user: foreseen(&self.user),
            eavesdroppers: self.eavesdroppers.iter().map(foreseen).collect(),
            limits: self.limits,
            turn_rate_rad_s: self.turn_rate_rad_s,
            apart_m: self.apart_m,
        };
        let from = PerVehicle::from_fn(|role: Role| match &self.flies[role] {
            Some(motion) => Flying::Motion(motion),
            None => Flying::Rest(&self.rest[role]),
        });
        let mut motion = plan(&scene, &from, self.begins_s, self.seed).ok()??;
        motion.add_tolerances(&scene, &self.errors, self.seed).ok()?;
        Some(motion)
    }
}

pub(super) fn foreseen<F: Foresight>(of: &Option<F>) -> Option<&dyn Foresight> {
    of.as_ref().map(|of| of as &dyn Foresight)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geo::{Enu, EnuVelocity};
    use crate::planner::expectation::{EvaluateOptions, evaluate};
    use crate::planner::following::Belief;
    use crate::planner::following::frame::Frame;
    use crate::planner::{Options, plan_slot};

    fn question() -> Question {
        let mut problem = Problem::paper([[200.0, 80.0], [-150.0, 210.0]], 0.5, 0.03);
        problem.airspace.min_separation_m = 5.0;
        let limits = Limits { speed_m_s: 8.0, climb_m_s: 3.0, acceleration_m_s2: 2.5, jerk_m_s3: Some(4.0) };
        let belief = Belief {
            position_enu_m: Enu::new(10.0, -5.0, 0.0),
            velocity_enu_m_s: EnuVelocity::new(6.0, 0.0, 0.0),
            std_m: [2.0, 4.0],
        };
        Question {
            rest: plan_slot(&problem, &Options { starts: Some(8), ..Options::default() }).unwrap().vehicles,
            problem: Arc::new(problem),
            user: Some(Drift { at_s: 1.0, belief }),
            eavesdroppers: vec![None, None],
            limits: PerVehicle { i: limits, j: limits },
            turn_rate_rad_s: PerVehicle { i: 0.6, j: 0.6 },
            apart_m: 7.0,
            flies: PerVehicle { i: None, j: None },
            begins_s: 1.0,
            errors: Sizes::ALL,
            seed: 7,
        }
    }

    #[test]
    fn spec_a_question_has_one_answer_and_another_question_another() {
        let question = question();
        let first = question.answer().unwrap();
        assert_eq!(question.answer().map(|motion| motion.digest()), Some(first.digest()));
        assert_eq!(question.user.unwrap().at(0.0).position_enu_m, Enu::new(4.0, -5.0, 0.0));
        let mut drift = question.user.unwrap();
        drift.belief.position_enu_m.x += 0.1;
        let seen = Question { eavesdroppers: vec![Some(drift), None], ..question.clone() };
        let elsewhere = Question { user: Some(drift), ..question.clone() };
        for other in [seen, elsewhere, Question { begins_s: 1.001, ..question.clone() }] {
            assert_ne!(other.answer().unwrap().digest(), first.digest());
        }
        // I flies a motion that J has not taken up: the next one begins with the state of each.
        let first = Arc::new(first);
        let flies = PerVehicle { i: Some(Arc::clone(&first)), j: None };
        let next = Question { flies, begins_s: 4.0, ..question.clone() }.answer().unwrap();
        let (begins, flown) = (next.at(4.0), first.at(4.0));
        let apart_m = |role: Role, from: &VehiclePlan| {
            (begins.vehicles[role].pose.position_enu_m - from.pose.position_enu_m).norm()
        };
        assert!(apart_m(Role::I, &flown.vehicles.i) < 1e-9 && apart_m(Role::J, &question.rest.j) < 1e-9);
        assert!(apart_m(Role::J, &flown.vehicles.j) > 0.1, "J would have moved by then");
        // What has no meaning has no answer.
        assert_eq!(Question { begins_s: f64::NAN, ..question }.answer(), None);
    }

    #[test]
    fn val_an_error_within_its_tolerance_costs_what_is_tolerated() {
        // By the evaluator, on other draws and in directions of its own.
        let mut question = question();
        let motion = question.answer().unwrap();
        let scene = Scene {
            problem: &question.problem,
            user: foreseen(&question.user),
            eavesdroppers: vec![],
            limits: question.limits,
            turn_rate_rad_s: question.turn_rate_rad_s,
            apart_m: question.apart_m,
        };
        let t_s = Frame::nodes_s(question.begins_s).nth(3).unwrap();
        let problem = scene.problem_at(t_s, question.begins_s);
        let tolerance = motion.tolerance(t_s).unwrap();
        let rate = |vehicles: &PerVehicle<VehiclePlan>| {
            let options = EvaluateOptions { samples: 8192, seed: 99, ..EvaluateOptions::default() };
            evaluate(&problem, vehicles, &options).unwrap().secrecy_rate_bps
        };
        let meant = motion.at(t_s).vehicles;
        for role in Role::BOTH {
            let moved = |k: u32, share: f64| {
                let (sin, cos) = (f64::from(k) * 0.7).sin_cos();
                let rise = (f64::from(k) * 1.9).sin();
                let way = Enu::new(cos, sin, rise).normalize() * (share * tolerance.position_m[role]);
                let mut vehicles = meant;
                vehicles[role].pose.position_enu_m += way;
                rate(&vehicles) / rate(&meant)
            };
            let least = |share: f64| (0..24).map(|k| moved(k, share)).fold(1.0, f64::min);
            assert!(least(0.9) > 0.975 && least(1.25) < 0.98, "{role}: {} {}", least(0.9), least(1.25));
        }
        // The narrower the errors that are looked at, the fewer are told; between instants it is the stricter of two.
        question.errors = Sizes { pointing_rad: [0.01, 0.02], position_m: [0.5; 2] };
        let narrow = question.answer().unwrap();
        assert_eq!(narrow.digest(), motion.digest());
        for at_s in [question.begins_s, t_s, t_s + 0.1, motion.ends_s()] {
            let (wide, narrow) = (motion.tolerance(at_s).unwrap(), narrow.tolerance(at_s).unwrap());
            for role in Role::BOTH {
                assert!(narrow.position_m[role] <= 0.5 && narrow.pointing_rad[role] <= 0.02);
                assert!(narrow.position_m[role] <= 1.02 * wide.position_m[role]);
            }
        }
    }
}
