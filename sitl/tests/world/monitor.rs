//! Each invariant broken on purpose, and seen from outside.

use crate::common::*;
use mavlink::dialects::ardupilotmega::MavCmd;
use veilwing_sitl::*;

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
        let flight = Flight::at_slot(config);
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
