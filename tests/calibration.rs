//! Calibration flights of the simulated world, with errors that it alone knows, and what `calibrate` makes of their logs.

#![cfg(feature = "desk")]
// Helpers of tests may fail the test.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod command;

use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use veilwing::desk::calibration::{Calibration, Site, fit, read};
use veilwing_sitl::calibration::{CalibrationConfig, Csv, fly};
use veilwing_sitl::{Antenna, Bias, Rician};

fn site(config: &CalibrationConfig) -> Site {
    Site {
        receiver_enu_m: Vector3::from(config.receiver_enu_m),
        rician_k_db: config.fading.map(|law| law.k_db),
        noise_dbm: Some(config.noise_dbm),
    }
}

/// Through the log's text, as a user's would go.
fn calibrated(config: &CalibrationConfig) -> Calibration {
    let readings = read(&Csv(&fly(config).unwrap()).to_string()).unwrap();
    fit(&site(config), &readings).unwrap()
}

/// What is found less what is true, over the stated standard error, by name.
fn misses(found: &Calibration, config: &CalibrationConfig, depth_db: f64) -> Vec<(&'static str, f64, f64)> {
    let Bias { heading_deg, mounting_deg: [x, y], position_enu_m: [e, n, u] } = config.bias;
    let rows = [
        ("null depth", found.null_depth_db.unwrap(), depth_db),
        ("mounting x", found.mounting_deg[0], x),
        ("mounting y", found.mounting_deg[1], y),
        ("heading", found.heading_deg, heading_deg),
        ("east", found.position_enu_m[0], e),
        ("north", found.position_enu_m[1], n),
        ("up", found.position_enu_m[2], u),
        ("level", found.level_dbm, config.level_dbm),
    ];
    rows.map(|(name, found, truth)| (name, found.value - truth, found.standard_error)).to_vec()
}

/// Ten flights with a floor, a mount, a compass and a position that are off by what nobody has said.
fn ten() -> Vec<(CalibrationConfig, f64)> {
    let mut rng = ChaCha8Rng::seed_from_u64(15);
    let mut within = |low: f64, high: f64| low + (high - low) * rng.random::<f64>();
    (0..10)
        .map(|seed| {
            let depth_db = within(18.0, 35.0);
            let bias = Bias {
                heading_deg: within(-6.0, 6.0),
                mounting_deg: [within(-3.0, 3.0), within(-3.0, 3.0)],
                position_enu_m: [within(-1.0, 1.0), within(-1.0, 1.0), within(-1.5, 1.5)],
            };
            let antenna = Antenna::NullDepth { depth_db };
            (CalibrationConfig { seed, antenna, bias, ..CalibrationConfig::default() }, depth_db)
        })
        .collect()
}

#[test]
fn val_ten_flights_find_what_the_world_alone_knows() {
    let (mut squares, mut beyond_two, mut count) = (0.0, 0, 0);
    for (config, depth_db) in ten() {
        let found = calibrated(&config);
        assert!(found.converged);
        let misses = misses(&found, &config, depth_db);
        let told: Vec<String> =
            misses.iter().map(|(name, off, error)| format!("{name} {off:+.3}/{error:.3}")).collect();
        println!("flight {}: depth {depth_db:.1} dB; off/stated: {}", config.seed, told.join(", "));
        for (name, off, error) in misses {
            let miss = off / error;
            assert!(miss.abs() < 4.5, "{name} in flight {}: {off} of {error}", config.seed);
            squares += miss * miss;
            beyond_two += usize::from(miss.abs() > 2.0);
            count += 1;
        }
        // Good enough to plan with.
        assert!(found.null_depth_db.unwrap().standard_error < 0.5, "{:?}", found.null_depth_db);
        assert!(found.heading_deg.standard_error < 0.2 && found.mounting_deg[0].standard_error < 0.1);
    }
    // The mean square of 80 normal values is 1 with a deviation of 0.16; thirty blocks know their errors to a seventh.
    let mean_square = squares / f64::from(count);
    println!("mean square {mean_square:.2}, {beyond_two} of {count} beyond two standard errors");
    assert!((0.4..1.8).contains(&mean_square), "{mean_square}");
    assert!(beyond_two <= 12, "{beyond_two}");
}

#[test]
fn val_the_pattern_of_an_antenna_that_is_no_dipole_is_found() {
    let gain_db: Vec<[f64; 2]> = (0..=36)
        .map(|k| {
            let angle_deg = 5.0 * f64::from(k);
            let a = angle_deg.to_radians();
            // A floor of -18 dB at one end and -23 dB at the other, and a lobe that leans forward by a decibel.
            let floor = if angle_deg < 90.0 { 10f64.powf(-1.8) } else { 10f64.powf(-2.3) };
            [
                angle_deg,
                10.0 * (floor + (1.0 - floor) * a.sin().powi(2)).log10() - 0.5 * (1.0 - a.cos()) * a.sin(),
            ]
        })
        .collect();
    let largest = gain_db.iter().map(|p| p[1]).fold(f64::NEG_INFINITY, f64::max);
    let gain_db: Vec<[f64; 2]> = gain_db.into_iter().map(|[a, g]| [a, g - largest]).collect();
    let bias = Bias { heading_deg: -2.0, mounting_deg: [1.0, -0.5], ..Bias::default() };
    let antenna = Antenna::Measured { gain_db: gain_db.clone() };
    let config = CalibrationConfig { seed: 21, antenna, bias, ..CalibrationConfig::default() };
    let found = calibrated(&config);
    assert!(found.converged);
    assert_eq!(found.pattern.len(), 37);
    for ([angle_deg, truth], point) in gain_db.into_iter().zip(&found.pattern) {
        println!(
            "{angle_deg}: {:.2} found, {truth:.2} true, +- {:?}",
            point.gain_db, point.standard_error_db
        );
        assert_eq!(point.angle_deg, angle_deg);
        assert!((point.gain_db - truth).abs() < 0.5, "{angle_deg}: {point:?} {truth}");
    }
    // And the mount is found though the antenna is no dipole.
    assert!(
        (found.mounting_deg[0].value - 1.0).abs() < 0.2 && (found.mounting_deg[1].value + 0.5).abs() < 0.2
    );
    assert!((found.heading_deg.value + 2.0).abs() < 0.3, "{:?}", found.heading_deg);
}

#[test]
fn val_known_scattering_is_not_taken_for_a_floor() {
    // 18 dB of scattering hide a floor of -25 dB unless they are said.
    let antenna = Antenna::NullDepth { depth_db: 25.0 };
    let fading = Some(Rician { k_db: 18.0, coherence_s: 0.05 });
    let config = CalibrationConfig { seed: 5, antenna, fading, ..CalibrationConfig::default() };
    let readings = read(&Csv(&fly(&config).unwrap()).to_string()).unwrap();
    let knowing = fit(&site(&config), &readings).unwrap();
    let depth = knowing.null_depth_db.unwrap();
    assert!((depth.value - 25.0).abs() < 4.0 * depth.standard_error, "{depth:?}");
    let ignorant = fit(&Site { rician_k_db: None, ..site(&config) }, &readings).unwrap();
    let shallow = ignorant.null_depth_db.unwrap();
    assert!(shallow.value < 22.0, "{shallow:?}");
    // The meter's half decibel counts as scattering too, half as much as the 18 dB: 16 dB or so are seen, and K is above.
    let seen = knowing.rician_k_at_least_db.unwrap();
    assert!((14.0..18.0).contains(&seen), "{seen}");
}

#[test]
fn spec_the_command_reads_a_log_and_keeps_the_pattern() {
    let directory = command::directory("calibration");
    let (log, pattern) = (directory.join("circle.csv"), directory.join("dipole.csv"));
    let config = CalibrationConfig { duration_s: 200.0, ..CalibrationConfig::default() };
    std::fs::write(&log, Csv(&fly(&config).unwrap()).to_string()).unwrap();
    let run = |more: &[&str]| {
        let common = ["pattern", log.to_str().unwrap(), "--receiver", "0,0,1.5"];
        command::veilwing(&["calibrate"]).args(common).args(more).output().unwrap()
    };
    let output = run(&["--json", "--out", pattern.to_str().unwrap()]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let document: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let depth = document["null_depth_db"]["value"].as_f64().unwrap();
    assert!((depth - 25.0).abs() < 1.0, "{depth}");
    let text = std::fs::read_to_string(&pattern).unwrap();
    assert!(text.starts_with("angle_deg,gain_db\n0,-") && text.lines().count() == 38, "{text}");
    let table = String::from_utf8(run(&[]).stdout).unwrap();
    assert!(table.contains("null depth") && table.lines().all(|line| line.len() <= 80), "{table}");
    // What cannot be used is said, with exit code 2.
    std::fs::write(&log, "time_s\n0\n").unwrap();
    let refused = run(&[]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("no column \"east_m\""));
}
