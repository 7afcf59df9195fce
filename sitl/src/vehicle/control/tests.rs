//! The loops on the rigid body, with a perfect estimator.

use super::*;
use crate::frames::Euler;
use crate::vehicle::config::WindConfig;
use crate::vehicle::dynamics::Dynamics;
use crate::vehicle::wind::Wind;

const DT: f64 = 0.0025;
const LIMITS: SpeedLimits = SpeedLimits { horizontal_m_s: 12.0, up_m_s: 6.0, down_m_s: 6.0 };

/// A perfect estimator.
fn estimate(body: &Dynamics) -> Estimate {
    Estimate {
        position_enu_m: body.position_enu_m,
        velocity_enu_m_s: body.velocity_enu_m_s,
        attitude: body.attitude,
        rates_flu_rad_s: body.rates_rad_s(),
        contact: body.on_ground,
    }
}

struct Rig {
    body: Dynamics,
    controller: Controller,
    wind: Wind,
}

impl Rig {
    fn new(airframe: Airframe, wind: WindConfig) -> Self {
        let geometry = airframe.rotors();
        let mut body = Dynamics::new(Body::default(), &geometry, Vector3::zeros(), 0.0);
        body.position_enu_m.z = 100.0;
        body.on_ground = false;
        let controller = Controller::new(Body::default(), airframe, &geometry);
        Self { body, controller, wind: Wind::new(wind, 4, 0) }
    }

    fn run(
        &mut self,
        seconds: f64,
        mut target: impl FnMut(f64) -> Target,
        mut see: impl FnMut(f64, &Dynamics),
    ) {
        let steps = (seconds / DT).round() as usize;
        for k in 0..steps {
            let t = k as f64 * DT;
            let throttles = self.controller.step(&estimate(&self.body), &target(t), LIMITS, DT);
            let wind = self.wind.step(DT, 30.0, &self.body.velocity_enu_m_s);
            self.body.step(&throttles, wind, DT);
            see(t + DT, &self.body);
        }
    }
}

fn hold(at: Vector3<f64>, attitude: UnitQuaternion<f64>) -> Target {
    Target { position_enu_m: [Some(at.x), Some(at.y), Some(at.z)], velocity_enu_m_s: [None; 3], attitude }
}

#[test]
fn spec_hold_at_every_tilt_is_centimetres_and_tenths_of_a_degree() {
    let at = Vector3::new(0.0, 0.0, 100.0);
    for (roll, pitch) in [(0.0, 0.0), (30.0, 0.0), (60.0, -45.0), (90.0, 0.0), (0.0, 90.0), (180.0, 0.0)] {
        let attitude =
            Euler { roll_rad: f64::to_radians(roll), pitch_rad: f64::to_radians(pitch), yaw_rad: 0.0 }
                .rotation();
        let mut rig = Rig::new(Airframe::Omnidirectional, WindConfig::default());
        let (mut worst_m, mut worst_rad) = (0.0f64, 0.0f64);
        rig.run(
            10.0,
            |_| hold(at, attitude),
            |t, body| {
                if t > 5.0 {
                    worst_m = worst_m.max((body.position_enu_m - at).norm());
                    worst_rad = worst_rad.max(body.attitude.angle_to(&attitude));
                }
            },
        );
        assert!(worst_m < 0.01 && worst_rad.to_degrees() < 0.05, "{roll} {pitch}: {worst_m} {worst_rad}");
    }
}

#[test]
fn spec_hold_in_gusts() {
    let wind = WindConfig { mean_enu_m_s: [6.0, 2.0, 0.0], turbulence_m_s: 12.0 };
    let at = Vector3::new(0.0, 0.0, 100.0);
    let mut rig = Rig::new(Airframe::Omnidirectional, wind);
    let (mut squares, mut n) = (0.0, 0);
    rig.run(
        40.0,
        |_| hold(at, UnitQuaternion::identity()),
        |t, body| {
            if t > 10.0 {
                squares += (body.position_enu_m - at).norm_squared();
                n += 1;
            }
        },
    );
    let rms = (squares / f64::from(n)).sqrt();
    assert!(rms < 0.1 && rms > 1e-4, "{rms}");
}

#[test]
fn spec_tracks_a_moving_setpoint_with_its_velocity() {
    // 3 m/s^2 to 8 m/s, on at 8 m/s, streamed at 50 Hz.
    let mut rig = Rig::new(Airframe::Omnidirectional, WindConfig::default());
    let path = |t: f64| {
        let ramp = 8.0 / 3.0;
        if t < ramp { (1.5 * t * t, 3.0 * t) } else { (1.5 * ramp * ramp + 8.0 * (t - ramp), 8.0) }
    };
    let mut worst = 0.0f64;
    let streamed = |t: f64| {
        let sent = (t / 0.02).floor() * 0.02;
        let (p, v) = path(sent);
        let mut target = hold(Vector3::new(p + v * (t - sent), 0.0, 100.0), UnitQuaternion::identity());
        target.velocity_enu_m_s = [Some(v), Some(0.0), Some(0.0)];
        target
    };
    rig.run(10.0, streamed, |t, body| worst = worst.max((body.position_enu_m.x - path(t).0).abs()));
    assert!(worst < 0.3, "{worst}");
}

#[test]
fn spec_a_far_target_is_reached_without_overshoot() {
    for airframe in [Airframe::Omnidirectional, Airframe::Conventional] {
        let mut rig = Rig::new(airframe, WindConfig::default());
        let at = Vector3::new(60.0, -30.0, 120.0);
        let (mut beyond, mut speed) = (0.0f64, 0.0f64);
        rig.run(
            25.0,
            |_| hold(at, UnitQuaternion::identity()),
            |_, body| {
                beyond = beyond.max(body.position_enu_m.x - at.x);
                speed = speed.max(body.velocity_enu_m_s.xy().norm());
            },
        );
        let left = (rig.body.position_enu_m - at).norm();
        assert!(beyond < 0.5 && left < 0.05 && speed < 12.5, "{airframe:?} {beyond} {left} {speed}");
    }
}

#[test]
fn val_thrust_units_are_forces_along_the_bodys_axes() {
    // 0.15 units along each axis in turn, attitude held: the acceleration is the unit's newtons, not one and the same.
    let model = Body { drag_n_s2_per_m2: 0.0, ..Body::default() };
    for (axis, newtons) in [(0, 25.1 * 16.0 / 3.0), (1, 25.1 * 16.0 / 3.0), (2, 25.1 * 8.0 / 3f64.sqrt())] {
        let mut rig = Rig::new(Airframe::Omnidirectional, WindConfig::default());
        rig.body = Dynamics::new(model, &Airframe::Omnidirectional.rotors(), Vector3::zeros(), 0.0);
        rig.body.position_enu_m.z = 1000.0;
        rig.body.on_ground = false;
        let mut thrust_flu = Vector3::zeros();
        thrust_flu[axis] = 0.15;
        let target = ThrustTarget { attitude: UnitQuaternion::identity(), thrust_flu, rates: None };
        let fly = |rig: &mut Rig, steps: usize| {
            for _ in 0..steps {
                let throttles = rig.controller.step_thrust(&estimate(&rig.body), &target, DT);
                rig.body.step(&throttles, Vector3::zeros(), DT);
            }
            rig.body.velocity_enu_m_s
        };
        // Ten lags for the rotors to be there.
        let start = fly(&mut rig, 120);
        let gained = fly(&mut rig, 400) - start;
        let mut expected = Vector3::new(0.0, 0.0, -GRAVITY_M_S2);
        expected[axis] += 0.15 * newtons / model.mass_kg;
        assert!((gained - expected).norm() < 2e-3, "axis {axis}: {gained} {expected}");
    }
}

#[test]
fn spec_a_steady_torque_leaves_no_attitude_error() {
    // 10 m/s of wind on a lever of 10 cm: 0.4 Nm, for which the rate loop alone would stand off by 2.9 degrees.
    let model = Body { pressure_offset_m: [0.0, 0.0, 0.1], ..Body::default() };
    let mut rig = Rig::new(
        Airframe::Omnidirectional,
        WindConfig { mean_enu_m_s: [10.0, 0.0, 0.0], ..WindConfig::default() },
    );
    rig.body = Dynamics::new(model, &Airframe::Omnidirectional.rotors(), Vector3::zeros(), 0.0);
    rig.body.position_enu_m.z = 100.0;
    rig.body.on_ground = false;
    let target = hold(Vector3::new(0.0, 0.0, 100.0), UnitQuaternion::identity());
    rig.run(10.0, |_| target, |_, _| {});
    assert!(rig.body.attitude.angle().to_degrees() < 0.01, "{}", rig.body.attitude.angle().to_degrees());
}

#[test]
fn spec_one_lost_rotor_of_eight_is_survived_if_it_is_known() {
    let at = Vector3::new(0.0, 0.0, 100.0);
    let fly = |known: bool| {
        let mut rig = Rig::new(Airframe::Omnidirectional, WindConfig::default());
        rig.run(5.0, |_| hold(at, UnitQuaternion::identity()), |_, _| {});
        rig.body.rotors.lose(3);
        if known {
            rig.controller.drop_rotor(3);
        }
        let mut worst_m = 0.0f64;
        rig.run(
            20.0,
            |_| hold(at, UnitQuaternion::identity()),
            |_, body| worst_m = worst_m.max((body.position_enu_m - at).norm()),
        );
        (worst_m, (rig.body.position_enu_m - at).norm(), rig.body.attitude.angle().to_degrees())
    };
    let (worst_m, left_m, left_deg) = fly(true);
    assert!(
        worst_m > 1e-4 && worst_m < 0.5 && left_m < 0.01 && left_deg < 0.05,
        "{worst_m} {left_m} {left_deg}"
    );
    assert!(fly(false).0 > 10.0);
}
