//! One direction of a link that carries datagrams: it may lose them, repeat them, delay them, and let them overtake
//! one another.

use std::collections::BTreeMap;
use std::time::Duration;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use veilwing_sitl::Passage;

/// How a path treats its datagrams.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Path {
    /// Probability that one is lost.
    pub loss: f64,
    /// Probability that one arrives twice.
    pub duplication: f64,
    /// The shortest time under way.
    pub delay: Duration,
    /// Uniform addition to the delay of each: they may overtake one another.
    pub spread: Duration,
    /// Nothing arrives; what was held up arrives at once when it goes on.
    pub frozen: bool,
}

impl Path {
    /// A wire: a millisecond, nothing lost.
    pub const GOOD: Self = Self {
        loss: 0.0,
        duplication: 0.0,
        delay: Duration::from_millis(1),
        spread: Duration::ZERO,
        frozen: false,
    };
    /// Nothing arrives.
    pub const CUT: Self = Self { loss: 1.0, ..Self::GOOD };
    /// Nothing arrives yet.
    pub const FROZEN: Self = Self { frozen: true, ..Self::GOOD };

    /// What is sent is under way for so long at most.
    #[must_use]
    pub fn longest_way(&self) -> Duration {
        self.delay + self.spread
    }

    /// As the world's monitor is to take it.
    #[must_use]
    pub fn passage(&self) -> Passage {
        let whole = self.loss <= 0.0 && self.duplication <= 0.0;
        match self.loss >= 1.0 || self.frozen {
            true => Passage::Cut,
            false if whole && self.delay + self.spread <= Self::GOOD.delay => Passage::Good,
            false => Passage::Impaired,
        }
    }
}

/// A path and what is under way on it.
#[derive(Debug, Clone)]
pub(crate) struct Pipe {
    pub path: Path,
    rng: ChaCha8Rng,
    /// By arrival and, for those of one instant, by departure.
    under_way: BTreeMap<(Duration, u64), Vec<u8>>,
    numbered: u64,
}

impl Pipe {
    /// `stream` tells apart the pipes of one seed.
    pub fn new(path: Path, seed: u64, stream: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(stream);
        Self { path, rng, under_way: BTreeMap::new(), numbered: 0 }
    }

    /// Sends a datagram. Returns how many copies of it are lost.
    pub fn send(&mut self, bytes: &[u8], now: Duration) -> u64 {
        let path = self.path;
        let mut draw = |probability: f64| probability > 0.0 && self.rng.random::<f64>() < probability;
        let copies = 1 + u64::from(draw(path.duplication));
        let arriving = (0..copies).filter(|_| !draw(path.loss)).count() as u64;
        for _ in 0..arriving {
            let extra = match path.spread {
                Duration::ZERO => Duration::ZERO,
                spread => spread.mul_f64(self.rng.random::<f64>()),
            };
            self.numbered += 1;
            self.under_way.insert((now + path.delay + extra, self.numbered), bytes.to_vec());
        }
        copies - arriving
    }

    /// When the next datagram arrives, or arrived.
    pub fn next_arrival(&self) -> Option<Duration> {
        let first = self.under_way.first_key_value().filter(|_| !self.path.frozen)?;
        Some(first.0.0)
    }

    /// The next datagram that has arrived.
    pub fn receive(&mut self, now: Duration) -> Option<Vec<u8>> {
        let first = self.under_way.first_entry().filter(|_| !self.path.frozen)?;
        (first.key().0 <= now).then(|| first.remove())
    }

    /// Drops of what has arrived all but the first `kept`: a socket's buffer holds no more, and refuses what comes
    /// later. Returns how many.
    pub fn overflow(&mut self, kept: usize, now: Duration) -> u64 {
        let late: Vec<_> =
            self.under_way.keys().take_while(|(at, _)| *at <= now).skip(kept).copied().collect();
        for key in &late {
            self.under_way.remove(key);
        }
        late.len() as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    fn arrivals(path: Path, count: u32) -> Vec<(Duration, u8)> {
        let mut pipe = Pipe::new(path, 5, 0);
        let lost: u64 = (0..count).map(|k| pipe.send(&[k as u8], k * MS)).sum();
        let mut all = Vec::new();
        while let Some(at) = pipe.next_arrival() {
            assert_eq!(pipe.receive(at.saturating_sub(Duration::from_nanos(1))), None, "not before its time");
            all.push((at, pipe.receive(at).unwrap()[0]));
        }
        assert!(all.len() as u64 + lost >= u64::from(count));
        all
    }

    #[test]
    fn spec_a_good_path_delays_and_nothing_else() {
        let expected: Vec<_> = (0..50u32).map(|k| ((k + 1) * MS, k as u8)).collect();
        assert_eq!(arrivals(Path::GOOD, 50), expected);
        assert_eq!(arrivals(Path::CUT, 50), []);
    }

    #[test]
    fn val_loss_and_duplication_are_the_shares_asked_for() {
        let n = 20_000;
        let count = arrivals(Path { loss: 0.3, duplication: 0.2, ..Path::GOOD }, n).len() as f64;
        // Each copy survives with 0.7; 1.2 copies each. Variance below 1.2 a datagram.
        let expected = f64::from(n) * 1.2 * 0.7;
        assert!((count - expected).abs() < 4.0 * (1.2 * f64::from(n)).sqrt(), "{count} {expected}");
    }

    #[test]
    fn spec_a_spread_lets_datagrams_overtake_one_another() {
        let all = arrivals(Path { spread: 10 * MS, ..Path::GOOD }, 100);
        assert!(all.windows(2).any(|pair| pair[0].1 > pair[1].1));
        assert!(all.iter().all(|(at, k)| {
            let way = *at - u32::from(*k) * MS;
            way >= MS && way <= 11 * MS
        }));
    }

    #[test]
    fn spec_a_frozen_path_holds_up_what_it_carries_and_lets_it_go_at_once() {
        let mut pipe = Pipe::new(Path::GOOD, 5, 0);
        pipe.send(&[0], Duration::ZERO);
        pipe.path = Path::FROZEN;
        (1..5).for_each(|k| {
            pipe.send(&[k], u32::from(k) * MS);
        });
        assert_eq!((pipe.next_arrival(), pipe.receive(99 * MS)), (None, None));
        assert_eq!(pipe.path.passage(), Passage::Cut);
        pipe.path = Path::GOOD;
        let held: Vec<u8> = std::iter::from_fn(|| pipe.receive(100 * MS)).map(|bytes| bytes[0]).collect();
        assert_eq!(held, [0, 1, 2, 3, 4]);
    }

    #[test]
    fn spec_a_full_socket_refuses_what_comes_later() {
        let mut pipe = Pipe::new(Path::GOOD, 5, 0);
        (0..10).for_each(|k| {
            pipe.send(&[k], u32::from(k) * MS);
        });
        assert_eq!(pipe.overflow(3, 6 * MS), 3);
        let held: Vec<u8> = std::iter::from_fn(|| pipe.receive(100 * MS)).map(|bytes| bytes[0]).collect();
        assert_eq!(held, [0, 1, 2, 6, 7, 8, 9]);
    }
}
