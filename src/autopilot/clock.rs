//! UTC from the autopilot's SYSTEM_TIME.
//!
//! A message that was stamped `u` and arrives at our instant `t` says that UTC - ours >= u - t: transport only ever
//! delays. The largest such difference over a window is the estimate, the least delayed message its evidence; the
//! spread of the recent ones bounds what the best of them may still have been delayed.

use std::collections::VecDeque;
use std::time::Duration;

use crate::time::{Instant, Utc};

const SAMPLES: usize = 64;
/// 2020-01-01: what is earlier is a clock that was never set.
const EARLIEST_US: u64 = 1_577_836_800_000_000;
/// A difference that is off by more than this is a clock that was set anew.
const STEP_US: i64 = 500_000;

/// The difference between UTC and our own time.
#[derive(Debug, Clone, Default)]
pub(super) struct UtcEstimate {
    /// UTC minus our time in microseconds, oldest first.
    differences_us: VecDeque<i64>,
}

impl UtcEstimate {
    pub(super) fn handle_system_time(&mut self, unix_us: u64, now: Instant) {
        let Ok(stamp_us) = i64::try_from(unix_us) else { return };
        if unix_us < EARLIEST_US {
            return;
        }
        let difference = stamp_us - ours_us(now);
        if self.best_us().is_some_and(|best| (best - difference).abs() > STEP_US) {
            self.differences_us.clear();
        }
        if self.differences_us.len() == SAMPLES {
            self.differences_us.pop_front();
        }
        self.differences_us.push_back(difference);
    }

    pub(super) fn clear(&mut self) {
        self.differences_us.clear();
    }

    /// UTC at `now`; `None` until a plausible SYSTEM_TIME was heard.
    pub(super) fn utc(&self, now: Instant) -> Option<Utc> {
        let us = self.best_us()?.checked_add(ours_us(now))?;
        u64::try_from(us).ok().map(|unix_us| Utc { unix_us })
    }

    /// Half the usual spread of delays, and at least the millisecond in which autopilots count.
    pub(super) fn uncertainty(&self) -> Option<Duration> {
        let best = self.best_us()?;
        let mean_delay =
            self.differences_us.iter().map(|d| best - d).sum::<i64>() / self.differences_us.len() as i64;
        Some(Duration::from_micros(u64::try_from(mean_delay).unwrap_or(0) / 2).max(Duration::from_millis(1)))
    }

    fn best_us(&self) -> Option<i64> {
        self.differences_us.iter().max().copied()
    }
}

fn ours_us(now: Instant) -> i64 {
    i64::try_from(now.since_start().as_micros()).unwrap_or(i64::MAX / 2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_the_least_delayed_message_sets_the_clock() {
        let mut estimate = UtcEstimate::default();
        assert_eq!(estimate.utc(Instant::ZERO), None);
        let epoch = 1_800_000_000_000_000;
        for (sent_ms, delay_ms) in [(1000, 30), (2000, 4), (3000, 55), (4000, 12)] {
            let now = Instant::from_start(Duration::from_millis(sent_ms + delay_ms));
            estimate.handle_system_time(epoch + sent_ms * 1000, now);
        }
        let at = Instant::from_start(Duration::from_secs(10));
        let error_us = estimate.utc(at).unwrap().unix_us as i64 - (epoch + 10_000_000) as i64;
        assert_eq!(error_us, -4000);
        assert!(estimate.uncertainty().unwrap() >= Duration::from_millis(4), "covers the error");
    }

    #[test]
    fn spec_an_unset_clock_is_no_clock_and_a_step_is_followed() {
        let mut estimate = UtcEstimate::default();
        estimate.handle_system_time(12_345_678, Instant::ZERO);
        assert_eq!(estimate.utc(Instant::ZERO), None);
        estimate.handle_system_time(1_800_000_000_000_000, Instant::ZERO);
        estimate.handle_system_time(1_700_000_000_000_000, Instant::ZERO);
        assert_eq!(estimate.utc(Instant::ZERO), Some(Utc { unix_us: 1_700_000_000_000_000 }));
    }
}
