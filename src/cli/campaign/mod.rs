//! `veilwing campaign`: many flights of one mission in virtual time, with faults drawn from a distribution.

mod out;
mod shard;

use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};

use crate::autopilot::Actuation;
use crate::config::Mission;
use crate::desk::campaign::coverage::{self, Tally};
use crate::desk::campaign::{
    CampaignDocument, Done, FlightLine, Identity, Times, ViolationLine, fly_all, merge,
};
use crate::desk::simulation::{Faults, Scenario, ScenarioError, Tracks, draw};
use crate::link::clock::Clock;
use crate::planner::slots::hex;

use super::planning::{document as plan_document, plan_mission};
use super::progress::Progress;
use super::{Exit, interrupt, load_mission, print_json, print_text};
use out::Out;
use shard::Shard;

/// Fly a mission many times in virtual time, with faults drawn from a distribution, and count what happens.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  veilwing campaign config/mission.toml --runs 1000 --faults config/faults.toml\n  \
                  veilwing campaign config/mission.toml --runs 1 --seed 123 --faults config/faults.toml --out run-123\n  \
                  veilwing campaign config/mission.toml --runs 1000 --shard $((SLURM_ARRAY_TASK_ID + 1))/10 --out parts\n  \
                  veilwing campaign --merge parts\nFlight k has the seed of flight 0 plus k; one flight alone, with --out, keeps its full logs."
)]
pub(super) struct Args {
    /// Mission file.
    #[arg(required_unless_present = "merge")]
    mission: Option<PathBuf>,
    /// Number of flights in the whole campaign.
    #[arg(long, default_value_t = 100, value_parser = clap::value_parser!(u64).range(1..=10_000_000))]
    runs: u64,
    /// Seed of the first flight; the mission's if not given. The plan is the mission's in any case.
    #[arg(long)]
    seed: Option<u64>,
    /// What may go wrong, a TOML file: config/faults.toml is one to start from. Without it, nothing does.
    #[arg(long)]
    faults: Option<PathBuf>,
    /// How both vehicles are commanded, whatever their airframes: thrust_vector, pose or position. As the airframes ask
    /// for if not given.
    #[arg(long, value_parser = actuation)]
    actuation: Option<Actuation>,
    /// Where those go that move, a CSV file: name,t_s,east_m,north_m and, where wanted, up_m. Without it they wander.
    #[arg(long, value_name = "FILE")]
    tracks: Option<PathBuf>,
    /// Fly the I-th of K parts only.
    #[arg(long, value_name = "I/K")]
    shard: Option<Shard>,
    /// Flights at the same time; as many as there are processors if not given. No figure depends on it.
    #[arg(long)]
    threads: Option<std::num::NonZeroUsize>,
    /// Print how often the companions came to each of their kinds of state, news and refusal too (the document has it in
    /// any case).
    #[arg(long)]
    coverage: bool,
    /// Print the campaign as one JSON document.
    #[arg(long)]
    json: bool,
    /// Keep the plan, the campaign's (or the part's) document and a flight document for each flight in this directory.
    #[arg(long)]
    out: Option<PathBuf>,
    /// Instead of flying: one document from those of all parts, or from the directories that hold them.
    #[arg(long, num_args = 1.., value_name = "FILE|DIR", conflicts_with_all = ["mission", "runs", "seed", "faults", "actuation", "shard", "threads", "out"])]
    merge: Vec<PathBuf>,
}

/// As a vehicle file spells it.
fn actuation(text: &str) -> Result<Actuation, String> {
    let known = [Actuation::ThrustVector, Actuation::Pose, Actuation::Position];
    let found = known.into_iter().find(|actuation| actuation.to_string() == text);
    found.ok_or_else(|| "give thrust_vector, pose or position".to_owned())
}

pub(super) fn run(args: &Args) -> Exit {
    let outcome = match &args.mission {
        None => merged(&args.merge).map(|document| show(args, &document)),
        Some(path) => match prepare(args, path) {
            Ok((mission, faults)) => fly(args, (&mission, path), &faults),
            Err(exit) => return exit,
        },
    };
    outcome.unwrap_or_else(|message| {
        eprintln!("error: {message}");
        Exit::Unusable
    })
}

/// One document from those of the parts; says what is in none of them.
fn merged(parts: &[PathBuf]) -> Result<CampaignDocument, String> {
    let document = merge(parts).map_err(|error| error.to_string())?;
    let runs = document.identity.campaign_runs;
    if !document.complete {
        eprintln!("warning: {} of {runs} flights are in none of the parts", runs - document.runs);
    }
    Ok(document)
}

fn prepare(args: &Args, path: &Path) -> Result<(Mission, Faults), Exit> {
    let mission = load_mission(path)?;
    let faults = match &args.faults {
        None => Faults::default(),
        Some(path) => Faults::load(path).map_err(|errors| {
            eprint!("{errors}");
            Exit::Unusable
        })?,
    };
    if let Some(kind) = faults.of_radio_hosts() {
        eprintln!(
            "error: {kind} befalls radio hosts, and campaigns have none: fly it by veilwing sitl --radio-hosts KIND"
        );
        return Err(Exit::Unusable);
    }
    Ok((mission, faults))
}

fn fly(args: &Args, (mission, file): (&Mission, &Path), faults: &Faults) -> Result<Exit, String> {
    let wall = Clock::real();
    let options = crate::planning::options(mission);
    let timed = plan_mission(mission, &options).map_err(|error| error.to_string())?;
    let plan = plan_document(mission, &options, &timed);
    let scenario = Scenario::new(mission, &timed.plan, args.actuation).map_err(|error| error.to_string())?;
    let tracks = args.tracks.as_deref().map(|path| Tracks::load(path, mission)).transpose()?;
    let scenario = tracks.iter().fold(scenario, Scenario::along);
    let seed = args.seed.unwrap_or(mission.seed);
    let identity = Identity {
        mission: mission.name.clone(),
        mission_digest: mission.digest_hex(),
        plan_digest: plan.plan_digest.clone(),
        actuation: args.actuation.map(|actuation| actuation.to_string()),
        tracks_digest: tracks.as_ref().map(Tracks::digest),
        faults_digest: args.faults.as_ref().map(|_| hex(&Sha256::digest(&faults.canonical))),
        seed,
        campaign_runs: args.runs,
    };
    let out = args.out.as_deref().map(|path| Out::new(path, &plan)).transpose()?;
    let alone = args.runs == 1;
    let runs = args.shard.map_or_else(|| (0..args.runs).collect(), |shard| shard.runs(args.runs));
    let fly_one = |run: u64| -> Result<FlightLine, ScenarioError> {
        let began = wall.now();
        let seed = seed.wrapping_add(run);
        let faults = draw(faults, seed, scenario.lengths());
        let mut tally = Tally::default();
        let (flown, record) = match &out {
            Some(out) if alone => {
                let (flown, record) = out.fly_with_logs(mission, &scenario, seed, faults, &mut tally)?;
                (flown, Some(record))
            }
            _ => (scenario.fly(seed, faults, &mut tally)?, None),
        };
        let line = FlightLine::new(run, seed, &flown, tally.finish());
        if let Some(out) = &out {
            let wall_s = wall.now().saturating_since(began).as_secs_f64();
            let record = record.as_ref().map(|record| (file, record));
            out.keep(&line, &identity.plan_digest, flown, wall_s, record);
        }
        Ok(line)
    };
    let threads = args.threads.or_else(|| std::thread::available_parallelism().ok()).map_or(1, usize::from);
    let mut flights = Vec::new();
    let mut failed = None;
    let mut cpu_s = 0.0;
    let progress = Progress::new("flights", runs.len() as u64);
    let note = |done: Done<Result<FlightLine, ScenarioError>>| {
        cpu_s += done.cpu_s;
        match done.result {
            Ok(flight) => {
                progress.aside(|| log(&flight));
                flights.push(flight);
            }
            Err(error) => failed = Some(error),
        }
        progress.step();
    };
    let interrupted = fly_all(&runs, threads, interrupt::requested(), fly_one, note)
        .map_err(|error| format!("the event loop cannot start: {error}"))?;
    drop(progress);
    if let Some(error) = failed {
        return Err(format!("a flight could not be flown: {error}"));
    }
    let complete = flights.len() == runs.len();
    let times = Times { wall_s: wall.now().since_start().as_secs_f64(), cpu_s };
    let document = CampaignDocument::new(identity, args.shard.map(Shard::name), complete, flights, times);
    // The result first: a disk that has filled up meanwhile must not cost it.
    let shown = show(args, &document);
    if let Some(out) = &out {
        out.keep_campaign(&document, args.shard)?;
    }
    Ok(if interrupted && shown != Exit::Unusable { Exit::Interrupted } else { shown })
}

/// What an operator of a long campaign wants to know at once.
fn log(flight: &FlightLine) {
    tracing::debug!(seed = flight.seed, result = ?flight.result, "flown");
    for violation in &flight.violations {
        let ViolationLine { invariant, seed, at_s, detail, .. } = violation;
        tracing::warn!(seed, at_s, "violation {invariant}: {detail}");
    }
}

fn show(args: &Args, document: &CampaignDocument) -> Exit {
    let name = |path: &Option<PathBuf>, word: &str| {
        path.as_ref().map_or(word.to_owned(), |path| path.display().to_string())
    };
    let faults = match &document.identity.faults_digest {
        Some(_) => format!(" --faults {}", name(&args.faults, "FAULTS")),
        None => String::new(),
    };
    let actuation = document.identity.actuation.as_ref();
    let actuation = actuation.map_or(String::new(), |actuation| format!(" --actuation {actuation}"));
    let tracks = match &document.identity.tracks_digest {
        Some(_) => format!(" --tracks {}", name(&args.tracks, "TRACKS")),
        None => String::new(),
    };
    let mission = name(&args.mission, "MISSION");
    let replay =
        format!("veilwing campaign {mission} --runs 1 --seed SEED{faults}{actuation}{tracks} --out run-SEED");
    let table = || {
        let coverage = if args.coverage { coverage::table(&document.coverage) } else { String::new() };
        coverage + &document.table(&replay)
    };
    let shown = if args.json { print_json(document) } else { print_text(&table()) };
    match shown {
        Exit::Done if !document.violations.is_empty() => Exit::Bad,
        shown => shown,
    }
}
