//! A host on the bench: a companion that numbers commands, and a device that obeys when it is let.

use std::time::Duration;

use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::{COMMAND_INT_DATA, COMMAND_LONG_DATA, MavCmd, MavMessage};

use crate::radio_host::{Facts, Fault, Host, Level, Notice, Order, OrderId, Outcome, Said, Scale, Settings};
use crate::time::Instant;
use crate::transmitter::wire::{VEILWING_RADIO_DATA, VeilwingRadioResult};

pub const OWN: (u8, u8) = (1, 68);
pub const COMPANION: (u8, u8) = (1, 191);
pub const OFF: i32 = i32::MIN;
pub const OFF_MS: u64 = 50;
pub const CHANGE_MS: u64 = 80;

pub fn ms(ms: u64) -> Duration {
    Duration::from_millis(ms)
}

pub fn settings() -> Settings {
    let values: Vec<f64> = (0..=30).map(f64::from).collect();
    let scale = Scale::linear(&values, 0.0, 1.0).unwrap();
    let facts = Facts {
        least_dbm: scale.least_dbm(),
        most_dbm: scale.most_dbm(),
        off: ms(OFF_MS),
        change: ms(CHANGE_MS),
        reads_back: true,
        dead: None,
        band_khz: Some([902_000.0, 928_000.0]),
    };
    Settings {
        own: OWN,
        commanders: Vec::new(),
        operators: Vec::new(),
        signed: false,
        command: 31_010,
        facts,
        scale,
        below_db: 0.5,
        line: None,
        killed: false,
        seed: 7,
        clock_began_ms: 70_000,
    }
}

/// The host, the time, and what it has said and told.
pub struct Stand {
    pub host: Host,
    pub now: Instant,
    pub orders: Vec<(OrderId, Order)>,
    /// What the kill line was driven to, and when.
    pub line: Vec<(Instant, Level)>,
    /// Whether it obeys.
    pub line_obeys: bool,
    pub reports: Vec<VEILWING_RADIO_DATA>,
    pub common: Vec<MavMessage>,
    pub notices: Vec<Notice>,
    pub boot: u32,
    pub number: u32,
    /// The device obeys by itself, so long after an order.
    pub obeys_after: Option<Duration>,
    told_at: Option<(Instant, OrderId, Order)>,
}

impl Stand {
    /// With a device that was told off and is.
    pub fn new() -> Self {
        Self::with(settings())
    }

    pub fn with(settings: Settings) -> Self {
        let mut stand = Self::raw(settings);
        stand.run(1);
        assert!(stand.host.is_off());
        stand.forget();
        stand
    }

    /// As it starts, its device answering at once.
    pub fn raw(settings: Settings) -> Self {
        let now = Instant::from_start(ms(10));
        let host = Host::new(settings, now);
        Self {
            host,
            now,
            orders: Vec::new(),
            line: Vec::new(),
            line_obeys: true,
            reports: Vec::new(),
            common: Vec::new(),
            notices: Vec::new(),
            boot: 5,
            number: 0,
            obeys_after: Some(Duration::ZERO),
            told_at: None,
        }
    }

    pub fn forget(&mut self) {
        self.orders.clear();
        self.line.clear();
        self.reports.clear();
        self.common.clear();
        self.notices.clear();
    }

    /// Takes out what the host has to say, and lets the device do what is due.
    pub fn drain(&mut self) {
        loop {
            while let Some(level) = self.host.poll_line() {
                self.line.push((self.now, level));
                self.host.handle_line(level, self.line_obeys, self.now);
            }
            while let Some(said) = self.host.poll_transmit() {
                match said {
                    Said::Common(message) => self.common.push(*message),
                    Said::Report(report) => self.reports.push(report),
                }
            }
            self.notices.extend(std::iter::from_fn(|| self.host.poll_notice()));
            while let Some((id, order)) = self.host.poll_order() {
                self.orders.push((id, order));
                self.told_at = Some((self.now, id, order));
            }
            let Some((at, id, order)) = self.told_at else { return };
            if self.obeys_after.is_none_or(|after| self.now < at + after) {
                return;
            }
            self.told_at = None;
            self.host.handle_outcome(id, obeyed(order), self.now);
        }
    }

    /// Lets so many milliseconds pass.
    pub fn run(&mut self, millis: u64) {
        self.drain();
        for _ in 0..millis {
            self.now = self.now + ms(1);
            if self.host.poll_timeout().0 <= self.now {
                self.host.handle_timeout(self.now);
            }
            self.drain();
        }
    }

    /// The outcome of the last order.
    pub fn outcome(&mut self, outcome: Outcome) {
        let (id, _) = *self.orders.last().unwrap();
        self.told_at = None;
        self.host.handle_outcome(id, outcome, self.now);
        self.drain();
    }

    pub fn fails(&mut self, fault: Fault) {
        self.outcome(Outcome::Failed(fault));
    }

    pub fn clock_ms(&self) -> u32 {
        self.host.report(self.now).time_ms
    }

    /// A command of the companion's that counts, unless a field is changed.
    pub fn command(&mut self, dbm: f32, ahead_ms: i32) -> COMMAND_INT_DATA {
        self.number += 1;
        let expires_ms = self.clock_ms().wrapping_add_signed(ahead_ms);
        COMMAND_INT_DATA {
            param1: dbm,
            param2: self.number as f32,
            param3: self.boot as f32,
            param4: self.host.report(self.now).series as f32,
            x: 4,
            y: expires_ms.cast_signed(),
            command: MavCmd::MAV_CMD_USER_1,
            target_system: OWN.0,
            target_component: OWN.1,
            ..COMMAND_INT_DATA::DEFAULT
        }
    }

    pub fn give_by(&mut self, by: (u8, u8), command: COMMAND_INT_DATA) -> Option<VEILWING_RADIO_DATA> {
        self.say_by(by, &MavMessage::COMMAND_INT(command.clone()));
        let is_its =
            |report: &&VEILWING_RADIO_DATA| report.answers == command.param2 as u32 && report.answers != 0;
        self.reports.iter().rev().find(is_its).cloned()
    }

    pub fn give(&mut self, command: COMMAND_INT_DATA) -> Option<VEILWING_RADIO_DATA> {
        self.give_by(COMPANION, command)
    }

    pub fn say_by(&mut self, (system, component): (u8, u8), message: &MavMessage) {
        let header = MavHeader { system_id: system.into(), component_id: component, sequence: 0 };
        self.host.handle_message(header, message, self.now);
        self.drain();
    }

    pub fn on(&mut self, dbm: f32, ahead_ms: i32) -> Option<VEILWING_RADIO_DATA> {
        let command = self.command(dbm, ahead_ms);
        self.give(command)
    }

    pub fn off(&mut self) -> Option<VEILWING_RADIO_DATA> {
        let command = self.command(f32::NEG_INFINITY, 0);
        self.give(command)
    }

    pub fn power(&self) -> i32 {
        self.host.report(self.now).power_mdbm
    }
}

/// What a device that obeys says.
pub fn obeyed(order: Order) -> Outcome {
    match order {
        Order::Off => Outcome::Off,
        Order::Set(setting) => Outcome::Set { read_back: Some(setting.value) },
    }
}

pub fn kill(target: (u8, u8), param1: f32) -> MavMessage {
    MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
        param1,
        command: MavCmd::MAV_CMD_USER_2,
        target_system: target.0,
        target_component: target.1,
        ..COMMAND_LONG_DATA::DEFAULT
    })
}

/// The end of a result's name.
pub fn result(report: &Option<VEILWING_RADIO_DATA>) -> VeilwingRadioResult {
    report.as_ref().expect("it was answered").result
}
