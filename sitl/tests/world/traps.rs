//! The firmwares' traps, on and off: the README's table names the tests here.

use crate::common::*;
use mavlink::dialects::ardupilotmega::*;
use veilwing_sitl::*;

fn of(firmware: Firmware, set: impl Fn(&mut Traps)) -> WorldConfig {
    let mut config = config();
    for vehicle in &mut config.vehicles {
        vehicle.firmware = firmware;
        set(&mut vehicle.traps);
    }
    config
}

fn copter(set: impl Fn(&mut Traps)) -> WorldConfig {
    of(Firmware::ArduCopter, set)
}

/// Vehicle 0 of ArduCopter in GUIDED, 25 m above home.
fn guided(config: WorldConfig) -> Flight {
    let mut f = Flight::new(config);
    f.pass(3000);
    f.clients[0].command(&mut f.world, MavCmd::MAV_CMD_DO_SET_MODE, &[1.0, 4.0]);
    f.clients[0].command(&mut f.world, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, &[1.0]);
    let climb = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 25.0];
    f.clients[0].command(&mut f.world, MavCmd::MAV_CMD_NAV_TAKEOFF, &climb);
    f.pass(14_000);
    assert!((f.position(0)[2] - 25.0).abs() < 0.5, "{:?}", f.position(0));
    f
}

fn mode(f: &Flight) -> &'static str {
    f.world.snapshot().vehicles[0].mode
}

fn speed(f: &Flight) -> f64 {
    f.world.snapshot().vehicles[0].velocity_enu_m_s.iter().map(|v| v * v).sum::<f64>().sqrt()
}

fn attitude(q: [f32; 4], mask: u8, thrust: f32) -> MavMessage {
    MavMessage::SET_ATTITUDE_TARGET(SET_ATTITUDE_TARGET_DATA {
        q,
        type_mask: AttitudeTargetTypemask::from_bits_truncate(mask),
        thrust,
        thrust_body: [9.0, 9.0, 9.0],
        target_system: 1,
        target_component: 1,
        ..SET_ATTITUDE_TARGET_DATA::DEFAULT
    })
}

/// Level, facing north.
const NORTH: [f32; 4] = [1.0, 0.0, 0.0, 0.0];

#[test]
fn spec_offboard_is_acknowledged_without_a_stream() {
    for (trap, result) in
        [(true, MavResult::MAV_RESULT_ACCEPTED), (false, MavResult::MAV_RESULT_TEMPORARILY_REJECTED)]
    {
        let mut f = Flight::new(of(Firmware::Px4, |t| t.ack_without_stream = trap));
        f.pass(3000);
        f.clients[0].command(&mut f.world, MavCmd::MAV_CMD_DO_SET_MODE, &[1.0, 6.0]);
        f.pass(10);
        assert_eq!(f.clients[0].last_ack(MavCmd::MAV_CMD_DO_SET_MODE).unwrap().result, result);
    }
}

#[test]
fn spec_a_resumed_stream_takes_the_vehicle_back() {
    for (trap, after) in [(true, "OFFBOARD"), (false, "HOLD")] {
        let mut f = Flight::new(of(Firmware::Px4, |t| t.resume_takes_over = trap));
        f.take_off();
        f.pass(1500);
        assert_eq!(mode(&f), "HOLD");
        let goals = f.goals(0);
        f.stream(1500, goals, None, |_| {});
        assert_eq!(mode(&f), after);
    }
}

#[test]
fn spec_a_lost_stream_that_is_left_to_missing_sticks_drifts_away_and_down() {
    for (trap, least_m, most_m) in [(true, 12.0, 18.0), (false, 0.0, 1.0)] {
        let mut f = Flight::new(of(Firmware::Px4, |t| t.sticks_missing = trap));
        f.take_off();
        f.set_int("COM_OBL_RC_ACT", 0);
        let [e, n, up] = f.position(0);
        f.pass(11_000);
        let [e2, n2, up2] = f.position(0);
        let sideways_m = (e2 - e).hypot(n2 - n);
        assert!((least_m..most_m).contains(&sideways_m), "trap {trap}: {sideways_m} m");
        assert!(up - up2 > 4.0, "down it comes in either case");
        assert_eq!(mode(&f) == "LAND", !trap, "{}", mode(&f));
    }
}

#[test]
fn spec_px4_goes_back_to_offboard_after_a_landing() {
    for (trap, after) in [(true, "OFFBOARD"), (false, "LAND")] {
        let mut f = Flight::new(of(Firmware::Px4, |t| t.armable_mode_returns = trap));
        f.take_off();
        f.clients[0].command(&mut f.world, MavCmd::MAV_CMD_NAV_LAND, &[]);
        while f.world.snapshot().vehicles[0].armed {
            f.pass(100);
        }
        f.pass(500);
        assert_eq!(mode(&f), "LAND");
        f.pass(1000);
        assert_eq!(mode(&f), after);
    }
}

#[test]
fn spec_the_battery_of_px4_in_simulation_falls_to_its_floor_while_armed_and_is_full_again_after() {
    let told = |f: &Flight| {
        f.clients[0].last(|m| match m {
            MavMessage::SYS_STATUS(s) => Some(s.battery_remaining),
            _ => None,
        })
    };
    let mut f = Flight::new(of(Firmware::Px4, |t| t.simulated_battery = true));
    f.pass(5000);
    assert_eq!(told(&f), Some(100));
    f.take_off();
    let goals = f.goals(0);
    f.stream(40_000, goals, None, |_| {});
    assert_eq!(told(&f), Some(50));
    f.clients[0].command(&mut f.world, MavCmd::MAV_CMD_NAV_LAND, &[]);
    while f.world.snapshot().vehicles[0].armed {
        f.pass(100);
    }
    f.pass(1500);
    assert_eq!(told(&f), Some(100));
}

#[test]
fn spec_px4_calls_itself_at_rest_for_a_second_after_lift_off() {
    let mut f = Flight::new(of(Firmware::Px4, |_| {}));
    f.take_off();
    let received = || f.clients[0].received.iter().map(|(_, message)| message);
    let lifted_off_ms = received().find_map(|m| match m {
        MavMessage::LOCAL_POSITION_NED(m) if m.vz < -0.5 => Some(m.time_boot_ms),
        _ => None,
    });
    let lifted_off_ms = u64::from(lifted_off_ms.unwrap());
    for message in received() {
        let MavMessage::ESTIMATOR_STATUS(m) = message else { continue };
        assert!(m.flags.contains(EstimatorStatusFlags::ESTIMATOR_POS_HORIZ_ABS));
        let at_rest = m.flags.contains(EstimatorStatusFlags::ESTIMATOR_CONST_POS_MODE);
        match m.time_usec / 1000 {
            // It stands.
            ms if 1000 < ms && ms < lifted_off_ms => assert!(at_rest, "{ms}"),
            ms if ms > lifted_off_ms + 1500 => assert!(!at_rest, "{ms}"),
            _ => {}
        }
    }
    let lags = received().any(|m| {
        matches!(m, MavMessage::ESTIMATOR_STATUS(m) if m.time_usec / 1000 >= lifted_off_ms
            && m.flags.contains(EstimatorStatusFlags::ESTIMATOR_CONST_POS_MODE))
    });
    assert!(lags);
}

#[test]
fn spec_a_receiver_that_talks_is_called_healthy_without_a_fix() {
    for firmware in [Firmware::Px4, Firmware::ArduCopter] {
        for set in [true, false] {
            let mut f = Flight::new(of(firmware, |traps| traps.gps_health_is_talk = set));
            f.pass(3000);
            f.world.inject(Fault::GpsLoss { vehicle: 0, on: true });
            f.pass(2000);
            let healthy = f.clients[0].last(|m| match m {
                MavMessage::SYS_STATUS(m) => Some(
                    m.onboard_control_sensors_health.contains(MavSysStatusSensor::MAV_SYS_STATUS_SENSOR_GPS),
                ),
                _ => None,
            });
            let fix = f.clients[0].last(|m| match m {
                MavMessage::GPS_RAW_INT(m) => Some(m.fix_type),
                _ => None,
            });
            assert_eq!(fix, Some(GpsFixType::GPS_FIX_TYPE_NO_FIX), "{firmware:?}");
            assert_eq!(healthy, Some(set), "{firmware:?}");
        }
    }
}

#[test]
fn spec_a_mode_is_acknowledged_and_not_taken() {
    for (firmware, number) in [(Firmware::Px4, 6.0), (Firmware::ArduCopter, 4.0)] {
        let mut f = Flight::new(of(firmware, |t| t.mode_ack_alone = true));
        f.pass(3000);
        for taken in [false, true] {
            f.clients[0].command(&mut f.world, MavCmd::MAV_CMD_DO_SET_MODE, &[1.0, number]);
            f.pass(10);
            let ack = f.clients[0].last_ack(MavCmd::MAV_CMD_DO_SET_MODE).unwrap();
            assert_eq!(ack.result, MavResult::MAV_RESULT_ACCEPTED);
            assert_eq!(f.world.snapshot().vehicles[0].companion_controlled, taken);
        }
    }
}

#[test]
fn spec_setpoints_before_guided_count_for_nothing() {
    for (trap, taken) in [(true, 0), (false, 1)] {
        let mut f = Flight::new(copter(|t| t.guided_first = trap));
        f.pass(3000);
        let goals = f.goals(0);
        f.target(0, goals[0], None);
        assert_eq!(f.world.counters()[0].setpoints.accepted, taken);
    }
}

#[test]
fn spec_a_position_target_is_kept_for_ever() {
    for (trap, kept) in [(true, true), (false, false)] {
        let mut f = guided(copter(|t| t.position_kept = trap));
        let [e, n, _] = f.config.vehicles[0].home_enu_m;
        let far = [e + 60.0, n, 40.0];
        f.target(0, far, None);
        f.pass(30_000);
        assert_eq!((f.position(0)[0] - far[0]).abs() < 0.5, kept, "{:?}", f.position(0));
        assert!(speed(&f) < 0.1);
    }
}

/// Streams a target that goes 60 m east at up to 8 m/s and slows down with 2.5 m/s^2, with its velocity and, if it
/// `tells`, its acceleration. How far past the end the vehicle comes.
fn flown_past_m(f: &mut Flight, tells: bool) -> f64 {
    let [from, n, u] = f.position(0);
    let (ramp, lasts) = (3.2, 10.7);
    let mut furthest = f64::MIN;
    for k in 0..900 {
        let t = f64::from(k) * 0.02;
        let left = (lasts - t).max(0.0);
        let (p, v, a) = if t < ramp {
            (1.25 * t * t, 2.5 * t, 2.5)
        } else if left > ramp {
            (12.8 + 8.0 * (t - ramp), 8.0, 0.0)
        } else {
            (60.0 - 1.25 * left * left, 2.5 * left, if left > 0.0 { -2.5 } else { 0.0 })
        };
        let vehicle = &f.config.vehicles[0];
        let MavMessage::SET_POSITION_TARGET_LOCAL_NED(mut target) =
            position_target(vehicle, [from + p, n, u], Some([v, 0.0, 0.0]))
        else {
            unreachable!()
        };
        if tells {
            target.afy = a as f32;
            target.type_mask = PositionTargetTypemask::from_bits_truncate(2048 | 1024);
        }
        f.clients[0].send(&mut f.world, &MavMessage::SET_POSITION_TARGET_LOCAL_NED(target));
        f.pass(20);
        furthest = furthest.max(f.position(0)[0]);
    }
    furthest - (from + 60.0)
}

#[test]
fn spec_a_target_that_does_not_say_how_it_slows_down_is_flown_past() {
    for (trap, tells, least, most) in
        [(true, false, 1.5, 15.0), (true, true, -0.1, 0.5), (false, false, -0.1, 0.5)]
    {
        let mut f = guided(copter(|t| t.targets_shaped = trap));
        let past_m = flown_past_m(&mut f, tells);
        assert!((least..=most).contains(&past_m), "trap {trap}, told {tells}: {past_m} m");
    }
}

#[test]
fn spec_an_orphan_flies_on_with_its_last_velocity_until_guid_timeout() {
    for (trap, timeout_s, least_m, most_m) in
        [(true, 3.0, 12.0, 18.0), (true, 1.0, 4.0, 8.0), (false, 3.0, 0.0, 3.0)]
    {
        let mut f = guided(copter(|t| t.velocity_kept = trap));
        f.set_real("GUID_TIMEOUT", timeout_s);
        let [e, n, u] = f.position(0);
        for k in 0..300 {
            let t = f64::from(k) * 0.02;
            let target = position_target(&f.config.vehicles[0], [e + 5.0 * t, n, u], Some([5.0, 0.0, 0.0]));
            f.clients[0].send(&mut f.world, &target);
            f.pass(20);
        }
        let left_at = f.position(0)[0];
        f.pass(20_000);
        let went_m = f.position(0)[0] - left_at;
        assert!((least_m..most_m).contains(&went_m), "trap {trap}, {timeout_s} s: {went_m} m");
        assert!(speed(&f) < 0.1);
    }
}

#[test]
fn spec_one_ignored_axis_drops_the_group() {
    for (trap, taken) in [(true, 0), (false, 1)] {
        let mut f = guided(copter(|t| t.whole_groups = trap));
        let goals = f.goals(0);
        let MavMessage::SET_POSITION_TARGET_LOCAL_NED(mut target) =
            position_target(&f.config.vehicles[0], goals[0], None)
        else {
            unreachable!()
        };
        target.type_mask |= PositionTargetTypemask::POSITION_TARGET_TYPEMASK_X_IGNORE;
        f.clients[0].send(&mut f.world, &MavMessage::SET_POSITION_TARGET_LOCAL_NED(target));
        assert_eq!(f.world.counters()[0].setpoints.accepted, taken);
    }
}

#[test]
fn spec_a_target_in_an_odd_frame_stops_the_vehicle() {
    for (trap, stops) in [(true, true), (false, false)] {
        let mut f = guided(copter(|t| t.odd_frame_stops = trap));
        let [e, n, _] = f.config.vehicles[0].home_enu_m;
        let far = [e + 300.0, n, 40.0];
        f.target(0, far, None);
        f.pass(6000);
        assert!(speed(&f) > 5.0);
        let MavMessage::SET_POSITION_TARGET_LOCAL_NED(mut target) =
            position_target(&f.config.vehicles[0], far, None)
        else {
            unreachable!()
        };
        target.coordinate_frame = MavFrame::MAV_FRAME_GLOBAL;
        f.clients[0].send(&mut f.world, &MavMessage::SET_POSITION_TARGET_LOCAL_NED(target));
        f.pass(6000);
        assert_eq!(speed(&f) < 0.2, stops, "{}", speed(&f));
        assert_eq!(f.clients[0].texts().iter().filter(|t| t.contains("frame")).count(), 0, "in silence");
    }
}

#[test]
fn spec_intervals_above_the_loop_rate_are_refused() {
    let interval = MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL;
    for (trap, result) in [(true, MavResult::MAV_RESULT_DENIED), (false, MavResult::MAV_RESULT_ACCEPTED)] {
        let mut f = Flight::new(copter(|t| t.fast_interval_refused = trap));
        f.pass(100);
        f.clients[0].command(&mut f.world, interval, &[32.0, 1000.0]);
        f.pass(10);
        assert_eq!(f.clients[0].last_ack(interval).unwrap().result, result);
    }
}

#[test]
fn spec_unknown_parameters_get_silence() {
    for firmware in [Firmware::Px4, Firmware::ArduCopter] {
        for (trap, words) in [(true, 0), (false, 1)] {
            let mut f = Flight::new(of(firmware, |t| t.silent_unknown_parameter = trap));
            f.pass(100);
            f.clients[0].received.clear();
            f.set_real("NO_SUCH_THING", 1.0);
            f.pass(10);
            assert_eq!(f.clients[0].texts().len(), words);
        }
    }
}

#[test]
fn spec_a_quaternion_ends_a_six_dof_autopilot() {
    for (trap, panics) in [(true, true), (false, false)] {
        let mut f = guided(copter(|t| t.six_dof_panics = trap));
        f.set_real("FRAME_CLASS", 16.0);
        let before = f.position(0)[2];
        f.clients[0].send(&mut f.world, &attitude(NORTH, 7 | 64, 0.0));
        f.pass(1000);
        f.clients[0].received.clear();
        f.pass(3000);
        assert_eq!(before - f.position(0)[2] > 10.0, panics);
        let spoken = f.clients[0].received.iter().filter(|(component, _)| *component == 1).count();
        assert_eq!(spoken == 0, panics);
    }
}

#[test]
fn spec_body_offsets_of_a_six_dof_frame_come_through_its_script() {
    let mut f = guided(copter(|_| {}));
    let (angles, switch) = (MavCmd::MAV_CMD_USER_4, MavCmd::MAV_CMD_USER_5);
    f.clients[0].command(&mut f.world, angles, &[40.0, 0.0]);
    f.pass(10);
    assert_eq!(f.clients[0].last_ack(angles).unwrap().result, MavResult::MAV_RESULT_UNSUPPORTED);
    f.set_real("FRAME_CLASS", 16.0);
    f.clients[0].command(&mut f.world, angles, &[40.0, 0.0]);
    f.clients[0].command(&mut f.world, switch, &[1.0]);
    f.pass(5000);
    // A roll of 40 degrees is a half angle whose sine is 0.342, about the body's x.
    let tilt = |f: &Flight| {
        let [_, x, y, _] = f.world.snapshot().vehicles[0].nominal_attitude_wxyz;
        x.hypot(y)
    };
    assert!((tilt(&f) - 20f64.to_radians().sin()).abs() < 0.01, "{}", tilt(&f));
    // Another mode levels it, and coming back does not tilt it again.
    f.clients[0].command(&mut f.world, MavCmd::MAV_CMD_DO_SET_MODE, &[1.0, 5.0]);
    f.pass(3000);
    f.clients[0].command(&mut f.world, MavCmd::MAV_CMD_DO_SET_MODE, &[1.0, 4.0]);
    f.pass(3000);
    assert!(tilt(&f) < 0.01);
}

#[test]
fn spec_a_burst_of_commands_ends_the_bridge_script_and_its_guard_goes_level() {
    let (angles, switch) = (MavCmd::MAV_CMD_USER_4, MavCmd::MAV_CMD_USER_5);
    for (dies, unguarded) in [(false, false), (true, false), (true, true)] {
        let mut f = guided(copter(|t| (t.script_dies_of_bursts, t.script_without_guard) = (dies, unguarded)));
        f.set_real("FRAME_CLASS", 16.0);
        f.clients[0].command(&mut f.world, angles, &[40.0, 0.0]);
        f.clients[0].command(&mut f.world, switch, &[1.0]);
        f.pass(5000);
        let tilt_deg = |f: &Flight| {
            let [_, x, y, _] = f.world.snapshot().vehicles[0].nominal_attitude_wxyz;
            2.0 * x.hypot(y).asin().to_degrees()
        };
        for _ in 0..10 {
            f.clients[0].command(&mut f.world, MavCmd::MAV_CMD_REQUEST_MESSAGE, &[242.0]);
        }
        f.pass(20);
        f.clients[0].received.clear();
        f.clients[0].command(&mut f.world, angles, &[40.0, 0.0]);
        f.pass(2500);
        assert_eq!(f.clients[0].last_ack(angles).is_none(), dies, "nobody answers");
        // Another mode levels it, where somebody lives to do it.
        let tilts = [tilt_deg(&f), {
            f.clients[0].command(&mut f.world, MavCmd::MAV_CMD_DO_SET_MODE, &[1.0, 9.0]);
            f.pass(3000);
            tilt_deg(&f)
        }];
        let wanted = if unguarded {
            [40.0, 40.0]
        } else if dies {
            [0.0, 0.0]
        } else {
            [40.0, 0.0]
        };
        assert!(tilts.iter().zip(wanted).all(|(t, w)| (t - w).abs() < 1.0), "{dies} {unguarded}: {tilts:?}");
    }
}

#[test]
fn spec_stock_attitude_targets_climb_and_drift() {
    let mut f = guided(copter(|t| t.angle_control = true));
    let start = f.position(0);
    // Nose down by 8 degrees, facing north, at 0.5: it goes north at its height.
    let half = 4f32.to_radians();
    let lean = [half.cos(), 0.0, -half.sin(), 0.0];
    for _ in 0..150 {
        f.clients[0].send(&mut f.world, &attitude(lean, 7, 0.5));
        f.pass(20);
    }
    let moved: [f64; 3] = std::array::from_fn(|k| f.position(0)[k] - start[k]);
    assert!(moved[1] > 3.0 && moved[0].abs() < 0.5 && moved[2].abs() < 0.5, "{moved:?}");
    // 0.75 is half of the climb speed of 6 m/s.
    for _ in 0..150 {
        f.clients[0].send(&mut f.world, &attitude(NORTH, 7, 0.75));
        f.pass(20);
    }
    assert!((f.world.snapshot().vehicles[0].velocity_enu_m_s[2] - 3.0).abs() < 0.2);
    // GUID_OPTIONS bit 3: the same number is thrust, far more than it weighs.
    f.set_real("GUID_OPTIONS", 8.0);
    for _ in 0..50 {
        f.clients[0].send(&mut f.world, &attitude(NORTH, 7, 0.75));
        f.pass(20);
    }
    assert!(f.world.snapshot().vehicles[0].velocity_enu_m_s[2] > 8.0);
    f.set_real("GUID_OPTIONS", 0.0);
    // GUID_TIMEOUT later it is level and drifts.
    f.pass(8000);
    assert_eq!(mode(&f), "GUIDED");
    assert!(f.world.snapshot().vehicles[0].velocity_enu_m_s[2].abs() < 0.2 && speed(&f) > 0.5);
}

#[test]
fn spec_a_quaternion_of_another_length_stops_the_vehicle_silently() {
    for (q, mask) in [([2.0, 0.0, 0.0, 0.0], 7), (NORTH, 7 | 64)] {
        let mut f = guided(copter(|t| t.angle_control = true));
        let [e, n, _] = f.config.vehicles[0].home_enu_m;
        f.target(0, [e + 300.0, n, 40.0], None);
        f.pass(6000);
        assert!(speed(&f) > 5.0);
        let words = f.clients[0].texts().len();
        f.clients[0].send(&mut f.world, &attitude(q, mask, 0.5));
        f.pass(6000);
        assert!(speed(&f) < 0.2 && f.clients[0].texts().len() == words, "{}", speed(&f));
    }
}

#[test]
fn spec_a_missing_ground_station_ends_guided_whatever_the_companion_sends() {
    for (enabled, after) in [(1.0, "RTL"), (0.0, "GUIDED")] {
        let mut f = guided(copter(|_| {}));
        f.set_real("FS_GCS_ENABLE", enabled);
        let mut gcs = Client::ground_station(0, 2);
        let heartbeat = HEARTBEAT_DATA { mavtype: MavType::MAV_TYPE_GCS, ..HEARTBEAT_DATA::DEFAULT };
        let goals = f.goals(0);
        for _ in 0..4 {
            gcs.send(&mut f.world, &MavMessage::HEARTBEAT(heartbeat.clone()));
            f.stream(1000, goals, None, |_| {});
        }
        f.stream(3900, goals, None, |_| {});
        assert_eq!(mode(&f), "GUIDED");
        f.stream(300, goals, None, |_| {});
        assert_eq!(mode(&f), after);
    }
}
