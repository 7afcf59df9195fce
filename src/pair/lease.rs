//! Jam leases: J vouches for its jamming for a while, I radiates only within it (S1, S3).
//!
//! A lease is counted from the instant at which I *asked*, on I's own clock, and J stays on until the same length
//! has passed since it *answered*, on J's own clock. Answering comes after asking, so I's lease ends first whatever
//! the network does with either message and whatever the two clocks say. J's own transmitter falls silent by
//! itself at a known instant (S5); a lease never reaches past it, so it holds even if J's companion dies the moment
//! after granting.
//!
//! J vouches for what the motion that it flies asks of it, and the one that it has made for I to take up. A lease that J granted
//! before it had holds no longer than the newer one asks for no more jamming than the older does.

use std::time::Duration;

use crate::time::Instant;

/// Covers the two companions' clocks, which do not run at quite the same rate.
const MARGIN: Duration = Duration::from_millis(10);

/// I's side: what J has granted.
#[derive(Debug, Clone, Default)]
pub struct Holder {
    expires_at: Option<Instant>,
    given_up_at: Option<Instant>,
    outgrown: Option<Outgrown>,
}

/// I has taken up a motion that asks for more jamming, from an instant on, than J knew of as it granted.
#[derive(Debug, Clone, Copy)]
struct Outgrown {
    at: Instant,
    /// What is asked for from then on is granted by one that knows of it, ...
    known_from: Instant,
    /// ... and what was asked for before this by one that did not even know of the motion before.
    void_before: Option<Instant>,
}

impl Holder {
    /// The end of the lease in force at `now`.
    #[must_use]
    pub fn held(&self, now: Instant) -> Option<Instant> {
        self.expires_at.filter(|&expiry| expiry > now)
    }

    /// When all was given up, if nothing has been taken since.
    #[must_use]
    pub fn given_up_at(&self) -> Option<Instant> {
        self.given_up_at.filter(|_| self.expires_at.is_none())
    }

    /// Takes a grant that answers the request sent at `asked_at`. A grant for a request from the future (another
    /// boot, a corrupted echo) or from before the last giving up is refused; a shorter one than that in force
    /// changes nothing.
    pub fn take(&mut self, asked_at: Instant, duration: Duration, now: Instant) -> bool {
        if asked_at > now || self.given_up_at.is_some_and(|given_up| asked_at <= given_up) {
            return false;
        }
        let mut expires_at = asked_at + duration;
        if let Some(outgrown) = self.outgrown.filter(|outgrown| asked_at < outgrown.known_from) {
            if outgrown.void_before.is_some_and(|known_from| asked_at < known_from) {
                return false;
            }
            expires_at = expires_at.min(outgrown.at);
        }
        self.expires_at = self.expires_at.max(Some(expires_at));
        true
    }

    /// A motion is taken up that asks for more from `at` on, of which J knows since `known_from`: what was asked for before ends then.
    pub fn outgrow(&mut self, at: Instant, known_from: Instant) {
        let void_before = self.outgrown.map(|older| older.known_from);
        self.outgrown = Some(Outgrown { at, known_from, void_before });
        self.expires_at = self.expires_at.map(|expires_at| expires_at.min(at));
    }

    /// Gives the lease up, and with it every grant that answers a request made until now.
    pub fn give_up(&mut self, now: Instant) {
        self.expires_at = None;
        self.given_up_at = Some(now);
    }
}

/// J's side: what has been granted.
#[derive(Debug, Clone, Default)]
pub struct Book {
    outstanding_until: Option<Instant>,
    last_request_us: u64,
}

impl Book {
    /// The length of a lease that may be granted at `now` to the request of `request_us`, and records it: to the
    /// instant up to which J's own transmitter certainly is on, less a margin, no longer than `longest`, no later than `closes_at`. `None`
    /// if nothing is left to grant.
    pub fn grant(
        &mut self,
        request_us: u64,
        on_until: Instant,
        longest: Duration,
        closes_at: Instant,
        now: Instant,
    ) -> Option<Duration> {
        let until = (on_until - MARGIN).min(now + longest).min(closes_at);
        let duration = until.saturating_since(now);
        // The wire counts milliseconds; what is promised is what is sent.
        let duration = Duration::from_millis(u64::try_from(duration.as_millis()).ok()?);
        if duration.is_zero() {
            return None;
        }
        self.outstanding_until = self.outstanding_until.max(Some(now + duration));
        self.last_request_us = self.last_request_us.max(request_us);
        Some(duration)
    }

    /// Whether I may still hold a lease at `now`: J must not stop jamming of its own will.
    #[must_use]
    pub fn outstanding(&self, now: Instant) -> bool {
        self.outstanding_until.is_some_and(|until| until > now)
    }

    /// Until when I may hold one at the most; may be past.
    #[must_use]
    pub fn outstanding_until(&self) -> Option<Instant> {
        self.outstanding_until
    }

    /// The peer restarted: its clock begins anew. What it may hold from before still runs out in its own time.
    pub fn new_boot(&mut self) {
        self.last_request_us = 0;
    }

    /// I is silent and has given up every lease it asked for up to `released_us` of its clock; 0: it may be on the air, by what
    /// a dead boot of it commanded as well. A word sent before the last grant's request says nothing of that grant.
    pub fn returned(&mut self, released_us: u64) {
        if released_us != 0 && released_us >= self.last_request_us {
            self.outstanding_until = None;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(ms: u64) -> Instant {
        Instant::from_start(Duration::from_millis(ms))
    }

    #[test]
    fn spec_lease_counts_from_the_request_whatever_the_delay() {
        let mut holder = Holder::default();
        assert!(holder.take(at(1000), Duration::from_millis(400), at(1300)));
        assert_eq!(holder.held(at(1399)), Some(at(1400)));
        assert_eq!(holder.held(at(1400)), None);
        // Two seconds late: already over.
        assert!(holder.take(at(1500), Duration::from_millis(400), at(3500)));
        assert_eq!(holder.held(at(3500)), None);
    }

    #[test]
    fn spec_grant_from_the_future_is_refused() {
        let mut holder = Holder::default();
        assert!(!holder.take(at(2000), Duration::from_millis(400), at(1000)));
        assert_eq!(holder.held(at(1000)), None);
    }

    #[test]
    fn spec_a_grant_may_come_in_the_instant_of_its_request() {
        let mut holder = Holder::default();
        assert!(holder.take(at(1000), Duration::from_millis(400), at(1000)));
        assert_eq!(holder.held(at(1000)), Some(at(1400)));
    }

    #[test]
    fn spec_older_grant_does_not_shorten() {
        let mut holder = Holder::default();
        holder.take(at(1000), Duration::from_millis(400), at(1010));
        holder.take(at(900), Duration::from_millis(100), at(1020));
        assert_eq!(holder.held(at(1100)), Some(at(1400)));
    }

    #[test]
    fn spec_grant_for_a_request_given_up_is_refused() {
        let mut holder = Holder::default();
        holder.give_up(at(1000));
        assert!(!holder.take(at(1000), Duration::from_millis(400), at(1010)));
        assert!(holder.take(at(1001), Duration::from_millis(400), at(1010)));
    }

    #[test]
    fn spec_a_lease_ends_where_a_motion_asks_for_more_of_which_j_did_not_know() {
        let ms = Duration::from_millis;
        let mut holder = Holder::default();
        assert!(holder.take(at(1000), ms(600), at(1010)));
        holder.outgrow(at(1200), at(1090));
        assert_eq!(holder.held(at(1100)), Some(at(1200)));
        // Granted before J knew, whenever it comes.
        assert!(holder.take(at(1089), ms(600), at(1110)));
        assert_eq!(holder.held(at(1110)), Some(at(1200)));
        assert!(holder.take(at(1090), ms(600), at(1120)));
        assert_eq!(holder.held(at(1120)), Some(at(1690)));
        // Nothing is longer for a newer motion, and of the one before the last nothing holds.
        holder.outgrow(at(1600), at(1300));
        assert_eq!(holder.held(at(1310)), Some(at(1600)));
        holder.give_up(at(1050));
        assert!(!holder.take(at(1089), ms(900), at(1320)));
        assert!(holder.take(at(1090), ms(900), at(1320)));
        assert_eq!(holder.held(at(1320)), Some(at(1600)));
        assert!(holder.take(at(1300), ms(600), at(1330)));
        assert_eq!(holder.held(at(1330)), Some(at(1900)));
    }

    #[test]
    fn spec_a_word_from_before_the_grant_returns_nothing() {
        let mut book = Book::default();
        book.grant(700, at(1500), Duration::from_secs(1), at(9000), at(1000)).unwrap();
        book.returned(699);
        assert!(book.outstanding(at(1100)));
        book.returned(700);
        assert!(!book.outstanding(at(1100)));
    }

    #[test]
    fn spec_after_a_restart_of_i_its_clock_counts_anew() {
        let mut book = Book::default();
        book.grant(9_000_000, at(1500), Duration::from_secs(1), at(9000), at(1000)).unwrap();
        book.new_boot();
        assert!(book.outstanding(at(1100)), "the dead boot's radio may still be on");
        book.returned(0);
        assert!(book.outstanding(at(1100)), "the new boot does not know of its radio yet");
        // It has found it off.
        book.returned(50_000);
        assert!(!book.outstanding(at(1100)));
    }

    #[test]
    fn spec_grant_ends_before_own_transmitter_and_slot() {
        let mut book = Book::default();
        let long = Duration::from_secs(1);
        let granted = book.grant(1, at(1500), long, at(9000), at(1000)).unwrap();
        assert_eq!(granted, Duration::from_millis(490));
        assert!(book.outstanding(at(1489)));
        assert!(!book.outstanding(at(1490)));
        assert_eq!(book.grant(1, at(2000), long, at(1600), at(1500)), Some(Duration::from_millis(100)));
        assert_eq!(book.grant(1, at(1010), long, at(9000), at(1000)), None);
    }
}
