//! The radio host's loop with a kill line of the test's: it is off though the device is not to be had, and one that does not obey
//! lets nothing through.

use std::os::unix::net::UnixDatagram;
use std::time::Duration;

use veilwing::config::RadioFile;
use veilwing::link::{Clock, Form, LinkConfig};
use veilwing::radio_device::Line;
use veilwing::radio_device::gpio::LineError;
use veilwing::radio_host::{Level, Settings};
use veilwing::radio_loop::{RadioProcess, Stopped};
use veilwing::systemd::Manager;
use veilwing::transmitter::Protocol;
use veilwing::transmitter::wire::VeilwingRadioResult as Is;

use crate::backends::directory;
use crate::files::BY_LINE;
use crate::host::{Companion, OWN, free_port};
use crate::parameter::{Habit, radio};
use crate::server::{Shared, shared};

/// A line that notes where it was driven, and obeys while it is let.
#[derive(Debug)]
struct Wire {
    driven: Shared<Vec<Level>>,
    obeys: Shared<bool>,
}

impl Line for Wire {
    fn drive(&mut self, level: Level) -> Result<(), LineError> {
        if !*self.obeys.lock().unwrap() {
            return Err(LineError::NotLinux);
        }
        self.driven.lock().unwrap().push(level);
        Ok(())
    }
}

/// The file's process, its companion's port, and its line.
fn process(
    text: &str,
    clock: &Clock,
    path: &std::path::Path,
) -> (RadioProcess<impl veilwing::radio_device::Device + use<>>, Shared<Vec<Level>>, Shared<bool>) {
    let file = RadioFile::parse("radio.toml", text).unwrap();
    let (driven, obeys) = (shared(Vec::new()), shared(true));
    let settings = Settings {
        own: OWN,
        commanders: Vec::new(),
        operators: Vec::new(),
        signed: false,
        command: 31_010,
        facts: file.facts(),
        scale: file.scale.clone(),
        below_db: 0.5,
        line: file.kill_line().map(|(_, times)| times),
        killed: false,
        seed: 1,
        clock_began_ms: 0,
    };
    let process = RadioProcess {
        link: (file.address.clone(), LinkConfig { peer_system: Some(1), ..LinkConfig::default() }),
        form: Form::Plain,
        settings,
        device: file.device(clock).unwrap(),
        line: Some(Box::new(Wire { driven: driven.clone(), obeys: obeys.clone() })),
        kill_file: path.join("radio.kill"),
        manager: Manager::none(),
    };
    (process, driven, obeys)
}

/// What the service manager was told, line by line.
fn hear(manager: &UnixDatagram, told: &mut Vec<String>) {
    let mut datagram = [0; 512];
    while let Ok(length) = manager.recv(&mut datagram) {
        told.extend(std::str::from_utf8(&datagram[..length]).unwrap().lines().map(str::to_owned));
    }
}

#[tokio::test]
async fn spec_a_radio_without_an_off_is_off_by_its_line_also_when_it_answers_no_more() {
    let path = directory("line");
    let (companion_port, radio_port) = (free_port(), free_port());
    let text = BY_LINE
        .replace("14570", &companion_port.to_string())
        .replace("14580", &radio_port.to_string())
        .replace("off_ms = 100\nchange_ms = 200", "off_ms = 2000\nchange_ms = 4000");
    let clock = Clock::real();
    let (process, driven, obeys) = process(&text, &clock, &path);
    let device = radio(Protocol::Bytewise, Habit::Obeys, radio_port);
    let (stop, stopped) = tokio::sync::oneshot::channel::<()>();
    let host = process.run(clock, async { stopped.await.unwrap() });
    let companion = async {
        let mut companion = Companion::new(companion_port, 5, None).await;
        companion.report().await;
        assert_eq!(companion.give(f32::NEG_INFINITY, 0).await.power_mdbm, i32::MIN);
        assert_eq!(*driven.lock().unwrap(), [Level::Off], "the first thing that it did");
        let on = companion.give(14.5, 4900).await;
        assert_eq!((on.result, on.power_mdbm), (Is::VEILWING_RADIO_RESULT_ACCEPTED, 14_000));
        assert_eq!(device.lock().unwrap().set.last(), Some(&14.0));
        assert_eq!(*driven.lock().unwrap(), [Level::Off, Level::On]);
        // It falls silent, at 14 dBm.
        device.lock().unwrap().habit = Habit::Silent;
        let off = companion.give(f32::NEG_INFINITY, 0).await;
        assert_eq!((off.result, off.power_mdbm), (Is::VEILWING_RADIO_RESULT_ACCEPTED, i32::MIN));
        assert_eq!(*driven.lock().unwrap(), [Level::Off, Level::On, Level::Off]);
        assert_eq!(device.lock().unwrap().value, 14.0, "as far as the radio goes");
        // It is back; the line is not.
        device.lock().unwrap().habit = Habit::Obeys;
        loop {
            *obeys.lock().unwrap() = false;
            let answer = companion.give(14.5, 4900).await;
            if answer.result == Is::VEILWING_RADIO_RESULT_DEVICE_ERROR {
                break;
            }
            // Its off was not confirmed yet, and came late.
            assert_eq!(answer.result, Is::VEILWING_RADIO_RESULT_DEVICE_LATE);
        }
        assert!(!driven.lock().unwrap()[3..].contains(&Level::On));
        *obeys.lock().unwrap() = true;
        stop.send(()).unwrap();
    };
    let (ended, ()) = tokio::join!(host, companion);
    assert_eq!(ended.unwrap(), Stopped::Off);
    assert_eq!(driven.lock().unwrap().last(), Some(&Level::Off));
    std::fs::remove_dir_all(path).unwrap();
}

#[tokio::test]
async fn spec_a_one_shot_is_fed_by_the_loop_itself_while_it_radiates() {
    let path = directory("one-shot");
    let (companion_port, radio_port) = (free_port(), free_port());
    let text = BY_LINE
        .replace("14570", &companion_port.to_string())
        .replace("14580", &radio_port.to_string())
        .replace("silent_ms = 5", "oneshot_ms = 2000")
        .replace("off_ms = 100\nchange_ms = 200", "off_ms = 2000\nchange_ms = 4000");
    let clock = Clock::real();
    let (mut process, driven, _obeys) = process(&text, &clock, &path);
    let (ours, manager) = UnixDatagram::pair().unwrap();
    manager.set_nonblocking(true).unwrap();
    process.manager = Manager::at(ours, Some(Duration::from_millis(400))).unwrap();
    let _device = radio(Protocol::Bytewise, Habit::Obeys, radio_port);
    let (stop, stopped) = tokio::sync::oneshot::channel::<()>();
    let host = process.run(clock.clone(), async { stopped.await.unwrap() });
    let companion = async {
        let mut told = Vec::new();
        let mut companion = Companion::new(companion_port, 5, None).await;
        companion.report().await;
        hear(&manager, &mut told);
        let on = companion.give(20.0, 4900).await;
        assert_eq!((on.result, on.power_mdbm), (Is::VEILWING_RADIO_RESULT_ACCEPTED, 20_000));
        let begun = clock.now();
        while driven.lock().unwrap().len() < 5 {
            companion.report().await;
            hear(&manager, &mut told);
        }
        let edges = driven.lock().unwrap().clone();
        assert_eq!(edges[..5], [Level::Off, Level::On, Level::Off, Level::On, Level::Off]);
        assert!(
            clock.now().saturating_since(begun) < Duration::from_secs(2),
            "three edges in half of its time"
        );
        hear(&manager, &mut told);
        stop.send(()).unwrap();
        told
    };
    let (ended, mut told) = tokio::join!(host, companion);
    assert_eq!(ended.unwrap(), Stopped::Off);
    hear(&manager, &mut told);
    let at = |word: &str| told.iter().position(|line| line.starts_with(word));
    assert!(at("READY=1") < at("STATUS=radio: commanded by") && at("STATUS") < at("STOPPING=1"), "{told:?}");
    let fed = told.iter().filter(|line| *line == "WATCHDOG=1").count();
    assert!(at("READY=1").is_some() && fed > 2, "{told:?}");
    std::fs::remove_dir_all(path).unwrap();
}
