//! The adapter against scripted autopilots that do what real programs were seen to do.

mod bridge;
mod fake;
mod omnicopter;
mod parameters;

use std::time::Duration;

use fake::*;
use mavlink::dialects::ardupilotmega::*;
use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::geo::{Attitude, Enu};

const BOTH: [Firmware; 2] = [Firmware::Px4, Firmware::ArduPilot];

#[test]
fn val_both_firmwares_take_off_fly_to_a_pose_in_the_missions_frame_and_land() {
    for firmware in BOTH {
        let mut world = World::new(Fake::new(firmware), |settings| settings.planned_tilt_rad = 0.6);
        world.launch();
        let attitude = Attitude::from_euler(0.5, -0.2, 0.0);
        let position_enu_m = Enu::new(30.0, -20.0, 25.0);
        world.setpoint = Some(Setpoint { position_enu_m, velocity_enu_m_s: Vector3::zeros(), attitude });
        world.run(130.0);
        // Where it really is, by the autopilot's own origin.
        let frame = world.fake.frame();
        let there = frame.position_to_enu(world.fake.position);
        assert!((there - position_enu_m).norm() < 0.01, "{firmware}: {there}");
        let known = world.autopilot.state().position_enu_m.unwrap().value;
        assert!((known - position_enu_m).norm() < 0.01, "{firmware}: {known}");
        match firmware {
            Firmware::Px4 => {
                let q = Attitude::from_mavlink(world.fake.attitude.map(f64::from)).unwrap();
                assert!(q.angle_to(&attitude) < 1e-6, "{q:?}");
            }
            Firmware::ArduPilot => {
                let q = Attitude::from_mavlink(world.fake.attitude.map(f64::from)).unwrap();
                assert!(q.angle_to(&attitude) < 1e-6, "{q:?}");
                let quaternions = world
                    .fake
                    .received
                    .iter()
                    .filter(|(_, m)| matches!(m, MavMessage::SET_ATTITUDE_TARGET(_)));
                assert_eq!(quaternions.count(), 0, "the 6DoF frame panics on a quaternion");
            }
        }
        world.autopilot.land(world.now);
        world.until(5.0, |event| matches!(event, Event::HandedOver { .. }));
        let landing_since = world.now;
        world.until(60.0, |event| *event == Event::Disarmed);
        world.run(1.0);
        assert_eq!(world.count(|event| *event == Event::Landed), 1);
        assert_eq!(world.fake.setpoints_since(landing_since + Duration::from_millis(20)), 0);
        assert_eq!(
            world.count(|event| matches!(event, Event::ControlLost { .. } | Event::Refused { .. })),
            0
        );
    }
}

#[test]
fn val_setpoints_go_out_at_the_rate_and_never_outlive_the_executive() {
    let mut world = World::new(Fake::new(Firmware::Px4), |settings| settings.actuation = Actuation::Position);
    world.launch();
    let since = world.now;
    world.run(10.0);
    let sent = world.fake.setpoints_since(since);
    assert!((499..=501).contains(&sent), "{sent}");
    world.setpoint = None;
    let stalled = world.now;
    world.run(0.5);
    let lifetime = world.autopilot.settings().setpoint_lifetime;
    let last = world
        .fake
        .received
        .iter()
        .rev()
        .find(|(_, m)| matches!(m, MavMessage::SET_POSITION_TARGET_LOCAL_NED(_)));
    assert!(last.unwrap().0 <= stalled + lifetime + Duration::from_millis(20), "{last:?}");
    // The autopilot's own failsafe follows, and is reported.
    world.until(3.0, |event| matches!(event, Event::ControlLost { .. }));
    assert_eq!(world.fake.custom_mode, PX4_LOITER);
    // It would go back to OFFBOARD at the next setpoint, by itself: an executive that is back must not cause that.
    world.hold_here();
    world.run(5.0);
    assert_eq!(world.fake.custom_mode, PX4_LOITER);
}

#[test]
fn val_the_pilot_wins_at_the_very_heartbeat_and_nothing_resumes_unasked() {
    for firmware in BOTH {
        let mut world = World::new(Fake::new(firmware), |settings| settings.planned_tilt_rad = 0.6);
        world.launch();
        world.fake.custom_mode = if firmware == Firmware::Px4 { PX4_POSCTL } else { 5 };
        world.fake.beat();
        let overridden = world.now;
        let event = world.until(1.0, |event| matches!(event, Event::ControlLost { .. }));
        let mode = if firmware == Firmware::Px4 { "POSCTL" } else { "LOITER" };
        assert_eq!(event, Event::ControlLost { mode: mode.into() });
        assert!(
            world.now.saturating_since(overridden) <= Duration::from_millis(20),
            "at the heartbeat itself"
        );
        assert!(!world.autopilot.in_control());
        // The executive goes on setting setpoints; the mode flaps back: still nothing is sent.
        let lost = world.now + Duration::from_millis(20);
        let set_mode = world.fake.commands(MavCmd::MAV_CMD_DO_SET_MODE).len();
        world.fake.custom_mode = if firmware == Firmware::Px4 { PX4_OFFBOARD } else { 4 };
        world.fake.beat();
        world.run(0.9);
        assert!(!world.autopilot.in_control());
        world.run(20.0);
        assert_eq!(world.fake.setpoints_since(lost), 0, "{firmware}");
        assert_eq!(world.fake.commands(MavCmd::MAV_CMD_DO_SET_MODE).len(), set_mode);
        // Asked for, it is taken again.
        world.hold_here();
        world.autopilot.take_control(world.now);
        world.until(10.0, |event| *event == Event::ControlTaken);
        assert!(world.autopilot.in_control());
    }
}

#[test]
fn val_a_mode_that_is_acknowledged_but_not_entered_is_refused_and_never_retried_after() {
    for firmware in BOTH {
        let mut fake = Fake::new(firmware);
        fake.set_mode = Manners::PayLipService;
        let mut world = World::new(fake, |settings| settings.readiness_timeout = Duration::from_secs(12));
        world.connect();
        world.autopilot.take_control(world.now);
        let event = world.until(15.0, |event| matches!(event, Event::Refused { .. }));
        let what = if firmware == Firmware::Px4 { "OFFBOARD" } else { "GUIDED" };
        assert_eq!(
            event,
            Event::Refused { what, result: Some(MavResult::MAV_RESULT_ACCEPTED), statustext: None },
            "{firmware}"
        );
        assert!(world.fake.commands(MavCmd::MAV_CMD_DO_SET_MODE).len() > 2);
        let asked = world.fake.commands(MavCmd::MAV_CMD_DO_SET_MODE).len();
        world.run(10.0);
        assert_eq!(world.fake.commands(MavCmd::MAV_CMD_DO_SET_MODE).len(), asked);
        assert_eq!(world.count(|event| *event == Event::ControlTaken), 0);
    }
}

#[test]
fn val_refused_arming_is_reported_with_its_reason_and_asked_again_until_ready() {
    for firmware in BOTH {
        let mut fake = Fake::new(firmware);
        let reason = "Arming denied: heading estimate invalid";
        fake.arming = Manners::Refuse(MavResult::MAV_RESULT_TEMPORARILY_REJECTED, reason);
        let mut world = World::new(fake, |_| {});
        world.connect();
        world.autopilot.take_control(world.now);
        world.until(10.0, |event| *event == Event::ControlTaken);
        world.autopilot.arm(world.now);
        let event = world.until(2.0, |event| matches!(event, Event::NotReady { .. }));
        let Event::NotReady { what, result, statustext, .. } = event else { unreachable!() };
        assert_eq!((what, result), ("arming", MavResult::MAV_RESULT_TEMPORARILY_REJECTED));
        assert_eq!(statustext.as_deref(), Some(reason));
        world.run(38.0);
        assert!(world.count(|event| matches!(event, Event::NotReady { .. })) > 10);
        world.fake.arming = Manners::Obey;
        world.until(5.0, |event| *event == Event::Armed);
    }
}

#[test]
fn val_arming_that_never_comes_ends_in_a_refusal() {
    let mut fake = Fake::new(Firmware::Px4);
    fake.arming = Manners::Refuse(MavResult::MAV_RESULT_DENIED, "Arming denied: safety switch");
    let mut world = World::new(fake, |_| {});
    world.connect();
    world.autopilot.take_control(world.now);
    world.until(10.0, |event| *event == Event::ControlTaken);
    world.autopilot.arm(world.now);
    let event = world.until(61.0, |event| matches!(event, Event::Refused { .. }));
    let Event::Refused { what, result, statustext } = event else { unreachable!() };
    assert_eq!((what, result), ("arming", Some(MavResult::MAV_RESULT_DENIED)));
    assert_eq!(statustext.as_deref(), Some("Arming denied: safety switch"));
    assert!(!world.autopilot.state().is_armed());
}

#[test]
fn val_an_unsupported_command_is_not_asked_again() {
    let mut fake = Fake::new(Firmware::ArduPilot);
    fake.set_mode = Manners::Refuse(MavResult::MAV_RESULT_UNSUPPORTED, "no");
    let mut world = World::new(fake, |_| {});
    world.connect();
    world.autopilot.take_control(world.now);
    world.until(1.0, |event| matches!(event, Event::Refused { .. }));
    world.run(5.0);
    assert_eq!(world.fake.commands(MavCmd::MAV_CMD_DO_SET_MODE).len(), 1);
}

#[test]
fn val_unanswered_commands_are_repeated_with_rising_confirmation() {
    let mut fake = Fake::new(Firmware::ArduPilot);
    fake.set_mode = Manners::Ignore;
    let mut world = World::new(fake, |_| {});
    world.connect();
    world.autopilot.take_control(world.now);
    world.run(1.9);
    let confirmations: Vec<u8> =
        world.fake.commands(MavCmd::MAV_CMD_DO_SET_MODE).iter().map(|command| command.confirmation).collect();
    assert_eq!(confirmations, [0, 1, 2, 3]);
    world.fake.set_mode = Manners::Obey;
    world.until(5.0, |event| *event == Event::ControlTaken);
}

#[test]
fn val_a_takeoff_that_is_acknowledged_but_not_flown_is_refused() {
    let mut fake = Fake::new(Firmware::ArduPilot);
    fake.takeoff = Manners::PayLipService;
    let mut world = World::new(fake, |_| {});
    world.connect();
    world.autopilot.take_control(world.now);
    world.until(10.0, |event| *event == Event::ControlTaken);
    world.autopilot.arm(world.now);
    world.until(10.0, |event| *event == Event::Armed);
    world.autopilot.take_off(10.0, world.now);
    let event = world.until(45.0, |event| matches!(event, Event::Refused { .. }));
    let Event::Refused { what, result, .. } = event else { unreachable!() };
    assert_eq!((what, result), ("take-off", Some(MavResult::MAV_RESULT_ACCEPTED)));
}

#[test]
fn val_a_lost_link_ends_control_and_its_return_does_not_bring_it_back() {
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
fn val_telemetry_without_heartbeats_is_a_lost_link() {
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
fn val_a_restart_in_flight_is_seen_and_everything_is_learnt_anew() {
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
fn val_a_changed_system_id_is_another_autopilot_not_ours() {
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
fn val_two_autopilots_are_refused_unless_one_is_named() {
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
fn val_the_only_autopilot_is_found_without_a_name_whatever_its_component_id() {
    let mut fake = Fake::new(Firmware::ArduPilot);
    fake.address = (42, 17);
    let mut world = World::new(fake, |settings| settings.autopilot_system = None);
    let event = world.until(4.0, |event| matches!(event, Event::Discovered { .. }));
    assert_eq!(event, Event::Discovered { system: 42, firmware: Firmware::ArduPilot });
    world.run(3.0);
    assert!(world.autopilot.fresh(world.now));
}

#[test]
fn val_the_wrong_firmware_is_not_taken() {
    let mut world =
        World::new(Fake::new(Firmware::Px4), |settings| settings.firmware = FirmwareChoice::ArduPilot);
    world.run(5.0);
    assert_eq!(world.count(|event| *event == Event::WrongFirmware { system: 1 }), 1);
    assert_eq!(world.autopilot.state().system, None);
}

#[test]
fn val_estimator_faults_are_reported_once_from_each_kind_of_evidence() {
    let mut world = World::new(Fake::new(Firmware::Px4), |settings| settings.planned_tilt_rad = 0.6);
    world.launch();
    assert_eq!(world.count(|event| matches!(event, Event::EstimatorFailure(_))), 0);
    world.fake.estimator |= EstimatorStatusFlags::ESTIMATOR_GPS_GLITCH;
    world.run(3.0);
    assert_eq!(
        world.count(|event| matches!(event, Event::EstimatorFailure(EstimatorFault::Flags { .. }))),
        1
    );
    assert_eq!(world.autopilot.state().estimator_ok.map(|ok| ok.value), Some(false));
    world.fake.estimator = px4_ready();
    world.run(2.0);
    assert_eq!(world.autopilot.state().estimator_ok.map(|ok| ok.value), Some(true));
    let jumps = |world: &World| {
        world.count(|event| matches!(event, Event::EstimatorFailure(EstimatorFault::Jump { distance_m }) if *distance_m > 7.0))
    };
    world.fake.position.x += 8.0;
    world.run(0.1);
    assert_eq!(jumps(&world), 1);
    let time_boot_ms = world.now.since_start().as_millis() as u32;
    let odd = LOCAL_POSITION_NED_DATA { time_boot_ms, x: f32::NAN, ..Default::default() };
    let zero = ATTITUDE_QUATERNION_DATA { time_boot_ms, ..Default::default() };
    world.inject((1, 1), &MavMessage::LOCAL_POSITION_NED(odd));
    world.inject((1, 1), &MavMessage::ATTITUDE_QUATERNION(zero));
    world.run(0.1);
    assert_eq!(
        world.count(|event| matches!(event, Event::EstimatorFailure(EstimatorFault::NotFinite { .. }))),
        2
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
fn val_streams_that_do_not_come_are_asked_for_again_and_named_in_the_preflight() {
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
fn val_preflight_names_parameter_value_and_remedy_and_silence_is_not_known() {
    let find = |world: &World, name: &str| {
        world.autopilot.preflight(world.now).into_iter().find(|check| check.name == name).unwrap()
    };
    let mut world =
        World::new(Fake::new(Firmware::Px4), |settings| settings.actuation = Actuation::ThrustVector);
    world.connect();
    let checks = world.autopilot.preflight(world.now);
    assert!(checks.iter().all(|check| check.result == Verdict::Pass), "{checks:#?}");

    let mut fake = Fake::new(Firmware::Px4);
    fake.parameters.insert("FD_FAIL_R".into(), int(60, Firmware::Px4));
    fake.parameters.insert("COM_OBL_RC_ACT".into(), int(6, Firmware::Px4));
    fake.parameters.remove("COM_OF_LOSS_T");
    let mut world = World::new(fake, |_| {});
    world.connect();
    let tilt = find(&world, "FD_FAIL_R");
    assert!(tilt.result == Verdict::Fail && tilt.detail.contains("60"), "{tilt:?}");
    let loss = find(&world, "COM_OBL_RC_ACT");
    assert!(loss.result == Verdict::Fail && loss.detail.contains("should be 5"), "{loss:?}");
    let unknown = find(&world, "COM_OF_LOSS_T");
    assert!(unknown.result == Verdict::Warn && unknown.detail.contains("not known"), "{unknown:?}");

    let mut fake = Fake::new(Firmware::ArduPilot);
    fake.parameters.insert("FRAME_CLASS".into(), int(1, Firmware::ArduPilot));
    fake.parameters.insert("FS_GCS_ENABLE".into(), int(1, Firmware::ArduPilot));
    let mut world = World::new(fake, |_| {});
    world.connect();
    assert_eq!(find(&world, "FRAME_CLASS").result, Verdict::Fail);
    assert_eq!(find(&world, "FS_GCS_ENABLE").result, Verdict::Warn);
}

#[test]
fn val_thrust_vector_is_refused_on_arducopter_with_the_reason() {
    let mut world =
        World::new(Fake::new(Firmware::ArduPilot), |settings| settings.actuation = Actuation::ThrustVector);
    world.connect();
    world.autopilot.take_control(world.now);
    let event = world.until(0.1, |event| matches!(event, Event::Refused { .. }));
    let Event::Refused { statustext, .. } = event else { unreachable!() };
    assert!(statustext.unwrap().contains("thrust_body"));
    assert_eq!(world.fake.commands(MavCmd::MAV_CMD_DO_SET_MODE).len(), 0);
}

#[test]
fn val_the_land_detector_is_off_before_the_vehicle_tilts_and_back_before_it_lands() {
    let parameter = |world: &World| world.fake.parameters["LNDMC_Z_VEL_MAX"].0;
    let mut world = World::new(Fake::new(Firmware::Px4), |_| {});
    world.launch();
    assert_eq!(parameter(&world), 0.0);
    let tilted = Attitude::from_euler(1.5, 0.0, 0.0);
    world.setpoint = world.setpoint.map(|setpoint| Setpoint { attitude: tilted, ..setpoint });
    world.run(10.0);
    let flown = Attitude::from_mavlink(world.fake.attitude.map(f64::from)).unwrap();
    assert!(flown.angle_to(&tilted) < 1e-6);
    // The pilot takes over: put back, but not while the vehicle still lies on its side.
    world.fake.custom_mode = PX4_POSCTL;
    world.fake.beat();
    world.until(1.0, |event| matches!(event, Event::ControlLost { .. }));
    world.run(2.0);
    assert_eq!(parameter(&world), 0.0);
    world.fake.attitude = Attitude::level().to_mavlink().map(|c| c as f32);
    world.run(1.0);
    assert_eq!(parameter(&world), 0.3);
}

#[test]
fn val_no_tilt_while_the_land_detector_may_still_disarm() {
    let mut world = World::new(Fake::new(Firmware::Px4), |_| {});
    world.launch();
    // From now on the write is never confirmed.
    world.fake.custom_mode = PX4_POSCTL;
    world.fake.beat();
    world.run(3.0);
    assert_eq!(world.fake.parameters["LNDMC_Z_VEL_MAX"].0, 0.3);
    world.fake.parameters.remove("LNDMC_Z_VEL_MAX");
    let since = world.now;
    world.hold_here();
    let tilted = Attitude::from_euler(1.5, 0.0, 0.0);
    world.setpoint = world.setpoint.map(|setpoint| Setpoint { attitude: tilted, ..setpoint });
    world.autopilot.take_control(world.now);
    world.until(10.0, |event| *event == Event::ControlTaken);
    world.run(5.0);
    let tilts = world.fake.received.iter().filter_map(|(at, m)| match m {
        MavMessage::SET_ATTITUDE_TARGET(a) if *at > since => Attitude::from_mavlink(a.q.map(f64::from)),
        _ => None,
    });
    assert!(tilts.map(|attitude| attitude.tilt_rad()).fold(0.0, f64::max) < 1e-3);
}

#[test]
fn val_utc_comes_from_system_time() {
    let mut world = World::new(Fake::new(Firmware::Px4), |_| {});
    assert_eq!(world.autopilot.utc(world.now), None);
    world.connect();
    let error_us = world.autopilot.utc(world.now).unwrap().unix_us as i64
        - (EPOCH_US + world.now.since_start().as_micros() as u64) as i64;
    assert!((-15_000..=0).contains(&error_us), "{error_us}");
}

#[test]
fn val_acknowledgements_to_others_end_nothing_of_ours() {
    let mut fake = Fake::new(Firmware::ArduPilot);
    fake.arming = Manners::Ignore;
    let mut world = World::new(fake, |_| {});
    world.connect();
    world.autopilot.take_control(world.now);
    world.until(5.0, |event| *event == Event::ControlTaken);
    world.autopilot.arm(world.now);
    let ack = COMMAND_ACK_DATA {
        command: MavCmd::MAV_CMD_COMPONENT_ARM_DISARM,
        result: MavResult::MAV_RESULT_DENIED,
        progress: 0,
        result_param2: 0,
        target_system: 255,
        target_component: 190,
    };
    world.inject((1, 1), &MavMessage::COMMAND_ACK(ack.clone()));
    // Nor do those of strangers.
    world.inject(
        (2, 1),
        &MavMessage::COMMAND_ACK(COMMAND_ACK_DATA { target_system: 1, target_component: 191, ..ack }),
    );
    world.run(0.4);
    assert_eq!(world.count(|event| matches!(event, Event::NotReady { .. })), 0);
}

#[test]
fn val_arducopter_without_brake_is_asked_to_loiter() {
    let mut world = World::new(Fake::new(Firmware::ArduPilot), |_| {});
    world.fake.missing_mode = Some(17);
    world.launch();
    world.autopilot.hold(world.now);
    let event = world.until(3.0, |event| matches!(event, Event::HandedOver { .. }));
    assert_eq!(event, Event::HandedOver { mode: "LOITER" });
    assert_eq!(world.count(|event| matches!(event, Event::NotReady { what: "BRAKE", .. })), 1);
    assert_eq!(world.count(|event| matches!(event, Event::ControlLost { .. })), 0);
}

/// A message of one of the kinds the adapter reads, from random bytes.
fn random_message(rng: &mut ChaCha8Rng) -> Option<MavMessage> {
    const IDS: [u32; 20] =
        [0, 1, 2, 22, 30, 31, 32, 33, 49, 62, 77, 86, 147, 148, 193, 230, 242, 245, 253, 76];
    let id = IDS[rng.random_range(0..IDS.len())];
    let length = rng.random_range(0..200);
    let payload: Vec<u8> = (0..length).map(|_| rng.random()).collect();
    <MavMessage as mavlink::Message>::parse(mavlink::MavlinkVersion::V2, id, &payload).ok()
}

#[test]
fn prop_no_message_and_no_order_of_requests_panics_or_makes_it_send_what_is_not_finite() {
    for seed in 0..40 {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let firmware = BOTH[(seed % 2) as usize];
        let mut world = World::new(Fake::new(firmware), |settings| {
            settings.actuation =
                [Actuation::Pose, Actuation::Position, Actuation::ThrustVector][seed as usize % 3];
        });
        if seed % 4 != 0 {
            world.connect();
        }
        let seen = world.fake.received.len();
        for _ in 0..3000 {
            if let Some(message) = random_message(&mut rng) {
                world.inject((1, 1), &message);
            }
            let now = world.now;
            let autopilot = &mut world.autopilot;
            match rng.random_range(0..60) {
                0 => autopilot.take_control(now),
                1 => autopilot.arm(now),
                2 => autopilot.take_off(rng.random_range(-5.0..50.0), now),
                3 => autopilot.take_off(f64::NAN, now),
                4 => autopilot.land(now),
                5 => autopilot.return_to_launch(now),
                6 => autopilot.hold(now),
                7 => autopilot.release(now),
                8 => autopilot.disarm(now),
                9 => drop(autopilot.preflight(now)),
                10 => autopilot
                    .statustext(MavSeverity::MAV_SEVERITY_INFO, &"é".repeat(rng.random_range(0..120))),
                11..40 => autopilot.set_setpoint(random_setpoint(&mut rng), now),
                _ => {}
            }
            assert!(autopilot.utc_uncertainty().is_none_or(|within| within < Duration::from_secs(1)));
            world.run(0.005);
        }
        for (_, message) in &world.fake.received[seen..] {
            let finite = match message {
                MavMessage::SET_POSITION_TARGET_LOCAL_NED(m) => {
                    [m.x, m.y, m.z, m.vx, m.vy, m.vz, m.yaw].iter().all(|c| c.is_finite())
                }
                MavMessage::SET_ATTITUDE_TARGET(m) => m.q.iter().chain(&m.thrust_body).all(|c| c.is_finite()),
                MavMessage::COMMAND_LONG(m) => {
                    [m.param1, m.param2, m.param3, m.param7].iter().all(|c| c.is_finite())
                }
                _ => true,
            };
            assert!(finite, "seed {seed}: {message:?}");
            let quaternion = matches!(message, MavMessage::SET_ATTITUDE_TARGET(_));
            assert!(firmware == Firmware::Px4 || !quaternion, "seed {seed}: {message:?}");
        }
    }
}

fn random_setpoint(rng: &mut ChaCha8Rng) -> Setpoint {
    let mut number =
        |scale: f64| if rng.random_bool(0.01) { f64::NAN } else { scale * (rng.random::<f64>() - 0.5) };
    Setpoint {
        position_enu_m: Enu::new(number(1e3), number(1e3), number(1e3)),
        velocity_enu_m_s: Vector3::new(number(10.0), number(10.0), number(10.0)),
        attitude: Attitude::from_euler(number(6.0), number(6.0), number(6.0)),
    }
}

#[test]
fn val_in_progress_extends_the_wait_and_nothing_is_repeated() {
    let mut fake = Fake::new(Firmware::ArduPilot);
    fake.arming = Manners::TakeTime(3000);
    let mut world = World::new(fake, |_| {});
    world.connect();
    world.autopilot.take_control(world.now);
    world.until(5.0, |event| *event == Event::ControlTaken);
    world.autopilot.arm(world.now);
    world.until(5.0, |event| *event == Event::Armed);
    assert_eq!(world.fake.commands(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM).len(), 1);
}

#[test]
fn val_a_repeated_mode_command_never_takes_the_mode_back_from_the_pilot() {
    for firmware in BOTH {
        let mut fake = Fake::new(firmware);
        // Done, but the answer is lost: the command would be repeated.
        fake.set_mode = Manners::ObeyInSilence;
        let mut world = World::new(fake, |_| {});
        world.connect();
        world.autopilot.take_control(world.now);
        world.until(5.0, |event| *event == Event::ControlTaken);
        let asked = world.fake.commands(MavCmd::MAV_CMD_DO_SET_MODE).len();
        world.fake.custom_mode = if firmware == Firmware::Px4 { PX4_POSCTL } else { 0 };
        world.fake.beat();
        world.until(1.0, |event| matches!(event, Event::ControlLost { .. }));
        world.run(10.0);
        assert_eq!(world.fake.commands(MavCmd::MAV_CMD_DO_SET_MODE).len(), asked, "{firmware}");
        assert_ne!(world.autopilot.state().mode(), Some(Mode::Companion));
    }
}

#[test]
fn val_a_pilot_who_acts_while_the_mode_is_being_taken_in_flight_wins() {
    let mut world = World::new(Fake::new(Firmware::Px4), |settings| settings.planned_tilt_rad = 0.3);
    world.launch();
    world.fake.custom_mode = PX4_POSCTL;
    world.fake.beat();
    world.run(0.5);
    world.fake.set_mode = Manners::PayLipService;
    world.autopilot.take_control(world.now);
    world.run(0.5);
    world.fake.custom_mode = PX4_LAND;
    world.fake.beat();
    let event = world.until(0.1, |event| matches!(event, Event::ControlLost { .. }));
    assert_eq!(event, Event::ControlLost { mode: "AUTO.LAND".into() });
    world.fake.set_mode = Manners::Obey;
    world.run(5.0);
    assert_eq!(world.autopilot.state().mode(), Some(Mode::Land));
}

#[test]
fn val_modes_that_flap_on_the_ground_do_not_stop_the_taking() {
    let mut world = World::new(Fake::new(Firmware::Px4), |_| {});
    world.connect();
    world.fake.set_mode = Manners::Refuse(MavResult::MAV_RESULT_TEMPORARILY_REJECTED, "not yet");
    world.autopilot.take_control(world.now);
    for mode in [PX4_LOITER, PX4_POSCTL, PX4_LOITER] {
        world.fake.custom_mode = mode;
        world.fake.beat();
        world.run(1.5);
    }
    assert_eq!(world.count(|event| matches!(event, Event::ControlLost { .. })), 0);
    assert!(world.count(|event| matches!(event, Event::NotReady { what: "OFFBOARD", .. })) > 0);
    world.fake.set_mode = Manners::Obey;
    world.until(5.0, |event| *event == Event::ControlTaken);
}

#[test]
fn val_a_refused_landing_leaves_the_vehicle_held_by_the_companion() {
    for firmware in BOTH {
        let mut world = World::new(Fake::new(firmware), |settings| settings.planned_tilt_rad = 0.3);
        world.launch();
        world.fake.set_mode = Manners::Refuse(MavResult::MAV_RESULT_DENIED, "no landing here");
        world.autopilot.land(world.now);
        let event = world.until(8.0, |event| matches!(event, Event::Refused { .. }));
        let Event::Refused { statustext, .. } = event else { unreachable!() };
        assert_eq!(statustext.as_deref(), Some("no landing here"));
        assert!(world.autopilot.in_control());
        let since = world.now;
        world.run(2.0);
        assert!(world.fake.setpoints_since(since) > 95, "{firmware}");
    }
}

#[test]
fn val_a_companion_that_restarts_in_flight_takes_control_again_when_asked() {
    for firmware in BOTH {
        let mut world = World::new(Fake::new(firmware), |settings| settings.planned_tilt_rad = 0.3);
        world.launch();
        let settings = world.autopilot.settings().clone();
        world.autopilot = Autopilot::new(settings, world.now);
        world.setpoint = None;
        let since = world.now + Duration::from_millis(20);
        world.until(3.0, |event| matches!(event, Event::Discovered { .. }));
        world.run(4.0);
        assert_eq!(world.fake.setpoints_since(since), 0, "nothing unasked");
        assert!(!world.autopilot.in_control());
        world.hold_here();
        world.autopilot.take_control(world.now);
        world.until(6.0, |event| *event == Event::ControlTaken);
        let since = world.now;
        world.run(1.0);
        assert!(world.autopilot.in_control() && world.fake.setpoints_since(since) > 45, "{firmware}");
    }
}

#[test]
fn val_arducopter_gets_no_setpoint_before_it_is_airborne() {
    let mut world = World::new(Fake::new(Firmware::ArduPilot), |_| {});
    world.connect();
    world.autopilot.take_control(world.now);
    world.until(5.0, |event| *event == Event::ControlTaken);
    world.autopilot.arm(world.now);
    world.until(5.0, |event| *event == Event::Armed);
    world.autopilot.take_off(10.0, world.now);
    world.until(30.0, |event| *event == Event::Airborne);
    assert_eq!(world.fake.setpoints_since(crate::time::Instant::ZERO), 0);
    world.hold_here();
    world.run(1.0);
    assert!(world.fake.setpoints_since(crate::time::Instant::ZERO) > 45);
}

#[test]
fn val_a_6dof_frame_without_its_bridge_is_named_and_offsets_are_off_for_the_landing() {
    let mut world = World::new(Fake::new(Firmware::ArduPilot), |settings| settings.planned_tilt_rad = 0.6);
    let bridge = |world: &World| {
        world.autopilot.preflight(world.now).into_iter().find(|check| check.name == "bridge script").unwrap()
    };
    world.launch();
    assert_eq!(bridge(&world).result, Verdict::Pass);
    let switched = |world: &World| world.fake.commands(MavCmd::MAV_CMD_USER_5).last().map(|c| c.param1);
    assert_eq!(switched(&world), Some(1.0));
    world.autopilot.land(world.now);
    world.run(0.1);
    assert_eq!(switched(&world), Some(0.0));

    // A stock autopilot knows no 31013.
    let mut fake = Fake::new(Firmware::ArduPilot);
    fake.without_bridge = true;
    let mut world = World::new(fake, |_| {});
    world.connect();
    assert!(bridge(&world).result == Verdict::Fail && bridge(&world).detail.contains("UNSUPPORTED"));
}

#[test]
fn val_a_rate_above_the_loop_is_refused_and_asked_for_again_at_half() {
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
