//! The schema, the parser and the commented examples say the same.

use super::*;

#[test]
fn spec_every_shipped_file_is_valid_under_the_schema() {
    let schema = schema();
    for (part, text) in [
        ("mission", DEMO),
        ("mission", PAPER),
        ("mission", LEAST),
        ("vehicle", VEHICLE_I),
        ("vehicle", VEHICLE_J),
        ("radio", RADIO),
    ] {
        assert_eq!(validate(&schema, &schema["definitions"][part], &as_json(text)), Ok(()));
        assert_eq!(validate(&schema, &schema, &as_json(text)), Ok(()));
    }
}

#[test]
fn spec_the_schema_refuses_what_the_parser_refuses_of_single_settings() {
    let schema = schema();
    for name in [
        "unknown_key",
        "unknown_table",
        "unknown_key_of_a_node",
        "wrong_type",
        "wrong_type_of_table",
        "no_user_list",
        "empty_user_list",
        "no_mission_table",
        "no_position",
        "emission_incomplete",
        "area_two_corners",
        "area_bad_corner",
        "negative_power",
        "zero_noise",
        "both_positions",
        "both_uncertainties",
        "both_gains",
        "longitude_out_of_range",
        "no_such_method",
        "guard_longer_than_slot",
    ] {
        let path = format!("{}/tests/broken_missions/{name}.toml", env!("CARGO_MANIFEST_DIR"));
        let value = as_json(&std::fs::read_to_string(path).unwrap());
        assert!(validate(&schema, &schema["definitions"]["mission"], &value).is_err(), "{name}");
    }
}

/// What an example file says: every key, also those commented out, and the default its comment gives.
fn documented(text: &str) -> Vec<(String, Option<Json>)> {
    let mut section = String::new();
    let mut out: Vec<(String, Option<Json>)> = Vec::new();
    for line in text.lines() {
        let bare = line.trim_start_matches("# ");
        if let Some(header) = bare.strip_prefix('[').and_then(|rest| rest.split_once(']')) {
            section = header.0.trim_start_matches('[').to_owned();
        } else if let Some((key, _)) = bare.split_once(" = ").filter(|(key, _)| !key.contains(' ')) {
            out.push((format!("{section}.{key}"), None));
        }
        let note = line.split_once("(default ").and_then(|(_, rest)| rest.rsplit_once(')'));
        if let (Some((value, _)), Some((_, default))) = (note, out.last_mut()) {
            *default = as_json(&format!("v = {value}")).get("v").cloned();
        }
    }
    out
}

#[test]
fn spec_the_examples_explain_every_setting_with_its_default() {
    for (schema, text) in
        [(Mission::schema(), DEMO), (Vehicle::schema(), VEHICLE_I), (RadioFile::schema(), RADIO)]
    {
        let mut wanted = Vec::new();
        settings(&schema, "", &mut wanted);
        let given = documented(text);
        let mut origin = serde_json::Map::new();
        for (path, default) in wanted {
            if let Some(key) = path.strip_prefix("mission.origin.") {
                origin.insert(key.to_owned(), default.unwrap());
                continue;
            }
            let explained_at = match path.strip_prefix("eavesdropper.") {
                Some(key @ ("lat_deg" | "lon_deg" | "alt_m")) => format!("user.{key}"),
                Some(key) if key.starts_with("moves.") => format!("user.{key}"),
                _ => path.clone(),
            };
            let found = given.iter().find(|(key, _)| *key == explained_at);
            let (_, told) = found.unwrap_or_else(|| panic!("{path} is not explained"));
            // Vehicle J's keys are those of I, and an eavesdropper's position is given as a user's.
            if !path.starts_with("vehicles.j.") {
                assert_eq!(told, &default, "{path}");
            }
        }
        let told = given.iter().find(|(key, _)| key == "mission.origin").and_then(|(_, told)| told.clone());
        assert_eq!(told.unwrap_or_else(|| json!({})), Json::Object(origin));
    }
}
