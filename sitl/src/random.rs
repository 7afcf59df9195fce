//! Seeded noise. Each purpose has its own stream, so that adding a draw in one place changes no other.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// What a stream of random numbers is for; the number is part of what a seed reproduces.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Purpose {
    Eavesdroppers = 1,
    Wind = 2,
    Jitter = 3,
    Sensors = 4,
    Link = 5,
    Radio = 6,
    RadioHop = 7,
    Users = 8,
    PathsToUsers = 9,
    PathsToEavesdroppers = 10,
    Bias = 11,
    Meter = 12,
    Roaming = 13,
    Handsets = 14,
}

/// Gaussian and uniform draws from one stream.
#[derive(Debug, Clone)]
pub(crate) struct Noise {
    rng: ChaCha8Rng,
    spare: Option<f64>,
}

impl Noise {
    /// The stream of a purpose and an index (a vehicle's).
    pub fn new(seed: u64, purpose: Purpose, index: usize) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(((purpose as u64) << 16) | index as u64);
        Self { rng, spare: None }
    }

    /// Uniform on [0, 1).
    pub fn uniform(&mut self) -> f64 {
        self.rng.random::<f64>()
    }

    /// Standard normal, by Marsaglia's polar method.
    pub fn normal(&mut self) -> f64 {
        if let Some(spare) = self.spare.take() {
            return spare;
        }
        loop {
            let x = 2.0 * self.uniform() - 1.0;
            let y = 2.0 * self.uniform() - 1.0;
            let s = x * x + y * y;
            if s > 0.0 && s < 1.0 {
                let f = (-2.0 * s.ln() / s).sqrt();
                self.spare = Some(y * f);
                return x * f;
            }
        }
    }
}

/// The factor by which a first-order process with this correlation time decays over a step; 0 for white noise.
pub(crate) fn decay(step_s: f64, correlation_s: f64) -> f64 {
    if correlation_s > 0.0 { (-step_s / correlation_s).exp() } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_normal_moments_within_their_standard_errors() {
        let mut noise = Noise::new(11, Purpose::Wind, 0);
        let n = 200_000;
        let (mut m1, mut m2, mut m4) = (0.0, 0.0, 0.0);
        for _ in 0..n {
            let x = noise.normal();
            m1 += x;
            m2 += x * x;
            m4 += x.powi(4);
        }
        let n = f64::from(n);
        assert!((m1 / n).abs() < 4.0 / n.sqrt());
        assert!((m2 / n - 1.0).abs() < 4.0 * (2.0 / n).sqrt());
        assert!((m4 / n - 3.0).abs() < 4.0 * (96.0 / n).sqrt());
    }
}
