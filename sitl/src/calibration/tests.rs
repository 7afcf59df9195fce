use nalgebra::{Quaternion, UnitQuaternion};

use super::*;

fn short() -> CalibrationConfig {
    CalibrationConfig { duration_s: 180.0, ..CalibrationConfig::default() }
}

/// The angle between antenna and receiver, degrees, from these columns of a reading.
fn angle_deg(config: &CalibrationConfig, position: [f64; 3], wxyz: [f64; 4]) -> f64 {
    let [w, x, y, z] = wxyz;
    let attitude = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
    let axis = attitude * Vector3::z();
    axis.angle(&(Vector3::from(config.receiver_enu_m) - Vector3::from(position))).to_degrees()
}

#[test]
fn spec_all_angles_are_seen_from_all_sides_at_a_safe_distance() {
    let config = short();
    let readings = fly(&config).unwrap();
    assert_eq!(readings.len(), 3600);
    let mut seen = [0; 18];
    for reading in &readings {
        let angle = angle_deg(&config, reading.true_position_enu_m, reading.true_attitude_wxyz);
        seen[((angle / 10.0) as usize).min(17)] += 1;
        let offset = Vector3::from(reading.true_position_enu_m) - Vector3::from(config.receiver_enu_m);
        assert!((offset.xy().norm() - 30.0).abs() < 1.0 && offset.z > 8.0, "{reading:?}");
    }
    assert!(seen.iter().all(|&count| count > 60), "{seen:?}");
}

#[test]
fn val_received_power_is_pattern_and_distance_at_the_truth() {
    let config = CalibrationConfig {
        antenna: Antenna::NullDepth { depth_db: 20.0 },
        meter_std_db: 0.0,
        noise_dbm: -300.0,
        ..short()
    };
    for reading in fly(&config).unwrap() {
        let angle = angle_deg(&config, reading.true_position_enu_m, reading.true_attitude_wxyz).to_radians();
        let d = Vector3::from(reading.true_position_enu_m) - Vector3::from(config.receiver_enu_m);
        let gain = 0.01 + 0.99 * angle.sin().powi(2);
        let expected = -20.0 + 10.0 * (gain / d.norm_squared()).log10();
        assert!((reading.received_dbm - expected).abs() < 1e-6, "{reading:?} {expected}");
    }
}

#[test]
fn spec_the_log_says_what_the_vehicle_believes() {
    let bias = Bias { heading_deg: 3.0, mounting_deg: [0.0; 2], position_enu_m: [0.4, -0.2, 0.6] };
    let config = CalibrationConfig { bias, sensors: SensorConfig::default(), ..short() };
    for reading in fly(&config).unwrap() {
        let off = Vector3::from(reading.true_position_enu_m) - Vector3::from(reading.position_enu_m);
        // The estimate is a step old.
        assert!((off - Vector3::from(bias.position_enu_m)).norm() < 0.02, "{reading:?}");
        let of = |[w, x, y, z]: [f64; 4]| UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
        let turn = of(reading.true_attitude_wxyz) * of(reading.attitude_wxyz).inverse();
        let turned = turn.scaled_axis() - Vector3::z() * 3f64.to_radians();
        assert!(turned.norm() < 1e-6, "{reading:?}");
    }
}

#[test]
fn spec_a_calibration_that_cannot_be_flown_is_refused() {
    for config in [
        CalibrationConfig { radius_m: 0.0, ..short() },
        CalibrationConfig { duration_s: f64::NAN, ..short() },
        CalibrationConfig { noise_dbm: f64::INFINITY, ..short() },
        CalibrationConfig { antenna: Antenna::NullDepth { depth_db: -3.0 }, ..short() },
        CalibrationConfig { fading: Some(Rician { k_db: f64::NAN, coherence_s: 0.1 }), ..short() },
    ] {
        assert!(fly(&config).is_err(), "{config:?}");
    }
}

#[test]
fn spec_the_csv_has_its_columns() {
    let readings = fly(&CalibrationConfig { duration_s: 3.0, ..short() }).unwrap();
    let text = Csv(&readings).to_string();
    let mut lines = text.lines();
    assert_eq!(lines.next().unwrap().split(',').count(), COLUMNS.len());
    assert_eq!(lines.clone().count(), 60);
    assert!(lines.all(|line| line.split(',').filter_map(|v| v.parse::<f64>().ok()).count() == COLUMNS.len()));
}
