use std::f64::consts::PI;

use super::*;

/// A line that makes this angle with the x axis.
fn line(angle_deg: f64) -> Vector3<f64> {
    let (s, c) = angle_deg.to_radians().sin_cos();
    Vector3::new(c, 0.6 * s, 0.8 * s) * 37.0
}

fn gain(antenna: &Antenna, angle_deg: f64) -> f64 {
    Pattern::new(antenna).gain(&Vector3::x(), &line(angle_deg))
}

#[test]
fn val_the_dipole_and_its_floor_are_the_closed_forms() {
    for angle_deg in [0.0f64, 1.0, 17.0, 45.0, 90.0, 130.0, 179.5] {
        let squared = angle_deg.to_radians().sin().powi(2);
        assert!((gain(&Antenna::Dipole, angle_deg) - squared).abs() < 1e-14);
        // 25 dB: the leakage f is 10^-2.5, and what is left of the dipole is 1 - f.
        let floor = 10f64.powf(-2.5) + (1.0 - 10f64.powf(-2.5)) * squared;
        assert!((gain(&Antenna::NullDepth { depth_db: 25.0 }, angle_deg) - floor).abs() < 1e-14);
    }
    assert!((gain(&Antenna::NullDepth { depth_db: 0.0 }, 63.0) - 1.0).abs() < 1e-14);
}

/// Asymmetric, with its peak between two points of different distance.
const MEASURED: [[f64; 2]; 7] =
    [[0.0, -22.0], [20.0, -9.0], [50.0, -2.5], [90.0, 0.0], [100.0, -0.4], [150.0, -8.0], [180.0, -17.0]];

#[test]
fn val_a_measured_pattern_is_scipys_pchip() {
    // scipy.interpolate.PchipInterpolator (SciPy 1.17.1) over the angle, of 10^(dB/10).
    let expected = [
        (0.0, 0.006309573444802),
        (5.0, 0.02444017540554),
        (13.0, 0.07187675610358),
        (33.0, 0.295011377434402),
        (70.0, 0.844042779518079),
        (95.0, 0.969127709835897),
        (99.0, 0.922977779876291),
        (120.0, 0.603682936608191),
        (149.0, 0.165677651949683),
        (163.0, 0.076960269352163),
        (178.0, 0.022091589942202),
        (180.0, 0.019952623149689),
    ];
    let antenna = Antenna::Measured { gain_db: MEASURED.to_vec() };
    for (angle_deg, value) in expected {
        assert!((gain(&antenna, angle_deg) - value).abs() < 1e-12, "{angle_deg}");
    }
    // Its mean by scipy.integrate.quad.
    assert!((Pattern::new(&antenna).mean() - 0.6087445815648405).abs() < 1e-9);
}

#[test]
fn prop_a_measured_pattern_is_monotonic_between_its_points() {
    let antenna = Antenna::Measured { gain_db: MEASURED.to_vec() };
    for pair in MEASURED.windows(2) {
        let rises = pair[1][1] > pair[0][1];
        let step = (pair[1][0] - pair[0][0]) / 100.0;
        for k in 0..100 {
            let [a, b] = [k, k + 1].map(|k| gain(&antenna, pair[0][0] + step * f64::from(k)));
            assert!(if rises { b >= a - 1e-12 } else { b <= a + 1e-12 }, "{pair:?} {k}");
        }
    }
}

#[test]
fn val_a_finely_sampled_dipole_is_the_dipole_with_its_mean() {
    let depth_db = 20.0;
    let closed = Antenna::NullDepth { depth_db };
    let points = (0..=180).map(|angle| [f64::from(angle), 10.0 * gain(&closed, f64::from(angle)).log10()]);
    let sampled = Antenna::Measured { gain_db: points.collect() };
    for angle_deg in [0.4, 3.3, 44.4, 89.7, 91.2, 171.9] {
        assert!((gain(&sampled, angle_deg) - gain(&closed, angle_deg)).abs() < 1e-4, "{angle_deg}");
    }
    // 1 - (1 - f)/3, and the same by adding up rings of the sphere.
    let mean = 1.0 - (1.0 - 0.01) / 3.0;
    let rings: f64 = (0..1000)
        .map(|k| PI * (f64::from(k) + 0.5) / 1000.0)
        .map(|angle| gain(&closed, angle.to_degrees()) * angle.sin() * PI / 2000.0)
        .sum();
    assert!((Pattern::new(&closed).mean() - mean).abs() < 1e-14 && (rings - mean).abs() < 1e-5, "{rings}");
    assert!((Pattern::new(&sampled).mean() - mean).abs() < 1e-4);
}

#[test]
fn spec_antennas_that_cannot_be_are_refused() {
    let measured = |gain_db: &[[f64; 2]]| Antenna::Measured { gain_db: gain_db.to_vec() };
    let bad = [
        Antenna::NullDepth { depth_db: -1.0 },
        Antenna::NullDepth { depth_db: f64::INFINITY },
        measured(&[]),
        measured(&[[0.0, 0.0]]),
        measured(&[[1.0, -20.0], [90.0, 0.0], [180.0, -20.0]]),
        measured(&[[0.0, -20.0], [90.0, 0.0], [179.0, -20.0]]),
        measured(&[[0.0, -20.0], [90.0, 0.0], [90.0, -1.0], [180.0, -20.0]]),
        measured(&[[0.0, f64::NAN], [180.0, 0.0]]),
    ];
    for antenna in bad {
        assert!(antenna.fault().is_some(), "{antenna:?}");
    }
    for antenna in [Antenna::Dipole, Antenna::NullDepth { depth_db: 0.0 }, measured(&MEASURED)] {
        assert_eq!(antenna.fault(), None);
    }
}
