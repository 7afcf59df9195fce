//! What a radio file says, by value.

use std::path::PathBuf;

use super::vehicle_draft::LogLimits;
use crate::link::{HostPort, LinkAddress};
use crate::radio_device::gpio::Electrical;
use crate::radio_device::parameter::Unit;
use crate::transmitter::Protocol;

/// Which protocol drives the device.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DeviceKind {
    /// Programs.
    Command,
    /// A programmable attenuator.
    Attenuator,
    /// JSON over HTTP.
    JsonRpc,
    /// AT commands.
    At,
    /// A MAVLink parameter.
    Parameter,
    /// SoapySDR.
    Soapy,
}

impl DeviceKind {
    /// All of them.
    pub(super) const ALL: [Self; 6] =
        [Self::Command, Self::Attenuator, Self::JsonRpc, Self::At, Self::Parameter, Self::Soapy];

    /// As the file spells it, and its table.
    #[must_use]
    pub fn key(self) -> &'static str {
        match self {
            Self::Command => "command",
            Self::Attenuator => "attenuator",
            Self::JsonRpc => "json_rpc",
            Self::At => "at",
            Self::Parameter => "parameter",
            Self::Soapy => "soapy",
        }
    }
}

/// The device as any radio has one.
#[derive(Debug, Clone, PartialEq)]
pub struct DeviceDraft {
    /// Its protocol.
    pub kind: DeviceKind,
    /// The least setting.
    pub least: Option<f64>,
    /// The largest setting.
    pub most: Option<f64>,
    /// Settings from the least to the largest are so far apart.
    pub step: f64,
    /// All settings, in place of the three.
    pub levels: Option<Vec<f64>>,
    /// What enters an attenuator, in dBm.
    pub source_dbm: Option<f64>,
    /// What is radiated at.
    pub frequency_hz: Option<f64>,
    /// From an off to silence, at the longest.
    pub off_ms: f64,
    /// From a command to the new power, at the longest.
    pub change_ms: f64,
    /// Until it is silent by itself; `None`: never.
    pub dead_ms: Option<f64>,
    /// The band in which it radiates.
    pub band_khz: Option<[f64; 2]>,
    /// How far below the power that was set it may be read back.
    pub tolerance_db: f64,
}

/// Programs; either an interface for `iw`, or all else.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct CommandDraft {
    /// A Wi-Fi interface.
    pub interface: Option<String>,
    /// Sets the power.
    pub set: Option<Vec<String>>,
    /// Ends the off.
    pub on: Option<Vec<String>>,
    /// Turns off.
    pub off: Option<Vec<String>>,
    /// Says the setting in force.
    pub read: Option<Vec<String>>,
    /// What stands before it.
    pub read_after: Option<String>,
    /// What stands behind it.
    pub read_before: Option<String>,
    /// Says whether it is off.
    pub read_off: Option<Vec<String>>,
    /// What that says then.
    pub off_reads: Option<String>,
}

/// A programmable attenuator.
#[derive(Debug, Clone, PartialEq)]
pub struct AttenuatorDraft {
    /// Where it is.
    pub address: LinkAddress,
    /// By HTTP, and not by lines of text.
    pub http: bool,
    /// Its password, by HTTP.
    pub password: Option<String>,
    /// Its largest attenuation, which is off.
    pub off_db: f64,
}

impl Default for AttenuatorDraft {
    fn default() -> Self {
        Self { address: port(23), http: false, password: None, off_db: 0.0 }
    }
}

/// A radio that is set by JSON over HTTP.
#[derive(Debug, Clone, PartialEq)]
pub struct JsonRpcDraft {
    /// Where it is.
    pub address: LinkAddress,
    /// What is posted to.
    pub path: String,
    /// Gives a session.
    pub login: Option<String>,
    /// Where in its answer.
    pub login_at: String,
    /// Sets the power.
    pub set: Option<String>,
    /// Ends the off.
    pub on: Option<String>,
    /// Turns off.
    pub off: String,
    /// Says the power in force.
    pub read: Option<String>,
    /// Where in its answer.
    pub read_at: String,
    /// Says whether it is off.
    pub read_off: Option<String>,
    /// Where in its answer.
    pub read_off_at: String,
    /// What stands there then.
    pub off_reads: String,
}

impl Default for JsonRpcDraft {
    fn default() -> Self {
        Self {
            address: port(80),
            path: "/streamscape_api".to_owned(),
            login: None,
            login_at: "/result/1/ubus_rpc_session".to_owned(),
            set: None,
            on: None,
            off: String::new(),
            read: None,
            read_at: "/result/0".to_owned(),
            read_off: None,
            read_off_at: "/result/0".to_owned(),
            off_reads: "0".to_owned(),
        }
    }
}

/// A modem.
#[derive(Debug, Clone, PartialEq)]
pub struct AtDraft {
    /// Where it is.
    pub address: LinkAddress,
    /// Who logs in.
    pub user: Option<String>,
    /// With what.
    pub password: Option<String>,
    /// Sets the power.
    pub set: String,
    /// Ends the off.
    pub on: String,
    /// Turns off.
    pub off: String,
    /// Whether the next ones are used.
    pub reads_back: bool,
    /// Says the power in force.
    pub read: String,
    /// What stands before it.
    pub read_after: String,
    /// Says whether it is off.
    pub read_off: String,
    /// What stands before that.
    pub read_off_after: String,
    /// What it says then.
    pub off_reads: f64,
}

impl Default for AtDraft {
    fn default() -> Self {
        Self {
            address: port(23),
            user: None,
            password: None,
            set: "AT+MWTXPOWER={level}".to_owned(),
            on: "AT+MWRADIO=1".to_owned(),
            off: "AT+MWRADIO=0".to_owned(),
            reads_back: true,
            read: "AT+MWTXPOWER?".to_owned(),
            read_after: "+MWTXPOWER:".to_owned(),
            read_off: "AT+MWRADIO?".to_owned(),
            read_off_after: "+MWRADIO:".to_owned(),
            off_reads: 0.0,
        }
    }
}

/// A radio with a power parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct ParameterDraft {
    /// Where it is.
    pub address: LinkAddress,
    /// Its MAVLink system.
    pub system_id: u8,
    /// Its component.
    pub component_id: u8,
    /// The parameter.
    pub name: String,
    /// How it is set.
    pub protocol: Protocol,
    /// What its value is.
    pub unit: Unit,
    /// The value that is off; `None`: there is none.
    pub off_value: Option<f64>,
}

impl Default for ParameterDraft {
    fn default() -> Self {
        Self {
            address: port(14_550),
            system_id: 1,
            component_id: crate::radio_host::COMPONENT,
            name: String::new(),
            protocol: Protocol::Extended,
            unit: Unit::Setting,
            off_value: None,
        }
    }
}

/// A SoapySDR device.
#[derive(Debug, Clone, PartialEq)]
pub struct SoapyDraft {
    /// Which one.
    pub args: String,
    /// Of its transmit channels.
    pub channel: u64,
    /// Its connector.
    pub antenna: Option<String>,
    /// How wide the noise is.
    pub sample_rate_hz: f64,
}

impl Default for SoapyDraft {
    fn default() -> Self {
        Self { args: String::new(), channel: 0, antenna: None, sample_rate_hz: 0.0 }
    }
}

/// A kill line.
#[derive(Debug, Clone, PartialEq)]
pub struct KillLineDraft {
    /// The chip's device file.
    pub chip: PathBuf,
    /// The line's offset.
    pub line: Option<u64>,
    /// Or its name.
    pub name: Option<String>,
    /// The level at which the transmitter is silent.
    pub off_level: Electrical,
    /// From that level to silence, at the longest.
    pub silent_ms: Option<f64>,
    /// For how long an edge holds, at the longest.
    pub oneshot_ms: Option<f64>,
}

impl Default for KillLineDraft {
    fn default() -> Self {
        Self {
            chip: PathBuf::from("/dev/gpiochip0"),
            line: None,
            name: None,
            off_level: Electrical::Low,
            silent_ms: None,
            oneshot_ms: None,
        }
    }
}

/// A whole radio file.
#[derive(Debug, Clone, PartialEq)]
pub struct RadioHostDraft {
    /// MAVLink system of the radio: the vehicle's.
    pub system_id: u8,
    /// Its component.
    pub component_id: u8,
    /// The command that sets power.
    pub command: u16,
    /// The companion's link.
    pub address: LinkAddress,
    /// Its signing key.
    pub key_file: Option<PathBuf>,
    /// Components that may command; empty: any.
    pub commanders: Vec<u8>,
    /// Its messages ride in TUNNEL.
    pub tunnel: bool,
    /// Systems whose kill is obeyed unsigned.
    pub operators: Vec<u8>,
    /// The device.
    pub device: DeviceDraft,
    /// Measured powers.
    pub calibration_file: Option<PathBuf>,
    /// Programs.
    pub by_command: Option<CommandDraft>,
    /// An attenuator.
    pub attenuator: Option<AttenuatorDraft>,
    /// A radio by JSON.
    pub json_rpc: Option<JsonRpcDraft>,
    /// A modem.
    pub at: Option<AtDraft>,
    /// A radio with a power parameter.
    pub parameter: Option<ParameterDraft>,
    /// A SoapySDR device.
    pub soapy: Option<SoapyDraft>,
    /// A kill line, beside any of them.
    pub kill_line: Option<KillLineDraft>,
    /// Where the kill and the link's timestamps are kept.
    pub log_dir: PathBuf,
    /// What recorded runs may take there.
    pub log_limits: LogLimits,
}

impl RadioHostDraft {
    /// Before a file is read: what must be given is anything.
    pub(super) fn blank() -> Self {
        Self {
            system_id: 1,
            component_id: crate::radio_host::COMPONENT,
            command: 31_010,
            address: LinkAddress::UdpIn(HostPort { host: "127.0.0.1".to_owned(), port: 14_570 }),
            key_file: None,
            commanders: Vec::new(),
            tunnel: false,
            operators: Vec::new(),
            device: DeviceDraft {
                kind: DeviceKind::Command,
                least: None,
                most: None,
                step: 1.0,
                levels: None,
                source_dbm: None,
                frequency_hz: None,
                off_ms: 0.0,
                change_ms: 0.0,
                dead_ms: None,
                band_khz: None,
                tolerance_db: 0.5,
            },
            calibration_file: None,
            by_command: None,
            attenuator: None,
            json_rpc: None,
            at: None,
            parameter: None,
            soapy: None,
            kill_line: None,
            log_dir: PathBuf::from("radio-logs"),
            log_limits: LogLimits::default(),
        }
    }
}

/// Some port of this machine.
fn port(port: u16) -> LinkAddress {
    LinkAddress::TcpOut(HostPort { host: "127.0.0.1".to_owned(), port })
}
