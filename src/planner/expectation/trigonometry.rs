//! Sine and cosine of a block of angles.
//!
//! Within 45 deg, where attitude noise nearly always is, by Taylor's series, whose first dropped term is below a hundredth
//! of the last place; beyond, by the library's functions. The same operations on every machine give the same bits.

use super::lanes::{LANES, Lane};

const FARTHEST: f64 = std::f64::consts::FRAC_PI_4;
const SINE: [f64; 9] = [
    1.0,
    -1.0 / 6.0,
    1.0 / 120.0,
    -1.0 / 5_040.0,
    1.0 / 362_880.0,
    -1.0 / 39_916_800.0,
    1.0 / 6_227_020_800.0,
    -1.0 / 1_307_674_368_000.0,
    1.0 / 355_687_428_096_000.0,
];
const COSINE: [f64; 9] = [
    1.0,
    -1.0 / 2.0,
    1.0 / 24.0,
    -1.0 / 720.0,
    1.0 / 40_320.0,
    -1.0 / 3_628_800.0,
    1.0 / 479_001_600.0,
    -1.0 / 87_178_291_200.0,
    1.0 / 20_922_789_888_000.0,
];

/// Cosine and sine.
#[must_use]
#[inline(always)]
pub fn cos_sin(x: &Lane) -> [Lane; 2] {
    let (mut cos, mut sin) = ([0.0; LANES], [0.0; LANES]);
    for l in 0..LANES {
        let square = x[l] * x[l];
        let (mut c, mut s) = (COSINE[8], SINE[8]);
        for k in (0..8).rev() {
            c = c * square + COSINE[k];
            s = s * square + SINE[k];
        }
        cos[l] = c;
        sin[l] = s * x[l];
    }
    for l in 0..LANES {
        // Not `> FARTHEST`: NaN goes to the library too.
        if !(x[l].abs() <= FARTHEST) {
            (sin[l], cos[l]) = libm::sincos(x[l]);
        }
    }
    [cos, sin]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_series_and_library_agree_to_the_last_place_or_two() {
        for k in -400..400 {
            let x = f64::from(k) * 0.01;
            let [cos, sin] = cos_sin(&[x; LANES]);
            assert!((cos[3] - x.cos()).abs() <= 2.3e-16, "{x}");
            assert!((sin[5] - x.sin()).abs() <= 2.3e-16, "{x}");
        }
        assert!(cos_sin(&[f64::NAN; LANES])[0][0].is_nan());
    }
}
