//! The permission to radiate: when it holds, and that every flight's log says it.

use std::time::Duration;

use veilwing::config::Emission;
use veilwing::role::{PerVehicle, Role};
use veilwing::time::Utc;

use crate::harness::*;

/// When the simulated world begins: 2027-01-15T12:00:00Z.
const BEGIN: Utc = Utc { unix_us: 1_800_014_400_000_000 };
/// Long before and after.
pub const ALWAYS: [Utc; 2] = [Utc { unix_us: 1_700_000_000_000_000 }, Utc { unix_us: 1_900_000_000_000_000 }];

fn after(seconds: u64) -> Utc {
    BEGIN + Duration::from_secs(seconds)
}

fn real(valid: Option<[Utc; 2]>) -> Setup {
    let permitted = yard().under(|draft| {
        draft.emission = Some(Emission {
            authorised_by: "a test".to_owned(),
            band_hz: [2.4e9, 2.41e9],
            max_power_w: 2.0,
            licensee: Some("the testers".to_owned()),
            licence: Some("T-1".to_owned()),
            valid,
            site: Some("a yard".to_owned()),
        });
    });
    Setup { given: PerVehicle { i: permitted.clone(), j: permitted }, simulated: false, ..Setup::default() }
}

#[test]
fn spec_nothing_real_takes_off_without_a_permission_that_holds_to_the_end() {
    for (valid, words) in [
        (None, "emission: does not say when it is valid"),
        (Some([after(3600), ALWAYS[1]]), "emission: is not valid before 2027-01-15T13:00:00Z"),
        (Some([ALWAYS[0], after(0)]), "emission: expired at 2027-01-15T12:00:00Z"),
        (
            Some([ALWAYS[0], after(60)]),
            "emission: expires at 2027-01-15T12:01:00Z, should be valid to the end",
        ),
    ] {
        let mut flight = Flight::new(real(valid));
        flight.pass(Duration::from_secs(30));
        for role in Role::BOTH {
            assert!(flight.landed(role) && flight.log.setpoints[role].is_empty(), "{}", flight.story());
            assert!(flight.said(role, words).is_some(), "{words}\n{}", flight.story());
        }
        assert!(flight.log.on_air.is_empty());
    }
}

#[test]
fn spec_a_flight_s_log_says_what_permits_it() {
    let mut flight = Flight::new(real(Some(ALWAYS)));
    assert!(flight.until(|flight| flight.radiating() == [true, true]), "{}", flight.story());
    let said = "emission: 2400 to 2410 MHz, at most 2.000 W, authorised by a test, licensee the testers, licence T-1, \
                site a yard, valid from 2023-11-14T22:13:20Z to 2030-03-17T17:46:40Z";
    for role in Role::BOTH {
        assert!(flight.said(role, said).is_some(), "{}", flight.story());
    }
    let mut simulated = Flight::new(Setup::default());
    assert!(simulated.until(|flight| flight.said(Role::I, "taking off").is_some()));
    assert!(simulated.said(Role::I, "emission: simulated transmitter, no [emission] table").is_some());
}

/// A pause makes the mission longer than it was to be.
#[test]
fn spec_a_permission_that_ends_in_flight_ends_the_emission_with_it() {
    let mut flight = Flight::new(real(Some([ALWAYS[0], after(120)])));
    assert!(
        flight.until(|flight| flight.said(Role::I, "slot 0 for alpha: over").is_some()),
        "{}",
        flight.story()
    );
    flight.command(Role::I, mavlink::dialects::ardupilotmega::MavCmd::MAV_CMD_DO_PAUSE_CONTINUE);
    flight.pass(Duration::from_secs(130).saturating_sub(flight.now));
    flight.command_with(Role::I, mavlink::dialects::ardupilotmega::MavCmd::MAV_CMD_DO_PAUSE_CONTINUE, 1.0);
    let at = flight.now;
    flight.pass(Duration::from_secs(100));
    assert!(flight.log.on_air.iter().all(|(when, on)| *when < at || *on == [false; 2]), "{}", flight.story());
    flight.assert_safe();
}

/// With seconds to spare or without.
#[test]
fn spec_what_a_permission_lets_begin_it_lets_end() {
    let begun = (76..100).map(|seconds| {
        let mut flight = Flight::new(real(Some([ALWAYS[0], after(seconds)])));
        flight.pass(Duration::from_secs(10));
        let begun = flight.said(Role::I, "taking off").is_some();
        if begun {
            flight.fly_out();
            assert!(flight.said(Role::I, "not served").is_none(), "{seconds}\n{}", flight.story());
            assert!(flight.said(Role::I, "not at this time").is_none(), "{seconds}\n{}", flight.story());
        }
        begun
    });
    let begun: Vec<_> = begun.collect();
    assert!(begun.contains(&true) && begun.contains(&false), "{begun:?}");
}
