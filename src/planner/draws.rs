//! How the rates at several draws of uncertain positions make one objective: their low quantile, or their least.

/// The quantile that is maximised.
pub const QUANTILE: f64 = 0.05;

/// How the rates of draws are combined.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Combination {
    /// The smoothed quantile of so many draws, of which those present are the lowest: their mean with a triangular weight
    /// about the quantile's rank.
    Quantile {
        /// All draws.
        of: usize,
        /// Half the base of the triangle, as a share of the draws; at most the quantile itself.
        width: f64,
    },
    /// The soft minimum of this sharpness.
    SoftMinimum(f64),
}

/// A weight that counts for nothing beside the largest, which is 1.
const NEGLIGIBLE: f64 = 1e-12;

/// Rates of draws and how much each counts in their combination; reusable memory.
#[derive(Debug, Clone, Default)]
pub struct Draws {
    /// The rates.
    pub values: Vec<f64>,
    weights: Vec<f64>,
    order: Vec<usize>,
}

impl Draws {
    /// The draws by rising rate, as the quantile was last taken.
    pub fn lowest_first(&self) -> &[usize] {
        &self.order
    }

    /// The derivative of the combined rate by each draw's, as last taken.
    pub fn weights(&self) -> &[f64] {
        &self.weights
    }

    /// The combined rate.
    pub fn combine(&mut self, combination: Combination) -> f64 {
        self.weights.clear();
        self.weights.resize(self.values.len(), 0.0);
        match combination {
            Combination::Quantile { of, width } => {
                self.order.clear();
                self.order.extend(0..self.values.len());
                self.order
                    .sort_unstable_by(|a, b| self.values[*a].total_cmp(&self.values[*b]).then(a.cmp(b)));
                let n = of as f64;
                let weight =
                    |rank: usize| (1.0 - ((rank as f64 + 0.5) / n - QUANTILE).abs() / width).max(0.0);
                let total: f64 = (0..self.order.len()).map(weight).sum::<f64>().max(f64::MIN_POSITIVE);
                let mut value = 0.0;
                for (rank, draw) in self.order.iter().enumerate() {
                    self.weights[*draw] = weight(rank) / total;
                    value += self.weights[*draw] * self.values[*draw];
                }
                value
            }
            Combination::SoftMinimum(q) => {
                let least = self.values.iter().copied().fold(f64::INFINITY, f64::min);
                for (weight, value) in self.weights.iter_mut().zip(&self.values) {
                    let own = libm::exp(-q * (value - least));
                    *weight = if own > NEGLIGIBLE { own } else { 0.0 };
                }
                let total: f64 = self.weights.iter().sum();
                self.weights.iter_mut().for_each(|weight| *weight /= total);
                least - libm::log(total) / q
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_soft_minimum_and_quantile_of_known_values() {
        let mut draws = Draws { values: (0..40).map(f64::from).collect(), ..Draws::default() };
        let derivative = |draws: &Draws| draws.weights().to_vec();
        // Ranks 0 to 3 of 40, weights 1/4, 3/4, 3/4, 1/4: symmetric about the 5% point, 1.5.
        let whole = Combination::Quantile { of: 40, width: QUANTILE };
        assert!((draws.combine(whole) - 1.5).abs() < 1e-12);
        for (weight, known) in derivative(&draws).iter().zip([0.125, 0.375, 0.375, 0.125, 0.0]) {
            assert!((weight - known).abs() < 1e-12);
        }
        assert_eq!(draws.lowest_first()[..4], [0, 1, 2, 3]);
        assert!(draws.combine(Combination::SoftMinimum(1e3)).abs() < 1e-12);
        assert_eq!(derivative(&draws)[..2], [1.0, 0.0]);
        let soft = draws.combine(Combination::SoftMinimum(1.0));
        assert!((soft + (1.0 / (1.0 - (-1f64).exp())).ln()).abs() < 1e-12);
        assert!((derivative(&draws)[0] - (1.0 - (-1f64).exp())).abs() < 1e-12);
    }
}
