//! The adapter against scripted autopilots that do what real programs were seen to do.

mod bridge;
mod control;
mod fake;
mod firmwares;
mod hearing;
mod omnicopter;
mod parameters;
mod world;

use std::time::Duration;

use fake::*;
use mavlink::dialects::ardupilotmega::*;
use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use world::*;

use super::*;
use crate::geo::{Attitude, Enu, EnuAcceleration, EnuVelocity, Ned};

const BOTH: [Firmware; 2] = [Firmware::Px4, Firmware::ArduPilot];

#[test]
fn spec_both_firmwares_take_off_fly_to_a_pose_in_the_missions_frame_and_land() {
    for firmware in BOTH {
        let mut world = World::new(Fake::new(firmware), |settings| settings.planned_tilt_rad = 0.6);
        world.launch();
        let attitude = Attitude::from_euler(0.5, -0.2, 0.0);
        let position_enu_m = Enu::new(30.0, -20.0, 25.0);
        world.setpoint = Some(Setpoint {
            position_enu_m,
            velocity_enu_m_s: EnuVelocity::ZERO,
            acceleration_enu_m_s2: EnuAcceleration::ZERO,
            attitude,
        });
        world.run(130.0);
        // Where it really is, by the autopilot's own origin.
        let frame = world.fake.frame();
        let there = frame.position_to_enu(Ned::from_vector(world.fake.position));
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
fn spec_a_setpoint_goes_out_once_at_the_instant_that_it_is_for() {
    for (actuation, forms) in [(Actuation::Position, 1), (Actuation::Pose, 2), (Actuation::ThrustVector, 1)] {
        let mut fake = Fake::new(Firmware::Px4);
        fake.body = (actuation == Actuation::ThrustVector).then(|| omnicopter::Body::new(Vector3::zeros()));
        let mut world = World::new(fake, |settings| settings.actuation = actuation);
        world.launch();
        let mut moving = world.setpoint.take().unwrap();
        world.run(0.1);
        for pace_ms in [20, 20, 7, 33, 150] {
            moving.position_enu_m.x += 0.3;
            world.autopilot.set_setpoint(moving, world.now);
            // Nothing was due: it is on its way before any timeout.
            let sent: Vec<_> = std::iter::from_fn(|| world.autopilot.poll_transmit()).collect();
            assert_eq!(sent.len(), forms, "{actuation}: {sent:?}");
            let frame = world.fake.frame();
            for message in sent {
                let boot_ms = match message {
                    MavMessage::SET_POSITION_TARGET_LOCAL_NED(target) => {
                        let there = [target.x, target.y, target.z].map(f64::from);
                        let wanted = frame.position_to_ned(moving.position_enu_m).vector();
                        assert!((wanted - Vector3::from(there)).norm() < 1e-4, "{there:?}");
                        target.time_boot_ms
                    }
                    MavMessage::SET_ATTITUDE_TARGET(target) => target.time_boot_ms,
                    other => panic!("{other:?}"),
                };
                assert_eq!(u128::from(boot_ms), world.now.since_start().as_millis());
            }
            let since = world.now;
            world.run(f64::from(pace_ms) * 1e-3);
            assert_eq!(world.fake.setpoints_since(since), 0, "{actuation}: repeated");
        }
    }
}

#[test]
fn spec_setpoints_go_out_at_the_executives_pace_and_never_outlive_it() {
    let mut world = World::new(Fake::new(Firmware::Px4), |settings| settings.actuation = Actuation::Position);
    world.launch();
    let since = world.now;
    world.run(10.0);
    let sent = world.fake.setpoints_since(since);
    assert!((499..=501).contains(&sent), "{sent}");
    world.setpoint = None;
    let stalled = world.now;
    // What was on the wire arrives, and no more.
    world.run(LATENCY.as_secs_f64());
    world.run(0.5);
    assert_eq!(world.fake.setpoints_since(stalled + LATENCY), 0);
    // The autopilot's own failsafe follows, and is reported.
    world.until(3.0, |event| matches!(event, Event::ControlLost { .. }));
    assert_eq!(world.fake.custom_mode, PX4_LOITER);
    // It would go back to OFFBOARD at the next setpoint, by itself: an executive that is back must not cause that.
    world.hold_here();
    world.run(5.0);
    assert_eq!(world.fake.custom_mode, PX4_LOITER);
}

#[test]
fn spec_an_autopilot_that_was_not_heard_gets_setpoints_again_once_it_shows_its_mode() {
    let mut world = World::new(Fake::new(Firmware::Px4), |settings| settings.actuation = Actuation::Position);
    world.launch();
    // One that bears more than a second without setpoints. Its telemetry alone fails, and its heartbeat comes long after: it
    // is asked for one. Setpoints end at 0.25 s, and 1.2 s after that what it shows counts.
    world.fake.parameters.insert("COM_OF_LOSS_T".into(), real(2.0));
    world.fake.beat();
    world.fake.heartbeat_at = world.now + Duration::from_secs(60);
    world.run(0.2);
    world.fake.silent = true;
    world.run(0.88);
    let shut = world.now + LATENCY;
    world.run(0.06);
    assert_eq!(world.fake.setpoints_since(shut), 0, "to an autopilot that may be another's");
    world.fake.silent = false;
    world.run(0.5);
    assert_eq!(world.fake.setpoints_since(shut), 0, "before it showed a mode that counts");
    world.run(0.1);
    assert_eq!(world.fake.custom_mode, PX4_OFFBOARD);
    assert!(world.fake.setpoints_since(shut) > 0);
    let lost = world.events.iter().filter(|(_, event)| matches!(event, Event::ControlLost { .. })).count();
    assert_eq!(lost, 0);
}

#[test]
fn val_the_attitude_turns_at_the_tilt_rate_whatever_the_pace() {
    for rate_hz in [20.0, 50.0, 100.0] {
        let mut world = World::new(Fake::new(Firmware::Px4), |settings| {
            settings.rate_hz = rate_hz;
            settings.planned_tilt_rad = 0.3;
        });
        world.launch();
        let wanted = Attitude::from_euler(1.2, 0.0, 0.0);
        world.setpoint = world.setpoint.map(|setpoint| Setpoint { attitude: wanted, ..setpoint });
        world.run(1.0);
        let turned = Attitude::from_mavlink(world.fake.attitude.map(f64::from)).unwrap().tilt_rad();
        let rate_rad_s = world.autopilot.settings().tilt_rate_rad_s;
        // The wire's delay and one setpoint are missing at most.
        let least = rate_rad_s * (1.0 - LATENCY.as_secs_f64() - 0.005 - 1.0 / rate_hz);
        assert!((least..=rate_rad_s * (1.0 + 1.0 / rate_hz)).contains(&turned), "{rate_hz} Hz: {turned}");
    }
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
        velocity_enu_m_s: EnuVelocity::new(number(10.0), number(10.0), number(10.0)),
        acceleration_enu_m_s2: EnuAcceleration::from_vector(Vector3::from_fn(|_, _| number(5.0))),
        attitude: Attitude::from_euler(number(6.0), number(6.0), number(6.0)),
    }
}
