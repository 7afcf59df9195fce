//! A fully actuated vehicle behind PX4's manners: body thrust whose axes have unequal scales, motors with a lag, an
//! attitude loop with a limited rate, drag in wind, and a land detector that disarms what pushes too little along
//! its own z without moving. Stated in NED and FRD, as PX4 states it.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use super::fake::*;
use super::*;

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
    commanded: Vector3<f64>,
    thrust: Vector3<f64>,
    wanted: UnitQuaternion<f64>,
    still_s: f64,
    pub detected_landing_at_m: Option<f64>,
}

fn rotation(q: [f32; 4]) -> UnitQuaternion<f64> {
    let [w, x, y, z] = q.map(f64::from);
    UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z))
}

impl Body {
    pub fn new(wind_m_s: Vector3<f64>) -> Self {
        Self {
            wind_m_s,
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
        self.wanted = rotation(target.q);
    }

    pub fn step(&mut self, fake: &mut Fake, dt_s: f64) {
        let flies = fake.armed && fake.custom_mode == PX4_OFFBOARD;
        let commanded = if flies { self.commanded } else { Vector3::zeros() };
        self.thrust += (commanded - self.thrust) * (dt_s / MOTOR_LAG_S);
        let attitude = rotation(fake.attitude);
        let on_ground = fake.position.z >= -1e-3;
        if flies && !on_ground {
            let turned = attitude.slerp(&self.wanted, dt_s / ATTITUDE_LAG_S);
            fake.attitude = [turned.w, turned.i, turned.j, turned.k].map(|c| c as f32);
        }
        let force = attitude * Vector3::from_fn(|axis, _| self.thrust[axis] * NEWTONS[axis]);
        let drag = (self.wind_m_s - fake.velocity) * DRAG_N_S_M;
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
    let mut world = World::new(fake, |settings| {
        settings.actuation = Actuation::ThrustVector;
        settings.position_control.hover_thrust = 0.2;
    });
    world.launch();
    world
}

/// Root mean square position error and attitude error, and the largest position error, against the setpoint.
fn errors(world: &mut World, seconds: f64) -> (f64, f64, f64) {
    let setpoint = world.setpoint.unwrap();
    let frame = crate::geo::LocalFrame { mission: MISSION, autopilot: ORIGIN };
    let wanted = frame.position_to_ned(setpoint.position_enu_m);
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
fn val_thrust_vector_holds_every_attitude_in_calm_and_wind() {
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
        assert!((hover - MASS_KG * GRAVITY / NEWTONS[2]).abs() < 0.01, "learned {hover}");
    }
}

#[test]
fn val_the_land_detector_is_survived_with_the_guard_and_not_without() {
    for guarded in [true, false] {
        let mut world = airborne(Vector3::zeros());
        if !guarded {
            // What a vehicle without the guard would have.
            world.fake.parameters.insert("LNDMC_Z_VEL_MAX", real(0.25));
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
