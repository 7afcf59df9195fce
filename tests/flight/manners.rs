//! What PX4 does of its own accord, as it was seen on the real program: it goes back to OFFBOARD once it has landed, tells its
//! state in uneven steps, and in simulation loses half of its charge in half a minute.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::MavCmd;
use veilwing::role::Role;
use veilwing_sitl::Traps;

use crate::harness::*;
use crate::start::completes;

/// Flies the small mission to its end, all served.
fn flown(traps: Traps) -> Flight {
    completes(Flight::new(Setup { traps, ..Setup::default() }))
}

/// How long I has been on the air, over all slots.
fn radiated_s(flight: &Flight) -> f64 {
    flight.report().slots.iter().map(|slot| slot.radiated_s.i).sum()
}

#[test]
fn spec_a_mission_begins_in_the_mode_that_the_one_before_has_left() {
    let mut flight = flown(Traps::default());
    let once_s = radiated_s(&flight);
    flight.pass(Duration::from_secs(2));
    for role in Role::BOTH {
        flight.start(role);
    }
    let again = flight.now;
    flight.pass(Duration::from_secs(10));
    let snapshot = flight.world.snapshot();
    assert!(snapshot.vehicles.iter().all(|vehicle| vehicle.mode == "OFFBOARD" && !vehicle.armed));
    // A mode that nobody aboard has asked for is not theirs.
    for role in Role::BOTH {
        assert!(flight.log.setpoints[role].iter().all(|at| *at <= again), "{}", flight.story());
    }
    flight.command(Role::I, MavCmd::MAV_CMD_MISSION_START);
    let flight = completes(flight);
    assert!((radiated_s(&flight) / once_s - 2.0).abs() < 0.02, "{once_s} {}", flight.story());
}

#[test]
fn spec_steps_of_16_and_24_ms_are_a_state_that_comes_in_time() {
    let uneven = flown(Traps::default());
    let even = flown(Traps { uneven_telemetry: false, ..Traps::default() });
    let [uneven_s, even_s] = [&uneven, &even].map(radiated_s);
    assert!((uneven_s - even_s).abs() < 0.05, "{uneven_s} {even_s}\n{}", uneven.story());
    for role in Role::BOTH {
        assert_eq!(uneven.said(role, "silent"), None, "{}", uneven.story());
    }
}

#[test]
fn spec_a_battery_that_px4_makes_up_is_no_reason_to_come_home() {
    flown(Traps { simulated_battery: true, ..Traps::default() });
}
