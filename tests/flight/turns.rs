//! A transit in which time alone keeps the vehicles apart: they exchange places at the only altitude that there is.

use std::time::Duration;

use veilwing::autopilot::FenceDuty;
use veilwing::geo::{Enu, Pose};
use veilwing::mission::Outcome;
use veilwing::planner::slots::Plan;
use veilwing::role::{PerVehicle, Role};
use veilwing_sitl::Fault;

use crate::harness::*;

/// Slot 0 with I in the west and J in the east, slot 1 the other way round, both level.
fn exchange() -> Planned {
    let mission = yard().mission.changed(|m| {
        m.airspace.altitude_m = [15.0, 16.0];
        m.vehicles.i.home_enu_m = Some(Enu::new(-20.0, 0.0, 0.0));
        m.vehicles.j.home_enu_m = Some(Enu::new(20.0, 0.0, 0.0));
    });
    let mission = mission.unwrap();
    let mut slots = yard().plan.slots.clone();
    for (slot, west) in slots.iter_mut().zip([-20.0, 20.0]) {
        let level =
            |x| Pose { position_enu_m: Enu::new(x, 0.0, 15.0), roll_rad: 0.0, pitch_rad: 0.0, yaw_rad: 0.0 };
        slot.plan.vehicles.i.pose = level(west);
        slot.plan.vehicles.j.pose = level(-west);
    }
    Planned { mission, plan: Plan::new(slots) }
}

fn setup() -> Setup {
    Setup { given: PerVehicle { i: exchange(), j: exchange() }, ..Setup::default() }
}

fn completes(flight: &mut Flight) {
    flight.fly_out();
    flight.assert_safe();
    for role in Role::BOTH {
        assert_eq!(flight.outcomes[role], Some(Outcome::Completed), "{}", flight.story());
    }
    assert!(flight.report().min_separation_m.unwrap() > 5.0, "{}", flight.story());
}

fn x(flight: &Flight, role: Role) -> f64 {
    flight.world.snapshot().vehicles[index(role)].position_enu_m[0]
}

#[test]
fn spec_vehicles_that_exchange_places_take_turns_and_come_home_one_by_one() {
    let mut flight = Flight::new(setup());
    assert!(flight.until(|flight| flight.said(Role::I, "slot 1 for bravo: agreed").is_some()));
    // At no time do both move along the line between their places.
    let mut before = PerVehicle::from_fn(|role| x(&flight, role));
    let mut both = 0;
    while flight.radiating() != [true, true] {
        flight.pass(Duration::from_millis(200));
        let now = PerVehicle::from_fn(|role| x(&flight, role));
        let moves = |role: Role| (now[role] - before[role]).abs() > 0.1;
        both += u32::from(moves(Role::I) && moves(Role::J));
        before = now;
    }
    assert_eq!(both, 0, "{}", flight.story());
    completes(&mut flight);
}

#[test]
fn spec_a_vehicle_that_hears_nothing_of_the_other_does_not_set_off() {
    let mut flight = Flight::new(setup());
    assert!(flight.until(|flight| flight.said(Role::I, "slot 1 for bravo: agreed").is_some()));
    // Whoever goes second does so when it hears that the first has arrived: not while it is deaf.
    let start = PerVehicle::from_fn(|role| x(&flight, role));
    let moved = |flight: &Flight, role: Role| (x(flight, role) - start[role]).abs() > 0.5;
    assert!(flight.until(|flight| Role::BOTH.into_iter().any(|role| moved(flight, role))));
    let second = if moved(&flight, Role::I) { Role::J } else { Role::I };
    let first = second.peer();
    assert!(flight.until(|flight| (x(flight, first) + start[first]).abs() < 0.5), "{}", flight.story());
    // Arrived; two seconds of pause follow. Deaf from 1.2 s on, for 1.9 s: 0.5 s of which an old word still counts.
    flight.pass(Duration::from_millis(1200));
    flight.set_pair_path(first, Path::CUT);
    flight.pass(Duration::from_millis(1900));
    assert!((x(&flight, second) - start[second]).abs() < 0.2, "{}", flight.story());
    flight.set_pair_path(first, Path::GOOD);
    assert!(flight.until(|flight| moved(flight, second)), "{}", flight.story());
    completes(&mut flight);
}

/// When the second one sets off to its next place, the first unheard by it from then on for so long.
fn sets_off(unheard: Option<(Duration, Duration)>) -> Duration {
    let mut flight = Flight::new(setup());
    assert!(flight.until(|flight| flight.said(Role::I, "slot 1 for bravo: agreed").is_some()));
    let start = PerVehicle::from_fn(|role| x(&flight, role));
    let moved = |flight: &Flight, role: Role| (x(flight, role) - start[role]).abs() > 0.3;
    assert!(flight.until(|flight| Role::BOTH.into_iter().any(|role| moved(flight, role))));
    let first = if moved(&flight, Role::I) { Role::I } else { Role::J };
    if let Some((from, length)) = unheard {
        flight.pass(from - flight.now);
        flight.set_pair_path(first, Path::CUT);
        flight.pass(length);
        flight.set_pair_path(first, Path::GOOD);
    }
    assert!(flight.until(|flight| moved(flight, first.peer())), "{}", flight.story());
    let at = flight.now;
    completes(&mut flight);
    at
}

#[test]
fn spec_who_does_not_hear_that_its_turn_has_come_sets_off_as_much_later() {
    let second = Duration::from_secs(1);
    let planned = sets_off(None);
    let late = sets_off(Some((planned - 2 * second, Duration::from_millis(2500))));
    let waited = late - planned;
    assert!(waited >= second && waited <= 2 * second, "{waited:?}");
}

#[test]
fn spec_who_waits_too_long_for_its_turn_gives_the_slot_up() {
    let fence = PerVehicle { i: FenceDuty::None, j: FenceDuty::None };
    let mut flight = Flight::new(Setup { fence, ..setup() });
    assert!(flight.until(|flight| flight.said(Role::I, "slot 1 for bravo: agreed").is_some()));
    let start = PerVehicle::from_fn(|role| x(&flight, role));
    let moved = |flight: &Flight, role: Role| (x(flight, role) - start[role]).abs() > 5.0;
    assert!(flight.until(|flight| Role::BOTH.into_iter().any(|role| moved(flight, role))));
    let first = if moved(&flight, Role::I) { Role::I } else { Role::J };
    // Blown off its way, it does not arrive.
    let wind = Fault::WindStep { vehicle: index(first), mean_enu_m_s: [0.0, 24.0, 0.0] };
    flight.world.inject(wind);
    let text = format!("vehicle {first} is not where it should be for its turn to pass");
    assert!(flight.until(|flight| flight.said(first.peer(), &text).is_some()), "{}", flight.story());
}
