//! The JSON Schema of the files that this layer reads, each as a document of its own or all as one.
//!
//! Draft-07 and `definitions`: what editors' TOML plugins read. Newer drafts say no more of these files.

use serde_json::{Value as Json, json};

use super::{Mission, RadioFile, Vehicle};

/// A kind of file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// The mission file.
    Mission,
    /// The vehicle file.
    Vehicle,
    /// The radio file.
    Radio,
}

impl Part {
    /// All kinds of this layer.
    pub const ALL: [Self; 3] = [Self::Mission, Self::Vehicle, Self::Radio];

    /// Its name among the definitions.
    #[must_use]
    pub fn key(self) -> &'static str {
        match self {
            Self::Mission => "mission",
            Self::Vehicle => "vehicle",
            Self::Radio => "radio",
        }
    }

    /// Its schema with title and description, to be one of the definitions.
    #[must_use]
    pub fn schema(self) -> Json {
        match self {
            Self::Mission => described(
                Mission::schema(),
                "veilwing mission",
                "The mission file: the same on both vehicles.",
            ),
            Self::Vehicle => {
                described(Vehicle::schema(), "veilwing vehicle", "The vehicle file: one for each vehicle.")
            }
            Self::Radio => {
                described(RadioFile::schema(), "veilwing radio", "The radio file: one for each radio host.")
            }
        }
    }
}

const DRAFT: &str = "http://json-schema.org/draft-07/schema#";

/// A file's schema with its title and what it is.
#[must_use]
pub fn described(mut schema: Json, title: &str, description: &str) -> Json {
    schema["title"] = json!(title);
    schema["description"] = json!(description);
    schema
}

/// One document of several kinds of files, under `definitions`; the document itself accepts any of them.
#[must_use]
pub fn any_of(parts: impl IntoIterator<Item = (&'static str, Json)>) -> Json {
    let parts: serde_json::Map<String, Json> =
        parts.into_iter().map(|(key, schema)| (key.to_owned(), schema)).collect();
    let any: Vec<Json> = parts.keys().map(|key| json!({ "$ref": format!("#/definitions/{key}") })).collect();
    json!({ "$schema": DRAFT, "title": "veilwing files", "definitions": parts, "anyOf": any })
}

/// A document of one kind of file.
#[must_use]
pub fn alone(mut schema: Json) -> Json {
    schema["$schema"] = json!(DRAFT);
    schema
}
