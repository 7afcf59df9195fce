//! Offset between the two vehicles' UTC, by the four-timestamp exchange of NTP (RFC 5905, section 8).

use std::collections::VecDeque;
use std::time::Duration;

/// How many exchanges are remembered; the one with the shortest round trip counts.
const MEMORY: usize = 8;

/// An estimate of the peer's clock against ours.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Offset {
    /// Peer's UTC minus ours, microseconds.
    pub offset_us: i64,
    /// Half the round trip: the true offset lies within this of `offset_us`.
    pub uncertainty: Duration,
}

/// Collects exchanges.
#[derive(Debug, Clone, Default)]
pub struct ClockFilter {
    samples: VecDeque<Offset>,
}

impl ClockFilter {
    /// Takes an exchange: request sent (ours), received and answered (peer's), answer received (ours), all UTC in
    /// microseconds. Exchanges that contradict themselves are ignored.
    pub fn take(&mut self, sent_us: u64, received_us: u64, answered_us: u64, returned_us: u64) {
        let (Some(total), Some(held)) =
            (returned_us.checked_sub(sent_us), answered_us.checked_sub(received_us))
        else {
            return;
        };
        let (Some(round_trip), Ok(sent), Ok(received), Ok(answered), Ok(returned)) = (
            total.checked_sub(held),
            i64::try_from(sent_us),
            i64::try_from(received_us),
            i64::try_from(answered_us),
            i64::try_from(returned_us),
        ) else {
            return;
        };
        let offset_us = ((received - sent) / 2).saturating_add((answered - returned) / 2);
        if self.samples.len() == MEMORY {
            self.samples.pop_front();
        }
        self.samples.push_back(Offset { offset_us, uncertainty: Duration::from_micros(round_trip / 2) });
    }

    /// The best estimate so far.
    #[must_use]
    pub fn offset(&self) -> Option<Offset> {
        self.samples.iter().copied().min_by_key(|sample| sample.uncertainty)
    }

    /// Forgets everything, as after a restart of the peer.
    pub fn reset(&mut self) {
        self.samples.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_symmetric_path_gives_the_offset() {
        let mut filter = ClockFilter::default();
        // Peer is 5 ms ahead, 2 ms each way, 1 ms to answer.
        filter.take(1_000_000, 1_007_000, 1_008_000, 1_005_000);
        let offset = filter.offset().unwrap();
        assert_eq!(offset.offset_us, 5_000);
        assert_eq!(offset.uncertainty, Duration::from_millis(2));
    }

    #[test]
    fn val_shortest_round_trip_wins_and_the_truth_lies_within_its_uncertainty() {
        let mut filter = ClockFilter::default();
        filter.take(0, 50_000, 50_000, 60_000); // offset 0 seen through 50 ms out, 10 ms back
        assert!(filter.offset().unwrap().offset_us.unsigned_abs() <= 30_000);
        filter.take(100_000, 101_000, 101_000, 102_000);
        assert_eq!(filter.offset(), Some(Offset { offset_us: 0, uncertainty: Duration::from_millis(1) }));
    }

    #[test]
    fn val_contradictions_are_ignored() {
        let mut filter = ClockFilter::default();
        filter.take(10, 0, 5, 3);
        filter.take(0, 10, 5, 20);
        filter.take(0, 0, 100, 20);
        assert_eq!(filter.offset(), None);
    }
}
