//! A quantile of a sample, with how well the sample knows it.

use serde::{Deserialize, Serialize};

/// A quantile and its standard error.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Quantile {
    /// Interpolated between order statistics.
    pub value: f64,
    /// Half the distance between the order statistics one deviation to either side; `null` of a sample too small to have
    /// them.
    pub standard_error: Option<f64>,
}

impl Quantile {
    /// The quantile at `share`, from 0 to 1, of values in any order; `None` of no values.
    ///
    /// Of n values some n p lie below the quantile at p, with a deviation of sqrt(n p (1 - p)), whatever they are
    /// distributed by (David and Nagaraja, Order Statistics, 7.1).
    #[must_use]
    pub fn of(values: &[f64], share: f64) -> Option<Self> {
        let mut sorted = values.to_vec();
        sorted.sort_by(f64::total_cmp);
        let last = sorted.len().checked_sub(1)? as f64;
        let at = |rank: f64| {
            let rank = rank.clamp(0.0, last);
            let (below, part) = (rank.floor(), rank.fract());
            let above = sorted[rank.ceil() as usize];
            sorted[below as usize] + part * (above - sorted[below as usize])
        };
        let n = sorted.len() as f64;
        let (rank, deviation) = (last * share, (n * share * (1.0 - share)).sqrt());
        let known = rank - deviation >= 0.0 && rank + deviation <= last;
        Some(Self {
            value: at(rank),
            standard_error: known.then(|| (at(rank + deviation) - at(rank - deviation)) / 2.0),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    #[test]
    fn val_of_equal_steps_by_hand() {
        // 0, 10, ..., 1000: the quantile at 5% is 50; 101 * 0.05 * 0.95 = 4.8 values are its variance.
        let values: Vec<f64> = (0..=100).rev().map(|k| f64::from(k) * 10.0).collect();
        let found = Quantile::of(&values, 0.05).unwrap();
        assert!((found.value - 50.0).abs() < 1e-9);
        assert!((found.standard_error.unwrap() - 10.0 * (101.0f64 * 0.05 * 0.95).sqrt()).abs() < 1e-9);
        assert_eq!(Quantile::of(&[3.0, 1.0], 0.5).unwrap().value, 2.0);
        assert_eq!(Quantile::of(&[3.0], 0.05), Some(Quantile { value: 3.0, standard_error: None }));
        assert_eq!(Quantile::of(&[], 0.05), None);
    }

    #[test]
    fn val_the_stated_error_is_the_scatter_over_samples() {
        // Exponential values: the quantile at p is -ln(1 - p), its deviation sqrt(p / (n (1 - p))) for large n.
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(5);
        let (samples, n, share) = (400, 500, 0.05);
        let found: Vec<Quantile> = (0..samples)
            .map(|_| {
                let values: Vec<f64> = (0..n).map(|_| -(1.0 - rng.random::<f64>()).ln()).collect();
                Quantile::of(&values, share).unwrap()
            })
            .collect();
        let count = f64::from(samples);
        let (truth, deviation) = (-(1.0 - share).ln(), (share / (1.0 - share) / f64::from(n)).sqrt());
        let mean = found.iter().map(|q| q.value).sum::<f64>() / count;
        let variance = found.iter().map(|q| (q.value - truth).powi(2)).sum::<f64>() / count;
        let stated = found.iter().filter_map(|q| q.standard_error).sum::<f64>() / count;
        // The interpolated order statistic is off by less than a value's worth, 1/n.
        assert!((mean - truth).abs() < 4.0 * deviation / count.sqrt() + 1.0 / f64::from(n), "{mean} {truth}");
        assert!(
            (variance.sqrt() / deviation - 1.0).abs() < 4.0 / (2.0 * count).sqrt(),
            "{variance} {deviation}"
        );
        assert!((stated / deviation - 1.0).abs() < 0.1, "{stated} {deviation}");
    }
}
