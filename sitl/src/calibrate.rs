//! `veilwing-sitl calibrate`: a calibration flight with a given truth, as a log.

use std::path::PathBuf;

use clap::Args;
use veilwing_sitl::calibration::{self, CalibrationConfig, Csv};
use veilwing_sitl::{Antenna, Bias, Rician};

pub const EXAMPLES: &str = "Example:
  veilwing-sitl calibrate --null-depth 23 --heading 2.5 --mounting 0.6,-0.4 --out circle.csv
      ten minutes round a receiver; `veilwing calibrate pattern circle.csv --receiver 0,0,1.5` finds the three again";

/// What is true, and what the log is to be called.
#[derive(Args)]
pub struct CalibrateArguments {
    /// Random seed of gusts, jitter, estimator and meter
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// How far the antenna's null is below its largest gain, dB
    #[arg(long, default_value_t = 25.0)]
    null_depth: f64,
    /// A measured pattern instead: CSV with the columns angle_deg,gain_db
    #[arg(long, value_name = "FILE", conflicts_with = "null_depth")]
    pattern: Option<PathBuf>,
    /// By how much the heading is off, degrees from east towards north
    #[arg(long, default_value_t = 0.0, allow_hyphen_values = true)]
    heading: f64,
    /// By how much the antenna is turned about the body's x and y, degrees: X,Y
    #[arg(long, default_value = "0,0", value_parser = list::<2>, allow_hyphen_values = true)]
    mounting: [f64; 2],
    /// By how much the position is off, metres: EAST,NORTH,UP
    #[arg(long, default_value = "0,0,0", value_parser = list::<3>, allow_hyphen_values = true)]
    position: [f64; 3],
    /// The site's Rician factor, dB; nothing is scattered if not given
    #[arg(long, allow_hyphen_values = true)]
    rician_k: Option<f64>,
    /// Time in which the scattering changes, seconds
    #[arg(long, default_value_t = 0.05)]
    coherence: f64,
    /// Where the receiver is, metres: EAST,NORTH,UP
    #[arg(long, default_value = "0,0,1.5", value_parser = list::<3>, allow_hyphen_values = true)]
    receiver: [f64; 3],
    /// Radius of the circle, metres
    #[arg(long, default_value_t = 30.0)]
    radius: f64,
    /// Time on the circle, seconds
    #[arg(long, default_value_t = 600.0)]
    duration: f64,
    /// Standard deviation of a reading of the received power, dB
    #[arg(long, default_value_t = 0.5)]
    meter: f64,
    /// The log to write; stdout if not given
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

fn list<const N: usize>(text: &str) -> Result<[f64; N], String> {
    let values: Option<Vec<f64>> = text.split(',').map(|v| v.trim().parse().ok()).collect();
    let values = values.and_then(|values| <[f64; N]>::try_from(values).ok());
    values.ok_or_else(|| format!("give {N} numbers with commas between them"))
}

/// Flies, and writes the log.
///
/// # Errors
/// What cannot be flown, read or written; in words.
pub fn run(arguments: &CalibrateArguments) -> Result<(), String> {
    let antenna = match &arguments.pattern {
        Some(path) => Antenna::Measured { gain_db: pattern(path)? },
        None => Antenna::NullDepth { depth_db: arguments.null_depth },
    };
    let config = CalibrationConfig {
        seed: arguments.seed,
        antenna,
        bias: Bias {
            heading_deg: arguments.heading,
            mounting_deg: arguments.mounting,
            position_enu_m: arguments.position,
        },
        fading: arguments.rician_k.map(|k_db| Rician { k_db, coherence_s: arguments.coherence }),
        receiver_enu_m: arguments.receiver,
        radius_m: arguments.radius,
        duration_s: arguments.duration,
        meter_std_db: arguments.meter,
        ..CalibrationConfig::default()
    };
    let readings = calibration::fly(&config).map_err(|error| error.to_string())?;
    let text = Csv(&readings).to_string();
    match &arguments.out {
        Some(path) => std::fs::write(path, text).map_err(|error| format!("{}: {error}", path.display())),
        None => std::io::Write::write_all(&mut std::io::stdout().lock(), text.as_bytes())
            .map_err(|error| format!("stdout: {error}")),
    }
}

/// Angles and gains of a pattern's file.
fn pattern(path: &std::path::Path) -> Result<Vec<[f64; 2]>, String> {
    let name = path.display();
    let text = std::fs::read_to_string(path).map_err(|error| format!("{name}: {error}"))?;
    let points = text
        .lines()
        .enumerate()
        .map(|(number, line)| (number + 1, line.trim()))
        .filter(|(_, line)| !line.is_empty() && !line.starts_with('#') && !line.starts_with("angle_deg"));
    points.map(|(number, line)| list::<2>(line).map_err(|why| format!("{name}:{number}: {why}"))).collect()
}
