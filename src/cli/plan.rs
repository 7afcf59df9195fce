//! `veilwing plan`: plans every slot of a mission.

mod text;

use std::path::{Path, PathBuf};

use clap::builder::{PossibleValuesParser, TypedValueParser};

use crate::config::file::{unwritable, usable_directory, write_whole};
use crate::config::{METHODS, Mission};
use crate::planner::document::PlanDocument;
use crate::planner::problem::Method;
use crate::planner::slots::Plan;
use crate::planning;
use crate::planning::maps::Map;

use super::planning::{add_unprotected, certify_plan, document, plan_mission};
use super::{Exit, load_mission, print_json, print_text};

const AFTER_HELP: &str = "\
Example: veilwing plan config/paper.toml --bound certify --json

Of each user: the rate with J off, at these poses and with I where it is best alone; the eavesdropper without which the rate
would rise the most; the limits at which a pose or power stands (within 5 cm, 0.05 deg or 0.1%) while the rate would rise
beyond them. `off_deg` is how far an attitude may be off its pose while the slot is served.

What upper_bound_kind says of upper_bound_bps:
  cap               user at the least distance in the plane of maximum gain, eavesdroppers deaf: proven, for every mission
  branch-and-bound  no jitter: no poses and powers do better; proven, rounding included
  without-jitter    the same with the mission's jitter left out, which no jitter can exceed: proven, and loose
  decoupled         under roll-pitch Euler jitter, or of antennas that leak: as firm as the margins of its quadrature
  decoupled-signed, branch-and-bound-signed
                    with scattered waves: bound the mean of the rate with its sign kept, which is less than the mean of the
                    rate where draws are negative";

/// Plan every slot of a mission: poses, powers, expected secrecy rate.
#[derive(Debug, clap::Args)]
#[command(after_help = AFTER_HELP)]
pub(super) struct Args {
    /// Mission file.
    mission: PathBuf,
    /// Print the plan as one JSON document.
    #[arg(long)]
    json: bool,
    /// Planner to use instead of the mission file's.
    #[arg(long, value_name = "M", value_parser = method_parser())]
    method: Option<Method>,
    /// Seed instead of the mission file's.
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    seed: Option<u64>,
    /// Threads to plan with; the plan does not depend on it.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..=256))]
    threads: u16,
    /// Upper bound on the rate beside the plan's own.
    #[arg(long, value_enum, default_value_t = BoundSearch::Cap)]
    bound: BoundSearch,
    /// Write plan.json into this directory as well, and maps to look at (GeoJSON, KML, a QGroundControl plan for each
    /// vehicle); made if it is not there.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// How hard to look for an upper bound.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum BoundSearch {
    /// The cap alone, at once
    Cap,
    /// Branch and bound as well, a fixed budget of boxes: about a second a slot without jitter, ten with
    Certify,
}

fn method_parser() -> impl TypedValueParser<Value = Method> {
    PossibleValuesParser::new(METHODS.iter().map(|(name, _)| *name)).try_map(|text| {
        let found = METHODS.iter().find(|(name, _)| *name == text);
        found.map(|(_, method)| *method).ok_or("no such method")
    })
}

pub(super) fn run(args: &Args) -> Exit {
    let mission = match load_mission(&args.mission) {
        Ok(mission) => mission,
        Err(exit) => return exit,
    };
    // Before the work, not after it, is the time to learn that the directory cannot be written.
    if let Some(Err(error)) = args.out.as_deref().map(usable_directory) {
        eprintln!("error: {error}");
        return Exit::Unusable;
    }
    let mut options = planning::options(&mission);
    options.method = args.method.unwrap_or(options.method);
    options.seed = args.seed.unwrap_or(options.seed);
    options.threads = args.threads.into();
    let planned = plan_mission(&mission, &options).and_then(|mut timed| {
        add_unprotected(&mission, &options, &mut timed)?;
        if args.bound == BoundSearch::Certify {
            certify_plan(&mission, &mut timed)?;
        }
        Ok(timed)
    });
    let timed = match planned {
        Ok(timed) => timed,
        Err(error) => {
            eprintln!("{}: {error}", args.mission.display());
            return Exit::Unusable;
        }
    };
    let document = document(&mission, &options, &timed);
    let kept = args.out.as_deref().map_or(Ok(()), |out| {
        write_plan(out, &document).and_then(|()| write_maps(out, &mission, &timed.plan))
    });
    let shown = if args.json {
        print_json(&document)
    } else {
        print_text(&text::table(&mission, &timed.plan, &document))
    };
    kept.err().unwrap_or(shown)
}

/// Writes `plan.json` into a directory, which is made if it is not there.
pub(super) fn write_plan(out: &Path, document: &PlanDocument) -> Result<(), Exit> {
    let path = out.join("plan.json");
    let text = serde_json::to_string_pretty(document).map_err(|error| error.to_string());
    let written = text.and_then(|text| {
        std::fs::create_dir_all(out).map_err(|error| unwritable(out, &error))?;
        write_whole(&path, &text)
    });
    written.map_err(|error| {
        eprintln!("error: {error}");
        Exit::Unusable
    })
}

/// Writes the plan's maps beside it.
fn write_maps(out: &Path, mission: &Mission, plan: &Plan) -> Result<(), Exit> {
    let Some(map) = Map::of_plan(mission, plan) else {
        eprintln!(
            "no maps: the mission has no origin; give [mission] origin for GeoJSON, KML and .plan files"
        );
        return Ok(());
    };
    keep_maps(out, &map, "plan").map(|_| ()).map_err(|error| {
        eprintln!("error: {error}");
        Exit::Unusable
    })
}

/// Writes a map's files, whose names begin with `stem`, and tells them.
pub(super) fn keep_maps(directory: &Path, map: &Map, stem: &str) -> Result<Vec<String>, String> {
    let mut names = Vec::new();
    for (name, text) in map.files(stem) {
        write_whole(&directory.join(&name), &text)?;
        names.push(name);
    }
    Ok(names)
}
