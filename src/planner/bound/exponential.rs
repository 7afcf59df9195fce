//! The exponential integral.

/// Euler's constant.
pub(super) const EULER: f64 = 0.577_215_664_901_532_9;

/// `exp(x) E_1(x)` of a positive `x`, which is `E ln(1 + X / x)` of an exponential X of mean 1: by its series (Abramowitz and Stegun
/// 5.1.11) below 1 and its continued fraction (5.1.22) above. Relative error below 1e-11.
pub(super) fn scaled_integral(x: f64) -> f64 {
    if x < 1.0 {
        let (mut sum, mut term) = (-EULER - x.ln(), -1.0);
        for k in 1..=20 {
            let k = f64::from(k);
            term *= -x / k;
            sum += term / k;
        }
        return x.exp() * sum;
    }
    // From its far end.
    let mut tail = 0.0;
    for k in (1..=60).rev() {
        let k = f64::from(k);
        tail = k / (1.0 + k / (x + tail));
    }
    1.0 / (x + tail)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_the_integral_is_that_of_the_tables() {
        // Abramowitz and Stegun, tables 5.1 and 5.2; and both roads where they meet.
        for (x, e_1) in
            [(0.01, 4.037_929_577), (0.5, 0.559_773_595), (1.0, 0.219_383_934), (2.0, 0.048_900_511)]
        {
            assert!((scaled_integral(x) * f64::exp(-x) / e_1 - 1.0).abs() < 1e-8, "{x}");
        }
        assert!((scaled_integral(10.0) - 0.091_563_334).abs() < 1e-8);
        let [below, above] = [1.0 - 1e-9, 1.0].map(scaled_integral);
        assert!((below / above - 1.0).abs() < 1e-8, "{below} {above}");
    }
}
