//! How the rates at several draws of uncertain positions make one objective: their low quantile, or their least.

use super::expectation::kernel::Raw;

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

/// Rates and gradients of draws, and their combination; reusable memory.
#[derive(Debug, Clone, Default)]
pub struct Draws {
    values: Vec<f64>,
    gradients: Vec<Raw>,
    order: Vec<usize>,
}

impl Draws {
    /// Forgets all draws.
    pub fn clear(&mut self) {
        self.values.clear();
        self.gradients.clear();
    }

    /// Adds a draw's rate and gradient.
    pub fn push(&mut self, value: f64, gradient: &Raw) {
        self.values.push(value);
        self.gradients.push(*gradient);
    }

    /// The draws by rising rate, as the quantile was last taken.
    pub fn lowest_first(&self) -> &[usize] {
        &self.order
    }

    /// The combined rate and its gradient.
    pub fn combine(&mut self, combination: Combination, gradient: &mut Raw) -> f64 {
        gradient.fill(0.0);
        let mut add = |weight: f64, of: &Raw| {
            for (g, c) in gradient.iter_mut().zip(of) {
                *g += weight * c;
            }
        };
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
                for (rank, draw) in self.order.iter().enumerate().filter(|(rank, _)| weight(*rank) > 0.0) {
                    value += weight(rank) / total * self.values[*draw];
                    add(weight(rank) / total, &self.gradients[*draw]);
                }
                value
            }
            Combination::SoftMinimum(q) => {
                let least = self.values.iter().copied().fold(f64::INFINITY, f64::min);
                let weight = |value: f64| libm::exp(-q * (value - least));
                let total: f64 = self.values.iter().map(|v| weight(*v)).sum();
                for (value, of) in self.values.iter().zip(&self.gradients) {
                    add(weight(*value) / total, of);
                }
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
        let mut draws = Draws::default();
        for k in 0..40 {
            let mut gradient = [0.0; 14];
            gradient[0] = f64::from(k);
            draws.push(f64::from(k), &gradient);
        }
        let mut gradient = [0.0; 14];
        // Ranks 0 to 3 of 40, weights 1/4, 3/4, 3/4, 1/4: symmetric about the 5% point, 1.5.
        assert!(
            (draws.combine(Combination::Quantile { of: 40, width: QUANTILE }, &mut gradient) - 1.5).abs()
                < 1e-12
        );
        assert!((gradient[0] - 1.5).abs() < 1e-12);
        assert!(draws.combine(Combination::SoftMinimum(1e3), &mut gradient).abs() < 1e-12);
        assert!(gradient[0].abs() < 1e-12);
        let soft = draws.combine(Combination::SoftMinimum(1.0), &mut gradient);
        assert!((soft + (1.0 / (1.0 - (-1f64).exp())).ln()).abs() < 1e-12);
    }
}
