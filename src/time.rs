//! Time without a clock: instants are handed in by whoever owns a clock, so that everything above runs in
//! virtual time as well. Only `link::clock` reads a real one.

use std::ops::{Add, Sub};
use std::time::Duration;

/// A monotonic instant: the time since the process (or the simulation) started.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct Instant(Duration);

impl Instant {
    /// The start of the process's time.
    pub const ZERO: Self = Self(Duration::ZERO);

    /// The instant `since_start` after the start.
    #[must_use]
    pub const fn from_start(since_start: Duration) -> Self {
        Self(since_start)
    }

    /// Time since the start.
    #[must_use]
    pub const fn since_start(self) -> Duration {
        self.0
    }

    /// `self - earlier`, zero if `earlier` is later.
    #[must_use]
    pub fn saturating_since(self, earlier: Self) -> Duration {
        self.0.saturating_sub(earlier.0)
    }
}

impl Add<Duration> for Instant {
    type Output = Self;

    fn add(self, rhs: Duration) -> Self {
        Self(self.0.saturating_add(rhs))
    }
}

impl Sub<Duration> for Instant {
    type Output = Self;

    fn sub(self, rhs: Duration) -> Self {
        Self(self.0.saturating_sub(rhs))
    }
}

/// UTC, as the autopilots' SYSTEM_TIME gives it: microseconds since 1970-01-01.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct Utc {
    /// Microseconds since the Unix epoch.
    pub unix_us: u64,
}

impl Add<Duration> for Utc {
    type Output = Self;

    fn add(self, rhs: Duration) -> Self {
        Self { unix_us: self.unix_us.saturating_add(u64::try_from(rhs.as_micros()).unwrap_or(u64::MAX)) }
    }
}
