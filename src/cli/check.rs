//! `veilwing check`: validates a mission, and vehicles for it.

mod figures;

use std::fmt::Write;
use std::path::{Path, PathBuf};

use crate::config::{Diagnostics, Mission, Vehicle};
use crate::link::{Clock, Key};
use crate::transmitter::Kind;

use super::{Exit, folded, print_text};

/// Columns of a narrow window, and of the titles in it.
const COLUMNS: usize = 80;
const TITLE: usize = 14;

/// Validate a mission file, and vehicle files for it.
///
/// Every error is printed as `file:line:column: message` with the offending line and a remedy, and so is every warning: what
/// is legal, and dangerous or hardly meant. A usable mission is summed up as it was understood.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example: veilwing check config/mission.toml --vehicle config/vehicle-i.toml")]
pub struct Args {
    /// Mission file (TOML).
    #[arg(value_name = "MISSION")]
    mission: PathBuf,
    /// Vehicle file (TOML) to validate with the mission; may be repeated.
    #[arg(long = "vehicle", value_name = "FILE")]
    vehicles: Vec<PathBuf>,
}

/// Validates; exit code 0, or 2 when a file cannot be used.
#[must_use]
pub fn run(args: &Args) -> Exit {
    let mut usable = true;
    let mut tell = |findings: Diagnostics| {
        eprint!("{findings}");
        usable &= !findings.has_errors();
    };
    let mission = Mission::load(&args.mission).map_err(&mut tell).ok();
    if let Some(mission) = &mission {
        tell(mission.warnings.clone());
        tell(mission.warnings_at(Clock::real().utc()));
    }
    let mut vehicles: Vec<(&Path, Vehicle)> = Vec::new();
    for path in &args.vehicles {
        match Vehicle::load(path) {
            Err(findings) => tell(findings),
            Ok(vehicle) => {
                tell(vehicle.warnings.clone());
                if let Some(mission) = &mission {
                    tell(vehicle.check_against(mission));
                    tell(vehicle.check_permission_at(mission, Clock::real().utc()));
                }
                for (setting, path) in vehicle.key_files() {
                    let Err(error) = Key::load(path) else { continue };
                    let help = "write 64 hexadecimal digits, 32 random bytes, into it; the same at the link's other end";
                    tell(vehicle.error_at(setting, error.to_string(), help.to_owned()));
                }
                if let Some((other, _)) = vehicles.iter().find(|(_, other)| other.role == vehicle.role) {
                    let message = format!("{} is vehicle {} too", other.display(), vehicle.role);
                    tell(vehicle.error_at(
                        "vehicle.role",
                        message,
                        "give a file for each vehicle of the pair".into(),
                    ));
                }
                vehicles.push((path.as_path(), vehicle));
            }
        }
    }
    match mission {
        Some(mission) if usable => print_text(&summary(&mission, &vehicles)),
        _ => Exit::Unusable,
    }
}

/// What was understood, for an operator to read before it is flown.
fn summary(mission: &Mission, vehicles: &[(&Path, Vehicle)]) -> String {
    let mut out = String::new();
    let mut line = |title: &str, text: String| {
        let mut title = title;
        for part in folded(&text, COLUMNS - TITLE - 1) {
            let _ = writeln!(out, "{title:<TITLE$} {part}");
            title = "";
        }
    };
    line("mission", format!("{}, seed {}", mission.name, mission.seed));
    line("digest", mission.digest_hex());
    for (title, text) in figures::of_the_site(mission) {
        line(&title, text);
    }
    for (title, text) in figures::of_the_slots(mission) {
        line(title, text);
    }
    line("jitter", format!("{:.3} deg", mission.jitter.std_rad.to_degrees()));
    for (title, text) in figures::of_the_link(mission) {
        line(&title, text);
    }
    for (title, text) in figures::of_the_emission(mission.emission.as_ref()) {
        line(title, text);
    }
    for (path, vehicle) in vehicles {
        let transmitter = match (&vehicle.transmitter.kind, vehicle.transmitter.simulated) {
            (Kind::None, _) => "no transmitter",
            (_, true) => "simulated transmitter",
            (_, false) => "real transmitter",
        };
        line(&format!("vehicle {}", vehicle.role), format!("{}: {transmitter}", path.display()));
        line("", format!("autopilot {}", vehicle.autopilot.link));
        line("", format!("pair {}", vehicle.pair_link));
    }
    out
}
