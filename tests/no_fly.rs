//! No-fly areas through the whole chain: planned round, flown round, and found by the simulated world's own monitor where
//! nobody has told the companions of them; read from files that others draw, and written so that they can be read again.

#![cfg(feature = "desk")]
// Helpers of tests may fail the test.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod command;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use nalgebra::{Vector2, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use veilwing::config::{METHODS, Mission, MissionDraft, NoFlyDraft, Optimise};
use veilwing::desk::simulation::{
    Flight, Given, Observer, Path as LinkPath, Scenario, Setup, Witness, vehicle_draft, world_config,
};
use veilwing::geo::Enu;
use veilwing::mission::Outcome;
use veilwing::planner::problem::{NoFly, Objective, Problem, Uncertainty};
use veilwing::planner::slots::Plan;
use veilwing::planner::{Options, plan_slot};
use veilwing::planning::{self, maps::Map};
use veilwing::role::{PerVehicle, Role};
use veilwing::schedule::trajectory::Start;
use veilwing::schedule::transit::{Router, TransitError};
use veilwing_sitl::{Breach, NoFlyConfig, World};

fn yard() -> Mission {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/flight/yard.toml");
    // Homes out of the way of what is put where the poses are.
    Mission::load(&file)
        .unwrap()
        .changed(|draft| {
            draft.vehicles.i.home_enu_m = Some(Enu::new(-30.0, -30.0, 0.0));
            draft.vehicles.j.home_enu_m = Some(Enu::new(10.0, -32.0, 0.0));
        })
        .unwrap()
}

fn square(centre: Vector2<f64>, half_m: f64) -> Vec<[f64; 2]> {
    [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
        .map(|[e, n]| [centre.x + half_m * e, centre.y + half_m * n])
        .to_vec()
}

fn pillar(name: &str, centre: Vector2<f64>, half_m: f64) -> NoFlyDraft {
    NoFlyDraft { name: name.into(), area_enu_m: Some(square(centre, half_m)), ..NoFlyDraft::default() }
}

fn poses(plan: &Plan, role: Role) -> Vec<Enu> {
    plan.slots.iter().map(|slot| slot.plan.vehicles[role].pose.position_enu_m).collect()
}

/// The yard with an area over I's ideal pose for its first user, and one on the straight way from there to the next; with what
/// the yard without them is planned as.
fn obstructed() -> (Mission, Plan, Plan) {
    let bare = yard();
    let ideal = planning::plan(&bare).unwrap();
    let over_pose = |draft: &mut MissionDraft| {
        draft.no_fly = vec![pillar("over the pose", poses(&ideal, Role::I)[0].xy(), 3.0)];
    };
    let first = planning::plan(&bare.changed(over_pose).unwrap()).unwrap();
    let [from, to] = poses(&first, Role::I)[..] else { panic!() };
    let mission = bare.changed(|draft| {
        over_pose(draft);
        draft.no_fly.push(pillar("on the way", (from.xy() + to.xy()) / 2.0, 2.0));
    });
    let mission = mission.unwrap();
    let plan = planning::plan(&mission).unwrap();
    (mission, plan, ideal)
}

#[test]
fn spec_areas_are_in_the_digest_one_by_one_by_text_and_by_value() {
    let text = std::fs::read_to_string("tests/flight/yard.toml").unwrap();
    let area =
        "[[airspace.no_fly]]\nname = \"mast\"\narea_enu_m = [[20, 20], [25, 20], [25, 25]]\nceiling_m = 15\n";
    let bare = Mission::parse("m.toml", &text).unwrap();
    let with = |area: &str| Mission::parse("m.toml", &format!("{text}{area}")).unwrap();
    let read = with(area);
    assert!(read.airspace.no_fly[0].floor_m.is_none() && bare.airspace.no_fly.is_empty());
    let mast = NoFlyDraft {
        name: "mast".into(),
        area_enu_m: Some(vec![[20.0, 20.0], [25.0, 20.0], [25.0, 25.0]]),
        ceiling_m: Some(15.0),
        ..NoFlyDraft::default()
    };
    let built = bare.changed(|draft| draft.no_fly = vec![mast.clone()]).unwrap();
    assert_eq!(built.digest(), read.digest(), "{:?}", built.differences(&read));
    assert_eq!(built.airspace, read.airspace);
    let none = built.changed(|draft| draft.no_fly.clear()).unwrap();
    assert_eq!(none.digest(), bare.digest());
    let others = [
        area.replace("mast", "pole"),
        area.replace("[20, 20]", "[20, 21]"),
        area.replace("ceiling_m = 15", "ceiling_m = 16"),
        area.replace("ceiling_m", "floor_m"),
    ];
    for other in others {
        assert_ne!(with(&other).digest(), read.digest(), "{other}");
    }
    // What nobody would read is refused.
    let lost = bare.changed(|draft| draft.airspace.no_fly = read.airspace.no_fly.clone()).unwrap_err();
    assert!(lost.to_string().contains("put them into the draft's own `no_fly`"), "{lost}");
}

#[test]
fn spec_an_area_over_the_ideal_pose_and_one_on_the_way_are_planned_and_flown_round() {
    let (mission, plan, ideal) = obstructed();
    let areas = &mission.airspace.no_fly;
    assert!(areas[0].depth_m(&poses(&ideal, Role::I)[0]) > 1.0);
    for role in Role::BOTH {
        for at in poses(&plan, role) {
            assert!(areas.iter().all(|area| area.depth_m(&at) == 0.0), "{role} {at}");
        }
    }
    // It costs something, and not everything.
    let rate = |plan: &Plan| plan.slots[0].plan.objective_bps;
    assert!(
        rate(&plan) < rate(&ideal) && rate(&plan) > 0.5 * rate(&ideal),
        "{} {}",
        rate(&plan),
        rate(&ideal)
    );

    let [from, to] = poses(&plan, Role::I)[..] else { panic!() };
    let straight = (0..=1000).map(|k| from + (to - from) * (f64::from(k) / 1000.0));
    assert!(
        straight.into_iter().any(|at| areas.iter().any(|area| area.depth_m(&at) > 0.5)),
        "nothing is on the way"
    );

    let scenario = Scenario::new(&mission, &plan, None).unwrap();
    for seed in 1..=4 {
        let mut deepest = Deepest { areas, metres: 0.0 };
        let flown = scenario.fly(seed, Vec::new(), &mut deepest).unwrap();
        // A pose may lie on a face, and is held to its tolerance.
        assert!(deepest.metres < 1.0, "{seed}: {} m", deepest.metres);
        assert!(flown.completed(), "{seed}: {:?}", flown.outcomes);
        assert_eq!(flown.report.violations, [], "{seed}");
        assert!(flown.report.slots.iter().all(|slot| slot.radiated_s.i > 1.0), "{seed}");
    }
}

/// How deep in the areas a vehicle has been, by its true position after every event.
struct Deepest<'a> {
    areas: &'a [NoFly],
    metres: f64,
}

impl Observer for Deepest<'_> {
    fn saw(&mut self, world: &World) {
        for vehicle in &world.snapshot().vehicles {
            let depths = self.areas.iter().map(|area| area.depth_m(&vehicle.position_enu_m.into()));
            self.metres = depths.fold(self.metres, f64::max);
        }
    }
}

impl Witness for Deepest<'_> {}

/// A flight by `mission` and `plan`, about to begin, in a world that has these areas.
fn flight_over(mission: &Mission, plan: &Plan, areas: Vec<NoFlyConfig>) -> Flight {
    let mut config = world_config(mission, plan).unwrap();
    config.airspace.no_fly = areas;
    let given = PerVehicle::from_fn(|role| {
        let vehicle = veilwing::config::Vehicle::new(vehicle_draft(mission, role, [1, 2])).unwrap();
        Arc::new(Given { mission: mission.clone(), plan: plan.clone(), vehicle })
    });
    let setup =
        Setup { given, start_unasked: true, autopilot: LinkPath::GOOD, pair: LinkPath::GOOD, seed: 5 };
    Flight::new(World::new(config).unwrap(), setup)
}

const END: Duration = Duration::from_secs(400);

/// Flies on until both companions have ended, or as long as `goes_on`.
fn fly(flight: &mut Flight, observer: &mut impl Observer, goes_on: impl Fn(&Flight) -> bool) {
    let flies = |flight: &Flight| Role::BOTH.into_iter().any(|role| flight.outcomes[role].is_none());
    while flight.now() < END && flies(flight) && goes_on(flight) {
        flight.step(END, observer).unwrap();
    }
}

/// What a flight in a world that has areas of its own breaks.
fn flown_over(mission: &Mission, plan: &Plan, areas: Vec<NoFlyConfig>) -> Vec<veilwing_sitl::Violation> {
    let mut flight = flight_over(mission, plan, areas);
    fly(&mut flight, &mut (), |_| true);
    flight.world.report().violations
}

#[test]
fn spec_after_an_abort_both_come_home_round_the_areas_in_their_way() {
    let bare = yard();
    let ideal = planning::plan(&bare).unwrap();
    let homes = bare.vehicles.map(|vehicle| vehicle.home_enu_m.unwrap());
    let middle = |role: Role| (poses(&ideal, role)[0].xy() + homes[role].xy()) / 2.0;
    let mission = bare
        .changed(|draft| {
            draft.no_fly =
                vec![pillar("I's way", middle(Role::I), 3.0), pillar("J's way", middle(Role::J), 3.0)];
        })
        .unwrap();
    let plan = planning::plan(&mission).unwrap();
    let areas = &mission.airspace.no_fly;
    let router = Router::new(&mission.airspace, &mission.transit_limits()).unwrap();
    for role in Role::BOTH {
        let at = poses(&plan, role)[0];
        assert!(
            !router.crossed_straight_home(&at, &homes[role], [at.z, 30.0]).is_empty(),
            "{role}: nothing in the way"
        );
    }
    let of_world = world_config(&mission, &plan).unwrap().airspace.no_fly;
    assert_eq!(of_world.len(), 2);
    let mut flight = flight_over(&mission, &plan, of_world);
    let mut deepest = Deepest { areas, metres: 0.0 };
    fly(&mut flight, &mut deepest, |flight| flight.radiating() != [true; 2]);
    assert_eq!(flight.radiating(), [true; 2]);
    for role in Role::BOTH {
        flight.set_pair_path(role, LinkPath::CUT);
    }
    fly(&mut flight, &mut deepest, |_| true);
    for role in Role::BOTH {
        let outcome = flight.outcomes[role].clone().expect("an end");
        assert_ne!(outcome, Outcome::Completed, "{role}");
        let vehicle = &flight.world.snapshot().vehicles[usize::from(role == Role::J)];
        let off_m = (Vector3::from(vehicle.position_enu_m) - homes[role]).xy().norm();
        assert!(vehicle.landed && off_m < 2.0, "{role}: {vehicle:?}");
    }
    assert!(deepest.metres < 1.0, "{} m", deepest.metres);
    assert_eq!(flight.world.report().violations, []);
}

#[test]
fn spec_an_area_that_nobody_told_the_companions_of_is_found_by_the_monitor() {
    let mission = yard();
    let plan = planning::plan(&mission).unwrap();
    assert_eq!(flown_over(&mission, &plan, Vec::new()), []);
    let area = |centre: Vector2<f64>, floor_m, ceiling_m| NoFlyConfig {
        name: "planted".into(),
        area_enu_m: square(centre, 4.0),
        floor_m,
        ceiling_m,
    };
    let at = poses(&plan, Role::J)[0];
    let found = flown_over(&mission, &plan, vec![area(at.xy(), None, None)]);
    let of_area = |v: &&veilwing_sitl::Violation| matches!(v.breach, Breach::NoFly { area: 0, .. });
    let told: Vec<_> = found.iter().filter(of_area).collect();
    assert!(!told.is_empty() && told.iter().all(|v| v.invariant().name() == "F1"), "{found:?}");
    assert!(
        told.iter().any(|v| v.vehicle == Some(1)) && told[0].to_string().contains("no-fly area 1"),
        "{found:?}"
    );
    // Over it nothing is forbidden.
    let [low, _] = mission.airspace.altitude_m;
    assert_eq!(flown_over(&mission, &plan, vec![area(at.xy(), None, Some(low - 4.0))]), []);
}

#[test]
fn spec_a_slot_behind_an_area_that_nothing_passes_is_refused_by_name() {
    let mut airspace = yard().airspace.clone();
    // A wall through the whole yard.
    airspace.no_fly = vec![NoFly {
        name: "the wall".into(),
        area_enu_m: [[-50.0, -2.0], [50.0, -2.0], [50.0, 2.0], [-50.0, 2.0]].map(Vector2::from).to_vec(),
        floor_m: None,
        ceiling_m: None,
    }];
    let limits = yard().transit_limits();
    let at =
        |e, n| Start { position_enu_m: Enu::new(e, n, 20.0), attitude: veilwing::geo::Attitude::level() };
    let pose = |e, n| veilwing::geo::Pose {
        position_enu_m: Enu::new(e, n, 20.0),
        roll_rad: 0.0,
        pitch_rad: 0.0,
        yaw_rad: 0.0,
    };
    let from = PerVehicle { i: at(0.0, -20.0), j: at(20.0, -20.0) };
    let to = PerVehicle { i: pose(0.0, 20.0), j: pose(20.0, -25.0) };
    let error = Router::new(&airspace, &limits).unwrap().plan(&from, &to).unwrap_err();
    assert!(
        matches!(&error, TransitError::Barred { role: Role::I, areas } if areas == &["the wall"]),
        "{error}"
    );
    // With a ceiling there is a way over it, and none comes nearer than its margin.
    airspace.no_fly[0].ceiling_m = Some(24.0);
    let transit = Router::new(&airspace, &limits).unwrap().plan(&from, &to).unwrap();
    let path = transit.trajectories.i.path();
    assert!(path.iter().any(|at| at.z >= 24.5), "{path:?}");
    let inside =
        Router::new(&airspace, &limits).unwrap().plan(&from, &PerVehicle { i: pose(0.0, 0.5), ..to });
    assert!(matches!(&inside, Err(TransitError::NoFly { area, .. }) if area == "the wall"), "{inside:?}");
}

#[test]
fn val_what_an_autopilot_crosses_by_itself_straight_home_and_straight_down() {
    let mut airspace = yard().airspace.clone();
    airspace.no_fly = vec![NoFly {
        name: "the wall".into(),
        area_enu_m: [[-20.0, -2.0], [20.0, -2.0], [20.0, 2.0], [-20.0, 2.0]].map(Vector2::from).to_vec(),
        floor_m: None,
        ceiling_m: Some(24.0),
    }];
    let router = Router::new(&airspace, &yard().transit_limits()).unwrap();
    let (pose, home) = (Enu::new(0.0, 20.0, 15.0), Enu::new(0.0, -20.0, 0.0));
    assert_eq!(router.crossed_straight_home(&pose, &home, [15.0, 20.0]), ["the wall"]);
    assert_eq!(router.crossed_straight_home(&pose, &home, [23.0, 30.0]), ["the wall"]);
    assert!(router.crossed_straight_home(&pose, &home, [24.0, 30.0]).is_empty());
    assert!(router.crossed_straight_home(&pose, &Enu::new(30.0, 10.0, 0.0), [15.0, 20.0]).is_empty());
    assert!(router.crossed_straight_down(&pose).is_empty());
    assert_eq!(router.crossed_straight_down(&Enu::new(1.0, 1.0, 26.0)), ["the wall"]);
    assert!(router.can_be_home(&home) && !router.can_be_home(&Enu::new(1.0, 1.0, 0.0)));
    assert!(!router.can_be_home(&Enu::new(100.0, 0.0, 0.0)));
}

// ---- a judge of another road -------------------------------------------------------------------------------------

/// The paper's rate without jitter, stated again: J's null on the user, so that all its power is free.
struct Judge<'a> {
    problem: &'a Problem,
    rng: ChaCha8Rng,
}

impl Judge<'_> {
    /// Bit/s/Hz of I at `x[..3]` with its axis by the angles `x[3..5]`, and J at `x[5..]`; `None` where that is forbidden.
    fn rate(&self, x: &[f64; 8]) -> Option<f64> {
        let air = &self.problem.airspace;
        let (i, j) = (Vector3::new(x[0], x[1], x[2]), Vector3::new(x[5], x[6], x[7]));
        for at in [&i, &j] {
            let [low, high] = air.altitude_m;
            let outside = at.x.abs() > 500.0 || at.y.abs() > 500.0 || at.z < low || at.z > high;
            if outside || air.no_fly.iter().any(|area| Self::is_inside(area, at)) {
                return None;
            }
        }
        let (sin, cos) = x[3].sin_cos();
        let axis = Vector3::new(sin * x[4].cos(), sin * x[4].sin(), cos);
        let user = self.problem.user_enu_m;
        let null = (j - user).normalize();
        let gain = |at: &Vector3<f64>, axis: &Vector3<f64>, node: &Vector3<f64>| {
            let d = node - at;
            let along = d.normalize().dot(axis);
            (1.0 - along * along) / d.norm_squared()
        };
        let radio = &self.problem.radio;
        let sinr = |node: &Vector3<f64>| {
            let jam = radio.max_power_w.j * gain(&j, &null, node);
            radio.max_power_w.i * gain(&i, &axis, node) / (jam + radio.noise_power_w)
        };
        let heard = self.problem.eavesdroppers.iter().map(|e| sinr(&e.position_enu_m)).fold(0.0, f64::max);
        Some(sinr(&user).ln_1p() / 2f64.ln() - heard.ln_1p() / 2f64.ln())
    }

    /// By the sides that a ray to the east crosses.
    fn is_inside(area: &NoFly, at: &Vector3<f64>) -> bool {
        let n = area.area_enu_m.len();
        let crossed = (0..n).filter(|k| {
            let (a, b) = (area.area_enu_m[*k], area.area_enu_m[(k + 1) % n]);
            (a.y > at.y) != (b.y > at.y) && at.x < a.x + (at.y - a.y) / (b.y - a.y) * (b.x - a.x)
        });
        let [floor, ceiling] = area.heights_m();
        crossed.count() % 2 == 1 && floor < at.z && at.z < ceiling
    }

    /// Many random starts over all there is, each improved by random steps that shrink while they fail; whatever is forbidden
    /// is thrown away.
    fn best(&mut self, starts: usize, steps: usize) -> f64 {
        let mut best = f64::NEG_INFINITY;
        let [low, high] = self.problem.airspace.altitude_m;
        for start in 0..starts {
            let reach = [500.0, 120.0, 40.0][start % 3];
            let (mut x, mut value) = loop {
                let user = self.problem.user_enu_m;
                let node =
                    self.problem.eavesdroppers[start % self.problem.eavesdroppers.len()].position_enu_m;
                let mut about = |c: f64| (c + self.rng.random_range(-reach..reach)).clamp(-500.0, 500.0);
                let (ie, in_, je, jn) = (about(user.x), about(user.y), about(node.x), about(node.y));
                let x = [
                    ie,
                    in_,
                    low + (high - low) * self.rng.random::<f64>().powi(3),
                    self.rng.random_range(0.0..std::f64::consts::PI),
                    self.rng.random_range(0.0..std::f64::consts::TAU),
                    je,
                    jn,
                    low + (high - low) * self.rng.random::<f64>().powi(3),
                ];
                if let Some(value) = self.rate(&x) {
                    break (x, value);
                }
            };
            let mut size = 1.0;
            for _ in 0..steps {
                let mut other = x;
                // Some of the variables at a time: along a face the others stay.
                let all = self.rng.random_bool(0.3);
                let one = self.rng.random_range(0..8);
                for (k, c) in other.iter_mut().enumerate() {
                    let unit = if k == 3 || k == 4 { 1.0 } else { 60.0 };
                    if all || k == one || self.rng.random_bool(0.15) {
                        *c += unit * size * self.rng.random_range(-1.0..1.0);
                    }
                }
                // Walls of the band are walked along.
                other[2] = other[2].clamp(low, high);
                other[7] = other[7].clamp(low, high);
                match self.rate(&other).filter(|found| *found > value) {
                    Some(found) => (x, value, size) = (other, found, f64::min(1.0, size * 1.6)),
                    None => size = f64::max(1e-7, size * 0.97),
                }
            }
            best = best.max(value);
        }
        best
    }
}

/// A problem of the paper's kind with areas where its plan without them has the vehicles.
fn hindered(seed: u64) -> Problem {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let nodes: Vec<[f64; 2]> = (0..2 + seed as usize % 3)
        .map(|_| [rng.random_range(-250.0..250.0), rng.random_range(-250.0..250.0)])
        .collect();
    let mut problem = Problem::paper(nodes, 0.5, 0.0);
    let ideal = plan_slot(&problem, &Options::default()).unwrap().vehicles;
    for (k, vehicle) in [ideal.i, ideal.j].into_iter().enumerate() {
        let at = vehicle.pose.position_enu_m;
        let mut side = || rng.random_range(8.0..60.0);
        let (west, east, south, north) = (side(), side(), side(), side());
        // An L for one of them.
        let corners = if (seed as usize + k).is_multiple_of(2) {
            vec![[-west, -south], [east, -south], [east, north], [-west, north]]
        } else {
            vec![
                [-west, -south],
                [2.0 * east, -south],
                [2.0 * east, 4.0],
                [4.0, 4.0],
                [4.0, 2.0 * north],
                [-west, 2.0 * north],
            ]
        };
        problem.airspace.no_fly.push(NoFly {
            name: format!("area {k}"),
            area_enu_m: corners.into_iter().map(|c| at.xy() + Vector2::from(c)).collect(),
            floor_m: None,
            ceiling_m: seed.is_multiple_of(2).then_some(at.z + 5.0 + 8.0 * (seed % 5) as f64),
        });
    }
    problem
}

#[test]
fn val_the_plan_beside_areas_is_as_good_as_that_of_a_dense_search_that_throws_away_what_is_forbidden() {
    let mut weakest = f64::INFINITY;
    for seed in 0..8 {
        let problem = hindered(seed);
        let plan = plan_slot(&problem, &Options::default()).unwrap();
        for role in Role::BOTH {
            let at = plan.vehicles[role].pose.position_enu_m;
            assert!(
                problem.airspace.no_fly.iter().all(|area| !Judge::is_inside(area, &at)),
                "{seed} {role} {at}"
            );
        }
        let planned = plan.secrecy_rate_bps / problem.radio.bandwidth_hz;
        let mut judge = Judge { problem: &problem, rng: ChaCha8Rng::seed_from_u64(1000 + seed) };
        let judged = judge.best(90, 6000);
        println!("{seed}: planned {planned:.4}, judged {judged:.4} bit/s/Hz");
        assert!(judged - planned <= 0.05, "{seed}: planned {planned}, judged {judged}");
        weakest = weakest.min(judged - planned);
    }
    // A judge that finds nothing judges nothing.
    assert!(weakest > -0.3, "the judge's search is too weak: {weakest}");
}

#[test]
fn spec_every_method_every_objective_and_a_plan_for_volume_keep_out_of_the_areas() {
    let keeps_out = |problem: &Problem, options: &Options, what: &str| {
        let plan = plan_slot(problem, options).unwrap();
        for role in Role::BOTH {
            let at = plan.vehicles[role].pose.position_enu_m;
            let areas = &problem.airspace.no_fly;
            assert!(areas.iter().all(|area| !Judge::is_inside(area, &at)), "{what} {role} {at}");
        }
    };
    for seed in [1, 2] {
        let problem = hindered(seed);
        for (name, method) in METHODS {
            keeps_out(&problem, &Options { method: *method, ..Options::default() }, name);
        }
        let mut jittered = problem.clone();
        jittered.jitter.std_rad = 2f64.to_radians();
        keeps_out(&jittered, &Options::default(), "under jitter");
        for eavesdropper in &mut jittered.eavesdroppers {
            eavesdropper.uncertainty = Uncertainty::Disc { radius_m: 20.0 };
        }
        jittered.objective = Objective::WorstCase;
        keeps_out(&jittered, &Options::default(), "in the worst case");
    }
    let (mission, ..) = obstructed();
    let volume = mission.changed(|draft| draft.planner.optimise = Optimise::Volume).unwrap();
    let plan = planning::plan(&volume).unwrap();
    for role in Role::BOTH {
        for at in poses(&plan, role) {
            assert!(volume.airspace.no_fly.iter().all(|area| area.depth_m(&at) == 0.0), "{role} {at}");
        }
    }
}

// ---- files that others draw --------------------------------------------------------------------------------------

fn directory(name: &str) -> PathBuf {
    command::directory(&format!("no-fly-{name}"))
}

#[test]
fn spec_what_plan_out_wrote_gives_the_same_field_and_the_path_is_not_in_the_digest() {
    let (mission, plan, _) = obstructed();
    let written = mission.changed(|draft| draft.no_fly[1].ceiling_m = Some(31.5)).unwrap();
    let map = Map::of_plan(&written, &plan).unwrap();
    let folder = directory("maps");
    for (name, text) in map.files("field") {
        std::fs::write(folder.join(name), text).unwrap();
    }
    let read = |file: &str| {
        let text = std::fs::read_to_string("tests/flight/yard.toml").unwrap();
        let text = text.replace(
            "area_enu_m = [[-40.0, -40.0], [40.0, -40.0], [40.0, 40.0], [-40.0, 40.0]]",
            &format!("area_file = \"{file}\""),
        );
        let text = text
            .replace("home_enu_m = [-8.0, 0.0, 0.0]\n", "")
            .replace("home_enu_m = [8.0, -20.0, 0.0]\n", "");
        let path = folder.join("mission.toml");
        std::fs::write(&path, text).unwrap();
        Mission::load(&path).unwrap()
    };
    // 1e-7 degrees are 11 mm.
    let near =
        |a: &[Vector2<f64>], b: &[Vector2<f64>]| a.iter().all(|a| b.iter().any(|b| (a - b).norm() < 0.011));
    for file in ["field.geojson", "field-i.plan"] {
        let again = read(file);
        assert_eq!(again.airspace.area_enu_m.len(), 4);
        assert!(near(&again.airspace.area_enu_m, &written.airspace.area_enu_m), "{file}");
        assert_eq!(again.airspace.no_fly.len(), 2, "{file}");
        for (a, b) in again.airspace.no_fly.iter().zip(&written.airspace.no_fly) {
            assert!(near(&a.area_enu_m, &b.area_enu_m), "{file}");
            if file == "field.geojson" {
                assert_eq!((&a.name, a.heights_m()), (&b.name, b.heights_m()));
            }
        }
        let home = again.vehicles.i.home_enu_m;
        assert_eq!(home.is_some(), file == "field.geojson");
        assert!(home.is_none_or(|home| (home - Enu::new(-30.0, -30.0, 0.0)).norm() < 0.011));
        // What was read counts, and not from where: a copy of the mission that needs no other file is the same mission.
        let alone = Mission::parse("alone.toml", &again.with_rows().unwrap()).unwrap();
        assert_eq!(alone.digest(), again.digest(), "{:?}", alone.differences(&again));
        std::fs::copy(folder.join(file), folder.join(format!("other-{file}"))).unwrap();
        assert_eq!(read(&format!("other-{file}")).digest(), again.digest());
        assert_eq!(again.changed(|_| ()).unwrap().digest(), again.digest());
    }
    assert_ne!(read("field.geojson").digest(), read("field-i.plan").digest());
}

#[test]
fn spec_a_broken_area_file_is_named_with_what_is_wrong_with_it() {
    let folder = directory("broken");
    std::fs::write(folder.join("empty.plan"), r#"{ "fileType": "Plan" }"#).unwrap();
    for (file, says) in [
        ("empty.plan", "`area_file` is \"empty.plan\": the file has 0 inclusion polygons in geoFence"),
        ("none.plan", "`area_file` is \"none.plan\": the file"),
    ] {
        let text = std::fs::read_to_string("tests/flight/yard.toml").unwrap();
        let text = text.replace(
            "area_enu_m = [[-40.0, -40.0], [40.0, -40.0], [40.0, 40.0], [-40.0, 40.0]]",
            &format!("area_file = \"{file}\""),
        );
        let path = folder.join("mission.toml");
        std::fs::write(&path, text).unwrap();
        let told = Mission::load(&path).unwrap_err().to_string();
        assert!(told.contains(says), "{told}");
        assert!(told.contains("mission.toml:8:"), "{told}");
    }
}
