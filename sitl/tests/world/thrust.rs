//! PX4's way with a fully actuated vehicle: SET_ATTITUDE_TARGET with a three-dimensional thrust, and its traps.

use crate::common::*;
use mavlink::dialects::ardupilotmega::*;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use veilwing_sitl::*;

const UNITS_N: [f64; 3] = [133.9, 133.9, 115.9];
const MASS_KG: f64 = 2.0;
const GRAVITY: f64 = 9.806_65;
/// Rates ignored, thrust_body set.
const MASK: u8 = 39;

/// A position controller of the test's own, in ENU and FLU, for vehicle 0.
struct Pilot {
    flight: Flight,
    units_n: [f64; 3],
    integral: Vector3<f64>,
    attitude: UnitQuaternion<f64>,
    goal: Vector3<f64>,
    mask: u8,
}

fn vector(v: [f64; 3]) -> Vector3<f64> {
    Vector3::from(v)
}

fn rotation(wxyz: [f64; 4]) -> UnitQuaternion<f64> {
    UnitQuaternion::from_quaternion(Quaternion::new(wxyz[0], wxyz[1], wxyz[2], wxyz[3]))
}

/// The paper's angles at zero yaw.
fn tilt(roll_deg: f64, pitch_deg: f64) -> UnitQuaternion<f64> {
    UnitQuaternion::from_axis_angle(&Vector3::y_axis(), pitch_deg.to_radians())
        * UnitQuaternion::from_axis_angle(&Vector3::x_axis(), roll_deg.to_radians())
}

fn target(attitude: &UnitQuaternion<f64>, thrust_flu: Vector3<f64>, mask: u8) -> SET_ATTITUDE_TARGET_DATA {
    let (roll, pitch, yaw) = attitude.euler_angles();
    let q = UnitQuaternion::from_euler_angles(roll, -pitch, std::f64::consts::FRAC_PI_2 - yaw);
    SET_ATTITUDE_TARGET_DATA {
        q: [q.w as f32, q.i as f32, q.j as f32, q.k as f32],
        type_mask: AttitudeTargetTypemask::from_bits_truncate(mask),
        thrust_body: [thrust_flu.x as f32, -thrust_flu.y as f32, -thrust_flu.z as f32],
        target_system: 1,
        target_component: 1,
        ..SET_ATTITUDE_TARGET_DATA::DEFAULT
    }
}

impl Pilot {
    /// 25 m above home, under its own thrust.
    fn airborne(config: WorldConfig) -> Self {
        let goal = vector(config.vehicles[0].home_enu_m) + Vector3::new(0.0, 0.0, 25.0);
        let mut pilot = Self {
            flight: Flight::new(config),
            units_n: UNITS_N,
            integral: Vector3::zeros(),
            attitude: UnitQuaternion::identity(),
            goal,
            mask: MASK,
        };
        pilot.flight.pass(3000);
        pilot.fly(1200, |_| {});
        pilot.command(MavCmd::MAV_CMD_DO_SET_MODE, &[1.0, 6.0]);
        pilot.command(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, &[1.0]);
        pilot.integral = Vector3::zeros();
        pilot.fly(15_000, |_| {});
        pilot
    }

    fn command(&mut self, command: MavCmd, params: &[f32]) {
        self.flight.clients[0].command(&mut self.flight.world, command, params);
    }

    fn state(&self) -> VehicleSnapshot {
        self.flight.world.snapshot().vehicles[0].clone()
    }

    fn thrust(&mut self) -> Vector3<f64> {
        let state = self.state();
        let error = (self.goal - vector(state.position_enu_m)).cap_magnitude(1.0);
        if error.norm() < 1.0 {
            self.integral += error * (2.5 * 0.02);
        }
        let wanted = error * 6.0 - vector(state.velocity_enu_m_s) * 4.5 + self.integral;
        let force = (wanted + Vector3::new(0.0, 0.0, GRAVITY)) * MASS_KG;
        let body = rotation(state.nominal_attitude_wxyz).inverse() * force;
        body.component_div(&vector(self.units_n))
    }

    /// Streams at 50 Hz for `ms`, and shows each state to `see`.
    fn fly(&mut self, ms: u64, mut see: impl FnMut(&VehicleSnapshot)) {
        for _ in 0..ms / 20 {
            let thrust = self.thrust();
            let message = target(&self.attitude, thrust, self.mask);
            self.send(message);
            self.flight.pass(20);
            see(&self.state());
        }
    }

    fn send(&mut self, message: SET_ATTITUDE_TARGET_DATA) {
        self.flight.clients[0].send(&mut self.flight.world, &MavMessage::SET_ATTITUDE_TARGET(message));
    }

    /// Root mean square errors of position (m) and attitude (degrees) over `ms`.
    fn errors(&mut self, ms: u64) -> (f64, f64) {
        let (goal, attitude) = (self.goal, self.attitude);
        let (mut position, mut angle, mut n) = (0.0, 0.0, 0.0);
        self.fly(ms, |state| {
            position += (vector(state.position_enu_m) - goal).norm_squared();
            angle += rotation(state.nominal_attitude_wxyz).angle_to(&attitude).to_degrees().powi(2);
            n += 1.0;
        });
        ((position / n).sqrt(), (angle / n).sqrt())
    }
}

#[test]
fn spec_every_attitude_is_held_under_body_thrust_in_calm_and_wind() {
    for wind in [0.0, 4.0] {
        let mut config = config();
        config.vehicles[0].wind.mean_enu_m_s = [0.8 * wind, -0.6 * wind, 0.0];
        let mut pilot = Pilot::airborne(config);
        for (roll, pitch) in [(30.0, 0.0), (0.0, -45.0), (-40.0, 20.0)] {
            pilot.attitude = tilt(roll, pitch);
            pilot.fly(8000, |_| {});
            let (metres, degrees) = pilot.errors(4000);
            assert!(metres < 0.03 && degrees < 0.15, "{wind} m/s {roll} {pitch}: {metres} m {degrees} deg");
        }
        // Beyond the land detector's limit, with the detector off.
        pilot.flight.set_real("LNDMC_Z_VEL_MAX", 0.0);
        for (roll, pitch) in [(60.0, 0.0), (90.0, 0.0), (180.0, 0.0), (0.0, 89.0)] {
            pilot.attitude = tilt(roll, pitch);
            pilot.fly(8000, |_| {});
            let (metres, degrees) = pilot.errors(4000);
            assert!(metres < 0.03 && degrees < 0.15, "{wind} m/s {roll} {pitch}: {metres} m {degrees} deg");
        }
        assert_eq!(pilot.state().mode, "OFFBOARD");
    }
}

#[test]
fn spec_one_scale_for_all_axes_is_a_larger_error() {
    // On its side in wind, x and y carry the vehicle: with z's unit everywhere they carry 15% too much.
    let hold = |units_n: [f64; 3]| {
        let mut pilot = Pilot::airborne(config());
        pilot.units_n = units_n;
        pilot.flight.set_real("LNDMC_Z_VEL_MAX", 0.0);
        pilot.attitude = tilt(90.0, 0.0);
        pilot.fly(4000, |_| {});
        pilot.errors(4000).0
    };
    let (right, wrong) = (hold(UNITS_N), hold([115.9; 3]));
    assert!(wrong > 2.0 * right, "{wrong} m with one scale, {right} m with three");
}

#[test]
fn val_the_rotors_are_told_as_px4_tells_them() {
    let mut f = Flight::new(config());
    f.pass(100);
    let list = PARAM_REQUEST_LIST_DATA { target_system: 1, target_component: 1 };
    f.clients[0].send(&mut f.world, &MavMessage::PARAM_REQUEST_LIST(list));
    f.pass(500);
    let value = |name: &str| {
        f.clients[0].last(|m| match m {
            MavMessage::PARAM_VALUE(v) if v.param_id.to_str() == Ok(name) => Some(v.param_value),
            _ => None,
        })
    };
    assert_eq!(value("CA_ROTOR_COUNT").map(f32::to_bits), Some(8));
    // The first sits at the front, left, top in FLU: FRD turns y and z over.
    let first = ["PX", "PY", "PZ", "AX", "AY", "AZ", "CT", "KM"].map(|f| value(&format!("CA_ROTOR0_{f}")));
    let expected = [0.144_35, -0.144_35, -0.144_35, -0.788_675, -0.211_325, -0.577_35, 25.1, 0.05];
    for (seen, wanted) in first.into_iter().zip(expected) {
        assert!((f64::from(seen.unwrap()) - wanted).abs() < 1e-4, "{seen:?} {wanted}");
    }
    assert!(value("CA_ROTOR8_PX").is_none());
}

#[test]
fn spec_the_land_detector_disarms_a_vehicle_on_its_side() {
    for (trap, speed, falls) in [(true, 0.25, true), (true, 0.0, false), (false, 0.25, false)] {
        let mut config = config();
        config.vehicles[0].traps.land_detector = trap;
        let mut pilot = Pilot::airborne(config);
        pilot.flight.set_real("LNDMC_Z_VEL_MAX", speed);
        pilot.attitude = tilt(90.0, 0.0);
        pilot.fly(10_000, |_| {});
        assert_eq!(!pilot.state().armed, falls, "trap {trap}, limit {speed}");
        let landed = pilot.flight.clients[0].texts().iter().any(|t| t.contains("Disarmed by landing"));
        assert_eq!(landed, falls);
    }
    // At a tilt that leaves enough thrust along z it is right.
    let mut pilot = Pilot::airborne(config());
    pilot.attitude = tilt(45.0, 0.0);
    pilot.fly(10_000, |_| {});
    assert!(pilot.state().armed);
    // 45 degrees leave 0.12 of the hover's 0.17.
    pilot.flight.set_real("MPC_MANTHR_MIN", 0.12);
    pilot.fly(5000, |_| {});
    assert!(!pilot.state().armed);
}

#[test]
fn spec_keeping_it_armed_after_landing_is_not_enough() {
    let mut pilot = Pilot::airborne(config());
    pilot.flight.set_real("COM_DISARM_LAND", -1.0);
    pilot.attitude = tilt(90.0, 0.0);
    pilot.fly(8000, |_| {});
    assert!(pilot.state().armed);
    let before = pilot.state().position_enu_m[2];
    // The stream ends; the autopilot believes itself on the ground and lets its motors idle, until it falls.
    pilot.flight.pass(1300);
    assert_eq!(pilot.state().mode, "HOLD");
    let mut fallen = 0.0f64;
    for _ in 0..40 {
        pilot.flight.pass(25);
        fallen = fallen.max(before - pilot.state().position_enu_m[2]);
    }
    assert!(fallen > 0.03, "{fallen}");
}

#[test]
fn spec_a_thrust_that_is_no_number_stops_the_motors() {
    let mut pilot = Pilot::airborne(config());
    let before = pilot.state().position_enu_m[2];
    for _ in 0..50 {
        pilot.send(target(&UnitQuaternion::identity(), Vector3::new(0.0, 0.0, f64::NAN), MASK));
        pilot.flight.pass(20);
    }
    assert!(before - pilot.state().position_enu_m[2] > 3.0, "it falls");
    assert!(pilot.state().position_enu_m[2].is_finite());
}

#[test]
fn spec_the_last_writer_wins() {
    // Stock manners: position and attitude streamed together, each target throws the other out.
    let mut config = config();
    config.vehicles[0].traps.attitude_needs_thrust = true;
    let mut pilot = Pilot::airborne(config);
    let hover = MASS_KG * GRAVITY / UNITS_N[2];
    let lean = tilt(15.0, 0.0);
    let start = vector(pilot.state().position_enu_m);
    for _ in 0..300 {
        let vehicle = pilot.flight.config.vehicles[0].clone();
        let at = position_target(&vehicle, pilot.goal.into(), None);
        pilot.flight.clients[0].send(&mut pilot.flight.world, &at);
        pilot.send(target(&lean, Vector3::new(0.0, 0.0, hover), MASK));
        pilot.flight.pass(20);
    }
    let drift = (vector(pilot.state().position_enu_m) - start).norm();
    assert!(drift > 10.0, "{drift}");
    assert!(!pilot.flight.clients[0].texts().iter().any(|t| t.contains("lost")), "and no warning");
}

#[test]
fn spec_rates_left_in_the_mask_fight_the_attitude() {
    for (trap, fights) in [(true, true), (false, false)] {
        let mut config = config();
        config.vehicles[0].traps.rates_fight_attitude = trap;
        let mut pilot = Pilot::airborne(config);
        pilot.mask = 32;
        pilot.attitude = tilt(30.0, 0.0);
        pilot.fly(3000, |_| {});
        let (metres, _) = pilot.errors(2000);
        assert_eq!(metres > 0.5, fights, "{metres}");
    }
}

#[test]
fn spec_an_attitude_without_thrust_is_no_signal_to_stock_px4() {
    for (trap, taken) in [(true, 0), (false, 60)] {
        let mut config = config();
        config.vehicles[0].traps.attitude_needs_thrust = trap;
        let mut f = Flight::new(config);
        f.pass(3000);
        for _ in 0..60 {
            let pose = f.config.slots[0].poses[0];
            let message = attitude_target(&f.config.vehicles[0], &pose);
            f.clients[0].send(&mut f.world, &message);
            f.pass(20);
        }
        assert_eq!(f.world.counters()[0].setpoints.accepted, taken);
    }
}

#[test]
fn spec_a_wrong_thrust_model_bends_the_thrust() {
    // The motors go with the square of their signal; an autopilot that believes in less gives less than it says.
    let mut pilot = Pilot::airborne(config());
    pilot.fly(20_000, |_| {});
    let hover = MASS_KG * GRAVITY / UNITS_N[2];
    let learned = pilot.thrust().z;
    assert!((learned / hover - 1.0).abs() < 0.02, "{learned} {hover}");
    pilot.flight.set_real("THR_MDL_FAC", 0.7);
    pilot.fly(20_000, |_| {});
    // It hovers at the same signal as before, which is believed to be 0.7 s^2 + 0.3 s.
    let expected = 0.7 * hover + 0.3 * hover.sqrt();
    let bent = pilot.thrust().z;
    assert!((bent / expected - 1.0).abs() < 0.02, "{bent} {expected}");
}

#[test]
fn spec_a_quadrotor_takes_a_scalar_thrust() {
    let mut config = config();
    config.vehicles[0].airframe = Airframe::Conventional;
    let mut pilot = Pilot::airborne_quad(config);
    let level = UnitQuaternion::identity();
    let start = vector(pilot.state().position_enu_m);
    // Nose down by 10 degrees in the paper's sign: it goes forward, to the east.
    for _ in 0..100 {
        let message = SET_ATTITUDE_TARGET_DATA {
            thrust: (MASS_KG * GRAVITY / 90.0) as f32,
            ..target(&(tilt(0.0, 10.0) * level), Vector3::zeros(), 7)
        };
        pilot.send(message);
        pilot.flight.pass(20);
    }
    let moved = vector(pilot.state().position_enu_m) - start;
    assert!(moved.x > 2.0 && moved.y.abs() < 0.3, "{moved}");
}

impl Pilot {
    /// A quadrotor brought up by position targets.
    fn airborne_quad(config: WorldConfig) -> Self {
        let mut flight = Flight::new(config);
        flight.take_off();
        Self {
            flight,
            units_n: UNITS_N,
            integral: Vector3::zeros(),
            attitude: UnitQuaternion::identity(),
            goal: Vector3::zeros(),
            mask: MASK,
        }
    }
}
