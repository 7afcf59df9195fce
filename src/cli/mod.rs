//! The command line: one file a subcommand. Results on stdout, progress and logs on stderr.

/// Prints a line on stderr. In place of the standard library's, which panics when nobody can be told (`2>&1 | head`, a
/// full disk): what is said may be lost, a flight or a result may not.
macro_rules! eprintln {
    () => { eprint!("\n") };
    ($($text:tt)*) => { eprint!("{}\n", format_args!($($text)*)) };
}

/// Prints on stderr: see `eprintln`.
macro_rules! eprint {
    ($($text:tt)*) => {{
        let _ = std::io::Write::write_fmt(&mut std::io::stderr().lock(), format_args!($($text)*));
    }};
}

mod bench;
#[cfg(feature = "desk")]
mod calibrate;
#[cfg(feature = "desk")]
mod campaign;
mod check;
mod evaluate;
#[cfg(feature = "desk")]
mod figures;
mod flight_log;
mod fly;
#[cfg(feature = "desk")]
mod ground_station;
mod interrupt;
mod journal;
mod logs;
mod manuals;
mod plan;
mod planning;
mod progress;
mod radio;
mod recording;
#[cfg(feature = "desk")]
mod report;
mod schema;
#[cfg(feature = "desk")]
mod sitl;
#[cfg(feature = "desk")]
mod step;
#[cfg(feature = "desk")]
mod watch;

use std::process::ExitCode;

use clap::{ColorChoice, CommandFactory, FromArgMatches, Parser, Subcommand, ValueEnum};
use tracing_subscriber::EnvFilter;
use tracing_subscriber::layer::{Layer, SubscriberExt};
use tracing_subscriber::util::SubscriberInitExt;

/// How a command ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Exit {
    /// Done.
    Done,
    /// Ran, and the result is bad: a violated invariant, a failed preflight, a mission not completed.
    Bad,
    /// Unusable input or arguments.
    Unusable,
    /// Interrupted, after a clean stop.
    Interrupted,
}

impl Exit {
    fn code(self) -> u8 {
        match self {
            Self::Done => 0,
            Self::Bad => 1,
            Self::Unusable => 2,
            Self::Interrupted => 130,
        }
    }
}

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> Self {
        Self::from(exit.code())
    }
}

/// With the commit and the target of this build (build.rs).
const VERSION: &str = env!("VEILWING_VERSION");

/// Two omnidirectional multirotors protect a ground user's radio traffic: plan, simulate, fly.
#[derive(Debug, Parser)]
#[command(
    version = VERSION,
    after_help = "Example: veilwing sitl config/mission.toml\nA mission file to start from: config/mission.toml\nExit codes: 0 done; 1 ran, and the result is bad; 2 unusable input or arguments; 130 interrupted."
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
    /// Format of the log on stderr; RUST_LOG sets its level (for example RUST_LOG=debug).
    #[arg(long, global = true, value_enum, default_value_t = LogFormat::Text)]
    log_format: LogFormat,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum LogFormat {
    /// Lines for a reader
    Text,
    /// One JSON document a line
    Json,
    /// Records of systemd's journal, each field by its own name; as text where there is no journal
    Journal,
}

#[derive(Debug, Subcommand)]
enum Command {
    Check(check::Args),
    Plan(plan::Args),
    Evaluate(evaluate::Args),
    #[cfg(feature = "desk")]
    Figures(figures::Args),
    #[cfg(feature = "desk")]
    Sitl(sitl::Args),
    #[cfg(feature = "desk")]
    Campaign(campaign::Args),
    Fly(fly::Args),
    Radio(radio::Args),
    Bench(bench::Args),
    Logs(logs::Args),
    #[cfg(feature = "desk")]
    #[command(hide = true)]
    RadioDevice(sitl::radios::client::Args),
    #[cfg(feature = "desk")]
    Report(report::Args),
    #[cfg(feature = "desk")]
    Calibrate(calibrate::Args),
    #[cfg(feature = "desk")]
    Watch(watch::Args),
    #[cfg(feature = "desk")]
    GroundStation(ground_station::Args),
    Schema(schema::Args),
    Manuals(manuals::Args),
}

/// Runs the command named on the command line.
#[must_use]
pub fn main() -> ExitCode {
    // Its own rule for colours asks for them in continuous integration, whatever the terminal knows.
    let color = if escapes_are_refused() { ColorChoice::Never } else { ColorChoice::Auto };
    let matches = Cli::command().color(color).get_matches();
    let cli = Cli::from_arg_matches(&matches).unwrap_or_else(|error| error.exit());
    start_log(cli.log_format, matches!(cli.command, Command::Fly(_) | Command::Radio(_) | Command::Bench(_)));
    interrupt::watch();
    let exit = match &cli.command {
        Command::Check(args) => check::run(args),
        Command::Plan(args) => plan::run(args),
        Command::Evaluate(args) => evaluate::run(args),
        #[cfg(feature = "desk")]
        Command::Figures(args) => figures::run(args),
        #[cfg(feature = "desk")]
        Command::Sitl(args) => sitl::run(args),
        #[cfg(feature = "desk")]
        Command::Campaign(args) => campaign::run(args),
        Command::Fly(args) => fly::run(args),
        Command::Radio(args) => radio::run(args),
        Command::Bench(args) => bench::run(args),
        Command::Logs(args) => logs::run(args),
        #[cfg(feature = "desk")]
        Command::RadioDevice(args) => sitl::radios::client::run(args),
        #[cfg(feature = "desk")]
        Command::Report(args) => report::run(args),
        #[cfg(feature = "desk")]
        Command::Calibrate(args) => calibrate::run(args),
        #[cfg(feature = "desk")]
        Command::Watch(args) => watch::run(args),
        #[cfg(feature = "desk")]
        Command::GroundStation(args) => ground_station::run(args),
        Command::Schema(args) => schema::run(args),
        Command::Manuals(args) => manuals::run(args),
    };
    exit.into()
}

/// Whether escape sequences may go to stderr: to a terminal that knows them, unless NO_COLOR is in the environment.
fn may_escape() -> bool {
    !escapes_are_refused() && std::io::IsTerminal::is_terminal(&std::io::stderr())
}

/// By NO_COLOR, or by a terminal that knows none.
fn escapes_are_refused() -> bool {
    let refused = std::env::var_os("NO_COLOR").is_some_and(|value| !value.is_empty());
    let is_dumb = std::env::var_os("TERM").is_none_or(|term| term == "dumb");
    refused || is_dumb
}

/// The log on stderr is JSON.
static JSON_LOG: std::sync::atomic::AtomicBool = std::sync::atomic::AtomicBool::new(false);

fn start_log(format: LogFormat, recorded: bool) {
    JSON_LOG.store(matches!(format, LogFormat::Json), std::sync::atomic::Ordering::Relaxed);
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new("info"));
    let lines = tracing_subscriber::fmt::layer()
        .with_writer(log_writer())
        .with_target(false)
        // It would panic when stderr takes nothing: in flight, when the terminal or the pipe behind it is gone.
        .log_internal_errors(false);
    let journal = matches!(format, LogFormat::Journal).then(journal::Journal::open).and_then(Result::ok);
    let shown = match (format, journal) {
        (_, Some(journal)) => journal.boxed(),
        (LogFormat::Json, None) => lines.json().boxed(),
        (LogFormat::Text | LogFormat::Journal, None) => lines.with_ansi(may_escape()).boxed(),
    };
    // What records its flights has its log there too.
    let kept = recorded.then(flight_log::layer);
    tracing_subscriber::registry().with(shown.with_filter(filter)).with(kept).init();
}

/// Where the log goes: to stderr, or, while a view has the terminal, to that.
#[cfg(feature = "desk")]
fn log_writer() -> impl for<'a> tracing_subscriber::fmt::MakeWriter<'a> + Send + Sync + 'static {
    watch::takes_over()
}

#[cfg(not(feature = "desk"))]
fn log_writer() -> impl for<'a> tracing_subscriber::fmt::MakeWriter<'a> + Send + Sync + 'static {
    std::io::stderr
}

/// A line of progress on stderr: a record of the log where that is JSON.
#[cfg(feature = "desk")]
fn progress(text: &str) {
    if JSON_LOG.load(std::sync::atomic::Ordering::Relaxed) {
        tracing::info!("{text}");
    } else if !watch::aside(text) {
        eprintln!("{text}");
    }
}

/// Prints one JSON document on stdout.
fn print_json(document: &impl serde::Serialize) -> Exit {
    match serde_json::to_string_pretty(document) {
        Ok(text) => print_text(&format!("{text}\n")),
        Err(error) => {
            eprintln!("error: the result cannot be written as JSON: {error}");
            Exit::Bad
        }
    }
}

/// Prints on stdout; a reader that went away (`| head`) is no failure of ours.
fn print_text(text: &str) -> Exit {
    use std::io::Write;
    let mut stdout = std::io::stdout().lock();
    match stdout.write_all(text.as_bytes()).and_then(|()| stdout.flush()) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            eprintln!("error: cannot write the result to stdout: {error}; send it to a file on another disk");
            Exit::Bad
        }
        _ => Exit::Done,
    }
}

/// Words in lines of at most so many characters; a longer word has a line of its own.
fn folded(text: &str, width: usize) -> Vec<String> {
    let mut lines = Vec::<String>::new();
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if line.chars().count() + 1 + word.chars().count() <= width => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

/// Loads a vehicle file; warnings and errors go to stderr as those of a mission.
fn load_vehicle(path: &std::path::Path) -> Result<crate::config::Vehicle, Exit> {
    match crate::config::Vehicle::load(path) {
        Ok(vehicle) => {
            eprint!("{}", vehicle.warnings);
            Ok(vehicle)
        }
        Err(errors) => {
            eprint!("{errors}");
            Err(Exit::Unusable)
        }
    }
}

/// Loads a mission; warnings and errors go to stderr as `file:line:column: message`.
fn load_mission(path: &std::path::Path) -> Result<crate::config::Mission, Exit> {
    match crate::config::Mission::load(path) {
        Ok(mission) => {
            eprint!("{}", mission.warnings);
            Ok(mission)
        }
        Err(errors) => {
            eprint!("{errors}");
            Err(Exit::Unusable)
        }
    }
}
