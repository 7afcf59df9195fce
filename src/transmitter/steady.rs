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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spec_another_power_or_a_break_begins_it_anew() {
        let at = |ms| Instant::from_start(Duration::from_millis(ms));
        let on_since = |power_w, until, noted: u64| {
            let mut steady = Steady::default();
            let vouched = |power_w, until| Some(Vouched { slot: 1, power_w, until: at(until) });
            steady.note(vouched(0.1, until), false, at(1000));
            steady.note(vouched(power_w, 9000), false, at(noted));
            (1000..).find(|&ms| steady.has_been_on(Duration::from_millis(100), at(ms)))
        };
        assert_eq!(on_since(0.1, 1050, 1050), Some(1100));
        assert_eq!(on_since(0.1, 1049, 1050), Some(1150), "a break");
        assert_eq!(on_since(0.2, 1050, 1050), Some(1150), "another power");
    }
}
