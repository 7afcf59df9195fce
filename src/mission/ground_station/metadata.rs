//! What our parameters are called, mean and may be, for ground stations to show: the files of the component metadata service
//! (<https://mavlink.io/en/services/component_metadata.html>), which MAVLink FTP hands out. They are made of the very table that
//! answers parameter requests.
//!
//! The service has no published form for a component's commands yet (COMP_METADATA_TYPE_COMMANDS), and we have neither actuators
//! nor events: there is one further file beside the one that names it.

use std::sync::OnceLock;

use mavlink::dialects::ardupilotmega::{COMPONENT_METADATA_DATA, MavMessage};
use serde_json::{Value, json};

use crate::mission::ground_station::information::{boot_ms, model};
use crate::mission::ground_station::parameters;
use crate::role::{PerVehicle, Role};
use crate::time::Instant;

const GENERAL: &str = "general.json";
const PARAMETERS: &str = "parameter.json";
/// COMP_METADATA_TYPE_PARAMETER.
const PARAMETER_TYPE: u8 = 1;
/// Of the published forms of the two files (parameter.schema.json: from 3 on with `readOnly`).
const GENERAL_VERSION: u8 = 1;
const PARAMETER_VERSION: u8 = 3;

/// A file that can be read.
#[derive(Debug)]
pub(super) struct File {
    pub name: &'static str,
    pub text: Vec<u8>,
    /// By MAVLink's rule.
    pub crc: u32,
}

impl File {
    fn new(name: &'static str, document: &Value) -> Self {
        let text = document.to_string().into_bytes();
        Self { name, crc: crc(&text), text }
    }

    fn uri(&self) -> String {
        format!("mftp://{}", self.name)
    }
}

/// The CRC-32 of MAVLink's files: zlib's polynomial and bit order, from 0, and the end not inverted.
fn crc(bytes: &[u8]) -> u32 {
    let mut hasher = crc32fast::Hasher::new_with_initial(u32::MAX);
    hasher.update(bytes);
    !hasher.finalize()
}

/// The files of a vehicle's companion, the general one first. The same from its start to its end.
pub(super) fn files(role: Role) -> &'static [File; 2] {
    static FILES: OnceLock<PerVehicle<[File; 2]>> = OnceLock::new();
    &FILES.get_or_init(|| PerVehicle::from_fn(made))[role]
}

fn made(role: Role) -> [File; 2] {
    let parameters = json!({ "version": PARAMETER_VERSION, "parameters": parameters::described() });
    let parameters = File::new(PARAMETERS, &parameters);
    let version =
        [env!("CARGO_PKG_VERSION_MAJOR"), env!("CARGO_PKG_VERSION_MINOR"), env!("CARGO_PKG_VERSION_PATCH")];
    let general = json!({
        "version": GENERAL_VERSION,
        "vendorName": "veilwing",
        "modelName": model(role),
        "firmwareVersion": version.join("."),
        "metadataTypes": [
            { "type": PARAMETER_TYPE, "uri": parameters.uri(), "fileCrc": parameters.crc },
        ],
    });
    [File::new(GENERAL, &general), parameters]
}

/// Where the general file is to be had.
pub(super) fn announced(role: Role, now: Instant) -> MavMessage {
    let [general, _] = files(role);
    MavMessage::COMPONENT_METADATA(COMPONENT_METADATA_DATA {
        time_boot_ms: boot_ms(now),
        file_crc: general.crc,
        uri: general.uri().as_str().into(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spec_the_checksum_is_mavlink_s_variant() {
        // CRC-32 of "123456789" is cbf43926 as zlib has it, 2dfd2d88 from 0 and not inverted.
        assert_eq!(crc(b"123456789"), 0x2dfd_2d88);
        assert_eq!(crc(b""), 0);
    }

    #[test]
    fn spec_the_general_file_names_the_other_one_with_its_checksum() {
        for role in Role::BOTH {
            let [general, parameters] = files(role);
            let document: Value = serde_json::from_slice(&general.text).unwrap();
            assert_eq!(
                document["metadataTypes"],
                json!([{ "type": 1, "uri": "mftp://parameter.json", "fileCrc": crc(&parameters.text) }])
            );
            let MavMessage::COMPONENT_METADATA(told) = announced(role, Instant::ZERO) else {
                panic!("no announcement")
            };
            assert_eq!((told.uri.to_str(), told.file_crc), (Ok("mftp://general.json"), crc(&general.text)));
        }
    }
}
