//! Numbers that were never used before, and none of which is remembered: each is a keyed hash of whom it was made for and
//! when, so that no flood of strangers can make us forget whom we have asked.

use std::hash::{BuildHasher, RandomState};
use std::time::Duration;

use crate::link::transport::Origin;
use crate::time::Instant;

/// A number is good until the end of the next of these.
const SLOT: Duration = Duration::from_secs(2);
/// Below 2^63 and not zero, for messages in which a time carries it.
const BITS: u64 = i64::MAX as u64;

/// The numbers of one link. Their key is the operating system's random numbers, drawn at each start.
#[derive(Debug, Default)]
pub(super) struct Nonces(RandomState);

impl Nonces {
    /// The number for `origin` at this time.
    pub(super) fn make(&self, origin: Origin, now: Instant) -> u64 {
        self.of(origin, slot(now))
    }

    /// Whether this number was made for `origin` not long ago.
    pub(super) fn made(&self, nonce: u64, origin: Origin, now: Instant) -> bool {
        let slot = slot(now);
        [Some(slot), slot.checked_sub(1)].into_iter().flatten().any(|slot| self.of(origin, slot) == nonce)
    }

    fn of(&self, origin: Origin, slot: u64) -> u64 {
        (self.0.hash_one((origin, slot)) & BITS).max(1)
    }
}

fn slot(now: Instant) -> u64 {
    now.since_start().as_secs() / SLOT.as_secs()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spec_a_number_is_its_origin_s_alone_and_good_to_the_end_of_the_next_two_seconds() {
        let at = |ms| Instant::from_start(Duration::from_millis(ms));
        let (nonces, others) = (Nonces::default(), Nonces::default());
        let (peer, elsewhere) = (Origin::Peer, Origin::Connection(1));
        for (made_ms, last_ms) in [(0, 3999), (1999, 3999), (2000, 5999), (9000, 11_999)] {
            let nonce = nonces.make(peer, at(made_ms));
            assert!(nonce > 0 && nonce <= BITS);
            assert!(nonces.made(nonce, peer, at(made_ms)) && nonces.made(nonce, peer, at(last_ms)));
            assert!(!nonces.made(nonce, peer, at(last_ms + 1)), "{made_ms}");
            assert!(!nonces.made(nonce, elsewhere, at(made_ms)));
            assert!(!others.made(nonce, peer, at(made_ms)), "another run's");
        }
    }
}
