//! What motions promise: limits at every instant, each begins with the state of the one before, all rest at their end.

use nalgebra::{Vector2, Vector3};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::geo::EnuVelocity;
use crate::planner::expectation::{EvaluateOptions, evaluate};
use crate::planner::plan::VehiclePlan;
use crate::planner::problem::{Airframe, NoFly, Objective as Aim, Pattern, PowerSteps};
use crate::planner::{Options, plan_slot};
use crate::radio::fading::Rician;

const LIMITS: Limits =
    Limits { speed_m_s: 8.0, climb_m_s: 3.0, acceleration_m_s2: 2.5, jerk_m_s3: Some(4.0) };
const TURN_RATE_RAD_S: f64 = 0.8;

fn problem() -> Problem {
    let mut problem =
        Problem::paper([[200.0, 80.0], [-150.0, 210.0], [40.0, -300.0]], 0.5, 2f64.to_radians());
    problem.airspace.min_separation_m = 5.0;
    problem
}

fn belief(position: [f64; 2], velocity: [f64; 2], at_s: f64) -> Estimate {
    let to = |xy: [f64; 2]| Enu::new(xy[0], xy[1], 0.0);
    let report = |t_s: f64| Report {
        at_s: t_s,
        position_enu_m: to(position) + to(velocity) * (t_s - at_s),
        std_m: [3.0, 1.0],
    };
    let mut estimate = Estimate::new(&report(at_s - 8.0), Unrest::DRIVES);
    for k in 1..=8 {
        estimate.take(&report(at_s - 8.0 + f64::from(k)));
    }
    estimate
}

fn scene<'a>(problem: &'a Problem, user: &'a Estimate, eavesdropper: Option<&'a Estimate>) -> Scene<'a> {
    Scene {
        problem,
        user: Some(user),
        eavesdroppers: vec![eavesdropper.map(|estimate| estimate as &dyn Foresight)],
        limits: PerVehicle { i: LIMITS, j: LIMITS },
        turn_rate_rad_s: PerVehicle { i: TURN_RATE_RAD_S, j: TURN_RATE_RAD_S },
        apart_m: problem.airspace.min_separation_m,
    }
}

fn at_rest(problem: &Problem) -> PerVehicle<VehiclePlan> {
    plan_slot(problem, &Options { starts: Some(8), ..Options::default() }).unwrap().vehicles
}

/// Every limit at instants so close together that nothing slips through, by differences of what is given out.
fn check(scene: &Scene<'_>, motion: &Motion) {
    let problem = scene.problem;
    let (air, setup) = (&problem.airspace, Setup::new(problem).unwrap());
    let step_s = 0.004;
    let steps = (HORIZON_S / step_s).round() as usize;
    let states: Vec<State> = (0..=steps).map(|k| motion.at(motion.begins_s() + step_s * k as f64)).collect();
    for role in Role::BOTH {
        let p: Vec<Enu> = states.iter().map(|state| state.vehicles[role].pose.position_enu_m).collect();
        let limits = &scene.limits[role];
        // Differences divide what rounding leaves.
        let steps_s = [1.0, step_s, step_s * step_s, step_s * step_s * step_s];
        let within = |value: f64, limit: f64, order: usize| {
            let may = limit + 1e-12 / steps_s[order];
            assert!(value <= may, "{role}: {value} of {limit}, order {order}");
        };
        for two in p.windows(2) {
            let velocity = (two[1] - two[0]) / step_s;
            within(velocity.xy().norm(), limits.speed_m_s, 1);
            within(velocity.z.abs(), limits.climb_m_s, 1);
        }
        for three in p.windows(3) {
            let bend = (three[2] - 2.0 * three[1] + three[0]) / (step_s * step_s);
            within(bend.norm(), limits.acceleration_m_s2, 2);
        }
        for four in p.windows(4) {
            let jerk = four[3] - 3.0 * four[2] + 3.0 * four[1] - four[0];
            within(jerk.norm() / steps_s[3], limits.jerk_m_s3.unwrap_or(f64::INFINITY), 3);
        }
        for p in &p {
            assert!(p.z >= air.altitude_m[0] - 1e-9 && p.z <= air.altitude_m[1] + 1e-9, "{role}: {}", p.z);
            assert!((setup.region.nearest(p.xy()) - p.xy()).norm() <= 2e-9, "{role}: {p}");
            assert!(air.no_fly.iter().all(|area| area.depth_m(p) <= 2e-9), "{role}: {p}");
        }
        for two in states.windows(2) {
            let [a, b] = [0, 1].map(|k: usize| two[k].attitudes()[role]);
            let rate = a.angle_to(&b) / step_s;
            assert!(rate <= scene.turn_rate_rad_s[role] + 1e-5, "{role}: {rate} rad/s");
        }
        let tilt_rad = match problem.vehicles[role].airframe {
            Airframe::Omnidirectional => problem.vehicles[role].max_tilt_rad,
            Airframe::Conventional => 0.0,
        };
        for state in &states {
            let upright = state.attitudes()[role].antenna_axis().z;
            assert!(tilt_rad >= std::f64::consts::FRAC_PI_2 || upright >= libm::cos(tilt_rad) - 1e-9);
            let power_w = state.vehicles[role].tx_power_w;
            assert!((0.0..=problem.radio.max_power_w[role]).contains(&power_w));
            if let PowerSteps::AtLeast(least_w) = problem.power_steps[role] {
                assert!(power_w >= least_w * (1.0 - 1e-9), "{power_w} W");
            }
        }
    }
    for state in &states {
        let [i, j] = Role::BOTH.map(|role| state.vehicles[role].pose.position_enu_m);
        assert!((i - j).norm() >= air.min_separation_m, "{} m", (i - j).norm());
    }
}

/// Position, velocity, acceleration, angles and power are one at an instant of two motions.
fn check_joint(before: &Motion, after: &Motion) {
    let t_s = after.begins_s();
    let (a, b) = (before.at(t_s), after.at(t_s));
    for role in Role::BOTH {
        let near = |a: Vector3<f64>, b: Vector3<f64>| assert!((a - b).norm() < 1e-9, "{role}: {a} {b}");
        let (x, y) = (&a.vehicles[role], &b.vehicles[role]);
        near(x.pose.position_enu_m, y.pose.position_enu_m);
        near(a.velocities_enu_m_s[role].vector(), b.velocities_enu_m_s[role].vector());
        near(a.accelerations_enu_m_s2[role].vector(), b.accelerations_enu_m_s2[role].vector());
        assert!((x.pose.roll_rad - y.pose.roll_rad).abs() < 1e-9);
        assert!((x.pose.pitch_rad - y.pose.pitch_rad).abs() < 1e-9);
        assert_eq!(x.pose.yaw_rad, y.pose.yaw_rad);
        assert!((x.tx_power_w - y.tx_power_w).abs() <= 1e-12);
    }
}

/// Wherever one is on a motion, or rests, and the other on this one or on that, they are as far apart as they are to be.
fn check_apart(either: [&PerVehicle<Flying<'_>>; 2], from_s: f64, apart_m: f64) {
    let places = |role: Role| {
        let of = |flying: &PerVehicle<Flying<'_>>| match flying[role] {
            Flying::Rest(vehicle) => vec![vehicle.pose.position_enu_m],
            Flying::Motion(motion) => {
                let last = ((motion.ends_s() - from_s) / 0.2).max(0.0) as usize;
                (0..=last)
                    .map(|k| motion.at(from_s + 0.2 * k as f64).vehicles[role].pose.position_enu_m)
                    .collect()
            }
        };
        either.map(of).concat()
    };
    let (i, j) = (places(Role::I), places(Role::J));
    let distances = i.iter().flat_map(|i| j.iter().map(move |j| (i - j).norm()));
    let nearest_m = distances.fold(f64::INFINITY, f64::min);
    assert!(nearest_m >= apart_m - 1e-6, "{nearest_m} m of {apart_m}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    #[test]
    fn prop_limits_hold_at_every_instant_and_motions_go_on_from_each_other(
        seed in any::<u64>(),
        rate in 0.2..1.5f64,
        speed in 2.0..15.0f64,
        tilted in any::<bool>(),
        level in any::<bool>(),
        split in any::<bool>(),
        least in any::<bool>(),
    ) {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut problem = problem();
        problem.airspace.min_separation_m = [5.0, 60.0][usize::from(rng.random_range(0..2) == 0)];
        // A pentagon with a notch, and not as wide as whoever moves gets about.
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
        if least {
            problem.power_steps.j = PowerSteps::AtLeast(0.01);
        }
        if split {
            problem.airspace.no_fly = vec![NoFly {
                name: "mast".into(),
                area_enu_m: [[-20.0, -30.0], [25.0, -30.0], [25.0, 20.0], [-20.0, 20.0]].map(Vector2::from).to_vec(),
                floor_m: None,
                ceiling_m: Some(110.0),
            }];
        }
        let mut place = |reach: f64| [0; 2].map(|_| rng.random_range(-reach..reach));
        let (mut p, mut v) = (place(150.0), place(10.0));
        let (mut q, w) = (place(300.0), place(10.0));
        problem.user_enu_m = Enu::new(p[0], p[1], 0.0);
        let rest = at_rest(&problem);
        let mut flown: Option<Motion> = None;
        let mut made = 0;
        for step in 0..8 {
            let at_s = 100.0 + f64::from(step);
            // What is believed jumps, and whom it is believed of turns.
            let (off, turn) = (place(4.0), place(2.0));
            for k in 0..2 {
                p[k] += v[k];
                q[k] += w[k];
                v[k] += turn[k];
            }
            let user = belief([p[0] + off[0], p[1] + off[1]], v, at_s);
            let eavesdropper = belief(q, w, at_s);
            let mut scene = scene(&problem, &user, Some(&eavesdropper));
            scene.limits.i.speed_m_s = speed;
            scene.turn_rate_rad_s = PerVehicle { i: rate, j: rate };
            let from = flown.as_ref().map_or(Flying::rest(&rest), Flying::motion);
            let Some(next) = plan(&scene, &from, at_s, 1).unwrap() else {
                // Segments are two seconds long: after one, near a limit, the way that is flown need not be one of the new ones.
                continue;
            };
            check(&scene, &next);
            check_apart([&from, &Flying::motion(&next)], at_s, scene.apart_m);
            if let Some(before) = &flown {
                check_joint(before, &next);
            }
            flown = Some(next);
            made += 1;
        }
        prop_assert!(made >= 4, "{} of 8", made);
    }
}

#[test]
fn spec_a_motion_flown_to_its_end_rests() {
    let problem = problem();
    let user = belief([20.0, -10.0], [-6.0, 3.0], 5.0);
    let rest = at_rest(&problem);
    let scene = scene(&problem, &user, None);
    let motion = plan(&scene, &Flying::rest(&rest), 5.0, 1).unwrap().unwrap();
    assert!((motion.ends_s() - 5.0 - HORIZON_S).abs() < 1e-9);
    let ends = motion.at(motion.ends_s());
    for role in Role::BOTH {
        let moved =
            ends.vehicles[role].pose.position_enu_m - motion.at(5.0).vehicles[role].pose.position_enu_m;
        assert!(moved.norm() > 1.0, "{role} {moved}");
        assert!(ends.velocities_enu_m_s[role].vector().norm() < 1e-9);
        assert!(ends.accelerations_enu_m_s2[role].vector().norm() < 1e-9);
    }
    assert_eq!(motion.at(motion.ends_s() + 100.0), ends);
    assert_eq!(motion.at(-100.0), motion.at(5.0));
    // The next one may begin there, and then it begins at rest.
    let user = belief([-90.0, 40.0], [0.0, 0.0], 30.0);
    let next = plan(&super::Scene { user: Some(&user), ..scene }, &Flying::motion(&motion), 30.0, 1)
        .unwrap()
        .unwrap();
    check_joint(&motion, &next);
}

#[test]
fn spec_what_cannot_be_kept_is_not_given_out() {
    let problem = problem();
    let user = belief([20.0, -10.0], [-6.0, 3.0], 5.0);
    let rest = at_rest(&problem);
    let good = scene(&problem, &user, None);
    let motion = plan(&good, &Flying::rest(&rest), 5.0, 1).unwrap().unwrap();
    // They are faster by now than they may be.
    let slow = PerVehicle { i: Limits { speed_m_s: 0.5, ..LIMITS }, j: LIMITS };
    let flying = &Flying::motion(&motion);
    assert_eq!(plan(&Scene { limits: slow, ..good.clone() }, flying, 8.0, 1), Ok(None));
    // Nor may nobody turn, nor is there such a time.
    let still = PerVehicle { i: 0.0, j: 0.0 };
    assert_eq!(plan(&Scene { turn_rate_rad_s: still, ..good.clone() }, flying, 8.0, 1), Ok(None));
    for at_s in [f64::NAN, f64::INFINITY] {
        assert_eq!(plan(&good, flying, at_s, 1), Ok(None), "{at_s}");
    }
    let far = belief([2e6, 0.0], [0.0; 2], 5.0);
    assert!(plan(&Scene { user: Some(&far), ..good.clone() }, flying, 8.0, 1).is_err());
    // Then the next one still can.
    assert!(plan(&good, flying, 8.0, 1).unwrap().is_some());
}

#[test]
fn spec_motions_do_not_depend_on_threads() {
    let problem = problem();
    let user = belief([20.0, -10.0], [-6.0, 3.0], 5.0);
    let twice = || {
        let rest = at_rest(&problem);
        let scene = scene(&problem, &user, None);
        let first = plan(&scene, &Flying::rest(&rest), 5.0, 1).unwrap().unwrap();
        let second = plan(&scene, &Flying::motion(&first), 6.0, 1).unwrap().unwrap();
        (first, second)
    };
    let here = twice();
    std::thread::scope(|scope| {
        let others = [0; 3].map(|_| scope.spawn(twice));
        for other in others {
            assert_eq!(other.join().unwrap(), here);
        }
    });
}

#[test]
fn spec_js_null_is_soon_where_the_user_is_believed_to_be() {
    let problem = problem();
    let user = belief([20.0, -10.0], [-6.0, 3.0], 5.0);
    let rest = at_rest(&problem);
    let scene = scene(&problem, &user, None);
    let first = plan(&scene, &Flying::rest(&rest), 5.0, 1).unwrap().unwrap();
    let elsewhere = belief([20.0, 5.0], [-6.0, 3.0], 8.0);
    let scene = super::Scene { user: Some(&elsewhere), ..scene };
    let next = plan(&scene, &Flying::motion(&first), 8.0, 1).unwrap().unwrap();
    check_joint(&first, &next);
    check(&scene, &next);
    let off = |t_s: f64| {
        let state = next.at(t_s);
        let line = state.vehicles.j.pose.position_enu_m - elsewhere.at(t_s).position_enu_m;
        let axis = state.attitudes().j.antenna_axis();
        libm::asin(axis.cross(&line.normalize()).norm().min(1.0)).to_degrees()
    };
    let meant = |t_s: f64| {
        let [roll, pitch] = next.knot_at(t_s).j;
        libm::hypot(roll, pitch).to_degrees()
    };
    assert!(off(8.0) > meant(8.0) + 1.0, "{}", off(8.0));
    for t_s in [8.4, 9.0, 11.0, 15.0] {
        assert!(off(t_s) <= meant(t_s) + 1e-6, "{} {} at {t_s}", off(t_s), meant(t_s));
        assert!(off(t_s) < 1.0, "{} at {t_s}", off(t_s));
    }
}

#[test]
fn spec_places_are_foreseen_and_doubted_as_they_are_a_second_on() {
    let problem = problem();
    let user = belief([20.0, -10.0], [-6.0, 3.0], 5.0);
    let scene = scene(&problem, &user, Some(&user));
    let std_m = |t_s: f64| Uncertainty::Gaussian { std_m: user.at(t_s).std_m[0] };
    for (t_s, doubted_s) in [(5.0, 5.0), (5.5, 5.5), (6.0, 6.0), (9.0, 6.0), (17.0, 6.0)] {
        let then = scene.problem_at(t_s, 5.0);
        assert_eq!(then.user_enu_m, user.at(t_s).position_enu_m);
        assert_eq!(then.user_uncertainty, std_m(doubted_s));
        assert_eq!(then.eavesdroppers[0].position_enu_m, user.at(t_s).position_enu_m);
        assert_eq!(then.eavesdroppers[0].uncertainty, std_m(doubted_s));
        assert_eq!(then.eavesdroppers[1], problem.eavesdroppers[1]);
    }
    // Who has not been heard of for long is not doubted less than that.
    assert_eq!(scene.problem_at(40.0, 30.0).user_uncertainty, std_m(31.0));
}

#[test]
fn val_the_expected_rate_is_the_evaluators() {
    let mut problem = problem();
    problem.objective = Aim::Mean;
    let user = belief([20.0, -10.0], [-6.0, 3.0], 5.0);
    let rest = at_rest(&problem);
    let scene = scene(&problem, &user, None);
    let motion = plan(&scene, &Flying::rest(&rest), 5.0, 1).unwrap().unwrap();
    let options = EvaluateOptions { samples: 8192, ..EvaluateOptions::default() };
    let (mut sum, mut counts) = (0.0, 0.0);
    for k in 0..480 {
        let share = (f64::from(k) + 0.5) / 480.0;
        let t_s = 5.0 + HORIZON_S * share;
        let count = ((1.0 - share) / 0.4).min(1.0);
        let rate = evaluate(&scene.problem_at(t_s, 5.0), &motion.at(t_s).vehicles, &options).unwrap();
        sum += count * rate.secrecy_rate_bps / problem.radio.bandwidth_hz;
        counts += count;
    }
    assert!(
        (motion.expected_bps_hz / (sum / counts) - 1.0).abs() < 0.02,
        "{} {}",
        motion.expected_bps_hz,
        sum / counts
    );
}

/// Central differences of the cost against its gradient, off any start.
fn check_gradient(problem: &Problem, limits: Limits, rate: f64, seed: u64) {
    let user = belief([20.0, -10.0], [-6.0, 3.0], 5.0);
    let eavesdropper = belief([120.0, 60.0], [-3.0, -4.0], 5.0);
    let standing = at_rest(problem);
    let mut scene = scene(problem, &user, Some(&eavesdropper));
    let first = plan(&scene, &Flying::rest(&standing), 5.0, 1).unwrap().unwrap();
    scene.limits = PerVehicle { i: limits, j: limits };
    scene.turn_rate_rad_s = PerVehicle { i: rate, j: rate };
    let at_s = 8.3;
    let problems: Vec<Problem> = Frame::nodes_s(at_s).map(|t_s| scene.problem_at(t_s, at_s)).collect();
    let setups: Vec<Setup<'_>> = problems.iter().map(|problem| Setup::new(problem).unwrap()).collect();
    let foreseen = Foreseen::new(&scene, at_s);
    let flying = Flying::motion(&first);
    let frame = Frame::new(&scene, &setups, &foreseen, &flying, at_s);
    let objective = Objective::new(&frame, 1);
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut x = frame.going_on(&flying);
    for (c, [low, high]) in x.iter_mut().zip(frame.bounds()) {
        *c = (*c + 0.3 * rng.random_range(-1.0..1.0)).clamp(low + 0.01, high - 0.01);
    }
    let mut memory = Memory::default();
    let mut gradient = vec![0.0; x.len()];
    let value = objective.cost(&x, 20.0, &mut memory, &mut gradient);
    assert!(value.is_finite());
    for k in 0..x.len() {
        let mut at = |step: f64| {
            let mut y = x.clone();
            y[k] += step;
            objective.cost(&y, 20.0, &mut memory, &mut vec![0.0; x.len()])
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
    let tight = Limits { speed_m_s: 1.0, climb_m_s: 0.2, acceleration_m_s2: 0.3, jerk_m_s3: Some(0.2) };
    check_gradient(&problem(), LIMITS, 0.4, 1);
    check_gradient(&problem(), tight, 0.02, 2);
    // No noise of attitudes, and nobody's place is random.
    let mut exact = problem();
    exact.jitter.std_rad = 0.0;
    exact.objective = Aim::Nominal;
    check_gradient(&exact, tight, 0.05, 3);
    let mut real = problem();
    real.antennas = PerVehicle { i: Pattern::Dipole { floor: 1e-3 }, j: Pattern::Dipole { floor: 3e-3 } };
    real.fading.user = Rician::from_db(15.0);
    real.fading.eavesdropper = Rician::from_db(10.0);
    check_gradient(&real, tight, 0.05, 4);
    let mut narrow = problem();
    narrow.vehicles.i.max_tilt_rad = 0.85;
    narrow.vehicles.j.max_tilt_rad = 0.5;
    narrow.airspace.min_separation_m = 80.0;
    narrow.airspace.area_enu_m =
        [[-60.0, -70.0], [90.0, -70.0], [90.0, 80.0], [-60.0, 80.0]].map(Vector2::from).to_vec();
    check_gradient(&narrow, LIMITS, 0.1, 5);
    narrow.vehicles.j.airframe = Airframe::Conventional;
    check_gradient(&narrow, LIMITS, 0.1, 6);
}

/// How a pair is that rests like this, and follows for so many seconds.
fn flown_to(seconds: u32, scene: &Scene<'_>, rest: &PerVehicle<VehiclePlan>) -> PerVehicle<VehiclePlan> {
    let mut motion: Option<Motion> = None;
    for second in 0..seconds {
        let from = motion.as_ref().map_or(Flying::rest(rest), Flying::motion);
        if let Some(next) = plan(scene, &from, f64::from(second), 1).unwrap() {
            check(scene, &next);
            motion = Some(next);
        }
    }
    motion.map_or(*rest, |motion| motion.at(f64::from(seconds)).vehicles)
}

/// Users that have come to where nothing near the pair's poses carries anything, and every way there is flat.
#[test]
fn val_a_pair_that_carries_nothing_makes_for_where_it_does() {
    let listeners = [[150.0, 0.0], [0.0, 150.0], [-150.0, 0.0], [200.0, 200.0], [-200.0, 200.0]];
    let mut problem = Problem::paper(listeners, 0.5, 0.03);
    problem.airspace.min_separation_m = 5.0;
    let rest = at_rest(&problem);
    for [east_m, north_m] in [[350.0, 150.0], [-350.0, 350.0], [-400.0, 100.0]] {
        let place = Enu::new(east_m, north_m, 0.0);
        let stays = Belief { position_enu_m: place, velocity_enu_m_s: EnuVelocity::ZERO, std_m: [2.0, 1.0] };
        let (user, moving) = (Drift { at_s: 0.0, belief: stays }, belief([0.0; 2], [0.0; 2], 0.0));
        let scene = Scene { user: Some(&user), eavesdroppers: vec![], ..scene(&problem, &moving, None) };
        let truth = Problem { user_enu_m: place, ..problem.clone() };
        let rate = |vehicles: &PerVehicle<VehiclePlan>| {
            evaluate(&truth, vehicles, &EvaluateOptions::default()).unwrap().secrecy_rate_bps / 1e6
        };
        assert!(rate(&rest) < 0.01, "{place}");
        let reached = rate(&flown_to(16, &scene, &rest));
        assert!(reached > 5.0, "{place}: {reached} bit/s/Hz");
    }
}

/// Over a courtyard, where optima are close to each other, and most places of the pair are next to one that is none of the best.
#[test]
fn val_a_pair_in_a_poor_optimum_leaves_it_for_a_better_one() {
    let mut problem = Problem::paper([[80.0, -40.0], [-50.0, 60.0], [-40.0, -60.0]], 0.5, 2f64.to_radians());
    problem.airspace.area_enu_m =
        [[-100.0, -100.0], [100.0, -100.0], [100.0, 100.0], [-100.0, 100.0]].map(Vector2::from).to_vec();
    problem.airspace.altitude_m = [20.0, 80.0];
    problem.airspace.min_separation_m = 5.0;
    let rate = |vehicles: &PerVehicle<VehiclePlan>| {
        evaluate(&problem, vehicles, &EvaluateOptions::default()).unwrap().secrecy_rate_bps / 1e6
    };
    let best = at_rest(&problem);
    let still = belief([0.0; 2], [0.0; 2], 0.0);
    let scene = Scene { user: None, ..scene(&problem, &still, None) };
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    let mut reached = Vec::new();
    for _ in 0..8 {
        let mut rest = best;
        for role in Role::BOTH {
            let pose = &mut rest[role].pose;
            pose.position_enu_m =
                Enu::from_fn(|k, _| [rng.random_range(-90.0..90.0), 25.0][usize::from(k == 2)]);
            (pose.roll_rad, pose.pitch_rad) = (rng.random_range(-1.2..1.2), rng.random_range(-1.2..1.2));
        }
        reached.push(rate(&flown_to(45, &scene, &rest)) / rate(&best));
    }
    println!("{reached:.3?}");
    assert!(reached.iter().all(|share| *share > 0.9), "{reached:?}");
}
