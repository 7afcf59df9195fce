//! Allocation against the effectiveness that it inverts, saturation, lag and curves.

use super::*;
use crate::vehicle::airframe::Airframe;

fn omni() -> Geometry {
    Airframe::Omnidirectional.rotors()
}

/// What rotors without a lag give.
fn given(geometry: &Geometry, throttles: &Throttles) -> Wrench {
    Rotors::new(&Geometry { lag_s: 0.0, ..geometry.clone() }).step(throttles, 0.0025)
}

fn close(a: &Wrench, b: &Wrench) -> bool {
    (a.force_n - b.force_n).norm() < 1e-9 && (a.torque_nm - b.torque_nm).norm() < 1e-9
}

#[test]
fn val_units_are_those_of_the_real_programs_omnicopter() {
    // Seen on PX4's stock omnicopter: 133.9 N along x and y, 115.9 N along z. By hand, with all entries of an axis'
    // row over its sum of squares: 16/3 and 8/sqrt(3) times the rotor's thrust.
    let units = *Allocator::new(&omni()).unit_n();
    assert!((units.x - 25.1 * 16.0 / 3.0).abs() < 1e-6 && (units.x - 133.9).abs() < 0.1, "{units}");
    assert!((units.y - units.x).abs() < 1e-9);
    assert!((units.z - 25.1 * 8.0 / 3f64.sqrt()).abs() < 1e-6 && (units.z - 115.9).abs() < 0.1, "{units}");
    // A level quadrotor has no sideways thrust, and its z is all rotors together.
    let quad = *Allocator::new(&Airframe::Conventional.rotors()).unit_n();
    assert!((quad - Vector3::repeat(90.0)).norm() < 1e-9, "{quad}");
}

#[test]
fn prop_what_fits_is_given_exactly_in_every_direction() {
    let allocator = Allocator::new(&omni());
    for k in 0..200u32 {
        let angle = f64::from(k) * 2.399_963;
        let z = f64::from(k) / 100.0 - 1.0;
        let flat = (1.0 - z * z).max(0.0).sqrt();
        let direction = Vector3::new(flat * angle.cos(), flat * angle.sin(), z);
        let wanted = Wrench { force_n: direction * 30.0, torque_nm: direction.yzx() * 0.8 };
        for saturation in [Saturation::Scale, Saturation::Clip] {
            let throttles = allocator.allocate(&wanted, saturation);
            assert!(close(&given(&omni(), &throttles), &wanted), "{direction}");
        }
    }
}

#[test]
fn val_saturated_forces_keep_their_direction_and_leave_room_for_torque() {
    let wanted = Wrench { force_n: Vector3::new(300.0, 0.0, 400.0), torque_nm: Vector3::new(0.0, 1.0, 0.0) };
    let throttles = Allocator::new(&omni()).allocate(&wanted, Saturation::Scale);
    let real = given(&omni(), &throttles);
    assert!(throttles.iter().all(|u| u.abs() <= 1.0));
    assert!((real.torque_nm - wanted.torque_nm).norm() < 1e-9, "{}", real.torque_nm);
    let direction = real.force_n.normalize();
    assert!((direction - Vector3::new(0.6, 0.0, 0.8)).norm() < 1e-9, "{direction}");
    assert!(real.force_n.norm() > 40.0 && real.force_n.norm() < 70.0, "{}", real.force_n.norm());
    // Cut off one by one they give more, and in another direction.
    let clipped = given(&omni(), &Allocator::new(&omni()).allocate(&wanted, Saturation::Clip));
    assert!(clipped.force_n.norm() > real.force_n.norm());
    assert!((clipped.force_n.normalize() - direction).norm() > 1e-3);
    // All eight at full thrust along z are the most there is.
    let most = given(
        &omni(),
        &Allocator::new(&omni()).allocate(
            &Wrench { force_n: Vector3::new(0.0, 0.0, 1e6), torque_nm: Vector3::zeros() },
            Saturation::Clip,
        ),
    );
    assert!((most.force_n.z - 8.0 * 25.1 / 3f64.sqrt()).abs() < 1e-9);
}

#[test]
fn val_a_quadrotor_pushes_up_alone() {
    let quad = Airframe::Conventional.rotors();
    let allocator = Allocator::new(&quad);
    let wanted = Wrench { force_n: Vector3::new(10.0, -5.0, 40.0), torque_nm: Vector3::new(0.3, -0.2, 0.1) };
    let real = given(&quad, &allocator.allocate(&wanted, Saturation::Scale));
    assert!((real.force_n - Vector3::new(0.0, 0.0, 40.0)).norm() < 1e-9);
    assert!((real.torque_nm - wanted.torque_nm).norm() < 1e-9);
    let down = Wrench { force_n: Vector3::new(0.0, 0.0, -40.0), torque_nm: Vector3::zeros() };
    assert_eq!(given(&quad, &allocator.allocate(&down, Saturation::Scale)).force_n.norm(), 0.0);
    assert_eq!((rank(&quad), rank(&omni())), (4, 6));
}

#[test]
fn val_rotors_lag_by_their_time_constant() {
    let geometry = omni();
    let mut rotors = Rotors::new(&geometry);
    let mut throttles = [0.0; MAX_ROTORS];
    throttles[0] = 0.5;
    let full = given(&geometry, &throttles);
    let mut real = Wrench::zero();
    for _ in 0..12 {
        real = rotors.step(&throttles, 0.0025); // one time constant of 30 ms
    }
    let part = 1.0 - (-1.0f64).exp();
    assert!((real.torque_nm - full.torque_nm * part).norm() < 1e-9);
    assert!(full.torque_nm.norm() > 1.0 && (rotors.load() - (0.5 * part).powf(1.5) / 8.0).abs() < 1e-12);
}

#[test]
fn spec_lost_rotors_and_nonsense_give_nothing() {
    let mut rotors = Rotors::new(&Geometry { lag_s: 0.0, ..omni() });
    rotors.lose(0);
    rotors.lose(99);
    let mut throttles = [f64::NAN; MAX_ROTORS];
    throttles[0] = 1.0;
    let nothing = rotors.step(&throttles, 0.0025);
    assert!(close(&nothing, &Wrench::zero()), "{nothing:?}");
    throttles[1] = f64::INFINITY;
    assert!(close(&rotors.step(&throttles, 0.0025), &Wrench::zero()));
    throttles[1] = 5.0;
    let one = rotors.step(&throttles, 0.0025);
    assert!((one.force_n.norm() - 25.1).abs() < 1e-9, "no more than it has");
}

#[test]
fn val_a_wrong_curve_bends_the_thrust() {
    // Believed linear, really a square: half is a quarter. The other way round half becomes its square root.
    assert!((through_curves(0.5, 0.0, 1.0) - 0.25).abs() < 1e-12);
    assert!((through_curves(-0.5, 1.0, 0.0) + 0.5f64.sqrt()).abs() < 1e-12);
    for throttle in [-1.0, -0.3, 0.0, 0.7, 1.0] {
        assert_eq!(through_curves(throttle, 0.6, 0.6), throttle);
        assert!((through_curves(throttle, 0.6, 0.600_000_1) - throttle).abs() < 1e-6);
    }
}

#[test]
fn spec_geometries_that_cannot_be_are_named() {
    let mut none = omni();
    none.rotors.clear();
    assert_eq!(none.fault(), Some(("geometry: number of rotors", 0.0)));
    let mut long = omni();
    long.rotors[2].axis_flu = [0.0, 0.0, 2.0];
    assert_eq!(long.fault(), Some(("geometry: length of axis_flu", 2.0)));
    let mut weak = omni();
    weak.rotors[7].thrust_n = f64::NAN;
    assert!(weak.fault().is_some_and(|(what, v)| what == "geometry: thrust_n" && v.is_nan()));
    assert!(omni().fault().is_none() && Airframe::Conventional.rotors().fault().is_none());
}
