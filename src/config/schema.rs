//! The JSON Schema of both files as one document.

use serde_json::{Value as Json, json};

use super::{Mission, Vehicle};

/// JSON Schema, draft 2020-12: `$defs.mission` and `$defs.vehicle`; the document itself accepts either.
#[must_use]
pub fn schema() -> Json {
    let titled = |mut schema: Json, title: &str, description: &str| {
        schema["title"] = json!(title);
        schema["description"] = json!(description);
        schema
    };
    json!({
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "veilwing files",
        "$defs": {
            "mission": titled(Mission::schema(), "veilwing mission", "The mission file: the same on both vehicles."),
            "vehicle": titled(Vehicle::schema(), "veilwing vehicle", "The vehicle file: one for each vehicle."),
        },
        "anyOf": [{ "$ref": "#/$defs/mission" }, { "$ref": "#/$defs/vehicle" }],
    })
}
