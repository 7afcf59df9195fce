//! The secrecy rate.

/// Spectral efficiency that is secret, bit/s/Hz and signed: `log2(1 + Gamma_0) - max_j log2(1 + Gamma_j)`, (1.6)
/// without B and [.]^+. With no eavesdropper it is the user's own.
#[must_use]
pub fn signed_bit_s_hz(user_sinr: f64, eavesdropper_sinr: impl IntoIterator<Item = f64>) -> f64 {
    let strongest = eavesdropper_sinr.into_iter().fold(0.0, f64::max);
    (libm::log1p(user_sinr) - libm::log1p(strongest)) / std::f64::consts::LN_2
}

/// The secrecy rate in bit/s (paper 1.6): `B [log2(1 + Gamma_0) - max_j log2(1 + Gamma_j)]^+`.
#[must_use]
pub fn rate_bps(bandwidth_hz: f64, user_sinr: f64, eavesdropper_sinr: impl IntoIterator<Item = f64>) -> f64 {
    bandwidth_hz * signed_bit_s_hz(user_sinr, eavesdropper_sinr).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_rate_of_round_sinrs() {
        assert!((rate_bps(1e6, 15.0, [3.0, 1.0]) - 2e6).abs() < 1e-6);
        assert_eq!(rate_bps(1e6, 1.0, [3.0]), 0.0);
        assert!((signed_bit_s_hz(1.0, [3.0]) + 1.0).abs() < 1e-15);
        assert!((signed_bit_s_hz(7.0, []) - 3.0).abs() < 1e-15);
    }
}
