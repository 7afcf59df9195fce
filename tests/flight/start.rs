//! When the mission begins: at a given time, for a companion that comes late, for one that comes again.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::MavCmd;
use veilwing::mission::Outcome;
use veilwing::role::{PerVehicle, Role};
use veilwing::time::Utc;

use crate::harness::*;

/// The simulated world begins at 2027-01-15T12:00:00Z.
fn starting_at((hour, minute, second): (u8, u8, u8)) -> Planned {
    yard().under(|m| m.tdma.start_utc = Utc::from_civil((2027, 1, 15), (hour, minute, second), 0, 0))
}

fn setup(time: (u8, u8, u8), start_unasked: bool) -> Setup {
    let given = PerVehicle { i: starting_at(time), j: starting_at(time) };
    Setup { given, start_unasked, ..Setup::default() }
}

pub fn completes(mut flight: Flight) -> Flight {
    flight.fly_out();
    flight.assert_safe();
    for role in Role::BOTH {
        assert_eq!(flight.outcomes[role], Some(Outcome::Completed), "{}", flight.story());
    }
    flight
}

fn positions(flight: &Flight) -> [[f64; 3]; 2] {
    [0, 1].map(|k| flight.world.snapshot().vehicles[k].position_enu_m)
}

pub fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}

/// When vehicle I is first on the air.
fn first_on(flight: &Flight) -> Duration {
    flight.log.on_air.iter().find(|(_, on)| on[0]).map(|(at, _)| *at).unwrap()
}

#[test]
fn spec_the_first_transit_begins_at_the_given_time_whoever_asks_for_more() {
    let at = Duration::from_secs(75);
    let mut first = Vec::new();
    for start_unasked in [false, true] {
        let mut flight = Flight::new(setup((12, 1, 15), start_unasked));
        flight.pass(Duration::from_secs(30));
        for role in Role::BOTH {
            assert!(flight.landed(role), "{}", flight.story());
            let announced = flight.said(role, "the start at 2027-01-15T12:01:15Z, with take-off");
            assert!(announced.is_some(), "{}", flight.story());
            // Twenty seconds and the climb.
            assert!(flight.said(role, "with take-off 20 s").is_none(), "{}", flight.story());
        }
        // In the air in time, and waiting where the transit begins.
        flight.pass(at - flight.now - Duration::from_secs(4));
        assert!(Role::BOTH.into_iter().all(|role| !flight.landed(role)), "{}", flight.story());
        let before = positions(&flight);
        flight.pass(at - flight.now);
        let then = positions(&flight);
        flight.pass(Duration::from_secs(4));
        let after = positions(&flight);
        for k in 0..2 {
            assert!(distance(before[k], then[k]) < 0.5, "{before:?} {then:?}\n{}", flight.story());
            assert!(distance(then[k], after[k]) > 2.0, "{then:?} {after:?}\n{}", flight.story());
        }
        first.push(first_on(&completes(flight)));
    }
    // Ten seconds later is ten seconds later: slots keep their places in UTC.
    let later = first_on(&completes(Flight::new(setup((12, 1, 25), false))));
    for first in first {
        let shift = (later - first).as_secs_f64();
        assert!((shift - 10.0).abs() < 0.1, "{first:?} {later:?}");
    }
}

#[test]
fn spec_a_start_in_the_past_waits_for_the_operator_and_says_so() {
    for told in Role::BOTH {
        let mut flight = Flight::new(setup((11, 59, 0), false));
        flight.pass(Duration::from_secs(30));
        for role in Role::BOTH {
            assert!(flight.landed(role), "{}", flight.story());
            let said = flight.said(role, "MISSION_START: the start at 2027-01-15T11:59:00Z was past");
            assert!(said.is_some(), "{}", flight.story());
        }
        flight.command(told, MavCmd::MAV_CMD_MISSION_START);
        completes(flight);
    }
}

#[test]
fn spec_a_companion_that_comes_late_joins() {
    for late in Role::BOTH {
        let mut flight = Flight::new(Setup::default());
        flight.kill(late);
        flight.pass(Duration::from_secs(25));
        let missed = format!("vehicle {late} is not heard");
        assert!(flight.said(late.peer(), &missed).is_some(), "{}", flight.story());
        assert!(Role::BOTH.into_iter().all(|role| flight.landed(role)), "{}", flight.story());
        flight.start(late);
        completes(flight);
    }
}

#[test]
fn spec_a_companion_that_starts_again_on_the_ground_joins_again() {
    for again in Role::BOTH {
        let mut flight = Flight::new(Setup { start_unasked: false, ..Setup::default() });
        flight.pass(Duration::from_secs(15));
        flight.kill(again);
        flight.pass(Duration::from_secs(1));
        flight.start(again);
        flight.pass(Duration::from_secs(15));
        flight.command(again.peer(), MavCmd::MAV_CMD_MISSION_START);
        completes(flight);
    }
}

#[test]
fn regress_nobody_takes_off_before_it_is_on_disk_that_the_mission_has_begun() {
    // A process that is killed in the air would leave one that knows of no flight: with --start it takes off once more.
    let mut flight = Flight::new(Setup::default());
    flight.stall_disk(Role::I, true);
    flight.pass(Duration::from_secs(25));
    assert!(flight.said(Role::I, "preflight passed, taking off").is_some(), "{}", flight.story());
    assert!(flight.landed(Role::I) && !flight.landed(Role::J), "{}", flight.story());
    flight.kill(Role::I);
    flight.stall_disk(Role::I, false);
    flight.start(Role::I);
    flight.pass(Duration::from_secs(60));
    assert!(flight.said(Role::I, "airborne").is_none(), "{}", flight.story());
    assert!(Role::BOTH.into_iter().all(|role| flight.landed(role)), "{}", flight.story());
    flight.assert_safe();
}

#[test]
fn spec_a_slow_disk_delays_a_take_off_and_nothing_else() {
    let mut flight = Flight::new(Setup::default());
    flight.stall_disk(Role::J, true);
    flight.pass(Duration::from_secs(8));
    assert!(flight.landed(Role::J), "{}", flight.story());
    flight.stall_disk(Role::J, false);
    completes(flight);
    // In the air nobody waits for it.
    let mut flight = Flight::new(Setup::default());
    flight.pass(Duration::from_secs(15));
    Role::BOTH.into_iter().for_each(|role| flight.stall_disk(role, true));
    completes(flight);
}

#[test]
fn spec_a_start_that_is_never_on_disk_is_given_up() {
    let mut flight = Flight::new(Setup::default());
    flight.stall_disk(Role::I, true);
    flight.fly_out();
    let Some(Outcome::Aborted(cause)) = &flight.outcomes[Role::I] else { panic!("{}", flight.story()) };
    assert_eq!(cause.to_string(), "the disk has not taken the record of the start in 30 s");
    assert!(flight.landed(Role::I) && flight.landed(Role::J), "{}", flight.story());
    assert!(flight.said(Role::I, "airborne").is_none());
    flight.assert_safe();
}
