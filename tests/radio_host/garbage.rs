//! Devices that do not behave: every backend, every kind of answer. Nothing panics or waits for ever once it is told off, and
//! the kind of fault is right.

use tokio::sync::mpsc::unbounded_channel;
use veilwing::radio_device::attenuator::{Access, Attenuator};
use veilwing::radio_device::json_rpc::JsonRpc;
use veilwing::radio_device::{AnyDevice, Device, at, attenuator, command, drive};
use veilwing::radio_host::{Facts, Fault, Host, Order, Outcome, Scale, Settings};
use veilwing::time::Instant;

use crate::backends::{
    GREETING, directory, microhard, microhard_settings, mini_circuits, programs, stream_caster,
    stream_caster_settings,
};
use crate::server::{Form, Handler, Reply, serve, shared, tcp};

#[derive(Debug, Clone, Copy, PartialEq)]
enum Backend {
    Telnet,
    Http,
    Json,
    Modem,
}

const BACKENDS: [Backend; 4] = [Backend::Telnet, Backend::Http, Backend::Json, Backend::Modem];

/// A device of this kind that behaves until `misbehaves` says otherwise of what it is asked.
async fn device(
    kind: Backend,
    mut misbehaves: impl FnMut(&str) -> Option<Reply> + Send + 'static,
) -> AnyDevice {
    let mut obedient: Handler = match kind {
        Backend::Telnet | Backend::Http => mini_circuits(&shared(0.0)),
        Backend::Json => stream_caster(&shared(("30".to_owned(), true)), 0),
        Backend::Modem => microhard(&shared((30, true))),
    };
    let handler: Handler = Box::new(move |asked| misbehaves(asked).unwrap_or_else(|| obedient(asked)));
    let form = if matches!(kind, Backend::Telnet | Backend::Modem) { Form::Lines } else { Form::Http };
    let greeting = if kind == Backend::Modem { GREETING } else { b"" };
    let to = serve(form, greeting, handler).await;
    match kind {
        Backend::Telnet => AnyDevice::Attenuator(Attenuator::new(attenuator::Settings {
            access: Access::Lines(tcp(&to)),
            off_db: 90.0,
        })),
        Backend::Http => AnyDevice::Attenuator(Attenuator::new(attenuator::Settings {
            access: Access::Http { to, password: None },
            off_db: 90.0,
        })),
        Backend::Json => AnyDevice::JsonRpc(JsonRpc::new(stream_caster_settings(to))),
        Backend::Modem => AnyDevice::At(at::Modem::new(microhard_settings(&to))),
    }
}

/// Whether it asks for the power in force.
fn reads(asked: &str) -> bool {
    [":ATT?", "read_power_dBm", "AT+MWTXPOWER?"].iter().any(|question| asked.contains(question))
}

#[tokio::test]
async fn spec_garbage_is_named_and_never_taken_for_a_power() {
    let answers = [
        (Reply::Text("what?\r\nOK\r\n".to_owned()), Fault::Garbled),
        (Reply::Text("\u{1}\u{2}\u{7f}%s%n\r\nOK\r\n".to_owned()), Fault::Garbled),
        (Reply::Text("NaN\r\nOK\r\n".to_owned()), Fault::Garbled),
        (Reply::Cut("1".to_owned()), Fault::Unreachable),
        (Reply::Cut(String::new()), Fault::Unreachable),
        (Reply::Flood, Fault::Garbled),
    ];
    for kind in BACKENDS {
        for (answer, fault) in &answers {
            let reply = answer.clone();
            let mut device = device(kind, move |asked| reads(asked).then(|| reply.clone())).await;
            let found = device.set(20.0).await.map_err(|error| error.fault());
            // By HTTP a text that is cut is a text: it is not JSON, or another attenuation than was set.
            match (kind, answer, &found) {
                (Backend::Http, Reply::Cut(text), Ok(read)) => assert_eq!(*read, text.parse().ok()),
                (Backend::Http | Backend::Json, Reply::Cut(_), Err(found)) => {
                    assert_eq!(*found, Fault::Garbled)
                }
                _ => assert_eq!(found, Err(*fault), "{kind:?} {answer:?}"),
            }
        }
    }
}

#[tokio::test]
async fn spec_a_device_that_hangs_is_told_off_on_a_connection_of_its_own() {
    for kind in BACKENDS {
        let device = device(kind, |asked| reads(asked).then_some(Reply::Hang)).await;
        // An attenuator is read back for off as well: it hangs there, and is told again.
        let can_be_off = !matches!(kind, Backend::Telnet | Backend::Http);
        let (orders, told) = unbounded_channel();
        let (outcomes, mut said) = unbounded_channel();
        let task = tokio::spawn(drive(device, told, outcomes));
        let mut host = host();
        orders.send(host.poll_order().unwrap()).unwrap();
        if can_be_off {
            let (first, outcome) = said.recv().await.unwrap();
            assert_eq!(outcome, Outcome::Off, "{kind:?}");
            host.handle_outcome(first, outcome, Instant::ZERO);
            assert!(host.is_off());
            // Hangs; then off pre-empts it.
            let set = (first, Order::Set(scale().at_most(20.0).unwrap()));
            orders.send(set).unwrap();
            orders.send((first, Order::Off)).unwrap();
            assert_eq!(said.recv().await, Some((first, Outcome::Off)), "{kind:?}");
        }
        drop(orders);
        task.await.unwrap();
    }
}

#[tokio::test]
async fn spec_a_program_that_never_ends_or_says_too_much_is_killed_with_all_that_it_started() {
    let path = directory("endless");
    let shell = |script: &str| ["sh", "-c", script, path.to_str().unwrap()].map(str::to_owned).to_vec();
    let endless = command::Settings {
        set: shell(r#"(echo started > "$0/started"; sleep 1000) & wait"#),
        ..programs(&path)
    };
    let (orders, told) = unbounded_channel();
    let (outcomes, mut said) = unbounded_channel();
    let task = tokio::spawn(drive(command::Program::new(endless), told, outcomes));
    let (id, _) = host().poll_order().unwrap();
    orders.send((id, Order::Set(scale().at_most(20.0).unwrap()))).unwrap();
    while !path.join("started").exists() {
        tokio::task::yield_now().await;
    }
    orders.send((id, Order::Off)).unwrap();
    assert_eq!(said.recv().await, Some((id, Outcome::Off)));
    drop(orders);
    task.await.unwrap();

    let flood = command::Settings { read: shell("head -c 10000000 /dev/zero"), ..programs(&path) };
    assert_eq!(command::Program::new(flood).set(1.0).await.unwrap_err().fault(), Fault::Garbled);
    let complains =
        command::Settings { set: shell("head -c 10000000 /dev/zero >&2; exit 1"), ..programs(&path) };
    assert_eq!(command::Program::new(complains).set(1.0).await.unwrap_err().fault(), Fault::Refused);
    std::fs::remove_dir_all(path).unwrap();
}

pub fn scale() -> Scale {
    Scale::linear(&[0.0, 10.0, 20.0], 0.0, 1.0).unwrap()
}

/// A host, for its orders.
pub fn host() -> Host {
    let ms = std::time::Duration::from_millis;
    let facts = Facts {
        least_dbm: 0.0,
        most_dbm: 20.0,
        off: ms(50),
        change: ms(50),
        reads_back: true,
        dead: None,
        band_khz: None,
    };
    let settings = Settings {
        own: (1, 68),
        commanders: Vec::new(),
        operators: Vec::new(),
        signed: false,
        command: 31_010,
        facts,
        scale: scale(),
        below_db: 0.5,
        line: None,
        killed: false,
        seed: 1,
        clock_began_ms: 0,
    };
    Host::new(settings, Instant::ZERO)
}
