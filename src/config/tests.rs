//! Whole files: defaults, digest, schema and examples.

mod by_value;
mod defaults;
mod digest;
mod garbage;
mod link;
mod schema;
mod vehicles;

use std::collections::BTreeSet;

use proptest::prelude::*;
use serde_json::{Value as Json, json};

use super::*;
use crate::autopilot::{Actuation, FirmwareChoice};
use crate::geo::{Enu, Geodetic};
use crate::planner::problem::*;
use crate::planner::volume::Fairness;
use crate::role::{PerVehicle, Role};
use crate::schedule::order::Order;
use crate::transmitter::{Kind, Level, PowerParameter, Protocol, Unit};

const DEMO: &str = include_str!("../../config/mission.toml");
const PAPER: &str = include_str!("../../config/paper.toml");
const VEHICLE_I: &str = include_str!("../../config/vehicle-i.toml");
const VEHICLE_J: &str = include_str!("../../config/vehicle-j.toml");
const RADIO: &str = include_str!("../../config/radio.toml");
const LEAST: &str = "[mission]\n[[user]]\nenu_m = [0, 0, 0]\n[[eavesdropper]]\nenu_m = [120, -40, 0]\n";
const ORIGIN: &str = "origin = { lat_deg = 50.0, lon_deg = 14.0, alt_amsl_m = 200.0 }\n";

fn schema() -> Json {
    use crate::config::schema::{Part, any_of};
    any_of(Part::ALL.map(|part| (part.key(), part.schema())))
}

fn mission(text: &str) -> Mission {
    Mission::parse("m.toml", text).unwrap_or_else(|findings| panic!("{findings}"))
}

fn vehicle(text: &str) -> Vehicle {
    Vehicle::parse("v.toml", text).unwrap_or_else(|findings| panic!("{findings}"))
}

fn as_json(text: &str) -> Json {
    serde_json::to_value(text.parse::<toml::Table>().unwrap()).unwrap()
}

/// Validates against the keywords that the schema uses; an unknown keyword fails, so that nothing passes unread.
fn validate(root: &Json, schema: &Json, value: &Json) -> Result<(), String> {
    let ok = |sound: bool, keyword: &str| {
        if sound { Ok(()) } else { Err(format!("{keyword}: {value} against {schema}")) }
    };
    let many = |schemas: &Json| {
        schemas.as_array().unwrap().iter().filter(|schema| validate(root, schema, value).is_ok()).count()
    };
    let (object, list) = (value.as_object(), value.as_array());
    for (keyword, rule) in schema.as_object().unwrap() {
        match keyword.as_str() {
            "description" | "title" | "default" | "x-unit" | "$schema" | "definitions" => {}
            "$ref" => {
                validate(root, root.pointer(rule.as_str().unwrap().trim_start_matches('#')).unwrap(), value)?;
            }
            "type" => {
                let sound = match rule.as_str().unwrap() {
                    "object" => value.is_object(),
                    "array" => value.is_array(),
                    "string" => value.is_string(),
                    "boolean" => value.is_boolean(),
                    "integer" => value.is_i64() || value.is_u64(),
                    "number" => value.is_number(),
                    other => panic!("type {other}"),
                };
                ok(sound, "type")?;
            }
            "properties" => {
                for (key, value) in object.into_iter().flatten().filter(|(key, _)| rule.get(key).is_some()) {
                    validate(root, &rule[key], value).map_err(|error| format!("{key}: {error}"))?;
                }
            }
            "additionalProperties" => {
                assert_eq!(rule, &json!(false));
                let known = |key: &String| schema["properties"].get(key).is_some();
                ok(object.is_none_or(|object| object.keys().all(known)), keyword)?;
            }
            "required" => {
                let all =
                    rule.as_array().unwrap().iter().all(|key| value.get(key.as_str().unwrap()).is_some());
                ok(object.is_none() || all, keyword)?;
            }
            "additionalItems" => {
                assert_eq!(rule, &json!(false));
                let fixed = schema["items"].as_array().unwrap().len();
                ok(list.is_none_or(|list| list.len() <= fixed), keyword)?;
            }
            "items" if rule.is_array() => {
                let pairs = rule.as_array().unwrap().iter().zip(list.into_iter().flatten());
                pairs.into_iter().try_for_each(|(rule, item)| validate(root, rule, item))?;
            }
            "items" => list.into_iter().flatten().try_for_each(|item| validate(root, rule, item))?,
            "minItems" | "maxItems" | "minLength" | "maxLength" | "minimum" | "maximum"
            | "exclusiveMinimum" => {
                ok(within(keyword, rule.as_f64().unwrap(), value), keyword)?;
            }
            "enum" => ok(rule.as_array().unwrap().contains(value), keyword)?,
            "oneOf" => ok(many(rule) == 1, keyword)?,
            "anyOf" => ok(many(rule) > 0, keyword)?,
            "allOf" => rule.as_array().unwrap().iter().try_for_each(|rule| validate(root, rule, value))?,
            "not" => ok(validate(root, rule, value).is_err(), keyword)?,
            other => panic!("the test does not know the keyword {other}"),
        }
    }
    Ok(())
}

/// Whether a value keeps a limit of JSON Schema; values of other types do.
fn within(keyword: &str, limit: f64, value: &Json) -> bool {
    let quantity = match keyword {
        "minItems" | "maxItems" => value.as_array().map(|list| list.len() as f64),
        "minLength" | "maxLength" => value.as_str().map(|text| text.chars().count() as f64),
        _ => value.as_f64(),
    };
    quantity.is_none_or(|quantity| match keyword {
        "exclusiveMinimum" => quantity > limit,
        keyword if keyword.starts_with("min") => quantity >= limit,
        _ => quantity <= limit,
    })
}

/// Every setting below an object's schema, with the path that a file's tables give it.
fn settings(schema: &Json, path: &str, out: &mut Vec<(String, Option<Json>)>) {
    for (key, schema) in schema["properties"].as_object().unwrap() {
        let path = if path.is_empty() { key.clone() } else { format!("{path}.{key}") };
        if schema.get("properties").is_some() {
            settings(schema, &path, out);
        } else if schema["items"].get("properties").is_some() {
            settings(&schema["items"], &path, out);
        } else {
            out.push((path, schema.get("default").cloned()));
        }
    }
}
