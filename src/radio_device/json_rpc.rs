//! Radios that are set by JSON over HTTP: Silvus StreamCaster, and radios with OpenWrt's ubus (Doodle Labs).
//!
//! Each step is one POST of a JSON text with placeholders, and a place in the answer (RFC 6901).
//!
//! Facts of StreamCaster's, from published clients and emulators of its interface:
//! - POST to `/streamscape_api`, `{"jsonrpc":"2.0","method":"power_dBm","params":["25"],"id":"1"}` sets (answers `[""]`); without
//!   params it says what is set, and `read_power_dBm` what is radiated (`["25"]`). An error has `error` in place of `result`.
//! - After a change the radio may be unavailable for seconds (emulators have 5 s for a power, 30 s for a frequency), in which it
//!   answers HTTP 503: declare `change_ms` accordingly, and the companion's preflight says whether a slot's guard can contain
//!   it. In most cases it cannot, and the radio is of use at one power.
//! - `tx_fifo_disable` with `["1"]` keeps the radio from transmitting, and with `["0"]` lets it again; without params it says
//!   which (3.33 of the maker's manual, as a published monitor of these radios quotes it, beside 3.58 for `read_power_dBm`, what is
//!   transmitted in all). That is an off: give it as `off`, `on` and `read_off` with `off_reads = "1"`. What was in the air already is
//!   not called back: measure it. `enable_max_power`, where it is on, overrides the power that is set.
//! - With login (`/login.sh`, a cookie) or in FIPS mode (HTTPS alone) it cannot be driven from here.
//!
//! Facts of ubus, from OpenWrt's documents (rpcd, uhttpd-mod-ubus):
//! - POST to `/ubus`, method `call`, params `[session, object, method, arguments]`; `session`'s `login` gives `ubus_rpc_session`,
//!   which lasts 300 s unless it is used. The answer is `[status, data]`, status 0 for done, 6 for no permission.
//! - Power is set where the maker's release says: often `file`'s `exec` of `iw`, read back by `iwinfo`'s `info` (`txpower`).
//! - Doodle Labs, by the maker's own JSON-RPC API guide: JSON-RPC is on by default since the firmware of June 2024, over IPv4, by HTTP
//!   and HTTPS, and what may be called is the integrator's choice (rpcd's access lists). HTTPS is not spoken here. Which call sets
//!   the power, and how long that takes, was not found.
//!
//! Neither turns itself off if this program dies.

use serde_json::Value as Json;

use super::template::fill;
use super::{Device, DeviceError, http};
use crate::link::HostPort;

/// One call, and where in its answer something stands.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Call {
    /// The JSON text.
    pub json: String,
    /// A JSON pointer; empty: the answer as a whole.
    pub at: String,
}

/// The device's settings.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Settings {
    /// Host and port.
    pub to: HostPort,
    /// The path that is posted to.
    pub path: String,
    /// What gives a session, for `{session}` in the others.
    pub login: Option<Call>,
    /// Sets the power.
    pub set: String,
    /// Says the power in force.
    pub read: Option<Call>,
    /// Ends the off, where setting a power does not.
    pub on: Option<String>,
    /// Turns off.
    pub off: String,
    /// Says whether it is off.
    pub read_off: Option<Call>,
    /// What that says when it is.
    pub off_reads: String,
}

/// The calls that StreamCaster's documents name: how it sets, and how it reads back.
#[must_use]
pub fn streamcaster() -> (String, Call) {
    let set = r#"{"jsonrpc":"2.0","method":"power_dBm","params":["{dbm}"],"id":"1"}"#;
    let read = r#"{"jsonrpc":"2.0","method":"read_power_dBm","id":"1"}"#;
    (set.to_owned(), Call { json: read.to_owned(), at: "/result/0".to_owned() })
}

/// See the module.
#[derive(Debug)]
pub struct JsonRpc {
    settings: Settings,
    session: Option<String>,
}

impl JsonRpc {
    /// A radio that was not spoken to yet.
    #[must_use]
    pub fn new(settings: Settings) -> Self {
        Self { settings, session: None }
    }

    /// The answer to a call. A session that was refused is asked for anew with the next one.
    async fn call(&mut self, json: &str, setting: f64) -> Result<Json, DeviceError> {
        let Settings { to, path, login, .. } = &self.settings;
        let session = match (login, self.session.take()) {
            (_, Some(session)) => session,
            (None, None) => String::new(),
            (Some(login), None) => {
                let answer = post(to, path, &login.json).await?;
                text_at(&answer, &login.at).ok_or_else(|| DeviceError::garbled(&answer.to_string()))?
            }
        };
        let text = fill(json, setting).replace("{session}", &session);
        let answer = post(to, path, &text).await?;
        self.session = login.is_some().then_some(session);
        Ok(answer)
    }
}

async fn post(to: &HostPort, path: &str, json: &str) -> Result<Json, DeviceError> {
    let body = http::request(to, path, Some(json)).await?;
    let answer: Json = serde_json::from_str(&body).map_err(|_| DeviceError::garbled(&body))?;
    let error = answer.get("error").filter(|error| !error.is_null());
    // ubus: the first of the result is its status.
    let status = answer.pointer("/result/0").and_then(Json::as_i64).filter(|status| *status != 0);
    if error.is_some() || status.is_some() { Err(DeviceError::refused(&body)) } else { Ok(answer) }
}

fn text_at(answer: &Json, at: &str) -> Option<String> {
    match answer.pointer(at)? {
        Json::String(text) => Some(text.trim().to_owned()),
        Json::Number(number) => Some(number.to_string()),
        Json::Bool(flag) => Some(flag.to_string()),
        _ => None,
    }
}

impl Device for JsonRpc {
    async fn off(&mut self) -> Result<(), DeviceError> {
        let Settings { off, read_off, off_reads, .. } = self.settings.clone();
        self.call(&off, 0.0).await?;
        let Some(read_off) = read_off else { return Ok(()) };
        let answer = self.call(&read_off.json, 0.0).await?;
        let said = text_at(&answer, &read_off.at).ok_or_else(|| DeviceError::garbled(&answer.to_string()))?;
        if said == off_reads { Ok(()) } else { Err(DeviceError::StillOn(said)) }
    }

    async fn set(&mut self, setting: f64) -> Result<Option<f64>, DeviceError> {
        let Settings { set, on, read, .. } = self.settings.clone();
        self.call(&set, setting).await?;
        if let Some(on) = on {
            self.call(&on, setting).await?;
        }
        let Some(read) = read else { return Ok(None) };
        let answer = self.call(&read.json, setting).await?;
        let value = text_at(&answer, &read.at)
            .and_then(|text| text.parse().ok())
            .filter(|value: &f64| value.is_finite());
        value.map(Some).ok_or_else(|| DeviceError::garbled(&answer.to_string()))
    }
}
