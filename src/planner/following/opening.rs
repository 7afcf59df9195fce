//! A slot's poses, made anew for where those that move will be as it opens: of the best that a global search meets, of the optimum
//! next to where the vehicles are, and where volume counts of places on the way to these, those that carry most for as long as coming to
//! them and the slot take together.
//!
//! The farther poses are, the later the slot opens, and the less is known of where its user will be by then: each is valued for when both
//! would be there, with the doubt of that time, as what moves goes on ([`Roaming`]). A user that drives is 50 m from where it was expected
//! 20 s ago, as likely as not: to go far for it is worth less than to begin where the pair is, and to follow.

use std::sync::Arc;

use super::question::foreseen;
use super::{Belief, Drift, Foresight, Unrest, believed};
use crate::geo::{Enu, Pose};
use crate::planner::expectation::kernel::{Raw, VEHICLE};
use crate::planner::expectation::{self, EvaluateOptions};
use crate::planner::moving::Limits;
use crate::planner::plan::VehiclePlan;
use crate::planner::problem::Problem;
use crate::planner::search::Quick;
use crate::planner::setup::Setup;
use crate::planner::{LEAST_BIT_S_HZ, Method, Options, plan_slot};
use crate::role::{PerVehicle, Role};

/// Searches, each for when the best poses of the one before would be reached.
const SEARCHES: usize = 3;
/// When a slot opens may be off by this from what its poses were searched for, in seconds.
const OFF_S: f64 = 1.0;
/// Who moves goes straight on for so long, in the mean, in seconds: it is not taken to be farther than that takes it.
const STRAIGHT_ON_S: f64 = 15.0;
/// Parts of the way to an optimum at which a slot may begin as well: there is none between where the pair is and one that is far, and yet
/// a shorter way may be worth more.
const PARTS: [f64; 4] = [0.0, 0.25, 0.5, 0.75];
/// Samples by which poses are valued.
const VALUED: usize = 512;

/// Where somebody is believed to be once nothing more is heard of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Roaming {
    /// What is believed now.
    pub drift: Drift,
    /// How it moves.
    pub unrest: Unrest,
}

impl Foresight for Roaming {
    /// The variance of a place grows by `q t^3 / 3`, as the filter has it (`estimate`).
    fn at(&self, t_s: f64) -> Belief {
        let since_s = (t_s - self.drift.at_s).max(0.0);
        let Belief { position_enu_m, velocity_enu_m_s, std_m } =
            self.drift.at(self.drift.at_s + since_s.min(STRAIGHT_ON_S));
        let grows = since_s * since_s * since_s / 3.0;
        let grown = |k: usize| (std_m[k] * std_m[k] + self.unrest.density_m2_s3[k] * grows).sqrt();
        Belief { position_enu_m, velocity_enu_m_s, std_m: [grown(0), grown(1)] }
    }
}

/// See the module. Two companions with the same question find the same poses.
#[derive(Debug, Clone)]
pub struct Opening {
    /// The slot as it was before anything moved.
    pub problem: Arc<Problem>,
    /// The served user, if it moves, by the time since this is asked.
    pub user: Option<Roaming>,
    /// Those of the eavesdroppers that move, in the problem's order.
    pub eavesdroppers: Vec<Option<Roaming>>,
    /// How the mission's slots are planned.
    pub options: Options,
    /// Where both are, with the powers that the plan has for them.
    pub from: PerVehicle<VehiclePlan>,
    /// What they may do on their way.
    pub limits: PerVehicle<Limits>,
    /// How fast they may turn on it, rad/s.
    pub turn_rate_rad_s: PerVehicle<f64>,
    /// What counts is what is delivered over time, whatever the rate: then a slot may begin on the way to an optimum as well.
    pub by_volume: bool,
    /// What the slot takes, and what an agreement and coming to rest take before it, in seconds.
    pub slot_s: [f64; 2],
}

impl Opening {
    /// Poses and powers of both; `None` where nothing is gained, or what is asked has no meaning.
    #[must_use]
    pub fn answer(&self) -> Option<PerVehicle<VehiclePlan>> {
        let mut opens_s = self.slot_s[1];
        if self.options.method != Method::Veilwing {
            return plan_slot(&self.known_at(opens_s, 0.0), &self.options).ok().map(|plan| plan.vehicles);
        }
        let mut best: Option<(f64, PerVehicle<VehiclePlan>)> = None;
        for _ in 0..SEARCHES {
            let problem = self.known_at(opens_s, 0.0);
            let setup = Setup::new(&problem).ok()?;
            let (from, mut quick) = (Setup::raw(&self.from), Quick::new(&setup, &self.options));
            let mut found: Vec<Raw> = quick.rough().into_iter().map(|rough| rough.raw).collect();
            found.extend(quick.next_to(&from));
            let optima = if self.by_volume { found.len() } else { 0 };
            for k in 0..optima {
                let on_the_way = PARTS.map(|part| on_the_way(&from, &found[k], part));
                let allowed = on_the_way.into_iter().filter(|raw| is_allowed(&setup, raw));
                found.extend(allowed.map(|raw| quick.in_place(&raw)));
            }
            for vehicles in found.iter().map(|raw| setup.vehicles(raw)) {
                let worth = self.worth_bps(&vehicles)?;
                if worth > best.map_or(0.0, |(worth, _)| worth) {
                    best = Some((worth, vehicles));
                }
            }
            let reached_s = self.opens_s(&best?.1);
            if (reached_s - opens_s).abs() < OFF_S {
                break;
            }
            opens_s = reached_s;
        }
        best.map(|(_, vehicles)| vehicles)
    }

    /// The question as it is at an instant, in which who moves is known as well as at another.
    fn known_at(&self, t_s: f64, known_s: f64) -> Problem {
        let eavesdroppers: Vec<_> = self.eavesdroppers.iter().map(foreseen).collect();
        believed(&self.problem, (foreseen(&self.user), &eavesdroppers), t_s, known_s)
    }

    /// What a slot carries there, over what it and coming there take, in bit/s; 0 where that is next to nothing.
    fn worth_bps(&self, vehicles: &PerVehicle<VehiclePlan>) -> Option<f64> {
        let opens_s = self.opens_s(vehicles);
        let problem = self.known_at(opens_s, opens_s);
        let setup = Setup::new(&problem).ok()?;
        let options =
            EvaluateOptions { samples: VALUED, seed: self.options.seed, ..EvaluateOptions::default() };
        let rate_bps = expectation::score(&setup, vehicles, &options).secrecy_rate_bps;
        let carries = rate_bps > LEAST_BIT_S_HZ * problem.radio.bandwidth_hz;
        Some(if carries { rate_bps * self.slot_s[0] / (opens_s + self.slot_s[0]) } else { 0.0 })
    }

    /// When a slot opens that is served from these poses, in seconds from now.
    fn opens_s(&self, to: &PerVehicle<VehiclePlan>) -> f64 {
        let way_s = |role: Role| {
            let (from, to): (&Pose, &Pose) = (&self.from[role].pose, &to[role].pose);
            let flies_s = self.limits[role].flies_s(&(to.position_enu_m - from.position_enu_m));
            let turns_s = from.attitude().angle_to(&to.attitude()) / self.turn_rate_rad_s[role];
            flies_s.max(turns_s)
        };
        way_s(Role::I).max(way_s(Role::J)) + self.slot_s[1]
    }
}

/// Both vehicles so far on their way, turned as they will be there.
fn on_the_way(from: &Raw, to: &Raw, part: f64) -> Raw {
    let mut raw = *to;
    for k in [0, VEHICLE].into_iter().flat_map(|vehicle| vehicle..vehicle + 3) {
        raw[k] = from[k] + part * (to[k] - from[k]);
    }
    raw
}

/// Whether both may be there.
fn is_allowed(setup: &Setup, raw: &Raw) -> bool {
    let [i, j] = [0, VEHICLE].map(|vehicle| Enu::from_row_slice(&raw[vehicle..vehicle + 3]));
    let apart = (i - j).norm() >= setup.problem.airspace.min_separation_m;
    apart && setup.region.allows(&i) && setup.region.allows(&j)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geo::EnuVelocity;

    /// Of a user 175 m from the last one's place, which it leaves at 2 m/s unless it stays.
    fn opening(slot_s: f64, unrest: Option<Unrest>) -> Opening {
        let mut problem = Problem::paper([[200.0, 80.0], [-150.0, 210.0]], 0.5, 0.03);
        problem.airspace.min_separation_m = 5.0;
        let limits = Limits { speed_m_s: 8.0, climb_m_s: 3.0, acceleration_m_s2: 2.5, jerk_m_s3: Some(4.0) };
        let belief = Belief {
            position_enu_m: Enu::new(150.0, -90.0, 0.0),
            velocity_enu_m_s: EnuVelocity::new(if unrest.is_some() { 2.0 } else { 0.0 }, 0.0, 0.0),
            std_m: [2.0, 4.0],
        };
        let unrest = unrest.unwrap_or(Unrest { density_m2_s3: [0.0; 2], ..Unrest::WALKS });
        Opening {
            from: plan_slot(&problem, &Options::default()).unwrap().vehicles,
            problem: Arc::new(problem),
            user: Some(Roaming { drift: Drift { at_s: 0.0, belief }, unrest }),
            eavesdroppers: vec![None, None],
            options: Options::default(),
            limits: PerVehicle { i: limits, j: limits },
            turn_rate_rad_s: PerVehicle { i: 0.8, j: 0.8 },
            by_volume: true,
            slot_s: [slot_s, 3.0],
        }
    }

    fn farther_m(opening: &Opening, to: &PerVehicle<VehiclePlan>) -> f64 {
        let way = |role: Role| to[role].pose.position_enu_m - opening.from[role].pose.position_enu_m;
        way(Role::I).norm().max(way(Role::J).norm())
    }

    #[test]
    fn spec_a_long_slot_is_worth_a_long_way_and_a_short_one_is_not() {
        let (short, long) = (opening(3.0, None), opening(3000.0, None));
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
    fn spec_nobody_goes_far_for_one_that_may_be_anywhere_by_then() {
        let goes_m = |unrest: Unrest| {
            let opening = opening(300.0, Some(unrest));
            farther_m(&opening, &opening.answer().unwrap())
        };
        let restless = Unrest { density_m2_s3: [20.0, 0.01], ..Unrest::DRIVES };
        let [known, doubted] = [Unrest::WALKS, restless].map(goes_m);
        assert!(doubted < known - 10.0, "{known} m, {doubted} m");
    }

    #[test]
    fn val_a_place_is_known_less_by_the_cube_of_the_time_and_left_straight_on_for_a_while() {
        let Roaming { drift, unrest } = opening(30.0, Some(Unrest::DRIVES)).user.unwrap();
        let at = |t_s: f64| Roaming { drift, unrest }.at(t_s);
        assert_eq!(at(0.0), drift.belief);
        let then = at(12.0);
        assert_eq!(then.position_enu_m, drift.belief.position_enu_m + Enu::new(24.0, 0.0, 0.0));
        let grown = unrest.density_m2_s3[0] * 12f64.powi(3) / 3.0;
        assert!((then.std_m[0] - (4.0 + grown).sqrt()).abs() < 1e-12);
        assert_eq!(at(40.0).position_enu_m, at(STRAIGHT_ON_S).position_enu_m);
        assert!(at(40.0).std_m[0] > at(STRAIGHT_ON_S).std_m[0]);
    }

    #[test]
    fn spec_what_has_no_meaning_has_no_answer() {
        let mut opening = opening(20.0, Some(Unrest::WALKS));
        opening.user.as_mut().unwrap().drift.belief.position_enu_m.x = f64::NAN;
        assert_eq!(opening.answer(), None);
    }
}
