//! UTC on this vehicle, and how far the peer's is from it.

use std::time::Duration;

use crate::planner::track::APART_S;
use crate::time::{Instant, Utc};

use super::super::clock::{ClockFilter, Offset};
use super::super::wire::{self, MavMessage};

const COMPARE_EVERY: Duration = Duration::from_millis(1000);

/// See the module.
#[derive(Debug, Clone)]
pub(super) struct SharedTime {
    /// The largest difference between the two UTC clocks that the guard time covers.
    tolerance: Duration,
    utc: Option<(Utc, Instant)>,
    filter: ClockFilter,
    /// When the clocks are compared next.
    pub due: Instant,
}

impl SharedTime {
    pub fn new(tolerance: Duration, now: Instant) -> Self {
        Self { tolerance, utc: None, filter: ClockFilter::default(), due: now }
    }

    /// UTC at `now`, from our autopilot. A step of it makes every comparison with the peer's clock void.
    pub fn set_utc(&mut self, utc: Option<Utc>, now: Instant) {
        if let (Some(expected), Some(utc)) = (self.utc_at(now), utc) {
            let step = Duration::from_micros(expected.unix_us.abs_diff(utc.unix_us));
            if step > self.tolerance / 2 {
                self.filter.reset();
                self.due = now;
            }
        }
        self.utc = utc.map(|utc| (utc, now));
    }

    /// Another boot of the peer has another clock.
    pub fn reset(&mut self) {
        self.filter.reset();
    }

    fn utc_at(&self, now: Instant) -> Option<Utc> {
        self.utc.map(|(utc, at)| utc + now.saturating_since(at))
    }

    /// The instant of a UTC, by our own clock.
    pub fn instant_of(&self, utc: Utc) -> Option<Instant> {
        let (known, at) = self.utc?;
        Some(at + utc.saturating_since(known) - known.saturating_since(utc))
    }

    /// The instant at which the peer's clock shows a UTC, by our own clock; `None` where that is not known as well as two vehicles
    /// that turn together must know it.
    pub fn instant_by_peer(&self, utc: Utc) -> Option<Instant> {
        let known = |offset: &Offset| offset.uncertainty.as_secs_f64() <= APART_S;
        let Offset { offset_us, .. } = self.filter.offset().filter(known)?;
        self.instant_of(Utc { unix_us: utc.unix_us.checked_add_signed(offset_us.checked_neg()?)? })
    }

    /// Peer's UTC against ours.
    pub fn offset(&self) -> Option<Offset> {
        self.filter.offset()
    }

    /// Whether the clocks were compared, and are not certain to differ by more than the guard time covers.
    pub fn agrees(&self) -> bool {
        let certain = |offset: Offset| {
            Duration::from_micros(offset.offset_us.unsigned_abs()).saturating_sub(offset.uncertainty)
        };
        self.filter.offset().is_some_and(|offset| certain(offset) <= self.tolerance)
    }

    /// The question to the peer's clock, if it is due.
    pub fn ask(&mut self, now: Instant) -> Option<MavMessage> {
        if self.due > now {
            return None;
        }
        self.due = now + COMPARE_EVERY;
        let utc = self.utc_at(now)?;
        self.filter.ask(utc.unix_us);
        let request = wire::VEILWING_CLOCK_DATA { originate_us: utc.unix_us, receive_us: 0, transmit_us: 0 };
        Some(MavMessage::VEILWING_CLOCK(request))
    }

    /// Takes a question, which it answers, or an answer.
    pub fn take(&mut self, clock: &wire::VEILWING_CLOCK_DATA, now: Instant) -> Option<MavMessage> {
        let utc = self.utc_at(now)?;
        if clock.receive_us != 0 {
            self.filter.take(clock.originate_us, clock.receive_us, clock.transmit_us, utc.unix_us);
            return None;
        }
        let reply =
            wire::VEILWING_CLOCK_DATA { receive_us: utc.unix_us, transmit_us: utc.unix_us, ..clock.clone() };
        Some(MavMessage::VEILWING_CLOCK(reply))
    }
}
