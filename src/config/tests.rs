//! Whole files: defaults, digest, schema and examples.

use crate::autopilot::{Actuation, FirmwareChoice};
use crate::schedule::order::Order;
use std::collections::BTreeSet;

use proptest::prelude::*;
use serde_json::{Value as Json, json};

use super::*;
use crate::geo::{Enu, Geodetic};
use crate::planner::problem::*;
use crate::role::{PerVehicle, Role};

const DEMO: &str = include_str!("../../config/mission.toml");
const PAPER: &str = include_str!("../../config/paper.toml");
const VEHICLE_I: &str = include_str!("../../config/vehicle-i.toml");
const VEHICLE_J: &str = include_str!("../../config/vehicle-j.toml");
const LEAST: &str = "[mission]\n[[user]]\nenu_m = [0, 0, 0]\n[[eavesdropper]]\nenu_m = [120, -40, 0]\n";
const ORIGIN: &str = "origin = { lat_deg = 50.0, lon_deg = 14.0, alt_amsl_m = 200.0 }\n";

fn mission(text: &str) -> Mission {
    Mission::parse("m.toml", text).unwrap_or_else(|findings| panic!("{findings}"))
}

fn vehicle(text: &str) -> Vehicle {
    Vehicle::parse("v.toml", text).unwrap_or_else(|findings| panic!("{findings}"))
}

fn as_json(text: &str) -> Json {
    serde_json::to_value(text.parse::<toml::Table>().unwrap()).unwrap()
}

#[test]
fn val_defaults_are_those_of_the_interface() {
    let least = mission(LEAST);
    assert_eq!((least.name.as_str(), least.seed), ("mission", 7));
    assert_eq!(least.origin, Geodetic { lat_deg: 50.0755, lon_deg: 14.4378, alt_m: 200.0 });
    assert_eq!((least.emission.as_ref(), least.carrier_hz), (None, None));
    let radio = Radio {
        bandwidth_hz: 1e6,
        noise_power_w: 1e-12,
        max_power_w: PerVehicle { i: 0.5, j: 0.5 },
        reference_gain: 1.0,
    };
    assert_eq!(least.radio, radio);
    assert_eq!(least.airspace.altitude_m, [80.0, 300.0]);
    let corners: Vec<[f64; 2]> =
        least.airspace.area_enu_m.iter().map(|corner| [corner.x, corner.y]).collect();
    assert_eq!(corners, [[-500.0, -500.0], [500.0, -500.0], [500.0, 500.0], [-500.0, 500.0]]);
    assert_eq!(least.airspace.min_separation_m, 5.0);
    assert_eq!(least.airspace_max_tilt_rad.to_degrees(), 90.0);
    let vehicle = VehicleSettings {
        airframe: Airframe::Omnidirectional,
        max_tilt_rad: 90f64.to_radians(),
        speed_m_s: 8.0,
        climb_m_s: 3.0,
        acceleration_m_s2: 2.5,
        tilt_rate_rad_s: 45f64.to_radians(),
        home_enu_m: None,
    };
    assert_eq!(least.vehicles, PerVehicle { i: vehicle, j: vehicle });
    let std_rad = 2f64.to_radians();
    assert_eq!(least.jitter, Jitter { std_rad, model: JitterModel::Euler, axes: JitterAxes::RollPitch });
    assert_eq!(
        least.tdma,
        Tdma {
            slot_s: 20.0,
            guard_s: 1.0,
            settle_s: 3.0,
            order: Order::Listed,
            superframes: 1,
            start_utc: None
        }
    );
    let planner = PlannerSettings { method: Method::Veilwing, objective: Objective::Mean, free_yaw: false };
    assert_eq!(least.planner, planner);
    assert_eq!(
        (least.users[0].name.as_str(), least.eavesdroppers[0].name.as_str()),
        ("user-1", "eavesdropper-1")
    );
    assert_eq!(least.eavesdroppers[0].node.uncertainty, Uncertainty::None);
    assert!(least.warnings.is_empty());
}

#[test]
fn val_vehicle_defaults_are_those_of_the_interface() {
    let least = vehicle("vehicle.role = \"j\"\npair.link = \"udpout:10.0.0.1:14600\"\n");
    assert_eq!((least.role, least.key_file.as_ref()), (Role::J, None));
    assert_eq!(least.autopilot.link.to_string(), "udpin:0.0.0.0:14540");
    assert_eq!(
        (least.autopilot.firmware, least.autopilot.actuation),
        (FirmwareChoice::Auto, Actuation::Pose)
    );
    assert_eq!((least.autopilot.system_id, least.autopilot.component_id), (None, 191));
    assert_eq!(least.autopilot.rate_hz, 50.0);
    let leased = Transmitter {
        kind: TransmitterKind::Leased,
        simulated: true,
        component_id: 68,
        command: 31010,
        parameter: None,
    };
    assert_eq!(least.transmitter, leased);
    assert_eq!(least.limits, Limits::default());
    assert_eq!((least.pair_peer_system, least.pair_tunnel), (None, false));
}

#[test]
fn val_a_start_is_one_instant_however_it_is_written() {
    let start = |text: &str| mission(&format!("{LEAST}[tdma]\nstart_utc = {text}\n"));
    let utc = start("2026-11-21T18:00:00Z");
    assert_eq!(utc.tdma.start_utc.map(|utc| utc.unix_us), Some(1_795_284_000_000_000));
    for same in ["2026-11-21 18:00:00Z", "2026-11-21T19:30:00+01:30", "2026-11-21T10:00:00.000-08:00"] {
        assert_eq!(start(same).tdma.start_utc, utc.tdma.start_utc, "{same}");
        assert_eq!(start(same).digest(), utc.digest(), "{same}");
    }
    assert_ne!(start("2026-11-21T18:00:00.000001Z").digest(), utc.digest());
    assert_ne!(mission(LEAST).digest(), utc.digest());
    for (wrong, fragment) in [
        ("2026-11-21T18:00:00", "offset from UTC open"),
        ("2026-11-21", "offset from UTC open"),
        ("\"2026-11-21T18:00:00Z\"", "without quotes"),
        ("1969-12-31T23:59:59Z", "before 1970"),
        ("1795284000", "without quotes"),
    ] {
        let text = format!("{LEAST}[tdma]\nstart_utc = {wrong}\n");
        let findings = Mission::parse("m.toml", &text).unwrap_err().to_string();
        assert!(findings.contains(fragment) && findings.contains("start_utc"), "{findings}");
    }
}

#[test]
fn val_a_tunnel_must_say_whom_it_leads_to() {
    let text = |more: &str| {
        format!(
            "vehicle.role = \"i\"\nautopilot.system_id = 1\n[pair]\nlink = \"udpout:10.0.0.1:14600\"\n{more}"
        )
    };
    let tunnel = vehicle(&text("tunnel = true\npeer_system_id = 2\n"));
    assert_eq!((tunnel.pair_peer_system, tunnel.pair_tunnel), (Some(2), true));
    for (more, line, fragment) in [
        ("tunnel = true\n", 5, "whom TUNNEL is addressed to"),
        ("tunnel = \"yes\"\n", 5, "true or false"),
        ("peer_system_id = 1\n", 5, "this vehicle's own system_id"),
        ("peer_system_id = 0\n", 5, "outside 1 to 255"),
    ] {
        let findings = Vehicle::parse("v.toml", &text(more)).unwrap_err().to_string();
        assert!(findings.contains(fragment) && findings.contains(&format!("v.toml:{line}:")), "{findings}");
    }
}

#[test]
fn val_the_demo_is_what_the_interface_promises() {
    let demo = mission(DEMO);
    assert!(demo.users.len() >= 2 && demo.eavesdroppers.len() >= 3, "two users and three eavesdroppers");
    assert!((demo.jitter.std_rad.to_degrees() - 2.0).abs() < 1e-12);
    assert!(demo.warnings.is_empty() && demo.emission.is_none());
    for file in [VEHICLE_I, VEHICLE_J] {
        assert!(vehicle(file).check_against(&demo).is_empty());
    }
}

#[test]
fn val_the_paper_mission_is_reference_scenario_0() {
    let problem = mission(PAPER).problem(0).unwrap();
    assert_eq!(problem.user_enu_m, Enu::zeros());
    let nodes: Vec<_> = problem.eavesdroppers.iter().map(|node| node.position_enu_m).collect();
    let s1 = Enu::new(21.385_737_975_062_74, 103.841_847_006_329_54, 0.0);
    let s2 = Enu::new(-29.058_202_677_746_067, -296.752_057_455_321_16, 0.0);
    assert_eq!(nodes, [s1, s2]);
    assert_eq!((problem.airspace.altitude_m, problem.jitter.std_rad), ([80.0, 300.0], 0.0));
    assert_eq!((problem.radio.noise_power_w, problem.radio.reference_gain), (1e-12, 1.0));
}

#[test]
fn val_a_problem_has_the_strictest_power_and_tilt() {
    let text = LEAST.replacen("[mission]\n", &format!("[mission]\n{ORIGIN}"), 1)
        + "[emission]\nauthorised_by = \"me\"\nband_hz = [2.4e9, 2.41e9]\nmax_power_w = 0.3\n\
           [radio]\nmax_power_w = { i = 0.5, j = 0.2 }\n[airspace]\nmax_tilt_deg = 60\n\
           [vehicles]\ni = { max_tilt_deg = 45 }\nj = { airframe = \"conventional\" }\n";
    let mission = mission(&text);
    let problem = mission.problem(0).unwrap();
    assert_eq!(problem.radio.max_power_w, PerVehicle { i: 0.3, j: 0.2 });
    assert_eq!(mission.power_ceiling(Role::I).1, PowerLimit::Emission);
    assert_eq!(mission.power_ceiling(Role::J).1, PowerLimit::Radio);
    let tilts = problem.vehicles.map(|vehicle| vehicle.max_tilt_rad.to_degrees());
    assert!((tilts.i - 45.0).abs() < 1e-12 && (tilts.j - 60.0).abs() < 1e-12);
    assert_eq!(problem.vehicles.j.airframe, Airframe::Conventional);
    assert_eq!(mission.problem(1), None);
}

#[test]
fn val_the_reference_gain_of_a_carrier_is_free_space_loss_at_one_metre() {
    // Free-space path loss: 20 log10(f) - 147.55 dB at one metre.
    let radio =
        mission(&format!("{LEAST}[radio]\ncarrier_hz = 2.4e9\ntx_gain_dbi = 1.76\nrx_gain_dbi = -3.0\n"))
            .radio;
    let loss_db = 20.0 * 2.4e9f64.log10() - 147.552;
    assert!((10.0 * radio.reference_gain.log10() - (1.76 - 3.0 - loss_db)).abs() < 1e-3);
}

#[test]
fn val_a_geodetic_position_is_the_same_place() {
    let origin = Geodetic { lat_deg: 50.0, lon_deg: 14.0, alt_m: 200.0 };
    let there = Geodetic::from_enu(Enu::new(120.0, -40.0, 3.0), origin);
    let (lat, lon, alt) = (there.lat_deg, there.lon_deg, there.alt_m - 200.0);
    let text = LEAST.replacen("[mission]\n", &format!("[mission]\n{ORIGIN}"), 1).replace(
        "enu_m = [120, -40, 0]",
        &format!("lat_deg = {lat}\nlon_deg = {lon}\nalt_m = {alt}\nstd_m = 4"),
    );
    let node = mission(&text).eavesdroppers[0].node;
    assert!((node.position_enu_m - Enu::new(120.0, -40.0, 3.0)).norm() < 1e-6);
    assert_eq!(node.uncertainty, Uncertainty::Gaussian { std_m: 4.0 });
}

#[test]
fn val_the_digest_sees_the_meaning_and_not_the_writing() {
    let demo = mission(DEMO);
    let rewritten = DEMO.parse::<toml::Table>().unwrap().to_string();
    assert!(!rewritten.contains('#'));
    assert_eq!(mission(&rewritten).digest(), demo.digest());
    let spelt_out = DEMO.replace("max_power_w = 0.5 ", "max_power_w = { j = 0.5, i = 5e-1 } ");
    assert_ne!(spelt_out, DEMO);
    assert_eq!(mission(&spelt_out).digest(), demo.digest());
    assert_eq!(mission(&format!("{LEAST}[tdma]\nguard_s = 1\n")).digest(), mission(LEAST).digest());
    assert_eq!(demo.digest_hex().len(), 64);
    assert!(demo.differences(&mission(&rewritten)).is_empty());
}

/// Paths to every value of a document that is no table.
fn leaves(value: &toml::Value, path: &mut Vec<String>, out: &mut Vec<Vec<String>>) {
    let nested: Vec<(String, &toml::Value)> = match value {
        toml::Value::Table(table) => table.iter().map(|(key, value)| (key.clone(), value)).collect(),
        toml::Value::Array(items) => {
            items.iter().enumerate().map(|(i, value)| (i.to_string(), value)).collect()
        }
        _ => return out.push(path.clone()),
    };
    for (key, value) in nested {
        path.push(key);
        leaves(value, path, out);
        path.pop();
    }
}

fn leaf<'v>(value: &'v mut toml::Value, path: &[String]) -> &'v mut toml::Value {
    path.iter().fold(value, |value, key| match value {
        toml::Value::Array(items) => &mut items[key.parse::<usize>().unwrap()],
        other => &mut other[key.as_str()],
    })
}

#[test]
fn val_the_digest_changes_with_every_single_value() {
    let demo = mission(DEMO);
    let document = toml::Value::Table(DEMO.parse().unwrap());
    let mut paths = Vec::new();
    leaves(&document, &mut Vec::new(), &mut paths);
    assert!(paths.len() > 50, "{} values", paths.len());
    let words = ["other", "conventional", "body", "roll-pitch-yaw", "shortest", "paper", "nominal"];
    for path in paths {
        let changes: Vec<toml::Value> = match leaf(&mut document.clone(), &path) {
            toml::Value::Float(x) => [*x * 0.99, *x - 1.0, *x + 1.0].map(toml::Value::Float).into(),
            toml::Value::Integer(x) => vec![toml::Value::Integer(*x + 1)],
            toml::Value::Boolean(flag) => vec![toml::Value::Boolean(!*flag)],
            _ => words.map(|word| toml::Value::String(word.to_owned())).into(),
        };
        let changed = changes.into_iter().find_map(|change| {
            let mut document = document.clone();
            let before = std::mem::replace(leaf(&mut document, &path), change.clone());
            let mission = Mission::parse("m.toml", &toml::to_string(&document).unwrap()).ok();
            mission.filter(|_| before != change)
        });
        let changed = changed.unwrap_or_else(|| panic!("no change of {path:?} is accepted"));
        assert_ne!(changed.digest(), demo.digest(), "{path:?}");
        assert_eq!(demo.differences(&changed).len(), 1, "{path:?}: {:?}", demo.differences(&changed));
    }
}

#[test]
fn val_differences_name_what_only_one_side_has() {
    let more = mission(&format!("{LEAST}[radio]\ncarrier_hz = 2.4e9\n"));
    let difference = Difference {
        key: "radio.carrier_hz".to_owned(),
        ours: None,
        theirs: Some("2400000000.0".to_owned()),
    };
    assert_eq!(mission(LEAST).differences(&more), std::slice::from_ref(&difference));
    let swapped = Difference { ours: difference.theirs, theirs: difference.ours, ..difference };
    assert_eq!(more.differences(&mission(LEAST)), [swapped]);
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
            "description" | "title" | "default" | "x-unit" | "$schema" | "$defs" => {}
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
            "items" if rule == &json!(false) => {
                let fixed = schema["prefixItems"].as_array().unwrap().len();
                ok(list.is_none_or(|list| list.len() <= fixed), keyword)?;
            }
            "items" => list.into_iter().flatten().try_for_each(|item| validate(root, rule, item))?,
            "prefixItems" => {
                let pairs = rule.as_array().unwrap().iter().zip(list.into_iter().flatten());
                pairs.into_iter().try_for_each(|(rule, item)| validate(root, rule, item))?;
            }
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

#[test]
fn val_every_shipped_file_is_valid_under_the_schema() {
    let schema = schema();
    for (part, text) in [
        ("mission", DEMO),
        ("mission", PAPER),
        ("mission", LEAST),
        ("vehicle", VEHICLE_I),
        ("vehicle", VEHICLE_J),
    ] {
        assert_eq!(validate(&schema, &schema["$defs"][part], &as_json(text)), Ok(()));
        assert_eq!(validate(&schema, &schema, &as_json(text)), Ok(()));
    }
}

#[test]
fn val_the_schema_refuses_what_the_parser_refuses_of_single_settings() {
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
        assert!(validate(&schema, &schema["$defs"]["mission"], &value).is_err(), "{name}");
    }
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
fn val_the_examples_explain_every_setting_with_its_default() {
    for (schema, text) in [(Mission::schema(), DEMO), (Vehicle::schema(), VEHICLE_I)] {
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

#[test]
fn val_a_real_transmitter_needs_the_mission_to_allow_it() {
    let real = vehicle(&VEHICLE_I.replace("simulated = true ", "simulated = false"));
    let findings = real.check_against(&mission(DEMO));
    assert!(findings.has_errors());
    assert!(findings.list()[0].message.contains("no [emission] table"), "{findings}");
    let permitted =
        format!("{DEMO}[emission]\nauthorised_by = \"me\"\nband_hz = [2.4e9, 2.41e9]\nmax_power_w = 0.5\n");
    assert!(real.check_against(&mission(&permitted)).is_empty());
}

#[test]
fn val_a_vehicle_may_not_be_slower_than_planned() {
    let slow = VEHICLE_I
        .replace("speed_m_s = 10.0", "speed_m_s = 7.9")
        .replace("climb_m_s = 5.0", "climb_m_s = 3.9")
        .replace("tilt_rate_deg_s = 90.0", "tilt_rate_deg_s = 44.0")
        .replace("max_tilt_deg = 90.0", "max_tilt_deg = 45.0")
        .replace("max_power_w = 0.5", "max_power_w = 0.1");
    let findings = vehicle(&slow).check_against(&mission(DEMO));
    let severities: Vec<Severity> = findings.list().iter().map(|finding| finding.severity).collect();
    use Severity::{Error, Warning};
    assert_eq!(severities, [Error, Error, Error, Warning, Warning], "{findings}");
    assert!(
        findings.list()[0].message.contains("7.9 m/s")
            && findings.list()[0].help.contains("vehicles.i.speed_m_s")
    );
}

#[test]
fn val_a_parameter_transmitter_must_say_how_it_is_silenced() {
    for (without, fragment) in
        [("off_value = 0.0\n", "silence"), ("name = \"TX_POWER\"\n", "no `name`"), ("simulated = true\n", "")]
    {
        let text = VEHICLE_J.replace(without, "");
        assert_ne!(text, VEHICLE_J);
        match Vehicle::parse("v.toml", &text) {
            Ok(_) => assert_eq!(fragment, ""),
            Err(findings) => {
                assert!(!fragment.is_empty() && findings.to_string().contains(fragment), "{findings}")
            }
        }
    }
    let powers: Vec<f64> =
        vehicle(VEHICLE_J).transmitter.parameter.unwrap().levels.iter().map(|level| level.power_w).collect();
    assert_eq!(powers, [0.01, 0.1, 0.5]);
}

#[test]
fn val_broken_vehicle_files_say_what_is_wrong() {
    // With each: what is pointed at, and at which column of its line.
    for (from, to, at, column, fragment) in [
        ("role = \"i\"", "role = \"k\"", "role", 8, "none of its values"),
        ("role = \"i\"", "", "[vehicle]", 1, "has no `role`"),
        (
            "link = \"udpout:192.168.40.2:14600\"",
            "link = \"udpout:192.168.40.2\"",
            "link = \"udpout",
            8,
            "there is no port",
        ),
        ("rate_hz = 50.0", "rate_hz = 20.0", "rate_hz", 11, "too slow"),
        ("component_id = 191", "component_id = 300", "component_id = 300", 16, "is 300, outside 1 to 255"),
        ("[limits]", "[limit]", "[limit]", 2, "unknown key `limit`"),
    ] {
        let text = VEHICLE_I.replace(from, to);
        assert_ne!(text, VEHICLE_I);
        let findings = Vehicle::parse("v.toml", &text).unwrap_err();
        let [finding] = findings.list() else { panic!("{findings}") };
        assert_eq!((finding.line, finding.column), (line_of(&text, at), column), "{findings}");
        assert!(finding.message.contains(fragment), "{findings}");
    }
}

/// The number of the first line that begins with this.
fn line_of(text: &str, start: &str) -> usize {
    1 + text.lines().position(|line| line.starts_with(start)).unwrap()
}

#[cfg(unix)]
#[test]
fn val_a_key_file_open_to_others_is_refused() {
    use std::os::unix::fs::PermissionsExt;
    let dir = std::env::temp_dir().join(format!("veilwing-key-{}", std::process::id()));
    std::fs::create_dir_all(&dir).unwrap();
    let (file, key) = (dir.join("v.toml"), dir.join("pair.key"));
    std::fs::write(&file, VEHICLE_I.replace("# key_file", "key_file")).unwrap();
    let missing = Vehicle::load(&file).unwrap_err().to_string();
    std::fs::write(&key, [7; 32]).unwrap();
    let mode = |mode| std::fs::set_permissions(&key, std::fs::Permissions::from_mode(mode)).unwrap();
    mode(0o640);
    let open = Vehicle::load(&file).unwrap_err().to_string();
    mode(0o600);
    let sound = Vehicle::load(&file).unwrap();
    std::fs::remove_dir_all(&dir).unwrap();
    let at = format!(":{}:12: ", line_of(VEHICLE_I, "# key_file"));
    assert!(missing.contains(&at) && missing.contains("cannot be read"), "{missing}");
    assert!(open.contains("its mode is 640") && open.contains("chmod 600"), "{open}");
    assert_eq!(sound.key_file, Some(key));
}

#[test]
fn val_garbage_of_the_largest_size_is_told_in_bounded_space() {
    for piece in ["=\n", "[[user]]\n", "[ 1 ", "a.", "\"", "x=[[", "user=1\n"] {
        let findings = Mission::parse("m.toml", &piece.repeat((1 << 20) / piece.len())).unwrap_err();
        assert!(findings.has_errors() && findings.list().len() <= 1000);
        assert!(findings.to_string().len() < 1 << 20);
    }
}

fn mutated() -> impl Strategy<Value = String> {
    let edit = (
        0..5usize,
        any::<prop::sample::Index>(),
        any::<prop::sample::Index>(),
        "[\\PC\\n\\[\\]{}=\"'.,#0-9e-]{0,6}",
    );
    (prop::sample::select(vec![DEMO, VEHICLE_I, VEHICLE_J]), prop::collection::vec(edit, 1..8)).prop_map(
        |(text, edits)| {
            let mut chars: Vec<char> = text.chars().collect();
            for (kind, a, b, insert) in edits {
                if chars.is_empty() {
                    break;
                }
                let (a, b) = (a.index(chars.len()), b.index(chars.len()));
                let (low, high) = (a.min(b), a.max(b).min(a.min(b) + 200));
                match kind {
                    0 => chars.truncate(a.max(1)),
                    1 => drop(chars.splice(a..a, insert.chars())),
                    2 => drop(chars.splice(low..high, insert.chars())),
                    3 => {
                        let copy: Vec<char> = chars[low..high].to_vec();
                        drop(chars.splice(b..b, copy));
                    }
                    _ => chars.swap(a, b),
                }
            }
            chars.into_iter().collect()
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(600))]

    #[test]
    fn prop_no_text_makes_the_parser_panic_or_err_without_a_place(text in mutated()) {
        let lines = text.lines().count() + 1;
        for findings in [Mission::parse("m", &text).map(|m| m.warnings), Vehicle::parse("v", &text).map(|v| v.warnings)] {
            match findings {
                Ok(warnings) => prop_assert!(!warnings.has_errors()),
                Err(findings) => {
                    prop_assert!(findings.has_errors() && !findings.to_string().is_empty());
                    for finding in findings.list() {
                        prop_assert!((1..=lines).contains(&finding.line) && finding.column >= 1);
                        prop_assert!(!finding.message.is_empty() && !finding.help.is_empty());
                    }
                }
            }
        }
    }

    #[test]
    fn prop_what_the_parser_accepts_the_schema_accepts(text in mutated()) {
        if Mission::parse("m", &text).is_ok() {
            let schema = schema();
            prop_assert_eq!(validate(&schema, &schema["$defs"]["mission"], &as_json(&text)), Ok(()));
        }
    }
}

#[test]
fn val_all_settings_of_the_interface_are_there() {
    let mut found = Vec::new();
    settings(&Mission::schema(), "", &mut found);
    let found: BTreeSet<String> = found.into_iter().map(|(path, _)| path).collect();
    for path in [
        "mission.name",
        "mission.seed",
        "mission.origin.lat_deg",
        "mission.origin.lon_deg",
        "mission.origin.alt_amsl_m",
        "emission.authorised_by",
        "emission.band_hz",
        "emission.max_power_w",
        "radio.bandwidth_hz",
        "radio.noise_power_w",
        "radio.max_power_w",
        "radio.reference_gain",
        "radio.carrier_hz",
        "airspace.altitude_m",
        "airspace.area_enu_m",
        "airspace.min_separation_m",
        "airspace.max_tilt_deg",
        "vehicles.i.airframe",
        "vehicles.j.max_tilt_deg",
        "jitter.std_deg",
        "jitter.model",
        "jitter.axes",
        "tdma.slot_s",
        "tdma.guard_s",
        "tdma.order",
        "tdma.superframes",
        "user.name",
        "user.enu_m",
        "user.lat_deg",
        "user.lon_deg",
        "user.alt_m",
        "eavesdropper.name",
        "eavesdropper.enu_m",
        "eavesdropper.radius_m",
        "eavesdropper.std_m",
        "planner.method",
        "planner.objective",
    ] {
        assert!(found.contains(path), "{path}");
    }
}
