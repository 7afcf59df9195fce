//! A radio host and its device in virtual time: the host's own state machine, fed bytes and instants, and a device that is
//! told without a protocol between them.

mod device;

use std::time::Duration;

use mavlink::dialects::ardupilotmega::{COMMAND_INT_DATA, MavCmd, MavMessage};

use crate::link::codec::{Decoder, Encoder};
use crate::link::counters::Counters;
use crate::link::envelope::Enclosed;
use crate::link::{Aboard, Form};
use crate::radio_host::{
    COMPONENT, Facts, Fault, Host, Level, LineTimes, Order, OrderId, Outcome, Said, Scale, Settings, Silence,
};
use crate::role::Role;
use crate::time::Instant;
use crate::transmitter::wire;

pub use device::{DeviceModel, OneShot, SimulatedDevice};

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

/// How host and device get on with each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Manners {
    /// As they should.
    Good,
    /// Nothing passes.
    Cut,
    /// Nothing comes back.
    Mute,
    /// The device refuses.
    Refuses,
    /// What it says cannot be understood.
    Garbled,
    /// It goes so many dB above what it is told: [`OTHER_DB`].
    Louder,
}

/// By how much a device that is louder than it is told is so.
pub const OTHER_DB: f64 = 3.0;

impl Manners {
    /// What a fault makes of them; `None`: nothing.
    fn of(fault: RadioFault) -> Option<Self> {
        match fault {
            RadioFault::DeviceLoss => Some(Self::Cut),
            RadioFault::DeviceMute => Some(Self::Mute),
            RadioFault::DeviceErrors => Some(Self::Refuses),
            RadioFault::DeviceGarbage => Some(Self::Garbled),
            RadioFault::DeviceOtherPower => Some(Self::Louder),
            RadioFault::HostKill
            | RadioFault::HostStop
            | RadioFault::HostLoss
            | RadioFault::DeviceKill
            | RadioFault::DeviceStop => None,
        }
    }

    /// What befalls a device, or its line to the host, begins (`on`), or is over. What befalls the host is not the device's.
    pub fn befall(&mut self, device: &mut SimulatedDevice, fault: RadioFault, on: bool, now: Duration) {
        match fault {
            RadioFault::DeviceKill if on => {
                device.fail(true, now);
                device.die(now);
            }
            RadioFault::DeviceStop => {
                device.fail(on, now);
                device.stop(on, now);
            }
            other => {
                if let Some(bad) = Self::of(other) {
                    *self = if on { bad } else { Self::Good };
                    device.fail(on, now);
                }
            }
        }
    }
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
    manners: Manners,
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
                // Off by the line alone is an off too: it is what ends a device that fails.
                off: model.line.map_or(model.off, |line| line.holds.max(model.off)) + MARGIN,
                change: model.change + MARGIN,
                reads_back: true,
                dead: model.declared_dead(),
                band_khz: None,
            },
            scale,
            below_db: BELOW_DB,
            line: model
                .line
                .map(|line| LineTimes { silence: Silence::WithoutEdges(line.holds), alone: line.alone }),
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
            manners: Manners::Good,
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
            other => self.manners.befall(&mut self.device, other, on, now),
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
            while let Some(level) = host.poll_line() {
                self.device.drive(level == Level::On, now);
                host.handle_line(level, true, at);
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
        // What it does for an off.
        let weakest = self.device.model().has_no_off().then_some(LEAST_DBM);
        let under_way = self.under_way.as_mut()?;
        if self.manners == Manners::Cut {
            return None;
        }
        if self.device.is_dead() {
            return Some((under_way.id, Outcome::Failed(Fault::Unreachable)));
        }
        if !self.device.runs() {
            return None;
        }
        if self.manners == Manners::Refuses {
            return Some((under_way.id, Outcome::Failed(Fault::Refused)));
        }
        if !std::mem::replace(&mut under_way.told, true) {
            let louder_db = if self.manners == Manners::Louder { OTHER_DB } else { 0.0 };
            let dbm = match under_way.order {
                Order::Off => weakest,
                Order::Set(setting) => Some(setting.dbm + louder_db),
            };
            self.device.tell(dbm, now);
        }
        if !self.device.is_done() || self.manners == Manners::Mute {
            return None;
        }
        if self.manners == Manners::Garbled {
            return Some((under_way.id, Outcome::Failed(Fault::Garbled)));
        }
        let outcome = match (under_way.order, self.device.power_dbm()) {
            (Order::Off, dbm) if dbm == weakest => Outcome::Off,
            (Order::Off, _) => Outcome::Failed(Fault::StillOn),
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
