//! The JSON Schema of all files as one document, or of one of them.

use serde_json::{Value as Json, json};

use super::{Mission, RadioFile, Vehicle};

/// A kind of file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Part {
    /// The mission file.
    Mission,
    /// The vehicle file.
    Vehicle,
    /// The radio file.
    Radio,
}

impl Part {
    const ALL: [Self; 3] = [Self::Mission, Self::Vehicle, Self::Radio];

    fn key(self) -> &'static str {
        match self {
            Self::Mission => "mission",
            Self::Vehicle => "vehicle",
            Self::Radio => "radio",
        }
    }

    fn described(self) -> Json {
        let (mut schema, title, description) = match self {
            Self::Mission => {
                (Mission::schema(), "veilwing mission", "The mission file: the same on both vehicles.")
            }
            Self::Vehicle => {
                (Vehicle::schema(), "veilwing vehicle", "The vehicle file: one for each vehicle.")
            }
            Self::Radio => {
                (RadioFile::schema(), "veilwing radio", "The radio file: one for each radio host.")
            }
        };
        schema["title"] = json!(title);
        schema["description"] = json!(description);
        schema
    }
}

const DRAFT: &str = "https://json-schema.org/draft/2020-12/schema";

/// JSON Schema, draft 2020-12: `$defs.mission`, `$defs.vehicle` and `$defs.radio`; the document itself accepts any of them.
#[must_use]
pub fn schema() -> Json {
    let parts: serde_json::Map<String, Json> =
        Part::ALL.into_iter().map(|part| (part.key().to_owned(), part.described())).collect();
    let any: Vec<Json> = parts.keys().map(|key| json!({ "$ref": format!("#/$defs/{key}") })).collect();
    json!({ "$schema": DRAFT, "title": "veilwing files", "$defs": parts, "anyOf": any })
}

/// JSON Schema, draft 2020-12, of one kind of file.
#[must_use]
pub fn schema_of(part: Part) -> Json {
    let mut schema = part.described();
    schema["$schema"] = json!(DRAFT);
    schema
}
