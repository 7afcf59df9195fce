//! The adapter and the transmitter against the software vehicle, in MAVLink bytes and virtual time: a second opinion
//! on frames, signs and manners, for both firmware faces. Home, local origin and heading all differ from the
//! mission's.

#![cfg(feature = "desk")]
#![allow(clippy::unwrap_used)] // helpers of tests

use std::time::Duration;

use mavlink::dialects::ardupilotmega::{MavMessage, MavSeverity};
use mavlink::{MavHeader, MavlinkVersion, Message};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use veilwing::autopilot::{Actuation, Autopilot, Event, Mode, Setpoint, Settings, Verdict};
use veilwing::geo::{Attitude, Enu, EnuAcceleration, EnuVelocity, Geodetic};
use veilwing::link::Aboard;
use veilwing::schedule::trajectory::{Limits, Start, Trajectory};
use veilwing::time::Instant;
use veilwing::transmitter::{self, Transmitter};
use veilwing_sitl::{
    Airframe, Firmware, JitterConfig, Origin, RadioPlace, Role, SensorConfig, Vehicle, VehicleConfig,
};

const MISSION: Geodetic = Geodetic { lat_deg: 50.0755, lon_deg: 14.4378, alt_m: 200.0 };
const OWN: (u8, u8) = (1, 191);
const STEP: Duration = Duration::from_millis(5);
/// Between two setpoints, which fall half-way between two instants of the vehicle's telemetry.
const TICK_MS: u128 = 20;
const EPOCH_US: u64 = 1_790_000_000_000_000;

struct World {
    now: Duration,
    vehicle: Vehicle,
    autopilot: Autopilot,
    transmitter: Transmitter,
    setpoint: Option<Setpoint>,
    events: Vec<Event>,
    sequence: u8,
}

fn vehicle(firmware: Firmware) -> VehicleConfig {
    VehicleConfig {
        home_enu_m: [-20.0, 35.0, 4.0],
        heading_rad: 0.7,
        local_origin_offset_enu_m: [150.0, -90.0, 6.0],
        airframe: Airframe::Omnidirectional,
        firmware,
        ready_after_s: 12.0,
        ..VehicleConfig::new(Role::I)
    }
}

fn settings(actuation: Actuation) -> Settings {
    let mut settings = Settings::new(OWN, MISSION);
    settings.autopilot_system = Some(1);
    settings.actuation = actuation;
    settings.tracks_pose = true;
    settings.tilt_rate_rad_s = 0.5;
    settings
}

impl World {
    fn new(firmware: Firmware, actuation: Actuation) -> Self {
        Self::with(vehicle(firmware), JitterConfig::default(), settings(actuation))
    }

    fn with(vehicle: VehicleConfig, jitter: JitterConfig, settings: Settings) -> Self {
        let mission =
            Origin { lat_deg: MISSION.lat_deg, lon_deg: MISSION.lon_deg, alt_amsl_m: MISSION.alt_m };
        Self {
            now: Duration::ZERO,
            vehicle: Vehicle::new(vehicle, jitter, mission, EPOCH_US, 3),
            autopilot: Autopilot::new(settings, Instant::ZERO),
            transmitter: Transmitter::new(
                transmitter::Settings {
                    own: OWN,
                    target: (1, 68),
                    kind: transmitter::Kind::Numbered { command: 31010 },
                    boot: 4,
                    longest_round_trip: Duration::from_millis(300),
                    apart: false,
                    system_is_given: false,
                    first_off_after: Duration::ZERO,
                },
                Instant::ZERO,
            ),
            setpoint: None,
            events: Vec::new(),
            sequence: 0,
        }
    }

    fn send(&mut self, message: &MavMessage) {
        let header = MavHeader { system_id: OWN.0.into(), component_id: OWN.1, sequence: self.sequence };
        self.sequence = self.sequence.wrapping_add(1);
        let mut bytes = Vec::new();
        mavlink::write_v2_msg(&mut bytes, header, message).unwrap();
        self.vehicle.handle(0, &bytes, self.now);
    }

    fn step(&mut self) {
        self.now += STEP;
        let now = Instant::from_start(self.now);
        self.vehicle.advance(self.now);
        while let Some((_, frame)) = self.vehicle.poll_transmit() {
            let id = u32::from_le_bytes([frame[7], frame[8], frame[9], 0]);
            let payload = &frame[10..10 + usize::from(frame[1])];
            let header = MavHeader { system_id: frame[5].into(), component_id: frame[6], sequence: frame[4] };
            match Aboard::parse(MavlinkVersion::V2, id, payload).unwrap() {
                Aboard::Common(message) => {
                    self.autopilot.handle_message(header, &message, now);
                    self.transmitter.handle_message(header, &message, now);
                }
                Aboard::Radio(message) => self.transmitter.handle_radio(header, message.message(), now),
            }
        }
        if self.now.as_millis().is_multiple_of(1000) {
            self.send(&veilwing::autopilot::heartbeat(
                mavlink::dialects::ardupilotmega::MavState::MAV_STATE_ACTIVE,
            ));
        }
        while self.autopilot.poll_timeout().is_some_and(|(at, _)| at <= now) {
            self.autopilot.handle_timeout(now);
        }
        if let Some(setpoint) = self.setpoint.filter(|_| self.now.as_millis() % TICK_MS == TICK_MS / 2) {
            self.autopilot.set_setpoint(setpoint, now);
        }
        while self.transmitter.poll_timeout().is_some_and(|(at, _)| at <= now) {
            self.transmitter.handle_timeout(now);
        }
        while let Some(message) = self.autopilot.poll_transmit().or_else(|| self.transmitter.poll_transmit())
        {
            self.send(&message);
        }
        self.events.extend(std::iter::from_fn(|| self.autopilot.poll_event()));
    }

    fn run(&mut self, seconds: f64) {
        let end = self.now + Duration::from_secs_f64(seconds);
        while self.now < end {
            self.step();
        }
    }

    fn until(&mut self, seconds: f64, wanted: impl Fn(&Event) -> bool) {
        let end = self.now + Duration::from_secs_f64(seconds);
        let seen = self.events.len();
        while !self.events[seen..].iter().any(&wanted) {
            assert!(self.now < end, "not within {seconds} s: {:#?}", self.events);
            self.step();
        }
    }

    fn now(&self) -> Instant {
        Instant::from_start(self.now)
    }

    fn place(&mut self, position_enu_m: Enu, attitude: Attitude) {
        self.setpoint = Some(Setpoint {
            position_enu_m,
            velocity_enu_m_s: EnuVelocity::ZERO,
            acceleration_enu_m_s2: EnuAcceleration::ZERO,
            attitude,
        });
    }

    /// Found, ready, in control, armed, at 20 m.
    fn launch(&mut self) {
        self.until(5.0, |event| matches!(event, Event::Discovered { .. }));
        self.run(6.0);
        let state = self.autopilot.state();
        let (position, attitude) = (state.position_enu_m.unwrap().value, state.attitude.unwrap().value);
        // On the ground, the estimate is the truth: through the autopilot's own origin and heading.
        assert!((position - Enu::new(-20.0, 35.0, 4.0)).norm() < 0.05, "{position}");
        assert!(attitude.angle_to(&Attitude::from_euler(0.0, 0.0, 0.7)) < 0.01, "{:?}", attitude.euler());
        self.place(position, attitude);
        let now = self.now();
        self.autopilot.take_control(now);
        self.until(10.0, |event| *event == Event::ControlTaken);
        let now = self.now();
        self.autopilot.arm(now);
        self.until(20.0, |event| *event == Event::Armed);
        let now = self.now();
        self.autopilot.take_off(20.0, now);
        self.place(position + Vector3::z() * 20.0, attitude);
        self.until(60.0, |event| *event == Event::Airborne);
        self.run(5.0);
    }

    fn truth(&self) -> (Enu, Attitude) {
        let snapshot = self.vehicle.snapshot();
        let [w, x, y, z] = snapshot.nominal_attitude_wxyz;
        let attitude = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
        (Enu::from(snapshot.position_enu_m), Attitude::from_rotation(attitude))
    }
}

#[test]
fn spec_both_faces_fly_where_the_mission_says_and_land() {
    for (firmware, actuation) in [
        (Firmware::Px4, Actuation::Pose),
        (Firmware::Px4, Actuation::Position),
        (Firmware::ArduCopter, Actuation::Position),
    ] {
        let mut world = World::new(firmware, actuation);
        world.launch();
        assert!(
            world.events.iter().any(|event| matches!(event, Event::NotReady { .. })),
            "readiness took 12 s"
        );
        let failed: Vec<_> = world
            .autopilot
            .preflight(world.now())
            .into_iter()
            .filter(|check| check.result == Verdict::Fail)
            .collect();
        assert!(failed.is_empty(), "{firmware:?}: {failed:?}");
        let attitude = Attitude::from_euler(0.9, -0.4, 0.0);
        let position = Enu::new(40.0, -10.0, 50.0);
        world.place(position, attitude);
        world.run(60.0);
        let (there, turned) = world.truth();
        assert!((there - position).norm() < 0.1, "{firmware:?} {actuation:?}: {there}");
        let wanted = if actuation == Actuation::Pose { attitude } else { Attitude::level() };
        assert!(turned.angle_to(&wanted) < 0.02, "{firmware:?} {actuation:?}: {:?}", turned.euler());
        assert!(world.autopilot.in_control());

        world.autopilot.statustext(MavSeverity::MAV_SEVERITY_INFO, "landing");
        let now = world.now();
        world.autopilot.land(now);
        world.until(5.0, |event| matches!(event, Event::HandedOver { .. }));
        world.until(120.0, |event| *event == Event::Disarmed);
        assert_eq!(world.autopilot.state().mode(), Some(Mode::Land));
        let lost = world.events.iter().any(|event| {
            matches!(
                event,
                Event::ControlLost { .. }
                    | Event::EstimatorFailure(_)
                    | Event::Refused { .. }
                    | Event::LinkLost { .. }
            )
        });
        assert!(!lost, "{:#?}", world.events);
        let utc_us = world.autopilot.utc(world.now()).unwrap().unix_us as i64;
        assert!((utc_us - (EPOCH_US + world.now.as_micros() as u64) as i64).abs() < 10_000);
    }
}

#[test]
fn spec_arducopter_ends_a_transit_within_half_a_metre_and_flies_past_what_does_not_say_how_it_slows() {
    for (tells, least_m, most_m) in [(true, -0.5, 0.5), (false, 1.5, 15.0)] {
        let mut world = World::new(Firmware::ArduCopter, Actuation::Position);
        world.launch();
        let start = Start {
            position_enu_m: world.setpoint.unwrap().position_enu_m,
            attitude: Attitude::from_euler(0.0, 0.0, 0.7),
        };
        let mut transit = Trajectory::rest(&start);
        let limits = Limits { jerk_m_s3: Some(4.0), ..Limits::new(8.0, 3.0, 0.5) };
        transit.fly(&[start.position_enu_m + Vector3::new(60.0, 0.0, 0.0)], &limits);
        let begins = world.now;
        let mut furthest_m = f64::MIN;
        while world.now < begins + transit.duration() + Duration::from_secs(8) {
            let sample = transit.sample(world.now - begins);
            let told = if tells { sample.acceleration_enu_m_s2 } else { EnuAcceleration::ZERO };
            world.setpoint = Some(Setpoint {
                position_enu_m: sample.position_enu_m,
                velocity_enu_m_s: sample.velocity_enu_m_s,
                acceleration_enu_m_s2: told,
                attitude: sample.attitude,
            });
            world.step();
            furthest_m = furthest_m.max(world.truth().0.x);
        }
        let past_m = furthest_m - transit.end().position_enu_m.x;
        println!("told {tells}: {past_m:.2} m past the end");
        assert!((least_m..=most_m).contains(&past_m), "told {tells}: {past_m} m");
        assert!((world.truth().0 - transit.end().position_enu_m).norm() < 0.1);
    }
}

/// Position error (m) and attitude error (degrees) of the desired pose over some seconds: root mean squares without the
/// injected jitter, and the largest position error.
fn errors(world: &mut World, seconds: f64) -> (f64, f64, f64) {
    let wanted = world.setpoint.unwrap();
    let (mut position, mut attitude, mut largest_m, mut count) = (0.0, 0.0, 0.0_f64, 0.0);
    let end = world.now + Duration::from_secs_f64(seconds);
    while world.now < end {
        world.step();
        let (there, turned) = world.truth();
        let error_m = (there - wanted.position_enu_m).norm();
        position += error_m.powi(2);
        attitude += turned.angle_to(&wanted.attitude).to_degrees().powi(2);
        largest_m = largest_m.max(error_m);
        count += 1.0;
    }
    ((position / count).sqrt(), (attitude / count).sqrt(), largest_m)
}

/// The attitudes flown, roll and pitch in degrees.
const TOUR_DEG: [(f64, f64); 5] = [(30.0, 0.0), (60.0, 0.0), (90.0, 0.0), (0.0, -45.0), (0.0, 0.0)];

/// A PX4 with eight rotors under body thrust, thrust axes of unequal scales, launched: in calm air with an estimator that
/// is right, or in 4 m/s of wind with one that is late and errs, and with jitter. `planned_tilt_rad` decides whether the
/// companion guards the land detector.
fn omnicopter(windy: bool, planned_tilt_rad: f64) -> World {
    let mut vehicle = vehicle(Firmware::Px4);
    let mut jitter = JitterConfig::default();
    if windy {
        vehicle.wind.mean_enu_m_s = [3.2, -2.4, 0.0];
        vehicle.sensors = SensorConfig { position_std_m: 0.0, ..SensorConfig::typical() };
        jitter.std_deg = 2.0;
    }
    let mut settings = settings(Actuation::ThrustVector);
    settings.planned_tilt_rad = planned_tilt_rad;
    let mut world = World::with(vehicle, jitter, settings);
    world.launch();
    world.run(10.0);
    world
}

fn turn_to(world: &mut World, (roll_deg, pitch_deg): (f64, f64)) {
    let attitude = Attitude::from_euler(roll_deg.to_radians(), pitch_deg.to_radians(), 0.7);
    world.setpoint = world.setpoint.map(|setpoint| Setpoint { attitude, ..setpoint });
}

#[test]
fn spec_the_simulated_omnicopter_holds_every_attitude_in_calm_and_wind() {
    for windy in [false, true] {
        let mut world = omnicopter(windy, std::f64::consts::FRAC_PI_2);
        for tilt_deg in TOUR_DEG {
            turn_to(&mut world, tilt_deg);
            let (_, _, way_m) = errors(&mut world, 12.0);
            let (hold_m, hold_deg, _) = errors(&mut world, 20.0);
            let case = format!("windy {windy}, roll and pitch {tilt_deg:?}");
            println!("{case}: at most {way_m:.3} m on the way, then {hold_m:.4} m and {hold_deg:.3} deg rms");
            assert!(way_m <= 0.4, "{case}: {way_m} m");
            assert!(hold_m <= 0.05 && hold_deg <= 0.3, "{case}: {hold_m} m, {hold_deg} deg");
        }
        assert!(world.autopilot.in_control(), "{:#?}", world.events);
        let now = world.now();
        world.autopilot.land(now);
        world.until(120.0, |event| *event == Event::Disarmed);
    }
}

#[test]
fn spec_auto_flies_an_omnicopter_by_thrust_and_a_multirotor_by_position() {
    for (firmware, tilt_rad, says) in
        [(Firmware::Px4, 1.0, "thrust_vector"), (Firmware::ArduCopter, 0.0, "position")]
    {
        let mut settings = settings(Actuation::Auto);
        settings.planned_tilt_rad = tilt_rad;
        let mut world = World::with(vehicle(firmware), JitterConfig::default(), settings);
        world.launch();
        let check = world.autopilot.preflight(world.now()).into_iter().find(|c| c.name == "actuation");
        assert!(check.as_ref().is_some_and(|check| check.detail.starts_with(says)), "{check:?}");
        world.place(Enu::new(-10.0, 30.0, 30.0), Attitude::from_euler(tilt_rad, 0.0, 0.7));
        world.run(30.0);
        let (there, turned) = world.truth();
        assert!((there - Enu::new(-10.0, 30.0, 30.0)).norm() < 0.2, "{firmware:?}: {there}");
        assert!((turned.tilt_rad() - tilt_rad).abs() < 0.02, "{firmware:?}: {}", turned.tilt_rad());
    }
}

#[test]
fn spec_without_the_guard_the_land_detector_ends_the_same_flight() {
    // Planned level, flown tilted: what a companion without the guard would do.
    let mut world = omnicopter(false, 0.0);
    for tilt_deg in TOUR_DEG {
        turn_to(&mut world, tilt_deg);
        world.run(32.0);
    }
    assert!(world.events.contains(&Event::Disarmed) && !world.autopilot.in_control(), "{:#?}", world.events);
}

#[test]
fn spec_the_radio_does_what_is_commanded_and_no_more() {
    for radio_place in [RadioPlace::BehindAutopilot, RadioPlace::OnTheWire] {
        let vehicle = VehicleConfig { radio_place, ..vehicle(Firmware::Px4) };
        let mut world = World::with(vehicle, JitterConfig::default(), settings(Actuation::Pose));
        world.run(3.0);
        assert_eq!(world.transmitter.supports_expiry(), Some(true));
        assert!((world.transmitter.limit_w().unwrap() - 1.0).abs() < 1e-6);
        let checks = world.transmitter.preflight(world.now());
        assert!(checks.iter().all(|check| check.result == Verdict::Pass), "{checks:?}");
        let now = world.now();
        let off_by = now + Duration::from_millis(300);
        assert_eq!(world.transmitter.command(0.25, 7, off_by, now), Ok(()));
        world.run(0.05);
        let snapshot = world.vehicle.snapshot();
        let power_w = snapshot.tx_power_w.unwrap();
        assert!(power_w <= 0.25 && power_w > 0.2498, "{power_w}");
        assert_eq!(snapshot.slot, Some(7));
        let vouched = world.transmitter.on_until_at_least(world.now()).unwrap();
        assert!((vouched.power_w - power_w).abs() < 1e-9 && vouched.slot == 7);
        assert!(vouched.until <= off_by && vouched.until > now + Duration::from_millis(250), "{vouched:?}");
        // As long as that it is on; by then it is off.
        while world.now() < vouched.until {
            assert!(world.vehicle.snapshot().tx_power_w.is_some());
            world.step();
        }
        while world.now() < off_by {
            world.step();
        }
        assert_eq!(world.vehicle.snapshot().tx_power_w, None);
        world.run(0.05);
        assert!(world.transmitter.is_off(world.now()));
    }
}
