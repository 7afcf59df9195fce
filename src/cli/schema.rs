//! `veilwing schema`: JSON Schema of the mission and vehicle files.

use super::{Exit, print_json};

/// Print the JSON Schema (draft 2020-12) of the mission and vehicle files, for editors.
///
/// One document with both: the mission's under `$defs.mission`, the vehicle's under `$defs.vehicle`.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example: veilwing schema > veilwing.schema.json")]
pub(super) struct Args {}

/// Prints the schema.
pub(super) fn run(_args: &Args) -> Exit {
    print_json(&crate::config::schema())
}
