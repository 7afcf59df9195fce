//! The radio's clock, as far as can be known of it from what it said and when that was heard.
//!
//! The radio's clock may be fast or slow against ours by [`DRIFT_PPM`]. A reading t, heard at r, was taken before r:
//! at any later x the clock shows at least t + (x - r)(1 - drift). If it is in the answer to a command that was sent
//! at s, it was taken after s, and the clock shows at most t + 1 ms + (x - s)(1 + drift), for t is cut to whole
//! milliseconds. The first bound is what "off by" needs, the second what "on until" needs. Each of them holds for
//! every reading, so that of several the tightest counts, and none is used beyond its age.

use std::collections::VecDeque;
use std::time::Duration;

use crate::time::Instant;

/// The most by which the two clocks' rates differ: two crystals at the edges of what they are sold for.
const DRIFT_PPM: i64 = 100;
/// A reading older than this is not used.
pub(super) const OLDEST: Duration = Duration::from_secs(1);
/// More than are heard in that time; a flood pushes out the oldest.
const MOST: usize = 64;

/// A time of the radio's clock in microseconds, unwrapped: it goes on where the wire's 32 bits of milliseconds begin
/// again.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct RadioTime(i64);

impl RadioTime {
    /// As it goes over the wire.
    pub fn wire_ms(self) -> u32 {
        // The lower 32 bits: what wraps on the wire does so here.
        (self.0.div_euclid(1000) & i64::from(u32::MAX)) as u32
    }

    /// Whole milliseconds, rounded down.
    fn whole_ms(self) -> Self {
        Self(self.0.div_euclid(1000) * 1000)
    }
}

#[derive(Debug, Clone, Copy)]
struct Reading {
    shown: RadioTime,
    heard_at: Instant,
    asked_at: Option<Instant>,
}

/// What was read of the radio's clock in the last second.
#[derive(Debug, Clone, Default)]
pub(super) struct RadioClock {
    readings: VecDeque<Reading>,
    last: Option<RadioTime>,
}

impl RadioClock {
    /// The clock showed `time_ms` in a message that was heard at `now`; `asked_at`: when the command that it answers
    /// was sent.
    pub fn read(&mut self, time_ms: u32, asked_at: Option<Instant>, now: Instant) {
        let shown = self.unwrap(time_ms);
        self.last = self.last.max(Some(shown));
        self.readings.retain(|reading| now.saturating_since(reading.heard_at) <= OLDEST);
        if self.readings.len() == MOST {
            self.readings.pop_front();
        }
        self.readings.push_back(Reading { shown, heard_at: now, asked_at });
    }

    /// The time nearest to the last reading that the wire writes so.
    pub fn unwrap(&self, time_ms: u32) -> RadioTime {
        let Some(last) = self.last else { return RadioTime(i64::from(time_ms) * 1000) };
        // The signed difference of two counters that wrap.
        let ahead_ms = time_ms.wrapping_sub(last.wire_ms()) as i32;
        RadioTime(last.whole_ms().0 + i64::from(ahead_ms) * 1000)
    }

    fn recent(&self, now: Instant) -> impl Iterator<Item = &Reading> {
        self.readings.iter().filter(move |reading| now.saturating_since(reading.heard_at) <= OLDEST)
    }

    /// The latest whole millisecond that the radio's clock has certainly reached by `instant`, for a command that is
    /// sent at `now`: an expiry at which it is off by then. `None` without a reading that is fresh enough.
    pub fn reached_by(&self, instant: Instant, now: Instant) -> Option<RadioTime> {
        let reached = self.recent(now).map(|reading| {
            let since = between(reading.heard_at, instant);
            // Before the reading the clock showed less, by as much as a fast one gains.
            let drift = drift(since.abs());
            RadioTime(reading.shown.0.saturating_add(since).saturating_sub(drift))
        });
        reached.max().map(RadioTime::whole_ms)
    }

    /// The instant before which the radio's clock has certainly not reached `time`. `None` without an answered reading
    /// that is fresh enough.
    pub fn not_before(&self, time: RadioTime, now: Instant) -> Option<Instant> {
        let answered = self.recent(now).filter_map(|reading| {
            let left = time.0.saturating_sub(reading.shown.0).saturating_sub(1000);
            // A clock that is fast takes that much less to get there. What is past is no promise.
            let left = left.saturating_sub(drift(left.abs()));
            let left = Duration::from_micros(u64::try_from(left).ok()?);
            Some(reading.asked_at? + left)
        });
        answered.max()
    }

    /// How old the last reading is.
    pub fn age(&self, now: Instant) -> Option<Duration> {
        self.readings.back().map(|reading| now.saturating_since(reading.heard_at))
    }
}

/// From `a` to `b` in microseconds, negative if `b` is before `a`.
fn between(a: Instant, b: Instant) -> i64 {
    let micros = |span: Duration| i64::try_from(span.as_micros()).unwrap_or(i64::MAX);
    micros(b.since_start()).saturating_sub(micros(a.since_start()))
}

/// What two clocks may differ by after so many microseconds, rounded up.
fn drift(span: i64) -> i64 {
    span.saturating_mul(DRIFT_PPM).saturating_add(999_999) / 1_000_000
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(ms: u64) -> Instant {
        Instant::from_start(Duration::from_millis(ms))
    }

    #[test]
    fn val_the_bounds_are_those_of_the_protocol() {
        let mut clock = RadioClock::default();
        // Sent at 1000, heard at 1200 to show 50,000.
        clock.read(50_000, Some(at(1000)), at(1200));
        // e = t_r + (T - r), less 100 ppm: 500 ms take away 50 us and the rounding.
        assert_eq!(clock.reached_by(at(1700), at(1200)).map(RadioTime::wire_ms), Some(50_499));
        // On until T - (r - s): of 499 ms, from the sending on, less a millisecond, 100 ppm and the rounding.
        let expiry = clock.unwrap(50_499);
        let until = clock.not_before(expiry, at(1200)).unwrap();
        assert_eq!(until, at(1000) + Duration::from_micros(498_000 - 49 - 1));
        // The later the answer the less is promised; what was not asked promises nothing from below.
        let mut unasked = RadioClock::default();
        unasked.read(50_000, None, at(1200));
        assert_eq!(unasked.not_before(expiry, at(1200)), None);
        assert!(unasked.reached_by(at(1700), at(1200)).is_some());
    }

    #[test]
    fn val_of_several_readings_the_tightest_counts_and_none_beyond_a_second() {
        let mut clock = RadioClock::default();
        clock.read(10_000, Some(at(0)), at(5));
        // 300 ms late, as if the clock had stood still.
        clock.read(10_100, Some(at(100)), at(400));
        let by = |clock: &RadioClock, now| clock.reached_by(at(1000), now).map(RadioTime::wire_ms);
        assert_eq!(by(&clock, at(400)), Some(10_994));
        let expiry = clock.unwrap(10_900);
        assert_eq!(clock.not_before(expiry, at(400)), Some(at(899) - Duration::from_micros(80)));
        assert_eq!(by(&clock, at(1005)), Some(10_994));
        assert_eq!(by(&clock, at(1006)), Some(10_699), "the first is older than a second");
        assert_eq!((by(&clock, at(1401)), clock.not_before(expiry, at(1401))), (None, None));
        assert_eq!(clock.age(at(1401)), Some(Duration::from_millis(1001)));
    }

    #[test]
    fn val_the_clock_wraps() {
        let mut clock = RadioClock::default();
        clock.read(u32::MAX - 99, Some(at(0)), at(10));
        let expiry = clock.reached_by(at(510), at(10)).unwrap();
        assert_eq!(expiry.wire_ms(), 399);
        assert_eq!(clock.unwrap(399), expiry);
        clock.read(300, Some(at(395)), at(405));
        let until = clock.not_before(expiry, at(405)).unwrap();
        assert!(until >= at(493) - Duration::from_millis(1) && until <= at(499), "{until:?}");
        assert_eq!(clock.unwrap(u32::MAX).wire_ms(), u32::MAX);
        assert!(clock.unwrap(u32::MAX) < clock.unwrap(0), "a late message is from before the wrap");
    }
}
