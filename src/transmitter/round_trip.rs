//! How long the radio takes to answer, as of late.

use std::collections::VecDeque;
use std::time::Duration;

use crate::time::Instant;

/// A measurement counts for so long.
const REMEMBERED: Duration = Duration::from_secs(3);
/// More than are made in that time; a flood of answers pushes out the oldest.
const MOST: usize = 64;

/// The round trips measured of late. Neither the best nor the worst is remembered beyond its time: the way of an
/// hour ago says nothing of the next slot, and one stall says nothing of the way.
#[derive(Debug, Clone, Default)]
pub(super) struct RoundTrips {
    measured: VecDeque<(Instant, Duration)>,
}

impl RoundTrips {
    /// A command sent at `sent_at` was answered at `now`.
    pub fn add(&mut self, sent_at: Instant, now: Instant) {
        let old = |(at, _): &(Instant, Duration)| now.saturating_since(*at) > REMEMBERED;
        while self.measured.len() >= MOST || self.measured.front().is_some_and(old) {
            self.measured.pop_front();
        }
        self.measured.push_back((now, now.saturating_since(sent_at)));
    }

    /// The median of the last three seconds; `None` if nothing was answered in that time.
    pub fn median(&self, now: Instant) -> Option<Duration> {
        let recent = self.measured.iter().filter(|(at, _)| now.saturating_since(*at) <= REMEMBERED);
        let mut recent: Vec<Duration> = recent.map(|(_, round_trip)| *round_trip).collect();
        recent.sort_unstable();
        recent.get(recent.len() / 2).copied()
    }

    /// The last one, however old.
    pub fn last(&self) -> Option<Duration> {
        self.measured.back().map(|(_, round_trip)| *round_trip)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(ms: u64) -> Instant {
        Instant::from_start(Duration::from_millis(ms))
    }

    #[test]
    fn spec_one_stall_changes_nothing_and_every_value_ages_out() {
        let mut trips = RoundTrips::default();
        assert_eq!(trips.median(at(0)), None);
        trips.add(at(0), at(900));
        assert_eq!(trips.median(at(900)), Some(Duration::from_millis(900)), "all that is known");
        for sent in [1000, 1250, 1500] {
            trips.add(at(sent), at(sent + 20));
        }
        assert_eq!(trips.median(at(1600)), Some(Duration::from_millis(20)));
        // The way has grown longer: what it was is forgotten in time.
        for sent in [5000, 5250] {
            trips.add(at(sent), at(sent + 400));
        }
        assert_eq!(trips.median(at(5650)), Some(Duration::from_millis(400)));
        assert_eq!(trips.median(at(8651)), None);
    }

    #[test]
    fn spec_a_new_measurement_pushes_out_none_that_still_counts() {
        let mut trips = RoundTrips::default();
        for (sent, took) in [(1000, 20), (1250, 20), (1500, 900)] {
            trips.add(at(sent), at(sent + took));
        }
        assert_eq!(trips.median(at(2400)), Some(Duration::from_millis(20)));
        assert_eq!(trips.last(), Some(Duration::from_millis(900)));
    }
}
