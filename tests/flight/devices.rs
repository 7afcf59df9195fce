//! Radios that take their time, or cannot do what the flight asks of them, and say so.

use std::time::Duration;

use veilwing::config::Emission;
use veilwing::mission::Outcome;
use veilwing::role::{PerVehicle, Role};
use veilwing_sitl::RadioDevice;

use crate::harness::*;

const GOOD: fn() -> RadioDevice = RadioDevice::default;

fn with(device: RadioDevice) -> Setup {
    Setup { devices: PerVehicle { i: device, j: device }, ..Setup::default() }
}

/// The flight as it should go, whatever the devices take: served, never unprotected. The least time that I was on the air.
fn served(setup: Setup) -> f64 {
    let mut flight = Flight::new(setup);
    flight.fly_out();
    flight.assert_safe();
    for role in Role::BOTH {
        assert_eq!(flight.outcomes[role], Some(Outcome::Completed), "{}", flight.story());
    }
    let slots = flight.report().slots;
    for slot in &slots {
        assert_eq!((slot.unprotected_s, slot.jam_out_of_tolerance_s), (0.0, 0.0), "{}", flight.story());
        println!("{}: I {:.3} s, J {:.3} s", slot.user, slot.radiated_s.i, slot.radiated_s.j);
    }
    slots.iter().map(|slot| slot.radiated_s.i).fold(f64::INFINITY, f64::min)
}

/// Refused on the ground, with these words.
fn refused(setup: Setup, words: &str) {
    let mut flight = Flight::new(setup);
    flight.pass(Duration::from_secs(20));
    for role in Role::BOTH {
        assert!(flight.landed(role) && flight.log.setpoints[role].is_empty(), "{}", flight.story());
        assert!(flight.said(role, words).is_some(), "{words}\n{}", flight.story());
    }
    assert!(flight.log.on_air.is_empty());
}

#[test]
fn spec_what_a_guard_contains_costs_time_on_the_air_and_never_protection() {
    let prompt = served(Setup::default());
    for read_back in [true, false] {
        // Of a guard of 0.6 s: J 0.2 s beyond its half of it, I 0.5 s.
        let slow = served(with(RadioDevice { off_s: 0.08, change_s: 0.5, read_back, ..GOOD() }));
        assert!(slow > prompt - 0.9 && slow < prompt - 0.5, "{slow} of {prompt} s");
    }
}

#[test]
fn spec_a_radio_that_takes_three_seconds_is_refused_or_contained_by_a_guard_that_long() {
    for read_back in [true, false] {
        let device = RadioDevice { change_s: 3.0, read_back, ..GOOD() };
        refused(with(device), "TX_CHANGE_MS: 3000 ms, should be 0 to 600, the guard (tdma.guard_s)");
        let long = yard().under(|draft| (draft.tdma.slot_s, draft.tdma.guard_s) = (12.0, 4.0));
        let given = PerVehicle { i: long.clone(), j: long };
        let on_s = served(Setup { given, ..with(device) });
        // Of 8 s of airtime J misses one, and I three more.
        assert!(on_s > 3.5 && on_s < 4.1, "{on_s}");
    }
}

#[test]
fn spec_what_cannot_be_contained_is_refused_by_name() {
    for (device, words) in [
        (RadioDevice { off_s: 0.15, ..GOOD() }, "TX_OFF_MS: 150 ms, should be 0 to 100"),
        (RadioDevice { least_dbm: 28.0, ..GOOD() }, ", the radio's least: it would be off in that slot"),
    ] {
        refused(with(device), words);
    }
}

/// Something real, with leave.
fn real(device: RadioDevice) -> Setup {
    let permitted = yard().under(|draft| {
        draft.emission = Some(Emission {
            authorised_by: "a test".to_owned(),
            band_hz: [2.4e9, 2.41e9],
            // A ceiling above the radio's own.
            max_power_w: 2.0,
            valid: Some(crate::emission::ALWAYS),
            ..Emission::default()
        });
    });
    Setup { given: PerVehicle { i: permitted.clone(), j: permitted }, simulated: false, ..with(device) }
}

#[test]
fn spec_what_is_real_stays_within_the_permission_and_does_not_outlive_its_host() {
    let inside = RadioDevice { band_khz: Some([2_401_000.0, 2_409_000.0]), ..GOOD() };
    assert!(served(real(inside)) > 2.5);
    for (device, words) in [
        (
            RadioDevice { band_khz: Some([2_401_000.0, 2_411_000.0]), ..GOOD() },
            "TX_BAND: 2401000 to 2411000 kHz, should be",
        ),
        (RadioDevice { dead_s: None, ..inside }, "TX_DEAD_MS: never by itself, should be at most 500 ms"),
    ] {
        refused(real(device), words);
    }
    // What is simulated is told of it, and flies.
    let mut flight = Flight::new(with(RadioDevice { dead_s: None, read_back: false, ..GOOD() }));
    assert!(flight.until(|flight| flight.radiating() == [true, true]), "{}", flight.story());
    for words in ["preflight warning: TX_DEAD_MS", "preflight warning: TX_READ_BACK"] {
        assert!(flight.said(Role::I, words).is_some(), "{}", flight.story());
    }
}

#[test]
fn spec_a_radio_that_declares_nothing_flies_as_ever_and_is_told_of_where_it_is_real() {
    let mute = RadioDevice { declares: false, ..GOOD() };
    assert!(served(with(mute)) > 2.5);
    let mut flight = Flight::new(real(mute));
    assert!(flight.until(|flight| flight.radiating() == [true, true]), "{}", flight.story());
    assert!(flight.said(Role::J, "transmitter facts: the radio does not declare TX_MIN_DBM").is_some());
}
