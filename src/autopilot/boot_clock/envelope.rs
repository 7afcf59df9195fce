//! The lower envelope of one-way delay.

use std::collections::VecDeque;
use std::time::Duration;

use super::{BootTime, drift, us};
use crate::time::Instant;

/// The least delayed message of so long counts. What the clocks may have drifted since is taken off, which makes samples
/// look older by 12 ms at most.
const WINDOW: Duration = Duration::from_secs(60);
/// Of messages nearer to one another than this the least delayed is enough.
const GRAIN: Duration = Duration::from_millis(100);
/// What was listened to for less says nothing of how it is delayed.
const SETTLED: Duration = Duration::from_secs(1);

/// Receipt minus stamp, over a window.
#[derive(Debug, Clone, Default)]
pub(super) struct Envelope {
    since: Option<Instant>,
    /// (Receipt, receipt minus stamp in microseconds), both rising: what is later and less delayed takes the place of what
    /// was before.
    lags: VecDeque<(Instant, i64)>,
}

impl Envelope {
    pub(super) fn hear(&mut self, time: BootTime, now: Instant) {
        let lag = us(now).saturating_sub(time.0);
        self.since.get_or_insert(now);
        while self.lags.front().is_some_and(|(at, _)| now.saturating_since(*at) > WINDOW) {
            self.lags.pop_front();
        }
        while self.lags.back().is_some_and(|(_, earlier)| *earlier >= lag) {
            self.lags.pop_back();
        }
        if self.lags.back().is_none_or(|(at, _)| now.saturating_since(*at) >= GRAIN) {
            self.lags.push_back((now, lag));
        }
    }

    /// When a sample with this stamp was taken, the least delayed message having had no delay: microseconds of our clock.
    pub(super) fn taken_at(&self, time: BootTime, now: Instant) -> Option<i64> {
        self.since.filter(|since| now.saturating_since(*since) >= SETTLED)?;
        let (at, lag) = self.lags.iter().find(|(at, _)| now.saturating_since(*at) <= WINDOW)?;
        let lag = lag.saturating_sub(drift(us(now).saturating_sub(us(*at))));
        Some(time.0.saturating_add(lag))
    }
}
