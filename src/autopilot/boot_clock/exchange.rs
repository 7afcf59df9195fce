//! Exchanges of TIMESYNC: what each says of when samples were taken.

use std::collections::VecDeque;
use std::time::Duration;

use mavlink::dialects::ardupilotmega::TIMESYNC_DATA;

use super::{BootTime, Tracking, drift, us};
use crate::autopilot::outbox::Address;
use crate::time::Instant;

/// The autopilot's time is asked for so often.
const ASK_EVERY: Duration = Duration::from_millis(200);
/// An exchange older than this is not used. Half of all messages lost either way, one in two million such spans passes
/// without an answer.
const OLDEST: Duration = Duration::from_secs(10);
/// Questions that an answer is taken to: those of six seconds.
const MOST_ASKED: usize = 32;
/// So many questions without an answer, and none is waited for any more: three seconds.
const ENOUGH: u32 = 15;
/// A sample that was taken so much after it was heard contradicts the exchange that says so: more than the drift makes.
const SLACK_US: i64 = 5_000;

#[derive(Debug, Clone, Copy)]
struct Exchange {
    asked_at: Instant,
    shown: BootTime,
    round_trip: Duration,
}

impl Exchange {
    /// When a sample with this stamp was taken at the earliest, in microseconds of our clock.
    fn taken_from(&self, time: BootTime) -> i64 {
        let since = time.0.saturating_sub(self.shown.0);
        us(self.asked_at).saturating_add(since).saturating_sub(drift(since))
    }

    fn contradicts(&self, time: BootTime, heard_at: Instant) -> bool {
        self.taken_from(time) > us(heard_at).saturating_add(SLACK_US)
    }

    fn is_recent(&self, now: Instant) -> bool {
        now.saturating_since(self.asked_at) <= OLDEST
    }
}

/// What was asked and answered of late.
#[derive(Debug, Clone, Default)]
pub(super) struct Exchanges {
    ask_at: Instant,
    /// Questions without an answer so far: what they carried, and when they were sent.
    asked: VecDeque<(i64, Instant)>,
    /// Questions since the last answer.
    unanswered: u32,
    answered: bool,
    recent: VecDeque<Exchange>,
}

impl Exchanges {
    /// Forgets every exchange, and asks at once.
    pub(super) fn clear(&mut self) {
        *self = Self { answered: self.answered, unanswered: self.unanswered, ..Self::default() };
    }

    pub(super) fn ask_at(&self) -> Instant {
        self.ask_at
    }

    pub(super) fn ask(
        &mut self,
        (target_system, target_component): Address,
        now: Instant,
    ) -> Option<TIMESYNC_DATA> {
        if now < self.ask_at {
            return None;
        }
        self.ask_at = now + ASK_EVERY;
        self.unanswered = self.unanswered.saturating_add(1);
        let ts1 = i64::try_from(now.since_start().as_nanos()).unwrap_or(i64::MAX);
        if self.asked.len() == MOST_ASKED {
            self.asked.pop_front();
        }
        self.asked.push_back((ts1, now));
        Some(TIMESYNC_DATA { tc1: 0, ts1, target_system, target_component })
    }

    /// The autopilot's clock has shown `shown` since we asked with `ts1`. `latest`: a sample's stamp and its receipt.
    pub(super) fn answered(
        &mut self,
        ts1: i64,
        shown: BootTime,
        latest: Option<(BootTime, Instant)>,
        now: Instant,
    ) {
        let Some(asked) = self.asked.iter().position(|(asked, _)| *asked == ts1) else { return };
        let Some((_, asked_at)) = self.asked.remove(asked) else { return };
        let exchange = Exchange { asked_at, shown, round_trip: now.saturating_since(asked_at) };
        if latest.is_some_and(|(time, heard_at)| exchange.contradicts(time, heard_at)) {
            return;
        }
        (self.answered, self.unanswered) = (true, 0);
        self.recent.retain(|exchange| exchange.is_recent(now));
        self.recent.push_back(exchange);
    }

    /// A sample that is stamped so was heard: exchanges by which it was taken later than that are of another clock.
    pub(super) fn heard(&mut self, time: BootTime, now: Instant) {
        self.recent.retain(|exchange| !exchange.contradicts(time, now));
    }

    /// The latest of what the exchanges say, in microseconds of our clock.
    pub(super) fn taken_from(&self, time: BootTime, now: Instant) -> Option<i64> {
        self.recent(now).map(|exchange| exchange.taken_from(time)).max()
    }

    pub(super) fn tracking(&self, now: Instant) -> Tracking {
        match self.recent(now).map(|exchange| exchange.round_trip).min() {
            Some(shortest) => Tracking::RoundTrip(shortest),
            None if self.answered => Tracking::Lost,
            None if self.unanswered < ENOUGH => Tracking::Asking,
            None => Tracking::OneWay,
        }
    }

    fn recent(&self, now: Instant) -> impl Iterator<Item = &Exchange> {
        self.recent.iter().filter(move |exchange| exchange.is_recent(now))
    }
}
