//! The air that moves.

use nalgebra::Vector3;

use super::config::WindConfig;
use crate::random::{Noise, Purpose, decay};

/// Correlation time of gusts where the configuration leaves it out.
const DEFAULT_CORRELATION_S: f64 = 2.0;

/// Mean wind plus a first-order Gauss-Markov gust on each axis.
#[derive(Debug, Clone)]
pub(crate) struct Wind {
    pub mean_enu_m_s: Vector3<f64>,
    gust_std: Vector3<f64>,
    gust_enu_m_s: Vector3<f64>,
    correlation_s: f64,
    noise: Noise,
}

impl Wind {
    pub fn new(config: WindConfig, seed: u64, vehicle: usize) -> Self {
        let std = config.gust_std_m_s.abs();
        let mut noise = Noise::new(seed, Purpose::Wind, vehicle);
        let gust_std = Vector3::new(std, std, 0.5 * std);
        // Drawn from the stationary law, so that the first seconds are like all others.
        let gust_enu_m_s = gust_std.map(|s| if s > 0.0 { s * noise.normal() } else { 0.0 });
        let correlation_s =
            if config.gust_correlation_s > 0.0 { config.gust_correlation_s } else { DEFAULT_CORRELATION_S };
        Self {
            mean_enu_m_s: Vector3::from(config.mean_enu_m_s),
            gust_std,
            gust_enu_m_s,
            correlation_s,
            noise,
        }
    }

    /// Advances by `dt` and returns the velocity of the air.
    pub fn step(&mut self, dt: f64) -> Vector3<f64> {
        if self.gust_std.x > 0.0 {
            let a = decay(dt, self.correlation_s);
            let b = (1.0 - a * a).sqrt();
            for axis in 0..3 {
                self.gust_enu_m_s[axis] =
                    a * self.gust_enu_m_s[axis] + b * self.gust_std[axis] * self.noise.normal();
            }
        }
        self.mean_enu_m_s + self.gust_enu_m_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_gust_has_its_variance_and_correlation() {
        let config = WindConfig { mean_enu_m_s: [3.0, 0.0, 0.0], gust_std_m_s: 1.5, gust_correlation_s: 0.5 };
        let mut wind = Wind::new(config, 3, 0);
        let (steps, lag) = (400_000, 200);
        let x: Vec<f64> = (0..steps).map(|_| wind.step(0.0025).x - 3.0).collect();
        let variance = x.iter().map(|v| v * v).sum::<f64>() / steps as f64;
        let covariance = x.iter().zip(&x[lag..]).map(|(a, b)| a * b).sum::<f64>() / (steps - lag) as f64;
        // 1000 s at a correlation time of 0.5 s are about 2000 independent values: the error of the variance
        // ratio is sqrt(2/2000) = 3.2%.
        assert!((variance / 2.25 - 1.0).abs() < 0.13, "{variance}");
        assert!((covariance / variance - (-1.0f64).exp()).abs() < 0.1, "{covariance}");
    }
}
