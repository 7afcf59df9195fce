//! The radio's clock: milliseconds in 32 bits, monotonic, never set.

use std::time::Duration;

use crate::time::Instant;

/// Shows the time since some instant before the start.
#[derive(Debug, Clone, Copy)]
pub(super) struct RadioClock {
    /// What it shows at [`Instant::ZERO`].
    began_ms: u32,
}

impl RadioClock {
    pub fn new(began_ms: u32) -> Self {
        Self { began_ms }
    }

    /// What it shows: whole milliseconds that have passed, modulo 2^32.
    pub fn shows_ms(self, now: Instant) -> u32 {
        let passed = now.since_start().as_millis() & u128::from(u32::MAX);
        self.began_ms.wrapping_add(u32::try_from(passed).unwrap_or_default())
    }

    /// How far ahead of the clock `time_ms` is, negative if it is behind; both wrap.
    pub fn ahead_ms(self, time_ms: u32, now: Instant) -> i32 {
        time_ms.wrapping_sub(self.shows_ms(now)).cast_signed()
    }

    /// When the clock begins to show `time_ms`, if that is ahead of it; else `now`'s own millisecond.
    pub fn reaches(self, time_ms: u32, now: Instant) -> Instant {
        let shown = Duration::from_millis(u64::try_from(now.since_start().as_millis()).unwrap_or(u64::MAX));
        let ahead = u64::try_from(self.ahead_ms(time_ms, now)).unwrap_or_default();
        Instant::from_start(shown) + Duration::from_millis(ahead)
    }
}
