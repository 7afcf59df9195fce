//! `veilwing report`: a flight's directory to one HTML file, and to an MCAP file.

use std::io;
use std::path::{Path, PathBuf};

use crate::config::Mission;
use crate::config::file::write_whole;
use crate::desk::report::mcap::{ATTACHED, Attached, mcap};
use crate::desk::report::{self, Timeline, telemetry};

use super::plan::keep_maps;
use super::{Exit, load_mission};

/// The report's name in a flight's directory.
pub(super) const REPORT: &str = "report.html";

/// Report a recorded flight as one HTML file: what happened, maps, timelines, tables.
///
/// Beside it, by its name, the flight on maps: GeoJSON, KML, and a QGroundControl plan for each vehicle, to look at.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Example: veilwing sitl config/mission.toml --out flight-1; veilwing report flight-1\nA real flight: put the .tlog files of both companions into one directory, beside the mission file as mission.toml and `plan --out`'s plan.json; true eavesdropper positions and true rates are then not known, and the report says so."
)]
pub(super) struct Args {
    /// The flight's directory.
    #[arg(value_name = "DIR")]
    directory: PathBuf,
    /// The HTML file to write; by default report.html in the directory.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// The flight as an MCAP file as well, for Foxglove and rerun: poses, axes, powers, leases, SINR, secrecy, events, violations.
    #[arg(long, value_name = "FILE")]
    mcap: Option<PathBuf>,
    /// Mission file, for telemetry logs; by default mission.toml in the directory, if it is there.
    #[arg(long, value_name = "FILE")]
    mission: Option<PathBuf>,
    /// Use the telemetry logs even if the simulated world's own record is there.
    #[arg(long)]
    telemetry: bool,
}

pub(super) fn run(args: &Args) -> Exit {
    let timeline = match load(args) {
        Ok(timeline) => timeline,
        Err(exit) => return exit,
    };
    let out = args.out.clone().unwrap_or_else(|| args.directory.join(REPORT));
    match write(&out, &timeline) {
        Ok(()) => {
            eprintln!("report: {}", out.display());
            let exit = write_maps(&out, &timeline);
            match write_mcap(args, &timeline) {
                Ok(()) => exit,
                Err(message) => unusable(&message),
            }
        }
        Err(message) => unusable(&message),
    }
}

/// Writes the flight as an MCAP file, if that is asked for.
fn write_mcap(args: &Args, timeline: &Timeline) -> Result<(), String> {
    let Some(path) = &args.mcap else { return Ok(()) };
    let leases = telemetry::leases(&args.directory).map_err(|error| error.to_string())?;
    let mut attached = Vec::new();
    for (name, media_type) in ATTACHED {
        let file = args.directory.join(name);
        match std::fs::read(&file) {
            Ok(data) => attached.push(Attached { name: name.to_owned(), media_type, data }),
            Err(error) if error.kind() == io::ErrorKind::NotFound => {}
            Err(error) => {
                return Err(format!("cannot read {}: {error}; check its mode and owner", file.display()));
            }
        }
    }
    let bytes = mcap(timeline, &leases, &attached)
        .map_err(|error| format!("cannot make {}: {error}", path.display()))?;
    write_whole(path, &bytes)?;
    eprintln!("mcap: {}", path.display());
    Ok(())
}

/// Writes the flight's maps beside its report, by the report's name.
fn write_maps(report: &Path, timeline: &Timeline) -> Exit {
    let Some(map) = report::maps::map(timeline) else {
        eprintln!(
            "no maps: the record does not say where on earth the flight was; give the mission an origin"
        );
        return Exit::Done;
    };
    let stem = report.file_stem().map_or_else(|| "report".into(), |stem| stem.to_string_lossy());
    match keep_maps(report.parent().unwrap_or(Path::new("")), &map, &stem) {
        Ok(names) => {
            eprintln!("maps: {}", names.join(", "));
            Exit::Done
        }
        Err(message) => unusable(&message),
    }
}

fn load(args: &Args) -> Result<Timeline, Exit> {
    let directory = &args.directory;
    let recorded = directory.join(report::directory::SCENE).exists()
        || directory.join(report::directory::TIMELINE).exists();
    if recorded && !args.telemetry {
        return report::load(directory).map_err(|error| unusable(&error.to_string()));
    }
    let mission = mission(args)?;
    telemetry::load(directory, mission.as_ref()).map_err(|error| unusable(&error.to_string()))
}

fn mission(args: &Args) -> Result<Option<Mission>, Exit> {
    let beside = args.directory.join("mission.toml");
    let path = args.mission.clone().or_else(|| beside.exists().then_some(beside));
    path.as_deref().map(load_mission).transpose()
}

/// Writes the report of a flight.
pub(super) fn write(out: &Path, timeline: &Timeline) -> Result<(), String> {
    write_whole(out, report::html(timeline))
}

fn unusable(message: &str) -> Exit {
    eprintln!("error: {message}");
    Exit::Unusable
}
