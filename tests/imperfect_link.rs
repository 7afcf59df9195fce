//! The link as it is, from outside: expectation, gradient, quantile and plans against plain Monte Carlo of other hands.

// Helpers of tests fail as tests do.
#![allow(clippy::unwrap_used, clippy::panic)]

#[path = "../examples/evaluator/truth.rs"]
mod truth;

use std::sync::Arc;

use nalgebra::Vector3;
use veilwing::geo::Pose;
use veilwing::planner::assessment::{Cause, assess};
use veilwing::planner::expectation::kernel::{POWER, Raw, Scene, VEHICLE, Workspace};
use veilwing::planner::expectation::samples::{Samples, Sequence};
use veilwing::planner::plan::{SlotPlan, Status, VehiclePlan};
use veilwing::planner::problem::{
    Fading, JitterAxes, JitterModel, Method, Objective, Pattern, PowerSteps, Problem, Rician, Uncertainty,
};
use veilwing::planner::{EvaluateOptions, Options, PlanError, cap, evaluate, plan_slot};
use veilwing::radio::measured::Measured;
use veilwing::role::PerVehicle;

fn ideal(jitter_deg: f64) -> Problem {
    Problem::paper(
        [[21.385_737_975, 103.841_847_006], [-29.058_202_678, -296.752_057_455]],
        0.5,
        jitter_deg.to_radians(),
    )
}

/// A pattern whose ends differ.
fn measured() -> Pattern {
    let point = |k: u32| {
        let deg = 10.0 * f64::from(k);
        let floor = if k < 9 { 3e-3 } else { 3e-2 };
        [
            deg,
            if k == 9 {
                0.0
            } else {
                10.0 * f64::log10(1.0 - (1.0 - floor) * deg.to_radians().cos().powi(2))
            },
        ]
    };
    Pattern::Measured(Arc::new(Measured::new(&(0..=18).map(point).collect::<Vec<_>>()).unwrap()))
}

fn both(pattern: Pattern) -> PerVehicle<Pattern> {
    PerVehicle { i: pattern.clone(), j: pattern }
}

/// Poses of no special kind, none of them level.
fn vehicles() -> PerVehicle<VehiclePlan> {
    let plan = |x, y, roll_rad, pitch_rad, yaw_rad, tx_power_w| VehiclePlan {
        pose: Pose { position_enu_m: Vector3::new(x, y, 85.0), roll_rad, pitch_rad, yaw_rad },
        tx_power_w,
    };
    PerVehicle { i: plan(4.4, 2.7, 0.89, -0.21, 0.1, 0.5), j: plan(88.3, -238.1, 1.1, 0.84, -0.05, 0.0057) }
}

/// Each effect alone, and all of them, under both models of jitter.
fn cases() -> Vec<(&'static str, Problem)> {
    type Effect = fn(&mut Problem);
    let effects: [(&str, Effect); 9] = [
        ("floor", |p| p.antennas.j = Pattern::with_null_depth(25.0)),
        ("pattern", |p| p.antennas = both(measured())),
        ("fading", |p| p.fading = Fading { user: Rician::from_db(15.0), eavesdropper: Rician::from_db(6.0) }),
        ("fading of one kind", |p| p.fading.user = Rician::from_db(12.0)),
        ("heading", |p| p.pointing.heading_std_rad = 0.05),
        ("mounting", |p| p.pointing.mounting_std_rad = 0.03),
        ("position", |p| p.pointing.position_std_m = [1.0, 2.0]),
        ("user", |p| p.user_uncertainty = Uncertainty::Disc { radius_m: 4.0 }),
        ("eavesdropper", |p| p.eavesdroppers[0].uncertainty = Uncertainty::Gaussian { std_m: 20.0 }),
    ];
    let mut all = Vec::new();
    for model in [JitterModel::Euler, JitterModel::Body] {
        let mut base = ideal(2.0);
        base.jitter.model = model;
        base.jitter.axes = JitterAxes::RollPitchYaw;
        let mut together = base.clone();
        for (name, effect) in effects {
            let mut problem = base.clone();
            effect(&mut problem);
            effect(&mut together);
            all.push((name, problem));
        }
        all.push(("all together", together.clone()));
        together.jitter.std_rad = 0.0;
        all.push(("all without jitter", together));
    }
    all
}

#[test]
fn val_the_evaluator_agrees_with_plain_monte_carlo() {
    let options = EvaluateOptions { samples: 16_384, seed: 3, ..EvaluateOptions::default() };
    for (index, (name, problem)) in cases().into_iter().enumerate() {
        let found = evaluate(&problem, &vehicles(), &options).unwrap();
        let (mean, error) = truth::mean(&problem, &vehicles(), 40_000, 11 + index as u64);
        let allowed = 4.0 * error.hypot(found.standard_error_bps / 1e6);
        let off = (found.secrecy_rate_bps / 1e6 - mean).abs();
        assert!(off < allowed, "{name}: {} against {mean} +- {error}", found.secrecy_rate_bps / 1e6);
        assert!(found.secrecy_rate_bps <= cap(&problem).unwrap(), "{name}");
    }
}

/// The gradient of the kernel for everything against central differences.
#[test]
fn val_the_gradient_is_the_objectives() {
    for (name, problem) in cases() {
        let scene = Scene::of(&problem);
        let samples = Samples::new(&problem, 256, 2, 5, Sequence::Sobol);
        let raw: Raw = [4.4, 2.7, 85.0, 0.89, -0.21, 0.1, 0.4, 88.3, -238.1, 85.0, 1.1, 0.84, -0.05, 0.0057];
        let mut workspace = Workspace::default();
        let mut gradient = [0.0; 14];
        let value = workspace.mean(&scene, &samples, &raw, false, Some(&mut gradient));
        assert!((workspace.mean(&scene, &samples, &raw, false, None) - value).abs() < 1e-12, "{name}");
        for k in 0..14 {
            let is_power = k % VEHICLE == POWER;
            let mut at = |step: f64| {
                let mut moved = raw;
                if is_power {
                    moved[k] *= step.exp()
                } else {
                    moved[k] += step
                }
                workspace.mean(&scene, &samples, &moved, false, None)
            };
            let h = if k % VEHICLE < 3 { 1e-4 } else { 1e-6 };
            let numeric = (8.0 * (at(h) - at(-h)) - (at(2.0 * h) - at(-2.0 * h))) / (12.0 * h);
            // The strongest eavesdropper may change between the steps, and the table of a pattern has corners.
            let scale = 1e-3 * (1.0 + gradient[k].abs());
            assert!((numeric - gradient[k]).abs() < scale, "{name} {k}: {numeric} {}", gradient[k]);
        }
    }
}

/// The 5% quantile over slots by drawing slots, each with a mean of its own.
#[test]
fn val_the_quantile_is_that_of_drawn_slots() {
    let (name, problem) = cases().into_iter().nth(9).unwrap();
    assert_eq!(name, "all together");
    let options = EvaluateOptions { samples: 65_536, ..EvaluateOptions::default() };
    let found = assess(&problem, &vehicles(), Some(2e6), &options).unwrap();
    let mut dice = truth::Dice::new(5);
    let mut rates: Vec<f64> = (0..1500)
        .map(|_| {
            let slot = truth::slot(&problem, &vehicles(), &mut dice);
            (0..400).map(|_| truth::rate(&problem, &vehicles(), &slot, &mut dice)).sum::<f64>() / 400.0
        })
        .collect();
    rates.sort_by(f64::total_cmp);
    // The ranks of the quantile less and more four of their deviations: sqrt(1500 x 0.05 x 0.95) is 8.4.
    let between = rates[75 - 34]..=rates[75 + 34];
    assert!(between.contains(&(found.quantile_5pct_bps / 1e6)), "{found:?} {between:?}");
    let missed = rates.iter().filter(|rate| **rate < 2.0).count() as f64 / 1500.0;
    let error = (missed * (1.0 - missed) / 1500.0).sqrt();
    assert!((found.miss_probability.unwrap() - missed).abs() < 4.0 * error + 0.01, "{found:?} {missed}");
    let names: Vec<&str> = found.losses_bps.iter().map(|(cause, _)| cause.name()).collect();
    assert_eq!(names.len(), Cause::ALL.len(), "{names:?}");
    assert!(found.loss_to_ideal_bps > 0.0);
}

/// MODEL section 7: what a plan of the ideal model is worth where the null has a floor, and what one that knows it is.
#[test]
fn val_floors_cost_what_the_model_says() {
    let plan = |problem: &Problem| plan_slot(problem, &Options::default()).unwrap();
    let unaware = plan(&ideal(0.0));
    for (depth_db, flown, planned) in
        [(40.0, 13.9, 17.8), (30.0, 10.6, 14.0), (25.0, 8.9, 12.4), (20.0, 7.2, 10.3)]
    {
        let mut problem = ideal(0.0);
        problem.antennas = both(Pattern::with_null_depth(depth_db));
        let was =
            evaluate(&problem, &unaware.vehicles, &EvaluateOptions::default()).unwrap().secrecy_rate_bps
                / 1e6;
        let aware = plan(&problem);
        let rate = aware.secrecy_rate_bps / 1e6;
        assert!((was - flown).abs() < 0.8, "-{depth_db} dB: {was:.2} flown, {flown} in the model");
        assert!(rate > planned - 0.05, "-{depth_db} dB: {rate:.2} planned, at least {planned}");
        assert_eq!(aware.status, Status::Converged, "-{depth_db} dB");
    }
}

fn planned(problem: &Problem) -> SlotPlan {
    plan_slot(problem, &Options { starts: Some(16), ..Options::default() }).unwrap()
}

#[test]
fn spec_a_plan_that_knows_is_no_worse_than_one_that_does_not() {
    let unaware = planned(&ideal(2.0));
    for (name, problem) in cases() {
        let mut problem = problem;
        problem.jitter.axes = JitterAxes::RollPitch;
        let score = |plan: &SlotPlan| {
            evaluate(&problem, &plan.vehicles, &EvaluateOptions::default()).unwrap().secrecy_rate_bps / 1e6
        };
        let aware = planned(&problem);
        let (knows, does_not) = (score(&aware), score(&unaware));
        assert!(knows > does_not - 0.02, "{name}: {knows} {does_not}");
        assert!(aware.secrecy_rate_bps <= aware.upper_bound_bps, "{name}");
    }
}

#[test]
fn spec_every_objective_is_planned_alike_by_any_number_of_threads() {
    for objective in [Objective::Nominal, Objective::Mean, Objective::Quantile, Objective::WorstCase] {
        let (_, mut problem) = cases().into_iter().nth(9).unwrap();
        problem.jitter.axes = JitterAxes::RollPitch;
        problem.objective = objective;
        problem.eavesdroppers[1].uncertainty = Uncertainty::Disc { radius_m: 20.0 };
        let options = Options { starts: Some(8), ..Options::default() };
        let one = plan_slot(&problem, &options).unwrap();
        assert_eq!(one, plan_slot(&problem, &Options { threads: 3, ..options }).unwrap(), "{objective:?}");
        assert!(one.secrecy_rate_bps > 0.0, "{objective:?}: {one:?}");
    }
}

#[test]
fn spec_a_radio_is_asked_for_what_it_can_give() {
    let free = planned(&ideal(2.0)).vehicles.j.tx_power_w;
    for levels_w in [vec![0.001, 0.01, 0.1], vec![0.2, 0.4], vec![0.4]] {
        for jitter_deg in [0.0, 2.0] {
            let mut problem = ideal(jitter_deg);
            problem.antennas.j = Pattern::with_null_depth(35.0);
            problem.power_steps = PerVehicle {
                i: PowerSteps::Levels(vec![0.1, 0.3, 0.9]),
                j: PowerSteps::Levels(levels_w.clone()),
            };
            let plan = planned(&problem);
            assert_eq!(plan.vehicles.i.tx_power_w, 0.3, "the highest level within the ceiling");
            let power_w = plan.vehicles.j.tx_power_w;
            assert!(power_w == 0.0 || levels_w.contains(&power_w), "{power_w} of {levels_w:?}");
            // No level that is planned for alone does better.
            for level in &levels_w {
                problem.power_steps.j = PowerSteps::Levels(vec![*level]);
                let alone = planned(&problem);
                let lost = (alone.secrecy_rate_bps - plan.secrecy_rate_bps) / 1e6;
                assert!(lost < 0.02, "{level} W alone is better than {power_w} W by {lost}");
            }
        }
    }
    let mut problem = ideal(2.0);
    for least_w in [0.1 * free, 10.0 * free] {
        problem.power_steps.j = PowerSteps::AtLeast(least_w);
        let plan = planned(&problem);
        let power_w = plan.vehicles.j.tx_power_w;
        assert!(power_w == 0.0 || (least_w..=0.5).contains(&power_w), "{power_w} below {least_w}");
    }
}

#[test]
fn spec_a_method_that_plans_any_power_says_so() {
    let mut problem = ideal(2.0);
    problem.power_steps.j = PowerSteps::AtLeast(0.01);
    for method in [Method::Paper, Method::InteriorPoint, Method::Conventional, Method::JammerOrientation] {
        let options = Options { method, ..Options::default() };
        assert_eq!(plan_slot(&problem, &options), Err(PlanError::PowerSteps), "{method:?}");
    }
    problem.power_steps.j = PowerSteps::Levels(vec![0.2, 0.1]);
    assert!(matches!(plan_slot(&problem, &Options::default()), Err(PlanError::OutOfRange { .. })));
}
