//! What excuses time without protection, by name and for how long, and what excuses nothing.

use crate::common::*;
use mavlink::dialects::ardupilotmega::{COMMAND_LONG_DATA, MavCmd, MavMessage};
use veilwing_sitl::*;

#[test]
fn spec_an_operators_radio_kill_excuses_nothing() {
    let mut flight = on_station(config());
    let mut station = Client::ground_station(1, 1);
    let kill = MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
        command: MavCmd::MAV_CMD_USER_2,
        target_system: 2,
        target_component: 191,
        ..COMMAND_LONG_DATA::DEFAULT
    });
    flight.hold(0, 500, [false, true]);
    flight.hold(0, 500, [true, true]);
    station.send(&mut flight.world, &kill);
    flight.off(1);
    flight.pass(10);
    flight.off(0);
    flight.pass(20);
    assert_eq!(names(&flight), ["S1", "S3"]);
    assert_eq!(unprotected_ms(&flight), (10, vec![], 10));
}

#[test]
fn spec_faults_of_companions_and_links_excuse_no_unprotected_time() {
    let faults: [&dyn Fn(&mut World); 5] = [
        &|world| world.inject(Fault::CompanionLost { vehicle: 1 }),
        &|world| world.inject(Fault::LinkLoss { vehicle: 1, on: true }),
        &|world| world.inject(Fault::LinkDegraded { vehicle: 0, loss: 0.3, delay_s: 0.0 }),
        &|world| world.inject(Fault::ClockJump { vehicle: 1, by_s: 3600.0 }),
        &|world| {
            let cut = Circumstances { from_peer: Passage::Cut, ..Circumstances::default() };
            world.set_circumstances(0, cut);
        },
    ];
    for inject in faults {
        let mut flight = on_the_air();
        inject(&mut flight.world);
        // J's last command runs out 280 ms later; I goes on.
        alone(&mut flight, 400);
        let names = names(&flight);
        assert!(names.starts_with(&["S1", "S3"]), "{names:?}");
        assert_eq!(unprotected_ms(&flight), (120, vec![], 120));
    }
}

#[test]
fn spec_a_jammer_whose_vehicle_fails_is_excused_for_the_rest_of_the_lease_and_no_longer() {
    // The jammer falls silent 60 ms after the failure; a lease of I's may run for 500 ms from then on.
    for (i_goes_on_ms, excused_ms, counted_ms) in [(20, 20, 0), (500, 500, 0), (700, 500, 200)] {
        let mut flight = on_the_air();
        flight.world.inject(Fault::AutopilotRestart { vehicle: 1 });
        alone(&mut flight, 60);
        flight.off(1);
        alone(&mut flight, i_goes_on_ms);
        flight.off(0);
        flight.pass(20);
        let excused = vec![("jammer-failed", excused_ms)];
        assert_eq!(unprotected_ms(&flight), (i_goes_on_ms.into(), excused, counted_ms));
        let broken: Vec<_> = names(&flight).into_iter().filter(|name| *name != "S4").collect();
        assert_eq!(broken, if counted_ms > 0 { vec!["S1"] } else { vec![] });
    }
}

#[test]
fn spec_a_failure_long_past_and_a_failure_of_i_excuse_nothing() {
    for (vehicle, before_ms) in [(1, 2000), (0, 0)] {
        let mut flight = on_station(config());
        flight.world.inject(Fault::RotorLoss { vehicle, rotor: 99 });
        flight.hold(0, before_ms, [false, false]);
        flight.hold(0, 500, [false, true]);
        flight.hold(0, 500, [true, true]);
        if vehicle == 0 {
            flight.world.inject(Fault::RotorLoss { vehicle, rotor: 99 });
        }
        flight.off(1);
        alone(&mut flight, 100);
        flight.off(0);
        assert_eq!(unprotected_ms(&flight), (100, vec![], 100));
        assert!(names(&flight).contains(&"S3"));
    }
}

#[test]
fn spec_a_jammer_torn_out_of_its_pose_is_excused_while_it_reacts() {
    let mut flight = on_the_air();
    // Two metres by its own estimator, which is what the best mind aboard has to go by.
    flight.world.inject(Fault::EstimatorReset { vehicle: 1, jump_enu_m: [2.0, 0.0, 0.0] });
    let dbm = flight.planned_dbm(0, 1);
    flight.clients[1].power(&mut flight.world, dbm, 0, 100);
    alone(&mut flight, 300);
    flight.off(0);
    flight.pass(20);
    let (all, excused, counted) = unprotected_ms(&flight);
    assert!(all > 290 && all <= 300 && counted == 0, "{all} {excused:?}");
    assert_eq!(excused, [("jammer-failed", all)]);
    let report = flight.world.report();
    assert_eq!(report.emitted_out_of_pose_s.i, 0.0);
    assert!((report.emitted_out_of_pose_s.j - 0.1).abs() < 0.006, "{report:?}");
}

#[test]
fn spec_a_radio_without_expiry_is_excused_by_name() {
    let mut endless = config();
    endless.vehicles[0].radio_expires = false;
    let mut flight = on_station(endless);
    flight.hold(0, 500, [false, true]);
    flight.hold(0, 500, [true, true]);
    // I's companion says no more: its radio would be off 280 ms later. J stays until then.
    flight.hold(0, 300, [false, true]);
    flight.off(1);
    flight.pass(1000);
    assert_eq!(unprotected_ms(&flight), (1000, vec![("radio-without-expiry", 1000)], 0));
    let report = flight.world.report();
    assert_eq!(report.violations, vec![]);
    assert!(report.excused.iter().all(|excused| excused.cause == Cause::RadioWithoutExpiry), "{report:#?}");
}

/// I holds its slot and renews its power, while nobody is left to tell J anything.
fn alone(flight: &mut Flight, ms: u64) {
    let (goals, dbm) = (flight.goals(0), flight.planned_dbm(0, 0));
    for _ in 0..ms / 20 {
        flight.target(0, goals[0], Some(0));
        flight.clients[0].power(&mut flight.world, dbm, 0, 300);
        flight.pass(20);
    }
}

/// Both devices set from outside, off.
fn devices() -> Flight {
    let mut flight = on_station(config());
    (0..2).for_each(|v| flight.world.set_device_power(v, DevicePower::default()));
    flight
}

/// A vehicle's device at its planned power.
fn device_on(flight: &mut Flight, vehicle: usize, astray: bool) {
    let dbm = Some(flight.planned_dbm(0, vehicle));
    flight.world.set_device_power(vehicle, DevicePower { dbm, slot: Some(0), astray });
}

#[test]
fn spec_a_device_is_judged_by_what_it_does_and_not_by_what_the_radio_was_told() {
    let mut flight = devices();
    // What the vehicles' own radios are told radiates nothing, and protects nobody.
    flight.hold(0, 300, [true, true]);
    assert!(flight.world.snapshot().vehicles.iter().all(|v| v.tx_power_w.is_none()));
    device_on(&mut flight, 1, false);
    flight.hold(0, 300, [false, false]);
    device_on(&mut flight, 0, false);
    // Far longer than any lease: nobody here knows what it was told.
    flight.hold(0, 2000, [false, false]);
    assert_eq!(flight.invariants(), vec![]);
    assert_eq!(flight.world.report().slots[0].radiated_s.i, 2.0);
    assert_eq!(flight.world.snapshot().vehicles[0].slot, Some(0));
    flight.world.set_device_power(1, DevicePower::default());
    flight.hold(0, 100, [true, true]);
    assert_eq!(names(&flight), ["S1", "S3"]);
    assert_eq!(unprotected_ms(&flight), (100, vec![], 100));
}

#[test]
fn spec_a_device_gone_astray_is_excused_by_name_and_one_in_no_slot_is_not() {
    let mut flight = devices();
    device_on(&mut flight, 0, true);
    flight.hold(0, 200, [false, false]);
    assert_eq!(unprotected_ms(&flight), (200, vec![("radio-out-of-order", 200)], 0));
    let mut flight = devices();
    let dbm = Some(flight.planned_dbm(0, 1));
    flight.world.set_device_power(1, DevicePower { dbm, slot: None, astray: false });
    flight.hold(0, 200, [false, false]);
    assert_eq!(names(&flight), ["S2"], "{:?}", flight.invariants());
}

#[test]
fn spec_a_radio_of_js_that_fails_is_excused_for_the_rest_of_the_lease() {
    let mut flight = devices();
    device_on(&mut flight, 1, false);
    device_on(&mut flight, 0, false);
    flight.hold(0, 500, [false, false]);
    flight.world.inject(Fault::RadioFails { vehicle: 1 });
    flight.world.set_device_power(1, DevicePower::default());
    flight.hold(0, 700, [false, false]);
    let (all, excused, counted) = unprotected_ms(&flight);
    assert_eq!((all, excused), (700, vec![("jammer-failed", 500)]));
    assert_eq!(counted, 200);
    assert!(names(&flight).contains(&"S4"), "J's companion could have known");
    // One whose host is gone says nothing any more: what nobody could hear of, I need not follow within S4's time.
    let mut flight = devices();
    device_on(&mut flight, 1, false);
    device_on(&mut flight, 0, false);
    flight.hold(0, 500, [false, false]);
    flight.world.inject(Fault::RadioFails { vehicle: 1 });
    flight.world.set_device_power(1, DevicePower { astray: true, ..DevicePower::default() });
    flight.hold(0, 400, [false, false]);
    assert_eq!(flight.invariants(), vec![]);
    assert_eq!(unprotected_ms(&flight), (400, vec![("jammer-failed", 400)], 0));
}

#[test]
fn spec_a_radio_out_of_order_excuses_nothing_that_it_was_told() {
    let mut flight = on_the_air();
    flight.world.inject(Fault::TransmitterStuck { vehicle: 0 });
    // I's companion goes on commanding what the radio does in any case, and J is off.
    flight.off(1);
    alone(&mut flight, 200);
    assert_eq!(names(&flight), ["S1", "S3", "S4"]);
    assert_eq!(unprotected_ms(&flight), (200, vec![], 200));
}
