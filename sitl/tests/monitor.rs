//! Each invariant broken on purpose, and seen from outside.

mod common;

use common::*;
use mavlink::dialects::ardupilotmega::{COMMAND_LONG_DATA, MavCmd, MavMessage};
use veilwing_sitl::*;

/// Both on station, nobody on the air.
fn on_station(config: WorldConfig) -> Flight {
    let mut flight = Flight::new(config);
    flight.take_off();
    flight.go_to_slot(0);
    assert_eq!(flight.invariants(), vec![]);
    flight
}

fn names(flight: &Flight) -> Vec<&'static str> {
    let mut names: Vec<_> = flight.invariants().into_iter().map(|(name, _)| name).collect();
    names.sort_unstable();
    names
}

#[test]
fn spec_i_before_j_breaks_s3_and_s1_once() {
    let mut flight = on_station(config());
    flight.hold(0, 1000, [true, false]);
    flight.hold(0, 1000, [true, true]);
    assert_eq!(names(&flight), ["S1", "S3"]);
    let report = flight.world.report();
    assert!((report.slots[0].unprotected_s - 1.0).abs() < 0.011, "{report:?}");
    // A second occurrence is a second violation.
    flight.off(0);
    flight.off(1);
    flight.hold(0, 500, [false, false]);
    flight.hold(0, 100, [true, false]);
    assert_eq!(names(&flight), ["S1", "S1", "S3", "S3"]);
}

#[test]
fn spec_an_operators_radio_kill_excuses_the_jammer() {
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
    assert_eq!(names(&flight), Vec::<&str>::new());
}

#[test]
fn spec_j_off_before_i_breaks_s3() {
    let mut flight = on_station(config());
    flight.hold(0, 500, [false, true]);
    flight.hold(0, 500, [true, true]);
    flight.off(1);
    flight.off(0);
    flight.pass(20);
    assert_eq!(names(&flight), ["S1", "S3"]);
    // Not a single radio sample fell between the two, and yet the order was seen.
    assert_eq!(flight.world.report().slots[0].unprotected_s, 0.0);
}

#[test]
fn spec_a_fault_excuses_the_order_but_not_beyond_the_lease() {
    let mut flight = on_station(config());
    flight.hold(0, 500, [false, true]);
    flight.hold(0, 500, [true, true]);
    flight.world.inject(Fault::CompanionLost { vehicle: 1 });
    // J's companion is dead: its transmitter's lease of 300 ms runs out; I goes on for 200 ms and stops.
    alone(&mut flight, 500);
    flight.off(0);
    flight.pass(100);
    assert_eq!(names(&flight), Vec::<&str>::new());
    let unprotected = flight.world.report().slots[0].unprotected_s;
    assert!(unprotected > 0.15 && unprotected < 0.25, "{unprotected}");

    let mut late = on_station(config());
    late.hold(0, 500, [false, true]);
    late.hold(0, 500, [true, true]);
    late.world.inject(Fault::CompanionLost { vehicle: 1 });
    alone(&mut late, 1500);
    // It hears J no more either.
    assert_eq!(names(&late), ["S1", "S4"]);
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

#[test]
fn spec_out_of_pose_breaks_s1_and_s2() {
    for (vehicle, expected) in [(0, "S1"), (1, "S2")] {
        let mut flight = on_station(config());
        flight.hold(0, 500, [false, true]);
        flight.hold(0, 500, [true, true]);
        // Two metres aside, still on the air.
        let mut goals = flight.goals(0);
        goals[vehicle][0] += 2.0;
        let dbm = [flight.planned_dbm(0, 0), flight.planned_dbm(0, 1)];
        flight.stream(3000, goals, Some(0), |f| {
            for k in [1, 0] {
                f.clients[k].power(&mut f.world, dbm[k], 0, 300);
            }
        });
        assert_eq!(names(&flight), [expected]);
        let slot = &flight.world.report().slots[0];
        let (jam, bare) = (slot.jam_out_of_tolerance_s, slot.unprotected_s);
        if vehicle == 1 {
            assert!(jam > 1.5 && (jam - bare).abs() < 0.01, "{slot:?}");
        } else {
            assert_eq!((jam, bare), (0.0, 0.0));
        }
    }
}

#[test]
fn spec_a_wrong_attitude_is_out_of_pose_at_once() {
    let mut flight = on_station(config());
    let goals = flight.goals(0);
    flight.stream(4000, goals, None, |_| {});
    // The attitude target is a second old: levelled, 60 degrees from the plan.
    let dbm = [flight.planned_dbm(0, 0), flight.planned_dbm(0, 1)];
    flight.clients[1].power(&mut flight.world, dbm[1], 0, 300);
    flight.clients[0].power(&mut flight.world, dbm[0], 0, 300);
    assert_eq!(names(&flight), ["S1"]);
    assert!(flight.invariants()[0].1.contains("deg off"), "{:?}", flight.invariants());
}

#[test]
fn spec_radiating_in_no_slot_breaks_s1_and_s2() {
    let mut flight = on_station(config());
    flight.clients[1].power(&mut flight.world, 10.0, 9, 100);
    flight.clients[0].power(&mut flight.world, 10.0, -1, 100);
    flight.pass(200);
    assert_eq!(names(&flight), ["S1", "S2"]);
    let outside = flight.world.report().outside_slots_s;
    assert!((outside.i - 0.1).abs() < 0.006 && (outside.j - 0.1).abs() < 0.006, "{outside:?}");
}

#[test]
fn spec_too_much_power_breaks_s6() {
    let mut flight = on_station(config());
    let dbm = flight.planned_dbm(0, 1);
    flight.clients[1].power(&mut flight.world, dbm + 0.004, 0, 100);
    assert_eq!(names(&flight), Vec::<&str>::new());
    flight.clients[1].power(&mut flight.world, dbm + 0.05, 0, 100);
    assert_eq!(names(&flight), ["S6"]);
}

#[test]
fn spec_a_weak_jammer_leaves_i_unprotected() {
    let mut flight = on_station(config());
    let (goals, dbm) = (flight.goals(0), [flight.planned_dbm(0, 0), flight.planned_dbm(0, 1)]);
    flight.stream(1000, goals, Some(0), |f| {
        f.clients[1].power(&mut f.world, dbm[1] - 0.1, 0, 300);
        f.clients[0].power(&mut f.world, dbm[0], 0, 300);
    });
    let unprotected = flight.world.report().slots[0].unprotected_s;
    assert!((unprotected - 1.0).abs() < 0.01, "{unprotected}");
}

#[test]
fn spec_too_near_breaks_f1_and_is_measured() {
    let mut flight = on_station(config());
    let mut goals = flight.goals(0);
    goals[1] = [goals[0][0] + 4.0, goals[0][1], goals[0][2]];
    flight.stream(15_000, goals, None, |_| {});
    assert_eq!(names(&flight), ["F1"]);
    let least = flight.world.report().min_separation_m.unwrap();
    assert!(least > 3.5 && least < 4.05, "{least}");
}

#[test]
fn spec_fence_and_band_break_f1() {
    let mut tight = config();
    tight.airspace.area_enu_m = vec![[-100.0, -100.0], [100.0, -100.0], [100.0, 100.0], [-100.0, 100.0]];
    tight.airspace.altitude_m = [20.0, 60.0];
    for (goal, word) in
        [([-110.0, 15.0, 30.0], "geofence"), ([-20.0, 15.0, 70.0], "band"), ([-60.0, 15.0, 8.0], "band")]
    {
        let mut flight = on_station(tight.clone());
        let goals = [goal, flight.goals(0)[1]];
        flight.stream(20_000, goals, None, |_| {});
        let broken = flight.invariants();
        assert!(matches!(&broken[..], [("F1", detail)] if detail.contains(word)), "{broken:?}");
    }
}

#[test]
fn spec_the_pilot_may_leave_the_band() {
    let mut tight = config();
    tight.airspace.altitude_m = [60.0, 90.0];
    tight.slots[0].poses[0].position_enu_m[2] = 65.0;
    tight.slots[0].poses[1].position_enu_m[2] = 65.0;
    let mut flight = Flight::new(tight);
    flight.take_off();
    // On the way up over home the band's floor does not bind.
    let mut goals = [flight.position(0), flight.position(1)];
    goals.iter_mut().for_each(|g| g[2] = 65.0);
    flight.stream(15_000, goals, None, |_| {});
    flight.go_to_slot(0);
    assert_eq!(flight.invariants(), vec![]);
    flight.clients[0].command(&mut flight.world, MavCmd::MAV_CMD_NAV_LAND, &[]);
    flight.pass(60_000);
    assert!(flight.world.snapshot().vehicles[0].landed);
    assert_eq!(flight.invariants(), vec![]);
}

#[test]
fn spec_a_stuck_transmitter_is_seen() {
    let mut flight = on_station(config());
    flight.hold(0, 500, [false, true]);
    flight.hold(0, 500, [true, true]);
    flight.world.inject(Fault::TransmitterStuck { vehicle: 0 });
    flight.off(0);
    flight.off(1);
    flight.hold(0, 1000, [false, false]);
    // J says that it is off, and I goes on.
    assert_eq!(names(&flight), ["S1", "S4"]);
}

#[test]
fn spec_a_plan_without_jammer_needs_none() {
    let mut silent = config();
    silent.slots[0].poses[1].tx_power_w = 0.0;
    let mut flight = on_station(silent);
    flight.hold(0, 1000, [true, false]);
    assert_eq!(names(&flight), Vec::<&str>::new());
    assert_eq!(flight.world.report().slots[0].unprotected_s, 0.0);
}

#[test]
fn spec_a_bad_configuration_names_what_is_wrong() {
    let broken = |change: fn(&mut WorldConfig)| {
        let mut config = config();
        change(&mut config);
        World::new(config).map(|_| ()).unwrap_err().to_string()
    };
    assert!(broken(|c| c.radio.noise_power_w = 0.0).contains("noise_power_w is 0"));
    assert!(broken(|c| c.slots[0].user = "nobody".into()).contains("nobody"));
    assert!(broken(|c| c.vehicles[1].system_id = 1).contains("system id 1"));
    assert!(broken(|c| c.slots[0].poses[1].roll_rad = f64::NAN).contains("slot 0"));
    assert!(broken(|c| c.vehicles[0].body.mass_kg = -1.0).contains("mass_kg"));
    assert!(broken(|c| c.vehicles.swap(0, 1)).contains("in this order"));
}
