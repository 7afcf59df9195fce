use nalgebra::Vector2;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::schedule::testing::{self, polygon, star};

const LIMITS: Limits = Limits::new(8.0, 3.0, 0.6);
const PAIR: PerVehicle<Limits> = PerVehicle { i: LIMITS, j: LIMITS };

/// 5 m and 2 m.
const FULL_M: f64 = 7.0;

fn square(half_m: f64) -> Vec<Vector2<f64>> {
    polygon(&[[-half_m, -half_m], [half_m, -half_m], [half_m, half_m], [-half_m, half_m]])
}

fn airspace(area_enu_m: Vec<Vector2<f64>>, altitude_m: [f64; 2]) -> Airspace {
    Airspace { altitude_m, area_enu_m, no_fly: Vec::new(), min_separation_m: 5.0 }
}

fn router(area_enu_m: Vec<Vector2<f64>>, altitude_m: [f64; 2]) -> Router {
    Router::new(&airspace(area_enu_m, altitude_m), &PAIR).unwrap()
}

fn start(x: f64, y: f64, z: f64) -> Start {
    Start { position_enu_m: Enu::new(x, y, z), attitude: Attitude::level() }
}

fn pose(x: f64, y: f64, z: f64) -> Pose {
    Pose { position_enu_m: Enu::new(x, y, z), roll_rad: 0.5, pitch_rad: -0.3, yaw_rad: 0.0 }
}

/// Positions at `n + 1` even times.
fn sampled(trajectory: &Trajectory, whole: Duration, n: u32) -> Vec<Enu> {
    (0..=n).map(|k| trajectory.sample(whole * k / n).position_enu_m).collect()
}

fn least_distance(a: &[Enu], b: &[Enu]) -> f64 {
    a.iter().flat_map(|p| b.iter().map(move |q| (p - q).norm())).fold(f64::INFINITY, f64::min)
}

/// What must hold of any transit, by dense sampling: the ends, the corridor, the distance whatever the timing
/// (or, taken in turns, on time and with one vehicle moving at a time).
fn assert_sound(router: &Router, transit: &Transit, from: &PerVehicle<Start>, to: &PerVehicle<Pose>) {
    let whole = transit.duration();
    let low_m = router.corridor.altitude_m[0];
    for role in Role::BOTH {
        let trajectory = &transit.trajectories[role];
        let (first, last) = (trajectory.sample(Duration::ZERO), trajectory.sample(trajectory.duration()));
        assert_eq!((first.position_enu_m, first.attitude), (from[role].position_enu_m, from[role].attitude));
        assert_eq!((last.position_enu_m, last.attitude), (to[role].position_enu_m, to[role].attitude()));
        let mut entered = first.position_enu_m.z >= low_m;
        for k in 0..=400 {
            let sample = trajectory.sample(whole * k / 400);
            let p = sample.position_enu_m;
            entered |= p.z >= low_m;
            assert!(
                router.corridor.fence.contains(p.xy()) && p.z <= router.corridor.altitude_m[1] + 1e-9,
                "{p}"
            );
            if !entered {
                assert_eq!(p.xy(), first.position_enu_m.xy());
                assert_eq!(sample.attitude, first.attitude);
            } else {
                assert!(p.z >= low_m - 1e-9);
            }
        }
    }
    let ends = PerVehicle::from_fn(|role| [from[role].position_enu_m, to[role].position_enu_m]);
    let near_tight = |role: Role, p: &Enu| {
        let near = |end: &usize| (p - ends[role][*end]).norm() < 2.0 * FULL_M + 1e-6;
        [0, 1].iter().filter(|&&end| (ends.i[end] - ends.j[end]).norm() < FULL_M).any(near)
    };
    let n = 1500;
    let [i, j] = Role::BOTH.map(|role| sampled(&transit.trajectories[role], whole, n));
    match transit.separation {
        Separation::Paths => {
            let thinned = |p: &[Enu]| p.iter().step_by(3).copied().collect::<Vec<_>>();
            let (i, j) = (thinned(&i), thinned(&j));
            for (p, q) in i.iter().flat_map(|p| j.iter().map(move |q| (p, q))) {
                let distance_m = (p - q).norm();
                assert!(distance_m >= transit.clearance_m - 1e-5, "{distance_m} {}", transit.clearance_m);
                // Less than the full clearance only where both are near ends that are as close.
                assert!(distance_m >= FULL_M - 1e-5 || (near_tight(Role::I, p) && near_tight(Role::J, q)));
            }
        }
        Separation::Time => {
            assert!(whole / n < PAUSE / 2, "sampled too coarsely to tell turns apart");
            for (k, (p, q)) in i.iter().zip(&j).enumerate() {
                assert!((p - q).norm() >= transit.clearance_m - 1e-5);
                let moving = |positions: &[Enu]| k > 0 && positions[k] != positions[k - 1];
                assert!(!(moving(&i) && moving(&j)));
            }
        }
    }
}

/// A random point of the corridor.
fn place(rng: &mut ChaCha8Rng, router: &Router, radius_m: f64) -> Enu {
    let [low, high] = router.corridor.altitude_m;
    let p = testing::inside(rng, &router.corridor.fence, radius_m);
    Enu::new(p.x, p.y, low + (high - low) * rng.random_range(0.0..=1.0))
}

/// Two random points at least `apart_m` from each other.
fn places(rng: &mut ChaCha8Rng, router: &Router, radius_m: f64, apart_m: f64) -> PerVehicle<Enu> {
    loop {
        let pair = PerVehicle { i: place(rng, router, radius_m), j: place(rng, router, radius_m) };
        if (pair.i - pair.j).norm() >= apart_m {
            return pair;
        }
    }
}

#[test]
fn spec_far_apart_both_fly_directly_at_once() {
    let router = router(square(200.0), [20.0, 100.0]);
    let from = PerVehicle { i: start(0.0, 0.0, 30.0), j: start(0.0, 100.0, 30.0) };
    let to = PerVehicle { i: pose(80.0, 0.0, 30.0), j: pose(40.0, 100.0, 30.0) };
    let transit = router.plan(&from, &to).unwrap();
    assert_sound(&router, &transit, &from, &to);
    assert_eq!((transit.separation, transit.clearance_m), (Separation::Paths, 7.0));
    // v/a + L/v, and the triangle's limit does not bind.
    assert!((transit.duration().as_secs_f64() - (3.2 + 10.0)).abs() < 1e-8);
    assert!((transit.trajectories.j.duration().as_secs_f64() - (3.2 + 5.0)).abs() < 1e-8);
}

#[test]
fn spec_crossing_paths_take_different_layers() {
    let router = router(square(200.0), [20.0, 100.0]);
    let from = PerVehicle { i: start(-50.0, 0.0, 30.0), j: start(0.0, -50.0, 30.0) };
    let to = PerVehicle { i: pose(50.0, 0.0, 30.0), j: pose(0.0, 50.0, 30.0) };
    let transit = router.plan(&from, &to).unwrap();
    assert_sound(&router, &transit, &from, &to);
    assert_eq!(transit.separation, Separation::Paths);
    let top = |role| transit.trajectories[role].path().iter().map(|p| p.z).fold(0.0, f64::max);
    // One goes 7 m up (a micrometre more), the other straight.
    assert!((top(Role::I) - top(Role::J)).abs() > 7.0 && top(Role::I).min(top(Role::J)) == 30.0);
}

#[test]
fn spec_crossing_in_a_band_of_one_altitude_goes_round_where_there_is_room() {
    let router = router(square(200.0), [30.0, 30.0]);
    let from = PerVehicle { i: start(-50.0, 0.0, 30.0), j: start(0.0, -50.0, 30.0) };
    let to = PerVehicle { i: pose(50.0, 0.0, 30.0), j: pose(0.0, 50.0, 30.0) };
    let transit = router.plan(&from, &to).unwrap();
    assert_sound(&router, &transit, &from, &to);
    assert_eq!(transit.separation, Separation::Paths);
    // J goes round an end of I's path.
    assert_eq!(transit.trajectories.i.path().len(), 2);
    assert!(transit.trajectories.j.path().iter().any(|p| p.x.abs() > 50.0));
}

#[test]
fn spec_crossing_in_a_band_of_one_altitude_takes_turns_where_there_is_none() {
    // Nobody gets round the ends of the other's path.
    let router = router(square(55.0), [30.0, 30.0]);
    let from = PerVehicle { i: start(-50.0, 0.0, 30.0), j: start(0.0, -50.0, 30.0) };
    let to = PerVehicle { i: pose(50.0, 0.0, 30.0), j: pose(0.0, 50.0, 30.0) };
    let transit = router.plan(&from, &to).unwrap();
    assert_sound(&router, &transit, &from, &to);
    assert_eq!(transit.separation, Separation::Time);
    // Each takes 3.2 + 12.5 s; between them is the pause.
    assert!((transit.duration().as_secs_f64() - (2.0 * 15.7 + 2.0)).abs() < 1e-8);
}

#[test]
fn spec_places_are_exchanged_in_a_band_of_one_altitude() {
    let router = router(square(60.0), [30.0, 30.0]);
    let from = PerVehicle { i: start(-20.0, 0.0, 30.0), j: start(20.0, 0.0, 30.0) };
    let to = PerVehicle { i: pose(20.0, 0.0, 30.0), j: pose(-20.0, 0.0, 30.0) };
    let transit = router.plan(&from, &to).unwrap();
    assert_sound(&router, &transit, &from, &to);
    assert_eq!(transit.separation, Separation::Time);
}

#[test]
fn spec_no_room_to_pass_is_an_error_with_numbers() {
    // A corridor 4 m wide at one altitude.
    let router = router(polygon(&[[-50., -2.], [50., -2.], [50., 2.], [-50., 2.]]), [30.0, 30.0]);
    let from = PerVehicle { i: start(-20.0, 0.0, 30.0), j: start(20.0, 0.0, 30.0) };
    let to = PerVehicle { i: pose(20.0, 0.0, 30.0), j: pose(-20.0, 0.0, 30.0) };
    assert_eq!(router.plan(&from, &to), Err(TransitError::NoWay { clearance_m: 7.0, direct_m: 0.0 }));
}

#[test]
fn spec_bad_ends_are_named() {
    let router = router(square(100.0), [20.0, 100.0]);
    let from = PerVehicle { i: start(0.0, 0.0, 0.0), j: start(10.0, 0.0, 0.0) };
    let to = PerVehicle { i: pose(0.0, 0.0, 30.0), j: pose(30.0, 0.0, 30.0) };
    let with = |f: &dyn Fn(&mut PerVehicle<Start>, &mut PerVehicle<Pose>)| {
        let (mut from, mut to) = (from, to);
        f(&mut from, &mut to);
        router.plan(&from, &to).map(|_| ())
    };
    assert_eq!(with(&|_, _| ()), Ok(()));
    let close = |end, distance_m, needed_m| Err(TransitError::TooClose { end, distance_m, needed_m });
    assert_eq!(with(&|from, _| from.j.position_enu_m.x = 4.0), close(End::Start, 4.0, 4.5));
    assert_eq!(with(&|_, to| to.j.position_enu_m.x = 4.0), close(End::Goal, 4.0, 5.0));
    assert_eq!(
        with(&|_, to| to.i.position_enu_m.y = f64::NAN),
        Err(TransitError::NotUsable { role: Role::I, end: End::Goal })
    );
    for (result, role, end, outside_m) in [
        (with(&|_, to| to.j.position_enu_m.x = 103.0), Role::J, End::Goal, 3.0),
        (with(&|_, to| to.i.position_enu_m.z = 19.0), Role::I, End::Goal, 1.0),
        (with(&|from, _| from.i.position_enu_m.x = -105.0), Role::I, End::Start, 5.0),
    ] {
        let Err(TransitError::Outside { role: r, end: e, outside_m: o, .. }) = result else {
            panic!("{result:?}")
        };
        assert_eq!((r, e), (role, end));
        assert!((o - outside_m).abs() < 1e-9);
    }
    let bad = Router::new(&airspace(square(10.0), [50.0, 40.0]), &PAIR).map(|_| ());
    assert_eq!(bad, Err(TransitError::Airspace { low_m: 50.0, high_m: 40.0, separation_m: 5.0 }));
    let still = PerVehicle { i: Limits::new(0.0, 1.0, 1.0), ..PAIR };
    let bad = Router::new(&airspace(square(10.0), [40.0, 50.0]), &still).map(|_| ());
    assert_eq!(bad, Err(TransitError::Limit { role: Role::I, key: "speed_m_s", value: 0.0 }));
}

#[test]
fn spec_poses_at_the_least_separation_are_reached_without_getting_closer() {
    let router = router(square(100.0), [20.0, 100.0]);
    let from = PerVehicle { i: start(0.0, 0.0, 0.0), j: start(6.0, 0.0, 0.0) };
    // The vehicles change sides and end 5 m apart, which is the minimum.
    let to = PerVehicle { i: pose(45.0, 0.0, 30.0), j: pose(40.0, 0.0, 30.0) };
    let transit = router.plan(&from, &to).unwrap();
    assert_sound(&router, &transit, &from, &to);
    assert!((transit.clearance_m - 5.0).abs() < 1e-9);
}

#[test]
fn spec_home_ends_level_above_home_and_a_vehicle_on_its_home_stays() {
    let router = router(square(100.0), [20.0, 100.0]);
    let tilted = Attitude::from_euler(1.2, 0.4, 0.7);
    let from = PerVehicle {
        i: Start { position_enu_m: Enu::new(50.0, 0.0, 60.0), attitude: tilted },
        j: start(10.2, 0.0, 0.1),
    };
    let homes = PerVehicle { i: Enu::new(0.0, 0.0, 0.0), j: Enu::new(10.0, 0.0, 0.0) };
    let transit = router.home(&from, &homes).unwrap();
    let end = transit.trajectories.i.end();
    assert_eq!(end.position_enu_m, Enu::new(0.0, 0.0, 20.0));
    assert!(end.attitude.tilt_rad() < 1e-7);
    // The shortest rotation to level turns by the tilt and no more.
    assert!((end.attitude.angle_to(&tilted) - tilted.tilt_rad()).abs() < 1e-9);
    assert_eq!(transit.trajectories.j.duration(), Duration::ZERO);
    let inverted = levelled(&Attitude::from_euler(PI, 0.0, 0.3));
    assert!(inverted.tilt_rad() < 1e-7);
}

#[test]
fn spec_alone_goes_round_where_the_other_may_be() {
    let router = router(square(100.0), [20.0, 20.0]);
    let from = start(-40.0, 0.0, 20.0);
    let home = Enu::new(40.0, 0.0, 0.0);
    let peer = Enu::new(0.0, 0.0, 20.0);
    let whole = |t: &Trajectory| sampled(t, t.duration(), 2000);
    let free = router.alone(Role::J, &from, &home, &[]).unwrap();
    assert!(least_distance(&whole(&free), &[peer]) < 0.1);
    let round = router.alone(Role::J, &from, &home, &[peer]).unwrap();
    assert!(least_distance(&whole(&round), &[peer]) >= 7.0 - 1e-5);
    assert_eq!(round.end().position_enu_m, Enu::new(40.0, 0.0, 20.0));
    // A polyline across the whole area at the only altitude cannot be passed.
    let wall = [Enu::new(0.0, -150.0, 20.0), Enu::new(0.0, 150.0, 20.0)];
    assert!(matches!(router.alone(Role::J, &from, &home, &wall), Err(TransitError::NoWay { .. })));
    let near = [Enu::new(41.0, 0.0, 20.0)];
    let refused = router.alone(Role::J, &from, &home, &near);
    assert!(matches!(refused, Err(TransitError::TooClose { end: End::Goal, .. })), "{refused:?}");
}

#[test]
fn spec_numbers_that_cannot_be_computed_with_are_refused() {
    let router = router(square(100.0), [20.0, 100.0]);
    let from = PerVehicle { i: start(0.0, 0.0, 30.0), j: start(20.0, 0.0, 30.0) };
    let to = PerVehicle { i: pose(0.0, 50.0, 30.0), j: pose(20.0, 50.0, 30.0) };
    let unusable = |role, end| TransitError::NotUsable { role, end };
    for bad in [f64::NAN, f64::INFINITY, 1e300] {
        let mut turned = to;
        turned.j.roll_rad = if bad == 1e300 { f64::NAN } else { bad };
        assert_eq!(router.plan(&from, &turned), Err(unusable(Role::J, End::Goal)));
        let airspace = airspace(square(10.0), [20.0, bad]);
        assert!(matches!(Router::new(&airspace, &PAIR), Err(TransitError::Airspace { .. })));
        let far = PerVehicle { i: start(bad, 0.0, 30.0), ..from };
        let homes = PerVehicle { i: Enu::zeros(), j: Enu::new(20.0, 0.0, 0.0) };
        assert_eq!(router.home(&far, &homes), Err(unusable(Role::I, End::Start)));
        let home = Enu::new(0.0, bad, 0.0);
        assert_eq!(router.home(&from, &PerVehicle { j: home, ..homes }), Err(unusable(Role::J, End::Goal)));
        assert_eq!(router.alone(Role::I, &from.i, &home, &[]), Err(unusable(Role::I, End::Goal)));
        assert_eq!(router.alone(Role::I, &far.i, &homes.i, &[]), Err(unusable(Role::I, End::Start)));
        assert_eq!(router.alone(Role::I, &from.i, &homes.i, &[home]), Err(unusable(Role::J, End::Start)));
    }
}

#[test]
fn prop_ways_home_keep_apart_together_and_alone() {
    let mut rng = testing::rng(10);
    let (mut together, mut round) = (0, 0);
    for case in 0..200 {
        let radius_m = [40.0, 200.0][case % 2];
        let router = router(star(&mut rng, radius_m), [[20.0, 60.0], [20.0, 20.0]][case / 2 % 2]);
        let attitude = Attitude::from_euler(rng.random_range(-1.5..1.5), rng.random_range(-1.5..1.5), 0.0);
        let from =
            places(&mut rng, &router, radius_m, 5.0).map(|position_enu_m| Start { position_enu_m, attitude });
        let homes = loop {
            let homes = places(&mut rng, &router, radius_m, 5.0).map(|p| Enu::new(p.x, p.y, 0.0));
            if (homes.i - homes.j).norm() >= 5.0 {
                break homes;
            }
        };
        let to = homes.map(|home| Pose {
            position_enu_m: Enu::new(home.x, home.y, 20.0),
            roll_rad: 0.0,
            pitch_rad: 0.0,
            yaw_rad: 0.0,
        });
        let level = levelled(&attitude);
        if let Ok(mut transit) = router.home(&from, &homes) {
            together += 1;
            for trajectory in [&mut transit.trajectories.i, &mut transit.trajectories.j] {
                assert_eq!(trajectory.end().attitude, level);
                assert!(level.tilt_rad() < 1e-6);
                // Ends level, heading aside: `assert_sound` compares with the poses' own.
                trajectory.turn(Attitude::level(), 0.0, &LIMITS);
            }
            assert_sound(&router, &transit, &from, &to);
        }
        let keep_out = [from.j.position_enu_m, to.j.position_enu_m];
        if let Ok(alone) = router.alone(Role::I, &from.i, &homes.i, &keep_out) {
            let n = 1000;
            let wall: Vec<_> = (0..=n)
                .map(|k| keep_out[0] + (keep_out[1] - keep_out[0]) * (f64::from(k) / f64::from(n)))
                .collect();
            let flown = sampled(&alone, alone.duration(), 1000);
            let ends = [flown[0], flown[flown.len() - 1]];
            let kept_m = 7f64.min(least_distance(&ends, &wall));
            assert!(least_distance(&flown, &wall) >= kept_m - 1e-3);
            assert!(flown.iter().all(|p| router.corridor.contains(p, 1e-8)));
            round += usize::from(alone.path().len() > 2);
        }
    }
    println!("200 ways home: {together} together, {round} alone with a detour or corner");
    assert!(together > 180 && round > 50);
}

#[test]
fn prop_transits_are_sound_in_roomy_and_in_tight_airspaces() {
    let mut rng = testing::rng(4);
    let (mut by_paths, mut by_time, mut none) = (0, 0, 0);
    for case in 0..400 {
        let radius_m = [30.0, 60.0, 300.0][case % 3];
        let band = [[30.0, 120.0], [30.0, 45.0], [30.0, 30.0]][case / 3 % 3];
        let router = router(star(&mut rng, radius_m), band);
        let mut from = places(&mut rng, &router, radius_m, 5.0).map(|p| Start {
            position_enu_m: p,
            attitude: Attitude::from_euler(rng.random_range(-1.5..1.5), rng.random_range(-1.5..1.5), 0.0),
        });
        if case % 4 == 0 && (from.i.position_enu_m.xy() - from.j.position_enu_m.xy()).norm() >= 5.0 {
            for role in Role::BOTH {
                from[role] = start(from[role].position_enu_m.x, from[role].position_enu_m.y, 0.0);
            }
        }
        let to = places(&mut rng, &router, radius_m, 5.0).map(|p| Pose {
            position_enu_m: p,
            roll_rad: rng.random_range(-1.5..1.5),
            pitch_rad: rng.random_range(-1.5..1.5),
            yaw_rad: 0.0,
        });
        match router.plan(&from, &to) {
            Ok(transit) => {
                assert_sound(&router, &transit, &from, &to);
                assert_eq!(router.clone().plan(&from, &to), Ok(transit.clone()));
                *if transit.separation == Separation::Paths { &mut by_paths } else { &mut by_time } += 1;
            }
            Err(TransitError::NoWay { .. }) => none += 1,
            Err(error) => panic!("{error}"),
        }
    }
    println!("400 transits: {by_paths} by paths, {by_time} by time, {none} without a way");
    // Every branch must have been taken; no way at all is left only where there is no room to pass.
    assert!(by_paths > 200 && by_time > 20 && none < 40, "{by_paths} {by_time} {none}");
}
