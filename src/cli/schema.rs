//! `veilwing schema`: JSON Schema of the mission and vehicle files.

use std::process::ExitCode;

/// Print the JSON Schema (draft 2020-12) of the mission and vehicle files, for editors.
///
/// One document with both: the mission's under `$defs.mission`, the vehicle's under `$defs.vehicle`.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example: veilwing schema > veilwing.schema.json")]
pub struct Args {}

/// Prints the schema; exit code 0.
#[must_use]
pub fn run(_args: &Args) -> ExitCode {
    println!("{:#}", crate::config::schema());
    ExitCode::SUCCESS
}
