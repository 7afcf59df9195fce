//! Radios with a power parameter that behave as their makers' sources say, and such that do not.

use mavlink::dialects::ardupilotmega::{
    MavMessage, MavParamExtType, MavParamType, PARAM_EXT_ACK_DATA, PARAM_EXT_VALUE_DATA, PARAM_VALUE_DATA,
    ParamAck,
};
use tokio::sync::mpsc::unbounded_channel;
use veilwing::config::RadioFile;
use veilwing::link::{Aboard, Clock, HostPort, Link, LinkAddress, LinkConfig};
use veilwing::radio_device::parameter::{ByParameter, Off, Settings, Unit};
use veilwing::radio_device::{Device, drive};
use veilwing::radio_host::{Fault, Order, Outcome};
use veilwing::transmitter::Protocol;

use crate::backends::directory;
use crate::files::BY_LINE;
use crate::garbage::{host, scale};
use crate::host::free_port;
use crate::server::{Shared, shared};

/// What a radio does with its parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Habit {
    Obeys,
    /// Takes no more than this, and says so.
    Clips(f64),
    /// Takes nothing outside of these, and says so, as OpenHD.
    Within(f64, f64),
    /// Hears every second message.
    Deaf,
    /// Says nothing.
    Silent,
    /// Says no number.
    Garbage,
    /// Has another component say it.
    Other,
    /// Says to each of the next questions what it had before.
    Behind(u8),
}

#[derive(Debug, Clone)]
pub struct Radio {
    pub habit: Habit,
    pub value: f64,
    before: f64,
    protocol: Protocol,
    pub set: Vec<f64>,
    heard: u32,
}

/// Where the device is that listens at `port`, and what it has.
pub fn radio(protocol: Protocol, habit: Habit, port: u16) -> Shared<Radio> {
    let state = shared(Radio { habit, value: 3.0, before: 3.0, protocol, set: Vec::new(), heard: 0 });
    let own = state.clone();
    tokio::spawn(async move {
        let to = LinkAddress::UdpOut(HostPort { host: "127.0.0.1".to_owned(), port });
        let clock = Clock::real();
        let mut link = Link::<Aboard>::open(to, LinkConfig::default(), clock.clone()).await.unwrap();
        let mut beat_at = clock.now();
        loop {
            tokio::select! {
                // Heard by whoever waits at the port.
                () = clock.sleep_until(beat_at) => {
                    link.send((51, 68), &Aboard::Common(MavMessage::HEARTBEAT(Default::default())));
                    beat_at = clock.now() + std::time::Duration::from_millis(20);
                }
                frame = link.recv() => {
                    let Aboard::Common(message) = frame.message else { continue };
                    let answer = own.lock().unwrap().answer(&message);
                    if let Some((component, answer)) = answer {
                        link.send((51, component), &Aboard::Common(answer));
                    }
                }
            }
        }
    });
    state
}

impl Radio {
    fn answer(&mut self, message: &MavMessage) -> Option<(u8, MavMessage)> {
        let asked = match (message, self.protocol) {
            (MavMessage::PARAM_REQUEST_READ(_), Protocol::Classic | Protocol::Bytewise)
            | (MavMessage::PARAM_EXT_REQUEST_READ(_), Protocol::Extended) => None,
            (MavMessage::PARAM_SET(m), Protocol::Classic) => Some(f64::from(m.param_value)),
            // The first byte of the float is the integer.
            (MavMessage::PARAM_SET(m), Protocol::Bytewise) => Some(f64::from(m.param_value.to_le_bytes()[0])),
            (MavMessage::PARAM_EXT_SET(m), Protocol::Extended) => {
                let mut bytes = [0; 4];
                bytes.copy_from_slice(&m.param_value[..4]);
                Some(f64::from(i32::from_le_bytes(bytes)))
            }
            _ => return None,
        };
        self.heard += 1;
        let mut result = ParamAck::PARAM_ACK_ACCEPTED;
        match (self.habit, asked) {
            (Habit::Silent, _) => return None,
            (Habit::Deaf, _) if self.heard % 2 == 1 => return None,
            (Habit::Within(least, most), Some(value)) if !(least..=most).contains(&value) => {
                result = ParamAck::PARAM_ACK_VALUE_UNSUPPORTED;
            }
            (_, Some(value)) => {
                let most = if let Habit::Clips(most) = self.habit { most } else { f64::INFINITY };
                self.before = std::mem::replace(&mut self.value, value.min(most));
                self.set.push(self.value);
            }
            (_, None) => {}
        }
        let said = match &mut self.habit {
            Habit::Behind(more) if *more > 0 => {
                *more -= 1;
                self.before
            }
            _ => self.value,
        };
        let component = if self.habit == Habit::Other { 67 } else { 68 };
        Some((component, self.says(said, asked.is_some(), result)))
    }

    fn says(&self, value: f64, was_set: bool, param_result: ParamAck) -> MavMessage {
        let param_id = "TX_POWER".into();
        if self.protocol == Protocol::Extended {
            let mut param_value = [0; 128];
            param_value[..4].copy_from_slice(&(value as i32).to_le_bytes());
            let (param_value, param_type) = (param_value.into(), MavParamExtType::MAV_PARAM_EXT_TYPE_INT32);
            return if was_set {
                MavMessage::PARAM_EXT_ACK(PARAM_EXT_ACK_DATA {
                    param_id,
                    param_value,
                    param_type,
                    param_result,
                })
            } else {
                let rest = PARAM_EXT_VALUE_DATA {
                    param_count: 1,
                    param_index: 0,
                    param_id,
                    param_value,
                    param_type,
                };
                MavMessage::PARAM_EXT_VALUE(rest)
            };
        }
        let (param_value, param_type) = match self.protocol {
            Protocol::Bytewise => {
                (f32::from_le_bytes([value as u8, 0, 0, 0]), MavParamType::MAV_PARAM_TYPE_UINT8)
            }
            _ => (value as f32, MavParamType::MAV_PARAM_TYPE_REAL32),
        };
        let param_value = if self.habit == Habit::Garbage && was_set { f32::NAN } else { param_value };
        let param_value = if self.habit == Habit::Garbage { param_value + f32::NAN } else { param_value };
        MavMessage::PARAM_VALUE(PARAM_VALUE_DATA {
            param_value,
            param_count: 1,
            param_index: 0,
            param_id,
            param_type,
        })
    }
}

fn settings(protocol: Protocol, unit: Unit, off: Off, port: u16) -> Settings {
    Settings {
        link: LinkAddress::UdpIn(HostPort { host: "127.0.0.1".to_owned(), port }),
        own: (1, 68),
        target: (51, 68),
        name: "TX_POWER".to_owned(),
        protocol,
        unit,
        off,
    }
}

fn pair(protocol: Protocol, unit: Unit, off: Off, habit: Habit) -> (ByParameter, Shared<Radio>) {
    let port = free_port();
    (ByParameter::new(settings(protocol, unit, off, port), Clock::real()), radio(protocol, habit, port))
}

#[tokio::test]
async fn spec_a_parameter_is_set_and_read_back_in_every_encoding() {
    for protocol in [Protocol::Extended, Protocol::Classic, Protocol::Bytewise] {
        let (mut device, radio) = pair(protocol, Unit::Setting, Off::Value(0.0), Habit::Obeys);
        device.off().await.unwrap();
        assert_eq!(device.set(5.0).await.unwrap(), Some(5.0), "{protocol:?}");
        assert_eq!(radio.lock().unwrap().value, 5.0);
        device.off().await.unwrap();
        assert_eq!(radio.lock().unwrap().set, [0.0, 5.0, 0.0], "{protocol:?}");
    }
}

#[tokio::test]
async fn spec_milliwatts_are_whole_never_more_than_asked_for_and_read_back_as_dbm() {
    let (mut device, radio) =
        pair(Protocol::Extended, Unit::Milliwatt, Off::Least(10.0), Habit::Within(10.0, 30_000.0));
    let read = device.set(14.0).await.unwrap().unwrap();
    assert_eq!(radio.lock().unwrap().value, 25.0, "of 25.12 mW");
    assert!((read - 13.979).abs() < 1e-3, "{read}");
    assert_eq!(device.set(20.0).await.unwrap(), Some(20.0));
    assert_eq!(radio.lock().unwrap().value, 100.0);
    // No off: the least that it takes.
    device.off().await.unwrap();
    assert_eq!(radio.lock().unwrap().value, 10.0);
    // A value that it does not take is no off.
    let (mut device, _radio) =
        pair(Protocol::Extended, Unit::Milliwatt, Off::Value(0.0), Habit::Within(10.0, 30_000.0));
    let error = device.off().await.unwrap_err();
    assert!(error.fault() == Fault::Refused && error.to_string().contains("TX_POWER = 0"), "{error}");
}

#[tokio::test]
async fn spec_what_is_lost_is_said_again_and_what_was_meant_for_before_is_not_believed() {
    let (mut device, radio) = pair(Protocol::Bytewise, Unit::Setting, Off::Value(0.0), Habit::Deaf);
    device.off().await.unwrap();
    assert_eq!(device.set(4.0).await.unwrap(), Some(4.0));
    assert_eq!(radio.lock().unwrap().value, 4.0);
    radio.lock().unwrap().habit = Habit::Behind(3);
    assert_eq!(device.set(7.0).await.unwrap(), Some(7.0), "three answers were older");
}

#[tokio::test]
async fn spec_another_value_than_was_set_is_what_is_read_back() {
    let (mut device, radio) = pair(Protocol::Classic, Unit::Setting, Off::Value(0.0), Habit::Clips(2.5));
    device.off().await.unwrap();
    assert_eq!(device.set(20.0).await.unwrap(), Some(2.5));
    radio.lock().unwrap().habit = Habit::Behind(u8::MAX);
    radio.lock().unwrap().value = 9.0;
    let error = device.off().await.unwrap_err();
    assert!(error.fault() == Fault::StillOn && error.to_string().contains("TX_POWER = 9"), "{error}");
}

#[tokio::test]
async fn spec_no_number_is_garbage_and_no_power() {
    let (mut device, _radio) = pair(Protocol::Classic, Unit::Setting, Off::Value(0.0), Habit::Garbage);
    assert_eq!(device.set(5.0).await.unwrap_err().fault(), Fault::Garbled);
    assert_eq!(device.off().await.unwrap_err().fault(), Fault::Garbled);
}

#[tokio::test]
async fn spec_a_radio_that_is_silent_or_another_component_is_not_believed_and_off_pre_empts() {
    for habit in [Habit::Silent, Habit::Other] {
        let (device, radio) = pair(Protocol::Bytewise, Unit::Setting, Off::Value(0.0), habit);
        let (orders, told) = unbounded_channel();
        let (outcomes, mut said) = unbounded_channel();
        let task = tokio::spawn(drive(device, told, outcomes));
        let (id, _) = host().poll_order().unwrap();
        orders.send((id, Order::Set(scale().at_most(20.0).unwrap()))).unwrap();
        // It is asked, and asked again.
        while radio.lock().unwrap().heard < 3 {
            tokio::task::yield_now().await;
        }
        radio.lock().unwrap().habit = Habit::Obeys;
        orders.send((id, Order::Off)).unwrap();
        let mut outcome = said.recv().await;
        if outcome != Some((id, Outcome::Off)) {
            // The power was set before the off was told.
            assert_eq!(outcome, Some((id, Outcome::Set { read_back: Some(20.0) })), "{habit:?}");
            outcome = said.recv().await;
        }
        assert_eq!(outcome, Some((id, Outcome::Off)), "{habit:?}");
        assert_eq!(radio.lock().unwrap().value, 0.0);
        drop(orders);
        task.await.unwrap();
    }
}

#[tokio::test]
async fn spec_without_an_off_the_radio_is_told_its_weakest_setting_by_the_calibration() {
    let path = directory("weakest");
    let port = free_port();
    let text = BY_LINE.replace("14580", &port.to_string()).replace("off_ms", "frequency_hz = 915e6\noff_ms");
    std::fs::write(path.join("radio.toml"), text + "[calibration]\nfile = \"measured.csv\"\n").unwrap();
    // Power falls with the level.
    std::fs::write(path.join("measured.csv"), "frequency_hz,setting,dbm\n915e6,10,20\n915e6,20,3\n").unwrap();
    let file = RadioFile::load(&path.join("radio.toml")).unwrap();
    let radio = radio(Protocol::Bytewise, Habit::Obeys, port);
    file.device(&Clock::real()).unwrap().off().await.unwrap();
    assert_eq!(radio.lock().unwrap().value, 20.0);
    std::fs::remove_dir_all(path).unwrap();
}
