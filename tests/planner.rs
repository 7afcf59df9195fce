//! The planner from outside: what a user of the library relies on.

// Helpers of tests fail as tests do.
#![allow(clippy::unwrap_used, clippy::panic)]

use nalgebra::{Rotation3, Vector2, Vector3};
use proptest::prelude::*;
use veilwing::geo::Pose;
use veilwing::planner::plan::{SlotPlan, Status, VehiclePlan};
use veilwing::planner::problem::{
    Airframe, Eavesdropper, JitterModel, Method, Objective, Problem, Uncertainty,
};
use veilwing::planner::slots::{Plan, PlannedSlot, hex};
use veilwing::planner::{
    EvaluateOptions, Near, Options, PlanError, cap, evaluate, plan_slot, plan_slot_near,
};
use veilwing::radio::pattern;
use veilwing::role::{PerVehicle, Role};

/// The paper's set-up at 0.5 W, with a mission file's default separation.
fn problem(eavesdroppers: &[[f64; 2]], jitter_deg: f64) -> Problem {
    let mut problem = Problem::paper(eavesdroppers.iter().copied(), 0.5, jitter_deg.to_radians());
    problem.airspace.min_separation_m = 5.0;
    problem
}

const METHODS: [Method; 5] =
    [Method::Veilwing, Method::Paper, Method::InteriorPoint, Method::Conventional, Method::JammerOrientation];

#[test]
fn spec_two_threads_equal_one_bit_for_bit() {
    for deg in [0.0, 2.0] {
        let problem = problem(&[[120.0, -40.0], [-300.0, 210.0], [50.0, 400.0]], deg);
        for method in METHODS {
            let options = Options { method, seed: 3, starts: Some(8), ..Options::default() };
            let one = plan_slot(&problem, &options).unwrap();
            for threads in [2, 5] {
                assert_eq!(
                    one,
                    plan_slot(&problem, &Options { threads, ..options }).unwrap(),
                    "{method:?} {deg}"
                );
            }
        }
    }
}

#[test]
fn spec_threads_do_not_matter_over_uncertain_positions() {
    for objective in [Objective::Nominal, Objective::Mean, Objective::Quantile, Objective::WorstCase] {
        let mut problem = problem(&[[120.0, -40.0], [-300.0, 210.0]], 2.0);
        problem.objective = objective;
        problem.eavesdroppers[0].uncertainty = Uncertainty::Disc { radius_m: 40.0 };
        problem.eavesdroppers[1].uncertainty = Uncertainty::Gaussian { std_m: 15.0 };
        let options = Options { starts: Some(12), ..Options::default() };
        let one = plan_slot(&problem, &options).unwrap();
        assert_sound(&problem, &one, &format!("{objective:?}"));
        assert_eq!(one, plan_slot(&problem, &Options { threads: 3, ..options }).unwrap(), "{objective:?}");
    }
}

#[test]
fn spec_evaluate_agrees_with_the_plans_own_figure() {
    for deg in [0.0, 2.0, 10.0] {
        let problem = problem(&[[120.0, -40.0], [-300.0, 210.0]], deg);
        let plan = plan_slot(&problem, &Options::default()).unwrap();
        let score =
            evaluate(&problem, &plan.vehicles, &EvaluateOptions { seed: 77, ..Default::default() }).unwrap();
        let error = plan.standard_error_bps.hypot(score.standard_error_bps);
        assert!((score.secrecy_rate_bps - plan.secrecy_rate_bps).abs() <= 4.0 * error + 1e-6, "{deg}");
        assert_eq!(score.user_sinr, plan.user_sinr);
        assert!(plan.secrecy_rate_bps <= cap(&problem).unwrap());
    }
}

#[test]
fn spec_the_plan_states_the_objective_that_it_was_asked_for() {
    let mut problem = problem(&[[120.0, -40.0], [-300.0, 210.0]], 2.0);
    let plan = plan_slot(&problem, &Options::default()).unwrap();
    assert_eq!(plan.objective_bps, plan.secrecy_rate_bps, "nothing is uncertain");
    for e in &mut problem.eavesdroppers {
        e.uncertainty = Uncertainty::Disc { radius_m: 40.0 };
    }
    let planned = |objective| {
        let problem = Problem { objective, ..problem.clone() };
        let plan = plan_slot(&problem, &Options::default()).unwrap();
        let options = EvaluateOptions { seed: 3, ..EvaluateOptions::default() };
        let score = evaluate(&problem, &plan.vehicles, &options).unwrap();
        let apart = plan.objective_bps / score.objective_rate_bps - 1.0;
        assert!(apart.abs() < 5e-3, "{objective:?}: {} {}", plan.objective_bps, score.objective_rate_bps);
        [plan.secrecy_rate_bps, plan.objective_bps]
    };
    let [mean, same] = planned(Objective::Mean);
    assert_eq!(mean, same);
    for lower in [Objective::Quantile, Objective::WorstCase] {
        let [mean, objective] = planned(lower);
        assert!(objective < mean, "{lower:?}: {objective} {mean}");
    }
}

#[test]
fn spec_plans_near_the_best_are_near_sound_and_apart() {
    let mut several = 0;
    for (deg, objective) in [(0.0, Objective::Mean), (2.0, Objective::Mean), (2.0, Objective::Quantile)] {
        for x in [100.0, 220.0, 340.0] {
            let mut problem = problem(&[[x, -40.0], [-300.0, 0.5 * x], [50.0, 400.0]], deg);
            problem.objective = objective;
            if objective == Objective::Quantile {
                problem.eavesdroppers[0].uncertainty = Uncertainty::Disc { radius_m: 30.0 };
            }
            let near = Near { most: 3, tolerance: 0.05 };
            let plans = plan_slot_near(&problem, &Options::default(), near).unwrap();
            assert!((1..=3).contains(&plans.len()));
            several += usize::from(plans.len() > 1);
            let best = plan_slot(&problem, &Options::default()).unwrap().secrecy_rate_bps;
            for (k, plan) in plans.iter().enumerate() {
                assert_sound(&problem, plan, "near");
                // The tolerance is on the objective; the mean rate is near it.
                assert!(plan.secrecy_rate_bps > 0.9 * best, "{} {best}", plan.secrecy_rate_bps);
                for other in &plans[..k] {
                    assert!(plan.vehicles != other.vehicles);
                }
            }
            if objective == Objective::Mean {
                assert!((plans[0].secrecy_rate_bps / best - 1.0).abs() < 1e-4);
            }
        }
    }
    assert!(several >= 1, "no problem has two optima within 5%");
}

/// Plans are the same bits on every machine: no function of the system's library, no vector width and no number of
/// threads is in them. Both vehicles compare this digest.
#[test]
fn regress_digests_of_plans() {
    let kinds = [
        (0.0, Objective::Mean),
        (2.0, Objective::Mean),
        (2.0, Objective::Nominal),
        (2.0, Objective::WorstCase),
        (2.0, Objective::Quantile),
    ];
    let digests: Vec<String> = kinds
        .into_iter()
        .map(|(deg, objective)| {
            let mut problem = problem(&[[120.0, -40.0], [-300.0, 210.0]], deg);
            problem.objective = objective;
            problem.free_yaw = objective == Objective::Nominal;
            if matches!(objective, Objective::WorstCase | Objective::Quantile) {
                problem.eavesdroppers[0].uncertainty = Uncertainty::Disc { radius_m: 40.0 };
            }
            let plan = plan_slot(&problem, &Options::default()).unwrap();
            hex(&Plan::new(vec![PlannedSlot {
                user: "u".into(),
                plan,
                lean_rad: PerVehicle { i: None, j: None },
                length: None,
            }])
            .digest)[..16]
                .to_owned()
        })
        .collect();
    assert_eq!(
        digests,
        ["360b472d795d33dd", "508a77ee41e6b45b", "48db51031504a313", "eeb9de7f8820cd11", "f79da6bccb7586ea"]
    );
}

/// Nothing that shapes a plan calls the system's mathematical library, whose last digit differs from machine to machine.
#[test]
fn spec_the_planner_calls_no_function_of_the_systems_library() {
    const FUNCTIONS: [&str; 18] = [
        "sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sin_cos", "ln", "ln_1p", "log2", "log10",
        "exp", "exp2", "exp_m1", "powf", "powi", "hypot",
    ];
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut files: Vec<_> = ["pattern", "jitter", "secrecy", "antenna", "measured", "fading"]
        .map(|f| root.join(format!("radio/{f}.rs")))
        .into();
    let mut folders = vec![root.join("planner")];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            // Bounds are not part of a plan's digest.
            if path.ends_with("planner/bound") || path.ends_with("planner/cap.rs") {
                continue;
            }
            if path.is_dir() {
                folders.push(path);
            } else {
                files.push(path);
            }
        }
    }
    assert!(files.len() > 20);
    for path in files {
        let text = std::fs::read_to_string(&path).unwrap();
        let code = text.split("#[cfg(test)]").next().unwrap();
        for (number, line) in
            code.lines().enumerate().filter(|(_, line)| !line.trim_start().starts_with("//"))
        {
            let called = FUNCTIONS
                .iter()
                .find(|f| line.contains(&format!(".{f}(")) || line.contains(&format!("f64::{f}")));
            assert_eq!(called, None, "{}:{}: {line}", path.display(), number + 1);
        }
    }
}

/// Asserts that a plan keeps every constraint to 1e-9 and holds no NaN. Written again from the mission, not from the
/// planner's own constraints.
fn assert_sound(problem: &Problem, plan: &SlotPlan, what: &str) {
    let area = &problem.airspace.area_enu_m;
    for role in Role::BOTH {
        let VehiclePlan { pose, tx_power_w } = plan.vehicles[role];
        let [low, high] = problem.airspace.altitude_m;
        let p = pose.position_enu_m;
        let all = [p.x, p.y, p.z, pose.roll_rad, pose.pitch_rad, pose.yaw_rad, tx_power_w];
        assert!(all.iter().all(|v| v.is_finite()), "{what}: {all:?}");
        assert!(p.z >= low - 1e-9 && p.z <= high + 1e-9, "{what}: altitude {}", p.z);
        assert!((0.0..=problem.radio.max_power_w[role]).contains(&tx_power_w), "{what}: power {tx_power_w}");
        let quarter = std::f64::consts::FRAC_PI_2;
        assert!(pose.roll_rad.abs() <= quarter && pose.pitch_rad.abs() <= quarter, "{what}: {pose:?}");
        let tilt = pose.antenna_axis().xy().norm().atan2(pose.antenna_axis().z.abs());
        let model = problem.vehicles[role];
        let limit = if model.airframe == Airframe::Conventional { 0.0 } else { model.max_tilt_rad };
        assert!(tilt <= limit + 1e-9, "{what}: tilt {tilt} over {limit}");
        assert!(problem.free_yaw || pose.yaw_rad == 0.0, "{what}: yaw");
        let (mut inside, mut distance) = (false, f64::INFINITY);
        for (k, a) in area.iter().enumerate() {
            let b = area[(k + 1) % area.len()];
            if (a.y > p.y) != (b.y > p.y) && p.x < (b.x - a.x) * (p.y - a.y) / (b.y - a.y) + a.x {
                inside = !inside;
            }
            let t = ((p.xy() - a).dot(&(b - a)) / (b - a).norm_squared()).clamp(0.0, 1.0);
            distance = distance.min((p.xy() - a - t * (b - a)).norm());
        }
        assert!(inside || distance < 1e-9, "{what}: {distance} m outside");
    }
    let apart = (plan.vehicles.i.pose.position_enu_m - plan.vehicles.j.pose.position_enu_m).norm();
    assert!(apart >= problem.airspace.min_separation_m - 1e-9, "{what}: {apart} m apart");
    let rates = [plan.secrecy_rate_bps, plan.standard_error_bps, plan.upper_bound_bps, plan.user_sinr];
    assert!(
        rates.iter().chain(&plan.eavesdropper_sinr).all(|v| v.is_finite() && *v >= 0.0),
        "{what}: {plan:?}"
    );
    assert!(plan.secrecy_rate_bps <= plan.upper_bound_bps * (1.0 + 1e-12), "{what}: above the cap");
    let silent = plan.vehicles.i.tx_power_w == 0.0;
    assert_eq!(plan.status == Status::NoPositiveRate, silent && plan.secrecy_rate_bps == 0.0, "{what}");
}

/// Plans by every method and checks the plans; the number of starts is lowered to what a test can afford.
fn plan_all(problem: &Problem, what: &str) -> Vec<SlotPlan> {
    METHODS
        .iter()
        .map(|method| {
            let plan =
                plan_slot(problem, &Options { method: *method, starts: Some(12), ..Options::default() });
            let plan = plan.unwrap_or_else(|e| panic!("{what} {method:?}: {e}"));
            assert_sound(problem, &plan, &format!("{what} {method:?}"));
            plan
        })
        .collect()
}

#[test]
fn spec_degenerate_inputs_have_sound_plans() {
    for deg in [0.0, 2.0] {
        let usual = problem(&[[120.0, -40.0], [-300.0, 210.0]], deg);
        let change = |f: &dyn Fn(&mut Problem)| {
            let mut changed = usual.clone();
            f(&mut changed);
            changed
        };
        // With an eavesdropper at the user nothing is secret.
        for plan in plan_all(&problem(&[[0.0, 0.0], [-300.0, 210.0]], deg), "eavesdropper at the user") {
            assert_eq!(plan.status, Status::NoPositiveRate);
            assert_eq!(plan.secrecy_rate_bps, 0.0);
        }
        plan_all(&problem(&[[120.0, -40.0], [120.0, -40.0]], deg), "two at the same place");
        let ring: Vec<_> = (0..100).map(|k| f64::from(k) * std::f64::consts::TAU / 100.0).collect();
        let ring: Vec<_> = ring.iter().map(|a| [150.0 * a.cos(), 150.0 * a.sin()]).collect();
        plan_all(&problem(&ring, deg), "a hundred on a ring");
        plan_all(&change(&|p| p.airspace.altitude_m = [80.0, 80.0]), "a band of one altitude");
        for plan in
            plan_all(&change(&|p| p.radio.max_power_w = PerVehicle { i: 0.0, j: 0.5 }), "I without power")
        {
            assert_eq!(plan.status, Status::NoPositiveRate);
        }
        plan_all(&change(&|p| p.radio.max_power_w = PerVehicle { i: 0.5, j: 0.0 }), "J without power");
        plan_all(&change(&|p| p.airspace.altitude_m = [-10.0, 10.0]), "user inside the airspace");
        plan_all(&change(&|p| p.user_enu_m.z = 500.0), "user above the airspace");
        plan_all(
            &change(&|p| p.eavesdroppers[0].position_enu_m = Vector3::new(3.0, 2.0, 80.0)),
            "eavesdropper in the way",
        );
        plan_all(&change(&|p| p.radio.noise_power_w = 1e-30), "hardly any noise");
        plan_all(&change(&|p| p.radio.reference_gain = 1e-12), "hardly any signal");
        plan_all(&change(&|p| p.airspace.area_enu_m = square(1.0)), "an area just large enough");
        plan_all(&change(&|p| p.airspace.min_separation_m = 1400.0), "a separation across the whole area");
        plan_all(&change(&|p| p.vehicles.i.max_tilt_rad = 0.0), "no tilt at all");
        plan_all(&change(&|p| p.vehicles.j.max_tilt_rad = 1e-3), "hardly any tilt");
        let far = Vector3::new(9e5, -9e5, 0.0);
        let shift = |p: &mut Problem| {
            p.user_enu_m += far;
            p.eavesdroppers.iter_mut().for_each(|e| e.position_enu_m += far);
            p.airspace.area_enu_m.iter_mut().for_each(|v| *v += far.xy());
        };
        plan_all(&change(&shift), "far coordinates");
        plan_all(&change(&|p| p.eavesdroppers[1].position_enu_m = far), "an eavesdropper far away");
        plan_all(&change(&|p| p.jitter.std_rad = 1.5), "jitter beyond sense");
        // A level vehicle's best place is right above a node, where its antenna points at it.
        plan_all(&change(&|p| p.vehicles.i.airframe = Airframe::Conventional), "I over an eavesdropper");
        plan_all(&change(&|p| p.vehicles.j.airframe = Airframe::Conventional), "J over the user");
        let over = |x, y| VehiclePlan {
            pose: Pose {
                position_enu_m: Vector3::new(x, y, 80.0),
                roll_rad: 0.0,
                pitch_rad: 0.0,
                yaw_rad: 0.0,
            },
            tx_power_w: 0.5,
        };
        let score = evaluate(
            &usual,
            &PerVehicle { i: over(120.0, -40.0), j: over(0.0, 0.0) },
            &EvaluateOptions { samples: 256, ..EvaluateOptions::default() },
        )
        .unwrap();
        assert!(score.secrecy_rate_bps.is_finite() && score.standard_error_bps.is_finite());
        assert_eq!(score.eavesdropper_sinr[0], 0.0, "I's null is on it");
        assert!(score.user_sinr > 0.0, "J's null is on the user");
    }
}

fn square(half: f64) -> Vec<Vector2<f64>> {
    [[-half, -half], [half, -half], [half, half], [-half, half]]
        .iter()
        .map(|c| Vector2::new(c[0], c[1]))
        .collect()
}

#[test]
fn spec_meaningless_problems_are_refused() {
    let refuse = |f: &dyn Fn(&mut Problem)| {
        let mut changed = problem(&[[120.0, -40.0]], 2.0);
        f(&mut changed);
        let error = plan_slot(&changed, &Options::default()).unwrap_err();
        assert_eq!(cap(&changed).unwrap_err().to_string(), error.to_string());
        assert!(error.to_string().len() > 20);
        error
    };
    assert_eq!(refuse(&|p| p.eavesdroppers.clear()), PlanError::NoEavesdropper);
    assert_eq!(refuse(&|p| p.radio.noise_power_w = 0.0), PlanError::NoNoise);
    let small = refuse(&|p| {
        p.airspace.area_enu_m = square(1.0);
        p.airspace.altitude_m = [80.0, 81.0];
    });
    assert!(
        matches!(small, PlanError::SeparationImpossible { separation_m: 5.0, reach_m } if (reach_m - 3.0).abs() < 1e-9)
    );
    let line = refuse(&|p| p.airspace.area_enu_m.truncate(2));
    assert_eq!(line, PlanError::EmptyArea { vertices: 2 });
    let crossed = refuse(&|p| p.airspace.area_enu_m.swap(1, 2));
    assert_eq!(crossed, PlanError::EmptyArea { vertices: 4 });
    let out_of_range: [&dyn Fn(&mut Problem); 9] = [
        &|p| p.user_enu_m.x = f64::NAN,
        &|p| p.eavesdroppers[0].position_enu_m.y = f64::INFINITY,
        &|p| p.eavesdroppers[0].position_enu_m.y = 1e300,
        &|p| p.radio.noise_power_w = -1e-12,
        &|p| p.radio.max_power_w.j = -0.5,
        &|p| p.airspace.altitude_m = [300.0, 80.0],
        &|p| p.airspace.min_separation_m = f64::NAN,
        &|p| p.jitter.std_rad = -0.1,
        &|p| p.vehicles.i.max_tilt_rad = f64::NAN,
    ];
    for f in out_of_range {
        assert!(matches!(refuse(f), PlanError::OutOfRange { .. }));
    }
    let usual = problem(&[[120.0, -40.0]], 2.0);
    let mut vehicles =
        plan_slot(&usual, &Options { starts: Some(4), ..Options::default() }).unwrap().vehicles;
    vehicles.i.tx_power_w = f64::NAN;
    assert!(evaluate(&usual, &vehicles, &EvaluateOptions::default()).is_err());
}

/// A problem of the field: everything at once.
fn field_problem() -> impl Strategy<Value = Problem> {
    let node = (-500.0..500.0, -500.0..500.0, 0.0..40.0);
    let nodes = prop::collection::vec(node, 1..6);
    let star = prop::collection::vec(120.0..500.0, 4..9);
    let limits = (0.05..1.7, 0.05..1.7, 0.0..150.0, 0.0..150.0);
    let vehicles = (0..4u8, any::<bool>(), any::<bool>());
    let radio = (0.01..2.0, 0.0..2.0, -6.0..0.0, 0.0..6.0);
    (nodes, star, limits, vehicles, radio, -300.0..300.0, -300.0..300.0).prop_map(
        |(
            nodes,
            star,
            (tilt_i, tilt_j, separation, depth),
            (levels, yaw, body),
            (pi, pj, gain, deg),
            x,
            y,
        )| {
            let mut p = problem(&[], if deg < 1.0 { 0.0 } else { deg });
            let node = |n: &(f64, f64, f64)| Eavesdropper {
                position_enu_m: Vector3::new(n.0, n.1, n.2),
                uncertainty: Uncertainty::None,
            };
            p.eavesdroppers = nodes.iter().map(node).collect();
            let n = star.len() as f64;
            let corner = |(k, r): (usize, &f64)| {
                let angle = std::f64::consts::TAU * k as f64 / n;
                Vector2::new(r * angle.cos(), r * angle.sin())
            };
            p.airspace.area_enu_m = star.iter().enumerate().map(corner).collect();
            p.airspace.min_separation_m = separation;
            p.airspace.altitude_m = [60.0, 60.0 + depth];
            (p.vehicles.i.max_tilt_rad, p.vehicles.j.max_tilt_rad) = (tilt_i, tilt_j);
            if levels & 1 > 0 {
                p.vehicles.i.airframe = Airframe::Conventional;
            }
            if levels & 2 > 0 {
                p.vehicles.j.airframe = Airframe::Conventional;
            }
            p.free_yaw = yaw;
            p.jitter.model = if body { JitterModel::Body } else { JitterModel::Euler };
            p.radio.max_power_w = PerVehicle { i: pi, j: pj };
            p.radio.reference_gain = 10f64.powf(gain);
            p.user_enu_m = Vector3::new(x, y, 5.0);
            p
        },
    )
}

fn vehicle() -> impl Strategy<Value = VehiclePlan> {
    let angle = -1.5..1.5;
    (-400.0..400.0, -400.0..400.0, 80.0..300.0, angle.clone(), angle, 1e-4..0.5).prop_map(
        |(x, y, z, roll_rad, pitch_rad, tx_power_w)| VehiclePlan {
            pose: Pose { position_enu_m: Vector3::new(x, y, z), roll_rad, pitch_rad, yaw_rad: 0.0 },
            tx_power_w,
        },
    )
}

fn rate(problem: &Problem, vehicles: &PerVehicle<VehiclePlan>) -> f64 {
    let options = EvaluateOptions { samples: 1024, ..EvaluateOptions::default() };
    evaluate(problem, vehicles, &options).unwrap().secrecy_rate_bps
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn prop_plans_of_the_field_are_feasible(problem in field_problem()) {
        for method in METHODS {
            let plan = plan_slot(&problem, &Options { method, starts: Some(6), ..Options::default() }).unwrap();
            assert_sound(&problem, &plan, &format!("{method:?}"));
        }
    }

    #[test]
    fn prop_order_of_eavesdroppers_is_irrelevant(i in vehicle(), j in vehicle(), shift in 1..4usize) {
        let vehicles = PerVehicle { i, j };
        let mut problem = problem(&[[120.0, -40.0], [-300.0, 210.0], [40.0, 50.0], [9.0, -400.0]], 2.0);
        let before = rate(&problem, &vehicles);
        problem.eavesdroppers.rotate_left(shift);
        prop_assert_eq!(rate(&problem, &vehicles), before);
    }

    #[test]
    fn prop_opposite_axes_are_the_same_antenna(i in vehicle(), j in vehicle(), deg in 0.0..5.0) {
        let problem = problem(&[[120.0, -40.0], [-300.0, 210.0]], deg);
        let before = rate(&problem, &PerVehicle { i, j });
        let mut turned = i;
        turned.pose.roll_rad += std::f64::consts::PI;
        let after = rate(&problem, &PerVehicle { i: turned, j });
        prop_assert!((after - before).abs() < 1e-3, "{} {}", before, after);
    }

    /// The whole scene turned about the vertical through the user: the same rate without jitter, and under body-axis
    /// jitter, where turning is a change of yaw.
    #[test]
    fn prop_turning_the_scene_changes_nothing(i in vehicle(), j in vehicle(), angle in -3.0..3.0) {
        let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), angle);
        for (model, deg) in [(JitterModel::Euler, 0.0), (JitterModel::Body, 3.0)] {
            let mut problem = problem(&[[120.0, -40.0], [-300.0, 210.0]], deg);
            problem.jitter.model = model;
            let before = rate(&problem, &PerVehicle { i, j });
            for e in &mut problem.eavesdroppers {
                e.position_enu_m = turn * e.position_enu_m;
            }
            let turned = PerVehicle { i, j }.map(|mut v: VehiclePlan| {
                v.pose.position_enu_m = turn * v.pose.position_enu_m;
                v.pose.yaw_rad += angle;
                v
            });
            let after = rate(&problem, &turned);
            prop_assert!((after - before).abs() < 1e-3, "{:?}: {} {}", model, before, after);
            if deg == 0.0 {
                // At yaw 0, by the canonical angles of the turned axis.
                let flat = turned.map(|mut v| {
                    (v.pose.roll_rad, v.pose.pitch_rad) = pattern::canonical_angles(&v.pose.antenna_axis());
                    v.pose.yaw_rad = 0.0;
                    v
                });
                prop_assert!((rate(&problem, &flat) - before).abs() < 1e-3);
            }
        }
    }

    /// P_I = Pmax is optimal with [.]^+ inside the expectation.
    #[test]
    fn prop_more_power_for_i_is_never_worse(i in vehicle(), j in vehicle(), deg in 0.0..5.0) {
        let problem = problem(&[[120.0, -40.0], [-300.0, 210.0]], deg);
        let full = VehiclePlan { tx_power_w: 0.5, ..i };
        let (part, full) = (rate(&problem, &PerVehicle { i, j }), rate(&problem, &PerVehicle { i: full, j }));
        prop_assert!(full >= part - 1e-6, "{} {}", part, full);
    }
}

#[test]
fn spec_rate_rises_with_maximum_power() {
    for deg in [0.0, 2.0] {
        let mut last = 0.0;
        for power in [0.05, 0.1, 0.3, 0.5, 1.0] {
            let mut problem = problem(&[[120.0, -40.0], [-300.0, 210.0], [50.0, 400.0]], deg);
            problem.radio.max_power_w = PerVehicle { i: power, j: power };
            let rate = plan_slot(&problem, &Options::default()).unwrap().secrecy_rate_bps;
            assert!(rate > last, "{deg} deg, {power} W: {rate} after {last}");
            last = rate;
        }
    }
}

#[test]
fn spec_freeing_yaw_gains_under_euler_jitter() {
    let mut problem = problem(&[[120.0, -40.0], [-300.0, 210.0]], 5.0);
    let bound = plan_slot(&problem, &Options::default()).unwrap().secrecy_rate_bps;
    problem.free_yaw = true;
    let plan = plan_slot(&problem, &Options::default()).unwrap();
    assert_sound(&problem, &plan, "free yaw");
    assert!(plan.secrecy_rate_bps > bound + 1e5, "{} {bound}", plan.secrecy_rate_bps);
}

/// A sample of the reference scenarios; the example `reference` prints all of them.
mod reference {
    use super::*;

    #[path = "../../examples/reference/data.rs"]
    #[allow(dead_code)]
    mod data;

    #[test]
    fn val_no_jitter_reaches_the_best_known() {
        for row in data::no_jitter().unwrap().iter().step_by(23) {
            let problem =
                data::paper(&data::eavesdroppers(row.n).unwrap()[row.scenario], row.max_power_w, 0.0);
            let rate = plan_slot(&problem, &Options::default()).unwrap().secrecy_rate_bps / 1e6;
            assert!(
                rate > row.best * (1.0 - 1e-4),
                "N {} scenario {}: {rate} of {}",
                row.n,
                row.scenario,
                row.best
            );
            assert!(rate <= row.cap + 1e-9 && (cap(&problem).unwrap() / 1e6 - row.cap).abs() < 1e-5);
        }
    }

    #[test]
    fn val_jitter_reaches_the_best_known_and_the_evaluator_agrees() {
        for row in data::jitter().unwrap().iter().step_by(7) {
            let problem =
                data::paper(&data::eavesdroppers(row.n).unwrap()[row.scenario], 0.5, row.jitter_deg);
            let score =
                |v| evaluate(&problem, v, &EvaluateOptions::default()).unwrap().secrecy_rate_bps / 1e6;
            // Two independent evaluators agree to 5e-4.
            assert!(
                (score(&row.plan) - row.best_clipped).abs() < 1e-3,
                "N {} scenario {}",
                row.n,
                row.scenario
            );
            let rate = score(&plan_slot(&problem, &Options::default()).unwrap().vehicles);
            assert!(rate > row.best_clipped * (1.0 - 1e-3), "N {} scenario {}: {rate}", row.n, row.scenario);
            assert!(rate > row.paper);
        }
    }

    #[test]
    fn val_field_variants_reach_the_best_known() {
        for variant in data::variants().unwrap().iter().step_by(3) {
            let (name, problem) = (&variant.name, &variant.problem);
            let score =
                |v| evaluate(problem, v, &EvaluateOptions::default()).unwrap().objective_rate_bps / 1e6;
            assert!((score(&variant.plan) - variant.best).abs() < 2e-3, "{name}: {}", score(&variant.plan));
            let plan = plan_slot(problem, &Options::default()).unwrap();
            assert_sound(problem, &plan, name);
            assert!(
                score(&plan.vehicles) > variant.best - 0.05,
                "{name}: {} of {}",
                score(&plan.vehicles),
                variant.best
            );
        }
    }

    /// The order of the paper's own figure: paper > interior point > conventional.
    #[test]
    fn val_methods_are_in_the_papers_order() {
        let scenarios = data::eavesdroppers(2).unwrap();
        let mean = |method| {
            let rates = scenarios.iter().step_by(4).map(|eavesdroppers| {
                let problem = data::paper(eavesdroppers, 0.5, 0.0);
                plan_slot(&problem, &Options { method, ..Options::default() }).unwrap().secrecy_rate_bps / 1e6
            });
            rates.sum::<f64>() / 25.0
        };
        let [ours, paper, interior, level] =
            [Method::Veilwing, Method::Paper, Method::InteriorPoint, Method::Conventional].map(mean);
        assert!(
            ours > paper && paper > interior + 0.3 && interior > level + 3.0,
            "{ours} {paper} {interior} {level}"
        );
        assert!((paper / 25.99 - 1.0).abs() < 5e-3, "{paper}");
        // From many starts both benchmarks are what they can be: below ours, and nowhere near their one start.
        let [interior_many, level_many] =
            [Method::InteriorPointMultiStart, Method::ConventionalMultiStart].map(mean);
        assert!(ours > interior_many && interior_many > interior + 0.3, "{ours} {interior_many} {interior}");
        assert!((level_many / 23.38 - 1.0).abs() < 1e-2, "{level_many}");
    }

    #[test]
    fn spec_planning_for_positions_pays() {
        let scenarios = data::eavesdroppers(2).unwrap();
        let mut sums = [[0.0; 3]; 4];
        let objectives = [Objective::Nominal, Objective::Mean, Objective::Quantile, Objective::WorstCase];
        for eavesdroppers in scenarios.iter().step_by(16) {
            let mut problem = data::paper(eavesdroppers, 0.5, 2.0);
            for e in &mut problem.eavesdroppers {
                e.uncertainty = Uncertainty::Disc { radius_m: 50.0 };
            }
            for (planned, sums) in objectives.iter().zip(&mut sums) {
                problem.objective = *planned;
                let vehicles = plan_slot(&problem, &Options::default()).unwrap().vehicles;
                for (scored, sum) in objectives[1..].iter().zip(sums) {
                    problem.objective = *scored;
                    let options = EvaluateOptions { samples: 16_384, ..EvaluateOptions::default() };
                    *sum += evaluate(&problem, &vehicles, &options).unwrap().objective_rate_bps;
                }
            }
        }
        let [nominal, mean, quantile, worst] = sums;
        assert!(mean[0] > nominal[0] && mean[1] > nominal[1]);
        assert!(quantile[1] > mean[1] && worst[2] > quantile[2] && mean[0] > quantile[0]);
    }
}

/// An eavesdropper that may stand beside the user, or where it stands: there is no secrecy there whatever the plan, and a search
/// that takes that place for the worst has the less to climb. 3.69 bit/s/Hz with it, 3.89 without.
/// Many short steps along the edge of the area, each of which rounds.
#[test]
fn regress_no_plan_drifts_over_an_edge_that_it_slides_along() {
    let mut problem = problem(&[[181.897_365_534_144_26, 322.811_802_262_751_5]], 0.0);
    problem.jitter.std_rad = 0.028_185_685_042_575_99;
    problem.eavesdroppers[0].position_enu_m.z = 11.529_573_490_813_116;
    problem.eavesdroppers.push(Eavesdropper {
        position_enu_m: Vector3::new(243.277_297_829_726_34, -322.400_857_373_584_76, 0.0),
        uncertainty: Uncertainty::None,
    });
    problem.user_enu_m = Vector3::new(282.736_784_249_682_4, 0.0, 5.0);
    problem.airspace.area_enu_m = [
        [144.246_858_324_371_52, 0.0],
        [214.161_310_411_378_9, 268.549_789_117_739_8],
        [-45.612_180_886_587_38, 199.840_021_750_719_7],
        [-379.119_256_132_469_4, 182.574_211_254_587_82],
        [-336.084_563_703_574_4, -161.849_795_652_643_4],
        [-71.780_969_484_627_93, -314.492_975_873_336_26],
        [200.728_603_054_202_18, -251.705_706_864_410_3],
    ]
    .map(Vector2::from)
    .to_vec();
    problem.airspace.altitude_m = [60.0, 60.0];
    problem.airspace.min_separation_m = 0.0;
    problem.radio.max_power_w = PerVehicle { i: 0.510_844_881_519_145_5, j: 1.087_491_512_734_301_4 };
    problem.radio.reference_gain = 0.000_154_971_068_355_913_44;
    problem.vehicles.i.max_tilt_rad = 0.484_283_575_062_408_43;
    problem.vehicles.j.airframe = Airframe::Conventional;
    for method in METHODS {
        let plan = plan_slot(&problem, &Options { method, starts: Some(6), ..Options::default() }).unwrap();
        assert_sound(&problem, &plan, &format!("{method:?}"));
    }
}

#[test]
fn regress_a_disc_that_holds_the_user_leaves_something_to_plan_for() {
    let mut problem = problem(&[[-15.9, -24.3], [-327.1, -125.5]], 1.0);
    problem.objective = Objective::WorstCase;
    for (e, radius_m) in problem.eavesdroppers.iter_mut().zip([53.6, 24.7]) {
        e.uncertainty = Uncertainty::Disc { radius_m };
    }
    let vehicles = plan_slot(&problem, &Options::default()).unwrap().vehicles;
    // The least mean rate over a grid of the first disc, but within 3 m of the user; the other where it is said to be.
    let mut certain = problem.clone();
    certain.objective = Objective::Mean;
    certain.eavesdroppers.iter_mut().for_each(|e| e.uncertainty = Uncertainty::None);
    let centre = problem.eavesdroppers[0].position_enu_m;
    let mut least = f64::INFINITY;
    for (east, north) in (-10..=10).flat_map(|a| (-10..=10).map(move |b| (f64::from(a), f64::from(b)))) {
        let at = centre + 5.36 * Vector3::new(east, north, 0.0);
        if (at - centre).norm() <= 53.6 && (at - problem.user_enu_m).norm() >= 3.0 {
            certain.eavesdroppers[0].position_enu_m = at;
            let rate = evaluate(&certain, &vehicles, &EvaluateOptions::default()).unwrap();
            least = least.min(rate.objective_rate_bps / 1e6);
        }
    }
    assert!(least > 3.8, "{least}");
}

/// Wide positions without jitter: along J's exact null an axis of its own is a ridge on which a search stops; it lost 0.45
/// bit/s/Hz here against 400 starts of other code (`--example judge -- wide-gaussians --missions 1 --first 23 --seed 2026`).
#[test]
fn regress_a_quantile_without_jitter_is_searched_along_the_null() {
    let mut problem =
        problem(&[[-52.9, 85.6], [396.6, 377.0], [320.6, 226.8], [-423.4, 189.1], [83.2, 373.6]], 0.0);
    problem.eavesdroppers.iter_mut().for_each(|e| e.uncertainty = Uncertainty::Gaussian { std_m: 80.0 });
    for (objective, least) in [(Objective::Quantile, 23.64), (Objective::Mean, 24.0)] {
        problem.objective = objective;
        let plan = plan_slot(&problem, &Options::default()).unwrap();
        let scored = evaluate(&problem, &plan.vehicles, &EvaluateOptions::default()).unwrap();
        let rate = scored.objective_rate_bps / problem.radio.bandwidth_hz;
        assert!(rate > least, "{objective:?}: {rate}");
    }
}
