//! What the fake devices hear and say: the protocols of `radio_device`, from the devices' side.

use super::bench::{Answer, Request};
use super::kind::Kind;

/// The largest attenuation.
pub(super) const OFF_DB: f64 = 90.0;

/// What is asked for.
///
/// # Errors
/// The answer to what cannot be understood.
pub(super) fn request(kind: Kind, asked: &str) -> Result<Request, Answer> {
    let known = match kind {
        Kind::Command => plain(asked),
        Kind::Attenuator => attenuator(asked),
        Kind::JsonRpc => json_rpc(asked),
        Kind::At => at(asked),
    };
    known.ok_or(Answer::Refused)
}

fn number(text: &str) -> Option<f64> {
    text.trim().parse().ok().filter(|value: &f64| value.is_finite())
}

fn plain(asked: &str) -> Option<Request> {
    Some(match asked.split_once(' ') {
        Some(("set", value)) => Request::Set(number(value)?),
        None if asked == "on" => Request::Turn(true),
        None if asked == "off" => Request::Turn(false),
        None if asked == "read" => Request::Setting,
        None if asked == "state" => Request::State,
        _ => return None,
    })
}

fn attenuator(asked: &str) -> Option<Request> {
    if let Some(value) = asked.strip_prefix(":SETATT=") {
        let db = number(value)?;
        return Some(if db >= OFF_DB { Request::Turn(false) } else { Request::Set(db) });
    }
    Some(match asked {
        ":MN?" => Request::Say("MN=RCDAT-8000-90"),
        ":STARTUPATT:INDICATOR?" => Request::Say("N"),
        ":ATT?" => Request::Setting,
        _ => return None,
    })
}

fn json_rpc(asked: &str) -> Option<Request> {
    let asked: serde_json::Value = serde_json::from_str(asked).ok()?;
    let param = asked.pointer("/params/0").and_then(serde_json::Value::as_str);
    Some(match (asked.get("method")?.as_str()?, param) {
        ("power_dBm", Some(value)) => Request::Set(number(value)?),
        ("read_power_dBm", None) => Request::Setting,
        ("transmit", Some(value)) => Request::Turn(value == "1"),
        ("transmit", None) => Request::State,
        _ => return None,
    })
}

fn at(asked: &str) -> Option<Request> {
    Some(match asked.split_once('=') {
        Some(("AT+MWTXPOWER", value)) => Request::Set(number(value)?),
        Some(("AT+MWRADIO", value)) => Request::Turn(value.trim() == "1"),
        None if asked == "AT+MWTXPOWER?" => Request::Setting,
        None if asked == "AT+MWRADIO?" => Request::State,
        _ => return None,
    })
}

/// The answer as the device words it: `on`, as it radiates.
pub(super) fn answer(kind: Kind, answer: Answer, setting: f64, on: bool) -> String {
    match kind {
        Kind::Command => match answer {
            Answer::Done => "done".to_owned(),
            Answer::Refused => "refused".to_owned(),
            Answer::Setting => format!("power {setting} dBm"),
            Answer::State => if on { "on" } else { "off" }.to_owned(),
            Answer::Text(text) => text.to_owned(),
        },
        Kind::Attenuator => match answer {
            Answer::Done => "1".to_owned(),
            Answer::Refused => "0".to_owned(),
            Answer::Setting | Answer::State => format!("{:.2}", if on { setting } else { OFF_DB }),
            Answer::Text(text) => text.to_owned(),
        },
        Kind::JsonRpc => {
            let result = match answer {
                Answer::Done => String::new(),
                Answer::Setting => setting.to_string(),
                Answer::State => u8::from(on).to_string(),
                Answer::Text(text) => text.to_owned(),
                Answer::Refused => {
                    let error = serde_json::json!({ "code": -1, "message": "INVALID_RANGE" });
                    return serde_json::json!({ "jsonrpc": "2.0", "error": error, "id": "1" }).to_string();
                }
            };
            serde_json::json!({ "jsonrpc": "2.0", "result": [result], "id": "1" }).to_string()
        }
        Kind::At => match answer {
            Answer::Done => "OK".to_owned(),
            Answer::Refused => "ERROR: Invalid parameter".to_owned(),
            Answer::Setting => format!("+MWTXPOWER: {setting} dBm\r\nOK"),
            Answer::State => format!("+MWRADIO: {}\r\nOK", u8::from(on)),
            Answer::Text(text) => format!("{text}\r\nOK"),
        },
    }
}
