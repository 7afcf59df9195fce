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
        Kind::Interface => interface(asked),
        Kind::Attenuator | Kind::AttenuatorHttp | Kind::AttenuatorSerial => attenuator(asked),
        Kind::JsonRpc => json_rpc(asked),
        Kind::Ubus => ubus(asked),
        Kind::At | Kind::AtSerial => at(asked),
        // Spoken to by messages.
        Kind::Parameter | Kind::ParameterBytewise => None,
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

/// The interface, and the session, that the radio files name.
pub(super) const INTERFACE: &str = "fake0";
pub(super) const SESSION: &str = "0123456789abcdef0123456789abcdef";

/// What iw and ip are called with.
fn interface(asked: &str) -> Option<Request> {
    let words: Vec<&str> = asked.split(' ').collect();
    Some(match words.as_slice() {
        ["iw", "dev", INTERFACE, "set", "txpower", "fixed", mbm] => Request::Set(number(mbm)? * 0.01),
        ["iw", "dev", INTERFACE, "info"] => Request::Setting,
        ["ip", "link", "set", INTERFACE, state @ ("up" | "down")] => Request::Turn(*state == "up"),
        ["ip", "-brief", "link", "show", INTERFACE] => Request::State,
        _ => return None,
    })
}

fn attenuator(asked: &str) -> Option<Request> {
    // By HTTP it is a path.
    let asked = asked.strip_prefix('/').unwrap_or(asked);
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
        ("tx_fifo_disable", Some(value)) => Request::Turn(value == "0"),
        ("tx_fifo_disable", None) => Request::State,
        _ => return None,
    })
}

fn ubus(asked: &str) -> Option<Request> {
    let asked: serde_json::Value = serde_json::from_str(asked).ok()?;
    let word = |at: &str| asked.pointer(at).and_then(serde_json::Value::as_str);
    let (session, object, method) = (word("/params/0")?, word("/params/1")?, word("/params/2")?);
    if (object, method) == ("session", "login") {
        return Some(Request::Say(SESSION));
    }
    if session != SESSION {
        return None;
    }
    Some(match (object, method) {
        ("file", "exec") if word("/params/3/command") == Some("iw") => {
            Request::Set(number(word("/params/3/params/4")?)? * 0.01)
        }
        ("iwinfo", "info") => Request::Setting,
        ("network.wireless", "up") => Request::Turn(true),
        ("network.wireless", "down") => Request::Turn(false),
        ("network.wireless", "status") => Request::State,
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
    if answer == Answer::Garbage {
        // A modem's answers end so.
        return if kind.key() == Kind::At.key() { "\u{1}?\r\nOK" } else { "\u{1}?" }.to_owned();
    }
    match kind {
        Kind::Command => match answer {
            Answer::Done | Answer::Garbage => "done".to_owned(),
            Answer::Refused => "refused".to_owned(),
            Answer::Setting => format!("power {setting} dBm"),
            Answer::State => if on { "on" } else { "off" }.to_owned(),
            Answer::Text(text) => text.to_owned(),
        },
        Kind::Interface => match answer {
            Answer::Done | Answer::Garbage => String::new(),
            Answer::Refused => "refused".to_owned(),
            Answer::Setting => {
                format!("Interface {INTERFACE}\n\tifindex 7\n\ttype monitor\n\ttxpower {setting:.2} dBm")
            }
            Answer::State => {
                let state = if on { "UP" } else { "DOWN" };
                format!("{INTERFACE:<16} {state:<14} 02:00:00:00:00:07 <BROADCAST,MULTICAST>")
            }
            Answer::Text(text) => text.to_owned(),
        },
        Kind::Attenuator | Kind::AttenuatorHttp | Kind::AttenuatorSerial => match answer {
            Answer::Done | Answer::Garbage => "1".to_owned(),
            Answer::Refused => "0".to_owned(),
            Answer::Setting | Answer::State => format!("{:.2}", if on { setting } else { OFF_DB }),
            Answer::Text(text) => text.to_owned(),
        },
        Kind::JsonRpc => {
            let result = match answer {
                Answer::Done | Answer::Garbage => String::new(),
                Answer::Setting => setting.to_string(),
                // Whether it is disabled.
                Answer::State => u8::from(!on).to_string(),
                Answer::Text(text) => text.to_owned(),
                Answer::Refused => {
                    let error = serde_json::json!({ "code": -1, "message": "INVALID_RANGE" });
                    return serde_json::json!({ "jsonrpc": "2.0", "error": error, "id": "1" }).to_string();
                }
            };
            serde_json::json!({ "jsonrpc": "2.0", "result": [result], "id": "1" }).to_string()
        }
        Kind::Ubus => {
            let result = match answer {
                Answer::Done | Answer::Garbage => serde_json::json!([0, {}]),
                Answer::Setting => serde_json::json!([0, { "txpower": setting }]),
                Answer::State => serde_json::json!([0, { "radio0": { "up": on } }]),
                Answer::Text(text) => serde_json::json!([0, { "ubus_rpc_session": text }]),
                // Invalid argument, or no permission: no call is refused otherwise.
                Answer::Refused => serde_json::json!([2]),
            };
            serde_json::json!({ "jsonrpc": "2.0", "id": 1, "result": result }).to_string()
        }
        Kind::Parameter | Kind::ParameterBytewise => String::new(),
        Kind::At | Kind::AtSerial => match answer {
            Answer::Done | Answer::Garbage => "OK".to_owned(),
            Answer::Refused => "ERROR: Invalid parameter".to_owned(),
            Answer::Setting => format!("+MWTXPOWER: {setting} dBm\r\nOK"),
            Answer::State => format!("+MWRADIO: {}\r\nOK", u8::from(on)),
            Answer::Text(text) => format!("{text}\r\nOK"),
        },
    }
}
