//! Figures as they are gathered: times, round trips, arrivals, a clock's rate.

use std::collections::BTreeMap;
use std::time::Duration;

use crate::time::Instant;

/// A question that is not answered by then will not be.
const LATEST_ANSWER: Duration = Duration::from_secs(1);

/// Numbers, to be asked for their quantiles.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Samples(Vec<f64>);

impl Samples {
    /// One more.
    pub fn add(&mut self, value: f64) {
        self.0.push(value);
    }

    /// A length of time more, in milliseconds.
    pub fn add_ms(&mut self, time: Duration) {
        self.add(time.as_secs_f64() * 1e3);
    }

    /// How many.
    #[must_use]
    pub fn count(&self) -> usize {
        self.0.len()
    }

    /// Median, 99% and largest, each one that was added; `None` where there is none.
    #[must_use]
    pub fn quantiles(&self) -> Option<[f64; 3]> {
        let mut sorted = self.0.clone();
        sorted.sort_by(f64::total_cmp);
        let at = |share: f64| {
            let index = (share * sorted.len() as f64).ceil() as usize;
            sorted.get(index.saturating_sub(1)).copied()
        };
        Some([at(0.5)?, at(0.99)?, at(1.0)?])
    }
}

/// Questions and their answers.
#[derive(Debug, Clone, Default)]
pub struct RoundTrips {
    waiting: BTreeMap<u64, Instant>,
    /// How long those that came took, in milliseconds.
    pub times: Samples,
    /// Those that were not answered in time.
    pub lost: u32,
}

impl RoundTrips {
    /// A question of this mark goes out.
    pub fn ask(&mut self, mark: u64, now: Instant) {
        self.forget(now);
        self.waiting.insert(mark, now);
    }

    /// The answer to it; when the question went out, if it waits for one.
    pub fn answered(&mut self, mark: u64, now: Instant) -> Option<Instant> {
        self.forget(now);
        let asked = self.waiting.remove(&mark)?;
        self.times.add_ms(now.saturating_since(asked));
        Some(asked)
    }

    /// What waited too long is lost.
    pub fn forget(&mut self, now: Instant) {
        let before = self.waiting.len();
        self.waiting.retain(|_, asked| now.saturating_since(*asked) <= LATEST_ANSWER);
        self.lost += u32::try_from(before - self.waiting.len()).unwrap_or(u32::MAX);
    }

    /// The share that was lost, of what is decided; `None` before anything is.
    #[must_use]
    pub fn loss(&self) -> Option<f64> {
        let answered = self.times.count() as f64;
        let decided = answered + f64::from(self.lost);
        (decided > 0.0).then(|| f64::from(self.lost) / decided)
    }
}

/// How one message comes.
#[derive(Debug, Clone, Default)]
pub struct Arrivals {
    first: Option<Instant>,
    last: Option<Instant>,
    /// Between two of them, in milliseconds.
    pub gaps: Samples,
}

impl Arrivals {
    /// One has come.
    pub fn add(&mut self, now: Instant) {
        if let Some(last) = self.last {
            self.gaps.add_ms(now.saturating_since(last));
        }
        self.first.get_or_insert(now);
        self.last = Some(now);
    }

    /// How many a second, from the first to the end.
    #[must_use]
    pub fn rate_hz(&self, end: Instant) -> f64 {
        match self.first {
            Some(first) if end > first => {
                self.gaps.count() as f64 / end.saturating_since(first).as_secs_f64()
            }
            _ => 0.0,
        }
    }
}

/// Another clock's rate against ours, from exchanges of a known uncertainty: the least uncertain one early, and one late.
#[derive(Debug, Clone, Default)]
pub struct Drift {
    exchanges: Vec<Exchange>,
}

#[derive(Debug, Clone, Copy)]
struct Exchange {
    at_us: f64,
    offset_us: f64,
    within_us: f64,
}

impl Drift {
    /// Asked and answered at these instants of ours; the other clock read this.
    pub fn add(&mut self, asked: Instant, answered: Instant, other_us: f64) {
        let [asked, answered] = [asked, answered].map(|at| at.since_start().as_secs_f64() * 1e6);
        let at_us = f64::midpoint(asked, answered);
        self.exchanges.push(Exchange {
            at_us,
            offset_us: other_us - at_us,
            within_us: 0.5 * (answered - asked),
        });
    }

    /// In parts per million, and within what it is known.
    #[must_use]
    pub fn ppm(&self) -> Option<(f64, f64)> {
        let third = self.exchanges.len() / 3;
        let best =
            |part: &[Exchange]| part.iter().copied().min_by(|a, b| a.within_us.total_cmp(&b.within_us));
        let early = best(self.exchanges.get(..third)?)?;
        let late = best(self.exchanges.get(self.exchanges.len() - third..)?)?;
        let span_us = late.at_us - early.at_us;
        (span_us > 0.0).then(|| {
            let ppm = (late.offset_us - early.offset_us) / span_us * 1e6;
            (ppm, (early.within_us + late.within_us) / span_us * 1e6)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(ms: u64) -> Instant {
        Instant::from_start(Duration::from_millis(ms))
    }

    #[test]
    fn val_quantiles_are_values_that_were_there() {
        let mut samples = Samples::default();
        assert_eq!(samples.quantiles(), None);
        (1..=200).rev().for_each(|value| samples.add(f64::from(value)));
        assert_eq!(samples.quantiles(), Some([100.0, 198.0, 200.0]));
    }

    #[test]
    fn spec_a_question_is_answered_once_or_lost() {
        let mut trips = RoundTrips::default();
        for mark in 0..10 {
            trips.ask(mark, at(mark * 100));
        }
        for mark in [0, 3, 3, 77] {
            trips.answered(mark, at(500));
        }
        assert_eq!((trips.times.count(), trips.loss()), (2, Some(0.0)));
        trips.forget(at(5000));
        assert_eq!((trips.lost, trips.loss()), (8, Some(0.8)));
    }

    #[test]
    fn val_a_clock_that_gains_100_ppm_is_found_within_what_is_said() {
        let mut drift = Drift::default();
        for k in 0..300u64 {
            // Between 2 and 20 ms there and back, not evenly so.
            let (there, back) = (1000 + k * 7 % 9000, 1000 + k * 11 % 9000);
            let asked = Duration::from_micros(k * 100_000);
            let read = asked + Duration::from_micros(there);
            let other_us = read.as_secs_f64() * 1e6 * (1.0 + 100e-6) + 5e6;
            let answered = read + Duration::from_micros(back);
            drift.add(Instant::from_start(asked), Instant::from_start(answered), other_us);
        }
        let (ppm, within) = drift.ppm().unwrap();
        assert!((ppm - 100.0).abs() <= within && within < 200.0, "{ppm} +- {within}");
    }

    #[test]
    fn val_fifty_a_second_are_fifty_hertz() {
        let mut arrivals = Arrivals::default();
        (0..=100).for_each(|k| arrivals.add(at(k * 20)));
        assert!((arrivals.rate_hz(at(2000)) - 50.0).abs() < 1e-9);
        // It has stopped since.
        assert!((arrivals.rate_hz(at(4000)) - 25.0).abs() < 1e-9);
        assert_eq!(Arrivals::default().rate_hz(at(9)), 0.0);
    }
}
