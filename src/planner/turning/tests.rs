//! What turns promise: limits at every instant, never less than the static plan, and in one case all of it by brute force.

use nalgebra::Vector3;
use proptest::prelude::*;

use super::ways::{Turning, on_air};
use super::*;
use crate::geo::Pose;
use crate::planner::expectation::{EvaluateOptions, evaluate};
use crate::planner::problem::{Airframe, Pattern, PowerSteps};
use crate::planner::volume::testing::{Plain, SERVICE, problems};
use crate::radio::pattern;

/// J's null on the user, I's axis as given.
fn served(
    problem: &Problem,
    positions: [[f64; 3]; 2],
    roll_pitch: [f64; 2],
    power_w: f64,
) -> PerVehicle<VehiclePlan> {
    let [i, j] = positions.map(Vector3::from);
    let pose = |position_enu_m, [roll_rad, pitch_rad]: [f64; 2]| Pose {
        position_enu_m,
        roll_rad,
        pitch_rad,
        yaw_rad: 0.0,
    };
    let (roll, pitch) = pattern::canonical_angles(&(j - problem.user_enu_m));
    PerVehicle {
        i: VehiclePlan { pose: pose(i, roll_pitch), tx_power_w: problem.radio.max_power_w.i },
        j: VehiclePlan { pose: pose(j, [roll, pitch]), tx_power_w: power_w },
    }
}

const PLACE: [[f64; 3]; 2] = [[20.0, 30.0, 85.0], [60.0, -110.0, 90.0]];

fn standing(problems: &[Problem], axes: [[f64; 2]; 3]) -> Vec<PerVehicle<VehiclePlan>> {
    problems.iter().zip(axes).map(|(problem, axis)| served(problem, PLACE, axis, 0.02)).collect()
}

const AXES: [[f64; 2]; 3] = [[0.7, -0.4], [-0.6, 0.3], [0.2, 1.1]];

fn turned(
    problems: &[Problem],
    vehicles: &[PerVehicle<VehiclePlan>],
    service: &Service,
    ways: &Plain,
) -> Protected {
    let slots_s = vec![service.slot_s; vehicles.len()];
    let standing = Standing { vehicles, slots_s: &slots_s, order: None };
    through(problems, &standing, service, ways, &Options::default(), None).unwrap()
}

/// Nobody turns faster than it can, between any two instants.
fn check_limits_of_turning(plan: &Protected, ways: &Plain) {
    let step_s = 0.002;
    let mut before: Option<State> = None;
    for k in 0..=(plan.superframe_s / step_s) as usize + 3 {
        let state = plan.at(k as f64 * step_s).unwrap();
        if let Some(before) = before {
            for role in Role::BOTH {
                let angle = before.attitudes[role].angle_to(&state.attitudes[role]);
                assert!(angle <= ways.turn_rate_rad_s * step_s * (1.0 + 1e-4) + 1e-7, "{role:?} {k} {angle}");
            }
        }
        before = Some(state);
    }
}

/// Every limit, at instants so close together that nothing slips through.
fn check_limits(problems: &[Problem], plan: &Protected, service: &Service, ways: &Plain) {
    let tilt = |role: Role| match problems[0].vehicles[role].airframe {
        Airframe::Omnidirectional => problems[0].vehicles[role].max_tilt_rad,
        Airframe::Conventional => 0.0,
    };
    check_limits_of_turning(plan, ways);
    let step_s = 0.002;
    for k in 0..=(plan.superframe_s / step_s) as usize + 3 {
        let state = plan.at(k as f64 * step_s).unwrap();
        for role in Role::BOTH {
            if tilt(role) < std::f64::consts::FRAC_PI_2 {
                assert!(
                    state.attitudes[role].antenna_axis().z >= libm::cos(tilt(role)) - 1e-9,
                    "{role:?} at {k}"
                );
            }
            let most_w = state.served.map_or(0.0, |user| problems[user].radio.max_power_w[role]);
            assert!((0.0..=most_w).contains(&state.tx_powers_w[role]));
        }
    }
    for slot in &plan.slots {
        assert!(slot.silence_s >= service.guard_s);
        let (first, last) = (&slot.knots[0], slot.knots.last().unwrap());
        assert!((last.at_s - first.at_s - slot.on_air_s).abs() < 1e-9 && last.served.is_none());
        assert!(
            slot.knots
                .windows(2)
                .all(|pair| pair[0].at_s < pair[1].at_s && pair[0].served == Some(slot.user))
        );
    }
}

/// What the same poses are worth without ramps, and in silence between slots, bit for each second.
fn static_bits_s(
    problems: &[Problem],
    vehicles: &[PerVehicle<VehiclePlan>],
    service: &Service,
    ways: &Plain,
) -> f64 {
    let options = EvaluateOptions { samples: 8192, ..EvaluateOptions::default() };
    let n = vehicles.len();
    let poses = |k: usize| vehicles[k % n].map(|vehicle| vehicle.pose);
    let mut length_s = n as f64 * (service.slot_s + service.settle_s);
    let mut bits = 0.0;
    for (k, (problem, at)) in problems.iter().zip(vehicles).enumerate() {
        bits +=
            (service.slot_s - service.guard_s) * evaluate(problem, at, &options).unwrap().secrecy_rate_bps;
        length_s += ways.transit_s(&poses(k), &poses(k + 1)).unwrap();
    }
    bits / length_s
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    #[test]
    fn prop_limits_hold_and_volume_is_never_below_the_static_plan(
        axes in prop::array::uniform3(prop::array::uniform2(-0.7..0.7f64)),
        guard_s in 0.0..1.5f64,
        rate in 0.3..2.0f64,
        tilted in any::<bool>(),
        level in any::<bool>(),
        slot_s in 3.0..12.0f64,
    ) {
        let mut problems = problems(2.0);
        for problem in &mut problems {
            if tilted {
                problem.vehicles.i.max_tilt_rad = 1.0;
                problem.vehicles.j.max_tilt_rad = 1.3;
            }
            if level {
                problem.vehicles.i.airframe = Airframe::Conventional;
            }
        }
        let axes = if level { [[0.0; 2]; 3] } else { axes };
        let vehicles = standing(&problems, axes);
        // J must be able to hold its nulls.
        prop_assume!(!tilted || vehicles.iter().all(|v| v.j.pose.antenna_axis().z > libm::cos(1.3) + 1e-6));
        let ways = Plain { turn_rate_rad_s: rate, ..Plain::default() };
        let service = Service { guard_s, slot_s, ..SERVICE };
        let plan = turned(&problems, &vehicles, &service, &ways);
        check_limits(&problems, &plan, &service, &ways);
        let before = static_bits_s(&problems, &vehicles, &service, &ways);
        prop_assert!(plan.volume_bits() / plan.superframe_s >= before * (1.0 - 2e-3), "{before}");
        // And not below the same without ramps.
        let silent: f64 = (0..3).map(|k| {
            let poses = |k: usize| vehicles[k % 3].map(|vehicle| vehicle.pose);
            let turning = Turning { ways: &ways, guard_s, settle_s: 2.0, tilt_rad: Setup::new(&problems[0]).unwrap().tilt_rad };
            turning.transit_s(&poses(k), &poses(k + 1)).unwrap()
        }).sum();
        let rates: f64 = plan.slots.iter().map(|slot| {
            let stands = |knot: &&Knot| knot.vehicles == vehicles[slot.user];
            slot.knots.iter().find(stands).unwrap().rate_bps
        }).sum();
        let without = (slot_s - guard_s) * rates / (3.0 * (slot_s - guard_s) + silent);
        prop_assert!(plan.volume_bits() / plan.superframe_s >= without * (1.0 - 1e-9));
    }
}

/// Central differences against the gradient of a change's cost.
fn check_gradient(problems: &[Problem], service: &Service) {
    let setups: Vec<Setup> = problems.iter().map(|problem| Setup::new(problem).unwrap()).collect();
    let ways = Plain { turn_rate_rad_s: 0.6, ..Plain::default() };
    let turning = Turning { ways: &ways, guard_s: 1.0, settle_s: 2.0, tilt_rad: setups[0].tilt_rad };
    let air = on_air(service);
    let job = Job::new(&setups, &air, &turning, &Options::default());
    let raws: Vec<Raw> = standing(problems, AXES).iter().map(Setup::raw).collect();
    let change = Change {
        case: &job.case,
        users: [0, 1],
        raws: [raws[0], raws[1]],
        weights: [1.0, 0.7],
        price: 6.0,
        guard_s: 1.0,
        longest_s: [4.0, 0.2],
    };
    change.check_gradient();
}

#[test]
fn val_the_gradient_of_a_change_is_that_of_central_differences() {
    check_gradient(&problems(2.0), &SERVICE);
    let mut limited = problems(2.0);
    for problem in &mut limited {
        problem.vehicles.i.max_tilt_rad = 0.85;
    }
    check_gradient(&limited, &SERVICE);
}

/// Two users who mirror each other, a level I between them, and J in the middle: nothing but J's roll changes, there and back
/// alike. Brute force over the length of a straight ramp and a grid of powers.
#[test]
fn val_two_users_who_mirror_each_other_by_brute_force() {
    let mut problem = Problem::paper([[0.0, 250.0], [0.0, -250.0]], 0.5, 2f64.to_radians());
    problem.vehicles.i.airframe = Airframe::Conventional;
    let problems =
        [-80.0, 80.0].map(|y| Problem { user_enu_m: Vector3::new(0.0, y, 0.0), ..problem.clone() });
    let place = [[0.0, 0.0, 80.0], [-40.0, 0.0, 100.0]];
    let vehicles: Vec<_> = problems.iter().map(|problem| served(problem, place, [0.0; 2], 0.01)).collect();
    let ways = Plain { turn_rate_rad_s: 0.5, ..Plain::default() };
    let plan = turned(&problems, &vehicles, &SERVICE, &ways);
    check_limits(&problems, &plan, &SERVICE, &ways);
    let [a, b] = &plan.slots[..] else { panic!("{plan:?}") };
    assert!((a.silence_s / b.silence_s - 1.0).abs() < 2e-2, "{} {}", a.silence_s, b.silence_s);
    assert!((a.volume_bits / b.volume_bits - 1.0).abs() < 5e-3);

    let options = EvaluateOptions { samples: 4096, ..EvaluateOptions::default() };
    let rate = |off: f64| {
        let mut at = vehicles[0];
        let way = vehicles[1].j.pose.roll_rad - at.j.pose.roll_rad;
        at.j.pose.roll_rad += off * way.signum();
        let powers = (0..28).map(|k| 0.01 * libm::pow(0.7, f64::from(k - 4)));
        let rated = powers.map(|power_w| {
            at.j.tx_power_w = power_w;
            evaluate(&problems[0], &at, &options).unwrap().secrecy_rate_bps
        });
        rated.fold(0.0, f64::max)
    };
    // The standing power is what it is.
    let still = evaluate(&problems[0], &vehicles[0], &options).unwrap().secrecy_rate_bps;
    let turn =
        Course::Shortest.angle_rad(&ways::angles(&vehicles[0].j.pose), &ways::angles(&vehicles[1].j.pose)).0;
    let step = 0.01;
    let (mut lost, mut best) = (0.0, 0.0f64);
    for k in 0..60 {
        let ramp = step * f64::from(k);
        let silence_s = ((turn - 2.0 * ramp) / 0.5 + READY_S).max(1.0);
        best = best.max((9.0 * still - 2.0 * lost) / (9.0 + silence_s));
        lost += step / 0.5 * (still - rate(ramp + 0.5 * step));
    }
    let found = plan.volume_bits() / plan.superframe_s;
    assert!(turn / 0.5 > 1.2, "the turn must not fit into the guard: {turn}");
    assert!((0.998..1.01).contains(&(found / best)), "{found} {best}");
}

#[test]
fn spec_a_turn_that_fits_into_the_guard_costs_the_guard() {
    let (problems, ways) = (problems(2.0), Plain { turn_rate_rad_s: 6.0, ..Plain::default() });
    let vehicles = standing(&problems, AXES);
    let plan = turned(&problems, &vehicles, &SERVICE, &ways);
    assert!(plan.slots.iter().all(|slot| slot.silence_s == 1.0 && slot.knots.len() == 2));
    assert!((plan.superframe_s - 30.0).abs() < 1e-9);
    assert!((plan.share_on_air() - 0.9).abs() < 1e-9);
}

#[test]
fn spec_the_superframe_comes_round_again() {
    let (problems, ways) = (problems(2.0), Plain::default());
    let vehicles = standing(&problems, AXES);
    let plan = turned(&problems, &vehicles, &SERVICE, &ways);
    assert_eq!(plan.slots.iter().map(|slot| slot.user).collect::<Vec<_>>(), [0, 1, 2]);
    for t_s in [0.0, 0.3, 5.0, plan.superframe_s - 0.2] {
        let (now, later) = (plan.at(t_s).unwrap(), plan.at(t_s + 3.0 * plan.superframe_s).unwrap());
        assert_eq!((now.served, now.tx_powers_w), (later.served, later.tx_powers_w));
        assert!(now.attitudes.i.angle_to(&later.attitudes.i) < 1e-6);
    }
    // Whoever is first, the cycle is the same.
    let slots_s = [10.0; 3];
    let other = Standing { vehicles: &vehicles, slots_s: &slots_s, order: Some(&[1, 2, 0]) };
    let other = through(&problems, &other, &SERVICE, &ways, &Options::default(), None).unwrap();
    assert!((other.superframe_s - plan.superframe_s).abs() < 1e-9);
    for (slot, user) in other.slots.iter().zip([1, 2, 0]) {
        assert_eq!(slot.user, user);
        assert!((slot.silence_s - plan.slots[user].silence_s).abs() < 1e-12);
    }
}

#[test]
fn spec_positions_are_changed_in_silence() {
    let (problems, ways) = (problems(2.0), Plain::default());
    let mut vehicles = standing(&problems, AXES);
    vehicles[1].j.pose.position_enu_m.x += 160.0;
    let plan = turned(&problems, &vehicles, &SERVICE, &ways);
    for slot in &plan.slots[..2] {
        assert_eq!(slot.between, Between::Transit);
        assert!((slot.silence_s - (1.0 + 2.0 + 160.0 / 8.0)).abs() < 1e-9);
        assert!(plan.at(slot.knots.last().unwrap().at_s + 1.0).is_none());
    }
    assert!(matches!(plan.slots[2].between, Between::Turn(_)));
    let none = Standing { vehicles: &vehicles, slots_s: &[10.0; 3], order: None };
    let refused = through(&problems, &none, &SERVICE, &Nowhere, &Options::default(), None);
    assert_eq!(refused, Err(PlanError::NoTransit { from: 0, to: 1 }));
}

/// Nothing can be flown.
struct Nowhere;

impl Ways for Nowhere {
    fn straight_s(&self, _: Role, _: &Vector3<f64>) -> (f64, Vector3<f64>) {
        (1.0, Vector3::zeros())
    }

    fn turn_rate_rad_s(&self, _: Role) -> f64 {
        1.0
    }

    fn transit_s(&self, _: &PerVehicle<Pose>, _: &PerVehicle<Pose>) -> Option<f64> {
        None
    }

    fn shortest(&self, users: usize, _: &[f64]) -> Vec<usize> {
        (0..users).collect()
    }
}

#[test]
fn spec_powers_are_those_that_the_transmitter_can_give() {
    let mut problems = problems(2.0);
    let levels = vec![0.005, 0.02, 0.1];
    for problem in &mut problems {
        problem.power_steps.j = PowerSteps::Levels(levels.clone());
        problem.antennas.j = Pattern::with_null_depth(30.0);
    }
    let ways = Plain { turn_rate_rad_s: 0.5, ..Plain::default() };
    let plan = turned(&problems, &standing(&problems, AXES), &SERVICE, &ways);
    assert!(plan.slots.iter().any(|slot| slot.knots.len() > 2));
    for knot in plan.knots() {
        let power_w = knot.vehicles.j.tx_power_w;
        assert!(power_w == 0.0 || levels.contains(&power_w), "{power_w}");
        assert_eq!(knot.served.is_some(), knot.vehicles.i.tx_power_w > 0.0);
    }
}

#[test]
fn spec_a_user_whom_nobody_can_serve_is_passed_in_silence() {
    let (problems, ways) = (problems(2.0), Plain { turn_rate_rad_s: 0.4, ..Plain::default() });
    let mut vehicles = standing(&problems, AXES);
    let all = turned(&problems, &vehicles, &SERVICE, &ways);
    // As the planner leaves them where no rate is positive.
    (vehicles[1].i.tx_power_w, vehicles[1].j.tx_power_w) = (0.0, 0.0);
    let plan = turned(&problems, &vehicles, &SERVICE, &ways);
    assert!(plan.slots[1].volume_bits.abs() < 1e-9 && plan.slots[1].on_air_s == 9.0);
    assert!(plan.slots[1].knots.iter().all(|knot| knot.served.is_none()));
    assert!(
        plan.slots[1].knots.iter().all(|knot| knot.vehicles.i.tx_power_w + knot.vehicles.j.tx_power_w == 0.0)
    );
    // Its slot is as good as silence to turn in.
    for slot in [0, 1] {
        assert!(plan.slots[slot].silence_s <= all.slots[slot].silence_s + 1e-9);
    }
    check_limits_of_turning(&plan, &ways);
}

#[test]
fn spec_one_user_alone_has_its_guard() {
    let problems = &problems(2.0)[..1];
    let plan = turned(problems, &standing(problems, AXES)[..1], &SERVICE, &Plain::default());
    assert_eq!((plan.slots.len(), plan.superframe_s), (1, 10.0));
    let none = turned(&[], &[], &SERVICE, &Plain::default());
    assert_eq!((none.at(1.0), none.superframe_s), (None, 0.0));
}

#[test]
fn val_volumes_are_those_of_the_evaluator_along_the_path() {
    let (problems, ways) = (problems(2.0), Plain { turn_rate_rad_s: 0.4, ..Plain::default() });
    let service = Service { guard_s: 0.5, ..SERVICE };
    let options = EvaluateOptions { samples: 4096, ..EvaluateOptions::default() };
    let known = volume::plan(&problems, &service, &ways, &Options::default()).unwrap();
    let vehicles: Vec<_> = known.slots.iter().map(|slot| slot.vehicles).collect();
    let plan = turned(&problems, &vehicles, &service, &ways);
    assert!(plan.slots.iter().any(|slot| slot.knots.len() > 2), "no ramp, and nothing is shown");
    for slot in &plan.slots {
        let mut bits = 0.0;
        for pair in slot.knots.windows(2) {
            let lasts_s = pair[1].at_s - pair[0].at_s;
            let parts = if pair[0].vehicles == vehicles[slot.user] { 1 } else { 4 };
            for part in 0..parts {
                let share = (f64::from(part) + 0.5) / f64::from(parts);
                let state = plan.at(pair[0].at_s + lasts_s * share).unwrap();
                let at = PerVehicle::from_fn(|role| {
                    let (roll_rad, pitch_rad, yaw_rad) = state.attitudes[role].euler();
                    let position_enu_m = state.positions_enu_m[role];
                    VehiclePlan {
                        pose: Pose { position_enu_m, roll_rad, pitch_rad, yaw_rad },
                        tx_power_w: state.tx_powers_w[role],
                    }
                });
                let rate = evaluate(&problems[slot.user], &at, &options).unwrap().secrecy_rate_bps;
                bits += rate * lasts_s / f64::from(parts);
            }
        }
        assert!((slot.volume_bits / bits - 1.0).abs() < 3e-3, "{} {bits}", slot.volume_bits);
    }
}

#[test]
fn val_an_error_of_the_tolerance_costs_its_share() {
    let (problems, ways) = (problems(2.0), Plain { turn_rate_rad_s: 0.5, ..Plain::default() });
    let vehicles = standing(&problems, AXES);
    let slots_s = [10.0; 3];
    let given = Standing { vehicles: &vehicles, slots_s: &slots_s, order: None };
    let plan = through(&problems, &given, &SERVICE, &ways, &Options::default(), Some(0.02)).unwrap();
    let options = EvaluateOptions { samples: 4096, ..EvaluateOptions::default() };
    for knot in plan.knots() {
        let Some(user) = knot.served else {
            assert_eq!(knot.tolerance, None);
            continue;
        };
        let tolerance = knot.tolerance.unwrap();
        assert!((0.0..=LARGEST_RAD).contains(&tolerance.pointing_rad.j) && tolerance.user_sinr_ratio > 0.0);
        let rate = |vehicles: &PerVehicle<VehiclePlan>| {
            evaluate(&problems[user], vehicles, &options).unwrap().secrecy_rate_bps
        };
        let known = rate(&knot.vehicles);
        for role in Role::BOTH {
            // The worst of many directions, by the evaluator.
            let worst = (0..24)
                .map(|k| {
                    let (sin, cos) = libm::sincos(std::f64::consts::TAU * f64::from(k) / 24.0);
                    let size = tolerance.pointing_rad[role];
                    let mut vehicles = knot.vehicles;
                    let pose = &mut vehicles[role].pose;
                    let wrong = pose.attitude().rotation()
                        * nalgebra::UnitQuaternion::from_scaled_axis(Vector3::new(
                            size * cos,
                            size * sin,
                            0.0,
                        ));
                    (pose.roll_rad, pose.pitch_rad, pose.yaw_rad) = wrong.euler_angles();
                    rate(&vehicles)
                })
                .fold(f64::INFINITY, f64::min);
            let lost = 1.0 - worst / known;
            if tolerance.pointing_rad[role] < LARGEST_RAD {
                assert!((0.014..0.03).contains(&lost), "{role:?} at {}: {lost}", knot.at_s);
            }
        }
    }
}

#[test]
fn spec_a_joint_plan_is_no_worse_and_does_not_depend_on_threads() {
    let (problems, ways) = (problems(2.0), Plain::default());
    let with = |threads| {
        let options = Options { threads, ..Options::default() };
        plan(&problems, &SERVICE, &ways, &options, Some(0.02)).unwrap()
    };
    let joint = with(1);
    assert_eq!(joint, with(3));
    check_limits(&problems, &joint.protected, &SERVICE, &ways);
    let known = volume::plan(&problems, &SERVICE, &ways, &Options::default()).unwrap();
    let vehicles: Vec<_> = known.slots.iter().map(|slot| slot.vehicles).collect();
    let turned = turned(&problems, &vehicles, &SERVICE, &ways);
    let per_second = |plan: &Protected| plan.volume_bits() / plan.superframe_s;
    assert!(per_second(&joint.protected) >= per_second(&turned) * (1.0 - 1e-12));
    assert!(per_second(&turned) >= 1.1 * static_bits_s(&problems, &vehicles, &SERVICE, &ways));
}

#[test]
fn spec_the_least_served_comes_first() {
    let (problems, ways) = (problems(2.0), Plain::default());
    let least = |fairness| {
        let service = Service { fairness, ..SERVICE };
        let plan = plan(&problems, &service, &ways, &Options::default(), None).unwrap();
        assert!(plan.slots_s.iter().sum::<f64>() <= 30.0 + 1e-9);
        plan.protected.least_user_volume_bits() / plan.protected.superframe_s
    };
    assert!(least(Fairness::MaxMin) > 1.01 * least(Fairness::Slots));
}
