//! `veilwing logs`: recorded flights, listed, bundled, pruned.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::time::Duration;

use serde::Serialize;

use super::{Exit, folded, print_json, print_text};
use crate::computer;
use crate::config::{LogLimits, file::unwritable};
use crate::logbook::bundle::{Bundle, BundleError};
use crate::logbook::{Entry, Limits, Logbook, Writer};

/// Where flights are, unless it is said: beside whoever asks, or where the installed service keeps them.
const PLACES: [&str; 2] = ["flight-logs", "/var/lib/veilwing/flights"];
/// Words are folded to so many columns.
const COLUMNS: usize = 80;

const EXAMPLES: &str = "Examples:
  veilwing logs /var/lib/veilwing/flights
  veilwing logs bundle logs-of-i logs-of-j --out courtyard.tar.gz
      both vehicles' newest flight of one mission; unpacked, `veilwing report` reads its directory
  veilwing logs prune --max-mb 2000 --dry-run";

/// Recorded flights: list them, bundle both vehicles' flights of a mission, remove the oldest.
///
/// Each start of `fly` and of `radio` records into a directory of its own, in the directory that [log] dir names.
#[derive(Debug, clap::Args)]
#[command(args_conflicts_with_subcommands = true, after_help = EXAMPLES)]
pub(super) struct Args {
    #[command(subcommand)]
    command: Option<Command>,
    #[command(flatten)]
    list: List,
}

#[derive(Debug, clap::Subcommand)]
enum Command {
    List(List),
    Bundle(Bundling),
    Prune(Prune),
}

/// List flights: how each ended, how long it was, what it takes.
#[derive(Debug, clap::Args)]
struct List {
    /// Log directories; by default flight-logs here, or /var/lib/veilwing/flights.
    #[arg(value_name = "DIR")]
    directories: Vec<PathBuf>,
    /// Print one JSON document.
    #[arg(long)]
    json: bool,
}

/// Make one archive of both vehicles' flights of a mission: the newest, or those that are named.
#[derive(Debug, clap::Args)]
struct Bundling {
    /// Log directories, of both vehicles; by default as for `list`.
    #[arg(value_name = "DIR")]
    directories: Vec<PathBuf>,
    /// A flight by its name, as `logs` lists it; may be repeated.
    #[arg(long = "flight", value_name = "NAME")]
    flights: Vec<String>,
    /// The archive to write (.tar.gz); by default named by mission and time, here.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

/// Remove the oldest flights until the others are within the limits; never one that is being recorded, nor the last two
/// of a vehicle.
#[derive(Debug, clap::Args)]
struct Prune {
    /// Log directory; by default as for `list`.
    #[arg(value_name = "DIR")]
    directory: Option<PathBuf>,
    /// What all flights together may take, in MB.
    #[arg(long, value_name = "N", default_value_t = LogLimits::default().max_mb)]
    max_mb: u64,
    /// What they leave free on their disk, in MB.
    #[arg(long, value_name = "N", default_value_t = LogLimits::default().min_free_mb)]
    min_free_mb: u64,
    /// Say what would be removed, and remove nothing.
    #[arg(long)]
    dry_run: bool,
}

pub(super) fn run(args: &Args) -> Exit {
    let done = match &args.command {
        None => list(&args.list),
        Some(Command::List(args)) => list(args),
        Some(Command::Bundle(args)) => bundle(args),
        Some(Command::Prune(args)) => prune(args),
    };
    done.unwrap_or_else(|message| {
        eprintln!("error: {message}");
        Exit::Unusable
    })
}

/// The directories asked for, or the first usual one that is there.
fn places(asked: &[PathBuf]) -> Vec<PathBuf> {
    if !asked.is_empty() {
        return asked.to_vec();
    }
    let usual = PLACES.map(PathBuf::from);
    let there = usual.iter().find(|path| path.is_dir()).unwrap_or(&usual[0]);
    vec![there.clone()]
}

fn entries(directories: &[PathBuf]) -> Result<Vec<Entry>, String> {
    let mut all = Vec::new();
    for directory in directories {
        all.extend(Logbook::new(directory).entries().map_err(|error| error.to_string())?);
    }
    Ok(all)
}

/// The list as a document.
#[derive(Debug, Serialize)]
struct Document {
    format: &'static str,
    bytes: u64,
    flights: Vec<Row>,
}

/// One flight.
#[derive(Debug, Serialize)]
struct Row {
    name: String,
    path: PathBuf,
    /// `i`, `j`, or `radio`.
    writer: &'static str,
    mission: Option<String>,
    mission_digest: Option<String>,
    started_utc: Option<String>,
    verdict: &'static str,
    cause: Option<String>,
    duration_s: Option<f64>,
    bytes: u64,
}

impl Row {
    fn of(entry: &Entry) -> Self {
        let record = entry.record.as_ref();
        Self {
            name: entry.name.clone(),
            path: entry.path.clone(),
            writer: entry.writer.key(),
            mission: record.and_then(|record| record.mission.clone()),
            mission_digest: record.and_then(|record| record.mission_digest.clone()),
            started_utc: record.map(|record| record.started_utc.clone()),
            verdict: entry.verdict().as_str(),
            cause: entry.cause().map(str::to_owned),
            duration_s: entry.duration().map(|duration| duration.as_secs_f64()),
            bytes: entry.bytes,
        }
    }
}

fn list(args: &List) -> Result<Exit, String> {
    let directories = places(&args.directories);
    let entries = entries(&directories)?;
    let bytes = entries.iter().map(|entry| entry.bytes).sum();
    if args.json {
        let flights = entries.iter().map(Row::of).collect();
        return Ok(print_json(&Document { format: "veilwing-logs/1", bytes, flights }));
    }
    if entries.is_empty() {
        let searched = named(&directories);
        return Ok(print_text(&format!("no flights in {searched}: `veilwing fly` records into [log] dir\n")));
    }
    let mut text = table(&entries);
    let free =
        computer::disk(&directories[0]).map(|disk| format!("; {} free", mb(disk.free))).unwrap_or_default();
    let _ = writeln!(text, "{} in {}{free}", plural(entries.len()), mb(bytes));
    Ok(print_text(&text))
}

fn table(entries: &[Entry]) -> String {
    let longest = entries.iter().map(|entry| entry.name.len()).max().unwrap_or_default();
    let width = longest.min(COLUMNS - 37);
    let mut text = format!("{:<width$}  {:<11}  {:>9}  {:>11}\n", "flight", "verdict", "length", "size");
    for entry in entries {
        let (name, verdict) = (&entry.name, entry.verdict().as_str());
        let length = entry.duration().map_or_else(|| "-".to_owned(), hours);
        // A name that does not fit has a line of its own.
        let name =
            if name.len() > width { format!("{name}\n{:width$}", "") } else { format!("{name:<width$}") };
        let _ = writeln!(text, "{name}  {verdict:<11}  {length:>9}  {:>11}", mb(entry.bytes));
        for line in entry.cause().map(|cause| folded(cause, COLUMNS - 4)).unwrap_or_default() {
            let _ = writeln!(text, "    {line}");
        }
    }
    text
}

/// Hours, minutes and seconds.
fn hours(duration: Duration) -> String {
    let seconds = duration.as_secs();
    format!("{}:{:02}:{:02}", seconds / 3600, seconds / 60 % 60, seconds % 60)
}

/// Megabytes: one unit for all sizes.
fn mb(bytes: u64) -> String {
    #[allow(clippy::cast_precision_loss)]
    let mb = bytes as f64 / 1e6;
    format!("{mb:.2} MB")
}

fn plural(flights: usize) -> String {
    if flights == 1 { "1 flight".to_owned() } else { format!("{flights} flights") }
}

fn named(directories: &[PathBuf]) -> String {
    let names: Vec<String> = directories.iter().map(|path| path.display().to_string()).collect();
    names.join(", ")
}

fn bundle(args: &Bundling) -> Result<Exit, String> {
    let directories = places(&args.directories);
    let entries = entries(&directories)?;
    let words = |error: BundleError| match error {
        BundleError::Io { path, source } => unwritable(&path, &source),
        error => error.to_string(),
    };
    let bundle = Bundle::choose(&entries, &args.flights, &named(&directories)).map_err(words)?;
    let out = args.out.clone().unwrap_or_else(|| PathBuf::from(format!("{}.tar.gz", bundle.name)));
    bundle.write(&out).map_err(words)?;
    for note in &bundle.notes {
        eprintln!("note: {note}");
    }
    let mut text = String::new();
    for flight in &bundle.flights {
        let _ = writeln!(text, "{}  {}", flight.name, flight.verdict().as_str());
    }
    let unpacked = Path::new(&bundle.name);
    let archive = out.display();
    let _ = writeln!(
        text,
        "in {archive}; to report them: tar xzf {archive} && veilwing report {}",
        unpacked.display()
    );
    let both = crate::role::Role::BOTH
        .iter()
        .all(|role| bundle.flights.iter().any(|flight| flight.writer == Writer::Companion(*role)));
    let shown = print_text(&text);
    Ok(if both { shown } else { Exit::Bad })
}

fn prune(args: &Prune) -> Result<Exit, String> {
    let directories = places(args.directory.as_slice());
    let limits = LogLimits { max_mb: args.max_mb, min_free_mb: args.min_free_mb }.in_bytes();
    let removed = remove(&directories[0], limits, args.dry_run)?;
    let mut text = String::new();
    for entry in &removed {
        let _ = writeln!(text, "{}  {}", entry.name, mb(entry.bytes));
    }
    let bytes: u64 = removed.iter().map(|entry| entry.bytes).sum();
    let what = if args.dry_run { "would be removed" } else { "removed" };
    let _ = writeln!(text, "{what}: {}, {}", plural(removed.len()), mb(bytes));
    Ok(print_text(&text))
}

fn remove(directory: &Path, limits: Limits, dry: bool) -> Result<Vec<Entry>, String> {
    Logbook::new(directory).prune(limits, dry).map_err(|error| error.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spec_lengths_sizes_and_folded_causes_read_alike() {
        assert_eq!(hours(Duration::from_secs(3_723)), "1:02:03");
        assert_eq!(
            (mb(0), mb(1_234_567), mb(8_192_000_000)),
            ("0.00 MB".into(), "1.23 MB".into(), "8192.00 MB".into())
        );
        assert_eq!(folded("one two three", 7), ["one two", "three"]);
        assert_eq!(folded("", 7), [""; 0]);
        assert_eq!(folded("unbreakable a", 4), ["unbreakable", "a"]);
    }
}
