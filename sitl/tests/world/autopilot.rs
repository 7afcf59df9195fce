//! The MAVLink face, asked as a client asks.

use crate::common::*;
use mavlink::dialects::ardupilotmega::*;
use veilwing_sitl::*;

fn arducopter() -> WorldConfig {
    let mut config = config();
    config.vehicles.iter_mut().for_each(|v| v.firmware = Firmware::ArduCopter);
    config
}

fn armed(heartbeat: &HEARTBEAT_DATA) -> bool {
    heartbeat.base_mode.contains(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED)
}

#[test]
fn spec_arming_is_refused_until_ready_and_without_a_stream() {
    let mut f = Flight::new(config());
    let arm = MavCmd::MAV_CMD_COMPONENT_ARM_DISARM;
    f.pass(500);
    f.clients[0].command(&mut f.world, arm, &[1.0]);
    f.pass(100);
    assert_eq!(f.clients[0].last_ack(arm).unwrap().result, MavResult::MAV_RESULT_TEMPORARILY_REJECTED);
    assert!(f.clients[0].texts().iter().any(|t| t.contains("estimator not ready")));
    f.pass(2500);
    // OFFBOARD while disarmed is acknowledged without a stream; arming in it is not.
    f.clients[0].command(&mut f.world, MavCmd::MAV_CMD_DO_SET_MODE, &[1.0, 6.0]);
    f.clients[0].command(&mut f.world, arm, &[1.0]);
    f.pass(1100);
    assert_eq!(
        f.clients[0].last_ack(MavCmd::MAV_CMD_DO_SET_MODE).unwrap().result,
        MavResult::MAV_RESULT_ACCEPTED
    );
    let refused = f.clients[0].last_ack(arm).unwrap();
    assert_eq!(refused.result, MavResult::MAV_RESULT_TEMPORARILY_REJECTED);
    assert_eq!((refused.target_system, refused.target_component), (1, 191));
    assert_eq!(f.clients[0].heartbeat().custom_mode, PX4_OFFBOARD);
    assert!(!armed(&f.clients[0].heartbeat()));
}

#[test]
fn spec_offboard_falls_back_a_second_after_the_stream_and_resumes_by_itself() {
    let mut f = Flight::at_slot(config());
    assert_eq!(f.clients[0].heartbeat().custom_mode, PX4_OFFBOARD);
    let mode = |f: &Flight| f.world.snapshot().vehicles[0].mode;
    f.pass(975);
    assert_eq!(mode(&f), "OFFBOARD");
    f.pass(50);
    assert_eq!(mode(&f), "HOLD");
    f.pass(3000);
    let heartbeat = f.clients[0].heartbeat();
    assert_eq!((heartbeat.custom_mode, heartbeat.system_status), (0x0304_0000, MavState::MAV_STATE_CRITICAL));
    assert!(f.clients[0].texts().iter().any(|t| t.contains("Offboard signal lost")));
    // Level, and where it was.
    let [_, x, y, _] = f.world.snapshot().vehicles[0].nominal_attitude_wxyz;
    assert!(x.hypot(y) < 0.01);
    let goals = f.goals(0);
    let drift: f64 = (0..3).map(|k| (f.position(0)[k] - goals[0][k]).abs()).fold(0.0, f64::max);
    assert!(drift < 0.2, "{drift}");
    // The trap: a stream is enough to take the vehicle back.
    f.stream(1200, goals, Some(0), |_| {});
    assert_eq!(mode(&f), "OFFBOARD");
    // Unless somebody has chosen another mode since.
    f.pass(1500);
    f.clients[0].command(&mut f.world, MavCmd::MAV_CMD_DO_SET_MODE, &[1.0, 3.0]);
    f.stream(2000, goals, Some(0), |_| {});
    assert_eq!(mode(&f), "POSCTL");
}

#[test]
fn spec_offboard_loss_follows_its_parameter() {
    for (action, expected) in [(3, "RTL"), (4, "LAND"), (5, "HOLD")] {
        let mut f = Flight::new(config());
        f.take_off();
        f.set_int("COM_OBL_RC_ACT", action);
        f.pass(1500);
        assert_eq!(f.world.snapshot().vehicles[0].mode, expected);
    }
}

#[test]
fn spec_the_attitude_failure_detector_ends_a_tilted_flight() {
    let mut f = Flight::new(config());
    f.take_off();
    f.set_int("FD_FAIL_R", 45);
    f.go_to_slot(0);
    assert!(!f.world.snapshot().vehicles[0].armed);
    assert!(f.clients[0].texts().iter().any(|t| t.contains("attitude failure")));
}

#[test]
fn spec_guided_needs_its_order() {
    let mut f = Flight::new(arducopter());
    let (arm, takeoff) = (MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, MavCmd::MAV_CMD_NAV_TAKEOFF);
    f.pass(3000);
    f.clients[0].command(&mut f.world, takeoff, &[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 25.0]);
    f.pass(20);
    assert_eq!(f.clients[0].last_ack(takeoff).unwrap().result, MavResult::MAV_RESULT_FAILED);
    f.clients[0].command(&mut f.world, MavCmd::MAV_CMD_DO_SET_MODE, &[1.0, 4.0]);
    f.clients[0].command(&mut f.world, arm, &[1.0]);
    let goals = f.goals(0);
    f.stream(3000, goals, None, |_| {});
    assert!(f.world.snapshot().vehicles[0].landed, "setpoints before the take-off are ignored");
    f.clients[0].command(&mut f.world, takeoff, &[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 25.0]);
    f.pass(12_000);
    assert_eq!(f.clients[0].last_ack(takeoff).unwrap().result, MavResult::MAV_RESULT_ACCEPTED);
    assert!((f.position(0)[2] - 25.0).abs() < 0.5);
    f.go_to_slot(0);
    let close = |f: &Flight| (0..3).all(|k| (f.position(0)[k] - f.goals(0)[0][k]).abs() < 0.1);
    assert!(close(&f), "{:?}", f.position(0));
    // A position target is kept for ever, without a word; the attitude levels after GUID_TIMEOUT.
    let before = f.clients[0].texts().len();
    f.pass(10_000);
    assert!(close(&f) && f.world.snapshot().vehicles[0].mode == "GUIDED");
    assert_eq!(f.clients[0].texts().len(), before);
    let [_, x, y, _] = f.world.snapshot().vehicles[0].nominal_attitude_wxyz;
    assert!(x.hypot(y) < 0.01);
    f.clients[0].command(&mut f.world, MavCmd::MAV_CMD_NAV_LAND, &[]);
    f.pass(40_000);
    let end = f.world.snapshot().vehicles[0].clone();
    assert!(end.landed && !end.armed, "{end:?}");
}

#[test]
fn spec_every_command_is_answered() {
    let mut f = Flight::new(config());
    f.pass(100);
    for command in [MavCmd::MAV_CMD_DO_SET_SERVO, MavCmd::MAV_CMD_USER_2, MavCmd::MAV_CMD_NAV_WAYPOINT] {
        f.clients[0].command(&mut f.world, command, &[]);
        f.pass(10);
        assert_eq!(f.clients[0].last_ack(command).unwrap().result, MavResult::MAV_RESULT_UNSUPPORTED);
    }
    let long = MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
        command: MavCmd::MAV_CMD_USER_1,
        target_system: 1,
        target_component: 68,
        ..COMMAND_LONG_DATA::DEFAULT
    });
    f.clients[0].send(&mut f.world, &long);
    f.pass(10);
    let ack = f.clients[0].last_ack(MavCmd::MAV_CMD_USER_1).unwrap();
    assert_eq!(ack.result, MavResult::MAV_RESULT_COMMAND_INT_ONLY);
    f.clients[0].power(&mut f.world, 20.25, 3, 300);
    f.pass(10);
    let ack = f.clients[0].last_ack(MavCmd::MAV_CMD_USER_1).unwrap();
    assert_eq!((ack.result, ack.result_param2), (MavResult::MAV_RESULT_ACCEPTED, 20_250));
}

#[test]
fn spec_both_components_tell_their_parameters() {
    let mut f = Flight::new(config());
    f.pass(100);
    f.clients[0].send(
        &mut f.world,
        &MavMessage::PARAM_REQUEST_LIST(PARAM_REQUEST_LIST_DATA { target_system: 1, target_component: 0 }),
    );
    f.pass(500);
    for component in [1u8, 68] {
        let values: Vec<_> = f.clients[0]
            .received
            .iter()
            .filter_map(|(c, m)| match m {
                MavMessage::PARAM_VALUE(v) if *c == component => Some(v.clone()),
                _ => None,
            })
            .collect();
        assert_eq!(values.len(), usize::from(values[0].param_count));
        assert!(values.iter().enumerate().all(|(k, v)| usize::from(v.param_index) == k));
    }
}

#[test]
fn val_origins_differ_and_positions_agree() {
    let mut f = Flight::new(config());
    f.pass(2000);
    let mut seen = Vec::new();
    for k in 0..2 {
        let request = MavCmd::MAV_CMD_REQUEST_MESSAGE;
        f.clients[k].command(&mut f.world, request, &[GPS_GLOBAL_ORIGIN_ID]);
        f.pass(20);
        let origin = f.clients[k].last(|m| match m {
            MavMessage::GPS_GLOBAL_ORIGIN(o) => Some((o.latitude, o.longitude, o.altitude)),
            _ => None,
        });
        let local = f.clients[k].last(|m| match m {
            MavMessage::LOCAL_POSITION_NED(p) => Some([p.x, p.y, p.z]),
            _ => None,
        });
        seen.push((origin.unwrap(), local.unwrap()));
    }
    assert_ne!(seen[0].0, seen[1].0);
    // At rest at home, its own origin lies the configured offset away: (3, -2, 0.5) and (-1, 4, 0), ENU.
    let near = |a: [f32; 3], b: [f32; 3]| a.iter().zip(b).all(|(x, y)| (x - y).abs() < 0.02);
    assert!(near(seen[0].1, [2.0, -3.0, 0.5]), "{:?}", seen[0].1);
    assert!(near(seen[1].1, [-4.0, 1.0, 0.0]), "{:?}", seen[1].1);
    // I's origin lies at (-27, 8) of the mission: 8 m north at 111.2 km and 27 m west at 71.5 km a degree.
    let ((lat, lon, alt), _) = seen[0];
    assert!((f64::from(lat) / 1e7 - 50.0755 - 8.0 / 111_230.0).abs() < 2e-7);
    assert!((f64::from(lon) / 1e7 - 14.4378 + 27.0 / 71_560.0).abs() < 2e-7, "{lon}");
    assert_eq!(alt, 200_500);
}

const GPS_GLOBAL_ORIGIN_ID: f32 = 49.0;

#[test]
fn spec_intervals_are_per_link() {
    let mut f = Flight::new(config());
    let mut gcs = Client::ground_station(0, 2);
    gcs.send(&mut f.world, &MavMessage::HEARTBEAT(HEARTBEAT_DATA::DEFAULT));
    f.clients[0].command(&mut f.world, MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL, &[32.0, 20_000.0]);
    f.clients[0].received.clear();
    pass(&mut f.world, &mut [&mut f.clients[0], &mut gcs], 10_000);
    let count = |client: &Client| {
        client.received.iter().filter(|(_, m)| matches!(m, MavMessage::LOCAL_POSITION_NED(_))).count()
    };
    assert!((count(&f.clients[0]) as i32 - 500).abs() <= 1, "{}", count(&f.clients[0]));
    assert!((count(&gcs) as i32 - 40).abs() <= 1, "{}", count(&gcs));
    // The ground station hears the companion's broadcasts, and may speak to it.
    f.clients[0].send(&mut f.world, &MavMessage::HEARTBEAT(HEARTBEAT_DATA::DEFAULT));
    gcs.received.clear();
    pass(&mut f.world, &mut [&mut f.clients[0], &mut gcs], 1);
    assert!(gcs.received.iter().any(|(component, _)| *component == 191));
}

#[test]
fn spec_time_is_answered() {
    let mut f = Flight::new(config());
    f.pass(2500);
    f.clients[0]
        .send(&mut f.world, &MavMessage::TIMESYNC(TIMESYNC_DATA { ts1: 424_242, ..TIMESYNC_DATA::DEFAULT }));
    f.pass(1000);
    let reply = f.clients[0].last(|m| match m {
        MavMessage::TIMESYNC(t) => Some((t.tc1, t.ts1, t.target_component)),
        _ => None,
    });
    assert_eq!(reply, Some((2_500_000_000, 424_242, 191)));
    let time = f.clients[0].last(|m| match m {
        MavMessage::SYSTEM_TIME(t) => Some(t.time_unix_usec - u64::from(t.time_boot_ms) * 1000),
        _ => None,
    });
    assert_eq!(time, Some(f.config.utc_start_us));
}

#[test]
fn spec_faults_show_on_the_wire() {
    let mut f = Flight::new(config());
    f.take_off();
    f.world.inject(Fault::EstimatorFailure { vehicle: 0 });
    f.world.inject(Fault::PilotMode { vehicle: 1 });
    let goals = f.goals(0);
    f.stream(2000, goals, None, |_| {});
    assert_eq!(f.clients[0].heartbeat().custom_mode, 0x0604_0000);
    assert_eq!(f.clients[1].heartbeat().custom_mode, 3 << 16);
    let flags = f.clients[0].last(|m| match m {
        MavMessage::ESTIMATOR_STATUS(e) => Some(e.flags.bits()),
        _ => None,
    });
    // The attitude, and a position that is assumed.
    assert_eq!(flags, Some(1 | 128));
    f.world.inject(Fault::LinkLoss { vehicle: 0, on: true });
    f.clients[0].received.clear();
    f.stream(2000, goals, None, |_| {});
    assert!(f.clients[0].received.is_empty());
    f.world.inject(Fault::LinkLoss { vehicle: 0, on: false });
    f.pass(1000);
    assert!(!f.clients[0].received.is_empty());
}

#[test]
fn spec_a_silent_lease_falls_to_off_by_itself() {
    let mut f = Flight::new(config());
    f.pass(1001);
    f.clients[1].power(&mut f.world, 10.0, 0, 250);
    f.pass(249);
    assert!(f.world.snapshot().vehicles[1].tx_power_w.is_some());
    f.pass(1);
    assert_eq!(f.world.snapshot().vehicles[1].tx_power_w, None);
}

#[test]
fn spec_an_armed_vehicle_on_the_ground_disarms_itself() {
    let mut f = Flight::new(config());
    f.pass(3000);
    f.clients[0].command(&mut f.world, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, &[1.0]);
    f.pass(9900);
    assert!(f.world.snapshot().vehicles[0].armed);
    f.pass(200);
    assert!(!f.world.snapshot().vehicles[0].armed);
}

#[test]
fn spec_disarming_in_the_air_is_refused() {
    let mut f = Flight::new(config());
    f.take_off();
    f.clients[0].command(&mut f.world, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, &[0.0]);
    f.pass(20);
    assert!(f.world.snapshot().vehicles[0].armed);
    f.clients[0].command(&mut f.world, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, &[0.0, 21_196.0]);
    f.pass(4000);
    let fallen = f.world.snapshot().vehicles[0].clone();
    assert!(!fallen.armed && fallen.landed, "{fallen:?}");
}

#[test]
fn spec_px4_takes_off_by_command_and_then_holds() {
    let mut f = Flight::new(config());
    f.pass(3000);
    // 12 m above J's home, which is 1 m above the mission's origin at 200 m.
    f.clients[1].command(&mut f.world, MavCmd::MAV_CMD_NAV_TAKEOFF, &[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 213.0]);
    f.clients[1].command(&mut f.world, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, &[1.0]);
    f.pass(3000);
    assert_eq!(f.clients[1].heartbeat().custom_mode, 0x0204_0000);
    f.pass(15_000);
    assert_eq!(f.clients[1].heartbeat().custom_mode, 0x0304_0000);
    assert!((f.position(1)[2] - 13.0).abs() < 0.05, "{:?}", f.position(1));
}

/// DO_REPOSITION from where the vehicle is: 1798e-7 deg of latitude, 20 m, north of it, `up_m` higher.
fn reposition(f: &mut Flight, frame: MavFrame, base_m: f64, up_m: f64, change_mode: f32) -> MavResult {
    let here = f.clients[0]
        .last(|m| match m {
            MavMessage::GLOBAL_POSITION_INT(m) => Some(m.clone()),
            _ => None,
        })
        .unwrap();
    let command = MavCmd::MAV_CMD_DO_REPOSITION;
    let message = MavMessage::COMMAND_INT(COMMAND_INT_DATA {
        target_system: 1,
        target_component: 1,
        frame,
        command,
        param1: -1.0,
        param2: change_mode,
        param4: f32::NAN,
        x: here.lat + 1798,
        y: here.lon,
        z: (f64::from(here.alt) / 1000.0 - base_m + up_m) as f32,
        ..COMMAND_INT_DATA::DEFAULT
    });
    f.clients[0].send(&mut f.world, &message);
    f.pass(20);
    f.clients[0].last_ack(command).unwrap().result
}

#[test]
fn spec_reposition_flies_to_the_point_in_each_firmwares_way() {
    let (amsl, relative) = (MavFrame::MAV_FRAME_GLOBAL_INT, MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT);
    let mut f = Flight::new(config());
    f.take_off();
    assert_eq!(reposition(&mut f, amsl, 0.0, 5.0, 0.0), MavResult::MAV_RESULT_UNSUPPORTED, "no mode change");
    assert_eq!(reposition(&mut f, amsl, 0.0, 5.0, 1.0), MavResult::MAV_RESULT_ACCEPTED);
    f.pass(15_000);
    let [east, north, up] = f.position(0);
    let [e, n, u] = f.config.vehicles[0].home_enu_m;
    assert!((north - n - 20.0).abs() < 0.3 && (east - e).abs() < 0.3 && (up - u - 30.0).abs() < 0.3);
    assert_eq!(f.world.snapshot().vehicles[0].mode, "HOLD");

    let mut f = Flight::new(arducopter());
    f.pass(3000);
    assert_eq!(reposition(&mut f, relative, 200.0, 0.0, 0.0), MavResult::MAV_RESULT_DENIED, "not in GUIDED");
    assert_eq!(reposition(&mut f, relative, 200.0, 0.0, 1.0), MavResult::MAV_RESULT_FAILED, "on the ground");
    f.clients[0].command(&mut f.world, MavCmd::MAV_CMD_DO_SET_MODE, &[1.0, 4.0]);
    f.clients[0].command(&mut f.world, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, &[1.0]);
    f.clients[0].command(&mut f.world, MavCmd::MAV_CMD_NAV_TAKEOFF, &[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 25.0]);
    f.pass(12_000);
    // BRAKE stops it; the point takes it back into GUIDED if the command says so.
    f.clients[0].command(&mut f.world, MavCmd::MAV_CMD_DO_SET_MODE, &[1.0, 17.0]);
    f.pass(1000);
    assert_eq!(f.clients[0].heartbeat().custom_mode, 17);
    assert_eq!(reposition(&mut f, relative, 200.0, 5.0, 0.0), MavResult::MAV_RESULT_DENIED);
    assert_eq!(reposition(&mut f, relative, 200.0, 5.0, 1.0), MavResult::MAV_RESULT_ACCEPTED);
    f.pass(15_000);
    let [east, north, up] = f.position(0);
    let [e, n, u] = f.config.vehicles[0].home_enu_m;
    assert!((north - n - 20.0).abs() < 0.3 && (east - e).abs() < 0.3 && (up - u - 30.0).abs() < 0.3);
    assert_eq!(f.world.snapshot().vehicles[0].mode, "GUIDED");
}

#[test]
fn spec_a_file_that_is_not_there_is_refused_and_not_ignored() {
    let mut f = Flight::new(config());
    // Sequence 41, session 7, open for reading (4), a path.
    for (opcode, answer) in
        [(4, [42, 0, 7, 129, 1, 4, 10]), (14, [42, 0, 7, 129, 1, 14, 7]), (2, [42, 0, 7, 128, 0, 2, 0])]
    {
        let mut payload = [0; 251];
        payload[..4].copy_from_slice(&[41, 0, 7, opcode]);
        let request =
            FILE_TRANSFER_PROTOCOL_DATA { target_network: 0, target_system: 1, target_component: 1, payload };
        f.clients[0].send(&mut f.world, &MavMessage::FILE_TRANSFER_PROTOCOL(request));
        f.pass(20);
        let said = f.clients[0].last(|m| match m {
            MavMessage::FILE_TRANSFER_PROTOCOL(m) => Some(m.payload),
            _ => None,
        });
        let said = said.unwrap();
        assert_eq!([said[0], said[1], said[2], said[3], said[4], said[5], said[12]], answer);
    }
}
