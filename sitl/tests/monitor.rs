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
    assert_eq!(report.slots[0].unprotected_s, 1.0, "{report:?}");
    assert_eq!(report.violations.iter().map(|v| v.lasted.as_millis()).collect::<Vec<_>>(), [1000; 2]);
    // A second occurrence is a second violation.
    flight.off(0);
    flight.off(1);
    flight.hold(0, 500, [false, false]);
    flight.hold(0, 100, [true, false]);
    assert_eq!(names(&flight), ["S1", "S1", "S3", "S3"]);
}

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
fn spec_j_off_before_i_breaks_s3() {
    let mut flight = on_station(config());
    flight.hold(0, 500, [false, true]);
    flight.hold(0, 500, [true, true]);
    flight.off(1);
    flight.off(0);
    flight.pass(20);
    // No time passed between the two, and yet the order was seen.
    assert_eq!(names(&flight), ["S3"]);
    assert_eq!(unprotected_ms(&flight), (0, vec![], 0));
}

/// Milliseconds: unprotected in all; excused, by cause; of violations of S1's jam.
fn unprotected_ms(flight: &Flight) -> (u128, Vec<(&'static str, u128)>, u128) {
    let report = flight.world.report();
    let of = |violation: &Violation| matches!(violation.breach, Breach::Unprotected);
    let excused = report.excused.iter().filter(|excused| of(&excused.violation));
    let counted = report.violations.iter().filter(|violation| of(violation));
    (
        (report.unprotected_s * 1000.0).round() as u128,
        excused.map(|excused| (excused.cause.name(), excused.duration().as_millis())).collect(),
        counted.map(|violation| violation.lasted.as_millis()).sum(),
    )
}

/// Both on the air in the slot.
fn on_the_air() -> Flight {
    let mut flight = on_station(config());
    flight.hold(0, 500, [false, true]);
    flight.hold(0, 500, [true, true]);
    flight
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
fn spec_out_of_pose_breaks_s1_and_s2() {
    // Nor is I protected by a jammer out of its pose.
    for (vehicle, expected) in [(0, &["S1"][..]), (1, &["S1", "S2"])] {
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
        assert_eq!(names(&flight), expected);
        let slot = &flight.world.report().slots[0];
        let (jam, bare) = (slot.jam_out_of_tolerance_s, slot.unprotected_s);
        if vehicle == 1 {
            assert!(jam > 1.5 && (jam - bare).abs() < 0.01, "{slot:?}");
        } else {
            assert_eq!((jam, bare), (0.0, 0.0));
        }
    }
}

/// A motion has just begun two metres aside of where both are: J may still be on the one before, where that is told, I not.
#[test]
fn spec_j_need_not_have_taken_up_a_motion_that_has_just_begun() {
    let aside = |mut pose: PlannedPose| {
        pose.position_enu_m[0] += 2.0;
        pose
    };
    for (begun, told_before, expected) in [
        ([false, true], true, &[][..]),
        ([false, true], false, &["S1", "S2"]),
        ([true, false], true, &["S1"]),
    ] {
        let mut flight = on_station(config());
        let poses = config().slots[0].poses;
        let newest = [0, 1].map(|k: usize| if begun[k] { aside(poses[k]) } else { poses[k] });
        let flown = Flown {
            poses: newest,
            j_behind: if told_before { poses[1] } else { newest[1] },
            most_w: poses.map(|pose| pose.tx_power_w),
        };
        let (goals, dbm) = (flight.goals(0), [0, 1].map(|k| flight.planned_dbm(0, k)));
        flight.stream(2000, goals, Some(0), |f| {
            f.world.follow(0, flown);
            for k in [1, 0] {
                f.clients[k].power(&mut f.world, dbm[k], 0, 300);
            }
        });
        assert_eq!(names(&flight), expected, "{begun:?} {told_before}");
    }
}

#[test]
fn spec_off_that_the_hop_to_the_radio_holds_up_may_come_with_the_expiry_and_no_later() {
    let late = Manners { delay_s: 0.1, spread_s: 0.06, ..Manners::default() };
    // On a good hop off arrives at once, so what outlasts it was not ended; on a troubled one it need not arrive.
    for (manners, ends, expected) in
        [(Manners::default(), true, &["S2"][..]), (late, true, &[]), (late, false, &["S2"])]
    {
        let mut flight = on_station(config());
        flight.hold(0, 500, [false, true]);
        flight.world.inject(Fault::RadioHop { vehicle: 1, toward: Toward::Radio, manners });
        let mut goals = flight.goals(0);
        goals[1][0] += 2.0;
        let dbm = flight.planned_dbm(0, 1);
        flight.stream(3000, goals, Some(0), |f| {
            if !ends || f.world.report().emitted_out_of_pose_s.j < 0.1 {
                f.clients[1].power(&mut f.world, dbm, 0, 300);
            }
        });
        assert_eq!(names(&flight), expected, "{manners:?}, ends: {ends}");
        assert!(flight.world.report().emitted_out_of_pose_s.j > 0.35);
    }
}

#[test]
fn regress_a_command_that_is_under_way_while_the_hop_recovers_is_late_all_the_same() {
    for (ends, expected) in [(true, &[][..]), (false, &["S2"])] {
        let mut slots = config();
        slots.slots = vec![slots.slots[0].clone(); 3];
        let mut flight = on_station(slots);
        let hop = |flight: &mut Flight, delay_s| {
            let manners = Manners { delay_s, ..Manners::default() };
            flight.world.inject(Fault::RadioHop { vehicle: 1, toward: Toward::Radio, manners });
        };
        let (mut goals, dbm) = (flight.goals(2), flight.planned_dbm(2, 1) as f32);
        let mut number = 1;
        flight.clients[1].numbered(&mut flight.world, f32::NEG_INFINITY, number, 0);
        hop(&mut flight, 0.3);
        // On; torn out of its pose; told off as soon as it is; and the hop is well again before any of these offs has arrived.
        let out_s = |flight: &Flight| flight.world.report().emitted_out_of_pose_s.j;
        for (ms, recovers) in [(1000, false), (3000, true)] {
            flight.stream(ms, goals, Some(2), |f| {
                number += 1;
                let on = out_s(f) == 0.0 || !ends;
                f.clients[1].numbered(&mut f.world, if on { dbm } else { f32::NEG_INFINITY }, number, 450);
                if recovers && out_s(f) > 0.2 {
                    hop(f, 0.0);
                }
            });
            goals[1][0] += 3.0;
        }
        assert_eq!(names(&flight), expected);
        assert!(out_s(&flight) > 0.2, "{}", out_s(&flight));
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
    // I, which nobody jams for, twice.
    assert_eq!(names(&flight), ["S1", "S1", "S2"]);
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

/// Three metres inside the fence, and by its estimate six metres outside, until it is back where it is to be by that.
#[test]
fn regress_a_jump_of_the_estimate_leads_nobody_out_of_the_fence() {
    let mut tight = config();
    tight.airspace.area_enu_m = vec![[-100.0, -100.0], [100.0, -100.0], [100.0, 100.0], [-100.0, 100.0]];
    let mut flight = on_station(tight);
    let goals = [[-97.0, 15.0, 30.0], flight.goals(0)[1]];
    flight.stream(20_000, goals, None, |_| {});
    flight.world.inject(Fault::EstimatorReset { vehicle: 0, jump_enu_m: [-9.0, 0.0, 0.0] });
    flight.stream(10_000, goals, None, |_| {});
    assert!(flight.position(0)[0] > -90.0, "{:?}", flight.position(0));
    assert_eq!(flight.invariants(), vec![]);
    // Who then goes out by what it knows, and in truth, is out.
    flight.stream(20_000, [[-120.0, 15.0, 30.0], goals[1]], None, |_| {});
    assert_eq!(names(&flight), ["F1"]);
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
    assert_eq!(names(&flight), Vec::<&str>::new());
    assert_eq!(unprotected_ms(&flight), (1000, vec![("radio-out-of-order", 1000)], 0));
    let mut excused: Vec<_> =
        flight.world.report().excused.iter().map(|e| (e.violation.invariant().name(), e.cause)).collect();
    excused.sort_unstable();
    assert_eq!(excused, ["S1", "S3", "S4"].map(|name| (name, Cause::RadioOutOfOrder)));
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

#[test]
fn spec_a_vehicle_inside_a_no_fly_area_breaks_f1_and_over_it_under_it_and_beside_it_does_not() {
    // I's pose is at (-20, 15, 30).
    let square =
        |e: f64, n: f64| vec![[e - 5.0, n - 5.0], [e + 5.0, n - 5.0], [e + 5.0, n + 5.0], [e - 5.0, n + 5.0]];
    let flown = |corners: Vec<[f64; 2]>, floor_m, ceiling_m| {
        let mut config = config();
        config.airspace.no_fly = vec![
            NoFlyConfig {
                name: "far away".into(),
                area_enu_m: square(400.0, 0.0),
                floor_m: None,
                ceiling_m: None,
            },
            NoFlyConfig { name: "planted".into(), area_enu_m: corners, floor_m, ceiling_m },
        ];
        let mut flight = Flight::new(config);
        flight.take_off();
        flight.go_to_slot(0);
        flight.invariants()
    };
    for (floor_m, ceiling_m) in [
        (None, None),
        (Some(20.0), Some(40.0)),
        (None, Some(40.0)),
        (Some(20.0), None),
        (Some(29.0), Some(31.0)),
    ] {
        let found = flown(square(-20.0, 15.0), floor_m, ceiling_m);
        assert_eq!(
            found.iter().map(|(name, _)| *name).collect::<Vec<_>>(),
            ["F1"],
            "{floor_m:?} {ceiling_m:?}"
        );
        assert!(
            found[0].1.starts_with("I is ") && found[0].1.contains("inside no-fly area 2, at (-2"),
            "{found:?}"
        );
    }
    let mut round_the_other_way = square(-20.0, 15.0);
    round_the_other_way.reverse();
    assert_eq!(flown(round_the_other_way, None, None).len(), 1);
    for (corners, floor_m, ceiling_m) in [
        (square(-20.0, 15.0), None, Some(26.0)),
        (square(-20.0, 15.0), Some(34.0), None),
        // Its side a metre and a half away, and its notch about the pose and the way there.
        (square(-13.5, 15.0), None, None),
        (
            vec![
                [-30.0, 0.0],
                [-10.0, 0.0],
                [-10.0, 25.0],
                [-30.0, 25.0],
                [-30.0, 20.0],
                [-15.0, 20.0],
                [-15.0, 6.0],
                [-30.0, 6.0],
            ],
            None,
            None,
        ),
    ] {
        assert_eq!(flown(corners, floor_m, ceiling_m), vec![]);
    }
}
