//! `veilwing calibrate`: what a flight round a receiver says of a vehicle.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use nalgebra::Vector3;

use crate::config::file::write_whole;
use crate::desk::calibration::{self, Calibration, Estimate, Reading, Site};

use super::{Exit, print_json, print_text};

/// Find an antenna's null depth, pattern and mounting error, and a compass's error, from a calibration flight.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Example: veilwing calibrate pattern circle.csv --receiver 0,0,1.5 --out dipole.csv\nHow to fly it, and what the log must hold: docs/calibration.md. veilwing-sitl calibrate makes a log to try it on."
)]
pub(super) struct Args {
    #[command(subcommand)]
    what: What,
}

#[derive(Debug, clap::Subcommand)]
enum What {
    /// Null depth, pattern and mounting of the antenna, heading and position of the vehicle
    Pattern(PatternArgs),
}

#[derive(Debug, clap::Args)]
struct PatternArgs {
    /// The log: CSV with the columns time_s, east_m, north_m, up_m, qw, qx, qy, qz (body forward-left-up to ENU), received_dbm
    log: PathBuf,
    /// Where the receiver is, metres: EAST,NORTH,UP
    #[arg(long, value_parser = place, allow_hyphen_values = true)]
    receiver: Vector3<f64>,
    /// The site's Rician factor, dB, if it is known: without it, what is scattered counts as the antenna's
    #[arg(long, value_name = "DB", allow_hyphen_values = true)]
    rician_k: Option<f64>,
    /// The receiver's noise in its readings, dBm
    #[arg(long, value_name = "DBM", allow_hyphen_values = true)]
    noise: Option<f64>,
    /// Print one JSON document
    #[arg(long)]
    json: bool,
    /// Keep the pattern in this file, for a mission's pattern_file
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

fn place(text: &str) -> Result<Vector3<f64>, String> {
    let numbers: Option<Vec<f64>> =
        text.split(',').map(|v| v.trim().parse().ok().filter(|v: &f64| v.is_finite())).collect();
    match numbers.as_deref() {
        Some(&[east, north, up]) => Ok(Vector3::new(east, north, up)),
        _ => Err("give EAST,NORTH,UP in metres, for example 0,0,1.5".to_owned()),
    }
}

pub(super) fn run(args: &Args) -> Exit {
    let What::Pattern(args) = &args.what;
    let found = read(&args.log).and_then(|readings| {
        let site = Site { receiver_enu_m: args.receiver, rician_k_db: args.rician_k, noise_dbm: args.noise };
        calibration::fit(&site, &readings).map_err(|error| format!("{}: {error}", args.log.display()))
    });
    let calibration = match found {
        Ok(calibration) => calibration,
        Err(message) => return unusable(&message),
    };
    if let Some(path) = &args.out
        && let Err(message) = write_whole(path, pattern_file(&calibration))
    {
        return unusable(&message);
    }
    let shown = if args.json { print_json(&calibration) } else { print_text(&table(&calibration)) };
    if shown == Exit::Done && !calibration.converged { Exit::Bad } else { shown }
}

fn unusable(message: &str) -> Exit {
    eprintln!("error: {message}");
    Exit::Unusable
}

fn read(path: &Path) -> Result<Vec<Reading>, String> {
    let name = path.display();
    let text = std::fs::read_to_string(path).map_err(|error| format!("{name}: {error}"))?;
    calibration::read(&text).map_err(|error| format!("{name}: {error}"))
}

/// As a mission's `pattern_file` wants it.
fn pattern_file(calibration: &Calibration) -> String {
    let mut text = String::from("angle_deg,gain_db\n");
    for point in &calibration.pattern {
        // Writing to a String cannot fail.
        let _ = writeln!(text, "{},{:.3}", point.angle_deg, point.gain_db);
    }
    text
}

fn table(calibration: &Calibration) -> String {
    let mut text = String::new();
    // Writing to a String cannot fail.
    let _ = write_table(&mut text, calibration);
    text
}

fn write_table(text: &mut String, found: &Calibration) -> std::fmt::Result {
    let with_error = |e: &Estimate| format!("{:8.3} +- {:.3}", e.value, e.standard_error);
    writeln!(
        text,
        "{} readings in {:.0} s, {:.2} dB rms off the fit",
        found.readings, found.duration_s, found.residual_db
    )?;
    if !found.converged {
        writeln!(text, "NOT CONVERGED: the figures below are the best that were found")?;
    }
    match &found.null_depth_db {
        Some(depth) => writeln!(text, "null depth        {} dB", with_error(depth))?,
        None => {
            writeln!(
                text,
                "null depth         no floor seen; at least {:.1} dB",
                found.null_depth_at_least_db
            )?;
        }
    }
    for (axis, mounting) in ["x", "y"].iter().zip(&found.mounting_deg) {
        writeln!(text, "mounting, body {axis}  {} deg", with_error(mounting))?;
    }
    writeln!(text, "heading           {} deg, east towards north", with_error(&found.heading_deg))?;
    for (axis, off) in ["east", "north", "up"].iter().zip(&found.position_enu_m) {
        writeln!(text, "position, {axis:<6}  {} m", with_error(off))?;
    }
    writeln!(text, "level at 1 m      {} dBm", with_error(&found.level_dbm))?;
    if let Some(k_db) = found.rician_k_at_least_db {
        writeln!(text, "scattering         a Rician factor of at least {k_db:.1} dB")?;
    }
    writeln!(text, "\nangle_deg  gain_db     +-  above dipole  readings")?;
    for point in &found.pattern {
        let error = point.standard_error_db.map_or_else(|| "-".to_owned(), |error| format!("{error:.2}"));
        writeln!(
            text,
            "{:9.0} {:8.2} {error:>6} {:13.2} {:9}",
            point.angle_deg, point.gain_db, point.above_dipole_db, point.readings
        )?;
    }
    Ok(())
}
