//! The link budget of a problem about its user, in the bound's units.

use std::f64::consts::LN_2;

use nalgebra::Vector3;

use crate::planner::problem::{Pattern, Problem, Rician};
use crate::radio::exponential::{EULER_GAMMA, ln_and_integral, scaled_integral};
use crate::role::PerVehicle;

/// A gain by the angle between axis and line: `flat + swing sin^2`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Gain {
    pub flat: f64,
    pub swing: f64,
}

impl Gain {
    /// Across the axis.
    pub fn most(&self) -> f64 {
        self.flat + self.swing
    }

    /// `1 + c (F + W s) = (1 + c F) (1 + c' s)`: the first factor and `c'`.
    pub fn apart(&self, scale: f64) -> (f64, f64) {
        let flat = 1.0 + scale * self.flat;
        (flat, scale * self.swing / flat)
    }

    /// Where the sine of the angle has this square.
    pub fn at(&self, sine_squared: f64) -> f64 {
        self.flat + self.swing * sine_squared
    }
}

/// What a dipole gives to one kind of receiver, what is scattered included.
#[derive(Debug, Clone)]
pub(crate) struct Reach {
    /// The mean over scattered waves.
    pub mean: Gain,
    /// Each at most `exp(E ln)` of it: one without scattering, which is the mean.
    pub least: Vec<Gain>,
}

impl Reach {
    /// With `G = f + (1 - f) sin^2` the received gain is `|sqrt(k G) + sqrt((1 - k) m) z|^2`, whose mean is
    /// `k G + (1 - k) m`, and `exp(E ln)` of it `(1 - k) m phi(x)`, `x = k G / ((1 - k) m)`, `phi(x) = x exp(E_1(x))`. phi is convex
    /// (`phi'' = exp(E_1 - x) (1 - (1 - exp(-x)) / x) >= 0`), so that its tangents lie below: at 0, at 1 and at infinity.
    fn new(floor: f64, rician: Rician) -> Self {
        let dipole = Gain { flat: floor, swing: 1.0 - floor };
        if !rician.is_present() {
            return Self { mean: dipole, least: vec![dipole] };
        }
        let scattered = rician.scattered() * Pattern::Dipole { floor }.mean();
        let share = |at_0: f64, slope: f64| Gain {
            flat: scattered * at_0 + slope * rician.direct() * dipole.flat,
            swing: slope * rician.direct() * dipole.swing,
        };
        let null = (-EULER_GAMMA).exp();
        let e = std::f64::consts::E;
        let at_1 = ln_and_integral(1.0).exp();
        let tangents = [[null, null], [at_1 / e, at_1 * (1.0 - 1.0 / e)], [0.0, 1.0]];
        Self { mean: share(1.0, 1.0), least: tangents.map(|[at_0, slope]| share(at_0, slope)).to_vec() }
    }
}

/// Positions relative to the user and powers over the noise.
#[derive(Debug, Clone)]
pub(crate) struct Links {
    /// rho = b0 Pmax / s^2 of each vehicle, m^2.
    pub rho: PerVehicle<f64>,
    /// Of each vehicle, towards the user.
    pub user: PerVehicle<Reach>,
    /// Of each vehicle, towards every eavesdropper.
    pub eavesdropper: PerVehicle<Reach>,
    /// The eavesdroppers relative to the user, metres.
    pub eavesdroppers: Vec<Vector3<f64>>,
    /// Whether anything is scattered: about the user, and at all.
    user_scatters: bool,
    pub scatters: bool,
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
        let fading = &problem.fading;
        (finite && placed).then(|| Self {
            rho,
            user: floor.map(|f| Reach::new(f, fading.user)),
            eavesdropper: floor.map(|f| Reach::new(f, fading.eavesdropper)),
            eavesdroppers,
            user_scatters: fading.user.is_present(),
            scatters: fading.is_present(),
        })
    }

    /// What `E log2(1 + b_0)` over scattered waves may fall short of `log2(1 + E b_0)` by, bit/s/Hz, where `E b_0` is at most
    /// `mean`: it is least without a direct path (`b_0` is then largest in the convex order), and the difference grows with the mean.
    pub fn shortfall(&self, mean: f64) -> f64 {
        if !self.user_scatters || mean <= 0.0 {
            return 0.0;
        }
        if mean.is_infinite() {
            EULER_GAMMA / LN_2
        } else {
            (mean.ln_1p() - scaled_integral(1.0 / mean)) / LN_2
        }
    }

    /// What the relaxation makes of I at `p_i` with axis `y` and full power, and J at `p_j` with its null on the user and the
    /// power that disturbs the user by `b_0` over the noise, or full power if that is less, bit/s/Hz and signed. Without
    /// scattering a true rate, and with it one that nothing here shows to be none.
    pub fn rate_nulled(&self, p_i: &Vector3<f64>, p_j: &Vector3<f64>, y: &Vector3<f64>, b_0: f64) -> f64 {
        let null = p_j.try_normalize(0.0).unwrap_or_else(Vector3::z);
        let received =
            |rho: f64, gain: &Gain, from: &Vector3<f64>, axis: &Vector3<f64>, to: &Vector3<f64>| {
                let line = to - from;
                let squared = line.norm_squared();
                let across = line.cross(axis).norm_squared();
                rho * (gain.swing * across + gain.flat * squared) / (squared * squared)
            };
        let origin = Vector3::zeros();
        let leaks = self.user.j.mean.flat > 0.0;
        let leak = received(self.rho.j, &self.user.j.mean, p_j, &null, &origin);
        let share = if leak > b_0 && leaks { b_0 / leak } else { 1.0 };
        let disturbed = if leaks { share * leak } else { 0.0 };
        let user = received(self.rho.i, &self.user.i.mean, p_i, y, &origin) / (1.0 + disturbed);
        let worst = self.eavesdroppers.iter().fold(0.0_f64, |worst, e| {
            let jammed = 1.0 + share * received(self.rho.j, &self.eavesdropper.j.mean, p_j, &null, e);
            let heard = |gain: &Gain| received(self.rho.i, gain, p_i, y, e) / jammed;
            self.eavesdropper.i.least.iter().map(heard).fold(worst, f64::max)
        });
        ((1.0 + user) / (1.0 + worst)).log2() + self.shortfall(disturbed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_least_gains_touch_the_geometric_mean_over_scattered_waves() {
        // By another road: ln |a + z|^2 by the trapezoidal rule on both parts of z.
        for (floor, k_db) in [(0.0, 10.0), (0.01, 15.0), (0.001, 0.0)] {
            let rician = Rician::from_db(k_db);
            let reach = Reach::new(floor, rician);
            let scattered = rician.scattered() * (1.0 - (1.0 - floor) / 3.0);
            for sine_squared in [0.0, 0.003, 0.02, 0.1, 0.4, 1.0] {
                let direct = (rician.direct() * (floor + (1.0 - floor) * sine_squared)).sqrt();
                let (step, mut log, mut mean, mut total) = (0.01, 0.0, 0.0, 0.0);
                for a in -500..500 {
                    for b in 0..500 {
                        let [x, y] = [a, b].map(|k| (f64::from(k) + 0.5) * step);
                        let weight = (-(x * x + y * y)).exp();
                        let gain = (direct + scattered.sqrt() * x).powi(2) + scattered * y * y;
                        log += weight * gain.ln();
                        mean += weight * gain;
                        total += weight;
                    }
                }
                let truth = (log / total).exp();
                assert!((reach.mean.at(sine_squared) / (mean / total) - 1.0).abs() < 1e-4);
                let best = reach.least.iter().map(|gain| gain.at(sine_squared)).fold(0.0, f64::max);
                assert!(
                    best <= truth * (1.0 + 1e-3) && best > 0.96 * truth,
                    "{sine_squared}: {best} {truth}"
                );
            }
        }
    }
}
