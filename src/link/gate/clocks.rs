//! Whether the clocks of the two ends agree, told when that changes.

use std::time::Duration;

use super::notice::Apart;
use crate::time::{Instant, Utc};

/// Clocks that differ by less are not worth a word.
const WORTH_TELLING: Duration = Duration::from_secs(10);
/// The same for a time that only shows in a signature: after a crash it may be a minute and more ahead of its clock.
const WORTH_TELLING_OF_A_STAMP: Duration = Duration::from_secs(150);

/// A time that is refused for longer is not about to be settled by a challenge.
const PATIENCE: Duration = Duration::from_secs(1);

/// What was last told of one link's clocks.
#[derive(Debug, Default)]
pub(super) struct Clocks {
    /// Ahead of ours by so many microseconds, and whether frames were turned away for it.
    told: Option<(i64, bool)>,
    /// Since when times are refused.
    refused_since: Option<Instant>,
    /// This machine's clock is behind what it has been before.
    pub(super) here_was_later: bool,
}

impl Clocks {
    /// The other end has said its clock.
    pub(super) fn heard(&mut self, there: Utc, here: Utc, refused: bool) -> Option<Apart> {
        if !refused {
            self.refused_since = None;
        }
        self.compare(there, here, refused, WORTH_TELLING)
    }

    /// The other end's clock shows in what it signs, and is refused.
    pub(super) fn seen(&mut self, there: Utc, here: Utc, now: Instant) -> Option<Apart> {
        let since = *self.refused_since.get_or_insert(now);
        if now.saturating_since(since) < PATIENCE {
            return None;
        }
        self.compare(there, here, true, WORTH_TELLING_OF_A_STAMP)
    }

    fn compare(&mut self, there: Utc, here: Utc, refused: bool, worth: Duration) -> Option<Apart> {
        let worth_us = i64::try_from(worth.as_micros()).unwrap_or(i64::MAX);
        let ahead_us = signed_us(there).saturating_sub(signed_us(here));
        if ahead_us.saturating_abs() < worth_us {
            return None;
        }
        let same = self.told.is_some_and(|(told_us, told_refused)| {
            told_refused == refused && told_us.saturating_sub(ahead_us).saturating_abs() < worth_us
        });
        if same {
            return None;
        }
        self.told = Some((ahead_us, refused));
        Some(Apart { there, here, refused, here_was_later: self.here_was_later })
    }
}

fn signed_us(utc: Utc) -> i64 {
    i64::try_from(utc.unix_us).unwrap_or(i64::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    const HERE: Utc = Utc { unix_us: 1_800_000_000_000_000 };

    fn at(ms: u64) -> Instant {
        Instant::from_start(Duration::from_millis(ms))
    }

    fn ahead(seconds: f64) -> Utc {
        Utc { unix_us: HERE.unix_us.saturating_add_signed((seconds * 1e6) as i64) }
    }

    #[test]
    fn spec_clocks_ten_seconds_apart_are_told_and_told_again_when_that_changes_by_as_much() {
        let mut clocks = Clocks::default();
        let mut told = |seconds, refused| clocks.heard(ahead(seconds), HERE, refused).is_some();
        assert!(!told(5.0, false) && !told(9.999_999, false) && !told(-9.999_999, false));
        assert!(told(10.0, false));
        assert!(!told(10.0, false) && !told(19.999_999, false) && !told(10.0, false));
        assert!(told(10.0, true), "now frames are turned away for it");
        assert!(!told(10.0, true));
        assert!(told(20.0, true) && told(-20.0, true));
    }

    #[test]
    fn spec_a_time_that_only_shows_in_a_signature_is_told_when_it_was_refused_for_a_second_on_end() {
        let mut clocks = Clocks::default();
        let far = ahead(1000.0);
        let seen = |clocks: &mut Clocks, ms| clocks.seen(far, HERE, at(ms)).is_some();
        assert!(!seen(&mut clocks, 0) && !seen(&mut clocks, 999));
        clocks.heard(HERE, HERE, false);
        assert!(!seen(&mut clocks, 1000), "one was taken in between");
        clocks.heard(HERE, HERE, true);
        assert!(!seen(&mut clocks, 1999) && seen(&mut clocks, 2000));
    }
}
