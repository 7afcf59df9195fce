//! The vehicle file: one per vehicle, what its companion must know of its own hardware.

use std::path::{Path, PathBuf};

use serde_json::Value as Json;

use super::diagnostic::{Diagnostics, Severity};
use super::document::Document;
use super::file::{MAX_BYTES, read_text};
use super::mission::Mission;
use super::mission_checks::{ORIGIN, ORIGIN_HELP};
use super::vehicle_file;
use crate::autopilot::{Actuation, FirmwareChoice};
use crate::link::LinkAddress;
use crate::role::Role;
use crate::transmitter::{Level, Protocol};

/// A validated vehicle file. SI units, angles in radians.
#[derive(Debug, Clone)]
pub struct Vehicle {
    /// Which vehicle of the pair this is.
    pub role: Role,
    /// The flight controller.
    pub autopilot: Autopilot,
    /// The payload radio.
    pub transmitter: Transmitter,
    /// Link to the other companion.
    pub pair_link: LinkAddress,
    /// The signing key of the pair link, if it is signed; relative paths are made relative to the vehicle file.
    pub key_file: Option<PathBuf>,
    /// MAVLink system of the other companion; `None`: any.
    pub pair_peer_system: Option<u8>,
    /// Pair messages ride in TUNNEL. Then the peer's system is known.
    pub pair_tunnel: bool,
    /// What the vehicle may be asked for.
    pub limits: Limits,
    /// Directory for logs.
    pub log_dir: PathBuf,
    /// What the operator should know although the file can be used. No errors.
    pub warnings: Diagnostics,
    document: Document,
}

/// The flight controller and how it is commanded.
#[derive(Debug, Clone, PartialEq)]
pub struct Autopilot {
    /// Where it is.
    pub link: LinkAddress,
    /// What it runs.
    pub firmware: FirmwareChoice,
    /// Which targets it is given.
    pub actuation: Actuation,
    /// Its MAVLink system; `None`: the first that is heard.
    pub system_id: Option<u8>,
    /// The companion's own MAVLink component.
    pub component_id: u8,
    /// Setpoints and state per second.
    pub rate_hz: f64,
    /// Newtons per unit of thrust along body x, y, z, for [`Actuation::ThrustVector`]; `None`: from the autopilot.
    pub thrust_n: Option<[f64; 3]>,
}

/// The payload radio.
#[derive(Debug, Clone, PartialEq)]
pub struct Transmitter {
    /// How its power is set.
    pub kind: TransmitterKind,
    /// It radiates nothing real.
    pub simulated: bool,
    /// Its MAVLink component.
    pub component_id: u8,
    /// The MAV_CMD that sets the power of a leased transmitter.
    pub command: u16,
    /// The form of that command.
    pub form: CommandForm,
    /// What a command of the first form that comes late does is accepted, so that something real may be radiated by it.
    pub accept_late_commands: bool,
    /// The parameter that sets the power; always there for [`TransmitterKind::Parameter`].
    pub parameter: Option<PowerParameter>,
}

/// How a radio's power is set.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TransmitterKind {
    /// By commands that expire.
    Leased,
    /// By a parameter, which does not expire.
    Parameter,
    /// There is no radio.
    None,
}

/// The form of a leased transmitter's power command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CommandForm {
    /// Its expiry counts from its receipt: one that comes late lasts too long.
    FromReceipt,
    /// Numbered, its expiry an instant of the radio's clock.
    Numbered,
}

/// A parameter that sets a radio's power.
#[derive(Debug, Clone, PartialEq)]
pub struct PowerParameter {
    /// Its name, 1 to 16 characters.
    pub name: String,
    /// How it is set.
    pub protocol: Protocol,
    /// What its value means.
    pub unit: PowerUnit,
    /// The value that silences the radio.
    pub off_value: f64,
    /// The values and what they give, for [`PowerUnit::Levels`]; by rising power.
    pub levels: Vec<Level>,
}

/// What the value of a power parameter means.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PowerUnit {
    /// Watts.
    Watt,
    /// Milliwatts.
    Milliwatt,
    /// dB relative to one milliwatt.
    Dbm,
    /// An entry of a table.
    Levels,
}

/// What a vehicle may be asked for; `None` where the mission's word is enough.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Limits {
    /// Horizontal speed in m/s.
    pub speed_m_s: Option<f64>,
    /// Vertical speed in m/s.
    pub climb_m_s: Option<f64>,
    /// Turning rate of the antenna in rad/s.
    pub tilt_rate_rad_s: Option<f64>,
    /// Tilt from level in radians.
    pub max_tilt_rad: Option<f64>,
    /// Transmit power in W.
    pub max_power_w: Option<f64>,
}

/// A vehicle file as read, before anything is known to be right.
pub(super) struct Draft {
    pub(super) role: Option<Role>,
    pub(super) autopilot: Autopilot,
    pub(super) transmitter: Transmitter,
    pub(super) pair: PairLink,
    pub(super) limits: Limits,
    pub(super) log_dir: PathBuf,
}

/// The `[pair]` table.
pub(super) struct PairLink {
    pub(super) link: Option<LinkAddress>,
    pub(super) key_file: Option<PathBuf>,
    pub(super) peer_system_id: Option<u8>,
    pub(super) tunnel: bool,
}

impl Vehicle {
    /// Reads and validates a vehicle file, and the mode of the key file it names.
    ///
    /// # Errors
    /// Everything that is wrong with the file, each with its place and remedy.
    pub fn load(path: &Path) -> Result<Self, Diagnostics> {
        let mut vehicle = Self::parse(&path.display().to_string(), &read_text(path, MAX_BYTES)?)?;
        if let Some(key_file) = vehicle.key_file.take() {
            let key_file = path.parent().unwrap_or(Path::new("")).join(key_file);
            if let Some((message, help)) = key_file_fault(&key_file) {
                return Err(vehicle.error_at("pair.key_file", message, help));
            }
            vehicle.key_file = Some(key_file);
        }
        Ok(vehicle)
    }

    /// Validates the text of a vehicle file; `file_name` is used in messages only, and no other file is looked at.
    ///
    /// # Errors
    /// Everything that is wrong with the text, each with its place and remedy.
    pub fn parse(file_name: &str, text: &str) -> Result<Self, Diagnostics> {
        let (draft, document, findings) = Document::read(file_name, text, vehicle_file::describe, check);
        let findings = findings.into_result()?;
        let Draft {
            role: Some(role),
            autopilot,
            mut transmitter,
            pair: PairLink { link: Some(pair_link), key_file, peer_system_id, tunnel },
            limits,
            log_dir,
        } = draft
        else {
            // Both are required, so that one of them missing is among the findings already.
            return Err(findings);
        };
        if let Some(parameter) = &mut transmitter.parameter {
            parameter.levels.sort_by(|a, b| a.power_w.total_cmp(&b.power_w));
        }
        Ok(Self {
            role,
            autopilot,
            transmitter,
            pair_link,
            key_file,
            pair_peer_system: peer_system_id,
            pair_tunnel: tunnel,
            limits,
            log_dir,
            warnings: findings,
            document,
        })
    }

    /// An error at a setting, found by whoever uses it.
    pub(crate) fn error_at(&self, setting: &str, message: String, help: String) -> Diagnostics {
        let mut all = Diagnostics::new(&self.document.file, self.document.text.clone());
        all.push(Severity::Error, self.document.at(setting), message, help);
        all
    }

    /// The JSON Schema of the vehicle file.
    #[must_use]
    pub fn schema() -> Json {
        Document::schema(vehicle_file::describe)
    }

    /// What is wrong between this vehicle and a mission: limits below what the mission plans with, and a real
    /// transmitter without the mission's leave. May hold warnings alone: see [`Diagnostics::into_result`].
    #[must_use]
    pub fn check_against(&self, mission: &Mission) -> Diagnostics {
        let file = &self.document;
        let mut all = Diagnostics::new(&file.file, file.text.clone());
        for Comparison { key, unit, limit, planned, planned_by, severity } in self.comparisons(mission) {
            // Radians and back lose a last digit, which is neither a difference nor worth showing.
            let shown = |value: f64| (value * 1e9).round() / 1e9;
            let planned = shown(planned);
            let Some(limit) = limit.map(shown).filter(|limit| *limit < planned) else { continue };
            let consequence = match severity {
                Severity::Error => "transits would be late",
                Severity::Warning => "the limit holds, and the flight falls short of its plan",
            };
            let message = format!(
                "`{key}` is {limit} {unit}, but the mission plans this vehicle with {planned} {unit}"
            );
            let help = format!(
                "{consequence}: lower {planned_by} in the mission, on both vehicles, or raise the limit"
            );
            all.push(severity, file.at(&format!("limits.{key}")), message, help);
        }
        if self.transmitter.kind != TransmitterKind::None && !self.transmitter.simulated {
            let mut refuse = |message: &str, help: &str| {
                let at = file.at("transmitter.simulated");
                all.push(Severity::Error, at, message.to_owned(), help.to_owned());
            };
            if mission.emission.is_none() {
                refuse(
                    "the transmitter is real, but the mission has no [emission] table",
                    "add [emission] with who authorised it, the band and the largest power, or set simulated = true",
                );
            } else if !mission.document.given(ORIGIN) {
                refuse("the transmitter is real, but the mission has no `origin`", ORIGIN_HELP);
            }
        }
        all
    }

    /// Each limit against what the mission plans with. Power and tilt may stay below their ceilings, so that a
    /// stricter limit is no error; speeds are what the slot table is computed from.
    fn comparisons(&self, mission: &Mission) -> [Comparison; 5] {
        use Severity::{Error, Warning};
        let limits = self.limits;
        let planned = mission.vehicles[self.role];
        let table = if self.role == Role::I { "vehicles.i" } else { "vehicles.j" };
        let compare = |key, unit, limit, planned, severity| {
            let planned_by = format!("{table}.{key}");
            Comparison { key, unit, limit, planned, planned_by, severity }
        };
        let tilt_deg = planned.max_tilt_rad.min(mission.airspace_max_tilt_rad).to_degrees();
        let tilt_rate_deg_s = planned.tilt_rate_rad_s.to_degrees();
        let (power_w, power_limit) = mission.power_ceiling(self.role);
        [
            compare("speed_m_s", "m/s", limits.speed_m_s, planned.speed_m_s, Error),
            compare("climb_m_s", "m/s", limits.climb_m_s, planned.climb_m_s, Error),
            compare(
                "tilt_rate_deg_s",
                "deg/s",
                limits.tilt_rate_rad_s.map(f64::to_degrees),
                tilt_rate_deg_s,
                Error,
            ),
            compare("max_tilt_deg", "deg", limits.max_tilt_rad.map(f64::to_degrees), tilt_deg, Warning),
            Comparison {
                planned_by: power_limit.key().to_owned(),
                ..compare("max_power_w", "W", limits.max_power_w, power_w, Warning)
            },
        ]
    }
}

/// A limit of the vehicle and what the mission plans with.
struct Comparison {
    key: &'static str,
    unit: &'static str,
    limit: Option<f64>,
    planned: f64,
    /// The mission's setting.
    planned_by: String,
    severity: Severity,
}

/// Settings against each other.
fn check(draft: &Draft, file: &mut Document) {
    let refuse = |file: &mut Document, path: &str, message: &str, help: &str| {
        file.error(file.at(path), message.to_owned(), help.to_owned());
    };
    let autopilot = &draft.autopilot;
    if autopilot.actuation == Actuation::ThrustVector
        && autopilot.rate_hz < 50.0
        && file.sound(&["autopilot.rate_hz"])
    {
        let message = format!("`rate_hz` is {} Hz, too slow to fly by thrust vector", autopilot.rate_hz);
        refuse(file, "autopilot.rate_hz", &message, "give at least 50");
    }
    if autopilot.thrust_n.is_some()
        && autopilot.actuation != Actuation::ThrustVector
        && file.sound(&["autopilot.thrust_n", "autopilot.actuation"])
    {
        let message = format!("`thrust_n` means nothing with actuation \"{}\"", autopilot.actuation);
        refuse(file, "autopilot.thrust_n", &message, "leave it out, or give actuation = \"thrust_vector\"");
    }
    check_pair(draft, file);
    let transmitter = &draft.transmitter;
    check_form(transmitter, file);
    if transmitter.kind != TransmitterKind::Parameter || !file.sound(&["transmitter"]) {
        return;
    }
    let Some(parameter) = &transmitter.parameter else {
        file.missing(
            file.at("transmitter"),
            "a transmitter of kind \"parameter\" has no `name`".to_owned(),
            "give the name of its power parameter".to_owned(),
        );
        return;
    };
    let off_is_known = file.given("transmitter.off_value")
        || matches!(parameter.unit, PowerUnit::Watt | PowerUnit::Milliwatt);
    if !off_is_known {
        file.missing(
            file.at("transmitter.unit"),
            "nothing says how to silence the radio: `off_value` is not set".to_owned(),
            "give off_value, the parameter's value at which the radio is off".to_owned(),
        );
    }
    if parameter.unit == PowerUnit::Levels && parameter.levels.is_empty() {
        file.missing(
            file.at("transmitter.unit"),
            "`unit` is \"levels\", but there is no [[transmitter.level]]".to_owned(),
            "add [[transmitter.level]] with value = ... and power_w = ..., one for each level".to_owned(),
        );
    }
}

/// A command that counts from its receipt prolongs what is real.
fn check_form(transmitter: &Transmitter, file: &mut Document) {
    let late = transmitter.kind == TransmitterKind::Leased && transmitter.form == CommandForm::FromReceipt;
    if late && !transmitter.simulated && !transmitter.accept_late_commands && file.sound(&["transmitter"]) {
        file.error(
            file.at("transmitter.form"),
            "the transmitter is real, and its commands expire so long after their receipt (`form` 1): one that comes late lasts too long"
                .to_owned(),
            "use a radio of form 2, or say accept_late_commands = true if the way to the radio delays nothing".to_owned(),
        );
    }
}

/// The pair link's addressing.
fn check_pair(draft: &Draft, file: &mut Document) {
    let pair = &draft.pair;
    if pair.tunnel && pair.peer_system_id.is_none() && file.sound(&["pair.peer_system_id"]) {
        file.missing(
            file.at("pair.tunnel"),
            "`tunnel` is set, but not whom TUNNEL is addressed to".to_owned(),
            "give peer_system_id, the MAVLink system of the other vehicle".to_owned(),
        );
    }
    if let Some(system) = pair.peer_system_id.filter(|peer| Some(*peer) == draft.autopilot.system_id) {
        file.error(
            file.at("pair.peer_system_id"),
            format!("`peer_system_id` is {system}, which is this vehicle's own system_id"),
            "give the other vehicle's; the two must differ".to_owned(),
        );
    }
}

/// What keeps a key file from being used. Its content is read by the link that signs with it.
fn key_file_fault(path: &Path) -> Option<(String, String)> {
    let name = path.display();
    let metadata = match std::fs::metadata(path) {
        Ok(metadata) if metadata.is_file() => metadata,
        Ok(_) => {
            return Some((
                format!("the key file {name} is not a file"),
                "give the path of the key itself".to_owned(),
            ));
        }
        Err(error) => {
            let help = "give the path of the key, relative to this vehicle file".to_owned();
            return Some((format!("the key file {name} cannot be read: {error}"), help));
        }
    };
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        let mode = metadata.permissions().mode() & 0o777;
        if mode & 0o077 != 0 {
            let message =
                format!("the key file {name} is open to others than its owner: its mode is {mode:03o}");
            return Some((message, format!("chmod 600 {name}")));
        }
    }
    #[cfg(not(unix))]
    drop(metadata);
    None
}
