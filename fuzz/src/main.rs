//! `cargo run --release -p veilwing-fuzz -- TARGET --seconds N --seed S`; docs/fuzzing.md.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

use clap::Parser;
use veilwing::link::Clock;
use veilwing_fuzz::fuzzer::{Fuzzer, Outcome, quiet_panics};
use veilwing_fuzz::watchdog::Watchdog;
use veilwing_fuzz::{Reached, TARGETS, Target, corpus};

/// How often the watchdog looks.
const LOOKS: Duration = Duration::from_millis(200);
/// How many different panics are shown before the search ends.
const MOST_PANICS: usize = 20;
const HANGS: u8 = 3;

/// Fuzzes one target for a time. Exit codes: 0 nothing wrong, 1 panics, 2 bad arguments, 3 a hang.
#[derive(Debug, Parser)]
#[command(
    after_help = "Example: cargo run --release -p veilwing-fuzz -- mission-file --seconds 300 --seed 1"
)]
struct Args {
    /// Target; without one all are listed.
    target: Option<String>,
    /// How long.
    #[arg(long, default_value_t = 60)]
    seconds: u64,
    /// What the inputs are drawn from.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Longest time for one input, seconds.
    #[arg(long, default_value_t = 10)]
    longest: u64,
    /// Where its corpus is, and grows [default: the repository's].
    #[arg(long, value_name = "DIR")]
    corpus: Option<PathBuf>,
    /// Where inputs that panic or hang are written.
    #[arg(long, value_name = "DIR", default_value = "fuzz-found")]
    found: PathBuf,
    /// Run these inputs and nothing else.
    #[arg(long, value_name = "FILE", num_args = 1..)]
    replay: Vec<PathBuf>,
    /// Leave of the corpus only what together reaches all that it reaches, and end.
    #[arg(long)]
    distill: bool,
}

fn main() -> ExitCode {
    let args = Args::parse();
    let Some(target) = args.target.as_deref().and_then(Target::named) else {
        for target in TARGETS {
            println!("{:<22} {}", target.name, target.what);
        }
        return ExitCode::from(if args.target.is_some() { 2 } else { 0 });
    };
    let directory = args.corpus.clone().unwrap_or_else(|| corpus::directory(target));
    let done = if !args.replay.is_empty() {
        replay(target, &args.replay)
    } else if args.distill {
        distill(target, &directory)
    } else {
        fuzz(target, &args, &directory)
    };
    done.unwrap_or_else(|error| {
        eprintln!("{}: {error}", target.name);
        ExitCode::from(2)
    })
}

/// Runs inputs one after the other; a panic ends it as it would end any program, with its place.
fn replay(target: &Target, files: &[PathBuf]) -> std::io::Result<ExitCode> {
    for path in files {
        let input = std::fs::read(path)?;
        println!("{}: {} bytes", path.display(), input.len());
        println!("{} outcomes", target.reach(&input).len());
    }
    Ok(ExitCode::SUCCESS)
}

fn distill(target: &Target, directory: &Path) -> std::io::Result<ExitCode> {
    let mut known = Reached::default();
    (target.seeds)().iter().for_each(|seed| known.join(&target.reach(seed)));
    let all = corpus::load(directory)?;
    let kept = corpus::distilled(target, all.clone(), &known);
    for input in all.iter().filter(|input| !kept.contains(input)) {
        std::fs::remove_file(directory.join(corpus::name_of(input)))?;
    }
    let bytes: usize = kept.iter().map(Vec::len).sum();
    println!("{}: {} of {} inputs kept, {bytes} bytes", target.name, kept.len(), all.len());
    Ok(ExitCode::SUCCESS)
}

fn fuzz(target: &Target, args: &Args, directory: &Path) -> std::io::Result<ExitCode> {
    quiet_panics();
    let clock = Clock::real();
    let watchdog = Watchdog::default();
    let (stop, stopped) = channel::<()>();
    let guard = {
        let (watchdog, clock, found, name) =
            (watchdog.clone(), clock.clone(), args.found.clone(), target.name);
        let limit = Duration::from_secs(args.longest);
        std::thread::spawn(move || {
            while stopped.recv_timeout(LOOKS) == Err(RecvTimeoutError::Timeout) {
                if let Some(input) = watchdog.overdue(limit, clock.now()) {
                    let kept = corpus::store(&found.join(name), &input);
                    println!("{name}: an input of {} bytes hangs: {kept:?}", input.len());
                    std::process::exit(HANGS.into());
                }
            }
        })
    };
    let mut fuzzer = Fuzzer::new(target, args.seed).watched(watchdog, clock.clone());
    let mut panics: Vec<String> = Vec::new();
    let mut note = |outcome: Outcome, kept: &Path| -> std::io::Result<usize> {
        match outcome {
            Outcome::New(input) => corpus::store(kept, &input).map(|_| 0),
            Outcome::Panicked { input, message } => {
                // One place that panics is told once, whatever the values.
                let place = message.lines().next().unwrap_or_default().to_owned();
                if !panics.contains(&place) {
                    let path = corpus::store(&args.found.join(target.name), &input)?;
                    println!("{}: panic, input in {}\n{message}", target.name, path.display());
                    panics.push(place);
                }
                Ok(panics.len())
            }
            Outcome::Known => Ok(panics.len()),
        }
    };
    let (mut executions, mut new, mut bad) = (0_u64, 0_u64, 0);
    for input in (target.seeds)().into_iter().chain(corpus::load(directory)?) {
        if let panicked @ Outcome::Panicked { .. } = fuzzer.take(input) {
            bad = note(panicked, directory)?;
        }
        executions += 1;
    }
    let (began, known) = (executions, fuzzer.known().len());
    while clock.now().since_start() < Duration::from_secs(args.seconds) && bad < MOST_PANICS {
        let input = fuzzer.next_input();
        let outcome = fuzzer.run(input);
        new += u64::from(matches!(outcome, Outcome::New(_)));
        bad = bad.max(note(outcome, directory)?);
        executions += 1;
    }
    drop(stop);
    // It cannot have panicked, and if it had, nothing would be left to save.
    drop(guard.join());
    println!(
        "{}: {executions} executions ({began} of the corpus) in {} s, seed {}: {known} outcomes before, {} after; {new} new inputs, {bad} panics, no hang",
        target.name,
        args.seconds,
        args.seed,
        fuzzer.known().len()
    );
    Ok(ExitCode::from(u8::from(bad > 0)))
}
