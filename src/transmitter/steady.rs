//! For how long the radio is known to be on, or off, without a break: a device takes its time to do what it is told.

use std::time::Duration;

use super::Vouched;
use crate::time::Instant;

/// See the module.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Steady {
    on: Option<On>,
    off_since: Option<Instant>,
}

#[derive(Debug, Clone, Copy)]
struct On {
    since: Instant,
    power_w: f64,
    /// As it was known last.
    until: Instant,
}

impl Steady {
    /// What is known at `now`: called whenever that may have changed.
    pub fn note(&mut self, on: Option<Vouched>, off: bool, now: Instant) {
        self.on = on.map(|Vouched { power_w, until, .. }| {
            let before = self.on.filter(|before| before.power_w == power_w && now <= before.until);
            On { since: before.map_or(now, |before| before.since), power_w, until }
        });
        self.off_since = off.then(|| self.off_since.unwrap_or(now));
    }

    /// Whether it is known to have been on for so long.
    pub fn has_been_on(&self, long: Duration, now: Instant) -> bool {
        long.is_zero() || self.on.is_some_and(|on| on.since + long <= now)
    }

    /// Whether it is known to have been off for so long.
    pub fn has_been_off(&self, long: Duration, now: Instant) -> bool {
        long.is_zero() || self.off_since.is_some_and(|since| since + long <= now)
    }
}
