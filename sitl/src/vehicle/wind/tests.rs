//! Turbulence against the specification: moments, correlations, spectrum.

use super::*;

const DT: f64 = 0.0025;

/// Samples of the gust alone, every 10 ms, along, across and up, in a mean wind to the north.
fn gusts(wind: WindConfig, seconds: usize, seed: u64, height_m: f64) -> Vec<[f64; 3]> {
    let mut wind = Wind::new(wind, seed, 0);
    let mean = wind.mean_enu_m_s;
    (0..seconds * 100)
        .map(|_| {
            let mut last = Vector3::zeros();
            for _ in 0..HOLD_STEPS {
                last = wind.step(DT, height_m, &Vector3::zeros());
            }
            let gust = last - mean;
            [gust.y, -gust.x, gust.z]
        })
        .collect()
}

#[test]
fn val_scales_of_the_specification() {
    // At 1000 ft the model joins the medium-altitude one: all scales 1000 ft, all intensities alike.
    let top = Scales::at(1000.0 * FOOT_M, 10.0);
    assert!(
        (top.length_m[0] / FOOT_M - 1000.0).abs() < 1e-6 && (top.length_m[1] / FOOT_M - 1000.0).abs() < 1e-9
    );
    assert!((top.sigma_m_s[0] - 1.0).abs() < 1e-9 && (top.sigma_m_s[1] - 1.0).abs() < 1e-12);
    // At 100 ft, by hand: 0.2593^-0.4 = 1.7160, 100 / 0.2593^1.2 = 505.3.
    let low = Scales::at(100.0 * FOOT_M, 10.0);
    assert!((low.sigma_m_s[0] - 1.7160).abs() < 1e-3, "{low:?}");
    assert!((low.length_m[0] / FOOT_M - 505.3).abs() < 0.2, "{low:?}");
}

#[test]
fn val_gusts_have_their_variances_and_correlations() {
    // Strong flow through a short scale: time constants of 1.1, 1.1 and 0.15 s.
    let config = WindConfig { mean_enu_m_s: [0.0, 40.0, 0.0], turbulence_m_s: 10.0 };
    let height_m = 20.0 * FOOT_M;
    let scales = Scales::at(height_m, 10.0);
    let samples = gusts(config, 4000, 3, height_m);
    let n = samples.len() as f64;
    let lag = 10usize;
    for axis in 0..3 {
        let vertical = usize::from(axis == 2);
        let (sigma, t) = (scales.sigma_m_s[vertical], scales.length_m[vertical] / 40.0);
        let mean = samples.iter().map(|s| s[axis]).sum::<f64>() / n;
        let variance = samples.iter().map(|s| s[axis] * s[axis]).sum::<f64>() / n;
        let covariance = samples.iter().zip(&samples[lag..]).map(|(a, b)| a[axis] * b[axis]).sum::<f64>()
            / (n - lag as f64);
        let delta = lag as f64 * 0.01 / t;
        // Dryden's longitudinal and lateral correlations.
        let expected = if axis == 0 { (-delta).exp() } else { (-delta).exp() * (1.0 - 0.5 * delta) };
        // 4000 s over twice the time constant of 1.1 s are 1800 independent values or more.
        let error = 4.0 * (2.0f64 / 1800.0).sqrt();
        assert!(mean.abs() < 4.0 * sigma / 1800f64.sqrt(), "axis {axis}: {mean}");
        assert!((variance / (sigma * sigma) - 1.0).abs() < error, "axis {axis}: {variance} {sigma}");
        assert!((covariance / variance - expected).abs() < error, "axis {axis}: {covariance} {expected}");
    }
}

#[test]
fn val_the_spectrum_is_drydens() {
    let config = WindConfig { mean_enu_m_s: [0.0, 20.0, 0.0], turbulence_m_s: 8.0 };
    let height_m = 20.0;
    let scales = Scales::at(height_m, 8.0);
    let (length, blocks) = (2048usize, 400usize);
    let samples = gusts(config, blocks * length / 100 + 1, 9, height_m);
    for (axis, hz) in [(0, 0.5), (0, 3.0), (1, 0.5), (1, 3.0), (2, 1.0), (2, 5.0)] {
        let omega = std::f64::consts::TAU * hz;
        // Averaged periodogram under a Hann window; the bins are 0.05 Hz wide.
        let mut power = 0.0;
        for block in samples.chunks_exact(length).take(blocks) {
            let (mut re, mut im) = (0.0, 0.0);
            for (k, s) in block.iter().enumerate() {
                let window = 1.0 - (std::f64::consts::TAU * k as f64 / length as f64).cos();
                let angle = omega * k as f64 * 0.01;
                re += s[axis] * window * angle.cos();
                im += s[axis] * window * angle.sin();
            }
            power += re * re + im * im;
        }
        // Two-sided density per hertz; the window's mean square is 1.5.
        let measured = power / blocks as f64 * 0.01 / (length as f64 * 1.5);
        let vertical = usize::from(axis == 2);
        let (sigma, t) = (scales.sigma_m_s[vertical], scales.length_m[vertical] / 20.0);
        let x = (t * omega).powi(2);
        let shape = if axis == 0 { 2.0 / (1.0 + x) } else { (1.0 + 3.0 * x) / (1.0 + x).powi(2) };
        let dryden = sigma * sigma * t * shape;
        // Each block is exponentially distributed: 5% at 400 blocks. Sampling at 100 Hz folds in up to 1% more.
        assert!((measured / dryden - 1.0).abs() < 0.2, "axis {axis} {hz} Hz: {measured} {dryden}");
    }
}

#[test]
fn spec_calm_air_has_its_mean_alone_and_the_mean_can_change() {
    let mut wind = Wind::new(WindConfig { mean_enu_m_s: [3.0, -1.0, 0.5], turbulence_m_s: 0.0 }, 1, 0);
    assert_eq!(wind.step(DT, 30.0, &Vector3::zeros()), Vector3::new(3.0, -1.0, 0.5));
    wind.set_mean(Vector3::new(0.0, 7.0, 0.0));
    assert_eq!(wind.step(DT, 30.0, &Vector3::zeros()), Vector3::new(0.0, 7.0, 0.0));
}

#[test]
fn spec_gusts_are_the_seeds_and_the_vehicles_own() {
    let config = WindConfig { mean_enu_m_s: [0.0, 5.0, 0.0], turbulence_m_s: 5.0 };
    assert_eq!(gusts(config, 3, 4, 30.0), gusts(config, 3, 4, 30.0));
    assert_ne!(gusts(config, 3, 4, 30.0), gusts(config, 3, 5, 30.0));
    let other: Vec<_> = {
        let mut wind = Wind::new(config, 4, 1);
        (0..12).map(|_| wind.step(DT, 30.0, &Vector3::zeros()).x).collect()
    };
    assert_ne!(-other[3], gusts(config, 1, 4, 30.0)[0][1]);
}
