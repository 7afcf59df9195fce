//! The inverse of the standard normal distribution function.

/// The quantile of the standard normal distribution at `p` in (0, 1); infinite at the ends, NaN outside.
///
/// Wichura's algorithm AS 241 (Applied Statistics 37, 1988), PPND16: relative accuracy about 1e-16.
#[must_use]
pub fn quantile(p: f64) -> f64 {
    if (p - 0.5).abs() <= CENTRE_HALF_WIDTH { central(p) } else { outer(p) }
}

/// [`quantile`] of each.
#[must_use]
#[inline(always)]
pub fn quantiles<const COUNT: usize>(p: &[f64; COUNT]) -> [f64; COUNT] {
    // Five in six are central: all as if they were, then the others again.
    let mut out = [0.0; COUNT];
    for (x, p) in out.iter_mut().zip(p) {
        *x = central(*p);
    }
    for (x, p) in out.iter_mut().zip(p) {
        if !((p - 0.5).abs() <= CENTRE_HALF_WIDTH) {
            *x = outer(*p);
        }
    }
    out
}

const CENTRE_HALF_WIDTH: f64 = 0.425;

#[inline(always)]
fn central(p: f64) -> f64 {
    let q = p - 0.5;
    let r = 0.180_625 - q * q;
    q * polynomial(&CENTRE.0, r) / polynomial(&CENTRE.1, r)
}

fn outer(p: f64) -> f64 {
    let q = p - 0.5;
    let tail = if q < 0.0 { p } else { 1.0 - p };
    if tail == 0.0 {
        return f64::INFINITY.copysign(q);
    }
    let r = (-libm::log(tail)).sqrt();
    let x = if r <= 5.0 {
        polynomial(&MIDDLE.0, r - 1.6) / polynomial(&MIDDLE.1, r - 1.6)
    } else {
        polynomial(&FAR.0, r - 5.0) / polynomial(&FAR.1, r - 5.0)
    };
    x.copysign(q)
}

#[inline(always)]
fn polynomial(coefficients: &[f64; 8], x: f64) -> f64 {
    let mut sum = coefficients[7];
    for k in (0..7).rev() {
        sum = sum * x + coefficients[k];
    }
    sum
}

type Rational = ([f64; 8], [f64; 8]);

const CENTRE: Rational = (
    [
        3.387_132_872_796_366_6,
        133.141_667_891_784_38,
        1_971.590_950_306_551_4,
        13_731.693_765_509_46,
        45_921.953_931_549_87,
        67_265.770_927_008_7,
        33_430.575_583_588_13,
        2_509.080_928_730_122_7,
    ],
    [
        1.0,
        42.313_330_701_600_91,
        687.187_007_492_057_9,
        5_394.196_021_424_751,
        21_213.794_301_586_597,
        39_307.895_800_092_71,
        28_729.085_735_721_943,
        5_226.495_278_852_855,
    ],
);

const MIDDLE: Rational = (
    [
        1.423_437_110_749_683_5,
        4.630_337_846_156_546,
        5.769_497_221_460_691,
        3.647_848_324_763_204_5,
        1.270_458_252_452_368_4,
        0.241_780_725_177_450_6,
        2.272_384_498_926_918_4e-2,
        7.745_450_142_783_414e-4,
    ],
    [
        1.0,
        2.053_191_626_637_759,
        1.676_384_830_183_803_8,
        0.689_767_334_985_1,
        0.148_103_976_427_480_08,
        1.519_866_656_361_645_7e-2,
        5.475_938_084_995_345e-4,
        1.050_750_071_644_416_9e-9,
    ],
);

const FAR: Rational = (
    [
        6.657_904_643_501_103,
        5.463_784_911_164_114,
        1.784_826_539_917_291_3,
        0.296_560_571_828_504_87,
        2.653_218_952_657_612_4e-2,
        1.242_660_947_388_078_4e-3,
        2.711_555_568_743_487_6e-5,
        2.010_334_399_292_288_1e-7,
    ],
    [
        1.0,
        0.599_832_206_555_888,
        0.136_929_880_922_735_8,
        1.487_536_129_085_061_5e-2,
        7.868_691_311_456_133e-4,
        1.846_318_317_510_054_8e-5,
        1.421_511_758_316_446e-7,
        2.044_263_103_389_939_8e-15,
    ],
);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_tabulated_quantiles() {
        for (p, x) in [
            (0.5, 0.0),
            (0.975, 1.959_963_984_540_054),
            (0.995, 2.575_829_303_548_900_4),
            (0.841_344_746_068_542_9, 1.0),
            (0.9, 1.281_551_565_544_600_4),
            (1e-3, -3.090_232_306_167_813_5),
            (1e-10, -6.361_340_902_404_056),
            (1e-12, -7.034_483_825_301_132),
        ] {
            assert!((quantile(p) - x).abs() < 1e-13, "{p}: {}", quantile(p));
        }
    }

    #[test]
    fn val_derivative_is_the_inverse_density() {
        // Through the regions' borders: dx/dp = sqrt(2 pi) exp(x^2 / 2).
        for k in 1..400 {
            let p = f64::from(k) / 400.0;
            let x = quantile(p);
            let slope = (quantile(p + 1e-6) - quantile(p - 1e-6)) / 2e-6;
            let expected = (2.0 * std::f64::consts::PI).sqrt() * (x * x / 2.0).exp();
            assert!((slope / expected - 1.0).abs() < 1e-5, "{p}");
            assert!((quantile(1.0 - p) + x).abs() < 1e-13);
        }
    }

    #[test]
    fn val_many_at_once_are_one_by_one() {
        for k in 0..100 {
            let p = [0, 1, 2, 3, 4, 5, 6, 7].map(|l: u32| (f64::from(8 * k + l) + 0.5) / 800.0);
            assert_eq!(quantiles(&p), p.map(quantile));
        }
        assert_eq!(quantiles(&[0.0, 0.5, 1.0]), [f64::NEG_INFINITY, 0.0, f64::INFINITY]);
        assert!(quantiles(&[f64::NAN])[0].is_nan());
    }

    #[test]
    fn val_ends_are_infinite() {
        assert_eq!((quantile(0.0), quantile(1.0)), (f64::NEG_INFINITY, f64::INFINITY));
    }
}
