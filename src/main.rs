//! The `veilwing` command.

use std::process::ExitCode;

use clap::Parser;
use veilwing::cli::{check, schema};

/// Plans and flies cooperative jamming missions.
#[derive(Parser)]
enum Command {
    /// Validate a mission file.
    Check(check::Args),
    /// Print the JSON Schema.
    Schema(schema::Args),
}

fn main() -> ExitCode {
    match Command::parse() {
        Command::Check(args) => check::run(&args),
        Command::Schema(args) => schema::run(&args),
    }
}
