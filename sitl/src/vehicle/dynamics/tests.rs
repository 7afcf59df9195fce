//! The rigid body against closed forms.

use super::*;
use crate::vehicle::airframe::Airframe;
use crate::vehicle::geometry::MAX_ROTORS;
use crate::vehicle::rotors::{Allocator, Saturation, Wrench};

const DT: f64 = 0.0025;
const OFF: Throttles = [0.0; MAX_ROTORS];

fn omni() -> Geometry {
    Airframe::Omnidirectional.rotors()
}

/// The throttles of a force and a torque.
fn throttles(force_n: Vector3<f64>, torque_nm: Vector3<f64>) -> Throttles {
    Allocator::new(&omni()).allocate(&Wrench { force_n, torque_nm }, Saturation::Scale)
}

fn flying(body: Body) -> Dynamics {
    let mut d = Dynamics::new(body, &omni(), Vector3::zeros(), 0.0);
    d.position_enu_m.z = 1000.0;
    d
}

#[test]
fn val_free_fall_without_air() {
    let mut d = flying(Body { drag_n_s2_per_m2: 0.0, ..Body::default() });
    for _ in 0..800 {
        d.step(&OFF, Vector3::zeros(), DT);
    }
    assert!((d.velocity_enu_m_s.z + 2.0 * GRAVITY_M_S2).abs() < 1e-9);
    // Symplectic Euler falls by half a step of velocity more than g t^2 / 2.
    assert!((d.position_enu_m.z - (1000.0 - 2.0 * GRAVITY_M_S2)).abs() < GRAVITY_M_S2 * DT * 1.01);
}

#[test]
fn val_terminal_speed_in_free_fall() {
    let body = Body::default();
    let mut d = flying(body);
    d.position_enu_m.z = 1e5;
    for _ in 0..40_000 {
        d.step(&OFF, Vector3::zeros(), DT);
    }
    let terminal = (body.mass_kg * GRAVITY_M_S2 / body.drag_n_s2_per_m2).sqrt();
    assert!((d.velocity_enu_m_s.z + terminal).abs() < 1e-6 * terminal);
}

#[test]
fn val_hover_thrust_balances_gravity() {
    let mut d = flying(Body::default());
    let hover = throttles(Vector3::new(0.0, 0.0, d.body.mass_kg * GRAVITY_M_S2), Vector3::zeros());
    // The rotors come up in their lag, and what was lost meanwhile stays: from then on nothing changes.
    for _ in 0..400 {
        d.step(&hover, Vector3::zeros(), DT);
    }
    d.velocity_enu_m_s = Vector3::zeros();
    let at = d.position_enu_m;
    for _ in 0..4000 {
        d.step(&hover, Vector3::zeros(), DT);
    }
    assert!(d.velocity_enu_m_s.norm() < 1e-9 && (d.position_enu_m - at).norm() < 1e-8);
    assert!(d.attitude.angle() < 1e-9);
}

#[test]
fn spec_torque_free_spin_keeps_momentum_and_energy() {
    let mut d = flying(Body { inertia_kg_m2: [0.05, 0.09, 0.14], drag_n_s2_per_m2: 0.0, ..Body::default() });
    d.position_enu_m.z = 1e5;
    // About the unstable middle axis, slightly off: it tumbles.
    d.angular_momentum_enu = Vector3::new(0.01, 0.5, 0.01);
    let energy = |d: &Dynamics| {
        let w = d.rates_rad_s();
        0.5 * w.dot(&w.component_mul(&d.inertia))
    };
    let (momentum, start) = (d.angular_momentum_enu, energy(&d));
    let mut tumbled = false;
    for _ in 0..8000 {
        d.step(&OFF, Vector3::zeros(), DT);
        tumbled |= d.rates_rad_s().y < 0.0;
        assert!((energy(&d) / start - 1.0).abs() < 1e-3, "{}", energy(&d) / start);
    }
    assert!(tumbled, "the middle axis is unstable, so it must turn over");
    assert!((d.angular_momentum_enu - momentum).norm() < 1e-12);
}

#[test]
fn val_spin_up_about_a_principal_axis() {
    let body = Body { drag_n_s2_per_m2: 0.0, ..Body::default() };
    let mut d = flying(body);
    d.rotors = Rotors::new(&Geometry { lag_s: 0.0, ..omni() });
    let asked = throttles(Vector3::zeros(), Vector3::new(0.0, 0.0, 0.6));
    for _ in 0..400 {
        d.step(&asked, Vector3::zeros(), DT);
    }
    assert!((d.rates_rad_s().z - 0.6 / body.inertia_kg_m2[2]).abs() < 1e-9);
}

#[test]
fn val_eulers_top_precesses_at_its_closed_form() {
    // A symmetric body (A, A, C) spinning at n about its axis: the transverse rate turns at (C - A) n / A in the body.
    let (a, c) = (0.09, 0.12);
    let mut d = flying(Body { inertia_kg_m2: [a, a, c], drag_n_s2_per_m2: 0.0, ..Body::default() });
    let (n, transverse) = (6.0, 0.5);
    d.angular_momentum_enu = d.attitude * Vector3::new(a * transverse, 0.0, c * n);
    let precession = (c - a) / a * n;
    for k in 1..=2000u32 {
        d.step(&OFF, Vector3::zeros(), DT);
        let (rates, angle) = (d.rates_rad_s(), precession * f64::from(k) * DT);
        let expected = Vector3::new(transverse * angle.cos(), transverse * angle.sin(), n);
        assert!((rates - expected).norm() < 3e-3, "step {k}: {rates} {expected}");
    }
}

#[test]
fn val_fall_under_drag_trades_height_for_speed_and_heat() {
    // Energy: what gravity gave is motion, or was taken by the air at force times speed.
    let body = Body::default();
    let mut d = flying(body);
    d.velocity_enu_m_s = Vector3::new(8.0, -3.0, 5.0);
    let energy = |d: &Dynamics| {
        body.mass_kg * (0.5 * d.velocity_enu_m_s.norm_squared() + GRAVITY_M_S2 * d.position_enu_m.z)
    };
    let (start, mut heat) = (energy(&d), 0.0);
    for _ in 0..2000 {
        let before = d.velocity_enu_m_s;
        d.step(&OFF, Vector3::zeros(), DT);
        let middle = (before + d.velocity_enu_m_s) * 0.5;
        heat += body.drag_n_s2_per_m2 * before.norm() * before.dot(&middle) * DT;
    }
    // Symplectic Euler's energy is off by half a step of gravity's power, m g v dt / 2 at most.
    let bound = body.mass_kg * GRAVITY_M_S2 * d.velocity_enu_m_s.norm() * DT;
    assert!((energy(&d) + heat - start).abs() < bound, "{} {heat} {start}", energy(&d));
    assert!(heat > 100.0 * bound, "the air took {heat} J");
}

#[test]
fn val_wind_pushes_and_turns() {
    let body = Body { pressure_offset_m: [0.0, 0.0, 0.05], ..Body::default() };
    let mut d = flying(body);
    d.step(&OFF, Vector3::new(10.0, 0.0, 0.0), DT);
    // 100 m^2/s^2 times 0.04: 4 N to the east, 0.05 m above the centre of mass: 0.2 Nm about north.
    assert!((d.velocity_enu_m_s.x - 4.0 / body.mass_kg * DT).abs() < 1e-12);
    assert!((d.angular_momentum_enu - Vector3::new(0.0, 0.2 * DT, 0.0)).norm() < 1e-12);
}

#[test]
fn spec_ground_carries_holds_and_levels() {
    let mut d = Dynamics::new(Body::default(), &omni(), Vector3::new(5.0, 6.0, 2.0), 0.7);
    let side = throttles(Vector3::new(20.0, 0.0, 10.0), Vector3::new(1.0, 0.0, 0.0));
    for _ in 0..400 {
        d.step(&side, Vector3::new(10.0, 0.0, 0.0), DT);
    }
    assert_eq!(d.position_enu_m, Vector3::new(5.0, 6.0, 2.0));
    // Dropped from a metre it stops at the ground, upright, facing where it faced.
    d.body.drag_n_s2_per_m2 = 0.0;
    d.position_enu_m.z = 3.0;
    d.attitude *= UnitQuaternion::from_scaled_axis(Vector3::new(0.4, 0.0, 0.0));
    for _ in 0..800 {
        d.step(&OFF, Vector3::zeros(), DT);
    }
    assert!(d.on_ground && d.position_enu_m.z == 2.0 && d.velocity_enu_m_s.norm() == 0.0);
    let level = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.7);
    // The rotors run down during the first hundredths of a second and turn it by as little.
    assert!(d.attitude.angle_to(&level) < 1e-4, "{}", d.attitude.angle_to(&level));
}
