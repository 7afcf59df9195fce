//! Scattering: what reaches a node beside the direct path.
//!
//! With a Rician factor K, `k = K / (K + 1)`, `m` the antenna's mean gain over the sphere and `z` complex normal with
//! `E |z|^2 = 1`, independent for each pair of vehicle and node, the received power is
//! `b0 P / d^2 |sqrt(k G) + sqrt((1 - k) m) z|^2`: a direct path through the pattern, and waves from everywhere about the
//! node's surroundings. A null is never deeper than about `m / K`, however good the antenna.

/// A Rician factor K, linear: power of the direct path over that of all others. Positive; infinite without scattering.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rician {
    k: f64,
}

impl Rician {
    /// No scattering.
    pub const NONE: Self = Self { k: f64::INFINITY };

    /// From K in dB.
    #[must_use]
    pub fn from_db(k_db: f64) -> Self {
        Self { k: libm::pow(10.0, k_db / 10.0) }
    }

    /// K, linear.
    #[must_use]
    pub fn factor(self) -> f64 {
        self.k
    }

    /// Whether anything is scattered.
    #[must_use]
    pub fn is_present(self) -> bool {
        self.k.is_finite()
    }

    /// `k = K / (K + 1)`: the direct path's share.
    #[must_use]
    pub fn direct(self) -> f64 {
        if self.is_present() { self.k / (self.k + 1.0) } else { 1.0 }
    }

    /// `1 - k = 1 / (K + 1)`: the share of what is scattered.
    #[must_use]
    pub fn scattered(self) -> f64 {
        1.0 / (self.k + 1.0)
    }

    /// Mean of the received gain at a gain `gain` of the direct path and a mean gain `mean` of the antenna.
    #[must_use]
    pub fn mean_gain(self, gain: f64, mean: f64) -> f64 {
        self.direct() * gain + self.scattered() * mean
    }
}

/// Scattering about each kind of receiver.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fading {
    /// About the user.
    pub user: Rician,
    /// About every eavesdropper.
    pub eavesdropper: Rician,
}

impl Default for Fading {
    /// None.
    fn default() -> Self {
        Self { user: Rician::NONE, eavesdropper: Rician::NONE }
    }
}

impl Fading {
    /// Whether anything is scattered anywhere.
    #[must_use]
    pub fn is_present(&self) -> bool {
        self.user.is_present() || self.eavesdropper.is_present()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    #[test]
    fn val_shares_of_round_factors() {
        let three = Rician::from_db(10.0 * 3f64.log10());
        assert!((three.direct() - 0.75).abs() < 1e-15 && (three.scattered() - 0.25).abs() < 1e-15);
        assert_eq!((Rician::NONE.direct(), Rician::NONE.scattered()), (1.0, 0.0));
        assert_eq!(Rician::NONE.mean_gain(0.3, 2.0 / 3.0), 0.3);
    }

    /// `K/(K+1) G + m/(K+1)` against the mean of the field's square.
    #[test]
    fn val_mean_power_is_that_of_many_draws() {
        let (rician, gain, mean) = (Rician::from_db(6.0), 0.2f64, 2.0f64 / 3.0);
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(3);
        let n = 400_000;
        let (mut sum, mut square) = (0.0, 0.0);
        for _ in 0..n {
            // Box and Muller: |z|^2 is exponential, its phase uniform.
            let size = (-(1.0 - rng.random::<f64>()).ln()).sqrt();
            let (im, re) = (std::f64::consts::TAU * rng.random::<f64>()).sin_cos();
            let (direct, around) =
                ((rician.direct() * gain).sqrt(), (rician.scattered() * mean).sqrt() * size);
            let power = (direct + around * re).powi(2) + (around * im).powi(2);
            sum += power;
            square += power * power;
        }
        let average = sum / f64::from(n);
        let error = ((square / f64::from(n) - average * average) / f64::from(n)).sqrt();
        assert!((average - rician.mean_gain(gain, mean)).abs() < 4.0 * error, "{average} {error}");
    }
}
