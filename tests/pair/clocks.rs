//! Clocks that are not the world's.

use std::time::Duration;

use veilwing::time::{Instant, Utc};

/// Monotonic time and UTC of one vehicle, in terms of true time.
#[derive(Debug, Clone, Copy)]
pub struct Clocks {
    /// True time of the companion's start.
    pub started: Duration,
    /// Rate against true time.
    pub rate: f64,
    /// Error of UTC, microseconds.
    pub utc_error_us: i64,
}

impl Clocks {
    pub fn local(&self, t: Duration) -> Instant {
        Instant::from_start(t.saturating_sub(self.started).mul_f64(self.rate))
    }

    /// True time of a local instant, rounded up so that a wake is never too early.
    pub fn true_time(&self, at: Instant) -> Duration {
        self.started + at.since_start().div_f64(self.rate) + Duration::from_nanos(2)
    }

    pub fn utc(&self, t: Duration) -> Utc {
        let us = 1_800_000_000_000_000 + t.as_micros() as i64 + self.utc_error_us;
        Utc { unix_us: us as u64 }
    }
}
