//! Each backend with a device that behaves as documented.

use veilwing::link::HostPort;
use veilwing::radio_device::attenuator::{Access, Attenuator};
use veilwing::radio_device::json_rpc::{Call, JsonRpc, streamcaster};
use veilwing::radio_device::{Device, Reading, at, attenuator, command, json_rpc};
use veilwing::radio_host::Fault;

use crate::server::{Form, Handler, Reply, Shared, serve, shared, tcp};

/// A Mini-Circuits attenuator of 0 to 90 dB: answers of its programming manual.
pub fn mini_circuits(db: &Shared<f64>) -> Handler {
    let db = db.clone();
    Box::new(move |asked| {
        let command = asked.trim_start_matches('/').trim_start_matches("PWD=secret;");
        let answer = if let Some(value) = command.strip_prefix(":SETATT=") {
            match value.parse::<f64>() {
                Ok(value) if value > 90.0 => {
                    *db.lock().unwrap() = 90.0;
                    "2".to_owned()
                }
                Ok(value) if value >= 0.0 => {
                    *db.lock().unwrap() = (value * 4.0).round() / 4.0;
                    "1".to_owned()
                }
                _ => "0".to_owned(),
            }
        } else {
            match command {
                ":MN?" => "MN=RCDAT-8000-90".to_owned(),
                ":STARTUPATT:INDICATOR?" => "N".to_owned(),
                ":ATT?" => format!("{:.2}", db.lock().unwrap()),
                _ => "-99 unrecognized command".to_owned(),
            }
        };
        Reply::Text(format!("{answer}\r\n"))
    })
}

async fn over(form: Form, db: &Shared<f64>) -> Attenuator {
    let to = serve(form, b"", mini_circuits(db)).await;
    let access = match form {
        Form::Lines => Access::Lines(tcp(&to)),
        Form::Http => Access::Http { to, password: Some("secret".to_owned()) },
    };
    Attenuator::new(attenuator::Settings { access, off_db: 90.0 })
}

#[tokio::test]
async fn spec_an_attenuator_is_set_and_read_back_over_telnet_and_http() {
    for form in [Form::Lines, Form::Http] {
        let db = shared(0.0);
        let mut device = over(form, &db).await;
        device.off().await.unwrap();
        assert_eq!(*db.lock().unwrap(), 90.0, "{form:?}");
        assert_eq!(device.set(12.25).await.unwrap(), Some(12.25));
        assert_eq!(*db.lock().unwrap(), 12.25);
        // Off its grid it does what it can, and says so.
        assert_eq!(device.set(12.3).await.unwrap(), Some(12.25));
        assert_eq!(device.set(-1.0).await.unwrap_err().fault(), Fault::Refused);
        device.off().await.unwrap();
    }
}

/// A StreamCaster: power by `power_dBm`, transmission by a call that this test makes up; unavailable for so many calls after a
/// change.
pub fn stream_caster(dbm: &Shared<(String, bool)>, mut blackout: u32) -> Handler {
    let dbm = dbm.clone();
    let mut unavailable = 0;
    let first = blackout;
    Box::new(move |asked| {
        if unavailable > 0 {
            unavailable -= 1;
            return Reply::Text(
                "HTTP/1.1 503 Service Unavailable\r\nContent-Length: 11\r\n\r\nUNAVAILABLE".to_owned(),
            );
        }
        let asked: serde_json::Value = serde_json::from_str(asked).unwrap();
        let mut state = dbm.lock().unwrap();
        let param = asked["params"][0].as_str().map(str::to_owned);
        let result = match (asked["method"].as_str().unwrap(), param) {
            ("power_dBm", Some(value)) if value.parse::<f64>().is_ok_and(|value| value <= 33.0) => {
                state.0 = value;
                unavailable = std::mem::replace(&mut blackout, first);
                String::new()
            }
            ("read_power_dBm", None) => state.0.clone(),
            ("transmit", Some(value)) => {
                state.1 = value == "1";
                String::new()
            }
            ("transmit", None) => if state.1 { "1" } else { "0" }.to_owned(),
            _ => {
                return Reply::Text(
                    r#"{"jsonrpc":"2.0","error":{"code":-1,"message":"INVALID_RANGE"},"id":"1"}"#.to_owned(),
                );
            }
        };
        Reply::Text(serde_json::json!({ "jsonrpc": "2.0", "result": [result], "id": "1" }).to_string())
    })
}

pub fn stream_caster_settings(to: HostPort) -> json_rpc::Settings {
    let (set, read) = streamcaster();
    let transmit = |params: &str| format!(r#"{{"jsonrpc":"2.0","method":"transmit"{params},"id":"1"}}"#);
    json_rpc::Settings {
        to,
        path: "/streamscape_api".to_owned(),
        login: None,
        set,
        read: Some(read),
        on: Some(transmit(r#","params":["1"]"#)),
        off: transmit(r#","params":["0"]"#),
        read_off: Some(Call { json: transmit(""), at: "/result/0".to_owned() }),
        off_reads: "0".to_owned(),
    }
}

#[tokio::test]
async fn spec_a_streamcaster_is_set_read_back_and_told_why_not() {
    let state = shared(("30".to_owned(), true));
    let mut device =
        JsonRpc::new(stream_caster_settings(serve(Form::Http, b"", stream_caster(&state, 0)).await));
    device.off().await.unwrap();
    assert!(!state.lock().unwrap().1);
    assert_eq!(device.set(25.0).await.unwrap(), Some(25.0));
    assert_eq!(*state.lock().unwrap(), ("25".to_owned(), true));
    let error = device.set(40.0).await.unwrap_err();
    assert!(error.fault() == Fault::Refused && error.to_string().contains("INVALID_RANGE"), "{error}");
    // Unavailable after a change: not there, as far as can be told.
    let mut device =
        JsonRpc::new(stream_caster_settings(serve(Form::Http, b"", stream_caster(&state, 1)).await));
    let error = device.set(20.0).await.unwrap_err();
    assert!(error.fault() == Fault::Refused && error.to_string().contains("503"), "{error}");
}

#[tokio::test]
async fn spec_a_radio_with_ubus_is_logged_in_to_once_and_again_when_its_session_is_over() {
    let calls = shared(Vec::new());
    let seen = calls.clone();
    let handler: Handler = Box::new(move |asked| {
        let asked: serde_json::Value = serde_json::from_str(asked).unwrap();
        let method = asked["params"][2].as_str().unwrap().to_owned();
        seen.lock().unwrap().push(method.clone());
        let logins = seen.lock().unwrap().iter().filter(|method| *method == "login").count();
        let session = format!("session {logins}");
        let result = match method.as_str() {
            "login" => serde_json::json!([0, { "ubus_rpc_session": session }]),
            _ if asked["params"][0] != session.as_str() || seen.lock().unwrap().len() == 4 => {
                serde_json::json!([6])
            }
            "info" => serde_json::json!([0, { "txpower": 17 }]),
            _ => serde_json::json!([0, {}]),
        };
        Reply::Text(serde_json::json!({ "jsonrpc": "2.0", "id": 1, "result": result }).to_string())
    });
    let call = |object: &str, method: &str, arguments: &str| {
        format!(
            r#"{{"jsonrpc":"2.0","id":1,"method":"call","params":["{{session}}","{object}","{method}",{arguments}]}}"#
        )
    };
    let mut device = JsonRpc::new(json_rpc::Settings {
        to: serve(Form::Http, b"", handler).await,
        path: "/ubus".to_owned(),
        login: Some(Call {
            json: call("session", "login", r#"{"username":"u","password":"p"}"#),
            at: "/result/1/ubus_rpc_session".to_owned(),
        }),
        set: call("file", "exec", r#"{"command":"iw","params":["wlan0","set","txpower","fixed","{mbm}"]}"#),
        read: Some(Call {
            json: call("iwinfo", "info", r#"{"device":"wlan0"}"#),
            at: "/result/1/txpower".to_owned(),
        }),
        on: None,
        off: call("network.wireless", "down", "{}"),
        read_off: None,
        off_reads: String::new(),
    });
    assert_eq!(device.set(17.0).await.unwrap(), Some(17.0));
    assert_eq!(device.off().await.unwrap_err().fault(), Fault::Refused, "the session is over");
    device.off().await.unwrap();
    assert_eq!(*calls.lock().unwrap(), ["login", "exec", "info", "down", "login", "down"]);
}

/// A Microhard modem's telnet console: options, a login, echoes.
pub fn microhard(state: &Shared<(i32, bool)>) -> Handler {
    let state = state.clone();
    let mut step = 0;
    Box::new(move |line| {
        if line == "admin" {
            step = 1;
            return Reply::Text("admin\r\nPassword: ".to_owned());
        }
        if step == 1 {
            step = if line == "microhard" { 2 } else { 0 };
            let said = if step == 2 {
                "\r\nEntering character mode\r\nUserDevice> "
            } else {
                "\r\nLogin incorrect\r\nlogin: "
            };
            return Reply::Text(said.to_owned());
        }
        let mut state = state.lock().unwrap();
        let answer = match line.split_once('=') {
            Some(("AT+MWTXPOWER", value))
                if value.parse().is_ok_and(|value: i32| (7..=30).contains(&value)) =>
            {
                state.0 = value.parse().unwrap();
                "OK".to_owned()
            }
            Some(("AT+MWRADIO", value)) => {
                state.1 = value == "1";
                "OK".to_owned()
            }
            None if line == "AT+MWTXPOWER?" => format!("+MWTXPOWER: {} dBm\r\nOK", state.0),
            None if line == "AT+MWRADIO?" => format!("+MWRADIO: {}\r\nOK", i32::from(state.1)),
            _ => "ERROR: Invalid parameter".to_owned(),
        };
        Reply::Text(format!("{line}\r\n{answer}\r\nUserDevice> "))
    })
}

/// IAC DO ECHO, IAC WILL SUPPRESS GO AHEAD, and the first question.
pub const GREETING: &[u8] = b"\xff\xfd\x01\xff\xfb\x03\r\nUserDevice login: ";

pub fn microhard_settings(to: &HostPort) -> at::Settings {
    let after = |text: &str| Reading { after: text.to_owned(), before: String::new() };
    at::Settings {
        link: tcp(to),
        login: Some(("admin".to_owned(), "microhard".to_owned())),
        set: "AT+MWTXPOWER={level}".to_owned(),
        read: "AT+MWTXPOWER?".to_owned(),
        reading: after("+MWTXPOWER:"),
        on: "AT+MWRADIO=1".to_owned(),
        off: "AT+MWRADIO=0".to_owned(),
        read_off: "AT+MWRADIO?".to_owned(),
        off_reading: after("+MWRADIO:"),
        off_reads: 0.0,
    }
}

#[tokio::test]
async fn spec_a_modem_is_logged_in_to_set_and_read_back() {
    let state = shared((30, true));
    let to = serve(Form::Lines, GREETING, microhard(&state)).await;
    let mut device = at::Modem::new(microhard_settings(&to));
    device.off().await.unwrap();
    assert!(!state.lock().unwrap().1);
    assert_eq!(device.set(20.0).await.unwrap(), Some(20.0));
    assert_eq!(*state.lock().unwrap(), (20, true));
    assert_eq!(device.set(31.0).await.unwrap_err().fault(), Fault::Refused);
    let to = serve(Form::Lines, GREETING, microhard(&state)).await;
    let wrong =
        at::Settings { login: Some(("admin".to_owned(), "wrong".to_owned())), ..microhard_settings(&to) };
    assert_eq!(at::Modem::new(wrong).off().await.unwrap_err().fault(), Fault::Refused);
}

/// Programs that keep a radio's state in a directory.
pub fn programs(directory: &std::path::Path) -> command::Settings {
    let shell = |script: &str| {
        ["sh", "-c", script, directory.to_str().unwrap(), "{dbm}", "{mbm}", "{mw}"]
            .map(str::to_owned)
            .to_vec()
    };
    command::Settings {
        set: shell(r#"echo "txpower $1 dBm" > "$0/power"; echo "$2 $3" > "$0/units""#),
        on: shell(r#"echo UP > "$0/link""#),
        off: shell(r#"echo DOWN > "$0/link""#),
        read: shell(r#"cat "$0/power""#),
        reading: Reading { after: "txpower".to_owned(), before: "dBm".to_owned() },
        read_off: shell(r#"echo "wlan0 $(cat "$0/link") 00:11:22:33:44:55""#),
        off_reads: "DOWN".to_owned(),
    }
}

pub fn directory(name: &str) -> std::path::PathBuf {
    let path = std::env::temp_dir().join(format!("veilwing-radio-{name}-{}", std::process::id()));
    std::fs::create_dir_all(&path).unwrap();
    path
}

#[tokio::test]
async fn spec_programs_set_turn_off_and_are_believed_by_what_they_print_and_how_they_end() {
    let path = directory("programs");
    let says = |file: &str| std::fs::read_to_string(path.join(file)).unwrap().trim().to_owned();
    let mut device = command::Program::new(programs(&path));
    device.off().await.unwrap();
    assert_eq!(device.set(20.5).await.unwrap(), Some(20.5));
    assert_eq!((says("link"), says("units")), ("UP".to_owned(), "2050 112.201845".to_owned()));
    let still_on = command::Settings { off: vec!["true".to_owned()], ..programs(&path) };
    assert_eq!(command::Program::new(still_on).off().await.unwrap_err().fault(), Fault::StillOn);
    let fails = ["sh", "-c", "echo no such device >&2; exit 3"].map(str::to_owned).to_vec();
    let error = command::Program::new(command::Settings { set: fails, ..programs(&path) })
        .set(1.0)
        .await
        .unwrap_err();
    assert!(error.fault() == Fault::Refused && error.to_string().contains("no such device"), "{error}");
    let missing = command::Settings { off: vec!["/no/such/program".to_owned()], ..programs(&path) };
    assert_eq!(command::Program::new(missing).off().await.unwrap_err().fault(), Fault::Unreachable);
    std::fs::remove_dir_all(path).unwrap();
}

#[test]
fn spec_the_preset_for_wifi_is_iw_and_ip() {
    let iw = command::Settings::iw("wlan1");
    assert_eq!(iw.set, ["iw", "dev", "wlan1", "set", "txpower", "fixed", "{mbm}"]);
    assert_eq!(iw.off, ["ip", "link", "set", "wlan1", "down"]);
    assert_eq!(iw.read, ["iw", "dev", "wlan1", "info"]);
}
