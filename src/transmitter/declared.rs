//! What a radio declares of itself by parameters (docs/radio.md), asked for at the start and once it is heard.

use std::collections::VecDeque;
use std::time::Duration;

use mavlink::dialects::ardupilotmega::{MavMessage, PARAM_VALUE_DATA};

use super::parameter_protocol::{self, Protocol};
use crate::time::Instant;
use crate::units::{Dbm, Watts};

const ATTEMPTS: u8 = 5;
const INTERVAL: Duration = Duration::from_secs(1);

/// What a radio can declare. The discriminants are places in [`Declared`]'s table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Fact {
    /// The largest power, in dBm.
    MaxDbm,
    /// The least power above off, in dBm.
    MinDbm,
    /// The longest time from an off, or from an expiry, to silence, in ms.
    OffMs,
    /// The longest time from a command to the new power, in ms.
    ChangeMs,
    /// 1: the power in its answers is read back from the device; 0: it is what was set.
    ReadBack,
    /// The longest time to silence when the host itself dies, in ms; negative: never by itself.
    DeadMs,
    /// The lowest frequency at which the device radiates, in kHz; negative: not known.
    BandLowKhz,
    /// The highest, likewise.
    BandHighKhz,
}

impl Fact {
    const ALL: [Self; 8] = [
        Self::MaxDbm,
        Self::MinDbm,
        Self::OffMs,
        Self::ChangeMs,
        Self::ReadBack,
        Self::DeadMs,
        Self::BandLowKhz,
        Self::BandHighKhz,
    ];

    /// The parameter that says it.
    pub fn parameter(self) -> &'static str {
        match self {
            Self::MaxDbm => "TX_MAX_DBM",
            Self::MinDbm => "TX_MIN_DBM",
            Self::OffMs => "TX_OFF_MS",
            Self::ChangeMs => "TX_CHANGE_MS",
            Self::ReadBack => "TX_READ_BACK",
            Self::DeadMs => "TX_DEAD_MS",
            Self::BandLowKhz => "TX_BAND_LO_KHZ",
            Self::BandHighKhz => "TX_BAND_HI_KHZ",
        }
    }
}

/// What the radio has declared so far.
#[derive(Debug, Clone, Default)]
pub(super) struct Declared {
    values: [Option<f32>; Fact::ALL.len()],
    asked: u8,
    ask_at: Option<Instant>,
}

impl Declared {
    /// To be asked for from `ask_at` on; never: it cannot be.
    pub fn new(ask_at: Option<Instant>) -> Self {
        Self { ask_at, ..Self::default() }
    }

    /// Asks for everything anew, unless that has just begun: the radio was not there before, or may be another one. What is
    /// known holds until then.
    pub fn ask_again(&mut self, now: Instant) {
        if self.ask_at.is_none() || self.asked > 1 {
            (self.asked, self.ask_at) = (0, self.ask_at.or(Some(now)));
        }
    }

    pub fn get(&self, fact: Fact) -> Option<f32> {
        self.values[fact as usize]
    }

    /// The largest power, in watts.
    pub fn limit_w(&self) -> Option<f64> {
        self.get(Fact::MaxDbm).map(|dbm| Watts::from(Dbm(dbm.into())).0)
    }

    /// From an off or an expiry to silence; zero where it is not declared.
    pub fn off(&self) -> Duration {
        self.time(Fact::OffMs)
    }

    /// For how long J waits after a power is answered: until the device has it, where the answer does not say that it does.
    pub fn settling(&self) -> Duration {
        let read_back = self.get(Fact::ReadBack).is_some_and(|read_back| read_back > 0.0);
        if read_back { Duration::ZERO } else { self.time(Fact::ChangeMs) }
    }

    fn time(&self, fact: Fact) -> Duration {
        let ms = self.get(fact).map_or(0.0, f64::from);
        Duration::try_from_secs_f64(ms * 1e-3).unwrap_or_default()
    }

    /// How many are still asked for.
    pub fn awaited(&self) -> usize {
        if self.ask_at.is_some() { self.missing().count() } else { 0 }
    }

    /// What it has not declared.
    pub fn missing(&self) -> impl Iterator<Item = Fact> {
        Fact::ALL.into_iter().filter(|fact| self.get(*fact).is_none())
    }

    /// Whether it declares anything beside its largest power.
    pub fn is_made(&self) -> bool {
        self.values[1..].iter().any(Option::is_some)
    }

    pub fn timeout(&self) -> Option<Instant> {
        self.ask_at
    }

    pub fn take(&mut self, value: &PARAM_VALUE_DATA) {
        let named = |fact: &Fact| value.param_id.to_str() == Ok(fact.parameter());
        let Some(fact) = Fact::ALL.into_iter().find(named) else { return };
        if value.param_value.is_finite() {
            self.values[fact as usize] = Some(value.param_value);
        }
        if self.asked > 0 && self.missing().next().is_none() {
            self.ask_at = None;
        }
    }

    pub fn advance(&mut self, now: Instant, target: (u8, u8), out: &mut VecDeque<MavMessage>) {
        if self.ask_at.is_none_or(|at| now < at) {
            return;
        }
        if self.asked == ATTEMPTS {
            self.ask_at = None;
            return;
        }
        let first = self.asked == 0;
        let asked_for = Fact::ALL.into_iter().filter(|fact| first || self.get(*fact).is_none());
        out.extend(
            asked_for.map(|fact| parameter_protocol::read(Protocol::Classic, fact.parameter(), target)),
        );
        self.asked += 1;
        self.ask_at = Some(now + INTERVAL);
    }
}
