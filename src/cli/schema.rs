//! `veilwing schema`: JSON Schema of the mission, vehicle and radio files.

use super::{Exit, print_json};
use crate::config::{Part, schema, schema_of};

/// Print the JSON Schema (draft 2020-12) of the mission, vehicle and radio files, for editors.
///
/// One document with all of them, under `$defs.mission`, `$defs.vehicle` and `$defs.radio`; or that of one.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example: veilwing schema > veilwing.schema.json")]
pub(super) struct Args {
    /// Only this one's.
    #[arg(value_enum)]
    part: Option<Part>,
}

/// Prints the schema.
pub(super) fn run(args: &Args) -> Exit {
    print_json(&args.part.map_or_else(schema, schema_of))
}
