//! The air that moves: a mean, and the Dryden turbulence of MIL-F-8785C at low altitude.
//!
//! Along the mean wind (u), across it (v) and vertically (w), with intensities, scale lengths and forming filters of
//! the specification (3.7.2, low-altitude model; lengths there are in feet):
//!
//! `sigma_w = 0.1 W20`, `sigma_u = sigma_v = sigma_w / (0.177 + 0.000823 h)^0.4`,
//! `L_w = h`, `L_u = L_v = h / (0.177 + 0.000823 h)^1.2`,
//! `H_u = sigma sqrt(2T) / (1 + T s)`, `H_v, H_w = sigma sqrt(T) (1 + sqrt(3) T s) / (1 + T s)^2`, `T = L / V`.
//!
//! The filters are advanced exactly: the state's transition matrix and the covariance of its noise are in closed form.

use nalgebra::Vector3;

use super::config::WindConfig;
use crate::random::{Noise, Purpose};

const FOOT_M: f64 = 0.3048;
/// The specification's low-altitude model, feet.
const LOW_ALTITUDE_FT: [f64; 2] = [10.0, 1000.0];
/// Slowest air past the vehicle for which a frozen field of turbulence is carried along, m/s.
const SLOWEST_M_S: f64 = 1.0;
/// Turbulence is advanced every so many steps and held in between (10 ms of 2.5 ms): it is slower than 1 s.
const HOLD_STEPS: u32 = 4;
/// Its scales follow height and speed every so many of those.
const RESHAPE_AFTER: u32 = 50;

/// A first-order filter of unit variance driven by white noise.
#[derive(Debug, Clone, Default)]
struct FirstOrder {
    state: f64,
    keep: f64,
    fresh: f64,
}

impl FirstOrder {
    /// `step`: the step over the time constant.
    fn shape(&mut self, step: f64) {
        self.keep = (-step).exp();
        self.fresh = (1.0 - self.keep * self.keep).max(0.0).sqrt();
    }

    fn settle(&mut self, noise: &mut Noise) {
        self.state = noise.normal();
    }

    fn advance(&mut self, noise: &mut Noise) -> f64 {
        self.state = self.keep * self.state + self.fresh * noise.normal();
        self.state
    }
}

/// `(1 + sqrt(3) s) / (1 + s)^2` of unit variance, as a cascade: `a' = -a + n`, `b' = -b + a`, and the output
/// `sqrt(3) a + (1 - sqrt(3)) b`. Under noise of unit intensity its covariance is [[1/2, 1/4], [1/4, 1/4]].
#[derive(Debug, Clone, Default)]
struct SecondOrder {
    a: f64,
    b: f64,
    keep: f64,
    step: f64,
    /// Lower triangle of the root of the step's noise covariance.
    root: [f64; 3],
}

impl SecondOrder {
    fn shape(&mut self, step: f64) {
        self.step = step;
        self.keep = (-step).exp();
        let squared = self.keep * self.keep;
        let aa = 0.5 * (1.0 - squared);
        let ab = 0.25 - squared * (0.5 * step + 0.25);
        let bb = 0.25 - squared * (0.5 * step * step + 0.5 * step + 0.25);
        let first = aa.max(0.0).sqrt();
        let cross = if first > 0.0 { ab / first } else { 0.0 };
        self.root = [first, cross, (bb - cross * cross).max(0.0).sqrt()];
    }

    fn settle(&mut self, noise: &mut Noise) {
        // The root of the stationary covariance.
        let (x, y) = (noise.normal(), noise.normal());
        self.a = 0.5f64.sqrt() * x;
        self.b = 0.125f64.sqrt() * (x + y);
    }

    fn advance(&mut self, noise: &mut Noise) -> f64 {
        let (x, y) = (noise.normal(), noise.normal());
        let [first, cross, rest] = self.root;
        let b = self.keep * (self.b + self.step * self.a);
        self.a = self.keep * self.a + first * x;
        self.b = b + cross * x + rest * y;
        let root = 3f64.sqrt();
        root * self.a + (1.0 - root) * self.b
    }
}

/// Standard deviations (m/s) and scale lengths (m), along or across and vertical.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Scales {
    sigma_m_s: [f64; 2],
    length_m: [f64; 2],
}

impl Scales {
    /// At a height above the ground, for a wind at 20 feet of this speed.
    fn at(height_m: f64, wind_20ft_m_s: f64) -> Self {
        let h = (height_m / FOOT_M).clamp(LOW_ALTITUDE_FT[0], LOW_ALTITUDE_FT[1]);
        let profile = 0.177 + 0.000_823 * h;
        let vertical = 0.1 * wind_20ft_m_s;
        Self {
            sigma_m_s: [vertical / profile.powf(0.4), vertical],
            length_m: [h / profile.powf(1.2) * FOOT_M, h * FOOT_M],
        }
    }
}

/// The wind where one vehicle flies.
#[derive(Debug, Clone)]
pub(crate) struct Wind {
    mean_enu_m_s: Vector3<f64>,
    turbulence_m_s: f64,
    along: FirstOrder,
    across: SecondOrder,
    vertical: SecondOrder,
    sigma_m_s: [f64; 2],
    velocity_enu_m_s: Vector3<f64>,
    steps: u32,
    noise: Noise,
}

impl Wind {
    pub fn new(config: WindConfig, seed: u64, vehicle: usize) -> Self {
        let mut made = Self {
            mean_enu_m_s: Vector3::from(config.mean_enu_m_s),
            turbulence_m_s: config.turbulence_m_s.abs(),
            along: FirstOrder::default(),
            across: SecondOrder::default(),
            vertical: SecondOrder::default(),
            sigma_m_s: [0.0; 2],
            velocity_enu_m_s: Vector3::from(config.mean_enu_m_s),
            steps: 0,
            noise: Noise::new(seed, Purpose::Wind, vehicle),
        };
        // Drawn from the stationary law, so that the first seconds are like all others.
        made.along.settle(&mut made.noise);
        made.across.settle(&mut made.noise);
        made.vertical.settle(&mut made.noise);
        made
    }

    /// The mean changes at once.
    pub fn set_mean(&mut self, mean_enu_m_s: Vector3<f64>) {
        self.mean_enu_m_s = mean_enu_m_s;
        self.steps = 0;
    }

    /// Advances by `dt` at a height above the ground, for a vehicle of this velocity; the velocity of the air.
    pub fn step(&mut self, dt: f64, height_m: f64, velocity_enu_m_s: &Vector3<f64>) -> Vector3<f64> {
        let turn = self.steps;
        self.steps = (turn + 1) % (HOLD_STEPS * RESHAPE_AFTER);
        if self.turbulence_m_s <= 0.0 {
            self.velocity_enu_m_s = self.mean_enu_m_s;
        } else if turn.is_multiple_of(HOLD_STEPS) {
            if turn == 0 {
                let speed = (self.mean_enu_m_s - velocity_enu_m_s).norm();
                self.reshape(dt * f64::from(HOLD_STEPS), height_m, speed);
            }
            self.velocity_enu_m_s = self.mean_enu_m_s + self.gust();
        }
        self.velocity_enu_m_s
    }

    fn reshape(&mut self, step_s: f64, height_m: f64, speed_m_s: f64) {
        let scales = Scales::at(height_m, self.turbulence_m_s);
        let part = |length_m: f64| step_s * speed_m_s.max(SLOWEST_M_S) / length_m;
        self.along.shape(part(scales.length_m[0]));
        self.across.shape(part(scales.length_m[0]));
        self.vertical.shape(part(scales.length_m[1]));
        self.sigma_m_s = scales.sigma_m_s;
    }

    fn gust(&mut self) -> Vector3<f64> {
        let [horizontal, vertical] = self.sigma_m_s;
        let along = horizontal * self.along.advance(&mut self.noise);
        let across = horizontal * self.across.advance(&mut self.noise);
        let up = vertical * self.vertical.advance(&mut self.noise);
        let flat = self.mean_enu_m_s.xy();
        let direction = flat.try_normalize(1e-6).unwrap_or_else(nalgebra::Vector2::x);
        Vector3::new(
            along * direction.x - across * direction.y,
            along * direction.y + across * direction.x,
            up,
        )
    }
}

#[cfg(test)]
mod tests;
