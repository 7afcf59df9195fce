//! The program `veilwing radio` beside devices that misbehave while a power is to change: it goes on, the device is told off long
//! before the lease's end, and the answer, the report and the STATUSTEXT say why.

use std::time::Duration;

use veilwing::link::Clock;
use veilwing::time::Instant;
use veilwing::transmitter::wire::VeilwingRadioResult as Is;

use crate::backends::{GREETING, microhard, mini_circuits, stream_caster};
use crate::host::{Companion, Program};
use crate::server::{Form, Handler, Reply, Shared, serve, shared};

/// What the device does wrong, once.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Wrong {
    /// Nothing.
    Nothing,
    /// Says what its documents do not have.
    Garbage,
    /// Refuses.
    Error,
    /// Goes 5 dB above what it is told.
    OtherPower,
    /// Answers nothing until it is told off.
    Late,
    /// Answers nothing, off neither.
    Never,
    /// Ends the connection in the middle of a line.
    MidLine,
    /// Says 10 MB.
    Flood,
}

impl Wrong {
    const ALL: [Self; 7] =
        [Self::Garbage, Self::Error, Self::OtherPower, Self::Late, Self::Never, Self::MidLine, Self::Flood];

    /// Reasons 7 to 10 of the acknowledgement (docs/radio.md).
    fn reason(self) -> Is {
        match self {
            Self::OtherPower => Is::VEILWING_RADIO_RESULT_OTHER_POWER,
            Self::Late | Self::Never => Is::VEILWING_RADIO_RESULT_DEVICE_LATE,
            _ => Is::VEILWING_RADIO_RESULT_DEVICE_ERROR,
        }
    }
}

impl Wrong {
    /// What the operator reads.
    fn words(self) -> &'static str {
        match self {
            Self::Nothing => "",
            Self::Garbage | Self::Flood => "the device answers garbage",
            Self::Error => "the device refuses",
            Self::OtherPower => "the device has another power",
            Self::Late | Self::Never => "the device is late",
            // By HTTP, a text that is cut is a text.
            Self::MidLine => "the device",
        }
    }
}

/// A backend: the radio file's part, how its fake is served, and how its commands look.
struct Backend {
    name: &'static str,
    kind: &'static str,
    table: &'static str,
    form: Form,
    greeting: &'static [u8],
    /// How an off, and a question for the power, begin or what they hold.
    off: &'static str,
    reads: &'static str,
    /// What sets 20 dBm, and what would set 25.
    sets: [&'static str; 2],
    refusal: &'static str,
}

const SETTINGS: &str = "least = 7\nmost = 30";

const BACKENDS: [Backend; 4] = [
    Backend {
        name: "attenuator, telnet",
        kind: "attenuator\"\nsource_dbm = 30\nleast = 0\nmost = 60",
        table: "[attenuator]\nADDRESS\noff_db = 90",
        form: Form::Lines,
        greeting: b"",
        off: ":SETATT=90",
        reads: ":ATT?",
        sets: [":SETATT=10.00", ":SETATT=5.00"],
        refusal: "0\r\n",
    },
    Backend {
        name: "attenuator, http",
        kind: "attenuator\"\nsource_dbm = 30\nleast = 0\nmost = 60",
        table: "[attenuator]\nADDRESS\nhttp = true\noff_db = 90",
        form: Form::Http,
        greeting: b"",
        off: ":SETATT=90",
        reads: ":ATT?",
        sets: [":SETATT=10.00", ":SETATT=5.00"],
        refusal: "0",
    },
    Backend {
        name: "json_rpc",
        kind: "json_rpc",
        table: "[json_rpc]\nADDRESS\non = '{\"method\":\"transmit\",\"params\":[\"1\"]}'\n\
                off = '{\"method\":\"transmit\",\"params\":[\"0\"]}'\nread_off = '{\"method\":\"transmit\"}'",
        form: Form::Http,
        greeting: b"",
        off: "\"transmit\",\"params\":[\"0\"]",
        reads: "read_power_dBm",
        sets: ["[\"20\"]", "[\"25\"]"],
        refusal: r#"{"jsonrpc":"2.0","error":{"code":-1,"message":"INVALID_RANGE"},"id":"1"}"#,
    },
    Backend {
        name: "at, telnet",
        kind: "at",
        table: "[at]\nADDRESS\nuser = \"admin\"\npassword = \"microhard\"",
        form: Form::Lines,
        greeting: GREETING,
        off: "AT+MWRADIO=0",
        reads: "AT+MWTXPOWER?",
        sets: ["AT+MWTXPOWER=20", "AT+MWTXPOWER=25"],
        refusal: "ERROR: Invalid parameter\r\n",
    },
];

/// The device: it does wrong what it is to do wrong, and from its off on nothing more.
struct Device {
    wrong: Shared<Wrong>,
    told_off: Shared<Option<Instant>>,
}

fn handler(backend: &'static Backend, clock: Clock, device: &Device) -> Handler {
    let mut obedient: Handler = match backend.name {
        "json_rpc" => stream_caster(&shared(("30".to_owned(), true)), 0),
        "at, telnet" => microhard(&shared((30, true))),
        _ => mini_circuits(&shared(0.0)),
    };
    let (wrong, told_off) = (device.wrong.clone(), device.told_off.clone());
    Box::new(move |asked| {
        let mut wrong = wrong.lock().unwrap();
        if *wrong == Wrong::Never {
            return Reply::Hang;
        }
        if asked.contains(backend.off) {
            told_off.lock().unwrap().get_or_insert(clock.now());
            *wrong = Wrong::Nothing;
        }
        let (sets, reads) = (asked.contains(backend.sets[0]), asked.contains(backend.reads));
        match *wrong {
            Wrong::Error if sets => Reply::Text(backend.refusal.to_owned()),
            Wrong::OtherPower if sets => obedient(&asked.replace(backend.sets[0], backend.sets[1])),
            Wrong::Garbage if reads => Reply::Text("what?\r\nOK\r\n".to_owned()),
            Wrong::Late if reads => Reply::Hang,
            Wrong::MidLine if reads => Reply::Cut("+MW".to_owned()),
            Wrong::Flood if reads => Reply::Flood,
            _ => obedient(asked),
        }
    })
}

async fn misbehaves(backend: &'static Backend) {
    let clock = Clock::real();
    for wrong in Wrong::ALL {
        let device = Device { wrong: shared(Wrong::Nothing), told_off: shared(None) };
        let to = serve(backend.form, backend.greeting, handler(backend, clock.clone(), &device)).await;
        let settings = if backend.kind.contains("least") { "" } else { SETTINGS };
        let kind = match backend.kind.split_once('"') {
            Some((kind, more)) => format!("kind = \"{kind}\"{more}"),
            None => format!("kind = \"{}\"", backend.kind),
        };
        let table = backend.table.replace("ADDRESS", &format!("address = \"tcpout:127.0.0.1:{}\"", to.port));
        let name = format!("wrong-{wrong:?}-{}", backend.name.replace([' ', ','], "-"));
        let mut program =
            Program::of(&name, &format!("{kind}\n{settings}\noff_ms = 900\nchange_ms = 900\n{table}\n"));
        let mut companion = Companion::new(program.port, 5, None).await;
        companion.report().await;
        let before = companion.give(10.0, 4500).await;
        assert_eq!(before.power_mdbm, 10_000, "{} {wrong:?}: {}", backend.name, program.said());

        *device.told_off.lock().unwrap() = None;
        *device.wrong.lock().unwrap() = wrong;
        let asked = clock.now();
        let answer = companion.give(20.0, 4500).await;
        assert_eq!(answer.result, wrong.reason(), "{} {wrong:?}: {}", backend.name, program.said());
        let answered = clock.now().saturating_since(asked);
        if wrong == Wrong::Never {
            // What it may radiate at most, and not what anybody wishes.
            assert!(companion.report().await.power_mdbm >= 10_000, "{}", program.said());
            *device.wrong.lock().unwrap() = Wrong::Nothing;
        }
        while companion.report().await.power_mdbm != i32::MIN {}
        let off = clock.now().saturating_since(asked);
        // One that hears nothing is off when it hears again.
        let in_time = off < Duration::from_millis(4500) || wrong == Wrong::Never;
        assert!(in_time, "{} {wrong:?}: off after the lease's end: {}", backend.name, program.said());
        let told = companion.texts.join("; ");
        assert!(told.contains(wrong.words()), "{} {wrong:?}: {told:?}", backend.name);
        let told_off = device.told_off.lock().unwrap().expect("told off").saturating_since(asked);
        // And again in order; but one that goes where it was not told to go is not tried again soon.
        let after = companion.give(20.0, 4500).await;
        let expected = if wrong == Wrong::OtherPower { i32::MIN } else { 20_000 };
        assert_eq!(after.power_mdbm, expected, "{} {wrong:?}: {}", backend.name, program.said());
        // The device is served meanwhile.
        let ended = tokio::task::spawn_blocking(move || (program.terminate(), program.said())).await.unwrap();
        let (code, said) = ended;
        assert_eq!(code, Some(130), "{} {wrong:?}: {said}", backend.name);
        assert!(!said.contains("panicked") && said.contains("radio"), "{said}");
        println!(
            "{:<19} {:<10} answered {:>5} ms, told off {:>5} ms, off {:>5} ms: {:?} {told:?}",
            backend.name,
            format!("{wrong:?}"),
            answered.as_millis(),
            told_off.as_millis(),
            off.as_millis(),
            answer.result
        );
    }
}

#[tokio::test]
async fn spec_an_attenuator_that_misbehaves_over_telnet_is_told_off_and_the_companion_why() {
    misbehaves(&BACKENDS[0]).await;
}

#[tokio::test]
async fn spec_an_attenuator_that_misbehaves_by_http_is_told_off_and_the_companion_why() {
    misbehaves(&BACKENDS[1]).await;
}

#[tokio::test]
async fn spec_a_radio_by_json_that_misbehaves_is_told_off_and_the_companion_why() {
    misbehaves(&BACKENDS[2]).await;
}

#[tokio::test]
async fn spec_a_modem_that_misbehaves_is_told_off_and_the_companion_why() {
    misbehaves(&BACKENDS[3]).await;
}
