//! The link budget of a problem about its user, in the bound's units.

use nalgebra::Vector3;

use crate::planner::problem::{Pattern, Problem};
use crate::role::PerVehicle;

/// Positions relative to the user and powers over the noise.
#[derive(Debug, Clone)]
pub(crate) struct Links {
    /// rho = b0 Pmax / s^2 of each vehicle, m^2.
    pub rho: PerVehicle<f64>,
    /// f of each vehicle's dipole: its gain is `1 - (1 - f) c^2`.
    pub floor: PerVehicle<f64>,
    /// The eavesdroppers relative to the user, metres.
    pub eavesdroppers: Vec<Vector3<f64>>,
}

impl Links {
    /// `None` if the numbers leave nothing to bound: zero noise, no power, no eavesdropper, anything not finite; and for
    /// antennas that are no dipoles.
    pub fn new(problem: &Problem) -> Option<Self> {
        let radio = &problem.radio;
        let floor = |pattern: &Pattern| match pattern {
            Pattern::Dipole { floor } => Some(*floor),
            Pattern::Measured(_) => None,
        };
        let floor = PerVehicle { i: floor(&problem.antennas.i)?, j: floor(&problem.antennas.j)? };
        let rho = radio.max_power_w.map(|p| radio.reference_gain * p.max(0.0) / radio.noise_power_w);
        let eavesdroppers: Vec<_> =
            problem.eavesdroppers.iter().map(|e| e.position_enu_m - problem.user_enu_m).collect();
        let finite = rho.i.is_finite() && rho.j.is_finite() && rho.i > 0.0 && rho.j >= 0.0;
        let placed = !eavesdroppers.is_empty() && eavesdroppers.iter().all(|e| e.norm_squared().is_finite());
        (finite && placed).then_some(Self { rho, floor, eavesdroppers })
    }

    /// The secrecy rate, bit/s/Hz and signed, of I at `p_i` with axis `y` and full power, and J at `p_j` with its null on the
    /// user and the power that disturbs the user by `b_0` over the noise, or full power if that is less. A true rate: what
    /// it exceeds is no bound.
    pub fn rate_nulled(&self, p_i: &Vector3<f64>, p_j: &Vector3<f64>, y: &Vector3<f64>, b_0: f64) -> f64 {
        let null = p_j.try_normalize(0.0).unwrap_or_else(Vector3::z);
        let received = |rho: f64, floor: f64, from: &Vector3<f64>, axis: &Vector3<f64>, to: &Vector3<f64>| {
            let line = to - from;
            let squared = line.norm_squared();
            let across = line.cross(axis).norm_squared();
            rho * (across + floor * (squared - across)) / (squared * squared)
        };
        let origin = Vector3::zeros();
        let leak = received(self.rho.j, self.floor.j, p_j, &null, &origin);
        let share = if leak > b_0 && self.floor.j > 0.0 { b_0 / leak } else { 1.0 };
        let disturbed = if self.floor.j > 0.0 { 1.0 + share * leak } else { 1.0 };
        let user = received(self.rho.i, self.floor.i, p_i, y, &origin) / disturbed;
        let worst = self.eavesdroppers.iter().fold(0.0_f64, |worst, e| {
            let jammed = 1.0 + share * received(self.rho.j, self.floor.j, p_j, &null, e);
            worst.max(received(self.rho.i, self.floor.i, p_i, y, e) / jammed)
        });
        ((1.0 + user) / (1.0 + worst)).log2()
    }
}
