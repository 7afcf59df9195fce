//! The link budget: free-space paths through the antennas' patterns, and the SINR at a node.

use nalgebra::Vector3;

use super::antenna::Pattern;
use super::fading::Rician;

/// Least distance between a vehicle and a node in metres at which the far-field formula is evaluated: a node nearer
/// than this is treated as being this far away, so that no rate is infinite.
pub const NEAREST_M: f64 = 1e-3;

/// One transmitter as a node sees it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Transmitter<'a> {
    /// Position in metres, ENU.
    pub position_enu_m: Vector3<f64>,
    /// Antenna axis, a unit vector in ENU.
    pub axis: Vector3<f64>,
    /// Transmit power in W.
    pub tx_power_w: f64,
    /// The antenna's pattern about its axis.
    pub antenna: &'a Pattern,
}

/// Mean power received from `from` at `node_enu_m` in W: `b0 G P / d^2` of (1.5), where nothing is scattered; else the mean
/// over what is.
#[must_use]
pub fn received_power_w(
    from: &Transmitter<'_>,
    node_enu_m: &Vector3<f64>,
    rician: Rician,
    reference_gain: f64,
) -> f64 {
    let path = node_enu_m - from.position_enu_m;
    let gain = rician.mean_gain(from.antenna.gain(&path, &from.axis), from.antenna.mean());
    power_at_gain_w(from, node_enu_m, gain, reference_gain)
}

/// Power received from `from` at `node_enu_m` through an antenna gain, relative to the largest, of `gain`, in W.
#[must_use]
pub fn power_at_gain_w(
    from: &Transmitter<'_>,
    node_enu_m: &Vector3<f64>,
    gain: f64,
    reference_gain: f64,
) -> f64 {
    let path = node_enu_m - from.position_enu_m;
    let square = path.norm_squared().max(NEAREST_M * NEAREST_M);
    reference_gain * gain * from.tx_power_w.max(0.0) / square
}

/// SINR at a node (paper 1.5), linear: I's mean received power over J's plus the noise variance.
#[must_use]
pub fn sinr(
    i: &Transmitter<'_>,
    j: &Transmitter<'_>,
    node_enu_m: &Vector3<f64>,
    rician: Rician,
    reference_gain: f64,
    noise_w: f64,
) -> f64 {
    received_power_w(i, node_enu_m, rician, reference_gain)
        / (received_power_w(j, node_enu_m, rician, reference_gain) + noise_w)
}

/// b0 of (1.5) for a carrier: free-space path gain at one metre `(lambda / 4 pi)^2` times both antennas' gains.
#[must_use]
pub fn reference_gain(carrier_hz: f64, tx_gain: f64, rx_gain: f64) -> f64 {
    const LIGHT_M_S: f64 = 299_792_458.0;
    (LIGHT_M_S / (carrier_hz * 4.0 * std::f64::consts::PI)).powi(2) * tx_gain * rx_gain
}

#[cfg(test)]
mod tests {
    use super::*;

    fn level_at(x: f64, y: f64, z: f64, tx_power_w: f64) -> Transmitter<'static> {
        Transmitter {
            position_enu_m: Vector3::new(x, y, z),
            axis: Vector3::z(),
            tx_power_w,
            antenna: &Pattern::IDEAL,
        }
    }

    #[test]
    fn val_sinr_of_level_vehicles() {
        // I at 45 deg elevation: gain 1/2, d^2 = 2e4; J: gain 1/5, d^2 = 5e4.
        let (i, j) = (level_at(100.0, 0.0, 100.0, 0.5), level_at(0.0, 100.0, 200.0, 0.25));
        let node = Vector3::zeros();
        assert!((received_power_w(&i, &node, Rician::NONE, 1.0) / 1.25e-5 - 1.0).abs() < 1e-14);
        assert!((received_power_w(&j, &node, Rician::NONE, 1.0) / 1e-6 - 1.0).abs() < 1e-14);
        assert!((sinr(&i, &j, &node, Rician::NONE, 1.0, 1e-6) - 6.25).abs() < 1e-12);
        assert!((sinr(&i, &j, &node, Rician::NONE, 0.1, 1e-7) - 6.25).abs() < 1e-12);
    }

    #[test]
    fn val_null_above_a_node() {
        let (i, j) = (level_at(100.0, 0.0, 100.0, 0.5), level_at(0.0, 0.0, 80.0, 0.5));
        assert_eq!(received_power_w(&j, &Vector3::zeros(), Rician::NONE, 1.0), 0.0);
        assert!((sinr(&i, &j, &Vector3::zeros(), Rician::NONE, 1.0, 1e-12) / 1.25e7 - 1.0).abs() < 1e-12);
    }

    #[test]
    fn spec_negative_power_radiates_nothing() {
        assert_eq!(
            received_power_w(&level_at(1.0, 0.0, 0.0, -1.0), &Vector3::zeros(), Rician::NONE, 1.0),
            0.0
        );
    }

    /// In an exact null a floor of 20 dB leaves a hundredth, and scattering `m / (K + 1)`.
    #[test]
    fn val_what_reaches_a_null() {
        let antenna = Pattern::with_null_depth(20.0);
        let above = Transmitter { antenna: &antenna, ..level_at(0.0, 0.0, 100.0, 0.5) };
        let power_w = |k| received_power_w(&above, &Vector3::zeros(), k, 1.0);
        assert!((power_w(Rician::NONE) / 0.5e-6 - 1.0).abs() < 1e-12);
        let ten = Rician::from_db(10.0);
        let expected = 0.5e-4 * (10.0 * 0.01 + (1.0 - 0.99 / 3.0)) / 11.0;
        assert!((power_w(ten) / expected - 1.0).abs() < 1e-12);
    }

    #[test]
    fn val_reference_gain_at_2_4_ghz() {
        // 20 log10(4 pi 2.4e9 / c) = 40.05 dB at one metre.
        let db = -10.0 * reference_gain(2.4e9, 1.0, 1.0).log10();
        assert!((db - 40.05).abs() < 0.01, "{db}");
    }
}
