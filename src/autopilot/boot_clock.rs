//! When a sample of the autopilot was taken, on our clock.
//!
//! Telemetry carries `time_boot_ms`, the autopilot's own clock B at which it was sampled; what counts for a decision is
//! how long ago that was, not when it was received. Both clocks may drift against each other by [`DRIFT_PPM`].
//!
//! *From a round trip.* We ask by TIMESYNC at our instant s; the autopilot answers with its clock c, read at some instant
//! t between our asking and our hearing. PX4 and ArduPilot both answer with nanoseconds since boot, on the clock that
//! telemetry is stamped by. A sample that is stamped b was taken b - c after t, but for drift, and t is not before s:
//!
//! taken >= s + (b - c) - drift |b - c|.
//!
//! This is certain, whatever the delays and however they differ by direction; it is too early by the time that the
//! request was under way, so that an age is overstated by that much and never understated. Cutting stamps to whole
//! milliseconds makes them earlier, which is the safe side. Every exchange gives such a bound and the latest counts, so
//! that of ten seconds of exchanges the least delayed request does. A constant delay of telemetry is seen by it.
//!
//! *From one way alone*, where TIMESYNC is never answered: no sample was received before it was taken, so that B lags our
//! clock by at most r - b for every receipt r. The smallest of these over a minute (the lower envelope of the delay) is
//! taken for the lag, that is, the least delayed message for one without delay. A delay that is there from the beginning,
//! or stays for longer than a minute, cannot be seen so; the preflight says it. An autopilot that has answered once must
//! go on doing so: after ten seconds without an answer nothing is known of its samples' age.
//!
//! *Contradiction.* No sample was taken after it was received. An exchange by which one was names a clock that is no more
//! (it was set, or ran faster than it may), and is forgotten. A clock that goes back is a restart, if what it shows now
//! can have passed since it was last heard, and else a message that was overtaken.

mod envelope;
mod exchange;

use std::time::Duration;

use mavlink::dialects::ardupilotmega::{MavMessage, TIMESYNC_DATA};

use crate::time::Instant;

use super::outbox::Address;
use envelope::Envelope;
use exchange::Exchanges;

/// The most by which the rates of the two clocks differ: each of them a crystal that is off by up to 100 ppm.
const DRIFT_PPM: i64 = 200;
/// A boot clock that goes back by no more than this is reordering on the way.
const BACKWARDS_US: i64 = 2_000_000;
/// So much more than the time since it was last heard may have passed since a restart: delays differ.
const BOOTING_US: i64 = 10_000_000;

/// A time of the autopilot's clock in microseconds, unwrapped: it goes on where the 32 bits of milliseconds begin again.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct BootTime(i64);

impl BootTime {
    /// For tests to which the time does not matter.
    #[cfg(test)]
    pub(super) const ZERO: Self = Self(0);

    /// Seconds from `earlier` to `self`, negative if it is later.
    pub(super) fn seconds_since(self, earlier: Self) -> f64 {
        self.0.saturating_sub(earlier.0) as f64 * 1e-6
    }

    /// As telemetry carries it: the lower 32 bits of whole milliseconds.
    fn wire_ms(self) -> u32 {
        (self.0.div_euclid(1000) & i64::from(u32::MAX)) as u32
    }
}

/// What is known of how long messages are under way.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Tracking {
    /// Round trips bound it; the shortest of late.
    RoundTrip(Duration),
    /// TIMESYNC has been answered, and is no more.
    Lost,
    /// It has not been answered, and not asked often enough to say that it never is.
    Asking,
    /// It is never answered: one way alone.
    OneWay,
}

/// The autopilot's clock, tracked.
#[derive(Debug, Clone, Default)]
pub(super) struct BootClock {
    /// The latest time of its own that the autopilot has named, and when that was heard.
    latest: Option<(BootTime, Instant)>,
    /// The first since it was found or restarted, likewise; or one since then that was less under way.
    first: Option<(BootTime, Instant)>,
    exchanges: Exchanges,
    envelope: Envelope,
}

impl BootClock {
    /// Forgets everything but whether TIMESYNC is answered: a restarted autopilot is the same program.
    pub(super) fn clear(&mut self) {
        self.latest = None;
        self.first = None;
        self.exchanges.clear();
        self.envelope = Envelope::default();
    }

    /// Whether a message that is stamped so and heard at `now` shows that the autopilot has restarted.
    pub(super) fn shows_restart(&self, boot_ms: u32, now: Instant) -> bool {
        let Some((latest, heard_at)) = self.latest else { return false };
        let back = latest.0.saturating_sub(self.unwrap(boot_ms).0);
        // A clock that began anew shows no more than can have passed; a message that was overtaken shows more.
        let passed = us(now).saturating_sub(us(heard_at)).saturating_add(BOOTING_US);
        back > BACKWARDS_US && i64::from(boot_ms).saturating_mul(1000) <= passed
    }

    /// Takes the stamp of a message that is heard at `now`.
    pub(super) fn hear(&mut self, boot_ms: u32, now: Instant) -> BootTime {
        let time = self.unwrap(boot_ms);
        // None is heard before it was taken: what names a later time was longer under way.
        if self.on_our_clock(time).is_none_or(|taken| taken > now) {
            self.first = Some((time, now));
        }
        if self.latest.is_none_or(|(latest, _)| time > latest) {
            self.latest = Some((time, now));
        }
        self.envelope.hear(time, now);
        self.exchanges.heard(time, now);
        time
    }

    /// When the sample that is stamped so was taken, at the earliest; `None` while that is not known.
    pub(super) fn taken_from(&self, time: BootTime, now: Instant) -> Option<Instant> {
        let taken = match self.exchanges.tracking(now) {
            Tracking::RoundTrip(_) => self.exchanges.taken_from(time, now),
            Tracking::OneWay => self.envelope.taken_at(time, now),
            Tracking::Lost | Tracking::Asking => None,
        };
        // What was taken before our own clock began cannot be named on it.
        taken.and_then(|us| u64::try_from(us).ok()).map(|us| Instant::from_start(Duration::from_micros(us)))
    }

    /// When the sample that is stamped so was probably taken: in the middle of what the shortest round trip leaves open.
    pub(super) fn probably_taken(&self, time: BootTime, now: Instant) -> Option<Instant> {
        match self.exchanges.tracking(now) {
            Tracking::RoundTrip(shortest) => Some(self.taken_from(time, now)? + shortest / 2),
            Tracking::OneWay => self.taken_from(time, now),
            Tracking::Lost | Tracking::Asking => self.on_our_clock(time),
        }
    }

    /// The autopilot's time on our clock, but for the delay of its least delayed message and the drift: for the time between samples.
    pub(super) fn on_our_clock(&self, time: BootTime) -> Option<Instant> {
        let (first, heard_at) = self.first?;
        let since = time.0.saturating_sub(first.0);
        let span = Duration::from_micros(since.unsigned_abs());
        Some(if since < 0 { heard_at - span } else { heard_at + span })
    }

    /// A question of the autopilot's time, if one is due at `now`.
    pub(super) fn ask(&mut self, autopilot: Address, now: Instant) -> Option<MavMessage> {
        self.exchanges.ask(autopilot, now).map(MavMessage::TIMESYNC)
    }

    /// When the next question is due.
    pub(super) fn timeout(&self) -> Instant {
        self.exchanges.ask_at()
    }

    /// Takes an answer; questions of the autopilot's, and answers to others, are nothing to us.
    pub(super) fn handle_timesync(&mut self, message: &TIMESYNC_DATA, now: Instant) {
        if message.tc1 <= 0 {
            return;
        }
        let (whole_ms, rest_ns) = (message.tc1 / 1_000_000, message.tc1 % 1_000_000);
        // Near what telemetry is stamped by, which wraps.
        let BootTime(shown) = self.unwrap((whole_ms & i64::from(u32::MAX)) as u32);
        let shown = BootTime(shown.saturating_add(rest_ns / 1000));
        self.exchanges.answered(message.ts1, shown, self.latest, now);
    }

    /// How well the clock is known.
    pub(super) fn tracking(&self, now: Instant) -> Tracking {
        self.exchanges.tracking(now)
    }

    /// The time nearest to the latest one that is stamped so.
    fn unwrap(&self, boot_ms: u32) -> BootTime {
        let Some((latest, _)) = self.latest else { return BootTime(i64::from(boot_ms) * 1000) };
        // The signed difference of two counters that wrap.
        let ahead_ms = boot_ms.wrapping_sub(latest.wire_ms()) as i32;
        BootTime(latest.0.div_euclid(1000).saturating_add(i64::from(ahead_ms)).saturating_mul(1000))
    }
}

/// Microseconds of our clock.
fn us(at: Instant) -> i64 {
    i64::try_from(at.since_start().as_micros()).unwrap_or(i64::MAX)
}

/// What the two clocks may differ by after so many microseconds, rounded up.
fn drift(span_us: i64) -> i64 {
    (span_us.saturating_abs().saturating_mul(DRIFT_PPM) / 1_000_000).saturating_add(1)
}

#[cfg(test)]
mod tests;
