//! The objective against differences, and what a superframe's plan promises.

use super::layout::{Axes, Layout, Pattern};
use super::objective::{COARSE, MEDIUM};
use super::testing::{Plain, SERVICE, problems};
use super::*;
use crate::planner::expectation::kernel::VEHICLE;
use crate::planner::model::Memory;
use crate::planner::problem::{Airframe, Pointing};
use nalgebra::{Vector2, Vector3};

const RAWS: [Raw; 3] = [
    [25.0, 30.0, 85.0, 0.7, -0.4, 0.0, 0.5, 150.0, -210.0, 120.0, 0.9, 0.5, 0.0, 0.02],
    [35.0, 10.0, 95.0, 0.3, -0.1, 0.0, 0.5, 140.0, -180.0, 90.0, 0.6, -0.5, 0.0, 0.01],
    [-25.0, 70.0, 82.0, -0.4, 0.4, 0.0, 0.5, 50.0, -250.0, 80.0, 0.9, 0.1, 0.0, 0.03],
];

fn case<'a>(setups: &'a [Setup<'a>], service: &'a Service, ways: &'a Plain) -> Case<'a, Plain> {
    let options = Options::default();
    let samples = setups.iter().map(|setup| samples(setup, &options)).collect();
    Case { setups, samples, service, ways, counts: vec![true; setups.len()] }
}

/// Central differences through layout and objective against the analytic gradient.
fn check(problems: &[Problem], service: &Service) {
    let setups: Vec<Setup> = problems.iter().map(|problem| Setup::new(problem).unwrap()).collect();
    let ways = Plain::default();
    let case = case(&setups, service, &ways);
    let patterns = [
        Pattern::shared(3),
        Pattern([vec![0, 0, 0], vec![0, 1, 2]]),
        Pattern([vec![0, 1, 0], vec![0, 1, 1]]),
        Pattern([vec![0, 1, 2], vec![0, 1, 2]]),
    ];
    let mut memory = Memory::default();
    for pattern in patterns {
        for axes in [Axes::Nulled, Axes::Free] {
            let layout = Layout::new(&setups, &RAWS, &pattern, axes);
            let x = layout.encode(&RAWS);
            let raws = layout.raws(&x);
            let mut by_raws = vec![[0.0; 14]; 3];
            case.value(&[0, 2, 1], COARSE, &raws, &mut memory, &mut by_raws);
            let mut gradient = vec![0.0; x.len()];
            layout.pull(&x, &raws, &by_raws, &mut gradient);
            for k in 0..x.len() {
                let mut at = |step: f64| {
                    let mut y = x.clone();
                    y[k] += step;
                    case.value(&[0, 2, 1], COARSE, &layout.raws(&y), &mut memory, &mut vec![[0.0; 14]; 3])
                };
                let numeric = (8.0 * (at(1e-5) - at(-1e-5)) - (at(2e-5) - at(-2e-5))) / 12e-5;
                assert!(
                    (numeric - gradient[k]).abs() < 2e-6 * (1.0 + gradient[k].abs()),
                    "{pattern:?} {axes:?}, variable {k}: {numeric} {}",
                    gradient[k]
                );
            }
        }
    }
}

#[test]
fn val_the_gradient_is_that_of_central_differences() {
    check(&problems(2.0), &SERVICE);
    check(&problems(0.0), &SERVICE);
    check(&problems(2.0), &Service { fairness: Fairness::MaxMin, ..SERVICE });
}

#[test]
fn val_the_gradient_with_errors_and_limited_tilt() {
    let mut problems = problems(2.0);
    for problem in &mut problems {
        problem.pointing =
            Pointing { heading_std_rad: 0.03, mounting_std_rad: 0.01, position_std_m: [0.5, 0.8] };
        problem.vehicles.i.max_tilt_rad = 0.9;
    }
    check(&problems, &SERVICE);
}

#[test]
fn val_a_value_is_volume_over_length() {
    let problems = problems(2.0);
    let setups: Vec<Setup> = problems.iter().map(|problem| Setup::new(problem).unwrap()).collect();
    let ways = Plain::default();
    let case = case(&setups, &SERVICE, &ways);
    let mut memory = Memory::default();
    let rates: Vec<f64> =
        (0..3).map(|user| case.rate(user, MEDIUM, &RAWS[user], &mut memory, &mut [0.0; 14])).collect();
    // The longest leg of J's decides each transit here.
    let legs_m = [(0, 2), (2, 1), (1, 0)].map(|(a, b): (usize, usize)| {
        let at = |user: usize| Vector3::from_fn(|k, _| RAWS[user][VEHICLE + k]);
        (at(a) - at(b)).norm()
    });
    let length_s = 36.0 + legs_m.iter().sum::<f64>() / 8.0;
    let expected = 9.0 * rates.iter().map(|r| r.max(0.0)).sum::<f64>() / length_s;
    let found = case.worth(&[0, 2, 1], MEDIUM, &RAWS, &mut memory);
    assert!((found / expected - 1.0).abs() < 1e-12, "{found} {expected}");
}

fn poses(superframe: &Superframe) -> Vec<[f64; 6]> {
    let at = |slot: &SlotPlan| {
        let [i, j] = [&slot.vehicles.i, &slot.vehicles.j].map(|v| v.pose.position_enu_m);
        [i.x, i.y, i.z, j.x, j.y, j.z]
    };
    superframe.slots.iter().map(at).collect()
}

#[test]
fn spec_short_slots_share_a_place_and_every_limit_is_kept() {
    let mut problems = problems(2.0);
    for problem in &mut problems {
        problem.airspace.area_enu_m =
            [[-100.0, -100.0], [100.0, -100.0], [100.0, 60.0], [20.0, 60.0], [20.0, 100.0], [-100.0, 100.0]]
                .map(Vector2::from)
                .to_vec();
        problem.airspace.min_separation_m = 30.0;
        problem.vehicles.i.max_tilt_rad = 1.0;
        problem.vehicles.j.airframe = Airframe::Conventional;
    }
    let found = plan(&problems, &SERVICE, &Plain::default(), &Options::default()).unwrap();
    let poses = poses(&found);
    assert!(poses.iter().all(|pose| pose == &poses[0]), "{poses:?}");
    let setup = Setup::new(&problems[0]).unwrap();
    for slot in &found.slots {
        let [i, j] = [&slot.vehicles.i.pose, &slot.vehicles.j.pose];
        for pose in [i, j] {
            assert!(setup.region.contains(pose.position_enu_m.xy(), 1e-9));
            assert!((80.0..=300.0).contains(&pose.position_enu_m.z));
        }
        assert!((i.position_enu_m - j.position_enu_m).norm() >= 30.0 - 1e-9);
        assert!(i.antenna_axis().z >= libm::cos(1.0) - 1e-9);
        assert_eq!((j.roll_rad, j.pitch_rad), (0.0, 0.0));
        assert!(slot.vehicles.j.tx_power_w <= 0.5 && slot.vehicles.i.tx_power_w == 0.5);
        assert!(slot.secrecy_rate_bps > 0.0);
    }
}

#[test]
fn spec_a_plan_does_not_depend_on_threads() {
    let problems = problems(2.0);
    let with = |threads| {
        let options = Options { threads, ..Options::default() };
        plan(&problems, &SERVICE, &Plain::default(), &options).unwrap()
    };
    assert_eq!(with(1), with(3));
}

#[test]
fn spec_long_slots_of_users_far_apart_have_places_of_their_own() {
    let mut problems = problems(2.0);
    for (problem, east) in problems.iter_mut().zip([-450.0, 0.0, 450.0]) {
        problem.user_enu_m.x = east;
    }
    let long = Service { slot_s: 600.0, ..SERVICE };
    let found = poses(&plan(&problems, &long, &Plain::default(), &Options::default()).unwrap());
    assert!(found.windows(2).all(|pair| pair[0] != pair[1]), "{found:?}");
}

#[test]
fn spec_the_least_served_comes_first() {
    let problems = problems(2.0);
    let volumes = |fairness| {
        let service = Service { fairness, ..SERVICE };
        let found = plan(&problems, &service, &Plain::default(), &Options::default()).unwrap();
        assert!(found.slots_s.iter().sum::<f64>() <= 30.0 + 1e-9);
        let volume = |(slot, slot_s): (&SlotPlan, &f64)| (slot_s - 1.0) * slot.secrecy_rate_bps;
        found.slots.iter().zip(&found.slots_s).map(volume).collect::<Vec<f64>>()
    };
    let least = |volumes: &[f64]| volumes.iter().copied().fold(f64::INFINITY, f64::min);
    let (equal, fair) = (volumes(Fairness::Slots), volumes(Fairness::MaxMin));
    assert!(least(&fair) > 1.01 * least(&equal), "{fair:?} {equal:?}");
    // No limit binds: all are served alike, but for the rounding of slots.
    assert!(fair.iter().all(|volume| *volume < 1.01 * least(&fair)), "{fair:?}");
}

#[test]
fn spec_what_knows_no_volume_is_refused() {
    let problems = problems(2.0);
    let ways = Plain::default();
    let options = Options { method: Method::Paper, ..Options::default() };
    assert_eq!(plan(&problems, &SERVICE, &ways, &options), Err(PlanError::VolumeMethod));
    let cautious: Vec<Problem> =
        problems.iter().map(|p| Problem { objective: Objective::Quantile, ..p.clone() }).collect();
    assert_eq!(plan(&cautious, &SERVICE, &ways, &Options::default()), Err(PlanError::VolumeObjective));
}

/// Three users all over the paper's arena, with five eavesdroppers anywhere: the place that serves all best is among those that look
/// middling at first.
#[test]
fn regress_the_best_place_for_all_need_not_look_so_at_first() {
    use rand::{RngExt, SeedableRng};
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(23 * 0x9e37_79b9 + 31);
    let nodes: Vec<[f64; 2]> = (0..5).map(|_| [0; 2].map(|_| rng.random_range(-500.0..500.0))).collect();
    let mut problem = Problem::paper(nodes, 0.5, f64::to_radians(2.0));
    problem.airspace.min_separation_m = 5.0;
    let mut place = || rng.random_range(-400.0..400.0);
    let problems: Vec<Problem> = (0..3)
        .map(|_| Problem { user_enu_m: Vector3::new(place(), place(), 0.0), ..problem.clone() })
        .collect();
    let service = Service { slot_s: 20.0, settle_s: 3.0, slot_limits_s: [10.0, 40.0], ..SERVICE };
    let found = choices(&problems, &service, &Plain::default(), &Options::default()).unwrap();
    let best = found.iter().map(|choice| choice.worth).fold(0.0, f64::max) / std::f64::consts::LN_2;
    assert!(best > 9.3, "bit/s/Hz: {best}");
}
