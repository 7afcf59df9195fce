//! Sums of logarithms with hardly any logarithms.
//!
//! `sum ln x_k = ln 2 * sum e_k + ln prod m_k` with `x_k = 2^e_k m_k`, m_k in [1, 2): exponents are added as integers and
//! mantissas multiplied, so that one logarithm serves some nine hundred factors. The relative error of the product is that
//! of as many roundings, which is what adding as many logarithms would cost.

use std::f64::consts::LN_2;

const MANTISSA_BITS: u32 = 52;
const MANTISSA: u64 = (1 << MANTISSA_BITS) - 1;
/// The exponent's bits of 1.
const ONE: u64 = 1023 << MANTISSA_BITS;
/// Products of mantissas are split again before they reach this.
const LARGE: f64 = 1e270;

/// The sum of the logarithms of positive numbers.
#[derive(Debug, Clone, Copy)]
pub struct LogSum {
    mantissa: f64,
    exponent: i64,
    /// Of what is no positive normal number: zero, infinite, NaN.
    rest: f64,
}

impl Default for LogSum {
    fn default() -> Self {
        Self { mantissa: 1.0, exponent: 0, rest: 0.0 }
    }
}

impl LogSum {
    /// Adds `ln x`.
    #[inline(always)]
    pub fn push(&mut self, x: f64) {
        let bits = x.to_bits();
        let biased = bits >> MANTISSA_BITS;
        // A negative number's sign makes it larger than any exponent.
        if !(1..=2046).contains(&biased) {
            self.rest += libm::log(x);
            return;
        }
        self.exponent += biased as i64 - 1023;
        self.mantissa *= f64::from_bits(bits & MANTISSA | ONE);
        if self.mantissa > LARGE {
            let bits = self.mantissa.to_bits();
            self.exponent += (bits >> MANTISSA_BITS) as i64 - 1023;
            self.mantissa = f64::from_bits(bits & MANTISSA | ONE);
        }
    }

    /// The sum.
    #[must_use]
    pub fn value(&self) -> f64 {
        self.exponent as f64 * LN_2 + libm::log(self.mantissa) + self.rest
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn sum(values: &[f64]) -> f64 {
        let mut sum = LogSum::default();
        values.iter().for_each(|x| sum.push(*x));
        sum.value()
    }

    #[test]
    fn spec_what_is_no_positive_number_is_not_lost() {
        assert_eq!(sum(&[]), 0.0);
        assert_eq!(sum(&[2.0, 0.0]), f64::NEG_INFINITY);
        assert_eq!(sum(&[2.0, f64::INFINITY]), f64::INFINITY);
        assert!(sum(&[2.0, f64::NAN, 3.0]).is_nan() && sum(&[2.0, -1.0]).is_nan());
        assert!((sum(&[f64::MIN_POSITIVE / 8.0]) + 1025.0 * LN_2).abs() < 1e-12);
    }

    proptest! {
        #[test]
        fn prop_the_sum_is_that_of_logarithms(exponents in prop::collection::vec(-250.0..250.0f64, 1..3000)) {
            let values: Vec<f64> = exponents.iter().map(|e| 10f64.powf(*e)).collect();
            let expected: f64 = values.iter().map(|x| x.ln()).sum();
            let scale: f64 = values.iter().map(|x| x.ln().abs()).sum();
            prop_assert!((sum(&values) - expected).abs() <= 1e-13 * (1.0 + scale));
        }
    }
}
