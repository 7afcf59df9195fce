//! `veilwing schema`: JSON Schema of the files that people write.

use serde_json::Value as Json;

use super::{Exit, print_json};
use crate::config::schema::{self, Part};
#[cfg(feature = "desk")]
use crate::desk::simulation::Faults;

/// Print the JSON Schema (draft-07) of the mission, vehicle, radio and fault files, for editors.
///
/// That of one kind of file; without one, a document with all of them under `definitions`. A file that begins with
/// `#:schema PATH` is checked by editors with Even Better TOML, taplo or tombi as it is written: the shipped ones do, by
/// config/schema/.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example: veilwing schema mission > mission.schema.json")]
pub(super) struct Args {
    /// Only this one's.
    #[arg(value_enum)]
    file: Option<File>,
}

/// A kind of file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum File {
    /// What the pair does, where, and for whom
    Mission,
    /// A vehicle: links, autopilot, transmitter, limits
    Vehicle,
    /// A radio host and its device
    Radio,
    /// What goes wrong in simulated flights
    #[cfg(feature = "desk")]
    Faults,
}

impl File {
    fn definition(self) -> (&'static str, Json) {
        let of = |part: Part| (part.key(), part.schema());
        match self {
            Self::Mission => of(Part::Mission),
            Self::Vehicle => of(Part::Vehicle),
            Self::Radio => of(Part::Radio),
            #[cfg(feature = "desk")]
            Self::Faults => {
                let words = "The fault file: what goes wrong in simulated flights.";
                ("faults", schema::described(Faults::schema(), "veilwing faults", words))
            }
        }
    }
}

/// Prints the schema.
pub(super) fn run(args: &Args) -> Exit {
    let all = || schema::any_of(<File as clap::ValueEnum>::value_variants().iter().map(|f| f.definition()));
    print_json(&args.file.map_or_else(all, |file| schema::alone(file.definition().1)))
}
