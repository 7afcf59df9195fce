//! A ground station that has a companion describe its parameters: the files are read by MAVLink FTP, held against the published
//! forms of them that the MAVLink crate brings along, and against the parameters themselves.

use std::path::PathBuf;
use std::process::Command;
use std::time::Duration;

use mavlink::dialects::ardupilotmega::*;
use serde_json::Value;
use veilwing::desk::simulation::index;
use veilwing::role::Role;

use crate::face::{Watched, value};

const DATA: usize = 12;

/// A published form, of the MAVLink revision that the messages are of.
fn schema(name: &str) -> Value {
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--format-version", "1", "--locked", "--manifest-path"])
        .arg(concat!(env!("CARGO_MANIFEST_DIR"), "/Cargo.toml"))
        .output()
        .unwrap();
    let metadata: Value = serde_json::from_slice(&output.stdout).unwrap();
    let packages = metadata["packages"].as_array().unwrap();
    let mavlink = packages.iter().find(|package| package["name"] == "mavlink").unwrap();
    let manifest = PathBuf::from(mavlink["manifest_path"].as_str().unwrap());
    let path = manifest.with_file_name("mavlink").join("component_metadata").join(name);
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

/// Holds a value against a schema, as far as these two schemas go: a keyword that is not known here fails.
fn hold(at: &str, value: &Value, schema: &Value) {
    for (keyword, rule) in schema.as_object().unwrap() {
        match keyword.as_str() {
            "$id" | "$schema" | "description" | "comment" | "default" => {}
            "type" => {
                let right = match rule.as_str().unwrap() {
                    "object" => value.is_object(),
                    "array" => value.is_array(),
                    "string" => value.is_string(),
                    "boolean" => value.is_boolean(),
                    "integer" => value.is_i64() || value.is_u64(),
                    "number" => value.is_number(),
                    other => panic!("{at}: type {other:?} is not known here"),
                };
                assert!(right, "{at}: {value} should be of type {rule}");
            }
            "enum" => assert!(rule.as_array().unwrap().contains(value), "{at}: {value} is none of {rule}"),
            "minimum" => assert!(value.as_f64() >= rule.as_f64(), "{at}: {value} is below {rule}"),
            "pattern" => {
                let text = value.as_str().unwrap();
                let right = match rule.as_str().unwrap() {
                    r"^\d+\.\d+\.\d+(\.\d+)?$" => {
                        let number = |part: &str| part.parse::<u32>().is_ok();
                        [3, 4].contains(&text.split('.').count()) && text.split('.').all(number)
                    }
                    r"^[\.\-a-zA-Z0-9_\{\}]{1,16}$" => {
                        let may = |c: char| c.is_ascii_alphanumeric() || ".-_{}".contains(c);
                        (1..=16).contains(&text.len()) && text.chars().all(may)
                    }
                    other => panic!("{at}: pattern {other:?} is not known here"),
                };
                assert!(right, "{at}: {text:?} does not match {rule}");
            }
            "properties" => {
                for (name, of_it) in rule.as_object().unwrap() {
                    if let Some(property) = value.get(name) {
                        hold(&format!("{at}.{name}"), property, of_it);
                    }
                }
            }
            "items" => {
                for (index, item) in value.as_array().unwrap().iter().enumerate() {
                    hold(&format!("{at}[{index}]"), item, rule);
                }
            }
            "required" => {
                for name in rule.as_array().unwrap() {
                    assert!(value.get(name.as_str().unwrap()).is_some(), "{at}: {name} is missing");
                }
            }
            "additionalProperties" => {
                assert_eq!(rule, false);
                let known = &schema["properties"];
                let unknown = value.as_object().unwrap().keys().find(|key| known.get(key).is_none());
                assert_eq!(unknown, None, "{at}");
            }
            other => panic!("{at}: keyword {other:?} is not known here"),
        }
    }
}

/// The CRC-32 of MAVLink's files, bit by bit.
fn crc(bytes: &[u8]) -> u32 {
    bytes.iter().fold(0, |crc, byte| {
        let step = |crc: u32| (crc >> 1) ^ if crc & 1 == 1 { 0xEDB8_8320 } else { 0 };
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| step(crc))
    })
}

fn request(role: Role, sequence: u16, opcode: MavFtpOpcode, size: usize, data: &[u8]) -> MavMessage {
    let mut payload = [0; 251];
    payload[..2].copy_from_slice(&sequence.to_le_bytes());
    payload[3..5].copy_from_slice(&[opcode as u8, size as u8]);
    payload[DATA..DATA + data.len()].copy_from_slice(data);
    MavMessage::FILE_TRANSFER_PROTOCOL(FILE_TRANSFER_PROTOCOL_DATA {
        target_network: 0,
        target_system: 1 + index(role) as u8,
        target_component: 191,
        payload,
    })
}

fn answers(said: &[MavMessage]) -> Vec<[u8; 251]> {
    let answer = |m: &MavMessage| match m {
        MavMessage::FILE_TRANSFER_PROTOCOL(m) => {
            assert_eq!((m.target_system, m.target_component), (255, 190));
            Some(m.payload)
        }
        _ => None,
    };
    said.iter().filter_map(answer).collect()
}

/// The file, by one burst.
fn fetch(watched: &mut Watched, role: Role, uri: &str) -> Vec<u8> {
    let path = uri.strip_prefix("mftp://").unwrap();
    let open = request(role, 10, MavFtpOpcode::MAV_FTP_OPCODE_OPENFILERO, path.len(), path.as_bytes());
    let opened = answers(&watched.ask(role, &open));
    assert_eq!((opened.len(), opened[0][3]), (1, 128), "{uri}");
    let length = u32::from_le_bytes(opened[0][DATA..DATA + 4].try_into().unwrap()) as usize;
    let burst = request(role, 11, MavFtpOpcode::MAV_FTP_OPCODE_BURSTREADFILE, 239, &[]);
    let mut said = watched.ask(role, &burst);
    let since = watched.station.heard.len();
    watched.pass(Duration::from_secs(5));
    let later = &watched.station.heard[since..];
    said.extend(later.iter().filter(|(_, who, _)| *who == role).map(|(.., m)| m.clone()));
    let mut file = Vec::new();
    for piece in answers(&said) {
        assert_eq!((piece[3], piece[5]), (128, 15));
        assert_eq!(piece[8..DATA], (file.len() as u32).to_le_bytes());
        file.extend_from_slice(&piece[DATA..DATA + usize::from(piece[4])]);
        assert_eq!(piece[6] == 1, file.len() == length);
    }
    assert_eq!(file.len(), length, "{uri}");
    let close = request(role, 12, MavFtpOpcode::MAV_FTP_OPCODE_TERMINATESESSION, 0, &[]);
    assert_eq!(answers(&watched.ask(role, &close))[0][3], 128);
    file
}

#[test]
fn spec_a_station_reads_names_units_and_ranges_as_they_are_published_and_as_they_hold() {
    let mut watched = Watched::new(false);
    watched.pass(Duration::from_secs(15));
    for role in Role::BOTH {
        let said = watched.command(role, MavCmd::MAV_CMD_REQUEST_MESSAGE, 397.0);
        let told = said.iter().find_map(|m| match m {
            MavMessage::COMPONENT_METADATA(m) => Some((m.uri.to_str().unwrap().to_owned(), m.file_crc)),
            _ => None,
        });
        let (uri, file_crc) = told.unwrap();
        let general = fetch(&mut watched, role, &uri);
        assert_eq!(crc(&general), file_crc, "{role}");
        let general: Value = serde_json::from_slice(&general).unwrap();
        hold("general", &general, &schema("general.schema.json"));
        assert_eq!(general["modelName"], format!("companion of vehicle {role}"));

        let [named] = general["metadataTypes"].as_array().unwrap().as_slice() else { panic!("{general}") };
        let parameters = fetch(&mut watched, role, named["uri"].as_str().unwrap());
        assert_eq!(u64::from(crc(&parameters)), named["fileCrc"].as_u64().unwrap(), "{role}");
        let parameters: Value = serde_json::from_slice(&parameters).unwrap();
        hold("parameter", &parameters, &schema("parameter.schema.json"));

        let described = parameters["parameters"].as_array().unwrap();
        for (place, of_it) in described.iter().enumerate() {
            let read = watched.read(role, "", place as i16);
            let (name, before, index, count) = value(&read[0]);
            assert_eq!((of_it["name"].as_str(), usize::from(index)), (Some(name), place));
            assert_eq!((usize::from(count), &of_it["type"]), (described.len(), &Value::from("Float")));
            if of_it["readOnly"] == true {
                let stays = watched.write(role, name, before + 1.0);
                assert_eq!(value(&stays[0]).1, before, "{name}");
                let words = of_it.get("values").and_then(Value::as_array);
                let among = words.is_none_or(|all| all.iter().any(|one| one["value"] == f64::from(before)));
                assert!(among, "{name}: {before} is none of its values");
                continue;
            }
            // What it says of its range is what is taken, and not a step more.
            let number = |key: &str| of_it[key].as_f64().unwrap() as f32;
            assert_eq!(before, number("default"), "{name}");
            for (set, becomes) in [
                (number("min"), number("min")),
                (number("max"), number("max")),
                (number("max") + number("increment"), number("max")),
                (number("min") - number("increment"), number("max")),
                (number("default"), number("default")),
            ] {
                assert_eq!(value(&watched.write(role, name, set)[0]).1, becomes, "{name} set to {set}");
            }
        }
    }
}

#[test]
fn spec_a_file_is_for_who_asks_this_companion_and_holds_up_no_setpoint() {
    let mut watched = Watched::new(true);
    watched.until(|w| w.flight.radiating() == [true, true]);
    // To all, to another component: not ours to answer.
    for (target_system, target_component) in [(0, 0), (1, 0), (0, 191), (1, 1), (2, 191)] {
        let MavMessage::FILE_TRANSFER_PROTOCOL(mut m) =
            request(Role::I, 1, MavFtpOpcode::MAV_FTP_OPCODE_LISTDIRECTORY, 1, b"/")
        else {
            panic!("no request");
        };
        (m.target_system, m.target_component) = (target_system, target_component);
        let said = watched.ask(Role::I, &MavMessage::FILE_TRANSFER_PROTOCOL(m));
        assert_eq!(answers(&said).len(), 0, "{target_system} {target_component}");
    }
    // In a slot, on the air: read again and again, and the flight goes on as it would.
    for _ in 0..3 {
        assert!(!fetch(&mut watched, Role::I, "mftp://parameter.json").is_empty());
    }
    watched.until(|w| Role::BOTH.iter().all(|role| w.flight.outcomes[*role].is_some()));
    assert_eq!(watched.flight.world.report().violations, vec![]);
    assert!(
        Role::BOTH
            .iter()
            .all(|role| { watched.flight.outcomes[*role] == Some(veilwing::mission::Outcome::Completed) })
    );
}
