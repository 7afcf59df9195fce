//! The rigid body: six degrees of freedom under rotors with a lag, air, gravity and ground.

use nalgebra::{UnitQuaternion, Vector3};

use super::airframe::Body;
use super::geometry::Geometry;
use super::rotors::{Rotors, Throttles};
use crate::frames::heading_rad;

/// Standard gravity, m/s^2.
pub(crate) const GRAVITY_M_S2: f64 = 9.806_65;

/// Time constant with which a body on the ground settles onto its landing gear.
const SETTLE_S: f64 = 0.1;

/// The state of motion. Angular momentum is kept in the world's frame, where it is constant without torque.
#[derive(Debug, Clone)]
pub(crate) struct Dynamics {
    body: Body,
    inertia: Vector3<f64>,
    ground_m: f64,
    pub position_enu_m: Vector3<f64>,
    pub velocity_enu_m_s: Vector3<f64>,
    /// Body FLU to world ENU.
    pub attitude: UnitQuaternion<f64>,
    angular_momentum_enu: Vector3<f64>,
    pub rotors: Rotors,
    /// The landing gear carries weight.
    pub on_ground: bool,
}

impl Dynamics {
    /// A body at rest on ground that is level at its own height.
    pub fn new(body: Body, geometry: &Geometry, position_enu_m: Vector3<f64>, heading: f64) -> Self {
        Self {
            body,
            inertia: Vector3::from(body.inertia_kg_m2),
            ground_m: position_enu_m.z,
            position_enu_m,
            velocity_enu_m_s: Vector3::zeros(),
            attitude: UnitQuaternion::from_axis_angle(&Vector3::z_axis(), heading),
            angular_momentum_enu: Vector3::zeros(),
            rotors: Rotors::new(geometry),
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

    /// Advances by `dt` seconds: explicit rotors, symplectic translation, and for the rotation a midpoint step,
    /// which keeps angular momentum exactly and energy to second order.
    pub fn step(&mut self, commands: &Throttles, wind_enu_m_s: Vector3<f64>, dt: f64) {
        let thrust = self.rotors.step(commands, dt);
        let air = wind_enu_m_s - self.velocity_enu_m_s;
        let drag = air * (air.norm() * self.body.drag_n_s2_per_m2);
        let weight = Vector3::new(0.0, 0.0, -GRAVITY_M_S2 * self.body.mass_kg);
        let force = self.attitude * thrust.force_n + drag + weight;
        self.velocity_enu_m_s += force / self.body.mass_kg * dt;
        let stood_at = self.on_ground.then_some(self.position_enu_m);
        self.position_enu_m += self.velocity_enu_m_s * dt;

        let lever = self.attitude * Vector3::from(self.body.pressure_offset_m);
        let torque = self.attitude * thrust.torque_nm + lever.cross(&drag);
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
mod tests;
