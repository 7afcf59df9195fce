//! Whole flights whose radios are radio hosts with devices: the chain from the companion's mind to what the device radiates, in
//! virtual time. `examples/radio_faults.rs` flies the same as processes over loopback.

use std::time::Duration;

use veilwing::desk::simulation::{DeviceModel, RadioFault};
use veilwing::mission::Outcome;
use veilwing::role::{PerVehicle, Role};
use veilwing_sitl::Breach;

use crate::harness::*;

fn ms(ms: u64) -> Duration {
    Duration::from_millis(ms)
}

/// A device that takes these milliseconds to be off and to change.
fn device([off, change]: [u64; 2], dead: Option<u64>) -> DeviceModel {
    DeviceModel { off: ms(off), change: ms(change), dead: dead.map(ms), outlives_control: true }
}

fn hosted(setup: Setup, model: DeviceModel) -> Flight {
    let mut flight = Flight::new(Setup { radio_apart: true, ..setup });
    Role::BOTH.into_iter().for_each(|role| flight.host_radio(role, model));
    flight
}

/// In slot 0, both on the air for a second.
fn on_the_air(setup: Setup, model: DeviceModel) -> Flight {
    let mut flight = hosted(setup, model);
    assert!(flight.until(|flight| flight.radiating() == [true, true]), "{}", flight.story());
    flight.pass(ms(1000));
    flight
}

#[test]
fn spec_slots_are_served_and_protected_by_hosts_and_devices_of_every_pace() {
    // An attenuator, programs, JSON over HTTP, a modem, and one that barely fits S4 and the guard.
    for times in [[1, 1], [10, 30], [20, 60], [20, 50], [90, 500]] {
        let mut flight = hosted(Setup::default(), device(times, None));
        flight.fly_out();
        flight.assert_safe();
        for role in Role::BOTH {
            assert_eq!(flight.outcomes[role], Some(Outcome::Completed), "{times:?} {}", flight.story());
            let radiated = flight.hosted(role).unwrap().device().radiated();
            // On and off in each of two slots, by the device's own account.
            assert_eq!(radiated.len(), 4, "{radiated:?}");
            assert!(flight.said(role, "slot 1 for bravo: over").is_some());
        }
        for slot in flight.report().slots {
            assert_eq!(slot.unprotected_s, 0.0);
            assert!(slot.radiated_s.i > 3.0 && slot.radiated_s.j > slot.radiated_s.i, "{times:?} {slot:?}");
        }
    }
}

/// What came of a fault.
struct Came {
    /// From the fault to the device's silence; `None`: not within ten seconds.
    off_after: Option<Duration>,
    unprotected_ms: f64,
    flight: Flight,
}

/// A fault that lasts for `lasts`, in the middle of a slot.
fn befallen(fault: RadioFault, role: Role, model: DeviceModel, lasts: Duration) -> Came {
    let mut flight = on_the_air(Setup::default(), model);
    let began = flight.now;
    flight.befall_radio(fault, role, true);
    flight.pass(lasts);
    flight.befall_radio(fault, role, false);
    flight.pass(ms(10_000).saturating_sub(lasts));
    let off = flight
        .hosted(role)
        .unwrap()
        .device()
        .radiated()
        .iter()
        .find(|(at, dbm)| *at >= began && dbm.is_none());
    let off_after = off.map(|(at, _)| *at - began);
    Came { off_after, unprotected_ms: flight.report().unprotected_s * 1e3, flight }
}

/// What nobody aboard can help is excused by its name; nothing else is broken, but for what an orphan does.
fn assert_only_excused(came: &Came, what: &str) {
    let report = came.flight.report();
    assert_eq!(report.violations, vec![], "{what}: {}", came.flight.story());
}

const FOR_GOOD: Duration = Duration::from_secs(10);
const FOR_A_WHILE: Duration = Duration::from_secs(3);

#[test]
fn spec_a_device_without_its_host_goes_on_for_ever_unless_it_has_a_dead_man_of_its_own() {
    for role in Role::BOTH {
        let orphan = befallen(RadioFault::HostKill, role, device([20, 50], None), FOR_GOOD);
        assert_eq!(orphan.off_after, None, "{}", orphan.flight.story());
        assert_only_excused(&orphan, "orphan");
        let saved = befallen(RadioFault::HostKill, role, device([20, 50], Some(400)), FOR_GOOD);
        assert_eq!(saved.off_after, Some(ms(400)));
        assert_only_excused(&saved, "dead-man");
        // I's lease outlives J's device by what the lease has left: S3's exception, and no more than it.
        let longest = if role == Role::I { 0.0 } else { 120.0 };
        assert!(saved.unprotected_ms <= longest, "{}", saved.flight.story());
        let sooner = befallen(RadioFault::HostKill, role, device([20, 50], Some(100)), FOR_GOOD);
        println!(
            "{role}: unprotected {} ms at 400 ms, {} ms at 100 ms",
            saved.unprotected_ms, sooner.unprotected_ms
        );
        assert_only_excused(&sooner, "quick dead-man");
        match role {
            Role::I => assert_eq!(sooner.unprotected_ms, 0.0),
            Role::J => assert!(sooner.unprotected_ms > 100.0 && sooner.unprotected_ms <= 400.0),
        }
        // A host that goes on finds its lease past, and turns its device off first of all.
        let stopped = befallen(RadioFault::HostStop, role, device([20, 50], None), FOR_A_WHILE);
        let off_after = stopped.off_after.unwrap();
        assert!(off_after >= FOR_A_WHILE && off_after <= FOR_A_WHILE + ms(25), "{off_after:?}");
        assert_only_excused(&stopped, "stopped host");
    }
}

#[test]
fn spec_a_host_that_hears_its_companion_no_more_is_off_by_its_lease() {
    for role in Role::BOTH {
        let cut = befallen(RadioFault::HostLoss, role, device([20, 50], None), FOR_GOOD);
        let off_after = cut.off_after.unwrap();
        assert!(off_after <= LEASE_AND_MARGIN, "{off_after:?}");
        cut.flight.assert_safe();
        assert!(
            cut.flight.said(role, "silent: the radio's clock was last heard").is_some(),
            "{}",
            cut.flight.story()
        );
    }
}

#[test]
fn spec_a_device_that_fails_is_said_by_name_and_its_peer_is_told() {
    for fault in
        [RadioFault::DeviceStop, RadioFault::DeviceLoss, RadioFault::DeviceMute, RadioFault::DeviceKill]
    {
        for role in Role::BOTH {
            let lasts = if fault == RadioFault::DeviceMute { FOR_GOOD } else { FOR_A_WHILE };
            let came = befallen(fault, role, device([20, 50], None), lasts);
            assert_only_excused(&came, &format!("{fault:?}"));
            match (fault, came.off_after) {
                // It radiates on, and nobody can tell it anything.
                (RadioFault::DeviceKill, off_after) => assert_eq!(off_after, None),
                // It does what it is told, at the slot's end at the latest.
                (RadioFault::DeviceMute, off_after) => {
                    assert!(off_after.unwrap() < ms(4500), "{off_after:?}")
                }
                (_, off_after) => {
                    let off_after = off_after.unwrap();
                    let expected = FOR_A_WHILE..FOR_A_WHILE + ms(500);
                    assert!(expected.contains(&off_after), "{fault:?} {off_after:?}");
                }
            }
            // What was not confirmed off is told of before anything else is agreed on.
            let next = "transmitter cannot serve slot 1: the radio's device";
            let told = came.flight.said(role, next).is_some();
            let unconfirmed = matches!(fault, RadioFault::DeviceKill | RadioFault::DeviceMute);
            assert!(told || !unconfirmed, "{fault:?}: {}", came.flight.story());
        }
    }
}

/// While it was off: when it is to radiate, it does not.
#[test]
fn spec_a_slot_that_a_device_does_not_serve_is_not_served_for_that_reason() {
    for (fault, words) in [
        (RadioFault::DeviceStop, "the radio's device is late"),
        (RadioFault::DeviceKill, "the radio's device cannot be reached, refuses, or is not understood"),
    ] {
        for role in Role::BOTH {
            let mut flight = hosted(Setup::default(), device([20, 50], None));
            assert!(flight.until(|flight| flight.said(role, "slot 0 for alpha: agreed").is_some()));
            flight.befall_radio(fault, role, true);
            assert!(
                flight.until(|flight| flight.said(role, "slot 0 for alpha: not served").is_some()),
                "{}",
                flight.story()
            );
            assert!(flight.said(role, &format!("slot 0: off: {words}")).is_some(), "{}", flight.story());
            assert!(
                flight.said(role, &format!("slot 0 for alpha: not served: {words}")).is_some(),
                "{}",
                flight.story()
            );
            let peer = role.peer();
            if role == Role::J {
                let told = flight.said(peer, "vehicle J fell silent: its transmitter does not answer");
                assert!(told.is_some(), "{}", flight.story());
            }
            let report = flight.report();
            assert!(
                !report.violations.iter().any(|v| matches!(v.breach, Breach::Unprotected)),
                "{}",
                flight.story()
            );
            assert_eq!(report.slots[0].radiated_s.i, 0.0, "{}", flight.story());
            // The next one is not agreed on either, and that is said with the same reason.
            let next = format!("transmitter cannot serve slot 1: {words}");
            assert!(flight.until(|flight| flight.said(role, &next).is_some()), "{}", flight.story());
        }
    }
}

/// Something real, with leave.
fn real(accept_orphaned_radio: bool) -> Setup {
    let permitted = yard().under(|draft| {
        draft.emission = Some(veilwing::config::Emission {
            authorised_by: "a test".to_owned(),
            band_hz: [2.4e9, 2.41e9],
            max_power_w: 2.0,
            valid: Some(crate::emission::ALWAYS),
            ..Default::default()
        });
    });
    let given = PerVehicle { i: permitted.clone(), j: permitted };
    Setup { given, simulated: false, accept_orphaned_radio, ..Setup::default() }
}

#[test]
fn spec_a_real_device_that_outlives_its_host_is_refused_by_name_unless_that_is_accepted() {
    let words = "TX_DEAD_MS: never by itself, should be at most 500 ms";
    let mut refused = hosted(real(false), device([20, 50], None));
    refused.pass(Duration::from_secs(20));
    assert!(refused.said(Role::I, words).is_some() && refused.log.on_air.is_empty(), "{}", refused.story());
    for (accepts, dead) in [(true, None), (false, Some(400))] {
        let mut flight = hosted(real(accepts), device([20, 50], dead));
        assert!(flight.until(|flight| flight.radiating() == [true, true]), "{}", flight.story());
        assert_eq!(flight.said(Role::I, words).is_some(), accepts);
    }
}
