//! The radio's own largest power, asked for at the start.

use std::collections::VecDeque;
use std::time::Duration;

use mavlink::dialects::ardupilotmega::{MavMessage, PARAM_VALUE_DATA};

use super::parameter;
use crate::time::Instant;
use crate::units::{Dbm, Watts};

/// The parameter in which a radio says it, in dBm.
const LIMIT_PARAMETER: &str = "TX_MAX_DBM";
const ATTEMPTS: u8 = 5;
const INTERVAL: Duration = Duration::from_secs(1);

/// The largest power, once the radio has said it.
#[derive(Debug, Clone, Default)]
pub(super) struct Limit {
    limit_w: Option<f64>,
    asked: u8,
    ask_at: Option<Instant>,
}

impl Limit {
    /// To be asked for from `ask_at` on.
    pub fn new(ask_at: Option<Instant>) -> Self {
        Self { ask_at, ..Self::default() }
    }

    pub fn watts(&self) -> Option<f64> {
        self.limit_w
    }

    pub fn timeout(&self) -> Option<Instant> {
        self.ask_at
    }

    pub fn take(&mut self, value: &PARAM_VALUE_DATA) {
        let dbm = f64::from(value.param_value);
        if value.param_id.to_str() == Ok(LIMIT_PARAMETER) && dbm.is_finite() {
            self.limit_w = Some(Watts::from(Dbm(dbm)).0);
            self.ask_at = None;
        }
    }

    pub fn advance(&mut self, now: Instant, target: (u8, u8), out: &mut VecDeque<MavMessage>) {
        if self.ask_at.is_none_or(|at| now < at) {
            return;
        }
        out.push_back(parameter::read(LIMIT_PARAMETER, target));
        self.asked += 1;
        self.ask_at = (self.asked < ATTEMPTS).then_some(now + INTERVAL);
    }
}
