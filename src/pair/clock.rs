//! Offset between the two vehicles' UTC, by the four-timestamp exchange of NTP (RFC 5905, section 8).

use std::collections::VecDeque;
use std::time::Duration;

/// How many exchanges are remembered; the one with the shortest round trip counts.
const MEMORY: usize = 8;
/// How many requests may be under way.
const UNDER_WAY: usize = 4;
/// Two measurements that are further apart than both their uncertainties and this, which covers years of drift
/// between two samples, are of two different settings of a clock.
const DRIFT: Duration = Duration::from_millis(5);

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
    /// Our UTC at the sending of the requests that are not answered.
    asked_us: VecDeque<u64>,
}

impl ClockFilter {
    /// A request is sent at this UTC of ours, microseconds.
    pub fn ask(&mut self, sent_us: u64) {
        if self.asked_us.len() == UNDER_WAY {
            self.asked_us.pop_front();
        }
        self.asked_us.push_back(sent_us);
    }

    /// Takes an exchange: request sent (ours), received and answered (peer's), answer received (ours), all UTC in
    /// microseconds. Exchanges that contradict themselves, and answers to no request of ours, are ignored. A
    /// measurement that contradicts older ones replaces them: one of the clocks was set.
    pub fn take(&mut self, sent_us: u64, received_us: u64, answered_us: u64, returned_us: u64) {
        let Some(request) = self.asked_us.iter().position(|&asked| asked == sent_us) else { return };
        self.asked_us.remove(request);
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
        let new = Offset { offset_us, uncertainty: Duration::from_micros(round_trip / 2) };
        self.samples.retain(|old| {
            let apart = Duration::from_micros(old.offset_us.abs_diff(new.offset_us));
            apart <= old.uncertainty + new.uncertainty + DRIFT
        });
        if self.samples.len() == MEMORY {
            self.samples.pop_front();
        }
        self.samples.push_back(new);
    }

    /// The best estimate so far.
    #[must_use]
    pub fn offset(&self) -> Option<Offset> {
        self.samples.iter().copied().min_by_key(|sample| sample.uncertainty)
    }

    /// Forgets everything, as after a restart of the peer or a step of our own clock.
    pub fn reset(&mut self) {
        self.samples.clear();
        self.asked_us.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn exchange(filter: &mut ClockFilter, [sent, received, answered, returned]: [u64; 4]) {
        filter.ask(sent);
        filter.take(sent, received, answered, returned);
    }

    #[test]
    fn val_symmetric_path_gives_the_offset() {
        let mut filter = ClockFilter::default();
        // Peer is 5 ms ahead, 2 ms each way, 1 ms to answer.
        exchange(&mut filter, [1_000_000, 1_007_000, 1_008_000, 1_005_000]);
        let offset = filter.offset().unwrap();
        assert_eq!(offset.offset_us, 5_000);
        assert_eq!(offset.uncertainty, Duration::from_millis(2));
    }

    #[test]
    fn val_shortest_round_trip_wins_and_the_truth_lies_within_its_uncertainty() {
        let mut filter = ClockFilter::default();
        exchange(&mut filter, [0, 50_000, 50_000, 60_000]); // offset 0 seen through 50 ms out, 10 ms back
        assert!(filter.offset().unwrap().offset_us.unsigned_abs() <= 30_000);
        exchange(&mut filter, [100_000, 101_000, 101_000, 102_000]);
        assert_eq!(filter.offset(), Some(Offset { offset_us: 0, uncertainty: Duration::from_millis(1) }));
    }

    #[test]
    fn spec_contradictions_are_ignored() {
        let mut filter = ClockFilter::default();
        exchange(&mut filter, [10, 0, 5, 3]);
        exchange(&mut filter, [0, 10, 5, 20]);
        exchange(&mut filter, [0, 0, 100, 20]);
        assert_eq!(filter.offset(), None);
    }

    #[test]
    fn spec_an_answer_to_no_request_is_ignored() {
        let mut filter = ClockFilter::default();
        filter.take(0, 10, 10, 20);
        assert_eq!(filter.offset(), None);
        filter.ask(0);
        filter.take(0, 10, 10, 20);
        let first = filter.offset();
        filter.take(0, 900, 900, 20); // a copy, or forged
        assert_eq!(filter.offset(), first);
        filter.ask(100);
        filter.reset(); // our clock was set: what it said before is no measure
        filter.take(100, 110, 110, 120);
        assert_eq!(filter.offset(), None);
    }

    #[test]
    fn spec_a_step_of_the_peer_s_clock_replaces_what_was_measured_before_it() {
        let mut filter = ClockFilter::default();
        exchange(&mut filter, [0, 1_000, 1_000, 2_000]);
        // Ten seconds ahead since, seen through a slower exchange.
        exchange(&mut filter, [1_000_000, 11_030_000, 11_030_000, 1_060_000]);
        assert_eq!(
            filter.offset(),
            Some(Offset { offset_us: 10_000_000, uncertainty: Duration::from_millis(30) })
        );
    }

    #[test]
    fn spec_four_requests_may_be_under_way_and_the_fifth_forgets_the_first() {
        let asked = |requests: u64| {
            let mut filter = ClockFilter::default();
            (0..requests).for_each(|k| filter.ask(k));
            filter.take(0, 10, 10, 20);
            filter.offset().is_some()
        };
        assert!(asked(4) && !asked(5));
    }

    #[test]
    fn val_measurements_apart_by_no_more_than_both_uncertainties_and_5_ms_agree() {
        // The second is off by 8 ms, and both are uncertain: 1 ms and 2 ms.
        for (beyond_us, the_first_stays) in [(0, true), (2, false)] {
            let mut filter = ClockFilter::default();
            exchange(&mut filter, [0, 1_000, 1_000, 2_000]);
            let peer_us = 1_010_000 + beyond_us;
            exchange(&mut filter, [1_000_000, peer_us, peer_us, 1_004_000]);
            assert_eq!(filter.offset().unwrap().offset_us == 0, the_first_stays, "{beyond_us}");
        }
    }

    #[test]
    fn spec_the_best_of_the_last_eight_counts() {
        let mut filter = ClockFilter::default();
        exchange(&mut filter, [0, 1_000, 1_000, 2_000]);
        for k in 1..=8 {
            assert_eq!(filter.offset().unwrap().uncertainty, Duration::from_millis(1), "{k}");
            let sent = k * 1_000_000;
            exchange(&mut filter, [sent, sent + 2_000, sent + 2_000, sent + 4_000]);
        }
        assert_eq!(filter.offset().unwrap().uncertainty, Duration::from_millis(2));
    }
}
