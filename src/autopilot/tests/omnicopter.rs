//! A fully actuated vehicle behind PX4's manners: body thrust whose axes have unequal scales, motors with a lag, an
//! attitude loop with a limited rate, drag in wind, and a land detector that disarms what pushes too little along
//! its own z without moving. Gusts, and an estimate with noise. Stated in NED and FRD, as PX4 states it.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use nalgebra::{UnitQuaternion, Vector3};

use super::*;
use crate::autopilot::firmware::OMNICOPTER;

const MASS_KG: f64 = 3.2;
const NEWTONS: [f64; 3] = [133.9, 133.9, 115.9];
const DRAG_N_S_M: f64 = 0.35;
const MOTOR_LAG_S: f64 = 0.04;
const ATTITUDE_LAG_S: f64 = 0.12;
const GRAVITY: f64 = 9.806_65;
/// MPC_MANTHR_MIN + 0.01.
const LANDED_THRUST: f64 = 0.09;
const LANDED_AFTER_S: f64 = 1.0;

/// Forces and the land detector.
#[derive(Debug, Clone)]
pub struct Body {
    pub wind_m_s: Vector3<f64>,
    gust_m_s: Vector3<f64>,
    rng: ChaCha8Rng,
    /// What the estimator adds to the truth: position, velocity.
    pub noise: (Vector3<f64>, Vector3<f64>),
    commanded: Vector3<f64>,
    thrust: Vector3<f64>,
    wanted: UnitQuaternion<f64>,
    still_s: f64,
    pub detected_landing_at_m: Option<f64>,
}

/// The rotors as PX4's parameters describe them.
pub fn rotors() -> Vec<(String, (f32, MavParamType))> {
    let mut all = vec![("CA_ROTOR_COUNT".to_owned(), int(8, Firmware::Px4))];
    for (i, (position, axis)) in OMNICOPTER.iter().enumerate() {
        let fields = ["PX", "PY", "PZ", "AX", "AY", "AZ", "CT", "KM"];
        let values = position.iter().chain(axis).copied().chain([6.5, 0.05]);
        all.extend(
            fields.iter().zip(values).map(|(field, v)| (format!("CA_ROTOR{i}_{field}"), real(v as f32))),
        );
    }
    all
}

impl Body {
    pub fn new(wind_m_s: Vector3<f64>) -> Self {
        Self {
            wind_m_s,
            gust_m_s: Vector3::zeros(),
            rng: ChaCha8Rng::seed_from_u64(1),
            noise: (Vector3::zeros(), Vector3::zeros()),
            commanded: Vector3::zeros(),
            thrust: Vector3::zeros(),
            wanted: UnitQuaternion::identity(),
            still_s: 0.0,
            detected_landing_at_m: None,
        }
    }

    pub fn command(&mut self, target: &SET_ATTITUDE_TARGET_DATA) {
        assert_eq!(target.type_mask.bits(), 39);
        self.commanded = Vector3::from(target.thrust_body.map(f64::from));
        self.wanted = quaternion(target.q);
    }

    pub fn step(&mut self, fake: &mut Fake, dt_s: f64) {
        let flies = fake.armed && fake.custom_mode == PX4_OFFBOARD;
        let commanded = if flies { self.commanded } else { Vector3::zeros() };
        self.thrust += (commanded - self.thrust) * (dt_s / MOTOR_LAG_S);
        let attitude = quaternion(fake.attitude);
        let on_ground = fake.position.z >= -1e-3;
        if flies && !on_ground {
            let turned = attitude.slerp(&self.wanted, dt_s / ATTITUDE_LAG_S);
            fake.attitude = [turned.w, turned.i, turned.j, turned.k].map(|c| c as f32);
        }
        let force = attitude * Vector3::from_fn(|axis, _| self.thrust[axis] * NEWTONS[axis]);
        self.disturb(dt_s);
        let drag = (self.wind_m_s + self.gust_m_s - fake.velocity) * DRAG_N_S_M;
        let mut acceleration = (force + drag) / MASS_KG + Vector3::z() * GRAVITY;
        if on_ground && acceleration.z >= 0.0 {
            acceleration = Vector3::zeros();
            fake.velocity = Vector3::zeros();
        }
        fake.velocity += acceleration * dt_s;
        fake.position += fake.velocity * dt_s;
        fake.position.z = fake.position.z.min(0.0);
        fake.landed = if fake.position.z < -0.3 {
            MavLandedState::MAV_LANDED_STATE_IN_AIR
        } else {
            MavLandedState::MAV_LANDED_STATE_ON_GROUND
        };
        self.detect_landing(fake, dt_s);
    }

    /// Gusts of a fifth of the wind with a time constant of a second; 1 cm and 3 cm/s of estimator noise, slow.
    fn disturb(&mut self, dt_s: f64) {
        let mut normal =
            || Vector3::from_fn(|_, _| (0..12).map(|_| self.rng.random::<f64>()).sum::<f64>() - 6.0);
        let (gust, position, velocity) = (normal(), normal(), normal());
        let part = |tau_s: f64| (2.0 * dt_s / tau_s).sqrt();
        self.gust_m_s += -self.gust_m_s * dt_s + gust * (0.2 * self.wind_m_s.norm() * part(1.0));
        self.noise.0 += -self.noise.0 * (dt_s / 0.5) + position * (0.01 * part(0.5));
        self.noise.1 += -self.noise.1 * (dt_s / 0.1) + velocity * (0.03 * part(0.1));
    }

    fn detect_landing(&mut self, fake: &mut Fake, dt_s: f64) {
        let limit_m_s = f64::from(fake.parameters["LNDMC_Z_VEL_MAX"].0);
        let still = fake.velocity.z.abs() < limit_m_s && fake.velocity.xy().norm() < 1.5;
        let weak = -self.commanded.z <= LANDED_THRUST;
        self.still_s = if fake.armed && still && weak { self.still_s + dt_s } else { 0.0 };
        if self.still_s > LANDED_AFTER_S && fake.position.z < -1.0 {
            self.detected_landing_at_m = Some(-fake.position.z);
            fake.armed = false;
        }
    }
}

fn airborne(wind_ned_m_s: Vector3<f64>) -> World {
    let mut fake = Fake::new(Firmware::Px4);
    fake.body = Some(Body::new(wind_ned_m_s));
    let mut world = World::new(fake, |settings| settings.actuation = Actuation::ThrustVector);
    world.launch();
    world
}

/// Root mean square position error and attitude error, and the largest position error, against the setpoint.
fn errors(world: &mut World, seconds: f64) -> (f64, f64, f64) {
    let setpoint = world.setpoint.unwrap();
    let frame = world.fake.frame();
    let wanted = frame.position_to_ned(setpoint.position_enu_m).vector();
    let (mut position, mut attitude, mut largest, mut count) = (0.0, 0.0, 0.0f64, 0.0);
    let end = world.now + Duration::from_secs_f64(seconds);
    while world.now < end {
        world.run(0.02);
        let error_m = (world.fake.position - wanted).norm();
        let there = Attitude::from_mavlink(world.fake.attitude.map(f64::from)).unwrap();
        position += error_m.powi(2);
        attitude += there.angle_to(&setpoint.attitude).to_degrees().powi(2);
        largest = largest.max(error_m);
        count += 1.0;
    }
    ((position / count).sqrt(), (attitude / count).sqrt(), largest)
}

#[test]
fn spec_thrust_vector_holds_every_attitude_in_calm_and_wind() {
    for wind_m_s in [0.0, 4.0] {
        let mut world = airborne(Vector3::new(-0.6, 0.8, 0.0) * wind_m_s);
        world.run(15.0);
        for (roll, pitch) in [(30.0, 0.0), (60.0, 0.0), (90.0, 0.0), (0.0, -45.0), (0.0, 0.0)] {
            let attitude = Attitude::from_euler(f64::to_radians(roll), f64::to_radians(pitch), 0.0);
            world.setpoint = world.setpoint.map(|setpoint| Setpoint { attitude, ..setpoint });
            let (_, _, transition_m) = errors(&mut world, 12.0);
            let (position_m, attitude_deg, _) = errors(&mut world, 10.0);
            let case = format!("wind {wind_m_s} m/s, roll {roll}, pitch {pitch}");
            println!(
                "{case}: transition {transition_m:.3} m, hold {position_m:.4} m {attitude_deg:.3} deg rms"
            );
            assert!(transition_m <= 0.4, "{case}: {transition_m} m");
            assert!(position_m <= 0.05 && attitude_deg <= 0.3, "{case}: {position_m} m, {attitude_deg} deg");
        }
        assert!(world.autopilot.in_control(), "{:#?}", world.events);
        let hover = world.autopilot.hover_thrust();
        assert!((hover - MASS_KG * GRAVITY / NEWTONS[2]).abs() < 0.02, "learned {hover}");
    }
}

#[test]
fn spec_the_land_detector_is_survived_with_the_guard_and_not_without() {
    for guarded in [true, false] {
        let mut world = airborne(Vector3::zeros());
        if !guarded {
            // What a vehicle without the guard would have.
            world.fake.parameters.insert("LNDMC_Z_VEL_MAX".into(), real(0.25));
        }
        let attitude = Attitude::from_euler(f64::to_radians(90.0), 0.0, 0.0);
        world.setpoint = world.setpoint.map(|setpoint| Setpoint { attitude, ..setpoint });
        world.run(20.0);
        let fell = world.fake.body.as_ref().unwrap().detected_landing_at_m;
        assert_eq!(fell.is_none(), guarded, "{fell:?}");
        assert_eq!(world.autopilot.in_control(), guarded);
        assert_eq!(world.count(|event| *event == Event::Disarmed), usize::from(!guarded));
    }
}

#[test]
fn spec_a_take_off_finds_its_own_hover_thrust_and_does_not_leap() {
    let mut fake = Fake::new(Firmware::Px4);
    fake.body = Some(Body::new(Vector3::zeros()));
    let mut world = World::new(fake, |settings| {
        settings.actuation = Actuation::ThrustVector;
        // Far from this vehicle's 0.27.
        settings.position_control.hover_thrust = 0.7;
    });
    world.connect();
    world.autopilot.take_control(world.now);
    world.until(10.0, |event| *event == Event::ControlTaken);
    world.autopilot.arm(world.now);
    world.until(10.0, |event| *event == Event::Armed);
    world.run(2.0);
    assert!(world.fake.position.z > -0.01, "stays on the ground until told to take off");
    world.autopilot.take_off(10.0, world.now);
    world.climb_to(10.0);
    let (mut fastest_m_s, mut highest_m) = (0.0f64, 0.0f64);
    for _ in 0..1000 {
        world.run(0.02);
        fastest_m_s = fastest_m_s.max(-world.fake.velocity.z);
        highest_m = highest_m.max(-world.fake.position.z);
    }
    println!("take-off: {fastest_m_s:.2} m/s at most, {highest_m:.2} m at most");
    assert_eq!(world.count(|event| *event == Event::Airborne), 1);
    assert!(fastest_m_s < 2.2 && (9.9..10.4).contains(&highest_m), "{fastest_m_s} m/s, {highest_m} m");
}
