//! `veilwing figures`: the paper's figures, and six of what it leaves out, from the running program.

use std::error::Error;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use clap::builder::PossibleValuesParser;

use crate::config::Mission;
use crate::config::file::{usable_directory, write_whole};
use crate::desk::figures::breakdown::{self, Slot};
use crate::desk::figures::{self, Figure, Settings};
use crate::link::clock::Clock;
use crate::planning::options;

use super::planning::plan_mission;
use super::progress::Progress;
use super::{Exit, load_mission, may_escape, print_text, progress};

/// Draw the paper's figures 3 and 4a to 4c, rates over null depth and Rician factor, volume over slots and arenas, what is lost over a
/// user's speed, and what each imperfection costs a mission, as SVG and CSV.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example: veilwing figures --out figures --scenarios 100 --threads 2")]
pub(super) struct Args {
    /// Directory to write into; made if it is not there.
    #[arg(long, value_name = "DIR", default_value = "figures")]
    out: PathBuf,
    /// Random scenarios behind each mean of rates; a fifth as many behind those of volume, and a twenty-fifth as many flights at each
    /// speed.
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = clap::value_parser!(u32).range(2..=100_000))]
    scenarios: u32,
    /// Threads; the figures do not depend on it.
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u16).range(1..=256))]
    threads: u16,
    /// Seed of the scenarios and of the planner.
    #[arg(long, value_name = "N", default_value_t = 6, allow_negative_numbers = true)]
    seed: u64,
    /// Mission file whose imperfections are broken down; by default the demo.
    #[arg(long, value_name = "MISSION")]
    mission: Option<PathBuf>,
    /// Draw this figure, and others so named, and none else.
    #[arg(long, value_name = "FIGURE", value_parser = PossibleValuesParser::new(names()))]
    only: Vec<String>,
}

/// Of all figures.
fn names() -> Vec<&'static str> {
    [figures::names(), vec![breakdown::NAME]].concat()
}

/// The demo, as it was when this program was built.
const DEMO: &str = include_str!("../../config/mission.toml");

pub(super) fn run(args: &Args) -> Exit {
    let clock = Clock::real();
    let started = clock.now();
    let elapsed_s = || clock.now().saturating_since(started).as_secs_f64();
    let settings =
        Settings { scenarios: args.scenarios as usize, threads: args.threads.into(), seed: args.seed };
    let mission = match &args.mission {
        Some(path) => load_mission(path),
        None => Mission::parse("config/mission.toml", DEMO).map_err(|errors| {
            eprint!("{errors}");
            Exit::Unusable
        }),
    };
    let mission = match mission {
        Ok(mission) => mission,
        Err(exit) => return exit,
    };
    // Before the work, not after it, is the time to learn that the directory cannot be written.
    if let Err(error) = usable_directory(&args.out) {
        eprintln!("error: {error}");
        return Exit::Unusable;
    }
    let line = ProgressLine::default();
    let wanted = |name: &str| args.only.is_empty() || args.only.iter().any(|only| only == name);
    let figures = match make(&mission, &settings, wanted, &line) {
        Ok(figures) => figures,
        Err(error) => {
            eprintln!("error: {error}");
            return Exit::Unusable;
        }
    };
    let mut text = String::new();
    for figure in &figures {
        match write(&args.out, figure) {
            // Writing to a String cannot fail.
            Ok(paths) => paths.iter().for_each(|path| {
                let _ = writeln!(text, "{}", path.display());
            }),
            Err(exit) => return exit,
        }
    }
    progress(&format!("{} scenarios, seed {}, {:.0} s", args.scenarios, args.seed, elapsed_s()));
    print_text(&text)
}

fn make(
    mission: &Mission,
    settings: &Settings,
    wanted: impl Fn(&str) -> bool,
    line: &ProgressLine,
) -> Result<Vec<Figure>, Box<dyn Error>> {
    let show = |figure: &str, done, count| line.show(figure, done, count);
    let mut figures = figures::make(settings, &wanted, &show)?;
    line.end();
    if !wanted(breakdown::NAME) {
        return Ok(figures);
    }
    let planned = plan_mission(mission, &options(mission))?;
    let slots = planned.plan.slots.iter().zip(&planned.assessments).map(|(slot, assessment)| {
        Slot::new(&slot.user, slot.plan.secrecy_rate_bps, assessment, mission.radio.bandwidth_hz)
    });
    figures.push(breakdown::figure(&mission.name, &slots.collect::<Vec<_>>()));
    Ok(figures)
}

fn write(out: &Path, figure: &Figure) -> Result<[PathBuf; 2], Exit> {
    let write = |extension: &str, text: &str| {
        let path = out.join(format!("{}.{extension}", figure.name));
        match write_whole(&path, text) {
            Ok(()) => Ok(path),
            Err(error) => {
                eprintln!("error: {error}");
                Err(Exit::Unusable)
            }
        }
    };
    Ok([write("svg", &figure.svg)?, write("csv", &figure.csv)?])
}

/// A bar for each figure on a terminal; elsewhere a line for every tenth of one.
#[derive(Debug, Default)]
struct ProgressLine(Mutex<Shown>);

#[derive(Debug, Default)]
struct Shown {
    figure: String,
    percent: usize,
    bar: Option<Progress>,
}

impl ProgressLine {
    /// Nothing is shown any more.
    fn end(&self) {
        self.0.lock().unwrap_or_else(std::sync::PoisonError::into_inner).bar = None;
    }

    fn show(&self, figure: &str, done: usize, count: usize) {
        // A thread that died while printing spoils nothing here.
        let mut shown = self.0.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        if shown.figure != figure {
            let bar = may_escape().then(|| Progress::new(figure, count as u64));
            *shown = Shown { figure: figure.to_owned(), percent: 0, bar };
        }
        let percent = 100 * done / count.max(1);
        // Threads may report out of order: only what is further than before is shown.
        if let Some(bar) = &shown.bar {
            if percent > shown.percent {
                bar.at(done as u64);
                shown.percent = percent;
            }
        } else if percent / 10 > shown.percent / 10 {
            shown.percent = percent;
            progress(&format!("{figure}: {percent}%"));
        }
    }
}
