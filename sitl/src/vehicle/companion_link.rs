//! The link between a companion and its vehicle: whole, degraded, or cut.

use std::collections::VecDeque;
use std::time::Duration;

use crate::random::{Noise, Purpose};

/// What becomes of bytes on the way.
#[derive(Debug, Clone)]
pub(super) struct CompanionLink {
    /// Both directions are cut.
    pub down: bool,
    /// Probability that a datagram is lost.
    loss: f64,
    delay: Duration,
    noise: Noise,
    to_vehicle: VecDeque<(Duration, Vec<u8>)>,
    to_companion: VecDeque<(Duration, Vec<u8>)>,
}

impl CompanionLink {
    pub fn new(seed: u64, vehicle: usize) -> Self {
        Self {
            down: false,
            loss: 0.0,
            delay: Duration::ZERO,
            noise: Noise::new(seed, Purpose::Link, vehicle),
            to_vehicle: VecDeque::new(),
            to_companion: VecDeque::new(),
        }
    }

    /// From now on datagrams are lost and late. What is under way stays so.
    pub fn degrade(&mut self, loss: f64, delay: Duration) {
        (self.loss, self.delay) = (if loss.is_finite() { loss } else { 1.0 }, delay);
    }

    fn lost(&mut self) -> bool {
        self.down || self.loss > 0.0 && self.noise.uniform() < self.loss
    }

    /// Bytes from the companion: those that are here at once.
    pub fn receive<'a>(&mut self, bytes: &'a [u8], now: Duration) -> Option<&'a [u8]> {
        if self.lost() {
            None
        } else if self.delay > Duration::ZERO || !self.to_vehicle.is_empty() {
            self.to_vehicle.push_back((now + self.delay, bytes.to_vec()));
            None
        } else {
            Some(bytes)
        }
    }

    /// A frame for the companion: as it is if it is there at once.
    pub fn transmit(&mut self, frame: Vec<u8>, now: Duration) -> Option<Vec<u8>> {
        if self.lost() {
            None
        } else if self.delay > Duration::ZERO || !self.to_companion.is_empty() {
            self.to_companion.push_back((now + self.delay, frame));
            None
        } else {
            Some(frame)
        }
    }

    /// What has arrived at the vehicle after a delay.
    pub fn arrived(&mut self, now: Duration) -> Option<Vec<u8>> {
        due(&mut self.to_vehicle, now)
    }

    /// What has arrived at the companion after a delay.
    pub fn delivered(&mut self, now: Duration) -> Option<Vec<u8>> {
        due(&mut self.to_companion, now)
    }
}

fn due(queue: &mut VecDeque<(Duration, Vec<u8>)>, now: Duration) -> Option<Vec<u8>> {
    let ready = queue.front().is_some_and(|(at, _)| *at <= now);
    if ready { queue.pop_front().map(|(_, bytes)| bytes) } else { None }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spec_delay_keeps_the_order_and_loss_its_share() {
        let ms = Duration::from_millis;
        let mut link = CompanionLink::new(1, 0);
        assert_eq!(link.receive(b"a", ms(0)), Some(&b"a"[..]));
        link.degrade(0.0, ms(50));
        assert_eq!(link.receive(b"b", ms(10)), None);
        // Mended: what comes after does not overtake what is under way.
        link.degrade(0.0, ms(0));
        assert_eq!(link.receive(b"c", ms(20)), None);
        assert_eq!((link.arrived(ms(59)), link.arrived(ms(60))), (None, Some(b"b".to_vec())));
        assert_eq!(link.arrived(ms(60)), Some(b"c".to_vec()));
        link.degrade(0.3, ms(0));
        let passed = (0..10_000).filter(|_| link.transmit(vec![0], ms(99)).is_some()).count();
        assert!((passed as f64 / 10_000.0 - 0.7).abs() < 4.0 * (0.21f64 / 1e4).sqrt(), "{passed}");
        link.down = true;
        assert!(link.transmit(vec![0], ms(99)).is_none() && link.receive(b"d", ms(99)).is_none());
    }
}
