//! The parameters the companion needs: read by name, a few at a time, and written.
//!
//! An autopilot that does not know a name says nothing (ArduCopter) or too little (PX4): silence is an answer.

use std::collections::BTreeMap;
use std::time::Duration;

use mavlink::dialects::ardupilotmega::{
    MavMessage, MavParamType, PARAM_REQUEST_READ_DATA, PARAM_SET_DATA, PARAM_VALUE_DATA,
};

use super::outbox::{Address, Outbox};
use super::param_value::{IntegerForm, ParamValue};
use crate::preflight::{Check, Verdict, check};
use crate::time::Instant;

const ANSWER_TIMEOUT: Duration = Duration::from_millis(500);
const ATTEMPTS: u8 = 4;
const READS_IN_FLIGHT: usize = 4;
/// On the ground everything is read again this often: someone may be putting right what the preflight named.
const AGAIN: Duration = Duration::from_secs(5);

/// What is known of a parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Knowledge {
    /// Still being asked for, or not asked for yet.
    Pending,
    /// Asked for in vain: the autopilot does not have it, or does not say.
    Unknown,
    /// As the autopilot last said.
    Known(ParamValue),
}

#[derive(Debug, Clone, Copy)]
struct Exchange {
    sent: u8,
    waits_until: Option<Instant>,
}

#[derive(Debug, Clone)]
struct Entry {
    known: Option<(ParamValue, MavParamType)>,
    /// Asked for in vain at least once.
    silent: bool,
    read: Option<Exchange>,
    /// The value to be written and how far that is; kept until the autopilot repeats the value.
    write: Option<(f64, Exchange)>,
}

const FRESH: Exchange = Exchange { sent: 0, waits_until: None };

/// The parameters read and written so far.
#[derive(Debug, Clone, Default)]
pub(super) struct Parameters {
    entries: BTreeMap<String, Entry>,
    again_at: Option<Instant>,
}

impl Parameters {
    /// Starts to read these parameters, forgetting what was known.
    pub(super) fn read(&mut self, names: &[&str]) {
        self.entries.clear();
        self.read_also(names.iter().map(ToString::to_string));
    }

    /// Starts to read these parameters as well, unless they have been asked for before.
    pub(super) fn read_also(&mut self, names: impl IntoIterator<Item = String>) {
        for name in names {
            self.entries.entry(name).or_insert(Entry {
                known: None,
                silent: false,
                read: Some(FRESH),
                write: None,
            });
        }
    }

    /// What is known of a parameter.
    pub(super) fn get(&self, name: &str) -> Knowledge {
        match self.entries.get(name) {
            Some(Entry { known: Some((value, _)), .. }) => Knowledge::Known(*value),
            Some(Entry { silent: true, .. }) => Knowledge::Unknown,
            _ => Knowledge::Pending,
        }
    }

    /// Judges a parameter before a flight: `judge` gives the verdict and what the value should be.
    pub(super) fn check(
        &self,
        name: &'static str,
        judge: impl FnOnce(f64) -> (Verdict, &'static str),
    ) -> Check {
        match self.get(name) {
            // It may be the one that should fail. Asking ends: what does not answer is unknown.
            Knowledge::Pending => check(name, Verdict::Fail, "not read yet"),
            Knowledge::Unknown => check(name, Verdict::Warn, "the autopilot does not answer: not known"),
            Knowledge::Known(value) => {
                let (result, should_be) = judge(value.as_f64());
                let shown = match value {
                    ParamValue::Int(value) => value.to_string(),
                    ParamValue::Real(value) => value.to_string(),
                };
                let detail =
                    if result == Verdict::Pass { shown } else { format!("{shown}, should be {should_be}") };
                check(name, result, detail)
            }
        }
    }

    /// Whether one of the parameters with this prefix is still asked for.
    pub(super) fn is_reading(&self, prefix: &str) -> bool {
        self.entries.iter().any(|(name, e)| name.starts_with(prefix) && e.known.is_none() && !e.silent)
    }

    /// Reads everything again, now and then; what is known stays known meanwhile.
    pub(super) fn refresh(&mut self, on_ground: bool, now: Instant) {
        if self.again_at.is_some_and(|at| now < at) {
            return;
        }
        if on_ground && self.again_at.is_some() {
            self.entries.values_mut().for_each(|entry| _ = entry.read.get_or_insert(FRESH));
        }
        self.again_at = Some(now + AGAIN);
    }

    /// Writes a parameter whose type is known from reading it; `false` if it is not.
    pub(super) fn write(&mut self, name: &str, value: f64) -> bool {
        let Some(entry) = self.entries.get_mut(name).filter(|entry| entry.known.is_some()) else {
            return false;
        };
        if entry.write.is_none_or(|(wanted, _)| wanted != value) {
            entry.write = Some((value, FRESH));
        }
        true
    }

    /// Whether a write still waits for the autopilot to repeat the value.
    pub(super) fn is_writing(&self, name: &str) -> bool {
        self.entries.get(name).is_some_and(|entry| entry.write.is_some())
    }

    pub(super) fn handle_value(&mut self, message: &PARAM_VALUE_DATA, form: IntegerForm) {
        let Ok(name) = message.param_id.to_str() else { return };
        let Some(entry) = self.entries.get_mut(name) else { return };
        let Some(value) = form.decode(message.param_value, message.param_type) else { return };
        entry.known = Some((value, message.param_type));
        entry.read = None;
        if entry
            .write
            .is_some_and(|(wanted, _)| (wanted - value.as_f64()).abs() <= 1e-6 * wanted.abs().max(1.0))
        {
            entry.write = None;
        }
    }

    /// Sends what is due.
    pub(super) fn advance(&mut self, now: Instant, form: IntegerForm, target: Address, out: &mut Outbox) {
        let waiting =
            |entry: &Entry| entry.read.is_some_and(|read| read.waits_until.is_some_and(|until| until > now));
        let mut in_flight = self.entries.values().filter(|entry| waiting(entry)).count();
        for (name, entry) in &mut self.entries {
            if let Some(read) = &mut entry.read {
                let expired = read.waits_until.is_some_and(|until| until <= now);
                if expired && read.sent == ATTEMPTS {
                    entry.read = None;
                    entry.silent = true;
                } else if expired || (read.waits_until.is_none() && in_flight < READS_IN_FLIGHT) {
                    in_flight += 1;
                    step(read, now);
                    out.send(MavMessage::PARAM_REQUEST_READ(PARAM_REQUEST_READ_DATA {
                        param_index: -1,
                        target_system: target.0,
                        target_component: target.1,
                        param_id: name.as_str().into(),
                    }));
                }
            }
            let (Some((value, write)), Some((_, kind))) = (&mut entry.write, entry.known) else { continue };
            // A write is repeated until it is confirmed: what depends on it must not proceed otherwise.
            if write.waits_until.is_none_or(|until| until <= now) {
                step(write, now);
                out.send(MavMessage::PARAM_SET(PARAM_SET_DATA {
                    param_value: form.encode(*value, kind),
                    target_system: target.0,
                    target_component: target.1,
                    param_id: name.as_str().into(),
                    param_type: kind,
                }));
            }
        }
    }

    pub(super) fn timeout(&self) -> Option<Instant> {
        self.entries
            .values()
            .flat_map(|entry| [entry.read, entry.write.map(|(_, write)| write)])
            .filter_map(|exchange| exchange?.waits_until)
            .chain(self.again_at)
            .min()
    }
}

fn step(exchange: &mut Exchange, now: Instant) {
    exchange.sent = exchange.sent.saturating_add(1);
    exchange.waits_until = Some(now + ANSWER_TIMEOUT);
}
