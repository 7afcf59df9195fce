//! Proposals that are refused, and when to stop making them.

use std::time::Duration;

use crate::time::Instant;

/// A refused proposal is made again after this; refused for this long altogether, the mission is given up.
const PROPOSE_AGAIN: Duration = Duration::from_millis(500);
const TOO_LONG: Duration = Duration::from_secs(30);

/// What has become of the proposals of one slot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Refusals {
    /// By the other vehicle, and by our own transmitter: each is news of its own.
    peer_since: Option<Instant>,
    radio_since: Option<Instant>,
    propose_at: Instant,
}

/// Who refuses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum By {
    Peer,
    Radio,
}

/// What a refusal is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Refusal {
    First,
    Another,
    /// One too many.
    Last,
}

impl Refusals {
    /// None yet; may be proposed from `now` on.
    pub fn none(now: Instant) -> Self {
        Self { peer_since: None, radio_since: None, propose_at: now }
    }

    /// Counts a refusal at `now`.
    pub fn count(&mut self, by: By, now: Instant) -> Refusal {
        self.propose_at = now + PROPOSE_AGAIN;
        let since = match by {
            By::Peer => &mut self.peer_since,
            By::Radio => &mut self.radio_since,
        };
        match *since {
            None => {
                *since = Some(now);
                Refusal::First
            }
            Some(since) if now.saturating_since(since) > TOO_LONG => Refusal::Last,
            Some(_) => Refusal::Another,
        }
    }

    /// Whether a proposal may be made at `now`.
    pub fn may_propose(&self, now: Instant) -> bool {
        now >= self.propose_at
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(ms: u64) -> Instant {
        Instant::from_start(Duration::from_millis(ms))
    }

    #[test]
    fn spec_refused_for_half_a_minute_is_given_up() {
        let mut refusals = Refusals::none(at(0));
        assert!(refusals.may_propose(at(0)));
        assert_eq!(refusals.count(By::Peer, at(100)), Refusal::First);
        assert!(!refusals.may_propose(at(599)) && refusals.may_propose(at(600)));
        assert_eq!(refusals.count(By::Peer, at(30_100)), Refusal::Another);
        assert_eq!(refusals.count(By::Peer, at(30_101)), Refusal::Last);
    }

    #[test]
    fn spec_a_radio_that_is_not_ready_is_news_after_a_peer_that_refused() {
        let mut refusals = Refusals::none(at(0));
        assert_eq!(refusals.count(By::Peer, at(100)), Refusal::First);
        assert_eq!(refusals.count(By::Radio, at(20_000)), Refusal::First);
        assert!(!refusals.may_propose(at(20_499)), "the wait is one");
        assert_eq!(refusals.count(By::Radio, at(40_000)), Refusal::Another, "its half minute is its own");
    }
}
