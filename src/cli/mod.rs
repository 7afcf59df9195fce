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

#[cfg(feature = "desk")]
mod calibrate;
#[cfg(feature = "desk")]
mod campaign;
mod check;
mod evaluate;
#[cfg(feature = "desk")]
mod figures;
mod fly;
mod interrupt;
mod plan;
mod planning;
mod radio;
#[cfg(feature = "desk")]
mod report;
mod schema;
#[cfg(feature = "desk")]
mod sitl;
#[cfg(feature = "desk")]
mod step;

use std::process::ExitCode;

use clap::{Parser, Subcommand, ValueEnum};
use tracing_subscriber::EnvFilter;

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

/// Two omnidirectional multirotors protect a ground user's radio traffic: plan, simulate, fly.
#[derive(Debug, Parser)]
#[command(
    version,
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
    Text,
    Json,
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
    #[cfg(feature = "desk")]
    #[command(hide = true)]
    RadioDevice(sitl::radios::client::Args),
    #[cfg(feature = "desk")]
    Report(report::Args),
    #[cfg(feature = "desk")]
    Calibrate(calibrate::Args),
    Schema(schema::Args),
}

/// Runs the command named on the command line.
#[must_use]
pub fn main() -> ExitCode {
    let cli = Cli::parse();
    start_log(cli.log_format);
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
        #[cfg(feature = "desk")]
        Command::RadioDevice(args) => sitl::radios::client::run(args),
        #[cfg(feature = "desk")]
        Command::Report(args) => report::run(args),
        #[cfg(feature = "desk")]
        Command::Calibrate(args) => calibrate::run(args),
        Command::Schema(args) => schema::run(args),
    };
    exit.into()
}

/// The log on stderr is JSON.
static JSON_LOG: std::sync::atomic::AtomicBool = std::sync::atomic::AtomicBool::new(false);

fn start_log(format: LogFormat) {
    JSON_LOG.store(matches!(format, LogFormat::Json), std::sync::atomic::Ordering::Relaxed);
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new("info"));
    let log = tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(std::io::stderr)
        .with_target(false)
        // It would panic when stderr takes nothing: in flight, when the terminal or the pipe behind it is gone.
        .log_internal_errors(false);
    match format {
        LogFormat::Text => log.with_ansi(std::io::IsTerminal::is_terminal(&std::io::stderr())).init(),
        LogFormat::Json => log.json().init(),
    }
}

/// A line of progress on stderr: a record of the log where that is JSON.
#[cfg(feature = "desk")]
fn progress(text: &str) {
    if JSON_LOG.load(std::sync::atomic::Ordering::Relaxed) {
        tracing::info!("{text}");
    } else {
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
