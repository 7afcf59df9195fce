//! The land detector's guard outlives nobody: a parameter that the autopilot keeps on its disk, and that a companion has
//! changed for its own flight alone, is put back by whoever is left to do it.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::{COMMAND_LONG_DATA, MavCmd, MavMessage};
use veilwing::mission::Outcome;
use veilwing::role::Role;

use crate::harness::*;

/// The pilot lands a vehicle that no companion flies; whether it disarms by itself.
fn lands_by_its_pilot(flight: &mut Flight, role: Role) -> bool {
    // PX4's AUTO.LAND.
    let land = MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
        command: MavCmd::MAV_CMD_DO_SET_MODE,
        param1: 1.0,
        param2: 4.0,
        param3: 6.0,
        target_system: 1 + index(role) as u8,
        target_component: 1,
        ..Default::default()
    });
    flight.tell_autopilot(role, &land);
    flight.until(|flight| flight.landed(role))
}

#[test]
fn spec_a_companion_that_is_told_to_end_levels_the_vehicle_and_puts_the_land_detector_back_first() {
    for role in Role::BOTH {
        let mut flight = in_mid_slot(Setup::default());
        let at = flight.now;
        flight.stop(role);
        assert!(flight.until(|flight| flight.outcomes[role].is_some()), "{}", flight.story());
        let took = flight.now - at;
        assert!(took < Duration::from_secs(5), "{role} ended after {took:?}\n{}", flight.story());
        assert!(matches!(flight.outcomes[role], Some(Outcome::Interrupted)), "{:?}", flight.outcomes[role]);
        flight.pass(Duration::from_secs(5));
        for told in Role::BOTH {
            assert!(flight.said(told, "the land detector").is_none(), "{}", flight.story());
        }
        assert!(lands_by_its_pilot(&mut flight, role), "{}", flight.story());
    }
}

#[test]
fn spec_a_guard_whose_companion_was_killed_is_told_by_the_peer_and_put_back_by_the_next() {
    for role in Role::BOTH {
        let mut flight = in_mid_slot(Setup::default());
        flight.kill(role);
        let told = format!("the land detector of vehicle {role} is off");
        assert!(flight.until(|flight| flight.said(role.peer(), &told).is_some()), "{}", flight.story());
        flight.pass(Duration::from_secs(2));
        flight.start(role);
        let put_right =
            "LNDMC_Z_VEL_MAX was 0, left so by a companion that ended in the air: it is 0.25 again";
        assert!(flight.until(|flight| flight.said(role, put_right).is_some()), "{}", flight.story());
        assert!(lands_by_its_pilot(&mut flight, role), "{}", flight.story());
    }
}

/// What the two above prevent.
#[test]
fn regress_without_anyone_to_put_it_back_the_vehicle_stays_armed_on_the_ground() {
    let mut flight = in_mid_slot(Setup::default());
    flight.kill(Role::J);
    flight.pass(Duration::from_secs(2));
    assert!(!lands_by_its_pilot(&mut flight, Role::J), "{}", flight.story());
}
