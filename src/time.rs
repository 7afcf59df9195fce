//! Time without a clock: instants are handed in by whoever owns a clock, so that everything above runs in
//! virtual time as well. Only `link::clock` reads a real one.

use std::fmt;
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

    /// So many seconds later, or earlier if negative; to the clock's first instant at most.
    #[must_use]
    pub fn after_s(self, seconds: f64) -> Self {
        let by = Duration::try_from_secs_f64(seconds.abs()).unwrap_or_default();
        Self(if seconds < 0.0 { self.0.saturating_sub(by) } else { self.0.saturating_add(by) })
    }

    /// `self - other` in seconds, negative if `other` is later.
    #[must_use]
    pub fn seconds_since(self, other: Self) -> f64 {
        self.saturating_since(other).as_secs_f64() - other.saturating_since(self).as_secs_f64()
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

impl Utc {
    const DAY_S: i64 = 86_400;

    /// The instant of a civil date (Gregorian, month and day from 1) and time, `offset` minutes ahead of UTC. `None`
    /// before 1970. A leap second is the second after it, as Unix time has it. The days since the epoch are counted
    /// from 1 March of the year 0, so that a leap day is the last of its year.
    #[must_use]
    pub fn from_civil(date: (u16, u8, u8), time: (u8, u8, u8), micros: u32, offset_min: i16) -> Option<Self> {
        let (year, month, day) = (i64::from(date.0), i64::from(date.1), i64::from(date.2));
        // March is month 0 of a year that begins with it.
        let (year, month) = if month > 2 { (year, month - 3) } else { (year - 1, month + 9) };
        let day_of_year = (153 * month + 2) / 5 + day - 1;
        let leap_days = year.div_euclid(4) - year.div_euclid(100) + year.div_euclid(400);
        let days = 365 * year + leap_days + day_of_year - 719_468;
        let (hour, minute, second) = (i64::from(time.0), i64::from(time.1), i64::from(time.2));
        let seconds = days * Self::DAY_S + hour * 3600 + minute * 60 + second - 60 * i64::from(offset_min);
        let unix_us = u64::try_from(seconds).ok()?.checked_mul(1_000_000)?.checked_add(micros.into())?;
        Some(Self { unix_us })
    }

    /// `self - earlier`, zero if `earlier` is later.
    #[must_use]
    pub fn saturating_since(self, earlier: Self) -> Duration {
        Duration::from_micros(self.unix_us.saturating_sub(earlier.unix_us))
    }
}

impl fmt::Display for Utc {
    /// RFC 3339, in UTC, with as many decimals of the second as it takes (none, three or six).
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (seconds, micros) = (self.unix_us / 1_000_000, self.unix_us % 1_000_000);
        let (days, of_day) = (seconds / 86_400, seconds % 86_400);
        // Backwards from the days since 1 March of the year 0: centuries of four, then years, then months.
        let days = days + 719_468;
        let (era, day) = (days / 146_097, days % 146_097);
        let year_of_era = (day - day / 1460 + day / 36_524 - day / 146_096) / 365;
        let day_of_year = day - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
        let month = (5 * day_of_year + 2) / 153;
        let day_of_month = day_of_year - (153 * month + 2) / 5 + 1;
        let (month, next) = if month < 10 { (month + 3, 0) } else { (month - 9, 1) };
        let year = 400 * era + year_of_era + next;
        let (hour, minute, second) = (of_day / 3600, of_day / 60 % 60, of_day % 60);
        write!(f, "{year:04}-{month:02}-{day_of_month:02}T{hour:02}:{minute:02}:{second:02}")?;
        match micros {
            0 => {}
            whole_ms if whole_ms % 1000 == 0 => write!(f, ".{:03}", whole_ms / 1000)?,
            micros => write!(f, ".{micros:06}")?,
        }
        write!(f, "Z")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Unix times as `date -u -d TEXT +%s` of GNU coreutils prints them.
    #[test]
    fn val_civil_dates_are_those_of_gnu_date() {
        for (text, date, time, unix_s) in [
            ("1970-01-01T00:00:00Z", (1970, 1, 1), (0, 0, 0), 0),
            ("2000-02-29T23:59:59Z", (2000, 2, 29), (23, 59, 59), 951_868_799),
            ("2000-03-01T00:00:00Z", (2000, 3, 1), (0, 0, 0), 951_868_800),
            ("2026-11-21T18:00:00Z", (2026, 11, 21), (18, 0, 0), 1_795_284_000),
            ("2100-02-28T12:00:00Z", (2100, 2, 28), (12, 0, 0), 4_107_499_200),
            ("2100-03-01T12:00:00Z", (2100, 3, 1), (12, 0, 0), 4_107_585_600),
        ] {
            let utc = Utc { unix_us: unix_s * 1_000_000 };
            assert_eq!(Utc::from_civil(date, time, 0, 0), Some(utc), "{text}");
            assert_eq!(utc.to_string(), text);
        }
        let east = Utc::from_civil((2026, 11, 21), (19, 30, 0), 250_000, 90);
        assert_eq!(east.map(|utc| utc.to_string()).as_deref(), Some("2026-11-21T18:00:00.250Z"));
        assert_eq!(Utc { unix_us: 1 }.to_string(), "1970-01-01T00:00:00.000001Z");
        assert_eq!(Utc::from_civil((1969, 12, 31), (23, 59, 59), 0, 0), None);
    }

    #[test]
    fn prop_every_day_of_four_centuries_reads_back() {
        for day in (0..146_097_u64).step_by(7) {
            let utc = Utc { unix_us: day * 86_400_000_000 };
            let text = utc.to_string();
            let part = |range| text.get(range).and_then(|digits: &str| digits.parse::<u16>().ok()).unwrap();
            let date = (part(0..4), part(5..7) as u8, part(8..10) as u8);
            assert_eq!(Utc::from_civil(date, (0, 0, 0), 0, 0), Some(utc), "{text}");
        }
    }
}
