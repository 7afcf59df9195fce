//! Radios with links of their own, beside the way through the autopilot.

use std::time::Duration;

use veilwing::mission::Outcome;
use veilwing::role::Role;
use veilwing_sitl::Fault;

use crate::harness::*;

fn apart() -> Setup {
    Setup { radio_apart: true, ..Setup::default() }
}

#[test]
fn spec_a_flight_whose_radios_have_links_of_their_own_serves_every_slot() {
    let mut flight = Flight::new(apart());
    flight.fly_out();
    flight.assert_safe();
    for role in Role::BOTH {
        assert_eq!(flight.outcomes[role], Some(Outcome::Completed), "{}", flight.story());
    }
    for slot in &flight.report().slots {
        assert!(slot.radiated_s.i > 2.5 && slot.radiated_s.j >= slot.radiated_s.i, "{slot:#?}");
        assert_eq!(slot.unprotected_s, 0.0, "{slot:#?}");
    }
}

/// A radio behind the autopilot falls silent by its command's expiry once the autopilot's link is cut; this one is told.
#[test]
fn spec_a_companion_that_loses_its_autopilot_still_silences_a_radio_of_its_own() {
    for role in Role::BOTH {
        let mut flight = in_mid_slot(apart());
        let at = flight.now;
        flight.world.inject(Fault::LinkLoss { vehicle: index(role), on: true });
        flight.pass(Duration::from_secs(2));
        let after = flight.silent_after(role, at);
        assert!(after <= REACTION + Duration::from_millis(30), "{role} {after:?}\n{}", flight.story());
        flight.assert_safe();
    }
}

#[test]
fn spec_a_radio_whose_own_link_is_cut_falls_silent_by_itself_and_protection_holds() {
    for role in Role::BOTH {
        let mut flight = in_mid_slot(apart());
        let at = flight.now;
        flight.set_radio_path(role, Path { loss: 1.0, ..Path::GOOD });
        flight.pass(Duration::from_secs(4));
        let after = flight.silent_after(role, at);
        assert!(after <= LEASE_AND_MARGIN, "{role} {after:?}\n{}", flight.story());
        flight.assert_safe();
    }
}
