//! What is heard of the autopilot: its link, identity, streams, estimator and clock.

use super::*;

#[test]
fn spec_a_lost_link_ends_control_and_its_return_does_not_bring_it_back() {
    let mut world = World::new(Fake::new(Firmware::Px4), |settings| settings.planned_tilt_rad = 0.6);
    world.launch();
    world.cut = true;
    let cut = world.now;
    world.run(0.3);
    assert!(!world.autopilot.fresh(world.now), "stale before the link counts as lost");
    assert!(!world.fake.silent);
    world.until(2.0, |event| matches!(event, Event::LinkLost { .. }));
    assert!(world.now.saturating_since(cut) <= Duration::from_millis(1050));
    world.run(2.0);
    world.cut = false;
    let back = world.now;
    world.until(3.0, |event| *event == Event::LinkRestored);
    world.run(10.0);
    // PX4 would re-enter OFFBOARD by itself if the stream resumed.
    assert_eq!(world.fake.setpoints_since(back + Duration::from_millis(20)), 0);
    assert_eq!(world.fake.custom_mode, PX4_LOITER);
    assert!(!world.autopilot.in_control());
    assert!(world.autopilot.fresh(world.now));
    world.hold_here();
    world.autopilot.take_control(world.now);
    world.until(10.0, |event| *event == Event::ControlTaken);
}

#[test]
fn spec_telemetry_without_heartbeats_is_a_lost_link() {
    let mut world = World::new(Fake::new(Firmware::ArduPilot), |_| {});
    world.connect();
    let heartbeat = |m: &MavMessage| matches!(m, MavMessage::HEARTBEAT(_));
    assert!(world.autopilot.poll_transmit().is_none_or(|m| !heartbeat(&m)));
    world.fake.silent = true;
    let position = MavMessage::LOCAL_POSITION_NED(LOCAL_POSITION_NED_DATA::default());
    for _ in 0..120 {
        world.run(0.05);
        world.inject((1, 1), &position);
    }
    let lost = |event: &Event| matches!(event, Event::LinkLost { missing: "no heartbeat", .. });
    assert_eq!(world.count(lost), 1);
}

#[test]
fn spec_a_restart_in_flight_is_seen_and_everything_is_learnt_anew() {
    for firmware in BOTH {
        let mut world = World::new(Fake::new(firmware), |settings| settings.planned_tilt_rad = 0.6);
        world.launch();
        world.fake.silent = true;
        world.run(0.5);
        let now = world.now;
        world.fake.restart(now);
        world.fake.silent = false;
        // Its first messages come before any stream is asked for.
        let booting = MavMessage::SYSTEM_TIME(SYSTEM_TIME_DATA { time_unix_usec: 0, time_boot_ms: 700 });
        world.inject((1, 1), &booting);
        world.run(0.01);
        assert_eq!(world.count(|event| *event == Event::Restarted), 1, "{firmware}");
        assert!(!world.autopilot.in_control());
        assert_eq!(world.autopilot.state().local_origin, None);
        let since = world.now + Duration::from_millis(20);
        world.run(8.0);
        assert_eq!(world.fake.setpoints_since(since), 0);
        assert!(world.autopilot.fresh(world.now), "streams were asked for again");
        assert_eq!(world.count(|event| *event == Event::Restarted), 1);
    }
}

#[test]
fn spec_a_changed_system_id_is_another_autopilot_not_ours() {
    let mut world = World::new(Fake::new(Firmware::Px4), |settings| settings.planned_tilt_rad = 0.6);
    world.launch();
    world.fake.address = (7, 1);
    world.until(2.0, |event| matches!(event, Event::LinkLost { .. }));
    world.run(3.0);
    assert_eq!(world.count(|event| *event == Event::AnotherAutopilot { system: 7, using: Some(1) }), 1);
    assert_eq!(world.count(|event| matches!(event, Event::Discovered { .. })), 1);
    assert_eq!(world.autopilot.state().system, Some(1));
}

#[test]
fn spec_two_autopilots_are_refused_unless_one_is_named() {
    let beat = |world: &mut World, from, autopilot, mavtype| {
        let heartbeat = HEARTBEAT_DATA {
            custom_mode: 0,
            mavtype,
            autopilot,
            base_mode: MavModeFlag::empty(),
            system_status: MavState::MAV_STATE_STANDBY,
            mavlink_version: 3,
        };
        world.inject(from, &MavMessage::HEARTBEAT(heartbeat));
    };
    let px4 = MavAutopilot::MAV_AUTOPILOT_PX4;
    let quad = MavType::MAV_TYPE_QUADROTOR;
    for (named, expected) in [(None, None), (Some(1), Some(1)), (Some(9), Some(9))] {
        let mut fake = Fake::new(Firmware::Px4);
        fake.silent = true;
        let mut world = World::new(fake, |settings| settings.autopilot_system = named);
        for _ in 0..8 {
            beat(&mut world, (1, 1), px4, quad);
            beat(&mut world, (9, 1), px4, quad);
            // Not autopilots, whatever their ids: a ground station, a companion, a radio in the autopilot's system.
            beat(&mut world, (255, 1), MavAutopilot::MAV_AUTOPILOT_INVALID, MavType::MAV_TYPE_GCS);
            beat(
                &mut world,
                (1, 191),
                MavAutopilot::MAV_AUTOPILOT_INVALID,
                MavType::MAV_TYPE_ONBOARD_CONTROLLER,
            );
            beat(&mut world, (1, 68), MavAutopilot::MAV_AUTOPILOT_INVALID, MavType::MAV_TYPE_RADIO);
            beat(&mut world, (3, 1), MavAutopilot::MAV_AUTOPILOT_GENERIC, MavType::MAV_TYPE_GIMBAL);
            world.run(0.5);
        }
        assert_eq!(world.autopilot.state().system, expected);
        if named.is_none() {
            assert_eq!(world.count(|event| matches!(event, Event::AnotherAutopilot { using: None, .. })), 2);
            let checks = world.autopilot.preflight(world.now);
            assert!(
                checks[0].result == Verdict::Fail && checks[0].detail.contains("system_id"),
                "{checks:?}"
            );
        }
    }
}

#[test]
fn spec_the_only_autopilot_is_found_without_a_name_whatever_its_component_id() {
    let mut fake = Fake::new(Firmware::ArduPilot);
    fake.address = (42, 17);
    let mut world = World::new(fake, |settings| settings.autopilot_system = None);
    let event = world.until(4.0, |event| matches!(event, Event::Discovered { .. }));
    assert_eq!(event, Event::Discovered { system: 42, firmware: Firmware::ArduPilot });
    world.run(3.0);
    assert!(world.autopilot.fresh(world.now));
}

#[test]
fn spec_the_wrong_firmware_is_not_taken() {
    let mut world =
        World::new(Fake::new(Firmware::Px4), |settings| settings.firmware = FirmwareChoice::ArduPilot);
    world.run(5.0);
    assert_eq!(world.count(|event| *event == Event::WrongFirmware { system: 1 }), 1);
    assert_eq!(world.autopilot.state().system, None);
}

#[test]
fn spec_estimator_faults_are_reported_once_from_each_kind_of_evidence() {
    let mut world = World::new(Fake::new(Firmware::Px4), |settings| settings.planned_tilt_rad = 0.6);
    world.launch();
    let healthy = |world: &World| world.autopilot.state().estimator.map(|estimator| estimator.value.is_ok());
    // PX4 says so of a vehicle at rest, and for a while after lift-off.
    world.fake.estimator |= EstimatorStatusFlags::ESTIMATOR_CONST_POS_MODE;
    world.run(3.0);
    assert_eq!(healthy(&world), Some(true));
    assert_eq!(world.count(|event| matches!(event, Event::EstimatorFailure(_))), 0);
    world.fake.estimator |= EstimatorStatusFlags::ESTIMATOR_GPS_GLITCH;
    world.run(3.0);
    assert_eq!(
        world.count(|event| matches!(event, Event::EstimatorFailure(EstimatorFault::Flags { .. }))),
        1
    );
    assert_eq!(healthy(&world), Some(false));
    let check =
        world.autopilot.preflight(world.now).into_iter().find(|check| check.name == "estimator").unwrap();
    assert_eq!((check.result, &*check.detail), (Verdict::Fail, "ESTIMATOR_STATUS: GPS glitch"));
    world.fake.estimator = px4_ready();
    world.run(2.0);
    assert_eq!(healthy(&world), Some(true));
    let jumps = |world: &World| {
        world.count(|event| matches!(event, Event::EstimatorFailure(EstimatorFault::Jump { distance_m }) if *distance_m > 7.0))
    };
    world.fake.position.x += 8.0;
    world.run(0.1);
    assert_eq!(jumps(&world), 1);
    let time_boot_ms = world.now.since_start().as_millis() as u32;
    let odd = LOCAL_POSITION_NED_DATA { time_boot_ms, x: f32::NAN, ..Default::default() };
    let far = LOCAL_POSITION_NED_DATA { time_boot_ms, z: 1e30, ..Default::default() };
    let zero = ATTITUDE_QUATERNION_DATA { time_boot_ms, ..Default::default() };
    world.inject((1, 1), &MavMessage::LOCAL_POSITION_NED(odd));
    world.inject((1, 1), &MavMessage::LOCAL_POSITION_NED(far));
    world.inject((1, 1), &MavMessage::ATTITUDE_QUATERNION(zero));
    world.run(0.1);
    assert_eq!(
        world.count(|event| matches!(event, Event::EstimatorFailure(EstimatorFault::NotFinite { .. }))),
        3
    );
    assert!(world.autopilot.state().position_enu_m.unwrap().value.iter().all(|c| c.is_finite()));
    let moved = GPS_GLOBAL_ORIGIN_DATA {
        latitude: 500_771_000 + 900,
        longitude: 144_350_000,
        altitude: 203_000,
        time_usec: 0,
    };
    world.inject((1, 1), &MavMessage::GPS_GLOBAL_ORIGIN(moved));
    world.run(0.1);
    assert_eq!(
        world.count(|event| matches!(event, Event::EstimatorFailure(EstimatorFault::OriginMoved { .. }))),
        1
    );
}

#[test]
fn spec_a_position_without_a_fix_is_none_whatever_the_flags_and_the_health_say() {
    type Change = fn(&mut Fake);
    let cases: [(Change, Change, f64, &str); 3] = [
        (
            |fake| fake.fix = GpsFixType::GPS_FIX_TYPE_NO_FIX,
            |fake| fake.fix = GpsFixType::GPS_FIX_TYPE_RTK_FLOAT,
            0.25,
            "GPS_RAW_INT: no 3D fix",
        ),
        (|fake| fake.mute.push(24), |fake| fake.mute.clear(), 3.3, "GPS_RAW_INT: not heard for 3 s"),
        (
            |fake| fake.accuracy_m = 2.1,
            |fake| fake.accuracy_m = 1.9,
            0.6,
            "ESTIMATOR_STATUS: horizontal position is worse than 2 m",
        ),
    ];
    for (lose, find, within_s, told) in cases {
        let mut world = World::new(Fake::new(Firmware::Px4), |settings| settings.planned_tilt_rad = 0.6);
        world.launch();
        let faults = |world: &World| {
            world.count(|event| matches!(event, Event::EstimatorFailure(fault) if fault.to_string() == told))
        };
        lose(&mut world.fake);
        world.run(within_s);
        assert_eq!(faults(&world), 1, "{told}");
        world.run(5.0);
        assert_eq!(faults(&world), 1, "{told}: told once");
        assert!(world.autopilot.state().estimator.unwrap().value.is_err(), "{told}");
        find(&mut world.fake);
        world.run(1.0);
        assert!(world.autopilot.state().estimator.unwrap().value.is_ok(), "{told}");
    }
}

#[test]
fn spec_slow_and_even_telemetry_warns_and_crawling_telemetry_fails() {
    for (slowness, verdict) in [(1.2, None), (2.0, Some(Verdict::Warn)), (4.0, Some(Verdict::Fail))] {
        let mut fake = Fake::new(Firmware::Px4);
        fake.slowness = slowness;
        let mut world = World::new(fake, |_| {});
        world.until(5.0, |event| matches!(event, Event::Discovered { .. }));
        world.run(7.0);
        let checks = world.autopilot.preflight(world.now);
        let slow = checks.iter().find(|check| check.detail.contains("ATTITUDE_QUATERNION"));
        assert_eq!(slow.map(|check| check.result), verdict, "{slowness}: {slow:?}");
        let period = world.autopilot.state_period().as_secs_f64();
        assert!((period / (0.02 * slowness) - 1.0).abs() < 0.1, "late is judged by what comes: {period}");
    }
}

#[test]
fn spec_streams_that_do_not_come_are_asked_for_again_and_named_in_the_preflight() {
    let mut fake = Fake::new(Firmware::Px4);
    fake.mute = vec![31];
    let mut world = World::new(fake, |_| {});
    world.until(5.0, |event| matches!(event, Event::Discovered { .. }));
    world.run(7.0);
    let asked = |world: &World| {
        world.fake.commands(MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL).iter().filter(|c| c.param1 == 31.0).count()
    };
    assert!(asked(&world) >= 4, "{}", asked(&world));
    let named = |world: &World| {
        let checks = world.autopilot.preflight(world.now);
        checks.iter().any(|c| c.result == Verdict::Fail && c.detail.contains("ATTITUDE_QUATERNION"))
    };
    assert!(named(&world) && !world.autopilot.fresh(world.now));
    world.fake.mute.clear();
    world.run(5.0);
    assert!(!named(&world) && world.autopilot.fresh(world.now));
    let before = asked(&world);
    world.run(10.0);
    assert_eq!(asked(&world), before, "what comes is not asked for again");
}

#[test]
fn spec_utc_comes_from_system_time() {
    let mut world = World::new(Fake::new(Firmware::Px4), |_| {});
    assert_eq!(world.autopilot.utc(world.now), None);
    world.connect();
    let error_us = world.autopilot.utc(world.now).unwrap().unix_us as i64
        - (EPOCH_US + world.now.since_start().as_micros() as u64) as i64;
    assert!((-15_000..=0).contains(&error_us), "{error_us}");
}

#[test]
fn spec_a_rate_above_the_loop_is_refused_and_asked_for_again_at_half() {
    let mut fake = Fake::new(Firmware::ArduPilot);
    fake.fastest_hz = 60.0;
    let mut world = World::new(fake, |settings| settings.rate_hz = 100.0);
    world.until(3.0, |event| matches!(event, Event::Discovered { .. }));
    world.run(8.0);
    assert!(world.autopilot.fresh(world.now));
    let asked: Vec<f32> = world
        .fake
        .commands(MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL)
        .iter()
        .filter(|c| c.param1 == 32.0)
        .map(|c| c.param2)
        .collect();
    assert_eq!(asked, [10_000.0, 20_000.0]);
}

fn verdict(world: &World, name: &str) -> (Verdict, String) {
    let checks = world.autopilot.preflight(world.now);
    checks.into_iter().find(|check| check.name == name).map(|check| (check.result, check.detail)).unwrap()
}

#[test]
fn spec_telemetry_that_is_late_is_not_fresh_however_promptly_it_comes() {
    for actuation in [Actuation::Pose, Actuation::ThrustVector] {
        let mut fake = Fake::new(Firmware::Px4);
        fake.body = (actuation == Actuation::ThrustVector).then(|| omnicopter::Body::new(Vector3::zeros()));
        let mut world = World::new(fake, |settings| settings.actuation = actuation);
        world.launch();
        assert!(world.autopilot.fresh(world.now));
        // What it says and hears is 10 ms under way; it and we move in steps of 5 ms.
        let age = world.autopilot.state_age(world.now).unwrap();
        assert!(age >= LATENCY && age <= 2 * LATENCY + Duration::from_millis(20 + 10), "{age:?}");
        // A second would be a lost link, for once, and 0.85 s a silence after which the mode is in doubt.
        world.late = Duration::from_millis(800);
        world.run(1.2);
        let since = world.now;
        world.run(0.5);
        let received = world.autopilot.state_received_at().unwrap();
        assert!(world.now.saturating_since(received) <= Duration::from_millis(25), "it comes");
        assert!(!world.autopilot.fresh(world.now));
        let age = world.autopilot.state_age(world.now).unwrap();
        assert!(age >= Duration::from_millis(810) && age <= Duration::from_millis(860), "{age:?}");
        let (result, detail) = verdict(&world, "position and attitude");
        assert!(result == Verdict::Fail && detail.contains("should be at most 250 ms"), "{detail}");
        // The autopilot closes the loop over a pose by itself; over a thrust we would, and it were a guess.
        assert_eq!(world.fake.setpoints_since(since) > 0, actuation == Actuation::Pose, "{actuation}");
        world.late = Duration::ZERO;
        world.run(1.5);
        assert!(world.autopilot.fresh(world.now));
    }
}

#[test]
fn spec_copies_and_what_was_overtaken_are_no_news() {
    let mut world = World::new(Fake::new(Firmware::Px4), |_| {});
    world.connect();
    world.run(10.0);
    let stamp = |world: &World, age_ms: u64| {
        (world.now.saturating_since(crate::time::Instant::ZERO).as_millis() as u64 - age_ms) as u32
    };
    let known = world.autopilot.state().clone();
    world.now = world.now + Duration::from_millis(100);
    let (position, attitude) = (known.position_enu_m.unwrap(), known.attitude.unwrap());
    for age_ms in [130, 300, 1900, 3000] {
        let time_boot_ms = stamp(&world, age_ms);
        let odd = LOCAL_POSITION_NED_DATA { time_boot_ms, x: 1e3, ..Default::default() };
        let turned = ATTITUDE_QUATERNION_DATA { time_boot_ms, q2: 1.0, ..Default::default() };
        world.inject((1, 1), &MavMessage::LOCAL_POSITION_NED(odd));
        world.inject((1, 1), &MavMessage::ATTITUDE_QUATERNION(turned));
    }
    let state = world.autopilot.state();
    assert_eq!((state.position_enu_m.unwrap(), state.attitude.unwrap()), (position, attitude));
    assert_eq!(world.count(|event| matches!(event, Event::Restarted | Event::EstimatorFailure(_))), 0);
    assert!(world.autopilot.poll_event().is_none());
}

#[test]
fn spec_an_autopilot_that_does_not_answer_timesync_flies_with_a_warning() {
    let mut world = World::new(Fake::new(Firmware::ArduPilot), |_| {});
    world.connect();
    let (result, detail) = verdict(&world, "age of telemetry");
    assert!(result == Verdict::Pass && detail.contains("by TIMESYNC"), "{detail}");
    let mut fake = Fake::new(Firmware::ArduPilot);
    fake.without_timesync = true;
    let mut world = World::new(fake, |_| {});
    world.until(5.0, |event| matches!(event, Event::Discovered { .. }));
    world.run(2.0);
    assert_eq!(verdict(&world, "age of telemetry").0, Verdict::Fail, "it may still answer");
    assert!(!world.autopilot.fresh(world.now));
    world.run(2.0);
    let (result, detail) = verdict(&world, "age of telemetry");
    assert!(result == Verdict::Warn && detail.contains("does not answer TIMESYNC"), "{detail}");
    assert!(world.autopilot.fresh(world.now));
    world.late = Duration::from_millis(400);
    world.run(1.0);
    assert!(!world.autopilot.fresh(world.now), "what comes late all of a sudden is seen without it");
}
