//! The radio file of a fake device, and what it needs beside.

use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use crate::config::file::unwritable;
use crate::desk::simulation::index;
use crate::role::Role;

use super::kind::{Grid, Kind, Options, Table};
use super::parameter::{Parameter, parameter};
use super::protocol::{INTERFACE, OFF_DB, SESSION};

/// At which the fake devices were measured.
const FREQUENCY_HZ: f64 = 2.4e9;

/// Where host and device are.
#[derive(Debug, Clone)]
pub(super) struct Places {
    /// The companion's end of the host's link.
    pub companion: u16,
    /// The device, as a radio file has it.
    pub device: String,
}

/// Writes it, with its calibration where its settings are no powers. The device is a new one: no kill holds.
pub(super) fn write(
    directory: &Path,
    role: Role,
    options: &Options,
    table: &Table,
    places: &Places,
) -> Result<PathBuf, String> {
    let (kind, name) = (options.kind, role.key());
    let put = |path: PathBuf, text: &str| {
        std::fs::write(&path, text).map_err(|error| unwritable(&path, &error)).map(|()| path)
    };
    // A host may run in another directory.
    let directory = std::path::absolute(directory).unwrap_or_else(|_| directory.to_path_buf());
    let logs = directory.join(format!("radio-{name}"));
    let kill = logs.join("radio.kill");
    if kill.exists() {
        std::fs::remove_file(&kill).map_err(|error| unwritable(&kill, &error))?;
    }
    let calibration = match kind {
        Kind::Command => String::new(),
        _ => {
            let file = format!("radio-{name}.csv");
            put(directory.join(&file), &table.csv(FREQUENCY_HZ))?;
            format!("[calibration]\nfile = {file:?}\n")
        }
    };
    let model = options.model();
    let [off_ms, change_ms] = [model.off, model.change].map(|time| time.as_secs_f64() * 1e3);
    let [off_beside_ms, change_beside_ms] = kind.beside_ms();
    // Off is the line's alone where there is one: its time, and no answer of the device's.
    let off_ms = match model.line {
        Some(line) => line.holds.as_secs_f64() * 1e3 + LINE_BESIDE_MS,
        None => off_ms + off_beside_ms,
    };
    let line = match model.line {
        Some(line) => format!(
            "[kill_line]\nchip = \"/dev/gpiochip0\"\nline = 17\noff_level = \"low\"\noneshot_ms = {:?}\n",
            line.holds.as_secs_f64() * 1e3
        ),
        None => String::new(),
    };
    let dead = options.dead_ms.map(|ms| format!("dead_ms = {ms:?}\n")).unwrap_or_default();
    let Grid { least, most, step, .. } = table.grid();
    let text = format!(
        "# The radio of the simulated vehicle {role}.\n[radio]\nsystem_id = {system}\n\
         [link]\naddress = \"udpout:127.0.0.1:{companion}\"\ncommanders = [191]\n\
         [device]\nkind = \"{key}\"\nleast = {least:?}\nmost = {most:?}\nstep = {step:?}\nfrequency_hz = {FREQUENCY_HZ:?}\n\
         off_ms = {off:?}\nchange_ms = {change:?}\n{dead}{calibration}[{key}]\n{how}\n{line}[log]\ndir = {logs}\n",
        system = 1 + index(role),
        companion = places.companion,
        key = kind.key(),
        off = off_ms,
        change = change_ms + change_beside_ms,
        how = how(kind, &places.device)?,
        logs = toml::Value::from(logs.display().to_string()),
    );
    put(directory.join(format!("radio-{name}.toml")), &text)
}

/// What a line's own time is declared to be longer.
const LINE_BESIDE_MS: f64 = 5.0;

fn this_program() -> Result<PathBuf, String> {
    std::env::current_exe().map_err(|error| format!("this program cannot find itself: {error}"))
}

/// Where an address's host and port stand alone.
fn bare(address: &str) -> &str {
    address.trim_start_matches("tcpout:")
}

/// The table of the device's kind.
fn how(kind: Kind, device: &str) -> Result<String, String> {
    let address = format!("address = {device:?}\n");
    let ubus = |session: &str, object: &str, method: &str, arguments: &str| {
        format!(
            r#"'{{"jsonrpc":"2.0","id":1,"method":"call","params":["{session}","{object}","{method}",{arguments}]}}'"#
        )
    };
    Ok(match kind {
        Kind::Command => {
            let program = toml::Value::from(this_program()?.display().to_string());
            let call = |words: &str| format!("[{program}, \"radio-device\", \"{}\", {words}]", bare(device));
            format!(
                "set = {}\non = {}\noff = {}\nread = {}\nread_after = \"power\"\nread_before = \"dBm\"\n\
                 read_off = {}\noff_reads = \"off\"",
                call("\"set\", \"{dbm}\""),
                call("\"on\""),
                call("\"off\""),
                call("\"read\""),
                call("\"state\"")
            )
        }
        Kind::Interface => format!("interface = {INTERFACE:?}"),
        Kind::Attenuator | Kind::AttenuatorSerial => format!("{address}off_db = {OFF_DB:?}"),
        Kind::AttenuatorHttp => format!("{address}http = true\noff_db = {OFF_DB:?}"),
        Kind::JsonRpc => {
            let disable = |params: &str| {
                format!(r#"'{{"jsonrpc":"2.0","method":"tx_fifo_disable"{params},"id":"1"}}'"#)
            };
            format!(
                "{address}on = {}\noff = {}\nread_off = {}\noff_reads = \"1\"",
                disable(r#","params":["0"]"#),
                disable(r#","params":["1"]"#),
                disable("")
            )
        }
        Kind::Ubus => {
            let set = r#"{"command":"iw","params":["wlan0","set","txpower","fixed","{mbm}"]}"#;
            let nobody = "0".repeat(SESSION.len());
            let call =
                |object: &str, method: &str, arguments: &str| ubus("{session}", object, method, arguments);
            format!(
                "{address}path = \"/ubus\"\nlogin = {}\nset = {}\nread = {}\nread_at = \"/result/1/txpower\"\non = {}\n\
                 off = {}\nread_off = {}\nread_off_at = \"/result/1/radio0/up\"\noff_reads = \"false\"",
                ubus(&nobody, "session", "login", r#"{"username":"root","password":"fake"}"#),
                call("file", "exec", set),
                call("iwinfo", "info", r#"{"device":"wlan0"}"#),
                call("network.wireless", "up", "{}"),
                call("network.wireless", "down", "{}"),
                call("network.wireless", "status", "{}")
            )
        }
        Kind::At | Kind::AtSerial => address,
        Kind::Parameter | Kind::ParameterBytewise => {
            let Parameter { own, name, protocol } = parameter(kind);
            format!(
                "{address}system_id = {}\ncomponent_id = {}\nname = {name:?}\nprotocol = {protocol:?}",
                own.0, own.1
            )
        }
    })
}

/// Programs named iw and ip, which are found before the machine's own.
///
/// # Errors
/// They cannot be written; in words.
pub(super) fn write_programs(directory: &Path, role: Role, device: &str) -> Result<PathBuf, String> {
    let directory = std::path::absolute(directory).unwrap_or_else(|_| directory.to_path_buf());
    let place = directory.join(format!("radio-{}-bin", role.key()));
    std::fs::create_dir_all(&place).map_err(|error| unwritable(&place, &error))?;
    let program = this_program()?.display().to_string().replace('\'', r"'\''");
    for name in ["iw", "ip"] {
        let path = place.join(name);
        let text = format!("#!/bin/sh\nexec '{program}' radio-device {} {name} \"$@\"\n", bare(device));
        std::fs::write(&path, text).map_err(|error| unwritable(&path, &error))?;
        let executable = std::fs::Permissions::from_mode(0o755);
        std::fs::set_permissions(&path, executable).map_err(|error| unwritable(&path, &error))?;
    }
    Ok(place)
}
