//! Why a plan's rate is what it is, on problems whose answer is known beforehand; and what `plan` says of it.

#![cfg(feature = "companion")]
// Helpers of tests may fail the test.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod command;

use std::path::Path;

use nalgebra::Vector3;
use serde_json::Value;
use veilwing::geo::Pose;
use veilwing::planner::explanation::{Explanation, Limit, explain, unprotected};
use veilwing::planner::plan::VehiclePlan;
use veilwing::planner::problem::{Airframe, Objective, PowerSteps, Problem, Uncertainty};
use veilwing::planner::{EvaluateOptions, Options, plan_slot};
use veilwing::role::{PerVehicle, Role};

use command::veilwing;

/// A user at the origin, two eavesdroppers; what the planner makes of it is at the floor and at I's largest power.
fn problem() -> Problem {
    Problem::paper([[120.0, 80.0], [-300.0, 210.0]], 0.5, 2f64.to_radians())
}

fn explained(problem: &Problem) -> (Explanation, PerVehicle<VehiclePlan>) {
    let plan = plan_slot(problem, &Options::default()).unwrap();
    let options = EvaluateOptions { samples: 4096, ..EvaluateOptions::default() };
    (explain(problem, &plan.vehicles, &options).unwrap(), plan.vehicles)
}

#[test]
fn spec_each_limit_is_named_where_it_binds_and_gone_where_it_is_widened() {
    let with = |change: fn(&mut Problem)| {
        let mut changed = problem();
        change(&mut changed);
        changed
    };
    let cases = [
        (Limit::Floor(Role::I), with(|_| ()), with(|p| p.user_enu_m.z = 200.0)),
        (
            Limit::Fence(Role::J),
            with(|p| p.airspace.area_enu_m.iter_mut().for_each(|corner| *corner *= 0.02)),
            with(|_| ()),
        ),
        (
            Limit::Tilt(Role::I),
            with(|p| p.vehicles.i.max_tilt_rad = 0.3),
            with(|p| p.vehicles.i.max_tilt_rad = 1.5),
        ),
        (Limit::Tilt(Role::J), with(|p| p.vehicles.j.airframe = Airframe::Conventional), with(|_| ())),
        (
            Limit::MaxPower(Role::J),
            with(|p| p.radio.max_power_w.j = 1e-4),
            with(|p| p.radio.max_power_w.j = 5.0),
        ),
        (
            Limit::LeastPower(Role::J),
            with(|p| p.power_steps.j = PowerSteps::AtLeast(0.1)),
            with(|p| p.power_steps.j = PowerSteps::AtLeast(1e-6)),
        ),
        (
            Limit::Separation,
            with(|p| p.airspace.min_separation_m = 500.0),
            with(|p| p.airspace.min_separation_m = 1.0),
        ),
    ];
    for (limit, bound, free) in cases {
        let (why, vehicles) = explained(&bound);
        assert!(why.limits.contains(&limit), "{limit:?} is not in {:?}: {vehicles:?}", why.limits);
        let (why, vehicles) = explained(&free);
        assert!(!why.limits.contains(&limit), "{limit:?} is in {:?}: {vehicles:?}", why.limits);
    }
}

/// A vehicle that is held at its highest by hand has nothing to gain above: it stands there, and is not held down.
#[test]
fn spec_to_stand_at_a_limit_is_not_enough() {
    let problem = problem();
    let (_, mut vehicles) = explained(&problem);
    vehicles.i.pose.position_enu_m.z = problem.airspace.altitude_m[1];
    let options = EvaluateOptions { samples: 4096, ..EvaluateOptions::default() };
    let why = explain(&problem, &vehicles, &options).unwrap();
    assert!(!why.limits.contains(&Limit::Ceiling(Role::I)), "{:?}", why.limits);
    // Over a quantile the mean's slope says nothing, and standing there is enough.
    let mut quantile = Problem { objective: Objective::Quantile, ..problem };
    quantile.user_uncertainty = Uncertainty::Disc { radius_m: 1.0 };
    let why = explain(&quantile, &vehicles, &options).unwrap();
    assert!(why.limits.contains(&Limit::Ceiling(Role::I)), "{:?}", why.limits);
}

/// A slope that is claimed is there: a step beyond a limit that binds gains, by plain evaluation.
#[test]
fn val_beyond_a_limit_that_binds_the_rate_is_higher() {
    let problem = problem();
    let options = EvaluateOptions { samples: 65_536, ..EvaluateOptions::default() };
    let rate = |problem: &Problem, vehicles: &PerVehicle<VehiclePlan>| {
        veilwing::planner::evaluate(problem, vehicles, &options).unwrap().signed_rate_bps
    };
    let (why, vehicles) = explained(&problem);
    assert!(why.limits.contains(&Limit::Floor(Role::I)) && why.limits.contains(&Limit::MaxPower(Role::I)));
    let mut lower = vehicles;
    lower.i.pose.position_enu_m.z -= 1.0;
    assert!(rate(&problem, &lower) > rate(&problem, &vehicles) + 1e3);
    let mut stronger = vehicles;
    stronger.i.tx_power_w *= 2.0;
    assert!(rate(&problem, &stronger) > rate(&problem, &vehicles));
}

#[test]
fn spec_the_decisive_eavesdropper_is_the_one_whose_absence_gains_the_most() {
    let level = |x: f64, tx_power_w| VehiclePlan {
        pose: Pose {
            position_enu_m: Vector3::new(x, 0.0, 80.0),
            roll_rad: 0.0,
            pitch_rad: 0.0,
            yaw_rad: 0.0,
        },
        tx_power_w,
    };
    let vehicles = PerVehicle { i: level(60.0, 0.5), j: level(0.0, 0.0) };
    let options = EvaluateOptions { samples: 1024, ..EvaluateOptions::default() };
    let order = [[3000.0, 0.0], [150.0, 30.0], [4000.0, 0.0]];
    let problem = Problem::paper(order, 0.5, 0.0);
    let why = explain(&problem, &vehicles, &options).unwrap();
    assert_eq!(why.decisive.eavesdropper, 1);
    // Without it the next one sets the rate, which is scored by itself.
    let next = Problem::paper([order[0], order[2]], 0.5, 0.0);
    let expected = veilwing::planner::evaluate(&next, &vehicles, &options).unwrap().secrecy_rate_bps;
    assert_eq!(why.decisive.without_bps, Some(expected));
    assert!(expected > why.unprotected_bps + 1e6);
    // One alone is decisive, and there is nothing to compare with.
    let alone = Problem::paper([order[1]], 0.5, 0.0);
    let why = explain(&alone, &vehicles, &options).unwrap();
    assert_eq!((why.decisive.eavesdropper, why.decisive.without_bps), (0, None));
    // Where nothing is radiated, the one that makes it so.
    let problem = Problem::paper([[500.0, 0.0], [0.0, 0.0]], 0.5, 0.0);
    let plan = plan_slot(&problem, &Options::default()).unwrap();
    assert_eq!(plan.vehicles.i.tx_power_w, 0.0);
    let why = explain(&problem, &plan.vehicles, &options).unwrap();
    assert_eq!((why.decisive.eavesdropper, why.limits.len()), (1, 0));
}

#[test]
fn val_unprotected_is_the_rate_with_j_off() {
    let problem = problem();
    let options = EvaluateOptions { samples: 4096, ..EvaluateOptions::default() };
    let (why, mut vehicles) = explained(&problem);
    vehicles.j.tx_power_w = 0.0;
    let silent = veilwing::planner::evaluate(&problem, &vehicles, &options).unwrap().secrecy_rate_bps;
    assert_eq!(why.unprotected_bps, silent);
    let best = unprotected(&problem, &Options::default()).unwrap();
    assert_eq!(best.vehicles.j.tx_power_w, 0.0);
    let protected = plan_slot(&problem, &Options::default()).unwrap().secrecy_rate_bps;
    assert!(silent <= best.secrecy_rate_bps && best.secrecy_rate_bps < protected, "{silent} {best:?}");
}

fn document(path: &str) -> Value {
    let output = veilwing(&["plan", path, "--json"]).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn spec_the_document_and_the_table_say_what_binds_who_is_decisive_and_what_jamming_is_worth() {
    let document = document("config/mission.toml");
    let text = veilwing(&["plan", "config/mission.toml"]).output().unwrap().stdout;
    let text = String::from_utf8(text).unwrap();
    for slot in document["slots"].as_array().unwrap() {
        let rate = |key: &str| slot[key].as_f64().unwrap();
        assert!(rate("unprotected_rate_bps") <= rate("best_unprotected_rate_bps"));
        assert!(rate("best_unprotected_rate_bps") < rate("secrecy_rate_bps"));
        assert!(rate("without_decisive_bps") > rate("secrecy_rate_bps"));
        let limits: Vec<&str> =
            slot["limits"].as_array().unwrap().iter().map(|limit| limit.as_str().unwrap()).collect();
        assert!(limits.contains(&"i.floor") && limits.contains(&"i.max-power"), "{limits:?}");
        let decisive = slot["decisive_eavesdropper"].as_str().unwrap();
        for said in [
            format!("with J off {:.3} at these poses", rate("unprotected_rate_bps") / 1e6),
            format!("set by eavesdropper {decisive}: without it"),
        ] {
            assert!(text.contains(&said), "{said:?} is not in {text}");
        }
    }
    for said in [
        "    I at its lowest, 20 m (airspace.altitude_m)\n    I at its largest power, 500.000 mW (radio.max_power_w)\n",
        "the search has converged",
        "slot  user                 transit_s",
        "   1  bravo",
        "to the end of the last slot",
    ] {
        assert!(text.contains(said), "{said:?} is not in {text}");
    }
    assert!(!text.contains("gap"), "a cap says nothing of a gap: {text}");
}

#[test]
fn spec_a_mission_without_homes_and_one_without_a_rate_are_explained_too() {
    let paper = std::fs::read_to_string("config/paper.toml").unwrap();
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join("no-rate.toml");
    let at_user = "[[eavesdropper]]\nname = \"beside\"\nenu_m = [0.0, 0.0, 0.0]\n\n[planner]";
    std::fs::write(&path, paper.replace("[planner]", at_user)).unwrap();
    let text = veilwing(&["plan", path.to_str().unwrap()]).output().unwrap().stdout;
    let text = String::from_utf8(text).unwrap();
    for said in [
        "set by eavesdropper beside",
        "limits that bind: none",
        "both transmitters stay off",
        "SINR: none, nothing is radiated",
        "[vehicles.i] and [vehicles.j] home_enu_m",
    ] {
        assert!(text.contains(said), "{said:?} is not in {text}");
    }
}
