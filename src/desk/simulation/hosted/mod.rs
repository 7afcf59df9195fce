//! A radio host and its device in virtual time: the host's own state machine, fed bytes and instants, and a device that is
//! told without a protocol between them.

mod device;

use std::time::Duration;

use mavlink::dialects::ardupilotmega::{COMMAND_INT_DATA, MavCmd, MavMessage};

use crate::link::codec::{Decoder, Encoder};
use crate::link::counters::Counters;
use crate::link::envelope::Enclosed;
use crate::link::{Aboard, Form};
use crate::radio_host::{COMPONENT, Facts, Fault, Host, Order, OrderId, Outcome, Said, Scale, Settings};
use crate::role::Role;
use crate::time::Instant;
use crate::transmitter::wire;

pub use device::{DeviceModel, SimulatedDevice};

use super::fault::RadioFault;
use super::index;

/// What such a device can be set to: hundredths of a dB, from -20 dBm to 30 dBm.
const LEAST_DBM: f64 = -20.0;
const HUNDREDTHS: u32 = 5000;
/// The host declares so much more than its device takes.
const MARGIN: Duration = Duration::from_millis(1);
/// As far as a device's reading may be below what was set.
const BELOW_DB: f64 = 0.5;

/// What the newest power command that has come through asks to radiate for.
#[derive(Debug, Clone, Default)]
pub struct Asked {
    frames: Decoder<Aboard>,
    counters: Counters,
    slot: Option<u16>,
}

impl Asked {
    /// Takes a datagram on its way to a radio.
    pub fn hear(&mut self, bytes: &[u8]) {
        self.frames.feed(bytes);
        self.frames.end();
        while let Some(raw) = self.frames.next_frame(&mut self.counters) {
            if let Ok(frame) = raw.parse::<Aboard>()
                && let Aboard::Common(MavMessage::COMMAND_INT(COMMAND_INT_DATA {
                    command: MavCmd::MAV_CMD_USER_1,
                    param1,
                    x,
                    ..
                })) = frame.message
                && param1.is_finite()
            {
                self.slot = u16::try_from(x).ok();
            }
        }
    }

    /// The slot.
    #[must_use]
    pub fn slot(&self) -> Option<u16> {
        self.slot
    }
}

/// The line between host and device.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Line {
    Good,
    Cut,
    /// Nothing comes back.
    Mute,
}

/// An order that the device has not done yet.
#[derive(Debug, Clone, Copy)]
struct UnderWay {
    id: OrderId,
    order: Order,
    told: bool,
}

/// See the module.
#[derive(Debug)]
pub struct Hosted {
    /// `None`: killed.
    host: Option<Host>,
    stopped: bool,
    own: (u8, u8),
    began: Duration,
    frames: Decoder<Aboard>,
    counters: Counters,
    encoder: Encoder,
    device: SimulatedDevice,
    line: Line,
    under_way: Option<UnderWay>,
    asked: Asked,
}

impl Hosted {
    /// A host that has just been started beside such a device. `None` never comes of the settings that are filled in here.
    #[must_use]
    pub fn start(role: Role, model: DeviceModel, seed: u64, now: Duration) -> Option<Self> {
        let own = (1 + index(role) as u8, COMPONENT);
        let values: Vec<f64> = (0..=HUNDREDTHS).map(|k| LEAST_DBM + f64::from(k) * 0.01).collect();
        let scale = Scale::linear(&values, 0.0, 1.0).ok()?;
        let settings = Settings {
            own,
            commanders: Vec::new(),
            operators: Vec::new(),
            signed: false,
            command: MavCmd::MAV_CMD_USER_1 as u16,
            facts: Facts {
                least_dbm: scale.least_dbm(),
                most_dbm: scale.most_dbm(),
                off: model.off + MARGIN,
                change: model.change + MARGIN,
                reads_back: true,
                dead: model.dead,
                band_khz: None,
            },
            scale,
            below_db: BELOW_DB,
            line: None,
            killed: false,
            seed: seed.wrapping_mul(2).wrapping_add(index(role) as u64),
            clock_began_ms: 70_000,
        };
        Some(Self {
            host: Some(Host::new(settings, Instant::ZERO)),
            stopped: false,
            own,
            began: now,
            frames: Decoder::default(),
            counters: Counters::default(),
            encoder: Encoder::default(),
            device: SimulatedDevice::new(model),
            line: Line::Good,
            under_way: None,
            asked: Asked::default(),
        })
    }

    /// Its device.
    #[must_use]
    pub fn device(&self) -> &SimulatedDevice {
        &self.device
    }

    /// The slot for which it was told to radiate last.
    #[must_use]
    pub fn slot(&self) -> Option<u16> {
        self.asked.slot()
    }

    /// Whether it takes what arrives: a stopped one lets it wait.
    #[must_use]
    pub fn listens(&self) -> bool {
        !self.stopped
    }

    /// What befalls it begins, or is over. Its link is not its own.
    pub fn befall(&mut self, fault: RadioFault, on: bool, now: Duration) {
        match fault {
            RadioFault::HostKill if on => {
                self.host = None;
                self.device.lose_host(true, now);
            }
            RadioFault::HostStop => {
                self.stopped = on;
                if self.host.is_some() {
                    self.device.lose_host(on, now);
                }
            }
            RadioFault::DeviceKill if on => {
                self.device.fail(true, now);
                self.device.die(now);
            }
            RadioFault::DeviceStop => {
                self.device.fail(on, now);
                self.device.stop(on, now);
            }
            RadioFault::DeviceLoss | RadioFault::DeviceMute => {
                let bad = if fault == RadioFault::DeviceLoss { Line::Cut } else { Line::Mute };
                self.line = if on { bad } else { Line::Good };
                self.device.fail(on, now);
            }
            RadioFault::HostKill | RadioFault::DeviceKill | RadioFault::HostLoss => {}
        }
    }

    fn instant(&self, now: Duration) -> Instant {
        Instant::from_start(now.saturating_sub(self.began))
    }

    /// Takes a datagram of the companion's.
    pub fn hear(&mut self, bytes: &[u8], now: Duration) {
        let at = self.instant(now);
        self.asked.hear(bytes);
        let Some(host) = &mut self.host else { return };
        self.frames.feed(bytes);
        self.frames.end();
        while let Some(raw) = self.frames.next_frame(&mut self.counters) {
            if let Ok(frame) = raw.parse::<Aboard>()
                && let Aboard::Common(message) = &frame.message
            {
                host.handle_message(frame.header, message, at);
            }
        }
    }

    /// Everything that is due, and the datagrams that it sends.
    pub fn run(&mut self, now: Duration) -> Vec<Vec<u8>> {
        let at = self.instant(now);
        let mut said = Vec::new();
        loop {
            self.device.advance(now);
            let outcome = self.outcome(now);
            let Some(host) = self.host.as_mut().filter(|_| !self.stopped) else { return said };
            if let Some((id, outcome)) = outcome {
                self.under_way = None;
                host.handle_outcome(id, outcome, at);
            }
            while let Some((id, order)) = host.poll_order() {
                self.under_way = Some(UnderWay { id, order, told: false });
            }
            while let Some(message) = host.poll_transmit() {
                let message = aboard(message, self.own);
                said.push(self.encoder.encode(self.own, &message).raw_bytes().to_vec());
            }
            while host.poll_notice().is_some() {}
            if host.poll_timeout().0 <= at {
                host.handle_timeout(at);
            } else if self.outcome(now).is_none() {
                return said;
            }
        }
    }

    /// Tells the device what it has not been told yet, and what became of that.
    fn outcome(&mut self, now: Duration) -> Option<(OrderId, Outcome)> {
        let under_way = self.under_way.as_mut()?;
        if self.line == Line::Cut {
            return None;
        }
        if self.device.is_dead() {
            return Some((under_way.id, Outcome::Failed(Fault::Unreachable)));
        }
        if !self.device.runs() {
            return None;
        }
        if !std::mem::replace(&mut under_way.told, true) {
            let dbm = match under_way.order {
                Order::Off => None,
                Order::Set(setting) => Some(setting.dbm),
            };
            self.device.tell(dbm, now);
        }
        if !self.device.is_done() || self.line == Line::Mute {
            return None;
        }
        let outcome = match (under_way.order, self.device.power_dbm()) {
            (Order::Off, None) => Outcome::Off,
            (Order::Off, Some(_)) => Outcome::Failed(Fault::StillOn),
            (Order::Set(_), Some(dbm)) => Outcome::Set { read_back: Some(dbm) },
            (Order::Set(_), None) => Outcome::Failed(Fault::OtherPower),
        };
        Some((under_way.id, outcome))
    }

    /// When it next has something to do.
    #[must_use]
    pub fn next(&self) -> Option<Duration> {
        let host = self.host.as_ref().filter(|_| !self.stopped);
        let host = host.map(|host| host.poll_timeout().0.since_start() + self.began);
        [host, self.device.next()].into_iter().flatten().min()
    }
}

fn aboard(said: Said, own: (u8, u8)) -> Aboard {
    match said {
        Said::Common(message) => Aboard::Common(*message),
        Said::Report(report) => {
            Aboard::Radio(Enclosed::new(Form::Plain, own, 0, wire::MavMessage::VEILWING_RADIO(report)))
        }
    }
}
