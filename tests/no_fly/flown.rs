//! Planned round, flown round, and found by the simulated world's own monitor where nobody has told the companions.

use std::sync::Arc;
use std::time::Duration;

use nalgebra::{Vector2, Vector3};
use veilwing::config::Mission;
use veilwing::desk::simulation::{
    Flight, Given, Observer, Path as LinkPath, Scenario, Setup, Witness, vehicle_draft, world_config,
};
use veilwing::geo::Enu;
use veilwing::mission::Outcome;
use veilwing::planner::problem::NoFly;
use veilwing::planner::slots::Plan;
use veilwing::planning;
use veilwing::role::{PerVehicle, Role};
use veilwing::schedule::trajectory::Start;
use veilwing::schedule::transit::{Router, TransitError};
use veilwing_sitl::{Breach, NoFlyConfig, World};

use crate::{obstructed, pillar, poses, square, yard};

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

/// Across the yard's middle, so far to the west and the east.
fn wall(half_m: f64, ceiling_m: Option<f64>) -> NoFly {
    let corners = [[-half_m, -2.0], [half_m, -2.0], [half_m, 2.0], [-half_m, 2.0]];
    let area_enu_m = corners.map(Vector2::from).to_vec();
    NoFly { name: "the wall".into(), area_enu_m, floor_m: None, ceiling_m }
}

#[test]
fn spec_a_slot_behind_an_area_that_nothing_passes_is_refused_by_name() {
    let mut airspace = yard().airspace.clone();
    // Through the whole yard.
    airspace.no_fly = vec![wall(50.0, None)];
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
    airspace.no_fly = vec![wall(20.0, Some(24.0))];
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
