//! The radio file of a fake device.

use std::path::{Path, PathBuf};

use crate::config::file::unwritable;
use crate::desk::simulation::index;
use crate::role::Role;

use super::kind::{Grid, Kind, Options, Table};
use super::protocol::OFF_DB;

/// At which the fake devices were measured.
const FREQUENCY_HZ: f64 = 2.4e9;

/// Where host and device are.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ports {
    /// The companion's end of the host's link.
    pub companion: u16,
    /// The device's server.
    pub device: u16,
}

/// Writes it, with its calibration where its settings are no powers. The device is a new one: no kill holds.
pub(super) fn write(
    directory: &Path,
    role: Role,
    options: &Options,
    table: &Table,
    ports: Ports,
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
    let dead = options.dead_ms.map(|ms| format!("dead_ms = {ms:?}\n")).unwrap_or_default();
    let Grid { least, most, step, .. } = table.grid();
    let text = format!(
        "# The radio of the simulated vehicle {role}.\n[radio]\nsystem_id = {system}\n\
         [link]\naddress = \"udpout:127.0.0.1:{companion}\"\ncommanders = [191]\n\
         [device]\nkind = \"{key}\"\nleast = {least:?}\nmost = {most:?}\nstep = {step:?}\nfrequency_hz = {FREQUENCY_HZ:?}\n\
         off_ms = {off:?}\nchange_ms = {change:?}\n{dead}{calibration}[{key}]\n{how}\n[log]\ndir = {logs}\n",
        system = 1 + index(role),
        companion = ports.companion,
        key = kind.key(),
        off = off_ms + off_beside_ms,
        change = change_ms + change_beside_ms,
        how = how(kind, ports.device)?,
        logs = toml::Value::from(logs.display().to_string()),
    );
    put(directory.join(format!("radio-{name}.toml")), &text)
}

/// The table of the device's kind.
fn how(kind: Kind, port: u16) -> Result<String, String> {
    let address = format!("address = \"tcpout:127.0.0.1:{port}\"\n");
    Ok(match kind {
        Kind::Command => {
            let program = std::env::current_exe()
                .map_err(|error| format!("this program cannot find itself: {error}"))?;
            let program = toml::Value::from(program.display().to_string());
            let call = |words: &str| format!("[{program}, \"radio-device\", \"127.0.0.1:{port}\", {words}]");
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
        Kind::Attenuator => format!("{address}off_db = {OFF_DB:?}"),
        Kind::JsonRpc => {
            let transmit =
                |params: &str| format!(r#"'{{"jsonrpc":"2.0","method":"transmit"{params},"id":"1"}}'"#);
            format!(
                "{address}on = {}\noff = {}\nread_off = {}",
                transmit(r#","params":["1"]"#),
                transmit(r#","params":["0"]"#),
                transmit("")
            )
        }
        Kind::At => address,
    })
}
