//! Power by a parameter, for radios that speak only that. It does not expire: off is ours alone to command.

use std::collections::VecDeque;
use std::time::Duration;

use mavlink::dialects::ardupilotmega::{
    MavMessage, MavParamExtType, MavParamType, PARAM_EXT_REQUEST_READ_DATA, PARAM_EXT_SET_DATA,
    PARAM_REQUEST_READ_DATA, PARAM_SET_DATA, ParamAck,
};

use super::{Lease, REPEAT_OFF, at_most, until_next_off};
use crate::time::Instant;
use crate::units::{Dbm, Watts};

/// The first echo of off may be an older one's, from before the radio was told to radiate.
const OFF_ECHOES: u8 = 2;

/// Which messages carry the parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Protocol {
    /// PARAM_EXT_SET.
    Extended,
    /// PARAM_SET, integers converted to float (mLRS, ELRS).
    Classic,
}

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

/// The parameter's type: learnt by reading it, needed to write it.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Type {
    Extended(MavParamExtType),
    Classic(MavParamType),
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
        let (kind, value) = match (message, self.parameter.protocol) {
            (MavMessage::PARAM_EXT_VALUE(m), Protocol::Extended) if self.is_named(&m.param_id) => {
                (Type::Extended(m.param_type), decode(&m.param_value, m.param_type))
            }
            (MavMessage::PARAM_EXT_ACK(m), Protocol::Extended)
                if self.is_named(&m.param_id) && m.param_result == ParamAck::PARAM_ACK_ACCEPTED =>
            {
                (Type::Extended(m.param_type), decode(&m.param_value, m.param_type))
            }
            (MavMessage::PARAM_VALUE(m), Protocol::Classic) if self.is_named(&m.param_id) => (
                Type::Classic(m.param_type),
                Some(f64::from(m.param_value)).filter(|value| value.is_finite()),
            ),
            _ => return,
        };
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
        let name = self.parameter.name.as_str();
        let (target_system, target_component) = self.target;
        let message = match (self.kind, self.parameter.protocol) {
            // Its type first: what is written in another type is refused or misread.
            (None, Protocol::Extended) => MavMessage::PARAM_EXT_REQUEST_READ(PARAM_EXT_REQUEST_READ_DATA {
                param_index: -1,
                target_system,
                target_component,
                param_id: name.into(),
            }),
            (None, Protocol::Classic) => read(name, self.target),
            (Some(Type::Extended(param_type)), _) => MavMessage::PARAM_EXT_SET(PARAM_EXT_SET_DATA {
                target_system,
                target_component,
                param_id: name.into(),
                param_value: encode(value, param_type).into(),
                param_type,
            }),
            (Some(Type::Classic(param_type)), _) => MavMessage::PARAM_SET(PARAM_SET_DATA {
                param_value: at_most(value),
                target_system,
                target_component,
                param_id: name.into(),
                param_type,
            }),
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

    fn is_named(&self, id: &mavlink::types::CharArray<16>) -> bool {
        id.to_str() == Ok(self.parameter.name.as_str())
    }
}

impl Type {
    fn is_whole(self) -> bool {
        match self {
            Self::Extended(kind) => !matches!(
                kind,
                MavParamExtType::MAV_PARAM_EXT_TYPE_REAL32
                    | MavParamExtType::MAV_PARAM_EXT_TYPE_REAL64
                    | MavParamExtType::MAV_PARAM_EXT_TYPE_CUSTOM
            ),
            Self::Classic(kind) => {
                !matches!(kind, MavParamType::MAV_PARAM_TYPE_REAL32 | MavParamType::MAV_PARAM_TYPE_REAL64)
            }
        }
    }
}

/// PARAM_REQUEST_READ by name.
pub(super) fn read(name: &str, (target_system, target_component): (u8, u8)) -> MavMessage {
    MavMessage::PARAM_REQUEST_READ(PARAM_REQUEST_READ_DATA {
        param_index: -1,
        target_system,
        target_component,
        param_id: name.into(),
    })
}

/// Equal but for single precision.
fn same(a: f64, b: f64) -> bool {
    a == b || (a - b).abs() <= 1e-6 * a.abs().max(b.abs())
}

/// PARAM_EXT carries values as they lie in memory, little-endian.
fn encode(value: f64, kind: MavParamExtType) -> [u8; 128] {
    let mut wire = [0u8; 128];
    let bytes: Vec<u8> = match kind {
        MavParamExtType::MAV_PARAM_EXT_TYPE_REAL32 => at_most(value).to_le_bytes().to_vec(),
        MavParamExtType::MAV_PARAM_EXT_TYPE_REAL64 => value.to_le_bytes().to_vec(),
        _ => (value.round() as i64).to_le_bytes()[..width(kind)].to_vec(),
    };
    wire[..bytes.len()].copy_from_slice(&bytes);
    wire
}

fn decode(wire: &[u8; 128], kind: MavParamExtType) -> Option<f64> {
    let mut eight = [0u8; 8];
    eight.copy_from_slice(&wire[..8]);
    let [a, b, c, d, ..] = eight;
    let value = match kind {
        MavParamExtType::MAV_PARAM_EXT_TYPE_REAL32 => f64::from(f32::from_le_bytes([a, b, c, d])),
        MavParamExtType::MAV_PARAM_EXT_TYPE_REAL64 => f64::from_le_bytes(eight),
        MavParamExtType::MAV_PARAM_EXT_TYPE_UINT8 => f64::from(a),
        MavParamExtType::MAV_PARAM_EXT_TYPE_INT8 => f64::from(i8::from_le_bytes([a])),
        MavParamExtType::MAV_PARAM_EXT_TYPE_UINT16 => f64::from(u16::from_le_bytes([a, b])),
        MavParamExtType::MAV_PARAM_EXT_TYPE_INT16 => f64::from(i16::from_le_bytes([a, b])),
        MavParamExtType::MAV_PARAM_EXT_TYPE_UINT32 => f64::from(u32::from_le_bytes([a, b, c, d])),
        MavParamExtType::MAV_PARAM_EXT_TYPE_INT32 => f64::from(i32::from_le_bytes([a, b, c, d])),
        MavParamExtType::MAV_PARAM_EXT_TYPE_UINT64 => u64::from_le_bytes(eight) as f64,
        MavParamExtType::MAV_PARAM_EXT_TYPE_INT64 => i64::from_le_bytes(eight) as f64,
        MavParamExtType::MAV_PARAM_EXT_TYPE_CUSTOM => return None,
    };
    value.is_finite().then_some(value)
}

/// Bytes of an integer type.
fn width(kind: MavParamExtType) -> usize {
    match kind {
        MavParamExtType::MAV_PARAM_EXT_TYPE_UINT8 | MavParamExtType::MAV_PARAM_EXT_TYPE_INT8 => 1,
        MavParamExtType::MAV_PARAM_EXT_TYPE_UINT16 | MavParamExtType::MAV_PARAM_EXT_TYPE_INT16 => 2,
        MavParamExtType::MAV_PARAM_EXT_TYPE_UINT32 | MavParamExtType::MAV_PARAM_EXT_TYPE_INT32 => 4,
        _ => 8,
    }
}
