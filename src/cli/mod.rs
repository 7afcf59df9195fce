//! The command line: one file a subcommand. Results on stdout, progress and logs on stderr.

#[cfg(feature = "sitl")]
mod campaign;
mod check;
mod evaluate;
mod figures;
mod fly;
mod plan;
mod planning;
mod report;
mod schema;
#[cfg(feature = "sitl")]
mod sitl;

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

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> Self {
        Self::from(match exit {
            Exit::Done => 0,
            Exit::Bad => 1,
            Exit::Unusable => 2,
            Exit::Interrupted => 130,
        })
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
    Figures(figures::Args),
    #[cfg(feature = "sitl")]
    Sitl(sitl::Args),
    #[cfg(feature = "sitl")]
    Campaign(campaign::Args),
    Fly(fly::Args),
    Report(report::Args),
    Schema(schema::Args),
}

/// Runs the command named on the command line.
#[must_use]
pub fn main() -> ExitCode {
    let cli = Cli::parse();
    start_log(cli.log_format);
    let exit = match &cli.command {
        Command::Check(args) => return check::run(args),
        Command::Plan(args) => plan::run(args),
        Command::Evaluate(args) => evaluate::run(args),
        Command::Figures(args) => figures::run(args),
        #[cfg(feature = "sitl")]
        Command::Sitl(args) => sitl::run(args),
        #[cfg(feature = "sitl")]
        Command::Campaign(args) => campaign::run(args),
        Command::Fly(args) => fly::run(args),
        Command::Report(args) => report::run(args),
        Command::Schema(args) => return schema::run(args),
    };
    exit.into()
}

fn start_log(format: LogFormat) {
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new("info"));
    let log =
        tracing_subscriber::fmt().with_env_filter(filter).with_writer(std::io::stderr).with_target(false);
    match format {
        LogFormat::Text => log.with_ansi(std::io::IsTerminal::is_terminal(&std::io::stderr())).init(),
        LogFormat::Json => log.json().init(),
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
    match std::io::stdout().write_all(text.as_bytes()) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            eprintln!("error: cannot write to stdout: {error}");
            Exit::Bad
        }
        _ => Exit::Done,
    }
}

/// Loads a mission; warnings and errors go to stderr as `file:line:column: message`.
fn load_mission(path: &std::path::Path) -> Result<crate::config::Mission, Exit> {
    match crate::config::Mission::load(path) {
        Ok(mission) => {
            if !mission.warnings.is_empty() {
                eprintln!("{}", mission.warnings);
            }
            Ok(mission)
        }
        Err(errors) => {
            eprintln!("{errors}");
            Err(Exit::Unusable)
        }
    }
}
