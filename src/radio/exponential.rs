//! The exponential integral `E_1` (Abramowitz and Stegun 5.1.11, 5.1.22): its series to 2, above it Lentz's continued fraction,
//! in two forms, each finite where the other is not. Accurate to 1e-12.

/// The Euler-Mascheroni constant.
pub(crate) const EULER_GAMMA: f64 = 0.577_215_664_901_532_9;
/// Up to here the series is taken.
const BORDER: f64 = 2.0;

/// `ln x + E_1(x)`, down to 0: with `x = a^2` the mean of `ln |a + z|^2`, z complex normal with `E |z|^2 = 1`.
pub(crate) fn ln_and_integral(x: f64) -> f64 {
    if x <= BORDER { series(x) } else { libm::log(x) + fraction(x) * libm::exp(-x) }
}

/// `exp(x) E_1(x)` of a positive `x`: the mean of `ln(1 + X / x)`, X exponential of mean 1.
pub(crate) fn scaled_integral(x: f64) -> f64 {
    if x <= BORDER { libm::exp(x) * (series(x) - libm::log(x)) } else { fraction(x) }
}

/// `ln x + E_1(x)`.
fn series(x: f64) -> f64 {
    let (mut sum, mut term) = (-EULER_GAMMA, 1.0);
    for n in 1..40 {
        let n = f64::from(n);
        term *= -x / n;
        sum -= term / n;
    }
    sum
}

/// `exp(x) E_1(x)`.
fn fraction(x: f64) -> f64 {
    let mut b = x + 1.0;
    let (mut c, mut d) = (f64::MAX, 1.0 / b);
    let mut fraction = d;
    for n in 1..100 {
        let a = -f64::from(n * n);
        b += 2.0;
        d = 1.0 / (a * d + b);
        c = b + a / c;
        fraction *= c * d;
    }
    fraction
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_the_exponential_integral_has_its_tabled_values() {
        // Abramowitz and Stegun, tables 5.1 and 5.2; 1.9 and 2.1 lie on either side of the two formulas' border.
        for (x, e1) in [
            (0.01, 4.037_929_577),
            (0.1, 1.822_923_958_4),
            (0.5, 0.559_773_595),
            (1.0, 0.219_383_934_4),
            (1.9, 0.056_204_378_2),
            (2.0, 0.048_900_511),
            (2.1, 0.042_614_341_5),
            (5.0, 0.001_148_295_591),
        ] {
            let found = ln_and_integral(x) - f64::ln(x);
            assert!((found - e1).abs() < 1e-9, "{x}: {found}");
            assert!((scaled_integral(x) * f64::exp(-x) / e1 - 1.0).abs() < 1e-8, "{x}");
        }
        assert!((ln_and_integral(0.0) + EULER_GAMMA).abs() < 1e-15);
        assert!((scaled_integral(10.0) - 0.091_563_334).abs() < 1e-8);
    }
}
