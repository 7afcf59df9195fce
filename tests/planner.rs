//! The planner from outside: what a user of the library relies on.

use nalgebra::{Vector2, Vector3};
use veilwing::planner::problem::{
    Airframe, Airspace, Eavesdropper, Jitter, JitterAxes, JitterModel, Method, Objective, Problem, Radio,
    Uncertainty, VehicleModel,
};
use veilwing::planner::{EvaluateOptions, Options, cap, evaluate, plan_slot};
use veilwing::role::PerVehicle;

fn problem(eavesdroppers: &[[f64; 2]], jitter_deg: f64) -> Problem {
    let vehicle =
        VehicleModel { airframe: Airframe::Omnidirectional, max_tilt_rad: std::f64::consts::FRAC_PI_2 };
    let corners = [[-500.0, -500.0], [500.0, -500.0], [500.0, 500.0], [-500.0, 500.0]];
    Problem {
        user_enu_m: Vector3::zeros(),
        eavesdroppers: eavesdroppers
            .iter()
            .map(|p| Eavesdropper {
                position_enu_m: Vector3::new(p[0], p[1], 0.0),
                uncertainty: Uncertainty::None,
            })
            .collect(),
        radio: Radio {
            bandwidth_hz: 1e6,
            noise_power_w: 1e-12,
            max_power_w: PerVehicle { i: 0.5, j: 0.5 },
            reference_gain: 1.0,
        },
        airspace: Airspace {
            altitude_m: [80.0, 300.0],
            area_enu_m: corners.iter().map(|c| Vector2::new(c[0], c[1])).collect(),
            min_separation_m: 5.0,
        },
        vehicles: PerVehicle { i: vehicle, j: vehicle },
        jitter: Jitter {
            std_rad: jitter_deg.to_radians(),
            model: JitterModel::Euler,
            axes: JitterAxes::RollPitch,
        },
        objective: Objective::Mean,
        free_yaw: false,
    }
}

const METHODS: [Method; 5] =
    [Method::Veilwing, Method::Paper, Method::InteriorPoint, Method::Conventional, Method::JammerOrientation];

#[test]
fn prop_two_threads_equal_one_bit_for_bit() {
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
fn prop_evaluate_agrees_with_the_plans_own_figure() {
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
