//! Proposals that are refused, and when to stop making them.

use std::time::Duration;

use crate::time::Instant;

/// A refused proposal is made again after this; refused for this long altogether, the mission is given up.
const PROPOSE_AGAIN: Duration = Duration::from_millis(500);
const TOO_LONG: Duration = Duration::from_secs(30);

/// What has become of the proposals of one slot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Refusals {
    since: Option<Instant>,
    propose_at: Instant,
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
        Self { since: None, propose_at: now }
    }

    /// Counts a refusal at `now`.
    pub fn count(&mut self, now: Instant) -> Refusal {
        self.propose_at = now + PROPOSE_AGAIN;
        match self.since {
            None => {
                self.since = Some(now);
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

    #[test]
    fn spec_refused_for_half_a_minute_is_given_up() {
        let at = |ms| Instant::from_start(Duration::from_millis(ms));
        let mut refusals = Refusals::none(at(0));
        assert!(refusals.may_propose(at(0)));
        assert_eq!(refusals.count(at(100)), Refusal::First);
        assert!(!refusals.may_propose(at(599)) && refusals.may_propose(at(600)));
        assert_eq!(refusals.count(at(30_100)), Refusal::Another);
        assert_eq!(refusals.count(at(30_101)), Refusal::Last);
    }
}
