//! F2 after a stall: an autopilot whose stream of setpoints has ended leaves our mode, and PX4 takes it again, unasked, at
//! the next setpoint. A companion that was not run for so long does not know, whatever waits at its door, and sends none
//! before a heartbeat that was sent since shows the mode.

use std::time::Duration;

use crate::time::Instant;

/// The autopilot may have left our mode after so long without a setpoint: just within PX4's COM_OF_LOSS_T of 1 s.
const OUTLIVES: Duration = Duration::from_millis(950);
/// What came within this of the awakening may have been sent before.
const AT_THE_DOOR: Duration = Duration::from_millis(100);

/// See the module.
#[derive(Debug, Clone, Default)]
pub(super) struct Stall {
    set_at: Option<Instant>,
    /// The mode is in doubt since.
    doubt: Option<Instant>,
}

impl Stall {
    /// A setpoint is due; whether it may go out.
    pub fn allows(&mut self, held: bool, now: Instant) -> bool {
        let before = self.set_at.replace(now);
        let stalled = before.is_some_and(|before| now.saturating_since(before) > OUTLIVES);
        if !held {
            self.doubt = None;
        } else if stalled {
            self.doubt = Some(now);
        }
        self.doubt.is_none()
    }

    /// A heartbeat shows our mode.
    pub fn shown(&mut self, now: Instant) {
        self.doubt = self.doubt.filter(|since| now < *since + AT_THE_DOOR);
    }

    /// Whether the mode may be another by now.
    pub fn is_in_doubt(&self) -> bool {
        self.doubt.is_some()
    }

    /// No setpoints are wanted.
    pub fn ends(&mut self) {
        *self = Self::default();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(ms: u64) -> Instant {
        Instant::from_start(Duration::from_millis(ms))
    }

    #[test]
    fn spec_after_a_stall_nothing_goes_out_before_a_heartbeat_sent_since() {
        let mut stall = Stall::default();
        assert!(stall.allows(true, at(0)) && stall.allows(true, at(20)) && stall.allows(true, at(970)));
        assert!(!stall.allows(true, at(1921)) && stall.is_in_doubt());
        // It waited at the door.
        stall.shown(at(2020));
        assert!(!stall.allows(true, at(2020)));
        stall.shown(at(2021));
        assert!(stall.allows(true, at(2040)) && !stall.is_in_doubt());
    }

    #[test]
    fn spec_nothing_is_in_doubt_that_is_not_held_or_no_more_wanted() {
        let mut stall = Stall::default();
        assert!(stall.allows(false, at(0)) && stall.allows(false, at(5000)));
        assert!(!stall.allows(true, at(9000)));
        stall.ends();
        assert!(stall.allows(true, at(20_000)));
    }
}
