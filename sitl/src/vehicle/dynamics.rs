//! The rigid body: six degrees of freedom under rotors with a lag, air, gravity and ground.

use nalgebra::{UnitQuaternion, Vector3};

use super::config::{Airframe, Body};
use crate::frames::heading_rad;

/// Standard gravity, m/s^2.
pub(crate) const GRAVITY_M_S2: f64 = 9.806_65;

/// Time constant with which a body on the ground settles onto its landing gear.
const SETTLE_S: f64 = 0.1;

/// What the controller asks of the rotors, in body axes (FLU).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Wrench {
    pub force_n: Vector3<f64>,
    pub torque_nm: Vector3<f64>,
}

impl Wrench {
    pub fn zero() -> Self {
        Self { force_n: Vector3::zeros(), torque_nm: Vector3::zeros() }
    }
}

/// The state of motion. Angular momentum is kept in the world's frame, where it is constant without torque.
#[derive(Debug, Clone)]
pub(crate) struct Dynamics {
    body: Body,
    airframe: Airframe,
    inertia: Vector3<f64>,
    ground_m: f64,
    pub position_enu_m: Vector3<f64>,
    pub velocity_enu_m_s: Vector3<f64>,
    /// Body FLU to world ENU.
    pub attitude: UnitQuaternion<f64>,
    angular_momentum_enu: Vector3<f64>,
    rotors: Wrench,
    /// The landing gear carries weight.
    pub on_ground: bool,
}

impl Dynamics {
    /// A body at rest on ground that is level at its own height.
    pub fn new(body: Body, airframe: Airframe, position_enu_m: Vector3<f64>, heading: f64) -> Self {
        Self {
            body,
            airframe,
            inertia: Vector3::from(body.inertia_kg_m2),
            ground_m: position_enu_m.z,
            position_enu_m,
            velocity_enu_m_s: Vector3::zeros(),
            attitude: UnitQuaternion::from_axis_angle(&Vector3::z_axis(), heading),
            angular_momentum_enu: Vector3::zeros(),
            rotors: Wrench::zero(),
            on_ground: true,
        }
    }

    /// Angular velocity in body axes, rad/s.
    pub fn rates_rad_s(&self) -> Vector3<f64> {
        self.rates_at(&self.attitude)
    }

    fn rates_at(&self, attitude: &UnitQuaternion<f64>) -> Vector3<f64> {
        (attitude.inverse() * self.angular_momentum_enu).component_div(&self.inertia)
    }

    /// The wrench that the rotors can give of the one asked for.
    fn saturated(&self, asked: Wrench) -> Wrench {
        let force_n = match self.airframe {
            Airframe::Omnidirectional => asked.force_n.cap_magnitude(self.body.max_force_n),
            Airframe::Conventional => {
                Vector3::new(0.0, 0.0, asked.force_n.z.clamp(0.0, self.body.max_force_n))
            }
        };
        Wrench { force_n, torque_nm: asked.torque_nm.cap_magnitude(self.body.max_torque_nm) }
    }

    /// Advances by `dt` seconds: explicit rotors, symplectic translation, and for the rotation a midpoint step,
    /// which keeps angular momentum exactly and energy to second order.
    pub fn step(&mut self, asked: Wrench, wind_enu_m_s: Vector3<f64>, dt: f64) {
        let target = self.saturated(asked);
        let blend = 1.0 - crate::random::decay(dt, self.body.actuator_lag_s);
        self.rotors.force_n += (target.force_n - self.rotors.force_n) * blend;
        self.rotors.torque_nm += (target.torque_nm - self.rotors.torque_nm) * blend;

        let air = wind_enu_m_s - self.velocity_enu_m_s;
        let drag = air * (air.norm() * self.body.drag_n_s2_per_m2);
        let weight = Vector3::new(0.0, 0.0, -GRAVITY_M_S2 * self.body.mass_kg);
        let force = self.attitude * self.rotors.force_n + drag + weight;
        self.velocity_enu_m_s += force / self.body.mass_kg * dt;
        let stood_at = self.on_ground.then_some(self.position_enu_m);
        self.position_enu_m += self.velocity_enu_m_s * dt;

        let lever = self.attitude * Vector3::from(self.body.pressure_offset_m);
        let torque = self.attitude * self.rotors.torque_nm + lever.cross(&drag);
        self.angular_momentum_enu += torque * (0.5 * dt);
        let half = self.attitude * UnitQuaternion::from_scaled_axis(self.rates_rad_s() * (0.5 * dt));
        let rates = self.rates_at(&half);
        self.attitude *= UnitQuaternion::from_scaled_axis(rates * dt);
        self.attitude.renormalize_fast();
        self.angular_momentum_enu += torque * (0.5 * dt);

        self.touch_ground(stood_at, dt);
    }

    /// The ground does not yield, holds by friction, and levels what stands on it.
    fn touch_ground(&mut self, stood_at: Option<Vector3<f64>>, dt: f64) {
        self.on_ground = self.position_enu_m.z <= self.ground_m;
        if !self.on_ground {
            return;
        }
        self.position_enu_m = stood_at.unwrap_or(self.position_enu_m);
        self.position_enu_m.z = self.ground_m;
        self.velocity_enu_m_s = Vector3::new(0.0, 0.0, self.velocity_enu_m_s.z.max(0.0));
        self.angular_momentum_enu = Vector3::zeros();
        let level = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), heading_rad(&self.attitude));
        let part = 1.0 - crate::random::decay(dt, SETTLE_S);
        self.attitude = self.attitude.try_slerp(&level, part, 1e-9).unwrap_or(level);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DT: f64 = 0.0025;

    fn flying(body: Body) -> Dynamics {
        let mut d = Dynamics::new(body, Airframe::Omnidirectional, Vector3::new(0.0, 0.0, 0.0), 0.0);
        d.position_enu_m.z = 1000.0;
        d
    }

    #[test]
    fn val_free_fall_without_air() {
        let mut d = flying(Body { drag_n_s2_per_m2: 0.0, ..Body::default() });
        for _ in 0..800 {
            d.step(Wrench::zero(), Vector3::zeros(), DT);
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
            d.step(Wrench::zero(), Vector3::zeros(), DT);
        }
        let terminal = (body.mass_kg * GRAVITY_M_S2 / body.drag_n_s2_per_m2).sqrt();
        assert!((d.velocity_enu_m_s.z + terminal).abs() < 1e-6 * terminal);
    }

    #[test]
    fn val_hover_thrust_balances_gravity() {
        let mut d = flying(Body::default());
        let hover = Wrench {
            force_n: Vector3::new(0.0, 0.0, d.body.mass_kg * GRAVITY_M_S2),
            torque_nm: Vector3::zeros(),
        };
        d.rotors = hover;
        for _ in 0..4000 {
            d.step(hover, Vector3::zeros(), DT);
        }
        assert!(d.velocity_enu_m_s.norm() < 1e-9 && (d.position_enu_m.z - 1000.0).abs() < 1e-9);
    }

    #[test]
    fn prop_torque_free_spin_keeps_momentum_and_energy() {
        let mut d =
            flying(Body { inertia_kg_m2: [0.05, 0.09, 0.14], drag_n_s2_per_m2: 0.0, ..Body::default() });
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
            d.step(Wrench::zero(), Vector3::zeros(), DT);
            tumbled |= d.rates_rad_s().y < 0.0;
            assert!((energy(&d) / start - 1.0).abs() < 1e-3, "{}", energy(&d) / start);
        }
        assert!(tumbled, "the middle axis is unstable, so it must turn over");
        assert!((d.angular_momentum_enu - momentum).norm() < 1e-12);
    }

    #[test]
    fn val_spin_up_about_a_principal_axis() {
        let body = Body { actuator_lag_s: 0.0, drag_n_s2_per_m2: 0.0, ..Body::default() };
        let mut d = flying(body);
        let asked = Wrench { force_n: Vector3::zeros(), torque_nm: Vector3::new(0.0, 0.0, 0.6) };
        for _ in 0..400 {
            d.step(asked, Vector3::zeros(), DT);
        }
        assert!((d.rates_rad_s().z - 0.6 / body.inertia_kg_m2[2]).abs() < 1e-9);
    }

    #[test]
    fn val_wind_pushes_and_turns() {
        let body = Body { pressure_offset_m: [0.0, 0.0, 0.05], ..Body::default() };
        let mut d = flying(body);
        d.step(Wrench::zero(), Vector3::new(10.0, 0.0, 0.0), DT);
        // 100 m^2/s^2 times 0.06: 6 N to the east, 0.05 m above the centre of mass: 0.3 Nm about north.
        assert!((d.velocity_enu_m_s.x - 6.0 / body.mass_kg * DT).abs() < 1e-12);
        assert!((d.angular_momentum_enu - Vector3::new(0.0, 0.3 * DT, 0.0)).norm() < 1e-12);
    }

    #[test]
    fn val_rotors_saturate_and_lag() {
        let body = Body::default();
        let mut d = flying(body);
        let asked =
            Wrench { force_n: Vector3::new(300.0, 0.0, 400.0), torque_nm: Vector3::new(0.0, 99.0, 0.0) };
        let steps = (body.actuator_lag_s / DT).round() as usize;
        for _ in 0..steps {
            d.step(asked, Vector3::zeros(), DT);
        }
        let part = 1.0 - (-1.0f64).exp();
        assert!((d.rotors.force_n - Vector3::new(54.0, 0.0, 72.0) * part).norm() < 1e-9);
        assert!((d.rotors.torque_nm.y - 8.0 * part).abs() < 1e-9);
        let mut flat = flying(body);
        flat.airframe = Airframe::Conventional;
        assert_eq!(flat.saturated(asked).force_n, Vector3::new(0.0, 0.0, 90.0));
        assert_eq!(flat.saturated(Wrench { force_n: -asked.force_n, ..asked }).force_n, Vector3::zeros());
    }

    #[test]
    fn val_ground_carries_holds_and_levels() {
        let mut d =
            Dynamics::new(Body::default(), Airframe::Omnidirectional, Vector3::new(5.0, 6.0, 2.0), 0.7);
        let side = Wrench { force_n: Vector3::new(20.0, 0.0, 10.0), torque_nm: Vector3::new(1.0, 0.0, 0.0) };
        for _ in 0..400 {
            d.step(side, Vector3::new(10.0, 0.0, 0.0), DT);
        }
        assert_eq!(d.position_enu_m, Vector3::new(5.0, 6.0, 2.0));
        // Dropped from a metre it stops at the ground, upright, facing where it faced.
        d.body.drag_n_s2_per_m2 = 0.0;
        d.position_enu_m.z = 3.0;
        d.attitude *= UnitQuaternion::from_scaled_axis(Vector3::new(0.4, 0.0, 0.0));
        for _ in 0..800 {
            d.step(Wrench::zero(), Vector3::zeros(), DT);
        }
        assert!(d.on_ground && d.position_enu_m.z == 2.0 && d.velocity_enu_m_s.norm() == 0.0);
        let level = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.7);
        // The rotors run down during the first hundredths of a second and turn it by as little.
        assert!(d.attitude.angle_to(&level) < 1e-4, "{}", d.attitude.angle_to(&level));
    }
}
