//! J: whether its jamming protects anybody.
//!
//! A pair link too slow for leases, or a radio of I's that does not answer, leaves I off, or on for moments, while J would
//! jam a whole slot for nothing.

use std::time::Duration;

use crate::time::Instant;

/// J ends a slot once I has been off for so long ...
const MOST_IN_VAIN: Duration = Duration::from_millis(1500);
/// ... with every moment on making up for so many off.
const MAKES_UP_FOR: u32 = 2;

/// What J's own radio has confirmed of a slot's power: without all of it J vouches for nothing, and I has to stay off.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Jamming {
    /// Nothing.
    Unconfirmed,
    /// So many watts, less than the plan's: most radios have steps.
    Short {
        /// Confirmed.
        given_w: f64,
        /// The plan's.
        planned_w: f64,
    },
    /// The plan's.
    Full,
}

/// Weighs the time in which I is on against the time in which it is off.
#[derive(Debug, Clone, Default)]
pub(super) struct Protection {
    in_vain: Duration,
    /// What has held since: that I is on, or not; `None` while J is off itself, or I is not yet to be on.
    held: Option<(bool, Instant)>,
}

impl Protection {
    /// From now on I is on, or is not; `None`: it need not be, and all is forgotten.
    pub fn feed(&mut self, i_on: Option<bool>, now: Instant) {
        match self.held.filter(|_| i_on.is_some()) {
            None => self.in_vain = Duration::ZERO,
            Some((true, since)) => {
                let made_up_for = now.saturating_since(since) * MAKES_UP_FOR;
                self.in_vain = self.in_vain.saturating_sub(made_up_for);
            }
            Some((false, since)) => self.in_vain += now.saturating_since(since),
        }
        self.held = i_on.map(|on| (on, now));
    }

    /// Whether J jams for nothing.
    pub fn is_in_vain(&self) -> bool {
        self.in_vain >= MOST_IN_VAIN
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// When J has enough of an I that is on for `on_ms` of each 100 ms.
    fn in_vain_after(on_ms: u64) -> Option<u64> {
        let mut protection = Protection::default();
        (0..60_000).find(|&ms| {
            protection.feed(Some(ms % 100 < on_ms), Instant::from_start(Duration::from_millis(ms)));
            protection.is_in_vain()
        })
    }

    #[test]
    fn val_the_time_until_j_has_enough() {
        assert_eq!(in_vain_after(0), Some(1500));
        // 88 ms in the first 100 ms, then 88 ms less twice 12 ms in each, and in the 24th the rest.
        assert_eq!(in_vain_after(12), Some(2300 + 12 + (1500 - 88 - 22 * 64 + 24)));
        assert_eq!(in_vain_after(34), None, "a third is worth it");
        assert_eq!(in_vain_after(100), None);
    }

    #[test]
    fn spec_while_j_is_off_nothing_is_in_vain() {
        let mut protection = Protection::default();
        let mut feed = |i_on, ms| {
            protection.feed(i_on, Instant::from_start(Duration::from_millis(ms)));
            protection.is_in_vain()
        };
        assert!(!feed(Some(false), 1000) && !feed(Some(false), 2499));
        assert!(
            !feed(None, 2500) && !feed(None, 9000) && !feed(Some(false), 9100) && !feed(Some(false), 10_500)
        );
        assert!(feed(Some(false), 10_600));
    }
}
