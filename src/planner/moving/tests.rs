//! What motions promise: limits at every instant, never less than the plan that turns, rates that are the evaluator's.

use nalgebra::{Vector2, Vector3};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::geo::Pose;
use crate::planner::expectation::{EvaluateOptions, evaluate};
use crate::planner::plan::VehiclePlan;
use crate::planner::problem::{Airframe, NoFly};
use crate::planner::volume::testing::{Plain, SERVICE, problems};

const LIMITS: Limits =
    Limits { speed_m_s: 8.0, climb_m_s: 3.0, acceleration_m_s2: 2.5, jerk_m_s3: Some(4.0) };

fn both(limits: Limits) -> PerVehicle<Limits> {
    PerVehicle { i: limits, j: limits }
}

/// Users far apart and slots long: where motion pays.
fn wide() -> (Vec<Problem>, Service) {
    let mut problems = problems(2.0);
    let users = [[-160.0, -40.0], [190.0, 60.0], [-60.0, 210.0]];
    for (problem, [x, y]) in problems.iter_mut().zip(users) {
        problem.user_enu_m = Vector3::new(x, y, 0.0);
    }
    (problems, Service { slot_s: 20.0, ..SERVICE })
}

/// The motion that is found, however little it gains.
fn any_motion(
    problems: &[Problem],
    service: &Service,
    ways: &Plain,
    limits: &PerVehicle<Limits>,
) -> Option<Moving> {
    let options = Options::default();
    let joint = turning::plan(problems, service, ways, &options, None).unwrap();
    let setups: Vec<Setup> = problems.iter().map(|problem| Setup::new(problem).unwrap()).collect();
    let samples = setups.iter().map(|setup| volume::samples(setup, &options)).collect();
    let case = Case { setups: &setups, samples, service, ways, counts: vec![true; setups.len()] };
    let standing: Vec<Raw> = joint.slots.iter().map(|slot| Setup::raw(&slot.vehicles)).collect();
    let frames = frames(&case, &joint.protected, &standing);
    let (_, flown) = best(&case, &frames, &[limits.i, limits.j], &standing, &options)?;
    let [i, j] = flown.ways;
    Some(Moving { protected: flown.protected, ways: PerVehicle { i, j } })
}

/// Every limit at instants so close together that nothing slips through.
fn check(
    problems: &[Problem],
    moving: &Moving,
    service: &Service,
    ways: &Plain,
    limits: &PerVehicle<Limits>,
) {
    let air = &problems[0].airspace;
    let setup = Setup::new(&problems[0]).unwrap();
    let plan = &moving.protected;
    let step_s = 0.01;
    let mut before: Option<State> = None;
    for k in 0..=(plan.superframe_s / step_s) as usize + 3 {
        let state = moving.at(k as f64 * step_s).unwrap();
        for role in Role::BOTH {
            let (p, v) = (state.positions_enu_m[role], state.velocities_enu_m_s[role].vector());
            let a = state.accelerations_enu_m_s2[role].vector();
            let limits = &limits[role];
            assert!(v.xy().norm() <= limits.speed_m_s && v.z.abs() <= limits.climb_m_s, "{role} at {k}: {v}");
            assert!(a.norm() <= limits.acceleration_m_s2 * (1.0 + 1e-9), "{role} at {k}: {}", a.norm());
            assert!((air.altitude_m[0]..=air.altitude_m[1]).contains(&p.z), "{role} at {k}: {}", p.z);
            assert!(setup.region.allows(&p) && setup.region.contains(p.xy(), 0.0), "{role} at {k}: {p}");
            for area in &air.no_fly {
                assert!(area.depth_m(&p) <= 0.0, "{role} at {k}: in {}", area.name);
            }
            let tilt = match problems[0].vehicles[role].airframe {
                Airframe::Omnidirectional => problems[0].vehicles[role].max_tilt_rad,
                Airframe::Conventional => 0.0,
            };
            if tilt < std::f64::consts::FRAC_PI_2 {
                assert!(state.attitudes[role].antenna_axis().z >= libm::cos(tilt) - 1e-9, "{role} at {k}");
            }
            let most_w = state.served.map_or(0.0, |user| problems[user].radio.max_power_w[role]);
            assert!((0.0..=most_w).contains(&state.tx_powers_w[role]));
            if let Some(before) = &before {
                let angle = before.attitudes[role].angle_to(&state.attitudes[role]);
                let may = ways.turn_rate_rad_s * step_s;
                assert!(angle <= may * (1.0 + 1e-4) + 1e-7, "{role} at {k}: {angle} {may}");
                let change = a - before.accelerations_enu_m_s2[role].vector();
                let jerk = limits.jerk_m_s3.unwrap_or(f64::INFINITY);
                assert!(change.norm() <= jerk * step_s * (1.0 + 1e-6), "{role} at {k}");
                let moved = p - before.positions_enu_m[role];
                let mean = 0.5 * (v + before.velocities_enu_m_s[role].vector());
                assert!((moved - mean * step_s).norm() <= limits.acceleration_m_s2 * step_s * step_s);
            }
        }
        let apart_m = (state.positions_enu_m.i - state.positions_enu_m.j).norm();
        assert!(apart_m >= air.min_separation_m, "{apart_m} m at {k}");
        before = Some(state);
    }
    let mut begins_s = 0.0;
    for slot in &plan.slots {
        assert!(slot.silence_s >= service.guard_s);
        assert!((slot.knots[0].at_s - begins_s).abs() < 1e-9);
        assert!((slot.knots.last().unwrap().at_s - begins_s - slot.on_air_s).abs() < 1e-9);
        begins_s += slot.on_air_s + slot.silence_s;
        for knot in &slot.knots {
            let positions = moving.at(knot.at_s).unwrap().positions_enu_m;
            for role in Role::BOTH {
                assert!((knot.vehicles[role].pose.position_enu_m - positions[role]).norm() < 1e-6);
            }
        }
    }
    assert!((begins_s - plan.superframe_s).abs() < 1e-9);
    assert!(moving.ways.i.period_s == plan.superframe_s && moving.ways.j.period_s == plan.superframe_s);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(8))]

    #[test]
    fn prop_limits_hold_at_every_instant(
        seed in any::<u64>(),
        slot_s in 4.0..30.0f64,
        rate in 0.3..1.5f64,
        speed in 2.0..15.0f64,
        tilted in any::<bool>(),
        level in any::<bool>(),
        split in any::<bool>(),
    ) {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut problems = problems(2.0);
        let apart_m = [5.0, 60.0][usize::from(rng.random_range(0..2) == 0)];
        for problem in &mut problems {
            let mut place = |reach: f64| rng.random_range(-reach..reach);
            problem.user_enu_m = Vector3::new(place(250.0), place(250.0), 0.0);
            problem.airspace.min_separation_m = apart_m;
            // A pentagon with a notch, and not as wide as the users are apart.
            problem.airspace.area_enu_m = [[-150.0, -130.0], [160.0, -150.0], [190.0, 120.0], [20.0, 60.0], [-140.0, 140.0]]
                .map(Vector2::from)
                .to_vec();
            if tilted {
                problem.vehicles.i.max_tilt_rad = 0.9;
                problem.vehicles.j.max_tilt_rad = 1.25;
            }
            if level {
                problem.vehicles.j.airframe = Airframe::Conventional;
            }
            if split {
                problem.airspace.no_fly = vec![NoFly {
                    name: "mast".into(),
                    area_enu_m: [[-20.0, -30.0], [25.0, -30.0], [25.0, 20.0], [-20.0, 20.0]].map(Vector2::from).to_vec(),
                    floor_m: None,
                    ceiling_m: Some(110.0),
                }];
            }
        }
        let ways = Plain { turn_rate_rad_s: rate, speed_m_s: speed };
        let service = Service { slot_s, ..SERVICE };
        let limits = PerVehicle { i: Limits { speed_m_s: speed, ..LIMITS }, j: LIMITS };
        let moving = any_motion(&problems, &service, &ways, &limits);
        prop_assert!(moving.is_some());
        if let Some(moving) = moving {
            check(&problems, &moving, &service, &ways, &limits);
            if level {
                prop_assert!(moving.ways.j.demand().speed_m_s == 0.0);
            }
        }
    }
}

#[test]
fn spec_a_motion_is_never_worse_than_turning_and_does_not_depend_on_threads() {
    let ((problems, service), ways) = (wide(), Plain::default());
    let with = |threads| {
        let options = Options { threads, ..Options::default() };
        plan(&problems, &service, &ways, &both(LIMITS), &options, Some(0.02)).unwrap()
    };
    let planned = with(1);
    assert_eq!(planned, with(2));
    let Flight::Moving(moving) = &planned.flight else { panic!("nothing moves") };
    check(&problems, moving, &service, &ways, &both(LIMITS));
    let turning = turning::plan(&problems, &service, &ways, &Options::default(), None).unwrap();
    let per_second = |plan: &Protected| plan.volume_bits() / plan.superframe_s;
    assert!(per_second(&moving.protected) >= (1.0 + WORTH_MOVING) * per_second(&turning.protected));
    for knot in moving.protected.knots() {
        let tolerance = knot.tolerance.filter(|tolerance| tolerance.pointing_rad.j > 0.0);
        assert_eq!(tolerance.is_some(), knot.served.is_some() && knot.rate_bps > 0.0);
    }
    // A slot's plan is the pose in its middle.
    for slot in &moving.protected.slots {
        let vehicles = &planned.slots[slot.user].vehicles;
        let near =
            |knot: &Knot| (knot.vehicles.j.pose.position_enu_m - vehicles.j.pose.position_enu_m).norm();
        assert!(slot.knots.iter().map(near).fold(f64::INFINITY, f64::min) < 1e-6);
    }
}

use super::super::turning::Knot;

#[test]
fn spec_nothing_moves_where_that_gains_nothing() {
    // Two users at one place, and vehicles that hardly move.
    let ways = Plain::default();
    let mut problems = problems(2.0);
    problems.truncate(2);
    problems[1].user_enu_m = problems[0].user_enu_m;
    let slow = Limits { speed_m_s: 0.01, ..LIMITS };
    let planned = plan(&problems, &SERVICE, &ways, &both(slow), &Options::default(), None).unwrap();
    let turning = turning::plan(&problems, &SERVICE, &ways, &Options::default(), None).unwrap();
    assert_eq!(planned.flight, Flight::Turning(turning.protected));
    assert_eq!((planned.slots, planned.slots_s), (turning.slots, turning.slots_s));
    for few in [&problems[..1], &[]] {
        let planned = plan(few, &SERVICE, &ways, &both(LIMITS), &Options::default(), None).unwrap();
        assert!(matches!(planned.flight, Flight::Turning(_)));
    }
}

#[test]
fn val_rates_along_the_path_are_the_evaluators() {
    let ((problems, service), ways) = (wide(), Plain::default());
    let moving = any_motion(&problems, &service, &ways, &both(LIMITS)).unwrap();
    let options = EvaluateOptions { samples: 4096, ..EvaluateOptions::default() };
    for slot in &moving.protected.slots {
        let mut bits = 0.0;
        for pair in slot.knots.windows(2) {
            let lasts_s = pair[1].at_s - pair[0].at_s;
            for part in 0..4 {
                let state = moving.at(pair[0].at_s + lasts_s * (f64::from(part) + 0.5) / 4.0).unwrap();
                assert_eq!(state.served, Some(slot.user));
                let at = PerVehicle::from_fn(|role| {
                    let (roll_rad, pitch_rad, yaw_rad) = state.attitudes[role].euler();
                    let position_enu_m = state.positions_enu_m[role];
                    let pose = Pose { position_enu_m, roll_rad, pitch_rad, yaw_rad };
                    VehiclePlan { pose, tx_power_w: state.tx_powers_w[role] }
                });
                let rate = evaluate(&problems[slot.user], &at, &options).unwrap().secrecy_rate_bps;
                bits += 0.25 * lasts_s * rate;
            }
        }
        assert!((slot.volume_bits / bits - 1.0).abs() < 5e-3, "{} {bits}", slot.volume_bits);
    }
}

/// Central differences of the cost against its gradient, off any start.
fn check_gradient(problems: &[Problem], service: &Service) {
    let ways = Plain { turn_rate_rad_s: 0.4, ..Plain::default() };
    let options = Options::default();
    let joint = turning::plan(problems, service, &ways, &options, None).unwrap();
    let setups: Vec<Setup> = problems.iter().map(|problem| Setup::new(problem).unwrap()).collect();
    let samples = setups.iter().map(|setup| volume::samples(setup, &options)).collect();
    let case = Case { setups: &setups, samples, service, ways: &ways, counts: vec![true; setups.len()] };
    let standing: Vec<Raw> = joint.slots.iter().map(|slot| Setup::raw(&slot.vehicles)).collect();
    let frames = frames(&case, &joint.protected, &standing);
    let limits = [Limits { speed_m_s: 3.0, climb_m_s: 0.2, ..LIMITS }; 2];
    let objective = Objective::new(&case, &frames[0], limits);
    let mut x = starts::all(&case, &frames[0], &limits, &standing, 3).swap_remove(12);
    for (k, c) in x.iter_mut().enumerate() {
        *c += 0.3 * libm::sin(3.0 * k as f64) - 0.1;
    }
    let mut memory = Memory::default();
    let look = Look::new(&case, COARSE, 2, 20.0);
    let mut gradient = vec![0.0; x.len()];
    objective.cost(&x, &look, &mut memory, &mut gradient);
    for k in 0..x.len() {
        let mut at = |step: f64| {
            let mut y = x.clone();
            y[k] += step;
            objective.cost(&y, &look, &mut memory, &mut vec![0.0; x.len()])
        };
        let numeric = (8.0 * (at(1e-4) - at(-1e-4)) - (at(2e-4) - at(-2e-4))) / 12e-4;
        assert!(
            (numeric - gradient[k]).abs() < 1e-3 * (1.0 + gradient[k].abs()),
            "variable {k} of {}: {numeric} {}",
            x.len(),
            gradient[k]
        );
    }
}

#[test]
fn val_the_gradient_of_the_cost_is_that_of_central_differences() {
    let (mut problems, service) = wide();
    check_gradient(&problems, &service);
    for problem in &mut problems {
        problem.vehicles.i.max_tilt_rad = 0.85;
        problem.airspace.min_separation_m = 80.0;
    }
    let service = Service { fairness: Fairness::MaxMin, ..service };
    check_gradient(&problems, &service);
}

#[test]
fn prop_a_motion_is_entered_left_and_gone_along_within_its_limits() {
    let ((problems, service), ways) = (wide(), Plain::default());
    let moving = any_motion(&problems, &service, &ways, &both(LIMITS)).unwrap();
    for (passage, at_s) in [
        (Passage::Enters, 0.0),
        (Passage::Leaves, 58.0),
        (Passage::Leaves, 13.7),
        (Passage::Goes(9.0), 3.0),
        (Passage::Goes(-21.0), 13.0),
    ] {
        for way in [&moving.ways.i, &moving.ways.j] {
            let passing = Passing::shortest(way, passage, at_s, &LIMITS);
            let goes_s = if let Passage::Goes(by_s) = passage { by_s } else { 0.0 };
            assert!(passing.lasts_s < 20.0 + 2.5 * goes_s.abs(), "{passing:?}");
            let [begins_s, ends_s] = passing.ends_s();
            let full = |at_s: f64| way.at(at_s).velocity_enu_m_s.vector();
            let (from, to, expected_s) = match passage {
                Passage::Enters => (Enu::zeros(), full(at_s), [at_s - 0.5 * passing.lasts_s, at_s]),
                Passage::Leaves => (full(at_s), Enu::zeros(), [at_s, at_s + 0.5 * passing.lasts_s]),
                Passage::Goes(by_s) => (Enu::zeros(), Enu::zeros(), [at_s, at_s + by_s]),
                Passage::Runs => (full(at_s), full(at_s), [at_s, at_s + passing.lasts_s]),
            };
            assert!((begins_s - expected_s[0]).abs() < 1e-9 && (ends_s - expected_s[1]).abs() < 1e-9);
            let [first, last] = [0.0, passing.lasts_s].map(|elapsed_s| passing.at(way, elapsed_s));
            assert!((first.velocity_enu_m_s.vector() - from).norm() < 1e-9);
            assert!((last.velocity_enu_m_s.vector() - to).norm() < 1e-9);
            assert!((last.position_enu_m - way.position(ends_s)).norm() < 1e-9);
            let steps = 4000;
            let step_s = passing.lasts_s / f64::from(steps);
            let mut before = first;
            for k in 1..=steps {
                let now = passing.at(way, step_s * f64::from(k));
                let v = now.velocity_enu_m_s.vector();
                assert!(v.xy().norm() <= LIMITS.speed_m_s && v.z.abs() <= LIMITS.climb_m_s);
                let a = now.acceleration_enu_m_s2.vector();
                assert!(a.norm() <= LIMITS.acceleration_m_s2 * 1.001, "{}", a.norm());
                let mean = 0.5 * (v + before.velocity_enu_m_s.vector());
                let moved = now.position_enu_m - before.position_enu_m;
                assert!((moved - mean * step_s).norm() <= 10.0 * step_s * step_s * step_s + 1e-9);
                before = now;
            }
        }
    }
}
