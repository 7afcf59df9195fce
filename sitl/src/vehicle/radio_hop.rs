//! The last hop, between the autopilot and its payload radio: a line of its own, with faults of its own in each
//! direction.

use std::time::Duration;

use crate::random::Noise;

/// A direction of the hop.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Toward {
    /// Commands.
    Radio,
    /// Answers, and what the radio says unasked.
    Companion,
}

/// What a direction does to what goes over it; the default does nothing.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Manners {
    /// Probability that a message is lost.
    pub loss: f64,
    /// Probability that it arrives twice.
    pub duplication: f64,
    /// Seconds that each is under way.
    pub delay_s: f64,
    /// Uniform addition to the delay, each copy's own: they overtake one another.
    pub spread_s: f64,
}

/// One direction, with what is under way on it.
#[derive(Debug, Clone)]
pub(super) struct Lane<T> {
    manners: Manners,
    /// Nothing arrives; what was held up arrives at once when it goes on.
    frozen: bool,
    noise: Noise,
    under_way: Vec<(Duration, T)>,
}

impl<T: Clone> Lane<T> {
    pub fn new(noise: Noise) -> Self {
        Self { manners: Manners::default(), frozen: false, noise, under_way: Vec::new() }
    }

    /// From now on; what is under way stays so.
    pub fn behave(&mut self, manners: Manners) {
        self.manners = manners;
    }

    pub fn freeze(&mut self, frozen: bool) {
        self.frozen = frozen;
    }

    /// Whether it is anything but good.
    pub fn is_troubled(&self) -> bool {
        self.frozen || self.manners != Manners::default()
    }

    /// When the last of what is under way arrives, if it is not held up.
    pub fn clear_at(&self) -> Option<Duration> {
        self.under_way.iter().map(|(at, _)| *at).max()
    }

    fn draw(&mut self, probability: f64) -> bool {
        probability > 0.0 && self.noise.uniform() < probability
    }

    fn copies(&mut self) -> usize {
        if self.draw(self.manners.loss) { 0 } else { 1 + usize::from(self.draw(self.manners.duplication)) }
    }

    /// Sends something: what is due at once is found by [`Self::arrived`].
    pub fn send(&mut self, what: T, now: Duration) {
        for _ in 0..self.copies() {
            let spread =
                if self.manners.spread_s > 0.0 { self.noise.uniform() * self.manners.spread_s } else { 0.0 };
            let delay = Duration::try_from_secs_f64(self.manners.delay_s + spread).unwrap_or_default();
            self.under_way.push((now + delay, what.clone()));
        }
    }

    /// The first of what has arrived.
    pub fn arrived(&mut self, now: Duration) -> Option<T> {
        if self.frozen {
            return None;
        }
        let due = self.under_way.iter().enumerate().filter(|(_, (at, _))| *at <= now);
        let (first, _) = due.min_by_key(|(sent, (at, _))| (*at, *sent))?;
        Some(self.under_way.remove(first).1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Purpose;

    fn ms(ms: u64) -> Duration {
        Duration::from_millis(ms)
    }

    fn all(lane: &mut Lane<u64>, now: Duration) -> Vec<u64> {
        std::iter::from_fn(|| lane.arrived(now)).collect()
    }

    #[test]
    fn prop_a_lane_loses_doubles_delays_reorders_and_bursts_as_it_is_told() {
        let mut lane = Lane::new(Noise::new(3, Purpose::RadioHop, 0));
        lane.send(1, ms(0));
        assert_eq!(all(&mut lane, ms(0)), [1], "a good line does nothing");
        lane.behave(Manners { loss: 0.3, duplication: 0.2, ..Manners::default() });
        (0..10_000).for_each(|k| lane.send(k, ms(0)));
        let arrived = all(&mut lane, ms(0));
        let share = arrived.len() as f64 / 10_000.0;
        assert!((share - 0.7 * 1.2).abs() < 0.03, "{share}");
        lane.behave(Manners { delay_s: 0.1, spread_s: 0.1, ..Manners::default() });
        assert_eq!(lane.clear_at(), None);
        (0..100).for_each(|k| lane.send(k, ms(k)));
        assert!(all(&mut lane, ms(99)).is_empty());
        lane.behave(Manners::default());
        assert!(!lane.is_troubled());
        let clear_at = lane.clear_at().unwrap();
        assert!(clear_at > ms(199) && clear_at < ms(300), "what is under way stays so: {clear_at:?}");
        let arrived = all(&mut lane, clear_at);
        assert!(arrived.len() == 100 && !arrived.is_sorted(), "they overtake one another");
        assert_eq!(lane.clear_at(), None);
        lane.freeze(true);
        (0..5).for_each(|k| lane.send(k, ms(500 + 10 * k)));
        assert!(all(&mut lane, ms(900)).is_empty());
        assert!(lane.is_troubled());
        lane.freeze(false);
        assert!(!lane.is_troubled());
        assert_eq!(all(&mut lane, ms(900)), [0, 1, 2, 3, 4], "at once, in order");
    }
}
