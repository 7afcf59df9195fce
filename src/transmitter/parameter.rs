//! Power by a parameter, for radios that speak only that. It does not expire: off is ours alone to command.

use std::collections::VecDeque;
use std::time::Duration;

use mavlink::dialects::ardupilotmega::{MavMessage, ParamAck};

use super::parameter_protocol::{self as protocol, Protocol, Type, same};
use super::{Lease, REPEAT_OFF, until_next_off};
use crate::time::Instant;
use crate::units::{Dbm, Watts};

/// The first echo of off may be an older one's, from before the radio was told to radiate.
const OFF_ECHOES: u8 = 2;

/// One entry of a level table.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Level {
    /// The parameter's value.
    pub value: f64,
    /// The power it gives, in watts.
    pub power_w: f64,
}

/// What the parameter's value means.
#[derive(Debug, Clone, PartialEq)]
pub enum Unit {
    /// Watts.
    Watt,
    /// Milliwatts.
    Milliwatt,
    /// dB relative to one milliwatt.
    Dbm,
    /// An entry of this table.
    Levels(Vec<Level>),
}

/// A parameter that sets a radio's power.
#[derive(Debug, Clone, PartialEq)]
pub struct PowerParameter {
    /// Its name, at most 16 characters.
    pub name: String,
    /// How it is set.
    pub protocol: Protocol,
    /// What its value means.
    pub unit: Unit,
    /// The value at which nothing is radiated.
    pub off_value: f64,
}

impl PowerParameter {
    /// The value that gives at most this power (S6); the off value if every level is stronger.
    fn value(&self, power_w: f64, whole: bool) -> f64 {
        let exact = match &self.unit {
            Unit::Watt => power_w,
            Unit::Milliwatt => power_w * 1e3,
            Unit::Dbm => Dbm::from(Watts(power_w)).0,
            Unit::Levels(levels) => {
                let allowed = levels.iter().filter(|level| level.power_w <= power_w);
                let best = allowed.max_by(|a, b| a.power_w.total_cmp(&b.power_w));
                return best.map_or(self.off_value, |level| level.value);
            }
        };
        if whole { exact.floor() } else { exact }
    }

    /// The power of a value in watts; zero for the off value.
    fn power_w(&self, value: f64) -> Option<f64> {
        if same(value, self.off_value) {
            return Some(0.0);
        }
        match &self.unit {
            Unit::Watt => Some(value),
            Unit::Milliwatt => Some(value * 1e-3),
            Unit::Dbm => Some(Watts::from(Dbm(value)).0),
            Unit::Levels(levels) => {
                levels.iter().find(|level| same(level.value, value)).map(|level| level.power_w)
            }
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Wanted {
    Off { since: Instant },
    On { power_w: f64, slot: u16, expires_at: Instant },
}

/// The driver of a transmitter with a power parameter.
#[derive(Debug, Clone)]
pub(super) struct ByParameter {
    parameter: PowerParameter,
    target: (u8, u8),
    kind: Option<Type>,
    wanted: Wanted,
    /// The value the radio last said it has.
    reported: Option<f64>,
    sent: Option<(f64, Instant)>,
    send_at: Option<Instant>,
    /// How often in a row the radio has repeated the off value since it was told so last.
    off_echoes: u8,
    round_trip: Option<Duration>,
}

impl ByParameter {
    pub(super) fn new(parameter: PowerParameter, target: (u8, u8)) -> Self {
        Self {
            parameter,
            target,
            kind: None,
            wanted: Wanted::Off { since: Instant::ZERO },
            reported: None,
            sent: None,
            send_at: None,
            off_echoes: 0,
            round_trip: None,
        }
    }

    pub(super) fn radiate(
        &mut self,
        power_w: f64,
        slot: u16,
        expires_at: Instant,
        now: Instant,
        out: &mut VecDeque<MavMessage>,
    ) {
        self.wanted = Wanted::On { power_w, slot, expires_at };
        self.settle(now, out);
    }

    pub(super) fn silence(&mut self, now: Instant, out: &mut VecDeque<MavMessage>) {
        self.wanted = Wanted::Off { since: now };
        // At once, whatever it reported last.
        self.reported = None;
        self.off_echoes = 0;
        self.send(now, out);
    }

    pub(super) fn link_is_back(&mut self, now: Instant, out: &mut VecDeque<MavMessage>) {
        self.reported = None;
        if matches!(self.wanted, Wanted::Off { .. }) {
            self.silence(now, out);
        }
    }

    pub(super) fn handle_message(
        &mut self,
        message: &MavMessage,
        now: Instant,
        out: &mut VecDeque<MavMessage>,
    ) {
        let said = protocol::said(self.parameter.protocol, &self.parameter.name, message);
        let Some(said) = said.filter(|said| said.result == ParamAck::PARAM_ACK_ACCEPTED) else { return };
        let (kind, value) = (said.kind, said.value);
        self.kind = Some(kind);
        self.reported = value;
        let off = value.is_some_and(|value| same(value, self.parameter.off_value));
        self.off_echoes = if off { self.off_echoes.saturating_add(1) } else { 0 };
        if let (Some((sent, at)), Some(value)) = (self.sent, value)
            && same(sent, value)
        {
            self.round_trip = Some(now.saturating_since(at));
            self.sent = None;
        }
        self.settle(now, out);
    }

    pub(super) fn advance(&mut self, now: Instant, out: &mut VecDeque<MavMessage>) {
        if matches!(self.wanted, Wanted::On { expires_at, .. } if expires_at <= now) {
            self.silence(now, out);
        } else if self.send_at.is_some_and(|at| at <= now) {
            self.send(now, out);
        }
    }

    pub(super) fn timeout(&self) -> Option<Instant> {
        let expiry = match self.wanted {
            Wanted::On { expires_at, .. } => Some(expires_at),
            Wanted::Off { .. } => None,
        };
        [expiry, self.send_at].into_iter().flatten().min()
    }

    pub(super) fn lease(&self) -> Option<Lease> {
        let Wanted::On { slot, expires_at, .. } = self.wanted else { return None };
        let power_w = self.parameter.power_w(self.reported.filter(|value| same(*value, self.value()))?)?;
        (power_w > 0.0).then_some(Lease { power_w, slot, expires_at })
    }

    pub(super) fn is_off(&self) -> bool {
        matches!(self.wanted, Wanted::Off { .. }) && self.off_echoes >= OFF_ECHOES
    }

    /// Of the last value that was set and echoed.
    pub(super) fn round_trip(&self) -> Option<Duration> {
        self.round_trip
    }

    /// The strongest level; other units have no limit of their own.
    pub(super) fn limit_w(&self) -> Option<f64> {
        match &self.parameter.unit {
            Unit::Levels(levels) => levels.iter().map(|level| level.power_w).max_by(f64::total_cmp),
            _ => None,
        }
    }

    /// The power in watts that this one comes to.
    pub(super) fn gives_w(&self, power_w: f64) -> f64 {
        let value = self.parameter.value(power_w, self.kind.is_some_and(Type::is_whole));
        self.parameter.power_w(value).unwrap_or(0.0)
    }

    /// The weakest level, in watts; other units have no least of their own.
    pub(super) fn least_w(&self) -> Option<f64> {
        match &self.parameter.unit {
            Unit::Levels(levels) => {
                let powers = levels.iter().map(|level| level.power_w);
                powers.filter(|power_w| *power_w > 0.0).min_by(f64::total_cmp)
            }
            _ => None,
        }
    }

    /// The value wanted now.
    fn value(&self) -> f64 {
        match self.wanted {
            Wanted::Off { .. } => self.parameter.off_value,
            Wanted::On { power_w, .. } => {
                self.parameter.value(power_w, self.kind.is_some_and(Type::is_whole))
            }
        }
    }

    /// Sends unless the radio already has the value, or was just told.
    fn settle(&mut self, now: Instant, out: &mut VecDeque<MavMessage>) {
        let value = self.value();
        let settled = match self.wanted {
            Wanted::Off { .. } => self.is_off(),
            Wanted::On { .. } => self.reported.is_some_and(|reported| same(reported, value)),
        };
        if settled {
            self.send_at = None;
        } else if self.sent.is_none_or(|(sent, _)| !same(sent, value)) {
            self.send(now, out);
        }
    }

    fn send(&mut self, now: Instant, out: &mut VecDeque<MavMessage>) {
        self.send_at = Some(now + self.until_next(now));
        let value = self.value();
        let PowerParameter { name, protocol, .. } = &self.parameter;
        let message = match self.kind {
            // Its type first.
            None => protocol::read(*protocol, name, self.target),
            Some(kind) => protocol::set(*protocol, name, self.target, kind, value),
        };
        if self.kind.is_some() && self.sent.is_none_or(|(sent, _)| !same(sent, value)) {
            self.sent = Some((value, now));
        }
        out.push_back(message);
    }

    /// PARAM_EXT_SET takes 28 ms on a line of 57,600 baud: as fast as PARAM_SET's 6 ms allow, repetitions would only
    /// queue up before the radio. A read, while the type is unknown, is no hurry either.
    fn until_next(&self, now: Instant) -> Duration {
        match (self.wanted, self.kind) {
            (Wanted::Off { since }, Some(Type::Classic(_))) => until_next_off(now.saturating_since(since)),
            (Wanted::Off { since }, _) => until_next_off(now.saturating_since(since)).max(REPEAT_OFF),
            (Wanted::On { .. }, _) => REPEAT_OFF,
        }
    }
}
