//! How old the peer's words are: by its own monotonic clock, which they name, and which is compared with nothing but itself.
//!
//! Receipt less sending, each by its own clock, is what the clocks differ by and the time under way. That is never less
//! than nothing, so that what a word has more of it than the fastest of all, it was held up for at least. Two crystals
//! drift apart meanwhile, and no word is taken for older than it is: the least difference grows by as much. Every link is
//! uneven; what is late by no more than [`UNEVEN`] counts as if it had come at once.

use std::time::Duration;

use crate::time::Instant;

/// What a link that serves holds up without anybody's harm.
const UNEVEN: Duration = Duration::from_millis(100);
/// No two crystals drift apart faster than a microsecond in this many.
const DRIFTS_IN_US: u64 = 5_000;

/// What is known of one boot's clock against ours.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Ages {
    /// The least difference in microseconds, and when it was found.
    least: Option<(i64, Instant)>,
}

impl Ages {
    /// For how long a word was held up at the least, that was sent at `sent_us` of its sender's clock and is heard at `now`. Of one
    /// that names no time (0) nothing is known.
    pub fn of(&mut self, sent_us: u64, now: Instant) -> Duration {
        if sent_us == 0 {
            return Duration::ZERO;
        }
        let micros = |span: Duration| u64::try_from(span.as_micros()).unwrap_or(u64::MAX);
        let signed = |us: u64| i64::try_from(us).unwrap_or(i64::MAX);
        let apart = signed(micros(now.since_start())) - signed(sent_us);
        let drift = |since: Instant| signed(micros(now.saturating_since(since)).div_ceil(DRIFTS_IN_US));
        let least = self.least.map(|(least, since)| least.saturating_add(drift(since)));
        match least {
            Some(least) if apart > least => {
                Duration::from_micros(apart.abs_diff(least)).saturating_sub(UNEVEN)
            }
            Some(_) | None => {
                self.least = Some((apart, now));
                Duration::ZERO
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn us(us: u64) -> Duration {
        Duration::from_micros(us)
    }

    fn at(at_us: u64) -> Instant {
        Instant::from_start(us(at_us))
    }

    #[test]
    fn val_a_word_is_as_old_as_it_was_longer_under_way_than_the_fastest_and_a_link_is_uneven() {
        // The peer's clock is 7 s ahead of ours, or behind.
        for (ahead_us, now_us) in [(7_000_000, 1_000_000), (-7_000_000, 9_000_000)] {
            let mut ages = Ages::default();
            let mut age = |way_us: u64| {
                let sent_us = (now_us - way_us).checked_add_signed(ahead_us).unwrap();
                ages.of(sent_us, at(now_us))
            };
            assert_eq!(age(3000), us(0), "the first may be the fastest");
            assert_eq!(age(103_001), us(1));
            assert_eq!(age(1000), us(0));
            assert_eq!([101_000, 101_001, 801_000].map(age), [us(0), us(1), us(700_000)]);
        }
    }

    #[test]
    fn val_the_difference_of_two_crystals_makes_no_word_older_than_it_is() {
        let mut ages = Ages::default();
        let (start_us, hour_us) = (1_000_000, 3_600_000_000);
        ages.of(start_us, at(start_us));
        // In an hour the peer's clock loses 0.72 s, the worst of two crystals.
        let late_us = 720_000 + 100_000;
        assert_eq!(ages.of(start_us + hour_us - late_us, at(start_us + hour_us)), us(0));
        assert_eq!(ages.of(start_us + hour_us - late_us - 1, at(start_us + hour_us)), us(1));
        // The fastest counts from when it was heard.
        assert_eq!(ages.of(start_us + hour_us - 720_000, at(start_us + hour_us)), us(0));
        assert_eq!(ages.of(start_us + hour_us - 720_000, at(start_us + hour_us + 300_000)), us(199_940));
    }

    #[test]
    fn spec_a_word_without_a_time_is_of_its_receipt_and_teaches_nothing() {
        let mut ages = Ages::default();
        ages.of(500_000, at(1_000_000));
        assert_eq!(ages.of(0, at(2_000_000)), us(0));
        assert_eq!(ages.of(500_000, at(2_000_000)), us(899_800));
        // Nor does a time that is none come to anything.
        assert_eq!(ages.of(u64::MAX, at(2_000_000)), us(0));
        assert!(ages.of(1, at(3_000_000)) > us(3_600_000_000));
    }
}
