//! The clock of a recorded flight: it plays, stands, goes faster, and leaps.

use std::time::Duration;

use crate::time::Instant;

/// As many seconds of flight in one of the operator's.
const SPEEDS: [f64; 9] = [0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0];
const REAL: usize = 2;

/// See the module.
#[derive(Debug, Clone)]
pub struct Replay {
    length: Duration,
    /// Where the flight stood, and when that was.
    from: Duration,
    since: Instant,
    speed: usize,
    plays: bool,
}

impl Replay {
    /// A flight of this length, which begins to play at `now`.
    #[must_use]
    pub fn new(length: Duration, now: Instant) -> Self {
        Self { length, from: Duration::ZERO, since: now, speed: REAL, plays: true }
    }

    /// Where the flight stands.
    #[must_use]
    pub fn at(&self, now: Instant) -> Duration {
        let passed =
            if self.plays { now.saturating_since(self.since).mul_f64(self.speed()) } else { Duration::ZERO };
        (self.from + passed).min(self.length)
    }

    /// How long it is.
    #[must_use]
    pub fn length(&self) -> Duration {
        self.length
    }

    /// Seconds of flight in one of the operator's.
    #[must_use]
    pub fn speed(&self) -> f64 {
        SPEEDS[self.speed]
    }

    /// Whether it plays, and is not at its end.
    #[must_use]
    pub fn plays(&self, now: Instant) -> bool {
        self.plays && self.at(now) < self.length
    }

    /// Stands, or plays on; at its end it begins again.
    pub fn toggle(&mut self, now: Instant) {
        if self.at(now) >= self.length {
            self.seek(Duration::ZERO, now);
            self.plays = true;
            return;
        }
        self.seek(self.at(now), now);
        self.plays = !self.plays;
    }

    /// A step faster or slower.
    pub fn change_speed(&mut self, faster: bool, now: Instant) {
        self.seek(self.at(now), now);
        let step = if faster { self.speed + 1 } else { self.speed.saturating_sub(1) };
        self.speed = step.min(SPEEDS.len() - 1);
    }

    /// Leaps so far, back where that is below zero.
    pub fn leap(&mut self, seconds: f64, now: Instant) {
        let at = self.at(now);
        let by = Duration::from_secs_f64(seconds.abs());
        self.seek(if seconds < 0.0 { at.saturating_sub(by) } else { at + by }, now);
    }

    /// To an instant of the flight.
    pub fn seek(&mut self, to: Duration, now: Instant) {
        self.from = to.min(self.length);
        self.since = now;
    }
}
