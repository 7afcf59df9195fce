//! What arrives beside the direct wave: scattering from the surroundings, which fills nulls and fades.
//!
//! A receiver hears `P b0 / d^2 |sqrt(k G) + sqrt((1 - k) m) z|^2` of a vehicle: G is the pattern's gain towards it, m the
//! pattern's mean over all directions, k = K / (K + 1) the direct share, and z a complex Gaussian with E|z|^2 = 1, of its
//! own for each pair of vehicle and receiver. The mean is k G + (1 - k) m.

use nalgebra::Complex;

use crate::random::{Noise, decay};
use crate::vehicle::SAMPLE;
use crate::vehicle::antenna::linear;

/// The Rician law of a kind of receiver.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rician {
    /// Direct over scattered power, where the antenna is as strong as it is on average, dB.
    pub k_db: f64,
    /// After this time the scattering has kept 1/e of what it was, seconds; 0 draws every radio sample (5 ms) afresh.
    pub coherence_s: f64,
}

/// What the site scatters. The default is nothing.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Fading {
    /// On the way to users.
    pub user: Option<Rician>,
    /// On the way to eavesdroppers.
    pub eavesdropper: Option<Rician>,
}

impl Fading {
    /// The first value that nothing scatters with.
    pub(crate) fn fault(&self) -> Option<(&'static str, f64)> {
        [self.user, self.eavesdropper].into_iter().flatten().find_map(|Rician { k_db, coherence_s }| {
            let lasts = coherence_s.is_finite() && coherence_s >= 0.0;
            let k = (!k_db.is_finite()).then_some(("fading.k_db", k_db));
            k.or_else(|| (!lasts).then_some(("fading.coherence_s", coherence_s)))
        })
    }
}

/// One way from a vehicle to a receiver: a stationary first-order Gauss-Markov process, advanced exactly.
#[derive(Debug, Clone)]
pub(crate) struct Path {
    /// The direct share k.
    direct: f64,
    /// What is left of the scattering from one radio sample to the next.
    keep: f64,
    scattered: Complex<f64>,
    noise: Noise,
}

impl Path {
    pub fn new(law: Rician, mut noise: Noise) -> Self {
        let factor = linear(law.k_db);
        Self {
            // Of a K so large that it overflows, everything is direct.
            direct: if factor.is_finite() { factor / (factor + 1.0) } else { 1.0 },
            keep: decay(SAMPLE.as_secs_f64(), law.coherence_s),
            scattered: circular(&mut noise),
            noise,
        }
    }

    /// The next radio sample.
    pub fn advance(&mut self) {
        let fresh = circular(&mut self.noise);
        self.scattered = self.scattered * self.keep + fresh * (1.0 - self.keep * self.keep).sqrt();
    }

    /// What takes the place of the pattern's gain towards the receiver.
    pub fn gain(&self, pattern: f64, mean: f64) -> f64 {
        let direct = Complex::from((self.direct * pattern).sqrt());
        (direct + self.scattered * ((1.0 - self.direct) * mean).sqrt()).norm_sqr()
    }
}

/// Complex Gaussian with E|z|^2 = 1, no phase before another.
fn circular(noise: &mut Noise) -> Complex<f64> {
    Complex::new(noise.normal(), noise.normal()) * std::f64::consts::FRAC_1_SQRT_2
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Purpose;

    fn path(k_db: f64, coherence_s: f64, seed: u64) -> Path {
        Path::new(Rician { k_db, coherence_s }, Noise::new(seed, Purpose::PathsToUsers, 0))
    }

    #[test]
    fn val_received_power_has_the_rician_mean_and_variance() {
        // In a maximum, on a slope and in a null; from nearly no direct wave to nearly nothing else.
        for (seed, (k_db, gain, mean)) in [
            (-10.0, 1.0, 0.667),
            (6.0, 0.4, 0.667),
            (15.0, 1e-3, 0.668),
            (15.0, 0.0, 0.7),
            (30.0, 1.0, 0.667),
        ]
        .into_iter()
        .enumerate()
        {
            let mut path = path(k_db, 0.0, seed as u64);
            let n = 200_000;
            let powers: Vec<f64> = (0..n)
                .map(|_| {
                    path.advance();
                    path.gain(gain, mean)
                })
                .collect();
            let k = 10f64.powf(k_db / 10.0) / (1.0 + 10f64.powf(k_db / 10.0));
            // |a + s z|^2, a^2 = k G, s^2 = (1 - k) m: mean a^2 + s^2, variance s^4 + 2 a^2 s^2.
            let (direct, scattered) = (k * gain, (1.0 - k) * mean);
            let (expected, variance) = (direct + scattered, scattered * (scattered + 2.0 * direct));
            let n = f64::from(n);
            let average = powers.iter().sum::<f64>() / n;
            assert!(
                (average - expected).abs() < 4.0 * (variance / n).sqrt(),
                "{k_db} {gain}: {average} {expected}"
            );
            let squares = powers.iter().map(|p| (p - expected).powi(2)).sum::<f64>() / n;
            // Of a power the fourth central moment is at most nine variances squared.
            assert!(
                (squares / variance - 1.0).abs() < 4.0 * (8.0 / n).sqrt(),
                "{k_db} {gain}: {squares} {variance}"
            );
        }
    }

    #[test]
    fn val_scattering_is_circular_and_forgets_at_its_coherence_time() {
        let mut path = path(3.0, 0.05, 4);
        let n = 400_000;
        let z: Vec<Complex<f64>> = (0..n)
            .map(|_| {
                path.advance();
                path.scattered
            })
            .collect();
        let lag = |samples: usize, of: fn(Complex<f64>, Complex<f64>) -> f64| {
            z.iter().zip(&z[samples..]).map(|(a, b)| of(*a, *b)).sum::<f64>() / (n - samples) as f64
        };
        // Ten samples are a coherence time, so that n holds n (1 - a) / (1 + a) independent values, a = exp(-0.1).
        let independent = f64::from(n as u32) * (0.05f64).tanh();
        let allowed = 4.0 / independent.sqrt();
        for samples in [0, 3, 10, 20] {
            let expected = (-(samples as f64) * 0.005 / 0.05).exp();
            let found = lag(samples, |a, b| (a.conj() * b).re);
            assert!((found - expected).abs() < allowed, "{samples}: {found} {expected}");
            // No rotation, and neither part leans on the other.
            assert!(lag(samples, |a, b| (a.conj() * b).im).abs() < allowed);
            assert!(lag(samples, |a, b| a.re * b.im).abs() < allowed);
        }
        assert!((lag(0, |a, _| a.re * a.re) - 0.5).abs() < allowed);
    }

    #[test]
    fn val_scattering_begins_as_it_goes_on() {
        let n = 20_000;
        let mean = (0..n).map(|seed| path(0.0, 10.0, seed).scattered.norm_sqr()).sum::<f64>() / n as f64;
        // |z|^2 is exponential: its variance is 1.
        assert!((mean - 1.0).abs() < 4.0 / (n as f64).sqrt(), "{mean}");
    }
}
