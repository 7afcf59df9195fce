//! How long before its transit a slot is proposed.

use std::time::Duration;

use crate::pair::Coordinator;
use crate::pair::wire::VeilwingAnswer;

/// Time for the agreement: longer on a slow link, and doubled each time it was not enough.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct AgreementTime {
    doublings: u32,
}

impl AgreementTime {
    const SHORTEST: Duration = Duration::from_secs(1);
    const LONGEST: Duration = Duration::from_secs(16);
    const MOST_DOUBLINGS: u32 = 4;

    /// The time to leave.
    pub fn time(self, pair: &Coordinator) -> Duration {
        // Twice the round trip, which is twice the uncertainty of the best comparison of clocks.
        let link = pair.clock_offset().map_or(Duration::ZERO, |offset| 4 * offset.uncertainty);
        (Self::SHORTEST * (1 << self.doublings) + link).min(Self::LONGEST)
    }

    /// The proposal was refused, or not agreed on in time.
    pub fn refused(&mut self, answer: VeilwingAnswer) {
        if answer == VeilwingAnswer::VEILWING_ANSWER_TOO_LATE {
            self.doublings = (self.doublings + 1).min(Self::MOST_DOUBLINGS);
        }
    }

    /// A slot was agreed on.
    pub fn agreed(&mut self) {
        self.doublings = self.doublings.saturating_sub(1);
    }
}
